import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex

from shellbench.report.data.accuracy import accuracies
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import inks
from shellbench.report.figures.panel import SPACING, apart
from shellbench.report.sections.cost import LEVELS, cost_figure, cost_table, section
from tests.report.conftest import TRUTH, UNCERTAINTY
from tests.report.studied import BYTES_AN_UNKNOWN, SECONDS_AN_UNKNOWN, UNKNOWNS_A_CELL, evidence, meshes, studied

SIZES = (4, 8, 16, 32)


def fourth_order(n):
    return 2.0 * n**-4.0


def square(errors):
    return {(n, n): error for n, error in errors.items()}


def only(folder, runs):
    (one,) = accuracies(evidence(folder, runs))
    return one


def line(folder, runs, measure="unknowns", solver="mesh"):
    table = cost_table([only(folder, runs)], measure, {})
    (found,) = [line for line in table.data.to_dict("records") if line["solver"] == solver]
    return found


@pytest.mark.parametrize("measure", ["unknowns", "seconds", "memory"])
def test_an_error_of_fourth_order_has_half_that_exponent_against_what_grows_as_the_square(tmp_path, measure):
    found = line(tmp_path, meshes(tmp_path, "mesh", square({n: fourth_order(n) for n in SIZES})), measure)
    assert found["exponent"] == pytest.approx(-2.0, abs=1e-9)
    if measure == "unknowns":
        assert found["order"] == pytest.approx(4.0, abs=1e-9)


def test_only_a_mesh_has_an_order(tmp_path):
    runs = [
        studied(tmp_path, "resolution", "field", {"neurons": n}, fourth_order(n), unknowns=3 * n * n) for n in SIZES
    ]
    found = line(tmp_path, runs, solver="field")
    assert found["exponent"] == pytest.approx(-2.0, abs=1e-9)
    assert found["order"] is None


def test_marginally_different_meshes_count_once_in_a_slope(tmp_path):
    errors = square({n: fourth_order(n) for n in SIZES})
    alike = {(31, 32): 3 * fourth_order(32), (32, 31): 0.5 * fourth_order(32), (15, 16): 5 * fourth_order(16)}
    found = line(tmp_path, meshes(tmp_path, "mesh", errors | alike))
    assert found["exponent"] == pytest.approx(-2.0, abs=1e-9)


def test_sizes_at_which_the_error_has_stalled_are_not_fitted(tmp_path):
    stalled = {64: fourth_order(32), 128: 1.1 * fourth_order(32), 256: fourth_order(32)}
    found = line(tmp_path, meshes(tmp_path, "mesh", square({n: fourth_order(n) for n in SIZES} | stalled)))
    assert found["exponent"] == pytest.approx(-2.0, abs=1e-9)


def test_a_first_order_method_has_not_stalled(tmp_path):
    found = line(tmp_path, meshes(tmp_path, "mesh", square({n: 0.5 / n for n in SIZES})))
    assert found["order"] == pytest.approx(1.0, abs=1e-9)


def test_the_cheapest_run_from_which_on_the_error_stays_below(tmp_path):
    errors = {4: 8e-3, 8: 5e-4, 12: 4e-3, 16: 9e-4, 32: 8e-5}
    runs = meshes(tmp_path, "mesh", square(errors))
    of = {n: UNKNOWNS_A_CELL * n * n for n in errors}
    found = line(tmp_path, runs)
    assert [found[f"to_{level:g}"] for level in LEVELS[:3]] == [of[4], of[16], of[32]]  # 8 falls back at 12
    assert math.isnan(found["to_1e-05"]) if found["to_1e-05"] is not None else True
    assert found["runs_0.001"] == runs[3][0].run_id
    assert line(tmp_path, runs, "seconds")["to_0.001"] == pytest.approx(SECONDS_AN_UNKNOWN * of[16])
    assert line(tmp_path, runs, "memory")["to_0.001"] == BYTES_AN_UNKNOWN * of[16]


