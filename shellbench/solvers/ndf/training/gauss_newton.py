"""Gauss-Newton in the energy norm for the hidden weights, the output layer eliminated.

Variable projection in Kaufman's form (BIT 15, 1975): a change d of the hidden weights changes the strains by J d, and
the output layer then adapts within the span of the features' strains A. The model of the energy therefore is g d + 1/2
d H d with H = J^T (I - A (A^T A)^-1 A^T) J, and g the energy's gradient at fixed output weights. This is the full
gradient if the energy is stationary in the output weights; the part by forces of point supports is left out.

The same points are used many times, so that their geometry is tabulated once. There are three parts: the points of an
area rule (`Sample`), the points of edge and point loads (`Tips`), and the energy of a field on both (`Energy`).

A reverse sweep through the network's jets gives the derivatives of strains by the hidden weights: any linear functional
of the feature jets (a strain row, or all of the energy's gradient) is pulled back layer by layer. One sweep serves many
functionals at once, and keeps no graph.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.geometry import apply_rows
from shellbench.solvers.ndf.field.jets import VALUE, activation, compose
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import BATCH, Rule
from shellbench.solvers.ndf.linear.regularised import JITTER, IndefiniteError, RegularisedInverse
from shellbench.solvers.ndf.strains.energy import (
    Concentrated,
    NormalEquations,
    Table,
    add_gram,
    strain_matrix,
    surface_area,
    symmetric,
    tabulate,
    value_vector,
)
from shellbench.solvers.ndf.training.sketch import Layer, flatten_layers, through_activation

if TYPE_CHECKING:
    from shellbench.solvers.ndf.training.sketch import Sketch


@dataclass(frozen=True)
class Sample:
    """The points of a rule: the energy's table, jets of inputs (6, N, n) and of fixed features (6, N, k)."""

    table: Table
    inputs: Tensor
    fixed: Tensor

    @classmethod
    def from_rule(cls, ansatz: Ansatz, features: Features, rule: Rule) -> Sample:
        """Tabulate a rule."""
        placement = features.placement
        table = tabulate(ansatz, rule, placement, surface_area(ansatz, rule))
        inputs = features.inputs.jets(rule.points, placement)
        return cls(table, inputs, features.fixed.jets(rule.points, placement))

    def __len__(self) -> int:
        return self.inputs.shape[1]

    def parts(self) -> Iterator[Sample]:
        """Yield the sample in portions of `BATCH` points; each has the whole work of the lift."""
        for start in range(0, len(self), BATCH):
            part, table = slice(start, start + BATCH), self.table
            yield Sample(
                Table(table.rows[part], table.offset[part], table.force[part], table.work, table.anchors[:, part]),
                self.inputs[:, part],
                self.fixed[:, part],
            )

    def jets(self, network: Network) -> Tensor:
        """Return the jets (6, N, M) of all features."""
        return torch.cat([network.features(self.inputs), self.fixed], dim=-1)


@dataclass(frozen=True)
class Tips:
    """Forces (P, 3) on F at single points, with jets of inputs and fixed features there."""

    force: Tensor
    work: float
    inputs: Tensor
    fixed: Tensor

    @classmethod
    def at_forces(cls, features: Features, forces: Concentrated) -> Tips:
        """Tabulate edge and point loads."""
        inputs = features.inputs.jets(forces.points, features.placement)
        return cls(forces.force, forces.work, inputs, features.fixed.jets(forces.points, features.placement))

    def __len__(self) -> int:
        return self.inputs.shape[1]

    def load(self, network: Network) -> Tensor:
        """Return the work (3 M,) on all (component, feature) pairs."""
        values = torch.cat([network.values(self.inputs[VALUE]), self.fixed[VALUE]], dim=-1)
        return value_vector(self.force, values)


@dataclass(frozen=True)
class Energy:
    """The least energy over multiples s of a field v in u = lift + s v, by one quadrature.

    Attributes
    ----------
    gain
        (b v)^2 / (v K v) with b = f - K lift, J: without a lift the compliance, and a lower bound of the true one.
    base
        Twice the potential energy of the lift alone, J.
    """

    gain: float
    base: float

    @property
    def potential(self) -> float:
        """Potential energy, J."""
        return 0.5 * (self.base - self.gain)

    def relative_gain(self, over: Energy) -> float:
        """Return the gain of this energy over another one, relative to its own magnitude."""
        return (self.gain - over.gain) / max(abs(2 * self.potential), torch.finfo(torch.float64).tiny)


