"""Tensor-product meshes of the parametric rectangle, closed by renumbering nodes.

The cells are those of scikit-fem's `MeshQuad.init_tensor`; its vertices on a seam of a periodic surface are given
one node number, because a periodic mesh of scikit-fem does not take C1 elements.

Bicubic Hermite (Bogner-Fox-Schmit) basis, tabulated once on the unit cell.

A node carries u, u,1, u,2 and u,12 of each Cartesian component, the derivatives with respect to the curvilinear
coordinates themselves. On a cell of size (h1, h2) the basis function that belongs to the derivative (k, l) is h1**k
h2**l times its counterpart on the unit cell, so that no matrix is inverted. scikit-fem's `ElementQuadBFS` inverts a
Vandermonde matrix in global coordinates instead, whose condition number grows to 3.5e14 on 64 x 64 cells.

Bogner, Fox & Schmit (1965), The generation of interelement-compatible stiffness and mass matrices.

Degree 4 and 5 add bubbles along each coordinate, functions of one cell whose value and slope vanish at both its ends:
the second integrals of the Legendre polynomials from L_2 on (the hierarchic modes of Szabo & Babuska 1991, section 5).
The joints stay C1. A node carries the bubbles of the cell that begins at it, so that all nodes carry (p - 1)^2 numbers
of each component; at the last node of an open coordinate they are unused.

At folds the slope across the line jumps. One more function of each end of a cell carries the jump: half of its slope
function, with a minus sign at the end where the cell stops. Its numbers are used at folds only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshQuad

from shellbench.problems.shell.question.folds import ASIDE, Fold
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Domain

Array = NDArray[np.float64]
Derivative = tuple[int, int]

# Thresholds of rounding, one name for each kind of number that is compared. None is tuned to an answer: each lies
# between the rounding of such numbers and the least meaningful difference.
SAME = 1e-9  # coordinates and times, relative to the whole; components of unit vectors of a surface
ROUNDING = 1e-12  # sums, products and solves, relative to their largest term: 4,500 eps
UNSTRAINED = 1e-14  # strain of a shell that is only moved, relative to its displacements: 45 eps

COMPONENTS = 3  # of a displacement
KINDS: tuple[Derivative, ...] = ((0, 0), (1, 0), (0, 1), (1, 1))  # derivatives of u that a node carries
CORNERS: tuple[Derivative, ...] = ((0, 0), (0, 1), (1, 1), (1, 0))  # of a cell, as MeshQuad.init_tensor orders them
FUNCTIONS = len(CORNERS) * len(KINDS)  # of one component on a cell

Degree = Literal[3, 4, 5]
CUBIC: Degree = 3
JUMP = -1  # number of the function that carries the jump of a slope at a fold


@dataclass(frozen=True)
class Basis:
    """The functions of a cell.

    Attributes
    ----------
    degree
        p in each coordinate.
    folded
        Coordinate across whose lines slopes may jump, or None.
    """

    degree: Degree = CUBIC
    folded: int | None = None

    def numbers(self, axis: int) -> tuple[int, ...]:
        """Return the functions of an end of a cell along a coordinate: value, slope, bubbles, jump of the slope."""
        return (*range(self.degree - 1), *((JUMP,) if self.folded == axis else ()))


CUBICS = Basis()

# H[end][slope]: coefficients of 1, x, x^2, x^3; 1 at its own end, in value or in slope, and 0 otherwise
_CUBICS = np.array([[[1, 0, -3, 2], [0, 1, -2, 1]], [[0, 0, 3, -2], [0, 0, -1, 1]]], dtype=float)
# the bubbles x^2 (1 - x)^2 and x^2 (1 - x)^2 (2 x - 1), times 16: they and the displacements are of one magnitude
_BUBBLES = 16 * np.array([[0, 0, 1, -2, 1, 0], [0, 0, -1, 4, -5, 2]], dtype=float)


@cache
def kinds_of(basis: Basis) -> tuple[tuple[int, int], ...]:
    """Return a node's degrees of freedom by coordinate, `KINDS` first: 0 is a value, 1 a slope, 2 and more bubbles."""
    pairs = ((a, b) for a in basis.numbers(0) for b in basis.numbers(1))
    return KINDS + tuple(pair for pair in pairs if pair not in KINDS)


