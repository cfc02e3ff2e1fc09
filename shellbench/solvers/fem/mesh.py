"""Tensor-product meshes of the parametric rectangle, closed by renumbering nodes.

The cells are those of scikit-fem's `MeshQuad.init_tensor`; its vertices on a seam of a periodic surface are given
one node number, because a periodic mesh of scikit-fem does not take C1 elements.

Bicubic Hermite (Bogner-Fox-Schmit) basis, tabulated once on the unit cell.

A node carries u, u,1, u,2 and u,12 of each Cartesian component, the derivatives with respect to the curvilinear
coordinates themselves. On a cell of size (h1, h2) the basis function that belongs to the derivative (k, l) is
h1**k h2**l times its counterpart on the unit cell, so nothing is ever inverted; scikit-fem's `ElementQuadBFS`
inverts a Vandermonde matrix in global coordinates instead, whose condition grows to 3.5e14 on 64 x 64 cells.

Bogner, Fox & Schmit (1965), The generation of interelement-compatible stiffness and mass matrices.

Degree 4 and 5 add bubbles along each coordinate, functions of one cell whose value and slope vanish at both its ends:
the second integrals of the Legendre polynomials from L_2 on (the hierarchic modes of Szabo & Babuska 1991, section 5).
The joints stay C1. A node carries the bubbles of the cell that begins at it, so that all nodes carry (p - 1)^2 numbers
of each component; at the last node of an open coordinate they stand for nothing.

Mesh lines: uniform, or graded toward the points where forces act, edges that end at singular corners, and thin layers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshQuad

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import PointLoad
from shellbench.problems.shell.features import quickness
from shellbench.problems.shell.places import Edge, Point
from shellbench.problems.shell.surface import Domain

Array = NDArray[np.float64]
Derivative = tuple[int, int]

COMPONENTS = 3  # of a displacement
KINDS: tuple[Derivative, ...] = ((0, 0), (1, 0), (0, 1), (1, 1))  # derivatives of u that a node carries
CORNERS: tuple[Derivative, ...] = ((0, 0), (0, 1), (1, 1), (1, 0))  # of a cell, as MeshQuad.init_tensor orders them
FUNCTIONS = len(CORNERS) * len(KINDS)  # of one component on a cell

Degree = Literal[3, 4, 5]
CUBIC: Degree = 3

# H[end][slope]: coefficients of 1, x, x^2, x^3; 1 at its own end, in value or in slope, and 0 otherwise
_CUBICS = np.array([[[1, 0, -3, 2], [0, 1, -2, 1]], [[0, 0, 3, -2], [0, 0, -1, 1]]], dtype=float)
# the bubbles x^2 (1 - x)^2 and x^2 (1 - x)^2 (2 x - 1), times 16: they and the displacements are of one magnitude
_BUBBLES = 16 * np.array([[0, 0, 1, -2, 1, 0], [0, 0, -1, 4, -5, 2]], dtype=float)


def kinds_of(degree: Degree) -> tuple[tuple[int, int], ...]:
    """Return what a node carries, by coordinate: 0 for a value, 1 for a slope, from 2 on bubbles; `KINDS` first."""
    numbers = range(degree - 1)
    return KINDS + tuple((a, b) for a in numbers for b in numbers if max(a, b) > 1)


def axis_functions(x: ArrayLike, derivative: int = 0, degree: Degree = CUBIC) -> Array:
    """Return the functions of the unit interval.

    Parameters
    ----------
    x
        (...) coordinates in [0, 1].
    derivative
        Order of the derivative.
    degree
        p.

    Returns
    -------
    Array
        (..., 2, p - 1): by end of the interval, and by value (0) or slope (1) at that end; the bubbles follow, at the
        first end only.
    """
    at = np.asarray(x, dtype=float)
    coefficients = np.zeros((len(_CUBICS), degree - 1, degree + 1))
    coefficients[:, :2, :4] = _CUBICS
    coefficients[0, 2:] = _BUBBLES[: degree - CUBIC, : degree + 1]
    for _ in range(derivative):
        coefficients = coefficients[..., 1:] * np.arange(1, coefficients.shape[-1])
    powers = np.ones((*at.shape, coefficients.shape[-1]))
    for power in range(1, coefficients.shape[-1]):
        np.multiply(powers[..., power - 1], at, out=powers[..., power])
    flat = coefficients.reshape(-1, coefficients.shape[-1])
    return np.asarray((powers @ flat.T).reshape(*at.shape, *coefficients.shape[:-1]))


def tabulate(points: ArrayLike, derivative: Derivative, degree: Degree = CUBIC) -> Array:
    """Return a derivative of the basis functions of the unit cell.

    Parameters
    ----------
    points
        (..., 2) in the unit square.
    derivative
        How often to differentiate in each direction.
    degree
        p.

    Returns
    -------
    Array
        (..., 4, (p - 1)^2): by corner, in the order of `CORNERS`, and by kind, in the order of `kinds_of`. Bubbles are
        zero at corners that a cell does not begin at.
    """
    xi = np.asarray(points, dtype=float)
    first, second = (axis_functions(xi[..., axis], derivative[axis], degree) for axis in (0, 1))
    kinds = kinds_of(degree)
    table = np.empty((len(CORNERS), len(kinds), *xi.shape[:-1]))  # each function for itself, which is faster
    for row, (i, j) in zip(table, CORNERS, strict=True):
        for function, (k, m) in zip(row, kinds, strict=True):
            np.multiply(first[..., i, k], second[..., j, m], out=function)
    return np.moveaxis(table, (0, 1), (-2, -1))


@cache
def gauss_rule(count: int) -> tuple[Array, Array]:
    """Return points (count,) in [-1, 1] and weights of the Gauss rule, computed once and not to be written to."""
    points, weights = np.polynomial.legendre.leggauss(count)
    points.flags.writeable = weights.flags.writeable = False
    return points, weights


Integers = NDArray[np.int64]


def present_functions(degree: Degree) -> NDArray[np.int64]:
    """Return which of a cell's functions (corner, kind) are not zero everywhere, (p + 1)^2 of them."""
    kinds = kinds_of(degree)
    there = [(i == 0 or k < 2) and (j == 0 or m < 2) for i, j in CORNERS for k, m in kinds]
    return np.flatnonzero(there)


