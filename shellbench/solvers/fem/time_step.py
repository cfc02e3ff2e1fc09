"""One step in time by the generalised-alpha method, as the minimum of an incremental potential.

With x = (1 - alpha_f) q_{n+1} + alpha_f q_n, the displacement at the time t_n + (1 - alpha_f) h, the method

    M ((1 - alpha_m) a_{n+1} + alpha_m a_n) + W'(x) + K_s x = f,
    q_{n+1} = q_n + h v_n + h^2 ((1/2 - beta) a_n + beta a_{n+1}),
    v_{n+1} = v_n + h ((1 - gamma) a_n + gamma a_{n+1})

(Chung & Hulbert 1993) says that x makes stationary

    W(x) + x . K_s x / 2 - f . x + c (x - x*) . M (x - x*) / 2,    c = (1 - alpha_m) / ((1 - alpha_f) beta h^2),

where x* is where x would go without any force. For a short step that is convex, and Newton's method with a line search
finds its minimum. The factorised tangent is kept from iteration to iteration and from step to step until it is too old
to converge quickly.

Chung & Hulbert (1993), A time integration algorithm for structural dynamics with improved numerical dissipation:
the generalized-alpha method, Journal of Applied Mechanics 60.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.fem.assembly import BlockMatrix, mass_matrix, spring_matrix
from shellbench.solvers.fem.constraints import Ties
from shellbench.solvers.fem.dissection import Factor, NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.problem import FiniteProblem, NotConvergedError
from shellbench.solvers.fem.strain_energy import Strained

Array = NDArray[np.float64]

CONVERGED = 1e-11  # work of the residual on the last correction, relative to the energies: its square is what is left
MOST_ITERATIONS = 20  # a step that takes more is cut
SLOW = 0.04  # ratio of that work from iteration to iteration beyond which an old tangent is replaced: 0.2 of the error
SUFFICIENT = 1e-4  # share of the linear prediction by which a step along the search direction must lower the potential
SHORTEST_SEARCH = 2.0**-10  # of the Newton step


@dataclass(frozen=True)
class Scheme:
    """The generalised-alpha method's constants for a spectral radius at infinite frequency, 0 <= rho <= 1.

    It is of second order and unconditionally stable on linear problems; the less rho, the more the frequencies are
    damped that a step does not resolve.
    """

    spectral_radius: float

    @property
    def alpha_m(self) -> float:
        """Weight of the acceleration at the step's begin."""
        return (2 * self.spectral_radius - 1) / (self.spectral_radius + 1)

    @property
    def alpha_f(self) -> float:
        """Weight of the displacement at the step's begin."""
        return self.spectral_radius / (self.spectral_radius + 1)

    @property
    def gamma(self) -> float:
        """Newmark's gamma."""
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        """Newmark's beta."""
        return (1 - self.alpha_m + self.alpha_f) ** 2 / 4


@dataclass(frozen=True)
class Instant:
    """A state of motion.

    Attributes
    ----------
    t
        Time, s.
    q, v, a
        (nodes, 12) scaled degrees of freedom, and their rates.
    reaction
        (nodes, 12) what the supports exert, at the time within the step before at which it is balanced.
    length
        Of the step before, s.
    iterations
        Newton iterations of the step that led here.
    supplied
        Work of the supports and loads since rest, J.
    """

    t: float
    q: Array
    v: Array
    a: Array
    reaction: Array
    length: float = 0.0
    iterations: int = 0
    supplied: float = 0.0


@dataclass
class _Kept:
    """A factorised tangent that is used as long as it converges quickly; of one length of step."""

    factor: Factor | None = None
    length: float = 0.0