def normal_equations_on(
    sample: Sample, tips: Tips, network: Network, kept: list[Tensor] | None = None
) -> NormalEquations:
    """Integrate the energy of the output weights on a sample; `kept` gets the jets of its parts, for `energy_on`."""
    unknowns = 3 * (network.width + sample.fixed.shape[2])
    like = network.weights[0]
    stiffness, load = like.new_zeros((unknowns, unknowns)), like.new_zeros(unknowns)
    anchor = like.new_zeros((len(sample.table.anchors), unknowns))
    for part in sample.parts():
        jets = part.jets(network)
        if kept is not None:
            kept.append(jets)
        rows = strain_matrix(part.table, jets)
        add_gram(stiffness, rows)
        load += value_vector(part.table.force, jets[VALUE]) - rows.T @ part.table.offset.reshape(-1)
        anchor += (part.table.anchors.mT @ jets[VALUE]).reshape(len(anchor), unknowns)
    return NormalEquations(symmetric(stiffness), load + tips.load(network), anchor, 0.0)


def energy_on(sample: Sample, tips: Tips, network: Network, output: Tensor, kept: list[Tensor] | None = None) -> Energy:
    """Return the energy of the field with output layer (3, M) on a sample, the jets of its parts `kept` or computed.

    Raises
    ------
    SolveFailure
        If it is NaN.
    """
    work, stored, base = 0.0, 0.0, -2 * (sample.table.work + tips.work)
    for k, part in enumerate(sample.parts()):
        jet = (kept[k] if kept else part.jets(network)) @ output.T
        strain, table = apply_rows(part.table.rows, jet), part.table
        work += float((table.force * jet[VALUE]).sum() - (table.offset * strain).sum())
        stored += float((strain**2).sum())
        base += float((table.offset**2).sum())
    if len(tips):
        work += float(tips.load(network) @ output.reshape(-1))
    gain = work * work / stored if stored > 0 else 0.0
    if not gain < float("inf"):  # also if it is NaN
        raise SolveFailure("the energy of the field is not finite")
    return Energy(gain, base)


def forward(network: Network, inputs: Tensor) -> tuple[Tensor, list[Layer]]:
    """Return the feature jets (6, N, M) of input jets (6, N, n), and the data of the reverse sweep."""
    function, h, tape = activation(network.activation), inputs, []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        z = h @ weight.T
        z[VALUE] += bias
        f0, f1, f2, f3 = function(z[VALUE], 3)
        tape.append(Layer(h, z, f1, f2, f3))
        h = compose((f0, f1, f2), z)
    return h, tape


def jacobian(network: Network, tape: list[Layer], seed: Tensor) -> Tensor:
    """Return the rows (N S, P) of d(functional)/d(weights), in the order of `flatten`.

    Parameters
    ----------
    seed
        (N, S, 6, M): S functionals of the feature jets at each point.
    """
    count, rows = seed.shape[:2]
    result = seed.new_empty((count, rows, network.parameters))
    end = network.parameters
    for weight, layer in zip(reversed(network.weights), reversed(tape), strict=True):
        seed = through_activation(layer, seed)
        units, width = weight.shape
        start = end - units * (width + 1)
        block = result[:, :, start:end].view(count, rows, units, width + 1)
        block[..., :-1] = seed.transpose(2, 3) @ layer.inputs.permute(1, 0, 2)[:, None]
        block[..., -1] = seed[:, :, VALUE]
        end = start
        if end:
            seed = seed @ weight
    return result.view(count * rows, -1)


def gradient(network: Network, tape: list[Layer], seed: Tensor) -> Tensor:
    """Return (P,), the derivative of one functional that sums over points, from its `seed` (N, 6, M)."""
    parts: list[Tensor] = []
    seed = seed[:, None]
    for weight, layer in zip(reversed(network.weights), reversed(tape), strict=True):
        seed = through_activation(layer, seed)
        flat = seed.permute(2, 0, 1, 3).reshape(-1, len(weight))
        slope = flat.T @ layer.inputs.reshape(-1, weight.shape[1])
        parts.append(torch.cat([slope, seed[:, 0, VALUE].sum(0)[:, None]], dim=1).reshape(-1))
        if len(parts) < len(tape):
            seed = seed @ weight
    return torch.cat(parts[::-1])


def flatten(network: Network) -> Tensor:
    """Return all weights (P,): layer by layer, each unit's weights and then its bias."""
    pairs = zip(network.weights, network.biases, strict=True)
    return flatten_layers([torch.cat([weight, bias[:, None]], dim=1) for weight, bias in pairs])


def unflatten(vector: Tensor, like: Network) -> Network:
    """Return a network of the same shape with the weights (P,)."""
    sizes = [weight.numel() + len(weight) for weight in like.weights]
    blocks = [part.view(len(weight), -1) for part, weight in zip(torch.split(vector, sizes), like.weights, strict=True)]
    return Network(
        tuple(block[:, :-1].contiguous() for block in blocks),
        tuple(block[:, -1].contiguous() for block in blocks),
        like.activation,
    )


GRAM_JITTER = 10 * JITTER  # on the unit diagonal of the features' matrix, which a coarse quadrature makes worse
FLOOR = 1e-6  # of the unprojected diagonal, in Marquardt's scaling: it fixes weights that the output layer can replace


