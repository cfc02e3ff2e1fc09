"""The published boundary functions of a moving shell: u = F t^2 B(xi) + sum over supports of (1 - B_p) m_p(xi, t).

Each held place p, a corner, point or edge, has a soft factor B_p = 1 - exp(-d^2 / sigma) with the distance d from it
and sigma = .01 (Kairanda et al., eqs. (27), (68)-(72)); B is their product over the places that hold a component. What
a support is moved by, m_p, is faded out by the same factor. Eqs. (69) and (71) are this sum, with motions of opposite
sign. So is eq. (72), where B stands for exp(-d^2 / sigma), once the sign before its first motion is repaired: as it is
printed the bottom rim is moved by -m instead of m. A component that is held on the whole surface is zero.

A soft factor has no slope at its place, so that grad u = grad m there: it clamps, whether that is asked for or not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import Support
from shellbench.problems.shell.places import Edge, Place, Point, Whole
from shellbench.solvers.ndf.jets import Array, Placement, constant, from_derivatives, product
from shellbench.solvers.ndf.published_factors import soft_bump

STEP = 1e-3  # of the final time, between the times by which a motion's velocity is found
STENCILS = {0: (-25, 48, -36, 16, -3), -2: (1, -8, 0, 8, -1), -4: (3, -16, 36, -48, 25)}  # over 12: fourth order
OVERLAP = 1e-9  # share of a motion that may reach another support
ALONG = 9  # points of an edge at which that is looked at


@dataclass(frozen=True)
class SoftSupports:
    """The soft factors and prescribed motions of a case in motion."""

    case: Case

    @cached_property
    def places(self) -> tuple[tuple[Support, Edge | Point], ...]:
        """Supports of edges and points, one entry for each place."""
        return tuple((s, place) for s, place in self.case.supported_places() if not isinstance(place, Whole))

    def factor(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of B, by component, at points (N, 2)."""
        one = constant(placement.tensor(np.ones(len(points))))
        factors = [one, one, one]
        for support, place in self.places:
            soft = one - self._bump(place, points, placement)
            for c in ("xyz".index(name) for name in support.held):
                factors[c] = product(factors[c], soft)
        for c in self.case.held_everywhere:
            factors[c] = torch.zeros_like(one)
        return torch.stack(factors, dim=-1)

    def motion(self, points: Array, t: float, placement: Placement) -> Tensor:
        """Return the prescribed part (7, N, 3) of the displacement at points (N, 2): its jet, and its velocity."""
        total = placement.tensor(np.zeros((7, len(points), 3)))
        for support, place in self.places:
            if support.motion is None:
                continue
            held = placement.tensor(np.array([c in support.held for c in "xyz"], dtype=float))
            bump = self._bump(place, points, placement)[..., None] * held
            moved = from_derivatives(self.case.motion(support, place, points, t, 2), placement)
            total[:6] += product(bump, moved)
            total[6] += bump[0] * placement.tensor(self._velocity(support, place, points, t))
        return total

    def why_not_held(self) -> str | None:
        """Return what these factors can't hold, as one clause; None if they hold all."""
        for support, place in self.places:
            if support.holds_slope and set(support.held) != set("xyz"):
                return f"its soft factors hold the slope of support '{support.name}' only where they hold all else"
            others = [(s, p) for s, p in self.places if s.motion and (s, p) != (support, place)]
            for other, far in others:
                shared = set(support.held) & set(other.held)
                reach = self._bump(far, self._along(place), Placement())[0].max()
                if shared and float(reach) > OVERLAP:
                    return f"the published motion of support '{other.name}' reaches support '{support.name}' too"
        return None

    def _bump(self, place: Place, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N) of exp(-d^2 / sigma)."""
        assert isinstance(place, Edge | Point)
        middle = self._along(place)[ALONG // 2 : ALONG // 2 + 1] if isinstance(place, Edge) else np.array([place.xi])
        x = self.case.surface.derivatives(middle, 1)
        lengths = tuple(float(np.linalg.norm(x[key])) for key in ((1, 0), (0, 1)))  # metres per unit of xi
        return soft_bump(self.case, place, (lengths[0], lengths[1]), points, placement)

    def _along(self, place: Edge | Point) -> Array:
        """Return points (n, 2) of a place."""
        if isinstance(place, Point):
            return np.array([place.xi])
        domain, running = self.case.surface.domain, 1 - place.axis
        return place.points(domain, np.linspace(domain.lower[running], domain.upper[running], ALONG))

    def _velocity(self, support: Support, place: Place, points: Array, t: float) -> Array:
        """Return the velocity (N, 3) of a support's motion by differences that stay within the time of the case."""
        assert self.case.dynamics is not None
        until = self.case.dynamics.until
        h = STEP * until
        first = 0 if t < 2 * h else -4 if t > until - 2 * h else -2
        terms = [
            weight * self.case.motion(support, place, points, t + (first + k) * h)[0, 0]
            for k, weight in enumerate(STENCILS[first])
            if weight
        ]
        return np.asarray(sum(terms)) / (12 * h)
