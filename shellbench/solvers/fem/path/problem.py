"""The equations of equilibrium of a shell at finite strain on one mesh, and Newton's method for them.

The unknowns are the scaled degrees of freedom q and, on a path that no load factor marks, the load factor t:

    r(q, t) = f(t) + f_M(q, t) + f_p(q, t) - W'(q) = 0 on what the supports leave free,      c . q + d t = s.

Newton's method takes the stresses in the geometric part of the tangent from the linear prediction of the step before,
C (eps(q) + eps'(q) dq), and those of the displacement itself everywhere else (the mixed integration point method:
Magisano, Leonetti & Garcea 2017). A thin shell's membrane stresses follow from a displacement only when that is exact
to second order; with their prediction a large step converges in a few iterations, still quadratically.

Magisano, Leonetti & Garcea (2017), How to improve efficiency and robustness of the Newton method in geometrically
non-linear structural problem discretized via displacement-based finite elements, CMAME 313.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS, BlockMatrix
from shellbench.solvers.fem.algebra.dissection import Dissection
from shellbench.solvers.fem.algebra.factor import Factor, NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.mechanics.clamping import FiniteClamp, finite_clamps
from shellbench.solvers.fem.mechanics.contact_points import ContactPoints
from shellbench.solvers.fem.mechanics.loads import EdgeMoment, Loading, area_rule, edge_moments
from shellbench.solvers.fem.mechanics.pins import determinate_pins
from shellbench.solvers.fem.mechanics.rigid_motions import Revolution, nodal_rigid_motions
from shellbench.solvers.fem.mechanics.strain_energy import Strained, StrainEnergy
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path.contact_at_finite_strain import Pressed, Pressing
from shellbench.solvers.fem.path.finite_state import (
    Constraint,
    FiniteState,
    Hold,
    PressedFactor,
    TangentFactor,
    TurnedFactor,
    on_free,
)
from shellbench.solvers.fem.path.following import FollowingPressure
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]

CONVERGED = 1e-10  # work of the residual on the last step, relative to the energy: the next one's is its square
BALANCED = 1e-3  # largest residual force before the last step, relative to the largest nodal force
MOST_ITERATIONS = 14  # a step that takes more is cut
MOST_IN_CONTACT = 40  # the same where points come into contact and part, and gaps close round by round
FEW = 3  # iterations with an obstacle that is soft
UNSTRAINED = 1e-14  # strain, relative to the displacements, that is the rounding of a shell that is only moved
HOPELESS = 1e8  # growth of that work that no iteration comes back from
ONTO = 1e-12  # of a displacement: what rounding misses supports by that stand still
SLOW = 1e-2  # ratio of that work from iteration to iteration beyond which an old tangent is replaced: 0.1 of the error
UNKNOWN = float(np.finfo(float).max)  # work before a first step by an old tangent: the second one tells of it
STRICT = 1e-4  # of `CONVERGED`, where the last step was made by an old tangent: what is to come is up to `SLOW` of it


class Known(NamedTuple):
    """A tangent beside a state, and the work of the residual on the step that was made by it, J."""

    factor: TangentFactor
    work: float


@dataclass(frozen=True)
class FiniteProblem:
    """A case at finite strain on a mesh.

    Attributes
    ----------
    case, mesh, quadrature
        What is solved, and on what.
    energy
        Strain energy of the mesh.
    moments
        Edge moments of the case.
    clamps
        Clamped edges whose normals turn along them.
    pressure
        Pressures that follow the shell, if there are any.
    dissection
        Elimination order of the mesh.
    holding
        Whether Newton's method holds waves that may travel around a shell of revolution where they are.
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
        """Where obstacles are asked for their distance; None without any, and in motion, whose steps ask them."""
        if not self.case.obstacles or self.case.dynamics is not None:
            return None
        return ContactPoints.on_mesh(self.case, self.mesh)

    def pressing(self, start: FiniteState, t: float) -> Pressing | None:
        """Return what obstacles there are at a load factor, with the pressures of a state."""
        return None if self.points is None else Pressing.from_pressure(self.points, t, start.pressure)

    @cached_property
    def ties(self) -> Callable[[float], Ties]:
        """The ties of the supports, and of what pins rigid motions, at a load factor."""
        # Supports that stand still tie alike at every t. Those that move are resolved anew, and the last few kept.
        if any(support.motion is not None for support in self.case.supports):
            return lru_cache(maxsize=4)(self._ties)
        fixed = self._ties(1.0)
        return lambda t: fixed

    def _ties(self, t: float) -> Ties:
        ties = Ties.from_case(self.case, self.mesh, (t,))
        if self.case.dynamics is not None:
            return ties  # what nothing holds moves
        # Rigid motions that neither supports nor loads mind would leave K singular. Determinate pins hold them, without
        # a reaction, as the loads balance.
        loose = free_motions(self.case)
        if not loose.size:
            return ties
        return ties.pinned(*determinate_pins(ties, nodal_rigid_motions(self.case, self.mesh) @ loose))

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

    def rest(self) -> FiniteState:
        """Return the state that nothing loads, with its tangent."""
        state = self.undeformed()
        try:
            # A mechanism is singular at rest, which ends a path only if its first step needs this tangent.
            return replace(state, factor=self._factorised(state.q, 0.0, state.strained, state.strained.stresses))
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
            factor = self._factorised(state.q, state.t, state.strained, state.strained.stresses)
        except NotPositiveDefiniteError:
            raise NotConvergedError from None
        return replace(state, factor=factor)

    def undeformed(self) -> FiniteState:
        """Return the state that nothing loads, without its tangent: no path goes on from it, it only tells angles."""
        q = np.zeros((self.mesh.node_count, NODE_DOFS))
        angles = tuple(np.zeros(len(moment.points)) for moment in self.moments)
        return FiniteState(0.0, q, self.energy.at(q), angles, None)

    def state_at(self, t: float, q: Array, near: FiniteState) -> FiniteState:
        """Return a displacement as if it were a state of equilibrium; its angles are the closest to those of `near`."""
        return FiniteState(t, q, self.energy.at(q), self._angles(q, near), None)

    def applied(self, q: Array, t: float) -> Array:
        """Return the nodal forces (nodes, 12) of all loads on the deformed shell."""
        total = self.loads(t)
        for moment in self.moments:
            total = total + moment.forces(q, t)
        if self.pressure is not None:
            total = total + self.pressure.forces(q, t)
        return total

    def forces(self, q: Array, t: float) -> Array:
        """Return the nodal forces (nodes, 12) of all loads, and of clamps between the nodes."""
        total = self.applied(q, t)
        for clamp in self.clamps:
            total = total - clamp.at(q, t).gradient(len(q))
        return total

    def reactions(self, state: FiniteState) -> Array:
        """Return the nodal forces (nodes, 12) that the supports exert."""
        # What the shell asks less what the loads give. Of a clamp's terms between the nodes the part with dm is no
        # reaction.
        total = state.strained.forces - self.applied(state.q, state.t)
        if self.points is not None and state.touch is not None:
            total = total - self.points.nodal(state.touch)[..., 0]
        for clamp in self.clamps:
            total = total + clamp.at(state.q, state.t).gap_forces(len(total))
        return total

    def potential(self, state: FiniteState) -> float:
        """Return strain energy less the work of the loads, J; of a pressure that follows, as if it had come dead."""
        work = float(np.sum(self.loads(state.t) * state.q))
        if self.pressure is not None:
            work += float(np.sum(self.pressure.forces(state.q, state.t) * state.q))
        for moment, angles in zip(self.moments, state.angles, strict=True):
            work += float(moment.moments(state.t) @ angles)
        clamped = self.clamped(state.q, state.t)
        return state.strained.energy + clamped - work

    def clamped(self, q: Array, t: float) -> float:
        """Return the potential of clamps between the nodes, J."""
        return sum(clamp.at(q, t).potential for clamp in self.clamps)

    def tangent(self, q: Array, t: float, strained: Strained, stresses: tuple[Array, ...]) -> BlockMatrix:
        """Return the symmetric part of -dr/dq, supports not applied, with these stresses in its geometric part.

        Only a pressure that follows has another part; see `_factorised`.
        """
        matrix = self.energy.tangent(strained, stresses)
        if self.pressure is not None:
            self.pressure.add_tangent(matrix, q, t)
        for moment in self.moments:
            moment.add_tangent(matrix, q, t)
        for clamp in self.clamps:
            clamp.at(q, t).add_tangent(matrix)
        return matrix

    def drift(self, state: FiniteState) -> Array:
        """Return dq/dt (nodes, 12) along the path at a state.

        Raises
        ------
        NotConvergedError
            If the tangent is singular there.
        """
        if state.factor is None:
            raise NotConvergedError
        ties = self.ties(state.t)
        return on_free(ties, state.factor, self._force_rate(state.q))

    def equilibrium(
        self, start: FiniteState, t: float, tolerance: float = CONVERGED, frugal: bool = False
    ) -> FiniteState:
        """Return the state at a load factor, from another one.

        Newton's method keeps its tangents as long as they will do if it is to be `frugal`: the state's is one nearby.

        Raises
        ------
        NotConvergedError
            If Newton's method does not get there.
        """
        ties = self.ties(t)
        # The change of q that puts the start onto the supports as they are at t, and touches nothing else.
        moved = ties.particular[..., 0] + ties.to_nodal(ties.to_free(start.q[..., None]))[..., 0] - start.q
        known: Known | None = None
        if not self._stays(start, moved):
            moved, known = self.carried(start, t, ties, moved)
        try:
            return self._newton(start, t, ties, moved, None, tolerance, known if frugal else None, frugal)
        except NotConvergedError:
            if start.pressure is None:
                raise
            # by way of soft obstacles, which know nothing of the points that were in contact
            return self._newton(replace(start, pressure=None), t, ties, moved, None, tolerance, None, frugal)

    def _stays(self, start: FiniteState, step: Array) -> bool:
        """Whether a step (nodes, 12) is no more than rounding; where points may touch, any is more."""
        return bool(np.abs(step).max() <= (ONTO * np.abs(start.q).max() if self.points is None else 0.0))

    def carried(self, start: FiniteState, t: float, ties: Ties, moved: Array) -> tuple[Array, Known]:
        """Return a motion of the supports with what the shell answers to it by its tangent at the start, and that."""
        # A support that jumps alone would strain only the cells beside it, and these far too much. One linear solve at
        # the start, K dq = r(q, t) - K moved, spreads the motion over the shell.
        pressing = self.pressing(start, t)
        own = None if pressing else start.tangent
        matrix = own or self.tangent(start.q, start.t, start.strained, start.strained.stresses)
        right = self.forces(start.q, t) - start.strained.forces
        if pressing:
            pressed = pressing.at(start.q)
            pressing.add_stiffness(matrix, pressed)
            right = right + pressed.nodal
        right = right - (matrix @ moved[..., None])[..., 0]
        factor: TangentFactor
        if own and start.factor is not None:
            factor = TurnedFactor(start.factor, self.ties(start.t), ties)
        else:
            try:
                factor = self._reduced_factor(ties, matrix)
            except NotPositiveDefiniteError:
                raise NotConvergedError from None
        hold = Hold.from_ties(ties, factor, self.travelling(start.q))
        step = hold.step(on_free(ties, factor, right))
        return moved + step, Known(factor, abs(float(np.sum(right * step))))

    @cached_property
    def revolution(self) -> Revolution | None:
        """What is symmetric about the case, where waves could travel around it."""
        return Revolution.from_case(self.case, self.mesh)

    def travelling(self, q: Array) -> Array | None:
        """Return the direction in which a state's waves travel, if Newton's method is to hold them."""
        return self.revolution.direction(q) if self.holding and self.revolution is not None else None

    def on_path(
        self,
        start: FiniteState,
        constraint: Constraint,
        guess: tuple[Array, float],
        nearby: TangentFactor | None = None,
    ) -> FiniteState:
        """Return the state that satisfies a constraint, from another one and a guess of the step (dq, dt) to it.

        The tangent of a state nearby is tried first, if there is one.

        Raises
        ------
        NotConvergedError
            If Newton's method does not get there.
        """
        ties = self.ties(start.t)
        known = None if nearby is None else Known(nearby, UNKNOWN)
        return self._newton(start, start.t + guess[1], ties, guess[0], constraint, CONVERGED, known, frugal=True)

    def _newton(
        self,
        start: FiniteState,
        t: float,
        ties: Ties,
        step: Array,
        constraint: Constraint | None,
        tolerance: float,
        known: Known | None,
        frugal: bool,
    ) -> FiniteState:
        """Iterate from `start` after a first step that satisfies the supports (and is a mere prediction)."""
        # Newton's method with predicted stresses:
        # 1. Residual r = f - W' at q, and its size relative to the largest nodal force.
        # 2. Factorise K: strains from q, but the stresses of its geometric part from the step before (see the top).
        # 3. dq = K^-1 r, without travelling waves where they are held, or bordered by the constraint of a path.
        # 4. Predict the next stresses, C (eps + eps' dq), from where q was, if a new K asks for them.
        # 5. Stop when the work r . dq is at rounding and r was already small before the step. Beside the shell's own
        #    forces and energy counts what rounding makes of a shell that is only moved, which has neither.
        # 6. Obstacles press on all that, and add to K. Those that are touched for the first time are soft for a few
        #    iterations, and ever harder. Where gaps are still open at the end, go on with the pressures as multipliers.
        # 7. Where it is frugal, try the old tangent first in 2. and 3.: a solve costs a tenth of a tangent. Its step is
        #    kept if the work falls fast; the work falls by a constant ratio then, and 5. asks for less of it.
        # The textbook takes the stresses of q itself, and damps its steps by a line search. A thin shell's membrane
        # stresses after a bending step are spurious and large, and so would be that K. There is no line search: the
        # residual may grow at first, and the step still be right. A step that does not converge is made shorter by the
        # caller instead.
        q, strained, predicted = start.q, start.strained, partial(tuple, start.strained.stresses)
        factor: TangentFactor | None = None
        pressing = self.pressing(start, t)
        if np.any(step):
            predicted = partial(self.energy.predicted_stresses, strained, step)
            q = q + step
            strained = self.energy.at(q)
        first, before, residuals, waves = 0.0, np.inf, [], self.travelling(start.q)
        if known is not None:
            factor, before = known.factor, known.work
        elif self._stays(start, step):
            factor = start.factor  # at the start itself the tangent is known
        hold = None if factor is None else Hold.from_ties(ties, factor, waves)
        pressed = pressing.at(q) if pressing else None
        membrane = self.case.material.membrane_stiffness
        for iteration in range(1, (MOST_IN_CONTACT if pressing else MOST_ITERATIONS) + 1):
            forces = self.forces(q, t)
            if pressed:
                forces = forces + pressed.nodal
            right = forces - strained.forces
            # The start's forces count too: a shell that is unloaded has no others at its end.
            largest = max(np.abs(forces).max(), np.abs(strained.forces).max(), np.abs(start.strained.forces).max())
            unbalanced, moved = _size(ties, right), UNSTRAINED * float(np.abs(q).max())
            residuals.append(unbalanced / max(largest, np.finfo(float).tiny))
            aged = frugal and not pressing and factor is not None and before < np.inf
            if aged and factor is not None and hold is not None:
                step, change = self._step(ties, factor, right, q, t, constraint, hold)
                aged = abs(float(np.sum(right * step))) <= SLOW * before
            if not aged:
                if iteration > 1 or factor is None or known is not None:
                    try:
                        contact = (pressing, pressed) if pressing and pressed else None
                        factor = self._factorised(q, t, strained, predicted(), contact)
                    except NotPositiveDefiniteError:
                        raise NotConvergedError from None
                    hold = Hold.from_ties(ties, factor, waves)
                assert factor is not None
                assert hold is not None
                step, change = self._step(ties, factor, right, q, t, constraint, hold)
            t += change
            decrement = abs(float(np.sum(right * step)))
            predicted = partial(self.energy.predicted_stresses, strained, step)
            q = q + step
            strained = self.energy.at(q)
            # So does the start's energy, for the same reason.
            scale = max(strained.energy + abs(float(np.sum(forces * q))), start.strained.energy)
            first = first or decrement
            # Spurious stresses may raise the work for a few iterations, but not so far.
            if not np.isfinite(scale) or decrement > HOPELESS * first:
                break
            # r . K^-1 r is small also for a large r along a stiff direction, hence the second condition.
            least = STRICT * tolerance if aged else tolerance
            idle = decrement <= max(least * scale, membrane * moved**2)
            settled = idle and unbalanced <= max(BALANCED * largest, membrane * moved)
            before = decrement
            if pressing:
                if pressing.softer and (settled or iteration % FEW == 0):
                    pressing, settled, first = replace(pressing, softer=pressing.softer[1:]), False, 0.0
                pressing = replace(pressing, held=None)
                pressed = pressing.at(q)
                if settled and not pressed.closed:
                    pressing, settled = pressing.next_round(pressed), False
                    pressed = pressing.at(q)
            if settled:
                assert hold is not None
                angles, forgiven = self._angles(q, start), int(hold.negative)
                found = FiniteState(t, q, strained, angles, factor, iteration, tuple(residuals), forgiven=forgiven)
                return replace(found, pressure=pressed.pressure, touch=pressed.forces) if pressed else found
        raise NotConvergedError

    def _step(
        self,
        ties: Ties,
        factor: TangentFactor,
        right: Array,
        q: Array,
        t: float,
        constraint: Constraint | None,
        hold: Hold,
    ) -> tuple[Array, float]:
        """Return a step (nodes, 12) by a tangent, and that of the load factor."""
        if constraint is not None:
            return self._bordered(ties, factor, right, q, t, constraint)
        return hold.step(on_free(ties, factor, right)), 0.0

    def _bordered(
        self, ties: Ties, factor: TangentFactor, right: Array, q: Array, t: float, constraint: Constraint
    ) -> tuple[Array, float]:
        # Bordering: the matrix [K, -f'; c, d] is neither symmetric nor of the mesh's pattern. Two solves with the
        # factor of K replace it: dq = K^-1 r + dt K^-1 f', with dt from the constraint. At a limit point itself K is
        # singular, but iterations do not hit it to rounding.
        rate = self._force_rate(q)
        both = ties.to_free(np.stack([right, rate], axis=-1))
        solved = ties.to_nodal(factor.solve(both) * ties.free[..., None])
        fixed, moving = solved[..., 0], solved[..., 1]
        row = constraint.row
        missing = constraint.value - float(np.sum(row * (q + fixed))) - constraint.factor * t
        slope = float(np.sum(row * moving)) + constraint.factor
        if slope == 0.0:
            raise NotConvergedError
        change = missing / slope
        return fixed + change * moving, change

    def _force_rate(self, q: Array) -> Array:
        """Return df/dt (nodes, 12); the loads are proportional to t where this is needed."""
        return self.applied(q, 1.0)

    def _factorised(
        self,
        q: Array,
        t: float,
        strained: Strained,
        stresses: tuple[Array, ...],
        contact: tuple[Pressing, Pressed] | None = None,
    ) -> TangentFactor:
        ties, matrix = self.ties(t), self.tangent(q, t, strained, stresses)
        if contact:
            contact[0].add_stiffness(matrix, contact[1])
        symmetric = self._reduced_factor(ties, matrix)
        if self.pressure is None:
            return symmetric
        return PressedFactor.on_free(symmetric, self.pressure.skew(q, t), ties)

    def _reduced_factor(self, ties: Ties, matrix: BlockMatrix) -> Factor:
        reduced = ties.reduce(matrix)
        if not np.all(np.isfinite(reduced.blocks)):
            raise NotPositiveDefiniteError
        # Newton's method needs no definite K. Unstable states lie on a path too, and the inertia tells them.
        return factorise(reduced, self.dissection, "reported")

    def _angles(self, q: Array, near: FiniteState) -> tuple[Array, ...]:
        return tuple(m.angles(q, a) for m, a in zip(self.moments, near.angles, strict=True))


def _size(ties: Ties, forces: Array) -> float:
    return float(np.abs(ties.to_free(forces[..., None])).max())
