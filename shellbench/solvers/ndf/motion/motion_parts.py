"""Parts of Newton's law for a field: energies, the lift, tables of features, and unknowns by reflections."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.jets import COMPONENTS


@dataclass(frozen=True)
class Energies:
    """Parts of the energy at one time, J."""

    kinetic: float
    membrane: float
    bending: float
    springs: float

    @property
    def total(self) -> float:
        """Their sum."""
        return self.kinetic + self.strain

    @property
    def strain(self) -> float:
        """Energy stored by the displacement alone, J."""
        return self.membrane + self.bending + self.springs


@dataclass(frozen=True)
class LiftValues:
    """The lift at the points of the rule: displacement (N, 3) and its gradients (N, 5, 3)."""

    values: Tensor
    gradients: Tensor


@dataclass(frozen=True)
class Table:
    """Features at points, one row a plane and a point: (6 N, M)."""

    rows: Tensor

    def fields(self, output: Tensor) -> Tensor:
        """Return six planes of fields (N, 6, 3) of output weights (3, M)."""
        return (self.rows @ output.T).view(-1, 6, COMPONENTS)  # one product for all points

    def pull_back(self, conjugate: Tensor) -> Tensor:
        """Return the vector (3, M) on the output weights of forces (N, 6, 3) conjugate to the fields."""
        total: Tensor = conjugate.reshape(-1, COMPONENTS).T @ self.rows
        return total


@dataclass(frozen=True)
class ReflectedBasis:
    """Unknowns of orthonormal features: the same as `Basis`, without a matrix.

    The null space of the point supports' conditions is kept as Householder reflections.

    Attributes
    ----------
    free
        (3 M,): True for weights that move; those of components held everywhere do not.
    root
        Root of the areal density: mass is its square times the identity.
    reflections, factors
        (3 M, k) and (k,): LAPACK's form of an orthogonal matrix whose first k columns span the constraints.
    held
        (3 M, k), as in `Basis`.
    """

    free: Tensor
    root: float
    reflections: Tensor
    factors: Tensor
    held: Tensor

    @classmethod
    def from_constraints(cls, free: Tensor, density: float, rows: Tensor) -> ReflectedBasis:
        """Hold the conditions `rows` (k, 3 M) on the weights."""
        # R^T = Q [T; 0]: the first columns of Q span the held directions, the others are free. R Q_1 T^-T = 1.
        own = rows[:, free].T.contiguous()
        reflections, factors = torch.geqrf(own)
        k = own.shape[1]
        held = rows.new_zeros((len(free), k))
        if k:
            first = torch.linalg.householder_product(reflections, factors)
            held[free] = torch.linalg.solve_triangular(reflections[:k].triu(), first.T, upper=True).T
        return cls(free, math.sqrt(density), reflections, factors, held)

    @property
    def size(self) -> int:
        """Number of unknowns r."""
        return int(self.free.sum()) - len(self.factors)

    def spread(self, y: Tensor) -> Tensor:
        """Return weights (3 M,) of unknowns (r,)."""
        own = torch.cat([y.new_zeros(len(self.factors)), y]) / self.root
        w = y.new_zeros(len(self.free))
        w[self.free] = self._apply_reflections(own, back=False)
        return w

    def gather(self, force: Tensor) -> Tensor:
        """Return forces (r,) on the unknowns of forces (3 M,) on the weights."""
        return self._apply_reflections(force[self.free], back=True)[len(self.factors) :] / self.root

    def _apply_reflections(self, own: Tensor, back: bool) -> Tensor:
        """Return Q y for `own` weights y that move, or Q^T y if `back`."""
        if not len(self.factors):
            return own
        turned: Tensor = torch.ormqr(self.reflections, self.factors, own[:, None], transpose=back)[:, 0]
        return turned
