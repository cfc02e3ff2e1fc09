"""The gates of accuracy, regression and cost; and the lock, which detects changes of the exam.

Accuracy holds every run with default settings against the known values: every one that was run, or that the suites
declare that are named. A gated row without a record that counts is red, and says why, as is a run that was planned and
did not end. Regression holds the same rows against the baseline, cost
compares what they took with what they took then; see `shellbench.bench.judge.baseline`. For the lock see
`shellbench.bench.judge.lock`.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.brought import claimed
from shellbench.bench.catalogue.listing import gated_quantities
from shellbench.bench.catalogue.reference import Tolerances
from shellbench.bench.judge.baseline import Baseline, cost_findings, make_baseline, regression_finding
from shellbench.bench.judge.calibration import Calibration, calibration_findings, calibrations
from shellbench.bench.judge.classes import Grade, grades, judged_by_class, third_party_solvers
from shellbench.bench.judge.compare import asked_cases, missing_runs, rows_and_notes, without_record
from shellbench.bench.judge.expected import Scope, expected_of_strangers, expected_runs
from shellbench.bench.judge.lock import LockCheck, check_lock
from shellbench.bench.judge.row import Finding, Row
from shellbench.bench.plugins.registry import find_solver, solver_entries
from shellbench.bench.store.conformance import read_conformance, why_unchecked
from shellbench.bench.store.current import CurrentRuns, current_runs, declared_by, overrides_of
from shellbench.bench.store.planned import DID_NOT_END, planned_files
from shellbench.bench.store.record import STATED
from shellbench.bench.store.store import Store
from shellbench.errors import InputError, ShellbenchError
from shellbench.problem import VARIANT


@dataclass(frozen=True)
class Verdict:
    """Result of the gates.

    Attributes
    ----------
    accuracy, regression, cost
        One finding for each gated row, cost one for each case and solver; the latter two only with a baseline.
    scope
        Scope of the gates.
    baseline
        True if there was a baseline.
    lock
        Comparison of the exam with the locked one.
    warnings
        Warnings, one sentence each.
    claims
        Findings for tolerances that plug-ins claim for themselves; they do not affect the verdict.
    beyond
        One sentence about declared runs that were not made; empty if suites were named.
    grades
        Classes of solvers without frozen tolerances.
    calibration
        One finding for each value of a solver with frozen tolerances whose error far exceeds its stated uncertainty.
    calibrations
        Comparison of stated uncertainties and actual errors, by solver.
    """

    accuracy: tuple[Finding, ...]
    regression: tuple[Finding, ...]
    cost: tuple[Finding, ...]
    scope: Scope
    baseline: bool
    lock: LockCheck
    warnings: tuple[str, ...] = ()
    beyond: str = ""
    claims: tuple[Finding, ...] = ()
    grades: tuple[Grade, ...] = ()
    calibration: tuple[Finding, ...] = ()
    calibrations: tuple[Calibration, ...] = ()

    def good(self, cost: bool = False, regression: bool = False) -> bool:
        """Return True if no finding is red; regression and cost count only if they are asked for."""
        # A broken lock is red for all rows: green answers to an easier exam prove nothing.
        judged = (
            *self.accuracy,
            *self.calibration,
            *(self.regression if regression else ()),
            *(self.cost if cost else ()),
        )
        # The class is the gate of a third-party solver, which has no class without the checks.
        unchecked = any(grade.unchecked for grade in self.grades)
        return not self.lock.broken and not unchecked and not any(finding.colour == "red" for finding in judged)


def gate(store: Store, baseline: Baseline | None, scope: Scope) -> Verdict:
    """Judge the records of a store.

    Without suites, what was run or planned is judged; with suites, all that they gate.

    Raises
    ------
    InputError
        If the store is empty or not there, a name of the scope is unknown, or nothing of it is gated.
    """
    # 1. Check the names of the scope, and that the store is not empty.
    # 2. Collect runs and plans, and the claims of plug-ins.
    # 3. Collect the rows to judge. With suites these are all declared runs, with or without a record. Otherwise they
    #    are all runs, stale records included.
    #    Solvers without frozen tolerances are judged by class.
    # 4. Planned runs that did not end take precedence over other rows of the same run.
    # 5. Restrict the rows to the scope, and refuse a scope if any part of it judges nothing.
    # 6. Judge accuracy, regression and cost of the same rows, the lock, and the calibration of all known values.
    # Silence is no success: a requested run without a record is red.
    cases = asked_cases(scope.cases, scope.suites)
    for solver in scope.solvers:
        if solver.endswith(STATED):
            raise InputError(f"nothing was judged of '{solver}': stated results are never gated")
        find_solver(solver)
    check_filled(store)
    current = current_runs(store.read())
    found, notes = rows_and_notes(store, scope.suites, scope.cases, current)
    more = "" if scope.suites else missing_runs(found)
    known = {run.record.run_id for run in current.runs if run.installed}
    shown = [row for row in found if _in_scope(row, scope, cases)]
    claims, bad_claims = _claims(shown)
    calibrated = calibrations(row for row in shown if row.run_id in known)
    unfinished = [row for row in found if _is_unfinished(row)]
    graded = third_party_solvers(scope.solvers)
    if scope.suites:
        others = [row for expected in expected_runs(scope, current) for row in expected.rows()]
        others += [row for expected in expected_of_strangers(scope, graded, current) for row in expected.rows()]
    else:
        # Records of a solver that is not installed may come from other code: they are shown, and never judged.
        counted = [row for row in found if row.run_id in known]
        others = [row for row in (_by_class(row, graded) for row in counted) if row.gated]
        # A run stays gated even if its record is no longer valid.
        others += _other_runs(others, stale_rows(current))
    found = [*unfinished, *_other_runs(unfinished, others)]
    rows = [row for row in found if _in_scope(row, scope, cases)]
    _check_judged(rows, shown, scope, cases, notes)
    _check_answered(rows, graded)
    by_id = {run.record.run_id: run.record for run in current.runs}
    records = [by_id[run_id] for run_id in dict.fromkeys(row.run_id for row in rows) if run_id in by_id]
    noted, by_class = read_conformance(store), graded & {row.solver for row in rows if not row.own_case}
    unchecked = {
        name: why_unchecked(name, (r for r in records if r.identity.solver == name), noted.found) for name in by_class
    }
    return Verdict(
        accuracy=tuple(_finding(row, graded) for row in rows),
        regression=tuple(f for row in rows if baseline and (f := regression_finding(baseline, row))),
        cost=tuple(cost_findings(baseline, records) if baseline else ()),
        scope=scope,
        baseline=baseline is not None,
        lock=check_lock(
            scope.suites or {row.suite for row in rows if row.suite},
            {row.case.partition(VARIANT)[0] for row in rows if not row.own_case},
        ),
        warnings=(*notes, *noted.damaged, *bad_claims),
        beyond=more,
        claims=tuple(claims),
        grades=tuple(grades(rows, by_class, unchecked)),
        calibration=tuple(calibration_findings(calibrated, catalog.tolerances())),
        calibrations=tuple(calibrated),
    )


def _finding(row: Row, graded: Collection[str]) -> Finding:
    # A built-in solver that takes a case as declared may decline its variants, and a third-party solver
    # may decline any case: this is only shown.
    if row.status == "declined" and (row.variant or row.solver in graded):
        return Finding(row, "not judged", row.reason or "")
    return row.finding()


def _by_class(row: Row, solvers: Collection[str]) -> Row:
    """Return the row with its verdict if a third-party solver answers one of the suite's cases; others unchanged."""
    if row.solver not in solvers or row.own_case or not row.default_settings:
        return row
    return judged_by_class(row)


