"""Formulas in case files: parsed by an allow-list and differentiated exactly.

A formula such as ``R*cos(xi1) + 0.1*xi2**2`` is read into a small tree of allowed operations; nothing is
ever evaluated as Python. Its derivatives are exact: the tree is evaluated on truncated Taylor series in
(xi1, xi2) instead of on numbers (Griewank & Walther, Evaluating Derivatives, 2nd ed., chapter 13), so that
one pass yields the value and all partial derivatives up to the order asked for.

    >>> radius = Expression("R*cos(xi1)", variables=("xi1", "xi2"), constants={"R": 2.0})
    >>> series = radius.series({"xi1": Taylor.variable(0.0, axis=0, order=2)}, order=2)
    >>> float(series.derivative(2, 0))
    -2.0
"""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError

MAX_LENGTH = 100_000  # characters: the longest formula that is read
MAX_DEPTH = 200  # deepest nesting of a formula that is read
MAX_EXPONENT = 16  # largest whole power that is expanded by multiplication

Array = NDArray[np.float64]


class Taylor:
    """A truncated Taylor series in (xi1, xi2) at each of many points.

    Parameters
    ----------
    terms
        Coefficients by (i, j): the factor of d1**i d2**j, that is, the partial derivative over i! j!.
        Each has the shape of the points, or broadcasts to it. Absent terms are zero.
    order
        Terms with i + j > order are dropped.
    """

    __slots__ = ("order", "terms")

    def __init__(self, terms: Mapping[tuple[int, int], Array], order: int) -> None:
        self.terms = dict(terms)
        self.order = order

    @classmethod
    def constant(cls, value: ArrayLike, order: int) -> Taylor:
        """Return the series of a constant."""
        return cls({(0, 0): np.asarray(value, dtype=float)}, order)

    @classmethod
    def variable(cls, value: ArrayLike, axis: int, order: int) -> Taylor:
        """Return the series of the coordinate xi1 (axis 0) or xi2 (axis 1) at `value`."""
        unit = (1, 0) if axis == 0 else (0, 1)
        terms = {(0, 0): np.asarray(value, dtype=float)}
        if order > 0:
            terms[unit] = np.asarray(1.0)
        return cls(terms, order)

    @property
    def value(self) -> Array:
        """The constant term."""
        return self.terms.get((0, 0), np.asarray(0.0))

    def derivative(self, i: int, j: int) -> Array:
        """Return the partial derivative, i times in xi1 and j times in xi2."""
        return self.terms.get((i, j), np.asarray(0.0)) * (math.factorial(i) * math.factorial(j))

    def __add__(self, other: Taylor) -> Taylor:
        terms = dict(self.terms)
        for key, term in other.terms.items():
            terms[key] = terms[key] + term if key in terms else term
        return Taylor(terms, self.order)

    def __neg__(self) -> Taylor:
        return Taylor({key: -term for key, term in self.terms.items()}, self.order)

    def __sub__(self, other: Taylor) -> Taylor:
        return self + (-other)

    def __mul__(self, other: Taylor) -> Taylor:
        terms: dict[tuple[int, int], Array] = {}
        for (i, j), a in self.terms.items():
            for (k, m), b in other.terms.items():
                if i + j + k + m <= self.order:
                    key = (i + k, j + m)
                    terms[key] = terms[key] + a * b if key in terms else a * b
        return Taylor(terms, self.order)

    def __truediv__(self, other: Taylor) -> Taylor:
        return self * other.compose(_reciprocal)

    def compose(self, outer: Callable[[Array, int], list[Array]]) -> Taylor:
        """Return outer(self), `outer` giving the scaled derivatives g, g', g''/2!, ... at the value."""
        coefficients = outer(self.value, self.order)
        increment = Taylor({k: t for k, t in self.terms.items() if k != (0, 0)}, self.order)
        result = Taylor.constant(coefficients[-1], self.order)
        for coefficient in reversed(coefficients[:-1]):
            result = result * increment + Taylor.constant(coefficient, self.order)
        return result

    def power(self, exponent: Taylor) -> Taylor:
        """Return self**exponent; a whole constant exponent is also right for a base of zero."""
        constant = len(exponent.terms) == 1 and exponent.value.ndim == 0
        number = float(exponent.value) if constant else math.nan
        if constant and number.is_integer() and abs(number) <= MAX_EXPONENT:
            result = Taylor.constant(1.0, self.order)
            for _ in range(abs(int(number))):
                result = result * self
            return result if number >= 0 else Taylor.constant(1.0, self.order) / result
        if constant:
            return self.compose(lambda v, n: _power(v, number, n))
        return (exponent * self.compose(_log)).compose(_exp)


