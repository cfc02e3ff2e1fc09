"""Resolution consistency from records of fields by formulas, whose differences are known."""

import itertools

import numpy as np
import pytest

from shellbench.report.data.ladder import Probes, case_runs, difference, read_probes
from shellbench.report.sections.consistency import consistency_table, section
from shellbench.report.sections.resolution import nominal_rates, yardstick_words
from tests.report.resolutions import LENGTH, NAPKIN, PLATE, PROBE_RMS, evidence, only_suites, plate_runs, run, unknowns


@pytest.fixture(autouse=True)
def studies(monkeypatch):
    only_suites(monkeypatch, ("resolution", "training", "obstacle_course"))


def line(table, solver):
    (found,) = table.data[table.data["solver"] == solver].to_dict("records")
    return found


def pairs(shown, kind, solver):
    data = section(shown).details[0].data
    found = data[(data["pair"] == kind) & (data["solver"] == solver)]
    return {(one["run"], one["other"]): one for one in found.to_dict("records")}


def test_successive_meshes_differ_by_the_difference_of_their_errors(plate):
    found = pairs(plate, "next in unknowns", "shells")
    sizes = [4, 8, 16, 32, 64]
    for coarse, fine in itertools.pairwise(sizes):
        pair = found[f"cells {coarse}×{coarse}", f"cells {fine}×{fine}"]
        expected = LENGTH * (coarse**-2 - fine**-2)
        assert pair["largest_difference"] == pytest.approx(expected, rel=1e-9)
        assert pair["rms_difference"] == pytest.approx(expected * PROBE_RMS, rel=1e-9)
    assert found["cells 64×64", "default settings"]["largest_difference"] == pytest.approx(LENGTH * (64**-2 - 1e-7))
    assert len(found) == 5  # the meshes with a row of cells more are no resolution of their own


def test_each_run_is_held_against_the_finest_of_its_solver(plate):
    found = pairs(plate, "finest of the solver", "shells")
    assert {other for _, other in found} == {"default settings"}
    assert found["cells 8×9", "default settings"]["largest_difference"] == pytest.approx(LENGTH * (8**-2 + 1e-3 - 1e-7))
    found = pairs(plate, "finest of the solver", "field")
    assert found["neurons 5, seed 2", "neurons 10, seed 0"]["largest_difference"] == pytest.approx(
        LENGTH * (2.4e-2 - 2e-3)
    )


def test_marginally_different_runs_are_compared_among_themselves(plate):
    meshes = pairs(plate, "marginally different", "shells")
    assert set(meshes) == {(f"cells {n}×{n}", f"cells {n}×{n + 1}") for n in (8, 16, 32)}
    assert all(one["largest_difference"] == pytest.approx(1e-3 * LENGTH) for one in meshes.values())
    seeds = line(consistency_table(case_runs(plate)), "field")
    assert seeds["alike_runs"] == 3
    assert seeds["alike_unknowns"] == unknowns(10)
    assert seeds["alike_largest"] == pytest.approx(LENGTH * 2e-3 * 0.2)  # seeds 0 and 2 are farthest apart
    squares = [0.1**2, 0.1**2, 0.2**2]
    assert seeds["alike_rms"] == pytest.approx(LENGTH * 2e-3 * PROBE_RMS * np.sqrt(np.mean(squares)))


def test_other_diagonals_are_marginally_different_and_never_stand_for_a_mesh(tmp_path):
    runs = [
        run(tmp_path, PLATE, "shells", 8, 3e-2, label="diagonal left", overrides={"cells": [8, 8], "diagonal": "left"}),
        run(tmp_path, PLATE, "shells", 8, 1e-2, label="cells 8×8"),
        run(tmp_path, PLATE, "shells", 16, 1e-3, label="cells 16×16"),
    ]
    shown = evidence(tmp_path, runs)
    assert set(pairs(shown, "marginally different", "shells")) == {("diagonal left", "cells 8×8")}
    ((coarse, fine),) = case_runs(shown)[0].ladders[0].steps("unknowns")
    assert (coarse.record.run_id, fine.record.run_id) == (runs[1][0].run_id, runs[2][0].run_id)


