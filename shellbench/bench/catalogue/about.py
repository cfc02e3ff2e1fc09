"""Description of one case, suite or solver, for ``shellbench list NAME`` and for the pages of cases."""

from __future__ import annotations

import contextlib
import json
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.brought import claimed
from shellbench.bench.catalogue.listing import gated_quantities, list_solver, list_suite, run_words
from shellbench.bench.catalogue.reference import KnownValue, Tolerance
from shellbench.bench.plugins.kinds import find_kind
from shellbench.bench.plugins.outside import declines, describe_solver, resolve_solver
from shellbench.bench.plugins.registry import FILE, OWN, SolverEntry, find_solver, solver_entries
from shellbench.errors import InputError
from shellbench.problem import VARIANT, Problem, Quantity
from shellbench.protocol.schema import read_toml
from shellbench.protocol.spelling import nearest

Data = dict[str, Any]
WIDTH = 80  # letters of a line
ROLES = ("judge", "origin", "literature", "published")
NO_PART_OF_THE_QUESTION = {
    *("name", "kind", "title", "description", "also_known_as", "suites", "units", "theory", "quantities", "picture")
}


def about(name: str) -> Data:
    """Return the description of the case, suite or solver of this name as JSON data; its kind is under `what`.

    A case may be a variant, such as ``scordelis_lo@oblique``; a case or a solver may be a path to a TOML file. Other
    words are looked up in the titles of cases and in the names under which others know them.

    Raises
    ------
    InputError
        If nothing has this name, with the nearest ones; or a file is malformed.
    """
    base = name.partition(VARIANT)[0]
    if name.endswith(FILE) and "command" in read_toml(Path(name)):
        return about_solver(find_solver(name))
    if base in catalog.case_names() or base.endswith(".toml"):
        return about_case(catalog.find_case(name), name)
    if name in catalog.suite_names():
        return about_suite(name)
    if name in solver_entries():
        return about_solver(solver_entries()[name])
    if found := look_up(name):
        return {"what": "cases", "name": name, "cases": found}
    near = nearest(base, [*catalog.case_names(), *catalog.suite_names(), *solver_entries()])
    meant = f"the nearest is {near[0]}" if len(near) == 1 else f"the nearest are {', '.join(near)}"
    hint = f"{meant}; " if near else ""
    raise InputError(f"no case, suite or solver is called '{name}': {hint}`shellbench list` shows all")


def look_up(words: str) -> list[Data]:
    """Return name, title and other names of the cases whose title or other names have all these words, in any case."""
    found, asked = [], re.findall(r"\w+", words.casefold())
    for name in catalog.case_names() if asked else ():
        with contextlib.suppress(InputError):
            if not _has_all(asked, str(read_toml(catalog.case_file(name)))):
                continue  # building a case takes long
            case = catalog.named_case(name)
            if any(_has_all(asked, text) for text in (case.title, *(other.name for other in case.also_known_as))):
                found.append({"name": name, "title": case.title, "also_known_as": _other_names(case)})
    return found


def _has_all(words: list[str], text: str) -> bool:
    return set(words) <= set(re.findall(r"\w+", text.casefold()))


def _other_names(case: Problem) -> list[str]:
    return [other.words for other in case.also_known_as]


def about_case(case: Problem, asked: str = "") -> Data:
    """Return the description of a case: the question, the known values, and the tolerance of each solver.

    `asked` is how it was named, such as the path to its file; its own name if empty.
    """
    own = catalog.is_own(case)
    curves = () if own else catalog.known_values(case.name).curves
    return {
        "what": "case",
        "name": case.name,
        "title": case.title,
        "description": case.description,
        "also_known_as": _other_names(case),
        "kind": case.kind,
        "theory": case.theory,
        "units": case.units,
        "own_case": own,
        "package": None if own else catalog.package_of(case.name),
        "digest": case.digest(),
        "suites": list(case.suites),
        "variants": [] if VARIANT in case.name else _variants(case, asked or case.name),
        "primary": case.primary.name,
        "problem": {key: value for key, value in case.shown().items() if key not in NO_PART_OF_THE_QUESTION},
        "quantities": [_quantity(case, quantity, own) for quantity in case.quantities],
        "curves": [
            {"quantity": c.quantity, "role": c.role, "theory": c.theory, "origin": c.origin, "source": c.source}
            | {"points": len(c.values)}
            for c in curves
        ],
    }


