"""The equations of equilibrium of a shell at finite strain on one mesh.

The unknowns are the scaled degrees of freedom q and, on a path that no load factor marks, the load factor t:

    r(q, t) = f(t) + f_M(q, t) + f_p(q, t) - W'(q) = 0 on what the supports leave free.

`newton` solves them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS, BlockMatrix
from shellbench.solvers.fem.algebra.dissection import Dissection
from shellbench.solvers.fem.algebra.factor import Factor, NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.mechanics.clamping import FiniteClamp, finite_clamps
from shellbench.solvers.fem.mechanics.constraints import support_ties
from shellbench.solvers.fem.mechanics.contact_points import ContactPoints
from shellbench.solvers.fem.mechanics.loads import EdgeMoment, Loading, area_rule, edge_moments
from shellbench.solvers.fem.mechanics.rigid_motions import Revolution, determinate_pins, nodal_rigid_motions
from shellbench.solvers.fem.mechanics.strain_energy import StrainedMesh, StrainEnergy
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path.contact_at_finite_strain import ContactState, Obstacles
from shellbench.solvers.fem.path.finite_state import FiniteState, TangentFactor, UnsymmetricFactor, solve_on_free
from shellbench.solvers.fem.path.following import FollowingPressure
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FiniteProblem:
    """A case at finite strain on a mesh.

    Attributes
    ----------
    case, mesh, quadrature
        The case, its mesh and quadrature.
    energy
        Strain energy of the mesh.
    moments
        Edge moments of the case.
    clamps
        Clamped edges whose normals turn along them.
    pressure
        Pressures that follow the shell, if any.
    dissection
        Elimination order of the mesh.
    holding
        Whether Newton's method fixes waves that may travel around a shell of revolution.
    """

    case: Case
    mesh: TensorMesh
    quadrature: Quadrature
    energy: StrainEnergy
    moments: tuple[EdgeMoment, ...]
    clamps: tuple[FiniteClamp, ...]
    pressure: FollowingPressure | None
    dissection: Dissection
    holding: bool = False

    @classmethod
    def on_mesh(cls, case: Case, mesh: TensorMesh, quadrature: Quadrature) -> FiniteProblem:
        """Discretise a case."""
        energy = StrainEnergy(mesh, case.surface, case.material, quadrature)
        dissection = Dissection.from_shape(mesh.shape, mesh.domain.periodic)
        moments, clamps = tuple(edge_moments(case, mesh)), tuple(finite_clamps(case, mesh))
        pressure = FollowingPressure(case, energy) if case.following else None
        return cls(case, mesh, quadrature, energy, moments, clamps, pressure, dissection)

    @cached_property
    def points(self) -> ContactPoints | None:
        """Points at which gaps are evaluated; None without obstacles, or in motion, which has its own points."""
        if not self.case.obstacles or self.case.dynamics is not None:
            return None
        return ContactPoints.on_mesh(self.case, self.mesh)

    def obstacle_contact(self, start: FiniteState, t: float) -> Obstacles | None:
        """Return the obstacles at a load factor, with the pressures of a state; None without obstacles."""
        return None if self.points is None else Obstacles.from_pressure(self.points, t, start.pressure)

    @cached_property
    def ties(self) -> Callable[[float], Ties]:
        """Ties of the supports, and of pins against rigid motions, at a load factor."""
        # Supports at rest have the same ties at every t. Moving ones are resolved again, and the last few ties are
        # cached.
        if any(support.motion is not None for support in self.case.supports):
            return lru_cache(maxsize=4)(self._ties)
        fixed = self._ties(1.0)
        return lambda t: fixed

    def _ties(self, t: float) -> Ties:
        ties = support_ties(self.case, self.mesh, (t,))
        if self.case.dynamics is not None:
            return ties  # in motion, free rigid motions are part of the answer
        # Free rigid motions would make K singular. Determinate pins hold them, without a reaction, since the loads are
        # in balance.
        loose = free_motions(self.case)
        if not loose.size:
            return ties
        return ties.with_pins(*determinate_pins(ties.nodes, nodal_rigid_motions(self.case, self.mesh) @ loose))

    @cached_property
    def loads(self) -> Callable[[float], Array]:
        """The nodal forces (nodes, 12) of the dead loads at a load factor."""
        rule = tuple(area_rule(self.case, self.mesh, self.quadrature))  # the same at every t

        def at(t: float) -> Array:
            return Loading.on_mesh(self.case, self.mesh, self.quadrature, (t,), rule).nodal[..., 0]

        if self.case.dynamics is not None and self.case.steady:
            always = at(0.0)
            return lambda t: always
        # Without a marked path loads may depend on t by any formula. On a path they are t times the ones at 1.
        if self.case.path.quantity is None:
            return lru_cache(maxsize=4)(at)
        unit = at(1.0)
        return lambda t: t * unit

    def at_rest(self) -> FiniteState:
        """Return the unloaded state, with its tangent."""
        state = self.undeformed_state()
        try:
            # A mechanism has a singular tangent at rest, which ends a path only if its first step needs this tangent.
            return replace(state, factor=self.factorised(state.q, 0.0, state.strained, state.strained.stresses))
        except NotPositiveDefiniteError:
            return state

    def with_own_tangent(self, state: FiniteState) -> FiniteState:
        """Return a state with its own tangent instead of an older one.

        Raises
        ------
        NotConvergedError
            If the tangent is singular there.
        """
        try:
            factor = self.factorised(state.q, state.t, state.strained, state.strained.stresses)
        except NotPositiveDefiniteError:
            raise NotConvergedError from None
        return replace(state, factor=factor)

    def undeformed_state(self) -> FiniteState:
        """Return the unloaded state without its tangent: no path starts from it; it only provides angles."""
        q = np.zeros((self.mesh.node_count, NODE_DOFS))
        angles = tuple(np.zeros(len(moment.points)) for moment in self.moments)
        return FiniteState(0.0, q, self.energy.deform(q), angles, None)

    def state_at(self, t: float, q: Array, near: FiniteState) -> FiniteState:
        """Return a displacement as a state, without a check of equilibrium; angles are closest to those of `near`."""
        return FiniteState(t, q, self.energy.deform(q), self.angles(q, near), None)

    def applied_forces(self, q: Array, t: float) -> Array:
        """Return the nodal forces (nodes, 12) of all loads on the deformed shell."""
        total = self.loads(t)
        for moment in self.moments:
            total = total + moment.forces(q, t)
        if self.pressure is not None:
            total = total + self.pressure.forces(q, t)
        return total

    def forces(self, q: Array, t: float) -> Array:
        """Return the nodal forces (nodes, 12) of all loads, and of clamps between the nodes."""
        total = self.applied_forces(q, t)
        for clamp in self.clamps:
            total = total - clamp.deform_edge(q, t).gradient(len(q))
        return total

    def reactions(self, state: FiniteState) -> Array:
        """Return the nodal forces (nodes, 12) that the supports exert."""
        # Internal forces less loads. In a clamp's terms between the nodes, the part with dm is no reaction.
        total = state.strained.forces - self.applied_forces(state.q, state.t)
        if self.points is not None and state.touch is not None:
            total = total - self.points.nodal_forces(state.touch)[..., 0]
        for clamp in self.clamps:
            total = total + clamp.deform_edge(state.q, state.t).gap_forces(len(total))
        return total

    def potential(self, state: FiniteState) -> float:
        """Return strain energy less the work of the loads, J; a following pressure counts as a dead load."""
        work = float(np.sum(self.loads(state.t) * state.q))
        if self.pressure is not None:
            work += float(np.sum(self.pressure.forces(state.q, state.t) * state.q))
        for moment, angles in zip(self.moments, state.angles, strict=True):
            work += float(moment.moments(state.t) @ angles)
        clamped = self.clamp_potential(state.q, state.t)
        return state.strained.energy + clamped - work

    def clamp_potential(self, q: Array, t: float) -> float:
        """Return the potential of clamps between the nodes, J."""
        return sum(clamp.deform_edge(q, t).potential for clamp in self.clamps)

    def tangent(
        self, q: Array, t: float, strained: StrainedMesh, stresses: tuple[Array, ...], factor: float = 1.0
    ) -> BlockMatrix:
        """Return the symmetric part of -dr/dq, supports not applied, with these stresses in its geometric part.

        Only a pressure that follows has another part; see `factorised`. The `factor` is of the strain energy.
        """
        matrix = self.energy.tangent(strained, stresses)
        if factor != 1.0:
            matrix.blocks[...] *= factor
        if self.pressure is not None:
            self.pressure.add_tangent(matrix, q, t)
        for moment in self.moments:
            moment.add_tangent(matrix, q, t)
        for clamp in self.clamps:
            clamp.deform_edge(q, t).add_tangent(matrix)
        return matrix

    def path_rate(self, state: FiniteState) -> Array:
        """Return dq/dt (nodes, 12) along the path at a state.

        Raises
        ------
        NotConvergedError
            If the tangent is singular there.
        """
        if state.factor is None:
            raise NotConvergedError
        ties = self.ties(state.t)
        return solve_on_free(ties, state.factor, self.force_rate(state.q))

    @cached_property
    def revolution(self) -> Revolution | None:
        """The shell of revolution, if waves can travel around the case; else None."""
        return Revolution.from_case(self.case, self.mesh)

    def wave_direction(self, q: Array) -> Array | None:
        """Return the direction in which a state's waves travel, if Newton's method has to hold them; else None."""
        return self.revolution.wave_direction(q) if self.holding and self.revolution is not None else None

    def force_rate(self, q: Array) -> Array:
        """Return df/dt (nodes, 12); the loads are proportional to t where this is needed."""
        return self.applied_forces(q, 1.0)

    def factorised(
        self,
        q: Array,
        t: float,
        strained: StrainedMesh,
        stresses: tuple[Array, ...],
        contact: tuple[Obstacles, ContactState] | None = None,
    ) -> TangentFactor:
        """Return the factorised tangent on the free unknowns; NotPositiveDefiniteError if it is singular."""
        ties, matrix = self.ties(t), self.tangent(q, t, strained, stresses)
        if contact:
            contact[0].add_stiffness(matrix, contact[1])
        symmetric = self.reduced_factor(ties, matrix)
        if self.pressure is None:
            return symmetric
        return UnsymmetricFactor.on_free(symmetric, self.pressure.skew(q, t), ties)

    def reduced_factor(self, ties: Ties, matrix: BlockMatrix) -> Factor:
        """Return a symmetric matrix factorised on the free unknowns; NotPositiveDefiniteError if singular."""
        reduced = ties.reduce(matrix)
        if not np.all(np.isfinite(reduced.blocks)):
            raise NotPositiveDefiniteError
        # Newton's method needs no definite K. A path also has unstable states, which the inertia shows.
        return factorise(reduced, self.dissection, "reported")

    def angles(self, q: Array, near: FiniteState) -> tuple[Array, ...]:
        """Return by edge moment the rotation angles of the normals, closest to those of another state."""
        return tuple(m.angles(q, a) for m, a in zip(self.moments, near.angles, strict=True))
