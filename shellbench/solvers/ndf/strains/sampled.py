"""Features and reference geometry at points, and the maps between output weights and displacement gradients."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.ansatz import Ansatz, FeatureSet
from shellbench.solvers.ndf.field.jets import COMPONENTS, VALUE, Array
from shellbench.solvers.ndf.field.quadrature import BATCH
from shellbench.solvers.ndf.strains.strain_measures import GRADIENTS, Undeformed, gradients_through

COLUMNS = 6 * COMPONENTS  # components of F by planes of its jet
CACHED = 256  # points whose products are summed at once: they fit into a processor's cache


@dataclass(frozen=True)
class Sampled:
    """N points of a shell for M features: gradients of u = lift + M F are affine in the output weights (3, M).

    Attributes
    ----------
    points
        (N, 2).
    features
        The features.
    kept
        (N, 6, M) jets of the features; None if each use computes them again, for a portion of the points at a time.
    through
        (N, 15, 18) from the jet of F to displacement gradients (`strain_measures.gradients_through`).
    matrix
        (N, 3, 3) values of the boundary matrix M.
    undeformed
        The surface.
    """

    points: Array
    features: FeatureSet
    kept: Tensor | None
    through: Tensor
    matrix: Tensor
    undeformed: Undeformed

    @classmethod
    def at_points(cls, ansatz: Ansatz, features: FeatureSet, points: Array, keep: bool = True) -> Sampled:
        """Tabulate points (N, 2), with or without the jets there."""
        placement, surface = features.placement, ansatz.case.surface
        undeformed = Undeformed.at_points(surface, points, placement)
        matrix = ansatz.factors.matrix(points, placement)
        through = gradients_through(undeformed.geometry, matrix)
        kept = features.jets(points).permute(1, 0, 2).contiguous() if keep else None
        return cls(points, features, kept, through, matrix[VALUE], undeformed)

    @property
    def jets(self) -> Tensor:
        """(N, 6, M) jets of the features."""
        return torch.cat([jets for _, jets in self._portions()]) if self.kept is None else self.kept

    def _portions(self, small: bool = False) -> Iterator[tuple[slice, Tensor]]:
        """Yield jets (n, 6, M) with the slice of their points; kept jets in `small` portions, or at once."""
        if self.kept is not None and not small:
            yield slice(None), self.kept
            return
        size = CACHED if small else BATCH
        for some in (slice(start, start + size) for start in range(0, len(self.points), size)):
            kept = None if self.kept is None else self.kept[some]
            yield some, self.features.jets(self.points[some]).permute(1, 0, 2).contiguous() if kept is None else kept

    def with_ansatz(self, ansatz: Ansatz) -> Sampled:
        """Return the same points and features with other boundary factors."""
        matrix = ansatz.factors.matrix(self.points, self.features.placement)
        return replace(self, through=gradients_through(self.undeformed.geometry, matrix), matrix=matrix[VALUE])

    def lift_gradients(self, ansatz: Ansatz) -> Tensor | None:
        """Return the gradients (N, 5, 3) of the lift, None where it is zero."""
        if not ansatz.lift.moves:
            return None
        jet = ansatz.lift.jet(self.points, self.features.placement)
        return self.undeformed.gradients(jet)

    def gradients(self, output: Tensor, lift: Tensor | None = None) -> Tensor:
        """Return u,1, u,2, d_11, d_22, d_12 (N, 5, 3) for output weights (3, M), those of the lift added."""
        free = torch.cat([output @ jets.mT for _, jets in self._portions()]).reshape(-1, COLUMNS, 1)
        gradients = (self.through @ free).view(-1, 5, COMPONENTS)
        return gradients if lift is None else gradients + lift

    def of_several(self, outputs: Tensor) -> tuple[Tensor, Tensor]:
        """Return gradients (N, 15, m) and displacements (N, 3, m) less the lift for output weights (m, 3, M)."""
        flat = outputs.flatten(0, 1)
        free = torch.cat([flat @ jets.mT for _, jets in self._portions()]).view(-1, len(outputs), COMPONENTS, 6)
        gradients = self.through @ free.reshape(-1, len(outputs), COLUMNS).mT
        return gradients, self.matrix @ free[..., VALUE].mT

    def pull_back(self, conjugate: Tensor) -> Tensor:
        """Return the vector (3 M,) on the output weights from forces (N, 15) conjugate to the gradients."""
        on_jet = (conjugate[:, None] @ self.through).view(-1, COMPONENTS, 6)
        total = conjugate.new_zeros((COMPONENTS, self.features.count))
        for some, jets in self._portions():
            total += on_jet[some].permute(1, 0, 2).reshape(COMPONENTS, -1) @ jets.flatten(0, 1)
        return total.reshape(-1)

    def forces(self, force: Tensor) -> Tensor:
        """Return the vector (3 M,) of forces (N, 3) on u."""
        on_free = (self.matrix.mT @ force[..., None])[..., 0]
        total = force.new_zeros((COMPONENTS, self.features.count))
        for some, jets in self._portions():
            total += on_free[some].T @ jets[:, VALUE]
        return total.reshape(-1)

    def displacements(self, output: Tensor) -> Tensor:
        """Return M F (N, 3), the displacement less the lift, for output weights (3, M)."""
        free = torch.cat([jets[:, VALUE] @ output.mT for _, jets in self._portions()])
        return (self.matrix @ free[..., None])[..., 0]

    def products(self, share: Tensor) -> Tensor:
        """Return the matrix (3 M, 3 M) of sums over points of products of displacements, weighted by `share` (N,)."""
        # (M phi_i, M phi_j) by blocks of components: the boundary matrix M may couple them.
        metric = (self.matrix.mT @ self.matrix) * share[:, None, None]
        total = share.new_zeros((COMPONENTS * self.features.count,) * 2)
        for some, jets in self._portions():
            values = jets[:, VALUE]
            for c in range(COMPONENTS):
                for d in range(COMPONENTS):
                    self._block(total, c, d).addmm_(values.T, metric[some, c, d, None] * values)
        return total

    def _block(self, matrix: Tensor, c: int, d: int) -> Tensor:
        """Return a block of components of a matrix (3 M, 3 M) to write into."""
        width = self.features.count
        return matrix[c * width : (c + 1) * width, d * width : (d + 1) * width]

    def values_by_slopes(self, form: Tensor) -> Tensor:
        """Return the matrix (3 M, 3 M) of a form (N, 3, 6) that pairs values of u with its slopes u,1 and u,2."""
        on_jets = (self.matrix.mT @ form @ self.through[:, : form.shape[-1]]).view(-1, COMPONENTS, COMPONENTS, 6)
        total = form.new_zeros((COMPONENTS * self.features.count,) * 2)
        for some, jets in self._portions():
            for c in range(COMPONENTS):
                for d in range(COMPONENTS):
                    half = (on_jets[some, c, None, d] @ jets)[:, 0]
                    self._block(total, c, d).addmm_(jets[:, VALUE].T, half)
        return total

    def add_form(self, total: Tensor, form: Tensor) -> None:
        """Add the symmetric form (N, 15, 15) of the gradients to a matrix (3 M, 3 M) of the output weights.

        It adds only the blocks of components on and above the diagonal; `symmetric` completes them.
        """
        on_jets = (self.through.mT @ form @ self.through).view(-1, COMPONENTS, 6, COMPONENTS, 6)
        for some, jets in self._portions(small=True):
            flat = jets.flatten(0, 1)
            for d in range(COMPONENTS):
                for c in range(d + 1):
                    half = (on_jets[some, c, :, d] @ jets).flatten(0, 1)
                    self._block(total, c, d).addmm_(flat.T, half)

    def block_sum(self, form: Tensor) -> Tensor:
        """Return the sum (M, M) of the diagonal blocks of a symmetric form's matrix (see `add_form`)."""
        on_jets = (self.through.mT @ form @ self.through).view(-1, COMPONENTS, 6, COMPONENTS, 6)
        alike = on_jets.diagonal(dim1=1, dim2=3).sum(-1)
        total = form.new_zeros((self.features.count,) * 2)
        for some, jets in self._portions(small=True):
            total.addmm_(jets.flatten(0, 1).T, (alike[some] @ jets).flatten(0, 1))
        return total


def elastic_form(elasticity: Tensor, variation: Tensor) -> Tensor:
    """Return the form (N, 15, 15) of the elastic part of the second variation."""
    rows = variation.view(-1, 2, 3, GRADIENTS)
    return variation.mT @ (elasticity @ rows).view(-1, 6, GRADIENTS)
