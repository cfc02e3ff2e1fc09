"""Rounding to shorter formats: how much a number errs, whatever its magnitude."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.problem import NumberFormat
from shellbench.problems.shortened import EXPONENT_BYTES, expanded, shortened

UNIT = {"float64": 0.0, "float32": 2.0**-24, "float16": 2.0**-11}  # unit roundoff (IEEE 754-2008, table 3.5)
TINY = 2.0**-39  # of the largest number: half the spacing of subnormals of binary16, 2**-25, against 2**14 and more


@given(
    st.lists(st.floats(-1, 1), min_size=1, max_size=20),
    st.integers(-300, 300),
    st.sampled_from(["float64", "float32", "float16"]),
)
def test_every_number_errs_by_the_unit_roundoff_at_most(
    numbers: list[float], exponent: int, format: NumberFormat
) -> None:
    array = np.ldexp(np.array(numbers), exponent)
    error = np.abs(shortened(array, format).expanded() - array)
    assert np.all(error <= np.maximum(UNIT[format] * np.abs(array), TINY * np.abs(array).max()))


@pytest.mark.parametrize("format", ["float32", "float16"])
def test_rounding_does_not_depend_on_the_unit(format: NumberFormat) -> None:
    array = np.random.default_rng(0).standard_normal((5, 7))
    metres, smaller = (shortened(scale * array, format) for scale in (1.0, 2.0**-33))
    assert np.array_equal(metres.numbers, smaller.numbers)
    assert np.array_equal(metres.expanded(), 2.0**33 * smaller.expanded())


def test_rounding_twice_is_rounding_once() -> None:
    once = shortened(np.random.default_rng(1).standard_normal(50) * 1e-7, "float16").expanded()
    assert np.array_equal(shortened(once, "float16").expanded(), once)


def test_numbers_that_are_short_enough_stay_and_are_not_copied() -> None:
    double, single = np.linspace(0, 1, 7), np.linspace(0, 1, 7, dtype=np.float32)
    assert shortened(double, "float64").expanded() is double
    assert shortened(single, "float64").numbers is single
    assert shortened(single, "float32").numbers is single
    assert expanded(single, 0).dtype == np.float64


def test_bytes_are_those_of_the_numbers_and_of_one_exponent() -> None:
    array = np.full(10, 3e-9)
    assert [shortened(array, f).nbytes for f in ("float64", "float32", "float16")] == [
        80,
        40 + EXPONENT_BYTES,
        20 + EXPONENT_BYTES,
    ]


def test_nothing_and_infinity_are_kept() -> None:
    assert np.array_equal(shortened(np.zeros(3), "float16").expanded(), np.zeros(3))
    assert shortened(np.zeros((0, 3)), "float16").expanded().shape == (0, 3)
    assert np.array_equal(shortened(np.array([1.0, np.inf]), "float16").expanded(), [1.0, np.inf])