def _variants(case: Problem, asked: str) -> list[Data]:
    """Return the variants of a case."""
    found = []
    for name, variant in find_kind(case.kind).statements.items():
        try:
            variant.make(case)
        except InputError:  # it can't be asked so
            continue
        found.append({"name": f"{asked}{VARIANT}{name}", "words": variant.words})
    return found


def _quantity(case: Problem, quantity: Quantity, own: bool) -> Data:
    known = (
        () if own else catalog.known_values(case.name).of(quantity.name, "judge", "origin", "literature", "published")
    )
    allowed = {} if own else catalog.tolerated(case.name, quantity.name)
    return {
        "name": quantity.name,
        "kind": quantity.kind,
        "description": quantity.description,
        "unit": quantity.unit,
        "primary": quantity.primary,
        "at": quantity.mark,
        "mark": case.telling_mark(quantity),
        "known": [_known(value, case.theory) for value in sorted(known, key=lambda v: ROLES.index(v.role))],
        "tolerances": {solver: found.model_dump(exclude_none=True) for solver, found in allowed.items()},
    }


def _known(value: KnownValue, theory: str) -> Data:
    """Return a known value; it judges only if it is of the theory of the case."""
    data = value.model_dump(exclude={"quantity"}, exclude_defaults=True)
    return data | {"judges": value.role == "judge" and value.theory == theory}


def about_suite(name: str) -> Data:
    """Return the description of a suite: its cases and variants, its runs, and its number of gated values by solver."""
    suite = catalog.find_suite(name)
    gated: dict[str, int] = {}
    for case in catalog.cases_of(name):
        # A run with settings of its own is not gated, and one with many seeds gates the same figures.
        for solver in dict.fromkeys(run.solver for run in suite.runs_for(case.name) if not run.settings):
            gated[solver] = gated.get(solver, 0) + len(gated_quantities(case, solver))
    return {
        "what": "suite",
        **list_suite(name),
        "study": suite.study,
        "remarks": list(suite.remarks),
        "titles": {case.name: case.title for case in catalog.members(name)},
        "gated": {solver: count for solver, count in gated.items() if count},
    }


def about_solver(entry: SolverEntry) -> Data:
    """Return the description of a solver: its settings, the suite's cases that it declines, and its tolerances."""
    if not entry.own:
        describe_solver(entry)  # an unresponsive plug-in counts as bad input here
    data = {"what": "solver", **list_solver(entry)}
    runs = [name for name in catalog.suite_names() if entry.name in {r.solver for r in catalog.find_suite(name).runs}]
    data |= {
        "suites": runs,
        "tolerances": _dumped(catalog.tolerances_of(entry.name)),
        "claims": _dumped(claimed(entry)),
    }
    if data["available"]:
        data["declines"] = _declined(entry)
    return data


def _dumped(held: Mapping[str, Mapping[str, Tolerance]]) -> Data:
    return {case: {name: t.model_dump(exclude_none=True) for name, t in of.items()} for case, of in held.items()}


def _declined(entry: SolverEntry) -> dict[str, str]:
    """Return the reasons for which a solver declines cases, by case."""
    solver = resolve_solver(entry)
    found = {}
    for name in catalog.case_names():
        try:
            reason = declines(solver, catalog.named_case(name))
        except InputError as error:
            reason = str(error)
        if reason is not None:
            found[name] = reason
    return found


