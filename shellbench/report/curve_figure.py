"""Load-displacement curves: what each solver computed on its way from rest, and what is known."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from shellbench.portrait import LoadAxis, PathSeries
from shellbench.report.palette import Ink
from shellbench.report.paths import KnownPath, PathRun, readable

WIDTH, HEIGHT = 2.45, 2.5  # inches a panel
MARGIN = 0.6  # inches for the legend
MOST_IN_A_ROW = 3  # panels
CROWDED = 40  # states of a path, above which their markers shrink
DENSE = 12  # tabulated points, above which their crosses shrink
CROSSES = ("x", "+", "1", "2", "3", "4")  # of figures from elsewhere, one for each source
ELSEWHERE = "#555555"
TITLE = 34  # characters a line
LETTER, HANDLE = 0.066, 0.6  # inches of a legend's mean letter, and of what stands before its words


@dataclass(frozen=True)
class CurvePanel:
    """One displacement against the load."""

    series: PathSeries
    known: tuple[KnownPath, ...] = ()


def curve_figure(
    panels: Sequence[CurvePanel],
    runs: Sequence[PathRun],
    load: LoadAxis,
    inks: Mapping[str, Ink],
    *,
    turning: bool,
    limit_loads: Sequence[float] = (),
) -> Figure:
    """Draw the load against each displacement: computed states, known values, figures from elsewhere.

    Parameters
    ----------
    runs
        Paths; those of a failed run end in a cross.
    inks
        By name of run.
    turning
        Whether limit points of the computed paths are marked.
    limit_loads
        Load factors of known limit points whose displacement is not known.
    """
    columns = min(len(panels), MOST_IN_A_ROW)
    rows = -(-len(panels) // columns)
    size = (max(3.6, WIDTH * columns), HEIGHT * rows + MARGIN)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    crosses = _crosses(panels)
    entries: dict[str, Line2D] = {}
    for place, axes in enumerate(grid.flat):
        if place >= len(panels):
            axes.set_axis_off()
            continue
        panel = panels[place]
        for run in runs:
            _draw_run(axes, run, panel.series, load, inks[run.name], turning=turning, entries=entries)
        for factor in limit_loads:
            entries["known limit load"] = axes.axhline(
                load.scale * factor, color="black", linewidth=0.7, linestyle=(0, (1, 1.5)), zorder=1
            )
        for known in panel.known:
            entries[known.label] = _draw_known(axes, known, load, crosses)
        unit = f" ({panel.series.unit})" if panel.series.unit else ""
        axes.set_xlabel(f"{readable(panel.series.name)}{unit}")
        axes.set_ylabel(load.label if place % columns == 0 else "")
        words = panel.series.description
        title = textwrap.fill(words[:1].upper() + words[1:], TITLE, break_on_hyphens=False)
        axes.set_title(title, loc="left", fontsize=7.5)
        axes.axhline(0, color="#999999", linewidth=0.5, zorder=0)
    columns = legend_columns(list(entries), size[0])
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)
    return figure


def legend_columns(labels: Sequence[str], width: float) -> int:
    """Return how many columns of a legend fit into so many inches; each is as wide as its longest label."""
    for columns in range(min(3, len(labels)), 1, -1):
        widest = [max(map(len, column)) for column in np.array_split(labels, columns)]
        if sum(HANDLE + LETTER * letters for letters in widest) <= width:
            return columns
    return 1


def _draw_run(
    axes: Axes,
    run: PathRun,
    series: PathSeries,
    load: LoadAxis,
    ink: Ink,
    *,
    turning: bool,
    entries: dict[str, Line2D],
) -> None:
    if series.name not in run.displacements:
        return
    displacements, loads = run.displacements[series.name], load.scale * run.factors
    (line,) = axes.plot(
        displacements,
        loads,
        color=ink.colour,
        linestyle=ink.dashes,
        marker=ink.marker,
        markersize=3.4 if len(loads) <= CROWDED else 1.8,
        markeredgecolor="white",
        markeredgewidth=0.3,
        linewidth=1.0,
        alpha=0.9,
        zorder=2,
    )
    entries.setdefault(run.name.replace("$", r"\$"), line)
    if run.reason is not None:
        (end,) = axes.plot(
            displacements[-1:], loads[-1:], linestyle="none", marker="X", markersize=8, color=ink.colour, zorder=4
        )
        entries.setdefault(f"{run.name}: end of what a failed run left".replace("$", r"\$"), end)
    if turning and (found := run.limit_points(series.name)):
        (mark,) = axes.plot(
            [displacement for _, displacement in found],
            [load.scale * factor for factor, _ in found],
            linestyle="none",
            marker="D",
            markersize=5.5,
            markerfacecolor="none",
            markeredgecolor=ink.colour,
            markeredgewidth=1.1,
            zorder=4,
        )
        entries.setdefault(f"{run.name}: limit points".replace("$", r"\$"), mark)


def _draw_known(axes: Axes, known: KnownPath, load: LoadAxis, crosses: Mapping[str, str]) -> Line2D:
    if known.judges:
        look = {"marker": "o", "markersize": 7.5, "markerfacecolor": "none", "markeredgecolor": "black"}
    else:
        size = 5.5 if len(known.factors) <= DENSE else 4.0
        look = {"marker": crosses[known.label], "markersize": size, "markeredgecolor": ELSEWHERE}
    (line,) = axes.plot(
        known.displacements,
        load.scale * known.factors,
        linestyle="none",
        markeredgewidth=0.9,
        zorder=3,
        **look,  # type: ignore[arg-type] # a dict of one type
    )
    return line


def _crosses(panels: Sequence[CurvePanel]) -> dict[str, str]:
    labels = dict.fromkeys(known.label for panel in panels for known in panel.known if not known.judges)
    return {label: CROSSES[i % len(CROSSES)] for i, label in enumerate(labels)}
