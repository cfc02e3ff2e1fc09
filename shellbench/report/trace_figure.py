"""Traces drawn over time, or along a path: a panel for each series, solvers overlaid, known values as marks."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shellbench.report.curve_figure import CROSSES, ELSEWHERE, legend_columns
from shellbench.report.palette import DASHES, Dashes, Ink
from shellbench.report.shells import plain
from shellbench.report.traces import KnownPoints, TracedRun

Array = NDArray[np.float64]

WIDTH, HEIGHT = 2.45, 1.95  # inches a panel
ALONE = 4.6, 2.4  # inches of a panel that stands alone
MARGIN, LINE = 0.55, 0.17  # inches for the legend's first line, and each further one
MOST_IN_A_ROW = 3  # panels
TITLE = 36  # characters a line
DENSE = 24  # points of a trace, above which they are a line without marks
THINNEST, STEP, THICKEST = 1.1, 0.9, 3.8  # widths of lines, the last solver's on top: of those below a rim is seen


@dataclass(frozen=True)
class ClosedForm:
    """A curve that is known by formula: values (n,) at marks (n,)."""

    label: str
    marks: Array
    values: Array
    colour: str = "black"
    dashes: Dashes = DASHES[1]


@dataclass(frozen=True)
class TracePanel:
    """One series.

    Attributes
    ----------
    names
        Names of the traces to draw, of which each run's first is drawn.
    label
        Of its axis, with the unit.
    smallest
        Extent that the axis has at least: what is smaller is rounding.
    logarithmic
        Whether its axis is; values that are not positive are left out.
    """

    names: tuple[str, ...]
    label: str
    title: str = ""
    known: tuple[KnownPoints, ...] = ()
    forms: tuple[ClosedForm, ...] = ()
    smallest: float = 0.0
    logarithmic: bool = False


def trace_figure(
    panels: Sequence[TracePanel],
    runs: Sequence[TracedRun],
    along: str | Sequence[str],
    inks: Mapping[str, Ink],
    most_in_a_row: int = MOST_IN_A_ROW,
) -> Figure:
    """Draw each panel's traces.

    Parameters
    ----------
    along
        Label of the horizontal axis with its unit; one for each panel, or the same for all.
    inks
        By name of run.
    """
    columns = min(len(panels), most_in_a_row)
    rows = -(-len(panels) // columns)
    width, height = ALONE if len(panels) == 1 else (WIDTH * columns, HEIGHT * rows)
    size = (max(3.4, width), height + MARGIN)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    crosses = _crosses(panels)
    entries: dict[str, Any] = {}
    for place, axes in enumerate(grid.flat):
        if place >= len(panels):
            axes.set_axis_off()
            continue
        panel = panels[place]
        _draw(axes, panel, runs, inks, crosses, entries)
        last = place + columns >= len(panels)
        words = along if isinstance(along, str) else along[place]
        axes.set_xlabel(words if last or not isinstance(along, str) else "")
        axes.set_ylabel(panel.label)
        title = textwrap.fill(panel.title[:1].upper() + panel.title[1:], TITLE, break_on_hyphens=False)
        axes.set_title(plain(title), loc="left", fontsize=7.5)
    if entries:
        labels = [label.replace("$", r"\$") for label in entries]
        beside = legend_columns(list(entries), size[0])
        figure.legend(entries.values(), labels, loc="outside lower center", ncols=beside)
        figure.set_size_inches(size[0], size[1] + LINE * (-(-len(entries) // beside) - 1))
    return figure


def _draw(
    axes: Axes,
    panel: TracePanel,
    runs: Sequence[TracedRun],
    inks: Mapping[str, Ink],
    crosses: Mapping[str, str],
    entries: dict[str, Any],
) -> None:
    for form in panel.forms:
        (line,) = axes.plot(form.marks, form.values, color=form.colour, linestyle=form.dashes, linewidth=0.9, zorder=3)
        entries.setdefault(form.label, line)
    names = list(dict.fromkeys(run.name for run in runs))
    for run in runs:
        above = len(names) - 1 - names.index(run.name)
        width = min(THINNEST + STEP * above, THICKEST)
        _draw_run(axes, panel, run, inks[run.name], width, entries)
    for points in panel.known:
        entries.setdefault(points.label, _draw_known(axes, points, crosses))
    if panel.logarithmic:
        axes.set_yscale("log")
        return
    low, high = axes.get_ylim()
    if high - low < panel.smallest:
        middle = (high + low) / 2
        axes.set_ylim(middle - panel.smallest / 2, middle + panel.smallest / 2)
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
    axes.yaxis.get_offset_text().set_fontsize(6.5)


def _draw_run(axes: Axes, panel: TracePanel, run: TracedRun, ink: Ink, width: float, entries: dict[str, Any]) -> None:
    trace = next((run.traces[name] for name in panel.names if name in run.traces), None)
    if trace is None:
        return
    shown = trace.values > 0 if panel.logarithmic else np.full(len(trace.values), True)
    marks, values = trace.marks[shown], trace.values[shown]
    few = len(marks) <= DENSE
    (line,) = axes.plot(
        marks,
        values,
        color=ink.colour,
        linestyle=ink.dashes,
        marker=ink.marker if few else "",
        markersize=3.2,
        markeredgecolor="white",
        markeredgewidth=0.3,
        linewidth=width,
        zorder=2,
    )
    entries.setdefault(run.name, line)
    if run.reason is not None and len(marks):
        (end,) = axes.plot(
            marks[-1:], values[-1:], linestyle="none", marker="X", markersize=7, color=ink.colour, zorder=4
        )
        entries.setdefault(f"{run.name}: end of what a failed run left", end)
    for name in panel.names:
        if name in run.critical and name in run.traces:
            (mark,) = axes.plot(
                *run.critical[name],
                linestyle="none",
                marker="D",
                markersize=5.5,
                markerfacecolor="none",
                markeredgecolor=ink.colour,
                markeredgewidth=1.1,
                zorder=4,
            )
            entries.setdefault(f"{run.name}: critical state", mark)


def _draw_known(axes: Axes, points: KnownPoints, crosses: Mapping[str, str]) -> Any:
    look: dict[str, Any] = {"marker": crosses.get(points.label, "x"), "markersize": 5.0, "color": ELSEWHERE}
    if points.judges:
        marker, size = ("s", 8.5) if points.critical else ("o", 6.5)
        look = {"marker": marker, "markersize": size, "markerfacecolor": "none", "color": "black"}
    known = np.isfinite(points.uncertainties)
    doubts = np.where(known, points.uncertainties, 0.0)
    return axes.errorbar(
        points.marks,
        points.values,
        yerr=doubts if known.any() else None,
        linestyle="none",
        markeredgewidth=0.9,
        elinewidth=0.9,
        capsize=2.0,
        zorder=3,
        **look,
    )


def _crosses(panels: Sequence[TracePanel]) -> dict[str, str]:
    labels = dict.fromkeys(points.label for panel in panels for points in panel.known if not points.judges)
    return {label: CROSSES[i % len(CROSSES)] for i, label in enumerate(labels)}
