"""Gauss panels on the parametric rectangle, graded toward points that carry a force.

A field trained on fixed points finds displacements that are cheap at those points only, so every rule has an
independent companion of other panels and another order, on which energies are certified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from shellbench.problems.shell.places import Edge
from shellbench.problems.shell.surface import Domain, Surface
from shellbench.solvers.ndf.jets import Array

CUT = 0.2  # of a panel at a focal point; for r^2 log r^2 the error per point is least between .15 and .25
MERGE = 1e-9  # breakpoints closer than this share of a side are one


@dataclass(frozen=True)
class Rule:
    """Points (N, 2) and parametric weights (N,)."""

    points: Array
    weights: Array

    def areas(self, surface: Surface) -> Array:
        """Return the areas (N,), m^2, of a surface that points of a rule on the rectangle stand for."""
        x = surface.derivatives(self.points, 1)
        return np.asarray(self.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1))


@dataclass(frozen=True)
class RuleSpec:
    """How fine a rule is.

    Attributes
    ----------
    panels
        Panels along each side, shared between the breakpoints in proportion to their distance.
    order
        Gauss points along a panel.
    grading
        Panels narrow toward focal points like s -> s**grading; 1 leaves them uniform.
    cuts
        How often the panels at a focal point are cut once more, at `CUT` of their length, for its logarithm.
    """

    panels: tuple[int, int]
    order: int
    grading: float = 1.0
    cuts: int = 0


def panel_ends(lower: float, upper: float, focal: Sequence[float], spec: RuleSpec, axis: int, periodic: bool) -> Array:
    """Return ascending ends of panels on [lower, upper] along one coordinate, narrowing toward focal values.

    Both bounds are ends of a panel even where the coordinate is periodic: a seam must not lie inside a panel.
    """
    size = upper - lower
    inner = sorted(f for f in focal if lower + MERGE * size < f < upper - MERGE * size)
    kept: list[float] = []
    for value in inner:
        if not kept or value - kept[-1] > MERGE * size:
            kept.append(value)
    marked = {*kept}
    for bound, other in ((lower, upper), (upper, lower)):
        near = [bound, other] if periodic else [bound]
        if any(abs(f - b) <= MERGE * size for f in focal for b in near):
            marked.add(bound)
    ends = [np.array([lower])]
    for left, right in pairwise([lower, *kept, upper]):
        both = left in marked and right in marked
        number = max(2 if both else 1, round(spec.panels[axis] * (right - left) / size))
        s = np.arange(1, number + 1) / number
        if both:
            s = np.where(s < 0.5, (2 * s) ** spec.grading / 2, 1 - (2 * (1 - s)) ** spec.grading / 2)
        elif left in marked:
            s = s**spec.grading
        elif right in marked:
            s = 1 - (1 - s) ** spec.grading
        shares = CUT ** np.arange(1, spec.cuts + 1)
        inserted = [s[0] * shares] if left in marked else []
        if right in marked:
            inserted.append(1 - (1 - (s[-2] if number > 1 else 0.0)) * shares)
        ends.append(left + (right - left) * np.unique(np.concatenate([s, *inserted])))
    return np.concatenate(ends)


def line_rule(ends: Array, order: int) -> tuple[Array, Array]:
    """Return Gauss points (n,) and weights (n,) on all panels between ascending ends."""
    x, w = np.polynomial.legendre.leggauss(order)
    half = np.diff(ends)[:, None] / 2
    middle = (ends[:-1] + ends[1:])[:, None] / 2
    return (middle + half * x).ravel(), (half * w).ravel()


def side_rule(domain: Domain, focal: Array, spec: RuleSpec, axis: int) -> tuple[Array, Array]:
    """Return points (n,) and weights (n,) along one coordinate; `focal` (k, 2) are focal points."""
    ends = panel_ends(
        domain.lower[axis],
        domain.upper[axis],
        [float(f) for f in focal[:, axis]],
        spec,
        axis,
        domain.periodic[axis],
    )
    return line_rule(ends, spec.order)


def area_rule(domain: Domain, focal: Array, spec: RuleSpec) -> Rule:
    """Return the tensor rule on the rectangle, graded toward focal points (k, 2)."""
    (x1, w1), (x2, w2) = (side_rule(domain, focal, spec, axis) for axis in (0, 1))
    points = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)
    return Rule(points, np.outer(w1, w2).ravel())


def edge_rule(domain: Domain, edge: Edge, focal: Array, spec: RuleSpec) -> Rule:
    """Return the rule along an edge; weights are those of the running coordinate."""
    running, weights = side_rule(domain, focal, spec, 1 - edge.axis)
    return Rule(edge.points(domain, running), weights)
