"""The list of checks, and how it is gone through."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shellbench.bench.registry import SolverEntry
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.testing import (
    answers,
    asking,
    continuity,
    convergence,
    energy,
    invariance,
    keeping,
)
from shellbench.testing.examination import (
    AlreadyReported,
    Examination,
    Verdict,
    failed,
    not_applicable,
    not_shown,
    shells,
)
from shellbench.testing.made_cases import CLOSED, MOVING, STATIC, short_motion
from shellbench.testing.subject import NoAnswer, Refused, Respondent, Subject

Ask = Callable[[Examination], Verdict]
AskOfCase = Callable[[Examination, Case], Verdict]
Tell = Callable[[str], None]
Start = Callable[[], Respondent]

OF_SOLVER: Mapping[str, Ask] = {
    "protocol": asking.protocol,
    "declining": asking.declining,
    "bad input": asking.bad_input,
}
OF_CASE: Mapping[str, AskOfCase] = {
    "answers": answers.displacements,
    "fields": answers.fields,
    "batching": answers.batching,
    "continuity": continuity.continuity,
    "seam": continuity.seam,
    "course": continuity.course,
    "determinism": answers.determinism,
    "units": invariance.units,
    "linearity": invariance.linearity,
    "placement": invariance.placement,
    "rigid motion": invariance.rigid_motion,
    "convergence": convergence.convergence,
    "energies": energy.energies,
    "work": energy.work,
    "strains": energy.strain_fields,
    "history": answers.history,
    "saving": keeping.saving,
    "parameters": keeping.counts,
    "storage": keeping.storage,
}


@dataclass(frozen=True)
class Line:
    """One check's outcome; `case` is empty where it asks about the solver alone."""

    check: str
    case: str
    verdict: Verdict


@dataclass(frozen=True)
class CheckOptions:
    """What is to be examined.

    Attributes
    ----------
    cases
        Cases to solve; empty: a cheap one that the solver takes.
    settings
        Settings that differ from the defaults.
    refinements
        Settings from coarse to fine; empty: the solver's own, or those of a suite.
    seconds
        Longest time for one answer of the solver.
    checks
        Names of the checks to make; empty: all.
    """

    cases: tuple[Case, ...] = ()
    settings: Mapping[str, Any] | None = None
    refinements: tuple[Mapping[str, Any], ...] = ()
    seconds: float = 600.0
    checks: tuple[str, ...] = ()


def examine(
    entry: SolverEntry, options: CheckOptions, tell: Tell = lambda _: None, start: Start | None = None
) -> Iterator[Line]:
    """Go through the checks of a solver, one line each.

    Parameters
    ----------
    tell
        Is told what is being asked.
    start
        Starts the solver; in a process of its own unless another way is given.

    Raises
    ------
    InputError
        If the solver can't be imported, or its settings are refused.
    """
    with tempfile.TemporaryDirectory(prefix="shellbench-") as folder:
        tell("import")
        exam = _begun(entry, options, Path(folder), start or (lambda: Subject.start(entry, options.seconds)))
        try:
            for name, ask in OF_SOLVER.items():
                if _wanted(options, name):
                    tell(name)
                    yield Line(name, "", _asked(lambda ask=ask: ask(exam)))  # type: ignore[misc]
            yield from _of_cases(exam, options, tell)
        finally:
            exam.close()


def _wanted(options: CheckOptions, check: str) -> bool:
    return not options.checks or check in options.checks


def _begun(entry: SolverEntry, options: CheckOptions, folder: Path, start: Start) -> Examination:
    try:
        subject = start()
    except NoAnswer as trouble:
        raise InputError(str(trouble).removeprefix("the import refused: ")) from None
    exam = Examination(entry, start, {}, dict(options.settings or {}), folder, options.refinements, subject)
    try:
        exam.facts = subject.call("describe")
        subject.call("settings", dict(exam.settings))
        for refinement in options.refinements:
            subject.call("settings", dict(refinement))
    except Refused as trouble:
        exam.close()
        reason = str(trouble).removeprefix("settings refused: ")
        raise InputError(f"settings of solver '{entry.name}': {reason}") from None
    except NoAnswer as trouble:
        exam.close()
        raise InputError(f"solver '{entry.name}' can't be described: {trouble}") from None
    return exam


def _of_cases(exam: Examination, options: CheckOptions, tell: Tell) -> Iterator[Line]:
    cases = options.cases or _cheap(exam)
    for case in cases:
        try:
            reason = exam.declined(case)
        except NoAnswer as trouble:
            reason = f"{trouble}"
        for name, ask in OF_CASE.items():
            if not _wanted(options, name):
                continue
            asked_of = case
            if name == "seam" and not any(case.surface.domain.periodic) and not options.cases:
                asked_of = _closed(exam) or case
            tell(f"{name}, {asked_of.name}")
            if reason is not None:
                yield Line(name, case.name, not_applicable(f"it declines the case: {reason}"))
            else:
                yield Line(name, asked_of.name, _asked(lambda ask=ask, c=asked_of: ask(exam, c)))  # type: ignore[misc]
    if not cases:
        yield Line("answers", "", not_shown("it takes no case that solvers are examined on: name one by --case"))


def _asked(ask: Callable[[], Verdict]) -> Verdict:
    """Return a check's verdict; a solver that does not answer has failed it."""
    try:
        return ask()
    except AlreadyReported as trouble:
        return not_shown(str(trouble))
    except NoAnswer as trouble:
        return failed(str(trouble))


def _cheap(exam: Examination) -> tuple[Case, ...]:
    """Return the first cheap case that the solver takes: a static one, a motion cut short, or else any static one."""
    others = (case for case in shells() if case.dynamics is None)
    for case in (*shells(STATIC), *map(short_motion, MOVING), *others):
        if _takes(exam, case):
            return (case,)
    return ()


def _closed(exam: Examination) -> Case | None:
    return next((case for case in shells(CLOSED) if _takes(exam, case)), None)


def _takes(exam: Examination, case: Case) -> bool:
    try:
        return exam.declined(case) is None
    except NoAnswer:
        return False
