"""Static cases: one linear solve, or Newton's method along a path of load factors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial.transform import Rotation

from shellbench.errors import SolveFailure
from shellbench.problems.shell.symmetry.symmetry import Part
from shellbench_kratos.thin_elements import DOFS, Elements
from shellbench_kratos.thin_mesh import Loads, Loose, QuadMesh, Supports

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

BALANCE = 1e-6  # of all loads: a force, of a pin or left over, that says that there is no balance
REFINEMENTS = 2  # of a linear solve, by its residual
MOST_ITERATIONS = 25  # Newton iterations of one load step
SHORTEST = 2.0**-10  # of the path: the smallest load step
EASY = 6  # iterations of a load step after which the next one may be longer
LONGEST_TURN = 1.5  # rad, of a node in one iteration; beyond it Newton's method is not trusted


@dataclass(frozen=True)
class ThinProblem:
    """A part of a shell on a mesh, with all that acts on it."""

    part: Part
    mesh: QuadMesh

    @cached_property
    def positions(self) -> Array:
        """(v, 3) of the nodes at rest, m."""
        return self.part.case.surface.position(self.mesh.nodes)

    @cached_property
    def elements(self) -> Elements:
        """Kratos' elements between the nodes."""
        return Elements(self.positions, self.mesh.quads, self.part.case.isotropic)

    @cached_property
    def supports(self) -> Supports:
        """Supports of the nodes."""
        return Supports.on_mesh(self.part.case, self.mesh)

    @cached_property
    def loose(self) -> Loose:
        """Rigid motions that no support holds."""
        return Loose.from_supports(self.supports)

    @cached_property
    def loads(self) -> Loads:
        """Loads on the nodes."""
        return Loads(self.part.case, self.mesh)

    @cached_property
    def free(self) -> Integers:
        """Degrees of freedom that are solved for."""
        return np.setdiff1d(self.supports.free, self.loose.pins)


@dataclass(frozen=True)
class ThinState:
    """One state of equilibrium.

    Attributes
    ----------
    at
        Load factor.
    values
        (v, 6) displacements, m, and rotation vectors of the nodes.
    work
        Work of the loads at this state as if they had always acted, the sum of f . u over the whole shell, J.
    inner_work
        The same of the internal forces: in the linear theory twice the strain energy.
    iterations
        Linear solves since the state before.
    residual
        Largest force that is not in balance, relative to the sum of all forces that act.
    """

    at: float
    values: Array
    work: float
    inner_work: float
    iterations: int
    residual: float


def factorised(matrix: csc_matrix) -> SuperLU:
    """Factorise a matrix whose pattern is symmetric, without exchanging rows.

    At rest the stiffness is symmetric and positive definite, so that its diagonal may be trusted; the tangents of a
    path are nearly so, and Newton's method forgives the difference. Exchanges would fill the factors of thin shells.

    Raises
    ------
    SolveFailure
        If it is singular.
    """
    try:
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        raise SolveFailure("the stiffness matrix is singular") from None


@dataclass(frozen=True)
class LinearSystem:
    """Stiffness (6 v, 6 v) of elements at rest, factorised for the degrees of freedom that are free."""

    stiffness: csr_matrix
    free: Integers
    factors: SuperLU

    @classmethod
    def at_rest(cls, elements: Elements, free: Integers) -> LinearSystem:
        """Assemble and factorise; SolveFailure if the matrix is singular."""
        elements.begin()
        stiffness, _ = elements.assemble()
        return cls(stiffness, free, factorised(stiffness[free][:, free].tocsc()))

    def solve(self, forces: Array, prescribed: Array) -> Array:
        """Return displacements and rotations (v, 6) under forces (v, 6), with those that are not free as prescribed.

        Raises
        ------
        SolveFailure
            If what is found is not in balance.
        """
        flat = prescribed.ravel().copy()
        for _ in range(1 + REFINEMENTS):
            flat[self.free] += self.factors.solve((forces.ravel() - self.stiffness @ flat)[self.free])
        internal = self.stiffness @ flat
        gap = np.abs((forces.ravel() - internal)[self.free]).max(initial=0.0)
        if not gap <= BALANCE * max(np.abs(forces).max(initial=0.0), np.abs(internal).max(initial=0.0)):
            raise SolveFailure("the stiffness matrix is singular")
        return flat.reshape(-1, DOFS)


def solve_linear(problem: ThinProblem, states: tuple[float, ...]) -> list[ThinState]:
    """Solve a linear case at each load factor.

    Raises
    ------
    SolveFailure
        If the stiffness matrix is singular, or loads are not in balance where nothing holds the shell.
    """
    system = LinearSystem.at_rest(problem.elements, problem.free)
    found = []
    for t in states:
        forces = problem.loads.forces(t)
        values = np.zeros(forces.shape)
        values[:, :3] = problem.supports.prescribed(t)
        values = system.solve(forces, values)
        internal = (system.stiffness @ values.ravel()).reshape(-1, DOFS)
        found.append(_state(problem, t, values, forces, internal, 1))
    return found


