"""NURBS: rational B-splines in one coordinate and in two, and the midsurface of a part as their surface.

Straight lines and circular arcs are exact; other curves are interpolated. A coordinate xi of the case is
joined to the spline's own parameter s in [0, 1] in closed form. On a straight line they are proportional. On an arc of
half-angle alpha about theta_m, with r = tan((theta - theta_m)/2) and T = tan(alpha/2), s = (1 + r/T)/2 and the weight
is W = 1 + r^2, so that W cos(theta - theta_m) = 1 - r^2 and W sin(theta - theta_m) = 2 r: a rational quadratic (Piegl &
Tiller, The NURBS Book, section 7.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.question.surface import Surface

Array = NDArray[np.float64]

WIDEST_ARC = 5 * np.pi / 6  # of one rational quadratic: at half a turn its end tangents are parallel
EXACT = 1e-12  # relative error of a position that is rounding
CHECKED = 23  # points a side at which the surface is held against the case's


@dataclass(frozen=True)
class Chart:
    """The map between a coordinate and the parameter s of a spline.

    Attributes
    ----------
    lower, upper
        Bounds of the coordinate; radians for angles.
    arc
        True if the coordinate is the angle of circular arcs; less than half a turn then.
    """

    lower: float
    upper: float
    arc: bool

    @property
    def half_tangent(self) -> float:
        """T, of an arc."""
        return float(np.tan((self.upper - self.lower) / 4))

    def parameter(self, xi: ArrayLike) -> tuple[Array, Array, Array]:
        """Return s and its first two derivatives with respect to xi, each (n,)."""
        x = np.asarray(xi, dtype=float)
        if not self.arc:
            slope = 1 / (self.upper - self.lower)
            return (x - self.lower) * slope, np.full_like(x, slope), np.zeros_like(x)
        r, t = np.tan((x - (self.lower + self.upper) / 2) / 2), self.half_tangent
        return (1 + r / t) / 2, (1 + r**2) / (4 * t), r * (1 + r**2) / (4 * t)

    def weight(self, s: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the weight function and its first two derivatives with respect to s, each (n,)."""
        x = np.asarray(s, dtype=float)
        if not self.arc:
            return np.ones_like(x), np.zeros_like(x), np.zeros_like(x)
        square = self.half_tangent**2
        middle = 2 * x - 1
        return 1 + square * middle**2, 4 * square * middle, np.full_like(x, 8 * square)


