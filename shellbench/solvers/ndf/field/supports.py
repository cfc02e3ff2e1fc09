"""Conditions of the supports and loads of a case on a field.

Supports are listed by edge and by point. Dead loads become forces at points: a density at area points, and forces at
points of edges and at single points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions, rigid_modes
from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Support
from shellbench.problems.shell.question.features import narrow_division
from shellbench.problems.shell.question.loads import AreaLoad, EdgeLoad, GravityLoad, Load, PointLoad, PressureLoad
from shellbench.problems.shell.question.places import SIDES, Edge, Point
from shellbench.solvers.ndf.field.choices import Slopes
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.field.quadrature import ROUNDING, Rule, RuleSpec, edge_rule, ends_of, rule_on_parts

EDGE_SAMPLES = 33  # points of an edge at which its normal is sampled


@dataclass(frozen=True)
class EdgeSupport:
    """Conditions of all supports on one edge.

    Attributes
    ----------
    held
        The support of each held component (0, 1, 2).
    slope
        The support that holds u,n . a3, if one does.
    tilted
        Whether the held components have a part along a3, so that they tilt the normal as they leave the edge.
    free
        Whether free components have such a part: then no factor can hold their slope (see `choices.Slopes`). Nor can
        any where folds cross the edge, since a3 jumps there.
    """

    edge: Edge
    held: dict[int, Support]
    slope: Support | None
    tilted: bool
    free: bool


@dataclass(frozen=True)
class PointSupport:
    """One component held at one point: the support, the point, the component, and its displacement, metres."""

    support: Support
    point: Point
    component: int
    value: float


def edge_supports(case: Case) -> tuple[EdgeSupport, ...]:
    """Return the supported edges of a case."""
    held: dict[Edge, dict[int, Support]] = {}
    slope: dict[Edge, Support] = {}
    for support, place in case.supported_places():
        if isinstance(place, Edge):
            components = held.setdefault(place, {})
            components.update({"xyz".index(c): support for c in support.held})
            if support.holds_slope:
                slope[place] = support
    supports = []
    for edge, components in held.items():
        normals = np.abs(edge_normals(case, edge))
        free = [c for c in range(3) if c not in components]
        smooth = all(fold.axis == edge.axis for fold in case.surface.fold_lines)
        supports.append(
            EdgeSupport(
                edge,
                components,
                slope.get(edge),
                tilted=edge in slope and smooth and bool(normals[:, list(components)].max(initial=0.0) > ROUNDING),
                free=edge in slope and (not smooth or bool(normals[:, free].max(initial=0.0) > ROUNDING)),
            )
        )
    return tuple(supports)


def point_supports(case: Case, t: float = 1.0) -> tuple[PointSupport, ...]:
    """Return the displacement components that supports hold at points and corners."""
    return tuple(
        PointSupport(support, place, component, float(motion[component]))
        for support, place in case.supported_places()
        if isinstance(place, Point)
        for motion in [case.motion(support, place, np.asarray(place.xi), t)[0, 0]]
        for component in sorted("xyz".index(c) for c in support.held)
    )


Sides = tuple[tuple[bool, bool], tuple[bool, bool]]
"""For each coordinate, something that holds or not at its lower and at its upper bound."""


def quantity_points(case: Case, quantity: DisplacementQuantity) -> tuple[Array, Array]:
    """Return the points (n, 2) of a displacement quantity, and its unit directions (n, 3) there."""
    places = [case.places[name] for name in quantity.points]
    points = np.array([place.xi for place in places if isinstance(place, Point)])
    return points, np.array([unit(d) for d in quantity.directions])


def even_sides(supports: tuple[EdgeSupport, ...], slopes: Slopes = "even") -> Sides:
    """Return for each coordinate two flags (lower, upper): True at a bound with even inputs."""
    even = {(s.edge.axis, s.edge.side) for s in supports if s.free and slopes == "even"}
    first, second = (tuple((axis, side) in even for side in SIDES) for axis in (0, 1))
    return (first[0], first[1]), (second[0], second[1])


def edge_samples(case: Case, edge: Edge) -> Array:
    """Return points (n, 2) along an edge, both its ends included."""
    domain, running = case.surface.domain, 1 - edge.axis
    return edge.points(domain, np.linspace(domain.lower[running], domain.upper[running], EDGE_SAMPLES))


def edge_normals(case: Case, edge: Edge) -> Array:
    """Return a3 (n, 3) at samples of an edge."""
    x = case.surface.derivatives(edge_samples(case, edge), 1)
    normal = np.cross(x[1, 0], x[0, 1])
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


# Work of the loads on a free rigid motion, relative to the sum of their magnitudes, above which it moves. It is far
# above rounding; neighbours are not on record.
BALANCE = 1e-6


def force_density(case: Case, points: ArrayLike, t: float = 1.0) -> Array:
    """Return the dead load per reference area (N, 3), N/m^2, at points (N, 2), without narrow loads.

    Narrow loads have points of their own, and are among the `concentrated_forces`.
    """
    return _density(case, [load for load in case.dead if narrow_division(case, load) is None], points, t)


def _density(case: Case, loads: Sequence[Load], points: ArrayLike, t: float) -> Array:
    xi = np.asarray(points, dtype=float)
    force = np.zeros((len(xi), 3))
    for load in loads:
        match load:
            case AreaLoad():
                given = case.evaluate(load.vector, xi, t)[0, 0]
                force += given if load.frame == "global" else _from_local(case, given, xi, 0)
            case GravityLoad():
                force += case.material.areal_density * case.evaluate(load.acceleration, xi, t)[0, 0]
            case PressureLoad():
                x = case.surface.derivatives(xi, 1)
                normal = np.cross(x[1, 0], x[0, 1])
                normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
                force += case.formula(load.value).derivatives(xi, 0, t)[0, 0][:, None] * normal
    return force


def _from_local(case: Case, vectors: Array, points: Array, running: int, outward: Edge | None = None) -> Array:
    """Return vectors (n, 3) of parts along a coordinate, across it within the surface and normal, as Cartesian ones.

    Across is a3 x a_running, or away from the surface at an edge.
    """
    x = case.surface.derivatives(points, 1)
    along, other = (x[1, 0], x[0, 1]) if running == 0 else (x[0, 1], x[1, 0])
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    inside = other - (other * along).sum(-1, keepdims=True) * along  # toward growing values of the other coordinate
    inside /= np.linalg.norm(inside, axis=-1, keepdims=True)
    normal = np.cross(along, inside) * (1.0 if running == 0 else -1.0)
    across = np.cross(normal, along)
    if outward is not None:
        across = inside if outward.side == "max" else -inside
    return np.asarray(vectors[:, :1] * along + vectors[:, 1:2] * across + vectors[:, 2:] * normal)


def concentrated_forces(case: Case, spec: RuleSpec, focal: Array, t: float = 1.0) -> tuple[Array, Array]:
    """Return points (P, 2) and forces (P, 3), N: point loads, edge loads at an edge rule's points, and narrow loads.

    An edge rule has more panels at narrow loads on it. Narrow loads on the surface have a rule on the parts into which
    their own cells cut the panels.
    """
    points, forces = [np.zeros((0, 2))], [np.zeros((0, 3))]
    panels = [ends_of(case.surface.domain, focal, spec, axis) for axis in (0, 1)]
    for load in case.dead:
        if (division := narrow_division(case, load)) is not None:
            rule = rule_on_parts(*division.parts((panels[0], panels[1]), (False, False)), spec.order)
            points.append(rule.points)
            forces.append(_density(case, [load], rule.points, t) * rule.areas(case.surface)[:, None])
    for load in case.loads:
        if not isinstance(load, PointLoad | EdgeLoad):
            continue
        for place in (case.places[name] for name in load.on):
            if isinstance(load, PointLoad) and isinstance(place, Point):
                at = np.array([place.xi])
                forces.append(case.evaluate(load.force, at, t)[0, 0])
            elif isinstance(load, EdgeLoad) and isinstance(place, Edge):
                narrow = narrow_division(case, load, place)
                more = np.zeros(0) if narrow is None else narrow.ends(1 - place.axis)
                rule = edge_rule(case.surface.domain, place, focal, spec, more)
                at = rule.points
                tangent = case.surface.derivatives(at, 1)[(0, 1) if place.axis == 0 else (1, 0)]
                lengths = rule.weights * np.linalg.norm(tangent, axis=-1)
                given = case.evaluate(load.vector, at, t)[0, 0]
                if load.frame == "local":
                    given = _from_local(case, given, at, 1 - place.axis, outward=place)
                forces.append(given * lengths[:, None])
            points.append(at)
    return np.concatenate(points), np.concatenate(forces)


def check_balance(case: Case, rule: Rule, spec: RuleSpec, focal: Array, t: float = 1.0) -> None:
    """Check that the loads do no work on free rigid motions.

    Raises
    ------
    InputError
        If they do: there is no static answer.
    """
    free = free_motions(case)
    if not free.size:
        return
    area = rule.areas(case.surface)
    points, forces = concentrated_forces(case, spec, focal, t)
    points = np.concatenate([rule.points, points])
    forces = np.concatenate([force_density(case, rule.points, t) * area[:, None], forces])
    modes = rigid_modes(case.surface, points)[0, 0] @ free
    work = np.einsum("pi,pik->k", forces, modes)
    largest = np.abs(forces).sum()
    if np.linalg.norm(work) > BALANCE * largest:
        motion = RIGID_MOTIONS[int(np.argmax(np.abs(free @ work)))]
        raise InputError(f"case '{case.name}': the loads are not in balance: nothing holds the shell against {motion}")
