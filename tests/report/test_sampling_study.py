import pytest

from shellbench.report.studies.paper_studies import points_of, sampled_runs, sampling, sampling_figure
from tests.report.studied import evidence, studied

SEEDS = (0, 1, 2)


def drawn_anew(folder, n, errors):
    """Runs with n x n samples, one in each cell of a grid."""
    return [
        studied(folder, "sampling", "adam", {"fixed": 500, "cells": [n, n]}, error, seed=seed, gap=0.1)
        for seed, error in zip(SEEDS, errors, strict=True)
    ]


def on_a_rule(folder, panels, errors, gap, status="ok"):
    """Runs on panels of 5 x 5 points that say themselves how many points they took."""
    return [
        studied(
            folder,
            "sampling",
            "ritz",
            {"fixed": 120, "panels": panels},
            error,
            seed=seed,
            gap=gap,
            status=status,
            diagnostics={"quadrature_points": (5 * panels) ** 2},
        )
        for seed, error in zip(SEEDS, errors, strict=True)
    ]


@pytest.fixture
def runs(tmp_path):
    return [
        *drawn_anew(tmp_path, 25, (1e-3, -2e-3, 4e-3)),
        *drawn_anew(tmp_path, 5, (0.1, -0.3, 0.2)),
        *on_a_rule(tmp_path, 5, (1e-6, -2e-6, 3e-6), 1e-8),
        *on_a_rule(tmp_path, 1, (-0.9, -0.95, -0.99), 1e6, status="failed"),
    ]


def test_points_a_side_are_the_solver_s_own_count_or_the_cells_of_its_samples(tmp_path, runs):
    found = sampled_runs(evidence(tmp_path, runs))[["solver", "a_side"]].drop_duplicates()
    assert list(found.itertuples(index=False, name=None)) == [("adam", 5), ("adam", 25), ("ritz", 5), ("ritz", 25)]


def test_the_table_has_least_and_largest_of_the_seeds(tmp_path, runs):
    (table,) = sampling(evidence(tmp_path, runs)).tables
    lines = {(line["solver"], line["points"]): line for line in table.data.to_dict("records")}
    coarse = lines["adam", 25]
    assert (coarse["least_error"], coarse["largest_error"]) == (pytest.approx(0.1), pytest.approx(0.3))
    assert (coarse["runs"], coarse["failed"], coarse["least_gap"], coarse["largest_gap"]) == (3, 0, 0.1, 0.1)
    assert coarse["held_fixed"] == "fixed 500"


def test_refused_runs_are_shown_with_their_value_and_gap_and_marked(tmp_path, runs):
    found = sampling(evidence(tmp_path, runs))
    lines = {(line["solver"], line["points"]): line for line in found.tables[0].data.to_dict("records")}
    refused = lines["ritz", 25]
    assert (refused["failed"], refused["largest_gap"]) == (3, 1e6)
    assert refused["largest_error"] == pytest.approx(0.99)
    assert "3 of 3" in found.tables[0].write("text")
    above, below = found.exhibits[0].figure.axes
    hollow = [
        sorted(float(y) for line in axes.get_lines() if line.get_markerfacecolor() == "white" for y in line.get_ydata())
        for axes in (above, below)
    ]
    assert hollow == [pytest.approx([90.0, 95.0, 99.0]), pytest.approx([1e8] * 3)]


def test_the_line_is_the_median_of_the_seeds(tmp_path, runs):
    held = evidence(tmp_path, runs)
    above = sampling_figure(sampled_runs(held).query("solver == 'adam'"), held).axes[0]
    (line,) = [line for line in above.get_lines() if line.get_linestyle() == "-"]
    assert list(line.get_xdata()) == [5, 25]
    assert list(line.get_ydata()) == pytest.approx([20.0, 0.2])


def test_cases_stand_beside_each_other(tmp_path, runs):
    roof = [
        studied(tmp_path, "sampling", "adam", {"cells": [n, n]}, 1 / n, case="scordelis_lo", gap=0.1) for n in (5, 10)
    ]
    (exhibit,) = sampling(evidence(tmp_path, [*runs, *roof])).exhibits
    assert [axes.get_title(loc="left") for axes in exhibit.figure.axes][::2] != ["", ""]
    assert len(exhibit.figure.axes) == 4
    assert set(exhibit.run_ids) == {made.run_id for made, _ in [*runs, *roof]}


def test_a_run_that_left_no_value_is_still_counted(tmp_path, runs):
    made, of = studied(tmp_path, "sampling", "adam", {"fixed": 500, "cells": [5, 5]}, 0.0, seed=3, status="timeout")
    empty = (made, of.model_copy(update={"value": None, "relative_error": None}))
    held = evidence(tmp_path, [*runs, empty])
    (coarse,) = sampling(held).tables[0].data.query("solver == 'adam' and points == 25").to_dict("records")
    assert (coarse["runs"], coarse["failed"], coarse["largest_error"]) == (4, 1, pytest.approx(0.3))
    assert sampled_runs(held).query("solver == 'adam' and points == 25")["error"].count() == 3


@pytest.mark.parametrize("cells", [None, 5, [5], "5x5", [5.5, 2]])
def test_settings_that_are_no_grid_say_no_points(tmp_path, cells):
    made, of = studied(tmp_path, "sampling", "odd", {"cells": cells}, 0.1)
    assert points_of(made, of) is None
    assert sampling(evidence(tmp_path, [(made, of)])) is None
