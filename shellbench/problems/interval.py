"""Intervals that enclose all values of a formula on a box, also those between samples.

An `Interval` takes the place of arrays of numbers in `Taylor` series, so that one evaluation of a formula encloses its
values, or any of its derivatives, over many boxes at once (Moore, Kearfott & Cloud, Introduction to Interval Analysis,
2009, chapters 5 and 6). NumPy's functions of an interval are those of `_FUNCTIONS`; others are refused.

If an argument leaves the domain of a function, its value is unknown: the interval is then unbounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDED = 2.0**-52  # relative: rounding of one operation, to either side
APPROXIMATED = 2.0**-49  # relative: the same of functions whose last digits are the library's choice


class Interval(NDArrayOperatorsMixin):
    """Intervals [low, high], one for each box; NumPy's functions and operators enclose their own values.

    Attributes
    ----------
    low, high
        (n,) bounds; infinite where there is none.
    """

    __slots__ = ("high", "low")
    ndim = 1

    def __init__(self, low: Array, high: Array) -> None:
        # NaN is an unknown bound
        unknown = np.isnan(low) | np.isnan(high)
        self.low, self.high = (low, high) if not unknown.any() else _without(low, high)

    @property
    def size(self) -> Array:
        """Largest magnitude (n,) in each interval."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def __array_ufunc__(self, function: np.ufunc, method: str, *inputs: Any, **_: Any) -> Any:
        if method != "__call__" or function not in _FUNCTIONS:
            return NotImplemented
        return _FUNCTIONS[function](*inputs)


@dataclass(frozen=True)
class Undecided:
    """A comparison of intervals: where it holds for all of their values, and where for none."""

    holds: NDArray[np.bool_]
    fails: NDArray[np.bool_]

    def chosen(self, first: Any, second: Any, known: bool) -> Interval:
        """Return one or the other; if both are possible, an enclosure of both if that is `known`, else no bounds."""
        one, other = interval_of(first), interval_of(second)
        low = np.minimum(one.low, other.low) if known else -np.inf
        high = np.maximum(one.high, other.high) if known else np.inf
        return Interval(
            np.where(self.holds, one.low, np.where(self.fails, other.low, low)),
            np.where(self.holds, one.high, np.where(self.fails, other.high, high)),
        )


def _without(low: Array, high: Array) -> tuple[Array, Array]:
    return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def interval_of(value: Any) -> Interval:
    """Return numbers as intervals of no width; intervals as they are."""
    return value if isinstance(value, Interval) else Interval(np.asarray(value, float), np.asarray(value, float))


def is_interval(*values: Any) -> bool:
    """Return True if any of the values is an interval."""
    return any(isinstance(value, Interval) for value in values)


def products(first: Sequence[Any], second: Sequence[Any]) -> list[Interval]:
    """Return the first coefficients of the product of two power series with intervals or numbers as coefficients.

    With middles and radii, (a +- r) (b +- s) lies in a b +- (|a| s + r (|b| + s)), for all coefficients at once.
    """
    (a, r), (b, s) = _middles(first), _middles(second)
    size, most = np.abs(a), np.abs(b) + s
    middle, radius = a[0] * b, size[0] * s + r[0] * most
    scale = size[0] * most
    for k in range(1, len(a)):
        middle[k:] += a[k] * b[:-k]
        radius[k:] += size[k] * s[:-k] + r[k] * most[:-k]
        scale[k:] += size[k] * most[:-k]
    radius += (len(a) + 2) * ROUNDED * (scale + radius)
    return [Interval(m - r, m + r) for m, r in zip(middle, radius, strict=True)]


def _middles(values: Sequence[Any]) -> tuple[Array, Array]:
    """Return middles and radii (k, n) of intervals and numbers; no numbers where there are no bounds."""
    width = max(np.size(value.low if is_interval(value) else value) for value in values)
    low, high = np.empty((len(values), width)), np.empty((len(values), width))
    for k, value in enumerate(values):
        low[k], high[k] = (value.low, value.high) if is_interval(value) else (value, value)
    return (low + high) / 2, (high - low) / 2 * (1 + ROUNDED) + ROUNDED * (np.abs(low) + np.abs(high))


