"""The midsurface of a part as a NURBS surface: exactly where it is made of lines and arcs, else interpolated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.surface import Surface
from shellbench.solvers.kratos.spline import Chart, RationalBasis

Array = NDArray[np.float64]

WIDEST_ARC = 5 * np.pi / 6  # of one rational quadratic: at half a turn its end tangents are parallel
EXACT = 1e-12  # relative error of a position that is rounding
CHECKED = 23  # points a side at which the surface is held against the case's


@dataclass(frozen=True)
class NurbsPatch:
    """Tensor-product NURBS on a rectangle of the case's coordinates.

    Attributes
    ----------
    bases
        Of the two coordinates; the functions are their products, and so are the weights.
    """

    bases: tuple[RationalBasis, RationalBasis]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of control points along the two coordinates."""
        return self.bases[0].size, self.bases[1].size

    @cached_property
    def weights(self) -> Array:
        """Weights of the control points, by coordinate."""
        return np.outer(self.bases[0].weights, self.bases[1].weights)

    def derivatives(self, coefficients: Array, points: ArrayLike, order: int = 2) -> dict[tuple[int, int], Array]:
        """Evaluate a field and its derivatives.

        Parameters
        ----------
        coefficients
            (n1, n2, c) of the control points.
        points
            (n, 2) in the rectangle.
        order
            Highest total order, at most 2.

        Returns
        -------
        dict
            (i, j) -> (n, c), the derivative i times in xi1 and j times in xi2.
        """
        xi = np.asarray(points, dtype=float)
        (start1, values1), (start2, values2) = (
            basis.local(xi[:, axis], order) for axis, basis in enumerate(self.bases)
        )
        rows = start1[:, None] + np.arange(values1.shape[2])
        columns = start2[:, None] + np.arange(values2.shape[2])
        near = coefficients[rows[:, :, None], columns[:, None, :]]
        result = {}
        for i in range(order + 1):
            half = np.einsum("na,nabc->nbc", values1[i], near)
            for j in range(order + 1 - i):
                result[i, j] = np.einsum("nb,nbc->nc", values2[j], half)
        return result

    def on_grid(self, coefficients: Array, first: Array, second: Array, order: int = 2) -> dict[tuple[int, int], Array]:
        """Evaluate a field as `derivatives` does, on the grid of two sets of points: (i, j) -> (g1, g2, c)."""
        left, right = self.bases[0].matrices(first, order), self.bases[1].matrices(second, order)
        halves = [np.tensordot(matrix, coefficients, axes=(1, 0)) for matrix in left]
        keys = [(i, j) for i, j in product(range(order + 1), repeat=2) if i + j <= order]
        return {(i, j): np.swapaxes(np.tensordot(halves[i], right[j], axes=(1, 1)), 1, 2) for i, j in keys}

    def gather(self, left: Array, density: Array, right: Array) -> Array:
        """Return the sums (3, n1, n2) over a grid of a density (g1, g2, 3) times functions (g1, n1) and (g2, n2)."""
        half = np.tensordot(left, density, axes=(0, 0))
        return np.moveaxis(np.tensordot(half, right, axes=(1, 0)), 1, 0)

    def interpolate(self, surface: Surface) -> Array:
        """Return the control points (n1, n2, 3) of the patch that meets a surface at the Greville points."""
        first, second = (basis.greville for basis in self.bases)
        grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
        left, right = (basis.matrices(basis.greville, 0)[0] for basis in self.bases)
        half = np.linalg.solve(left, surface.position(grid).reshape(len(first), -1)).reshape(*grid.shape[:2], 3)
        return np.moveaxis(np.linalg.solve(right, np.moveaxis(half, 1, 0).reshape(len(second), -1)).reshape(
            len(second), len(first), 3), 0, 1)  # fmt: skip


@dataclass(frozen=True)
class Midsurface:
    """A patch with its control points.

    Attributes
    ----------
    patch, control_points
        The functions and (n1, n2, 3) positions, m.
    error
        Largest distance from the case's surface that was found, relative to its size; 0 where it is rounding.
    """

    patch: NurbsPatch
    control_points: Array
    error: float


def midsurface_of(
    surface: Surface, lines: tuple[tuple[float, ...], tuple[float, ...]], degree: int, angles: tuple[bool, bool]
) -> Midsurface:
    """Return the NURBS surface between knot lines, which are values of the coordinates.

    Coordinates that are angles are tried as arcs first; if that does not meet the surface everywhere, positions are
    interpolated by splines in the coordinates themselves.
    """
    best: Midsurface | None = None
    choices = [
        (True, False) if a and b[-1] - b[0] <= WIDEST_ARC else (False,) for a, b in zip(angles, lines, strict=True)
    ]
    for arcs in product(*choices):
        bases = [RationalBasis(Chart(b[0], b[-1], arc), degree, b) for arc, b in zip(arcs, lines, strict=True)]
        patch = NurbsPatch((bases[0], bases[1]))
        points = patch.interpolate(surface)
        ends = [np.linspace(b[0], b[-1], CHECKED) for b in lines]
        grid = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1)
        wanted = surface.position(grid)
        error = float(np.abs(patch.on_grid(points, ends[0], ends[1], 0)[0, 0] - wanted).max())
        error /= float(np.ptp(wanted.reshape(-1, 3), axis=0).max())
        found = Midsurface(patch, points, 0.0 if error < EXACT else error)
        if found.error == 0:
            return found
        if best is None or error < best.error:
            best = found
    assert best is not None
    return best
