"""The inverse of a nearly singular Gram matrix, regularised at a fixed level.

Random features are nearly dependent: the least eigenvalues of their Gram matrix are rounding, and may be negative. The
textbook raises the level until a Cholesky factorisation succeeds. The answer then depends on that rounding, and so on
the processor. Here the level is fixed. If Cholesky still fails, the eigenvalues are computed, negative ones are set to
zero, and the same level is added: both ways give the same inverse up to rounding.

Iterative refinement restores the weak combinations that are above rounding. With M = A + level I, the residual of M^-1
b is level M^-1 b, so that k refinements add up to

    sum of (level M^-1)^i M^-1 b, i = 0 .. k:   a share 1 - (level / (lambda + level))^(k + 1) of each eigenvector.

The sum needs no residual; M^-1 would magnify the rounding of a residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.quadrature import ROUNDING

REFINEMENTS = 3  # the error is 1e-4 for a combination ten times as stiff as the level; without refinement it is 9 %
JITTER = 1e-12  # on the unit diagonal: ten times the rounding of the matrix, so that rounding does not matter


class IndefiniteError(ArithmeticError):
    """The matrix is not positive semidefinite."""


@dataclass(frozen=True)
class RegularisedInverse:
    """(D^-1 A D^-1 + level I)^-1 between scales D^-1, with D^2 the diagonal of A.

    Attributes
    ----------
    level
        Number that is added to the unit diagonal of the scaled matrix.
    scale
        (n,) D^-1; zero where the diagonal is.
    factor
        (n, n) lower triangle of the Cholesky factor, or eigenvectors divided by the roots of their eigenvalues.
    triangular
        True for a Cholesky factor.
    pivots
        Of LU factors (n, n) instead, of a matrix that is not definite.
    """

    level: float
    scale: Tensor
    factor: Tensor
    triangular: bool
    pivots: Tensor | None = None

    @classmethod
    def from_matrix(cls, matrix: Tensor, level: float) -> RegularisedInverse:
        """Factorise a symmetric positive semidefinite matrix (n, n).

        Raises
        ------
        IndefiniteError
            If it is not finite, or has an eigenvalue that is negative beyond rounding.
        """
        # Scaled to a unit diagonal, features of any magnitude have the same regularisation. A feature without stiffness
        # gets no weight.
        diagonal = matrix.diagonal().clamp_min(0.0).sqrt()
        scale = torch.where(diagonal > 0, 1 / diagonal, torch.zeros_like(diagonal))
        scaled = matrix * scale[:, None] * scale
        scaled.diagonal().fill_(1 + level)
        if not bool(torch.isfinite(scaled).all()):
            raise IndefiniteError
        factor, info = torch.linalg.cholesky_ex(scaled)
        if int(info) == 0:
            return cls(level, scale, factor, triangular=True)
        # `scaled` already contains the level: an eigenvalue below it was negative in A, and is set to zero.
        values, vectors = torch.linalg.eigh(scaled)
        if not float(values[0]) >= -ROUNDING * float(values[-1]):
            raise IndefiniteError
        return cls(level, scale, vectors / values.clamp_min(level).sqrt(), triangular=False)

    @classmethod
    def of_indefinite(cls, matrix: Tensor, level: float) -> RegularisedInverse:
        """Factorise a matrix (n, n) that need be neither definite nor symmetric.

        Raises
        ------
        IndefiniteError
            If it is not finite.
        """
        diagonal = matrix.diagonal().abs().sqrt()
        scale = torch.where(diagonal > 0, 1 / diagonal, torch.zeros_like(diagonal))
        scaled = matrix * scale[:, None] * scale
        scaled.diagonal().add_(level)
        if not bool(torch.isfinite(scaled).all()):
            raise IndefiniteError
        factor, pivots = torch.linalg.lu_factor(scaled)
        return cls(level, scale, factor, triangular=False, pivots=pivots)

    def half(self, right: Tensor) -> Tensor:
        """Return H (n, m) with H^T H = right^T A^-1 right, not refined, for right-hand sides (n, m)."""
        scaled = right * self.scale[:, None]
        if not self.triangular:
            return self.factor.T @ scaled
        result: Tensor = torch.linalg.solve_triangular(self.factor, scaled, upper=False)
        return result

    def __matmul__(self, right: Tensor) -> Tensor:
        """Return A^-1 right, refined, for right-hand sides (n, m)."""
        step = self._solve(right * self.scale[:, None])
        total = step
        for _ in range(REFINEMENTS):
            # The series of the module's docstring. The textbook forms b - A x instead, whose rounding M^-1 would
            # magnify.
            step = self.level * self._solve(step)
            total = total + step
        return total * self.scale[:, None]

    def _solve(self, scaled: Tensor) -> Tensor:
        if self.pivots is not None:
            turned: Tensor = torch.linalg.lu_solve(self.factor, self.pivots, scaled)
            return turned
        if not self.triangular:
            return self.factor @ (self.factor.T @ scaled)
        solved: Tensor = torch.cholesky_solve(scaled, self.factor)
        return solved