def _scaled(derivatives: list[Array]) -> list[Array]:
    return [d / math.factorial(k) for k, d in enumerate(derivatives)]


def _reciprocal(v: Array, order: int) -> list[Array]:
    return [(-1.0) ** k / v ** (k + 1) for k in range(order + 1)]


def _power(v: Array, p: float, order: int) -> list[Array]:
    factors = np.cumprod([1.0, *(p - k for k in range(order))])
    return _scaled([f * v ** (p - k) for k, f in enumerate(factors)])


def _exp(v: Array, order: int) -> list[Array]:
    return _scaled([np.exp(v)] * (order + 1))


def _log(v: Array, order: int) -> list[Array]:
    return [np.log(v), *((-1.0) ** (k + 1) / (k * v**k) for k in range(1, order + 1))]


def _sin(v: Array, order: int) -> list[Array]:
    return _scaled([np.sin(v + k * math.pi / 2) for k in range(order + 1)])


def _cos(v: Array, order: int) -> list[Array]:
    return _scaled([np.cos(v + k * math.pi / 2) for k in range(order + 1)])


def _sinh(v: Array, order: int) -> list[Array]:
    return _scaled([(np.sinh, np.cosh)[k % 2](v) for k in range(order + 1)])


def _cosh(v: Array, order: int) -> list[Array]:
    return _scaled([(np.cosh, np.sinh)[k % 2](v) for k in range(order + 1)])


def _integrated(
    function: Callable[[Array], Array], slope: Callable[[Taylor], Taylor]
) -> Callable[[Array, int], list[Array]]:
    """Scaled derivatives of a function that is known by its value and by the series of its slope."""

    def outer(v: Array, order: int) -> list[Array]:
        series = slope(Taylor.variable(v, axis=0, order=max(order - 1, 0)))
        zero = np.zeros(())
        return [function(v), *(series.terms.get((k, 0), zero) / (k + 1) for k in range(order))]

    return outer


def _one(x: Taylor) -> Taylor:
    return Taylor.constant(1.0, x.order)


def _sqrt(x: Taylor) -> Taylor:
    return x.compose(lambda v, n: _power(v, 0.5, n))


Function = Callable[[Taylor], Taylor]

FUNCTIONS: dict[str, Function] = {
    "sin": lambda x: x.compose(_sin),
    "cos": lambda x: x.compose(_cos),
    "tan": lambda x: x.compose(_sin) / x.compose(_cos),
    "exp": lambda x: x.compose(_exp),
    "log": lambda x: x.compose(_log),
    "sqrt": _sqrt,
    "sinh": lambda x: x.compose(_sinh),
    "cosh": lambda x: x.compose(_cosh),
    "tanh": lambda x: x.compose(_sinh) / x.compose(_cosh),
    "asin": lambda x: x.compose(_integrated(np.arcsin, lambda s: _one(s) / _sqrt(_one(s) - s * s))),
    "acos": lambda x: x.compose(_integrated(np.arccos, lambda s: -_one(s) / _sqrt(_one(s) - s * s))),
    "atan": lambda x: x.compose(_integrated(np.arctan, lambda s: _one(s) / (_one(s) + s * s))),
    "asinh": lambda x: x.compose(_integrated(np.arcsinh, lambda s: _one(s) / _sqrt(_one(s) + s * s))),
}

CONSTANTS = {"pi": math.pi}

_OPERATORS: dict[type[ast.operator], Callable[[Taylor, Taylor], Taylor]] = {
    ast.Add: Taylor.__add__,
    ast.Sub: Taylor.__sub__,
    ast.Mult: Taylor.__mul__,
    ast.Div: Taylor.__truediv__,
    ast.Pow: Taylor.power,
}


