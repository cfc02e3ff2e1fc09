"""Features of a field whose third derivative jumps along coordinate lines: edges of contact.

Without friction displacement, slope and moment are continuous where contact begins, and the shear force jumps. So the
displacement is smooth but for s^3 times smooth functions on one side, with s the distance from the edge. Features that
are smooth throughout would ring there.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.choices import Crease
from shellbench.solvers.ndf.field.jets import (
    VALUE,
    Array,
    Placement,
    chebyshev,
    compose,
    coordinates,
    product,
)

ALONG, ACROSS = 8, 3  # Chebyshev polynomials of the coordinate that s_+^3 are multiplied by, and of the other one


@dataclass(frozen=True)
class Creases:
    """Cubes of the distance on one side of coordinate lines, times polynomials of both coordinates.

    Attributes
    ----------
    domain
        Of the coordinates.
    lines
        Where.
    """

    domain: Domain
    lines: tuple[Crease, ...]

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.lines) * ALONG * ACROSS

    def columns(self, points: Array, placement: Placement) -> list[Tensor]:
        """Return the jets (6, N) of all features at points (N, 2)."""
        centred = []
        for axis, coordinate in enumerate(coordinates(points, placement)):
            unit = 2 / self.domain.size[axis] * coordinate
            unit[VALUE] -= (self.domain.lower[axis] + self.domain.upper[axis]) / self.domain.size[axis]
            centred.append(unit)
        columns: list[Tensor] = []
        for axis, at, side in self.lines:
            s = side * centred[axis]
            s[VALUE] -= side * (2 * at - self.domain.lower[axis] - self.domain.upper[axis]) / self.domain.size[axis]
            v = s[VALUE].clamp_min(0.0)
            cube = compose((v**3, 3 * v**2, 6 * v), s)
            for along in chebyshev(centred[axis], ALONG):
                cut = product(cube, along)
                columns += [product(cut, across) for across in chebyshev(centred[1 - axis], ACROSS)]
        return columns
