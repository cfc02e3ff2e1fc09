"""The figure of resolution consistency: difference at the same points, drift, and the difference over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator, StrMethodFormatter

from shellbench.report.ladder import CaseRuns, Ladder, Run
from shellbench.report.notation import SUPERSCRIPTS
from shellbench.report.palette import DASHES, Ink
from shellbench.report.probes import Difference
from shellbench.report.rates import Rate

WIDTH, HEIGHT, MARGIN = 2.53, 2.15, 0.45  # inches: a panel, and the legend below
LINE, MOST_BESIDE = 0.17, 5  # inches a further line of the legend, and entries in one
ALONE = 3.3  # inches of a panel of two
SMALLEST_DRIFT = 1e-9  # relative; no figure here is known better, and smaller ones are drawn at this height
SMALLEST = 1e-10  # relative difference below which rounding is all there is
PALEST = 0.25  # opacity of the coarsest run over time
FEW_DECADES = 2.0
_RIM: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.4}
_COMMON: dict[str, Any] = {"marker": "*", "markersize": 8, "linestyle": "none", **_RIM}
_OTHER: dict[str, Any] = {"marker": "x", "markersize": 5, "linestyle": "none"}


def drift_floor(case: CaseRuns) -> str:
    """Say that drifts too small for the axis are drawn at its foot, where that happens."""
    drifts = [value for ladder in case.ladders for _, value in _drifts(ladder.runs, ladder.finest)]
    return f" (below {SMALLEST_DRIFT:g} drawn there)" if any(value < SMALLEST_DRIFT for value in drifts) else ""


def consistency_figure(
    case: CaseRuns,
    ladders: Sequence[Ladder],
    spreads: Mapping[str, Sequence[tuple[int, float]]],
    rates: Mapping[str, Rate],
    inks: Mapping[str, Ink],
) -> Figure:
    """Draw one case.

    Parameters
    ----------
    ladders
        Of solvers with more than one resolution.
    spreads
        By solver: unknowns and the largest difference, m, between marginally different runs.
    rates
        By solver: fitted power law of the largest relative difference.
    """
    count = 3 if case.moves else 2
    width = WIDTH * count if count > 2 else ALONE * count
    figure = Figure(figsize=(width, HEIGHT + MARGIN), layout="constrained")
    panels = list(figure.subplots(1, count))
    scale = case.scale or 1.0
    _differences(panels[0], ladders, spreads, rates, inks, scale)
    _from_common(panels[0], case, inks, scale)
    _finish(panels[0], "unknowns", "difference (% of the largest)")
    _drift(panels[1], ladders, inks)
    if case.moves:
        _over_time(panels[2], case, ladders, inks, scale)
    shown = dict.fromkeys(ladder.solver for ladder in case.ladders)
    entries = {
        solver: Line2D([], [], color=inks[solver].colour, marker=inks[solver].marker, linestyle="-") for solver in shown
    }
    entries["largest"] = Line2D([], [], color="#444444", linestyle="-")
    entries["root mean square"] = Line2D([], [], color="#444444", linestyle="--")
    if any(spreads.get(solver) for solver in shown):
        entries["marginally different runs"] = Line2D(
            [], [], color="#444444", marker="o", markerfacecolor="none", linestyle="none", markersize=6
        )
    if any(ladder.other_time_steps for ladder in ladders):
        entries["other time steps"] = Line2D([], [], color="#444444", **_OTHER)
    if len(case.ladders) > 1:
        entries["finest, from the common run"] = Line2D([], [], color="#444444", **_COMMON)
    if case.moves and len(case.ladders) > 1:
        entries["the same over time"] = Line2D([], [], color="#444444", linestyle=":", linewidth=1.5)
    titles = ("From the solver's finest run", "Headline quantity", "Over time")
    for axes, title in zip(panels, titles, strict=False):
        axes.set_title(title, loc="left")
    labels = [label.replace("$", r"\$") for label in entries]
    rows = -(-len(entries) // MOST_BESIDE)
    figure.legend(entries.values(), labels, loc="outside lower center", ncols=-(-len(entries) // rows))
    figure.set_size_inches(width, HEIGHT + MARGIN + LINE * (rows - 1))
    return figure


def _differences(
    axes: Axes,
    ladders: Sequence[Ladder],
    spreads: Mapping[str, Sequence[tuple[int, float]]],
    rates: Mapping[str, Rate],
    inks: Mapping[str, Ink],
    scale: float,
) -> None:
    for ladder in ladders:
        ink = inks[ladder.solver]
        found = _from_finest(ladder.line, ladder.finest, scale)
        x = [unknowns for unknowns, _ in found]
        axes.plot(x, [100 * d.largest / scale for _, d in found], color=ink.colour, marker=ink.marker, **_RIM)
        axes.plot(x, [100 * d.rms / scale for _, d in found], color=ink.colour, linestyle=DASHES[1], linewidth=1.0)
        others = _from_finest(ladder.other_time_steps, ladder.finest, scale)
        axes.plot(
            [unknowns for unknowns, _ in others],
            [100 * d.largest / scale for _, d in others],
            color=ink.colour,
            **_OTHER,
        )
        around = [(u, 100 * s / scale) for u, s in spreads.get(ladder.solver, ()) if s > SMALLEST * scale]
        if around:
            axes.plot(
                *zip(*around, strict=True),
                color=ink.colour,
                marker="o",
                markersize=6,
                markerfacecolor="none",
                markeredgewidth=1.0,
                linestyle="none",
            )
        rate = rates.get(ladder.solver)
        if rate is not None:
            _slope(axes, rate, ink.colour)


def _from_common(axes: Axes, case: CaseRuns, inks: Mapping[str, Ink], scale: float) -> None:
    """Draw how far each solver's finest run is from the one that all are held against."""
    for ladder in case.ladders:
        if case.yardstick is None or ladder.finest is case.yardstick:
            continue
        found = ladder.finest.difference(case.yardstick)
        if found is not None and found.largest > SMALLEST * scale:
            colour = inks[ladder.solver].colour
            axes.plot([ladder.finest.unknowns], [100 * found.largest / scale], color=colour, **_COMMON)


