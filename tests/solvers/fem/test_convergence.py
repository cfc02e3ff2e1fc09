"""Extrapolation of sequences whose limit is known."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problems.shell.case import Case
from shellbench.solvers.fem.mesh.convergence import ASYMPTOTIC, SAFETY, UNSEEN, estimate
from shellbench.solvers.fem.solver import FemSettings, FemSolver

RESOLUTIONS = (8.0, 11.0, 16.0)


GROWING = tuple(8 * 2 ** (k / 2) for k in range(6))  # as the solver's meshes grow


@pytest.mark.parametrize("rate", [0.4, 1.0, 1.5, 2.0, 4.0, 5.5])
def test_a_power_law_is_extrapolated_exactly(rate):
    values = [3.0 + 0.7 * n**-rate for n in RESOLUTIONS]
    found = estimate(values, RESOLUTIONS)
    assert found.extrapolated == pytest.approx(3.0, abs=1e-10)
    assert found.rate == pytest.approx(rate, rel=1e-6)
    if rate <= ASYMPTOTIC:
        assert found.uncertainty == pytest.approx(SAFETY * abs(values[-1] - 3.0), rel=1e-6)
    else:
        assert found.uncertainty > SAFETY * abs(values[-1] - 3.0)


@pytest.mark.parametrize("rate", [0.2, 0.4, 1.0])
def test_the_tail_of_a_slow_rate_is_counted(rate):
    # the last change is a small part of what is still to come: r / (1 - r) of it, r = 2^(-rate / 2)
    values = [1.0 - n**-rate for n in GROWING]
    change, ratio = values[-1] - values[-2], 2 ** (-rate / 2)
    still_to_come = change * ratio / (1 - ratio)
    assert still_to_come == pytest.approx(1.0 - values[-1])
    assert still_to_come > 2 * change
    assert estimate(values, GROWING).uncertainty == pytest.approx(SAFETY * still_to_come)


def test_two_values_know_of_a_slow_rate_if_they_are_told():
    values = [1.0 - n**-0.4 for n in GROWING[:2]]
    assert estimate(values, GROWING[:2], fastest=0.4).uncertainty == pytest.approx(1.0 - values[-1])
    assert estimate(values, GROWING[:2]).uncertainty < 0.3 * (1.0 - values[-1])


def test_no_rate_is_believed_that_is_faster_than_the_given_one():
    # a corner's slow part shows late: values that seem to converge fast go on at its rate
    values = [1.0 - 2 * n**-5.0 - 1e-4 * n**-0.4 for n in GROWING[:3]]
    assert estimate(values, GROWING[:3]).uncertainty < abs(1.0 - values[-1])
    assert estimate(values, GROWING[:3], fastest=0.4).uncertainty > abs(1.0 - values[-1])


def test_faster_than_believed_is_not_believed():
    values = [3.0 + 7.0 * n**-9.0 for n in RESOLUTIONS]
    found = estimate(values, RESOLUTIONS)
    assert found.rate is None
    assert found.uncertainty >= SAFETY * abs(values[2] - values[1]) / ((16 / 11) ** ASYMPTOTIC - 1)
    assert found.uncertainty > abs(values[-1] - 3.0)


@given(
    sign=st.sampled_from([-1.0, 1.0]), rate=st.floats(2.0, 4.0), other=st.floats(4.5, 6.0), zero=st.floats(2.0, 3.99)
)
def test_an_error_that_passes_through_zero_is_still_covered(sign, rate, other, zero):
    # two terms of opposite signs that cancel on or close before the last mesh, where the last change is small
    meshes = GROWING[:5]
    at = 8 * 2 ** (zero / 2)
    errors = [sign * (n**-rate - at ** (other - rate) * n**-other) for n in meshes]
    found = estimate([2.0 + e for e in errors], meshes, fastest=rate)
    assert abs(errors[-1]) <= 2 * found.uncertainty


@given(sign=st.sampled_from([-1.0, 1.0]), share=st.floats(0.05, 0.2))
def test_two_small_changes_that_differ_in_sign_do_not_count_alone(sign, share):
    # errors stay below C n^-4, and are alike on the last three meshes by accident
    meshes = GROWING[:4]
    errors = [sign * e * meshes[-1] ** -4.0 for e in (-20.0, share, 1.01 * share, 1.005 * share)]
    found = estimate([2.0 + e for e in errors], meshes, fastest=4.0)
    assert abs(errors[-1]) <= 2 * found.uncertainty


def test_what_does_not_settle_is_not_extrapolated():
    found = estimate([1.0, 1.1, 1.3], RESOLUTIONS)
    assert (found.extrapolated, found.rate) == (1.3, None)
    assert found.uncertainty >= 0.3


def test_a_small_step_back_does_not_count_alone():
    found = estimate([1.0, 1.1, 1.09], RESOLUTIONS)
    assert (found.extrapolated, found.rate) == (1.09, None)
    still_to_come = 0.1 / ((11 / 8) ** UNSEEN - 1) * (11 / 16) ** UNSEEN
    assert found.uncertainty == pytest.approx(SAFETY * still_to_come)


def test_short_sequences_promise_nothing():
    assert math.isinf(estimate([1.0], RESOLUTIONS[:1]).uncertainty)
    assert estimate([1.0, 1.5], RESOLUTIONS[:2]).uncertainty == pytest.approx(0.5)
    assert estimate([2.0, 2.0, 2.0], RESOLUTIONS).uncertainty == 0.0


@pytest.mark.long
def test_an_edge_of_contact_at_the_end_of_its_line_is_no_surer_than_it_is_far_from_there():
    # pressed by a tenth of its load, the strip touches with its middle alone, the end of the line of 0.5 m
    whole = named_case("contact_strip_stages").data()
    (asked,) = (q for q in whole["quantities"] if q["name"] == "contact_point_10")
    case = Case.model_validate({**whole, "quantities": [{**asked, "primary": True}]})
    found = FemSolver().solve(case, FemSettings(tolerance=1e-2))
    missing = 0.5 - case.primary.measure(found)
    assert 1e-4 < missing < 5e-3
    assert found.uncertainty["contact_point_10"] >= missing * (1 - 1e-9)
