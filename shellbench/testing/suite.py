"""The list of checks and their execution, and the output and exit code of `shellbench check-solver`."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

from rich.console import Console
from rich.status import Status as Spinner
from rich.text import Text

from shellbench.bench.catalogue.catalog import find_case
from shellbench.bench.plugins.kinds import DEFAULT
from shellbench.bench.plugins.registry import SolverEntry, find_solver
from shellbench.bench.plugins.settings import parse_setting
from shellbench.bench.plugins.subject import NoAnswer, Refused, Respondent
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.problem import Problem
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.shell.case import Case
from shellbench.testing import answers, convergence, derivatives, keeping, mechanics, ropes
from shellbench.testing.between import between_points
from shellbench.testing.conforming import Line, needed_checks, store_results
from shellbench.testing.examination import (
    AlreadyReported,
    Examination,
    Status,
    Verdict,
    failed,
    not_applicable,
    not_shown,
    shells,
    why_no_energies,
)
from shellbench.testing.grading import ExamOptions, Graded, start_exam
from shellbench.testing.made_cases import CLOSED, MOVING, STATIC, short_motion
from shellbench.testing.subject import subject_of

Ask = Callable[[Examination], Verdict]
AskOfProblem = Callable[[Examination, Problem], Verdict]
Tell = Callable[[str], None]
Start = Callable[[], Respondent]

OF_SOLVER: Mapping[str, Ask] = {
    "protocol": answers.protocol,
    "declining": answers.declining,
    "bad input": answers.bad_input,
}
OF_CASE: Mapping[str, Callable[[Examination, Case], Verdict]] = {
    "answers": answers.displacements,
    "fields": answers.fields,
    "batching": answers.batching,
    "continuity": answers.continuity,
    "seam": answers.seam,
    "course": answers.course,
    "determinism": answers.determinism,
    "units": mechanics.units,
    "linearity": mechanics.linearity,
    "placement": mechanics.placement,
    "rigid motion": mechanics.rigid_motion,
    "convergence": convergence.convergence,
    "energies": mechanics.energies,
    "work": mechanics.work,
    "strains": mechanics.strain_fields,
    "derivatives": derivatives.derivatives,
    "history": answers.history,
    "saving": keeping.saving,
    "parameters": keeping.counts,
    "storage": keeping.storage,
}


OF_STRAINS = ("fields", "energies", "strains")
"""Of `OF_CASE`: those that a solver of displacements only can't pass. Its class needs `work`, by the known energy."""

OF_ROPE: Mapping[str, AskOfProblem] = {
    "answers": ropes.links,
    "determinism": answers.determinism,
    "units": ropes.units,
    "placement": ropes.placement,
    "convergence": convergence.convergence,
    "energy": ropes.energy,
    "history": answers.history,
    "saving": keeping.saving,
    "parameters": keeping.counts,
    "storage": keeping.storage,
}
OF_ANY: tuple[str, ...] = ("determinism", "convergence", "history", "saving", "parameters", "storage")
"""Of `OF_ROPE`: those that know of quantities only, for kinds of problem from elsewhere."""


