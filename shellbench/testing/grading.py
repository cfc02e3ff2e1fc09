"""The grade of a checked solver: the exam, and its result as text and data."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.classes import CLASSES, third_party_solvers
from shellbench.bench.judge.exam import Sitting, hold_exam, is_judged, missed_words, plan_of, questions, suites_for
from shellbench.bench.plugins.outside import resolve_solver
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.run.display import display
from shellbench.bench.run.execute import Observer, Outcome
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.run.plan import Plan
from shellbench.bench.store import environment
from shellbench.bench.store.conformance import read_conformance, why_unchecked
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.problem import Problem, Progress
from shellbench.testing.between import Between

MOST_SHOWN = 10  # rows that are missed


@dataclass(frozen=True)
class ExamOptions:
    """Options of an exam.

    Attributes
    ----------
    suites
        Suites whose cases are solved; None for those of the solver's kinds of problem.
    quick
        True if these are the suites of a first look.
    grade
        True if the exam is held; otherwise only the checks are made and kept in the store.
    store
        Folder of the records; runs with a valid record are not solved again.
    jobs
        Parallel runs, one thread each; None for one per core.
    """

    suites: tuple[str, ...] | None
    store: Path
    jobs: int | None = None
    quick: bool = False
    grade: bool = True

    def asked_of(self, entry: SolverEntry) -> tuple[str, ...]:
        """Return the suites of a solver's exam; InputError if one is unknown, or the solver can't be imported."""
        if not self.grade:
            return ()
        if self.suites is not None:
            for suite in self.suites:
                catalog.find_suite(suite)  # printed before the checks
            return self.suites
        return suites_for(map(str, resolve_solver(entry).capabilities.theories), quick=self.quick)


@dataclass(frozen=True)
class Graded:
    """Result of an exam.

    Attributes
    ----------
    why
        Reason why there is no grade, in a clause; empty if the exam was held and something was judged.
    between
        Differences of its fields from those of the yardstick between the points of the cases; they judge nothing.
    """

    solver: str
    suites: tuple[str, ...]
    why: str = ""
    sitting: Sitting | None = None
    between: Between | None = None

    @property
    def held(self) -> float | None:
        """The solver's class; None if it has no grade."""
        return self.sitting.grade.held if self.sitting and not self.why else None

    @property
    def fell_short(self) -> bool:
        """True if a third-party solver gets no class; built-in solvers are gated by their tolerances instead."""
        graded = self.sitting is not None and not self.why
        return graded and self.held is None and self.solver in third_party_solvers((self.solver,))

    @property
    def judged_nothing(self) -> bool:
        """True if an exam was held and the solver declined everything."""
        return bool(self.sitting and self.why)

    def lines(self) -> Iterator[str]:
        """Yield the printed lines."""
        asked = f" ({'suite' if len(self.suites) == 1 else 'suites'} {', '.join(self.suites)})" if self.suites else ""
        if self.why or self.sitting is None:
            yield f"no grade{asked}: {self.why}"
            return
        yield f"{f'grade {self.held:g}' if self.held else 'no grade'}{asked}: {self.sitting.grade}"
        missed = self.sitting.missed
        yield from (f"  misses {missed_words(row)}" for row in missed[:MOST_SHOWN])
        if len(missed) > MOST_SHOWN:
            yield f"  and {len(missed) - MOST_SHOWN} figures more"
        if self.between is not None:
            yield from self.between.lines()

    def as_data(self) -> dict[str, Any]:
        """Return the grade and the exam as JSON data."""
        grade = self.sitting.grade if self.sitting else None
        worst = grade.worst if grade else None
        return {
            "grade": self.held,
            "exam": {
                "classes": list(CLASSES),
                "suites": list(self.suites),
                "why": self.why,
                "unchecked": grade.unchecked if grade else "",
                "cases": grade.cases if grade else 0,
                "figures": grade.figures if grade else 0,
                "declined": list(grade.declined) if grade else [],
                "worst": worst
                and {"case": worst.case, "quantity": worst.quantity, "error": worst.judged_error}
                | {"absolute": worst.tolerance_is_absolute, "unit": worst.unit},
                "missed": [
                    {"case": row.case, "quantity": row.quantity, "status": row.status, "reason": row.reason}
                    for row in (self.sitting.missed if self.sitting else ())
                ],
                "between": self.between and self.between.as_data(),
            },
        }


class EventBuffer:
    """Buffers the events of runs until a display is attached, and then passes them on."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: list[Callable[[Observer], None]] = []
        self._observer: Observer | None = None

    def started(self, task: Task) -> None:
        """Keep it, or pass it on."""
        self._told(lambda observer: observer.started(task))

    def progressed(self, task: Task, progress: Progress) -> None:
        """Keep it, or pass it on."""
        self._told(lambda observer: observer.progressed(task, progress))

    def ended(self, outcome: Outcome) -> None:
        """Keep it, or pass it on."""
        self._told(lambda observer: observer.ended(outcome))

    def show(self, observer: Observer) -> None:
        """Pass all on."""
        with self._lock:
            self._observer = observer
            for tell in self._kept:
                tell(observer)
            self._kept.clear()

    def _told(self, tell: Callable[[Observer], None]) -> None:
        with self._lock:
            if self._observer is None:
                self._kept.append(tell)
            else:
                tell(self._observer)


@contextlib.contextmanager
def start_exam(
    solver: str, cases: Sequence[Problem], suites: tuple[str, ...], options: ExamOptions, seconds: float
) -> Iterator[Callable[[Console], Graded]]:
    """Start the exam of a solver with default settings, beside the checks, which use one of its jobs.

    The yielded function shows the runs, gives all jobs to them, and waits for the grade. If it is not called, the runs
    are stopped at the end.

    Parameters
    ----------
    cases
        Cases in addition to those of the suites.
    suites
        Suites whose cases are solved.
    seconds
        Longest time for one answer.

    Raises
    ------
    InputError
        While waiting for the grade, if the solver can't be imported.
    StoreError
        While waiting for the grade, if the store can't be written.
    """
    store, later = Store(options.store), EventBuffer()
    alone, left = threading.Event(), threading.Event()
    executor = LocalProcesses(
        options.jobs or environment.cores(),
        1,
        seconds,
        wanted=lambda: not left.is_set(),
        taken=lambda: 0 if alone.is_set() else 1,
    )

    def plan() -> tuple[list[Problem], Plan | None]:
        asked = {case.name: case for case in (*questions(suites), *cases) if is_judged(case)}
        judged = list(asked.values())
        return judged, plan_of(solver, judged, store, executor, threads=1) if judged else None

    with contextlib.closing(executor), ThreadPoolExecutor(1) as thread:
        planned = thread.submit(plan)

        def hold() -> Sitting | None:
            asked, runs = planned.result()
            return None if runs is None else hold_exam(solver, asked, store, runs, executor, later)

        held = thread.submit(hold)

        def grade(console: Console) -> Graded:
            alone.set()
            _, runs = planned.result()
            if runs is None:
                return Graded(solver, suites, "no known value judges what was asked")
            with display(console, len(runs.tasks)) as observer:
                later.show(observer)
                sitting = held.result()
            if sitting is not None:  # only now, because the checks ran in parallel
                runs_of = (run.record for run in sitting.answers)
                unchecked = why_unchecked(solver, runs_of, read_conformance(store).found)
                sitting = replace(sitting, grade=replace(sitting.grade, unchecked=unchecked))
            why = "" if sitting and sitting.grade.figures else "it declines every case that was asked"
            return Graded(solver, suites, why, sitting)

        try:
            yield grade
        finally:
            left.set()
