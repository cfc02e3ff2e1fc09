"""Truncated Taylor series in (xi1, xi2); formulas are evaluated on them, so that their derivatives are exact.

Griewank & Walther, Evaluating Derivatives, 2nd ed., chapter 13.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.interval import Interval, Undecided, is_interval, products

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
        return cls({(0, 0): _term(value)}, order)

    @classmethod
    def variable(cls, value: ArrayLike, axis: int, order: int) -> Taylor:
        """Return the series of the coordinate xi1 (axis 0) or xi2 (axis 1) at `value`."""
        unit = (1, 0) if axis == 0 else (0, 1)
        terms = {(0, 0): _term(value)}
        if order > 0:
            terms[unit] = np.asarray(1.0)
        return cls(terms, order)

    @classmethod
    def _of_value(cls, value: Array) -> Taylor:
        """Return a series of order zero, by a quick path: long formulas of loads cost as much as Python's calls."""
        made = cls.__new__(cls)
        made.terms, made.order = {(0, 0): value}, 0
        return made

    @property
    def value(self) -> Array:
        """The constant term."""
        return self.terms.get((0, 0), np.asarray(0.0))

    def derivative(self, i: int, j: int) -> Array:
        """Return the partial derivative, i times in xi1 and j times in xi2."""
        return self.terms.get((i, j), np.asarray(0.0)) * (math.factorial(i) * math.factorial(j))

    def __add__(self, other: Taylor) -> Taylor:
        if self.order == 0 and self.terms and other.terms:
            return Taylor._of_value(self.terms[0, 0] + other.terms[0, 0])
        terms = dict(self.terms)
        for key, term in other.terms.items():
            terms[key] = terms[key] + term if key in terms else term
        return Taylor(terms, self.order)

    def __neg__(self) -> Taylor:
        return Taylor({key: -term for key, term in self.terms.items()}, self.order)

    def __sub__(self, other: Taylor) -> Taylor:
        return self + (-other)

    def __mul__(self, other: Taylor) -> Taylor:
        if self.order == 0 and self.terms and other.terms:
            return Taylor._of_value(self.terms[0, 0] * other.terms[0, 0])
        if is_interval(*self.terms.values()) and is_interval(*other.terms.values()):
            return self._products(other)
        terms: dict[tuple[int, int], Array] = {}
        for (i, j), a in self.terms.items():
            for (k, m), b in other.terms.items():
                if i + j + k + m <= self.order:
                    key = (i + k, j + m)
                    terms[key] = terms[key] + a * b if key in terms else a * b
        return Taylor(terms, self.order)

    def _products(self, other: Taylor) -> Taylor:
        """Return the product of series of intervals along one variable."""
        rows = products(*([x.terms.get((k, 0), np.zeros(())) for k in range(self.order + 1)] for x in (self, other)))
        terms: dict[tuple[int, int], Any] = {(k, 0): row for k, row in enumerate(rows)}
        # the value keeps the sharper bounds of a square, or of a bound of zero
        return Taylor({**terms, (0, 0): self.value * other.value}, self.order)

    def __truediv__(self, other: Taylor) -> Taylor:
        return self * other.compose(_reciprocal)

    def chosen(
        self, other: Taylor, mask: NDArray[np.bool_] | Undecided, compared: Sequence[Taylor] = (), known: int = 0
    ) -> Taylor:
        """Return this series where the mask of a comparison (`compared`) is true, and the other one elsewhere.

        For intervals either may be chosen: then derivatives up to the order `known` enclose both; others are unbounded.
        """
        zero = np.asarray(0.0)
        keys = self.terms.keys() | other.terms.keys()
        moving = {key for series in compared for key in series.terms} - {(0, 0)}
        if isinstance(mask, Undecided) and moving:
            # a derivative that neither part has is unbounded, too, where one turns into the other
            keys |= {(i * k, j * k) for i, j in moving for k in range(1, self.order + 1) if (i + j) * k <= self.order}
        pairs = {key: (self.terms.get(key, zero), other.terms.get(key, zero)) for key in keys}
        if not isinstance(mask, Undecided) and is_interval(*(term for pair in pairs.values() for term in pair)):
            mask = Undecided(mask, ~mask)  # of numbers alone, and decided
        if isinstance(mask, Undecided):
            chosen = {key: mask.chosen(*pair, not moving or sum(key) <= known) for key, pair in pairs.items()}
            return Taylor(chosen, self.order)  # type: ignore[arg-type]
        return Taylor({key: np.where(mask, *pair) for key, pair in pairs.items()}, self.order)

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
        constant = len(exponent.terms) == 1 and exponent.value.ndim == 0 and not np.iscomplexobj(exponent.value)
        number = float(exponent.value) if constant else math.nan
        if constant and number.is_integer() and is_interval(self.value):
            return self.compose(lambda v, n: _power(v, number, n))
        if constant and number.is_integer() and abs(number) <= MAX_EXPONENT:
            result = Taylor.constant(1.0, self.order)
            for _ in range(abs(int(number))):
                result = result * self
            return result if number >= 0 else Taylor.constant(1.0, self.order) / result
        if constant:
            return self.compose(lambda v, n: _power(v, number, n))
        return (exponent * self.compose(log_terms)).compose(exp_terms)