def _outward(low: Array, high: Array, rounded: float = ROUNDED) -> Interval:
    return Interval(low - rounded * np.abs(low), high + rounded * np.abs(high))


def _add(a: Any, b: Any) -> Interval:
    x, y = interval_of(a), interval_of(b)
    return _outward(x.low + y.low, x.high + y.high)


def _negative(a: Interval) -> Interval:
    return Interval(-a.high, -a.low)


def _multiply(a: Any, b: Any) -> Interval:
    if a is b:
        return _whole_power(interval_of(a), 2)
    if not is_interval(a):
        a, b = b, a
    if not is_interval(b) and not np.isnan(b).any():  # a number has one bound
        first, second = a.low * b, a.high * b
        low, high = np.fmin(first, second), np.fmax(first, second)
    else:
        b = interval_of(b)
        ends = (a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high)
        low = np.fmin(np.fmin(ends[0], ends[1]), np.fmin(ends[2], ends[3]))
        high = np.fmax(np.fmax(ends[0], ends[1]), np.fmax(ends[2], ends[3]))
    # a product of zero and an infinite bound is zero: the bound itself is not a value
    if (nothing := np.isnan(low)).any():
        low, high = np.where(nothing, 0.0, low), np.where(nothing, 0.0, high)
    return _outward(low, high)


def _reciprocal(a: Any) -> Interval:
    x = interval_of(a)
    inside = (x.low < 0) & (x.high > 0)
    # a bound of zero is reached from the interval's own side
    low = np.where(x.high == 0, -np.inf, 1 / x.high)
    high = np.where(x.low == 0, np.inf, 1 / x.low)
    none = inside | ((x.low == 0) & (x.high == 0))
    return _outward(np.where(none, -np.inf, low), np.where(none, np.inf, high))


def _divide(a: Any, b: Any) -> Interval:
    if not is_interval(b):
        return _multiply(a, 1 / np.asarray(b))
    return _multiply(a, _reciprocal(b))


def _whole_power(x: Interval, exponent: int) -> Interval:
    if exponent <= 0:
        return _reciprocal(_whole_power(x, -exponent)) if exponent else interval_of(np.ones(x.low.shape))
    low, high = x.low**exponent, x.high**exponent
    if exponent % 2 == 0:
        least = np.where((x.low <= 0) & (x.high >= 0), 0.0, np.minimum(low, high))
        low, high = least, np.maximum(low, high)
    return _outward(low, high, max(exponent, 1) * ROUNDED)


def _power(a: Any, b: Any) -> Interval:
    if is_interval(b):
        return _exp(_multiply(b, _log(interval_of(a))))
    exponent = float(b)
    if exponent.is_integer():
        return _whole_power(a, int(exponent))
    return _within(a, 0.0, math.inf, lambda x: x**exponent, exponent > 0)


def _within(x: Interval, least: float, most: float, function: Callable[[Array], Array], rises: bool = True) -> Interval:
    """Enclose a monotone function of [least, most]; without bounds where the interval leaves that."""
    outside = (x.low < least) | (x.high > most)
    at = np.where(outside, np.nan, x.low), np.where(outside, np.nan, x.high)
    low, high = (function(bound) for bound in (at if rises else at[::-1]))
    return _outward(low, high, APPROXIMATED)


def _rising(function: Callable[[Array], Array]) -> Callable[[Interval], Interval]:
    return lambda x: _outward(function(x.low), function(x.high), APPROXIMATED)


_exp = _rising(np.exp)


def _log(x: Interval) -> Interval:
    found = _within(x, 0.0, math.inf, np.log)
    # near 1 the logarithm is as small as the rounding of its argument
    return Interval(found.low - APPROXIMATED, found.high + APPROXIMATED)


