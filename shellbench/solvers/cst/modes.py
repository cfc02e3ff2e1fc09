"""Modes on one mesh of triangles: vibrations about rest with lumped masses, and buckling under the case's loads.

    vibration  K u = omega^2 M u        buckling  K u = -lambda G u

G are the stresses of the triangles in the linear answer, times the second derivatives of their strains. Moments of
hinges before buckling are left out: the solver takes shells that stretch but do not bend until they buckle.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from shellbench.errors import SolveFailure
from shellbench.solvers.cst.problem import TriangleProblem, factorise

Array = NDArray[np.float64]


def find_modes(problem: TriangleProblem, loaded: Array | None, count: int) -> tuple[Array, Array]:
    """Return values (count,) of the first modes, Hz or load factors, and shapes (count, v, 3) of 1 m at most.

    `loaded` (v, 3) is the linear answer to the loads under which the shell buckles; None asks for vibrations.

    Raises
    ------
    SolveFailure
        If the mesh has fewer modes.
    """
    elastic, pattern = problem.elastic, problem.pattern
    rest, none = np.zeros_like(elastic.rest), np.zeros(len(pattern.free))
    springs = problem.loading.springs.ravel()[pattern.free]
    stiffness = pattern.matrix(elastic.tangent_values(rest), springs)
    if loaded is None:
        ahead = diags_array(np.repeat(problem.loading.mass, 3)[pattern.free]).tocsc()
    else:
        blocks = -elastic.membrane.geometric_stiffness(elastic.strain(loaded)).ravel()
        ahead = pattern.matrix(np.append(blocks, np.zeros(len(elastic.entries[0]) - len(blocks))), none)
    size = stiffness.shape[0]
    if count >= size - 1:
        raise SolveFailure(f"the mesh has {size} unknowns, too few for mode {count}")
    backward = LinearOperator(stiffness.shape, matvec=factorise(stiffness), dtype=float)
    start = np.random.default_rng(0).normal(size=size)
    try:
        found, vectors = eigsh(ahead, count, stiffness, which="LA", Minv=backward, v0=start)
    except ArpackError:
        raise SolveFailure(f"the first {count} modes do not converge on this mesh") from None
    order = np.argsort(-found)
    if not found.min() > 0:
        raise SolveFailure(f"the shell has no {count} modes: these loads buckle it in fewer ways")
    values = 1 / found[order]
    shapes = np.zeros((count, rest.size))
    shapes[:, pattern.free] = (vectors / np.abs(vectors).max(axis=0)).T[order]
    return np.sqrt(values) / (2 * math.pi) if loaded is None else values, shapes.reshape(count, *rest.shape)
