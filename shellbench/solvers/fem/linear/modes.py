"""Modes on one mesh: small vibrations about rest or about a loaded state, and buckling under the case's loads.

    vibration  (K + G(S)) u = omega^2 M u        buckling  K u = -lambda G(S) u

K is the stiffness of the linear shell, M its consistent mass. S are the stress resultants of the linear answer to the
case's loads. G(S) is the sum of these times the second variations of the strains, at the shell's reference state: the
geometric part of the non-linear theory's tangent stiffness at zero displacement.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.modes import why_too_few
from shellbench.solvers.fem.algebra.block_matrix import (
    NEIGHBOURS,
    NODE_DOFS,
    BlockMatrix,
    add_cell_matrices,
    neighbour_columns,
)
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices, cell_dofs
from shellbench.solvers.fem.algebra.choices import Method
from shellbench.solvers.fem.algebra.direct_solve import factorised
from shellbench.solvers.fem.algebra.eigenpairs import BLOCK, NotFoundError, largest_eigenpairs
from shellbench.solvers.fem.algebra.factor import NotPositiveDefiniteError
from shellbench.solvers.fem.linear.equilibrium import Equilibrium, solve
from shellbench.solvers.fem.mechanics.assembly import (
    InternalForces,
    derivatives_on_cells,
    product_matrix,
    root_operators,
    spring_blocks,
    stiffness,
)
from shellbench.solvers.fem.mechanics.clamping import clamped_edges
from shellbench.solvers.fem.mechanics.constraints import support_ties
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    GRADIENT,
    Deformation,
    Midsurface,
    elasticities,
    stiffness_moduli,
    strain_operator,
)
from shellbench.solvers.fem.mechanics.rigid_motions import determinate_pins, nodal_rigid_motions
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, CUBIC, KINDS, present_functions, tabulate
from shellbench.solvers.fem.mesh.grading import shell_size
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature, basis_scales, cell_portions

Array = NDArray[np.float64]
Matrix = BlockMatrix | CellMatrices

FULL_LOAD = 1.0
SHIFT = 1.0  # of the unit B / (rho L^4) of a plate's squared frequencies, by which a shell that may move is held


@dataclass(frozen=True)
class _Modes:
    """A case on a mesh, with the matrices of its modes."""

    case: Case
    mesh: TensorMesh
    quadrature: Quadrature
    method: Method

    @cached_property
    def vibrates(self) -> bool:
        """True if the case asks for frequencies, False for buckling loads."""
        return self.case.quantities[0].kind == "frequency"

    @cached_property
    def motions(self) -> Array:
        """(6, n): free rigid motions."""
        return free_motions(self.case)

    @cached_property
    def ties(self) -> Ties:
        ties = support_ties(self.case, self.mesh, (FULL_LOAD,))
        if self.vibrates or not self.motions.size:
            return ties
        # Stresses do no work on a translation: held or not, it changes no buckling load.
        return ties.with_pins(*determinate_pins(ties.nodes, nodal_rigid_motions(self.case, self.mesh) @ self.motions))

    @cached_property
    def stiffness(self) -> Matrix:
        """The stiffness of the shell alone."""
        return stiffness(self.mesh, self.case.surface, self.case.material, self.quadrature)

    @cached_property
    def support_terms(self) -> Matrix | None:
        """Stiffness of springs, and of clamps between nodes; None without any."""
        clamps = list(clamped_edges(self.case, self.mesh, (FULL_LOAD,)))
        if not clamps and not self.case.springs:
            return None
        springs = spring_blocks(self.case, self.mesh) if self.case.springs else np.zeros_like(self.stiffness.blocks)
        matrix = replace(self.stiffness, blocks=springs)
        for clamp in clamps:
            clamp.add_to(matrix)
        return matrix

    @cached_property
    def mass(self) -> Matrix:
        density = self.case.material.areal_density
        return product_matrix(
            self.mesh, self.case.surface, self.quadrature, lambda points: np.full((len(points), COMPONENTS), density)
        )

    @cached_property
    def geometric(self) -> Matrix | None:
        """The geometric stiffness of the case's loads; None without loads."""
        if not self.case.loads and not any(support.motion is not None for support in self.case.supports):
            return None
        order = 2 * self.mesh.degree + 1
        loaded = solve(self.case, self.mesh, (FULL_LOAD,), order, self.method).solution
        return geometric_stiffness(loaded, self.quadrature)

    def total(self, *matrices: Matrix | None) -> Matrix:
        blocks = [matrix.blocks for matrix in matrices if matrix is not None]
        return replace(self.stiffness, blocks=sum(blocks[1:], start=blocks[0]))

    def reduced(self, matrix: Matrix) -> Matrix:
        return self.ties.reduce_cells(matrix) if isinstance(matrix, CellMatrices) else self.ties.reduce(matrix)

    @cached_property
    def shift(self) -> float:
        """Shift of the squared angular frequencies of a shell that may move freely, 1/s^2."""
        if not self.vibrates or not self.motions.size:
            return 0.0
        material, size = self.case.material, shell_size(self.case)
        return SHIFT * material.bending_stiffness / (material.areal_density * size**4)

    def eigenpairs(self, count: int) -> tuple[Array, Array, Array]:
        """Return the values (count,) increasing, the same as rounded in K, and nodal modes (nodes, dofs, count)."""
        # 1. B is K, plus stresses and a shift if there are any; A is M or -G. Factorise B on the free unknowns.
        # 2. Find the largest mu of A u = mu B u, for the asked number of modes plus the rigid motions.
        # 3. Apply Rayleigh-Ritz to these modes, with energies from strains, which have less rounding than K as a
        #    matrix.
        # 4. Remove the rigid motions: in vibration they are the first modes, at zero.
        first = len(self.motions.T) if self.vibrates else 0
        if self.vibrates:
            ahead, geometric = self.mass, self.geometric
            shift = replace(self.mass, blocks=self.shift * self.mass.blocks) if self.shift else None
            stiff = self.total(self.stiffness, self.support_terms, geometric, shift)
        else:
            geometric = self.geometric
            assert geometric is not None  # a case that asks for buckling loads has loads
            ahead, stiff = replace(geometric, blocks=-geometric.blocks), self.total(self.stiffness, self.support_terms)
        try:
            backward = factorised(self.reduced(stiff), self.mesh, self.method)
        except NotPositiveDefiniteError:
            raise SolveFailure("the shell is not stable at the state about which it is to vibrate") from None
        on_free, shape = self.reduced(ahead), (*self.ties.free.shape, -1)
        start = np.random.default_rng(0).normal(size=(self.ties.free.size, BLOCK)) * self.ties.free.reshape(-1, 1)
        wanted = first + count

        def forward(x: Array) -> Array:
            return (on_free @ x.reshape(shape)).reshape(x.shape)

        def back(x: Array) -> Array:
            return backward(x.reshape(shape)).reshape(x.shape)

        try:
            inverse, vectors = largest_eigenpairs(forward, back, start, wanted)
        except NotFoundError as error:
            if self.vibrates or error.positive >= wanted:
                raise SolveFailure(f"the shell has no {count} modes on this mesh, or they do not converge") from None
            nearest = None
            if not error.positive:  # the factors of the load turned round
                with contextlib.suppress(NotFoundError):
                    nearest = -1 / float(largest_eigenpairs(lambda x: -forward(x), back, start, 1)[0][0])
            raise SolveFailure(why_too_few(count, error.positive, nearest)) from None
        modes = self.ties.to_nodal(vectors.reshape(shape))
        roots = root_operators(self.mesh, self.case.surface, self.case.material, self.quadrature)
        energy = _products_of_modes(modes, InternalForces(self.mesh, self.quadrature, roots)(modes))
        for matrix in (self.support_terms, geometric if self.vibrates else None):
            if matrix is not None:
                energy += _products_of_modes(modes, matrix @ modes)
        # Sort by mu again, which is finite whatever the energy of rigid motions.
        product = _products_of_modes(modes, ahead @ modes)
        found, shares = eigh(product, energy + self.shift * product)
        values = 1 / found[::-1][first:wanted] - self.shift
        return values, 1 / inverse[first:wanted] - self.shift, modes @ shares[:, ::-1][:, first:wanted]


