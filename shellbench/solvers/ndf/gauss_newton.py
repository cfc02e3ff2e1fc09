"""Gauss-Newton in the energy norm for the hidden weights, the output layer eliminated.

Variable projection in Kaufman's form (BIT 15, 1975): a change d of the hidden weights changes the strains by J d, and
the output layer then adapts by whatever the features' strains A can represent. So the model of the energy is
g d + 1/2 d H d with H = J^T (I - A (A^T A)^-1 A^T) J, and g the energy's gradient at fixed output weights. That is the
full one where the energy is stationary in the output weights; where point supports bear forces, their part is left out.

The reverse sweep through a network's jets: how strains change with the hidden weights.

Any linear functional of the feature jets (a strain row, or all of the energy's gradient) is pulled back layer by layer.
One sweep serves many functionals at once, and no graph is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.energy import add_gram, mirrored, strain_matrix
from shellbench.solvers.ndf.jets import D1, D2, D11, D12, D22, VALUE, activation, compose
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.sample import Sample, Tips
from shellbench.solvers.ndf.solve import IndefiniteError, RegularisedInverse
from shellbench.solvers.ndf.strain import apply_rows


class Layer(NamedTuple):
    """What the sweep needs of a layer: input jets (6, N, n), z (6, N, m), and sigma', sigma'', sigma''' (N, m)."""

    inputs: Tensor
    z: Tensor
    first: Tensor
    second: Tensor
    third: Tensor


def forward(network: Network, inputs: Tensor) -> tuple[Tensor, list[Layer]]:
    """Return the feature jets (6, N, M) of input jets (6, N, n), and what the sweep back needs."""
    function, h, tape = activation(network.activation), inputs, []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        z = h @ weight.T
        z[VALUE] += bias
        f0, f1, f2, f3 = function(z[VALUE], 3)
        tape.append(Layer(h, z, f1, f2, f3))
        h = compose((f0, f1, f2), z)
    return h, tape


def through_activation(layer: Layer, seed: Tensor) -> Tensor:
    """Pull functionals of sigma(z) back to functionals of z: the chain rule for jets, transposed.

    Parameters
    ----------
    seed
        (N, S, 6, m): with which factor each plane of sigma(z) enters functional S at a point.
    """
    z1, z2, z11, z12, z22 = (layer.z[plane][:, None] for plane in (D1, D2, D11, D12, D22))
    f1, f2, f3 = layer.first[:, None], layer.second[:, None], layer.third[:, None]
    result = seed * f1[:, :, None]
    c11, c12, c22 = seed[:, :, D11], seed[:, :, D12], seed[:, :, D22]
    bend = seed[:, :, D1] * z1
    bend.addcmul_(seed[:, :, D2], z2).addcmul_(c11, z11).addcmul_(c12, z12).addcmul_(c22, z22)
    slope1, slope2 = c11 * z1, c22 * z2
    twist = slope1 * z1
    twist.addcmul_(slope2, z2).addcmul_(c12, z1 * z2)
    result[:, :, VALUE].addcmul_(f2, bend).addcmul_(f3, twist)
    result[:, :, D1].addcmul_(f2, slope1.mul_(2).addcmul_(c12, z2))
    result[:, :, D2].addcmul_(f2, slope2.mul_(2).addcmul_(c12, z1))
    return result


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
    return torch.cat([torch.cat([weight, bias[:, None]], dim=1).reshape(-1) for weight, bias in pairs])


def unflatten(vector: Tensor, like: Network) -> Network:
    """Return a network of the same shape with the weights (P,)."""
    sizes = [weight.numel() + len(weight) for weight in like.weights]
    blocks = [part.view(len(weight), -1) for part, weight in zip(torch.split(vector, sizes), like.weights, strict=True)]
    return Network(
        tuple(block[:, :-1].contiguous() for block in blocks),
        tuple(block[:, -1].contiguous() for block in blocks),
        like.activation,
    )


JITTER = 1e-11  # on the unit diagonal of the features' matrix, which a coarse quadrature conditions worse
FLOOR = 1e-6  # of the unprojected diagonal, in Marquardt's scaling: weights that the output layer replaces stay


@dataclass(frozen=True)
class Quadratic:
    """The model g d + 1/2 d H d of the energy, J.

    Attributes
    ----------
    slope, matrix
        g (P,) and H (P, P).
    floor
        (P,) diagonal of J^T J.
    """

    slope: Tensor
    matrix: Tensor
    floor: Tensor

    def step(self, damping: float) -> Tensor | None:
        """Return -(H + damping diag H)^-1 g, or None where that is not positive definite."""
        # Marquardt scales by the diagonal of H. The projection leaves next to nothing on the diagonal of some weights,
        # which would then run away. The floor is a share of the diagonal before it.
        scale = (self.matrix.diagonal() + FLOOR * self.floor).clamp_min(torch.finfo(self.slope.dtype).tiny).sqrt()
        scaled = self.matrix / scale[:, None] / scale
        scaled.diagonal().add_(damping)
        factor, info = torch.linalg.cholesky_ex(scaled)
        step = -torch.cholesky_solve((self.slope / scale)[:, None], factor)[:, 0] / scale
        return step if int(info) == 0 and bool(torch.isfinite(step).all()) else None

    def decrease(self, step: Tensor) -> float:
        """Return by how much the model falls along a step, J."""
        return float(-(self.slope @ step) - 0.5 * step @ (self.matrix @ step))


def energy_gradient(sample: Sample, tips: Tips, network: Network, output: Tensor) -> Tensor:
    """Return the gradient (P,) of the energy in the hidden weights at a fixed output layer (3, M)."""
    # g = sum over points of (stress . dstrain/dtheta - force . du/dtheta), by one reverse sweep for each part of the
    # sample. The rows hold the roots of stiffness and weight, so that strains are their own stresses. The output layer
    # is fixed: its own change adds nothing, as the energy is stationary in it. Under point supports it is so only along
    # what they leave free: the work of their forces is left out of g.
    used = output[:, : network.width]
    total = output.new_zeros(network.parameters)
    for part in sample.parts():
        features, tape = forward(network, part.inputs)
        jet = torch.cat([features, part.fixed], dim=-1) @ output.T
        rows = part.table.rows
        strain = apply_rows(rows, jet) + part.table.offset
        pull = (strain[:, None] @ rows.reshape(len(part), 6, 18)).view(-1, 3, 6)
        pull[..., VALUE] -= part.table.force
        total += gradient(network, tape, pull.mT @ used)
    if len(tips):
        _, tape = forward(network, tips.inputs)
        seed = output.new_zeros((len(tips), 6, network.width))
        seed[:, VALUE] = -(tips.force @ used)
        total += gradient(network, tape, seed)
    return total


def quadratic_model(sample: Sample, tips: Tips, coarse: Sample, network: Network, output: Tensor) -> Quadratic:
    """Return the model of the energy: its gradient on `sample`, its matrix on the sparser `coarse`.

    Raises
    ------
    SolveFailure
        If the features' strains are not finite.
    """
    # 1. [A J], strains by output and by hidden weights, on the coarse rule; their Gram matrix point by point.
    # 2. H = J^T J - (A^T J)^T (A^T A)^-1 (A^T J), the Schur complement of the output layer.
    # 3. g on the fine sample: it decides where training goes, H only how fast.
    # Golub and Pereyra differentiate the projection too. Kaufman drops that term, which is of the size of the residual.
    # Strains are no small residual, but g is exact all the same, and H is only a model. The projection itself is never
    # formed: it would have a row for each strain of each point.
    unknowns = output.numel()
    joint = output.new_zeros((unknowns + network.parameters,) * 2)
    anchors = output.new_zeros((len(coarse.table.anchors), unknowns))
    for part in coarse.parts():
        features, tape = forward(network, part.inputs)
        jets = torch.cat([features, part.fixed], dim=-1)
        seed = part.table.rows.transpose(2, 3) @ output[:, : network.width]
        add_gram(joint, torch.cat([strain_matrix(part.table, jets), jacobian(network, tape, seed)], dim=1))
        anchors += (part.table.anchors.mT @ jets[VALUE]).reshape(len(anchors), unknowns)
    joint = mirrored(joint)
    own, cross, matrix = joint[:unknowns, :unknowns], joint[:unknowns, unknowns:], joint[unknowns:, unknowns:]
    own = own + anchors.T @ anchors
    try:
        # half^T half is subtracted: positive semidefinite whatever the rounding of the inverse.
        half = RegularisedInverse.from_matrix(own, JITTER).half(cross)
    except IndefiniteError:
        raise SolveFailure("the Gauss-Newton matrix is not positive definite") from None
    return Quadratic(energy_gradient(sample, tips, network, output), matrix - half.T @ half, matrix.diagonal().clone())
