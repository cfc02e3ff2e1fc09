"""States at finite strain, and conditions on a step of Newton's method: one more equation, or a held direction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.factor import Factor
from shellbench.solvers.fem.mechanics.strain_energy import StrainedMesh
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.basis import ROUNDING

Array = NDArray[np.float64]

KRYLOV = 60  # products of a step; a longer iteration is stopped, which makes Newton's method an inexact one


@dataclass(frozen=True)
class UnsymmetricFactor:
    """The tangent K - A on the free unknowns, with K factorised.

    Attributes
    ----------
    symmetric
        Factorisation of K.
    free
        (nodes, 12) mask of the free unknowns.
    skew
        A, reduced as K is.
    """

    symmetric: Factor
    free: Array
    skew: BlockMatrix

    @classmethod
    def on_free(cls, symmetric: Factor, skew: BlockMatrix, ties: Ties) -> UnsymmetricFactor:
        """Reduce A to the free unknowns."""
        return cls(symmetric, ties.free.astype(float), ties.reduce(skew))

    @property
    def negative_count(self) -> int:
        """Number of negative eigenvalues of K.

        If there is none, no step does negative work, whatever A is: the state does not diverge. The converse is not
        true, so that a path may end too early.
        """
        return self.symmetric.negative_count

    def solve(self, right: Array) -> Array:
        """Solve (K - A) x = right for (nodes, 12, n) right-hand sides."""
        # x - K^-1 A x = K^-1 right, by GMRES. If K is positive definite, K^-1 A has imaginary eigenvalues only, which
        # accumulate at zero: 1 - K^-1 A is never singular.
        return np.stack([self._solve(right[..., k]) for k in range(right.shape[-1])], axis=-1)

    def _solve(self, right: Array) -> Array:
        shape = right.shape

        def backward(vector: Array) -> Array:
            return self.symmetric.solve(vector[..., None])[..., 0]

        def product(flat: Array) -> Array:
            x = flat.reshape(shape)
            return np.asarray(x - backward((self.skew @ (x * self.free)[..., None])[..., 0] * self.free)).ravel()

        start = backward(right)
        operator = LinearOperator((right.size, right.size), matvec=product, dtype=float)
        found, _ = gmres(operator, start.ravel(), x0=start.ravel(), rtol=ROUNDING, atol=0.0, restart=KRYLOV, maxiter=1)
        return np.asarray(found).reshape(shape)


@dataclass(frozen=True)
class MovedSupportsFactor:
    """The factorised tangent of a state, used as an approximation after supports have moved.

    Attributes
    ----------
    factor
        The tangent on the free unknowns at the state.
    before, ties
        The supports at the state, and at the place of use.
    """

    factor: TangentFactor
    before: Ties
    ties: Ties

    @property
    def negative_count(self) -> int:
        """Number of negative eigenvalues at the state."""
        return self.factor.negative_count

    def solve(self, right: Array) -> Array:
        """Solve for (nodes, 12, n) right-hand sides."""
        # The bases of free directions differ; therefore the solve goes through nodal degrees of freedom.
        free = self.before.to_free(self.ties.to_nodal(right))
        return self.ties.to_free(self.before.to_nodal(self.factor.solve(free) * self.before.free[..., None]))


TangentFactor = Factor | UnsymmetricFactor | MovedSupportsFactor


@dataclass(frozen=True)
class FiniteState:
    """A state of equilibrium.

    Attributes
    ----------
    t
        Load factor.
    q
        (nodes, 12) scaled degrees of freedom.
    strained
        Strains and stresses.
    angles
        By edge moment (n,): the angles by which the normals have turned, rad.
    factor
        Factorisation of the tangent stiffness of the last iteration; None if it is singular, or there was none.
    iterations
        Newton iterations that led here.
    residuals
        Largest residual force before each of them, relative to the largest nodal force.
    critical
        Whether it is the last stable state before buckling.
    forgiven
        Negative eigenvalues of the tangent that belong to waves that may travel.
    pressure, touch
        Contact at the contact points, (n,), Pa, and (n, 3), N; None without obstacles, or if unknown.
    tangent
        Tangent stiffness of the state itself, supports not applied, if `factor` is its factorisation; else None.
    """

    t: float
    q: Array
    strained: StrainedMesh
    angles: tuple[Array, ...]
    factor: TangentFactor | None
    iterations: int = 0
    residuals: tuple[float, ...] = ()
    critical: bool = False
    forgiven: int = 0
    pressure: Array | None = None
    touch: Array | None = None
    tangent: BlockMatrix | None = None

    @property
    def stable(self) -> bool:
        """True if the state is a minimum of the potential energy.

        A pressure that follows the shell has no potential. Then it is True if all steps from the state do positive
        work.
        """
        return self.factor is not None and self.factor.negative_count == self.forgiven

    @property
    def without_step_data(self) -> FiniteState:
        """The state without the data that only the next step needs, which take most of the memory."""
        return replace(self, factor=None, tangent=None, strained=replace(self.strained, deformations=(), stresses=()))


@dataclass(frozen=True)
class Constraint:
    """One more equation, c . q + d t = s, for a path on which the load factor is unknown."""

    row: Array
    factor: float
    value: float


@dataclass(frozen=True)
class HeldDirection:
    """A direction w that is excluded from a step, w . dq = 0; no direction if `answer` is None.

    Attributes
    ----------
    row, answer
        (nodes, 12) w, and the shell's displacement under w as a force.
    negative
        Whether the tangent's negative eigenvalue is along w, so that holding w removes it.
    """

    row: Array
    answer: Array | None = None
    negative: bool = False

    @classmethod
    def from_ties(cls, ties: Ties, factor: TangentFactor, row: Array | None) -> HeldDirection:
        """Hold a direction, if there is one, in addition to the supports."""
        if row is None:
            return cls(np.zeros(0))
        # A multiplier m holds w: K dq + m w = r and w . dq = 0. This takes one more solve, A = K^-1 w. By the inertia
        # of the bordered matrix, w . A < 0 means that K has one negative eigenvalue less across w.
        answer = solve_on_free(ties, factor, row)
        return cls(row, answer, bool(np.sum(row * answer) < 0))

    def without_direction(self, step: Array) -> Array:
        """Return a step without its part along w."""
        if self.answer is None:
            return step
        # m = (w . K^-1 r) / (w . A), so that K and its factor need no change.
        return step - self.answer * (np.sum(self.row * step) / np.sum(self.row * self.answer))


def solve_on_free(ties: Ties, factor: TangentFactor, right: Array) -> Array:
    """Return the displacement of the shell under forces (nodes, 12) where the supports leave it free."""
    free = ties.to_free(right[..., None])
    return np.asarray(ties.to_nodal(factor.solve(free) * ties.free[..., None])[..., 0])
