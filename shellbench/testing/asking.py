"""Checks of what a solver says before it solves: its parts, what it declines, and what it refuses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from shellbench.bench.task import case_data
from shellbench.engine import ENGINE
from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Examination, Findings, Verdict, shells
from shellbench.testing.subject import Lost, NoAnswer, Raised, Refused, SolveFailed, UnknownName

SLOW = 10.0  # seconds to decline a case: it is asked of every pair of a table
LONGEST_CLAUSE = 300  # characters: it stands in a line of a list
NO_SETTING = "no_solver_has_this_setting"
NO_VALUE = {"no_setting": "takes this table"}
NO_ENGINE = "an engine of another version 0.0"
BOUNDS = {"exclusiveMinimum": 0.0, "minimum": -1.0, "exclusiveMaximum": 0.0, "maximum": 1.0}
"""Keys of a JSON schema that bound a number, each with the step from it that is out of bounds."""


def protocol(exam: Examination) -> Verdict:
    """Check that the solver has the parts of the protocol, of their types, and that its name is the entry point's."""
    found, facts = Findings(faults=list(exam.facts["faults"])), exam.facts
    found.hold(facts["name"] == exam.entry.name, f"it is called '{facts['name']}', its entry point '{exam.entry.name}'")
    settings = f"{len(facts['defaults'])} settings{', seeded' if facts['seeded'] else ''}"
    optional = ", ".join(facts["optional"]) or "none"
    found.figures.append(f"{', '.join(facts['theories'])}; {settings}; optional parts: {optional}")
    return found.verdict()


def declining(exam: Examination) -> Verdict:
    """Check that each shipped case is taken or declined in one clause, quickly, and one at least is taken."""
    found, cases = Findings(), shells()
    taken: list[str] = []
    slowest = 0.0
    for case, (kind, answer, seconds) in zip(cases, exam.refusals(cases), strict=True):
        slowest = max(slowest, seconds)
        if kind != "ok":
            found.faults.append(f"declines({case.name}) {answer}")
        elif answer is None:
            taken.append(case.name)
            stated = case.theory in exam.facts["theories"]
            found.hold(stated, f"it takes {case.name}, whose theory {case.theory} it does not state")
        else:
            short = answer.strip() and "\n" not in answer and len(answer) <= LONGEST_CLAUSE
            found.hold(bool(short), f"it declines {case.name} with {answer[:60]!r}, which is not one clause")
        found.hold(seconds <= SLOW, f"declines({case.name}) took {seconds:.0f} s")
    found.hold(bool(taken), "it declines every case, so nothing can be shown")
    found.figures.append(f"takes {len(taken)} of {len(cases)} cases; slowest answer {slowest:.2f} s")
    return found.verdict()


def bad_input(exam: Examination) -> Verdict:
    """Check that settings that do not exist or can't be are refused, and that a declined case is not solved."""
    found = Findings()
    fault = _not_refused(exam, {NO_SETTING: 1}, "a setting that it does not have")
    found.hold(fault is None, fault or "", "unknown setting refused")
    tried = list(_impossible(exam.facts["schema"]))
    for setting in tried:
        fault = _not_refused(exam, setting, f"{next(iter(setting))} = {next(iter(setting.values()))!r}")
        found.hold(fault is None, fault or "")
    if tried:
        found.figures.append(f"{len(tried)} impossible values refused")
    else:
        found.unseen.append("it has no settings to give impossible values")
    _declined_case(exam, found)
    return found.verdict()


def _not_refused(exam: Examination, setting: Mapping[str, Any], what: str) -> str | None:
    try:
        exam.subject.call("settings", dict(setting))
    except Refused:
        return None
    except NoAnswer as trouble:
        return f"{what}: {trouble}"
    return f"its settings take {what}"


def _impossible(schema: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield settings that can't be: numbers out of each bound, tables, and another engine than there is."""
    for name, field in schema.get("properties", {}).items():
        if name == ENGINE:
            yield {name: NO_ENGINE}
        for option in (field, *field.get("anyOf", ())):
            for bound, step in BOUNDS.items():
                if bound in option:
                    yield {name: option[bound] + step}
        typed = [option.get("type") for option in (field, *field.get("anyOf", ()))]
        if any(typed) and "object" not in typed:
            yield {name: NO_VALUE}


def _declined_case(exam: Examination, found: Findings) -> None:
    case = _first_declined(exam)
    if case is None:
        found.unseen.append("it declines no case that could be given to it anyway")
        return
    try:
        data = {**case_data(case), "name": case.name}
        exam.subject.call("solve", "declined", data, dict(exam.settings))
    except (Refused, SolveFailed):
        found.figures.append(f"{case.name}, which it declines, refused")
    except (Raised, UnknownName, Lost) as trouble:
        found.faults.append(f"{case.name}, which it declines, given to it anyway: {trouble}")
    else:
        found.faults.append(f"it answers {case.name}, which it declines")


def _first_declined(exam: Examination) -> Case | None:
    cases = shells()
    for case, (kind, answer, _) in zip(cases, exam.refusals(cases), strict=True):
        if kind == "ok" and answer is not None:
            return case
    return None
