"""The network of five fields, held at supports by factors that vanish there.

See `shellbench.solvers.naghdi.supports` for what supports hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.naghdi.strains import FIELDS, Frame, load_density
from shellbench.solvers.naghdi.supports import held_fields

Array = NDArray[np.float64]

REACH = 4.0  # of inputs on either side of zero: by certified energy on the roof, against 1 and 2


def factors(case: Case, xi: Array) -> Array:
    """Return the factors (N, 3, 5) of the fields and their slopes along xi1 and xi2 at points (N, 2)."""
    domain = case.surface.domain
    out = np.zeros((len(xi), 3, FIELDS))
    out[:, 0] = 1.0
    for number, edges in enumerate(held_fields(case)):
        for edge in edges:
            # The distance from the edge in units of the side.
            sign = 1.0 if edge.side == "min" else -1.0
            slope = sign / domain.size[edge.axis]
            distance = slope * (xi[:, edge.axis] - edge.coordinate(domain))
            out[:, 1:, number] *= distance[:, None]
            out[:, 1 + edge.axis, number] += slope * out[:, 0, number]
            out[:, 0, number] *= distance
    return out


def units(case: Case) -> Array:
    """Return the scales (5,) of the fields, m and 1: between those of a stretching and of a bending shell."""
    domain, material = case.surface.domain, case.material
    xi = domain.grid(9, 9).reshape(-1, 2)
    frame = Frame.at(case, xi)
    load = float(np.linalg.norm(load_density(case, frame, xi), axis=-1).max())
    length = math.sqrt(float(frame.area.mean()) * domain.size[0] * domain.size[1])
    unit = load * length**3 / math.sqrt(material.membrane_stiffness * material.bending_stiffness) / 4
    return np.array([unit] * 3 + [4 * unit / length] * 2) if unit else np.ones(FIELDS)


Activation = Callable[[Tensor], tuple[Tensor, Tensor]]


def _gelu(z: Tensor) -> tuple[Tensor, Tensor]:
    share = 0.5 * (1 + torch.erf(z / math.sqrt(2)))
    return z * share, share + z * torch.exp(-z * z / 2) / math.sqrt(2 * math.pi)


def _tanh(z: Tensor) -> tuple[Tensor, Tensor]:
    value = torch.tanh(z)
    return value, 1 - value * value


ACTIVATIONS: dict[str, Activation] = {
    "gelu": _gelu,
    "tanh": _tanh,
    "sine": lambda z: (torch.sin(z), torch.cos(z)),
}
"""Value and slope (Bastek & Kochmann have GELU)."""


@dataclass(frozen=True)
class Shape:
    """Shape of a network: everything but its weights."""

    layers: int
    width: int
    activation: str

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Inputs and outputs of each layer."""
        widths = [2, *[self.width] * self.layers, FIELDS]
        return list(pairwise(widths))

    @property
    def parameters(self) -> int:
        """Number of weights."""
        return sum((i + 1) * o for i, o in self.sizes)

    def initial(self, seed: int) -> Tensor:
        """Return weights (parameters,) by the rule of Glorot & Bengio (2010); biases are zero."""
        generator = torch.Generator().manual_seed(seed)
        parts = []
        for i, o in self.sizes:
            bound = math.sqrt(6 / (i + o))
            parts += [(2 * torch.rand(i * o, generator=generator, dtype=torch.float64) - 1) * bound]
            parts += [torch.zeros(o, dtype=torch.float64)]
        return torch.cat(parts)

    def outputs(self, weights: Tensor, inputs: Tensor, rates: tuple[float, float]) -> Tensor:
        """Return (N, 3, 5): outputs and their slopes along xi1 and xi2 at inputs (N, 2) that grow at these rates."""
        value, slopes = (
            inputs,
            torch.diag(torch.tensor(rates, dtype=torch.float64))[:, None].expand(-1, len(inputs), -1),
        )
        start = 0
        for number, (i, o) in enumerate(self.sizes):
            matrix = weights[start : start + i * o].reshape(i, o)
            bias = weights[start + i * o : start + (i + 1) * o]
            start += (i + 1) * o
            value, slopes = value @ matrix + bias, slopes @ matrix
            if number < self.layers:
                value, slope = ACTIVATIONS[self.activation](value)
                slopes = slope * slopes
        return torch.cat([value[:, None], slopes.movedim(0, 1)], dim=1)


@dataclass(frozen=True)
class Fields:
    """The five fields at points: network times factors times units.

    Attributes
    ----------
    inputs
        (N, 2) coordinates in [-REACH, REACH].
    rates
        Rates of their growth with xi1 and xi2.
    factors
        (N, 3, 5), times units.
    """

    shape: Shape
    inputs: Tensor
    rates: tuple[float, float]
    factors: Tensor

    @classmethod
    def at(cls, case: Case, shape: Shape, xi: Array) -> Fields:
        """Return the fields at points (N, 2)."""
        domain = case.surface.domain
        rates = (2 * REACH / domain.size[0], 2 * REACH / domain.size[1])
        inputs = (xi - np.asarray(domain.lower)) * np.asarray(rates) - REACH
        held = factors(case, xi) * units(case)
        return cls(shape, torch.as_tensor(inputs), rates, torch.as_tensor(held))

    def jets(self, weights: Tensor) -> Tensor:
        """Return z (N, 15): the fields and their slopes along xi1 and xi2."""
        out = self.shape.outputs(weights, self.inputs, self.rates)
        values = self.factors[:, :1] * out
        crossed = self.factors[:, 1:] * out[:, :1]
        return torch.cat([values[:, :1], values[:, 1:] + crossed], dim=1).flatten(1)
