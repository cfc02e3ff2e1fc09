"""Equilibrium of the linear shell on one mesh: assemble, tie, remove rigid motions, solve, read off the reactions.

The reduced system is solved directly, with the residual checked after every solve. `dissection` is our own multifrontal
Cholesky factorisation and the default; `superlu` is SciPy's general sparse LU, `pardiso` the solver of Intel's MKL
through pypardiso, where that is installed. All three see the same matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import RIGID_MOTIONS
from shellbench.problems.shell.rigid import free_motions
from shellbench.solvers.fem.assembly import (
    COMPONENTS,
    BlockMatrix,
    Quadrature,
    spring_matrix,
    stiffness,
)
from shellbench.solvers.fem.clamping import clamped_edges
from shellbench.solvers.fem.constraints import Ties
from shellbench.solvers.fem.dissection import Dissection, NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.loads import Loading
from shellbench.solvers.fem.mesh import KINDS, TensorMesh
from shellbench.solvers.fem.rigid_motions import determinate_pins, mean_rigid_motion, nodal_rigid_motions
from shellbench.solvers.fem.solution import FemSolution
from shellbench.solvers.fem.solver import Method

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]

REFINEMENTS = 2  # steps of iterative refinement after the first solve
LARGEST_RESIDUAL = 1e-5  # relative to the right-hand side; a point load on a graded mesh leaves 1e-8
LARGEST_CORRECTION = 1e-5  # relative change of the answer by the last refinement: what rounding may still hide

SINGULAR = (
    "the stiffness matrix is singular to working precision: check that the supports hold the shell,"
    " and that its thickness is not vanishingly small"
)


@dataclass(frozen=True)
class Answer:
    """A solution of the linear system.

    Attributes
    ----------
    unknowns
        (nodes, 12, n).
    residual
        Largest |K z - f| over largest |f|.
    correction
        Largest change by the last refinement over the largest unknown.
    """

    unknowns: Array
    residual: float
    correction: float


def solve_reduced(matrix: BlockMatrix, right: Array, mesh: TensorMesh, method: Method) -> Answer:
    """Solve K z = f.

    Parameters
    ----------
    matrix
        Symmetric positive definite.
    right
        (nodes, 12, n) right-hand sides.
    mesh
        The mesh that the matrix belongs to.
    method
        Which direct solver.

    Raises
    ------
    SolveFailure
        If the right-hand side is not finite, the matrix is singular, the memory does not suffice, or the residual
        stays large.
    InputError
        If pardiso is asked for and not installed.
    """
    if not np.all(np.isfinite(right)):
        raise SolveFailure("the loads or prescribed motions are not finite at every point of the mesh")
    if not np.all(np.isfinite(matrix.blocks)):
        raise SolveFailure("the stiffness matrix is not finite: the surface or the material is out of range")
    try:
        # Factorise once, then refine by the residual. The textbook forms that in higher precision, and iterates until
        # it is small. In the same precision refinement still mends what a factorisation without pivoting has lost. Its
        # last correction shows the error of the answer, which a small residual of an ill-conditioned K does not.
        backward = _FACTORISATIONS[method](matrix, mesh)
        unknowns = backward(right)
        correction = 0.0
        for _ in range(REFINEMENTS):
            change = backward(right - matrix @ unknowns)
            unknowns = unknowns + change
            correction = _ratio(change, unknowns)
    except MemoryError:
        raise SolveFailure(f"the factorisation of {right[..., 0].size} unknowns does not fit into memory") from None
    except NotPositiveDefiniteError:
        raise SolveFailure(SINGULAR) from None
    residual = _ratio(right - matrix @ unknowns, right)
    # Written so that a residual which is not a number fails.
    if not (residual <= LARGEST_RESIDUAL and correction <= LARGEST_CORRECTION):
        raise SolveFailure(
            f"{SINGULAR} (relative residual {residual:.1e}, last correction {correction:.1e} of the answer)"
        )
    return Answer(unknowns, residual, correction)


def _ratio(part: Array, whole: Array) -> float:
    largest = float(np.abs(whole).max())
    return float(np.abs(part).max()) / largest if largest else 0.0


def _dissection(matrix: BlockMatrix, mesh: TensorMesh) -> Solve:
    return factorise(matrix, Dissection.from_shape(mesh.shape, mesh.domain.periodic)).solve


def _superlu(matrix: BlockMatrix, mesh: TensorMesh) -> Solve:
    options = {"SymmetricMode": True}
    try:
        # symmetric: the rows of a compressed row matrix are the columns of the compressed column one
        columns = sp.csc_matrix(matrix.to_csr().T)
        lu = splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:
        raise NotPositiveDefiniteError from None
    return lambda right: lu.solve(right.reshape(-1, right.shape[-1])).reshape(right.shape)


def _pardiso(matrix: BlockMatrix, mesh: TensorMesh) -> Solve:
    try:
        from pypardiso import PyPardisoSolver
        from pypardiso.pardiso_wrapper import PyPardisoError
    except ImportError:
        raise InputError("direct_solver = 'pardiso' needs pypardiso, which is not installed") from None
    upper = sp.triu(matrix.to_csr(), format="csr")
    pardiso = PyPardisoSolver(mtype=2)  # symmetric positive definite
    # PARDISO perturbs small pivots without a word: hence these, and the check of the residual above.
    pardiso.set_iparm(8, 3)  # steps of iterative refinement
    pardiso.set_iparm(10, 13)  # pivots below 1e-13 are perturbed
    try:
        pardiso.factorize(upper)
    except PyPardisoError:
        raise NotPositiveDefiniteError from None

    def backward(right: Array) -> Array:
        flat = np.asfortranarray(right.reshape(-1, right.shape[-1]))
        return np.asarray(pardiso.solve(upper, flat)).reshape(right.shape)

    return backward


_FACTORISATIONS: dict[Method, Callable[[BlockMatrix, TensorMesh], Solve]] = {
    "auto": _dissection,
    "dissection": _dissection,
    "superlu": _superlu,
    "pardiso": _pardiso,
}


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
        Energy of strains and springs less the work of the loads at the last state, J.
    residual, correction
        See `shellbench.solvers.fem.equilibrium.Answer`.
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
    if case.springs:
        matrix = BlockMatrix(matrix.blocks + spring_matrix(case, mesh).blocks, matrix.columns)
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
