"""Tensor grids of cells, graded toward edges, with integrated Legendre functions.

In each direction a cell has two linear functions, one for each of its ends, and functions that vanish at both ends
(Szabo & Babuska 1991, section 3.1). Products of them are continuous over the grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.symmetry.symmetry import Part

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]


def functions(s: Array, degree: int) -> Array:
    """Return values and slopes (2, N, degree + 1) on [-1, 1]: (1 - s) / 2, (1 + s) / 2, and integrated Legendre."""
    legendre, k = np.polynomial.legendre.legvander(s, degree), np.arange(1, degree)
    out = np.empty((2, len(s), degree + 1))
    out[:, :, :2] = np.stack([np.stack([1 - s, 1 + s], axis=-1), np.full((len(s), 2), [-1.0, 1.0])]) / 2
    scale = np.sqrt(k + 0.5)
    out[0, :, 2:] = scale * (legendre[:, 2:] - legendre[:, :-2]) / (2 * k + 1)
    out[1, :, 2:] = scale * legendre[:, 1:-1]
    return out


@dataclass(frozen=True)
class Grid:
    """A tensor grid of cells with polynomials of one degree.

    Attributes
    ----------
    ends
        Ends of the cells along each coordinate, increasing.
    periodic
        For each coordinate, whether the last cell meets the first one.
    """

    ends: tuple[Array, Array]
    degree: int
    periodic: tuple[bool, bool]

    @property
    def cells(self) -> tuple[int, int]:
        """Numbers of cells along the coordinates."""
        return len(self.ends[0]) - 1, len(self.ends[1]) - 1

    def corners(self, axis: int) -> int:
        """Return the number of functions along a coordinate that are one at an end of a cell."""
        return self.cells[axis] + (not self.periodic[axis])

    def count(self, axis: int) -> int:
        """Return the number of functions along a coordinate."""
        return self.corners(axis) + self.cells[axis] * (self.degree - 1)

    def numbers(self, axis: int) -> Numbers:
        """Return the numbers (cells, degree + 1) of each cell's functions along a coordinate, those of ends first."""
        cell = np.arange(self.cells[axis])[:, None]
        inner = self.corners(axis) + cell * (self.degree - 1) + np.arange(self.degree - 1)
        return np.concatenate([(cell + np.arange(2)) % self.corners(axis), inner], axis=1)

    def at(self, axis: int, x: Array) -> tuple[Numbers, Array]:
        """Return the cells (N,) of points (N,) and values and slopes (2, N, degree + 1) of their functions there."""
        ends = self.ends[axis]
        cell = np.clip(np.searchsorted(ends, x, side="right") - 1, 0, self.cells[axis] - 1)
        half = np.diff(ends)[cell] / 2
        found = functions((x - ends[cell]) / half - 1, self.degree)
        found[1] /= half[:, None]
        return cell, found


LARGEST = 0.25  # cell, a share of a side
LAYER = 2.2  # the same, in cube roots of thickness over side: on the hypar of 1e-4, whose layers run across the shell


def graded_ends(part: Part, axis: int, smallest: float, ratio: float) -> Array:
    """Return ends of cells along a coordinate of a part: graded toward free and held edges, even between them.

    Layers of shear at edges are as wide as the thickness, and layers inside as the cube root of it (Pitkaranta 1992).

    Parameters
    ----------
    smallest
        The cell at an edge, in thicknesses.
    ratio
        Of the distances of successive ends from the edge.
    """
    case = part.case
    low, high = part.lower[axis], part.upper[axis]
    mirrored = [end is not None for end in part.ends[axis]]
    open_ends = [not (m or case.surface.domain.periodic[axis]) for m in mirrored]
    thin = case.material.thickness / _length(case, axis)
    largest = min(LARGEST, LAYER * thin ** (1 / 3))
    layers, distance = [], smallest * thin
    while distance < largest:
        layers.append(distance)
        distance *= ratio
    from_low, from_high = ([0.0, *layers] if opened else [0.0] for opened in open_ends)
    start, stop = from_low[-1], 1 - from_high[-1]
    middle = np.linspace(start, stop, max(1, round((stop - start) / largest)) + 1)
    shares = [*from_low[:-1], *middle, *(1 - np.array(from_high[:-1]))[::-1]]
    inside = [at for at in part.whole.kinks[axis] if low < at < high]
    return np.unique([*(low + (high - low) * np.array(shares)), *inside])


def _length(case: Case, axis: int) -> float:
    """Return the mean length of the coordinate lines, m."""
    x = case.surface.derivatives(case.surface.domain.grid(9, 9).reshape(-1, 2), order=1)
    slope = x[1, 0] if axis == 0 else x[0, 1]
    return float(np.linalg.norm(slope, axis=-1).mean() * case.surface.domain.size[axis])


def gauss(ends: Sequence[float] | Array, count: int) -> tuple[Array, Array]:
    """Return Gauss points and weights (cells, count) on cells between ends."""
    s, w = np.polynomial.legendre.leggauss(count)
    half = np.diff(ends)[:, None] / 2
    return np.asarray(ends)[:-1, None] + half * (s + 1), half * w
