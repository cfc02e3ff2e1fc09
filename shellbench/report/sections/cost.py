"""The section on convergence and cost: what an answer of a given accuracy takes, in unknowns, seconds and memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.report.data.accuracy import CaseAccuracy, Family, Measure, accuracies, down_to
from shellbench.report.data.columns import Line, Way, column, count, frame, seconds, size
from shellbench.report.data.document import makings
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Exhibit, Ink
from shellbench.report.data.notation import MINUS, Notation
from shellbench.report.data.rates import FEWEST
from shellbench.report.data.runs import remarks_on
from shellbench.report.data.section import Section
from shellbench.report.data.table import Note, Table
from shellbench.report.figures import panel

LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)
WIDTH, HEIGHT, MARGIN = 7.4, 2.5, 0.55  # inches of the figure, of its panels, and of the legend
ALONE: dict[str, Any] = {"markersize": 6.5, "markeredgecolor": "black", "markeredgewidth": 0.8}
UNITS: dict[Measure, float] = {"unknowns": 1.0, "seconds": 1.0, "memory": 1e6}
LABELS: dict[Measure, str] = {
    "unknowns": "unknowns",
    "seconds": "wall time of the solve (s)",
    "memory": "peak memory of the solve (MB)",
}
TITLES: dict[Measure, str] = {
    "unknowns": "Unknowns at a stated error",
    "seconds": "Seconds at a stated error",
    "memory": "Peak memory at a stated error",
}
WHAT: dict[Measure, str] = {
    "unknowns": "Fewest unknowns",
    "seconds": "Least wall time of the solve, s,",
    "memory": "Least peak memory of the solve, above what the process held before,",
}
WAYS: dict[Measure, Way] = {"unknowns": count, "seconds": seconds, "memory": size}
RULE = (
    "with which the headline quantity is within the given error for every seed and in all finer runs of the same sweep,"
    " the uncertainty of the known value counted against it. The exponent is that of a power law fitted to the finest"
    " sizes of the longest sweep whose error lies above that uncertainty and still falls; for fields it describes the"
    " runs and is no asymptotic order. None is given where what it took less than doubled over these sizes."
)


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite studied the resolution of any case."""
    found = accuracies(evidence)
    if not found:
        return None
    environments = {making.record.run_id: making.environment for making in makings(evidence.records, evidence.rows)[0]}
    return Section(
        name="cost",
        title="Convergence and cost",
        words=(
            "What an answer takes, by each solver: the relative error of a case's headline quantity against unknowns,"
            " wall time and memory. Errors are relative to the known value of the case; where none is known, to the"
            " best answer; those of a position, to the extent of the shell. The figure says so.",
            "Seconds are wall time of the solve alone, on a machine that may have had other work: compare them within"
            " one environment only, and as factors rather than digits. Memory is the largest resident memory of the"
            " process less what it held before the solve; below about 10 MB it tells of the libraries alone.",
            *remarks_on(evidence.rows, "resolution"),
        ),
        tables=tuple(cost_table(found, measure, environments) for measure in LABELS),
        exhibits=tuple(
            Exhibit(
                name=f"cost_{one.case}",
                title=f"{one.title}: error and cost",
                caption=_caption(one),
                description=_description(one),
                figure=cost_figure(one, evidence.inks),
                run_ids=tuple(dict.fromkeys([*one.run_ids, *(course.run_id for course in one.refinements)])),
            )
            for one in found
        ),
    )


def cost_table(found: Sequence[CaseAccuracy], measure: Measure, environment: Mapping[str, int]) -> Table:
    """Return the table of what each solver takes to be within each of `LEVELS`."""
    lines: list[dict[str, Any]] = []
    for one in found:
        for solver in one.solvers:
            families, floor = one.of(solver), one.yardstick.floor
            rate, order = families[0].rate(measure, floor), families[0].order(floor)
            runs = [run for family in families for point in family.points for run in point.run_ids]
            line: dict[str, Any] = {"block": one.title, "case": one.case, "solver": solver}
            for level in LEVELS:
                ways = [way for family in families if (way := family.cheapest(level, floor, measure))]
                cost, point = min(ways, key=lambda way: way[0], default=(None, None))
                line |= {f"to_{level:g}": cost, f"runs_{level:g}": " ".join(point.run_ids) if point else ""}
            line |= {
                "exponent": rate.slope if rate else None,
                "order": order if measure == "unknowns" else None,
                "environment": ", ".join(map(str, sorted({environment[run] for run in runs if run in environment}))),
            }
            lines.append(line)
    own = {
        "unknowns": (column("order", "Order in h", _exponent),),
        "seconds": (column("environment", right=True),),
        "memory": (),
    }
    return Table(
        name=f"cost_{measure}",
        title=TITLES[measure],
        caption=f"{WHAT[measure]} {RULE}",
        data=frame(lines),
        columns=(
            "solver",
            *(column(f"to_{level:g}", f"{100 * level:g} %", WAYS[measure]) for level in LEVELS),
            column("exponent", "Exponent", _exponent),
            *own[measure],
        ),
        notes=tuple(_notes(found)),
    )


