"""The published network: a SIREN whose frequency is outside its weights during training.

Adam moves every weight by about its learning rate, independent of the gradient. Therefore omega0 (W h + b) is trained
differently from (omega0 W) h + omega0 b. Here the weights are those of Sitzmann et al. (2020), and omega0 is multiplied
into them only when the trained field becomes a `shellbench.solvers.ndf.field.network.Network` on the inputs of this
package.

The module also has a sine layer on second-order jets with a hand-written backward pass.

`jets` leaves the backward pass to automatic differentiation, which splits a sine layer into some twenty products and
keeps all of them. A layer h <- sin(omega (W h + b)) needs only z, its sine and its cosine: with z_1, z_11, ... the
planes of z and g those of the incoming gradient, the chain rule

    sin(z)_1 = cos(z) z_1,   sin(z)_11 = cos(z) z_11 - sin(z) z_1^2,   sin(z)_12 = cos(z) z_12 - sin(z) z_1 z_2

transposes to a few fused products, and the matrix products of all six planes remain one product.

The module also has the published boundary functions, derived from the supports of any case.

Held edges have the factor xi (L - xi) on the held components (Kairanda et al. 2023, eqs. (61), (64), (65)). Departure
from the paper: its maximum is scaled to 1; as printed it is up to 6e6 on the plate, and the training does not start.
This is `BoundaryFactors` of this package, clamps included.

A shell without supports is kept from drifting: the points under its point loads are held in all directions except that
of the load, by factors 1 - exp(-d^2 / sigma) (eq. (66)). For loads along one axis this is the published pair of factors
on the other two components; for any directions it is the product of the matrices I - exp(-d^2 / sigma) (I - f f^T /
|f|^2), exact where no second load is within a few sqrt(sigma). The distance is in the units of the case file, degrees
for angles, as in eq. (66): in radians the samples hit its steep flank every few dozen iterations, and Adam does not
recover from the gradient there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import FunctionCtx

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.choices import FieldSpec, Pins
from shellbench.solvers.ndf.field.factors import BoundaryFactors, Lift
from shellbench.solvers.ndf.field.geometry import contravariant_basis_jet
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
    compose,
    constant,
    coordinates,
    matrix_product,
    smooth_activation,
)
from shellbench.solvers.ndf.field.network import Network


def sine_layer(h: Tensor, weight: Tensor, bias: Tensor, omega: float) -> Tensor:
    """Return the jets (6, N, m) of sin(omega (W h + b)) (Sitzmann et al. 2020).

    Parameters
    ----------
    h
        (6, N, n) jets of the layer below.
    weight, bias
        (m, n) and (m,).
    omega
        Frequency.
    """
    result: Tensor = _SineLayer.apply(h, weight, bias, omega)  # type: ignore[no-untyped-call]
    return result


def linear_layer(h: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Return the jets (6, N, m) of W h + b."""
    constant = torch.zeros_like(h[:, :1, :1])
    constant[VALUE] = 1.0
    return h @ weight.T + constant * bias


