"""Folds: coordinate lines at which the tangent plane or the curvature of a midsurface jumps.

The displacement u is continuous across a fold. A rigid fold keeps the angle between the two tangent planes: the
rotation about the fold line, (u,n . a3) with one sense of n across the fold, is equal on both sides. A hinge leaves it
free, and its bending moment is zero. Derivatives of the surface have a value on each side of a fold. Points on the
line itself belong to the side of the larger coordinate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.branches import branch_in
from shellbench.problems.expression import Expression, derivatives_of
from shellbench.problems.features import NAMES, SAME_LINE
from shellbench.problems.smoothness import jump_between, rough_place

Array = NDArray[np.float64]
Pair = tuple[float, float]

ASIDE = 1e-11  # of a side: points that are nearer to a fold lie on it, and its two sides are this far away
NEAR_EDGE = 1e-6  # of a side: the least distance of a fold from edges and other folds
ALONG, HALVINGS = 5, 40  # points along a line at which slopes are compared, and halvings of the interval of a kink
TEAR_SAMPLES, TEAR = 17, 1e-8  # points along a fold, and the jump of the position there relative to the shell


@dataclass(frozen=True)
class Fold:
    """One fold line, xi_axis = at.

    Attributes
    ----------
    axis
        0 for a line of constant xi1, 1 for one of constant xi2.
    at
        Its coordinate; radians for angles.
    hinged
        True if the angle is free.
    """

    axis: int
    at: float
    hinged: bool


def kink_line(formulas: Sequence[Expression], sides: tuple[Array, Array], box: tuple[Pair, Pair]) -> float | None:
    """Return the coordinate of a kink between two points (2,), if it runs along a coordinate line; None otherwise."""
    axis = int(np.argmax(np.abs(sides[1] - sides[0])))
    low, up = box[1 - axis]
    for place in np.linspace(low, up, ALONG + 2)[1:-1]:
        ends = np.array(sides)
        ends[:, 1 - axis] = place
        if jump_between(formulas, ends, box) not in (1, 2):
            return None
    before, after = sides
    for _ in range(HALVINGS):
        middle = (before + after) / 2
        if jump_between(formulas, np.array([before, middle]), box) is None:
            before = middle
        else:
            after = middle
    return float(after[axis])


def folds_of(
    rigid: Mapping[Any, Sequence[float]],
    hinged: Mapping[Any, Sequence[float]],
    lower: Pair,
    upper: Pair,
    angles: Sequence[str],
    periodic: Sequence[str],
) -> tuple[Fold, ...]:
    """Return the folds of a case's file by increasing coordinate.

    Raises
    ------
    ValueError
        If both coordinates have folds, one is given twice, or one lies outside or on an edge.
    """
    given = [(name, at, hinge) for hinge, kind in enumerate((rigid, hinged)) for name in kind for at in kind[name]]
    if len({name for name, _, _ in given}) > 1:
        raise ValueError("both coordinates have folds, but folds along one coordinate can't cross those of the other")
    found: list[Fold] = []
    for name, value, hinge in given:
        axis = NAMES.index(name)
        at, size = float(np.radians(value) if name in angles else value), upper[axis] - lower[axis]
        if name in periodic and abs(at - upper[axis]) <= ASIDE * size:
            at = lower[axis]
        seam = name in periodic and abs(at - lower[axis]) <= ASIDE * size
        if not (lower[axis] + NEAR_EDGE * size < at < upper[axis] - NEAR_EDGE * size or seam):
            raise ValueError(f"the fold at {name} = {value:g} is not inside the surface")
        if any(abs(at - other.at) <= NEAR_EDGE * size for other in found):
            raise ValueError(f"the fold at {name} = {value:g} is given twice")
        found.append(Fold(axis, lower[axis] if seam else at, bool(hinge)))
    return tuple(sorted(found, key=lambda fold: fold.at))


def join_folds(folds: Sequence[Fold], axis: int, kinks: Iterable[float], size: float) -> tuple[float, ...]:
    """Return the kinks along a coordinate of this size, with folds for those that only rounding parts from them.

    A load may jump at a fold, at a place that its formula rounds otherwise.
    """
    own = [fold.at for fold in folds if fold.axis == axis]
    others = [at for at in kinks if all(abs(at - fold) > SAME_LINE * size for fold in own)]
    return tuple(sorted({*own, *others}))


def strips(lower: Pair, upper: Pair, folds: Sequence[Fold]) -> list[tuple[Pair, Pair]]:
    """Return the parts ((low, up), (low, up)) of a rectangle between its folds, which they do not touch."""
    if not folds:
        return [((lower[0], upper[0]), (lower[1], upper[1]))]
    axis = folds[0].axis
    size = upper[axis] - lower[axis]
    inside = [fold.at for fold in folds if fold.at > lower[axis]]
    starts = [lower[axis], *(at + 2 * ASIDE * size for at in inside)]
    stops = [*(at - 2 * ASIDE * size for at in inside), upper[axis]]
    other = (lower[1 - axis], upper[1 - axis])
    return [((a, b), other) if axis == 0 else (other, (a, b)) for a, b in zip(starts, stops, strict=True)]


def why_rough(
    formulas: Sequence[Expression], lower: Pair, upper: Pair, angles: tuple[bool, bool], folds: Sequence[Fold]
) -> str | None:
    """Return one clause about a kink that is no fold, with the line to write if it could be one, or None."""
    boxes = strips(lower, upper, folds)
    box, found = next(((box, f) for box in boxes if (f := rough_place(formulas, box))), (None, None))
    if box is None or found is None:
        return None
    at, sides, order = found
    shown = ", ".join(f"{np.degrees(c) if angle else c:.6g}" for c, angle in zip(at, angles, strict=True))
    x = derivatives_of(formulas, np.array(sides), 1)
    turns = [np.arctan2(np.linalg.norm(np.cross(*x[key])), x[key][0] @ x[key][1]) for key in ((1, 0), (0, 1))]
    angle = f"tangent turns by {np.degrees(max(turns)):.3g} degrees"
    what = ("position jumps", angle, "curvature jumps")[order]
    remedy = "a midsurface has a tangent and a curvature without jumps, however its formulas are written"
    if order and (line := kink_line(formulas, sides, box)) is not None:
        axis = int(np.argmax(np.abs(sides[1] - sides[0])))
        line = float(np.degrees(line)) if angles[axis] else line
        remedy = f"if the shell has a fold there, declare it in [surface]: folds = {{ xi{axis + 1} = [{line:.12g}] }}"
    return f"the surface has a kink at (xi1, xi2) = ({shown}), where its {what}: {remedy}"


@dataclass(frozen=True)
class Piece:
    """The part of a surface between two folds: its box ((low, up), (low, up)) and its formulas there."""

    box: tuple[Pair, Pair]
    formulas: tuple[Expression, ...]


def pieces(formulas: Sequence[Expression], lower: Pair, upper: Pair, folds: Sequence[Fold]) -> tuple[Piece, ...]:
    """Return the parts of a surface, each with the branches that its piecewise formulas take all over it."""
    boxes = strips(lower, upper, folds)
    return tuple(Piece(box, tuple(branch_in(formula, box) for formula in formulas)) for box in boxes)


def derivatives_by_piece(
    parts: Sequence[Piece], folds: Sequence[Fold], points: Array, order: int
) -> dict[tuple[int, int], Array]:
    """Return the derivatives (i, j) -> (..., 3) at points (..., 2); on a fold those of the side of larger xi."""
    axis = folds[0].axis
    size = parts[-1].box[axis][1] - parts[0].box[axis][0]
    starts = [part.box[axis][0] - 3 * ASIDE * size for part in parts[1:]]
    number = np.searchsorted(starts, points[..., axis], side="right")
    found = {(i, total - i): np.empty((*points.shape[:-1], 3)) for total in range(order + 1) for i in range(total + 1)}
    for own, part in enumerate(parts):
        there = number == own
        for key, values in derivatives_of(part.formulas, points[there], order).items():
            found[key][there] = values
    return found


def position_jumps(formulas: Sequence[Expression], lower: Pair, upper: Pair, folds: Sequence[Fold]) -> str | None:
    """Return one clause about a fold at which the surface is torn, or None."""
    for fold in folds:
        size = np.subtract(upper, lower)
        line = np.empty((TEAR_SAMPLES, 2))
        line[:, fold.axis] = fold.at
        line[:, 1 - fold.axis] = np.linspace(lower[1 - fold.axis], upper[1 - fold.axis], TEAR_SAMPLES)
        before = line.copy()
        before[:, fold.axis] -= 2 * ASIDE * size[fold.axis]
        if fold.at == lower[fold.axis]:
            before[:, fold.axis] = upper[fold.axis]
        sides = [derivatives_of(formulas, points, 0)[0, 0] for points in (before, line)]
        extent = np.ptp(derivatives_of(formulas, np.array([lower, upper]), 0)[0, 0], axis=0).max()
        if not np.abs(sides[1] - sides[0]).max() <= TEAR * max(extent, np.ptp(sides[0], axis=0).max()):
            return f"the surface is torn at its fold {NAMES[fold.axis]} = {fold.at:.6g}: its position jumps there"
    return None
