"""Equilibrium of the linear shell on one mesh: assemble, tie, remove rigid motions, solve, read off the reactions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import RIGID_MOTIONS
from shellbench.problems.shell.rigid import free_motions
from shellbench.solvers.fem.assembly import (
    COMPONENTS,
    BlockMatrix,
    Quadrature,
    stiffness,
)
from shellbench.solvers.fem.choices import Method
from shellbench.solvers.fem.clamping import clamped_edges
from shellbench.solvers.fem.constraints import Ties
from shellbench.solvers.fem.linear_solve import solve_reduced
from shellbench.solvers.fem.loads import Loading
from shellbench.solvers.fem.mesh import KINDS, TensorMesh
from shellbench.solvers.fem.rigid_motions import determinate_pins, mean_rigid_motion, nodal_rigid_motions
from shellbench.solvers.fem.solution import FemSolution

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

BALANCE = 1e-6  # work of the loads on a removed rigid motion that still counts as rounding, relative to all loads


@dataclass(frozen=True)
class Equilibrium:
    """The answer on one mesh.

    Attributes
    ----------
    solution
        The field, without history.
    potential_energy
        Strain energy less the work of the loads at the last state, J.
    residual, correction
        See `shellbench.solvers.fem.linear_solve.Answer`.
    """

    solution: FemSolution
    potential_energy: float
    residual: float
    correction: float


def solve(case: Case, mesh: TensorMesh, states: Sequence[float], quadrature_order: int, method: Method) -> Equilibrium:
    """Solve a linear case on a mesh at the times or load factors `states`.

    Raises
    ------
    InputError
        If supports contradict each other.
    SolveFailure
        If the loads are not in balance with the removed rigid motions, or the linear solve fails.
    """
    quadrature = Quadrature.of_order(mesh, quadrature_order)
    loading = Loading.on_mesh(case, mesh, quadrature, states)
    ties = Ties.from_case(case, mesh, states)
    # a case that names no rigid motion was checked to have none that is free
    loose = free_motions(case) if case.remove_rigid_motions else np.zeros((len(RIGID_MOTIONS), 0))
    check_balance(loading, loose)
    if loose.size:
        ties = ties.pinned(*determinate_pins(ties, nodal_rigid_motions(case, mesh) @ loose))

    matrix = stiffness(mesh, case.surface, case.material, quadrature)
    clamps = list(clamped_edges(case, mesh, states))
    system = BlockMatrix(matrix.blocks.copy(), matrix.columns) if clamps else matrix
    forces = loading.nodal
    for clamp in clamps:
        clamp.add_to(system)
        forces = forces + clamp.right_hand_side(mesh.node_count)
    answer = solve_reduced(ties.reduce(system), ties.to_free(forces - system @ ties.particular), mesh, method)
    q = ties.to_nodal(answer.unknowns) + ties.particular

    internal = matrix @ q
    energy = np.sum(q[..., -1] * (internal / 2 - loading.nodal)[..., -1])
    unbalanced = internal - loading.nodal + sum(clamp.gap_forces(q) for clamp in clamps)
    reactions = unbalanced[ties.nodes]
    scales = mesh.node_scales[:, None, :, None]
    shape = (COMPONENTS, len(KINDS), len(states))
    coefficients, shares = q.reshape(-1, *shape) / scales, ties.shares(reactions)
    if loose.size:
        coefficients = coefficients - mean_rigid_motion(case, mesh, quadrature, coefficients, loose)
    solution = FemSolution(
        case=case,
        mesh=mesh,
        coefficients=coefficients,
        states=tuple(states),
        support_nodes=ties.nodes,
        support_forces=shares.reshape(*shares.shape[:2], *shape) * scales[ties.nodes],
        quadrature_order=quadrature_order,
        parameters=int(np.count_nonzero(ties.free)),
    )
    return Equilibrium(solution, float(energy), answer.residual, answer.correction)


def check_balance(loading: Loading, loose: Array) -> None:
    """Check that the loads do no work on the rigid motions that nothing resists.

    Raises
    ------
    SolveFailure
        If they do.
    """
    imbalance = np.abs(loose.T @ loading.resultant).max(initial=0.0)
    scale = loading.magnitude.max()  # the motions are of like magnitude, so that one scale serves them all
    if imbalance > BALANCE * scale:
        raise SolveFailure(
            "the loads are not in balance: they push the shell along a rigid motion that no support resists"
            f" (imbalance {imbalance / scale:.1e} of the loads)"
        )
