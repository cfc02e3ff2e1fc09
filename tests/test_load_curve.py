"""Load-displacement curves: extrema and passages of curves that are known in closed form."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.problem import Step
from shellbench.protocol.load_curve import Curve


def history(factors, displacements, quantity="w", phase="path"):
    return tuple(
        Step(number, 0.0, 0.0, 1, at=t, quantities={quantity: w}, phase=phase)
        for number, (t, w) in enumerate(zip(factors, displacements, strict=True))
    )


def cubic(n=40, end=3.0):
    """A snap-through: t = w^3 - 4.5 w^2 + 6 w has its maximum 2.5 at w = 1 and its minimum 2 at w = 2."""
    w = np.linspace(0, end, n + 1)
    return Curve(w**3 - 4.5 * w**2 + 6 * w, w)


def looping(n=60, scale=(1.0, 1.0)):
    """A snap-back: a Lissajous arc, t = sin(2 s), w = s + 1.5 sin(s) ... from rest, both with extrema known."""
    s = np.linspace(0, 1.5 * np.pi, n + 1)
    return Curve(scale[0] * np.sin(2 * s), scale[1] * (s + 2 * np.sin(s)))


def test_a_cubic_has_its_turning_points_and_no_more():
    for n, accuracy in ((20, 1e-3), (80, 1e-5)):
        curve = cubic(n)
        assert curve.turning_point("load", 1) == pytest.approx((2.5, 1.0), rel=accuracy)
        assert curve.turning_point("load", 2) == pytest.approx((2.0, 2.0), rel=accuracy)
        with pytest.raises(ValueError, match="has 2 turning points of the load, not 3"):
            curve.turning_point("load", 3)
        with pytest.raises(ValueError, match="has 0 turning points of the displacement, not 1"):
            curve.turning_point("displacement", 1)


def test_a_snap_back_has_its_largest_displacement():
    curve = looping(120)
    s = 2 * np.pi / 3  # where d(s + 2 sin s) = 0
    factor, displacement = curve.turning_point("displacement", 1)
    assert displacement == pytest.approx(s + 2 * np.sin(s), rel=1e-5)
    assert factor == pytest.approx(np.sin(2 * s), rel=1e-3)
    later = 4 * np.pi / 3
    assert curve.turning_point("displacement", 2)[1] == pytest.approx(later + 2 * np.sin(later), rel=1e-4)
    for number, s in enumerate((np.pi / 4, 3 * np.pi / 4, 5 * np.pi / 4), start=1):
        factor, displacement = curve.turning_point("load", number)
        assert factor == pytest.approx(np.sin(2 * s), rel=1e-4)
        assert displacement == pytest.approx(s + 2 * np.sin(s), rel=1e-2)


def test_an_extremum_converges_with_the_fourth_order():
    """A cubic spline's values; with third order at least its extremum's place."""
    errors = [abs(cubic(n).turning_point("load", 1)[0] - 2.5) for n in (11, 22, 44)]
    assert errors[2] < errors[0]
    assert np.log2(errors[0] / errors[2]) / 2 > 3


def test_points_of_the_curve_are_met_exactly():
    curve = cubic(30)
    for t, w in zip(curve.factors[1:], curve.displacements[1:], strict=True):
        assert curve.factor_at(w) == t


def test_a_load_is_read_between_the_points():
    for w in (0.05, 0.77, 1.0001, 1.5, 2.9999):
        assert cubic(60).factor_at(w) == pytest.approx(w**3 - 4.5 * w**2 + 6 * w, rel=1e-4)


def test_a_load_is_read_at_the_first_passage():
    curve = looping(120)
    top = 2 * np.pi / 3 + np.sqrt(3)
    for w in (1.0, 2.5, 3.5):
        s = np.linspace(0, 2 * np.pi / 3, 200_001)
        first = np.sin(2 * np.interp(w, s + 2 * np.sin(s), s))
        assert curve.factor_at(w) == pytest.approx(first, abs=1e-4)
    with pytest.raises(ValueError, match="does not reach the displacement 5"):
        curve.factor_at(5.0)
    assert curve.displacements.max() < top * (1 + 1e-12)


def test_between_two_states_an_overshoot_of_the_spline_is_not_taken():
    """The passage lies between the two states that enclose it, also where the spline swings beyond its points."""
    w = np.array([0.0, 1.0, 2.0, 2.05, 3.0, 3.1])
    t = np.array([0.0, 5.0, 1.0, 6.0, 2.0, 7.0])
    curve = Curve(t, w)
    for value in (0.5, 1.5, 2.02, 2.5, 3.05):
        end = int(np.argmax(w >= value))
        factor = curve.factor_at(value)
        inside = curve._spline(np.linspace(curve._spline.x[end - 1], curve._spline.x[end], 2001))[:, 0]
        assert inside.min() - 1e-9 <= factor <= inside.max() + 1e-9


@settings(max_examples=50, deadline=None)
@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_units_change_nothing_but_the_units(load_unit, displacement_unit):
    base, other = looping(30), looping(30, (load_unit, displacement_unit))
    for of in ("load", "displacement"):
        t, w = base.turning_point(of, 1)
        assert other.turning_point(of, 1) == pytest.approx((t * load_unit, w * displacement_unit), rel=1e-9)
    assert other.factor_at(2.2 * displacement_unit) == pytest.approx(base.factor_at(2.2) * load_unit, rel=1e-9)


def test_a_curve_starts_at_rest_and_takes_the_path_alone():
    t, w = cubic(10).factors[1:], cubic(10).displacements[1:]
    steps = (*history([9.0], [9.0], phase="solve"), *history([8.0], [8.0], quantity="v"), *history(t, w))
    curve = Curve.of(steps, "w")
    assert curve.factors.tolist() == [0.0, *t]
    assert curve.displacements.tolist() == [0.0, *w]


def test_a_state_that_stands_twice_counts_once():
    t, w = cubic(10).factors[1:], cubic(10).displacements[1:]
    repeated = np.repeat(np.arange(10), 2)
    curve = Curve.of(history(t[repeated], w[repeated]), "w")
    assert curve.factors.tolist() == [0.0, *t]
    assert curve.turning_point("load", 1)[0] == pytest.approx(2.5, rel=0.05)


@pytest.mark.parametrize("gap", [1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
def test_states_next_to_each_other_turn_no_curve(gap):
    """A mark may lie next to a step: a spline through both must not swing over what a solve leaves of an error."""
    rng = np.random.default_rng(0)
    for beside in range(3, 40):
        w = cubic(40).displacements[1:]
        w = np.insert(w, beside, w[beside - 1] + 3 * gap)
        t = (w**3 - 4.5 * w**2 + 6 * w) * (1 + 1e-10 * rng.normal(size=len(w)))
        curve = Curve.of(history(t, w), "w")
        assert curve.turning_point("load", 1)[0] == pytest.approx(2.5, rel=1e-4)
        assert curve.turning_point("load", 2)[0] == pytest.approx(2.0, rel=1e-4)
        with pytest.raises(ValueError, match="has 2 turning points"):
            curve.turning_point("load", 3)
        assert curve.factor_at(w[-1]) == t[-1]


@pytest.mark.parametrize("gap", [1e-12, 1e-7])
def test_the_end_of_a_path_is_never_left_out(gap):
    w = np.array([*np.linspace(0.1, 1, 10), 1 + gap])
    curve = Curve.of(history(2 * w, w), "w")
    assert curve.displacements[-1] == w[-1]
    assert curve.factor_at(1 + gap) == 2 * w[-1]
    assert len(curve.factors) == 11


@pytest.mark.parametrize("states", [0, 1, 2])
def test_too_few_states_are_no_curve(states):
    w = np.linspace(0.1, 1, states)
    with pytest.raises(ValueError, match=rf"too few states of the path for a curve \({states}\)"):
        Curve.of(history(w, w), "w")
    with pytest.raises(ValueError, match=r"too few states of the path for a curve \(0\)"):
        Curve.of(history(w, w), "another")


def test_a_straight_path_turns_nowhere():
    w = np.linspace(0, 2, 9)
    curve = Curve(3 * w, w)
    for of in ("load", "displacement"):
        with pytest.raises(ValueError, match=f"has 0 turning points of the {of}, not 1"):
            curve.turning_point(of, 1)
    assert curve.factor_at(1.234) == pytest.approx(3 * 1.234, rel=1e-12)


def test_a_path_that_only_loads_or_only_moves_is_a_curve():
    w = np.linspace(0, 1, 6)
    with pytest.raises(ValueError, match=r"does not reach the displacement 0\.5"):
        Curve(w, 0 * w).factor_at(0.5)
    assert Curve(0 * w, w).factor_at(0.5) == pytest.approx(0.0, abs=1e-15)


def test_a_denser_curve_never_loses_a_turning_point():
    found = [cubic(n).turning_point("load", 1)[0] for n in (9, 18, 36, 72)]
    errors = np.abs(np.array(found) - 2.5)
    assert all(later <= earlier for earlier, later in pairwise(errors))
