"""Features with no weights of their own: a constant, and the known singularity of a plate under a point force.

Near a normal point force every shell behaves like a plate, w ~ (P / 8 pi B) r^2 log r with a non-smooth remainder of
the form r^2 log r^2 times polynomials (Timoshenko & Woinowsky-Krieger, section 19). Here r is the chord |x(xi) - x0|,
smooth and single-valued on any surface, closed ones included, and the polynomials are in the tangential chords.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.choices import MULTIPLIERS
from shellbench.solvers.ndf.inputs import even_columns
from shellbench.solvers.ndf.jets import D1, VALUE, Array, Placement, compose, constant, dot, from_derivatives, product
from shellbench.solvers.ndf.lengths import Focus
from shellbench.solvers.ndf.supports import edge_samples, edge_supports

AT_THE_POINT = 1e-30  # r^2 / reach^2 below this is taken as this: r^2 log r^2 is zero there to double precision
ODD = 1e-9  # slope at an edge, in units of the feature over the side's length, above which a feature is not even


@dataclass(frozen=True)
class FixedFeatures:
    """A constant, and r^2 log r^2 times {1, t1, t2, r^2, ...} for each focus.

    Attributes
    ----------
    case
        Whose surface carries the chords.
    foci
        Points that carry a force.
    multipliers
        How many functions multiply r^2 log r^2.
    kept
        Which of these features are used: all, unless an edge asks for even ones.
    """

    case: Case
    foci: tuple[Focus, ...]
    multipliers: int
    kept: tuple[int, ...]

    @classmethod
    def from_case(
        cls,
        case: Case,
        around: tuple[Focus, ...] = (),
        multipliers: int = MULTIPLIERS,
        mirrored: tuple[int, ...] = (),
    ) -> FixedFeatures:
        """Derive the features of a case, leaving out those that are not even where free components need it.

        They must be even about the seams of the coordinates `mirrored`, too.
        """
        everything = cls(case, around, multipliers, tuple(range(1 + multipliers * len(around))))
        even = torch.ones(everything.count, dtype=torch.bool)
        for support in edge_supports(case):
            if support.even:
                jets = everything.jets(edge_samples(case, support.edge)[1:-1], Placement())
                slope = jets[D1 + support.edge.axis].abs().amax(0) * case.surface.domain.size[support.edge.axis]
                even &= slope <= ODD * jets[VALUE].abs().amax(0).clamp_min(1.0)
        if mirrored:
            even &= even_columns(lambda p: everything.jets(p, Placement())[VALUE], case.surface.domain, mirrored)
        return cls(case, around, multipliers, tuple(torch.nonzero(even)[:, 0].tolist()))

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.kept)

    def jets(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, count) at points (N, 2)."""
        columns = [constant(placement.tensor(np.ones(len(points))), placement.planes)]
        if self.foci and self.multipliers:
            x = from_derivatives(self.case.surface.derivatives(points, 2), placement)
            for focus in self.foci:
                columns += self._around(focus, x, placement)
        return torch.stack([columns[k] for k in self.kept], dim=-1)

    def _around(self, focus: Focus, x: Tensor, placement: Placement) -> list[Tensor]:
        chord = (x - constant(placement.tensor(focus.position).expand(x.shape[1:]), len(x))) / focus.reach
        first, second = (chord @ placement.tensor(focus.tangents).T).unbind(-1)
        square = dot(chord, chord)
        v = square[VALUE].clamp_min(AT_THE_POINT)
        log = torch.log(v)
        bubble = compose((v * log, log + 1, 1 / v), square)
        others = [first, second, square, product(first, second), product(first, first)]
        return [bubble, *(product(bubble, other) for other in others[: self.multipliers - 1])]
