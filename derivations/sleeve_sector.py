r"""The thin sleeve twisted beyond buckling, by splines on one sector: the second origin of `sleeve_path.thin_states`.

A state with n waves repeats itself n times around the sleeve. On a sector of angle 2 pi / n the position is

    x = p_r e_r(theta) + p_y e_y + p_t e_t(theta),

with p periodic in theta: B-splines around and along, in a frame that does not turn with the rims. A rim is turned as
a whole: its coefficients are prescribed, and those next to them are free along the axis and along the turned tangent,
so that the normal turns with the rim. Energy and gradient are written from positions, their second derivatives come
from complex steps. No function, mechanics, start or condition of phase is shared with `sleeve` and `sleeve_path`.

A minimum is sought by Newton's method with K + s K0, K0 the stiffness at rest. s stays above `FLOOR`: waves move freely
around the sleeve, so that K alone is all but singular at each state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from .estimate import Estimate
from .surface_strains import Array

RADIUS, LENGTH, THICKNESS, YOUNG, POISSON = 0.25, 1.0, 0.0012, 5000.0, 0.25
WAVES = 8
FLOOR, FIRST_SHIFT = 1e-6, 1e-2
"""Least shift, a thousandth of the softest stable mode's stiffness beyond buckling, and the one first tried."""
DECREMENT = 1e-16
"""Promised decrease of the energy, as a fraction of it, at which a minimum is accepted."""
NEWTON_STEPS = 300
COMPLEX_STEP = 1e-30
DENT, SLANT = 2.0, 6.0
"""Depth of the first dents, in thicknesses, and their slant, rad of phase along the sleeve."""


