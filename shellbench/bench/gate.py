"""Three gates, kept apart: accuracy, regression and cost.

Accuracy holds every run that a suite declares with default settings against the known values; a gated row
without a record that counts is red, and says why. Regression holds the same rows against the baseline, cost
compares what they took with what they took then; see `shellbench.bench.baseline`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from shellbench import catalog
from shellbench.bench.baseline import Baseline, cost_findings, make_baseline, regression_finding
from shellbench.bench.compare import row_of
from shellbench.bench.current import CurrentRun, CurrentRuns, current_runs
from shellbench.bench.finding import Finding
from shellbench.bench.marks import mark_of, telling_mark
from shellbench.bench.plan import declared_runs, declines
from shellbench.bench.registry import find_solver, load_solver
from shellbench.bench.row import Row
from shellbench.bench.store import Store
from shellbench.case import Case
from shellbench.errors import InputError, ShellbenchError
from shellbench.quantities import QuantityModel

Lack = tuple[Literal["missing", "declined"], str]
NOTHING_LACKS: Lack = ("missing", "")


@dataclass(frozen=True)
class Scope:
    """What a gate looks at; all that is declared where empty."""

    suites: tuple[str, ...] = ()
    solvers: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()

    @property
    def narrowed(self) -> str:
        """What is left out, in words; empty if nothing is."""
        parts = [
            f"{what} {', '.join(map(str, names))} only"
            for what, names in (("suites", self.suites), ("solvers", self.solvers), ("seeds", self.seeds))
            if names
        ]
        return ", ".join(parts)


@dataclass(frozen=True)
class Verdict:
    """What the gates found.

    Attributes
    ----------
    accuracy, regression, cost
        One finding for each gated row, cost one for each case and solver; the latter two only with a baseline.
    scope
        What was looked at.
    baseline
        Whether there was one.
    warnings
        What else to know, one sentence each.
    """

    accuracy: tuple[Finding, ...]
    regression: tuple[Finding, ...]
    cost: tuple[Finding, ...]
    scope: Scope
    baseline: bool
    warnings: tuple[str, ...] = ()

    def good(self, cost: bool = False) -> bool:
        """Tell whether nothing is red; in the cost gate only if it is asked for."""
        judged = (*self.accuracy, *self.regression, *(self.cost if cost else ()))
        return not any(finding.colour == "red" for finding in judged)


def gate(store: Store, baseline: Baseline | None, scope: Scope) -> Verdict:
    """Judge the records of a store.

    Raises
    ------
    InputError
        If a suite or solver of the scope is unknown.
    """
    current = current_runs(store.read())
    runs = list(_expected(scope, current))
    rows = [row for expected in runs for row in expected.rows()]
    regression = [f for row in rows if baseline and (f := regression_finding(baseline, row))]
    cost = cost_findings(baseline, [e.run.record for e in runs if e.run]) if baseline else []
    return Verdict(
        accuracy=tuple(map(accuracy_finding, rows)),
        regression=tuple(regression),
        cost=tuple(cost),
        scope=scope,
        baseline=baseline is not None,
        warnings=current.notes,
    )


def accuracy_finding(row: Row) -> Finding:
    """Say what the accuracy gate makes of a gated row."""
    colour: Literal["green", "red", "expected failure"] = "green" if row.passed else "red"
    sentence = row.reason or ""
    if row.passed is None:
        colour, sentence = "expected failure", f"open finding: {row.open_finding}"
    elif row.passed and row.relative_error is not None and not row.tolerance_is_absolute:
        sentence = f"error {row.relative_error:+.2e}, {row.tolerance:g} allowed"
    elif row.passed and row.absolute_error is not None:
        sentence = f"error {row.absolute_error:+.2e} {row.unit}, {row.tolerance:g} allowed"
    return Finding(row=row, colour=colour, sentence=sentence)


def missing_rows(store: Store, rows: Sequence[Row]) -> list[Row]:
    """Return gated rows without a record that counts, of the suites, solvers and seeds that `rows` have records of.

    No solver is imported: reports are made where none is installed.
    """
    begun = {(name, row.solver, row.seed) for row in rows for name in row.suites}
    suites = tuple(dict.fromkeys(name for name, _, _ in sorted(begun, key=str)))
    if not suites:
        return []
    lacking = [e for e in _expected(Scope(suites), current_runs(store.read()), ask=False) if e.run is None]
    wanted = [e for e in lacking if {(e.suite, e.solver, e.seed), (e.suite, e.solver, None)} & begun]
    return [row for expected in wanted for row in expected.rows()]


def move_baseline(store: Store, old: Baseline | None, scope: Scope, like: Sequence[Store] = ()) -> Baseline:
    """Return a baseline of the runs of a scope; what the old one knows of others stays.

    `like` are stores of the same runs from other processors and numbers of threads.

    Raises
    ------
    ShellbenchError
        If a gated row is red in accuracy: a baseline remembers good answers only.
    """
    runs = list(_expected(scope, current_runs(store.read())))
    rows = [row for expected in runs for row in expected.rows()]
    red = [finding for finding in map(accuracy_finding, rows) if finding.colour == "red"]
    if red:
        first = red[0].row
        raise ShellbenchError(
            f"the baseline is not moved, for {len(red)} of {len(rows)} gated rows are red: "
            f"first {first.case}, {first.solver}, {first.quantity} ({red[0].sentence})"
        )
    elsewhere = [row for other in like for e in _expected(scope, current_runs(other.read())) for row in e.rows()]
    gated = {row.run_id for row in rows}
    records = [e.run.record for e in runs if e.run and e.run.record.run_id in gated]
    good = [row for row in rows if row.status == "ok"]
    return make_baseline(good, [r for r in records if r.status == "ok"], old, elsewhere)


@dataclass(frozen=True)
class _Expected:
    """A declared run with default settings, and its record if there is one that counts."""

    suite: str
    case: Case
    solver: str
    seed: int
    run: CurrentRun | None
    lack: Lack = NOTHING_LACKS

    def rows(self) -> Iterator[Row]:
        for quantity in self.case.quantities:
            if self.solver in quantity.tolerance or self.solver in quantity.open_finding:
                yield row_of(self.run, quantity) if self.run else self._empty(quantity)

    def _empty(self, quantity: QuantityModel) -> Row:
        status, reason = self.lack
        finding = quantity.open_finding.get(self.solver)
        return Row(
            case=self.case.name,
            suite=self.suite,
            solver=self.solver,
            settings={},
            seed=self.seed,
            quantity=quantity.name,
            primary=quantity.primary,
            at=mark_of(quantity),
            value=None,
            status=status,
            tolerance=quantity.tolerance.get(self.solver),
            passed=False,
            case_title=self.case.title,
            suites=(self.suite,),
            declared=True,
            unit=quantity.unit,
            description=quantity.description,
            mark=telling_mark(self.case, quantity),
            open_finding=finding,
            reason=reason,
        )


def _expected(scope: Scope, current: CurrentRuns, ask: bool = True) -> Iterator[_Expected]:
    """Yield what a scope should have; with `ask`, solvers have to be there, and say what they decline."""
    for solver in scope.solvers:
        find_solver(solver)
    seen: set[tuple[str, str, int | None]] = set()
    for suite in scope.suites or _suites_that_compare():
        runs = [run for run in catalog.find_suite(suite).runs if not run.settings]
        for case in catalog.cases_of(suite):
            for run in declared_runs(runs, case):
                if scope.solvers and run.solver not in scope.solvers:
                    continue
                for seed in scope.seeds or run.seeds:
                    found = current.find(case.name, run.solver, {}, seed, installed=ask)
                    known_seed = found.record.identity.seed if found else seed
                    if (case.name, run.solver, known_seed) in seen:
                        continue
                    seen.add((case.name, run.solver, known_seed))
                    why = _lack if ask else _absence
                    lack = NOTHING_LACKS if found else why(current, case, run.solver, seed)
                    yield _Expected(suite, case, run.solver, seed, found, lack)


def _suites_that_compare() -> list[str]:
    """Return the suites that are judged unless some are named: a study may need what is not installed."""
    return [name for name in catalog.suite_names() if catalog.find_suite(name).study is None]


def _lack(current: CurrentRuns, case: Case, solver: str, seed: int) -> Lack:
    """Say why there is no record that counts; only now is the solver imported, to hear whether it declines."""
    try:
        reason = declines(load_solver(find_solver(solver)), case)
    except InputError as error:
        return "missing", f"no record: {error}"
    if reason is not None:
        return "declined", f"the solver declines the case: {reason}"
    return _absence(current, case, solver, seed)


def _absence(current: CurrentRuns, case: Case, solver: str, seed: int) -> Lack:
    stale = current.why_not(case.name, solver, seed)
    return "missing", f"no record that counts: {stale}" if stale else "no record"