class Expression:
    """One formula of a case file.

    Parameters
    ----------
    text
        The formula: numbers, names, + - * / **, parentheses and the functions in `FUNCTIONS`.
    variables
        Names that get their values at evaluation.
    constants
        Named constants of the case file, beside pi.

    Raises
    ------
    InputError
        If the text is anything else than a formula of allowed parts.
    """

    def __init__(
        self,
        text: str | float,
        variables: tuple[str, ...] = ("xi1", "xi2"),
        constants: Mapping[str, float] | None = None,
    ) -> None:
        self.text = str(text)
        self._variables = variables
        self._constants = {**CONSTANTS, **(constants or {})}
        if len(self.text) > MAX_LENGTH:
            raise InputError(f"a formula of {len(self.text)} characters is longer than the {MAX_LENGTH} allowed")
        try:
            self._tree = ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise InputError(f"'{self.text}' is not a formula") from None
        self._check(self._tree, depth=0)

    def depends_on(self, variable: str) -> bool:
        """Tell whether a variable stands in the formula."""
        return any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(self._tree))

    def _check(self, node: ast.AST, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise InputError(f"'{self.text[:40]}...' is nested more than {MAX_DEPTH} levels deep")
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                if abs(number) > sys.float_info.max:
                    raise InputError(f"'{self.text}' holds a number that is too large")
            case ast.Name(id=name):
                if name not in self._variables and name not in self._constants:
                    known = ", ".join([*self._variables, *sorted(self._constants)])
                    raise InputError(f"'{self.text}' uses the unknown name '{name}'; known are {known}")
            case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
                self._check(operand, depth + 1)
            case ast.BinOp(op=ast.BitXor()):
                raise InputError(f"'{self.text}': write ** for a power, not ^")
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
                self._check(left, depth + 1)
                self._check(right, depth + 1)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
                self._check(argument, depth + 1)
            case ast.Call(func=ast.Name(id=name)):
                raise InputError(
                    f"'{self.text}' calls '{name}' in a way that is not allowed;"
                    f" functions of one argument are {', '.join(FUNCTIONS)}"
                )
            case _:
                raise InputError(
                    f"'{self.text}' is not a formula:"
                    " only numbers, names, + - * / **, parentheses and functions are allowed"
                )

    def series(self, values: Mapping[str, Taylor], order: int) -> Taylor:
        """Return the Taylor series of the formula; variables without a value are an error."""
        with np.errstate(all="ignore"):
            return self._evaluate(self._tree, values, order)

    def _evaluate(self, node: ast.AST, values: Mapping[str, Taylor], order: int) -> Taylor:
        match node:
            case ast.Constant(value=number):
                return Taylor.constant(float(number), order)  # type: ignore[arg-type]
            case ast.Name(id=name):
                if name in self._constants:
                    return Taylor.constant(self._constants[name], order)
                return values[name]
            case ast.UnaryOp(op=operator, operand=operand):
                inner = self._evaluate(operand, values, order)
                return -inner if isinstance(operator, ast.USub) else inner
            case ast.BinOp(left=left, op=operator, right=right):
                operation = _OPERATORS[type(operator)]
                return operation(self._evaluate(left, values, order), self._evaluate(right, values, order))
            case ast.Call(func=ast.Name(id=name), args=[argument]):
                return FUNCTIONS[name](self._evaluate(argument, values, order))
        raise AssertionError("unreachable: the tree was checked at construction")

    def derivatives(self, points: ArrayLike, order: int, t: float = 1.0) -> dict[tuple[int, int], Array]:
        """Return all partial derivatives at the points.

        Parameters
        ----------
        points
            (..., 2) curvilinear coordinates; angles in radians.
        order
            Highest total order of derivatives.
        t
            Value of the variable t, if the formula has it.

        Returns
        -------
        dict
            (i, j) -> (...) derivative i times in xi1 and j times in xi2.
        """
        xi = np.asarray(points, dtype=float)
        series = self.series(
            {
                "xi1": Taylor.variable(xi[..., 0], axis=0, order=order),
                "xi2": Taylor.variable(xi[..., 1], axis=1, order=order),
                "t": Taylor.constant(t, order),
            },
            order,
        )
        shape = xi.shape[:-1]
        return {
            (i, total - i): np.broadcast_to(series.derivative(i, total - i), shape)
            for total in range(order + 1)
            for i in range(total, -1, -1)
        }

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"