@dataclass(frozen=True)
class CheckOptions:
    """Options of the checks.

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

    cases: tuple[Problem, ...] = ()
    settings: Mapping[str, Any] | None = None
    refinements: tuple[Mapping[str, Any], ...] = ()
    seconds: float = 600.0
    checks: tuple[str, ...] = ()


def examine(
    entry: SolverEntry, options: CheckOptions, tell: Tell = lambda _: None, start: Start | None = None
) -> Iterator[Line]:
    """Make the checks of a solver, one line each.

    Parameters
    ----------
    tell
        Receives the name of the current check.
    start
        Starts the solver; by default in a process of its own.

    Raises
    ------
    InputError
        If the solver can't be imported, or its settings are refused.
    """
    with tempfile.TemporaryDirectory(prefix="shellbench-") as folder:
        tell("import")
        exam = _begin_exam(entry, options, Path(folder), start or (lambda: subject_of(entry, options.seconds)))
        try:
            for name, ask in OF_SOLVER.items():
                if _wanted(options, name):
                    tell(name)
                    yield Line(name, "", _verdict_of(lambda ask=ask: ask(exam)))  # type: ignore[misc]
            yield from _of_cases(exam, options, tell)
        finally:
            exam.close()


def _wanted(options: CheckOptions, check: str) -> bool:
    return not options.checks or check in options.checks


def _begin_exam(entry: SolverEntry, options: CheckOptions, folder: Path, start: Start) -> Examination:
    try:
        subject = start()
    except NoAnswer as trouble:
        words, named = str(trouble).removeprefix("the import refused: "), f"solver '{entry.name}' can't be used: "
        raise InputError(named + words.removeprefix(named)) from None
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
        for name, ask in checks_of(case).items():
            if not _wanted(options, name):
                continue
            wanted = needed_checks(case.kind, exam.facts["theories"])
            asked_of, needed = case, name in wanted
            if name == "seam" and isinstance(case, Case) and not options.cases:
                asked_of = case if any(case.surface.domain.periodic) else _closed(exam) or case
            tell(f"{name}, {asked_of.name}")
            if reason is not None:
                verdict = not_applicable(f"it declines the case: {reason}")
            elif isinstance(case, Case) and name in OF_STRAINS and (lacking := why_no_energies(exam, case)):
                verdict, needed = not_applicable(lacking), needed and "work" not in wanted
            else:
                verdict = _verdict_of(lambda ask=ask, c=asked_of: ask(exam, c))  # type: ignore[misc]
            yield Line(name, asked_of.name, verdict, case.kind, needed)
    if not cases:
        yield Line("answers", "", not_shown("it takes no case that solvers are examined on: name one by --case"))


def checks_of(case: Problem) -> Mapping[str, AskOfProblem]:
    """Return the checks of a case: those of its kind."""
    if isinstance(case, Case):
        return cast(Mapping[str, AskOfProblem], OF_CASE)
    return OF_ROPE if isinstance(case, RopeCase) else {name: OF_ROPE[name] for name in OF_ANY}


def _verdict_of(ask: Callable[[], Verdict]) -> Verdict:
    """Return a check's verdict; it is failed if the solver does not answer."""
    try:
        return ask()
    except AlreadyReported as trouble:
        return not_shown(str(trouble))
    except NoAnswer as trouble:
        return failed(str(trouble))


def _cheap(exam: Examination) -> tuple[Problem, ...]:
    """Return the first cheap case of each kind that the solver takes.

    For shells it is a static one, a shortened motion, or else any static one.
    """
    kinds = dict.fromkeys(case.kind for case in exam.cases)
    others = (case for case in shells() if case.dynamics is None)
    of_shells = (*shells(STATIC), *map(short_motion, MOVING), *others) if DEFAULT in kinds else ()
    cheap = (*of_shells, *(case for case in ropes.cheap_cases() if case.kind in kinds))
    found: dict[str, Problem] = {}
    for case in (*cheap, *(case for case in exam.cases if case.kind != DEFAULT)):
        if case.kind not in found and _takes(exam, case):
            found[case.kind] = case
    return tuple(found.values())


def _closed(exam: Examination) -> Case | None:
    return next((case for case in shells(CLOSED) if _takes(exam, case)), None)


def _takes(exam: Examination, case: Problem) -> bool:
    try:
        return exam.declined(case) is None
    except NoAnswer:
        return False


COLOURS: dict[Status, str] = {"passed": "green", "failed": "red", "not applicable": "dim", "not shown": "yellow"}
LONGEST_STATUS = 14  # characters
GOOD, BAD, NOTHING_JUDGED = 0, 1, 2