@dataclass(frozen=True)
class Quadratic:
    """The model g d + 1/2 d H d of the energy, J, in k directions of the weights.

    Attributes
    ----------
    slope, matrix
        g (k,) and H (k, k).
    floor
        (k,) diagonal of J^T J.
    """

    slope: Tensor
    matrix: Tensor
    floor: Tensor

    def step(self, damping: float) -> Tensor | None:
        """Return -(H + damping diag H)^-1 g, or None if that matrix is not positive definite."""
        # Marquardt scales by the diagonal of H. The projection nearly removes the diagonal of some weights, which would
        # then diverge. The floor is a share of the diagonal before projection.
        scale = (self.matrix.diagonal() + FLOOR * self.floor).clamp_min(torch.finfo(self.slope.dtype).tiny).sqrt()
        scaled = self.matrix / scale[:, None] / scale
        scaled.diagonal().add_(damping)
        factor, info = torch.linalg.cholesky_ex(scaled)
        step = -torch.cholesky_solve((self.slope / scale)[:, None], factor)[:, 0] / scale
        return step if int(info) == 0 and bool(torch.isfinite(step).all()) else None

    def decrease(self, step: Tensor) -> float:
        """Return the decrease of the model along a step, J."""
        return float(-(self.slope @ step) - 0.5 * step @ (self.matrix @ step))


def energy_gradient(sample: Sample, tips: Tips, network: Network, output: Tensor) -> Tensor:
    """Return the gradient (P,) of the energy in the hidden weights at a fixed output layer (3, M)."""
    # g = sum over points of (stress . dstrain/dtheta - force . du/dtheta), by one reverse sweep for each part of the
    # sample. The rows contain the roots of stiffness and weight, so that strains are their own stresses. The output
    # layer is fixed: its change adds nothing, since the energy is stationary in it. With point supports this is true
    # only of the free fields: the work of their forces is left out of g.
    used = output[:, : network.width]
    total = output.new_zeros(network.parameters)
    for part in sample.parts():
        features, tape = forward(network, part.inputs)
        jet = torch.cat([features, part.fixed], dim=-1) @ output.T
        rows = part.table.rows
        strain = apply_rows(rows, jet) + part.table.offset
        pull = (strain[:, None] @ rows.flatten(2)).view(-1, 3, 6)
        pull[..., VALUE] -= part.table.force
        total += gradient(network, tape, pull.mT @ used)
    if len(tips):
        _, tape = forward(network, tips.inputs)
        seed = output.new_zeros((len(tips), 6, network.width))
        seed[:, VALUE] = -(tips.force @ used)
        total += gradient(network, tape, seed)
    return total


def quadratic_model(
    sample: Sample,
    tips: Tips,
    coarse: Sample,
    network: Network,
    output: Tensor,
    sketch: Sketch | None = None,
    slope: Tensor | None = None,
) -> Quadratic:
    """Return the model of the energy: its gradient on `sample`, its matrix on the sparser `coarse`.

    It covers all weights, or the directions of a `sketch`. `slope` (P,) is the gradient if it is known.

    Raises
    ------
    SolveFailure
        If the features' strains are not finite.
    """
    # 1. Compute [A J], strains by output and by hidden weights, on the coarse rule, and their Gram matrix point by
    #    point.
    # 2. Form H = J^T J - (A^T J)^T (A^T A)^-1 (A^T J), the Schur complement of the output layer.
    # 3. Compute g on the fine sample: it determines the minimum that training approaches, H only the speed.
    # Golub and Pereyra differentiate the projection too. Kaufman drops that term, which is of the size of the residual.
    # Strains are no small residual, but g is still exact, and H is only a model. The projection itself is never formed:
    # it would have a row for each strain of each point.
    unknowns, count = output.numel(), sketch.count if sketch else network.parameters
    joint = output.new_zeros((unknowns + count,) * 2)
    anchors = output.new_zeros((len(coarse.table.anchors), unknowns))
    for part in coarse.parts():
        features, tape = forward(network, part.inputs)
        jets = torch.cat([features, part.fixed], dim=-1)
        seed = part.table.rows.transpose(2, 3) @ output[:, : network.width]
        moved = (sketch.rows if sketch else jacobian)(network, tape, seed)
        add_gram(joint, torch.cat([strain_matrix(part.table, jets), moved], dim=1))
        anchors += (part.table.anchors.mT @ jets[VALUE]).reshape(len(anchors), unknowns)
    joint = symmetric(joint)
    own, cross, matrix = joint[:unknowns, :unknowns], joint[:unknowns, unknowns:], joint[unknowns:, unknowns:]
    own = own + anchors.T @ anchors
    try:
        # half^T half is subtracted: it is positive semidefinite for any rounding of the inverse.
        half = RegularisedInverse.from_matrix(own, GRAM_JITTER).half(cross)
    except IndefiniteError:
        raise SolveFailure("the Gauss-Newton matrix is not positive definite") from None
    slope = energy_gradient(sample, tips, network, output) if slope is None else slope
    return Quadratic(sketch.restrict(slope) if sketch else slope, matrix - half.T @ half, matrix.diagonal().clone())
