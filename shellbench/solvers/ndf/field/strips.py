"""Coordinates of the strips between folds, as inputs of a field.

A smooth function of continuous inputs is continuous, and its slope jumps where theirs do. Along an open coordinate with
folds, the inputs therefore are the strips' own coordinates: each runs from -1 to 1 in its strip, and stays constant
outside. In each strip a feature is a wave of its own, and no two strips share its frequency. Around a closed
coordinate such inputs would not close. There (cos, sin) remain, and each strip adds an arch that vanishes outside.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from torch import Tensor

from shellbench.problems.shell.question.folds import ASIDE
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.ndf.field.geometry import LINE
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement, compose, coordinates
from shellbench.solvers.ndf.field.quadrature import ROUNDING

Strip = tuple[float, float]


def strips_along(surface: Surface, axis: int) -> list[Strip]:
    """Return the bounds of the strips between folds along a coordinate; none if it has no folds.

    Around a closed coordinate the last strip may end beyond the upper bound.
    """
    domain, lines = surface.domain, [fold.at for fold in surface.fold_lines if fold.axis == axis]
    if not lines:
        return []
    closed = [*lines, lines[0] + domain.size[axis]]
    return list(pairwise(closed if domain.periodic[axis] else [domain.lower[axis], *lines, domain.upper[axis]]))


def sides_along(surface: Surface) -> tuple[int, int]:
    """Return, for each coordinate, the number of sides that it is as long as: two for a turn, one for each strip."""
    first, second = (max(1 + surface.domain.periodic[axis], len(strips_along(surface, axis))) for axis in (0, 1))
    return first, second


def strip_input(surface: Surface, axis: int, strip: Strip, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N) of a strip's input at points (N, 2); on a fold, the one of its upper side."""
    domain, (start, stop) = surface.domain, strip
    size, length = domain.size[axis], stop - start
    x = points[:, axis] + ASIDE * size
    x = start + np.mod(x - start, size) if domain.periodic[axis] else x
    share = (x - start - ASIDE * size) / length
    before = (x < start) & (start > domain.lower[axis])
    after = (x >= stop) & (domain.periodic[axis] or stop < domain.upper[axis])
    share, inside = np.where(before, 0.0, np.where(after, 1.0, share)), ~(before | after)
    if domain.periodic[axis]:
        angle = math.pi * share
        parts = [np.sin(angle), np.cos(angle) * math.pi / length, -np.sin(angle) * (math.pi / length) ** 2]
    else:
        parts = [2 * share - 1, np.full_like(share, 2 / length), np.zeros_like(share)]
    value, slope, bend = (placement.tensor(part) for part in (parts[0], parts[1] * inside, parts[2] * inside))
    return compose((value, slope, bend), coordinates(points, placement)[axis])


def oblique_at_folds(surface: Surface) -> bool:
    """Return True if coordinate lines do not cross every fold at right angles."""
    for fold in surface.fold_lines:
        for side in (-1, 1):
            points = surface.domain.grid(LINE, LINE)
            points[..., fold.axis] = fold.at + 2 * side * ASIDE * surface.domain.size[fold.axis]
            x = surface.derivatives(surface.domain.wrap(points), 1)
            sizes = np.linalg.norm(x[1, 0], axis=-1) * np.linalg.norm(x[0, 1], axis=-1)
            if (np.abs((x[1, 0] * x[0, 1]).sum(-1)) > ROUNDING * sizes).any():
                return True
    return False


def toward_edge(surface: Surface, edge: Edge, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N) of a coordinate that is one on an edge, and zero from the next fold or edge on."""
    domain, axis, upper = surface.domain, edge.axis, edge.side == "max"
    strips = strips_along(surface, axis) or [(domain.lower[axis], domain.upper[axis])]
    (start, stop), x = strips[-1 if upper else 0], points[:, axis]
    length = stop - start if upper else start - stop
    share = (x - (start if upper else stop)) / length
    inside = np.where((share > -ASIDE * domain.size[axis] / length) | (len(strips) < 2), 1.0, 0.0)
    t = coordinates(points, placement)[axis] / length * placement.tensor(inside)
    t[VALUE] = placement.tensor(inside * share)
    return t
