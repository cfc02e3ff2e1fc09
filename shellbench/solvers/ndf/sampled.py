"""Features and reference geometry at points, and what goes between the output weights and displacement gradients.

Also here: independent combinations of nearly dependent features.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.strain_measures import GRADIENTS, gradients_through
from shellbench.solvers.ndf.undeformed import Undeformed

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
    """Combinations (M, r) of other features."""

    features: FeatureSet
    combine: Tensor

    def __post_init__(self) -> None:
        # as in `shellbench.solvers.ndf.network.Network`; eigenvectors come column by column
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


COMPONENTS = 3
COLUMNS = 6 * COMPONENTS  # components of F by planes of its jet


@dataclass(frozen=True)
class Sampled:
    """N points of a shell for M features: gradients of u = lift + M F are affine in the output weights (3, M).

    Attributes
    ----------
    points
        (N, 2).
    jets
        (N, 6, M) of the features.
    through
        (N, 15, 18) from the jet of F to displacement gradients (`strain_measures.gradients_through`).
    matrix
        (N, 3, 3) values of the boundary matrix M.
    undeformed
        The surface.
    """

    points: Array
    jets: Tensor
    through: Tensor
    matrix: Tensor
    undeformed: Undeformed

    @classmethod
    def at_points(cls, ansatz: Ansatz, features: FeatureSet, points: Array) -> Sampled:
        """Tabulate points (N, 2)."""
        placement, surface = features.placement, ansatz.case.surface
        undeformed = Undeformed.at_points(surface, points, placement)
        matrix = ansatz.factors.matrix(points, placement)
        through = gradients_through(undeformed.geometry, matrix)
        jets = features.jets(points).permute(1, 0, 2).contiguous()
        return cls(points, jets, through, matrix[VALUE], undeformed)

    def carried(self, ansatz: Ansatz) -> Sampled:
        """Return the same points and features with other boundary factors."""
        matrix = ansatz.factors.matrix(self.points, Placement(self.jets.device, self.jets.dtype))
        return replace(self, through=gradients_through(self.undeformed.geometry, matrix), matrix=matrix[VALUE])

    def lift_gradients(self, ansatz: Ansatz) -> Tensor | None:
        """Return the gradients (N, 5, 3) of the lift, None where it is zero."""
        if not ansatz.lift.moves:
            return None
        jet = ansatz.lift.jet(self.points, Placement(self.jets.device, self.jets.dtype))
        return self.undeformed.gradients(jet)

    def gradients(self, output: Tensor, lift: Tensor | None = None) -> Tensor:
        """Return u,1, u,2, d_11, d_22, d_12 (N, 5, 3) for output weights (3, M), those of the lift added."""
        free = (output @ self.jets.mT).reshape(-1, COLUMNS, 1)
        gradients = (self.through @ free).view(-1, 5, COMPONENTS)
        return gradients if lift is None else gradients + lift

    def pulled_back(self, conjugate: Tensor) -> Tensor:
        """Return the vector (3 M,) on the output weights from what is conjugate (N, 15) to the gradients."""
        on_jet = (conjugate[:, None] @ self.through).view(-1, COMPONENTS, 6)
        width = self.jets.shape[-1]
        flat = self.jets.reshape(-1, width)
        return (on_jet.permute(1, 0, 2).reshape(COMPONENTS, -1) @ flat).reshape(-1)

    def forces(self, force: Tensor) -> Tensor:
        """Return the vector (3 M,) of forces (N, 3) on u."""
        on_free = (self.matrix.mT @ force[..., None])[..., 0]
        return (on_free.T @ self.jets[:, VALUE]).reshape(-1)

    def add_form(self, total: Tensor, form: Tensor) -> None:
        """Add the symmetric form (N, 15, 15) of the gradients to a matrix (3 M, 3 M) of the output weights.

        Only its blocks of components on and above the diagonal; `mirrored` completes them.
        """
        width = self.jets.shape[-1]
        flat = self.jets.reshape(-1, width)
        on_jets = (self.through.mT @ form @ self.through).view(-1, COMPONENTS, 6, COMPONENTS, 6)
        for d in range(COMPONENTS):
            for c in range(d + 1):
                half = (on_jets[:, c, :, d] @ self.jets).reshape(-1, width)
                block = total[c * width : (c + 1) * width, d * width : (d + 1) * width]
                block.addmm_(flat.T, half)


def elastic_form(elasticity: Tensor, variation: Tensor) -> Tensor:
    """Return the form (N, 15, 15) of the elastic part of the second variation."""
    rows = variation.view(-1, 2, 3, GRADIENTS)
    return variation.mT @ (elasticity @ rows).view(-1, 6, GRADIENTS)