def _exponent(value: float, line: Line, notation: Notation) -> str:
    return notation.escape(f"{value:.1f}".replace("-", MINUS))


def _notes(found: Sequence[CaseAccuracy]) -> list[Note]:
    notes = []
    for one in found:
        if one.yardstick.run_id:
            notes.append(Note(one.title, f"errors are against {one.yardstick.words}."))
        notes += one.failures(" and reached nothing")
    return notes


def _caption(one: CaseAccuracy) -> str:
    rates = (
        "Numbers at the right: slopes fitted to the finest sizes of each solver's longest sweep at which errors still"
        " fall, drawn dashed below (a field's errors follow no power law for long)."
    )
    level = any(
        len(family.points) >= FEWEST and len({point.unknowns for point in family.points}) == 1
        for family in one.families
    )
    steps = " Dotted: a sweep that leaves the unknowns as they are, as over the time step." if level else ""
    return (
        f"Error of the {one.quantity} against unknowns, wall time and peak memory of the solve (above what the process"
        f" held before). Errors are against {one.yardstick.words}. A mark is one size: with several seeds the"
        f" geometric mean, with a bar from the least to the largest. {panel.FLOOR_WORDS} {rates}{steps}"
    )


def _description(one: CaseAccuracy) -> str:
    best = [f"{solver} {down_to(p for family in one.of(solver) for p in family.points)}" for solver in one.solvers]
    return f"{one.title}, relative error of the {one.quantity}: {'; '.join(best)}"


def cost_figure(accuracy: CaseAccuracy, inks: Mapping[str, Ink], own: str = "default settings") -> Figure:
    """Draw error against unknowns, seconds and memory, with the slopes of each solver's largest family.

    Runs without a sweep have black rims, and are called `own` in the legend.
    """
    figure, (panels,) = panel.open_figure((WIDTH, HEIGHT + MARGIN), 1, len(LABELS), sharey=True)
    floor = accuracy.yardstick.floor
    for axes, measure in zip(panels, LABELS, strict=True):
        for course in accuracy.refinements:
            if measure in ("unknowns", "seconds"):
                x, errors = course.errors(measure)
                share = 100 * abs(course.reference) / accuracy.yardstick.scale * np.array(errors)
                axes.plot(x, share, color=inks[course.solver].colour, linewidth=0.6, alpha=0.6)
        for family in accuracy.families:
            _draw(axes, family, measure, inks[family.solver], floor / panel.BELOW_FLOOR)
        axes.set_xlabel(LABELS[measure])
    panel.finish(panels, y=panel.ERROR_LABEL, floor=100 * floor, below=panel.FOR_SLOPES)
    starting = panel.shade_start(panels[list(LABELS).index("seconds")])
    for axes, measure in zip(panels, LABELS, strict=True):
        rates = {solver: accuracy.of(solver)[0].rate(measure, floor) for solver in accuracy.solvers}
        fits = [(rate, f"{rate.slope:.1f}", inks[solver].colour) for solver, rate in rates.items() if rate is not None]
        panel.draw_slopes(axes, fits, UNITS[measure])
    panel.add_legend(
        figure, _legend(accuracy, inks, own, in_view=100 * floor > panels[0].get_ylim()[0], starting=starting)
    )
    return figure


def _draw(axes: Axes, family: Family, measure: Measure, ink: Ink, least: float) -> None:
    """Draw a family: a line through the sizes that ended well, dotted if only its cost changes, and a mark for each.

    Errors below `least` are drawn at its height.
    """
    shown = [(cost / UNITS[measure], point) for point in family.points if (cost := point.cost(measure)) is not None]
    for x, point in shown:
        if max(point.errors) > min(point.errors):
            ends = [100 * max(end, least) for end in (min(point.errors), max(point.errors))]
            axes.plot([x, x], ends, color=ink.colour, linewidth=0.8, alpha=0.7)
    level = len({point.unknowns for _, point in shown}) == 1
    line = "none" if len(family.points) < FEWEST else DASHES[2] if level else DASHES[0]
    look = {"linewidth": 1.0, **({} if family.swept else ALONE)}
    drawn = [(x, 100 * max(point.error, least), point.sound) for x, point in shown]
    panel.draw_runs(axes, drawn, ink, line, **look)


def _legend(
    accuracy: CaseAccuracy, inks: Mapping[str, Ink], own: str, *, in_view: bool, starting: bool
) -> dict[str, Any]:
    families = accuracy.families
    entries = {solver: panel.entry(inks[solver]) for solver in accuracy.solvers}
    if any(not family.swept for family in families):
        entries[own] = panel.mark_entry(**ALONE)
    if accuracy.refinements:
        entries["refinement within a run"] = panel.entry(linewidth=0.6)
    entries |= panel.failed_entry(any(not point.sound for family in families for point in family.points))
    if any(family.rate(measure, accuracy.yardstick.floor) for family in families for measure in LABELS):
        entries["fitted slope"] = panel.entry(linewidth=0.8, linestyle=DASHES[1])
    return entries | panel.shade_entry(in_view, "uncertainty of the reference") | panel.start_entry(starting)
