"""Rates and limits of sequences whose rate and limit are known."""

import numpy as np
import pytest

from shellbench.protocol.limit import limit_of
from shellbench.testing.convergence import Refinement, judge, slope, spread_out

UNKNOWNS = np.array([100.0, 400.0, 1600.0, 6400.0])


def levels(values, unknowns=UNKNOWNS):
    return [Refinement({}, int(n), v) for n, v in zip(unknowns, values, strict=True)]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_order_is_the_exponent_of_the_spacing(order):
    errors = 3.0 * UNKNOWNS ** (-order / 2)
    assert slope(UNKNOWNS, errors) == pytest.approx(order)
    assert limit_of(UNKNOWNS**-0.5, 5 + errors).value == pytest.approx(5, abs=1e-3 * errors[-1])
    verdict = judge(levels(5 + errors), 5.0)
    assert verdict.status == "passed"
    assert f"order {order:.1f}" in verdict.words


def test_another_limit_is_said_and_is_no_pass():
    verdict = judge(levels(5 + UNKNOWNS**-1.0), 4.0)
    assert verdict.status == "not shown"
    assert "converges to 5, known is 4" in verdict.words


def test_errors_that_grow_or_stay_fail():
    assert judge(levels([1.0, 1.1, 1.3, 1.8]), 0.5).status == "failed"
    assert judge(levels([1.0, 1.0, 1.0, 1.0]), 0.5).status == "failed"
    assert judge(levels([1.0, 2.0, 1.0, 2.0]), None).status == "failed"


def test_exact_answers_pass():
    assert judge(levels([2.0, 2.0, 2.0, 2.0]), 2.0).status == "passed"


def test_without_a_known_value_steps_must_fall():
    assert judge(levels(5 + UNKNOWNS**-1.0), None).status == "passed"


def test_unknowns_that_do_not_grow_show_no_rate():
    assert judge(levels([1.0, 2.0, 3.0], [10, 10, 10]), 3.0).status == "not shown"


def test_a_few_refinements_are_chosen_about_equal_factors_apart():
    sweep = [{"cells": [n, n], "order": 2} for n in (2, 3, 4, 6, 8, 12, 15, 16, 24, 32)]
    assert [s["cells"][0] for s in spread_out(sweep, 5)] == [2, 4, 8, 16, 32]
    assert spread_out(sweep[:3], 5) == sweep[:3]
