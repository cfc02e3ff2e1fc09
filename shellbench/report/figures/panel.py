"""One panel on logarithmic axes: curves with marks, fitted slopes, the shade of what is uncertain, ticks and legend.

All figures of evidence are made of it, so that they look and read alike. Percentages come in as they are drawn. The
order is: open the figure, draw the curves, finish the panels (their limits follow from what was drawn), then the
slopes, whose labels stand at the height at which they end, and the legend below all panels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from shellbench.report.data.exhibit import DASHES, Dashes, Ink
from shellbench.report.data.notation import SUPERSCRIPTS, plain
from shellbench.report.data.rates import FEWEST, Rate

ERROR_LABEL = "relative error (%)"
UNCERTAIN = "uncertainty of the known value"
SMALLEST = 1e-12  # relative figure that is drawn for none
BELOW = 2.5  # factor by which a fitted line is drawn under its curve
SPACING = 0.075  # of a panel's height between two slopes' labels
ROOM, FOR_SLOPES = 3.0, 6.0  # factors between curves and ends of the axis, and where slopes stand below curves
FLOOR_SHOWN = 30.0  # factor by which that axis goes below what can't be told from zero, at most
MOST_IN_A_ROW = 6  # entries of the legend
LINE, ROWS = 0.17, 2  # inches of a row of it; rows that figures have room for
NARROW, FEW_DECADES = 0.7, 2.0  # decades below which an axis has few plain steps, and 1, 3 or 1, 2, 5 of each decade
BELOW_FLOOR = 10.0  # errors smaller than the known value's uncertainty by more than this factor are drawn there
FLOOR_WORDS = (
    f"Errors below 1/{BELOW_FLOOR:.0f} of the known value's uncertainty, no different from zero, are drawn there."
)
FITS = 0.95  # share of a figure's width that a legend may take: letters are wider in some formats than on the screen
GREY, SHADE = "#666666", "#BBBBBB"
START = 0.1  # seconds below which a time tells of the first calls in a fresh process as much as of the solve
STARTING: dict[str, Any] = {"facecolor": "none", "edgecolor": "#DDDDDD", "hatch": "////", "linewidth": 0}


def open_figure(size: tuple[float, float], rows: int = 1, columns: int = 1, **shared: Any) -> tuple[Figure, Any]:
    """Return a figure of so many inches and its panels (rows, columns)."""
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def draw(axes: Axes, x: Any, y: Any, ink: Ink, line: Dashes = "-", *, hollow: bool = False, **look: Any) -> None:
    """Draw a curve with its marks, the marks open if `hollow`.

    It has no line if that is "none", or if there are fewer than `FEWEST` points: two points look like a trend.
    """
    edge = {"markerfacecolor": "white", "markeredgecolor": ink.colour, "markeredgewidth": 0.9}
    rim = {"markeredgecolor": "white", "markeredgewidth": 0.4}
    style = {"color": ink.colour, "marker": ink.marker, "linestyle": line, **(edge if hollow else rim), **look}
    if len(x) < FEWEST:
        style |= {"linestyle": "none", "marker": style["marker"] or "."}
    if len(x):
        axes.plot(x, y, **style)


def draw_runs(axes: Axes, runs: Any, ink: Ink, line: Dashes = "none", **look: Any) -> None:
    """Draw runs, rows (x, y, whether it ended well): a curve of the good ones, and open marks for the others."""
    x, y, good = np.array(runs, dtype=float).reshape(-1, 3).T
    draw(axes, x[good > 0], y[good > 0], ink, line, **look)
    draw(axes, x[good == 0], y[good == 0], ink, "none", hollow=True, **look)


def finish(
    panels: Iterable[Axes],
    x: str = "",
    y: str = "",
    title: str = "",
    *,
    floor: float | Sequence[float] = 0.0,
    log: str = "xy",
    below: float = ROOM,
) -> None:
    """Label panels that share their ordinate, limit it to what is drawn, shade what is uncertain, and tick the axes.

    The ordinate leaves out what lies far below the uncertainty, but never all that is drawn.

    Parameters
    ----------
    x, y, title
        Words; those of the ordinate stand at the first panel.
    floor
        What can't be told from zero, on the ordinate; of each panel, if there are several.
    log
        Which axes are logarithmic, if something positive is drawn: an empty one has no logarithm.
    below
        Factor that is left below the curves: `FOR_SLOPES` where slopes are to stand there.
    """
    panels = list(panels)
    floors = np.broadcast_to(np.asarray(floor, dtype=float), len(panels))
    for axes in panels:
        if "x" in log and math.isfinite(axes.xaxis.get_minpos()):
            axes.set_xscale("log")
        if "y" in log and math.isfinite(axes.yaxis.get_minpos()):
            axes.set_yscale("log")
        axes.margins(x=0.1)
        if x:
            axes.set_xlabel(x)
        if title:
            axes.set_title(plain(title), loc="left")
    panels[0].set_ylabel(y)
    drawn = [np.asarray(line.get_ydata(), dtype=float) for axes in panels for line in axes.get_lines()]
    heights = np.concatenate([np.empty(0), *drawn])
    heights = heights[np.isfinite(heights) & (heights > 0)]
    if "y" in log and len(heights):
        highest = heights.max() * ROOM
        lowest = max(heights.min() / below, min(floors.max() / FLOOR_SHOWN, highest / FLOOR_SHOWN))
        panels[0].set_ylim(lowest, highest)
    for axes, uncertain in zip(panels, floors, strict=True):
        low, high = axes.get_ylim()
        if uncertain > max(low, 0.0):
            axes.axhspan(low / ROOM, uncertain, color=SHADE, alpha=0.35, linewidth=0, zorder=0)
            axes.set_ylim(low, high)
        tick(axes.xaxis)
        tick(axes.yaxis)


def tick(axis: Axis) -> None:
    """Label decades of a logarithmic axis; 1, 2 and 5 or 1 and 3 of each, or plain steps, where few are in view."""
    if axis.get_scale() != "log":
        return
    low, high = sorted(axis.get_view_interval())
    decades = math.log10(high / low) if low > 0 else 0.0
    if decades < NARROW:
        axis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
    elif decades < FEW_DECADES:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if 2 * decades < FEW_DECADES else (1.0, 3.0)))
    else:
        axis.set_major_locator(LogLocator(numticks=8))
    plain_steps = decades < FEW_DECADES
    axis.set_major_formatter(FuncFormatter(step_words if plain_steps else power_words))
    axis.set_minor_locator(NullLocator())


def power_words(value: float, place: int | None = None) -> str:
    """Write a power of ten in plain characters, which are drawn far faster than formulas."""
    exponent = round(math.log10(value)) if value > 0 else 0
    return f"{value:g}" if 0 <= exponent <= 1 else f"10{str(exponent).translate(SUPERSCRIPTS)}"


def step_words(value: float, place: int | None = None) -> str:
    """Write a number that is no power of ten, as 3·10⁻⁹ where it would need an exponent."""
    mantissa, _, exponent = f"{value:g}".partition("e")
    return f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPTS)}" if exponent else mantissa


def draw_slopes(axes: Axes, fits: Sequence[tuple[Rate, str, str]], unit: float = 1.0, line: Dashes = DASHES[1]) -> None:
    """Draw fitted power laws below their curves, with their words at the right of the panel.

    Parameters
    ----------
    fits
        Law of a relative error, words, and colour.
    unit
        In which the abscissa is drawn, in that of the law.
    """
    labels = []
    for rate, words, colour in fits:
        ends = (rate.first, rate.last)
        low = [100 * rate(x) / BELOW for x in ends]
        axes.plot([x / unit for x in ends], low, color=colour, linewidth=0.8, linestyle=line)
        place = axes.transAxes.inverted().transform(axes.transData.transform((axes.get_xlim()[1], low[1])))
        labels.append((float(place[1]), words.replace("-", "\N{MINUS SIGN}"), colour))
    labels.sort()
    for height, (_, words, colour) in zip(apart([height for height, _, _ in labels]), labels, strict=True):
        axes.text(1.01, height, words, transform=axes.transAxes, color=colour, fontsize=7.0, va="center")


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


def entry(ink: Ink | None = None, **look: Any) -> Line2D:
    """Return a legend entry: a solver's line and marker, or grey without an ink."""
    own = {"color": ink.colour, "marker": ink.marker, "linestyle": ink.dashes} if ink else {"color": GREY}
    return Line2D([], [], **{**own, **look})


