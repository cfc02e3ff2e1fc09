"""The displacement field: u = lift + M W (network features, fixed features), less a rigid motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.rigid import rigid_modes
from shellbench.solvers.ndf.inputs import Inputs
from shellbench.solvers.ndf.jets import VALUE, Array, Placement, matrix_product
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.singular import FixedFeatures


class Factors(Protocol):
    """What multiplies the network so that supports are held."""

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        ...


class Lifting(Protocol):
    """What moves the supports as prescribed."""

    @property
    def moves(self) -> bool:
        """Whether any support is moved at all."""
        ...

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        ...


@dataclass(frozen=True)
class Ansatz:
    """A case with the way its supports are built in: u = lift + M F for any F; if `soft`, springs hold them instead."""

    case: Case
    factors: Factors
    lift: Lifting
    t: float = 1.0
    soft: bool = False


@dataclass(frozen=True)
class Features:
    """The scalar features of which F is a linear combination: the network's, then the fixed ones."""

    inputs: Inputs
    network: Network
    fixed: FixedFeatures
    placement: Placement

    @property
    def count(self) -> int:
        """Number of features M."""
        return self.network.width + self.fixed.count

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, M) at points (N, 2)."""
        hidden = self.network.features(self.inputs.jets(points, self.placement))
        return torch.cat([hidden, self.fixed.jets(points, self.placement)], dim=-1)

    def values(self, points: Array) -> Tensor:
        """Return the values (N, M) at points (N, 2), at a sixth of the cost of the jets."""
        placement = self.placement.of_values
        hidden = self.network.values(self.inputs.jets(points, placement)[VALUE])
        return torch.cat([hidden, self.fixed.jets(points, placement)[VALUE]], dim=-1)


@dataclass(frozen=True)
class Field:
    """A displacement field.

    Attributes
    ----------
    output
        (3, M): the output layer's weights.
    rigid
        (6,): the rigid motion that is taken away, in the basis of `shellbench.problems.shell.rigid.rigid_modes`.
    """

    ansatz: Ansatz
    features: Features
    output: Tensor
    rigid: Tensor

    def __post_init__(self) -> None:
        # as in `shellbench.solvers.ndf.network.Network`; solved weights come column by column
        for name in ("output", "rigid"):
            object.__setattr__(self, name, getattr(self, name).contiguous())

    def displacement(self, points: Array) -> Tensor:
        """Return the displacement (N, 3), metres, at points (N, 2)."""
        placement = self.features.placement
        free = self.features.values(points) @ self.output.T
        u = (self.ansatz.factors.matrix(points, placement.of_values)[VALUE] @ free[..., None])[..., 0]
        u = u + self.ansatz.lift.jet(points, placement)[VALUE]
        if bool((self.rigid != 0).any()):
            modes = rigid_modes(self.ansatz.case.surface, points)[0, 0]
            u = u - placement.tensor(modes) @ self.rigid
        return u

    def jet(self, points: Array) -> Tensor:
        """Return the jet (6, N, 3) of the displacement at points (N, 2), the rigid motion (unstrained) left in."""
        placement = self.features.placement
        free = (self.features.jets(points) @ self.output.T)[..., None]
        matrix = self.ansatz.factors.matrix(points, placement)
        return matrix_product(matrix, free)[..., 0] + self.ansatz.lift.jet(points, placement)

    def less_rigid(self, rigid: Tensor) -> Field:
        """Return the field with this rigid motion taken away instead."""
        return replace(self, rigid=rigid)
