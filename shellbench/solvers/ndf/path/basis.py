"""The unknowns of a path: independent combinations of features, and what a displacement of them is."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.ansatz import independent
from shellbench.solvers.ndf.strains.strain_measures import Strained


@dataclass(frozen=True)
class Deformed:
    """A displacement of the shell.

    Attributes
    ----------
    membrane, bending, work
        Parts of the strain energy, and the work of the loads, J.
    residual
        (3 M,): loads less what the strains resist, on the output weights.
    strained, stresses
        At the points of the rule: strains, and what is conjugate to them (N, 6).
    angles
        By moment (n,): the angles that its normals have turned by.
    """

    membrane: float
    bending: float
    work: float
    residual: Tensor
    strained: Strained
    stresses: Tensor
    angles: tuple[Tensor, ...]

    @property
    def potential(self) -> float:
        """Potential energy, J."""
        return self.membrane + self.bending - self.work

    @property
    def magnitude(self) -> float:
        """What the potential energy is made of, J: its parts, each without its sign."""
        return self.membrane + self.bending + abs(self.work)


@dataclass(frozen=True)
class Basis:
    """Independent fields: w = held target + combine y, with `combine` (3 M, r) and `held` (3 M, k)."""

    combine: Tensor
    held: Tensor

    @classmethod
    def from_stiffness(cls, stiffness: Tensor, constraints: Tensor, least: float = 0.0) -> Basis:
        """Choose a basis whose stiffness is the identity, and in which `constraints` (k, 3 M) w = target are held.

        Combinations of constraints that a unit of energy moves by no more than `least`, metres, are left out.
        """
        # Null-space method: with K = 1 in `combine`, a singular value decomposition of the constraints splits it
        # orthogonally. The first columns of V hold the supports' displacements, the others move none of them.
        combine = independent(stiffness)
        if not len(constraints):
            return cls(combine, combine.new_zeros((len(stiffness), 0)))
        u, moved, v = torch.linalg.svd(constraints @ combine)
        k = int((moved > least).sum())
        return cls(combine @ v[k:].T, combine @ (v[:k].T / moved[:k]) @ u[:, :k].T)

    @property
    def size(self) -> int:
        """Number of unknowns r."""
        return self.combine.shape[1]

    def spread(self, y: Tensor) -> Tensor:
        """Return weights (3 M,) of unknowns (r,), less what is held."""
        return self.combine @ y

    def gather(self, force: Tensor) -> Tensor:
        """Return forces (r,) on the unknowns of forces (3 M,) on the weights."""
        return self.combine.T @ force
