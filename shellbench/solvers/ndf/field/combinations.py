"""Scalar features of which a field is a linear combination, and combinations of them that are independent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field.jets import Array, Placement

DEPENDENT = 1e-12  # combinations less stiff than this share of the stiffest are rounding, with ten times its room


class FeatureSet(Protocol):
    """Scalar features of which a field is a linear combination."""

    @property
    def count(self) -> int:
        """Number of features M."""
        ...

    @property
    def placement(self) -> Placement:
        """Where they live and in what precision."""
        ...

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, M) at points (N, 2)."""
        ...

    def values(self, points: Array) -> Tensor:
        """Return the values (N, M) at points (N, 2)."""
        ...


@dataclass(frozen=True)
class Combined:
    """Combinations (M, r) of other features, independent in a stiffness (M, M) if it is given."""

    features: FeatureSet
    combine: Tensor
    stiffness: Tensor | None = None

    def __post_init__(self) -> None:
        # as in `shellbench.solvers.ndf.field.network.Network`; eigenvectors come column by column
        object.__setattr__(self, "combine", self.combine.contiguous())

    @property
    def count(self) -> int:
        """Number of combinations r."""
        return self.combine.shape[1]

    @property
    def placement(self) -> Placement:
        """Where they live and in what precision."""
        return self.features.placement

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, r) at points (N, 2)."""
        return self.features.jets(points) @ self.combine

    def values(self, points: Array) -> Tensor:
        """Return the values (N, r) at points (N, 2)."""
        return self.features.values(points) @ self.combine


def independent(stiffness: Tensor) -> Tensor:
    """Return combinations (n, r) whose stiffness is the identity, from a positive semidefinite matrix (n, n).

    Raises
    ------
    SolveFailure
        If the matrix is not finite.
    """
    if not bool(torch.isfinite(stiffness).all()):
        raise SolveFailure("the energy of the features is not finite")
    diagonal = stiffness.diagonal().clamp_min(0.0).sqrt()
    scale = torch.where(diagonal > 0, 1 / diagonal, torch.zeros_like(diagonal))
    values, vectors = torch.linalg.eigh(stiffness * scale[:, None] * scale)
    kept = values > DEPENDENT * values[-1]
    combine: Tensor = scale[:, None] * vectors[:, kept] / values[kept].sqrt()
    return combine
