"""Strain measures of a displacement field at any size: exact, published, and linear, each with two variations.

All are functions of five displacement gradients at a point, u,1, u,2 and d_ab = u,ab - Gamma^m_ab u,m (ab = 11, 22,
12), with reference Christoffel symbols. All except the linear one have the exact membrane strain,

    eps_ab = (a_a . u,b + a_b . u,a + u,a . u,b) / 2

and differ in the bending strain. With n the deformed unit normal the exact one is

    kappa_ab = bbar_ab (1 - a3 . n) - d_ab . n,

which follows from kappa = bbar - b (Kairanda et al. 2023, (15), (16)) because the deformed base vectors are normal to
n. The published one, eq. (30), reads, with phi_l = u,l . a3 and phi^l = abar^lm phi_m,

    kappa_ab = -d_ab . a3 + phi^l (d_ab . a_l + bbar_ab phi_l / 2):

it is not invariant under rigid rotation, and a plate rolled to the angle theta has cos theta + sin^2 theta of its true
curvature. No measure subtracts large numbers.

The module also has the undeformed surface at points, with its elasticity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from shellbench.problems.shell.question.orthotropic import AnyMaterial
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.ndf.field.choices import StrainName
from shellbench.solvers.ndf.field.geometry import Geometry, elasticity_tensors, geometry, rigidities
from shellbench.solvers.ndf.field.jets import D1, D2, D11, D12, D22, VALUE, Array, Placement, from_derivatives
from shellbench.solvers.ndf.strains.stiffening import stiffening_membrane

GRADIENTS = 15  # u,1, u,2, d_11, d_22, d_12, each with three components
TWICE = (1.0, 1.0, 2.0)  # strains are 11, 22 and twice 12


UNSTRAINED = 1e-20  # energy per membrane stiffness and area that counts as rounding: a strain of 1e-10


def gradient_map(geometry: Geometry) -> Tensor:
    """Return the map (N, 5, 6) from the planes of a jet to u,1, u,2, d_11, d_22, d_12, the same for each component."""
    gamma = geometry.christoffel
    rows = gamma.new_zeros((len(gamma), 5, 6))
    rows[:, 0, D1] = rows[:, 1, D2] = 1.0
    for row, plane in ((2, D11), (3, D22), (4, D12)):
        rows[:, row, plane] = 1.0
        rows[:, row, D1], rows[:, row, D2] = -gamma[:, row - 2, 0], -gamma[:, row - 2, 1]
    return rows


def gradients_through(geometry: Geometry, matrix: Tensor) -> Tensor:
    """Return the map (N, 15, 18) from the jet of F to the gradients of u = M F, M a jet (6, N, 3, 3).

    Columns are component (slow) by plane of the jet of F; rows gradient (slow) by component of u.
    """
    count = matrix.shape[1]
    jet = matrix.new_zeros((count, 6, 3, 3, 6))  # plane and component of u, component and plane of F
    for plane in range(6):
        jet[:, plane, :, :, VALUE] = matrix[plane]
    for plane in (D1, D2):
        jet[:, plane, :, :, plane] += matrix[VALUE]
    for plane, first in ((D11, D1), (D22, D2)):
        jet[:, plane, :, :, first] += 2 * matrix[first]
        jet[:, plane, :, :, plane] += matrix[VALUE]
    jet[:, D12, :, :, D1] += matrix[D2]
    jet[:, D12, :, :, D2] += matrix[D1]
    jet[:, D12, :, :, D12] += matrix[VALUE]
    return (gradient_map(geometry) @ jet.reshape(count, 6, 54)).reshape(count, GRADIENTS, 18)


@dataclass(frozen=True)
class Reference:
    """Undeformed surface in strain measures: base vectors (N, 2, 3), a3, abar^ab, and bbar (N, 3)."""

    base: Tensor
    normal: Tensor
    inverse: Tensor
    curvature: Tensor


class Strained(Protocol):
    """Strains of N points with their variations in the gradients (N, 15)."""

    @property
    def strains(self) -> Tensor:
        """(N, 6): eps_11, eps_22, 2 eps_12, kappa_11, kappa_22, 2 kappa_12."""
        ...

    @property
    def variation(self) -> Tensor:
        """(N, 6, 15): first variation of the strains."""
        ...

    def conjugate_forces(self, stresses: Tensor) -> Tensor:
        """Return the forces conjugate to the gradients (N, 15): the sum of stresses (N, 6) times first variations."""
        ...

    def second_variation(self, stresses: Tensor) -> Tensor:
        """Return the sum of stresses (N, 6) times the second variations of the strains, (N, 15, 15)."""
        ...


@dataclass(frozen=True)
class DeformedNormal:
    """The deformed normal of N points.

    Attributes
    ----------
    normal, base, dual
        n (N, 3); deformed a_a and a^a (N, 2, 3).
    lowered
        (N,): 1 - a3 . n, without cancellation.
    """

    normal: Tensor
    base: Tensor
    dual: Tensor
    lowered: Tensor

    @classmethod
    def from_slopes(cls, reference: Reference, slopes: Tensor) -> DeformedNormal:
        """Turn the normal by slopes u,a (N, 2, 3)."""
        a, u = reference.base, slopes
        base = a + u
        area = _cross(base[:, 0], base[:, 1])
        size = area.norm(dim=-1, keepdim=True)
        normal = area / size
        change = _cross(a[:, 0], u[:, 1]) + _cross(u[:, 0], a[:, 1]) + _cross(u[:, 0], u[:, 1])
        across = (change - _dot(change, reference.normal)[:, None] * reference.normal) / size
        along = _dot(reference.normal, normal)
        lowered = torch.where(along > 0, _dot(across, across) / (1 + along.clamp_min(0.0)), 1 - along)
        dual = torch.stack([_cross(base[:, 1], normal), _cross(normal, base[:, 0])], dim=1) / size[:, None]
        return cls(normal, base, dual, lowered)

    def variation(self, vectors: Tensor) -> Tensor:
        """Return vectors . dn (N, ..., 6) on du,1 and du,2, for vectors (N, ..., 3): dn = -a^l (n . du,l)."""
        weights = -(vectors[..., None, :] @ _broadcast(self.dual.mT, vectors))[..., 0, :]
        return (weights[..., None] * _broadcast(self.normal[:, None], vectors)).flatten(-2)

    def second_variation(self, vectors: Tensor) -> Tensor:
        """Return vectors . d2n (N, 6, 6) for vectors (N, 3).

        From da^l = -(a^l . du,m) a^m + a^lm (n . du,m) n, which keeps a^l dual to the base and normal to n.
        """
        n, dual = self.normal, self.dual
        share = (dual @ vectors[..., None])[..., 0]
        crossed = torch.einsum("nm,nlc,nd->nmcld", share, dual, n)
        level = torch.einsum("n,nlm,nc,nd->nmcld", _dot(vectors, n), dual @ dual.mT, n, n)
        form = (crossed - level).reshape(-1, 6, 6)
        return form + crossed.reshape(-1, 6, 6).mT


def membrane(reference: Reference, slopes: Tensor, quadratic: bool = True) -> Tensor:
    """Return eps_11, eps_22, 2 eps_12 (N, 3) of slopes u,a (N, 2, 3)."""
    linear = reference.base @ slopes.mT
    product = slopes @ slopes.mT / 2 if quadratic else torch.zeros_like(linear)
    both = linear + product
    return torch.stack([both[:, 0, 0], both[:, 1, 1], both[:, 0, 1] + both[:, 1, 0]], dim=-1)


def membrane_variation(base: Tensor) -> Tensor:
    """Return the rows (N, 3, 15) of d eps on the gradients, at base vectors (N, 2, 3)."""
    rows = base.new_zeros((len(base), 3, 5, 3))
    rows[:, 0, 0], rows[:, 1, 1] = base[:, 0], base[:, 1]
    rows[:, 2, 0], rows[:, 2, 1] = base[:, 1], base[:, 0]
    return rows.flatten(-2)


def membrane_second(stresses: Tensor) -> Tensor:
    """Return the sum (N, 15, 15) of membrane stresses (N, 6) times the second variations of the membrane strains."""
    form = stresses.new_zeros((len(stresses), 5, 3, 5, 3))
    for c in range(3):
        form[:, 0, c, 0, c], form[:, 1, c, 1, c] = stresses[:, 0], stresses[:, 1]
        form[:, 0, c, 1, c] = form[:, 1, c, 0, c] = stresses[:, 2]
    return form.reshape(-1, GRADIENTS, GRADIENTS)


@dataclass(frozen=True)
class Exact:
    """Exact strains (module docstring)."""

    reference: Reference
    gradients: Tensor

    @cached_property
    def deformed(self) -> DeformedNormal:
        """The deformed normal."""
        return DeformedNormal.from_slopes(self.reference, self.gradients[:, :2])

    @property
    def strains(self) -> Tensor:
        """See `Strained`."""
        bend = self.reference.curvature * self.deformed.lowered[:, None]
        bend = bend - (self.gradients[:, 2:] @ self.deformed.normal[..., None])[..., 0]
        return torch.cat([membrane(self.reference, self.gradients[:, :2]), bend * bend.new_tensor(TWICE)], dim=-1)

    @property
    def variation(self) -> Tensor:
        """See `Strained`."""
        rows = self.gradients.new_zeros((len(self.gradients), 3, 5, 3))
        for row in range(3):
            rows[:, row, 2 + row] = -TWICE[row] * self.deformed.normal
        rows = rows.flatten(-2)
        twice = rows.new_tensor(TWICE)[:, None]
        rows[:, :, :6] = -twice * self.deformed.variation(self._curvature_vectors)
        return torch.cat([membrane_variation(self.deformed.base), rows], dim=1)

    def conjugate_forces(self, stresses: Tensor) -> Tensor:
        """See `Strained`; computed without the rows, which would take longer."""
        moments = stresses[:, 3:] * stresses.new_tensor(TWICE)
        forces = stresses[:, [0, 2, 2, 1]].view(-1, 2, 2)
        turning = self.deformed.variation((moments[:, None] @ self._curvature_vectors)[:, 0])
        bending = -moments[..., None] * self.deformed.normal[:, None]
        return torch.cat([(forces @ self.deformed.base).flatten(1) - turning, bending.flatten(1)], dim=1)

    @property
    def _curvature_vectors(self) -> Tensor:
        """(N, 3, 3): bbar_ab a3 + d_ab, the vectors whose product with n is b_ab."""
        return self.gradients[:, 2:] + self.reference.curvature[..., None] * self.reference.normal[:, None]

    def second_variation(self, stresses: Tensor) -> Tensor:
        """See `Strained`."""
        form = membrane_second(stresses)
        moments = stresses[:, 3:] * stresses.new_tensor(TWICE)
        form[:, :6, :6] -= self.deformed.second_variation((moments[:, None] @ self._curvature_vectors)[:, 0])
        identity = torch.eye(3, dtype=form.dtype, device=form.device).expand(len(form), 3, 3)
        turning = self.deformed.variation(identity)
        for row in range(3):
            block = slice(3 * (2 + row), 3 * (3 + row))
            coupling = moments[:, row, None, None] * turning
            form[:, block, :6] -= coupling
            form[:, :6, block] -= coupling.mT
        return form


@dataclass(frozen=True)
class Published:
    """Exact membrane strain with the bending strain of Kairanda et al. 2023, eq. (30)."""

    reference: Reference
    gradients: Tensor

    @property
    def _slope(self) -> tuple[Tensor, Tensor]:
        low = (self.gradients[:, :2] @ self.reference.normal[..., None])[..., 0]
        return low, (self.reference.inverse @ low[..., None])[..., 0]

    @property
    def strains(self) -> Tensor:
        """See `Strained`."""
        (low, high), d = self._slope, self.gradients[:, 2:]
        within = (d @ self.reference.base.mT) @ high[..., None]
        bend = within[..., 0] - (d @ self.reference.normal[..., None])[..., 0]
        bend = bend + self.reference.curvature * _dot(low, high)[:, None] / 2
        return torch.cat([membrane(self.reference, self.gradients[:, :2]), bend * bend.new_tensor(TWICE)], dim=-1)

    @property
    def variation(self) -> Tensor:
        """See `Strained`."""
        reference, d = self.reference, self.gradients[:, 2:]
        _, high = self._slope
        rows = self.gradients.new_zeros((len(d), 3, 5, 3))
        lean = (high[:, None] @ reference.base)[:, 0] - reference.normal
        weights = (d @ reference.base.mT) @ reference.inverse + reference.curvature[..., None] * high[:, None]
        for row in range(3):
            rows[:, row, 2 + row] = TWICE[row] * lean
            rows[:, row, :2] = TWICE[row] * weights[:, row, :, None] * reference.normal[:, None]
        return torch.cat([membrane_variation(reference.base + self.gradients[:, :2]), rows.flatten(-2)], dim=1)

    def conjugate_forces(self, stresses: Tensor) -> Tensor:
        """See `Strained`."""
        return (stresses[:, None] @ self.variation)[:, 0]

    def second_variation(self, stresses: Tensor) -> Tensor:
        """See `Strained`."""
        reference, form = self.reference, membrane_second(stresses)
        moments = stresses[:, 3:] * stresses.new_tensor(TWICE)
        a3 = reference.normal
        bent = _dot(moments, reference.curvature)[:, None, None] * reference.inverse
        form[:, :6, :6] += torch.einsum("nlm,nc,nd->nlcmd", bent, a3, a3).reshape(-1, 6, 6)
        raised = reference.inverse @ reference.base  # contravariant base vectors
        mixed = torch.einsum("nld,nc->ndlc", raised, a3).reshape(-1, 3, 6)
        for row in range(3):
            block = slice(3 * (2 + row), 3 * (3 + row))
            coupling = moments[:, row, None, None] * mixed
            form[:, block, :6] += coupling
            form[:, :6, block] += coupling.mT
        return form


@dataclass(frozen=True)
class Linear:
    """Linear strains: the first variation at rest."""

    reference: Reference
    gradients: Tensor

    @property
    def strains(self) -> Tensor:
        """See `Strained`."""
        bend = -(self.gradients[:, 2:] @ self.reference.normal[..., None])[..., 0]
        stretch = membrane(self.reference, self.gradients[:, :2], quadratic=False)
        return torch.cat([stretch, bend * bend.new_tensor(TWICE)], dim=-1)

    @property
    def variation(self) -> Tensor:
        """See `Strained`."""
        rows = self.gradients.new_zeros((len(self.gradients), 3, 5, 3))
        for row in range(3):
            rows[:, row, 2 + row] = -TWICE[row] * self.reference.normal
        return torch.cat([membrane_variation(self.reference.base), rows.flatten(-2)], dim=1)

    def conjugate_forces(self, stresses: Tensor) -> Tensor:
        """See `Strained`."""
        return (stresses[:, None] @ self.variation)[:, 0]

    def second_variation(self, stresses: Tensor) -> Tensor:
        """See `Strained`: zero."""
        return stresses.new_zeros((len(stresses), GRADIENTS, GRADIENTS))


MEASURES: Mapping[StrainName, type[Exact | Published | Linear]] = {
    "exact": Exact,
    "published": Published,
    "linear": Linear,
}


def _dot(first: Tensor, second: Tensor) -> Tensor:
    product: Tensor = (first * second).sum(-1)
    return product


def _cross(first: Tensor, second: Tensor) -> Tensor:
    product: Tensor = torch.linalg.cross(first, second, dim=-1)
    return product


def _broadcast(tensor: Tensor, vectors: Tensor) -> Tensor:
    """Broadcast (N, i, j) over the middle axes of vectors (N, ..., 3)."""
    return tensor.reshape(len(tensor), *([1] * (vectors.ndim - 2)), *tensor.shape[1:])


@dataclass(frozen=True)
class Undeformed:
    """Geometry at N points, also in the form of strain measures."""

    geometry: Geometry
    reference: Reference
    rigidity: Callable[[AnyMaterial], tuple[Tensor, Tensor]]

    @classmethod
    def at_points(cls, surface: Surface, points: Array, placement: Placement) -> Undeformed:
        """Compute the geometry at points (N, 2) of a surface."""
        found = geometry(surface, points, placement)
        jet = from_derivatives(surface.derivatives(points, 2), placement)
        second = torch.stack([jet[D11], jet[D22], jet[D12]], dim=1)
        curvature = (second @ found.normal[..., None])[..., 0]
        reference = Reference(found.tangents, found.normal, found.inverse_metric, curvature)
        return cls(found, reference, lambda material: rigidities(surface, material, points, placement))

    def gradients(self, jet: Tensor) -> Tensor:
        """Return u,1, u,2, d_11, d_22, d_12 (N, 5, 3) of a displacement with jet (6, N, 3)."""
        return gradient_map(self.geometry) @ jet.permute(1, 0, 2)

    def strained(self, measure: StrainName, gradients: Tensor) -> Strained:
        """Return the strains of displacement gradients (N, 5, 3)."""
        return MEASURES[measure](self.reference, gradients)

    def elasticity(self, material: AnyMaterial) -> Tensor:
        """Return D H and B H (eqs. (17)-(19)) as (N, 2, 3, 3), N/m and N m."""
        tensors = elasticity_tensors(self.geometry, material)
        return torch.stack(tensors, dim=1) * torch.stack(self.rigidity(material), dim=1)

    def respond(self, material: AnyMaterial, strains: Tensor) -> tuple[Tensor, Tensor]:
        """Return stresses and energies (N, 6) per area of strains (N, 6); those of each half belong together."""
        found = stresses(self.elasticity(material), strains)
        densities = 0.5 * strains * found
        if (membrane := stiffening_membrane(self.geometry, material)) is not None:
            energy, found[:, :3], _ = membrane.respond(strains[:, :3])
            densities[:, :3] = energy[:, None] / 3
        return found, densities


def stresses(elasticity: Tensor, strains: Tensor) -> Tensor:
    """Return the stresses conjugate to strains (N, 6), for an elasticity (N, 2, 3, 3)."""
    return (elasticity @ strains.view(-1, 2, 3, 1)).view(-1, 6)
