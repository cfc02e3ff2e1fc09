"""Limits of made-up series whose limit and rate are known."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.protocol.limit import limit_of


@given(st.floats(0.5, 6), st.floats(-3, 3), st.floats(-0.3, 0.3), st.integers(3, 5))
def test_the_stated_uncertainty_covers_a_series_with_a_second_term(rate, size, second, count):
    steps = [2.0**-k for k in range(count)]
    values = [1 + 0.1 * size * h**rate * (1 + second * h) for h in steps]
    found = limit_of(steps, values)
    assert abs(found.value - 1) <= 2 * found.uncertainty + 1e-9
    assert found.uncertainty >= 0.0999 * abs(values[-1] - values[-2])  # steep rates included
    if found.rate is not None and abs(size) > 0.01 and abs(second) < 0.02:
        assert found.rate == pytest.approx(rate, abs=0.4)


def test_a_series_without_a_limit_is_given_its_spread():
    found = limit_of([4, 2, 1], [1.0, 2.0, 1.5])
    assert (found.value, found.uncertainty, found.rate) == (1.5, 1.0, None)
    assert limit_of([2, 1], [1.0, 1.3]).value == pytest.approx(1.4)
    assert math.isinf(limit_of([1], [2.0]).uncertainty)
    assert limit_of([3, 2, 1], [2.0, 2.0, 2.0]).uncertainty == pytest.approx(0, abs=1e-11)
