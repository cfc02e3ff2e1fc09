"""Solution of K z = f by a direct solver, with refinement of z until rounding no longer shows.

The effect of rounding is measured after every solve. `dissection` is the project's own multifrontal Cholesky
factorisation and the default; `superlu` is SciPy's general sparse LU; `pardiso` is the solver of Intel's MKL through
pypardiso, if that is installed. All three get the same matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from shellbench.errors import InputError, SolveFailure
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.cell_dissection import dissect_cells, factorise_cells
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.algebra.choices import Method
from shellbench.solvers.fem.algebra.dissection import Dissection
from shellbench.solvers.fem.algebra.factor import NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]

REFINEMENTS = 2  # steps of iterative refinement after the first solve, at most
# Change of the answer by the last refinement above which the residual is computed from strains. It lies below the
# tolerance of smooth cases, 6e-7. A larger value would leave rounding in answers; a much smaller one would compute
# strains in vain.
CAREFUL = 1e-7
# The same in degree 4 and 5: their K has more rounding; a residual by K itself shows only 1 to 15 % of it.
CAREFUL_CELLS = 1e-9
CAREFUL_REFINEMENTS = 4  # at most, as long as each change is smaller than half the one before
# Change of the answer by a refinement that ends them: a thousandth of `CAREFUL`.
REFINED = 1e-10
ALIGNED = 0.5  # cosine between two such changes above which they are no rounding
CONJUGATE_STEPS = 20  # at most, where such refinements do not lead to the answer
# Share of the whole change by conjugate gradients: a smaller step ends a pass. The next pass computes the residual
# again and corrects the rest, so that a smaller value would only cost products. Set on meshes on which refinement by K
# converges slowly.
CONJUGATE_SHARE = 1e-3
CONJUGATE_PASSES = 6  # at most, as long as each changes less than half of the one before: the rest is rounding
# Of a solve: rounding leaves 1e-15, and pivots that were perturbed leave far more.
LARGEST_BACKWARD_ERROR = 1e-10
# Relative change of the answer by the last refinement beyond which rounding hides it, and the mesh fails. More than the
# tolerance of smooth cases, 6e-7, and less than that of forces at points in cubics, 2.5e-5.
LARGEST_CORRECTION = 1e-5


class RoundingError(SolveFailure):
    """Rounding hides the answer on this mesh; it may not on another one."""


@dataclass(frozen=True)
class LinearSolution:
    """A solution of the linear system.

    Attributes
    ----------
    unknowns
        (nodes, 12, n).
    residual
        Largest |K z - f| over largest |f| after refinement by K alone. On thin shells rounding alone makes it large:
        membrane forces that are (L/h)^2 times the loads cancel.
    backward_error
        Largest |K z - f| then over the largest |K| times the largest |z| plus the largest |f|: the relative change of
        K and f by which z becomes exact (Rigal & Gaches 1967), but for the number of terms in a row.
    correction
        Largest change by the last refinement over the largest unknown.
    noise
        Energy of that change, J.
    factor
        The inverse of K as a function, for further solves.
    """

    unknowns: Array
    residual: float
    backward_error: float
    correction: float
    noise: float
    factor: Solve


class StrainSystem(NamedTuple):
    """The system computed from strains, with less rounding than its matrix has.

    Attributes
    ----------
    residual
        f - K z of unknowns z (nodes, 12, n).
    product
        K z.
    """

    residual: Solve
    product: Solve


def solve_reduced(
    matrix: BlockMatrix | CellMatrices,
    right: Array,
    mesh: TensorMesh,
    method: Method,
    careful: StrainSystem | None = None,
    factor: Solve | None = None,
) -> LinearSolution:
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
        The direct solver.
    careful
        The same system with less rounding, if available.
    factor
        Its factor by an earlier solve, if available.

    Raises
    ------
    SolveFailure
        If the right-hand side is not finite, or the memory does not suffice; `RoundingError` if the matrix is
        singular to working precision, or rounding moves the answer.
    InputError
        If pardiso is asked for and not installed.
    """
    if not np.all(np.isfinite(right)):
        raise SolveFailure("the loads or prescribed motions are not finite at every point of the mesh")
    if not np.isfinite(matrix.largest):
        raise SolveFailure("the stiffness matrix is not finite: the surface or the material is out of range")
    try:
        # 1. Factorise once, then refine by the residual. In the same precision this corrects the loss by a
        #    factorisation without pivoting. The remaining residual is rounding, like that in K itself. The last
        #    correction, K^-1 times the residual, is the error that it causes in the answer. The size of the residual
        #    does not show that error.
        # 2. If the correction is large, continue with a residual that does not come from K. The textbook computes one
        #    in higher precision. Strains serve as well, and also correct the rounding of K.
        # 3. If K resists some motion by rounding alone, steps by its factor are far too long or too short. Conjugate
        #    gradients take their lengths from the strains.
        backward = factor or _FACTORISATIONS[method](matrix, mesh)
        much = CAREFUL_CELLS if isinstance(matrix, CellMatrices) else CAREFUL
        unknowns = backward(right)
        correction = noise = 0.0
        for _ in range(REFINEMENTS):
            left = right - matrix @ unknowns
            change = backward(left)
            unknowns = unknowns + change
            correction, noise = _ratio(change, unknowns), _energy(left, change)
            if correction <= REFINED or (careful and correction > much):
                break
        left = right - matrix @ unknowns
        magnitude = matrix.largest * float(np.abs(unknowns).max()) + float(np.abs(right).max())
        backward_error = float(np.abs(left).max()) / magnitude if magnitude else 0.0
        relative = _ratio(left, right)
        lost = False
        if careful and correction > much:
            unknowns, correction, noise, lost = _refine(careful, backward, unknowns, much)
    except MemoryError:
        raise SolveFailure(f"the factorisation of {right[..., 0].size} unknowns does not fit into memory") from None
    except NotPositiveDefiniteError:
        raise RoundingError(
            f"the stiffness matrix is singular to working precision on {_cells(mesh)} cells: a mechanism that the"
            " supports leave, or a thickness that is lost in rounding beside the shell's size"
        ) from None
    answer = LinearSolution(unknowns, relative, backward_error, correction, noise, backward)
    # Written so that NaN fails.
    if not answer.backward_error <= LARGEST_BACKWARD_ERROR:
        raise RoundingError(
            f"the direct solver failed on {_cells(mesh)} cells: its answer solves a system whose stiffness differs by"
            f" {answer.backward_error:.1e} (relative residual {answer.residual:.1e})"
        )
    if lost or not correction <= LARGEST_CORRECTION:
        raise RoundingError(
            f"rounding moves the answer by {correction:.1e} of itself on {_cells(mesh)} cells: the shell resists some"
            " motion with too small a part of its stiffness, for its thickness or for what holds it"
        )
    return answer