def _claims(rows: Iterable[Row]) -> tuple[list[Finding], list[str]]:
    """Judge rows by the tolerances that their solvers claim; return findings, and reasons why claims can't be read."""
    claims: dict[str, Tolerances] = {}
    findings, unread = [], []
    entries = solver_entries()
    for row in rows:
        if row.solver not in claims:
            claims[row.solver] = {}
            try:
                claims[row.solver] = claimed(entries[row.solver]) if row.solver in entries else {}
            except InputError as error:  # a plug-in's bad file must not affect others
                unread.append(f"what solver '{row.solver}' claims can't be read: {error}")
        claim = claims[row.solver].get(row.case, {}).get(row.quantity)
        # A claim applies to default settings on the suite's own cases, like a tolerance.
        if claim is None or row.own_case or not row.default_settings or row.run_id is None:
            continue
        held = row.held_to(claim)
        why_not = held.why_short(held.tolerance)
        findings.append(Finding(held, "red" if why_not else "green", why_not or f"claims {claim}"))
    return findings, unread


def check_filled(store: Store) -> None:
    """Raise InputError if a store is not there or is empty.

    Raises
    ------
    InputError
        In one sentence.
    """
    records = store.names()
    if not store.folder.exists():
        raise InputError(f"store {store.folder}: is not there; `shellbench run` makes one")
    if not (records or planned_files(store)):
        raise InputError(f"store {store.folder}: is empty; `shellbench run` fills it")