def test_the_slope_is_that_of_the_formula(plate):
    table = consistency_table(case_runs(plate))
    assert line(table, "shells")["slope"] == pytest.approx(-1.0, abs=0.02)  # 1 / n^2 of 12 n^2 unknowns
    assert np.isnan(line(table, "field")["slope"])  # two sizes make no slope


def test_drift_is_the_change_of_the_quantity(plate):
    table = consistency_table(case_runs(plate))
    assert line(table, "shells")["drift"] == pytest.approx(64**-2 - 1e-7, rel=1e-6)


def test_the_common_run_is_the_one_of_smallest_error(plate):
    (case,) = case_runs(plate)
    assert case.yardstick.row.solver == "shells"
    assert case.judged
    found = line(consistency_table([case]), "field")
    assert found["yardstick_largest"] == pytest.approx(LENGTH * (2e-3 - 1e-7))
    assert found["yardstick_rms"] == pytest.approx(LENGTH * (2e-3 - 1e-7) * PROBE_RMS)
    assert case.doubt == pytest.approx(LENGTH * (64**-2 - 1e-7))
    assert "smallest doubt" in yardstick_words(case)


def test_an_error_within_the_known_values_uncertainty_wins_nothing(tmp_path):
    runs = [
        run(tmp_path, PLATE, "field", 8, 1e-12, seed=0, suites=("obstacle_course",)),
        run(tmp_path, PLATE, "shells", 8, 5e-10, suites=("obstacle_course",)),
    ]
    assert case_runs(evidence(tmp_path, runs))[0].yardstick.row.solver == "shells"  # it depends on no seed


def test_without_known_value_the_common_run_is_deterministic_and_changed_least(tmp_path):
    runs = [
        run(tmp_path, PLATE, solver, n, error, seed=seed, label=f"cells {n}", known=False)
        for solver, n, error, seed in (
            ("coarse", 64, 0.1, None),
            ("coarse", 128, 0.2, None),
            ("fine", 8, 0.001, None),
            ("fine", 16, 0.0, None),
            ("drawn", 8, 0.0, 0),
            ("drawn", 16, 0.0, 0),
        )
    ]
    (case,) = case_runs(evidence(tmp_path, runs))
    assert case.yardstick.row.solver == "fine"
    assert not case.judged
    assert "no value is known" in yardstick_words(case)


def test_positions_are_judged_by_their_absolute_error(tmp_path):
    made = [
        run(tmp_path, PLATE, "shells", 8, 2e-3, suites=("obstacle_course",)),
        run(tmp_path, PLATE, "field", 8, -1e-3, seed=0, suites=("obstacle_course",)),
    ]
    positions = [
        (record, row.model_copy(update={"relative_error": None, "absolute_error": row.value - row.reference}))
        for record, row in made
    ]
    (case,) = case_runs(evidence(tmp_path, positions))
    assert case.yardstick.row.solver == "field"
    assert "smallest doubt" in yardstick_words(case)


def test_failed_runs_are_left_out_and_counted(plate):
    (case,) = case_runs(plate)
    assert case.failed == {"field": 1}
    assert all("neurons 99" not in run.name for ladder in case.ladders for run in ladder.runs)
    assert "1 of field" in consistency_table([case]).write("text")


def test_runs_of_other_studies_do_not_count(tmp_path):
    runs = [*plate_runs(tmp_path), run(tmp_path, PLATE, "field", 80, 0.5, seed=0, label="x", suites=("training",))]
    shown = evidence(tmp_path, runs)
    assert all(run.unknowns != unknowns(80) for ladder in case_runs(shown)[0].ladders for run in ladder.runs)


def test_in_motion_differences_grow_as_the_formula_says(napkin):
    (case,) = case_runs(napkin)
    assert case.moves
    shells = next(ladder for ladder in case.ladders if ladder.solver == "shells")
    coarse = next(run for run in shells.runs if run.name == "cells 4×4")
    found = coarse.difference(shells.finest)
    gap = 0.2 * (4**-2 - 32**-2)
    assert found.marks == pytest.approx(np.linspace(0.1, 1.0, 10))
    assert found.by_mark == pytest.approx(LENGTH * found.marks * gap * np.exp(2 * found.marks))
    at = np.linspace(0.1, 1.0, 10)
    assert found.rms == pytest.approx(LENGTH * gap * PROBE_RMS * np.sqrt(np.mean((at * np.exp(2 * at)) ** 2)))


