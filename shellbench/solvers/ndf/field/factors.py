"""Boundary factors: the matrix M in u = lift + M F that holds the supports for any output of the network.

Held components carry factors that vanish linearly at their edges; slopes are held by a projector,

    M = D [I - (1 - B) p p^T / (p . p)],   p = P D' a3,

with D the diagonal of the factors, B the factor that vanishes at the slope-held edges, P the components that are held
there, and D' the factors of the other edges. At such an edge u = 0 and u,n . a3 = B,n a3 . (I - p p^T/..) F = 0; if one
factor is common to all components of a3, this is B [I - (1 - B) a3 (x) a3] F. Components left free at a slope-held
edge, as on planes of symmetry, get even inputs instead (`inputs`), or rows of the output layer (`solve`).

The module also defines the lift: a smooth displacement that moves every support as prescribed; the field adds to it.

Each held component is blended separately from the motions of the edges that hold it. A weight is one on its own edge
and zero on the opposite one, with vanishing slope at both, so that the lift has a clamped edge's own slope. Edges of
both coordinates meet at corners. There they are joined as a Coons patch (Coons 1967), which is exact on all edges if
the prescribed motions agree at the corners.

Clamped edges that turn by finite angles carry the shell, its normals, and the field's own axes along.

Each edge's motion is a rigid one, scaled by the edge's weight: one on the edge, with vanishing slope, and zero on the
opposite edge. The lift is the composition of these motions, x -> T_1(T_2(x)): to first order in the distance from an
edge it is the rigid motion of that edge, so that the edge is clamped at any angle. The field's components are those on
axes that turn with it,

    u = lift + Q M F,    Q = R_1(w_1 angle_1) R_2(w_2 angle_2),

with the boundary matrix M of the undeformed shell: on an edge Q is its rotation R, and the projector of M becomes the
one along the turned normal R a3. In a tube whose rims are turned against each other, Q takes up the twist, so that F
hardly changes from step to step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import Rotation, Support, Translation, Value
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.places import SIDES, Edge, Point, Whole
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.ansatz import Factors
from shellbench.solvers.ndf.field.choices import Slopes
from shellbench.solvers.ndf.field.geometry import contravariant_basis_jet, normal_jet
from shellbench.solvers.ndf.field.jets import (
    PLANES,
    VALUE,
    Array,
    Placement,
    compose,
    constant,
    coordinates,
    cosine,
    dot,
    from_derivatives,
    matrix_product,
    power,
    product,
    sine,
)
from shellbench.solvers.ndf.field.mirrors import Mirrors
from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.field.strips import toward_edge
from shellbench.solvers.ndf.field.supports import EdgeSupport, Sides, edge_supports, even_sides

NORMAL_SAMPLES = 17  # points a side of the grid on which a3 is sampled


def edge_factor(domain: Domain, edges: set[Edge], even: Sides, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N) of a factor that vanishes linearly at the given edges and is at most 1.

    At a bound with even inputs that the factor does not hold, the factor is even too.
    """
    factor = constant(placement.tensor(np.ones(len(points))), placement.planes)
    for axis in (0, 1):
        held = [any(e.axis == axis and e.side == side for e in edges) for side in SIDES]
        if not any(held):
            continue
        t = coordinates(points, placement)[axis] / domain.size[axis]
        t[VALUE] = (placement.tensor(points[:, axis]) - domain.lower[axis]) / domain.size[axis]
        from_upper = -t
        from_upper[VALUE] = (domain.upper[axis] - placement.tensor(points[:, axis])) / domain.size[axis]
        if all(held):
            factor = product(factor, 4 * product(t, from_upper))
            continue
        distance, other = (t, 1) if held[0] else (from_upper, 0)
        if even[axis][other]:
            distance = math.pi / 2 * distance
            distance = compose(sine(distance[VALUE]), distance)
        factor = product(factor, distance)
    return factor


