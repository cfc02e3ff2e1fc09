"""Extrapolation of sequences whose limit is known."""

import math

import pytest

from shellbench.solvers.fem.refinement import ASYMPTOTIC, SAFETY, SLOWEST, estimate

RESOLUTIONS = (8.0, 11.0, 16.0)


@pytest.mark.parametrize("rate", [1.5, 2.0, 4.0, 5.5])
def test_a_power_law_is_extrapolated_exactly(rate):
    values = [3.0 + 0.7 * n**-rate for n in RESOLUTIONS]
    found = estimate(values, RESOLUTIONS)
    assert found.extrapolated == pytest.approx(3.0, abs=1e-10)
    assert found.rate == pytest.approx(rate, rel=1e-6)
    if rate <= ASYMPTOTIC:
        assert found.uncertainty == pytest.approx(SAFETY * abs(values[-1] - 3.0), rel=1e-6)
    else:
        assert found.uncertainty > SAFETY * abs(values[-1] - 3.0)


def test_faster_than_believed_is_not_believed():
    values = [3.0 + 7.0 * n**-9.0 for n in RESOLUTIONS]
    found = estimate(values, RESOLUTIONS)
    assert found.rate is None
    assert found.uncertainty == pytest.approx(SAFETY * abs(values[2] - values[1]) / ((16 / 11) ** ASYMPTOTIC - 1))
    assert found.uncertainty > abs(values[-1] - 3.0)


def test_what_does_not_settle_is_not_extrapolated():
    found = estimate([1.0, 1.1, 1.3], RESOLUTIONS)
    assert (found.extrapolated, found.rate) == (1.3, None)
    assert found.uncertainty == pytest.approx(0.3)


def test_a_small_step_back_is_followed_by_the_slowest_rate_that_is_believed():
    found = estimate([1.0, 1.1, 1.09], RESOLUTIONS)
    assert (found.extrapolated, found.rate) == (1.09, None)
    still_to_come = 0.01 / ((16 / 11) ** SLOWEST - 1)
    assert found.uncertainty == pytest.approx(SAFETY * still_to_come)


def test_short_sequences_promise_nothing():
    assert math.isinf(estimate([1.0], RESOLUTIONS[:1]).uncertainty)
    assert estimate([1.0, 1.5], RESOLUTIONS[:2]).uncertainty == pytest.approx(0.5)
    assert estimate([2.0, 2.0, 2.0], RESOLUTIONS).uncertainty == 0.0
