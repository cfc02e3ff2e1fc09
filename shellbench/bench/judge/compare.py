"""Comparison of each quantity of each valid run with the known value that judges it.

A solver is judged by the known value of the case's own theory. Only runs with default settings are gated, each
quantity at the solver's frozen tolerance. Without a known value, as for a user's own case, solvers are compared with
each other.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import Any, Literal

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.listing import gated_quantities
from shellbench.bench.catalogue.reference import KnownValue, KnownValues, Tolerance, allowed_by_file
from shellbench.bench.judge.row import Row, in_suites
from shellbench.bench.store.current import CurrentRun, CurrentRuns, case_of_planned, current_runs, overrides_of
from shellbench.bench.store.planned import DID_NOT_END, not_ended, read_planned
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.errors import InputError
from shellbench.problem import Problem, Quantity
from shellbench.protocol.schema import LONGEST_TITLE


def rows(store: Store, suites: Sequence[str] = (), cases: Sequence[str] = ()) -> list[Row]:
    """Return the rows of all valid runs in a store, sorted by suite, case, quantity, solver and seed.

    Runs that were planned and did not end have rows without a value.

    Parameters
    ----------
    store
        Where the records are.
    suites
        Names of suites; if empty all, and runs without a suite.
    cases
        Names of cases, or paths to case files; all if empty.

    Raises
    ------
    InputError
        If a suite or case is unknown, or a case is in none of the suites.
    """
    return rows_and_notes(store, suites, cases)[0]


def rows_and_notes(
    store: Store, suites: Sequence[str] = (), cases: Sequence[str] = (), current: CurrentRuns | None = None
) -> tuple[list[Row], tuple[str, ...]]:
    """Return the rows of `rows`, and a sentence for each omission; `current` saves reading the store again."""
    wanted = asked_cases(cases, suites)
    # Valid records, and plans without a record. Suites narrow a row to those of its suites that were asked
    # for.
    current, planned = with_cases_of_files(current or current_runs(store.read()), cases), read_planned(store)
    if cases:
        current = current.narrowed(wanted)
    found = rows_of(current, not_ended(planned, (run.record for run in current.runs)))
    found = in_suites(found, suites)
    if cases:
        found = [row for row in found if (row.case, row.own_case) in wanted]
    return found, (*current.notes, *planned.damaged)


def with_cases_of_files(current: CurrentRuns, cases: Sequence[str]) -> CurrentRuns:
    """Return the runs with the cases of the named files; runs whose physics has changed are stale.

    Known values in a file are not physics, and may have changed since the run.
    """
    named = [catalog.find_case(text) for text in cases]
    files = {case.name: case for case in named if catalog.is_own(case)}
    runs, stale = [], dict(current.stale)
    for run in current.runs:
        file = files.get(run.case.name) if run.record.own_case else None
        if file is not None and file.digest() != run.record.identity.case:
            stale[run.record.run_id] = (run.record, "the case has changed since")
        else:
            runs.append(run if file is None else replace(run, case=file))
    return replace(current, runs=tuple(runs), stale=stale)


def asked_cases(cases: Sequence[str], suites: Sequence[str]) -> set[tuple[str, bool]]:
    """Return names of the requested cases, each with a flag that is True for a user's own case.

    Raises
    ------
    InputError
        If a suite or case is unknown, or a case is in none of the suites.
    """
    for name in suites:
        catalog.find_suite(name)
    found = [catalog.find_case(text) for text in cases]
    if not suites:
        return {(case.name, catalog.is_own(case)) for case in found}
    asked: set[tuple[str, bool]] = set()
    for case in found:
        named = [] if catalog.is_own(case) else [m for suite in suites for m in catalog.cases_named(suite, case.name)]
        if not named:
            raise InputError(f"case '{case.name}' is not in suite {' or '.join(map(repr, suites))}")
        asked |= {(member.name, False) for member in named}
    return asked


def missing_runs(found: Sequence[Row]) -> str:
    """Return one line on the runs that the suites of these rows declare besides them; empty if there are none."""
    runs = {(row.case, row.solver, json.dumps(row.overrides, sort_keys=True), row.seed): row for row in found}
    begun = list(dict.fromkeys(row.suites[0] for row in found if row.declared))
    members = {name: catalog.suites_named_by(name) for name in catalog.case_names()} if begun else {}
    more: dict[str, int] = {}
    for name in begun:
        cases = (*(case for case in members if name in members[case]), *catalog.variants_asked(name))
        declared = sum(len(run.seeds) for run in catalog.find_suite(name).runs for case in cases if run.is_for(case))
        left = declared - sum(row.declared and name in row.suites for row in runs.values())
        more |= {name: left} if left > 0 else {}
    of = f"suite '{next(iter(more))}'" if len(more) == 1 else f"{len(more)} suites"
    return f"Left out: {sum(more.values())} other runs of {of}; --suite NAME includes them." if more else ""


def rows_of(current: CurrentRuns, planned: Sequence[Task] = ()) -> list[Row]:
    """Return the rows of valid runs, and of runs that were planned and did not end."""
    # 1. Make rows of records, one for each quantity, with the values that judge them.
    # 2. Make rows of plans that did not end.
    # 3. Compare rows without a known value with each other.
    # 4. Sort by suite and case, so that a report does not depend on the order of the runs.
    found = [row_of(run, quantity) for run in current.runs for quantity in run.case.quantities]
    order = {(run.case.name, q.name): i for run in current.runs for i, q in enumerate(run.case.quantities)}
    for task in planned:
        rows_of_task = planned_rows(task)
        found += rows_of_task
        order |= {
            (row.case, row.quantity): i for i, row in enumerate(rows_of_task) if (row.case, row.quantity) not in order
        }
    found = with_distinct_titles(found)
    known = set(catalog.suite_names())
    asked = {(row.suite, row.case) for row in found if row.suite in known}
    places = {(suite, case): catalog.place_in(suite, case) for suite, case in asked if suite is not None}
    errors = {(run.case.name, q.name) for run in current.runs for q in run.case.quantities if q.is_an_error}
    alone = [row for row in found if (row.case, row.quantity) in errors]
    return sorted(
        [*alone, *with_mutual_differences(row for row in found if (row.case, row.quantity) not in errors)],
        key=lambda row: _position(row, order[row.case, row.quantity], places.get((row.suite or "", row.case), ())),
    )


def with_distinct_titles(found: Sequence[Row]) -> list[Row]:
    """Return the rows; if a user's own case has the same title as another case, its title gets the name of its file."""
    of_title: dict[str, set[tuple[str, bool]]] = {}
    for row in found:
        of_title.setdefault(row.case_title, set()).add((row.case, row.own_case))
    return [
        row.model_copy(update={"case_title": f"{row.case_title[: LONGEST_TITLE - len(file)]}{file}"})
        if row.own_case and len(of_title[row.case_title]) > 1 and (file := f" ({row.case}.toml)")
        else row
        for row in found
    ]


