"""Judgements of the pytest plug-in, by the gate's own rows and verdicts, and the table of its findings.

A solver's answers to a case are computed once in a session of pytest. All items and processes share them.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.listing import gated_quantities
from shellbench.bench.catalogue.reference import KnownValue, Tolerance
from shellbench.bench.judge.compare import near_zero, row_of, without_record
from shellbench.bench.judge.row import Colour, Finding, Row
from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import execute
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.run.plan import FIRST_SEED, Request, make_plan
from shellbench.bench.store.current import CurrentRun, newest, run_key
from shellbench.bench.store.environment import cores, threads
from shellbench.bench.store.record import ANSWERED, Record
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.disk import said_plainly
from shellbench.errors import InputError, ShellbenchError
from shellbench.problem import Problem, Quantity

try:
    import fcntl
except ImportError:  # pragma: no cover - no such locks outside POSIX; then each process solves for itself
    fcntl = None  # type: ignore[assignment]

DEFAULT_TOLERANCE = 1e-2  # relative: an engineer's percent, until the project states its own
WHOLE = 1.0  # relative error of the answer zero
WORKERS = "PYTEST_XDIST_WORKER_COUNT"  # set by pytest-xdist in each of its processes


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of a solver without frozen tolerances.

    Attributes
    ----------
    general
        Relative error, unless a narrower one is given.
    narrower
        By case, or by case and quantity; absolute, in the quantity's unit, if its error is absolute.
    """

    general: float = DEFAULT_TOLERANCE
    narrower: Mapping[tuple[str, str | None], float] = field(default_factory=dict)

    @classmethod
    def read(cls, texts: Sequence[str]) -> Tolerances:
        """Read ``TOL``, ``CASE=TOL`` and ``CASE.QUANTITY=TOL``; InputError in one sentence for other forms."""
        general = DEFAULT_TOLERANCE
        narrower: dict[tuple[str, str | None], float] = {}
        for text in texts:
            where, _, number = text.rpartition("=")
            tolerance = positive(number, f"--shellbench-tolerance={text}")
            case_name, _, quantity = where.partition(".")
            if not quantity and tolerance >= WHOLE:
                raise InputError(f"--shellbench-tolerance={text}: a relative tolerance is below 1, or 0 would pass")
            if not where:
                general = tolerance
                continue
            case = catalog.find_case(case_name)
            asked = next((q for q in case.quantities if q.name == quantity), None)
            if quantity and asked is None:
                names = ", ".join(q.name for q in case.quantities)
                raise InputError(f"--shellbench-tolerance={text}: quantities of {case.name} are {names}")
            if asked and tolerance >= WHOLE and not is_absolute(case, asked):
                raise InputError(f"--shellbench-tolerance={text}: a relative tolerance is below 1, or 0 would pass")
            narrower[case.name, quantity or None] = tolerance
        return cls(general, narrower)

    def allowed(self, case: Problem, quantity: Quantity, solver: str) -> Tolerance | None:
        """Return the largest admissible error; shellbench's frozen tolerance of the solver has priority.

        None if only a relative tolerance is given and the known value is too near zero for it.
        """
        frozen = catalog.tolerance(case.name, quantity.name, solver)
        own = self.narrower.get((case.name, quantity.name))
        if frozen is not None:
            return frozen
        if is_absolute(case, quantity):
            return None if own is None else Tolerance(absolute=own)
        return Tolerance(relative=own or self.narrower.get((case.name, None), self.general))


def is_absolute(case: Problem, quantity: Quantity) -> bool:
    """Return True if errors of a quantity are given in its unit, because relative errors would be meaningless."""
    judge = catalog.known_values(case.name).judge(quantity.name, case.theory)
    return quantity.absolute or (judge is not None and near_zero(judge, quantity))