def check_solver(
    name: str,
    cases: Sequence[str] = (),
    settings: Sequence[str] = (),
    refine: str | None = None,
    seconds: float = 600.0,
    as_json: bool = False,
    console: Console | None = None,
    exam: ExamOptions | None = None,
) -> int:
    """Check a solver, print the results, and return the exit code.

    It is 1 if a check failed, or if a graded third-party solver reaches no class; 2 if the exam judged nothing. Results
    of the checks with default settings are kept in the store of the exam, for the gate.

    Parameters
    ----------
    exam
        The exam that grades it, with default settings; None for no grade and no stored results.

    Raises
    ------
    InputError
        If the solver, a case or a setting is unknown, or an extra is missing.
    """
    entry = find_solver(name)
    options = CheckOptions(
        tuple(map(find_case, cases)), given_settings(name, settings), given_refinements(refine), seconds
    )
    out = console or Console(highlight=False, soft_wrap=True)
    suites = exam.asked_of(entry) if exam is not None else ()
    with contextlib.ExitStack() as stack:
        # The checks mostly wait for the solver's process. The exam uses the other cores meanwhile, and is shown later.
        grading = None
        if exam is not None and exam.grade and not options.settings:
            grading = stack.enter_context(start_exam(name, options.cases, suites, exam, seconds))
        lines = _gone_through(entry, options, out, as_json)
        if exam is not None and not options.settings:  # stored results are for default settings, like a class
            store_results(Store(exam.store), entry, lines)
        grade = grading and grading(Console(stderr=True) if as_json else out)
    begin = partial(subject_of, seconds=seconds)
    if exam is not None and grade is not None and grade.sitting is not None:
        grade = replace(grade, between=between_points(entry, grade.sitting.answers, exam.store, begin))
    elif exam is not None and exam.grade and grade is None:
        grade = Graded(name, suites, "grades are of default settings, and --set changes them")
    if as_json:
        data = {"solver": name, "checks": [as_data(line) for line in lines]} | (grade.as_data() if grade else {})
        out.out(json.dumps(data, indent=2), highlight=False)
    elif grade is not None:
        out.out("\n".join(grade.lines()), highlight=False)
    if any(line.verdict.status == "failed" for line in lines) or (grade and grade.fell_short):
        return BAD
    return NOTHING_JUDGED if grade and grade.judged_nothing else GOOD


def _gone_through(entry: SolverEntry, options: CheckOptions, out: Console, silent: bool) -> list[Line]:
    """Make the checks, and print each line immediately unless `silent`."""
    if silent:
        return list(examine(entry, options))
    if not out.is_terminal:
        lines = [_shown(out, line) for line in examine(entry, options)]
    else:
        with out.status(entry.name) as spinner:
            turn = partial(_turn, spinner, entry.name)
            lines = [_shown(out, line) for line in examine(entry, options, turn)]
    out.out(summary(entry.name, lines))
    return lines


def _turn(spinner: Spinner, name: str, word: str) -> None:
    spinner.update(f"{name}: {word}")


def _shown(out: Console, line: Line) -> Line:
    verdict = line.verdict
    where = f" ({line.case})" if line.case else ""
    text = Text.assemble(
        (f"{verdict.status:<{LONGEST_STATUS}} ", COLOURS[verdict.status]),
        f"{line.check}{where}: {verdict.words}",
    )
    out.print(text, soft_wrap=True)
    return line


def summary(name: str, lines: Sequence[Line]) -> str:
    """Return one line with the number of checks by outcome."""
    found = [line.verdict.status for line in lines]
    return f"{name}: " + ", ".join(f"{found.count(status)} {status}" for status in COLOURS if status in found)


def as_data(line: Line) -> dict[str, Any]:
    """Return a line as JSON data."""
    return {"check": line.check, "case": line.case, "status": line.verdict.status, "words": line.verdict.words}


def given_settings(name: str, texts: Sequence[str]) -> dict[str, Any]:
    """Read ``SOLVER.KEY=VALUE`` of the checked solver."""
    given = {}
    for text in texts:
        solver, key, value = parse_setting(text)
        if solver != name:
            raise InputError(f"--set {text}: the solver that is checked is '{name}'")
        given[key] = value
    return given


def given_refinements(text: str | None) -> tuple[dict[str, Any], ...]:
    """Read ``KEY=VALUE;VALUE;VALUE``, from coarse to fine, each value in TOML."""
    if text is None:
        return ()
    key, equals, values = text.partition("=")
    parts = [part for part in values.split(";") if part.strip()]
    if not equals or not key.strip() or len(parts) < 3:
        raise InputError(f"--refine: found {text!r}, but expected KEY=VALUE;VALUE;VALUE, from coarse to fine")
    return tuple({key.strip(): parse_setting(f"x.y={part.strip()}")[2]} for part in parts)