def planned_rows(task: Task) -> list[Row]:
    """Return red rows for a run that was planned and did not end: its gated values, or else its headline."""
    known = case_of_planned(task)
    if known is None:
        return []
    case, declared = known
    # A planned run must not vanish from the table. If none of its values is gated, it has a row for its headline.
    judged = [] if overrides_of(task) or task.own_case else gated_quantities(case, task.identity.solver)
    return [
        without_record(case, quantity, task.identity.solver, task.identity.seed, (), DID_NOT_END).model_copy(
            update=_about_run(task, case, declared)
            # frozen tolerances of a suite's case do not apply to a user's case of the same name
            | ({"tolerance": None, "open_finding": None} if task.own_case else {})
        )
        for quantity in judged or [case.primary]
    ]


def without_record(
    case: Problem,
    quantity: Quantity,
    solver: str,
    seed: int | None,
    suites: tuple[str, ...],
    reason: str,
    status: Literal["missing", "declined"] = "missing",
) -> Row:
    """Return a red row for a requested run without a record."""
    allowed = catalog.tolerance(case.name, quantity.name, solver)
    return Row(
        **_about_quantity(case, quantity),
        suite=suites[0] if suites else None,
        suites=suites,
        solver=solver,
        settings={},
        seed=seed,
        value=None,
        status=status,
        tolerance=allowed.largest if allowed else None,
        passed=False,
        declared=True,
        open_finding=allowed.open_finding if allowed else None,
        reason=reason,
    )


