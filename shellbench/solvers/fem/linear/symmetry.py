"""A symmetric linear case solved on a part of its mesh, and the answer unfolded to the whole mesh.

The module `shellbench.problems.shell.symmetry.symmetry` defines the reflections of a case and its part as a case of its
own. This module adds the conditions of the mesh. Its lines have to be symmetric too. The case is compared with its
image at all points of the whole mesh, at every Gauss point and the nodes of edges, to rounding. The integrals of the
whole mesh are then symmetric, and the part of the mesh has the solution of the whole mesh. A whole mesh that may turn
freely is pinned at a few nodes. Its solution differs from that of the part by the element's error of a rigid rotation,
which vanishes with the mesh size faster than the other errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.mirrors import ComparisonPoints, Ends, Mirror, mirror_of, mirrored_supports
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.surface import Domain
from shellbench.problems.shell.symmetry.mirror_frame import in_frame_of_mirrors
from shellbench.problems.shell.symmetry.symmetry import Part
from shellbench.solvers.fem.linear.equilibrium import Equilibrium
from shellbench.solvers.fem.mechanics import bubble_conditions
from shellbench.solvers.fem.mechanics.loads import EDGE_GAUSS_POINTS
from shellbench.solvers.fem.mechanics.sharing import support_nodes
from shellbench.solvers.fem.mesh.basis import gauss_rule
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

HALF, QUARTER = 2, 4  # images of the part along a coordinate; quarters of a closed one only
# Relative difference to the mirror image that counts as rounding. Formulas have 1e-15 to 3e-15. Points, and mesh lines
# through them, have the digits of the case file: the last of 12 digits is worth up to 1e-11, twice that across a
# mirror.
SYMMETRIC = 3e-11


@dataclass(frozen=True)
class Image:
    """The part, or one of its mirror images, along a coordinate.

    Attributes
    ----------
    nodes, begins
        (n + 1,) number along the coordinate of each line of nodes of the part; (n,) of the first line of its cells.
    signs
        (3,) of the components of the displacement.
    parity
        -1 if the coordinate is reversed, else 1.
    supports
        For each support the number of its image.
    """

    nodes: Integers
    begins: Integers
    signs: Array
    parity: int
    supports: tuple[int, ...]


@dataclass(frozen=True)
class Fold:
    """Part of a mesh along a coordinate, and the mirrors at its ends.

    Attributes
    ----------
    start, cells
        First mesh line of the part, and its number of cells.
    mirrors
        Mirrors of the part at its first and at its last line; None without a mirror.
    """

    start: int
    cells: int
    mirrors: Ends = (None, None)

    @property
    def folded(self) -> bool:
        """True if there are mirror images."""
        return self.mirrors != (None, None)

    def lines(self, line: Array, domain: Domain, axis: int) -> Array:
        """Return the part of the mesh lines, brought into the domain."""
        if not self.folded:
            return line
        twice = np.concatenate([line, line[1:] + domain.size[axis]])  # it may end in the next period
        part = twice[self.start : self.start + self.cells + 1]
        turns = np.round((part.mean() - (domain.lower[axis] + domain.upper[axis]) / 2) / domain.size[axis])
        return np.asarray(part - turns * domain.size[axis] if domain.periodic[axis] else part)

    def images(self, nodes: int, case: Case) -> tuple[Image, ...]:
        """Return the part and its mirror images in order, on a mesh of the case with so many nodes along here."""
        run = np.arange(self.cells + 1) if self.folded else np.arange(nodes)
        own = tuple(range(len(case.supports)))
        at = (self.start + run) % nodes
        found = [Image(at, at[: self.cells], np.ones(len(COMPONENTS)), 1, own)]
        first, last = self.mirrors
        around = (last, first, last) if first is not None and first is not last else (last,)
        for number, mirror in enumerate(around, start=1):
            if mirror is not None:
                before = found[-1]
                at = (number + 1) * self.cells - run if number % 2 else number * self.cells + run
                at = (self.start + at) % nodes
                swap = mirrored_supports(case, mirror)
                assert swap is not None  # it would be no mirror of the mesh
                swapped = tuple(swap[s] for s in before.supports)
                begins = at[1:] if before.parity > 0 else at[:-1]  # a reversed cell begins where it ended
                found.append(Image(at, begins, before.signs * mirror.signs, -before.parity, swapped))
        return tuple(found)


@dataclass(frozen=True)
class FoldedMesh:
    """A case and its mesh, folded onto a part of which the rest is a mirror image.

    Attributes
    ----------
    part
        The part of the case.
    whole_mesh, mesh
        The mesh of the whole, and its part.
    folds
        By coordinate.
    """

    part: Part
    whole_mesh: TensorMesh
    mesh: TensorMesh
    folds: tuple[Fold, Fold]

    @classmethod
    def from_case(cls, case: Case, mesh: TensorMesh, quadrature_order: int) -> FoldedMesh | None:
        """Find the symmetries of a case on a mesh; None if there is none, or if its loads can't be checked."""
        if (
            not case.linear
            or case.springs
            or case.obstacles
            or any(isinstance(load, MomentLoad) for load in case.loads)
        ):
            return None
        observed = _CaseOnMesh(case, mesh, quadrature_order)
        folds = observed.fold(0), observed.fold(1)
        if not (folds[0].folded or folds[1].folded):
            return None
        first, second = (fold.lines(mesh.lines[axis], mesh.domain, axis) for axis, fold in enumerate(folds))
        bounds = [
            (float(line[0]), float(line[-1])) if fold.folded else (mesh.domain.lower[axis], mesh.domain.upper[axis])
            for axis, (fold, line) in enumerate(zip(folds, (first, second), strict=True))
        ]
        (low1, high1), (low2, high2) = bounds
        part = Part(case, (low1, low2), (high1, high2), (folds[0].mirrors, folds[1].mirrors))
        return cls(part, mesh, TensorMesh(part.case.surface.domain, (first, second), mesh.degree), folds)

    @cached_property
    def images(self) -> tuple[tuple[Image, ...], tuple[Image, ...]]:
        """The images of the part along each coordinate."""
        counts, case = self.whole_mesh.shape, self.part.whole
        return self.folds[0].images(counts[0], case), self.folds[1].images(counts[1], case)

    @property
    def supports(self) -> list[int]:
        """Numbers, in the whole, of the part's supports that are no planes of symmetry."""
        names, own = [support.name for support in self.part.whole.supports], self.part.case.supports
        return [names.index(support.name) for support in own[: len(own) - len(self.part.planes)]]

    def unfold(self, found: Equilibrium) -> Equilibrium:
        """Return the answer on the whole mesh from that on the part."""
        solution, case, mesh = found.solution, self.part.whole, self.whole_mesh
        tail, numbers = solution.coefficients.shape[1:], self.supports
        forces = np.zeros((len(numbers), self.mesh.node_count, *tail))
        forces[:, solution.support_nodes] = solution.support_forces[: len(numbers)]
        forces = forces.reshape(len(numbers), *self.mesh.shape, *tail)
        field = solution.coefficients.reshape(*self.mesh.shape, *tail)
        whole = np.zeros((*mesh.shape, *tail))
        whole_forces = np.zeros((len(case.supports), *mesh.shape, *tail))
        for first, second in product(*self.images):
            for kind, (k, m) in enumerate(mesh.kinds):
                signs = (first.signs * second.signs * first.parity**k * second.parity**m)[:, None]
                rows, columns = (i.begins if b > 1 else i.nodes for i, b in ((first, k), (second, m)))
                at, own = np.ix_(rows, columns), (slice(len(rows)), slice(len(columns)))
                whole[..., kind, :][at] = signs * field[own][..., kind, :]
                for number, force in zip(numbers, forces, strict=True):
                    image = second.supports[first.supports[number]]
                    # on a line of symmetry the images' shares add up
                    whole_forces[image][..., kind, :][at] += signs * force[own][..., kind, :]
        held = [support_nodes(mesh, place) for _, place in case.supported_places()]
        nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *held]))
        # energies are integrated from the first mesh line on; if the part does not begin there, over the whole
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
        count = images[0] * images[1]
        energies: dict[str, Any] = {"potential_energy": found.potential_energy * count, "noise": found.noise * count}
        return replace(found, solution=answer, **energies)


