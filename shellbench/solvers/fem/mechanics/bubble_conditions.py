"""Conditions of supports on the bubbles along an edge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import COMPONENTS, Support
from shellbench.problems.shell.question.places import Edge, Place
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.fem.mesh.basis import CUBIC, SAME, Derivative
from shellbench.solvers.fem.mesh.bubbles import fitted_bubbles, moment_points
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import EdgeRule

Array = NDArray[np.float64]

GAUSS_POINTS = 6  # a cell's side

Motion = Mapping[Derivative, Array]  # derivative -> (n, 3, states)


def motion_at(
    case: Case, support: Support, place: Place, domain: Domain, points: Array, states: Sequence[float]
) -> Motion:
    """Return a support's motion at points and its prescribed derivatives, (n, 3, states) each."""
    at = [case.motion(support, place, domain.wrap(points), t, order=2) for t in states]
    return {key: np.stack([m[key] for m in at], axis=-1) for key in at[0]}


def constant_normal(case: Case, mesh: TensorMesh, edge: Edge) -> Array | None:
    """Return the unit normal (3,) of an edge if it keeps its direction along the edge; None if it turns.

    Bubbles hold the slope of a clamp on the first kind of edge, and Nitsche's terms on the second. Both use this
    function.
    """
    line = mesh.node_points[mesh.edge_nodes(edge), 1 - edge.axis]
    between = EdgeRule.on_edge(mesh, edge, GAUSS_POINTS).points
    x = case.surface.derivatives(np.concatenate([mesh.domain.wrap(edge.points(mesh.domain, line)), between]), order=1)
    normals = np.cross(x[1, 0], x[0, 1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.asarray(normals[0]) if np.ptp(normals, axis=0).max() <= SAME else None


def bubble_conditions(
    case: Case, mesh: TensorMesh, support: Support, edge: Edge, states: Sequence[float]
) -> tuple[Array, Array]:
    """Return rows (n, r, dofs) and values (n, r, states) on the bubbles along an edge, by the first node of each cell.

    Held components have the bubbles of the prescribed motion, and a plane of symmetry excludes bubbles of slopes across
    it. A clamp holds bubbles of the slope if the normal keeps its direction; if it turns, only Nitsche's terms hold the
    slope between nodes.
    """
    running, domain = 1 - edge.axis, mesh.domain
    line = mesh.lines[running]
    inside = line[:-1, None] + np.diff(line)[:, None] * moment_points()
    at = [edge.points(domain, places.ravel()) for places in (line, mesh.lower_sides(running), inside)]
    at_starts, at_stops, at_inside = (motion_at(case, support, edge, domain, domain.wrap(p), states) for p in at)
    steps = np.diff(line)[:, None, None]
    along, across = ((0, 1), (1, 0)) if edge.axis == 0 else ((1, 0), (0, 1))

    def bubbles(value: Derivative, slope: Derivative) -> Array:
        starts, stops = ((motion[value], motion[slope]) for motion in (at_starts, at_stops))
        sides = [
            np.stack([values[s], slopes[s] * steps], axis=1)
            for (values, slopes), s in ((starts, slice(None, -1)), (stops, slice(1, None)))
        ]
        return fitted_bubbles(
            mesh.degree, np.stack(sides, axis=1), at_inside[value].reshape(*inside.shape, *at_inside[value].shape[1:])
        )

    kept = constant_normal(case, mesh, edge) if support.clamped else None
    normals = np.zeros((0, 3)) if kept is None else kept[None]
    held = np.array([[float(c == name) for c in COMPONENTS] for name in support.held])
    if support.symmetry:
        normals = np.eye(3)[[c not in support.held for c in COMPONENTS]]
    directions = [(direction, 0) for direction in held] + [(direction, 1) for direction in normals]
    nodes, kinds = len(mesh.edge_nodes(edge)), len(mesh.kinds)
    rows = np.zeros((nodes, len(directions), mesh.degree - CUBIC, len(COMPONENTS), kinds))
    values = np.zeros((nodes, len(directions), mesh.degree - CUBIC, len(states)))
    for row, (direction, slope) in enumerate(directions):
        found = bubbles(*((across, (1, 1)) if slope else ((0, 0), along)))
        values[: len(found), row] = np.einsum("c,nbcs->nbs", direction, found)
        for number in range(mesh.degree - CUBIC):
            kind = (slope, number + 2) if edge.axis == 0 else (number + 2, slope)
            rows[:, row, number, :, mesh.kinds.index(kind)] = direction
    return rows.reshape(nodes, -1, len(COMPONENTS) * kinds), values.reshape(nodes, -1, len(states))
