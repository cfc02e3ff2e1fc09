"""Resolution consistency: what a solver's answer at a material point owes to the resolution it was computed at.

Two questions are kept apart. One solution may be asked through any grid and frame rate
(`shellbench.report.resolution`); and the same case may be solved at many resolutions, which is compared here at the
same material points of all runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from shellbench.report.consistency_figure import consistency_figure, drift_floor
from shellbench.report.consistency_pairs import drift, drift_table, pair_table, show_drift
from shellbench.report.digits import Digits, percent
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.ladder import ALIKE, CaseRuns, Ladder, Run, case_runs
from shellbench.report.notation import TEXT, Notation
from shellbench.report.palette import inks, style
from shellbench.report.probes import Difference
from shellbench.report.rates import Rate, fitted_rate
from shellbench.report.resolution import frame_rate_table, mesh_table, relative, resolution_table
from shellbench.report.studies import remarks_on
from shellbench.report.table import Column, Line, Note, Table, present

CONSISTENCY = "consistency_"  # how names of figures begin
WORDS = (
    "One solution was asked for its displacement through grids from coarse to fine and, of a motion, at many frame"
    " rates. A continuous field gives the same answer at the same material point and instant, whoever asks. A mesh or a"
    " sequence of frames of the same resolution does not: what it would add is shown beside it.",
    "Each case was then solved at many resolutions, and at each resolution by discretisations that differ only"
    f" marginally: unknowns within {100 * (ALIKE - 1):.0f} % of each other, other diagonals, or other seeds. All runs"
    " of a case are compared at the same material points, which lie on no regular grid, and at all instants or loads"
    " that both runs kept. Differences are lengths of vectors, the largest and the root mean square over points and"
    " instants, relative to the largest displacement of the run that all are held against.",
    "A small difference between two resolutions of one solver is no small error: a solver can be consistently wrong."
    " The difference from another solver's run stands beside it for that reason, and the known values stand in the"
    " tables of displacements. Folding cloth amplifies small differences with time; there, differences late in the"
    " motion say how far the problem itself can be foretold.",
)


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no run was seen through grids and no two runs can be compared."""
    cases = case_runs(evidence)
    tables = (
        consistency_table(cases),
        resolution_table(evidence.records, evidence.rows),
        frame_rate_table(evidence.records, evidence.rows),
        mesh_table(evidence.records, evidence.rows),
    )
    found = tuple(table for table in tables if table is not None)
    if not found:
        return None
    return Section(
        name="consistency",
        title="Resolution consistency",
        words=(*WORDS, *remarks_on(evidence.rows, "resolution")),
        tables=found,
        exhibits=tuple(_exhibits(cases, [row.solver for row in evidence.rows])),
        details=details(cases),
    )


def details(cases: Sequence[CaseRuns]) -> tuple[Table, ...]:
    """Return the long tables behind the section: all pairs of runs, and the drift of all quantities."""
    return tuple(table for table in (pair_table(cases), drift_table(cases)) if table is not None)


def consistency_table(cases: Sequence[CaseRuns]) -> Table | None:
    """Return a line for each case and solver; None if no two runs can be compared."""
    lines = [line for case in cases for ladder in case.ladders if (line := _line(case, ladder)) is not None]
    if not lines:
        return None
    data = pd.DataFrame(lines).astype(dict.fromkeys(("alike_runs", "alike_unknowns"), "Int64"))
    stepped = data["step_in_time_largest"].notna().any()
    return Table(
        name="consistency",
        title="The same material points at many resolutions",
        caption="Last step: difference between the finest run and one a resolution coarser (last time step: the same"
        " for the two finest time steps of one mesh); slope: fitted power of the number of"
        " unknowns with which the difference from the finest run falls (of a mesh, −1 is second order in its width);"
        " alike: the largest difference within the"
        " finest group of marginally different runs (other mesh of the same size, other seed), and how many they are of"
        " how many unknowns; drift: headline quantity of the run a resolution coarser, less"
        " the finest, relative. The finest run of each solver is held against one common run. Differences are relative"
        " to the largest displacement; largest, and root mean square.",
        data=data,
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Unknowns", _unknowns),
            Column("Last step", relative("step_largest")),
            Column("rms", relative("step_rms")),
            *([Column("Last time step", relative("step_in_time_largest"))] if stepped else []),
            Column("Slope", _slope),
            Column("Alike", relative("alike_largest")),
            Column("Runs alike", _alike),
            Column("Drift", show_drift),
            Column("From the common run", relative("yardstick_largest")),
            Column("rms", relative("yardstick_rms")),
        ),
        notes=tuple(_notes(cases)),
    )


def _alike(line: Line, notation: Notation) -> str:
    runs = _whole(line["alike_runs"], notation)
    return notation.escape(f"{runs} of {int(line['alike_unknowns'])}") if present(line["alike_unknowns"]) else runs


def _line(case: CaseRuns, ladder: Ladder) -> dict[str, Any] | None:
    finest, yardstick = ladder.finest, case.yardstick
    step = ladder.last_step("unknowns")
    changed = _between(step)
    changed_in_time = _between(ladder.last_step("time steps"))
    alike = next(((level, spread) for level in reversed(ladder.levels) if (spread := spread_of(level))), None)
    apart = None if yardstick is None or yardstick is finest else finest.difference(yardstick)
    if not any((changed, changed_in_time, alike, apart)):
        return None
    rate = order_of(case, ladder)
    quantity = finest.row.quantity
    return {
        "block": case.title,
        "case": case.case,
        "solver": ladder.solver,
        "runs": len(ladder.runs),
        "coarsest_unknowns": ladder.runs[0].unknowns,
        "finest_unknowns": finest.unknowns,
        "finest_run_id": finest.record.run_id,
        "largest_displacement": case.scale,
        "step_largest": changed.largest if changed else None,
        "step_rms": changed.rms if changed else None,
        "step_in_time_largest": changed_in_time.largest if changed_in_time else None,
        "step_in_time_rms": changed_in_time.rms if changed_in_time else None,
        "slope": rate.slope if rate else None,
        "alike_runs": len(alike[0]) if alike else None,
        "alike_unknowns": alike[0][0].unknowns if alike else None,
        "alike_largest": alike[1][0] if alike else None,
        "alike_rms": alike[1][1] if alike else None,
        "drift_quantity": quantity,
        "drift": drift(*step, quantity) if step is not None else None,
        "yardstick_run_id": yardstick.record.run_id if yardstick else None,
        "yardstick_largest": apart.largest if apart else None,
        "yardstick_rms": apart.rms if apart else None,
    }


