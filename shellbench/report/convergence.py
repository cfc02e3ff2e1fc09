"""Convergence plots: how the error of a solve fell while it refined or iterated, and what that cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatterMathtext, LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

from shellbench.report.courses import SURFACE_DIMENSION, Abscissa, Course
from shellbench.report.palette import DASHES, Ink
from shellbench.report.rates import Rate, fitted_rate

AXIS_LABELS: dict[Abscissa, str] = {
    "unknowns": "unknowns",
    "seconds": "wall time (s)",
    "iteration": "iteration",
}
ERROR_LABEL = "relative error (%)"
GAP_LABEL = "quadrature gap (%)"
WIDTH, HEIGHT = 2.0, 1.9  # inches a panel: four of them fill a page's width
MARGIN = 0.75  # inches for the legend
MOST_IN_A_ROW = 4  # panels; more cases go on below
NARROW = 5.0  # ratio of an axis' ends below which its labels are plain steps


def refinement_figure(courses: Sequence[Course], inks: Mapping[str, Ink]) -> Figure | None:
    """Draw the error of refining solvers against unknowns and seconds, with fitted slopes beside the curves.

    The order in the mesh width h is twice the slope against the unknowns. Fields are drawn elsewhere, for they
    have no h. Returns None if no solver refines.
    """
    courses = [course for course in courses if not course.is_field]
    if not any(course.refines for course in courses):
        return None
    rows: tuple[Abscissa, Abscissa] = ("unknowns", "seconds")
    figure, panels = _panels(courses, len(rows), share_abscissa=False)
    for row, abscissa in enumerate(rows):
        for place, of_case in enumerate(_by_case(courses).values()):
            band, column = divmod(place, MOST_IN_A_ROW)
            axes = panels[len(rows) * band + row][column]
            for course in of_case:
                x, errors = course.errors(abscissa)
                _draw(axes, x, errors, course, inks)
                rate = fitted_rate(x, errors, course.floor)
                if rate is not None:
                    draw_rate(axes, rate, order=-SURFACE_DIMENSION * rate.slope if abscissa == "unknowns" else None)
            _draw_floor(axes, of_case)
            _label(axes, abscissa, ERROR_LABEL, of_case[0].title if row == 0 else "", first=column == 0)
    _finish(figure, panels, courses, inks)
    return figure


def iteration_figure(courses: Sequence[Course], inks: Mapping[str, Ink], abscissa: Abscissa) -> Figure | None:
    """Draw error and quadrature gap of fields against unknowns, seconds or iterations; None if there are none.

    Every seed is drawn. Against the unknowns each run is its last step, unless it grew on the way. Solvers that
    refine stand beside the fields where the abscissa means the same for both.
    """
    measured = [course for course in courses if course.errors(abscissa)[0]]
    fields = [course for course in measured if course.is_field and not (abscissa == "iteration" and course.refines)]
    if not fields:
        return None
    if abscissa != "iteration":
        fields = [course for course in measured if course.is_field or course.case in _by_case(fields)]
    measures: list[tuple[str, Callable[[Course], tuple[list[float], list[float]]]]] = [
        (ERROR_LABEL, lambda course: course.errors(abscissa))
    ]
    if any(course.gaps(abscissa)[0] for course in fields):
        measures.append((GAP_LABEL, lambda course: course.gaps(abscissa)))
    figure, panels = _panels(fields, len(measures), share_abscissa=True)
    for row, (label, measure) in enumerate(measures):
        for place, of_case in enumerate(_by_case(fields).values()):
            band, column = divmod(place, MOST_IN_A_ROW)
            axes = panels[len(measures) * band + row][column]
            for course in of_case:
                x, values = measure(course)
                last_only = abscissa == "unknowns" and not course.refines
                _draw(axes, x[-1:] if last_only else x, values[-1:] if last_only else values, course, inks)
            if label == ERROR_LABEL:
                _draw_floor(axes, of_case)
            _label(axes, abscissa, label, of_case[0].title if row == 0 else "", first=column == 0)
    _finish(figure, panels, fields, inks)
    return figure


def draw_rate(axes: Axes, rate: Rate, order: float | None) -> None:
    """Draw a fitted slope beside its curve, with its order in h or, against seconds, its exponent."""
    shift = 2.2
    ends = (rate.first, rate.last)
    axes.plot(ends, [100 * rate(x) / shift for x in ends], color="#666666", linewidth=0.8, linestyle=DASHES[1])
    middle = math.sqrt(rate.first * rate.last)
    text = rf"$h^{{{order:.1f}}}$" if order is not None else rf"$t^{{\,{rate.slope:.1f}}}$"
    axes.annotate(
        text.replace("-", "\N{MINUS SIGN}"),
        (middle, 100 * rate(middle) / shift),
        xytext=(-3, -3),
        textcoords="offset points",
        ha="right",
        va="top",
        color="#444444",
        fontsize=7.5,
    )


def _draw(axes: Axes, x: Sequence[float], values: Sequence[float], course: Course, inks: Mapping[str, Ink]) -> None:
    points = [(a, 100 * v) for a, v in zip(x, values, strict=True) if a > 0 and v > 0]
    if not points:
        return
    ink = inks[course.solver]
    crowded = len(points) > 30
    axes.plot(
        *zip(*points, strict=True),
        color=ink.colour,
        marker=None if crowded else ink.marker,
        linestyle=_dashes(course),
        alpha=0.85,
        markeredgecolor="white",
        markeredgewidth=0.4,
    )


def _dashes(course: Course) -> Any:
    """Return the dashes that a variant is drawn with: the solver's own settings have full lines."""
    return DASHES[0 if not course.variant else 1 + sum(course.variant.encode()) % (len(DASHES) - 1)]


