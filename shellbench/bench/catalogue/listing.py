"""The list of cases, suites and solvers, with the requirements of each."""

from __future__ import annotations

import json
from collections import defaultdict
from textwrap import wrap
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import kinds_of_theories
from shellbench.bench.plugins.outside import describe_solver
from shellbench.bench.plugins.registry import OWN, SolverEntry, solver_entries
from shellbench.errors import InputError, ShellbenchError
from shellbench.problem import Problem, Quantity

WIDTH, TITLE = 110, 64  # characters, of a line and of a title
NOT_GATED = "not gated"  # how titles of such suites end
UNUSABLE = ""  # in place of a kind: solvers that can't be imported


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
    """Return suites and solvers by kind of problem as text, a line for each gated suite. No case is built for it."""
    width = width or WIDTH
    kinds = {name: catalog.kind_named_by(name) for name in catalog.case_names()}
    cases, suites, solvers = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list), _solvers_by_kind()
    for name in kinds:
        for suite in catalog.suites_named_by(name):
            cases[suite].append(name)
    for suite in catalog.suite_names():
        suites[kinds[cases[suite][0]] if cases[suite] else "variants"].append(suite)
    lines = ["Suites by kind of problem, with the number of their cases:"]
    for kind in sorted({*suites, *solvers} - {UNUSABLE}, key=lambda kind: (-len(suites[kind]), kind)):
        of = f", solved by {', '.join(solvers[kind])}" if kind in solvers else ""
        lines += wrap(f"{kind}{of}", width, subsequent_indent="    ", break_on_hyphens=False)
        titles = {name: catalog.find_suite(name).title + _from(catalog.package_of_suite(name)) for name in suites[kind]}
        shown = [name for name in titles if not titles[name].endswith(NOT_GATED)]
        lines += [_shorten(f"  {name:<16} {len(cases[name]) or '':>3}  {titles[name]}", width) for name in shown]
        if rest := ", ".join(f"{name} ({len(cases[name])})" for name in titles if name not in shown):
            lines += wrap(f"  not gated: {rest}", width, subsequent_indent="    ")
    count = "1 case" if len(kinds) == 1 else f"{len(kinds)} cases"
    hint = f"{count}: `shellbench list --all` has a line for each, `shellbench list NAME` all about one."
    return "\n".join([*lines, "", *solvers[UNUSABLE], *wrap(hint, width)])


def _solvers_by_kind() -> defaultdict[str, list[str]]:
    """Return the names of solvers by kind of problem, and why the others can't be used."""
    found = defaultdict[str, list[str]](list)
    for solver in (list_solver(entry) for entry in solver_entries().values()):
        if not solver["available"]:
            found[UNUSABLE].append(solver["reason"])
        for kind in kinds_of_theories(solver["theories"]) if solver["available"] else ():
            found[kind].append(solver["name"] + _from(solver["package"]))
    return found


def all_cases(width: int | None = None) -> str:
    """Return a line for each case as text; only names and titles if the given width has no room for more."""
    narrow, names = width is not None and width < WIDTH, catalog.case_names()
    start, lines = max(map(len, names), default=0), []
    for case in map(_case, names):
        title = f"{case['title']}{_from(case['package'])}" if case["available"] else case["reason"]
        line = f"{case['name']:<{start}}  {title}"
        if case["available"] and not narrow:
            line = f"{line:<{start + TITLE}}  {case['theory']:<24}  {', '.join(case['suites'])}"
        lines.append(_shorten(line, width))
    return "\n".join(
        [*lines, *(["", "`shellbench list NAME` shows all about one; --wide adds columns."] if narrow else [])]
    )


def _shorten(line: str, width: int | None) -> str:
    return line if width is None or len(line) <= width else f"{line[: width - 1]}…"


def _from(package: str) -> str:
    """Return the words that name the package of an entry; empty for shellbench's own."""
    return "" if package == OWN else f" (package {package})"


def run_words(run: dict[str, Any]) -> str:
    """Return the name of a suite's run in tables."""
    return f"{run['solver']} {run['label']}".strip()


def gated_quantities(case: Problem, solver: str) -> list[Quantity]:
    """Return the quantities of one of the suite's own cases that have a frozen tolerance for a solver."""
    return [q for q in case.quantities if catalog.tolerance(case.name, q.name, solver) is not None]
