"""What the gate of the pytest plug-in judges, and what it says of each answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from shellbench.bench import catalog
from shellbench.bench.compare import gates, row_of, verdict
from shellbench.bench.current import CurrentRun
from shellbench.bench.plan import FIRST_SEED, declared_runs
from shellbench.bench.reference import KnownValue
from shellbench.bench.row import Row
from shellbench.problem import Problem, Quantity
from shellbench.testing.pytest_options import Tolerances
from shellbench.testing.pytest_solving import Answers

DIGITS = ".9g"  # of a value and of the known value beside it
Colour = Literal["green", "red", "expected failure", "not judged"]


@dataclass(frozen=True)
class Judgement:
    """What came of one quantity.

    Attributes
    ----------
    sentence
        Why it is red, expected to fail, or not judged; what was found where it is green.
    value, known
        In the quantity's unit.
    error
        Signed, of the value; relative unless `absolute`.
    seconds
        Wall time of the run; `kept` if an earlier session made it.
    """

    suite: str
    case: str
    solver: str
    quantity: str
    colour: Colour
    sentence: str
    unit: str
    value: float | None = None
    known: float | None = None
    error: float | None = None
    absolute: bool = False
    tolerance: float | None = None
    seconds: float | None = None
    kept: bool = False

    def plain(self) -> dict[str, Any]:
        """Return it as data that goes from one process to another."""
        return asdict(self)

    @classmethod
    def read(cls, data: Any) -> Judgement:
        """Make it of what `plain` has returned."""
        return cls(**data)


@dataclass(frozen=True)
class Question:
    """One quantity of one case that is put to a solver; `seeds` are all that the solver is run with."""

    suite: str
    case: Problem
    solver: str
    quantity: Quantity
    seed: int
    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Name of the item of pytest."""
        return self.quantity.name if len(self.seeds) == 1 else f"{self.quantity.name}[seed {self.seed}]"

    def judged(self, answers: Answers, tolerances: Tolerances) -> Judgement:
        """Solve the case, unless that was done, and judge the quantity."""
        solver, case, quantity = self.solver, self.case, self.quantity
        known = catalog.known_values(case.name)
        judge = known.judge(quantity.name, case.theory)
        if judge is None:
            others = sorted({v.theory for v in known.of(quantity.name, "judge")})
            only = f" (only one of {', '.join(others)})" if others else ""
            return self._says("red", f"no known value of its theory, {case.theory}, judges {quantity.name}{only}")
        answer = answers.of(case.name, solver, self.seeds)
        if answer.declined is not None:
            return self._says("not judged", f"not applicable: {answer.declined}")
        record = answer.record(self.seed)
        if record is None:
            return self._says("red", answer.trouble or f"solver '{solver}' left no record")
        row = row_of(CurrentRun(record, case, {}), quantity)
        tolerance = tolerances.of(case, quantity, solver)
        colour, sentence = self._verdict(row, judge, tolerance)
        return self._of(row, colour, sentence, tolerance, kept=not answers.is_new(record))

    def _verdict(self, row: Row, judge: KnownValue, tolerance: float | None) -> tuple[Colour, str]:
        """Return what a row of a run comes to, and why."""
        finding = row.open_finding
        if tolerance is None and row.status == "ok":
            option = f"--shellbench-tolerance={row.case}.{row.quantity}=TOL"
            why = f"no relative tolerance can judge it, its known value being {judge.value:g} {row.unit}: give {option}"
            return ("red" if row.primary else "not judged"), why
        holds, reason = verdict(row, tolerance)
        if finding is not None:
            why = "it passes, but is an open finding" if holds else "open finding"
            return ("red" if holds else "expected failure"), f"{why}: {finding}"
        if row.status != "ok" or row.value is None:
            return "red", f"the run failed: {reason}"
        error, relative = _error(row)
        unit = "" if relative else f" {row.unit}"
        words = (
            f"{row.quantity} is {row.value:{DIGITS}} {row.unit}, and its known value {judge.value:{DIGITS}} {row.unit} "
            f"({judge.origin} [{judge.source}], {judge.theory}): error {error:+.2e}{unit}, {tolerance:g} allowed"
        )
        outside = error is None or tolerance is None or not abs(error) <= tolerance
        return ("green" if holds else "red"), (words if holds or outside else f"{words}, but {reason}")

    def _says(self, colour: Colour, sentence: str) -> Judgement:
        return Judgement(self.suite, self.case.name, self.solver, self.name, colour, sentence, self.quantity.unit)

    def _of(self, row: Row, colour: Colour, sentence: str, tolerance: float | None, kept: bool) -> Judgement:
        error, relative = _error(row)
        return Judgement(
            suite=self.suite,
            case=self.case.name,
            solver=self.solver,
            quantity=self.name,
            colour=colour,
            sentence=sentence,
            unit=row.unit,
            value=row.value,
            known=row.reference,
            error=error,
            absolute=not relative,
            tolerance=tolerance,
            seconds=row.seconds,
            kept=kept,
        )


def questions(suite: str, case: Problem, solver: str) -> Iterator[Question]:
    """Yield what is judged: the headline, what has a known value of the case's theory, and what is gated."""
    seeds = seeds_of(suite, case, solver)
    known = catalog.known_values(case.name)
    for quantity in case.quantities:
        if quantity.primary or gates(case, quantity, solver) or known.judge(quantity.name, case.theory):
            for seed in seeds:
                yield Question(suite, case, solver, quantity, seed, seeds)


def seeds_of(suite: str, case: Problem, solver: str) -> tuple[int, ...]:
    """Return the seeds that a suite declares for a solver with default settings; one if it declares none."""
    declared = [run for run in declared_runs(catalog.find_suite(suite).runs, case) if run.solver == solver]
    seeds = dict.fromkeys(seed for run in declared if not run.settings for seed in run.seeds)
    return tuple(seeds) or (FIRST_SEED,)


def _error(row: Row) -> tuple[float | None, bool]:
    """Return the error by which a row is judged, and whether it is relative."""
    relative = not row.tolerance_is_absolute
    return (row.relative_error if relative else row.absolute_error), relative
