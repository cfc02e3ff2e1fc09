"""Resolution consistency: what a solver's answer at a material point owes to the resolution it was computed at.

Two questions are kept apart. One solution may be asked through any grid and frame rate
(`shellbench.report.sections.resolution`); and the same case may be solved at many resolutions, which is compared here
at the same material points of all runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.report.data.columns import Column, Line, column, error, frame, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Exhibit, Ink
from shellbench.report.data.ladder import (
    ALIKE,
    FINER,
    CaseRuns,
    Difference,
    Ladder,
    Run,
    case_runs,
    drift,
    order_of,
    spread_of,
    step_difference,
    to_finest,
)
from shellbench.report.data.notation import Digits, Notation
from shellbench.report.data.runs import remarks_on
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Note, Table
from shellbench.report.figures.panel import (
    FOR_SLOPES,
    add_legend,
    draw,
    draw_slopes,
    entry,
    finish,
    mark_entry,
    open_figure,
)
from shellbench.report.sections.resolution import (
    frame_rate_table,
    of_largest,
    resolution_table,
    yardstick_words,
)

WIDTH, ALONE, HEIGHT, MARGIN = 2.53, 3.3, 2.15, 0.62  # inches: a panel of three, of two, its height, and the legend
SMALLEST_DRIFT = 1e-9  # relative; no figure here is known better, and smaller ones are drawn at this height
SMALLEST = 1e-10  # relative difference below which rounding is all there is
PALEST = 0.25  # opacity of the coarsest run over time
COMMON: dict[str, Any] = {"marker": "*", "markersize": 8}
OTHER: dict[str, Any] = {"marker": "x", "markersize": 5, "markeredgewidth": 1.0}
AROUND: dict[str, Any] = {"marker": "o", "markersize": 6, "markerfacecolor": "none", "markeredgewidth": 1.0}
GRIDS = (
    "Each solution was evaluated on grids from coarse to fine. A continuous field, of finite elements or of a network,"
    " gives the same value at the same material point on every grid. That is a property of continuity, not of a solver."
    " A mesh of the same resolution adds an interpolation error, which is listed beside it."
)
RATES = "Motions were evaluated at many frame rates too: only interpolation between frames adds an error."
SOLVED_AGAIN = "Cases were solved at several resolutions."
ALIKE_RUNS = f"Alike are runs whose unknowns are within {100 * (ALIKE - 1):.0f} %: other meshes, diagonals or seeds."
COMPARED = (
    "All runs of a case are compared at the same material points, which lie on no regular grid, and at all instants or"
    " loads that both runs kept. Differences are lengths of vectors, the largest and the root mean square over points"
    " and instants, relative to the largest displacement of the common run."
)
NO_ERROR = (
    "A small difference between two resolutions of one solver does not mean a small error: a solver can be consistently"
    " wrong. The table therefore also gives the difference from another solver's run. The known values are in the"
    " tables of headline values."
)
CLOTH = "Folding cloth amplifies small differences, so late differences show how predictable the problem is."
OVER_TIME = (
    "the same difference over time, the largest over the points, a line for each run, the finer the darker; dotted:"
    " each solver's finest run from the common one."
)
CAPTIONS = {
    "step_largest": "Last step: difference between the finest run and one a resolution coarser; slope: fitted power of"
    " the number of unknowns with which the difference from the finest run falls (of a mesh, −1 is second order in its"
    " width); drift: headline quantity of the run a resolution coarser, less the finest, relative.",
    "step_in_time_largest": "Last time step: difference of the two finest time steps of one mesh.",
    "alike_largest": "Alike: the largest difference within the finest group of marginally different runs (other mesh of"
    " the same size, other seed), and how many they are of how many unknowns.",
    "yardstick_largest": "From the common run: the difference of the finest run of each solver from one common run.",
    "": "Differences are relative to the largest displacement; largest, and root mean square.",
}


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no run was seen through grids and no two runs can be compared."""
    cases = evidence.once(case_runs)
    compared = consistency_table(cases)
    queries = [make(evidence) for make in (resolution_table, frame_rate_table)]
    tables = given(compared, *queries)
    if not tables:
        return None
    return Section(
        name="consistency",
        title="Resolution consistency",
        words=(*_words(cases, compared, *queries), *remarks_on(evidence.rows, "resolution")),
        tables=tables,
        exhibits=tuple(exhibit for case in cases if (exhibit := _exhibit(case, evidence.inks)) is not None),
        details=given(pair_table(cases)),
    )


