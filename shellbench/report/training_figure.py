"""States of stopped trainings side by side, and what became of error and displacement over the seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, NullLocator

from shellbench.report.convergence import ERROR_LABEL
from shellbench.report.digits import duration
from shellbench.report.palette import Ink
from shellbench.report.shells import FEW_CELLS, Shell, aspect, colour_bar, draw_deformed, name_row, plain

WIDTH, WIDEST = 7.2, 1.9  # inches of a row of states, and of one state
LOWEST, HIGHEST = 0.8, 1.5  # inches a state
TITLE, BAR, CURVES = 0.3, 0.5, 2.3  # inches of the states' titles, of the colour bar, and of the curves
SMALLEST = 1e-12  # relative error that is drawn for none
FEW_DECADES = 2.5
GREY = "#BBBBBB"


class Stop(Protocol):
    """What is drawn of a stopped training; see `shellbench.report.training_time.Stop`."""

    @property
    def solver(self) -> str:
        """Name of the solver."""
        ...

    @property
    def iterations(self) -> int:
        """After which it was stopped."""
        ...

    @property
    def seconds(self) -> float:
        """Of training."""
        ...

    @property
    def unit(self) -> str:
        """Of displacements."""
        ...

    @property
    def error(self) -> float | None:
        """Relative."""
        ...

    @property
    def floor(self) -> float:
        """Relative uncertainty of the known value."""
        ...

    @property
    def mean_displacement(self) -> float | None:
        """Over a grid."""
        ...

    @property
    def sound(self) -> bool:
        """Whether the run ended well."""
        ...

    @property
    def shell(self) -> Shell | None:
        """The state."""
        ...

    @property
    def course(self) -> tuple[tuple[float, float], ...]:
        """Seconds and errors on the way."""
        ...


def training_figure(stops: Sequence[Stop], inks: Mapping[str, Ink]) -> Figure:
    """Draw a row of states for each solver, and error and mean displacement of all of them below."""
    solvers: dict[str, list[Stop]] = {}
    for stop in stops:
        solvers.setdefault(stop.solver, []).append(stop)
    shells = [stop.shell for stop in stops if stop.shell is not None]
    columns = max(map(len, solvers.values()))
    width = min(WIDEST, WIDTH / columns)
    low = float(np.clip(width * aspect(shells), LOWEST, HIGHEST)) + TITLE if shells else 0.1
    upper = low * len(solvers) + BAR
    figure = Figure(figsize=(WIDTH, upper + CURVES), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(upper, CURVES)).flat
    panels = above.subplots(len(solvers), columns, squeeze=False)
    for row, (solver, of_solver) in zip(panels, solvers.items(), strict=True):
        for axes in row:
            axes.set_axis_off()
        for axes, stop in zip(row, of_solver, strict=False):
            _draw_state(axes, stop, shells)
        name_row(row[0], solver, inks[solver].colour)
    if shells:
        colour_bar(above, list(panels.flat), *shells, shrink=0.5, aspect=34)
    left, right = below.subplots(1, 2)
    for solver, of_solver in solvers.items():
        _draw_errors(left, of_solver, inks[solver])
        _draw_means(right, of_solver, inks[solver], plain(solver))
    _finish(left, right, stops)
    below.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=len(solvers))
    return figure


def _draw_state(axes: Axes, stop: Stop, shells: Sequence[Shell]) -> None:
    words = f"{stop.iterations} iteration{'' if stop.iterations == 1 else 's'}\n{duration(stop.seconds)} s"
    axes.set_title(words + ("" if stop.sound else ", failed"), fontsize=7.5, pad=2)
    if stop.shell is not None:
        draw_deformed(axes, stop.shell, shells, cells=FEW_CELLS)


def _draw_errors(axes: Axes, stops: Sequence[Stop], ink: Ink) -> None:
    longest = max(stops, key=lambda stop: stop.iterations)
    thin = [(seconds, 100 * max(SMALLEST, error)) for seconds, error in longest.course]
    if thin:
        axes.plot(*zip(*thin, strict=True), color=ink.colour, linewidth=0.6, alpha=0.6)
    for stop in stops:
        if stop.error is not None:
            _mark(axes, stop, 100 * max(SMALLEST, abs(stop.error)), ink)


def _draw_means(axes: Axes, stops: Sequence[Stop], ink: Ink, label: str) -> None:
    axes.plot([], [], color=ink.colour, marker=ink.marker, label=label)
    shown = [(stop, stop.mean_displacement) for stop in stops if stop.mean_displacement is not None]
    if shown:
        axes.plot([stop.seconds for stop, _ in shown], [mean for _, mean in shown], color=ink.colour, linewidth=0.8)
    for stop, mean in shown:
        _mark(axes, stop, mean, ink)


def _mark(axes: Axes, stop: Stop, height: float, ink: Ink) -> None:
    axes.plot(
        [stop.seconds],
        [height],
        color=ink.colour,
        marker=ink.marker,
        linestyle="none",
        markersize=4.5,
        markerfacecolor=ink.colour if stop.sound else "white",
        markeredgecolor="white" if stop.sound else ink.colour,
        markeredgewidth=0.4 if stop.sound else 0.9,
    )


def _finish(left: Axes, right: Axes, stops: Sequence[Stop]) -> None:
    seconds = [stop.seconds for stop in stops if stop.seconds > 0]
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("training time (s)")
        if seconds:
            axes.set_xlim(min(seconds) / 1.5, max(seconds) * 1.5)
        decades = float(np.log10(np.divide(*axes.get_xlim()[::-1])))
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)) if decades < FEW_DECADES else LogLocator(numticks=7))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
    left.set_yscale("log")
    left.yaxis.set_major_locator(LogLocator(numticks=7))
    left.yaxis.set_major_formatter(LogFormatterMathtext())
    left.yaxis.set_minor_locator(NullLocator())
    left.set_ylabel(ERROR_LABEL)
    floor, low = 100 * max(stop.floor for stop in stops), left.get_ylim()[0]
    if floor > low:
        left.axhspan(low, floor, color=GREY, alpha=0.35, linewidth=0, zorder=0)
    right.set_ylim(bottom=0.0)
    right.set_ylabel(f"mean displacement ({stops[0].unit or 'm'})")