@dataclass(frozen=True)
class MovingShell:
    """A case with dynamics on a mesh, and how it steps in time."""

    problem: FiniteProblem
    scheme: Scheme
    _kept: _Kept = field(default_factory=_Kept)

    @cached_property
    def mass(self) -> BlockMatrix:
        """Consistent mass matrix, kg."""
        return mass_matrix(self.problem.case, self.problem.mesh, self.problem.quadrature)

    @cached_property
    def springs(self) -> BlockMatrix | None:
        """Stiffness of the springs, N/m."""
        return spring_matrix(self.problem.case, self.problem.mesh) if self.problem.case.springs else None

    def at_rest(self, h: float) -> Instant:
        """Return the begin of the motion; `h` is the step over which supports are taken to gather speed evenly."""
        problem = self.problem
        q = np.zeros((problem.mesh.node_count, 12))
        ties = problem.ties(0.0)
        # M a = f at rest, without stresses or springs. Supports that move reach their place at h by a constant
        # acceleration, u0 = a h^2 / 2.
        moved = 2 / h**2 * problem.ties(h).particular[..., 0]
        right = problem.loads(0.0) - _times(self.mass, moved)
        factor = factorise(ties.reduce(self.mass), problem.dissection)
        a = moved + _on_free(ties, factor, right)
        reaction = np.zeros_like(q)
        reaction[ties.nodes] = (_times(self.mass, a) - problem.loads(0.0))[ties.nodes]
        return Instant(0.0, q, np.zeros_like(q), a, reaction)

    def energies(self, instant: Instant) -> tuple[float, float]:
        """Return kinetic energy, and that of strains and springs, J."""
        return self._kinetic(instant.v), sum(self.problem.energy.parts(instant.q)) + self._sprung(instant.q)

    def _kinetic(self, v: Array) -> float:
        return 0.5 * float(np.sum(v * _times(self.mass, v)))

    def _sprung(self, q: Array) -> float:
        return 0.0 if self.springs is None else 0.5 * float(np.sum(q * _times(self.springs, q)))

    def step(self, start: Instant, h: float) -> Instant:
        """Return the state after a step.

        Raises
        ------
        NotConvergedError
            If Newton's method does not converge: the step is too long.
        """
        problem, s = self.problem, self.scheme
        # 1. Collect what is known of q_{n+1}: `coast` is all of it but a_{n+1}, `free` has no mean acceleration.
        # 2. Guess by a constant acceleration, moved onto the supports.
        # 3. Minimise the incremental potential over x.
        # 4. Recover q, a, v at the end from x, and the supports' reactions from the residual.
        # Chung and Hulbert state the method for linear springs. Of its two extensions this takes W' at the mean
        # displacement, not the mean of W' at the two ends. So x alone is the step's unknown.
        end, middle = start.t + h, start.t + (1 - s.alpha_f) * h
        ties = problem.ties(end)
        loads = problem.loads(middle)
        coast = start.q + h * start.v + h**2 * (0.5 - s.beta) * start.a
        # (1 - alpha_m) a_{n+1} + alpha_m a_n = 0 gives the acceleration without any force.
        free = coast - h**2 * s.beta * s.alpha_m / (1 - s.alpha_m) * start.a
        target = (1 - s.alpha_f) * free + s.alpha_f * start.q  # x*
        weight = (1 - s.alpha_m) / ((1 - s.alpha_f) * s.beta * h**2)
        guess = start.q + h * start.v + h**2 / 2 * start.a
        guess = ties.particular[..., 0] + ties.to_nodal(ties.to_free(guess[..., None]))[..., 0]
        x = (1 - s.alpha_f) * guess + s.alpha_f * start.q
        minimum = _Minimum(self, ties, loads, target, weight, self._kinetic(start.v))
        x, residual, iterations = minimum.find(x, h)
        q = (x - s.alpha_f * start.q) / (1 - s.alpha_f)
        a = (q - coast) / (s.beta * h**2)
        v = start.v + h * ((1 - s.gamma) * start.a + s.gamma * a)
        reaction = np.zeros_like(q)
        reaction[ties.nodes] = -residual[ties.nodes]
        # Loads by the trapezium rule. Reactions balance at t_n + (1 - alpha_f) h, which is not the middle of the step.
        # the work of the supports is theirs at the middle of the step, between the instants where reactions are known
        late = (s.alpha_f - 0.5) * h / ((1 - s.alpha_f) * h + s.alpha_f * start.length)
        exerted = reaction + late * (reaction - start.reaction)
        loaded = 0.5 * (problem.loads(start.t) + problem.loads(end)) + exerted
        supplied = start.supplied + float(np.sum(loaded * (q - start.q)))
        return Instant(end, q, v, a, reaction, h, iterations, supplied)


