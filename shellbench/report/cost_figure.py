"""Error against unknowns, seconds and memory in three panels, all solvers of a case in one figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, NullLocator

from shellbench.report.accuracy import CaseAccuracy, Family, Measure, Point
from shellbench.report.convergence import ERROR_LABEL
from shellbench.report.palette import DASHES, Ink
from shellbench.report.rates import FEWEST
from shellbench.report.shells import plain

MEASURES: tuple[Measure, ...] = ("unknowns", "seconds", "memory")
LABELS: dict[Measure, str] = {
    "unknowns": "unknowns",
    "seconds": "wall time of the solve (s)",
    "memory": "peak memory of the solve (MB)",
}
MEGABYTE = 1e6
WIDTH, HEIGHT, MARGIN = 7.4, 2.5, 0.55  # inches of the figure, of its panels, and of the legend
BELOW = 2.5  # factor by which a fitted line is drawn under its curve
SPACING = 0.075  # of a panel's height between two slopes' labels
MOST_IN_A_ROW = 6  # entries of the legend
FEW_DECADES = 1.3  # of an axis that is labelled at 1, 2 and 5, or at 1 and 3 up to twice as many
GREY = "#BBBBBB"


def cost_figure(accuracy: CaseAccuracy, inks: Mapping[str, Ink]) -> Figure:
    """Draw the three panels; the slopes of each solver's largest family stand on their right, in its colour."""
    figure = Figure(figsize=(WIDTH, HEIGHT + MARGIN), layout="constrained")
    panels = figure.subplots(1, len(MEASURES), sharey=True)
    for axes, measure in zip(panels, MEASURES, strict=True):
        axes.set_xscale("log")
        axes.set_yscale("log")
        for course in accuracy.refinements:
            if measure != "memory":
                x, errors = course.errors(measure)
                percent = 100 * abs(course.reference) / accuracy.yardstick.scale * np.array(errors)
                axes.plot(x, percent, color=inks[course.solver].colour, linewidth=0.6, alpha=0.6)
        for family in accuracy.families:
            _draw(axes, family, measure, inks[family.solver])
        axes.set_xlabel(LABELS[measure])
    panels[0].set_ylabel(ERROR_LABEL)
    _limit(panels[0], accuracy)
    for axes, measure in zip(panels, MEASURES, strict=True):
        axes.margins(x=0.08)
        _tick(axes)
        _label_slopes(axes, accuracy, measure, inks)
    legend = _legend(accuracy, inks)
    figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=min(MOST_IN_A_ROW, len(legend)))
    return figure


def _draw(axes: Axes, family: Family, measure: Measure, ink: Ink) -> None:
    shown = [(scaled(cost, measure), point) for point in family.points if (cost := point.cost(measure)) is not None]
    sound = [(x, point) for x, point in shown if point.sound]
    alone = not family.swept
    if len(family.points) >= FEWEST:
        axes.plot(
            [x for x, _ in sound],
            [100 * point.error for _, point in sound],
            color=ink.colour,
            linewidth=1.0,
            linestyle=DASHES[0] if len({point.unknowns for _, point in sound}) > 1 else DASHES[2],
            alpha=0.85,
        )
    for x, point in shown:
        low, high = 100 * min(point.errors), 100 * max(point.errors)
        if high > low:
            axes.plot([x, x], [low, high], color=ink.colour, linewidth=0.8, alpha=0.7)
        axes.plot(
            [x],
            [100 * point.error],
            color=ink.colour,
            marker=ink.marker,
            markersize=6.5 if alone else 3.8,
            linestyle="none",
            markerfacecolor=ink.colour if point.sound else "white",
            markeredgecolor="black" if alone and point.sound else ink.colour,
            markeredgewidth=0.8 if alone or not point.sound else 0.2,
            zorder=3 if alone else 2.5,
        )


def scaled(cost: float, measure: Measure) -> float:
    """Return a cost in the unit of its axis."""
    return cost / MEGABYTE if measure == "memory" else cost


