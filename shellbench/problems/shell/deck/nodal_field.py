"""Nodal results of another program as a displacement field on the shell, and its quantities.

1. Each node gets the coordinates of the closest point of the midsurface (Gauss and Newton, from the nearest sample).
2. Cells carry the displacement between their nodes. Files without cells are triangulated in the coordinates.
3. A point outside of the mesh is looked up at its images under the planes of symmetry, so that any symmetric part will
   do. A point without an image in the mesh is refused.
4. Rigid motions that the case removes are taken out in the mean over the area.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from shellbench.errors import InputError, without_middle
from shellbench.files import LARGEST_RESULT, read_file
from shellbench.problem import NodalValues
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.cells import MESHIO, Mesh, Shape, shapes_at
from shellbench.problems.shell.deck.solver import OF_DISPLACEMENTS
from shellbench.problems.shell.deck.vtu import read_vtu
from shellbench.problems.shell.mesh.other import LINES, meshio_mesh
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.problems.shell.quantities.quantities import PointQuantity
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.question.surface import Surface
from shellbench.problems.shell.symmetry.symmetry import Part, part_of

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

COLUMNS = ["x", "y", "z", "ux", "uy", "uz"]
OTHER_NAMES = {"u1": "ux", "u2": "uy", "u3": "uz"}
SHAPES = {name: shape for shape, name in MESHIO.items()}
FARTHEST = 1e-3  # of the shell's size: largest distance of its nodes from the midsurface
HALF = "half the thickness: nodes of a solid; print those of the shell, as the .dat has them"
SAMPLES = 201  # points a side of the midsurface from which closest points are looked for
STEPS, NEAR = 30, 1e-13  # of the search, and where it ends, in sides of the domain
ON_BOUND = 1e-5  # of the domain's side: nodes as near to a bound, or a plane of symmetry, lie on it in another program
SAME = 1e-8  # of the domain's side: nodes that are one
OUTSIDE = 1e-2  # of a cell, by which a point may lie outside: digits that a file lacks
OPEN = 0.4  # of a turn: nodes with a wider gap do not go around; a half leaves 0.5, three cells around leave 0.33
SKEW = 0.01  # of the nodes' coordinates, so that no four of them lie on a circle
SLIVER = 0.01  # ratio of the radii of a triangle on the boundary that joins nodes of one line


def measure_nodes(case: Case, path: Path, factor: float) -> NodalValues:
    """Measure the quantities of displacements from a file of nodal results; `factor` makes its lengths the case's.

    Raises
    ------
    InputError
        In one sentence with the file: it can't be read, has a number that is not finite, is not of this shell, or does
        not reach a point of a quantity.
    """
    if not case.linear or case.dynamics is not None or len(case.states) != 1:
        raise InputError(f"{path}: case '{case.name}' asks for more than one state: fill in answers.csv instead")
    asked = [quantity for quantity in case.quantities if isinstance(quantity, OF_DISPLACEMENTS)]
    if not asked:
        raise InputError(f"{path}: case '{case.name}' asks for no displacement: fill in answers.csv instead")
    try:
        positions, moved, cells = read_nodes(path)
        found: Any = NodalField.on(case, factor * positions, factor * moved, cells)
        values = {quantity.name: quantity.measure(found) * quantity.factor for quantity in asked}
        points = {q.name: q.coordinates(found) for q in asked if isinstance(q, PointQuantity)}
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    nearest = {name: float(found.distance_of_nodes(at).max()) for name, at in points.items()}
    return NodalValues(values, nearest, sum(len(mesh.cells) for mesh, _ in found.blocks), found.share)


Cells = list[tuple[Shape, Integers]]


def read_nodes(path: Path) -> tuple[Array, Array, Cells]:
    """Return positions (n, 3), displacements (n, 3), and cells by shape; none of a CSV file."""
    content = read_file(path, LARGEST_RESULT)
    if path.suffix in (".vtu", ".dat"):
        if path.suffix == ".vtu":
            mesh, moved = read_vtu(content)
        else:
            beside = path.with_suffix(".vtu")
            if not beside.is_file():
                raise InputError(f"it has numbers of nodes only: put the sheet's {beside.name} beside it")
            mesh = meshio_mesh(read_file(beside, LARGEST_RESULT), ".vtu")
            moved = _last_displacements(content, len(mesh.points))
        blocks = [block for block in mesh.cells if block.type not in LINES]
        for block in blocks:
            if block.type not in SHAPES:
                raise InputError(f"it has cells of kind '{block.type}', but a shell has {', '.join(SHAPES)}")
        cells = [(SHAPES[block.type], np.asarray(block.data, np.int64)) for block in blocks]
        if not cells:
            raise InputError("it has no cells")
        data = np.hstack([np.asarray(mesh.points, float), moved])
        first = 1
    else:
        try:
            table = pd.read_csv(io.BytesIO(content), dtype=str, skipinitialspace=True)
        except (ValueError, pd.errors.ParserError) as error:
            raise InputError(f"it is no CSV ({without_middle(' '.join(str(error).split()))})") from None
        table.columns = [OTHER_NAMES.get(name, name) for name in map(str.lower, map(str.strip, table.columns))]
        if lacking := [name for name in COLUMNS if name not in table]:
            raise InputError(f"line 1, field '{lacking[0]}': not found; the columns are {', '.join(COLUMNS)}")
        data, cells, first = table[COLUMNS].apply(pd.to_numeric, errors="coerce").to_numpy(float), [], 2
    bad = np.argwhere(~np.isfinite(data))
    if len(bad):
        where = f"{'line' if first == 2 else 'node'} {bad[0, 0] + first}"
        raise InputError(f"{where}, field '{COLUMNS[bad[0, 1]]}': found no finite number")
    if len(data) < 3:
        raise InputError(f"it has {len(data)} nodes, and a mesh has at least 3")
    return data[:, :3], data[:, 3:], cells


def _last_displacements(content: bytes, count: int) -> Array:
    """Return the displacements (count, 3) of the last state in a .dat of CalculiX (`*NODE PRINT`, `U`)."""
    moved = np.full((count, 3), np.nan)
    for line in content.decode(errors="replace").rpartition("displacements")[2].splitlines()[1:]:
        numbers = line.split()
        if len(numbers) == 4 and numbers[0].isdigit() and 1 <= int(numbers[0]) <= count:
            moved[int(numbers[0]) - 1] = pd.to_numeric(pd.Series(numbers[1:]), errors="coerce")
        elif numbers:
            break
    return moved


def coordinates_on(surface: Surface, positions: Array) -> tuple[Array, Array]:
    """Return coordinates (n, 2) of the closest points of a surface to positions (n, 3), and the distances (n,), m."""
    from scipy.spatial import cKDTree

    domain = surface.domain
    samples = domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
    xi = samples[cKDTree(surface.position(samples)).query(positions)[1]]
    for _ in range(STEPS):
        x = surface.derivatives(xi, 1)
        tangents = np.stack([x[1, 0], x[0, 1]], axis=-2)
        metric, gap = tangents @ tangents.swapaxes(-1, -2), (tangents @ (positions - x[0, 0])[..., None])
        there = xi + np.linalg.solve(metric, gap)[..., 0]
        there = np.where(domain.periodic, domain.wrap(there), np.clip(there, domain.lower, domain.upper))
        step, xi = np.abs((there - xi) / domain.size), there
        if np.minimum(step, np.where(domain.periodic, 1 - step, step)).max() < NEAR:
            break
    return xi, np.asarray(np.linalg.norm(surface.position(xi) - positions, axis=-1))


@dataclass(frozen=True)
class NodalField:
    """Displacements of nodes, and between them those of cells.

    Attributes
    ----------
    part
        The part of the case that its planes of symmetry leave.
    blocks
        Meshes of one shape each, with the displacements of their nodes (m, 3), in the case's unit of length.
    nodes
        (n, 3) positions of all nodes.
    rigid
        Factors of the rigid motions that are taken out.
    """

    part: Part
    blocks: Sequence[tuple[Mesh, Array]]
    nodes: Array
    rigid: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def on(cls, case: Case, positions: Array, moved: Array, cells: Cells) -> NodalField:
        """Make the field of displacements (n, 3) of nodes (n, 3); without cells the nodes are triangulated.

        Raises
        ------
        InputError
            As a clause, if the nodes do not lie on the shell.
        """
        used = np.unique(np.concatenate([own.ravel() for _, own in cells])) if cells else np.arange(len(positions))
        if used[0] < 0 or used[-1] >= len(positions):
            raise InputError("a cell names a node that is not there")
        xi, part = np.zeros((len(positions), 2)), part_of(case)
        xi[used], distance = coordinates_on(case.surface, positions[used])
        corners = case.surface.position(case.surface.domain.grid(9, 9)).reshape(-1, 3)
        size, farthest = float(np.linalg.norm(np.ptp(corners, axis=0))), int(np.argmax(distance))
        if distance[farthest] > FARTHEST * size:
            half = np.isclose(distance[farthest], getattr(case.material, "thickness", 0.0) / 2, rtol=0.01)
            raise InputError(
                f"it is not the shell of case '{case.name}': node {used[farthest] + 1} is {distance[farthest]:.3g} from"
                f" the midsurface, and at most {FARTHEST:g} of the shell's size {size:.3g} is allowed"
                f" ({HALF if half else 'other --units?'})"
            )
        # Other programs round: nodes beside a bound are put on it, or points on it would lie outside of the mesh.
        domain = case.surface.domain
        for line in (domain.lower, domain.upper, part.lower, part.upper):
            xi = np.where(np.abs(xi - line) <= ON_BOUND * np.asarray(domain.size), line, xi)
        blocks = [_one_shape(part, xi, shape, own) for shape, own in cells or [_triangulated(part, xi)]]
        found = cls(part, [(mesh, moved[numbers]) for mesh, numbers in blocks], positions[used])
        if not case.remove_rigid_motions:
            return found
        points, weights = case.area_rule
        motions = found._motions(points)
        weighted = motions * weights[:, None, None]
        left = np.einsum("nca,ncb->ab", weighted, motions)
        return replace(found, rigid=np.linalg.solve(left, np.einsum("nca,nc->a", weighted, found.displacement(points))))

    @property
    def case(self) -> Case:
        """The case that it answers."""
        return self.part.whole

    @property
    def share(self) -> float:
        """Share of the coordinates' rectangle that the mesh covers."""
        ends = np.concatenate([mesh.xi for mesh, _ in self.blocks])
        return float(np.prod(np.minimum(np.ptp(ends, axis=0) / self.case.surface.domain.size, 1.0)))

    def _images(self, points: Array) -> Iterator[tuple[Array, Array]]:
        """Yield points (n, 2), then their images, with the factors (n, 3) from a displacement there to theirs."""
        domain, folded = self.case.surface.domain, self.part.fold(points)
        turns = [(0.0, size, -size) if domain.periodic[axis] else (0.0,) for axis, size in enumerate(domain.size)]
        for mirrors in [None, *self.part.images()]:
            at, signs = (points, np.ones((len(points), 3))) if mirrors is None else (folded.points, folded.signs)
            for mirror in mirrors or ():
                at, signs = mirror.image(at), signs * mirror.signs
            for turn in product(*turns):
                yield at + np.array(turn), signs

    def _motions(self, points: Array) -> Array:
        """Return the rigid motions (n, 3, k) that the case removes."""
        numbers = [RIGID_MOTIONS.index(name) for name in self.case.remove_rigid_motions]
        return rigid_modes(self.case.surface, points)[0, 0][..., numbers]

    def displacement(self, points: Array, at: float | None = None) -> Array:
        """Return the displacement (..., 3) at points (..., 2); InputError, as a clause, if the mesh lacks one."""
        xi = np.asarray(points, float).reshape(-1, 2)
        found = np.full((len(xi), 3), np.nan)
        # A point that no image has inside may lie beside a boundary that the file's digits moved.
        for beside, (images, signs) in product((SAME, OUTSIDE), list(self._images(xi))):
            for mesh, moved in self.blocks:
                low, high = mesh.xi.min(axis=0), mesh.xi.max(axis=0)
                slack = beside * (high - low) / np.sqrt(len(mesh.cells))
                near = np.all((images >= low - slack) & (images <= high + slack), axis=-1)
                asked = np.flatnonzero(near & np.isnan(found[:, 0]))
                cell, places, beyond = mesh.locate(images[asked])
                shares = np.where(beyond[:, None] <= beside, shapes_at(mesh.shape, places)[0], np.nan)
                found[asked] = signs[asked] * np.einsum("nk,nkc->nc", shares, moved[mesh.cells[cell]])
        if np.isnan(found).any():
            lost = int(np.argmax(np.isnan(found[:, 0])))
            named = [place for place in self.case.places.values() if isinstance(place, Point)]
            names = [place.name for place in named if np.allclose(place.xi, xi[lost])]
            x = ", ".join(f"{c:.6g}" for c in self.case.surface.position(xi[lost]))
            raise InputError(f"{f'point {names[0]!r}' if names else 'the point'} at ({x}) lies outside of the mesh")
        if len(self.rigid):
            found -= self._motions(xi) @ self.rigid
        return found.reshape((*np.shape(points)[:-1], 3))

    def distance_of_nodes(self, points: Array) -> Array:
        """Return the distance (n,) of the nearest node from each point (n, 2), or from an image of it."""
        from scipy.spatial import cKDTree

        surface, tree = self.case.surface, cKDTree(self.nodes)
        images = [surface.domain.wrap(at) for at, _ in self._images(points)]
        return np.asarray(np.min([tree.query(surface.position(at))[0] for at in images], axis=0))


