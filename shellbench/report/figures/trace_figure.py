"""Traces drawn over time, or as load against displacement: a panel for each series, solvers overlaid, known values."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.report.data.exhibit import DASHES, Ink
from shellbench.report.data.notation import plain
from shellbench.report.data.traces import CRITICAL, KnownPoints, Trace, TracedRun
from shellbench.report.figures.panel import add_legend

WIDTH, HEIGHT, HIGH = 2.45, 1.95, 2.5  # inches a panel; of one that has the load upwards
ALONE = 4.6, 2.4  # inches of a panel that stands alone
MARGIN = 0.7  # inches for the legend's first lines
MOST_IN_A_ROW = 3  # panels
TITLE = 36  # characters a line
DENSE = 24  # points of a line, above which it has no markers
TABLE = 12  # tabulated points, above which their crosses shrink
THINNEST, STEP, THICKEST = 1.1, 1.5, 5.0  # widths of lines, the last solver's on top: of those below a rim is seen
CROSSES = ("x", "+", "1", "2", "3", "4")  # of figures from elsewhere, one for each source
ELSEWHERE = "#555555"
FORMS = (("black", DASHES[1]), ("#777777", DASHES[2]))  # colours and dashes of closed forms
TIME = "time t (s)"


@dataclass(frozen=True)
class TracePanel:
    """One series.

    Attributes
    ----------
    names
        Names of the traces to draw, of which each run's first is drawn.
    label
        Of the values' axis, with the unit.
    along
        Of the marks' axis, with the unit.
    load_scale
        Factor of marks that are load factors and are drawn upwards; None of marks that are drawn to the right.
    forms
        Curves that are known by formula, by what a legend calls them.
    limit_loads
        Load factors of known limit points whose displacement is not known.
    smallest
        Extent that the axis has at least: what is smaller is rounding.
    logarithmic
        Whether its axis is; values that are not positive are left out.
    """

    names: tuple[str, ...]
    label: str
    along: str = TIME
    title: str = ""
    known: tuple[KnownPoints, ...] = ()
    forms: Mapping[str, Trace] = field(default_factory=dict)
    load_scale: float | None = None
    limit_loads: tuple[float, ...] = ()
    smallest: float = 0.0
    logarithmic: bool = False

    def xy(self, marks: Any, values: Any) -> tuple[Any, Any]:
        """Return the horizontal and the vertical coordinates of a curve."""
        return (marks, values) if self.load_scale is None else (values, self.load_scale * np.asarray(marks))


def trace_figure(
    panels: Sequence[TracePanel],
    runs: Sequence[TracedRun],
    inks: Mapping[str, Ink],
    most_in_a_row: int = MOST_IN_A_ROW,
    special: str = "critical state",
) -> Figure:
    """Draw each panel's traces; those of a failed run end in a cross.

    Parameters
    ----------
    inks
        By name of run.
    special
        What a legend calls the states of a run that a diamond marks.
    """
    columns = min(len(panels), most_in_a_row)
    rows, upright = -(-len(panels) // columns), panels[0].load_scale is not None
    width, height = ALONE if len(panels) == 1 else (WIDTH * columns, (HIGH if upright else HEIGHT) * rows)
    figure = Figure(figsize=(max(3.6, width), height + MARGIN), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=upright)
    labels = dict.fromkeys(points.label for panel in panels for points in panel.known if not points.judges)
    crosses = {label: CROSSES[i % len(CROSSES)] for i, label in enumerate(labels)}
    entries: dict[str, Any] = {}
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    for place, (axes, panel) in enumerate(zip(grid.flat, panels, strict=False)):
        _draw(axes, panel, runs, inks, entries, special)
        for points in panel.known:
            entries.setdefault(points.label, _draw_known(axes, panel, points, crosses))
        if upright:
            axes.set(xlabel=panel.label, ylabel="" if place % columns else panel.along)
        else:
            axes.set(xlabel=panel.along if place + columns >= len(panels) else "", ylabel=panel.label)
        title = textwrap.fill(panel.title[:1].upper() + panel.title[1:], TITLE, break_on_hyphens=False)
        axes.set_title(plain(title), loc="left", fontsize=7.5)
    if entries:
        add_legend(figure, entries, 3)
    return figure


def _draw(
    axes: Axes,
    panel: TracePanel,
    runs: Sequence[TracedRun],
    inks: Mapping[str, Ink],
    entries: dict[str, Any],
    special: str,
) -> None:
    for (label, form), (colour, dashes) in zip(panel.forms.items(), FORMS, strict=False):
        (line,) = axes.plot(form.marks, form.values, color=colour, linestyle=dashes, linewidth=0.9, zorder=3)
        entries.setdefault(label, line)
    names = list(dict.fromkeys(run.name for run in runs))
    for run in runs:
        width = min(THINNEST + STEP * (len(names) - 1 - names.index(run.name)), THICKEST)
        _draw_run(axes, panel, run, inks[run.name], width, entries, special)
    if panel.load_scale is not None:
        axes.axhline(0, color="#999999", linewidth=0.5, zorder=0)
        for factor in panel.limit_loads:
            load = axes.axhline(panel.load_scale * factor, color="black", linewidth=0.7, linestyle=":", zorder=1)
            entries["known limit load"] = load
    elif panel.logarithmic:
        axes.set_yscale("log")
    else:
        low, high = axes.get_ylim()
        if high - low < panel.smallest:
            middle = (high + low) / 2
            axes.set_ylim(middle - panel.smallest / 2, middle + panel.smallest / 2)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
        axes.yaxis.get_offset_text().set_fontsize(6.5)


def _draw_run(
    axes: Axes, panel: TracePanel, run: TracedRun, ink: Ink, width: float, entries: dict[str, Any], special: str
) -> None:
    name = next((name for name in panel.names if name in run.traces), None)
    if name is None:
        return
    trace = run.traces[name]
    shown = trace.values > 0 if panel.logarithmic else np.full(len(trace.values), True)
    x, y = panel.xy(trace.marks[shown], trace.values[shown])
    look: dict[str, Any] = {"color": ink.colour, "zorder": 4, "linestyle": "none"}
    (line,) = axes.plot(
        x,
        y,
        color=ink.colour,
        linestyle=ink.dashes,
        marker=ink.marker if len(x) <= DENSE else "",
        markersize=3.3,
        markeredgecolor="white",
        markeredgewidth=0.3,
        linewidth=width,
        zorder=2,
    )
    entries.setdefault(run.name, line)
    if run.reason is not None and len(x):
        (end,) = axes.plot(x[-1:], y[-1:], marker="X", markersize=7, **look)
        entries.setdefault(f"{run.name}: end of what a failed run left", end)
    if points := run.special.get(name):
        look |= {
            "marker": "D",
            "markersize": 5.5 + 2 * (width - THINNEST),
            "markerfacecolor": "none",
            "markeredgewidth": 1.1,
        }
        (mark,) = axes.plot(*panel.xy(*np.transpose(points)), **look)
        entries.setdefault(f"{run.name}: {special}", mark)


def _draw_known(axes: Axes, panel: TracePanel, points: KnownPoints, crosses: Mapping[str, str]) -> Any:
    look: dict[str, Any] = {"linestyle": "none", "markeredgewidth": 0.9, "elinewidth": 0.9, "capsize": 2.0, "zorder": 3}
    if points.judges:
        marker, size = ("s", 8.5) if points.label == CRITICAL else ("o", 7.0)
        look |= {"marker": marker, "markersize": size, "markerfacecolor": "none", "color": "black"}
    else:
        size = 5.0 if len(points.marks) <= TABLE else 4.0
        look |= {"marker": crosses[points.label], "markersize": size, "color": ELSEWHERE}
    known = np.isfinite(points.uncertainties)
    bars = np.where(known, points.uncertainties, 0.0) if known.any() else None
    return axes.errorbar(*panel.xy(points.marks, points.values), yerr=bars, **look)
