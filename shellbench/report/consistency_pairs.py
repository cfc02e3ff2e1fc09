"""The long tables of resolution consistency: all pairs of runs, and the drift of all quantities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pandas as pd

from shellbench.report.ladder import FINER, CaseRuns, Ladder, Run
from shellbench.report.notation import Notation
from shellbench.report.resolution import relative
from shellbench.report.table import Column, Line, Table, present


def drift(run: Run, finest: Run, quantity: str) -> float | None:
    """Return a quantity less that of the finest run, relative to the latter; None if one is missing or that is zero."""
    ours, theirs = run.record.values.get(quantity), finest.record.values.get(quantity)
    if ours is None or theirs is None or not theirs.value:
        return None
    return (ours.value - theirs.value) / abs(theirs.value)


def pair_table(cases: Sequence[CaseRuns]) -> Table | None:
    """Return a line for each pair of runs that is compared; None if there is none."""
    lines = [
        {
            "block": case.title,
            "case": case.case,
            "solver": ladder.solver,
            "pair": kind,
            "run": run.name,
            "unknowns": run.unknowns,
            "time_steps": run.time_steps,
            "other_solver": other.row.solver,
            "other": other.name,
            "other_unknowns": other.unknowns,
            "other_time_steps": other.time_steps,
            "largest_difference": found.largest,
            "rms_difference": found.rms,
            "largest_displacement": case.scale,
            "run_ids": f"{run.record.run_id} {other.record.run_id}",
        }
        for case in cases
        for ladder in case.ladders
        for kind, run, other in _pairs(case, ladder)
        if (found := run.difference(other)) is not None
    ]
    if not lines:
        return None
    return Table(
        name="consistency_pairs",
        title="All pairs of runs",
        caption="Difference of the displacement at the same material points, relative to the largest displacement.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Run", lambda line, notation: notation.escape(line["run"]), right=False),
            Column("Pair", lambda line, notation: notation.escape(line["pair"]), right=False),
            Column("Other run", lambda line, notation: notation.escape(line["other"]), right=False),
            Column("Largest", relative("largest_difference")),
            Column("rms", relative("rms_difference")),
        ),
    )


def _pairs(case: CaseRuns, ladder: Ladder) -> Iterator[tuple[str, Run, Run]]:
    for finer in FINER:
        for coarse, fine in ladder.steps(finer):
            yield f"next in {finer}", coarse, fine
    for run in ladder.runs:
        if run is not ladder.finest:
            yield "finest of the solver", run, ladder.finest
    for level in ladder.levels:
        for i, one in enumerate(level):
            for other in level[:i]:
                yield "marginally different", other, one
    if case.yardstick is not None:
        for run in ladder.runs:
            if run is not case.yardstick:
                yield "common run", run, case.yardstick


def drift_table(cases: Sequence[CaseRuns]) -> Table | None:
    """Return a line for each run and quantity: its value, and the finest run's of the same solver."""
    lines = [
        {
            "block": case.title,
            "case": case.case,
            "solver": ladder.solver,
            "run": run.name,
            "unknowns": run.unknowns,
            "time_steps": run.time_steps,
            "quantity": name,
            "value": value.value,
            "finest_value": ladder.finest.record.values[name].value,
            "drift": drift(run, ladder.finest, name),
            "run_ids": f"{run.record.run_id} {ladder.finest.record.run_id}",
        }
        for case in cases
        for ladder in case.ladders
        for run in ladder.runs
        if run is not ladder.finest
        for name, value in run.record.values.items()
        if name in ladder.finest.record.values
    ]
    if not lines:
        return None
    return Table(
        name="consistency_drift",
        title="Drift of all quantities",
        caption="Each quantity less that of the same solver's finest run, relative to the latter.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Run", lambda line, notation: notation.escape(line["run"]), right=False),
            Column("Quantity", lambda line, notation: notation.code(line["quantity"]), right=False),
            Column("Drift", show_drift),
        ),
    )


def show_drift(line: Line, notation: Notation) -> str:
    """Write the drift of a line in percent."""
    return notation.error(line["drift"]) if present(line["drift"]) else notation.missing
