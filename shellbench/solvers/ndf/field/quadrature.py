"""Gauss panels on the parametric rectangle, graded toward points that carry a force.

A field trained on fixed points finds displacements with low energy at those points only. Therefore every rule has an
independent companion with other panels and another order, on which energies are certified.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from shellbench.problems.features import Array, cut_line
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Domain, Surface

NOWHERE = np.zeros((0, 2))  # no point toward which a rule is graded
PANEL_CUT = 0.2  # of a panel at a focal point; for r^2 log r^2 the error per point is least between .15 and .25
SOFTENED = 5  # power p of r = s**p at a corner: the least power of the distance there, mu = .1, becomes smooth
FURTHER = 6  # more points along r than elsewhere, since a polynomial in r has p times the degree in s
BATCH = 1024  # points whose strain rows, or jets of features, are held in memory at once
SEARCHED = 4001  # distances from an end among which ends of panels are interpolated
ROUNDING = 1e-9
"""Relative size below which a difference is rounding, here and in all of `ndf`.

Sums of thousands of terms in double precision leave 1e-13 at most, and what differs by design differs by 1e-6 or more.
"""


@dataclass(frozen=True)
class Rule:
    """Points (N, 2) and parametric weights (N,)."""

    points: Array
    weights: Array

    def batches(self) -> Iterator[Rule]:
        """Yield the rule in portions of at most `BATCH` points."""
        for start in range(0, len(self.points), BATCH):
            yield Rule(self.points[start : start + BATCH], self.weights[start : start + BATCH])

    def areas(self, surface: Surface) -> Array:
        """Return the areas (N,), m^2, of a surface at the points of a rule on the rectangle."""
        x = surface.derivatives(self.points, 1)
        return np.asarray(self.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1))


@dataclass(frozen=True)
class RuleSpec:
    """Resolution of a quadrature rule.

    Attributes
    ----------
    panels
        Panels along each side, shared between the breakpoints in proportion to their distance.
    order
        Gauss points along a panel.
    grading
        Panels narrow toward focal points like s -> s**grading; 1 leaves them uniform.
    cuts
        Number of further cuts of the panels at a focal point, at `PANEL_CUT` of their length, for its logarithm.
    layers
        Lengths in the coordinates of layers at both ends of a side that has no focal point inside: half of its panels
        are spread evenly over asinh(distance / length), the other half over the distance. Zero for a side without.
    corner_cuts
        Number of cuts of the cells at corners into four, at `PANEL_CUT` of their sides, for powers of the distance.
        In the cells that remain at corners, points narrow toward these, too.
    point_cuts
        Number of cuts of the four cells at a focal point, as at corners. `cuts` then holds along edges alone.
    joints
        Further values of xi1, and of xi2, at which panels end, because the integrand has a kink there.
    """

    panels: tuple[int, int]
    order: int
    grading: float = 1.0
    cuts: int = 0
    layers: tuple[float, float] = (0.0, 0.0)
    corner_cuts: int = 0
    point_cuts: int = 0
    joints: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())


def panel_ends(lower: float, upper: float, focal: Sequence[float], spec: RuleSpec, axis: int, periodic: bool) -> Array:
    """Return ascending ends of panels on [lower, upper] along one coordinate, narrowing toward focal values.

    Both bounds are ends of a panel even if the coordinate is periodic: a seam must not lie inside a panel.
    """
    ends = _panel_ends(lower, upper, focal, spec, axis, periodic)
    slack = ROUNDING * (upper - lower)
    joints = [at for at in spec.joints[axis] if np.abs(ends - at).min() > slack]
    return np.sort(np.concatenate([ends, joints])) if joints else ends


def _panel_ends(lower: float, upper: float, focal: Sequence[float], spec: RuleSpec, axis: int, periodic: bool) -> Array:
    size = upper - lower
    if spec.layers[axis] and not periodic:
        return _layered_ends(lower, upper, spec.layers[axis], spec.panels[axis])
    inner = sorted(f for f in focal if lower + ROUNDING * size < f < upper - ROUNDING * size)
    kept: list[float] = []
    for value in inner:
        if not kept or value - kept[-1] > ROUNDING * size:
            kept.append(value)
    marked = {*kept}
    for bound, other in ((lower, upper), (upper, lower)):
        near = [bound, other] if periodic else [bound]
        if any(abs(f - b) <= ROUNDING * size for f in focal for b in near):
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
        shares = PANEL_CUT ** np.arange(1, spec.cuts + 1)
        inserted = [s[0] * shares] if left in marked else []
        if right in marked:
            inserted.append(1 - (1 - (s[-2] if number > 1 else 0.0)) * shares)
        ends.append(left + (right - left) * np.unique(np.concatenate([s, *inserted])))
    return np.concatenate(ends)


def _layered_ends(lower: float, upper: float, layer: float, panels: int) -> Array:
    """Return ends of panels that narrow toward both bounds, within a layer of that length."""
    half = (upper - lower) / 2
    distance = layer * np.sinh(np.linspace(0, np.arcsinh(half / layer), SEARCHED))
    spread = distance / half + np.arcsinh(distance / layer) / np.arcsinh(half / layer)  # from 0 to 2 at the middle
    at = np.linspace(0, 4, panels + 1)
    near = np.interp(np.minimum(at, 4 - at), spread, distance)
    return np.where(at <= 2, lower + near, upper - near)


gauss = cache(np.polynomial.legendre.leggauss)


def line_rule(ends: Array, order: int) -> tuple[Array, Array]:
    """Return Gauss points (n,) and weights (n,) on all panels between ascending ends."""
    x, w = gauss(order)
    half = np.diff(ends)[:, None] / 2
    middle = (ends[:-1] + ends[1:])[:, None] / 2
    return (middle + half * x).ravel(), (half * w).ravel()


def ends_of(domain: Domain, focal: Array, spec: RuleSpec, axis: int) -> Array:
    """Return ascending ends of panels along a coordinate, graded toward focal points (k, 2)."""
    values = [float(f) for f in focal[:, axis]]
    return panel_ends(domain.lower[axis], domain.upper[axis], values, spec, axis, domain.periodic[axis])


def area_rule(domain: Domain, focal: Array, spec: RuleSpec) -> Rule:
    """Return the rule on the rectangle, graded toward focal points (k, 2); cells there and at corners are cut."""
    # A tensor rule that narrows toward both coordinates of a point would put most of its points at regular places.
    lines = replace(spec, cuts=0) if spec.point_cuts else spec
    ends = [ends_of(domain, focal, lines, axis) for axis in (0, 1)]
    (x1, w1), (x2, w2) = (line_rule(along, spec.order) for along in ends)
    points, weights = _tensor_product(x1, w1, x2, w2)
    inner = np.ones((len(x1), len(x2)), dtype=bool)
    rules = []
    for (i, first), (j, second), cuts in _cut_cells(domain, focal, spec, ends):
        cell = inner[i * spec.order : (i + 1) * spec.order, j * spec.order : (j + 1) * spec.order]
        if not cell.all():
            continue  # of another point already
        cell[:] = False
        sides = []
        for along, number, last in ((ends[0], i, first), (ends[1], j, second)):
            start, stop = along[number : number + 2][:: -1 if last else 1]
            sides.append((float(start), float(stop - start)))
        rules.append(_corner_rule(sides[0], sides[1], spec.order, cuts))
    kept = inner.ravel()
    return Rule(
        np.concatenate([points[kept], *(rule.points for rule in rules)]),
        np.concatenate([weights[kept], *(rule.weights for rule in rules)]),
    )


Side = tuple[int, bool]


def _cut_cells(domain: Domain, focal: Array, spec: RuleSpec, ends: Sequence[Array]) -> Iterator[tuple[Side, Side, int]]:
    """Yield the cells that are cut toward one of their corners.

    Each has its numbers along both coordinates, True where that corner is at the cell's upper end, and the number of
    cuts.
    """
    if spec.corner_cuts and not any(domain.periodic):
        last = [len(along) - 2 for along in ends]
        for first in ((0, False), (last[0], True)):
            for second in ((0, False), (last[1], True)):
                yield first, second, spec.corner_cuts
    for point in focal if spec.point_cuts else ():
        for first in _panels_at(ends[0], float(point[0]), domain.periodic[0]):
            for second in _panels_at(ends[1], float(point[1]), domain.periodic[1]):
                yield first, second, spec.point_cuts


def _panels_at(ends: Array, at: float, periodic: bool) -> list[Side]:
    """Return the numbers of the panels that begin or end at a value, each with True if they end there."""
    size = ends[-1] - ends[0]
    distance = np.abs(ends - at)
    if periodic:
        distance = np.minimum(distance, size - distance)
    found = np.nonzero(distance <= ROUNDING * size)[0]  # empty if the value is NaN
    panels = len(ends) - 1
    return [(int(k), False) for k in found if k < panels] + [(int(k) - 1, True) for k in found if k]


def _tensor_product(x1: Array, w1: Array, x2: Array, w2: Array) -> tuple[Array, Array]:
    """Return the points (n m, 2) and weights (n m,) of the product of two rules on lines."""
    return np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(w1, w2).ravel()


def _corner_rule(first: tuple[float, float], second: tuple[float, float], order: int, cuts: int) -> Rule:
    """Return the rule on one cell at a corner, from the corner's coordinates and the cell's signed sides."""
    # The cell is cut into four, then the one of these at the corner again, and so on.
    parts = []
    for k in range(cuts):
        far, near = (PANEL_CUT ** (k + 1), PANEL_CUT**k), (0.0, PANEL_CUT ** (k + 1))
        for one, two in ((far, near), (near, far), (far, far)):
            (x1, w1), (x2, w2) = (line_rule(np.array(interval), order) for interval in (one, two))
            parts.append(_tensor_product(x1, w1, x2, w2))
    local, weights = _last_corner_rule(order)
    parts.append((PANEL_CUT**cuts * local, PANEL_CUT ** (2 * cuts) * weights))
    points = np.array([first[0], second[0]]) + np.concatenate([p for p, _ in parts]) * [first[1], second[1]]
    return Rule(points, np.concatenate([w for _, w in parts]) * abs(first[1] * second[1]))


def _last_corner_rule(order: int) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,) on the unit square that integrate powers of the distance from its corner 0.

    Energies of powers go as r**(2 mu - 2) with mu > 0 as small as 1 / (2 `SOFTENED`): no even points integrate them.
    """
    # The square is two triangles at the corner (Duffy 1982): x1 = r, x2 = r t, and the same exchanged, with the area
    # r dr dt. With r = s**p, r**(2 mu - 2) r dr is p s**(2 mu p - 1) ds: no singularity, if p mu is 1/2 at least.
    s, by_s = line_rule(np.array([0.0, 1.0]), order + FURTHER)
    t, by_t = line_rule(np.array([0.0, 1.0]), order + FURTHER // 2)
    r = np.repeat(s**SOFTENED, len(t))
    across = r * np.tile(t, len(s))
    weights = np.outer(SOFTENED * s ** (2 * SOFTENED - 1) * by_s, by_t).ravel()
    both = [np.stack([r, across], axis=-1), np.stack([across, r], axis=-1)]
    return np.concatenate(both), np.concatenate([weights, weights])


def rule_on_parts(origins: Array, sizes: Array, order: int) -> Rule:
    """Return the rule of so many points a side on each of some rectangles (k, 2)."""
    x, w = line_rule(np.array([0.0, 1.0]), order)
    unit, weights = _tensor_product(x, w, x, w)
    points = origins[:, None] + unit * sizes[:, None]
    return Rule(points.reshape(-1, 2), np.outer(np.prod(sizes, axis=1), weights).ravel())


def edge_rule(domain: Domain, edge: Edge, focal: Array, spec: RuleSpec, more: Array | None = None) -> Rule:
    """Return the rule along an edge, or along a part of one; weights are those of the running coordinate.

    Panels also end at `more` values (k,).
    """
    axis = 1 - edge.axis
    ends = ends_of(domain, focal, spec, axis)
    if more is not None:
        ends = cut_line(ends, more, periodic=False)
    start, stop = edge.bounds(domain)
    inside = ends[(ends > start + ROUNDING * domain.size[axis]) & (ends < stop - ROUNDING * domain.size[axis])]
    running, weights = line_rule(np.array([start, *inside, stop]), spec.order)
    return Rule(edge.points(domain, running), weights)