def _one_shape(part: Part, xi: Array, shape: Shape, cells: Integers) -> tuple[Mesh, Integers]:
    """Return a mesh, and the number of each of its nodes: nodes at one place are one, a seam has its nodes twice."""
    domain = part.whole.surface.domain
    size = np.asarray(domain.size)
    corners = xi[cells]
    turns = np.round((corners - corners[:, :1]) / size) * domain.periodic  # a cell over the seam goes on beyond it
    corners = (corners - turns * size).reshape(-1, 2)
    keys = np.rint((corners - domain.lower) / (SAME * size)).astype(np.int64)
    _, first, inverse = np.unique(keys[:, 0] * (1 << 31) + keys[:, 1], return_index=True, return_inverse=True)
    return Mesh(corners[first], inverse.reshape(cells.shape), shape), cells.ravel()[first]


def _triangulated(part: Part, xi: Array) -> tuple[Shape, Integers]:
    """Return triangles (e, 3) between nodes, by Delaunay in the coordinates, scaled to lengths on the surface."""
    from matplotlib.tri import TriAnalyzer, Triangulation

    # Around a closed coordinate the nodes of both ends are repeated beyond the other end, and each triangle is kept
    # once, where its middle is in the domain. The skew splits squares alike at both ends.
    domain, numbers, closed = part.whole.surface.domain, np.arange(len(xi)), []
    for axis in (axis for axis in (0, 1) if domain.periodic[axis]):
        turn, around = domain.size[axis], np.unique(xi[:, axis])
        gaps, along = np.diff(around, append=around[0] + turn), np.arange(2) == axis
        if gaps.max() > OPEN * turn:
            start = around[(int(np.argmax(gaps)) + 1) % len(around)]
            xi = np.where(along, start + np.mod(xi - start, turn), xi)
        else:
            closed.append(axis)
            xi = np.where(along, domain.wrap(xi), xi)
            offset = xi[:, axis] - domain.lower[axis]
            ends = [(offset < turn / 4, turn), (offset > 3 * turn / 4, -turn)]
            numbers = np.concatenate([numbers, *(numbers[mask] for mask, _ in ends)])
            xi = np.concatenate([xi, *(xi[mask] + by * along for mask, by in ends)])
    tangents = part.whole.surface.derivatives(domain.grid(9, 9).reshape(-1, 2), 1)
    first, second = (xi * [float(np.linalg.norm(tangents[key], axis=-1).mean()) for key in ((1, 0), (0, 1))]).T
    try:
        mesh = Triangulation(first + SKEW * second, second)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"its nodes can't be triangulated ({error})") from None
    flat = TriAnalyzer(mesh).get_flat_tri_mask(SLIVER, rescale=False)
    middle = xi[mesh.triangles].mean(axis=1)
    once = [(middle[:, a] >= domain.lower[a]) & (middle[:, a] < domain.upper[a]) for a in closed]
    return "tri3", np.asarray(numbers[mesh.triangles[np.all([~flat, *once], axis=0)]])