@dataclass(frozen=True)
class BoundaryFactors:
    """The matrix M of a case; with `covariant`, times the contravariant basis (u = u_a a^a + u_3 a^3).

    Attributes
    ----------
    case
        The case whose supports it holds.
    covariant
        Whether the network's outputs are covariant components instead of Cartesian ones.
    slopes
        Method by which the slope of free components is held.
    """

    case: Case
    covariant: bool = False
    slopes: Slopes = "even"

    @cached_property
    def _all_held(self) -> bool:
        return self.case.prescribed

    @cached_property
    def _supports(self) -> tuple[EdgeSupport, ...]:
        return edge_supports(self.case)

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        if self._all_held:
            return constant(placement.tensor(np.zeros((len(points), 3, 3))))
        even = even_sides(self._supports, self.slopes)
        domain = self.case.surface.domain
        held = [{s.edge for s in self._supports if c in s.held} for c in range(3)]
        factors: list[Tensor] = []
        for c, edges in enumerate(held):
            same = held.index(edges)
            factors.append(factors[same] if same < c else edge_factor(domain, edges, even, points, placement))
        matrix = torch.diag_embed(torch.stack(factors, dim=-1))
        tilted = [s for s in self._supports if s.tilted]
        if tilted:
            matrix = matrix_product(matrix, self._projector(tilted, held, even, points, placement))
        if self.covariant:
            matrix = matrix_product(matrix, contravariant_basis_jet(self.case.surface, points, placement))
        return matrix

    def _projector(
        self, tilted: list[EdgeSupport], held: list[set[Edge]], even: Sides, points: Array, placement: Placement
    ) -> Tensor:
        domain, edges = self.case.surface.domain, {s.edge for s in tilted}
        b = edge_factor(domain, edges, even, points, placement)
        if self.case.surface.fold_lines:  # a3 jumps at a fold, and M must not
            one = constant(torch.ones_like(b[VALUE]), placement.planes)
            b = reduce(product, [one - toward_edge(self.case.surface, edge, points, placement) for edge in edges])
        p = normal_jet(self.case.surface, points, placement)
        others = [held[c] - edges if all(c in s.held for s in tilted) else None for c in range(3)]
        active = [c for c in range(3) if self._normal_extent[c] > ROUNDING]
        mixed = any(others[c] != others[active[0]] for c in active)
        if mixed:
            p = torch.stack(
                [
                    torch.zeros_like(b)
                    if rest is None
                    else product(p[..., c], edge_factor(domain, rest, even, points, placement))
                    for c, rest in enumerate(others)
                ],
                dim=-1,
            )
        length = dot(p, p)
        if mixed:  # p may vanish on other edges; B^2 keeps the quotient smooth and vanishes where it matters
            length = length + product(b, b)
        outer = product(p[..., :, None], p[..., None, :])
        scale = product(power(length, -1.0), b)
        scale = power(length, -1.0) - scale
        identity = constant(torch.eye(3, device=placement.device, dtype=placement.dtype).expand(len(points), 3, 3))
        return identity - product(scale[..., None, None], outer)

    @cached_property
    def _normal_extent(self) -> Array:
        x = self.case.surface.derivatives(self.case.surface.domain.grid(NORMAL_SAMPLES, NORMAL_SAMPLES), 1)
        normal = np.cross(x[1, 0], x[0, 1])
        extent: Array = np.abs(normal / np.linalg.norm(normal, axis=-1, keepdims=True)).max(axis=(0, 1))
        return extent


Moved = list[tuple[Edge, Support]]


def edge_weight(case: Case, edge: Edge, alone: bool, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N) of an edge's weight: the cubic smoothstep across the shell, or one if it is `alone`."""
    if alone:
        return constant(placement.tensor(np.ones(len(points))))
    t = toward_edge(case.surface, edge, points, placement)
    v = t[VALUE]
    return compose((v * v * (3 - 2 * v), 6 * v * (1 - v), 6 - 12 * v), t)