def positive(text: str, option: str) -> float:
    """Read the positive number of an option; InputError in one sentence."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise InputError(f"{option}: found '{text}', but expected a positive number")
    return number


@dataclass(frozen=True)
class CaseOutcome:
    """Result of a solver on a case.

    Attributes
    ----------
    records
        By seed; None for a deterministic solver.
    declined
        Reason why the solver declines the case; None if it takes it.
    trouble
        Reason why a run has no record, in one sentence; None if every run has one.
    """

    records: Mapping[int | None, Record] = field(default_factory=dict)
    declined: str | None = None
    trouble: str | None = None

    def record(self, seed: int) -> Record | None:
        """Return the record of a seed; a deterministic solver has one for all."""
        return self.records.get(seed, self.records.get(None))


@dataclass
class Answers:
    """Answers of one session.

    Attributes
    ----------
    store
        Finished runs of this and of earlier sessions: runs of the same identity are not repeated.
    began
        The largest sequence number of a record when the session began; a run that has failed since is not repeated.
    """

    store: Store
    began: int
    settings: Mapping[str, Mapping[str, Any]]
    timeout: float | None
    known: dict[tuple[str, str, tuple[int, ...]], CaseOutcome] = field(default_factory=dict)

    def is_new(self, record: Record) -> bool:
        """Return True if a record was made by this session, or during it."""
        return (record.sequence or 0) > self.began

    def answer(self, case: str, solver: str, seeds: Sequence[int]) -> CaseOutcome:
        """Return the answer of a solver to a case; solve it if necessary."""
        key = (case, solver, tuple(seeds))
        if key not in self.known:
            self.known[key] = self._found(*key)
        return self.known[key]

    def _found(self, case: str, solver: str, seeds: tuple[int, ...]) -> CaseOutcome:
        given = {solver: self.settings[solver]} if solver in self.settings else {}
        request = Request(cases=(case,), solvers=(solver,), settings=given, seeds=seeds)
        try:
            with named_lock(self.store.folder, f"{case}-{solver}"):
                return self._solved(request)
        except ShellbenchError as error:
            return CaseOutcome(trouble=" ".join(str(error).split()))
        except Exception as error:  # a plug-in's `declines` may raise anything
            said = " ".join(str(error).split())
            return CaseOutcome(
                trouble=f"the solver could not be asked: {type(error).__name__}{f': {said}' if said else ''}"
            )

    def _solved(self, request: Request) -> CaseOutcome:
        contents = self.store.read()
        plan = make_plan(request, contents)
        if plan.declined:
            return CaseOutcome(declined=plan.declined[0].reason)
        past = newest(contents)
        kept = [record for record in past.values() if record.run_id in plan.kept]
        waiting: list[Task] = []
        for task in plan.tasks:
            failed = past.get(run_key(task))
            if failed is not None and self.is_new(failed):
                kept.append(failed)
            else:
                waiting.append(task)
        outcomes = execute(waiting, self.store, Silent(), LocalProcesses(1, threads_of_a_run(), timeout=self.timeout))
        refused = [outcome.refused for outcome in outcomes if outcome.record is None]
        made = [outcome.record for outcome in outcomes if outcome.record is not None]
        records = {record.identity.seed: record for record in (*kept, *made)}
        return CaseOutcome(records, trouble=f"the solver refused its input: {refused[0]}" if refused else None)


def threads_of_a_run() -> int:
    """Return the threads of a run, so that the processes of pytest-xdist share the cores."""
    workers = int(os.environ.get(WORKERS, "1"))
    return max(1, min(threads(), cores() // workers))


@contextlib.contextmanager
def named_lock(folder: Path, name: str) -> Iterator[None]:
    """Hold a named lock among all processes of a folder; StoreError if it can't be written."""
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", name)
    with said_plainly(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = (folder / f".gate-{safe}.lock").open("a")
    with handle:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


DIGITS = ".9g"  # digits of a value and of its known value
HEAD = ("case", "solver", "quantity", "value", "known", "error", "tolerance", "seconds", "verdict")
LEFT = {"case", "solver", "quantity", "verdict"}  # columns of words
NOTHING = "-"
VERDICTS = {"green": "pass", "red": "FAIL", "expected failure": "expected failure", "not judged": "skipped"}


@dataclass(frozen=True)
class Judgement:
    """Judgement of one item: its finding, its name, and a flag that is True if an earlier session made the run."""

    finding: Finding
    name: str
    kept: bool

    def plain(self) -> dict[str, Any]:
        """Return it as data for another process."""
        row = self.finding.row.model_dump(mode="json")
        return {"row": row, "finding": (self.finding.colour, self.finding.sentence), "about": (self.name, self.kept)}

    @classmethod
    def read(cls, data: Any) -> Judgement:
        """Rebuild it from the result of `plain`."""
        return cls(Finding(Row.model_validate(data["row"]), *data["finding"]), *data["about"])


@dataclass(frozen=True)
class Question:
    """One quantity of one case for a solver; `seeds` are all seeds of the solver's runs."""

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
        """Solve the case if necessary, and judge the quantity."""
        case, quantity = self.case, self.quantity
        known = catalog.known_values(case.name)
        judge = known.judge(quantity.name, case.theory)
        if judge is None:
            others = sorted({v.theory for v in known.of(quantity.name, "judge")})
            only = f" (only one of {', '.join(others)})" if others else ""
            return self._unanswered("red", f"no known value of its theory, {case.theory}, judges {quantity.name}{only}")
        answer = answers.answer(case.name, self.solver, self.seeds)
        if answer.declined is not None:
            return self._unanswered("not judged", f"not applicable: {answer.declined}")
        record = answer.record(self.seed)
        if record is None:
            return self._unanswered("red", answer.trouble or f"solver '{self.solver}' left no record")
        return Judgement(self._finding(record, judge, tolerances), self.name, kept=not answers.is_new(record))

    def _finding(self, record: Record, judge: KnownValue, tolerances: Tolerances) -> Finding:
        """Return the finding on a run, by the solver's frozen tolerance, or else by the given one."""
        row = row_of(CurrentRun(record, self.case, {}), self.quantity).model_copy(update={"suite": self.suite})
        if not row.gated:
            allowed = tolerances.allowed(self.case, self.quantity, self.solver)
            if allowed is None and row.status in ANSWERED:
                option = f"--shellbench-tolerance={row.case}.{row.quantity}=TOL"
                small = f"its known value being {judge.value:g} {row.unit}"
                why = f"no relative tolerance can judge it, {small}: give {option}"
                return Finding(row, "red" if row.primary else "not judged", why)
            row = row.judged(allowed) if allowed else row
        found = row.finding()
        if row.open_finding is not None:
            return Finding(
                row, found.colour, f"{row.reason if row.passed is False else 'open finding'}: {row.open_finding}"
            )
        if row.status not in ANSWERED or row.value is None or row.tolerance is None or row.judged_error is None:
            return Finding(row, "red", f"the run failed: {row.reason}")
        unit = f" {row.unit}" if row.tolerance_is_absolute else ""
        words = (
            f"{row.quantity} is {row.value:{DIGITS}} {row.unit}, and its known value {judge.value:{DIGITS}} {row.unit} "
            f"({judge.origin} [{judge.source}], {judge.theory}): error {row.judged_error:+.2e}{unit}, "
            f"{row.tolerance:g} allowed"
        )
        why_not = row.why_short(row.tolerance)
        within = abs(row.judged_error) <= row.tolerance
        return Finding(row, found.colour, words if row.passed or not within else f"{words}, but {why_not}")

    def _unanswered(self, colour: Colour, sentence: str) -> Judgement:
        row = without_record(self.case, self.quantity, self.solver, self.seed, (self.suite,), sentence)
        return Judgement(Finding(row, colour, sentence), self.name, kept=False)


def questions(suite: str, case: Problem, solver: str) -> Iterator[Question]:
    """Yield the judged quantities: the headline, those with a known value of the case's theory, and gated ones."""
    seeds = seeds_of(suite, case, solver)
    known, gated = catalog.known_values(case.name), gated_quantities(case, solver)
    for quantity in case.quantities:
        if quantity.primary or quantity in gated or known.judge(quantity.name, case.theory):
            for seed in seeds:
                yield Question(suite, case, solver, quantity, seed, seeds)


def seeds_of(suite: str, case: Problem, solver: str) -> tuple[int, ...]:
    """Return the seeds that a suite declares for a solver with default settings; one if it declares none."""
    declared = [run for run in catalog.find_suite(suite).runs_for(case.name) if run.solver == solver]
    seeds = dict.fromkeys(seed for run in declared if not run.settings for seed in run.seeds)
    return tuple(seeds) or (FIRST_SEED,)


def table(found: Sequence[Judgement]) -> list[str]:
    """Return the lines of the table, and the reasons for missing judgements; once for a declined case."""
    rows: list[tuple[str, ...]] = [HEAD]
    unjudged: dict[tuple[str, ...], str] = {}
    for judgement in found:
        row, colour = judgement.finding.row, judgement.finding.colour
        answered = row.value is not None
        if colour != "not judged" or answered:
            rows.append(_cells(judgement))
        if colour == "not judged":
            where = (row.case, row.solver, judgement.name) if answered else (row.case, row.solver)
            unjudged[where] = judgement.finding.sentence
    lines = _aligned(rows) if len(rows) > 1 else []
    lines += [f"{' '.join(where)}: {sentence}" for where, sentence in unjudged.items()]
    if any(judgement.kept for judgement in found):
        lines.append("(k) kept from an earlier session: solver, settings and case are the same")
    return lines


def _cells(judgement: Judgement) -> tuple[str, ...]:
    row = judgement.finding.row
    unit = f" {row.unit}" if row.tolerance_is_absolute else ""
    answered = row.value is not None
    return (
        row.case,
        row.solver,
        judgement.name,
        _figure(row.value, ".7g"),
        _figure(row.reference, ".7g"),
        _figure(row.judged_error, "+.1e", unit),
        _figure(row.tolerance if answered or row.seconds is not None else None, ".1e", unit),
        _figure(row.seconds, ".2f", " (k)" if judgement.kept else ""),
        VERDICTS[judgement.finding.colour],
    )


def _figure(value: float | None, form: str, unit: str = "") -> str:
    return NOTHING if value is None else f"{value:{form}}{unit}"


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if name in LEFT else cell.rjust(width)
            for cell, width, name in zip(row, widths, HEAD, strict=True)
        ).rstrip()
        for row in rows
    ]