def _about_quantity(case: Problem, quantity: Quantity) -> dict[str, Any]:
    """Return the fields of a row that describe the question."""
    return {
        "case": case.name,
        "kind": case.kind,
        "case_title": case.title,
        "quantity": quantity.name,
        "primary": quantity.primary,
        "at": quantity.mark,
        "mark": case.telling_mark(quantity),
        "unit": quantity.unit,
        "description": quantity.words(case, lambda _: None),
    }


def _about_run(run: Task | Record, case: Problem, declared: Mapping[str, str]) -> dict[str, Any]:
    """Return the fields of a row that describe the run; `declared` are the suites that declare the run."""
    identity, overrides = run.identity, overrides_of(run)
    suites = tuple(declared) or (() if run.own_case else case.suites)
    return {
        "suite": suites[0] if suites else None,
        "suites": suites,
        "declared": bool(declared),
        "label": next(filter(None, declared.values()), ""),
        "own_case": run.own_case,
        "solver": identity.solver,
        "solver_label": run.solver_label,
        "settings": identity.settings,
        "overrides": overrides,
        "default_settings": not overrides,
        "seed": identity.seed,
        "device": identity.device,
        "dtype": identity.dtype,
    }


def _position(row: Row, quantity: int, place: tuple[int, ...]) -> tuple[object, ...]:
    suite = (1, "") if row.suite is None else (0, row.suite)
    settings = json.dumps(row.overrides, sort_keys=True)
    return (suite, place, row.case, not row.primary, quantity, row.solver, settings, row.seed or 0)


def row_of(run: CurrentRun, quantity: Quantity) -> Row:
    """Return one row of a run."""
    record = run.record
    measured = record.values.get(quantity.name)
    gap = record.diagnostics.get("energy_gap")
    declined = record.declined.get(quantity.name)
    remarks = (*(one.words for one in record.self_intersection), run.case.remark)
    remarks += (record.stated.words,) if record.stated else ()
    row = Row(
        **_about_quantity(run.case, quantity) | _about_run(record, run.case, run.declared_by),
        value=measured.value if measured else None,
        uncertainty=measured.uncertainty if measured else None,
        data_error=measured.data_error if measured else None,
        extrapolated=measured.extrapolated if measured else None,
        converged=record.converged(quantity.name),
        energy_gap=float(gap) if isinstance(gap, int | float) else None,
        status="declined" if declined else record.status,
        reason=f"the solver declines the quantity: {declined}" if declined else record.reason,
        remark="; ".join(filter(None, remarks)),
        seconds=None if record.stated else record.seconds,
        peak_memory_bytes=record.peak_memory_bytes,
        idle_memory_bytes=record.idle_memory_bytes,
        parameters=record.parameters,
        storage_bytes=record.storage_bytes,
        run_id=record.run_id,
    )
    # A user's own case may have the name of a suite's case. Known values and tolerances of that case do not apply
    # to it: its own file has both.
    known = values_of_file(run.case) if record.own_case else catalog.known_values(record.case_name)
    row = with_known_values(row, known, run.case, quantity)
    allowed = allowed_by_file(run.case, quantity) if record.own_case else _frozen_tolerance(row)
    return (
        row
        if run.overrides or allowed is None or row.stated
        else row.judged(allowed, ours=row.solver in catalog.tolerances())
    )