def _from_finest(runs: Sequence[Run], finest: Run, scale: float) -> list[tuple[int, Difference]]:
    return [
        (run.unknowns, found)
        for run in runs
        if run is not finest and (found := run.difference(finest)) is not None and found.largest > SMALLEST * scale
    ]


def _slope(axes: Axes, rate: Rate, colour: str) -> None:
    """Draw a fitted slope below its curve, with its power of the number N of unknowns at its end."""
    shift = 2.2
    ends = (rate.first, rate.last)
    axes.plot(ends, [100 * rate(x) / shift for x in ends], color=colour, linewidth=0.9, linestyle=DASHES[2])
    axes.annotate(
        rf"$N^{{\,{rate.slope:.1f}}}$".replace("-", "\N{MINUS SIGN}"),
        (rate.last, 100 * rate(rate.last) / shift),
        xytext=(2, -1),
        textcoords="offset points",
        ha="left",
        va="top",
        color=colour,
        fontsize=7.0,
        bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.6},
    )


def _drifts(runs: Sequence[Run], finest: Run) -> list[tuple[int, float]]:
    quantity = finest.row.quantity
    last = finest.record.values.get(quantity)
    found = []
    for run in runs:
        value = run.record.values.get(quantity)
        if run is not finest and value is not None and last is not None and last.value:
            found.append((run.unknowns, abs(value.value - last.value) / abs(last.value)))
    return found


def _drift(axes: Axes, ladders: Sequence[Ladder], inks: Mapping[str, Ink]) -> None:
    for ladder in ladders:
        ink = inks[ladder.solver]
        looks: list[tuple[Sequence[Run], dict[str, Any]]] = [
            (ladder.line, {"marker": ink.marker, **_RIM}),
            (ladder.other_time_steps, _OTHER),
        ]
        for runs, look in looks:
            found = _drifts(runs, ladder.finest)
            heights = [100 * max(value, SMALLEST_DRIFT) for _, value in found]
            axes.plot([x for x, _ in found], heights, color=ink.colour, **look)
    _finish(axes, "unknowns", "drift (%)")


def _over_time(axes: Axes, case: CaseRuns, ladders: Sequence[Ladder], inks: Mapping[str, Ink], scale: float) -> None:
    for ladder in ladders:
        colour = inks[ladder.solver].colour
        runs = [run for run in ladder.line if run is not ladder.finest]
        for place, run in enumerate(runs, start=1):
            alpha = PALEST + (1 - PALEST) * place / len(runs)
            _trace(axes, run.difference(ladder.finest), scale, color=colour, alpha=alpha, linewidth=1.1)
        if case.yardstick is not None and case.yardstick is not ladder.finest:
            found = ladder.finest.difference(case.yardstick)
            _trace(axes, found, scale, color=colour, linestyle=DASHES[2], linewidth=1.5)
    axes.set_yscale("log")
    axes.set_xlabel("time t (s)")
    axes.set_ylabel("largest difference (%)")
    tick(axes.yaxis)


def _trace(axes: Axes, found: Difference | None, scale: float, **look: Any) -> None:
    if found is not None:
        shown = found.by_mark > SMALLEST * scale
        axes.plot(found.marks[shown], 100 * found.by_mark[shown] / scale, **look)


def _finish(axes: Axes, abscissa: str, ordinate: str) -> None:
    logarithmic(axes)
    axes.set_xlabel(abscissa)
    axes.set_ylabel(ordinate)
    axes.margins(x=0.12, y=0.12)
    tick(axes.xaxis)
    tick(axes.yaxis)


def logarithmic(axes: Axes) -> None:
    """Set logarithmic scales where something positive is drawn: an empty axis has none."""
    if math.isfinite(axes.xaxis.get_minpos()):
        axes.set_xscale("log")
    if math.isfinite(axes.yaxis.get_minpos()):
        axes.set_yscale("log")


def tick(axis: Axis) -> None:
    """Label decades of a logarithmic axis, or 1, 2 and 5 where only few are in view."""
    if axis.get_scale() != "log":
        return
    low, high = sorted(axis.get_view_interval())
    decades = math.log10(high / low) if low > 0 else 0.0
    if decades < FEW_DECADES:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < FEW_DECADES / 2 else (1.0, 3.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    else:
        axis.set_major_locator(LogLocator(numticks=6))
        axis.set_major_formatter(FuncFormatter(_power))
    axis.set_minor_locator(NullLocator())


def _power(value: float, place: int | None = None) -> str:
    """Write a power of ten in plain characters, which are drawn far faster than formulas."""
    exponent = round(math.log10(value)) if value > 0 else 0
    return f"{value:g}" if 0 <= exponent <= 1 else f"10{str(exponent).translate(SUPERSCRIPTS)}"
