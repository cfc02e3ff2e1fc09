"""The displacement field: u = lift + M W (network features, fixed features), less a rigid motion.

The network is a coordinate network of any depth, whose features carry second-order jets. Fixed features have no weights
of their own: a constant, and the known singularity of a plate under a point force.

Near a normal point force every shell behaves like a plate, w ~ (P / 8 pi B) r^2 log r with a non-smooth remainder of
the form r^2 log r^2 times polynomials (Timoshenko & Woinowsky-Krieger, section 19). Here r is the chord |x(xi) - x0|,
smooth and single-valued on any surface, closed ones included, and the polynomials are in the tangential chords.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.choices import MULTIPLIERS, Slopes
from shellbench.solvers.ndf.field.corners import AT_A_POINT, CornerPowers
from shellbench.solvers.ndf.field.inputs import Focus, Inputs
from shellbench.solvers.ndf.field.jets import (
    D1,
    VALUE,
    Array,
    Integers,
    Placement,
    compose,
    constant,
    dot,
    from_derivatives,
    matrix_product,
    product,
)
from shellbench.solvers.ndf.field.lines import Creases, Hinges
from shellbench.solvers.ndf.field.mirrors import Mirrors, Planes, independent_columns, samples
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import ROUNDING, Rule
from shellbench.solvers.ndf.field.supports import edge_samples, edge_supports


@dataclass(frozen=True)
class FixedFeatures:
    """A constant, r^2 log r^2 times {1, t1, t2, r^2, ...} for each focus, powers of r about corners, and creases.

    Attributes
    ----------
    case
        The case, on whose surface the chords are measured.
    foci
        Points that carry a force.
    multipliers
        Number of functions that multiply r^2 log r^2.
    kept
        Numbers of the features that are used: all, unless an edge requires even ones.
    corners, creases, hinges
        Powers about corners, and about edges of contact, and integrals across hinges; they come last.
    mirrors
        Planes about which each feature is made even, as the mean of its images.
    averaged
        For each feature, the planes about which it is not even by itself.
    """

    case: Case
    foci: tuple[Focus, ...]
    multipliers: int
    kept: tuple[int, ...]
    corners: CornerPowers | None = None
    creases: Creases | None = None
    mirrors: Mirrors | None = None
    hinges: Hinges | None = None
    averaged: tuple[Planes, ...] = ()

    @classmethod
    def from_case(
        cls,
        case: Case,
        around: tuple[Focus, ...] = (),
        multipliers: int = MULTIPLIERS,
        seams: Mirrors | None = None,
        corners: CornerPowers | None = None,
        slopes: Slopes = "even",
        creases: Creases | None = None,
        mirrors: Mirrors | None = None,
        hinges: Hinges | None = None,
    ) -> FixedFeatures:
        """Derive the features of a case that are even at the bounds of even inputs, and about `seams`.

        With `mirrors`, take the features with independent means over all images.
        """
        total = 1 + multipliers * len(around) + sum(part.count for part in (corners, creases, hinges) if part)
        everything = cls(case, around, multipliers, tuple(range(total)), corners, creases, hinges=hinges)
        even = torch.ones(everything.count, dtype=torch.bool)
        for support in edge_supports(case):
            if support.free and slopes == "even":
                jets = everything.jets(edge_samples(case, support.edge)[1:-1], Placement())
                slope = jets[D1 + support.edge.axis].abs().amax(0) * case.surface.domain.size[support.edge.axis]
                even &= slope <= ROUNDING * jets[VALUE].abs().amax(0).clamp_min(1.0)
        if seams:
            even &= (seams.parity(lambda p: everything.jets(p, Placement(planes=1))[VALUE]) == 1).all(0)
        kept = tuple(torch.nonzero(even)[:, 0].tolist())
        return replace(everything, kept=kept) if mirrors is None else everything._made_even(kept, mirrors)

    def _made_even(self, kept: tuple[int, ...], mirrors: Mirrors) -> FixedFeatures:
        """Return the features replaced by the means over their images, reduced to independent ones."""

        def values(points: Array) -> Tensor:
            return self.jets(points, Placement(planes=1))[VALUE]

        points, parity = samples(mirrors.domain), mirrors.parity(values)
        before = values(points)
        made = replace(self, mirrors=mirrors, averaged=tuple(tuple(planes) for planes in (parity != 1).T.tolist()))
        after = made.jets(points, Placement(planes=1))[VALUE]
        usable = (after.norm(dim=0) > ROUNDING * before.norm(dim=0)).tolist()
        others = independent_columns(after, [k in kept and usable[k] for k in range(len(usable))])
        return replace(made, kept=(0, *others))  # of which no constant is one

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.kept)

    def coarser_mask(self) -> Array:
        """Return (count,): True for features that exist with one detail less: all but new powers about corners."""
        first = np.ones(1 + self.multipliers * len(self.foci), dtype=bool)
        powers = [self.corners.coarser_mask()] if self.corners else []
        cut = [np.ones(self.creases.count, dtype=bool)] if self.creases else []
        cut += [self.hinges.coarser_mask()] if self.hinges else []
        return np.asarray(np.concatenate([first, *powers, *cut])[list(self.kept)])

    def component_mask(self) -> Array:
        """Return (3, count): True if a component of F has a feature."""
        first = np.ones((3, 1 + self.multipliers * len(self.foci)), dtype=bool)
        powers = [self.corners.component_mask()] if self.corners else []
        cut = [np.ones((3, part.count), dtype=bool) for part in (self.creases, self.hinges) if part]
        everything = np.concatenate([first, *powers, *cut], axis=1)
        return np.asarray(everything[:, list(self.kept)])

    def jets(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, count) at points (N, 2)."""
        if not self.kept:
            return placement.tensor(np.zeros((placement.planes, len(points), 0)))
        if self.mirrors is None:
            return self._columns(points, placement, self.kept)

        def some(images: Array, numbers: Sequence[int]) -> Tensor:
            return self._columns(images, placement, [self.kept[k] for k in numbers])

        return self.mirrors.mean(some, points, [self.averaged[k] for k in self.kept])

    def _columns(self, points: Array, placement: Placement, kept: Sequence[int]) -> Tensor:
        """Return the jets (6, N, n) of features with these numbers, without mirrors."""
        columns: dict[int, Tensor] = {}
        start = 0
        for count, made in self._parts(points, placement):
            if any(start <= k < start + count for k in kept):
                columns |= enumerate(made(), start)
            start += count
        return torch.stack([columns[k] for k in kept], dim=-1)

    def _parts(self, points: Array, placement: Placement) -> Iterator[tuple[int, Callable[[], list[Tensor]]]]:
        """Yield numbers of features that belong together, with a function that returns their jets (6, N)."""
        yield 1, lambda: [constant(placement.tensor(np.ones(len(points))), placement.planes)]

        @cache
        def position() -> Tensor:
            return from_derivatives(self.case.surface.derivatives(points, placement.order), placement)

        for focus in self.foci:
            yield self.multipliers, partial(self._focus_jets, focus, position, placement)
        # With planes of symmetry most corners are images of one corner, whose features represent all.
        alone = [replace(self.corners, corners=(c,)) for c in self.corners.corners] if self.corners else []
        powers = alone if self.mirrors else [self.corners]
        for part in (*powers, self.creases, self.hinges):
            if part:
                yield part.count, partial(part.columns, points, placement)

    def _focus_jets(self, focus: Focus, position: Callable[[], Tensor], placement: Placement) -> list[Tensor]:
        """Return the jets (6, N) of r^2 log r^2 about a focus, and of its products with t1, t2, r^2, ..."""
        x = position()
        chord = (x - constant(placement.tensor(focus.position).expand(x.shape[1:]), len(x))) / focus.reach
        first, second = (chord @ placement.tensor(focus.tangents).T).unbind(-1)
        square = dot(chord, chord)
        v = square[VALUE].clamp_min(AT_A_POINT)
        log = torch.log(v)
        bubble = compose((v * log, log + 1, 1 / v), square)
        others = [first, second, square]
        if self.multipliers > 1 + len(others):
            others += [product(first, second), product(first, first)]
        return [bubble, *(product(bubble, other) for other in others[: self.multipliers - 1])]