@dataclass(frozen=True)
class Lift:
    """The prescribed motions of a case, extended to the whole shell; `t` is the load factor."""

    case: Case
    t: float = 1.0

    @cached_property
    def _edges(self) -> tuple[Moved, Moved, Moved]:
        supports = edge_supports(self.case)
        x, y, z = ([(s.edge, s.held[c]) for s in supports if c in s.held] for c in range(3))
        return x, y, z

    @cached_property
    def _whole_support(self) -> tuple[Support, Whole] | None:
        """The first support that moves the whole surface, with its place."""
        found = [(s, place) for s, place in self.case.supported_places() if isinstance(place, Whole) and s.motion]
        return found[0] if found else None

    @property
    def moves(self) -> bool:
        """True if any edge is moved."""
        return self._whole_support is not None or any(support.motion for edges in self._edges for _, support in edges)

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        if self._whole_support is not None:
            return from_derivatives(self.case.motion(*self._whole_support, points, self.t, 2), placement)
        zero = constant(placement.tensor(np.zeros(len(points))))
        columns = [
            self._component(c, edges, points, placement) if any(s.motion for _, s in edges) else zero
            for c, edges in enumerate(self._edges)
        ]
        return torch.stack(columns, dim=-1)

    def _component(self, c: int, edges: Moved, points: Array, placement: Placement) -> Tensor:
        first_motion = edges[0][1].motion
        if not isinstance(first_motion, Value) and all(s.motion == first_motion for _, s in edges):
            return self._motion(*edges[0], points, placement)[..., c]
        sides = [[(e, s) for e, s in edges if e.axis == axis] for axis in (0, 1)]
        if not (sides[0] and sides[1]):
            return self._blend(c, sides[0] or sides[1], points, placement)
        first = self._blend(c, sides[0], points, placement, frozen=True)
        for edge, support in sides[1]:
            motion = self._edge_motion(edge, support, points, placement)[..., c]
            for other, _ in sides[0]:  # contribution of the other pair of edges
                corner = other.project(self.case.surface.domain, edge.project(self.case.surface.domain, points))
                value = self._motion(edge, support, corner, placement)[VALUE, :, c]
                weight = edge_weight(self.case, other, len(sides[0]) == 1, points, placement)
                motion = motion - product(weight, constant(value))
            weight = edge_weight(self.case, edge, len(sides[1]) == 1, points, placement)
            first = first + product(weight, motion)
        return first

    def _blend(self, c: int, edges: Moved, points: Array, placement: Placement, frozen: bool = False) -> Tensor:
        """Return the jet (6, N) of a component: the motions of these edges, weighted across the shell."""
        total = constant(placement.tensor(np.zeros(len(points))))
        for edge, support in edges:
            motion = (self._edge_motion if frozen else self._motion)(edge, support, points, placement)
            weight = edge_weight(self.case, edge, len(edges) == 1, points, placement)
            total = total + product(weight, motion[..., c])
        return total

    def _motion(self, edge: Edge, support: Support, points: Array, placement: Placement) -> Tensor:
        return from_derivatives(self.case.motion(support, edge, points, self.t, 2), placement)

    def _edge_motion(self, edge: Edge, support: Support, points: Array, placement: Placement) -> Tensor:
        """Return the motion on the edge itself, constant along the other coordinate."""
        jet = self._motion(edge, support, edge.project(self.case.surface.domain, points), placement)
        across = [plane for plane, orders in enumerate(PLANES) if orders[edge.axis]]
        jet[across] = 0.0
        return jet


def turns_clamps(case: Case) -> bool:
    """Return True if a clamped edge turns by a finite angle."""
    return not case.linear and any(s.clamped and isinstance(s.motion, Rotation) for s in case.supports)


def why_not_turned(case: Case) -> str | None:
    """Return the reason that clamped edges of a case can't be turned by finite angles, as one clause, or None."""
    if not turns_clamps(case):
        return None
    name = next(s.name for s in case.supports if s.clamped and isinstance(s.motion, Rotation))
    turn = f"it can't turn the clamped support '{name}' by finite angles"
    supports = edge_supports(case)
    if case.dynamics is not None:
        return f"{turn} in motion"
    if len({s.edge.axis for s in supports}) > 1:
        return f"{turn} where supported edges meet"
    if any(isinstance(place, Point) for _, place in case.supported_places()):
        return f"{turn} beside supports at points"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return f"{turn} beside edge moments"
    if any(len({h.name for h in s.held.values()}) != 1 or len(s.held) < 3 for s in supports):
        return f"{turn} unless each supported edge is held in all components by one support"
    movable = (Translation, Rotation, type(None))
    if any(not isinstance(h.motion, movable) for s in supports for h in s.held.values()):
        return f"{turn} beside a support that is moved by prescribed values"
    return None