def _frozen_tolerance(row: Row) -> Tolerance | None:
    return catalog.tolerance(row.case, row.quantity, row.solver)


def values_of_file(case: Problem) -> KnownValues:
    """Return the known values in a user's own case file."""
    return KnownValues(
        values=tuple(
            KnownValue(
                quantity=one.quantity,
                role="judge",
                value=one.value,
                uncertainty=one.uncertainty,
                theory=case.theory,
                origin="the case's own file",
                source=one.source,
            )
            for one in case.known
        )
    )


def with_known_values(row: Row, known: KnownValues, case: Problem, quantity: Quantity) -> Row:
    """Return the row with the value that judges it, its errors, and the values of the literature."""

    def value(name: str) -> float | None:
        judge = known.judge(name, case.theory)
        return judge.value if judge else None

    found: dict[str, Any] = {"description": quantity.words(case, value)}
    if judge := known.judge(quantity.name, case.theory):
        found |= {
            "reference": judge.value,
            "reference_uncertainty": judge.uncertainty,
            "reference_theory": judge.theory,
            "reference_source": judge.source,
        }
        if row.value is not None:
            found["absolute_error"] = row.value - judge.value
            # An error relative to a value that is zero within its own uncertainty would be a ratio of two roundings.
            if not near_zero(judge, quantity):
                found["relative_error"] = (row.value - judge.value) / abs(judge.value)
    if literature := known.of(quantity.name, "literature"):
        first = literature[0]
        found |= {"literature": first.value, "literature_theory": first.theory, "literature_source": first.source}
    for published in known.of(quantity.name, "published"):
        if published.label == row.label:
            found |= {"published": published.value, "published_source": published.source}
    absolute = quantity.absolute or (judge is not None and near_zero(judge, quantity))
    return row.model_copy(update=found | {"tolerance_is_absolute": absolute})


def near_zero(judge: KnownValue, quantity: Quantity) -> bool:
    """Return True if the known value is too near zero for relative errors."""
    return quantity.absolute or abs(judge.value) <= (judge.uncertainty or 0.0)


def with_mutual_differences(found: Iterable[Row]) -> list[Row]:
    """Return the rows; those without a known value get their difference from another solver.

    The comparison is with the deterministic solver. If there are none or several, it is with the median of all.
    """
    listed = list(found)
    peers: dict[tuple[object, ...], list[Row]] = {}
    for row in listed:
        if row.default_settings and row.status == "ok" and row.value is not None and not row.stated:
            peers.setdefault(_question(row), []).append(row)
    # One solver agrees with itself: a comparison needs answers of two.
    yardsticks = {
        asked: _yardstick(answers) for asked, answers in peers.items() if len({row.solver for row in answers}) > 1
    }
    return [_held_against(row, *yardsticks[_question(row)]) if _question(row) in yardsticks else row for row in listed]


def _question(row: Row) -> tuple[object, ...]:
    """Return the key of a row's case and quantity: rows with equal keys can be compared."""
    return row.case, row.own_case, row.quantity, row.at


def _held_against(row: Row, value: float, name: str) -> Row:
    if row.reference is not None or row.value is None or row.solver == name or not value:
        return row
    return row.model_copy(update={"disagreement": (row.value - value) / abs(value), "disagreement_with": name})


def _yardstick(peers: Sequence[Row]) -> tuple[float, str]:
    values = [row.value for row in peers if row.value is not None]
    # One deterministic solver has no scatter, and is the reference. If there are several, the median is robust.
    certain = [row for row in peers if row.seed is None and row.value is not None]
    if len(certain) == 1 and certain[0].value is not None:
        return certain[0].value, certain[0].solver
    return median(values), "median"


def as_json(found: Iterable[Row]) -> str:
    """Return rows as a JSON list of objects; numbers that are not finite are null, case and variant are separate."""
    rows = [json.loads(row.model_dump_json()) | {"case": row.base, "variant": row.variant} for row in found]
    return json.dumps(rows, indent=1, allow_nan=False)