def test_another_sweep_or_the_default_run_may_be_the_cheaper_way(tmp_path):
    sweep = meshes(tmp_path, "mesh", square({8: 5e-3, 16: 4e-4, 32: 4e-5}))
    alone = studied(tmp_path, "obstacle_course", "mesh", {"tolerance": 1}, 5e-5, unknowns=700)
    default = (alone[0], alone[1].model_copy(update={"overrides": {}, "default_settings": True}))
    found = line(tmp_path, [*sweep, default])
    assert found["to_0.01"] == 700  # the sweep's is 768
    assert found["to_0.0001"] == 700


def test_sweeps_over_two_settings_are_two_families(tmp_path):
    """A coarse step on a fine mesh takes nothing away from the meshes, and has no order in their width."""
    cells = meshes(tmp_path, "mesh", square({8: 5e-3, 16: 4e-4, 32: 4e-5}))
    steps = []
    for step, error in {0.01: 8e-2, 0.005: 3e-2}.items():
        made, of = studied(tmp_path, "resolution", "mesh", {"cells": [32, 32], "step": step}, error, unknowns=12288)
        steps.append((made, of.model_copy(update={"label": f"step {step}"})))
    one = only(tmp_path, [*cells, *steps])
    assert [(family.swept, len(family.points)) for family in one.of("mesh")] == [("cells", 3), ("step", 2)]
    assert line(tmp_path, [*cells, *steps]) == line(tmp_path, cells)
    held_fixed = [(made, of.model_copy(update={"label": f"fixed step, {of.label}"})) for made, of in cells]
    assert [family.swept for family in only(tmp_path, held_fixed).families] == ["cells"]


def test_one_bad_seed_reaches_nothing(tmp_path):
    runs = []
    for neurons, errors in {30: (1e-3, 2e-2), 60: (5e-4, 8e-4)}.items():
        for seed, error in enumerate(errors):
            runs.append(
                studied(tmp_path, "resolution", "field", {"neurons": neurons}, error, seed=seed, unknowns=3 * neurons)
            )
    found = line(tmp_path, runs, solver="field")
    assert found["to_0.01"] == found["to_0.001"] == 180
    held = only(tmp_path, runs)
    assert held.families[0].points[1].error == pytest.approx(math.sqrt(5e-4 * 8e-4), rel=1e-6)


def test_a_finer_run_that_failed_spoils_the_coarser_ones(tmp_path):
    runs = meshes(tmp_path, "mesh", square({8: 1e-4, 16: 1e-5}))
    failed = meshes(tmp_path, "mesh", square({32: 1e-6}), status="failed")
    found = line(tmp_path, [*runs, *failed])
    assert found["to_0.01"] is None or math.isnan(found["to_0.01"])
    text = cost_table([only(tmp_path, [*runs, *failed])], "unknowns", {}).write("text")
    assert "one run failed" in text
    assert "it was refused" in text


def test_the_uncertainty_of_the_known_value_counts_against_a_run(tmp_path):
    just = 1e-5 - UNCERTAINTY
    assert line(tmp_path, meshes(tmp_path, "mesh", {(8, 8): 0.999 * just}))["to_1e-05"] == UNKNOWNS_A_CELL * 64
    beyond = line(tmp_path, meshes(tmp_path, "mesh", {(8, 8): 1.001 * just}))["to_1e-05"]
    assert beyond is None or math.isnan(beyond)