@dataclass
class _Moved:
    """Where the nodes are: displacements, Kratos' sum of turns, and what these turns make of each node's axes."""

    displacement: Array
    turns: Array
    axes: Rotation

    def by(self, step: Array) -> _Moved:
        """Return the nodes moved and turned by (v, 6)."""
        axes = Rotation.from_rotvec(step[:, 3:]) * self.axes
        return _Moved(self.displacement + step[:, :3], self.turns + step[:, 3:], axes)

    @property
    def values(self) -> Array:
        """(v, 6) displacements and the rotation vectors of the whole turns."""
        return np.concatenate([self.displacement, self.axes.as_rotvec()], axis=1)


def follow_path(
    problem: ThinProblem, states: tuple[float, ...], steps: int, tolerance: float, tell: Callable[[ThinState], None]
) -> None:
    """Find the equilibrium at each load factor, from the one before it.

    Parameters
    ----------
    problem
        Part and mesh.
    states
        Load factors, increasing.
    steps
        Load steps of the whole path, at least; they are halved where Newton's method fails.
    tolerance
        Newton's last step, relative to the shell's size.
    tell
        Called with each new state.

    Raises
    ------
    SolveFailure
        If Newton's method does not converge even for small steps.
    """
    count = problem.mesh.node_count
    moved = _Moved(np.zeros((count, 3)), np.zeros((count, 3)), Rotation.identity(count))
    longest = states[-1] / steps
    reached, increment = 0.0, longest
    for mark in states:
        iterations = 0
        while reached < mark:
            left = math.ceil((mark - reached) / increment - 1e-9)
            goal = mark if left <= 1 else reached + (mark - reached) / left
            try:
                after, forces, internal, needed = _newton(problem, moved, goal, tolerance)
            except SolveFailure as failure:
                increment = (goal - reached) / 2
                if increment < SHORTEST * states[-1]:
                    raise SolveFailure(f"{failure} beyond load factor {reached:.4g}") from None
                continue
            problem.elements.keep()
            moved, reached, iterations = after, goal, iterations + needed
            if needed <= EASY:
                increment = min(2 * increment, longest)
        tell(_state(problem, mark, moved.values, forces, internal, iterations))


def _newton(problem: ThinProblem, start: _Moved, t: float, tolerance: float) -> tuple[_Moved, Array, Array, int]:
    """Return the state at a load factor, the forces that act, those inside, and how many linear solves it took."""
    free, elements = problem.free, problem.elements
    size = float(np.ptp(problem.positions, axis=0).max())
    forces = problem.loads.forces(t)
    elements.begin()
    elements.move(start.displacement, start.turns)
    moved = start
    step = np.zeros((problem.mesh.node_count, DOFS))
    step[:, :3] = np.where(problem.supports.held[:, :3], problem.supports.prescribed(t) - start.displacement, 0.0)
    stiffness, internal = elements.assemble()
    for iteration in range(1, MOST_ITERATIONS + 1):
        flat = step.ravel()
        solver = factorised(stiffness[free][:, free].tocsc())
        flat[free] = solver.solve((forces.ravel() - internal - stiffness @ flat)[free])
        length, turn = np.abs(step[:, :3]).max(), np.abs(step[:, 3:]).max()
        if not length <= 10 * size or not turn <= LONGEST_TURN:
            raise SolveFailure("Newton's method diverges")
        moved = moved.by(step)
        elements.move(moved.displacement, moved.turns)
        stiffness, internal = elements.assemble()
        if length <= tolerance * size and turn <= tolerance:
            return moved, forces, internal.reshape(-1, DOFS), iteration
        step = np.zeros_like(step)
    raise SolveFailure("Newton's method does not converge")


def _state(problem: ThinProblem, t: float, values: Array, forces: Array, internal: Array, iterations: int) -> ThinState:
    gap = (internal - forces).ravel()
    size = float(np.ptp(problem.positions, axis=0).max())
    largest = np.abs(forces[:, :3]).sum() + np.abs(forces[:, 3:]).sum() / size
    scale = max(float(largest), float(np.abs(internal[:, :3]).max(initial=0.0)), float(np.finfo(float).tiny))
    if np.abs(gap[problem.loose.pins]).max(initial=0.0) > BALANCE * scale:
        raise SolveFailure("the loads are not in balance, and nothing holds the shell")
    values = problem.loose.removed(values, problem.loads.areas)
    by_force = problem.free[problem.free % DOFS < 3]
    work, inner = (problem.part.copies * float(np.sum(acting * values)) for acting in (forces, internal))
    return ThinState(t, values, work, inner, iterations, float(np.abs(gap[by_force]).max(initial=0.0)) / scale)