@cache
def cell_functions(degree: Degree) -> tuple[Integers, Integers]:
    """Return corner and kind (p + 1, p + 1) of a cell's functions, by number along each coordinate.

    Along a coordinate these are the first p + 1 of the `axis_functions`, whose last ones are zero: bubbles belong to
    the first end.
    """
    on_axis = [(end, number) for end in (0, 1) for number in range(degree - 1)][: degree + 1]
    kinds = kinds_of(degree)
    corner = [[CORNERS.index((i, j)) for j, _ in on_axis] for i, _ in on_axis]
    return np.array(corner), np.array([[kinds.index((k, m)) for _, m in on_axis] for _, k in on_axis])


def kind_scales(sizes: ArrayLike, degree: Degree = CUBIC) -> Array:
    """Return the lengths (..., (p - 1)^2) that slopes are multiplied by, h1**k h2**l, of sizes (..., 2)."""
    h = np.asarray(sizes, dtype=float)
    kinds = kinds_of(degree)
    scales = np.ones((*h.shape[:-1], len(kinds)))
    for number, kind in enumerate(kinds):
        for axis in (0, 1):
            if kind[axis] == 1:
                scales[..., number] *= h[..., axis]
    return scales


MIN_PERIODIC_CELLS = 4  # with fewer, a node meets the same neighbour on both sides


