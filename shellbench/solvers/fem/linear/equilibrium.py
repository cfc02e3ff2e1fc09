"""Equilibrium of the linear shell on one mesh: assemble, tie, remove rigid motions, solve, read off the reactions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.quantities import DerivativeQuantity
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.algebra.choices import Method
from shellbench.solvers.fem.algebra.direct_solve import LinearSolution, Solve, StrainSystem, solve_reduced
from shellbench.solvers.fem.linear.contact import solve_contact
from shellbench.solvers.fem.mechanics.assembly import InternalForces, root_operators, spring_blocks, stiffness
from shellbench.solvers.fem.mechanics.clamping import ClampedEdge, clamped_edges
from shellbench.solvers.fem.mechanics.constraints import support_ties
from shellbench.solvers.fem.mechanics.contact_points import ContactPoints
from shellbench.solvers.fem.mechanics.loads import Loading
from shellbench.solvers.fem.mechanics.rigid_motions import determinate_pins, nodal_rigid_motions
from shellbench.solvers.fem.mechanics.solution import FemSolution, mean_rigid_motion
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.basis import COMPONENTS
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Work of the loads on a removed rigid motion, relative to all loads, that counts as rounding of the decimals in a file.
# Loads that are not in balance exceed it by a share of order one.
BALANCE = 1e-6


@dataclass(frozen=True)
class Equilibrium:
    """The answer on one mesh.

    Attributes
    ----------
    solution
        The field, without history.
    potential_energy
        Energy of strains and springs less the work of the loads at the last state, J.
    residual, correction, noise
        See `shellbench.solvers.fem.algebra.direct_solve.LinearSolution`.
    assembled
        The shell and the inverse of its K, kept for derivatives if the case asks for some.
    """

    solution: FemSolution
    potential_energy: float
    residual: float
    correction: float = 0.0
    noise: float = 0.0
    assembled: tuple[LinearShell, Solve] | None = None


@dataclass(frozen=True)
class LinearShell:
    """A linear case assembled on a mesh: K with springs and clamps, ties of supports, and pins of free rigid motions.

    Attributes
    ----------
    case, mesh, quadrature, method
        The case, the mesh, its rule and the direct solver.
    ties
        The supports and pins.
    loose
        (6, n) free rigid motions.
    roots
        See `root_operators`.
    matrix, springs, system
        K of the shell with springs, that of springs alone or None, and K with the terms of clamps between nodes.
    clamps
        Edges with such terms.
    careful
        Internal forces from strains, once a solve had to refine by them; they have less rounding than K q.
    """

    case: Case
    mesh: TensorMesh
    quadrature: Quadrature
    method: Method
    ties: Ties
    loose: Array
    roots: list[Array]
    matrix: BlockMatrix | CellMatrices
    springs: BlockMatrix | CellMatrices | None
    system: BlockMatrix | CellMatrices
    clamps: list[ClampedEdge]
    careful: list[InternalForces]

    @classmethod
    def on_mesh(
        cls, case: Case, mesh: TensorMesh, states: Sequence[float], quadrature: Quadrature, method: Method
    ) -> LinearShell:
        """Assemble; InputError if supports contradict each other."""
        ties = support_ties(case, mesh, states)
        # a case that removes no rigid motion was checked to have no free one
        loose = free_motions(case) if case.remove_rigid_motions else np.zeros((len(RIGID_MOTIONS), 0))
        if loose.size:
            ties = ties.with_pins(*determinate_pins(ties.nodes, nodal_rigid_motions(case, mesh) @ loose))
        roots = root_operators(mesh, case.surface, case.material, quadrature)
        matrix = stiffness(mesh, case.surface, case.material, quadrature, roots)
        springs = replace(matrix, blocks=spring_blocks(case, mesh)) if case.springs else None
        if springs:
            matrix = replace(matrix, blocks=matrix.blocks + springs.blocks)
        clamps = list(clamped_edges(case, mesh, states))
        system = matrix
        if clamps and isinstance(matrix, CellMatrices):
            system = matrix.with_cells_copied(np.concatenate([clamp.cells for clamp in clamps]))
        elif clamps:
            system = replace(matrix, blocks=matrix.blocks.copy())
        for clamp in clamps:
            clamp.add_to(system)
        return cls(case, mesh, quadrature, method, ties, loose, roots, matrix, springs, system, clamps, [])

    def internal_forces(self, nodal: Array) -> Array:
        """Return the nodal forces (nodes, 12, n) of strains and springs."""
        if not self.careful:
            return self.matrix @ nodal
        return self.careful[0](nodal) + (self.springs @ nodal if self.springs else 0.0)

    def solve(
        self,
        forces: Array,
        particular: Array,
        system: BlockMatrix | CellMatrices | None = None,
        factor: Solve | None = None,
    ) -> tuple[Array, LinearSolution]:
        """Return the nodal answer (nodes, 12, n) to nodal forces; `system` has further terms in K, of contact."""
        ties, system = self.ties, self.system if system is None else system

        def resisted(nodal: Array) -> Array:
            if not self.careful:
                self.careful.append(InternalForces(self.mesh, self.quadrature, self.roots))
            held = system @ nodal - self.matrix @ nodal if system is not self.matrix else 0.0
            return self.internal_forces(nodal) + held

        by_strains = StrainSystem(
            residual=lambda unknowns: ties.to_free(forces - resisted(ties.to_nodal(unknowns) + particular)),
            product=lambda unknowns: ties.to_free(resisted(ties.to_nodal(unknowns))),
        )
        right = ties.to_free(forces - system @ particular)
        reduced = ties.reduce_cells(system) if isinstance(system, CellMatrices) else ties.reduce(system)
        answer = solve_reduced(reduced, right, self.mesh, self.method, by_strains, factor)
        return ties.to_nodal(answer.unknowns) + particular, answer


def solve(
    case: Case,
    mesh: TensorMesh,
    states: Sequence[float],
    quadrature_order: int,
    method: Method,
    near: FemSolution | None = None,
) -> Equilibrium:
    """Solve a linear case on a mesh at the times or load factors `states`; contact may start from another mesh.

    Raises
    ------
    InputError
        If supports contradict each other.
    SolveFailure
        If the loads are not in balance with the removed rigid motions, or the linear solve fails.
    """
    # 1. Integrate the loads, resolve the supports to ties, and pin free rigid motions.
    # 2. Assemble K with springs and the terms of clamps between nodes.
    # 3. Reduce K and the forces by the ties, and solve; with obstacles, `solve_contact` calls this solve repeatedly.
    # 4. Compute the energy, and the reactions as internal forces less loads, contact forces and gap terms of clamps.
    # 5. Remove the mean rigid motion, and divide the forces among supports.
    # Textbooks take internal forces from K q. If the solve had to refine by strains, they come from strains here, which
    # have less rounding.
    quadrature = Quadrature.of_order(mesh, quadrature_order)
    loading = Loading.on_mesh(case, mesh, quadrature, states)
    shell = LinearShell.on_mesh(case, mesh, states, quadrature, method)
    ties, clamps, loose = shell.ties, shell.clamps, shell.loose
    check_balance(loading, loose)
    forces = loading.nodal
    for clamp in clamps:
        forces = forces + clamp.right_hand_side(mesh.node_count)

    def solved(
        system: BlockMatrix | CellMatrices, forces: Array, state: slice = slice(None)
    ) -> tuple[Array, LinearSolution]:
        return shell.solve(forces, ties.particular[..., state], system)

    pushed: Array | float = 0.0
    touching = None
    if case.obstacles:
        points = ContactPoints.on_mesh(case, mesh)
        found = [
            solve_contact(points, shell.system, forces[..., k : k + 1], t, partial(solved, state=slice(k, k + 1)), near)
            for k, t in enumerate(states)
        ]
        q, answer = np.concatenate([f.q for f in found], axis=-1), found[-1].answer
        pushed = np.concatenate([points.nodal_forces(f.forces) for f in found], axis=-1)
        touching = tuple(points.touch(f.forces) for f in found)
    else:
        q, answer = solved(shell.system, forces)

    internal = shell.internal_forces(q)
    energy = np.sum(q[..., -1] * (internal / 2 - loading.nodal)[..., -1])
    unbalanced = internal - loading.nodal - pushed + sum(clamp.gap_forces(q) for clamp in clamps)
    reactions = unbalanced[ties.nodes]
    scales = mesh.node_scales[:, None, :, None]
    shape = (COMPONENTS, len(mesh.kinds), len(states))
    coefficients, shares = q.reshape(-1, *shape) / scales, ties.sharing.shares(reactions)
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
        touching=touching or (),
    )
    asks = any(isinstance(quantity, DerivativeQuantity) for quantity in case.quantities)
    kept = (shell, answer.factor) if asks else None
    return Equilibrium(solution, float(energy), answer.residual, answer.correction, answer.noise, kept)


def check_balance(loading: Loading, loose: Array) -> None:
    """Check that the loads do no work on the free rigid motions.

    Raises
    ------
    SolveFailure
        If they do.
    """
    imbalance = np.abs(loose.T @ loading.resultant).max(initial=0.0)
    scale = loading.magnitude.max()  # all motions have a similar magnitude, so that one scale suffices
    if imbalance > BALANCE * scale:
        raise SolveFailure(
            "the loads are not in balance: they push the shell along a rigid motion that no support resists"
            f" (imbalance {imbalance / scale:.1e} of the loads)"
        )