def _draw_floor(axes: Axes, courses: Sequence[Course]) -> None:
    floor = 100 * max(course.floor for course in courses)
    if floor > 0:
        bottom = axes.get_ylim()[0]
        axes.axhspan(min(bottom, floor) / 1e3, floor, color="#BBBBBB", alpha=0.35, linewidth=0, zorder=0)


def _by_case(courses: Sequence[Course]) -> dict[str, list[Course]]:
    cases: dict[str, list[Course]] = {}
    for course in courses:
        cases.setdefault(course.case, []).append(course)
    return cases


def _panels(courses: Sequence[Course], rows: int, *, share_abscissa: bool) -> tuple[Figure, list[list[Axes]]]:
    """Return axes row by row: `rows` of them for each band of `MOST_IN_A_ROW` cases."""
    cases = len(_by_case(courses))
    columns, bands = min(cases, MOST_IN_A_ROW), -(-cases // MOST_IN_A_ROW)
    size = (max(3.4, WIDTH * columns), HEIGHT * rows * bands + MARGIN)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.add_gridspec(rows * bands, columns)
    panels: list[list[Axes]] = []
    for row in range(rows * bands):
        panels.append([])
        for column in range(min(columns, cases - columns * (row // rows))):
            above = panels[row - row % rows][column] if share_abscissa and row % rows else None
            axes = figure.add_subplot(grid[row, column], sharex=above, sharey=panels[row][0] if column else None)
            axes.tick_params(labelleft=column == 0, labelbottom=not share_abscissa or row % rows == rows - 1)
            panels[row].append(axes)
    return figure, panels


def _label(axes: Axes, abscissa: Abscissa, ordinate: str, title: str, *, first: bool) -> None:
    axes.set_xscale("linear" if abscissa == "iteration" else "log")
    axes.set_yscale("log")
    axes.set_xlabel(AXIS_LABELS[abscissa])
    axes.set_ylabel(ordinate if first else "")
    if abscissa == "iteration":
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    if title:
        axes.set_title(title.replace("$", r"\$").replace(", ", ",\n", 1), loc="left")


def _tick(axis: Axis) -> None:
    """Label decades, or 1, 2 and 5 where fewer than two decades are in view, or few plain steps."""
    low, high = sorted(axis.get_view_interval())
    if high / low < NARROW:
        axis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    elif high / low < 100:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 20 else (1.0, 3.0), numticks=12))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    else:
        axis.set_major_locator(LogLocator(numticks=6))
        axis.set_major_formatter(LogFormatterMathtext())
    axis.set_minor_locator(NullLocator())


def _finish(
    figure: Figure,
    panels: Sequence[Sequence[Axes]],
    courses: Sequence[Course],
    inks: Mapping[str, Ink],
) -> None:
    """Limit the axes to what was drawn, and put one legend below all panels."""
    for row in panels:
        heights = [np.asarray(line.get_ydata(), dtype=float) for axes in row for line in axes.get_lines()]
        values = [float(y) for y in np.concatenate(heights) if y > 0] if heights else []
        if values:
            row[0].set_ylim(min(values) / 3, max(values) * 3)
        for axes in row:
            axes.margins(x=0.12)
            _tick(axes.yaxis)
            if axes.get_xscale() == "log":
                _tick(axes.xaxis)
    entries: dict[str, Line2D] = {}
    for course in courses:
        ink = inks[course.solver]
        name = f"{course.solver}, {course.variant}" if course.variant else course.solver
        entries.setdefault(
            name.replace("$", r"\$"),
            Line2D([], [], color=ink.colour, marker=ink.marker, linestyle=_dashes(course)),
        )
    if any(100 * course.floor > panels[0][0].get_ylim()[0] for course in courses):
        entries["uncertainty of the known value"] = Line2D([], [], color="#BBBBBB", alpha=0.6, linewidth=6)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=min(5, len(entries)))