@dataclass(frozen=True)
class RationalBasis:
    """The rational B-splines R_i = w_i B_i / W of one coordinate.

    Attributes
    ----------
    chart
        Coordinate and weight.
    degree
        Of the B-splines.
    lines
        (spans + 1,) knot lines from the lower to the upper bound, in the coordinate xi.
    """

    chart: Chart
    degree: int
    lines: tuple[float, ...]

    @cached_property
    def knots(self) -> Array:
        """Open knot vector in s, (size + degree + 1,)."""
        inner = self.chart.parameter(np.asarray(self.lines))[0]
        return np.concatenate([np.zeros(self.degree), [0.0], inner[1:-1], [1.0], np.ones(self.degree)])

    @property
    def size(self) -> int:
        """Number of functions."""
        return len(self.lines) - 1 + self.degree

    @cached_property
    def weights(self) -> Array:
        """Coefficients (size,) of the weight function: W = sum w_i B_i.

        The coefficient of a quadratic is its blossom, averaged over the pairs of a function's inner knots.
        """
        if not self.chart.arc:
            return np.ones(self.size)
        inner = np.stack([self.knots[i + 1 : i + 1 + self.degree] for i in range(self.size)])
        sums, squares = inner.sum(axis=1), (inner**2).sum(axis=1)
        pairs = (sums**2 - squares) / (self.degree * (self.degree - 1))  # mean of the products s_a s_b, a != b
        value, slope, curve = (float(part) for part in self.chart.weight(0.0))
        return np.asarray(value + slope * sums / self.degree + curve / 2 * pairs)

    @cached_property
    def greville(self) -> Array:
        """Means (size,) of each function's inner knots, as values of xi: points at which interpolation is stable."""
        s = np.array([self.knots[i + 1 : i + 1 + self.degree].mean() for i in range(self.size)])
        return self._coordinate(s)

    def _coordinate(self, s: Array) -> Array:
        low, high = self.chart.lower, self.chart.upper
        if not self.chart.arc:
            return low + s * (high - low)
        return np.asarray((low + high) / 2 + 2 * np.arctan((2 * s - 1) * self.chart.half_tangent))

    def local(self, xi: ArrayLike, order: int = 2) -> tuple[NDArray[np.int64], Array]:
        """Evaluate the functions that are not zero at points, and their derivatives with respect to xi.

        Parameters
        ----------
        xi
            (n,) points from the lower to the upper bound.
        order
            Highest derivative, at most 2.

        Returns
        -------
        first
            (n,) number of the first such function; degree + 1 of them follow each other.
        values
            (order + 1, n, degree + 1) value, first and second derivative.
        """
        s, s1, s2 = self.chart.parameter(xi)
        s = np.clip(s, 0.0, 1.0)
        last = self.size - 1
        span = np.clip(np.searchsorted(self.knots, s, side="right") - 1, self.degree, last)
        first = span - self.degree
        w, w1, w2 = (part[:, None] for part in self.chart.weight(s))
        weights = self.weights[first[:, None] + np.arange(self.degree + 1)]
        value = weights * self._derivative(s, span, 0) / w
        result = [value]
        if order > 0:
            slope = (weights * self._derivative(s, span, 1) - value * w1) / w
            result.append(slope * s1[:, None])
        if order > 1:
            curve = (weights * self._derivative(s, span, 2) - 2 * slope * w1 - value * w2) / w
            result.append(curve * s1[:, None] ** 2 + slope * s2[:, None])
        return first, np.stack(result)

    def _derivative(self, s: Array, span: NDArray[np.int64], order: int) -> Array:
        """Return derivatives (n, degree + 1) with respect to s of the B-splines on spans (n,).

        By the recurrence of Cox and de Boor up to degree - order, and then that of derivatives.
        """
        t, rows = self.knots, np.ones((len(s), 1))
        for degree in range(1, self.degree + 1):
            number = span[:, None] - degree + 1 + np.arange(degree)  # of the functions of degree - 1
            left, right = t[number], t[number + degree]
            wide = np.zeros((len(s), degree + 1))
            if degree <= self.degree - order:
                wide[:, :-1] = (right - s[:, None]) / (right - left) * rows
                wide[:, 1:] += (s[:, None] - left) / (right - left) * rows
            else:
                slope = degree / (right - left) * rows
                wide[:, :-1] = -slope
                wide[:, 1:] += slope
            rows = wide
        return rows

    def matrices(self, xi: ArrayLike, order: int = 2) -> Array:
        """Return value, first and second derivative of all functions at points, (order + 1, n, size)."""
        first, values = self.local(xi, order)
        full = np.zeros((order + 1, len(first), self.size))
        columns = first[:, None] + np.arange(self.degree + 1)
        np.put_along_axis(full, np.broadcast_to(columns, values.shape), values, axis=2)
        return full

    def gauss(self, points: int) -> tuple[Array, Array]:
        """Return nodes and weights (spans * points,) of Gauss's rule on each span, for integrals over xi.

        The rule is one in s, as Kratos has it, so that its sums are met exactly.
        """
        x, w = np.polynomial.legendre.leggauss(points)
        lines = self.knots[self.degree : self.size + 1]
        lengths = np.diff(lines)[:, None]
        xi = self._coordinate((lines[:-1, None] + lengths * (x + 1) / 2).ravel())
        return xi, (lengths * w / 2).ravel() / self.chart.parameter(xi)[1]


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
