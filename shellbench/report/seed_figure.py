"""Strips of seeds: a line for each case and solver, a mark for each run, on one axis of errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogFormatterMathtext, LogLocator, NullLocator

from shellbench.report.palette import Ink
from shellbench.report.shells import plain

WIDTH, LINE, GAP, MARGIN = 6.2, 0.155, 0.1, 1.0  # inches of the figure, a line, between cases, and of axis and legend
SMALLEST = 1e-12  # relative error that is drawn for none
GREY = "#BBBBBB"


class Spread(Protocol):
    """What is drawn of a spread over seeds; see `shellbench.report.seeds.SeedSpread`."""

    @property
    def title(self) -> str:
        """Of the case."""
        ...

    @property
    def solver(self) -> str:
        """Name of the solver."""
        ...

    @property
    def errors(self) -> tuple[float, ...]:
        """Relative, one for each seed."""
        ...

    @property
    def reference(self) -> float | None:
        """The known value."""
        ...

    @property
    def floor(self) -> float:
        """Relative uncertainty of the known value."""
        ...


def seed_figure(spreads: Sequence[Spread], inks: Mapping[str, Ink]) -> Figure:
    """Draw the magnitude of each seed's error; cases in their order from the top, solvers below each other."""
    cases: dict[str, list[Spread]] = {}
    for spread in spreads:
        cases.setdefault(spread.title, []).append(spread)
    height = LINE * len(spreads) + GAP * len(cases)
    figure = Figure(figsize=(WIDTH, height + MARGIN), layout="constrained")
    axes = figure.subplots()
    shown = [100 * max(SMALLEST, abs(error)) for spread in spreads for error in spread.errors]
    left = min(shown) / 3
    y, ticks = 0.0, []
    for title, of_case in cases.items():
        top = y
        for spread in of_case:
            y += LINE
            ink = inks[spread.solver]
            errors = sorted(100 * max(SMALLEST, abs(error)) for error in spread.errors)
            heights = [y - LINE / 2] * len(errors)
            axes.plot(errors, heights, color=ink.colour, linewidth=0.8, alpha=0.6)
            axes.plot(errors, heights, color=ink.colour, marker=ink.marker, linestyle="none", markersize=4.5, zorder=3)
        floor = 100 * max(spread.floor for spread in of_case)
        if floor > left:
            axes.add_patch(Rectangle((left, top), floor - left, y - top, color=GREY, alpha=0.35, linewidth=0, zorder=0))
        dagger = "" if of_case[0].reference is not None else " †"
        ticks.append(((top + y) / 2, plain(title) + dagger))
        y += GAP
    axes.set_xscale("log")
    axes.set_xlim(left, max(shown) * 3)
    axes.set_ylim(y, -GAP)
    axes.set_yticks([place for place, _ in ticks], [words for _, words in ticks])
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_locator(LogLocator(numticks=8))
    axes.xaxis.set_major_formatter(LogFormatterMathtext())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("magnitude of the relative error (%)")
    entries = {
        plain(spread.solver): Line2D([], [], color=inks[spread.solver].colour, marker=inks[spread.solver].marker)
        for spread in spreads
    }
    if any(100 * spread.floor > left for spread in spreads):
        entries["uncertainty of the known value"] = Line2D([], [], color=GREY, alpha=0.6, linewidth=6)
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=min(4, len(entries)))
    return figure
