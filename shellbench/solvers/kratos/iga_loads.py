"""Loads of a part's case as forces on its control points: their work on the part's own functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import EdgeLoad
from shellbench.problems.shell.measure import load_density
from shellbench.problems.shell.places import Edge
from shellbench.problems.shell.symmetry import point_forces
from shellbench.solvers.kratos.nurbs import NurbsPatch

Array = NDArray[np.float64]

EXTRA_POINTS = 2  # a span and coordinate, beyond degree + 1: loads may be any formula


def control_forces(case: Case, patch: NurbsPatch, t: float) -> Array:
    """Return the forces (3, n1, n2) on control points at time or load factor t, N."""
    return _area(case, patch, t) + _edges(case, patch, t) + _points(case, patch, t)


def _area(case: Case, patch: NurbsPatch, t: float) -> Array:
    (first, w1), (second, w2) = (basis.gauss(basis.degree + 1 + EXTRA_POINTS) for basis in patch.bases)
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    density = load_density(case, points, t)
    if not np.any(density):
        return np.zeros((3, *patch.shape))
    x = case.surface.derivatives(points, order=1)
    area = np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    density = (density * area[:, None]).reshape(len(first), len(second), 3) * np.outer(w1, w2)[..., None]
    return patch.gather(patch.bases[0].matrices(first, 0)[0], density, patch.bases[1].matrices(second, 0)[0])


def _edges(case: Case, patch: NurbsPatch, t: float) -> Array:
    total = np.zeros((3, *patch.shape))
    for load in case.loads:
        for name in load.on if isinstance(load, EdgeLoad) else ():
            edge = case.places[name]
            assert isinstance(load, EdgeLoad)
            assert isinstance(edge, Edge)
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


def _points(case: Case, patch: NurbsPatch, t: float) -> Array:
    total = np.zeros((3, *patch.shape))
    for xi, force in point_forces(case, t):
        left, right = (basis.matrices(np.array([xi[a]]), 0)[0, 0] for a, basis in enumerate(patch.bases))
        total += force[:, None, None] * np.outer(left, right)
    return total