def _products_of_modes(modes: Array, images: Array) -> Array:
    """Return the products (m, m) x^T A x of vectors (nodes, dofs, m) with a symmetric matrix."""
    product = np.einsum("ndi,ndj->ij", modes, images)
    return np.asarray((product + product.T) / 2)


def solve_modes(case: Case, mesh: TensorMesh, quadrature_order: int, method: Method) -> Equilibrium:
    """Find the modes of a case on a mesh. Their mean value takes the place of the potential energy.

    Raises
    ------
    SolveFailure
        If the state of the vibration is not stable, or there are fewer modes than asked for.
    """
    modes = _Modes(case, mesh, Quadrature.of_order(mesh, quadrature_order), method)
    marks = case.states
    asked = [int(mark) for mark in marks]
    values, rounded, shapes = modes.eigenpairs(asked[-1])
    kept = [number - 1 for number in asked]
    scales = mesh.node_scales[:, None, :, None]
    coefficients = shapes[..., kept].reshape(-1, COMPONENTS, len(mesh.kinds), len(marks)) / scales
    solution = FemSolution(
        case=case,
        mesh=mesh,
        coefficients=_unit_shapes(coefficients),
        states=marks,
        support_nodes=modes.ties.nodes,
        support_forces=np.zeros((len(case.supports), len(modes.ties.nodes), COMPONENTS, len(mesh.kinds), len(marks))),
        quadrature_order=quadrature_order,
        parameters=int(np.count_nonzero(modes.ties.free)),
        mode_values=dict(zip(asked, _mode_values(values[kept], modes.vibrates), strict=True)),
    )
    # The Ritz values do not have the first order of K's rounding; its square remains.
    loss = float(np.abs(values - rounded).max() / np.abs(values).max())
    return Equilibrium(solution, float(values.mean()), residual=loss, correction=loss)