def test_time_steps_are_a_resolution_of_their_own(napkin):
    found = pairs(napkin, "next in time steps", "shells")
    assert set(found) == {("time_step 0.05", "cells 8×8"), ("cells 8×8", "time_step 0.0125")}
    assert set(pairs(napkin, "next in unknowns", "shells")) == {
        (f"cells {n}×{n}", f"cells {2 * n}×{2 * n}") for n in (4, 8, 16)
    }
    shells = line(consistency_table(case_runs(napkin)), "shells")
    assert shells["step_in_time_largest"] == pytest.approx(LENGTH * 1e-2 / 80 * np.exp(2.0))


def test_a_solver_that_goes_through_time_several_times_is_counted_by_its_last_passage(tmp_path):
    record, row = run(tmp_path, NAPKIN, "shells", 8, 0.0, steps=20, marks=(0.5, 1.0))
    twice = record.model_copy(update={"history": record.history[:7] + record.history})
    ((ladder,),) = [case.ladders for case in case_runs(evidence(tmp_path, [(twice, row)]))]
    assert ladder.finest.time_steps == 20


def test_only_marks_that_both_reached_are_compared():
    points = np.array([[0.2, 0.3]])
    ours = Probes(points, np.array([0.5, 1.0]), np.array([[[1.0, 0, 0]], [[2.0, 0, 0]]]))
    theirs = Probes(points, np.array([0.25, 0.5]), np.array([[[9.0, 0, 0]], [[1.5, 0, 0]]]))
    found = difference(ours, theirs)
    assert found.marks.tolist() == [0.5]
    assert found.largest == 0.5
    later = Probes(points, np.array([3.0]), np.zeros((1, 1, 3)))
    assert difference(ours, later) is None
    elsewhere = Probes(points + 0.1, ours.marks, ours.displacements)
    assert difference(ours, elsewhere) is None


@pytest.mark.parametrize("damage", ["lost", "broken", "missing", "not finite", "shape"])
def test_probes_that_cannot_be_read_are_none(tmp_path, damage):
    record, _ = run(tmp_path, PLATE, "shells", 4, 0.0, probes=damage != "missing")
    file = tmp_path / record.fields_file
    if damage == "lost":
        file.unlink()
    elif damage == "broken":
        file.write_bytes(file.read_bytes()[:40])
    elif damage in {"not finite", "shape"}:
        field = np.full((1, 1, 3), np.nan) if damage == "not finite" else np.zeros((1, 4, 3))
        np.savez(file, probes=np.zeros((1, 2)), probe_marks=np.ones(1), probe=field)
    assert read_probes(record, tmp_path) is None


def test_without_probes_only_the_queries_are_shown(tmp_path):
    shown = evidence(tmp_path, [run(tmp_path, PLATE, "shells", n, 0.1, label=f"n {n}", probes=False) for n in (4, 8)])
    made = section(shown)
    assert [table.name for table in made.tables] == ["resolution"]
    assert not made.exhibits
    assert case_runs(shown)[0].yardstick is None


def test_one_resolution_alone_is_compared_with_other_solvers(tmp_path):
    runs = [
        run(tmp_path, PLATE, "shells", 8, 1e-3, suites=("obstacle_course",)),
        run(tmp_path, PLATE, "field", 8, 2e-3, seed=0, suites=("obstacle_course",)),
    ]
    (case,) = case_runs(evidence(tmp_path, runs))
    table = consistency_table([case])
    assert table.data["solver"].tolist() == ["field"]  # the common run has nothing to be held against
    assert line(table, "field")["yardstick_largest"] == pytest.approx(1e-3 * LENGTH)
    assert case.doubt == pytest.approx(1e-3 * LENGTH)  # nothing but the other solver tells
    assert not section(evidence(tmp_path, runs)).exhibits