@dataclass(frozen=True)
class EdgeRotations:
    """The rigid motions of a case's supported edges at load factor t, as a lift and as the field's axes."""

    case: Case
    t: float = 1.0

    @property
    def moves(self) -> bool:
        """True if any edge is moved."""
        return True

    @cached_property
    def _supports(self) -> tuple[EdgeSupport, ...]:
        return edge_supports(self.case)

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        start = from_derivatives(self.case.surface.derivatives(points, 2), placement)
        x = start
        for support in reversed(self._supports):
            weight = edge_weight(self.case, support.edge, len(self._supports) == 1, points, placement)
            match support.held[0].motion:
                case Translation(vector=vector):
                    shift = placement.tensor(np.array([self.case.scalar(text, self.t) for text in vector]))
                    x = x + product(weight[..., None], constant(shift.expand(len(points), 3)))
                case Rotation() as rotation:
                    centre = constant(placement.tensor(np.tile(rotation.centre, (len(points), 1))))
                    turn = self._rotation(rotation, weight, placement)
                    x = centre + matrix_product(turn, (x - centre)[..., None])[..., 0]
        return x - start

    def axes(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of the rotation Q of the field's axes at points (N, 2)."""
        identity = torch.eye(3, device=placement.device, dtype=placement.dtype)
        total = constant(identity.expand(len(points), 3, 3))
        for support in self._supports:
            motion = support.held[0].motion
            if isinstance(motion, Rotation):
                weight = edge_weight(self.case, support.edge, len(self._supports) == 1, points, placement)
                total = matrix_product(total, self._rotation(motion, weight, placement))
        return total

    def _rotation(self, rotation: Rotation, weight: Tensor, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of the rotation by `weight` (6, N) of its angle, by Rodrigues' formula."""
        axis = np.asarray(rotation.axis) / np.linalg.norm(rotation.axis)
        cross = placement.tensor(np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]))
        angle = math.radians(self.case.scalar(rotation.angle, self.t)) * weight
        s, c = (compose(f(angle[VALUE]), angle)[..., None, None] for f in (sine, cosine))
        identity = constant(torch.eye(3, device=cross.device, dtype=cross.dtype).expand(weight.shape[1], 3, 3))
        return identity + s * cross + (constant(torch.ones_like(weight[VALUE]))[..., None, None] - c) * (cross @ cross)


@dataclass(frozen=True)
class MirroredFactors:
    """Boundary factors times functions with the parity of each component of the answer: the matrix M O."""

    factors: Factors
    mirrors: Mirrors

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M O at points (N, 2)."""
        return product(self.factors.matrix(points, placement), self.mirrors.odd_jets(points, placement)[..., None, :])


@dataclass(frozen=True)
class TurnedFactors:
    """Boundary factors on axes that turn with the supported edges: the matrix Q M."""

    factors: Factors
    turning: EdgeRotations

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of Q M at points (N, 2)."""
        return matrix_product(self.turning.axes(points, placement), self.factors.matrix(points, placement))


@dataclass(frozen=True)
class NoFactors:
    """M = 1, or the contravariant basis of covariant components: supports are left to springs."""

    case: Case
    covariant: bool = False

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        if self.covariant:
            return contravariant_basis_jet(self.case.surface, points, placement)
        return constant(placement.tensor(np.tile(np.eye(3), (len(points), 1, 1))))


@dataclass(frozen=True)
class NoLift:
    """A lift of zero: springs pull supports to their prescribed places."""

    moves: bool = False

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        return placement.tensor(np.zeros((6, len(points), 3)))
