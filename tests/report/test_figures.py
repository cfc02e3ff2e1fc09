"""Figures: what is drawn, in which colours, with which labels and units."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_hex

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.protocol.schema import read_toml
from shellbench.report.data.exhibit import COLOURS, inks, style
from shellbench.report.data.rates import courses
from shellbench.report.figures.panel import ERROR_LABEL
from shellbench.report.figures.pictures import picture_scale, pictured, shell
from shellbench.report.figures.shells import Camera, Shell, course_figure, shell_figure, times, what_is_coloured
from shellbench.report.sections.convergence import GAP_LABEL, iteration_figure, refinement_figure
from tests.report.conftest import COURSE, TRUTH, Store


@pytest.fixture(scope="module")
def by_id(store: Store):
    return {record.run_id: record for record in store.records}


@pytest.fixture(scope="module")
def course_rows(store: Store):
    return [row for row in store.rows if row.suite == "obstacle_course"]


@pytest.fixture(scope="module")
def all_courses(by_id, course_rows):
    return courses(by_id, course_rows)


@pytest.fixture(scope="module")
def colours(all_courses):
    return inks(course.solver for course in all_courses)


def panels(figure):
    return [axes for axes in figure.axes if axes.get_lines()]


def test_a_solver_has_the_same_colour_in_every_company():
    alone, together = inks(["fem"]), inks(["fem", "ndf", "ndf-ritz", "ndf-published", "cst-hinge"])
    assert alone["fem"] == together["fem"]
    assert len({ink.colour for ink in together.values()}) == 5
    assert len({ink.marker for ink in together.values()}) == 5
    assert inks(["b", "a"]) == inks(["a", "b"])


def test_more_solvers_than_colours_still_have_one_each():
    many = inks([f"solver-{i}" for i in range(len(COLOURS))])
    assert len(many) == len(COLOURS)
    assert {ink.colour for ink in many.values()} == set(COLOURS)


def test_every_panel_says_what_it_shows_and_in_which_unit(all_courses, colours):
    with style():
        figures = [refinement_figure(all_courses, colours)] + [
            iteration_figure(all_courses, colours, abscissa) for abscissa in ("unknowns", "seconds", "iteration")
        ]
    for figure in figures:
        axes = panels(figure)
        assert len(axes) == 8
        for one in axes:
            assert one.get_xlabel() in ("unknowns", "wall time (s)", "iteration")
            assert one.get_yscale() == "log"
        assert {one.get_ylabel() for one in axes} <= {ERROR_LABEL, GAP_LABEL, ""}
        assert axes[0].get_ylabel().endswith("(%)")
        titles = " ".join(one.get_title(loc="left").replace("\n", " ") for one in axes)
        assert all(catalog.named_case(name).title.replace(", ", " ") in titles.replace(", ", " ") for name in COURSE)
        assert figure.legends


def test_refinement_is_drawn_as_recorded_in_the_solvers_colour(store, by_id, all_courses, colours):
    with style():
        figure = refinement_figure(all_courses, colours)
    first = panels(figure)[0]
    steps = next(r for r in store.records if r.case_name == COURSE[0] and r.identity.solver == "fem").history
    quantity = catalog.named_case(COURSE[0]).primary.name
    drawn = next(line for line in first.get_lines() if len(line.get_xdata()) == len(steps))
    assert list(drawn.get_xdata()) == [step.unknowns for step in steps]
    assert list(drawn.get_ydata()) == pytest.approx(
        [100 * abs(step.quantities[quantity] / TRUTH[COURSE[0]] - 1) for step in steps]
    )
    assert to_hex(drawn.get_color()).upper() == colours["fem"].colour


def test_the_fitted_order_stands_beside_the_curve(all_courses, colours):
    with style():
        figure = refinement_figure(all_courses, colours)
    words = [text.get_text() for axes in panels(figure) for text in axes.texts]
    assert words[:4] == ["$h^{4.0}$"] * 4  # the synthetic histories fall with h**4
    assert all("2.0" in text for text in words[4:])  # and their seconds grow with the unknowns


def test_errors_ten_decades_apart_stand_on_axes_of_their_own(all_courses, colours):
    """One uncertainty over all panels left the panel of the most exact case empty."""
    fem = [course for course in all_courses if course.solver == "fem"]
    exact = replace(
        fem[0],
        uncertainty=1e-12 * fem[0].reference,
        steps=tuple(
            step.model_copy(update={"quantities": {fem[0].quantity: fem[0].reference * (1 + 1e-11 / 10**i)}})
            for i, step in enumerate(fem[0].steps)
        ),
    )
    with style():
        figure = refinement_figure([exact, *fem[1:]], colours)
        figure.draw_without_rendering()
    for axes in panels(figure):
        low, high = axes.get_ylim()
        curves = [line for line in axes.get_lines() if line.get_marker() not in ("None", None, "")]
        heights = np.concatenate([line.get_ydata() for line in curves])
        assert len(heights) >= 3
        assert np.all((low < heights) & (heights < high))
    first = panels(figure)[0].get_lines()[0].get_ydata()
    assert min(first) == pytest.approx(100 * 1e-12 / 10)  # what can't be told from zero is drawn at its lower end


def test_fields_that_iterate_are_no_refinement(all_courses, colours):
    fields = [course for course in all_courses if course.solver == "ndf"]
    assert refinement_figure(fields, colours) is None
    assert iteration_figure([c for c in all_courses if c.solver == "fem"], colours, "iteration") is None


def test_every_seed_is_drawn_with_its_gap(all_courses, colours):
    fields = [course for course in all_courses if course.solver == "ndf" and course.case == COURSE[0]]
    assert {course.seed for course in fields} == {0, 1, 2}
    with style():
        above, below = panels(iteration_figure(fields, colours, "iteration"))
    assert len(above.get_lines()) == len(below.get_lines()) == 3
    gaps = [100 * step.gap for step in fields[0].steps]
    assert list(below.get_lines()[0].get_ydata()) == pytest.approx(gaps)


def test_a_failed_runs_history_is_drawn_too(all_courses):
    assert {c.seed for c in all_courses if c.case == "pinched_cylinder_free" and c.solver == "ndf"} == {0, 1, 2}


@pytest.mark.parametrize("name", COURSE)
def test_a_shell_is_drawn_as_its_case_asks(store, by_id, course_rows, name):
    record = pictured(by_id, course_rows)[name][0]
    drawn = shell(record, store.folder)
    case = catalog.named_case(name)
    assert drawn.scale == case.picture.scale
    assert drawn.deformed == pytest.approx(drawn.position + case.picture.scale * drawn.displacement)
    with style():
        figure = shell_figure(drawn)
    assert case.title in figure.axes[0].get_title(loc="left")
    bar = figure.axes[1]
    assert bar.get_xlabel().endswith("m)")
    direction = drawn.direction  # as the record has it
    said = "inward $u$" if direction == "inward" else f"u_{{{'xyz'[np.argmax(np.abs(direction))]}}}"
    assert said in bar.get_xlabel()
    assert bar.get_xlim()[1] == pytest.approx(np.abs(drawn.coloured).max(), rel=1e-6)


@pytest.mark.parametrize("theory", ["kirchhoff-love-linear", "kirchhoff-love-nonlinear"])
@pytest.mark.parametrize("share", [1e-9, 3e-5, 0.002, 0.0499, 0.06, 0.9, 3.0, 1e4])
def test_without_a_scale_of_its_own_a_picture_shows_something(theory, share):
    """The largest displacement is drawn as a tenth or a fifth of the extent, by a round factor; as it is where it shows."""
    data = read_toml(catalog.data_folder("cases") / "scordelis_lo.toml")
    del data["picture"]["scale"]
    if theory == "kirchhoff-love-nonlinear":
        data |= {"theory": theory, "loads": [{"kind": "area", "vector": [0, 0, "-t"]}]}
    case = build_case(data, "roof", "roof.toml")
    scene = ShellPortrait(case).scene
    position = np.stack([*np.meshgrid([0.0, 30.0, 50.0], [0.0, 10.0], indexing="ij"), np.zeros((3, 2))], axis=-1)
    small, large = np.zeros((3, 2, 3)), np.zeros((3, 2, 3))
    small[1, 1, 2], large[2, 0] = -0.1 * share * 50, np.array([0.6, 0.0, 0.8]) * share * 50
    scale = picture_scale(scene, position, [small, large])
    assert float(f"{scale:.0e}".partition("e")[0]) in {1, 2, 5}
    assert scale == pytest.approx(float(f"{scale:.0e}"))
    if 0.05 <= share <= 1 or (share > 1 and not case.linear):
        assert scale == 1
    else:
        assert 0.07 <= scale * share <= 0.2
    assert picture_scale(scene, position, [0 * small]) == 1


def test_supports_and_loads_are_where_the_case_has_them(store, by_id, course_rows):
    drawn = shell(pictured(by_id, course_rows)["pinched_cylinder_diaphragm"][0], store.folder)
    assert [float(np.ptp(edge[:, 1])) for edge in drawn.held] == [0.0, 0.0]  # rims, at constant y
    assert {float(edge[0, 1]) for edge in drawn.held} == {0.0, 600.0}
    (top, down), (bottom, up) = drawn.forces
    assert top == pytest.approx([0, 300, 300], abs=1e-9)
    assert bottom == pytest.approx([0, 300, -300], abs=1e-9)
    assert down @ top < 0  # inward
    assert up @ bottom < 0


def test_the_course_has_reference_and_deformed_shells(store, by_id, course_rows):
    drawn = [shell(records[0], store.folder) for records in pictured(by_id, course_rows).values()]
    with style():
        figure = course_figure(drawn)
    shown = [axes for axes in figure.axes if axes.collections and not axes.get_xlabel()]
    assert len([axes for axes in shown if axes.get_title(loc="left")]) == len(drawn) == 4


def test_the_first_default_run_is_pictured_not_the_luckiest(store, by_id, course_rows):
    chosen = pictured(by_id, list(store.rows))["square_plate"]
    ritz = next(record for record in chosen if record.identity.solver == "ndf-ritz")
    assert ritz.identity.seed == 0  # seed 1 has the smallest of the synthetic errors
    assert all(record.identity.settings != {"activation": "gelu"} for record in chosen)


def flat(**changes) -> Shell:
    grid = np.stack(
        [*np.meshgrid([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0], indexing="ij"), np.zeros((4, 4))], axis=-1
    )
    facts = {
        "case": "c", "title": "t $ t", "solver": "s", "position": grid, "displacement": 0 * grid,
        "scale": 1.0, "camera": Camera(25, -60),
    }  # fmt: skip
    return Shell(**{**facts, **changes})


def test_the_words_of_a_narrow_colour_bar_do_not_overlap():
    sunk = flat(displacement=np.linspace(0, 2.3e-5, 48).reshape(4, 4, 3))
    with style():
        figure = course_figure([sunk, sunk])
        figure.draw_without_rendering()
    bar = next(axes for axes in figure.axes if axes.get_xlabel()).xaxis
    words = [w for w in (*bar.get_ticklabels(), bar.label, bar.get_offset_text()) if w.get_text() and w.get_visible()]
    boxes = [word.get_window_extent() for word in words]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert [word.get_text().count("10^") for word in words] == [0] * (len(words) - 1) + [1]


def test_a_shell_that_does_not_move_can_be_drawn():
    with style():
        figure = shell_figure(flat())
        figure.draw_without_rendering()
    assert figure.axes


def test_colour_words():
    assert what_is_coloured(flat()) == "displacement"
    assert what_is_coloured(flat(direction=(0.0, 1.0, 0.0))) == "$u_{y}$"
    assert what_is_coloured(flat(direction=(1.0, 1.0, 0.0))) == "displacement along (1, 1, 0)"
    assert times(50.0) == "× 50"
    assert times(8e6) == "× 8×10⁶"


@pytest.mark.parametrize("content", [b"", b"no archive at all", None])
def test_lost_or_damaged_fields_draw_nothing(store, tmp_path, content):
    record = next(record for record in store.records if record.fields_file)
    if content is not None:
        (tmp_path / record.fields_file).write_bytes(content)
    assert shell(record, tmp_path) is None


def test_many_cases_go_on_below(all_courses, colours):
    many = [
        replace(course, case=f"{course.case}-{i}") for i in range(2) for course in all_courses if course.solver == "fem"
    ]
    with style():
        figure = refinement_figure(many, colours)
        figure.draw_without_rendering()
    axes = panels(figure)
    assert len(axes) == 2 * len(many) == 16
    assert figure.get_figwidth() == refinement_figure(many[:4], colours).get_figwidth()
    boxes = [one.get_window_extent() for one in axes]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert [one.get_ylabel() for one in axes].count(ERROR_LABEL) == 4  # each row says it once


def test_tick_labels_of_a_narrow_axis_do_not_overlap(all_courses, colours):
    narrow = [
        replace(course, steps=(course.steps[0], course.steps[1].model_copy(update={"unknowns": 300})))
        for course in all_courses
        if course.solver == "fem"
    ]
    assert narrow[0].steps[0].unknowns == 192
    with style():
        figure = refinement_figure(narrow, colours)
        figure.draw_without_rendering()
    for axes in panels(figure):
        shown = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
        low, high = axes.get_window_extent().intervalx
        shown = [box for box in shown if low - 1 <= (box.x0 + box.x1) / 2 <= high + 1]
        assert shown
        assert not any(a.overlaps(b) for i, a in enumerate(shown) for b in shown[:i])


def test_without_gaps_there_is_no_row_for_them(all_courses, colours):
    fields = [
        replace(course, steps=tuple(s.model_copy(update={"gap": None}) for s in course.steps))
        for course in all_courses
        if course.solver == "ndf" and course.case == COURSE[0]
    ]
    with style():
        (only,) = panels(iteration_figure(fields, colours, "iteration"))
    assert only.get_ylabel() == ERROR_LABEL


def test_a_single_step_is_neither_a_refinement_nor_a_training(all_courses, colours):
    alone = [replace(course, steps=course.steps[-1:]) for course in all_courses if course.solver == "fem"]
    assert refinement_figure(alone, colours) is None
    for abscissa in ("unknowns", "seconds", "iteration"):
        assert iteration_figure(alone, colours, abscissa) is None


def test_two_iterations_are_no_figure(all_courses, colours):
    short = [replace(course, steps=course.steps[:2]) for course in all_courses if course.solver == "ndf"]
    assert iteration_figure(short, colours, "iteration") is None


def test_states_of_a_path_and_solves_of_nothing_are_no_convergence(by_id, course_rows):
    refined = by_id[course_rows[0].run_id]
    as_path = tuple(step.model_copy(update={"phase": "path"}) for step in refined.history)
    nothing = tuple(step.model_copy(update={"unknowns": 0}) for step in refined.history)
    for history in (as_path, nothing):
        assert courses({refined.run_id: refined.model_copy(update={"history": history})}, course_rows) == []
    both = refined.model_copy(update={"history": refined.history + as_path})
    (course,) = courses({refined.run_id: both}, course_rows)
    assert course.steps == refined.history


def test_a_large_suite_is_drawn_in_bands(store, by_id, course_rows):
    drawn = [shell(records[0], store.folder) for records in pictured(by_id, course_rows).values()]
    with style():
        figure = course_figure([*drawn, *drawn, *drawn[:1]])
        figure.draw_without_rendering()
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]
    assert [title[:3] for title in titles] == [f"({letter})" for letter in "abcde"] + [f"({x})" for x in "fghi"]
    assert figure.get_figwidth() < 10