def _scaled(derivatives: list[Array]) -> list[Array]:
    return [d / math.factorial(k) for k, d in enumerate(derivatives)]


def _reciprocal(v: Array, order: int) -> list[Array]:
    return [(-1.0) ** k / v ** (k + 1) for k in range(order + 1)]


def _term(value: ArrayLike | Interval) -> Array:
    """Return real or complex numbers as an array; intervals, which stand for arrays, as they are."""
    return value if isinstance(value, Interval) else numbers(value)  # type: ignore[return-value]


def numbers(values: ArrayLike) -> Array:
    """Return values as an array of floating-point numbers; complex ones, of a complex step, stay complex."""
    return np.asarray(values, dtype=complex if np.iscomplexobj(values) else float)


def _power(v: Array, p: float, order: int) -> list[Array]:
    factors = np.cumprod([1.0, *(p - k for k in range(order))])
    return _scaled([f * v ** (p - k) if f else np.zeros(()) for k, f in enumerate(factors)])


def tangent_terms(function: Callable[[Array], Array], sign: float) -> Callable[[Array, int], list[Array]]:
    """Return the scaled derivatives of a function with f' = 1 + sign f^2, from the value on: tan, or tanh with -1."""

    def outer(v: Array, order: int) -> list[Array]:
        found = [function(v)]
        for k in range(order):
            squares = sum((found[i] * found[k - i] for i in range(1, k + 1)), start=found[0] * found[k])
            found.append((sign * squares + (1.0 if k == 0 else 0.0)) / (k + 1))
        return found

    return outer


def exp_terms(v: Array, order: int) -> list[Array]:
    """Return the scaled derivatives of exp, from the value on."""
    return _scaled([np.exp(v)] * (order + 1))


def log_terms(v: Array, order: int) -> list[Array]:
    """Return the scaled derivatives of log, from the value on."""
    return [np.log(v), *((-1.0) ** (k + 1) / (k * v**k) for k in range(1, order + 1))]


def sin_terms(v: Array, order: int) -> list[Array]:
    """Return the scaled derivatives of sin, from the value on."""
    return _scaled([np.sin(v + k * math.pi / 2) for k in range(order + 1)])


def cos_terms(v: Array, order: int) -> list[Array]:
    """Return the scaled derivatives of cos, from the value on."""
    return _scaled([np.cos(v + k * math.pi / 2) for k in range(order + 1)])


def sinh_terms(v: Array, order: int) -> list[Array]:
    """Return the scaled derivatives of sinh, from the value on."""
    return _scaled([(np.sinh, np.cosh)[k % 2](v) for k in range(order + 1)])


def cosh_terms(v: Array, order: int) -> list[Array]:
    """Return the scaled derivatives of cosh, from the value on."""
    return _scaled([(np.cosh, np.sinh)[k % 2](v) for k in range(order + 1)])


def integrated(
    function: Callable[[Array], Array], slope: Callable[[Taylor], Taylor]
) -> Callable[[Array, int], list[Array]]:
    """Return the scaled derivatives of a function from its value and the series of its slope."""

    def outer(v: Array, order: int) -> list[Array]:
        series = slope(Taylor.variable(v, axis=0, order=max(order - 1, 0)))
        zero = np.zeros(())
        return [function(v), *(series.terms.get((k, 0), zero) / (k + 1) for k in range(order))]

    return outer


def one(x: Taylor) -> Taylor:
    """Return the series of one."""
    return Taylor.constant(1.0, x.order)


def square_root(x: Taylor) -> Taylor:
    """Return the series of the square root."""
    return x.compose(lambda v, n: _power(v, 0.5, n))
