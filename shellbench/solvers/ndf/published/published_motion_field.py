"""The published field in motion: u(xi, t) = F(xi, t) t^2 B(xi) + motion (Kairanda et al. 2023, eqs. (25), (28)).

F is one SIREN in space and time, so that time is one more input, scaled to [0, 1] like the others, and the velocity is
one more derivative. In training it is a seventh plane beside a jet's six; a solution computes it by forward-mode
differentiation of the displacement.

The published boundary functions of a moving shell: u = F t^2 B(xi) + sum over supports of (1 - B_p) m_p(xi, t).

Each held place p, a corner, point or edge, has a soft factor B_p = 1 - exp(-d^2 / sigma) with the distance d from it
and sigma = .01 (Kairanda et al. 2023, eqs. (27), (68)-(72)); B is their product over the places that hold a component.
The motion of a support, m_p, is faded out by the same factor. Eqs. (69) and (71) are this sum, with motions of opposite
sign. Eq. (72), where B stands for exp(-d^2 / sigma), is this sum after a correction of the sign before its first
motion: as printed, the bottom rim moves by -m instead of m. A component that is held on the whole surface is zero.

A soft factor has no slope at its place, so that grad u = grad m there: it clamps, even if the case has no clamp.

The module also has the published loss of collisions (equation (75)),

    lambda |Omega| / (N_Omega N_t) sum_ij max(eps - phi(x(xi_i, t_j)), 0),  lambda = 1000, eps = .001 m

It is linear in the depth: an obstacle presses with lambda, in N/m^2, where the shell is nearer than eps, and not
elsewhere. Areas are those of the midsurface, as in the functional (35). Departure from the paper: phi is the case's own
distance, to which the paper fits a network.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.contact import gaps
from shellbench.problems.shell.question.places import Edge, Place, Point, Whole
from shellbench.solvers.ndf.field.build import build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec, PeriodicInput
from shellbench.solvers.ndf.field.inputs import Inputs
from shellbench.solvers.ndf.field.jets import (
    D1,
    D2,
    D11,
    D12,
    D22,
    VALUE,
    Array,
    Placement,
    constant,
    from_derivatives,
    product,
)
from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.published.published_network import InputScale, Siren, soft_bump

RATE_STEP = 1e-3  # of the final time: distance of the times that give a motion's velocity
STENCILS = {0: (-25, 48, -36, 16, -3), -2: (1, -8, 0, 8, -1), -4: (3, -16, 36, -48, 25)}  # over 12: fourth order
EDGE_POINTS = 9  # points of an edge at which this is checked
WEIGHT = 1000.0  # lambda, N/m^2: the paper's value
MARGIN = 1e-3  # eps, m: the paper's value
DT = 6  # plane of the derivative in time
MOVING_PLANES = (VALUE, D1, D2, D11, D12, D22, DT)


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
        """Return the supports that these factors can't hold, as one clause; None if they hold all."""
        for support, place in self.places:
            if support.holds_slope and set(support.held) != set("xyz"):
                return f"its soft factors hold the slope of support '{support.name}' only where they hold all else"
            others = [(s, p) for s, p in self.places if s.motion and (s, p) != (support, place)]
            for other, far in others:
                shared = set(support.held) & set(other.held)
                reach = self._bump(far, self._place_points(place), Placement())[0].max()
                if shared and float(reach) > ROUNDING:
                    return f"the published motion of support '{other.name}' reaches support '{support.name}' too"
        return None

    def _bump(self, place: Place, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N) of exp(-d^2 / sigma)."""
        assert isinstance(place, Edge | Point)
        middle = (
            self._place_points(place)[EDGE_POINTS // 2 : EDGE_POINTS // 2 + 1]
            if isinstance(place, Edge)
            else np.array([place.xi])
        )
        x = self.case.surface.derivatives(middle, 1)
        lengths = tuple(float(np.linalg.norm(x[key])) for key in ((1, 0), (0, 1)))  # metres per unit of xi
        return soft_bump(self.case, place, (lengths[0], lengths[1]), points, placement)

    def _place_points(self, place: Edge | Point) -> Array:
        """Return points (n, 2) of a place."""
        if isinstance(place, Point):
            return np.array([place.xi])
        domain, running = self.case.surface.domain, 1 - place.axis
        return place.points(domain, np.linspace(domain.lower[running], domain.upper[running], EDGE_POINTS))

    def _velocity(self, support: Support, place: Place, points: Array, t: float) -> Array:
        """Return the velocity (N, 3) of a support's motion by differences within the time of the case."""
        assert self.case.dynamics is not None
        until = self.case.dynamics.until
        h = RATE_STEP * until
        first = 0 if t < 2 * h else -4 if t > until - 2 * h else -2
        terms = [
            weight * self.case.motion(support, place, points, t + (first + k) * h)[0, 0]
            for k, weight in enumerate(STENCILS[first])
            if weight
        ]
        return np.asarray(sum(terms)) / (12 * h)


