"""Loads of a case as forces on the control points of its part: their work on the part's own functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.conditions import EdgeLoad
from shellbench.problems.shell.measure import load_density
from shellbench.problems.shell.places import Edge
from shellbench.solvers.kratos.nurbs import NurbsPatch
from shellbench.solvers.kratos.symmetry import Part, point_forces

Array = NDArray[np.float64]

EXTRA_POINTS = 2  # a span and coordinate, beyond degree + 1: loads may be any formula


def control_forces(part: Part, patch: NurbsPatch, t: float) -> Array:
    """Return the forces (3, n1, n2) on control points at time or load factor t, N."""
    return _area(part, patch, t) + _edges(part, patch, t) + _points(part, patch, t)


def _area(part: Part, patch: NurbsPatch, t: float) -> Array:
    case = part.case
    (first, w1), (second, w2) = (basis.gauss(basis.degree + 1 + EXTRA_POINTS) for basis in patch.bases)
    grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
    points = case.surface.domain.wrap(grid.reshape(-1, 2))
    density = load_density(case, points, t)
    if not np.any(density):
        return np.zeros((3, *patch.shape))
    x = case.surface.derivatives(points, order=1)
    area = np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    density = (density * area[:, None]).reshape(len(first), len(second), 3) * np.outer(w1, w2)[..., None]
    return patch.gather(patch.bases[0].matrices(first, 0)[0], density, patch.bases[1].matrices(second, 0)[0])


def _edges(part: Part, patch: NurbsPatch, t: float) -> Array:
    case, total = part.case, np.zeros((3, *patch.shape))
    for load in case.loads:
        for name in load.on if isinstance(load, EdgeLoad) else ():
            edge = case.places[name]
            assert isinstance(load, EdgeLoad)
            assert isinstance(edge, Edge)
            if (edge.axis, edge.side) in part.planes:
                continue  # its image is on the part
            running = 1 - edge.axis
            basis = patch.bases[running]
            nodes, weights = basis.gauss(basis.degree + 1 + EXTRA_POINTS)
            points = edge.points(case.surface.domain, nodes)
            x = case.surface.derivatives(points, order=1)
            length = np.linalg.norm(x[1, 0] if running == 0 else x[0, 1], axis=-1)
            density = case.evaluate(load.vector, points, t)[0, 0] * (length * weights)[:, None]
            row = basis.matrices(nodes, 0)[0].T @ density
            end = 0 if edge.side == "min" else -1
            if edge.axis == 0:
                total[:, end, :] += row.T
            else:
                total[:, :, end] += row.T
    return total


def _points(part: Part, patch: NurbsPatch, t: float) -> Array:
    total = np.zeros((3, *patch.shape))
    for xi, force in point_forces(part.case, t):
        found = part.place((float(xi[0]), float(xi[1])))
        if found is None:
            continue
        place, share = found
        left, right = (basis.matrices(np.array([place[a]]), 0)[0, 0] for a, basis in enumerate(patch.bases))
        total += share * force[:, None, None] * np.outer(left, right)
    return total