class _SineLayer(Function):
    @staticmethod
    def forward(ctx: Any, h: Tensor, weight: Tensor, bias: Tensor, omega: float) -> Tensor:
        z = h @ (omega * weight).T
        z[VALUE] += omega * bias
        sine, cosine = torch.sin(z[VALUE]), torch.cos(z[VALUE])
        ctx.save_for_backward(h, weight, z, sine, cosine)
        ctx.omega = omega
        jet = torch.empty_like(z)
        jet[VALUE] = sine
        torch.mul(cosine, z[1:], out=jet[1:])
        s1, s2 = sine * z[D1], sine * z[D2]
        jet[D11].addcmul_(s1, z[D1], value=-1)
        jet[D12].addcmul_(s1, z[D2], value=-1)
        jet[D22].addcmul_(s2, z[D2], value=-1)
        return jet

    @staticmethod
    def backward(ctx: FunctionCtx, *gradients: Any) -> tuple[Tensor | None, Tensor, Tensor, None]:
        h, weight, z, sine, cosine = ctx.saved_tensors  # type: ignore[attr-defined]
        (g,) = gradients
        omega: float = ctx.omega  # type: ignore[attr-defined]
        dz = cosine * g
        s1, s2 = sine * z[D1], sine * z[D2]
        dz[D1].addcmul_(s1, g[D11], value=-2).addcmul_(s2, g[D12], value=-1)
        dz[D2].addcmul_(s2, g[D22], value=-2).addcmul_(s1, g[D12], value=-1)
        through_sine = (z[1:] * g[1:]).sum(0)
        dz[VALUE].addcmul_(sine, through_sine, value=-1)
        through_cosine = z[D1] * g[D11]
        through_cosine.addcmul_(z[D2], g[D12]).mul_(z[D1]).addcmul_(z[D2].square(), g[D22])
        dz[VALUE].addcmul_(cosine, through_cosine, value=-1)
        flat = dz.flatten(0, 1)
        to_weight = omega * (flat.T @ h.flatten(0, 1))
        to_bias = omega * dz[VALUE].sum(0)
        to_input = dz @ (omega * weight) if ctx.needs_input_grad[0] else None  # type: ignore[attr-defined]
        return to_input, to_weight, to_bias, None


@dataclass(frozen=True)
class InputScale:
    """The affine map t = factor * c + shift from the package's inputs c to the published ones t.

    Plain coordinates of [-1, 1] are mapped to [0, 1] (Kairanda et al. 2023, appendix A); cosine and sine of a periodic
    one are unchanged.

    Attributes
    ----------
    factor, shift
        (n,) for the n inputs.
    """

    factor: Tensor
    shift: Tensor

    @classmethod
    def from_inputs(cls, inputs: Inputs, placement: Placement) -> InputScale:
        """Return the map for the inputs of a case."""
        half: list[bool] = []
        for periodic in inputs.case.surface.domain.periodic:
            turns = {"both": [False, False], "cosine": [False], "none": [True]}
            half += turns[inputs.periodic] if periodic else [True]
        halved = torch.tensor([half[k] for k in inputs.kept], device=placement.device)
        factor = torch.where(halved, 0.5, 1.0).to(placement.dtype)
        return cls(factor, 1 - factor)

    def apply(self, jets: Tensor) -> Tensor:
        """Return the jets (6, N, n) of the published inputs."""
        return jets * self.factor + constant(self.shift.expand(jets.shape[1:]))


