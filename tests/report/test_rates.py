import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.report.rates import fitted_rate

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