def axis_functions(x: ArrayLike, derivative: int = 0, degree: Degree = CUBIC, folded: bool = False) -> Array:
    """Return the functions of the unit interval.

    Parameters
    ----------
    x
        (...) coordinates in [0, 1].
    derivative
        Order of the derivative.
    degree
        p.
    folded
        True if slopes may jump.

    Returns
    -------
    Array
        (..., 2, p - 1): by end of the interval, and by value (0) or slope (1) at that end; the bubbles follow, at the
        first end only. With `folded`, the function of the jump is the last one.
    """
    at = np.asarray(x, dtype=float)
    coefficients = np.zeros((len(_CUBICS), degree - 1 + folded, degree + 1))
    coefficients[:, :2, :4] = _CUBICS
    coefficients[0, 2 : degree - 1] = _BUBBLES[: degree - CUBIC, : degree + 1]
    if folded:
        coefficients[:, JUMP, :4] = _CUBICS[:, 1] * [[0.5], [-0.5]]
    for _ in range(derivative):
        coefficients = coefficients[..., 1:] * np.arange(1, coefficients.shape[-1])
    powers = np.ones((*at.shape, coefficients.shape[-1]))
    for power in range(1, coefficients.shape[-1]):
        np.multiply(powers[..., power - 1], at, out=powers[..., power])
    flat = coefficients.reshape(-1, coefficients.shape[-1])
    return np.asarray((powers @ flat.T).reshape(*at.shape, *coefficients.shape[:-1]))


def tabulate(points: ArrayLike, derivative: Derivative, basis: Basis = CUBICS) -> Array:
    """Return a derivative of the basis functions of the unit cell.

    Parameters
    ----------
    points
        (..., 2) in the unit square.
    derivative
        Order of the derivative in each direction.
    basis
        The functions.

    Returns
    -------
    Array
        (..., 4, (p - 1)^2): by corner, in the order of `CORNERS`, and by kind, in the order of `kinds_of`. Bubbles are
        zero at corners that a cell does not begin at.
    """
    xi = np.asarray(points, dtype=float)
    first, second = (
        axis_functions(xi[..., axis], derivative[axis], basis.degree, basis.folded == axis) for axis in (0, 1)
    )
    kinds = kinds_of(basis)
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


def present_functions(basis: Basis) -> NDArray[np.int64]:
    """Return the numbers of a cell's functions (corner, kind) that are not zero everywhere, (p + 1)^2 of them."""
    kinds = kinds_of(basis)
    there = [(i == 0 or k < 2) and (j == 0 or m < 2) for i, j in CORNERS for k, m in kinds]
    return np.flatnonzero(there)


@cache
def present_on_axis(basis: Basis, axis: int) -> slice | Integers:
    """Return the numbers of the `axis_functions`, by end (slow), that are not zero: bubbles have the first end only."""
    numbers = basis.numbers(axis)
    if basis.folded != axis:
        return slice(basis.degree + 1)
    there = [end == 0 or number < 2 for end in (0, 1) for number in numbers]
    return np.flatnonzero(there)


@cache
def cell_functions(basis: Basis) -> tuple[Integers, Integers]:
    """Return corner and kind (p + 1, p + 1) of a cell's functions, by number along each coordinate.

    Along a coordinate these are the ones of `present_on_axis`.
    """
    first, second = (
        [(end, number) for end in (0, 1) for number in basis.numbers(axis) if end == 0 or number < 2] for axis in (0, 1)
    )
    kinds = kinds_of(basis)
    corner = [[CORNERS.index((i, j)) for j, _ in second] for i, _ in first]
    return np.array(corner), np.array([[kinds.index((k, m)) for _, m in second] for _, k in first])


