"""Tools of the checks: the solver, the cases, answers that are solved for once, and verdicts.

A verdict is one of four words, with the measured figures.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import kinds_of_theories
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.plugins.subject import NoAnswer, Refused, Respondent
from shellbench.bench.store.task import case_data
from shellbench.problem import Problem
from shellbench.problems.shell.case import Case
from shellbench.testing.subject import RemoteSolution, solve_in

Array = NDArray[np.float64]
Setting = Mapping[str, Any]

SAMPLE = 17  # points a side of the grid on which displacements are compared
SAME = 1e-6  # relative difference that counts as zero
OWN = 3.0  # multiple of the solver's own stated uncertainty, or of the change by another seed
MOST_EXCUSED = 0.1  # largest relative difference for any stated uncertainty


def asked_kinds(theories: Iterable[str]) -> tuple[Problem, ...]:
    """Return the suite's own cases of the kinds that have one of these theories."""
    kinds = kinds_of_theories(theories)
    return tuple(case for case in map(catalog.named_case, catalog.case_names()) if case.kind in kinds)


def shells(names: Iterable[str] | None = None) -> tuple[Case, ...]:
    """Return the suite's own shells of these names; all shells if none are named."""
    cases = map(catalog.named_case, catalog.case_names() if names is None else names)
    return tuple(case for case in cases if isinstance(case, Case))


@dataclass
class Examination:
    """One solver under examination.

    Attributes
    ----------
    start
        Starts the solver in a process of its own.
    facts
        The solver's description of itself; see `shellbench.testing.child.solver_facts`.
    settings
        Settings that differ from the defaults in all solves.
    folder
        Folder for saved solutions.
    refinements
        Settings from coarse to fine; empty: the solver's own, or those of a suite.
    """

    entry: SolverEntry
    start: Callable[[], Respondent]
    facts: Setting
    settings: Setting
    folder: Path
    refinements: tuple[Setting, ...] = ()
    _subject: Respondent | None = None
    _answers: dict[str, RemoteSolution] = field(default_factory=dict)
    _troubles: dict[str, NoAnswer] = field(default_factory=dict)
    _refusals: dict[str, tuple[str, Any, float]] = field(default_factory=dict)

    @property
    def cases(self) -> tuple[Problem, ...]:
        """The suite's own cases of the kinds of problem that have the solver's theories."""
        return asked_kinds(self.facts["theories"])

    @property
    def subject(self) -> Respondent:
        """The running process; a new one if the last was lost."""
        if self._subject is None or not self._subject.alive:
            self._subject = self.start()
            self._answers.clear()
        return self._subject

    @contextmanager
    def fresh(self) -> Iterator[Respondent]:
        """Return a new process, without earlier solves."""
        subject = self.start()
        try:
            yield subject
        finally:
            subject.stop()

    def solve(self, case: Problem, settings: Setting | None = None) -> RemoteSolution:
        """Return the solver's answer to a case; answers are cached.

        Raises
        ------
        NoAnswer
            If there is none. `AlreadyReported` if an earlier check met the same failure, so that it is one finding.
        """
        chosen = {**self.settings, **(settings or {})}
        key = json.dumps([case.name, case.digest(), chosen], sort_keys=True)
        if key in self._troubles:
            raise AlreadyReported(f"its solve of {case.name} has no answer, as said above")
        subject = self.subject
        if key not in self._answers:
            try:
                self._answers[key] = solve_in(subject, key, case, chosen)
            except NoAnswer as trouble:
                self._troubles[key] = trouble
                raise
        return self._answers[key]

    def declined(self, case: Problem) -> str | None:
        """Return the reason why the solver declines a case, or None; raise `NoAnswer` if it can't be asked."""
        kind, answer, _ = self.refusals((case,))[0]
        if kind != "ok":
            raise NoAnswer(f"declines {answer}")
        return None if answer is None else str(answer)

    def refusals(self, cases: tuple[Problem, ...]) -> list[tuple[str, Any, float]]:
        """Return for each case ("ok", clause or None, seconds) or ("raised", words, seconds); None if it is taken."""
        keys = [f"{case.name} {case.digest()}" for case in cases]
        unasked = [i for i, key in enumerate(keys) if key not in self._refusals]
        if unasked:
            data = [{**case_data(cases[i]), "name": cases[i].name} for i in unasked]
            for i, answer in zip(unasked, self.subject.call("declines", data), strict=True):
                self._refusals[keys[i]] = answer
        return [self._refusals[key] for key in keys]

    def close(self) -> None:
        """End the process."""
        if self._subject is not None and self._subject.alive:
            self._subject.stop()


class AlreadyReported(NoAnswer):
    """A failure that an earlier check has already reported."""


