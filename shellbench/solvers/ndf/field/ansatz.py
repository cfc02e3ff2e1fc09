"""How the supports of a case are built into a displacement: u = lift + M F for any F."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.choices import Slopes
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.field.mirrors import Mirrors
from shellbench.solvers.ndf.field.quadrature import Rule, RuleSpec, area_rule


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
    """A case with the way its supports are built in: u = lift + M F for any F; if `soft`, springs hold them instead.

    With `mirrors`, for any F that is even about their planes.
    """

    case: Case
    factors: Factors
    lift: Lifting
    t: float = 1.0
    soft: bool = False
    slopes: Slopes = "even"
    mirrors: Mirrors | None = None

    def rule(self, focal: Array, spec: RuleSpec) -> Rule:
        """Return the rule over which energies are integrated, graded toward focal points (k, 2).

        With mirrors its points are those of one part, and its weights stand for the images, too.
        """
        if self.mirrors is not None:
            return self.mirrors.rule(focal, spec)
        return area_rule(self.case.surface.domain, focal, spec)