def kind_scales(sizes: ArrayLike, basis: Basis = CUBICS) -> Array:
    """Return the factors (..., (p - 1)^2) of slopes, h1**k h2**l, for sizes (..., 2)."""
    h = np.asarray(sizes, dtype=float)
    kinds = kinds_of(basis)
    scales = np.ones((*h.shape[:-1], len(kinds)))
    for number, kind in enumerate(kinds):
        for axis in (0, 1):
            if kind[axis] in (1, JUMP):
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
    folds
        Folds of the surface: mesh lines of one coordinate; in degree 4 and 5.
    """

    domain: Domain
    lines: tuple[Array, Array]
    degree: Degree = CUBIC
    folds: tuple[Fold, ...] = ()

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
    def basis(self) -> Basis:
        """Functions of a cell."""
        return Basis(self.degree, self.folds[0].axis if self.folds else None)

    @cached_property
    def kinds(self) -> tuple[tuple[int, int], ...]:
        """Degrees of freedom of a node, for each component; see `kinds_of`."""
        return kinds_of(self.basis)

    def fold_column(self, fold: Fold) -> int:
        """Return the number, along its coordinate, of the nodes of a fold."""
        away = (self.lines[fold.axis] - fold.at) / self.domain.size[fold.axis]  # a closed mesh begins anywhere
        away -= np.round(away) * self.domain.periodic[fold.axis]
        return int(np.argmin(np.abs(away))) % self.shape[fold.axis]

    def lower_sides(self, axis: int) -> Array:
        """Return the mesh lines of a coordinate, those on folds moved to their lower side."""
        line = self.lines[axis].copy()
        columns = [self.fold_column(fold) for fold in self.folds if fold.axis == axis]
        both = [len(line) - 1] if 0 in columns else []  # the seam is the first line and the last one
        line[[*columns, *both]] -= 2 * ASIDE * self.domain.size[axis]
        return line

    @cached_property
    def folded_nodes(self) -> NDArray[np.bool_]:
        """(nodes,) mask of the nodes on folds."""
        moved = [self.lower_sides(axis) != line for axis, line in enumerate(self.lines)]
        first, second = (mask[:count] for mask, count in zip(moved, self.shape, strict=True))
        return np.asarray((first[:, None] | second).ravel())

    @cached_property
    def used_dofs(self) -> NDArray[np.bool_]:
        """(nodes, (p - 1)^2) mask of the numbers that are used: at the last node no cell begins."""
        result = np.ones((*self.shape, len(self.kinds)), dtype=bool)
        for number, (k, m) in enumerate(self.kinds):
            if k > 1 and not self.domain.periodic[0]:
                result[-1, :, number] = False
            if m > 1 and not self.domain.periodic[1]:
                result[:, -1, number] = False
            if JUMP in (k, m):
                result[..., number] &= self.folded_nodes.reshape(self.shape)
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

        Derivatives times these lengths have the unit of displacements, so that the stiffness matrix stays well scaled.
        """
        lengths = []
        for axis, line in enumerate(self.lines):
            h = np.diff(line)
            before, after = (h[-1:], h[:1]) if self.domain.periodic[axis] else (h[:1], h[-1:])
            mean = (np.concatenate([before, h]) + np.concatenate([h, after])) / 2
            lengths.append(mean[: self.shape[axis]])
        return kind_scales(np.stack(np.meshgrid(*lengths, indexing="ij"), axis=-1).reshape(-1, 2), self.basis)

    def edge_nodes(self, edge: Edge) -> Integers:
        """Return the nodes of an edge, or of a part of one, in the order of the running coordinate."""
        numbers = np.arange(self.node_count).reshape(self.shape)
        found = np.asarray(np.take(numbers, 0 if edge.side == "min" else -1, axis=edge.axis))
        return np.asarray(found[edge.covers(self.domain, self.node_points[found, 1 - edge.axis])])

    def edge_cells(self, edge: Edge) -> Integers:
        """Return the cells along an edge, or a part of one, in the order of the running coordinate."""
        at = self.origins[:, edge.axis] + (self.sizes[:, edge.axis] if edge.side == "max" else 0.0)
        bound = self.lines[edge.axis][0 if edge.side == "min" else -1]
        found = np.flatnonzero(np.abs(at - bound) <= ROUNDING * self.domain.size[edge.axis])
        found = found[np.argsort(self.origins[found, 1 - edge.axis])]
        middle = (self.origins + self.sizes / 2)[found, 1 - edge.axis]
        return np.asarray(found[edge.covers(self.domain, middle)])

    def node_at(self, xi: tuple[float, float]) -> int:
        """Return the node at a point, or raise ValueError if there is none."""
        point = self.into_period(np.asarray(xi))
        index = []
        for axis, line in enumerate(self.lines):
            nearest = int(np.argmin(np.abs(line - point[axis])))
            if abs(line[nearest] - point[axis]) > SAME * self.domain.size[axis]:
                raise ValueError(f"no node at {xi}")
            index.append(nearest % self.shape[axis])
        return index[0] * self.shape[1] + index[1]

    def into_period(self, points: ArrayLike) -> Array:
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
        index, unit, sizes = self._find(points)
        corners = np.array(CORNERS)
        first = (index[0][:, None] + corners[:, 0]) % self.shape[0]
        second = (index[1][:, None] + corners[:, 1]) % self.shape[1]
        return first * self.shape[1] + second, unit, sizes

    def find_cells(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        """Find points as `locate` does; return their cells (n,), by number in `cell_corners`, instead of nodes."""
        index, unit, sizes = self._find(points)
        return index[0] * self.cells[1] + index[1], unit, sizes

    def _find(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        xi = self.into_period(points)
        index = np.empty((2, len(xi)), dtype=np.int64)
        unit, sizes = np.empty_like(xi), np.empty_like(xi)
        for axis, line in enumerate(self.lines):
            index[axis] = np.clip(np.searchsorted(line, xi[:, axis], side="right") - 1, 0, len(line) - 2)
            sizes[:, axis] = np.diff(line)[index[axis]]
            unit[:, axis] = (xi[:, axis] - line[index[axis]]) / sizes[:, axis]
        return index, unit, sizes
