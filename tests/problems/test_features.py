"""Bounds of formulas on cells: never inside of what samples find, and no narrow part is missed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.problems.expression import Expression
from shellbench.problems.features import MOST_CELLS, boxes_of, divided
from shellbench.problems.formula_functions import FUNCTIONS
from shellbench.problems.kinks import kink_lines
from shellbench.problems.smoothness import bad_place

UNIT = ((0.0, 1.0), (0.0, 1.0))


def read(text: str) -> Expression:
    return Expression(text, ("xi1", "xi2", "t"), piecewise=True)


LEAVES = st.sampled_from(["xi1", "xi2", "(xi1 - 0.37)", "(xi1*xi2 + 0.2)", "2.5", "0.3"])


def _more(inner):
    two = st.tuples(inner, inner)
    return st.one_of(
        two.map("({0[0]} + {0[1]})".format),
        two.map("({0[0]} - {0[1]})".format),
        two.map("({0[0]}*{0[1]})".format),
        two.map("({0[0]}/{0[1]})".format),
        st.tuples(inner, st.sampled_from(["2", "3", "-1", "-2", "0.5", "1.5", "-0.5", "17"])).map(
            "({0[0]})**{0[1]}".format
        ),
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), inner).map("{0[0]}({0[1]})".format),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner).map("{0[0]}({0[1]}, {0[2]})".format),
        inner.map("abs({})".format),
        st.tuples(inner, inner, inner).map("where({0[0]} < {0[1]}, {0[2]}, {0[0]})".format),
        two.map("(1.3 + {0[0]}**2)**({0[1]})".format),
    )


@settings(deadline=None, max_examples=30)
@given(st.recursive(LEAVES, _more, max_leaves=6), st.integers(0, 2**32 - 1))
def test_samples_are_never_outside_of_the_bounds(text, seed):
    formula, random = read(text), np.random.default_rng(seed)
    low = random.uniform(-1.0, 1.0, (8, 2))
    high = low + random.uniform(0, 1, (8, 2)) ** 8
    points = low[:, None] + random.uniform(0, 1, (8, 8, 2)) * (high - low)[:, None]
    points[:, 0], points[:, 1] = low, high
    samples = formula.derivatives(points, 4)
    factorial = 1.0
    for order in range(5):
        factorial *= max(order, 1)
        for axis, name in enumerate(("xi1", "xi2")):
            bounds = formula.enclosed(boxes_of(low, high, 1.0), name, 4)[order]
            found = samples[(order, 0) if axis == 0 else (0, order)] / factorial
            slack = 1e-9 * np.abs(found) + 1e-280
            with np.errstate(invalid="ignore"):  # what is no number is no sample
                outside = (found < bounds.low[:, None] - slack) | (found > bounds.high[:, None] + slack)
            # derivatives at a kink or jump are those of one of its sides
            assert not outside.any(), (text, order, name)


@pytest.mark.sampled(11)
@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize(
    ("text", "measure"),
    [
        ("1 + exp(-((xi1 - {a})/{w})**2 - ((xi2 - {b})/{w})**2)/{w}**2", "integral"),
        ("1/(1 + ((xi1 - {a})/{w})**2)/{w}", "integral"),
        ("(1 + tanh((xi1 - {a})/{w}))*xi2", "integral"),
        ("1/(1 - 0.99*exp(-((xi1 - {a})/{w})**2))**6 + 1", "integral"),
        ("xi1*xi2 + {w}*exp(-((xi1 - {a})/{w})**2)", "curvature"),
    ],
)
@pytest.mark.parametrize("place", [(0.37193, 0.61907), (2**-0.5, 1 / 7)])
def test_what_is_narrow_is_found_wherever_it_is(text, measure, width, place):
    found = divided([([read(text.format(a=place[0], b=place[1], w=width))], 1.0)], UNIT, measure)
    at, length = found.peaks((0,), 1 / 64)[0]
    resolved = max(2 * width, 2e-5)  # of a step, what is less is below the tolerance
    assert found.undecided is None
    assert abs(at[0] - place[0]) < (resolved if "tanh" in text else 2 * width)
    assert width / 300 < length < (resolved if "tanh" in text else 2 * width)


def test_cells_tell_the_integral_to_the_tolerance():
    formula = read("1 + exp(-((xi1 - 0.371)/1e-4)**2 - ((xi2 - 0.617)/1e-3)**2)/(pi*1e-7)")
    origins, sizes = divided([([formula], 1.0)], UNIT).parts(
        (np.linspace(0, 1, 6), np.linspace(0, 1, 4)), (False, False)
    )
    assert np.prod(sizes, axis=1).sum() == pytest.approx(1.0)
    x, w = np.polynomial.legendre.leggauss(6)
    unit = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2) / 2 + 0.5
    values = formula.derivatives(origins[:, None] + unit * sizes[:, None], 0)[0, 0]
    assert np.sum(values * np.outer(w, w).ravel() / 4 * np.prod(sizes, axis=1)[:, None]) == pytest.approx(2, rel=1e-5)


@pytest.mark.parametrize("text", ["exp(-((xi1 - xi2)/1e-6)**2)/1e-6", "abs(sin(1e6*xi1))*xi2"])
def test_what_no_cells_tell_is_undecided(text):
    found = divided([([read(text)], 1.0)], UNIT)
    assert found.undecided is not None
    assert len(found.low) <= MOST_CELLS


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("1/(xi1 - 0.37)", 0.37),
        ("xi2 + 1/(xi1 - 0.37)**2", 0.37),
        ("log(xi1 - 0.37)", None),
        ("sqrt((xi1 - 0.37)**2 - 1e-16)", 0.37),
        ("tan(pi*(xi1 + 0.13))", 0.37),
        ("1/abs(xi1 - 0.37)**0.5", "finite"),  # has an integral
        ("where(abs(xi1 - 0.37) < 1e-9, 1e9, 0)", "finite"),
        ("sqrt(1 - xi1**2)", "finite"),
    ],
)
def test_poles_between_samples_are_found(text, place):
    found = bad_place(read(text), UNIT)
    assert (found is None) == (place == "finite")
    if isinstance(place, float):
        assert found[0] == pytest.approx(place, abs=1e-6)


@pytest.mark.parametrize("low", [np.pi / 2, np.nextafter(np.pi / 2, 0), 1.5, 65 * np.pi / 2])
def test_a_pole_at_an_end_of_cells_is_no_bound(low):
    boxes = boxes_of(np.array([[low, 0.0]]), np.array([[low + 0.3, 1.0]]), 1.0)
    (bounds,) = read("tan(xi1)").enclosed(boxes)
    assert (bounds.low[0], bounds.high[0]) == (-np.inf, np.inf)


def test_nothing_is_known_of_what_is_no_number_anywhere():
    (bounds,) = read("log(0 - 1)*xi1").enclosed(boxes_of(np.zeros((1, 2)), np.ones((1, 2)), 1.0))
    assert not np.isfinite(bounds.size).any()


def test_a_factor_that_is_zero_between_samples_is_not_positive():
    found = bad_place(read("1 - exp(-((xi1 - 0.3719)/1e-7)**2)"), UNIT, 0.0)
    assert found[0] == pytest.approx(0.3719, abs=1e-6)


def test_rivals_of_a_call_grow_as_its_arguments_do():
    formula = read(f"min({', '.join(f'xi1 + {k}' for k in range(2000))})")
    assert [len(rivals) for rivals in formula.rivals] == [2000]
    assert kink_lines(read(f"min({', '.join(f'{k}*xi1 + {(20 - k) ** 2}/40' for k in range(20))})"), UNIT)[0] != []
    assert kink_lines(formula, UNIT) == ([], [])