class _CaseOnMesh:
    """A case evaluated as on the whole mesh: at its Gauss points, and at the nodes and Gauss points of its edges."""

    def __init__(self, case: Case, mesh: TensorMesh, quadrature_order: int) -> None:
        self.case, self.mesh, self.domain = case, mesh, mesh.domain
        self.gauss = quadrature_order // 2 + 1  # points of a cell along a coordinate
        self.runs = [_gauss_points(line, self.gauss) for line in mesh.lines]
        edges = [
            np.concatenate(
                [line, _gauss_points(line, EDGE_GAUSS_POINTS), _gauss_points(line, bubble_conditions.GAUSS_POINTS)]
            )
            for line in mesh.lines
        ]
        self.along = edges[0], edges[1]

    def fold(self, axis: int) -> Fold:
        """Return the fold of the mesh along a coordinate, and restrict the points of later checks to its part."""
        mesh, domain = self.mesh, self.domain
        cells, slack = mesh.cells[axis], SYMMETRIC * domain.size[axis]
        for fold in self._closed_folds(axis) if domain.periodic[axis] else self._open_folds(axis):
            self.runs[axis] = self._points(axis, fold.start, fold.cells)
            lines = fold.lines(mesh.lines[axis], domain, axis)
            # formulas of a closed surface and its loads may hold inside the domain only
            if lines[0] >= domain.lower[axis] - slack and lines[-1] <= domain.upper[axis] + slack:
                return fold
        return Fold(0, cells)

    def _open_folds(self, axis: int) -> Iterator[Fold]:
        """Yield the half with a mirror in the middle."""
        half, odd = divmod(self.mesh.cells[axis], HALF)
        mirror = None if odd else self._mirror_at_line(axis, half, half)
        if mirror is not None:
            yield Fold(0, half, (None, mirror))

    def _closed_folds(self, axis: int) -> Iterator[Fold]:
        """Yield the parts with mirrors at a mesh line and a quarter of the turn from it."""
        cells = self.mesh.cells[axis]
        half, quarter = cells // HALF, cells // QUARTER
        if cells % HALF:
            return
        # Candidates are the first line, the line a quarter of the turn from it, and one other about which the mesh is
        # its own image. A mesh that is divided at points has no more, and in another mesh the check of every line would
        # be in vain.
        even = (line for line in range(1, half) if line != quarter and self._lines_are_symmetric(axis, line))
        found = (
            (line, self._mirror_at_line(axis, line, half))
            for line in (0, *([quarter] if cells % QUARTER == 0 else []), *islice(even, 1))
        )
        start, first = next(((line, mirror) for line, mirror in found if mirror is not None), (0, None))
        if first is None:
            return
        square = cells % QUARTER == 0 and start != quarter  # half a turn from the first line was checked already
        second = self._mirror_at_line(axis, start + quarter, quarter) if square else None
        mirrors = [mirror for mirror in (first, second) if mirror is not None]
        size = cells // (HALF * len(mirrors))
        for number in range(HALF * len(mirrors)):
            ends = mirrors[number % len(mirrors)], mirrors[(number + 1) % len(mirrors)]
            yield Fold((start + number * size) % cells, size, ends)

    def _lines_are_symmetric(self, axis: int, line: int) -> bool:
        """Return True if the mesh's own lines are their mirror images about one of them."""
        steps = np.diff(self.mesh.lines[axis])
        opposite = (2 * line - 1 - np.arange(len(steps))) % len(steps)
        return bool(np.abs(steps - steps[opposite]).max() <= SYMMETRIC * self.domain.size[axis])

    def _mirror_at_line(self, axis: int, line: int, cells: int) -> Mirror | None:
        """Return the reflection about a mesh line if it is a symmetry; so many cells on either side are compared."""
        if not self._lines_are_symmetric(axis, line):
            return None
        runs = [self._points(axis, line, cells), self.runs[1 - axis]]
        first, second = runs if axis == 0 else runs[::-1]
        points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
        sight = ComparisonPoints(points, self.along, order=2, rounding=SYMMETRIC).with_narrow_cells(self.case)
        mirror = mirror_of(self.case, axis, float(self.mesh.lines[axis][line]), sight)
        return mirror if mirror is not None and mirrored_supports(self.case, mirror) is not None else None

    def _points(self, axis: int, start: int, cells: int) -> Array:
        """Return the Gauss points of a number of cells from `start` on, also beyond the seam."""
        every = _gauss_points(self.mesh.lines[axis], self.gauss)
        return every[(start * self.gauss + np.arange(cells * self.gauss)) % len(every)]


