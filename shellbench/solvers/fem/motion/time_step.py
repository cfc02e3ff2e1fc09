"""One step in time by the generalised-alpha method, as the minimum of an incremental potential.

With x = (1 - alpha_f) q_{n+1} + alpha_f q_n, the displacement at the time t_n + (1 - alpha_f) h, the method

    M ((1 - alpha_m) a_{n+1} + alpha_m a_n) + W'(x) + K_s x = f,
    q_{n+1} = q_n + h v_n + h^2 ((1/2 - beta) a_n + beta a_{n+1}),
    v_{n+1} = v_n + h ((1 - gamma) a_n + gamma a_{n+1})

(Chung & Hulbert 1993) is the condition that x makes stationary

    W(x) + x . K_s x / 2 - f . x + c (x - x*) . M (x - x*) / 2,    c = (1 - alpha_m) / ((1 - alpha_f) beta h^2),

where x* is the value of x without any force. Obstacles add impulses: see `contact_in_motion`. For a short step this
potential is convex, and Newton's method with a line search finds its minimum. The factorised tangent is kept from
iteration to iteration and from step to step until it converges too slowly.

Rayleigh's damping keeps it so (`damping`).

Chung & Hulbert (1993), A time integration algorithm for structural dynamics with improved numerical dissipation:
the generalized-alpha method, Journal of Applied Mechanics 60.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.factor import Factor, NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.mechanics.assembly import mass_matrix, spring_matrix
from shellbench.solvers.fem.mechanics.contact_points import CLOSED
from shellbench.solvers.fem.mechanics.strain_energy import StrainedMesh
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.motion.contact_in_motion import STEEPER, Compliance, StepContact, StepPush, TouchingPoints
from shellbench.solvers.fem.motion.damping import StepDamping
from shellbench.solvers.fem.motion.generalised_alpha import Instant, Scheme
from shellbench.solvers.fem.path.finite_state import solve_on_free
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]

# Work of the residual on the last correction, relative to the energies: with a new tangent its square remains.
CONVERGED = 1e-11
# Of that work: a step with less is not made, as strains are expensive.
UNMOVED = 1e-3
MOST_ITERATIONS = 20  # a step that takes more is cut
# Ratio of that work from iteration to iteration beyond which an old tangent is replaced: 0.2 of the error. A smaller
# ratio factorises more often; a larger one iterates longer with an old tangent. It affects time only: `CONVERGED` ends
# a step.
SLOW = 0.04
# Armijo's constant of the textbooks (Nocedal & Wright 2006, section 3.1): the share of the linear prediction by which a
# step along the search direction must lower the potential.
SUFFICIENT = 1e-4
SHORTEST_SEARCH = 2.0**-10  # of the Newton step


@dataclass
class _Tangent:
    """A factorised tangent, used as long as it converges quickly; for one length of step, without obstacles."""

    factor: Factor | None = None
    length: float = 0.0
    compliance: Compliance | None = None


@dataclass(frozen=True)
class MovingShell:
    """A case with dynamics on a mesh, with its scheme in time."""

    problem: FiniteProblem
    scheme: Scheme
    _kept: _Tangent = field(default_factory=_Tangent)

    @cached_property
    def mass(self) -> BlockMatrix:
        """Consistent mass matrix, kg."""
        return mass_matrix(self.problem.case, self.problem.mesh, self.problem.quadrature)

    @cached_property
    def _sparse_mass(self) -> sp.csr_matrix:
        matrix = self.mass.to_csr()
        matrix.eliminate_zeros()  # components have nothing in common
        return matrix

    def momentum(self, v: Array) -> Array:
        """Return the mass matrix times v (nodes, 12)."""
        return np.asarray((self._sparse_mass @ v.ravel()).reshape(v.shape))

    @cached_property
    def springs(self) -> BlockMatrix | None:
        """Stiffness of the springs, N/m."""
        return spring_matrix(self.problem.case, self.problem.mesh) if self.problem.case.springs else None

    @cached_property
    def _sparse_springs(self) -> sp.csr_matrix | None:
        return None if self.springs is None else self.springs.to_csr()

    def spring_forces(self, q: Array) -> Array:
        """Return the forces (nodes, 12) of the springs on a displacement (nodes, 12), N."""
        springs = self._sparse_springs
        return np.zeros_like(q) if springs is None else np.asarray((springs @ q.ravel()).reshape(q.shape))

    @cached_property
    def points(self) -> TouchingPoints | None:
        """Points at which gaps to obstacles are evaluated."""
        return TouchingPoints.on_mesh(self.problem.case, self.problem.mesh) if self.problem.case.obstacles else None

    @cached_property
    def _inertia(self) -> Factor:
        """The factorised mass matrix; the held degrees of freedom do not depend on the time."""
        return factorise(self.problem.ties(0.0).reduce(self.mass), self.problem.dissection)

    def initial_instant(self, h: float) -> Instant:
        """Return the initial state; over the step `h`, supports are assumed to accelerate evenly."""
        problem = self.problem
        q = np.zeros((problem.mesh.node_count, 12))
        ties = problem.ties(0.0)
        # M a = f at rest, without stresses or springs. Supports that move reach their place at h by a constant
        # acceleration, u0 = a h^2 / 2.
        moved = 2 / h**2 * problem.ties(h).particular[..., 0]
        right = problem.loads(0.0) - self.momentum(moved)
        a = moved + solve_on_free(ties, self._inertia, right)
        reaction = np.zeros_like(q)
        reaction[ties.nodes] = (self.momentum(a) - problem.loads(0.0))[ties.nodes]
        return Instant(0.0, q, np.zeros_like(q), a, reaction)

    def energies(self, instant: Instant) -> tuple[float, float]:
        """Return kinetic energy, and that of strains and springs, J."""
        return self._kinetic(instant.v), sum(self.problem.energy.parts(instant.q)) + self._spring_energy(instant.q)

    def _kinetic(self, v: Array) -> float:
        return 0.5 * float(np.sum(v * self.momentum(v)))

    def _spring_energy(self, q: Array) -> float:
        return 0.0 if self.springs is None else 0.5 * float(np.sum(q * self.spring_forces(q)))

    def step(self, start: Instant, h: float) -> Instant:
        """Return the state after a step.

        Raises
        ------
        NotConvergedError
            If Newton's method does not converge: the step is too long.
        """
        problem, s = self.problem, self.scheme
        # 1. Compute the known part of q_{n+1}: `coast` is all of it except a_{n+1}, `free` has no mean acceleration.
        # 2. Guess by a constant acceleration, moved onto the supports.
        # 3. Minimise the incremental potential over x.
        # 4. Recover q, a, v at the end from x, and the supports' reactions from the residual.
        # Chung and Hulbert state the method for linear springs. It has two extensions; this one takes W' at the mean
        # displacement, not the mean of W' at the two ends. Therefore x alone is the step's unknown.
        end, middle = start.t + h, start.t + (1 - s.alpha_f) * h
        ties = problem.ties(end)
        loads = problem.loads(middle)
        coast = start.q + h * start.v + h**2 * (0.5 - s.beta) * start.a
        # (1 - alpha_m) a_{n+1} + alpha_m a_n = 0 gives the acceleration without any force.
        free = coast - h**2 * s.beta * s.alpha_m / (1 - s.alpha_m) * start.a
        target = (1 - s.alpha_f) * free + s.alpha_f * start.q  # x*
        weight = (1 - s.alpha_m) / ((1 - s.alpha_f) * s.beta * h**2)
        damping = StepDamping.of_step(problem.case.dynamics, problem.energy, s, start, h, coast)
        target, weight = damping.with_inertia(target, weight)
        contact = None if self.points is None else self._step_contact(self.points, start, end)
        guess = start.q + h * start.velocity + h**2 / 2 * start.a
        if start.impulse is not None:
            guess = guess + h / 2 * start.impulse
        guess = ties.particular[..., 0] + ties.to_nodal(ties.to_free(guess[..., None]))[..., 0]
        x = (1 - s.alpha_f) * guess + s.alpha_f * start.q
        minimum = _StepPotential(
            self, ties, middle, loads, target, weight, self._kinetic(start.v), start.q, contact, damping
        )
        x, residual, forces, iterations = minimum.minimise(x, h)
        q = minimum.end_displacement(x)
        push = np.zeros_like(q)  # r of `contact_in_motion`
        touched: dict[str, Array] = {}
        supplied, lost = start.supplied, start.lost
        if contact is not None:
            nodal = contact.points.nodal_forces(forces)
            push = solve_on_free(ties, self._inertia, nodal)
            touched = {"touch": forces, "impulse": h * push}
            supplied += contact.work(forces)
            # impulses change the kinetic energy by their work on the velocity in their middle
            lost += contact.work(forces) - h * float(np.sum(nodal * (start.v + h / 2 * push)))
            # the equation of x contains impulses `impulse_factor` times, and reactions contain them once
            residual = residual + (minimum.impulse_factor - 1) * (self.momentum(push) - nodal)
        for clamp in problem.clamps:  # the part of its terms without dm is the force of its support
            clamped = clamp.deform_edge(x, middle)
            residual = residual + clamped.gradient(len(x)) - clamped.gap_forces(len(x))
        a = (q - coast - h**2 * push) / (s.beta * h**2)
        v = start.v + h * ((1 - s.gamma) * start.a + s.gamma * a + push)
        reaction = np.zeros_like(q)
        reaction[ties.nodes] = -residual[ties.nodes]
        # The work of loads is by the trapezium rule. Reactions balance at t_n + (1 - alpha_f) h, which is not the
        # middle of the step. the work of the supports is theirs at the middle of the step, between the instants where
        # reactions are known
        late = (s.alpha_f - 0.5) * h / ((1 - s.alpha_f) * h + s.alpha_f * start.length)
        exerted = reaction + late * (reaction - start.reaction)
        loaded = 0.5 * (problem.loads(start.t) + problem.loads(end)) + exerted
        supplied += float(np.sum(loaded * (q - start.q)))
        supplied -= damping.work(problem.energy, start.q, q, self._kinetic(start.v) + self._kinetic(v), h)
        return Instant(end, q, v, a, reaction, h, iterations, supplied, lost, **touched)

    def _step_contact(self, points: TouchingPoints, start: Instant, end: float) -> StepContact:
        before = np.zeros((len(points.points), 3)) if start.touch is None else start.touch
        return StepContact(points, start.t, end, points.displacement(start.q), before)

    @cached_property
    def _size(self) -> float:
        return float(np.ptp(self.problem.case.surface.position(self.problem.mesh.node_points), axis=0).max())


@dataclass(frozen=True)
class _StepPotential:
    """The incremental potential of one step, with forces balanced at the time t.

    `kinetic` is the kinetic energy, J, at the beginning of the step, and `begin` the displacement.
    """

    shell: MovingShell
    ties: Ties
    t: float
    loads: Array
    target: Array
    weight: float
    kinetic: float = 0.0
    begin: Array = field(default_factory=lambda: np.zeros(()))
    contact: StepContact | None = None
    damping: StepDamping = field(default_factory=StepDamping)

    def _deform(self, x: Array) -> StrainedMesh:
        """Deform the mesh, with the strains that damping counts."""
        return self.shell.problem.energy.deform(x, self.damping.shifts)

    def end_displacement(self, x: Array) -> Array:
        """Return the displacement (nodes, 12) at the step's end."""
        late = self.shell.scheme.alpha_f
        return np.asarray((x - late * self.begin) / (1 - late))

    @property
    def impulse_factor(self) -> float:
        """Factor, in the equation of x, of a force R that moves the step's end by h^2 M^-1 R."""
        return (1 - self.shell.scheme.alpha_m) / self.shell.scheme.beta

    def minimise(self, x: Array, h: float) -> tuple[Array, Array, Array, int]:
        """Return the minimum from a guess that satisfies the supports, and the residual, forces and iterations there.

        Forces (n, 3), N, are those of obstacles.
        """
        # Newton's method on the incremental potential, with an old tangent as long as it converges:
        # 1. Compute step = K^-1 r; the decrement r . step is twice the gain of the quadratic model. With obstacles the
        #    step minimises the model among displacements that enter none: sequential quadratic programming.
        # 2. Backtrack by Armijo's rule, because an old or modified tangent may overshoot.
        # 3. Stop when a full step has a decrement at the floor, or when the next one would have a thousandth of that:
        #    that one is not made, as strains are expensive.
        # 4. Drop the tangent when decrements fall too slowly, or the step was cut.
        # The textbook factorises at each iteration. The inertia c M does not change and grows as 1 / h^2. For a short
        # step it dominates, and the tangent of the step before is nearly right.
        kept = self.shell._kept
        # c depends on the length of the step.
        if kept.length != h:
            kept.factor, kept.length = None, h
        strained = self._deform(x)
        value, size = self._potential(x, strained)
        residual, before, share = self._residual(x, strained), np.inf, 0.0
        for iteration in range(1, MOST_ITERATIONS + 1):
            if not np.isfinite(value):
                break
            if kept.factor is None:
                kept.factor, kept.compliance = self._factorised(x, strained), None
                before = np.inf
            step = solve_on_free(self.ties, kept.factor, residual)
            touch = StepPush(np.zeros((0, 3)), np.zeros(x.shape), np.zeros(x.shape), 0.0)
            if self.contact is not None:
                touch, step = self._contact_step(self.contact, x, step, kept)
            decrement = float(np.sum((residual + touch.nodal) * step))
            if self.contact is None and iteration > 1 and share == 1.0 and abs(decrement) <= UNMOVED * CONVERGED * size:
                return x, residual, touch.forces, iteration - 1
            # Near the minimum a difference of potentials is rounding: without the floor the search would fail there.
            # The floor's energies include the kinetic one, since a shell in free fall has hardly another.
            share, floor, merit = 1.0, CONVERGED * size, value + self._contact_merit(x, touch)
            while True:
                moved = x + share * step
                strained = self._deform(moved)
                found, size = self._potential(moved, strained)
                if found + self._contact_merit(moved, touch) <= merit - SUFFICIENT * share * decrement + floor:
                    break
                share /= 2
                if share < SHORTEST_SEARCH:
                    raise NotConvergedError
            x, value, residual = moved, found, self._residual(moved, strained)
            if decrement <= floor and share == 1.0 and self._gaps_are_closed(x):
                return x, residual + touch.nodal, touch.forces, iteration
            # A new tangent has no earlier decrement, so that its first step never replaces it.
            if decrement > SLOW * before or share < 1.0:
                kept.factor = None
            before = decrement
        raise NotConvergedError

    def _contact_step(self, contact: StepContact, x: Array, step: Array, kept: _Tangent) -> tuple[StepPush, Array]:
        """Return the contact forces if a step would enter obstacles, and the step with these forces."""
        factor, ties = kept.factor, self.ties
        assert factor is not None
        if kept.compliance is None:
            kept.compliance = Compliance(contact.points, lambda right: _solve_on_free(ties, factor, right))
        whole = 1 / (1 - self.shell.scheme.alpha_f)
        u = contact.points.displacement(self.end_displacement(x))
        forces, step = contact.repel(u, step, kept.compliance, self.impulse_factor, whole)
        normal = contact.gap(u)[1]
        pressure = np.sum(forces * normal, axis=-1, keepdims=True)
        rubbing = self.impulse_factor * contact.points.nodal_forces(forces - pressure * normal)
        weight = STEEPER * self.impulse_factor / whole * float(pressure.max())
        return StepPush(forces, self.impulse_factor * contact.points.nodal_forces(forces), rubbing, weight), step

    def _contact_merit(self, x: Array, touch: StepPush) -> float:
        """Return the merit without the potential, J: depths in obstacles, and work against friction as a dead force."""
        if self.contact is None:
            return 0.0
        u = self.contact.points.displacement(self.end_displacement(x))
        return touch.weight * float(self.contact.depths(u).sum()) - float(np.sum(touch.rubbing * x))

    def _gaps_are_closed(self, x: Array) -> bool:
        if self.contact is None:
            return True
        depths = self.contact.depths(self.contact.points.displacement(self.end_displacement(x)))
        return bool(depths.max() <= CLOSED * self.shell._size)

    def _potential(self, x: Array, strained: StrainedMesh) -> tuple[float, float]:
        """Return the incremental potential, and the magnitude of the energies that it is made of, J."""
        away = x - self.target
        inertia = self.weight / 2 * float(np.sum(away * self.shell.momentum(away)))
        elastic = (
            self.damping.factor * strained.energy
            + self.shell.problem.clamp_potential(x, self.t)
            + self.shell._spring_energy(x)
        )
        work = float(np.sum(self.loads * x))
        return inertia + elastic - work, self.kinetic + inertia + elastic + abs(work)

    def _residual(self, x: Array, strained: StrainedMesh) -> Array:
        forces = self.loads - self.damping.factor * strained.forces - self.weight * self.shell.momentum(x - self.target)
        forces -= sum(clamp.deform_edge(x, self.t).gradient(len(x)) for clamp in self.shell.problem.clamps)
        return forces if self.shell.springs is None else forces - self.shell.spring_forces(x)

    def _factorised(self, x: Array, strained: StrainedMesh) -> Factor:
        matrix = self.shell.problem.tangent(x, self.t, strained, strained.stresses, self.damping.factor)
        matrix.blocks[...] += self.weight * self.shell.mass.blocks
        if self.shell.springs is not None:
            matrix.blocks[...] += self.shell.springs.blocks
        reduced = self.ties.reduce(matrix)
        if not np.all(np.isfinite(reduced.blocks)):
            raise NotConvergedError
        try:  # if the potential is not convex, take a descent direction
            return factorise(reduced, self.shell.problem.dissection, "imposed")
        except NotPositiveDefiniteError:
            raise NotConvergedError from None


def _solve_on_free(ties: Ties, factor: Factor, right: Array) -> Array:
    """Return the displacements (nodes, 12, n) of the free unknowns under forces (nodes, 12, n)."""
    return np.asarray(ties.to_nodal(factor.solve(ties.to_free(right)) * ties.free[..., None]))