@dataclass(frozen=True)
class Sector:
    """Splines on a sector: knot spans around and along, and their degree.

    Coefficients are numbered by place around, place along, and component (radial, axial, tangential).
    """

    around: int
    along: int
    degree: int = 4
    waves: int = WAVES

    @cached_property
    def _sides(self) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array]]:
        """For each direction, points (spans, points), weights, and derivatives (3 orders, spans, points, functions)."""
        angle = 2 * np.pi / self.waves
        knots = np.asarray(angle / self.around * np.arange(-self.degree, self.around + self.degree + 1.0))
        return self._side(knots), self._side(self._knots)

    @cached_property
    def _knots(self) -> Array:
        """Knots along the sleeve, twice as dense at its rims as half way."""
        s = np.linspace(-1, 1, self.along + 1)
        inner = LENGTH / 2 * (s + np.sin(np.pi * s) / (3 * np.pi))
        return np.concatenate([[inner[0]] * self.degree, inner, [inner[-1]] * self.degree])

    def _side(self, knots: Array) -> tuple[Array, Array, Array]:
        p = self.degree
        breaks = knots[p : len(knots) - p]
        x, w = np.polynomial.legendre.leggauss(p + 1)
        half = np.diff(breaks)[:, None] / 2
        points = breaks[:-1, None] + half * (1 + x)
        spline = BSpline(knots, np.eye(len(knots) - p - 1), p)
        values = []
        for order in range(3):
            every = spline(points.ravel(), nu=order).reshape(*points.shape, -1)
            values.append(np.stack([v[:, i : i + p + 1] for i, v in enumerate(every)]))
        return points, half * w, np.stack(values)

    @property
    def rows(self) -> int:
        """Coefficients along the sleeve."""
        return self.along + self.degree

    @property
    def size(self) -> int:
        """All coefficients, the prescribed ones as well."""
        return 3 * self.around * self.rows

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """Numbers of the coefficients of each cell, (cells, functions, 3)."""
        own = np.arange(self.degree + 1)
        one = (np.arange(self.around)[:, None] + own) % self.around
        two = np.arange(self.along)[:, None] + own
        places = one[:, None, :, None] * self.rows + two[None, :, None, :]
        return 3 * places.reshape(self.around * self.along, -1, 1) + np.arange(3)

    @cached_property
    def _weights(self) -> Array:
        """Area of all sectors at the points of each cell."""
        (_, one, _), (_, two, _) = self._sides
        area = self.waves * RADIUS * np.einsum("ip,jq->ijpq", one, two)
        return np.asarray(area.reshape(self.around * self.along, -1))

    @cached_property
    def _tables(self) -> Array:
        """From the coefficients of a cell to x,1 x,2 x,11 x,22 x,12: (cells, points, 15, 3 functions)."""
        (_, _, one), (_, _, two) = self._sides
        cells = self.around * self.along

        def products(a: int, b: int) -> Array:
            return np.asarray(np.einsum("ipm,jqn->ijpqmn", one[a], two[b]).reshape(cells, (self.degree + 1) ** 2, -1))

        # e_r' = e_t and e_t' = -e_r.
        same = np.eye(3)
        turn = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        parts = (
            ((1, 0, same), (0, 0, turn)),
            ((0, 1, same),),
            ((2, 0, same), (1, 0, 2 * turn), (0, 0, turn @ turn)),
            ((0, 2, same),),
            ((1, 1, same), (0, 1, turn)),
        )
        vectors = [sum(np.einsum("cpf,de->cpdfe", products(a, b), m) for a, b, m in terms) for terms in parts]
        return np.stack(vectors, axis=2).reshape(*vectors[0].shape[:2], 15, -1)

    def rest(self) -> Array:
        """Coefficients of the sleeve at rest, (around, rows, 3): splines reproduce the axial coordinate."""
        c = np.zeros((self.around, self.rows, 3))
        c[..., 0], c[..., 1] = RADIUS, self._greville
        return c

    @cached_property
    def _greville(self) -> Array:
        inner = np.lib.stride_tricks.sliding_window_view(self._knots[1:-1], self.degree)
        return np.asarray(inner.mean(axis=1))

    def dented(self, twist: float) -> Array:
        """Coefficients of a cylinder in pure torsion, with slanting dents."""
        c = self.rest()
        g = self._greville
        theta = 2 * np.pi / self.waves * (np.arange(self.around)[:, None] - (self.degree - 1) / 2) / self.around
        dents = DENT * THICKNESS * np.cos(self.waves * theta + SLANT * g / LENGTH) * np.cos(np.pi * g / LENGTH) ** 2
        turned = twist * g / LENGTH
        c[..., 0], c[..., 2] = RADIUS * np.cos(turned) + dents, RADIUS * np.sin(turned)
        return c

    def held(self, c: Array, twist: float) -> Array:
        """Coefficients with both rims turned by half of a twist, and their normals with them."""
        c = c.copy()
        for end, beside, half, y in ((0, 1, -twist / 2, -LENGTH / 2), (-1, -2, twist / 2, LENGTH / 2)):
            out = np.array([np.cos(half), 0.0, np.sin(half)])
            c[:, end] = RADIUS * out + [0.0, y, 0.0]
            c[:, beside] += (RADIUS - c[:, beside] @ out)[:, None] * out
        return c

    def freedom(self, twist: float) -> Array:
        """Orthonormal matrix from free numbers to changes of all coefficients, (size, free)."""
        axes = np.zeros((self.rows, 3, 3))
        axes[1:-1] = np.eye(3)
        for beside, half in ((1, -twist / 2), (-2, twist / 2)):
            out = np.array([np.cos(half), 0.0, np.sin(half)])
            axes[beside] = np.array([0.0 * out, [0.0, 1.0, 0.0], [-out[2], 0.0, out[0]]]).T
        columns = [np.kron(np.eye(self.rows)[:, [k]], a[:, np.any(a, axis=0)]) for k, a in enumerate(axes)]
        return np.asarray(np.kron(np.eye(self.around), np.concatenate(columns, axis=1)), dtype=np.float64)

    def _vectors(self, c: Array) -> Array:
        local = c.ravel()[self._numbers].reshape(len(self._numbers), -1)
        return np.asarray(np.einsum("cpkf,cf->cpk", self._tables, local))

    def energies(self, c: Array) -> tuple[float, float]:
        """Membrane and bending energy, J."""
        membrane, bending, _ = densities(self._vectors(c))
        return float(np.sum(self._weights * membrane)), float(np.sum(self._weights * bending))

    def gradient(self, c: Array) -> Array:
        """Derivative of the energy by all coefficients, (size,)."""
        pull = densities(self._vectors(c))[2] * self._weights[..., None]
        local = np.einsum("cpkf,cpk->cf", self._tables, pull)
        total = np.zeros(self.size)
        np.add.at(total, self._numbers.reshape(len(local), -1), local)
        return total

    def stiffness(self, c: Array) -> Array:
        """Second derivative of the energy by all coefficients, (size, size)."""
        x = self._vectors(c)
        steps = x[..., None, :] + 1j * COMPLEX_STEP * np.eye(15)
        inner = densities(steps)[2].imag / COMPLEX_STEP * self._weights[..., None, None]
        total = np.zeros((self.size, self.size))
        for numbers, table, block in zip(self._numbers.reshape(len(x), -1), self._tables, inner, strict=True):
            local = np.tensordot(table, block @ table, axes=([0, 1], [0, 1]))
            total[np.ix_(numbers, numbers)] += local  # no cell has a coefficient twice if around > degree
        return total

    def torque(self, c: Array) -> float:
        """Derivative of the energy by a turn of the upper rim: its coefficients and those beside it, N m."""
        pull = self.gradient(c).reshape(c.shape)[:, -2:]
        return float(np.sum(c[:, -2:, 0] * pull[..., 2] - c[:, -2:, 2] * pull[..., 0]))