def _gauss_points(line: Array, count: int) -> Array:
    x, _ = gauss_rule(count)
    return np.asarray((line[:-1, None] + np.diff(line)[:, None] * (x + 1) / 2).ravel())


@dataclass(frozen=True)
class Folding:
    """Folding of a case onto a part of it by its symmetries.

    Attributes
    ----------
    case
        The case.
    """

    case: Case

    @cached_property
    def _case_in_mirror_frame(self) -> tuple[Case, NDArray[np.float64]] | None:
        return in_frame_of_mirrors(self.case)

    def fold(self, mesh: TensorMesh, quadrature_order: int) -> FoldedMesh | None:
        """Return the case folded on a mesh, in the frame in which its part is smaller; None if it can't be folded."""
        cases = (self.case,) if self._case_in_mirror_frame is None else (self.case, self._case_in_mirror_frame[0])
        found = [folded for case in cases if (folded := FoldedMesh.from_case(case, mesh, quadrature_order))]
        return min(found, key=lambda folded: folded.mesh.dof_count, default=None)

    def unfold(self, folded: FoldedMesh, found: Equilibrium) -> Equilibrium:
        """Return the answer to the case in its own frame from that on its folded part."""
        whole = folded.unfold(found)
        if folded.part.whole is self.case or self._case_in_mirror_frame is None:
            return whole
        solution, back = whole.solution, self._case_in_mirror_frame[1].T
        answer = replace(
            solution,
            case=self.case,
            coefficients=np.einsum("cd,ndks->ncks", back, solution.coefficients),
            support_forces=np.einsum("cd,mndks->mncks", back, solution.support_forces),
        )
        return replace(whole, solution=answer)
