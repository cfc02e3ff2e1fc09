"""Gauss-Newton in the energy norm for the hidden weights, the output layer eliminated.

Variable projection in Kaufman's form (BIT 15, 1975): a change d of the hidden weights changes the strains by J d, and
the output layer then adapts by whatever the features' strains A can represent. So the model of the energy is
g d + 1/2 d H d with H = J^T (I - A (A^T A)^-1 A^T) J, and g the energy's gradient at fixed output weights, which is
the full one because the energy is stationary in the output weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.backward import forward, gradient, jacobian
from shellbench.solvers.ndf.energy import add_gram, mirrored, strain_matrix
from shellbench.solvers.ndf.jets import VALUE
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.sample import Sample, Tips
from shellbench.solvers.ndf.solve import IndefiniteError, RegularisedInverse
from shellbench.solvers.ndf.strain import apply_rows

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