def _between(step: tuple[Run, Run] | None) -> Difference | None:
    return None if step is None else step[1].difference(step[0])


def spread_of(level: Sequence[Run]) -> tuple[float, float] | None:
    """Return the largest, and the root mean square, of the differences between any two runs of a level, m."""
    found = [d for i, one in enumerate(level) for other in level[:i] if (d := one.difference(other)) is not None]
    if not found:
        return None
    return max(d.largest for d in found), float(np.sqrt(np.mean([d.rms**2 for d in found])))


def order_of(case: CaseRuns, ladder: Ladder) -> Rate | None:
    """Return the fitted power law of the largest relative difference from the solver's finest run.

    Runs no farther from it than twice its own last step are left out: they owe their small difference to their
    nearness, not to their resolution.
    """
    last = _between(ladder.last_step("unknowns"))
    if last is None or not case.scale:
        return None
    pairs = _to_finest(ladder)
    x = [float(run.unknowns) for run, _ in pairs]
    return fitted_rate(x, [found.largest / case.scale for _, found in pairs], last.largest / case.scale)


def _to_finest(ladder: Ladder) -> list[tuple[Run, Difference]]:
    runs = (run for run in ladder.line if run is not ladder.finest)
    return [(run, found) for run in runs if (found := run.difference(ladder.finest)) is not None]


def _exhibits(cases: Sequence[CaseRuns], solvers: Sequence[str]) -> Iterator[Exhibit]:
    colours = inks(solvers)
    for case in cases:
        shown = [ladder for ladder in case.ladders if len(ladder.levels) > 1 and _to_finest(ladder)]
        if not shown or not case.scale:
            continue
        rates = {ladder.solver: rate for ladder in shown if (rate := order_of(case, ladder)) is not None}
        spreads = {
            ladder.solver: [(level[0].unknowns, s[0]) for level in ladder.levels if (s := spread_of(level))]
            for ladder in case.ladders
        }
        with style():
            figure = consistency_figure(case, shown, spreads, rates, colours)
        quantity = shown[0].finest.row.description or shown[0].finest.row.quantity
        second = "Middle" if case.moves else "Right"
        over_time = (
            " Right: the same difference over time, the largest over the points, a line for each run, the finer the"
            " darker; dotted: each solver's finest run from the common one."
            if case.moves
            else ""
        )
        yield Exhibit(
            name=f"{CONSISTENCY}{case.case}",
            title=f"{case.title}: the same material points at many resolutions",
            caption="Left: difference of the displacement from the same solver's finest run, largest (full) and root"
            " mean square (dashed) over the same material points; open marks: largest difference between marginally"
            f" different runs; stars: each solver's finest run from the common one; dotted, where differences fall by a"
            f" power law: its exponent of the number N of unknowns. {second}: drift of {quantity}"
            f" from that of the same solver's finest run{drift_floor(case)}.{over_time}"
            f" {yardstick_words(case)}",
            description="; ".join(
                f"{ladder.solver}: from {max(f.largest for _, f in _to_finest(ladder)):.2g} m to"
                f" {min(f.largest for _, f in _to_finest(ladder)):.2g} m"
                for ladder in shown
            ),
            figure=figure,
            run_ids=tuple(run.record.run_id for ladder in shown for run in ladder.runs),
            drawing=True,
        )


def yardstick_words(case: CaseRuns) -> str:
    """Say which run all solvers are held against, why, and how well it is known."""
    run = case.yardstick
    if run is None:
        return "No run kept its answer at the probes."
    why = (
        "of all finest runs the one with the smallest doubt (headline's error or last change of the field)"
        if case.judged
        else "no value is known, and of the finest runs without a seed it changed least from the resolution before it"
        if run.row.seed is None
        else "no value is known, and there is no run without a seed"
    )
    known = (
        f"it is known to {TEXT.number(percent(case.doubt / case.scale, signed=False))} % itself"
        if case.doubt is not None and case.scale
        else "nothing tells how well it is known itself"
    )
    return f"Held against: {run.row.solver}, {run.name} ({run.unknowns} unknowns), {why}; {known}."


def _notes(cases: Sequence[CaseRuns]) -> Iterator[Note]:
    for case in cases:
        lost = ", ".join(f"{count} of {solver}" for solver, count in case.failed.items())
        yield Note(case.title, yardstick_words(case) + (f" Runs that failed and are left out: {lost}." if lost else ""))


def _unknowns(line: Line, notation: Notation) -> str:
    first, last = line["coarsest_unknowns"], line["finest_unknowns"]
    return str(last) if first == last else notation.escape(f"{first}–{last}")


def _slope(line: Line, notation: Notation) -> str:
    slope = line["slope"]
    return notation.number(Digits(f"{slope:.1f}")) if present(slope) else notation.missing


def _whole(value: Any, notation: Notation) -> str:
    return str(int(value)) if present(value) else notation.missing