@dataclass(frozen=True)
class Features:
    """The scalar features of which F is a linear combination: those of the network, fixed ones, and further ones."""

    inputs: Inputs
    network: Network
    fixed: FixedFeatures
    placement: Placement
    beside: Features | None = None

    @property
    def count(self) -> int:
        """Number of features M."""
        return self.network.width + self.fixed.count + (self.beside.count if self.beside else 0)

    def component_mask(self) -> Array:
        """Return (3, M): True if a component of F has a feature."""
        parts = [np.ones((3, self.network.width), dtype=bool), self.fixed.component_mask()]
        return np.concatenate([*parts, *([self.beside.component_mask()] if self.beside else [])], axis=1)

    def pairs(self, part: Integers) -> Array:
        """Return the numbers of the (component, feature) pairs (3 M,) to solve for, of features with these numbers."""
        allowed = self.component_mask()
        return np.concatenate([part[allowed[c, part]] + c * self.count for c in range(3)])

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, M) at points (N, 2)."""
        hidden = self.network.features(self.inputs.jets(points, self.placement))
        others = [self.beside.jets(points)] if self.beside else []
        return torch.cat([hidden, self.fixed.jets(points, self.placement), *others], dim=-1)

    def values(self, points: Array) -> Tensor:
        """Return the values (N, M) at points (N, 2), at a sixth of the cost of the jets."""
        placement = self.placement.of_values
        hidden = self.network.values(self.inputs.jets(points, placement)[VALUE])
        others = [self.beside.values(points)] if self.beside else []
        return torch.cat([hidden, self.fixed.jets(points, placement)[VALUE], *others], dim=-1)


@dataclass(frozen=True)
class Field:
    """A displacement field.

    Attributes
    ----------
    output
        (3, M): the output layer's weights.
    rigid
        (6,): the rigid motion that is subtracted, in the basis of `shellbench.problems.shell.posed.rigid.rigid_modes`.
    """

    ansatz: Ansatz
    features: Features
    output: Tensor
    rigid: Tensor

    def __post_init__(self) -> None:
        # as in `shellbench.solvers.ndf.field.field.Network`; solved weights come column by column
        for name in ("output", "rigid"):
            object.__setattr__(self, name, getattr(self, name).contiguous())

    def displacement(self, points: Array) -> Tensor:
        """Return the displacement (N, 3), metres, at points (N, 2)."""
        placement = self.features.placement
        mirrors = self.ansatz.mirrors
        if mirrors is None:
            free = self.features.values(points) @ self.output.T
        else:
            folded, number = mirrors.fold_onto_part(points)
            free = (self.features.values(folded) @ self.output.T)[number]
        u = (self.ansatz.factors.matrix(points, placement.of_values)[VALUE] @ free[..., None])[..., 0]
        u = u + self.ansatz.lift.jet(points, placement)[VALUE]
        if bool((self.rigid != 0).any()):
            modes = rigid_modes(self.ansatz.case.surface, points)[0, 0]
            u = u - placement.tensor(modes) @ self.rigid
        return u

    def jet(self, points: Array) -> Tensor:
        """Return the jet (6, N, 3) of the displacement at points (N, 2), with the rigid motion (without strain)."""
        placement = self.features.placement
        free = (self.features.jets(points) @ self.output.T)[..., None]
        matrix = self.ansatz.factors.matrix(points, placement)
        return matrix_product(matrix, free)[..., 0] + self.ansatz.lift.jet(points, placement)

    def rigid_part(self, rule: Rule) -> Tensor:
        """Return the rigid motion (6,) left free by the supports that the field has in the mean over the area."""
        case, placement = self.ansatz.case, self.features.placement
        free = self.ansatz.free_motions
        if not free.any():
            return torch.zeros_like(self.rigid)
        area = rule.areas(case.surface)
        modes = rigid_modes(case.surface, rule.points)[0, 0] @ free
        whole = replace(self, rigid=torch.zeros_like(self.rigid))
        displacement = whole.displacement(rule.points).cpu().numpy()
        # Least squares over the area, for the modes without a support.
        gram = np.einsum("p,pik,pil->kl", area, modes, modes)
        moments = np.einsum("p,pik,pi->k", area, modes, displacement)
        return placement.tensor(free @ np.linalg.pinv(gram, rcond=ROUNDING, hermitian=True) @ moments)

    def without_rigid_part(self, rule: Rule) -> Field:
        """Return the field without the rigid motion that it has in the mean over the area."""
        return replace(self, rigid=self.rigid_part(rule))