def _is_unfinished(row: Row) -> bool:
    return row.run_id is None and row.reason == DID_NOT_END


def _question(row: Row) -> tuple[object, ...]:
    return row.case, row.own_case, row.solver, repr(sorted(row.overrides.items()))


def _other_runs(found: Iterable[Row], others: Iterable[Row]) -> list[Row]:
    """Return the other rows whose runs are not among the found rows; a run without seed stands for every seed."""
    # One set of rows replaces another run by run, not quantity by quantity. Answers of two runs never mix.
    known: dict[tuple[object, ...], set[int | None]] = {}
    for row in found:
        known.setdefault(_question(row), set()).add(row.seed)
    return [
        row
        for row in others
        if not (seeds := known.get(_question(row), set())) or (row.seed is not None and not seeds & {row.seed, None})
    ]


def stale_rows(current: CurrentRuns) -> list[Row]:
    """Return red rows for the gated values of runs whose records are no longer valid."""
    rows: dict[tuple[object, ...], list[Row]] = {}
    for record, reason in current.stale.values():
        solver, seed = record.identity.solver, record.identity.seed
        # Keep only rows that can be gated: existing cases of the suites, with default settings.
        if record.own_case or not catalog.has_case(record.case_name) or overrides_of(record):
            continue
        case = catalog.named_case(record.case_name)
        suites = tuple(declared_by(record, case)) or case.suites
        rows[case.name, solver, seed] = [
            without_record(case, quantity, solver, seed, suites, f"no record that counts: {reason}")
            for quantity in gated_quantities(case, solver)
        ]
    return [row for of_run in rows.values() for row in of_run]


def _in_scope(row: Row, scope: Scope, cases: set[tuple[str, bool]]) -> bool:
    return (
        (not scope.solvers or row.solver in scope.solvers)
        and (not scope.seeds or row.seed is None or row.seed in scope.seeds)
        and (not scope.cases or (row.case, row.own_case) in cases)
    )


def _check_answered(rows: Sequence[Row], graded: Collection[str]) -> None:
    """Raise InputError if a third-party solver declines every case.

    Raises
    ------
    InputError
        In one sentence that names it.
    """
    for solver in graded:
        of_solver = [row for row in rows if row.solver == solver]
        if of_solver and all(row.status == "declined" for row in of_solver):
            raise InputError(f"nothing was judged of solver '{solver}': it declines every requested case")