@dataclass(frozen=True)
class Ansatz:
    """Ansatz that turns a network into the motion of a case, without the network's weights.

    Attributes
    ----------
    inputs
        Inputs of the network at a point.
    supports
        Soft factors and prescribed motions.
    """

    case: Case
    inputs: Inputs
    supports: SoftSupports

    @classmethod
    def from_case(cls, case: Case, periodic_input: PeriodicInput) -> Ansatz:
        """Derive it from a case."""
        spec = FieldSpec(periodic_input=periodic_input, stretched=False, multipliers=0)
        return cls(case, build_inputs(case, spec), SoftSupports(case))

    @property
    def until(self) -> float:
        """Final time, s."""
        assert self.case.dynamics is not None
        return self.case.dynamics.until

    @property
    def count(self) -> int:
        """Number of inputs of the network, time included."""
        return self.inputs.count + 1

    def space_inputs(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, n) of the published inputs of space at points (N, 2)."""
        return InputScale.from_inputs(self.inputs, placement).apply(self.inputs.jets(points, placement))

    def network_inputs(self, space: Tensor, times: Tensor) -> Tensor:
        """Return all inputs (7, T N, n + 1) of T times (T,) at the N points of `space_inputs`; times vary slowest."""
        moments, (_, count, inputs) = len(times), space.shape
        seen = space.new_zeros((len(MOVING_PLANES), moments, count, inputs + 1))
        seen[:DT, ..., :-1] = space[:, None]
        seen[VALUE, ..., -1] = times[:, None] / self.until
        seen[DT, ..., -1] = 1 / self.until
        return seen.flatten(1, 2)

    def prescribed_motion(self, points: Array, times: Array, placement: Placement) -> Tensor:
        """Return the prescribed part (7, T, N, 3) of the displacement at points (N, 2) and times (T,)."""
        return torch.stack([self.supports.motion(points, float(t), placement) for t in times], dim=1)


def motion_planes(jets: Tensor, times: Tensor, factor: Tensor) -> Tensor:
    """Return the planes (7, T, N, 3) of F t^2 B from those of F at T times (T,) and the jet (6, N, 3) of B."""
    t = times[:, None, None]
    space = product(factor[:, None], jets[:DT]) * t**2
    velocity = factor[VALUE] * (jets[DT] * t**2 + jets[VALUE] * (2 * t))
    return torch.cat([space, velocity[None]])


@dataclass(frozen=True)
class MotionField:
    """A motion: a network with its ansatz."""

    ansatz: Ansatz
    siren: Siren

    @cached_property
    def placement(self) -> Placement:
        """Device and precision of the weights."""
        place = self.siren.tensors[0]
        return Placement(place.device, place.dtype)

    def to(self, placement: Placement) -> MotionField:
        """Move the weights to another placement."""
        tensors = [t.to(device=placement.device, dtype=placement.dtype) for t in self.siren.tensors]
        return replace(self, siren=self.siren.with_tensors(tensors))

    def planes(self, points: Array, t: float) -> Tensor:
        """Return the displacement's planes (7, N, 3): its jet and its velocity at points (N, 2)."""
        times = self.placement.tensor(np.array([t]))
        space = self.ansatz.space_inputs(points, self.placement)
        jets = self.siren.jets(self.ansatz.network_inputs(space, times))[:, None]
        free = motion_planes(jets, times, self.ansatz.supports.factor(points, self.placement))
        return free[:, 0] + self.ansatz.supports.motion(points, t, self.placement)

    def displacement(self, points: Array, t: float) -> Tensor:
        """Return the displacement (N, 3), metres, at points (N, 2)."""
        moment = self.placement.tensor(np.array([t]))
        return self._free_motion(points)(moment) + self.ansatz.supports.motion(points, t, self.placement)[VALUE]

    def velocity(self, points: Array, t: float) -> Tensor:
        """Return the velocity (N, 3), m/s, at points (N, 2)."""
        moment = self.placement.tensor(np.array([t]))
        free: Tensor = torch.func.jvp(self._free_motion(points), (moment,), (torch.ones_like(moment),))[1]
        result: Tensor = free + self.ansatz.supports.motion(points, t, self.placement)[DT]
        return result

    def _free_motion(self, points: Array) -> Callable[[Tensor], Tensor]:
        """Return F t^2 B (N, 3) at points (N, 2) as a function of the time (1,)."""
        space = self.ansatz.space_inputs(points, self.placement)[VALUE]
        factor = self.ansatz.supports.factor(points, self.placement)[VALUE]

        def at(moment: Tensor) -> Tensor:
            last = (moment / self.ansatz.until).expand(len(points))[:, None]
            return self._values(torch.cat([space, last], dim=1)) * factor * moment**2

        return at

    def _values(self, inputs: Tensor) -> Tensor:
        """Return F (N, 3) from the values (N, n + 1) of the inputs."""
        h = inputs
        *hidden, (weight, bias) = zip(self.siren.weights, self.siren.biases, strict=True)
        for w, b in hidden:
            h = torch.sin(self.siren.omega0 * (h @ w.T + b))
        return h @ weight.T + bias


def collision(case: Case, points: Array, times: Array, displacement: Tensor) -> Tensor:
    """Return lambda max(eps - phi, 0) (T, N), N/m, of a displacement (T, N, 3) at points (N, 2) and times (T,), s."""
    where = displacement.detach().cpu().double().numpy()
    found = [gaps(case, points, u, float(t)) for u, t in zip(where, times, strict=True)]
    gap, normal = (displacement.new_tensor(np.stack(part)) for part in zip(*found, strict=True))
    along = ((displacement - displacement.detach()) * normal).sum(-1)  # zero; its derivative is that of phi
    return WEIGHT * torch.relu(MARGIN - gap - along)


def contact_forces(case: Case, points: Array, areas: Array, t: float, displacement: Array) -> Array:
    """Return the contact forces (N, 3) of the loss, N, at points (N, 2) of areas (N,), m^2, at a time t, s."""
    gap, normal = gaps(case, points, displacement, t)
    return np.asarray(WEIGHT * (areas * (gap < MARGIN))[:, None] * normal)
