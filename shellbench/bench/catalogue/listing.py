"""The list of cases, suites and solvers, with the requirements of each."""

from __future__ import annotations

import json
from collections import defaultdict
from io import StringIO
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import kinds_of_theories
from shellbench.bench.plugins.outside import describe_solver
from shellbench.bench.plugins.registry import OWN, SolverEntry, solver_entries
from shellbench.errors import InputError, ShellbenchError
from shellbench.problem import Problem, Quantity

WIDTH = 110  # characters


def contents() -> dict[str, Any]:
    """Return cases, suites and solvers as JSON data.

    A solver that can't be imported is listed with the reason.
    """
    return {
        "cases": [_case(name) for name in catalog.case_names()],
        "suites": [list_suite(name) for name in catalog.suite_names()],
        "solvers": [list_solver(entry) for entry in solver_entries().values()],
    }


def _case(name: str) -> dict[str, Any]:
    try:
        case = catalog.named_case(name)
    except InputError as error:
        return {"name": name, "package": catalog.package_of(name), "available": False, "reason": str(error)}
    return {
        "name": name,
        "available": True,
        "reason": None,
        "title": case.title,
        "description": case.description,
        "package": catalog.package_of(name),
        "suites": list(case.suites),
        "theory": case.theory,
        "units": case.units,
        "primary": case.primary.name,
        "quantities": [
            {"name": q.name, "kind": q.kind, "unit": q.unit, "tolerance": _tolerances(name, q.name)}
            for q in case.quantities
        ],
    }


def _tolerances(case: str, quantity: str) -> dict[str, float]:
    """Return the frozen tolerances of a quantity, by solver."""
    return {solver: allowed.largest for solver, allowed in catalog.tolerated(case, quantity).items()}


def list_suite(name: str) -> dict[str, Any]:
    """Return the description of a suite as JSON data."""
    suite = catalog.find_suite(name)
    return {
        "name": name,
        "title": suite.title,
        "package": catalog.package_of_suite(name),
        "cases": [case.name for case in catalog.members(name)],
        "variants": list(catalog.variants_asked(name)),
        "runs": [run.model_dump(mode="json") for run in suite.runs],
    }


def list_solver(entry: SolverEntry) -> dict[str, Any]:
    """Return the description of a solver as JSON data; the reason if it can't be imported."""
    origin = {"name": entry.name, "package": entry.distribution, "version": entry.version}
    try:
        facts = describe_solver(entry)
    except ShellbenchError as error:
        return origin | {"available": False, "reason": str(error)}
    return origin | {"available": True, "reason": None} | facts


def as_json() -> str:
    """Return all suites, cases and solvers as JSON."""
    return json.dumps(contents(), indent=1)


def overview(width: int | None = None) -> str:
    """Return suites and solvers by kind of problem as text, a line for each suite. No case is built for it."""
    kinds = {name: catalog.kind_named_by(name) for name in catalog.case_names()}
    cases = defaultdict[str, list[str]](list)
    for name in kinds:
        for suite in catalog.suites_named_by(name):
            cases[suite].append(name)
    suites = defaultdict[str, list[tuple[str, str, str]]](list)
    for name in catalog.suite_names():
        of, count = kinds[cases[name][0]] if cases[name] else "variants", str(len(cases[name]) or "")
        suites[of].append((name, count, catalog.find_suite(name).title + _from(catalog.package_of_suite(name))))
    solvers, unusable = defaultdict[str, list[str]](list), list[str]()
    for solver in (list_solver(entry) for entry in solver_entries().values()):
        if not solver["available"]:
            unusable.append(solver["reason"])
        for kind in kinds_of_theories(solver["theories"]) if solver["available"] else ():
            solvers[kind].append(solver["name"] + _from(solver["package"]))
    console = Console(file=StringIO(), width=width or WIDTH)
    table = _table("suite", "cases", "title")
    for kind in sorted(suites, key=lambda kind: -len(suites[kind])):
        table.add_row(f"[bold]{escape(kind)}[/bold]")
        for row in suites[kind]:
            table.add_row(*map(escape, row))
    console.print(table)
    table = _table("kind", "solvers")
    for kind in sorted(solvers, key=lambda kind: -len(solvers[kind])):
        table.add_row(escape(kind), escape(", ".join(solvers[kind])))
    console.print()
    console.print(table)
    count = "1 case" if len(kinds) == 1 else f"{len(kinds)} cases"
    hint = f"{count}: `shellbench list --all` has a line for each,\n`shellbench list NAME` says all about one."
    return "\n".join([_printed(console), "", *unusable, hint])


def all_cases(width: int | None = None) -> str:
    """Return a line for each case as text; only names and titles if the given width has no room for more."""
    narrow = width is not None and width < WIDTH
    console = Console(file=StringIO(), width=width if narrow else WIDTH)
    table = _table(*("case", "title", "theory", "suites")[: 2 if narrow else None])
    for case in map(_case, catalog.case_names()):
        title = f"{case['title']}{_from(case['package'])}" if case["available"] else case["reason"]
        shown = [title, case["theory"], ", ".join(case["suites"])] if case["available"] else [title]
        table.add_row(case["name"], *map(escape, shown[: len(table.columns) - 1]))
    console.print(table)
    more = ["", "`shellbench list NAME` says all about one; --wide shows more columns."] if narrow else []
    return "\n".join([_printed(console), *more])


def _printed(console: Console) -> str:
    """Return the text that a console has printed, without trailing blanks."""
    file = console.file
    assert isinstance(file, StringIO)
    return "\n".join(line.rstrip() for line in file.getvalue().rstrip().splitlines())


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for i, column in enumerate(columns):
        table.add_column(column, no_wrap=i == 0, overflow="fold")
    return table


def _from(package: str) -> str:
    """Return the words that name the package of an entry; empty for shellbench's own."""
    return "" if package == OWN else f" (package {package})"


def run_words(run: dict[str, Any]) -> str:
    """Return the name of a suite's run in tables."""
    return f"{run['solver']} {run['label']}".strip()


def gated_quantities(case: Problem, solver: str) -> list[Quantity]:
    """Return the quantities of one of the suite's own cases that have a frozen tolerance for a solver."""
    return [q for q in case.quantities if catalog.tolerance(case.name, q.name, solver) is not None]