@dataclass(frozen=True)
class TensorMesh:
    """A tensor-product mesh.

    Attributes
    ----------
    domain
        The parametric rectangle that it covers.
    lines
        For each coordinate the increasing mesh lines, both ends included; of a periodic coordinate they span one
        period, from wherever the mesh begins.
    degree
        p, of the functions on a cell in each coordinate.
    """

    domain: Domain
    lines: tuple[Array, Array]
    degree: Degree = CUBIC

    def __post_init__(self) -> None:
        for axis in (0, 1):
            if self.domain.periodic[axis] and len(self.lines[axis]) <= MIN_PERIODIC_CELLS:
                raise ValueError(f"a periodic coordinate needs at least {MIN_PERIODIC_CELLS} cells")

    @property
    def cells(self) -> tuple[int, int]:
        """Number of cells along each coordinate."""
        return (len(self.lines[0]) - 1, len(self.lines[1]) - 1)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along each coordinate."""
        first, second = (n + (not closed) for n, closed in zip(self.cells, self.domain.periodic, strict=True))
        return (first, second)

    @cached_property
    def kinds(self) -> tuple[tuple[int, int], ...]:
        """What a node carries of each component; see `kinds_of`."""
        return kinds_of(self.degree)

    @cached_property
    def carried(self) -> NDArray[np.bool_]:
        """(nodes, (p - 1)^2) which of these numbers mean anything: at the last node no cell begins."""
        result = np.ones((*self.shape, len(self.kinds)), dtype=bool)
        for number, (k, m) in enumerate(self.kinds):
            if k > 1 and not self.domain.periodic[0]:
                result[-1, :, number] = False
            if m > 1 and not self.domain.periodic[1]:
                result[:, -1, number] = False
        return result.reshape(self.node_count, -1)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return self.shape[0] * self.shape[1]

    @property
    def dof_count(self) -> int:
        """Number of degrees of freedom of the nodes."""
        return COMPONENTS * len(self.kinds) * self.node_count

    @cached_property
    def grid(self) -> MeshQuad:
        """scikit-fem's mesh, before it is closed."""
        return MeshQuad.init_tensor(*self.lines)

    @cached_property
    def nodes(self) -> Integers:
        """(cells, 4) node numbers of the corners of every cell, in the order of `CORNERS`."""
        vertices = self.grid.t.T
        first, second = np.divmod(vertices, len(self.lines[1]))
        return np.asarray((first % self.shape[0]) * self.shape[1] + second % self.shape[1], dtype=np.int64)

    @cached_property
    def cell_corners(self) -> tuple[Integers, Array]:
        """(cells, 4) as `nodes`, and (cells, 2) as `sizes`; of cells the second coordinate of which runs fastest."""
        middles = (line[:-1] + np.diff(line) / 2 for line in self.lines)
        nodes, _, sizes = self.locate(np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2))
        return nodes, sizes

    @cached_property
    def origins(self) -> Array:
        """(cells, 2) lower corner of every cell."""
        return np.asarray(self.grid.p[:, self.grid.t[CORNERS.index((0, 0))]].T)

    @cached_property
    def sizes(self) -> Array:
        """(cells, 2) sides of every cell."""
        return np.asarray(self.grid.p[:, self.grid.t[CORNERS.index((1, 1))]].T) - self.origins

    @cached_property
    def node_points(self) -> Array:
        """(nodes, 2) curvilinear coordinates of the nodes."""
        first, second = (line[:count] for line, count in zip(self.lines, self.shape, strict=True))
        return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def node_scales(self) -> Array:
        """(nodes, (p - 1)^2) local length of the mesh to the power of each derivative that a node carries.

        Derivatives times these lengths are all displacements, and the stiffness matrix stays well scaled.
        """
        lengths = []
        for axis, line in enumerate(self.lines):
            h = np.diff(line)
            before, after = (h[-1:], h[:1]) if self.domain.periodic[axis] else (h[:1], h[-1:])
            mean = (np.concatenate([before, h]) + np.concatenate([h, after])) / 2
            lengths.append(mean[: self.shape[axis]])
        return kind_scales(np.stack(np.meshgrid(*lengths, indexing="ij"), axis=-1).reshape(-1, 2), self.degree)

    def edge_nodes(self, edge: Edge) -> Integers:
        """Return the nodes of an edge, or of a part of one, in the order of the running coordinate."""
        numbers = np.arange(self.node_count).reshape(self.shape)
        found = np.asarray(np.take(numbers, 0 if edge.side == "min" else -1, axis=edge.axis))
        return np.asarray(found[edge.covers(self.domain, self.node_points[found, 1 - edge.axis])])

    def edge_cells(self, edge: Edge) -> Integers:
        """Return the cells along an edge, or a part of one, in the order of the running coordinate."""
        at = self.origins[:, edge.axis] + (self.sizes[:, edge.axis] if edge.side == "max" else 0.0)
        bound = self.lines[edge.axis][0 if edge.side == "min" else -1]
        found = np.flatnonzero(np.abs(at - bound) <= 1e-12 * self.domain.size[edge.axis])
        found = found[np.argsort(self.origins[found, 1 - edge.axis])]
        middle = (self.origins + self.sizes / 2)[found, 1 - edge.axis]
        return np.asarray(found[edge.covers(self.domain, middle)])

    def node_at(self, xi: tuple[float, float]) -> int:
        """Return the node at a point, or raise ValueError if there is none."""
        point = self.brought_in(np.asarray(xi))
        index = []
        for axis, line in enumerate(self.lines):
            nearest = int(np.argmin(np.abs(line - point[axis])))
            if abs(line[nearest] - point[axis]) > 1e-9 * self.domain.size[axis]:
                raise ValueError(f"no node at {xi}")
            index.append(nearest % self.shape[axis])
        return index[0] * self.shape[1] + index[1]

    def brought_in(self, points: ArrayLike) -> Array:
        """Bring points (..., 2) into the period that the mesh spans; others are left as they are."""
        xi = np.array(points, dtype=float)
        for axis, line in enumerate(self.lines):
            if self.domain.periodic[axis]:
                xi[..., axis] = line[0] + np.mod(xi[..., axis] - line[0], line[-1] - line[0])
        return xi

    def locate(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        """Find points in the mesh.

        Parameters
        ----------
        points
            (n, 2) curvilinear coordinates, anywhere in a periodic coordinate.

        Returns
        -------
        tuple
            Node numbers of the corners (n, 4) of the cells that hold the points, in the order of `CORNERS`;
            coordinates (n, 2) in the unit cell; and the cells' sizes (n, 2).
        """
        index, unit, sizes = self._found(points)
        corners = np.array(CORNERS)
        first = (index[0][:, None] + corners[:, 0]) % self.shape[0]
        second = (index[1][:, None] + corners[:, 1]) % self.shape[1]
        return first * self.shape[1] + second, unit, sizes

    def find_cells(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        """Find points as `locate` does; return their cells (n,), by number in `cell_corners`, instead of nodes."""
        index, unit, sizes = self._found(points)
        return index[0] * self.cells[1] + index[1], unit, sizes

    def _found(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        xi = self.brought_in(points)
        index = np.empty((2, len(xi)), dtype=np.int64)
        unit, sizes = np.empty_like(xi), np.empty_like(xi)
        for axis, line in enumerate(self.lines):
            index[axis] = np.clip(np.searchsorted(line, xi[:, axis], side="right") - 1, 0, len(line) - 2)
            sizes[:, axis] = np.diff(line)[index[axis]]
            unit[:, axis] = (xi[:, axis] - line[index[axis]]) / sizes[:, axis]
        return index, unit, sizes


FEWEST = 2  # cells of a part that is graded toward one end, or half of another
SAME = 1e-9  # coordinates that differ by less of the side are the same
USUAL = 8  # cells a side of meshes that take just the cells which tell a stiffness
MOST_ADDED = 1600  # of these where all are in one mesh: what would add more is left to even meshes
COARSE = 4  # times as long as cells that tell a stiffness: such cells of a mesh do not resolve it
APART = 1 / 16  # of the side: cells further from each other are of two places
NEAR = 0.5  # of the cells beside it: a line that is nearer to another is left out


def singular_points(case: Case) -> list[tuple[float, float]]:
    """Return the points where a force acts: point loads and supports, narrow loads, and the case's focus."""
    names = [*case.focus, *(name for load in case.loads if isinstance(load, PointLoad) for name in load.on)]
    places = [case.places[name] for name in names] + [place for _, place in case.supported_places()]
    peaks = (peak for feature in case.features for peak in feature.peaks)
    return sorted({*(place.xi for place in places if isinstance(place, Point)), *peaks})


def segment(cells: int, exponents: tuple[float, float]) -> Array:
    """Return lines (cells + 1,) from 0 to 1 whose distances from either end grow by these powers; 1 grades nothing.

    Raises
    ------
    ValueError
        If both ends are graded and the number of cells is odd.
    """
    first, last = exponents
    if last == 1:
        return np.asarray(np.linspace(0.0, 1.0, cells + 1) ** first)
    if first == 1:
        return np.asarray(1.0 - segment(cells, (last, first))[::-1])
    half, odd = divmod(cells, 2)
    if odd:
        raise ValueError("a segment that is graded toward both ends needs an even number of cells")
    return np.concatenate([segment(half, (first, 1)) / 2, 1.0 - segment(half, (last, 1))[-2::-1] / 2])


def marked_coordinates(case: Case, axis: int) -> list[float]:
    """Return the different coordinates of the singular points along an axis, increasing."""
    domain = case.surface.domain
    slack = SAME * domain.size[axis]
    marks: list[float] = []
    for mark in sorted(float(domain.wrap(point)[axis]) for point in singular_points(case)):
        seam = domain.periodic[axis] and domain.upper[axis] - mark <= slack  # the other name of the lower bound
        place = domain.lower[axis] if seam else mark
        if all(abs(place - known) > slack for known in marks):
            marks.append(place)
    return sorted(marks)


def break_coordinates(case: Case, axis: int) -> list[float]:
    """Return the coordinates at which parts of edges begin or end along an axis, or formulas have kinks."""
    parts = (place for place in case.places.values() if isinstance(place, Edge) and 1 - place.axis == axis)
    return sorted({*case.kinks[axis], *(at for part in parts if part.between for at in part.between)})


Breaks = Mapping[float, float]  # coordinate -> exponent of the grading toward it
Ends = tuple[tuple[float, float], tuple[float, float]]
UNGRADED: Ends = ((1.0, 1.0), (1.0, 1.0))
UNBROKEN: tuple[Breaks, Breaks] = ({}, {})


def axis_lines(
    case: Case,
    axis: int,
    cells: int,
    exponent: float,
    ends: tuple[float, float] = (1.0, 1.0),
    breaks: Breaks = UNBROKEN[0],
) -> Array:
    """Return the mesh lines of a coordinate.

    The coordinate is divided at the singular points, toward which it is graded by `exponent`, and where parts of edges
    begin and end or formulas have kinks, toward which it is graded by the exponents of `breaks`, if they name them, as
    it is toward its `ends` by theirs. Each divided part counts as two halves if it is graded toward both ends or
    toward none. The
    longest of these gets `cells` cells, and shorter ones fewer, so that the cells on either side of a singular point
    are alike.
    """
    domain = case.surface.domain
    lower, upper = domain.lower[axis], domain.upper[axis]
    slack = SAME * domain.size[axis]
    graded = dict.fromkeys(marked_coordinates(case, axis), exponent)
    for at in break_coordinates(case, axis):
        near = next((mark for mark in graded if abs(mark - at) <= slack), at)
        graded[near] = max(graded.get(near, 1.0), breaks.get(at, 1.0))
    marks = sorted(graded)
    if domain.periodic[axis]:
        if marks and marks[-1] - marks[0] >= domain.size[axis] - slack:  # both names of the seam
            graded[marks[0]] = max(graded[marks[0]], graded[marks.pop()])
        stops = [*marks, marks[0] + domain.size[axis]] if marks else [lower, upper]
        powers = [*(graded[mark] for mark in marks), graded[marks[0]]] if marks else [1.0, 1.0]
    else:
        stops = [lower, *(m for m in marks if lower + slack < m < upper - slack), upper]
        powers = [max((graded[m] for m in marks if abs(m - stop) <= slack), default=1.0) for stop in stops]
        powers[0], powers[-1] = max(powers[0], ends[0]), max(powers[-1], ends[1])
    toward = list(pairwise(powers))
    halves = [1 if (first > 1) != (second > 1) else 2 for first, second in toward]
    reaches = np.diff(stops) / halves
    counts = np.ceil(cells * (reaches / reaches.max()) ** (1 / exponent) - SAME).astype(int)
    lines = [np.array([stops[0]])]
    for (start, stop), exponents, parts, count in zip(pairwise(stops), toward, halves, counts, strict=True):
        inside = segment(parts * max(int(count), FEWEST), exponents)[1:-1]
        lines += [start + (stop - start) * inside, np.array([stop])]
    return _resolving(case, axis, cells, np.concatenate(lines))


def _resolving(case: Case, axis: int, cells: int, lines: Array) -> Array:
    """Return mesh lines with more of them where the stiffness of a case varies quickly.

    At `USUAL` cells they are the ends of the cells that tell it, and on other meshes as many more or fewer.
    """
    for feature in case.features:
        both = [feature.division.ends(a) for a in (0, 1)]
        ends = both[axis]
        if feature.role != "stiffness" or not len(ends) or (len(both[0]) + 1) * (len(both[1]) + 1) > MOST_ADDED:
            continue
        # places that are apart are resolved each by itself
        for run in np.split(ends, 1 + np.flatnonzero(np.diff(ends) > APART * feature.division.side[axis])):
            count = max(2, round((len(run) - 1) * cells / USUAL))
            at = np.interp(np.linspace(0, len(run) - 1, count + 1), np.arange(len(run)), run)
            if case.surface.domain.periodic[axis]:
                at = np.sort(lines[0] + np.mod(at - lines[0], lines[-1] - lines[0]))
            # what is as near to a line as its own neighbours stays out, but for lines that have to be
            gaps = np.diff(at)
            nearest = np.abs(lines[:, None] - at).argmin(axis=1)
            near = np.abs(lines - at[nearest]) < NEAR * np.minimum(np.r_[gaps, gaps[-1]], np.r_[gaps[0], gaps])[nearest]
            fixed = [lines[0], lines[-1], *break_coordinates(case, axis), *marked_coordinates(case, axis)]
            kept = ~near | (np.abs(lines[:, None] - fixed).min(axis=1) <= SAME * case.surface.domain.size[axis])
            taken = np.abs(lines[kept][:, None] - at).min(axis=0) > SAME**1.5 * case.surface.domain.size[axis]
            lines = np.sort(np.concatenate([lines[kept], at[taken]]))
    return lines


def unresolved(case: Case, mesh: TensorMesh) -> str | None:
    """Return which formula varies within less than a cell of the mesh, and where, as one clause; None if none does."""
    for feature in case.features if not case.modal else ():
        division = feature.division
        for axis in (0, 1) if feature.role == "stiffness" else ():
            there = division.narrow[:, axis]
            middles = mesh.brought_in((division.low + division.high)[there] / 2)[:, axis]
            line = mesh.lines[axis]
            cells = np.diff(line)[np.clip(np.searchsorted(line, middles) - 1, 0, len(line) - 2)]
            needed = (division.high - division.low)[there, axis]
            if np.any(cells > COARSE * needed):
                return f"{feature.what} {quickness(case, feature, axis)}, and the mesh does not resolve it"
    return None


def graded_mesh(
    case: Case,
    cells: tuple[int, int],
    exponent: float,
    ends: Ends = UNGRADED,
    breaks: tuple[Breaks, Breaks] = UNBROKEN,
    degree: Degree = CUBIC,
) -> TensorMesh:
    """Return a mesh with `cells` along each coordinate as `axis_lines` counts them."""
    first, second = (axis_lines(case, a, cells[a], exponent, ends[a], breaks[a]) for a in (0, 1))
    return TensorMesh(case.surface.domain, (first, second), degree)