def _words(cases: Sequence[CaseRuns], compared: Table | None, grids: Table, rates: Table) -> Iterator[str]:
    """Yield paragraphs on the runs that there are: no word on other resolutions if each case was solved at one."""
    ladders = [ladder for case in cases for ladder in case.ladders]
    again = any(len(ladder.levels) > 1 for ladder in ladders)
    alike = any(len(level) > 1 for ladder in ladders for level in ladder.levels)
    if len(grids.data):
        yield f"{GRIDS} {RATES}" if len(rates.data) else GRIDS
    if compared is not None:
        yield " ".join([SOLVED_AGAIN] * again + [ALIKE_RUNS] * alike + [COMPARED])
        if again:
            yield f"{NO_ERROR} {CLOTH}" if any(case.moves for case in cases) else NO_ERROR


def consistency_table(cases: Sequence[CaseRuns]) -> Table | None:
    """Return a line for each case and solver, with columns of what there is; None if no two runs can be compared."""
    lines = [line for case in cases for ladder in case.ladders if (line := _line(case, ladder)) is not None]
    if not lines:
        return None
    data = frame(lines).astype(dict.fromkeys(("alike_runs", "alike_unknowns"), "Int64"))
    there = {name for name in CAPTIONS if not name or data[name].notna().any()}
    columns: dict[str, tuple[Column, ...]] = {
        "step_largest": (
            column("step_largest", "Last step", of_largest),
            column("step_rms", "rms", of_largest),
            column("slope", "Slope", lambda slope, _, notation: notation.number(Digits(f"{slope:.1f}"))),
            column("drift", "Drift", error),
        ),
        "step_in_time_largest": (column("step_in_time_largest", "Last time step", of_largest),),
        "alike_largest": (column("alike_largest", "Alike", of_largest), column("alike_runs", "Runs alike", _alike)),
        "yardstick_largest": (
            column("yardstick_largest", "From the common run", of_largest),
            column("yardstick_rms", "rms", of_largest),
        ),
    }
    return Table(
        name="consistency",
        title=f"The same material points{' at many resolutions' if 'step_largest' in there else ''}",
        caption=" ".join(words for name, words in CAPTIONS.items() if name in there),
        data=data,
        columns=(
            "solver",
            Column("Unknowns", _unknowns),
            *(one for name, group in columns.items() if name in there for one in group),
        ),
        notes=tuple(map(_note, cases)),
    )


def _unknowns(line: Line, notation: Notation) -> str:
    first, last = line["coarsest_unknowns"], line["finest_unknowns"]
    return str(last) if first == last else notation.escape(f"{first}–{last}")


def _alike(runs: int, line: Line, notation: Notation) -> str:
    return notation.escape(f"{int(runs)} of {int(line['alike_unknowns'])}")


def _line(case: CaseRuns, ladder: Ladder) -> dict[str, Any] | None:
    finest, yardstick = ladder.finest, case.yardstick
    step = ladder.last_step("unknowns")
    alike = next(((level, spread) for level in reversed(ladder.levels) if (spread := spread_of(level))), None)
    apart = None if yardstick is None or yardstick is finest else finest.difference(yardstick)
    changed, changed_in_time = step_difference(step), step_difference(ladder.last_step("time steps"))
    if not any((changed, changed_in_time, alike, apart)):
        return None
    rate = order_of(case, ladder)
    return {
        **case.line(ladder),
        "runs": len(ladder.runs),
        "coarsest_unknowns": ladder.runs[0].unknowns,
        "finest_unknowns": finest.unknowns,
        "finest_run_id": finest.record.run_id,
        "largest_displacement": case.scale,
        **_sizes("step", changed),
        **_sizes("step_in_time", changed_in_time),
        "slope": rate.slope if rate else None,
        "alike_runs": len(alike[0]) if alike else None,
        "alike_unknowns": alike[0][0].unknowns if alike else None,
        "alike_largest": alike[1][0] if alike else None,
        "alike_rms": alike[1][1] if alike else None,
        "drift_quantity": finest.row.quantity,
        "drift": drift(*step, finest.row.quantity) if step is not None else None,
        "yardstick_run_id": yardstick.record.run_id if yardstick else None,
        **_sizes("yardstick", apart),
    }


