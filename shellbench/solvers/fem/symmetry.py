"""Mirror symmetry of a linear case: solve on the part that the rest of the shell mirrors, and unfold the answer.

A linear problem has one solution, but for the rigid motions that are taken from it, so that the solution of a
symmetric case (see `reflections`) is its own mirror image, u(xi') = R u(xi). The lines of symmetry of the part are
edges in planes of symmetry (see `constraints`); the part of the mesh has the solution of the whole mesh, and the answer
is unfolded onto it. A whole mesh that may turn freely is pinned at a few nodes, and differs from the part by as much as
the element misses a rigid rotation, which vanishes with the mesh size long before its errors do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import COMPONENTS, MomentLoad
from shellbench.problems.shell.surface import Domain
from shellbench.solvers.fem.constraints import support_nodes
from shellbench.solvers.fem.equilibrium import Equilibrium
from shellbench.solvers.fem.hermite import KINDS
from shellbench.solvers.fem.mesh import TensorMesh
from shellbench.solvers.fem.part import part_case
from shellbench.solvers.fem.reflections import SYMMETRIC, Mirror, Observed

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

HALF, QUARTER = 2, 4  # images of the part along a coordinate; quarters of a closed one only


@dataclass(frozen=True)
class Image:
    """The part, or one of its mirror images, along a coordinate.

    Attributes
    ----------
    nodes
        (n + 1,) number along the coordinate of each line of nodes of the part.
    signs
        (3,) of the components of the displacement.
    parity
        -1 if the coordinate is reversed, else 1.
    supports
        For each support the number of its image.
    """

    nodes: Integers
    signs: Array
    parity: int
    supports: tuple[int, ...]


@dataclass(frozen=True)
class Fold:
    """How a mesh is mirrored along a coordinate.

    Attributes
    ----------
    start, cells
        First mesh line of the part, and its number of cells.
    mirrors
        What mirrors the part at its first and at its last line; None where nothing does.
    """

    start: int
    cells: int
    mirrors: tuple[Mirror | None, Mirror | None] = (None, None)

    @property
    def folded(self) -> bool:
        """Whether there are mirror images."""
        return self.mirrors != (None, None)

    def lines(self, line: Array, domain: Domain, axis: int) -> Array:
        """Return the part of the mesh lines, brought into the domain."""
        if not self.folded:
            return line
        twice = np.concatenate([line, line[1:] + domain.size[axis]])  # it may end in the next period
        part = twice[self.start : self.start + self.cells + 1]
        turns = np.round((part.mean() - (domain.lower[axis] + domain.upper[axis]) / 2) / domain.size[axis])
        return np.asarray(part - turns * domain.size[axis] if domain.periodic[axis] else part)

    def images(self, nodes: int, supports: int) -> tuple[Image, ...]:
        """Return the part and its mirror images in order, on a mesh with so many nodes along the coordinate."""
        run = np.arange(self.cells + 1) if self.folded else np.arange(nodes)
        found = [Image((self.start + run) % nodes, np.ones(len(COMPONENTS)), 1, tuple(range(supports)))]
        first, last = self.mirrors
        around = (last, first, last) if first is not None and first is not last else (last,)
        for number, mirror in enumerate(around, start=1):
            if mirror is not None:
                before = found[-1]
                at = (number + 1) * self.cells - run if number % 2 else number * self.cells + run
                swapped = tuple(mirror.supports[s] for s in before.supports)
                found.append(Image((self.start + at) % nodes, before.signs * mirror.signs, -before.parity, swapped))
        return tuple(found)


@dataclass(frozen=True)
class Part:
    """The part of a case and its mesh that the rest mirrors.

    Attributes
    ----------
    whole, whole_mesh
        What it is a part of.
    folds
        By coordinate.
    case, mesh
        The part: a case of its own, with planes of symmetry after its supports.
    """

    whole: Case
    whole_mesh: TensorMesh
    folds: tuple[Fold, Fold]
    case: Case
    mesh: TensorMesh

    @classmethod
    def of(cls, case: Case, mesh: TensorMesh, quadrature_order: int) -> Part | None:
        """Find the symmetries of a case on a mesh; None if there is none, or what loads it is not looked at."""
        if not case.linear or case.springs or any(isinstance(load, MomentLoad) for load in case.loads):
            return None
        observed = Observed(case, mesh, quadrature_order)
        folds = _fold(observed, 0), _fold(observed, 1)
        if not (folds[0].folded or folds[1].folded):
            return None
        first, second = (fold.lines(mesh.lines[axis], mesh.domain, axis) for axis, fold in enumerate(folds))
        part = part_case(case, (folds[0].mirrors, folds[1].mirrors), (first, second))
        return cls(case, mesh, folds, part, TensorMesh(part.surface.domain, (first, second)))

    @cached_property
    def images(self) -> tuple[tuple[Image, ...], tuple[Image, ...]]:
        """The images of the part along each coordinate."""
        counts, supports = self.whole_mesh.shape, len(self.whole.supports)
        return self.folds[0].images(counts[0], supports), self.folds[1].images(counts[1], supports)

    @property
    def supports(self) -> list[int]:
        """Numbers, in the whole, of the part's supports that are no planes of symmetry."""
        planes = sum(mirror is not None for fold in self.folds for mirror in fold.mirrors)
        names = [support.name for support in self.whole.supports]
        return [names.index(support.name) for support in self.case.supports[: len(self.case.supports) - planes]]

    def unfolded(self, found: Equilibrium) -> Equilibrium:
        """Return the answer on the whole mesh, of that on the part."""
        solution, case, mesh = found.solution, self.whole, self.whole_mesh
        tail, numbers = solution.coefficients.shape[1:], self.supports
        forces = np.zeros((len(numbers), self.mesh.node_count, *tail))
        forces[:, solution.support_nodes] = solution.support_forces[: len(numbers)]
        forces = forces.reshape(len(numbers), *self.mesh.shape, *tail)
        field = solution.coefficients.reshape(*self.mesh.shape, *tail)
        whole = np.empty((*mesh.shape, *tail))
        whole_forces = np.zeros((len(case.supports), *mesh.shape, *tail))
        for first, second in product(*self.images):
            kinds = [float(first.parity**k * second.parity**m) for k, m in KINDS]
            signs = np.multiply.outer(first.signs * second.signs, kinds)[..., None]
            at = np.ix_(first.nodes, second.nodes)
            whole[at] = signs * field
            for number, force in zip(numbers, forces, strict=True):
                image = second.supports[first.supports[number]]
                whole_forces[image][at] += signs * force  # on a line of symmetry the images' shares add up
        held = [support_nodes(mesh, place) for _, place in case.supported_places()]
        nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *held]))
        # energies are integrated from the first mesh line on: where the part does not begin there, over the whole
        begun = tuple(fold.start % fold.cells == 0 for fold in self.folds)
        images = (len(self.images[0]), len(self.images[1]))
        answer = replace(
            solution,
            case=case,
            mesh=mesh,
            coefficients=whole.reshape(mesh.node_count, *tail),
            support_nodes=nodes,
            support_forces=whole_forces.reshape(len(case.supports), mesh.node_count, *tail)[:, nodes],
            images=(images[0] if begun[0] else 1, images[1] if begun[1] else 1),
        )
        return replace(found, solution=answer, potential_energy=found.potential_energy * images[0] * images[1])


