"""Powers of the distance from corners, as output features of a field.

If two edges meet and at least one of them is held, moments or membrane forces may be infinite. Near such a corner the
solution is a sum of r**lambda phi(theta) (Williams 1952), with exponents that follow from the angle and the supports.
This module does not compute the exponents. Powers at a few fixed exponents span those between them: on a half line of
log r, sums of exp(-mu_j s) approximate exp(-mu s) to the product of abs(mu - mu_j) / (mu + mu_j) (Muentz), which is
below 1e-2 for four exponents. The powers are multiplied by harmonics of the angle in the tangent plane.

The order at which the boundary factors vanish determines the powers of F with finite energy. The normal displacement
must scale as r**(1 + mu) with mu > 0, the tangential one as r**mu. If no edge holds a tangential displacement, membrane
forces are finite (Williams's exponents of a wedge with two free edges are 1 and more), and tangential components have
no powers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.places import SIDES
from shellbench.solvers.ndf.field.geometry import surface_size
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement, constant, from_derivatives, power, product
from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.field.supports import edge_supports

# Any few exponents span those between them (see the module's docstring). The effect of other ones is not on record.
FEW = (0.25, 0.5)
EXPONENTS = ((), FEW, (*FEW, 0.1, 1.0))  # mu, by the detail that is asked for
HARMONICS = (0, 2, 3)  # of the angle, by the same
AT_A_POINT = 1e-30  # square of a relative distance: less is taken as this, where r^2 log r^2 and powers are zero


@dataclass(frozen=True)
class Corner:
    """A corner of the rectangle at which an edge is held.

    Attributes
    ----------
    xi
        (xi1, xi2).
    shift
        Exponent of F less mu.
    components
        Components of F with these powers: those that need the lowest ones.
    """

    xi: tuple[float, float]
    shift: int
    components: tuple[bool, bool, bool]


def held_corners(case: Case) -> tuple[Corner, ...]:
    """Return the corners of a case at which an edge is held; none if a coordinate is periodic."""
    domain = case.surface.domain
    if any(domain.periodic) or case.prescribed:
        return ()
    supports, corners = edge_supports(case), []
    bounds = (domain.lower, domain.upper)
    for i in (0, 1):
        for j in (0, 1):
            xi = (float(bounds[i][0]), float(bounds[j][1]))
            meeting = [s for s in supports if s.edge.side == SIDES[(i, j)[s.edge.axis]]]
            if not meeting:
                continue
            x = case.surface.derivatives(np.asarray(xi), 1)
            normal = np.cross(x[1, 0], x[0, 1])
            normal /= np.linalg.norm(normal)
            slopes = any(s.tilted for s in meeting)  # their factor is the normal displacement's second one
            shifts = [
                int(abs(normal[c]) > ROUNDING and not slopes) - sum(c in s.held for s in meeting) for c in range(3)
            ]
            stretches = any(abs(float(normal[c])) < 1 - ROUNDING for s in meeting for c in s.held)
            singular = [stretches or abs(float(normal[c])) > ROUNDING for c in range(3)]
            first, second, third = (s == min(shifts) and needed for s, needed in zip(shifts, singular, strict=True))
            corners.append(Corner(xi, min(shifts), (first, second, third)))
    return tuple(corners)


@dataclass(frozen=True)
class CornerPowers:
    """r**(mu + shift) times harmonics of the angle about each corner; r is the chord abs(x - x0) over the size.

    Attributes
    ----------
    case
        The case, on whose surface the chords are measured.
    corners
        Corners of the powers.
    exponents, harmonics
        mu, and the number of pairs (cos m theta, sin m theta) beside 1.
    """

    case: Case
    corners: tuple[Corner, ...]
    exponents: tuple[float, ...]
    harmonics: int

    @classmethod
    def from_case(cls, case: Case, detail: int) -> CornerPowers:
        """Derive the powers of a case: 0 none, 1 few, 2 more of them."""
        return cls(case, held_corners(case) if detail else (), EXPONENTS[detail], HARMONICS[detail])

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.corners) * len(self.exponents) * (1 + 2 * self.harmonics)

    def coarser_mask(self) -> Array:
        """Return (count,): True for features that also exist with one detail less."""
        detail = EXPONENTS.index(self.exponents) - 1 if self.exponents else 0
        powers = np.arange(len(self.exponents)) < len(EXPONENTS[detail])
        turns = np.arange(1 + 2 * self.harmonics) < 1 + 2 * HARMONICS[detail]
        return np.tile(np.outer(powers, turns).ravel(), len(self.corners))

    def component_mask(self) -> Array:
        """Return (3, count): True if a component of F has a feature."""
        each = len(self.exponents) * (1 + 2 * self.harmonics)
        return np.repeat(np.array([c.components for c in self.corners], dtype=bool).reshape(-1, 3).T, each, axis=1)

    def columns(self, points: Array, placement: Placement) -> list[Tensor]:
        """Return the jets (6, N) of all features at points (N, 2)."""
        if not self.corners:
            return []
        # One row of points for each feature: operations on rows are several times faster than on short columns.
        x = from_derivatives(self.case.surface.derivatives(points, placement.order), placement).mT
        size = surface_size(self.case)
        at = [self.case.surface.derivatives(np.asarray(corner.xi), 1) for corner in self.corners]
        first = np.stack([a[1, 0] / np.linalg.norm(a[1, 0]) for a in at])
        second = np.stack([a[0, 1] - (a[0, 1] @ one) * one for a, one in zip(at, first, strict=True)])
        second /= np.linalg.norm(second, axis=1, keepdims=True)
        chords = x[:, None] - constant(placement.tensor(np.stack([a[0, 0] for a in at])), len(x))[..., None]
        t1, t2 = ((placement.tensor(tangents)[:, None] @ chords)[:, :, 0] / size for tangents in (first, second))
        square = product(t1, t1) + product(t2, t2)
        square[VALUE].clamp_min_(AT_A_POINT)
        inverse = power(square, -0.5)
        c1, s1 = product(t1, inverse), product(t2, inverse)
        angular, c, s = [constant(torch.ones_like(t1[VALUE]), len(x))], c1, s1
        for _ in range(self.harmonics):
            angular += [c, s]
            c, s = product(c, c1) - product(s, s1), product(c, s1) + product(s, c1)
        turning = torch.stack(angular, dim=2)
        powers = np.add.outer([corner.shift for corner in self.corners], self.exponents) / 2
        radial = power(torch.stack([square] * len(self.exponents), dim=2), placement.tensor(powers)[..., None])
        return list(product(radial[:, :, :, None], turning[:, :, None]).flatten(1, 3).unbind(1))