def _sizes(name: str, found: Difference | None) -> dict[str, float | None]:
    return {f"{name}_largest": found.largest if found else None, f"{name}_rms": found.rms if found else None}


def _exhibit(case: CaseRuns, inks: Mapping[str, Ink]) -> Exhibit | None:
    shown = [ladder for ladder in case.ladders if len(ladder.levels) > 1 and to_finest(ladder.line, ladder.finest)]
    if not shown or not case.scale:
        return None
    finest = shown[0].finest.row
    second, over_time = ("Middle", f" Right: {OVER_TIME}") if case.moves else ("Right", "")
    small = any(value < SMALLEST_DRIFT for one in case.ladders for value in _drifts(one.runs, one.finest)[1])
    return Exhibit(
        name=f"consistency_{case.case}",
        title=f"{case.title}: the same material points at many resolutions",
        caption="Left: difference of the displacement from the same solver's finest run, largest (full) and root"
        " mean square (dashed) over the same material points; open marks: largest difference between marginally"
        f" different runs; stars: each solver's finest run from the common one; dotted, where differences fall by a"
        f" power law: its exponent of the number N of unknowns. {second}: drift of"
        f" {finest.description or finest.quantity} from that of the same solver's finest run"
        f"{f' (below {SMALLEST_DRIFT:g} drawn there)' if small else ''}.{over_time} {yardstick_words(case)}",
        description="; ".join(
            f"{ladder.solver}: from {max(sizes):.2g} m to {min(sizes):.2g} m"
            for ladder in shown
            if (sizes := [found.largest for _, found in to_finest(ladder.line, ladder.finest)])
        ),
        figure=consistency_figure(case, shown, inks),
        run_ids=tuple(run.record.run_id for ladder in shown for run in ladder.runs),
    )


def _note(case: CaseRuns) -> Note:
    lost = ", ".join(f"{count} of {solver}" for solver, count in case.failed.items())
    return Note(case.title, yardstick_words(case) + (f" Runs that failed and are left out: {lost}." if lost else ""))