@dataclass(frozen=True)
class Siren:
    """Trained tensors of a SIREN: F = W_out h + b_out, h <- sin(omega0 (W h + b)); or of a network like it.

    Attributes
    ----------
    weights, biases
        Of the hidden layers and, last, of the linear output layer: (out, in) and (out,).
    omega0
        Frequency of every sine.
    activation
        Name of another activation than the sine; then omega0 is 1.
    beside
        Number of last inputs that only the output layer gets: singular features.
    """

    weights: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]
    omega0: float
    activation: str = "sine"
    beside: int = 0

    @property
    def tensors(self) -> list[Tensor]:
        """The trained tensors, layer by layer."""
        return [*self.weights, *self.biases]

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(tensor.numel() for tensor in self.tensors)

    def jets(self, inputs: Tensor) -> Tensor:
        """Return the jets (6, N, 3) of F from the jets (6, N, n) of the published inputs."""
        h = inputs[..., : self.weights[0].shape[1]]
        *hidden, (weight, bias) = zip(self.weights, self.biases, strict=True)
        for w, b in hidden:
            h = sine_layer(h, w, b, self.omega0) if self.activation == "sine" else self._layer(h, w, b)
        if self.beside:
            h = torch.cat([h, inputs[..., -self.beside :]], dim=-1)
        return linear_layer(h, weight, bias)

    def _layer(self, h: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        z = linear_layer(h, weight, bias)
        return compose(smooth_activation(self.activation)(z[VALUE], 2), z)

    def with_tensors(self, tensors: list[Tensor]) -> Siren:
        """Return the same network with other numbers."""
        layers = len(self.weights)
        return replace(self, weights=tuple(tensors[:layers]), biases=tuple(tensors[layers:]))

    def as_field(self, scale: InputScale, unit: float) -> tuple[Network, Tensor]:
        """Return the field unit * F on the package's inputs: hidden layers, and the output layer (3, M + 1 + beside).

        The bias comes before the columns of singular features: it multiplies the constant among the fixed features.
        """
        weights = [self.omega0 * w for w in self.weights[:-1]]
        biases = [self.omega0 * b for b in self.biases[:-1]]
        biases[0] = biases[0] + weights[0] @ scale.shift
        weights[0] = weights[0] * scale.factor
        width = len(weights[-1])
        columns = (self.weights[-1][:, :width], self.biases[-1][:, None], self.weights[-1][:, width:])
        output = unit * torch.cat(columns, dim=1)
        return Network(tuple(weights), tuple(biases), self.activation), output

    @classmethod
    def from_field(cls, network: Network, output: Tensor, omega0: float, scale: InputScale, unit: float) -> Siren:
        """Return the network of a field on the package's inputs; the inverse of `as_field`."""
        weights = [w / omega0 for w in network.weights]
        biases = [b / omega0 for b in network.biases]
        weights[0] = weights[0] / scale.factor
        biases[0] = biases[0] - weights[0] @ scale.shift
        last = torch.cat([output[:, : network.width], output[:, network.width + 1 :]], dim=1) / unit
        beside = output.shape[1] - network.width - 1
        bias = output[:, network.width] / unit
        return cls((*weights, last), (*biases, bias), omega0, network.activation, beside)


def initial_siren(
    inputs: int,
    layers: int,
    width: int,
    omega0: float,
    seed: int,
    placement: Placement,
    activation: str = "sine",
    beside: int = 0,
) -> Siren:
    """Return a SIREN as initialised by Sitzmann et al. (2020), section 3.2 and their code.

    Weights are U(-1/n, 1/n) in the first layer and U(-sqrt(6/n)/omega0, sqrt(6/n)/omega0) in all others, the output
    layer included; biases are U(-1/sqrt(n), 1/sqrt(n)), the default of a linear layer. With another activation
    than the sine, weights are drawn like biases, which is their default, and omega0 is 1.
    """
    sines = activation == "sine"
    generator = torch.Generator().manual_seed(seed)
    sizes = [inputs, *[width] * layers, 3]
    weights, biases = [], []
    for layer, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        fan_in += beside if layer == layers else 0
        bound = 1 / fan_in if layer == 0 else math.sqrt(6 / fan_in) / omega0
        bound = bound if sines else 1 / math.sqrt(fan_in)
        weights.append(_uniform(generator, bound, (fan_out, fan_in), placement))
        biases.append(_uniform(generator, 1 / math.sqrt(fan_in), (fan_out,), placement))
    return Siren(tuple(weights), tuple(biases), omega0 if sines else 1.0, activation, beside)


def check_same_layers(siren: Siren, wanted: Siren) -> None:
    """Raise InputError, in one sentence, if two networks do not have layers of the same sizes."""
    for found, expected in zip(_layer_shapes(siren), _layer_shapes(wanted), strict=False):
        if found != expected:
            raise InputError(f"the start has a layer of {found}, but the settings ask for one of {expected}")
    if len(siren.weights) != len(wanted.weights):
        raise InputError(
            f"the start has {len(siren.weights) - 1} hidden layers, but the settings ask for {len(wanted.weights) - 1}"
        )


def _layer_shapes(siren: Siren) -> Iterator[str]:
    """Yield inputs x units of each layer."""
    yield from (f"{w.shape[1]} x {w.shape[0]}" for w in siren.weights)


def _uniform(generator: torch.Generator, bound: float, shape: tuple[int, ...], placement: Placement) -> Tensor:
    drawn = torch.rand(shape, generator=generator, dtype=torch.float64)
    return ((2 * drawn - 1) * bound).to(device=placement.device, dtype=placement.dtype)


SIGMA = 0.01  # Kairanda et al. 2023, section 5.2; in squared units of the case file's coordinates
PINNED_CELLS = 20  # a side, of the published grid: the width of pins that its samples resolve
FAR_FROM_PIN = 700.0  # upper bound of d^2 / sigma: beyond it exp underflows to zero


@dataclass(frozen=True)
class PublishedFactors:
    """The matrix M of the published ansatz u = M F of a case."""

    case: Case
    t: float = 1.0
    kind: Pins = "points"
    covariant: bool = False

    @cached_property
    def pins(self) -> tuple[tuple[Point, Array], ...]:
        """Points with loads that are held across the load, with the matrices (3, 3) of the held directions."""
        if self.case.supports or not self.case.remove_rigid_motions or self.kind == "none":
            return ()
        pins = []
        for load in (load for load in self.case.loads if isinstance(load, PointLoad)):
            for place in (self.case.places[name] for name in load.on):
                if isinstance(place, Point):
                    force = self.case.evaluate(load.force, np.asarray(place.xi), self.t)[0, 0]
                    square = float(force @ force)
                    if square > 0:
                        pins.append((place, np.eye(3) - np.outer(force, force) / square))
        return tuple(pins)

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        matrix = BoundaryFactors(self.case).matrix(points, placement)
        for point, directions in self.pins:
            bump = self._bump(point, points, placement)
            identity = constant(torch.eye(3, device=placement.device, dtype=placement.dtype).expand(len(points), 3, 3))
            factor = identity - bump[..., None, None] * placement.tensor(directions)
            matrix = matrix_product(matrix, factor)
        if self.covariant:
            matrix = matrix_product(matrix, contravariant_basis_jet(self.case.surface, points, placement))
        return matrix

    def _bump(self, point: Point, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N) of exp(-d^2 / sigma), d in the units of the case file; or of exp(-d^2), d in cells."""
        domain = self.case.surface.domain
        if self.kind == "cells":
            first, second = (math.sqrt(SIGMA) * PINNED_CELLS / size for size in domain.size)
        else:
            first, second = (180 / math.pi if angle else 1.0 for angle in domain.angle)
        return soft_bump(self.case, point, (first, second), points, placement)


def soft_bump(
    case: Case, place: Edge | Point, units: tuple[float, float], points: Array, placement: Placement
) -> Tensor:
    """Return the jet (6, N) of exp(-d^2 / sigma) at points (N, 2), d the distance from a place (eq. (27)).

    Differences of xi1 and xi2 are multiplied by `units`; the distance from an edge is only across it. A periodic
    coordinate takes the shorter way round.
    """
    domain = case.surface.domain
    exponent = constant(placement.tensor(np.zeros(len(points))))
    for axis, coordinate in enumerate(coordinates(points, placement)):
        if isinstance(place, Edge) and axis != place.axis:
            continue
        offset = points[:, axis] - (place.coordinate(domain) if isinstance(place, Edge) else place.xi[axis])
        if domain.periodic[axis]:
            offset = offset - domain.size[axis] * np.round(offset / domain.size[axis])
        distance = coordinate * (units[axis] / math.sqrt(SIGMA))
        distance[VALUE] = placement.tensor(offset * (units[axis] / math.sqrt(SIGMA)))
        exponent = exponent - _square(distance)
    value = torch.exp(exponent[VALUE].clamp_min(-FAR_FROM_PIN))
    value = torch.where(exponent[VALUE] <= -FAR_FROM_PIN, torch.zeros_like(value), value)
    return compose((value, value, value), exponent)


def _square(z: Tensor) -> Tensor:
    v = z[VALUE]
    return compose((v * v, 2 * v, torch.full_like(v, 2.0)), z)


def published_ansatz(case: Case, spec: FieldSpec) -> Ansatz:
    """Return the ansatz with the published boundary functions of a case."""
    return Ansatz(
        case, PublishedFactors(case, spec.t, spec.pins, spec.components == "covariant"), Lift(case, spec.t), spec.t
    )