def as_json(name: str) -> str:
    """Return the description as JSON."""
    return json.dumps(about(name), indent=1, ensure_ascii=False)


def as_text(name: str) -> str:
    """Return the description as text."""
    data = about(name)
    kinds = {"case": _case_lines, "cases": _found_lines, "suite": _suite_lines, "solver": _solver_lines}
    return "\n".join(line.rstrip() for line in kinds[data["what"]](data))


def _case_lines(case: Data) -> Iterator[str]:
    yield f"{case['name']}: {case['title']}"
    yield from _wrapped(case["description"])
    yield ""
    yield from _entry("also known as", "; ".join(case["also_known_as"]))
    yield from _entry("theory", f"{case['theory']}; units {case['units']}; kind {case['kind']}")
    yield from _entry("suites", _listed(case["suites"]) or ("none (your own case)" if case["own_case"] else "none"))
    if case["package"] not in (None, OWN):
        yield from _entry("package", case["package"])
    yield from _entry("variants", _listed(f"{v['name']} ({v['words']})" for v in case["variants"]))
    yield from _headed("Question")
    for name, value in question(case):
        yield from _entry(name, value)
    yield from _headed("Quantities")
    for quantity in case["quantities"]:
        yield from _quantity_lines(quantity)
    for curve in case["curves"]:
        yield f"curve of {curve['quantity']}, {curve['points']} points: {curve['origin']} [{curve['source']}]"


def _found_lines(found: Data) -> Iterator[str]:
    yield f"cases with '{found['name']}' in their title, or in a name under which others know them:"
    yield ""
    for case in found["cases"]:
        yield from _entry(case["name"], "; ".join([case["title"], *case["also_known_as"]]))


def question(case: Data) -> Iterator[tuple[str, str]]:
    """Yield name and words of each part of the question; parts of which there may be several have a number."""
    for key, value in case["problem"].items():
        if isinstance(value, list | tuple) and value and all(isinstance(item, dict) for item in value):
            for number, item in enumerate(value, 1):
                yield f"{key} {number}", _words(item)
        elif value not in ([], (), {}, None):
            yield key, _words(value)


def _words(value: Any) -> str:
    """Say a value of a case file in a line."""
    match value:
        case dict():
            return ", ".join(f"{key} = {_inner(item)}" for key, item in value.items() if item not in ([], (), {}, None))
        case list() | tuple():
            return ", ".join(map(_inner, value))
    return _inner(value)


def _inner(value: Any) -> str:
    match value:
        case dict():
            return f"{{{_words(value)}}}"
        case list() | tuple():
            return f"[{', '.join(map(_inner, value))}]"
        case bool():
            return "true" if value else "false"
        case float():
            return f"{value:.13g}"
    return str(value)


def _quantity_lines(quantity: Data) -> Iterator[str]:
    unit, mark = quantity["unit"] or "no unit", f", {quantity['mark']}" if quantity["mark"] else ""
    yield f"{quantity['name']} ({unit}{mark}{', headline' if quantity['primary'] else ''})"
    yield from _wrapped(quantity["description"] or quantity["kind"].replace("_", " "))
    for known in quantity["known"]:
        yield from _entry(known["role"], known_words(known, quantity["unit"]), indent=2)
    if not any(known["judges"] for known in quantity["known"]):
        yield from _entry("judge", "none: no value of its theory is known", indent=2)
    if quantity["tolerances"]:
        yield from _entry("tolerances", tolerance_words(quantity), indent=2)


def known_words(known: Data, unit: str) -> str:
    """Describe a known value: the number, its uncertainty, its theory, its origin and its source."""
    sure = f" ± {known['uncertainty']:.2g}" if known.get("uncertainty") is not None else ""
    where = ", ".join(filter(None, (known["source"], known.get("locator", ""))))
    note = f" {known['note']}" if known.get("note") else ""
    return f"{known['value']:.13g}{sure} {unit}".rstrip() + f", {known['theory']}: {known['origin']} [{where}]{note}"