def pair_table(cases: Sequence[CaseRuns]) -> Table:
    """Return a line for each pair of runs that is compared."""
    lines = [
        {
            **case.line(ladder),
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
    return Table(
        name="consistency_pairs",
        title="All pairs of runs",
        caption="Difference of the displacement at the same material points, relative to the largest displacement.",
        data=frame(lines),
        columns=(
            "solver",
            "run",
            column("pair", "Pair", words),
            column("other", "Other run", words),
            column("largest_difference", way=of_largest),
            column("rms_difference", way=of_largest),
        ),
    )


def _pairs(case: CaseRuns, ladder: Ladder) -> Iterator[tuple[str, Run, Run]]:
    for finer in FINER:
        yield from ((f"next in {finer}", coarse, fine) for coarse, fine in ladder.steps(finer))
    yield from (("finest of the solver", run, ladder.finest) for run in ladder.runs if run is not ladder.finest)
    for level in ladder.levels:
        yield from (("marginally different", other, one) for i, one in enumerate(level) for other in level[:i])
    common = case.yardstick
    yield from (("common run", run, common) for run in ladder.runs if common is not None and run is not common)


def consistency_figure(case: CaseRuns, ladders: Sequence[Ladder], inks: Mapping[str, Ink]) -> Figure:
    """Draw one case and its solvers with more than one resolution: differences, drift and, in motion, all over time."""
    widths = [WIDTH] * 3 if case.moves else [ALONE] * 2
    figure, (panels,) = open_figure((sum(widths), HEIGHT + MARGIN), 1, len(widths))
    scale = case.scale or 1.0
    fits = []
    for ladder in ladders:
        ink = inks[ladder.solver]
        found = [pair for pair in to_finest(ladder.line, ladder.finest) if pair[1].largest > SMALLEST * scale]
        x, rms = [x for x, _ in found], [100 * one.rms / scale for _, one in found]
        draw(panels[0], x, [100 * one.largest / scale for _, one in found], ink)
        draw(panels[0], x, rms, ink, DASHES[1], marker=None, linewidth=1.0)
        for x_other, one in to_finest(ladder.other_time_steps, ladder.finest):
            if one.largest > SMALLEST * scale:
                draw(panels[0], [x_other], [100 * one.largest / scale], ink, "none", **_other(ink))
        for level in ladder.levels:
            around = spread_of(level)
            if around and around[0] > SMALLEST * scale:
                look = AROUND | {"markeredgecolor": ink.colour}
                draw(panels[0], [level[0].unknowns], [100 * around[0] / scale], ink, "none", **look)
        for runs, line, look in ((ladder.line, "-", {}), (ladder.other_time_steps, "none", _other(ink))):
            x, sizes = _drifts(runs, ladder.finest)
            draw(panels[1], x, [100 * max(size, SMALLEST_DRIFT) for size in sizes], ink, line, **look)
        if (rate := order_of(case, ladder)) is not None:
            fits.append((rate, rf"$N^{{\,{rate.slope:.1f}}}$", ink.colour))
        if case.moves:
            _over_time(panels[2], case, ladder, ink)
    for ladder in case.ladders:
        apart = ladder.finest.difference(case.yardstick) if case.yardstick not in (None, ladder.finest) else None
        if apart is not None and apart.largest > SMALLEST * scale:
            height = [100 * apart.largest / scale]
            draw(panels[0], [ladder.finest.unknowns], height, inks[ladder.solver], "none", **COMMON)
    finish(panels[:1], "unknowns", "difference (% of the largest)", "From the solver's finest run", below=FOR_SLOPES)
    draw_slopes(panels[0], fits, line=DASHES[2])
    finish(panels[1:2], "unknowns", "drift (%)", "Headline quantity")
    if case.moves:
        finish(panels[2:], "time t (s)", "largest difference (%)", "Over time", log="y")
    add_legend(figure, _legend(case, ladders, inks), 5)
    return figure


def _other(ink: Ink) -> dict[str, Any]:
    return OTHER | {"markeredgecolor": ink.colour}


def _drifts(runs: Sequence[Run], finest: Run) -> tuple[list[int], list[float]]:
    found = [(run.unknowns, drift(run, finest, finest.row.quantity)) for run in runs if run is not finest]
    shown = [(unknowns, abs(one)) for unknowns, one in found if one is not None]
    return [unknowns for unknowns, _ in shown], [one for _, one in shown]


def _over_time(axes: Axes, case: CaseRuns, ladder: Ladder, ink: Ink) -> None:
    """Draw how far each run is from the finest, the finer the darker, and that from the common run."""
    scale = case.scale or 1.0
    runs = [run for run in ladder.line if run is not ladder.finest]
    curves: list[tuple[Difference | None, dict[str, Any]]] = [
        (run.difference(ladder.finest), {"alpha": PALEST + (1 - PALEST) * place / len(runs), "linewidth": 1.1})
        for place, run in enumerate(runs, start=1)
    ]
    if case.yardstick is not None and case.yardstick is not ladder.finest:
        curves.append((ladder.finest.difference(case.yardstick), {"linestyle": DASHES[2], "linewidth": 1.5}))
    for found, look in curves:
        if found is not None:
            shown = found.by_mark > SMALLEST * scale
            draw(axes, found.marks[shown], 100 * found.by_mark[shown] / scale, ink, **{"marker": None, **look})


def _legend(case: CaseRuns, ladders: Sequence[Ladder], inks: Mapping[str, Ink]) -> dict[str, Any]:
    entries = {ladder.solver: entry(inks[ladder.solver]) for ladder in case.ladders}
    entries |= {"largest": entry(), "root mean square": entry(linestyle=DASHES[1])}
    if any(spread_of(level) for ladder in ladders for level in ladder.levels):
        entries["marginally different runs"] = mark_entry(**AROUND)
    if any(ladder.other_time_steps for ladder in ladders):
        entries["other time steps"] = mark_entry(**OTHER)
    if len(case.ladders) > 1:
        entries["finest, from the common run"] = mark_entry(**COMMON)
        if case.moves:
            entries["the same over time"] = entry(linestyle=DASHES[2], linewidth=1.5)
    return entries
