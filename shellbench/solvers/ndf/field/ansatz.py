"""The parts of a displacement u = lift + M F: the lift and the matrix M of the supports, and the features of F.

The module also computes independent combinations of features.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions, rigid_modes
from shellbench.solvers.ndf.field.choices import Slopes
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.field.mirrors import Mirrors, samples
from shellbench.solvers.ndf.field.quadrature import ROUNDING, Rule, RuleSpec, area_rule

DEPENDENT = 1e-12  # combinations less stiff than this share of the stiffest are rounding, with ten times its room


class Factors(Protocol):
    """Boundary factors: they multiply the network so that supports are held."""

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        ...


class Lifting(Protocol):
    """Lift: it moves the supports as prescribed."""

    @property
    def moves(self) -> bool:
        """True if any support is moved."""
        ...

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        ...


@dataclass(frozen=True)
class Ansatz:
    """A case with its supports built in: u = lift + M F for any F; if `soft`, springs hold the supports instead.

    With `mirrors`, F has to be even about their planes.
    """

    case: Case
    factors: Factors
    lift: Lifting
    t: float = 1.0
    soft: bool = False
    slopes: Slopes = "even"
    mirrors: Mirrors | None = None

    @cached_property
    def free_motions(self) -> Array:
        """The rigid motions (6, r) that supports leave free; with mirrors, the means over their images."""
        free, surface = free_motions(self.case), self.case.surface
        if self.mirrors is None or not free.size:
            return free
        points = samples(self.mirrors.domain)
        modes = rigid_modes(surface, points)[0, 0].reshape(-1, 6)
        for mirror in self.mirrors.each:  # images of rigid motions are rigid motions, too
            images = mirror.signs[:, None] * rigid_modes(surface, surface.domain.wrap(mirror.image(points)))[0, 0]
            free = (free + np.linalg.lstsq(modes, images.reshape(-1, 6), rcond=ROUNDING)[0] @ free) / 2
        return np.where(np.abs(free) > ROUNDING, free, 0.0)

    def rule(self, focal: Array, spec: RuleSpec) -> Rule:
        """Return the rule over which energies are integrated, graded toward focal points (k, 2).

        With mirrors its points are those of one part, and its weights stand for the images, too.
        """
        if self.mirrors is not None:
            return self.mirrors.rule(focal, spec)
        return area_rule(self.case.surface.domain, focal, spec)


class FeatureSet(Protocol):
    """Scalar features of which a field is a linear combination."""

    @property
    def count(self) -> int:
        """Number of features M."""
        ...

    @property
    def placement(self) -> Placement:
        """Device and precision of the tensors."""
        ...

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, M) at points (N, 2)."""
        ...

    def values(self, points: Array) -> Tensor:
        """Return the values (N, M) at points (N, 2)."""
        ...


@dataclass(frozen=True)
class Combined:
    """Combinations (M, r) of other features, independent in a stiffness (M, M) if given."""

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
        """Device and precision of the tensors."""
        return self.features.placement

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, r) at points (N, 2)."""
        return self.features.jets(points) @ self.combine

    def values(self, points: Array) -> Tensor:
        """Return the values (N, r) at points (N, 2)."""
        return self.features.values(points) @ self.combine


def independent_combinations(stiffness: Tensor) -> Tensor:
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
