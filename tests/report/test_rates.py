import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.report.data.accuracy import accuracies
from shellbench.report.data.rates import fitted_rate, known_yardstick, yardstick_of
from shellbench.report.sections.cost import section
from shellbench.report.sections.seeds import seed_spreads
from tests.report.conftest import TRUTH, UNCERTAINTY
from tests.report.studied import evidence, meshes

UNKNOWNS = [100.0 * 4**k for k in range(5)]


@given(st.floats(0.3, 4.0), st.floats(1e-3, 10.0))
def test_a_power_law_gives_its_own_exponent(order, factor):
    errors = [factor * n**-order for n in UNKNOWNS]
    rate = fitted_rate(UNKNOWNS, errors)
    usable = [e for e in errors if e < 0.3]
    if len(usable) < 3:
        assert rate is None
    else:
        assert rate is not None
        assert rate.slope == pytest.approx(-order)
        assert rate(UNKNOWNS[-1]) == pytest.approx(errors[-1])


def test_points_in_the_known_values_uncertainty_do_not_bend_the_slope():
    errors = [n**-2.0 for n in UNKNOWNS[:3]] + [3e-8, 3e-8]
    assert fitted_rate(UNKNOWNS, errors, floor=2e-8).slope == pytest.approx(-2.0)
    assert fitted_rate(UNKNOWNS, errors).slope > -1.9


def test_the_coarsest_points_are_left_out():
    errors = [0.9, 0.7] + [1e3 * n**-2.0 for n in UNKNOWNS[2:]]
    assert fitted_rate(UNKNOWNS, errors).slope == pytest.approx(-2.0)


def test_order_of_the_points_does_not_matter():
    errors = [n**-1.5 for n in UNKNOWNS]
    forward = fitted_rate(UNKNOWNS, errors)
    backward = fitted_rate(UNKNOWNS[::-1], errors[::-1])
    assert backward.slope == pytest.approx(forward.slope)


@pytest.mark.parametrize("errors", [[], [1e-2, 1e-3], [0.0, 0.0, 0.0], [math.nan] * 3])
def test_too_little_gives_no_slope(errors):
    assert fitted_rate(UNKNOWNS[: len(errors)], errors) is None


def test_repeated_abscissae_give_no_slope():
    assert fitted_rate([5.0, 5.0, 5.0], [1e-2, 1e-3, 1e-4]) is None


SIDE = 100.0  # m, of the square plate
ERRORS = {(4, 4): 1e-2, (8, 8): 1e-3, (16, 16): 1e-4}


@pytest.fixture
def runs(tmp_path):
    return meshes(tmp_path, "mesh", ERRORS)


@pytest.fixture
def positions(runs):
    """The same runs, as if the quantity were a position, which has no relative error of its own."""
    return [(made, of.model_copy(update={"relative_error": None})) for made, of in runs]


def test_the_known_value_is_what_errors_are_relative_to(tmp_path, runs):
    held = evidence(tmp_path, runs)
    yardstick = known_yardstick(held.records, held.rows)
    truth = TRUTH["square_plate"]
    assert (yardstick.value, yardstick.scale, yardstick.run_id) == (truth, truth, None)
    assert yardstick.floor == pytest.approx(UNCERTAINTY)
    assert yardstick.error(0.9 * truth) == pytest.approx(-0.1)


def test_errors_of_a_negative_value_keep_the_sign_of_the_difference(tmp_path, runs):
    held = evidence(tmp_path, [(made, of.model_copy(update={"reference": -2.0})) for made, of in runs])
    assert known_yardstick(held.records, held.rows).error(-1.5) == pytest.approx(0.25)


def test_errors_of_a_position_are_relative_to_the_extent_of_the_shell(tmp_path, positions):
    held = evidence(tmp_path, positions)
    yardstick = yardstick_of(held.records, held.rows)
    assert yardstick.scale == pytest.approx(SIDE)
    assert yardstick.floor == pytest.approx(UNCERTAINTY * TRUTH["square_plate"] / SIDE)
    (one,) = accuracies(held)
    expected = [error * TRUTH["square_plate"] / SIDE for error in ERRORS.values()]
    assert [point.error for point in one.families[0].points] == pytest.approx(expected)
    assert "extent of the shell, 100 m" in section(held).exhibits[0].caption


def test_a_value_about_zero_that_is_no_length_is_no_yardstick(tmp_path, positions):
    energies = [(made, of.model_copy(update={"unit": "J"})) for made, of in positions]
    held = evidence(tmp_path, energies)
    assert yardstick_of(held.records, held.rows) is None
    assert section(held) is None


def test_without_uncertainties_the_best_answer_is_that_of_most_unknowns(tmp_path, runs):
    unknown = [(made, of.model_copy(update={"reference": None, "relative_error": None})) for made, of in runs]
    held = evidence(tmp_path, unknown)
    assert known_yardstick(held.records, held.rows) is None
    yardstick = yardstick_of(held.records, held.rows)
    assert yardstick.run_id == runs[2][0].run_id
    assert yardstick.value == pytest.approx(TRUTH["square_plate"] * (1 + 1e-4))
    failed = [(made, of.model_copy(update={"status": "failed"})) for made, of in unknown[2:]]
    held = evidence(tmp_path, [*unknown[:2], *failed])
    assert yardstick_of(held.records, held.rows).run_id == runs[1][0].run_id


def test_seeds_of_a_position_spread_relative_to_the_extent(tmp_path):
    runs = [
        (made, of.model_copy(update={"relative_error": None}))
        for seed, error in {0: 1e-3, 1: 3e-3}.items()
        for made, of in meshes(tmp_path, "field", {(4, 4): error}, seed=seed)
    ]
    held = evidence(tmp_path, runs)
    (spread,) = seed_spreads(held).itertuples()
    truth = TRUTH["square_plate"]
    assert spread.errors == pytest.approx((1e-3 * truth / SIDE, 3e-3 * truth / SIDE))
    assert spread.largest_from_mean == pytest.approx(1e-3 * truth / SIDE)