def _cosine(x: Interval) -> Interval:
    turn = 2 * math.pi
    slack = 1e-15 * (1 + x.size)  # the turns are known as well as pi is
    ends = np.cos(x.low), np.cos(x.high)
    wide = ~(x.high - x.low < turn) | ~(x.size < 1e15)

    def holds(at: float) -> NDArray[np.bool_]:
        """Return True if at + n turns is inside for some n."""
        return wide | (np.floor((x.high + slack - at) / turn) >= np.ceil((x.low - slack - at) / turn))

    low = np.where(holds(math.pi), -1.0, np.minimum(*ends) - APPROXIMATED)
    high = np.where(holds(0.0), 1.0, np.maximum(*ends) + APPROXIMATED)
    return Interval(np.maximum(low, -1.0), np.minimum(high, 1.0))


def _sine(x: Interval) -> Interval:
    found = _cosine(_add(x, -math.pi / 2))
    slack = 2.0**-51 * (1 + x.size)  # of the quarter of a turn
    slack = np.where(np.isfinite(slack), slack, 0.0)
    exact = (x.low == x.high) & (x.low == 0)
    return Interval(
        np.where(exact, 0.0, np.maximum(found.low - slack, -1.0)),
        np.where(exact, 0.0, np.minimum(found.high + slack, 1.0)),
    )


def _tangent(x: Interval) -> Interval:
    slack = 1e-15 * (1 + x.size)  # poles are known as well as pi is
    pole = np.floor((x.high + slack) / math.pi + 0.5) != np.floor((x.low - slack) / math.pi + 0.5)
    pole |= ~(x.high - x.low < math.pi)
    found = _outward(np.tan(x.low), np.tan(x.high), APPROXIMATED)
    return Interval(np.where(pole, -np.inf, found.low), np.where(pole, np.inf, found.high))


def _magnitude(x: Interval) -> Interval:
    return Interval(np.maximum(np.maximum(x.low, -x.high), 0.0), x.size)


def _least(a: Any, b: Any) -> Interval:
    x, y = interval_of(a), interval_of(b)
    return Interval(np.minimum(x.low, y.low), np.minimum(x.high, y.high))


def _hyperbolic_cosine(x: Interval) -> Interval:
    ends = np.cosh(x.low), np.cosh(x.high)
    inside = (x.low <= 0) & (x.high >= 0)
    return _outward(np.where(inside, 1.0, np.minimum(*ends)), np.maximum(*ends), APPROXIMATED)


def _compared(low: str, high: str, holds: Callable[..., Any]) -> Callable[[Any, Any], Undecided]:
    """Return a comparison: it holds if it does between these ends, and fails if it does not between the others."""

    def compare(a: Any, b: Any) -> Undecided:
        x, y = interval_of(a), interval_of(b)
        return Undecided(holds(getattr(x, low), getattr(y, high)), ~holds(getattr(x, high), getattr(y, low)))

    return compare


_FUNCTIONS: dict[np.ufunc, Callable[..., Any]] = {
    np.add: _add,
    np.subtract: lambda a, b: _add(a, _negative(interval_of(b))),
    np.multiply: _multiply,
    np.divide: _divide,
    np.power: _power,
    np.negative: _negative,
    np.absolute: _magnitude,
    np.minimum: _least,
    np.exp: _exp,
    np.log: _log,
    np.sqrt: lambda x: _power(x, 0.5),
    np.sin: _sine,
    np.cos: _cosine,
    np.tan: _tangent,
    np.sinh: _rising(np.sinh),
    np.cosh: _hyperbolic_cosine,
    np.tanh: _rising(np.tanh),
    np.arcsin: lambda x: _within(x, -1.0, 1.0, np.arcsin),
    np.arccos: lambda x: _within(x, -1.0, 1.0, np.arccos, rises=False),
    np.arctan: _rising(np.arctan),
    np.arcsinh: _rising(np.arcsinh),
    np.less: _compared("high", "low", np.less),
    np.less_equal: _compared("high", "low", np.less_equal),
    np.greater: _compared("low", "high", np.greater),
    np.greater_equal: _compared("low", "high", np.greater_equal),
}