def tolerance_words(quantity: Data) -> str:
    """Describe the tolerance of each solver, and open findings."""
    return _listed(f"{solver} {_allowed(held, quantity['unit'])}" for solver, held in quantity["tolerances"].items())


def _allowed(held: Data, unit: str) -> str:
    size = f"{held['relative']:g}" if "relative" in held else f"{held['absolute']:g} {unit}".rstrip() + " absolute"
    return f"{size} (open finding: {held['open_finding']})" if "open_finding" in held else size


def _suite_lines(suite: Data) -> Iterator[str]:
    yield f"{suite['name']}: {suite['title']}"
    for remark in suite["remarks"]:
        yield from _wrapped(remark)
    yield ""
    if suite["package"] != OWN:
        yield from _entry("package", suite["package"])
    if suite["study"]:
        yield from _entry("study", suite["study"])
    gated = _listed(f"{count} values of {solver}" for solver, count in suite["gated"].items())
    yield from _entry("gated", gated or "nothing")
    yield from _headed("Cases")
    for name, title in suite["titles"].items():
        yield from _entry(name, title)
    if suite["variants"]:
        yield from _headed("Variants")
        yield from _wrapped(_listed(suite["variants"]))
    yield from _headed("Runs")
    for run in suite["runs"]:
        settings = f", {_words(run['settings'])}" if run["settings"] else ""
        of = f", of {_listed(run['cases'])}" if run["cases"] else ""
        of += "" if run["variants"] or not suite["variants"] else ", no variants"
        yield from _entry(run_words(run), f"seeds {_listed(map(str, run['seeds']))}{settings}{of}")


def _solver_lines(solver: Data) -> Iterator[str]:
    yield f"{solver['name']}: {solver.get('label', solver['reason'])}"
    yield ""
    yield from _entry("package", f"{solver['package']} {solver['version']}")
    if solver["available"]:
        yield from _entry("theories", _listed(solver["theories"]))
        yield from _entry("devices", _listed(solver["devices"]))
        yield from _entry("seeds", "its answer depends on a seed" if solver["seeded"] else "none: one answer")
        if solver["engine"]:
            yield from _entry("engine", solver["engine"])
    yield from _entry("suites", _listed(solver["suites"]) or "none")
    if solver["available"]:
        yield from _headed("Settings")
        for one in solver["settings"]:
            yield from _entry(f"{one['name']} = {json.dumps(one['default'])}", one["description"] or "no description")
        yield from _headed(f"Declined, {len(solver['declines'])} of {len(catalog.case_names())} cases")
        reasons: dict[str, list[str]] = {}
        for case, reason in solver["declines"].items():
            reasons.setdefault(reason, []).append(case)
        for reason, cases in reasons.items():
            yield from _entry(reason, _listed(cases))
    for words, held in (("Frozen tolerances", solver["tolerances"]), ("What it claims of itself", solver["claims"])):
        if held:
            yield from _headed(words)
        for case, of in held.items():
            yield from _entry(case, _listed(f"{name} {_allowed(allowed, '')}" for name, allowed in of.items()))
    if not solver["tolerances"]:
        yield from _headed("Frozen tolerances")
        yield from _wrapped("none: `shellbench gate --solver` judges it by class, 1e-4, 1e-3 or 1e-2")


def _headed(words: str) -> Iterator[str]:
    yield ""
    yield words


def _entry(name: str, words: str, indent: int = 0) -> Iterator[str]:
    """Yield a name and its description, wrapped below itself."""
    if words:
        start = " " * indent
        yield from textwrap.wrap(
            f"{name}: {words}", WIDTH, initial_indent=start + "  ", subsequent_indent=start + "      ", **UNBROKEN
        )


def _wrapped(words: str) -> Iterator[str]:
    yield from textwrap.wrap(words, WIDTH, initial_indent="  ", subsequent_indent="  ", **UNBROKEN)


UNBROKEN: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)