def test_text_tells_of_runs_that_are_there(tmp_path, plate, napkin):
    def words(shown):
        return " ".join(section(shown).words)

    suites = {"suites": ("obstacle_course",)}
    alone = [
        run(tmp_path, PLATE, "shells", 8, 1e-3, **suites),
        run(tmp_path, PLATE, "field", 8, 2e-3, seed=0, **suites),
    ]
    seeds = [*alone, run(tmp_path, PLATE, "field", 8, 3e-3, seed=1, **suites)]
    for runs, several, alike in ((alone, False, False), (seeds, False, True)):
        shown = evidence(tmp_path, runs)
        assert ("solved at several resolutions" in words(shown)) == several
        assert ("Alike are runs" in words(shown)) == alike
        text = consistency_table(case_runs(shown)).write("text")
        assert "Last step" not in text
        assert ("Runs alike" in text) == alike
    assert "solved at several resolutions" in words(plate)
    assert "Alike are runs" in words(plate)
    assert "cloth" not in words(plate)
    assert "frame rates" not in words(plate)
    assert "Folding cloth" in words(napkin)
    assert "frame rates" in words(napkin)


def test_repetition_is_stated_as_a_property_of_every_continuous_field(plate):
    assert "a property of continuity, not of a solver" in section(plate).words[0]


def test_nothing_that_moves_has_no_relative_difference(tmp_path):
    runs = [run(tmp_path, PLATE, "shells", n, 0.0, label=f"cells {n}", length=0.0) for n in (4, 8)]
    shown = evidence(tmp_path, runs)
    made = section(shown)
    assert case_runs(shown)[0].scale is None
    assert not made.exhibits
    assert all(table.write("text") for table in made.tables)


def test_nothing_at_all_is_no_section(tmp_path):
    assert section(evidence(tmp_path, [])) is None


def test_what_one_solution_gives_through_grids_and_rates_is_the_records(napkin):
    tables = {table.name: table for table in section(napkin).tables}
    rates = tables["frame_rates"].data
    assert rates["solution"].tolist() == ["shells, cells 32×32", "field, neurons 12"]  # of each solver the finest
    assert rates["interpolation_difference_10"].tolist() == [LENGTH / 100] * 2
    assert rates["frames_100"].tolist() == [101] * 2
    grids = tables["resolution"].data
    assert grids["solution"].tolist() == rates["solution"].tolist()
    assert grids["interpolation_rms_10"].tolist() == pytest.approx([LENGTH / 100] * 2)


def test_frame_rates_that_are_nearly_one_share_a_column():
    assert nominal_rates([14.0, 16.0, 30.0, 60.0, 16.0]) == {14.0: 15, 16.0: 15, 30.0: 30, 60.0: 60}


@pytest.mark.parametrize("which", ["plate", "napkin"])
def test_the_figure_shows_what_the_table_says(request, which):
    shown = request.getfixturevalue(which)
    (exhibit,) = section(shown).exhibits
    panels = exhibit.figure.axes
    assert len(panels) == (3 if which == "napkin" else 2)
    found = pairs(shown, "finest of the solver", "shells")
    scale = case_runs(shown)[0].scale
    largest = {round(100 * one["largest_difference"] / scale, 9) for one in found.values() if "×" in one["run"]}
    drawn = [{round(float(y), 9) for y in curve.get_ydata()} for curve in panels[0].get_lines()]
    assert any(heights and heights <= largest and len(heights) >= 3 for heights in drawn)
    (star,) = [curve for curve in panels[0].get_lines() if curve.get_marker() == "*"]
    apart = line(consistency_table(case_runs(shown)), "field")["yardstick_largest"]
    assert star.get_ydata() == pytest.approx([100 * apart / scale])
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in panels)
    assert exhibit.run_ids
    assert exhibit.name == f"consistency_{PLATE if which == 'plate' else NAPKIN}"
    assert max(exhibit.figure.get_size_inches()) <= 7.6


def test_a_run_that_no_suite_declares_is_no_part_of_the_study(plate, tmp_path):
    """A run of one's own settings carries all suites of its case, and must not become a solver's finest."""
    record, row = run(tmp_path, PLATE, "shells", 512, 0.5, label="")
    stray = row.model_copy(update={"declared": False, "default_settings": False, "overrides": {"cells": [512, 512]}})
    before = case_runs(plate)
    both = type(plate)({**plate.records, record.run_id: record}, [*plate.rows, stray], plate.folder)
    after = case_runs(both)
    assert [[r.record.run_id for r in one.runs] for c in after for one in c.ladders] == [
        [r.record.run_id for r in one.runs] for c in before for one in c.ladders
    ]
