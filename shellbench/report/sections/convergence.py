"""Convergence: how the error of a solve fell while it refined or iterated, and at what cost; from stored histories."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import portrait_of
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Dashes, Exhibit, Ink
from shellbench.report.data.notation import plain
from shellbench.report.data.rates import FEWEST, SURFACE_DIMENSION, Abscissa, Course, courses, fitted_rate
from shellbench.report.data.runs import grouped, rows_at_home, suite_title
from shellbench.report.figures import panel

AXIS_LABELS: dict[Abscissa, str] = {"unknowns": "unknowns", "seconds": "wall time (s)", "iteration": "iteration"}
GAP_LABEL = "quadrature gap (%)"
WIDTH, HEIGHT, MARGIN = 2.0, 1.9, 0.75  # inches a panel: four of them fill a page's width; and for the legend
MOST_IN_A_ROW = 4  # panels; more cases go on below
AXES: tuple[Abscissa, ...] = ("unknowns", "seconds", "iteration")
CONVERGENCE = "convergence_"  # how names of figures begin
CROWDED = 30  # points from which on a curve has no marks
Strip = tuple[Abscissa, str, Callable[[Course], tuple[list[float], list[float]]]]


def convergence_exhibits(evidence: Evidence) -> Iterator[Exhibit]:
    """Yield the figures of each suite's convergence."""
    for suite, of_suite in rows_at_home(evidence.headline).items():
        of_unknowns = [row for row in of_suite if not steps_in_time(evidence, row)]
        shown = [course for course in courses(evidence.records, of_unknowns) if not course.variant]
        refining = [course for course in shown if not course.is_field]
        refinement = refinement_figure(shown, evidence.inks)
        if refinement is not None:
            yield Exhibit(
                name=f"{CONVERGENCE}{suite}_refinement",
                title=f"{suite_title(suite)}: convergence under refinement",
                caption="Relative error of each case's headline figure against unknowns and wall time. Dashed: power"
                " laws fitted to the finest steps whose error lies above the uncertainty of the known value; against"
                f" the unknowns the exponent is the order in the mesh width h. {panel.FLOOR_WORDS}",
                description=f"Errors fall with refinement. {_rates(refining)}",
                figure=refinement,
                run_ids=tuple(course.run_id for course in refining),
            )
        for abscissa in AXES:
            figure = iteration_figure(shown, evidence.inks, abscissa)
            if figure is None:
                continue
            solvers = ", ".join(dict.fromkeys(course.solver for course in shown))
            against = AXIS_LABELS[abscissa].removesuffix(" (s)")
            yield Exhibit(
                name=f"{CONVERGENCE}{suite}_{abscissa}",
                title=f"{suite_title(suite)}: error and quadrature gap against {against}",
                caption="Relative error of each case's headline figure, and the gap between the energy on the"
                " solve's own quadrature and on a finer one. The gap tells a field that exploits its quadrature; it"
                f" does not bound the error. A line or a mark for each seed. {panel.FLOOR_WORDS}",
                description=f"Error and gap of {solvers} against {against}, case by case",
                figure=figure,
                run_ids=tuple(course.run_id for course in shown),
            )


def steps_in_time(evidence: Evidence, row: Row) -> bool:
    """Return True if the run is refined by steps in time; other sections show these errors."""
    record = evidence.records.get(row.run_id or "")
    case = portrait_of(record) if record is not None else None
    return case is not None and case.steps_in_time


def _rates(refining: Sequence[Course]) -> str:
    words = []
    for course in refining:
        rate = fitted_rate(*course.errors("unknowns"), course.floor)
        if rate is not None:
            words.append(f"{course.title}, {course.solver}: order {-2 * rate.slope:.1f} in h")
    return "Fitted: " + "; ".join(dict.fromkeys(words)) + "." if words else ""


def refinement_figure(courses: Sequence[Course], inks: Mapping[str, Ink]) -> Figure | None:
    """Draw the error of refining solvers against unknowns and seconds, with fitted slopes beside the curves.

    The order in the mesh width h is twice the slope against the unknowns. Fields are drawn elsewhere, for they
    have no h. Returns None if no solver refines.
    """
    courses = [course for course in courses if not course.is_field]
    if not any(course.refines for course in courses):
        return None
    strips: list[Strip] = [
        ("unknowns", panel.ERROR_LABEL, lambda course: course.errors("unknowns")),
        ("seconds", panel.ERROR_LABEL, lambda course: course.errors("seconds")),
    ]
    return _figure(courses, inks, strips, slopes=True)


