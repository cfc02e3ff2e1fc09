"""The grade of a solver that is checked: the exam is held, and said in words and as data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from shellbench.bench import environment
from shellbench.bench.classes import CLASSES, strangers
from shellbench.bench.display import display
from shellbench.bench.exam import Sitting, is_judged, missed_words, plan_of, questions, sit, suites_for
from shellbench.bench.local import LocalProcesses
from shellbench.bench.registry import SolverEntry, load_solver
from shellbench.bench.store import Store
from shellbench.problem import Problem

MOST_SHOWN = 10  # rows that are missed


@dataclass(frozen=True)
class ExamOptions:
    """What exam is held.

    Attributes
    ----------
    suites
        Suites whose cases are asked; None for those of the solver's kinds of problem.
    quick
        Whether these are the suites of a first look.
    store
        Folder of the records; what has one that counts is not solved again.
    jobs
        Runs at a time, one thread each; None for as many as there are cores.
    """

    suites: tuple[str, ...] | None
    store: Path
    jobs: int | None = None
    quick: bool = False

    def asked_of(self, entry: SolverEntry) -> tuple[str, ...]:
        """Return the suites that a solver is asked; InputError if it can't be imported."""
        if self.suites is not None:
            return self.suites
        return suites_for(map(str, load_solver(entry).capabilities.theories), quick=self.quick)


@dataclass(frozen=True)
class Graded:
    """What the exam found.

    Attributes
    ----------
    why
        Why there is no grade, in a clause; empty if the exam was held and something was judged.
    """

    solver: str
    suites: tuple[str, ...]
    why: str = ""
    sitting: Sitting | None = None

    @property
    def held(self) -> float | None:
        """The class that the solver holds; None if it has no grade."""
        return self.sitting.grade.held if self.sitting and not self.why else None

    @property
    def fell_short(self) -> bool:
        """Whether a stranger holds no class; our own solvers are gated by their tolerances, not by classes."""
        return bool(self.sitting and self.sitting.missed and self.solver in strangers((self.solver,)))

    @property
    def judged_nothing(self) -> bool:
        """Whether an exam was held, and it declined everything."""
        return bool(self.sitting and self.why)

    def lines(self) -> Iterator[str]:
        """Yield what is printed."""
        asked = f" ({'suite' if len(self.suites) == 1 else 'suites'} {', '.join(self.suites)})" if self.suites else ""
        if self.why or self.sitting is None:
            yield f"no grade{asked}: {self.why}"
            return
        yield f"{f'grade {self.held:g}' if self.held else 'no grade'}{asked}: {self.sitting.grade}"
        missed = self.sitting.missed
        yield from (f"  misses {missed_words(row)}" for row in missed[:MOST_SHOWN])
        if len(missed) > MOST_SHOWN:
            yield f"  and {len(missed) - MOST_SHOWN} figures more"

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
            },
        }


def graded(
    solver: str,
    cases: tuple[Problem, ...],
    suites: tuple[str, ...],
    options: ExamOptions,
    seconds: float,
    console: Console,
) -> Graded:
    """Hold the exam of a solver with default settings.

    Parameters
    ----------
    cases
        Cases that are asked beside those of the suites.
    suites
        Suites whose cases are asked.
    seconds
        Longest time for one answer.
    console
        Shows the runs as they go by.

    Raises
    ------
    InputError
        If a suite is unknown, or the solver can't be imported.
    """
    asked = {case.name: case for case in (*questions(suites), *cases) if is_judged(case)}
    if not asked:
        return Graded(solver, suites, "no known value judges what was asked")
    store = Store(options.store)
    executor = LocalProcesses(options.jobs or environment.cores(), 1, seconds)
    plan = plan_of(solver, list(asked.values()), store, executor, threads=1)
    with display(console, len(plan.tasks)) as observer:
        sitting = sit(solver, list(asked.values()), store, plan, executor, observer)
    why = "" if sitting.grade.figures else "it declines every case that was asked"
    return Graded(solver, suites, why, sitting)
