"""Error and energy gap against points a side, a column for each case, all seeds and failed runs among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatterMathtext, LogLocator, NullLocator

from shellbench.report.convergence import ERROR_LABEL
from shellbench.report.palette import Ink
from shellbench.report.shells import plain

WIDTH, HEIGHT, MARGIN = 3.2, 1.9, 0.7  # inches of a panel, and of the legend
GAP_LABEL = "energy gap (%)"
SMALLEST = 1e-12  # relative figure that is drawn for none
GREY = "#BBBBBB"


class Sampled(Protocol):
    """What is drawn; see `shellbench.report.sampling_study.Sampled`."""

    @property
    def title(self) -> str:
        """Of the case."""
        ...

    @property
    def solver(self) -> str:
        """Name of the solver."""
        ...

    @property
    def a_side(self) -> float:
        """Points a side."""
        ...

    @property
    def marks(self) -> tuple[tuple[float | None, float | None, bool], ...]:
        """Of each run the error, the gap, and whether it ended well."""
        ...

    @property
    def floor(self) -> float:
        """Relative uncertainty of the known value."""
        ...


def sampling_figure(cases: Sequence[Sequence[Sampled]], inks: Mapping[str, Ink]) -> Figure:
    """Draw error above and gap below, a column for each case."""
    figure = Figure(figsize=(max(4.2, WIDTH * len(cases)), 2 * HEIGHT + MARGIN), layout="constrained")
    panels = figure.subplots(2, len(cases), sharey="row", sharex=True, squeeze=False)
    for column, of_case in enumerate(cases):
        above, below = panels[0, column], panels[1, column]
        for axes, which in ((above, 0), (below, 1)):
            axes.set_yscale("log")
            for solver in dict.fromkeys(one.solver for one in of_case):
                _draw(axes, [one for one in of_case if one.solver == solver], which, inks[solver])
            axes.yaxis.set_major_locator(LogLocator(numticks=7))
            axes.yaxis.set_major_formatter(LogFormatterMathtext())
            axes.yaxis.set_minor_locator(NullLocator())
        above.set_title(plain(of_case[0].title), loc="left")
        below.set_xlabel("points a side")
        below.set_xticks(sorted({round(one.a_side) for of_any in cases for one in of_any}))
        floor = 100 * max(one.floor for one in of_case)
        if floor > above.get_ylim()[0]:
            above.axhspan(above.get_ylim()[0], floor, color=GREY, alpha=0.35, linewidth=0, zorder=0)
    panels[0, 0].set_ylabel(ERROR_LABEL)
    panels[1, 0].set_ylabel(GAP_LABEL)
    shown = [one for of_case in cases for one in of_case]
    entries = {
        plain(one.solver): Line2D([], [], color=inks[one.solver].colour, marker=inks[one.solver].marker)
        for one in shown
    }
    if any(not sound for one in shown for _, _, sound in one.marks):
        entries["failed run"] = Line2D([], [], color="#666666", marker="o", markerfacecolor="white", linestyle="none")
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=len(entries))
    return figure


def _draw(axes: Axes, sampled: Sequence[Sampled], which: int, ink: Ink) -> None:
    middle: list[tuple[float, float]] = []
    for one in sampled:
        shown = [
            (100 * max(SMALLEST, abs(value)), sound)
            for *measured, sound in one.marks
            if (value := measured[which]) is not None
        ]
        if shown:
            middle.append((one.a_side, float(np.median([height for height, _ in shown]))))
        for height, sound in shown:
            axes.plot(
                [one.a_side],
                [height],
                color=ink.colour,
                marker=ink.marker,
                linestyle="none",
                markerfacecolor=ink.colour if sound else "white",
                markeredgecolor="white" if sound else ink.colour,
                markeredgewidth=0.4 if sound else 0.9,
                zorder=3,
            )
    if middle:
        axes.plot(*zip(*middle, strict=True), color=ink.colour, linewidth=1.0, alpha=0.8)
