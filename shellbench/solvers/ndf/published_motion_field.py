"""The published field of a moving shell: u(xi, t) = F(xi, t) t^2 B(xi) + motion (Kairanda et al., eqs. (25), (28)).

F is one SIREN in space and time, so that time is one more input, scaled to [0, 1] as the others are, and the velocity
one more derivative. In training it is a seventh plane beside a jet's six; a solution asks for it by forward-mode
differentiation of the displacement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.build import FieldSpec, build_inputs
from shellbench.solvers.ndf.choices import PeriodicInput
from shellbench.solvers.ndf.inputs import Inputs
from shellbench.solvers.ndf.jets import D1, D2, D11, D12, D22, VALUE, Array, Placement, product
from shellbench.solvers.ndf.published_motion_factors import SoftSupports
from shellbench.solvers.ndf.published_network import InputScale, Siren

DT = 6  # plane of the derivative in time
PLANES = (VALUE, D1, D2, D11, D12, D22, DT)


@dataclass(frozen=True)
class Ansatz:
    """What turns a network into the motion of a case, beside its weights.

    Attributes
    ----------
    inputs
        What the network sees of a point.
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

    def space(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, n) of the published inputs of space at points (N, 2)."""
        return InputScale.from_inputs(self.inputs, placement).apply(self.inputs.jets(points, placement))

    def seen(self, space: Tensor, times: Tensor) -> Tensor:
        """Return all inputs (7, T N, n + 1) of T times (T,) at the N points of `space`; times vary slowest."""
        moments, (_, count, inputs) = len(times), space.shape
        seen = space.new_zeros((len(PLANES), moments, count, inputs + 1))
        seen[:DT, ..., :-1] = space[:, None]
        seen[VALUE, ..., -1] = times[:, None] / self.until
        seen[DT, ..., -1] = 1 / self.until
        return seen.flatten(1, 2)

    def prescribed(self, points: Array, times: Array, placement: Placement) -> Tensor:
        """Return the prescribed part (7, T, N, 3) of the displacement at points (N, 2) and times (T,)."""
        return torch.stack([self.supports.motion(points, float(t), placement) for t in times], dim=1)


def moving(jets: Tensor, times: Tensor, factor: Tensor) -> Tensor:
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
        """Where the weights are, and in what precision."""
        place = self.siren.tensors[0]
        return Placement(place.device, place.dtype)

    def to(self, placement: Placement) -> MotionField:
        """Bring the weights elsewhere."""
        tensors = [t.to(device=placement.device, dtype=placement.dtype) for t in self.siren.tensors]
        return replace(self, siren=self.siren.with_tensors(tensors))

    def planes(self, points: Array, t: float) -> Tensor:
        """Return the displacement's planes (7, N, 3): its jet and its velocity at points (N, 2)."""
        times = self.placement.tensor(np.array([t]))
        space = self.ansatz.space(points, self.placement)
        jets = self.siren.jets(self.ansatz.seen(space, times))[:, None]
        free = moving(jets, times, self.ansatz.supports.factor(points, self.placement))
        return free[:, 0] + self.ansatz.supports.motion(points, t, self.placement)

    def displacement(self, points: Array, t: float) -> Tensor:
        """Return the displacement (N, 3), metres, at points (N, 2)."""
        moment = self.placement.tensor(np.array([t]))
        return self._free(points)(moment) + self.ansatz.supports.motion(points, t, self.placement)[VALUE]

    def velocity(self, points: Array, t: float) -> Tensor:
        """Return the velocity (N, 3), m/s, at points (N, 2)."""
        moment = self.placement.tensor(np.array([t]))
        free: Tensor = torch.func.jvp(self._free(points), (moment,), (torch.ones_like(moment),))[1]
        result: Tensor = free + self.ansatz.supports.motion(points, t, self.placement)[DT]
        return result

    def _free(self, points: Array) -> Callable[[Tensor], Tensor]:
        """Return F t^2 B (N, 3) at points (N, 2) as a function of the time (1,)."""
        space = self.ansatz.space(points, self.placement)[VALUE]
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
