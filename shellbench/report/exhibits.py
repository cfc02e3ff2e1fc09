"""The figures of a report, each with its caption, a description for those who can't see it, and the runs it shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from shellbench.report.convergence import AXIS_LABELS, iteration_figure, refinement_figure
from shellbench.report.evidence import Evidence
from shellbench.report.exhibit import Exhibit, style
from shellbench.report.fields import lead_shells, pictured
from shellbench.report.newton import newton_exhibits
from shellbench.report.rates import Abscissa, Course, courses, fitted_rate
from shellbench.report.runs import rows_at_home, suite_title
from shellbench.report.shells import Shell, course_figure, scale_words, shell_figure
from shellbench.report.trace_exhibits import motion_exhibits, path_exhibits

MOST_TOGETHER = 15  # shells in one composite
AXES: tuple[Abscissa, ...] = ("unknowns", "seconds", "iteration")
COMPOSITE, PICTURE, CONVERGENCE = "course_", "shell_", "convergence_"  # how names of figures begin


def exhibits(evidence: Evidence) -> list[Exhibit]:
    """Return the figures of the report that compare solvers, case by case."""
    with style():
        return [
            *_pictures(evidence),
            *path_exhibits(evidence),
            *motion_exhibits(evidence),
            *newton_exhibits(evidence),
            *_convergence(evidence),
        ]


def _pictures(evidence: Evidence) -> Iterator[Exhibit]:
    drawn: dict[str, Shell] = {}
    for suite, of_suite in rows_at_home(evidence.headline).items():
        candidates = pictured(evidence.records, [row for row in of_suite if row.default_settings])
        shells = lead_shells(candidates, evidence.folder)
        drawn |= {one.case: one for one in shells if one.case not in drawn}
        if len(shells) > 1:
            shown = shells[:MOST_TOGETHER]
            left_out = f" {len(shown)} of {len(shells)} cases." if len(shown) < len(shells) else ""
            yield Exhibit(
                name=f"{COMPOSITE}{suite}",
                title=suite_title(suite),
                caption="Above, the reference surfaces with held edges (thick) and point loads (arrows); below, the"
                " deformed shells coloured by the displacement, which is magnified by the factor given, with the"
                f" reference surface as a wire. {_solved_by(shown)}{left_out}",
                description="; ".join(f"{one.title}: {one.words}" for one in shown),
                figure=course_figure(shown),
                run_ids=tuple(one.run_id for one in shown),
                drawing=False,
            )
    for one in drawn.values():
        yield Exhibit(
            name=f"{PICTURE}{one.case}",
            title=one.title,
            caption=f"Deformed shell, {scale_words(one)}. {_solved_by([one])}",
            description=f"{one.title}: {one.words}",
            figure=shell_figure(one),
            run_ids=(one.run_id,),
            drawing=False,
        )


def _solved_by(shells: Sequence[Shell]) -> str:
    return f"Solved by {' and '.join(dict.fromkeys(shell.solver for shell in shells))}."


def _convergence(evidence: Evidence) -> Iterator[Exhibit]:
    for suite, of_suite in rows_at_home(evidence.headline).items():
        shown = [course for course in courses(evidence.records, of_suite) if not course.variant]
        refining = [course for course in shown if not course.is_field]
        refinement = refinement_figure(shown, evidence.inks)
        if refinement is not None:
            yield Exhibit(
                name=f"{CONVERGENCE}{suite}_refinement",
                title=f"{suite_title(suite)}: convergence under refinement",
                caption="Relative error of each case's headline figure against unknowns and wall time. Dashed: power"
                " laws fitted to the finest steps whose error lies above the uncertainty of the known value; against"
                " the unknowns the exponent is the order in the mesh width h.",
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
                " does not bound the error. A line or a mark for each seed.",
                description=f"Error and gap of {solvers} against {against}, case by case",
                figure=figure,
                run_ids=tuple(course.run_id for course in shown),
            )


def _rates(refining: Sequence[Course]) -> str:
    words = []
    for course in refining:
        rate = fitted_rate(*course.errors("unknowns"), course.floor)
        if rate is not None:
            words.append(f"{course.title}, {course.solver}: order {-2 * rate.slope:.1f} in h")
    return "Fitted: " + "; ".join(dict.fromkeys(words)) + "." if words else ""
