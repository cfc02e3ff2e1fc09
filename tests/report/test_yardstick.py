import pytest

from shellbench.report.accuracy import accuracies
from shellbench.report.cost import section
from shellbench.report.rates import known_yardstick, yardstick_of
from shellbench.report.seeds import seed_spreads
from tests.report.conftest import TRUTH, UNCERTAINTY
from tests.report.studied import evidence, meshes

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