def _check_judged(
    rows: Sequence[Row], shown: Sequence[Row], scope: Scope, cases: set[tuple[str, bool]], notes: Sequence[str]
) -> None:
    """Raise InputError if a part of the scope judges nothing, because such a gate could not fail.

    `shown` are all rows of the scope, judged or not.

    Raises
    ------
    InputError
        In one sentence that names the part, and why nothing of it is judged.
    """
    # Check each name separately: rows of the others would hide a misspelt or ungated name.
    begin = "nothing was judged"
    for name, own in sorted(cases):
        if (name, own) not in {(row.case, row.own_case) for row in rows}:
            why = _why_unjudged([row for row in shown if (row.case, row.own_case) == (name, own)], notes)
            raise InputError(f"{begin} of case '{name}': {why}")
    for solver in scope.solvers:
        if solver not in {row.solver for row in rows}:
            why = _why_unjudged([row for row in shown if row.solver == solver], notes)
            raise InputError(f"{begin} of solver '{solver}': {why}")
    for suite in scope.suites:
        members = {case.name for case in catalog.cases_of(suite)}
        solvers = {run.solver for run in catalog.find_suite(suite).runs} | set(scope.solvers)
        if not any(row.case in members and row.solver in solvers for row in rows):
            raise InputError(f"{begin} of suite '{suite}': {_why_unjudged(shown, notes)}")
    for seed in scope.seeds:
        if not any(row.seed in {seed, None} for row in rows):
            raise InputError(f"{begin} of seed {seed}: {_why_unjudged([r for r in shown if r.seed == seed], notes)}")
    if not rows:
        raise InputError(f"{begin}: {_why_unjudged(shown, notes)}")


def _why_unjudged(shown: Sequence[Row], notes: Sequence[str]) -> str:
    """Return the reason that a gate judges none of these rows, as a clause."""
    if not shown:
        return "; ".join(("no run counts", *(notes or ["`shellbench run` makes one"])))
    if all(row.reference is None for row in shown):
        file = "; `[[known]]` in the case's file states one" if any(row.own_case for row in shown) else ""
        return f"no value is known{file}"
    if all(row.overrides for row in shown):
        given = {f"{row.solver}.{key}={json.dumps(value)}" for row in shown for key, value in row.overrides.items()}
        return f"only runs with default settings are judged, and these have {', '.join(sorted(given))}"
    return "; ".join(("no tolerance is stated", *notes))


def missing_rows(store: Store, rows: Sequence[Row], suites: Sequence[str] = (), cases: Sequence[str] = ()) -> list[Row]:
    """Return gated rows without a record that counts, beside the rows of a report.

    Of the suites, if some are named, those of the solvers and seeds that `rows` have; else those whose records do not
    count any more.
    """
    current = current_runs(store.read())
    asked = asked_cases(cases, suites)
    if suites:
        begun = {(name, row.solver, row.seed) for row in rows for name in row.suites}
        names = tuple(dict.fromkeys(name for name, _, _ in sorted(begun, key=str)))
        lacking = [e for e in expected_runs(Scope(names), current, ask=False) if e.run is None] if names else []
        wanted = [e for e in lacking if {(e.suite, e.solver, e.seed), (e.suite, e.solver, None)} & begun]
        missing = [row for expected in wanted for row in expected.rows()]
    else:
        missing = stale_rows(current)
    return [row for row in _other_runs(rows, missing) if not cases or (row.case, row.own_case) in asked]


def move_baseline(store: Store, old: Baseline | None, scope: Scope, like: Sequence[Store] = ()) -> Baseline:
    """Return a baseline of the runs of a scope; entries of the old one for other runs stay.

    `like` are stores of the same runs from other processors and numbers of threads.

    Raises
    ------
    ShellbenchError
        If a gated row is red in accuracy: a baseline remembers good answers only.
    """
    check_filled(store)
    # All or nothing: a baseline of the green rows only would look like one of all rows.
    runs = list(expected_runs(scope, current_runs(store.read())))
    rows = [row for expected in runs for row in expected.rows()]
    red = [finding for row in rows if (finding := row.finding()).colour == "red"]
    if red:
        first = red[0].row
        raise ShellbenchError(
            f"the baseline is not moved, for {len(red)} of {len(rows)} gated rows are red: "
            f"first {first.case}, {first.solver}, {first.quantity} ({red[0].sentence})"
        )
    elsewhere = [row for other in like for e in expected_runs(scope, current_runs(other.read())) for row in e.rows()]
    gated = {row.run_id for row in rows}
    records = [e.run.record for e in runs if e.run and e.run.record.run_id in gated]
    good = [row for row in rows if row.status == "ok"]
    return make_baseline(good, [r for r in records if r.status == "ok"], old, elsewhere)