def mark_entry(**look: Any) -> Line2D:
    """Return a grey mark alone, for a legend."""
    return entry(**{"marker": "o", "linestyle": "none", **look})


def failed_entry(shown: bool) -> dict[str, Line2D]:
    """Return the legend's entry of open marks, if there are any."""
    return {"failed or not settled": mark_entry(markerfacecolor="white")} if shown else {}


def shade_entry(shown: bool, words: str = UNCERTAIN) -> dict[str, Line2D]:
    """Return the legend's entry of the shade, if there is any."""
    return {words: entry(color=SHADE, alpha=0.6, linewidth=6)} if shown else {}


def shade_start(axes: Axes, unit: float = 1.0) -> bool:
    """Hatch times in which a process starts, on an abscissa of seconds; return whether any are in view."""
    low, high = axes.get_xlim()
    if low >= START / unit or high <= low:
        return False
    axes.axvspan(low, START / unit, zorder=0, **STARTING)
    axes.set_xlim(low, high)
    return True


def start_entry(shown: bool) -> dict[str, Patch]:
    """Return the legend's entry of times in which a process starts, if there are any."""
    return {f"below {START:g} s: first calls of a process": Patch(**STARTING)} if shown else {}


def add_legend(figure: Figure | SubFigure, entries: Mapping[str, Any], most: int = MOST_IN_A_ROW) -> None:
    """Put one legend below all panels, in as many columns as fit the figure's width, of `most` at most.

    The figure grows by what its rows need beyond the first two.
    """
    if not entries:
        return
    handles, words = list(entries.values()), list(map(plain, entries))
    for columns in range(min(most, len(entries)), 0, -1):
        rows = -(-len(entries) // columns)
        legend = figure.legend(handles, words, loc="outside lower center", ncols=-(-len(entries) // rows))
        if legend.get_window_extent().width <= FITS * figure.bbox.width or columns == 1:
            break
        legend.remove()
    if isinstance(figure, Figure):
        figure.set_figheight(figure.get_figheight() + LINE * max(0, rows - ROWS))