def test_without_a_known_value_errors_are_relative_to_the_most_certain_answer(tmp_path):
    runs = meshes(tmp_path, "mesh", square({4: 1e-2, 8: 1e-3, 16: 0.0}))
    uncertainty = {4: 1e-2, 8: 1e-3, 16: 1e-5}
    unknown = [
        (made, of.model_copy(update={"reference": None, "relative_error": None, "uncertainty": u * TRUTH[of.case]}))
        for (made, of), u in zip(runs, uncertainty.values(), strict=True)
    ]
    one = only(tmp_path, unknown)
    assert one.yardstick.value == TRUTH["square_plate"]
    assert one.yardstick.floor == pytest.approx(1e-5)
    assert [point.error for point in one.families[0].points] == pytest.approx([1e-2, 1e-3])  # not against itself
    assert "best answer" in section(evidence(tmp_path, unknown)).exhibits[0].caption


def test_all_solvers_are_in_one_figure_with_their_slopes(tmp_path):
    runs = meshes(tmp_path, "mesh", square({n: fourth_order(n) for n in SIZES}))
    runs += meshes(tmp_path, "peer", square({n: 0.3 * n**-2.0 for n in SIZES}))
    runs += meshes(tmp_path, "peer", {(64, 64): 0.2}, status="failed")
    one, colours = only(tmp_path, runs), inks(["mesh", "peer"])
    figure = cost_figure(one, colours)
    assert [axes.get_xlabel() for axes in figure.axes] == [
        "unknowns",
        "wall time of the solve (s)",
        "peak memory of the solve (MB)",
    ]
    for axes in figure.axes:
        slopes = {to_hex(text.get_color()).upper(): text.get_text() for text in axes.texts}
        assert slopes == {colours["mesh"].colour: "−2.0", colours["peer"].colour: "−1.0"}
        hollow = [mark for mark in axes.get_lines() if mark.get_markerfacecolor() == "white"]
        assert [tuple(mark.get_ydata()) for mark in hollow] == [(pytest.approx(20.0),)]
    last = figure.axes[2].get_lines()
    drawn = {float(x) for mark in last for x in mark.get_xdata()}
    assert any(x == pytest.approx(BYTES_AN_UNKNOWN * UNKNOWNS_A_CELL * 16 / 1e6) for x in drawn)  # the mesh of 4x4


def test_the_section_has_a_figure_for_each_case_and_a_table_for_each_measure(tmp_path):
    runs = meshes(tmp_path, "mesh", square({n: fourth_order(n) for n in SIZES}))
    runs += meshes(tmp_path, "mesh", square({n: fourth_order(n) for n in SIZES}), case="scordelis_lo")
    made = section(evidence(tmp_path, runs))
    assert [exhibit.name for exhibit in made.exhibits] == ["cost_square_plate", "cost_scordelis_lo"]
    assert [table.name for table in made.tables] == ["cost_unknowns", "cost_seconds", "cost_memory"]
    for table in made.tables:
        assert table.data["case"].tolist() == ["square_plate", "scordelis_lo"]
    seconds = made.tables[1].write("text")
    assert "Environment" in seconds


def test_runs_of_no_resolution_study_make_no_section(store):
    by_id = {record.run_id: record for record in store.records}
    assert section(Evidence(by_id, store.rows, store.folder, store.known_values)) is None


@given(st.lists(st.floats(-0.5, 1.5), max_size=10).map(sorted))
def test_labels_are_moved_apart_within_the_panel(heights):
    moved = apart(heights)
    assert len(moved) == len(heights)
    assert all(-1e-9 <= height <= 1 + 1e-9 for height in moved)
    assert all(b - a >= SPACING - 1e-9 for a, b in pairwise(moved))


def test_a_time_that_hardly_grows_has_no_exponent(tmp_path):
    runs = meshes(tmp_path, "mesh", square({n: fourth_order(n) for n in SIZES}))
    seconds = {4: 1.0, 8: 1.1, 16: 1.3, 32: 1.9}
    slow = [(made, of.model_copy(update={"seconds": s})) for (made, of), s in zip(runs, seconds.values(), strict=True)]
    assert only(tmp_path, slow).families[0].rate("seconds", 0.0) is None
    assert only(tmp_path, slow).families[0].rate("unknowns", 0.0) is not None
