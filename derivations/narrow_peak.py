r"""Plates whose displacement along x has one narrow peak: cases/narrow_peak.toml and cases/sharp_peak.toml.

The displacement is u = a X(x) Y(y) along x, without Poisson's effect, and vanishes with its slopes where the patch ends. Then

    f1 = -D (u,xx + u,yy / 2),    f2 = -D u,xy / 2

keep the balance, and the energy is D / 2 int (u,x^2 + u,y^2 / 2). Each factor is H(s) = 3 s^2 - 2 s^3 of a distance that runs
from 0 to 1 within a width w, with int H'^2 = 6 / (5 w) and int H^2 = 13 w / 35: all is in closed form.

The second form knows of the loads alone: Galerkin's method for both components in the plane, products of Legendre's
polynomials between the lines where the loads jump, continuous across them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from numpy.polynomial import legendre
from scipy.sparse.linalg import spsolve

from .estimate import Estimate
from .surface_strains import Array

STIFFNESS, HEIGHT = 1e5, 1e-3  # D = E h, N/m, and a, m
DEGREE = 5
ROUNDING, AGREED = 1e-10, 1e-8  # relative


@dataclass(frozen=True)
class Peak:
    """A factor H: where it is 1, and the widths within which it rises before and falls after."""

    top: float
    before: float
    after: float

    def __call__(self, x: Array, order: int = 0) -> Array:
        """Return a derivative."""
        width = np.where(x < self.top, self.before, self.after)
        s = 1 - np.abs(x - self.top) / width
        slope = np.where(x < self.top, 1.0, -1.0) / width
        values = (s**2 * (3 - 2 * s), 6 * s * (1 - s) * slope, (6 - 12 * s) * slope**2)
        return np.where(s > 0, values[order], 0.0)

    @property
    def lines(self) -> Array:
        """0, where it begins, is 1, and ends, and 1."""
        return np.unique([0.0, self.top - self.before, self.top, self.top + self.after, 1.0])

    @property
    def squares(self) -> tuple[float, float]:
        """Integrals of H^2 and H'^2."""
        return 13 / 35 * (self.before + self.after), 6 / 5 * (1 / self.before + 1 / self.after)


@dataclass(frozen=True)
class Plate:
    """A plate, by its peak in x and in y, and three points."""

    along: Peak
    across: Peak
    points: tuple[tuple[float, float], ...]


NARROW = Plate(Peak(0.0025, 0.0025, 0.06), Peak(0.40125, 0.04, 0.04), ((0.03, 0.42), (0.001, 0.396), (0.05, 0.37)))
SHARP = Plate(Peak(0.3173, 0.012, 0.003), Peak(0.4037, 5e-4, 5e-4), ((0.31, 0.4039), (0.3155, 0.4034), (0.312, 0.4038)))


def _estimates(largest: float, mean: float, energy: float, share: float) -> dict[str, Estimate]:
    values = (
        ("largest_displacement", largest, "m"),
        ("mean_oblique", mean, "m"),
        ("strain_energy", energy, "J"),
        ("membrane_energy", energy, "J"),
    )
    return {name: Estimate(float(v), share * abs(float(v)), unit) for name, v, unit in values}


def peak(plate: Plate) -> dict[str, Estimate]:
    """Known values in closed form."""
    (x, x1), (y, y1) = plate.along.squares, plate.across.squares
    one, two = np.array(plate.points).T
    mean = HEIGHT * float(np.mean(plate.along(one) * plate.across(two))) / 3
    return _estimates(HEIGHT, mean, STIFFNESS / 2 * HEIGHT**2 * (x1 * y + x * y1 / 2), ROUNDING)


@dataclass(frozen=True)
class Line:
    """Continuous piecewise polynomials on [0, 1], and Gauss points with weights."""

    ends: Array

    @property
    def rule(self) -> tuple[Array, Array]:
        """Points and weights."""
        t, w = legendre.leggauss(DEGREE + 3)
        sizes = np.diff(self.ends)[:, None]
        return (self.ends[:-1, None] + sizes * (t + 1) / 2).ravel(), (sizes * w / 2).ravel()

    def table(self, x: Array, order: int) -> Array:
        """Values or slopes (n, functions): hats first, then integrals of Legendre's polynomials of each piece."""
        count = len(self.ends) - 1
        piece = np.clip(np.searchsorted(self.ends, x, side="right") - 1, 0, count - 1)
        size = np.diff(self.ends)[piece]
        s = 2 * (x - self.ends[piece]) / size - 1
        found = np.zeros((len(x), count + 1 + count * (DEGREE - 1)))
        at = np.arange(len(x))
        found[at, piece], found[at, piece + 1] = ((1 - s) / 2, (1 + s) / 2) if order == 0 else (-1 / size, 1 / size)
        for k in range(1, DEGREE):
            series = np.eye(DEGREE + 1)[k]
            value = legendre.legval(s, legendre.legint(series, lbnd=-1) if order == 0 else series)
            found[at, count + 1 + piece * (DEGREE - 1) + k - 1] = value * (2 / size) ** order
        return found


def peak_by_galerkin(plate: Plate) -> dict[str, Estimate]:
    """Values by Galerkin's method; its largest displacement is that at the lines, one of which is the top."""
    first, second = Line(plate.along.lines), Line(plate.across.lines)
    (x, wx), (y, wy) = first.rule, second.rule
    (x0, x1), (y0, y1) = ([line.table(at, k) for k in (0, 1)] for line, at in ((first, x), (second, y)))
    mx, kx, cx = (a.T @ (wx[:, None] * b) for a, b in ((x0, x0), (x1, x1), (x0, x1)))
    my, ky, cy = (a.T @ (wy[:, None] * b) for a, b in ((y0, y0), (y1, y1), (y0, y1)))
    uu = sparse.kron(kx, my) + sparse.kron(mx, ky) / 2
    vv = sparse.kron(mx, ky) + sparse.kron(kx, my) / 2
    uv = sparse.kron(cx, cy.T) / 2  # of u,y and v,x
    matrix = (STIFFNESS * sparse.bmat([[uu, uv], [uv.T, vv]])).tocsr()
    work = np.zeros((2, x0.shape[1], y0.shape[1]))
    for one, two, factor, component in ((2, 0, -1.0, 0), (0, 2, -0.5, 0), (1, 1, -0.5, 1)):
        given = np.outer(x0.T @ (wx * plate.along(x, one)), y0.T @ (wy * plate.across(y, two)))
        work[component] += STIFFNESS * HEIGHT * factor * given
    held = np.zeros(work.shape, dtype=bool)
    held[:, [0, len(first.ends) - 1]] = held[:, :, [0, len(second.ends) - 1]] = True  # hats at the rim
    free = np.flatnonzero(~held.ravel())
    q = np.zeros(work.size)
    q[free] = spsolve(matrix[free][:, free].tocsc(), work.ravel()[free])
    energy, (u, v) = float(q @ (matrix @ q)) / 2, q.reshape(work.shape)
    at_lines = [first.table(first.ends, 0) @ part @ second.table(second.ends, 0).T for part in (u, v)]
    one, two = np.array(plate.points).T
    along, across = first.table(one, 0), second.table(two, 0)
    at_points = [np.einsum("pi,ij,pj->p", along, part, across) for part in (u, v)]
    mean = float(np.mean(at_points[0] + 2 * at_points[1])) / 3
    return _estimates(float(np.linalg.norm(at_lines, axis=0).max()), mean, energy, AGREED)
