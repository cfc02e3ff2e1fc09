"""Memory at stated error from records by formulas, whose bytes and errors are known."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.report.data.answers import LEVELS, answers, smallest_form
from shellbench.report.data.ladder import case_runs
from shellbench.report.data.notation import BYTES_A_POINT
from shellbench.report.sections.memory import (
    NOT_KNOWN,
    NOT_REACHED,
    REACHED,
    level_table,
    rounding_table,
    section,
)
from tests.report.resolutions import (
    HEADLINE,
    INTERPOLATION,
    LENGTH,
    NAPKIN,
    PLATE,
    ROUNDING,
    UNCERTAINTY,
    evidence,
    only_suites,
    run,
    unknowns,
)


@pytest.fixture(autouse=True)
def studies(monkeypatch):
    only_suites(monkeypatch, ("resolution",))


@pytest.fixture
def sharp(tmp_path):
    """Meshes of rate 4 that pass all levels, and a field that is off by 0.3 % however large it is."""
    runs = [run(tmp_path, PLATE, "shells", n, n**-4.0, label=f"cells {n}×{n}") for n in (2, 4, 8, 16, 32)]
    runs += [run(tmp_path, PLATE, "field", n, 3e-3, seed=0, label=f"neurons {n}") for n in (3, 6)]
    return evidence(tmp_path, runs)


def line(table, solver, kept_as="its own numbers"):
    data = table.data[table.data["solver"] == solver]
    (found,) = data[data["kept_as"] == kept_as].to_dict("records") if "kept_as" in data else data.to_dict("records")
    return found


def ladder(case, solver):
    return next(ladder for ladder in case.ladders if ladder.solver == solver)


def test_fewest_bytes_are_those_of_the_coarsest_run_and_format_within_the_level(sharp):
    found = line(level_table(case_runs(sharp)), "shells")
    # Errors: 4x4: 0.39 %, 8x8: 0.024 %, 16x16: 0.0015 %; float16 adds 0.1 %, float32 1e-7.
    assert (found["bytes_field_0.01"], found["format_field_0.01"]) == (2 * unknowns(4), "float16")
    assert (found["bytes_field_0.001"], found["format_field_0.001"]) == (4 * unknowns(8), "float32")
    assert (found["bytes_field_0.0001"], found["format_field_0.0001"]) == (4 * unknowns(16), "float32")
    assert found["run_field_0.001"] == "cells 8×8"
    assert found["status_field_0.001"] == REACHED


def test_headline_is_against_the_known_value_with_its_own_rounding(sharp):
    found = line(level_table(case_runs(sharp)), "field")
    assert (found["bytes_headline_0.01"], found["format_headline_0.01"]) == (2 * unknowns(3), "float16")
    assert found["status_headline_0.001"] == NOT_REACHED
    (case,) = case_runs(sharp)
    (short,) = [
        a for a in answers(case, ladder(case, "field")) if a.format == "float16" and a.run.unknowns == unknowns(3)
    ]
    assert short.error == pytest.approx(1.003 * 1.001 - 1)


def test_a_level_that_no_run_passes_is_not_reached(sharp):
    found = line(level_table(case_runs(sharp)), "field")
    assert found["status_field_0.01"] == REACHED
    assert found["status_field_0.001"] == found["status_field_0.0001"] == NOT_REACHED
    assert found["run_field_0.001"] == ""


def test_a_level_below_what_the_best_answer_is_known_to_is_not_known(plate):
    table = level_table(case_runs(plate))  # it changed by 0.024 % in its last step
    for solver in ("shells", "field"):
        assert line(table, solver)["status_field_0.0001"] == NOT_KNOWN
    assert line(table, "shells")["status_field_0.001"] == REACHED
    assert "not known" in table.write("text")


def test_a_level_below_the_known_values_uncertainty_is_not_known(tmp_path):
    made = [run(tmp_path, PLATE, "shells", n, 0.0, label=f"cells {n}") for n in (4, 8)]
    doubtful = [
        (record, row.model_copy(update={"reference_uncertainty": 5e-3 * row.reference})) for record, row in made
    ]
    found = line(level_table(case_runs(evidence(tmp_path, doubtful))), "shells")
    assert found["status_headline_0.01"] == REACHED
    assert found["status_headline_0.001"] == found["status_headline_0.0001"] == NOT_KNOWN


def test_the_best_answer_is_not_called_exact(sharp):
    (case,) = case_runs(sharp)
    own = [a for a in answers(case, ladder(case, "shells")) if a.run is case.yardstick and a.kept == "solved"]
    assert own[0].difference == pytest.approx((16**-4.0 - 32**-4.0) / (1 + 32**-4.0), rel=1e-6)
    assert own[0].error == pytest.approx(32**-4.0 + UNCERTAINTY)
    assert own[0].error > UNCERTAINTY


def test_rounding_adds_to_the_difference(sharp):
    (case,) = case_runs(sharp)
    by_format = {
        a.format: a for a in answers(case, ladder(case, "shells")) if a.run.name == "cells 8×8" and a.kept != "mesh"
    }
    exact = by_format["as solved"]
    assert exact.storage_bytes == 8 * unknowns(8)
    for format, (size, relative) in ROUNDING.items():
        assert by_format[format].storage_bytes == size * unknowns(8)
        assert by_format[format].difference == pytest.approx(exact.difference + relative * LENGTH / case.scale)


def test_a_mesh_is_made_of_the_best_run_and_adds_its_interpolation(sharp):
    (case,) = case_runs(sharp)
    (mesh,) = [a for a in answers(case, ladder(case, "field")) if a.kept == "mesh"]  # the finest is not one of them
    assert mesh.storage_bytes == BYTES_A_POINT * 10**2
    own = (3e-3 - 32**-4.0) * LENGTH / case.scale
    assert mesh.difference == pytest.approx(own + INTERPOLATION * LENGTH / 10**2 / case.scale, rel=1e-6)


def test_frames_multiply_the_bytes_and_add_their_own_interpolation(napkin):
    (case,) = case_runs(napkin)
    (mesh,) = [a for a in answers(case, ladder(case, "shells")) if a.kept == "mesh"]
    assert mesh.format == "11 meshes 10×10"
    assert mesh.storage_bytes == BYTES_A_POINT * 10**2 * 11
    own = case.doubt / case.scale
    assert mesh.difference == pytest.approx(own + (INTERPOLATION / 100 + 1 / 100) * LENGTH / case.scale)


def test_without_known_value_the_headline_is_not_known(napkin):
    table = level_table(case_runs(napkin))
    for solver in ("shells", "field"):
        assert {line(table, solver)[f"status_headline_{level:g}"] for level in LEVELS} == {NOT_KNOWN}


def test_a_position_is_judged_relative_to_the_largest_displacement(tmp_path):
    made = [run(tmp_path, PLATE, "shells", n, 1e-3 / n, label=f"cells {n}") for n in (4, 8)]
    positions = [
        (record, row.model_copy(update={"relative_error": None, "absolute_error": row.value - row.reference}))
        for record, row in made
    ]
    (case,) = case_runs(evidence(tmp_path, positions))
    assert case.judged
    solved = [a for a in answers(case, case.ladders[0]) if a.kept == "solved"]
    largest = LENGTH * (1 + 1e-3 / 8)
    assert [a.error for a in solved] == pytest.approx(
        [HEADLINE * (1e-3 / n + UNCERTAINTY) / largest for n in (4, 8)], rel=1e-6
    )


def test_a_level_that_is_not_known_is_not_told(tmp_path):
    made = [run(tmp_path, PLATE, "shells", n, n**-4.0, label=f"cells {n}") for n in (4, 8, 16)]
    doubtful = [
        (record, row.model_copy(update={"reference_uncertainty": 5e-4 * row.reference})) for record, row in made
    ]
    (exhibit,) = section(evidence(tmp_path, doubtful)).exhibits
    assert "within 0.1 %" in exhibit.description
    assert "0.01 %" not in exhibit.description


def test_the_figure_judges_by_the_known_value_and_not_by_a_solvers_finest_run(tmp_path):
    """A solver that converges to a wrong value, as finest of all, keeps its error."""
    runs = [run(tmp_path, PLATE, "shells", n, 1e-2 + n**-4.0, label=f"cells {n}") for n in (4, 8, 16, 32)]
    (exhibit,) = section(evidence(tmp_path, runs)).exhibits
    (solved,) = [one for one in exhibit.figure.axes[0].get_lines() if len(one.get_xdata()) == 4]
    assert solved.get_ydata() == pytest.approx([100 * (1e-2 + n**-4.0 + UNCERTAINTY) for n in (4, 8, 16, 32)])


def test_an_error_below_rounding_is_drawn_too(tmp_path):
    runs = [run(tmp_path, PLATE, "shells", n, 0.0, label=f"cells {n}") for n in (4, 8, 16)]
    exact = [(record, row.model_copy(update={"reference_uncertainty": 1e-12 * HEADLINE})) for record, row in runs]
    (exhibit,) = section(evidence(tmp_path, exact)).exhibits
    (solved,) = [one for one in exhibit.figure.axes[0].get_lines() if len(one.get_xdata()) == 3]
    low, high = exhibit.figure.axes[0].get_ylim()
    assert np.all((low < solved.get_ydata()) & (solved.get_ydata() < high))


def test_without_a_known_value_the_best_answers_own_solver_has_no_curve(napkin):
    (exhibit,) = section(napkin).exhibits
    (case,) = case_runs(napkin)
    assert case.yardstick.row.solver == "shells"
    solved = [one for one in exhibit.figure.axes[0].get_lines() if len(one.get_xdata()) == 3]
    assert len(solved) == 1  # the field's
    assert "it is of shells, which has no curve" in exhibit.caption


def test_a_format_whose_numbers_overflow_is_never_chosen(tmp_path):
    made = [run(tmp_path, PLATE, "shells", n, n**-4.0, label=f"cells {n}") for n in (4, 8, 16)]
    broken = [
        (
            record.model_copy(
                update={
                    "precision": tuple(
                        step.model_copy(update={"largest_difference": None, "rms_difference": None, "quantities": {}})
                        for step in record.precision
                    )
                }
            ),
            row,
        )
        for record, row in made
    ]
    cases = case_runs(evidence(tmp_path, broken))
    assert {a.kept for a in answers(cases[0], cases[0].ladders[0])} == {"solved", "mesh"}
    assert "not finite" in rounding_table(cases).write("text")


def test_runs_without_probes_still_have_bytes_and_headline(tmp_path):
    made = [run(tmp_path, PLATE, "shells", n, n**-4.0, label=f"cells {n}", probes=False) for n in (4, 8, 16)]
    shown = evidence(tmp_path, made)
    found = line(level_table(case_runs(shown)), "shells")
    assert {found[f"status_field_{level:g}"] for level in LEVELS} == {NOT_KNOWN}
    assert found["bytes_headline_0.001"] == 4 * unknowns(8)
    (exhibit,) = section(shown).exhibits
    assert "known value" in exhibit.caption


def test_one_run_alone_is_not_known_to_any_level(tmp_path):
    shown = evidence(tmp_path, [run(tmp_path, PLATE, "shells", 8, 1e-4)])
    found = line(level_table(case_runs(shown)), "shells")
    assert {found[f"status_field_{level:g}"] for level in LEVELS} == {NOT_KNOWN}


def test_nothing_that_moves_is_no_figure(tmp_path):
    still = {"length": 0.0, "known": False}
    shown = evidence(tmp_path, [run(tmp_path, PLATE, "shells", n, 0.0, label=f"n {n}", **still) for n in (4, 8)])
    made = section(shown)
    assert not made.exhibits
    assert all(table.write("text") for table in made.tables)


def test_rounding_is_shown_for_the_finest_run(sharp):
    data = rounding_table(case_runs(sharp)).data
    shells = data[data["solver"] == "shells"]
    assert shells["run"].unique().tolist() == ["cells 32×32"]
    assert shells["format"].tolist() == list(ROUNDING)
    assert shells["storage_bytes"].tolist() == [size * unknowns(32) for size, _ in ROUNDING.values()]
    assert shells["change"].tolist() == pytest.approx([relative for _, relative in ROUNDING.values()])


def test_smallest_of_the_candidates(sharp):
    (case,) = case_runs(sharp)
    found = answers(case, ladder(case, "shells"))
    for level in LEVELS:
        for measure in ("difference", "error"):
            best = smallest_form(found, level, measure=measure)
            assert getattr(best, measure) <= level
            smaller = [a for a in found if a.storage_bytes < best.storage_bytes]
            assert all(getattr(a, measure) is None or getattr(a, measure) > level for a in smaller)
            finest = max(a.run.unknowns for a in found if a.kept == "solved")
            spoilt = [replace(a, **{measure: 2 * level}) if a.kept == "solved" and a.run.unknowns == finest else a for a in found]  # fmt: skip
            assert smallest_form(spoilt, level, measure=measure) is None  # a coarser run alone was lucky
    assert smallest_form(found, 1e-12) is None
    assert smallest_form([], 1.0) is None


def test_nothing_at_all_is_no_section(tmp_path):
    assert section(evidence(tmp_path, [])) is None


@pytest.mark.parametrize("which", ["plate", "napkin"])
def test_figures_have_axes_with_units_and_fit_the_page(request, which):
    (exhibit,) = section(request.getfixturevalue(which)).exhibits
    panels = exhibit.figure.axes
    assert len(panels) == 2
    assert exhibit.name == f"memory_{PLATE if which == 'plate' else NAPKIN}"
    assert exhibit.figure.get_figwidth() <= 7.6
    assert "bytes" in panels[0].get_xlabel()
    assert "MB" in panels[-1].get_ylabel()
    rounded = [line.get_ydata() for line in panels[0].get_lines() if line.get_markerfacecolor() == "white"]
    assert len(rounded) == (2 if which == "plate" else 1)
    assert all(np.all(np.diff(errors) < 0) for errors in rounded)  # what a smaller one outdoes is not drawn