def why_no_energies(exam: Examination, case: Case) -> str | None:
    """Return the reason why a solver has no energies of a case, if it declines and refuses them; None if it has."""
    reason: str | None = None
    try:
        reason = exam.subject.call("declines_energy", {**case_data(case), "name": case.name})
        if reason is not None:
            exam.solve(case).energies()
    except Refused:
        return reason
    except NoAnswer:  # the check itself reports it
        pass
    return None


def known_energy(case: Case) -> float | None:
    """Return the known strain energy of a case of the suite, J: it replaces that of a solver that has none."""
    energy = next((q for q in case.quantities if q.kind == "strain_energy"), None)
    known = catalog.known_values(case.name).judge(energy.name, case.theory) if energy else None
    return known.value / energy.factor if energy and known and not catalog.is_own(case) else None


def fingerprint(answer: RemoteSolution) -> Array:
    """Return the values by which two answers are compared: displacements on a grid of a shell, else all quantities."""
    return answer.displacement(grid(answer.case)) if isinstance(answer.case, Case) else answer.values()


def grid(case: Case, sides: int = SAMPLE) -> Array:
    """Return points (n, 2) on a regular grid of the closed domain."""
    return case.surface.domain.grid(sides, sides).reshape(-1, 2)


def scattered(case: Case, count: int, seed: int = 0, margin: float = 0.0) -> Array:
    """Return points (n, 2) at random in the domain, `margin` of its side away from the edges."""
    domain = case.surface.domain
    local = margin + (1 - 2 * margin) * np.random.default_rng(seed).random((count, 2))
    return np.asarray(domain.lower) + np.asarray(domain.size) * local


def deviation(first: Array, second: Array) -> float:
    """Return the largest difference of two fields, relative to the larger of their largest magnitudes."""
    size = max(np.abs(first).max(initial=0.0), np.abs(second).max(initial=0.0))
    return 0.0 if size == 0 else float(np.abs(first - second).max() / size)


def own_uncertainty(answer: RemoteSolution) -> float:
    """Return the solver's stated relative error of the headline quantity; 0 if it states none."""
    stated = float(answer.facts["uncertainty"].get(answer.case.primary.name, 0.0))
    if stated == 0:
        return 0.0
    value = abs(answer.headline())
    return stated / value if value > 0 else 0.0


def seed_difference(exam: Examination, case: Problem) -> float:
    """Return the difference of another seed's answer, relative to the largest displacement; 0 without a seed."""
    if not exam.facts["seeded"]:
        return 0.0
    other = exam.solve(case, {"seed": int(exam.settings.get("seed", exam.facts["defaults"]["seed"])) + 1})
    return deviation(fingerprint(exam.solve(case)), fingerprint(other))


def allowed_deviation(exam: Examination, case: Problem) -> float:
    """Return the admissible relative difference of two solves of one question."""
    return min(MOST_EXCUSED, max(SAME, OWN * own_uncertainty(exam.solve(case)), OWN * seed_difference(exam, case)))


Status = Literal["passed", "failed", "not applicable", "not shown"]
"""A check is not applicable where the solver or case lacks what is asked about, and not shown where the answer can't be
told either way; neither is a failure, and neither is a pass."""


@dataclass(frozen=True)
class Verdict:
    """Result of a check.

    Attributes
    ----------
    words
        One line: the measured figures, or the faults.
    """

    status: Status
    words: str


@dataclass
class Findings:
    """Findings of a check so far.

    Attributes
    ----------
    faults
        Faults; any fault fails the check.
    figures
        Measurements that are in order.
    unseen
        Questions that could not be decided, with the reason.
    """

    faults: list[str] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)
    unseen: list[str] = field(default_factory=list)

    def hold(self, holds: bool, fault: str, figure: str = "") -> bool:
        """Note the fault if `holds` is false, else the measured value; return `holds`."""
        if not holds:
            self.faults.append(fault)
        elif figure:
            self.figures.append(figure)
        return holds

    def verdict(self) -> Verdict:
        """Return the result of the check."""
        if self.faults:
            return Verdict("failed", "; ".join(self.faults))
        if self.unseen and not self.figures:
            return Verdict("not shown", "; ".join(self.unseen))
        return Verdict("passed", "; ".join([*self.figures, *(f"not shown: {words}" for words in self.unseen)]))


def not_applicable(reason: str) -> Verdict:
    """Return the verdict of a check that does not apply."""
    return Verdict("not applicable", reason)


def not_shown(reason: str) -> Verdict:
    """Return the verdict of a check that could not decide."""
    return Verdict("not shown", reason)


def failed(reason: str) -> Verdict:
    """Return the verdict of a check that found a fault."""
    return Verdict("failed", reason)
