"""Dead loads as forces at points: a density at area points, and forces at points of edges and at single points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import RIGID_MOTIONS, AreaLoad, EdgeLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.places import Edge, Point
from shellbench.problems.shell.rigid import free_motions, rigid_modes
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.quadrature import Rule, RuleSpec, edge_rule

BALANCE = (
    1e-6  # work of the loads on a free rigid motion, relative to the sum of their magnitudes, above which it moves
)


def force_density(case: Case, points: ArrayLike, t: float = 1.0) -> Array:
    """Return the load per reference area (N, 3), N/m^2, at points (N, 2)."""
    xi = np.asarray(points, dtype=float)
    force = np.zeros((len(xi), 3))
    for load in case.loads:
        match load:
            case AreaLoad():
                force += case.evaluate(load.vector, xi, t)[0, 0]
            case GravityLoad():
                force += case.material.areal_density * case.evaluate(load.acceleration, xi, t)[0, 0]
            case PressureLoad():
                x = case.surface.derivatives(xi, 1)
                normal = np.cross(x[1, 0], x[0, 1])
                normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
                force += case.formula(load.value).derivatives(xi, 0, t)[0, 0][:, None] * normal
    return force


def concentrated_forces(case: Case, spec: RuleSpec, focal: Array, t: float = 1.0) -> tuple[Array, Array]:
    """Return points (P, 2) and forces (P, 3), N: the point loads, and the edge loads at an edge rule's points."""
    points, forces = [np.zeros((0, 2))], [np.zeros((0, 3))]
    for load in case.loads:
        if not isinstance(load, PointLoad | EdgeLoad):
            continue
        for place in (case.places[name] for name in load.on):
            if isinstance(load, PointLoad) and isinstance(place, Point):
                at = np.array([place.xi])
                forces.append(case.evaluate(load.force, at, t)[0, 0])
            elif isinstance(load, EdgeLoad) and isinstance(place, Edge):
                rule = edge_rule(case.surface.domain, place, focal, spec)
                at = rule.points
                tangent = case.surface.derivatives(at, 1)[(0, 1) if place.axis == 0 else (1, 0)]
                lengths = rule.weights * np.linalg.norm(tangent, axis=-1)
                forces.append(case.evaluate(load.vector, at, t)[0, 0] * lengths[:, None])
            points.append(at)
    return np.concatenate(points), np.concatenate(forces)


def check_balance(case: Case, rule: Rule, spec: RuleSpec, focal: Array, t: float = 1.0) -> None:
    """Check that the loads do no work on the rigid motions that nothing holds.

    Raises
    ------
    InputError
        If they do: there is no static answer.
    """
    free = free_motions(case)
    if not free.size:
        return
    x = case.surface.derivatives(rule.points, 1)
    area = rule.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    points, forces = concentrated_forces(case, spec, focal, t)
    points = np.concatenate([rule.points, points])
    forces = np.concatenate([force_density(case, rule.points, t) * area[:, None], forces])
    modes = rigid_modes(case.surface, points)[0, 0] @ free
    work = np.einsum("pi,pik->k", forces, modes)
    largest = np.abs(forces).sum()
    if np.linalg.norm(work) > BALANCE * largest:
        motion = RIGID_MOTIONS[int(np.argmax(np.abs(free @ work)))]
        raise InputError(f"case '{case.name}': the loads are not in balance: nothing holds the shell against {motion}")