def _mode_values(values: Array, vibrates: bool) -> Sequence[float]:
    """Return frequencies, Hz, from squared angular ones; load factors stay."""
    return [math.sqrt(max(value, 0.0)) / (2 * math.pi) if vibrates else float(value) for value in values]


def _unit_shapes(coefficients: Array) -> Array:
    """Return modes (nodes, 3, kinds, m) of which the largest nodal component is 1 m."""
    nodal = coefficients[:, :, 0].reshape(-1, coefficients.shape[-1])
    largest_one = np.take_along_axis(nodal, np.abs(nodal).argmax(axis=0)[None], axis=0)[0]
    return np.asarray(coefficients / largest_one)


def geometric_stiffness(loaded: FemSolution, quadrature: Quadrature) -> Matrix:
    """Return the sum of a linear answer's stress resultants times the second variations of the strains."""
    mesh, case = loaded.mesh, loaded.case
    present = present_functions(mesh.basis)
    unit = [tabulate(quadrature.points, d, mesh.basis) for d in DERIVATIVES]
    table = np.stack([t.reshape(len(t), -1)[:, present] for t in unit], axis=1)
    parts = []
    for cells in cell_portions(mesh):
        points, weights = quadrature.on_cells(mesh, cells)
        flat = points.reshape(-1, 2)
        reference = Midsurface.from_position(case.surface.derivatives(flat, order=2))
        gradients = derivatives_on_cells(mesh, cells, quadrature, loaded.coefficients)[..., 0]
        operator = np.swapaxes(strain_operator(reference), -1, -2).reshape(len(flat), 6, GRADIENT)
        strains = (operator @ gradients.reshape(len(flat), GRADIENT, 1)).reshape(-1, 2, 3, 1)
        moduli = stiffness_moduli(case.surface, case.material, flat)[..., None]
        stresses = (elasticities(reference, case.material) @ strains)[..., 0] * moduli
        stresses *= (weights.ravel() * reference.area)[:, None, None]
        rest = Deformation.from_gradients(reference, np.zeros((len(flat), len(DERIVATIVES), COMPONENTS)))
        form = rest.second_variation(stresses.reshape(-1, 6))
        parts.append(_cell_forms(mesh, cells, form.reshape(*weights.shape, GRADIENT, GRADIENT), table, present))
    if mesh.degree > CUBIC:
        count = mesh.node_count * COMPONENTS * len(mesh.kinds)
        return CellMatrices(np.concatenate(parts), cell_dofs(mesh), present, count)
    blocks = np.zeros((mesh.node_count, len(NEIGHBOURS), NODE_DOFS, NODE_DOFS))
    shape = (COMPONENTS, len(CORNERS), len(KINDS))
    for cells, matrices in zip(cell_portions(mesh), parts, strict=True):
        add_cell_matrices(blocks, mesh.nodes[cells], matrices.reshape(-1, *shape, *shape))
    return BlockMatrix(blocks, neighbour_columns(mesh))


def _cell_forms(mesh: TensorMesh, cells: slice, form: Array, table: Array, present: NDArray[np.int64]) -> Array:
    """Turn forms (cells, q, 15, 15) of derivatives (slow) and components into the cells' matrices (cells, f, f)."""
    sizes, (points, derivatives, functions) = mesh.sizes[cells], table.shape
    steps = np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1)
    shaped = form.reshape(-1, points, derivatives, COMPONENTS, derivatives, COMPONENTS)
    shaped = shaped / (steps[:, None, :, None, None, None] * steps[:, None, None, None, :, None])
    scales = basis_scales(mesh, cells).reshape(len(sizes), -1)[:, present]
    matrices = np.empty((len(sizes), COMPONENTS, functions, COMPONENTS, functions))
    flat = table.reshape(-1, functions)
    for c in range(COMPONENTS):
        for d in range(COMPONENTS):
            half = (shaped[:, :, :, c, :, d] @ table).reshape(len(sizes), points * derivatives, functions)
            matrices[:, c, :, d] = flat.T @ half
    matrices *= scales[:, None, :, None, None] * scales[:, None, None, None, :]
    return matrices.reshape(len(sizes), COMPONENTS * functions, -1)