def _fold(observed: Observed, axis: int) -> Fold:
    """Return how the mesh is mirrored along a coordinate."""
    mesh, domain = observed.mesh, observed.domain
    cells, slack = mesh.cells[axis], SYMMETRIC * domain.size[axis]
    for fold in _closed_folds(observed, axis) if domain.periodic[axis] else _open_folds(observed, axis):
        observed.keep(axis, fold.start, fold.cells)
        lines = fold.lines(mesh.lines[axis], domain, axis)
        # formulas of a closed surface and its loads may hold inside the domain only
        if lines[0] >= domain.lower[axis] - slack and lines[-1] <= domain.upper[axis] + slack:
            return fold
    return Fold(0, cells)


def _open_folds(observed: Observed, axis: int) -> Iterator[Fold]:
    """Yield the half that a mirror in the middle makes."""
    half, odd = divmod(observed.mesh.cells[axis], HALF)
    mirror = None if odd else observed.mirror(axis, half, half)
    if mirror is not None:
        yield Fold(0, half, (None, mirror))


def _closed_folds(observed: Observed, axis: int) -> Iterator[Fold]:
    """Yield the parts that mirrors about the first mesh line and a quarter of the turn from it make."""
    cells = observed.mesh.cells[axis]
    half, quarter = cells // HALF, cells // QUARTER
    first = None if cells % HALF else observed.mirror(axis, 0, half)
    second = None if cells % QUARTER else observed.mirror(axis, quarter, quarter if first else half)
    mirrors = [mirror for mirror in (first, second) if mirror is not None]
    size, start = cells // (HALF * max(len(mirrors), 1)), 0 if first else quarter
    for number in range(HALF * len(mirrors)):
        ends = mirrors[number % len(mirrors)], mirrors[(number + 1) % len(mirrors)]
        yield Fold((start + number * size) % cells, size, ends)
