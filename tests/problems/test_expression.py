"""Formulas: only what is allowed is read, and derivatives are exact."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.errors import InputError
from shellbench.problems.expression import MAX_LENGTH, Expression
from shellbench.problems.formula_functions import FUNCTIONS
from shellbench.problems.kinks import kink_lines

# Coordinates in the interior of every function's domain.
POINTS = np.array([[0.31, 0.57], [0.62, 0.41], [0.45, 0.73]])


def central_differences(expression: Expression, step: float = 1e-3) -> dict[tuple[int, int], np.ndarray]:
    """First to third derivatives by differences of the next lower exact ones."""
    lower = expression.derivatives
    first, second = np.array([step, 0.0]), np.array([0.0, step])
    result = {}
    for i, j in [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]:
        offset, key = (first, (i - 1, j)) if i else (second, (i, j - 1))
        values = [lower(POINTS + k * offset, 3)[key] for k in (-2, -1, 1, 2)]
        result[i, j] = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
    return result


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function_has_the_derivatives_of_its_values(name):
    expression = Expression(f"{name}(0.3*xi1 + 0.5*xi2**2 + 0.1*xi1*xi2)")
    exact = expression.derivatives(POINTS, order=3)
    assert np.allclose(exact[0, 0], [getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "asinh":
                       "arcsinh"}.get(name, name))(0.3 * a + 0.5 * b**2 + 0.1 * a * b) for a, b in POINTS])  # fmt: skip
    for key, difference in central_differences(expression).items():
        assert np.allclose(exact[key], difference, rtol=1e-8, atol=1e-9), key


@pytest.mark.parametrize(
    "text", ["xi1/xi2", "xi1**xi2", "xi1**-2", "2**xi1", "(xi1 + 1)**2.5", "-xi1 + +xi2", "R*cos(xi1)/(1 + xi2**3)"]
)
def test_operators_have_the_derivatives_of_their_values(text):
    expression = Expression(text, constants={"R": 2.5})
    names = {"cos": np.cos, "R": 2.5}
    exact = expression.derivatives(POINTS, order=3)
    assert np.allclose(exact[0, 0], [eval(text, {**names, "xi1": a, "xi2": b}) for a, b in POINTS])
    for key, difference in central_differences(expression).items():
        assert np.allclose(exact[key], difference, rtol=1e-8, atol=1e-9), key


def test_mixed_derivatives_of_a_monomial():
    derivatives = Expression("xi1**3 * xi2**2").derivatives(np.array([2.0, 5.0]), order=4)
    assert derivatives[2, 1] == pytest.approx(6 * 2.0 * 2 * 5.0)
    assert derivatives[3, 0] == pytest.approx(6 * 25.0)
    assert derivatives[2, 2] == pytest.approx(6 * 2.0 * 2)
    assert derivatives[0, 3] == 0


def test_a_whole_power_of_zero_has_finite_derivatives():
    derivatives = Expression("xi1**2").derivatives(np.array([0.0, 0.0]), order=3)
    assert [float(derivatives[key]) for key in [(0, 0), (1, 0), (2, 0), (3, 0)]] == [0, 0, 2, 0]


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')", "().__class__", "xi1.real", "lambda: 1", "[xi1]", "xi1 if xi2 else 0", "xi1 and xi2",
        "open('x')", "cos(xi1, xi2)", "cos(x=xi1)", "cos(*xi1)", "abs(xi1)", "'text'", "1j", "True", "f'{xi1}'", "xi3", "xi1 ^ 2",
        "xi1 // 2", "xi1 % 2", "~xi1", "xi1 < 2", "(xi1 := 2)", "", "1 +", "1" * (MAX_LENGTH + 1), "1e999", "9" * 400, "(" * 400, "-" * 499 + "1",
        "cos", "xi1;xi2", "xi1\nxi2", "\x00",
    ],
)  # fmt: skip
def test_anything_but_a_formula_is_refused_in_one_sentence(text):
    with pytest.raises(InputError) as caught:
        Expression(text)
    assert "Traceback" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["-" * MAX_LENGTH, "1" + "+1" * (MAX_LENGTH // 2 - 1), "2" + "**2" * (MAX_LENGTH // 3 - 1), "sin(" * 4000, "1" * MAX_LENGTH]
)  # fmt: skip
def test_the_longest_formulas_are_refused_where_they_are_too_deep(text):
    """The parser of Python ends in one of three exceptions, by its version."""
    with pytest.raises(InputError):
        Expression(text)


def test_a_long_polynomial_is_read():
    """The load of a manufactured solution: hundreds of coefficients, nested in two coordinates."""
    rng = np.random.default_rng(0)
    coefficients = rng.normal(size=(18, 18))
    rows = [
        "".join(f"{c!r}+xi2*(" for c in row[:-1].tolist()) + repr(float(row[-1])) + ")" * 17 for row in coefficients
    ]
    text = "".join(f"{row}+xi1*(" for row in rows[:-1]) + rows[-1] + ")" * 17
    assert len(text) > 5000
    found = Expression(text).derivatives(POINTS, order=1)
    for key in ((0, 0), (1, 0), (0, 1)):
        terms = coefficients
        for axis, count in enumerate(key):
            terms = np.polynomial.polynomial.polyder(terms, count, axis=axis)
        np.testing.assert_allclose(found[key], np.polynomial.polynomial.polyval2d(*POINTS.T, terms), rtol=1e-12)


@given(st.text(max_size=60))
def test_any_text_is_a_formula_or_a_clear_refusal(text):
    try:
        expression = Expression(text)
    except InputError:
        return
    assert expression.derivatives(POINTS, order=1)[0, 0].shape == (3,)


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_product_rule_agrees_with_expansion(a, b):
    point = np.array([a, b])
    product = Expression("(xi1 + 2*xi2)*(xi1 - xi2)").derivatives(point, order=2)
    expanded = Expression("xi1**2 + xi1*xi2 - 2*xi2**2").derivatives(point, order=2)
    for key in product:
        assert math.isclose(product[key], expanded[key], rel_tol=1e-12, abs_tol=1e-12)


@pytest.mark.parametrize(
    ("text", "smooth"),  # the same function beside the points, from a formula without kinks
    [
        ("min(xi1, xi2)", "xi1"),
        ("max(xi1*xi2, xi2**2, 0.1)", "xi2**2"),
        ("abs(xi1 - 2)*xi2", "(2 - xi1)*xi2"),
        ("where(xi1 + 1 >= xi2, exp(xi1), log(xi1))", "exp(xi1)"),
        ("where(xi1 > 5, 1, xi2**3) + where(xi1 <= 5, 1, 2)", "xi2**3 + 1"),
    ],
)
def test_a_piece_has_the_derivatives_of_its_formula(text, smooth):
    points = POINTS[[0, 2]]  # where xi1 < xi2
    found, expected = (Expression(t, piecewise=True).derivatives(points, 3) for t in (text, smooth))
    for key, value in expected.items():
        assert found[key] == pytest.approx(value), key


@pytest.mark.parametrize("text", ["abs(xi1)", "min(xi1, 2)", "where(xi1 < 1, 2, 3)"])
def test_kinks_are_read_only_where_they_may_be(text):
    with pytest.raises(InputError, match="has kinks: it may stand in"):
        Expression(text)
    assert Expression(text, piecewise=True).rivals


@pytest.mark.parametrize("width", [0.1, 1e-4, 1e-7])
@pytest.mark.parametrize("text", ["where(abs(xi1 - 0.3) < {w}, 1, 0)", "max(0, min(xi1 - 0.3 + {w}, 0.3 + {w} - xi1))"])
def test_kinks_of_a_narrow_part_are_found_from_those_of_what_stands_inside(text, width):
    first, second = kink_lines(Expression(text.format(w=width), piecewise=True), ((0.0, 1.0), (0.0, 1.0)))
    assert sorted(first) == pytest.approx([0.3 - width, 0.3, 0.3 + width], abs=1e-14)
    assert second == []


def test_a_formula_of_many_lines_is_what_it_says():
    text = "(sin(xi1) # once\n + sin(xi1) +\n cos(xi2 *\n xi1) - cos(xi2 *\n  xi1))"
    assert Expression(text).derivatives(np.array([0.3, 0.7]), order=0)[0, 0] == pytest.approx(2 * math.sin(0.3))
    for broken in ("1 # one\n + 2", "1\n + 2"):
        with pytest.raises(InputError, match="is not a formula"):
            Expression(broken)