def _limit(axes: Axes, accuracy: CaseAccuracy) -> None:
    """Limit the errors to those of the runs, and shade what can't be told from zero."""
    points: list[Point] = [point for family in accuracy.families for point in family.points]
    errors = [100 * error for point in points for error in point.errors]
    low, high = min(errors) / 3, max(errors) * 3
    floor = 100 * accuracy.yardstick.floor
    axes.set_ylim(max(low, floor / 30), high)
    for one in axes.figure.axes if floor else ():
        one.axhspan(low / 1e6, floor, color=GREY, alpha=0.35, linewidth=0, zorder=0)


def _label_slopes(axes: Axes, accuracy: CaseAccuracy, measure: Measure, inks: Mapping[str, Ink]) -> None:
    labels: list[tuple[float, str, str]] = []
    for solver in accuracy.solvers:
        rate = accuracy.of(solver)[0].rate(measure, accuracy.yardstick.floor)
        if rate is None:
            continue
        colour = inks[solver].colour
        ends = np.array([rate.first, rate.last])
        below = [100 * rate(x) / BELOW for x in ends]
        axes.plot([scaled(x, measure) for x in ends], below, color=colour, linewidth=0.8, linestyle=DASHES[1])
        height = axes.transAxes.inverted().transform(axes.transData.transform((axes.get_xlim()[1], below[1])))[1]
        labels.append((float(height), f"{rate.slope:.1f}".replace("-", "\N{MINUS SIGN}"), colour))
    for height, (_, text, colour) in zip(
        apart([height for height, _, _ in sorted(labels)]), sorted(labels), strict=True
    ):
        axes.text(1.01, height, text, transform=axes.transAxes, color=colour, fontsize=7.0, va="center")


def apart(heights: Sequence[float], spacing: float = SPACING) -> list[float]:
    """Move increasing heights apart until they are `spacing` from each other, within 0 and 1 as far as they fit."""
    moved: list[float] = []
    for height in heights:
        moved.append(max(min(max(height, 0.0), 1.0), moved[-1] + spacing if moved else 0.0))
    excess = max(0.0, moved[-1] - 1.0) if moved else 0.0
    for i in reversed(range(len(moved))):
        ceiling = moved[i + 1] - spacing if i + 1 < len(moved) else moved[i] - excess
        moved[i] = min(moved[i], ceiling)
    return moved


def _tick(axes: Axes) -> None:
    """Label decades, or 1, 2 and 5 where few of them are in view."""
    low, high = axes.get_xlim()
    decades = float(np.log10(high / low))
    if decades < 2 * FEW_DECADES:
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < FEW_DECADES else (1.0, 3.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    else:
        axes.xaxis.set_major_locator(LogLocator(numticks=6))
        axes.xaxis.set_major_formatter(LogFormatterMathtext())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_minor_locator(NullLocator())


def _legend(accuracy: CaseAccuracy, inks: Mapping[str, Ink]) -> dict[str, Line2D]:
    entries: dict[str, Line2D] = {}
    for solver in accuracy.solvers:
        ink = inks[solver]
        entries[plain(solver)] = Line2D([], [], color=ink.colour, marker=ink.marker)
    families = accuracy.families
    marks = {"color": "#666666", "marker": "o", "linestyle": "none"}
    if any(not family.swept for family in families):
        entries["default settings"] = Line2D([], [], **marks, markersize=6.5, markeredgecolor="black")  # type: ignore[arg-type]
    if accuracy.refinements:
        entries["refinement within a run"] = Line2D([], [], color="#666666", linewidth=0.6)
    if any(not point.sound for family in families for point in family.points):
        entries["failed run"] = Line2D([], [], **marks, markerfacecolor="white")  # type: ignore[arg-type]
    if any(family.rate(measure, accuracy.yardstick.floor) for family in families for measure in MEASURES):
        entries["fitted slope"] = Line2D([], [], color="#666666", linewidth=0.8, linestyle=(0, (4, 1.5)))
    if accuracy.yardstick.floor and 100 * accuracy.yardstick.floor > _bottom(accuracy):
        entries["uncertainty of the reference"] = Line2D([], [], color=GREY, alpha=0.6, linewidth=6)
    return entries


def _bottom(accuracy: CaseAccuracy) -> float:
    errors = [100 * min(point.errors) for family in accuracy.families for point in family.points]
    return max(min(errors) / 3, 100 * accuracy.yardstick.floor / 30)
