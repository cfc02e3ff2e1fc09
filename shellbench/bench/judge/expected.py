"""Results that a gate expects: every run that the suites declare, and the answers of named third-party solvers.

A solver is imported only if its record is missing, to find out if it declines the case.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.listing import gated_quantities
from shellbench.bench.judge.classes import judged_by_class, judged_quantities
from shellbench.bench.judge.compare import row_of, without_record
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.outside import declines, resolve_solver
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.run.plan import FIRST_SEED
from shellbench.bench.store.current import CurrentRun, CurrentRuns
from shellbench.errors import InputError, PluginError
from shellbench.problem import Problem

Lack = tuple[Literal["missing", "declined"], str]
NOTHING_LACKS: Lack = ("missing", "")


@dataclass(frozen=True)
class Scope:
    """Scope of a gate: all runs that were made, or all that the named suites declare; the other fields narrow it."""

    suites: tuple[str, ...] = ()
    solvers: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    cases: tuple[str, ...] = ()

    @property
    def narrowed(self) -> str:
        """Description of the restrictions; empty if there are none."""
        parts = [
            f"{what} {', '.join(map(str, names))} only"
            for what, names in (
                ("cases", self.cases),
                ("suites", self.suites),
                ("solvers", self.solvers),
                ("seeds", self.seeds),
            )
            if names
        ]
        return ", ".join(parts)


@dataclass(frozen=True)
class Expected:
    """An expected run with default settings, and its valid record if there is one.

    Attributes
    ----------
    lack
        Reason why there is no record.
    by_class
        True for a third-party solver: every value with a known value is then gated.
    """

    suite: str
    case: Problem
    solver: str
    seed: int
    run: CurrentRun | None
    lack: Lack = NOTHING_LACKS
    by_class: bool = False

    def rows(self) -> Iterator[Row]:
        """Yield its gated rows, red ones if it has no record."""
        status, reason = self.lack
        names = judged_quantities(self.case) if self.by_class else ()
        for quantity in map(self.case.quantity, names) if self.by_class else gated_quantities(self.case, self.solver):
            if self.run is None:
                yield without_record(self.case, quantity, self.solver, self.seed, (self.suite,), reason, status)
                continue
            row = row_of(self.run, quantity)
            if self.by_class:  # frozen tolerances do not count if a built-in solver is graded by class
                row = judged_by_class(row.model_copy(update={"passed": None, "open_finding": None}))
            if row.gated:  # a class can't judge a zero without another value of its unit as a scale
                yield row


def expected_runs(scope: Scope, current: CurrentRuns, ask: bool = True) -> Iterator[Expected]:
    """Yield the expected runs of a scope; with `ask`, solvers are imported to find out the cases that they decline."""
    for solver in scope.solvers:
        find_solver(solver)
    # A case may be in several suites, and a run of a deterministic solver stands for every seed: each run counts once.
    seen: set[tuple[str, str, int | None]] = set()
    for suite in scope.suites or _suites_that_compare():
        for case in catalog.cases_of(suite):
            for run in catalog.find_suite(suite).runs_for(case.name):
                # Tolerances hold for the default settings only.
                if run.settings or (scope.solvers and run.solver not in scope.solvers):
                    continue
                for seed in scope.seeds or run.seeds:
                    found = current.find(case.name, run.solver, {}, seed, installed=ask)
                    known_seed = found.record.identity.seed if found else seed
                    if (case.name, run.solver, known_seed) in seen:
                        continue
                    seen.add((case.name, run.solver, known_seed))
                    why = _why_no_record if ask else _absence
                    lack = NOTHING_LACKS if found else why(current, case, run.solver, seed)
                    yield Expected(suite, case, run.solver, seed, found, lack)


def expected_of_strangers(scope: Scope, solvers: set[str], current: CurrentRuns) -> Iterator[Expected]:
    """Yield the expected runs of named third-party solvers: an answer to each case, or the reason to decline."""
    # Use the given seeds, or those of a line of the suite, or one.
    for solver in sorted(solvers & set(scope.solvers)):
        seen: set[tuple[str, int]] = set()
        for suite in scope.suites:
            for case in catalog.cases_of(suite):
                lines = [run for run in catalog.find_suite(suite).runs_for(case.name) if run.solver == solver]
                declared = tuple(seed for run in lines if not run.settings for seed in run.seeds)
                for seed in scope.seeds or declared or (FIRST_SEED,):
                    if (case.name, seed) not in seen:
                        seen.add((case.name, seed))
                        yield expected_of_third_party(suite, case, solver, seed, current)


def expected_of_third_party(suite: str, case: Problem, solver: str, seed: int, current: CurrentRuns) -> Expected:
    """Return the expected result of a third-party solver on a case: an answer, or its reason to decline."""
    found = current.find(case.name, solver, {}, seed)
    lack = NOTHING_LACKS if found else _why_no_record(current, case, solver, seed)
    return Expected(suite, case, solver, seed, found, lack, by_class=True)


def _suites_that_compare() -> list[str]:
    """Return the suites that are judged by default; studies are left out, because they may need other packages."""
    return [name for name in catalog.suite_names() if catalog.find_suite(name).study is None]


def _why_no_record(current: CurrentRuns, case: Problem, solver: str, seed: int) -> Lack:
    """Return the reason why there is no valid record; only now is the solver imported, to find out if it declines."""
    try:
        reason = declines(resolve_solver(find_solver(solver)), case)
    except (InputError, PluginError) as error:
        return "missing", f"no record: {error}"
    if reason is not None:
        return "declined", f"the solver declines the case: {reason}"
    return _absence(current, case, solver, seed)


def _absence(current: CurrentRuns, case: Problem, solver: str, seed: int) -> Lack:
    stale = current.why_not(case.name, solver, seed)
    return "missing", f"no record that counts: {stale}" if stale else "no record"