@dataclass(frozen=True)
class _Minimum:
    """The incremental potential of one step; `kinetic` is the energy, J, that the shell begins it with."""

    shell: MovingShell
    ties: Ties
    loads: Array
    target: Array
    weight: float
    kinetic: float = 0.0

    def find(self, x: Array, h: float) -> tuple[Array, Array, int]:
        """Return the minimum from a guess that satisfies the supports, the residual there, and the iterations."""
        # Newton's method on the incremental potential, with an old tangent as long as it will do:
        # 1. step = K^-1 r; the decrement r . step is twice what the quadratic model gains.
        # 2. Backtrack by Armijo's rule, because an old tangent and one made definite may overshoot.
        # 3. Stop when a full step has a decrement at the floor.
        # 4. Drop the tangent when decrements fall too slowly, or the step was cut.
        # The textbook factorises at each iteration. The inertia c M does not change and grows as 1 / h^2. For a short
        # step it dominates, and the tangent of the step before is nearly right.
        kept, energy = self.shell._kept, self.shell.problem.energy
        # c depends on the length of the step.
        if kept.length != h:
            kept.factor, kept.length = None, h
        strained = energy.at(x)
        value, size = self._potential(x, strained)
        before = np.inf
        for iteration in range(1, MOST_ITERATIONS + 1):
            residual = self._residual(x, strained)
            if not np.isfinite(value):
                break
            if kept.factor is None:
                kept.factor = self._factorised(x, strained)
                before = np.inf
            step = _on_free(self.ties, kept.factor, residual)
            decrement = float(np.sum(residual * step))
            # Near the minimum a difference of potentials is rounding: without the floor the search would fail there.
            # The floor's energies include the kinetic one, since a shell in free fall has hardly another.
            share, floor = 1.0, CONVERGED * size
            while True:
                moved = x + share * step
                strained = energy.at(moved)
                found, size = self._potential(moved, strained)
                if found <= value - SUFFICIENT * share * decrement + floor:
                    break
                share /= 2
                if share < SHORTEST_SEARCH:
                    raise NotConvergedError
            x, value = moved, found
            if decrement <= floor and share == 1.0:
                return x, self._residual(x, strained), iteration
            # A new tangent has no decrement before it, so that it is never judged by its first step.
            if decrement > SLOW * before or share < 1.0:
                kept.factor = None
            before = decrement
        raise NotConvergedError

    def _potential(self, x: Array, strained: Strained) -> tuple[float, float]:
        """Return the incremental potential, and the magnitude of the energies that it is made of, J."""
        away = x - self.target
        inertia = self.weight / 2 * float(np.sum(away * _times(self.shell.mass, away)))
        elastic, work = strained.energy + self.shell._sprung(x), float(np.sum(self.loads * x))
        return inertia + elastic - work, self.kinetic + inertia + elastic + abs(work)

    def _residual(self, x: Array, strained: Strained) -> Array:
        forces = self.loads - strained.forces - self.weight * _times(self.shell.mass, x - self.target)
        return forces if self.shell.springs is None else forces - _times(self.shell.springs, x)

    def _factorised(self, x: Array, strained: Strained) -> Factor:
        matrix = self.shell.problem.energy.tangent(strained)
        matrix.blocks[...] += self.weight * self.shell.mass.blocks
        if self.shell.springs is not None:
            matrix.blocks[...] += self.shell.springs.blocks
        reduced = self.ties.reduce(matrix)
        if not np.all(np.isfinite(reduced.blocks)):
            raise NotConvergedError
        try:  # where the potential is not convex, a descent direction all the same
            return factorise(reduced, self.shell.problem.dissection, "imposed")
        except NotPositiveDefiniteError:
            raise NotConvergedError from None


def _times(matrix: BlockMatrix, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _on_free(ties: Ties, factor: Factor, right: Array) -> Array:
    free = ties.to_free(right[..., None])
    return np.asarray(ties.to_nodal(factor.solve(free) * ties.free[..., None])[..., 0])