def densities(x: Array) -> tuple[Array, Array, Array]:
    """Membrane and bending energy per area at rest, and the derivative of their sum by the five vectors.

    x is (..., 15), real or complex; the derivative as well. With lengths along theta in units of the radius,
    eps = (a - 1) / 2, kappa = bbar - b and n = x,1 cross x,2 / J (inward), dW = N : deps - M : db, and db_ab has

        dn . x,ab = (dx,1 cross x,2 + x,1 cross dx,2) . (x,ab - b_ab n) / J.
    """
    stretching = YOUNG * THICKNESS / (1 - POISSON**2)
    bending = stretching * THICKNESS**2 / 12
    a1, a2, b11, b22, b12 = (x[..., 3 * k : 3 * k + 3] / r for k, r in enumerate((RADIUS, 1, RADIUS**2, 1, RADIUS)))
    c = np.cross(a1, a2)
    area = np.sqrt(_dot(c, c))
    n = c / area[..., None]
    e11, e22, e12 = (_dot(a1, a1) - 1) / 2, (_dot(a2, a2) - 1) / 2, _dot(a1, a2) / 2
    k11, k22, k12 = 1 / RADIUS - _dot(b11, n), -_dot(b22, n), -_dot(b12, n)

    def stress(s11: Array, s22: Array, s12: Array, factor: float) -> tuple[Array, Array, Array]:
        return factor * (s11 + POISSON * s22), factor * (s22 + POISSON * s11), factor * (1 - POISSON) * s12

    n11, n22, n12 = stress(e11, e22, e12, stretching)
    m11, m22, m12 = stress(k11, k22, k12, bending)
    membrane = (n11 * e11 + n22 * e22 + 2 * n12 * e12) / 2
    bent = (m11 * k11 + m22 * k22 + 2 * m12 * k12) / 2
    lever = _times(m11, b11) + _times(m22, b22) + 2 * _times(m12, b12)
    lever = _times(1 / area, lever - _times(_dot(lever, n), n))
    by = (
        _times(n11, a1) + _times(n12, a2) - np.cross(a2, lever),
        _times(n22, a2) + _times(n12, a1) - np.cross(lever, a1),
        -_times(m11, n),
        -_times(m22, n),
        -2 * _times(m12, n),
    )
    slope = np.concatenate([v / r for v, r in zip(by, (RADIUS, 1, RADIUS**2, 1, RADIUS), strict=True)], axis=-1)
    return membrane, bent, slope


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def _times(scalar: Array, vector: Array) -> Array:
    return np.asarray(scalar[..., None] * vector)


def minimum(sector: Sector, c: Array, twist: float) -> Array:
    """Return the coefficients of the stable state downhill of the given ones, at a twist in rad.

    Raises
    ------
    ArithmeticError : no minimum is reached
    """
    free, c = sector.freedom(twist), sector.held(c, twist)
    at_rest = free.T @ sector.stiffness(sector.rest()) @ free
    energy, shift = sum(sector.energies(c)), FIRST_SHIFT
    for _ in range(NEWTON_STEPS):
        stiffness, residual = free.T @ sector.stiffness(c) @ free, free.T @ sector.gradient(c)
        while True:
            try:
                factor = cho_factor(stiffness + shift * at_rest)
            except LinAlgError:
                shift *= 4
                continue
            step = -cho_solve(factor, residual)
            promised = -residual @ step
            moved = c + (free @ step).reshape(c.shape)
            reached = sum(sector.energies(moved))
            if promised <= DECREMENT * energy and shift <= FLOOR:
                return np.asarray(moved)
            if reached <= energy - 1e-4 * promised or promised <= 1e-12 * energy:
                break
            shift *= 4
        c, energy, shift = moved, reached, max(FLOOR, shift / 4)
    raise ArithmeticError("no stable state found")


# --- estimates -----------------------------------------------------------------------------------

MILLIRADIANS = (6, 8, 10)
FINE, COARSE = (10, 40), (8, 28)
"""Spans around and along."""
ROUNDING = 1e-9


def states(sector: Sector, twists: Sequence[float]) -> list[Array]:
    """Return the coefficients of the stable states at ascending twists, the first beyond the critical one."""
    found = [sector.dented(twists[0])]
    for twist in twists:
        found.append(minimum(sector, found[-1], twist))
    return found[1:]


def sleeve_twist_thin_buckled_by_splines() -> dict[str, Estimate]:
    """Second origin of the torques of sleeve_twist_thin_buckled, N m, and of its energies, J."""
    twists = [m / 1000 for m in MILLIRADIANS]
    sectors = [Sector(*spans) for spans in (FINE, COARSE)]
    levels = [states(sector, twists) for sector in sectors]
    values = {}
    for place, name in enumerate(MILLIRADIANS):
        fine, coarse = (_values(sector, found[place]) for sector, found in zip(sectors, levels, strict=True))
        for quantity, value in fine.items():
            unit = "N m" if quantity == "torque" else "J"
            values[f"{quantity}_{name}mrad"] = Estimate.between(value, coarse[quantity], unit, ROUNDING * abs(value))
    return values


def _values(sector: Sector, c: Array) -> dict[str, float]:
    membrane, bending = sector.energies(c)
    return {"torque": sector.torque(c), "strain_energy": membrane + bending, "bending_energy": bending}