def _refine(careful: StrainSystem, backward: Solve, unknowns: Array, much: float) -> tuple[Array, float, float, bool]:
    """Return the answer refined by strains, its last correction, the correction's energy, and True if it is lost."""
    before, last = math.inf, np.zeros_like(unknowns)  # the first step corrects K: it may exceed the last one by K
    for _ in range(CAREFUL_REFINEMENTS):
        left = careful.residual(unknowns)
        change = backward(left)
        unknowns = unknowns + change
        correction, noise = _ratio(change, unknowns), _energy(left, change)
        if correction <= REFINED:
            return unknowns, correction, noise, False
        if not correction < before / 2:
            # Rounding has no direction. Steps that all have one direction approach an answer that K does not contain.
            if correction <= LARGEST_CORRECTION and _cosine(change, last) < ALIGNED:
                return unknowns, correction, noise, False
            break
        before, last = correction, change
    else:
        if correction <= much:
            return unknowns, correction, noise, False
    before, settled = math.inf, True
    for _ in range(CONJUGATE_PASSES):
        left = careful.residual(unknowns)
        change, settled = _conjugate_gradients(careful.product, backward, left)
        unknowns = unknowns + change
        correction, noise = _ratio(change, unknowns), _energy(left, change)
        if not settled or correction <= REFINED or not correction < before / 2:
            break
        before = correction
    return unknowns, correction, noise, not settled


