"""Places where formulas are not finite, not positive, or not smooth, found by halving undecided cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from shellbench.problems.expression import Expression
from shellbench.problems.features import FARTHER, FIRST, NAMES, Array, Box, Dividing, Place, boxes_of, grid, place
from shellbench.protocol.schema import LARGEST

JUMP, COARSER = 1e-6, 1e3  # relative change that is a jump, between points that are further apart than rounding tells
MOST_LOOKED_AT = 1024  # cells whose bounds do not tell whether a formula is finite


def bad_place(formula: Expression, box: Box, least: float = -np.inf, t: float = 1.0, order: int = 0) -> Place | None:
    """Return a place where a formula, or a derivative up to an order, is not a number in range, or None.

    A number in range is at most `LARGEST` in size; the formula itself is also above `least`.

    Cells whose bounds do not decide are halved. If there are many, only some are examined; the divisions of solvers
    find the rest.
    """
    axes = [a for a in (0, 1) if box[a][1] > box[a][0] and formula.depends_on(NAMES[a])]
    low, high = grid(box, [FIRST if a in axes else 1 for a in (0, 1)])
    look = Dividing([formula], t, box, axes, "integral", ((), ()))
    while True:
        corners = np.concatenate([low, high, (low + high) / 2])
        values = formula.derivatives(corners, order, t)
        bad = ~np.all([np.abs(each) <= LARGEST for each in values.values()], axis=0) | ~(values[0, 0] > least)
        if bad.any():
            return place(corners[np.argmax(bad)])
        boxes, sure = boxes_of(low, high, t), np.ones(len(low), dtype=bool)
        for name in [NAMES[a] for a in axes] if order else [""]:
            for k, term in enumerate(formula.enclosed(boxes, name, order)):
                sure &= (term.size <= LARGEST) & ((term.low > least) | (k > 0))
        low, high = low[~sure], high[~sure]
        last = np.any((high - low <= look.nothing)[:, axes], axis=1) if axes else ~sure[~sure]
        if last.any() and ((pole := look.pole(low[last], high[last])) or np.isfinite(least)):
            return pole or place(low[last][0])
        low, high = low[~last], high[~last]
        if not len(low):
            return None
        if len(low) > MOST_LOOKED_AT:
            some = np.unique(np.linspace(0, len(low) - 1, MOST_LOOKED_AT // 16).astype(int))
            low, high = low[some], high[some]
        relative = (high - low)[:, axes] / look.side[axes]
        low, high, _ = look.halves(low, high, np.zeros(low.shape, dtype=bool), relative)


def rough_place(formulas: Sequence[Expression], box: Box) -> tuple[Place, tuple[Array, Array], int] | None:
    """Return a place where slopes or curvatures jump, or have no bounds, for whatever reason; None if there is none.

    With it come the points (2,) on its two sides, and the least order of the derivatives that differ there. Cells on
    which intervals bound all second derivatives contain no such place. If there are many other cells, only some are
    examined.
    """
    for formula in formulas:
        axes = [a for a in (0, 1) if formula.depends_on(NAMES[a])]
        look = Dividing(formulas, 1.0, box, axes, "curvature", ((), ()))
        low, high = grid(box, [FIRST if a in axes else 1 for a in (0, 1)])
        while axes and len(low):
            boxes, sure = boxes_of(low, high, 1.0), np.ones(len(low), dtype=bool)
            for name in (NAMES[a] for a in axes):
                sure &= np.all([np.isfinite(term.size) for term in formula.enclosed(boxes, name, 2)], axis=0)
            low, high = low[~sure], high[~sure]
            last = np.all((high - low <= 2 * look.nothing * COARSER)[:, axes], axis=1)
            for at, size in zip((low + high)[last] / 2, (high - low)[last], strict=True):
                for way in np.eye(2)[axes]:
                    ends = [np.clip(at + sign * FARTHER * size * way, *np.transpose(box)) for sign in (-1, 1)]
                    if (order := jump_between(formulas, np.array(ends), box)) is not None:
                        return place(at), (ends[0], ends[1]), order
            low, high = low[~last], high[~last]
            if len(low):
                some = np.unique(np.linspace(0, len(low) - 1, MOST_LOOKED_AT // 16).astype(int))
                low, high = low[some], high[some]
            for _ in axes if len(low) else ():
                low, high, _ = look.halves(low, high, np.zeros(low.shape, dtype=bool), (high - low)[:, axes])
    return None


def jump_between(formulas: Sequence[Expression], ends: Array, box: Box) -> int | None:
    """Return the least order of derivatives that differ relatively at two points; None if none do."""
    with np.errstate(all="ignore"):
        found = [formula.derivatives(ends, 2) for formula in formulas]
    side = np.array([stop - start for start, stop in box])
    for order in (0, 1, 2):
        for key in ((i, order - i) for i in range(order + 1)):
            values = np.stack([each[key] for each in found])
            # a curvature is compared with one that turns a side by a radian, too
            slopes = np.stack([each[1, 0] for each in found]), np.stack([each[0, 1] for each in found])
            scale = max(np.abs(values).max(), *(np.abs(s).max() * side.max() ** (1 - order) for s in slopes))
            if not np.linalg.norm(values[:, 1] - values[:, 0]) <= JUMP * scale:
                return order
    return None
