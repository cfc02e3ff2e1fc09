"""Kinks and jumps of piecewise formulas, found from the formulas: lines along the coordinates, or a refusal.

`min`, `max`, `abs` and `where` change over where another of their rivals becomes the least. If that depends on one
coordinate alone, the places are coordinate lines, at which cells of meshes and quadratures can end. Other lines are
refused. Intervals show where one rival is less than all others, however narrow the rest is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.expression import Expression
from shellbench.problems.features import FIRST, NAMES, SHORTEST, Box, boxes_of, grid

MOST_LINES = 32  # lines of one formula across a coordinate
MOST_CELLS = 4096  # of a look at rivals; where more are undecided, more than `MOST_LINES` are, or one is no line
MOST_VALUES = 1_000_000  # of all rivals in all cells, at once
HALVINGS = 60  # of the interval in which another one becomes the least
TIE = 2.0**-48  # relative: rivals that differ by less all over a cell are the same there

Array = NDArray[np.float64]


def kink_lines(formula: Expression, bounds: Box) -> tuple[list[float], list[float]]:
    """Return the values of xi1, and of xi2, at which a formula changes over, within their bounds.

    Raises
    ------
    InputError
        If it changes over along other lines, at some time, or too often.
    """
    lines: tuple[list[float], list[float]] = [], []
    for rivals in formula.rivals:
        if any(rival.depends_on("t") for rival in rivals):
            raise InputError(f"'{formula.quoted}' changes over at some t, and formulas may only at coordinate lines")
        live = _live(formula, rivals, bounds)
        axes = [axis for axis, name in enumerate(NAMES) if any(rival.depends_on(name) for rival in live)]
        if len(axes) == 1:
            found = _changes(formula, live, axes[0], bounds)
            lines[axes[0]].extend(found)
            if len(lines[axes[0]]) > MOST_LINES:
                raise InputError(
                    f"'{formula.quoted}' changes over at more than {MOST_LINES} values of {NAMES[axes[0]]}"
                )
    return lines


def _live(formula: Expression, rivals: Sequence[Expression], bounds: Box) -> Sequence[Expression]:
    """Return the rivals that may change over somewhere: all of one coordinate, or those left by cells of both.

    Raises
    ------
    InputError
        If they change over along no coordinate line.
    """
    if not all(any(rival.depends_on(name) for rival in rivals) for name in NAMES):
        return rivals
    low, high = grid(bounds, (FIRST, FIRST))
    left: Sequence[Expression] = rivals
    while True:
        values = _values(left, np.concatenate([low, high, (low + high) / 2]))
        sure = np.partition(values, 1, axis=0)[1] - values.min(axis=0) > TIE * np.abs(values).max(axis=0)
        won = [left[k] for k in np.unique(values.argmin(axis=0)[sure])]
        if len(won) > 1 and all(any(rival.depends_on(name) for rival in won) for name in NAMES):
            raise InputError(
                f"'{formula.quoted}' changes over where {_difference(*won[:2])} is zero, which is no coordinate line"
            )
        near, _ = _rivalling(left, low, high)
        open_ = near.sum(axis=0) > 1
        left = [
            rival for rival, anywhere in zip(left, np.any(near[:, open_], axis=1).tolist(), strict=True) if anywhere
        ]
        if len(left) < 2 or not all(any(rival.depends_on(name) for rival in left) for name in NAMES):
            return left if len(left) > 1 else ()
        low, high = low[open_], high[open_]
        if 4 * len(low) > MOST_CELLS or len(low) * len(left) > MOST_VALUES:
            return ()  # they touch, as far as one can tell, and do not change over
        low, high = _halved(*_halved(low, high, 0), 1)


def _difference(first: Expression, second: Expression) -> str:
    one, other = (rival.quoted for rival in (first, second))
    if one.startswith("-") and other.startswith("-"):
        one, other = one[1:], other[1:]
    return one if other in (f"-{one}", f"-({one})") else f"{one} - {other}"


def _changes(formula: Expression, rivals: Sequence[Expression], axis: int, bounds: Box) -> list[float]:
    """Return the places on a coordinate where another rival becomes the least; InputError if there are too many."""
    box = tuple(b if a == axis else (0.0, 0.0) for a, b in enumerate(bounds))
    low, high = grid((box[0], box[1]), [8 * FIRST if a == axis else 1 for a in (0, 1)])
    nothing = SHORTEST * (bounds[axis][1] - bounds[axis][0]) + 8 * np.finfo(float).eps * np.abs(bounds[axis]).max()
    brackets: list[tuple[Array, Array]] = []
    left = rivals
    while len(low):
        near, once = _rivalling(left, low, high)
        open_ = near.sum(axis=0) > 1
        left = [
            rival for rival, anywhere in zip(left, np.any(near[:, open_], axis=1).tolist(), strict=True) if anywhere
        ]
        last = open_ & (once | ((high - low)[:, axis] <= nothing))
        brackets.append((low[last], high[last]))
        low, high = low[open_ & ~last], high[open_ & ~last]
        if len(low) > 8 * FIRST * MOST_LINES or len(low) * len(left) > MOST_VALUES:
            raise InputError(f"'{formula.quoted}' changes over at more than {MOST_LINES} values of {NAMES[axis]}")
        low, high = _halved(low, high, axis)
    before, after = (np.concatenate(ends) for ends in zip(*brackets, strict=True))
    # a place on an end of cells lies between them
    before[:, axis] = np.maximum(before[:, axis] - nothing, bounds[axis][0])
    after[:, axis] = np.minimum(after[:, axis] + nothing, bounds[axis][1])
    first, then = (_values(rivals, ends).argmin(axis=0) for ends in (before, after))
    before, after, first = before[first != then], after[first != then], first[first != then]
    for _ in range(HALVINGS if len(first) else 0):
        middle = (before + after) / 2
        same = (_values(rivals, middle).argmin(axis=0) == first)[:, None]
        before, after = np.where(same, middle, before), np.where(same, after, middle)
    slack = 1e-9 * (bounds[axis][1] - bounds[axis][0])
    found: list[float] = []
    for place in np.sort(after[:, axis]).tolist():
        inside = bounds[axis][0] + slack < place < bounds[axis][1] - slack
        if inside and (not found or place - found[-1] > 8 * nothing):
            found.append(place)
    return found


def _values(rivals: Sequence[Expression], points: Array) -> Array:
    """Return the values (rivals, n) at points (n, 2)."""
    return np.stack([rival.derivatives(points, 0)[0, 0] for rival in rivals])


def _rivalling(rivals: Sequence[Expression], low: Array, high: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks: of rivals (r, n) that may be the least in a cell, and of cells (n,) where two are so in turn.

    In these cells the difference of the two only rises, or only falls, along the one coordinate that counts.
    """
    boxes, half, mine = boxes_of(low, high, 1.0), (high - low) / 2, np.arange(len(low))
    at = _values(rivals, (low + high) / 2)
    first = at.argmin(axis=0)
    with np.errstate(all="ignore"):
        # 1. By their values.
        values = [rival.enclosed(boxes)[0] for rival in rivals]
        near = np.stack([v.low for v in values]) <= np.stack([v.high for v in values])[first, mine]
        some = np.flatnonzero(near.any(axis=1)).tolist()
        # 2. By the difference to the rival that is the least in the middle: its value there, and its slopes.
        place = np.searchsorted(some, first)
        reach = np.zeros((len(some), len(low)))
        rises: NDArray[np.bool_] = np.ones(reach.shape, dtype=bool)
        for axis, name in enumerate(NAMES):
            if not half[:, axis].any() or not any(rivals[k].depends_on(name) for k in some):
                continue
            slopes = [rivals[k].enclosed(boxes, name, 1)[1] for k in some]
            lows, highs = np.stack([s.low for s in slopes]), np.stack([s.high for s in slopes])
            least, most = lows - highs[place, mine], highs - lows[place, mine]
            reach += np.maximum(np.abs(least), np.abs(most)) * half[:, axis]
            rises &= (least > 0) | (most < 0)
        less = at[some] - at[first, mine]
        size = np.stack([values[k].size for k in some])
        near[some] &= ~(less - reach > 0) & ~(less + reach <= TIE * (size + size[place, mine]))
    near[first, mine] = True
    rises[place, mine] = True
    pair = near.sum(axis=0) == 2
    return near, pair & np.all(rises | ~near[some], axis=0)


def _halved(low: Array, high: Array, axis: int) -> tuple[Array, Array]:
    below, above = high.copy(), low.copy()
    below[:, axis] = above[:, axis] = (low + high)[:, axis] / 2
    return np.concatenate([low, above]), np.concatenate([below, high])