def iteration_figure(courses: Sequence[Course], inks: Mapping[str, Ink], abscissa: Abscissa) -> Figure | None:
    """Draw error and quadrature gap of fields against unknowns, seconds or iterations; None if there are none.

    Every seed is drawn. Against the unknowns each run is its last step, unless it grew on the way. Solvers that
    refine stand beside the fields where the abscissa means the same for both.
    """
    measured = [course for course in courses if course.errors(abscissa)[0]]
    fields = [course for course in measured if course.is_field and not (abscissa == "iteration" and course.refines)]
    if abscissa == "iteration":
        fields = [course for course in fields if len(course.errors(abscissa)[0]) >= FEWEST]
    if not fields:
        return None
    if abscissa != "iteration":
        cases = {course.case for course in fields}
        fields = [course for course in measured if course.is_field or course.case in cases]
    strips: list[Strip] = [(abscissa, panel.ERROR_LABEL, lambda course: course.errors(abscissa))]
    if any(course.gaps(abscissa)[0] for course in fields):
        strips.append((abscissa, GAP_LABEL, lambda course: course.gaps(abscissa)))
    return _figure(fields, inks, strips)


def _figure(
    courses: Sequence[Course], inks: Mapping[str, Ink], strips: Sequence[Strip], *, slopes: bool = False
) -> Figure:
    """Draw a column of panels for each case, one for each strip; after `MOST_IN_A_ROW` of them a new band begins.

    Each panel has an ordinate of its own, for errors of two cases may be ten decades apart.
    """
    cases = grouped(courses, lambda course: course.case)
    columns, bands = min(len(cases), MOST_IN_A_ROW), -(-len(cases) // MOST_IN_A_ROW)
    size = max(3.4, WIDTH * columns), HEIGHT * len(strips) * bands + MARGIN
    figure, panels = panel.open_figure(size, len(strips) * bands, columns)
    shaded = False
    for band in range(bands):
        shown = list(cases.values())[band * columns : (band + 1) * columns]
        for i, (abscissa, label, measure) in enumerate(strips):
            row = panels[band * len(strips) + i]
            for axes in row[len(shown) :]:
                axes.remove()
            row = row[: len(shown)]
            for column, (axes, of_case) in enumerate(zip(row, shown, strict=True)):
                if i and not slopes:
                    axes.sharex(panels[band * len(strips), column])
                for course in of_case:
                    least = course.floor / panel.BELOW_FLOOR if label == panel.ERROR_LABEL else 0.0
                    _draw(axes, course, *measure(course), abscissa, inks[course.solver], least)
            for axes, of_case in zip(row, shown, strict=True):
                floor = 100 * max(course.floor for course in of_case) * (label == panel.ERROR_LABEL)
                panel.finish(
                    [axes],
                    AXIS_LABELS[abscissa],
                    label if axes is row[0] else "",
                    floor=floor,
                    log="y" if abscissa == "iteration" else "xy",
                    below=panel.FOR_SLOPES if slopes else panel.ROOM,
                )
                shaded |= floor > axes.get_ylim()[0] > 0
            for axes, of_case in zip(row, shown, strict=True):
                if i == 0:
                    axes.set_title(plain(of_case[0].title).replace(", ", ",\n", 1), loc="left")
                if abscissa == "iteration":
                    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
                if slopes:
                    _draw_orders(axes, of_case, abscissa, inks)
    entries = {
        f"{course.solver}, {course.variant}" if course.variant else course.solver: panel.entry(
            inks[course.solver], linestyle=_dashes(course)
        )
        for course in courses
    }
    panel.add_legend(figure, entries | panel.shade_entry(shaded), 5)
    return figure


def _draw(
    axes: Axes, course: Course, x: list[float], values: list[float], abscissa: Abscissa, ink: Ink, least: float
) -> None:
    """Draw a course; relative values below `least` at its height."""
    last_only = abscissa == "unknowns" and not course.refines
    points = [(a, 100 * max(v, least)) for a, v in zip(x, values, strict=True) if a > 0 and max(v, least) > 0]
    points = points[-1 if last_only else 0 :]
    if points:
        look: dict[str, Any] = {"marker": None} if len(points) > CROWDED else {}
        panel.draw(axes, [a for a, _ in points], [v for _, v in points], ink, _dashes(course), alpha=0.85, **look)


def _draw_orders(axes: Axes, courses: Sequence[Course], abscissa: Abscissa, inks: Mapping[str, Ink]) -> None:
    """Draw fitted slopes, with their orders in h or, against seconds, their exponents."""
    fits = []
    for course in courses:
        rate = fitted_rate(*course.errors(abscissa), course.floor)
        if rate is not None:
            order = f"h^{{{-SURFACE_DIMENSION * rate.slope:.1f}}}"
            words = f"${order}$" if abscissa == "unknowns" else rf"$t^{{\,{rate.slope:.1f}}}$"
            fits.append((rate, words, inks[course.solver].colour))
    panel.draw_slopes(axes, fits)


def _dashes(course: Course) -> Dashes:
    """Return the dashes that a variant is drawn with: the solver's own settings have full lines."""
    return DASHES[0 if not course.variant else 1 + sum(course.variant.encode()) % (len(DASHES) - 1)]