def _conjugate_gradients(product: Solve, backward: Solve, left: Array) -> tuple[Array, bool]:
    """Solve K z = f for each column by conjugate gradients, preconditioned by `backward`; also return True if settled.

    Hestenes & Stiefel (1952), Methods of conjugate gradients for solving linear systems, J. Res. NBS 49.
    """
    found, direction, before = np.zeros_like(left), np.zeros_like(left), np.ones(left.shape[-1])
    for _ in range(CONJUGATE_STEPS):
        near = backward(left)
        work = np.sum(left * near, axis=(0, 1))
        direction = near + _quotient(work, before) * direction
        resisted = product(direction)
        length = _quotient(work, np.sum(direction * resisted, axis=(0, 1)))
        step = length * direction
        found, left, before = found + step, left - length * resisted, work
        if _quotient(*(np.abs(part).max(axis=(0, 1)) for part in (step, found))).max() <= CONJUGATE_SHARE:
            return found, True
    return found, False


def _quotient(above: Array, below: Array) -> Array:
    return np.divide(above, below, out=np.zeros_like(above), where=below != 0)


def _energy(forces: Array, change: Array) -> float:
    return float(np.abs(np.sum(forces * change, axis=(0, 1))).max()) / 2


def _cosine(first: Array, second: Array) -> float:
    lengths = float(np.linalg.norm(first)) * float(np.linalg.norm(second))
    return float(np.sum(first * second)) / lengths if lengths else 0.0


def _cells(mesh: TensorMesh) -> str:
    return f"{mesh.cells[0]} x {mesh.cells[1]}"


def _ratio(part: Array, whole: Array) -> float:
    largest = float(np.abs(whole).max())
    return float(np.abs(part).max()) / largest if largest else 0.0


def _factorise_by_dissection(matrix: BlockMatrix | CellMatrices, mesh: TensorMesh) -> Solve:
    if isinstance(matrix, CellMatrices):
        return factorise_cells(matrix, dissect_cells(mesh)).solve
    return factorise(matrix, Dissection.from_shape(mesh.shape, mesh.domain.periodic)).solve


def _factorise_by_superlu(matrix: BlockMatrix | CellMatrices, mesh: TensorMesh) -> Solve:
    options = {"SymmetricMode": True}
    try:
        # symmetric: the rows of a compressed row matrix are the columns of the compressed column one
        columns = sp.csc_matrix(matrix.to_csr().T)
        lu = splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:
        raise NotPositiveDefiniteError from None
    return lambda right: lu.solve(right.reshape(-1, right.shape[-1])).reshape(right.shape)


def _factorise_by_pardiso(matrix: BlockMatrix | CellMatrices, mesh: TensorMesh) -> Solve:
    try:
        from pypardiso import PyPardisoSolver
        from pypardiso.pardiso_wrapper import PyPardisoError
    except ImportError:
        raise InputError("direct_solver = 'pardiso' needs pypardiso, which is not installed") from None
    upper = sp.triu(matrix.to_csr(), format="csr")
    pardiso = PyPardisoSolver(mtype=2)  # symmetric positive definite
    # PARDISO perturbs small pivots without a warning: hence these settings, and the check of the residual above.
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


_FACTORISATIONS: dict[Method, Callable[[BlockMatrix | CellMatrices, TensorMesh], Solve]] = {
    "auto": _factorise_by_dissection,
    "dissection": _factorise_by_dissection,
    "superlu": _factorise_by_superlu,
    "pardiso": _factorise_by_pardiso,
}


def factorised(matrix: BlockMatrix | CellMatrices, mesh: TensorMesh, method: Method) -> Solve:
    """Return the inverse of a positive definite matrix as a function; else raise NotPositiveDefiniteError."""
    return _FACTORISATIONS[method](matrix, mesh)
