r"""Razzaque's skew plate by powers of its corners: the second form of `benchmark_shells` for it.

Every biharmonic function is Re(conj(z) f + g). Where a simply supported side meets a free one at the angle omega, w
goes like r^(l + 1) with the roots l of Williams (1952), (3 + nu) sin 2 l omega + (1 - nu) l sin 2 omega = 0, so that f
has the powers l and g the powers l + 1 of the complex distance from the corner. With these powers at all corners, and
polynomials, least squares on the rim converge exponentially; no energy is minimised.

Let w = C r^4 + Re(conj(z) f + g), C = q / (64 B), lap = 4 Re f' and P = w_xx - w_yy + 2 i w_xy = 2 (z conj(f'') +
conj(g'')) of the second part. At a straight side with the normal n = exp(i a):

- simply supported: w = 0 and the Laplacian is 0;
- free: M_nn = 0, that is (1 + nu) lap + (1 - nu) Re(P exp(-2 i a)) = 0; and V_n = 0, integrated along the side with
  d_n Re f' = d_s Im f': 4 Im f' + (1 - nu)/2 Im(P exp(-2 i a)) is constant, one constant a side.

The part C r^4 has the Laplacian 16 C r^2, P = 8 C z^2, and 32 C d s instead of 4 Im f': d is the distance of the side
from the centre, s the place along it. Second derivatives grow toward corners: their rows have the distance as weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .surface_strains import Array

ANGLE = np.pi / 3
HALF = 1 / np.sqrt(3)
"""Half a side, in units of half of the long diagonal."""
SIDES = ((1j, False), (-1j, False), (np.exp(-1j * np.pi / 6), True), (-np.exp(-1j * np.pi / 6), True))
"""Outward normals, and True for free sides."""
NEAREST, POINTS = 14.0, 400
"""Points of a side cluster toward its ends like tanh of so many units; how many they are."""


def corner_roots(omega: float, poisson: float, count: int) -> np.ndarray:
    """The first roots l with Re l > 0, by their real parts, with their conjugates: Newton's method from many places."""
    a, b = 3 + poisson, (1 - poisson) * np.sin(2 * omega)
    start = (np.linspace(0.3, 2.0 * count, 40 * count)[:, None] + 1j * np.array([0.0, 0.3, 0.6, 1.0])).ravel()
    for _ in range(60):
        step = (a * np.sin(2 * start * omega) + b * start) / (2 * omega * a * np.cos(2 * start * omega) + b)
        start = start - np.clip(step.real, -0.2, 0.2) - 1j * np.clip(step.imag, -0.2, 0.2)
    good = np.abs(a * np.sin(2 * start * omega) + b * start) < 1e-9 * np.abs(start)
    found = np.unique(np.round(start[good & (start.real > 0.01) & (start.imag > -1e-8)], 9))
    both = np.concatenate([found, np.conj(found[np.abs(found.imag) > 1e-8])])
    return both[np.argsort(both.real)][:count]


@dataclass(frozen=True)
class Trial:
    """Trial functions: a degree of polynomials, and how many roots each corner has."""

    degree: int
    roots: int
    poisson: float

    @cached_property
    def corners(self) -> np.ndarray:
        """The four corners, (4,) complex."""
        return np.array([p * HALF + q * HALF * np.exp(1j * ANGLE) for p in (-1, 1) for q in (-1, 1)])

    @cached_property
    def rim(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (N,) and unit normals, side by side."""
        t = HALF * np.tanh(np.linspace(-NEAREST, NEAREST, POINTS))
        up = np.exp(1j * ANGLE)
        places = [t + side * HALF * up for side in (1, -1)] + [t * up + side * HALF for side in (1, -1)]
        return np.concatenate(places), np.repeat([n for n, _ in SIDES], POINTS)

    @cached_property
    def _exponents(self) -> list[np.ndarray]:
        found = []
        for corner in self.corners:
            omega = ANGLE if abs(corner) > np.sin(ANGLE) else np.pi - ANGLE
            roots = corner_roots(omega, self.poisson, self.roots)
            found.append(np.unique(np.round(np.concatenate([roots, roots + 1]), 12)))
        return found

    def functions(self, z: np.ndarray) -> list[np.ndarray]:
        """Polynomials and powers at z, and their first and second derivatives, each (N, F)."""
        k, at = np.arange(self.degree + 1), z[:, None]
        parts = [(at**k, k * at ** np.maximum(k - 1, 0), k * (k - 1) * at ** np.maximum(k - 2, 0))]
        for corner, p in zip(self.corners, self._exponents, strict=True):
            axis = -corner / abs(corner)  # the cut of the powers lies outside
            d = (at - corner) / axis
            parts.append((d**p, p * d ** (p - 1) / axis, p * (p - 1) * d ** (p - 2) / axis**2))
        return [np.hstack(part) for part in zip(*parts, strict=True)]

    def deflection(self, z: np.ndarray) -> Array:
        """Real trial functions Re(conj(z) f) and Re g, (N, J)."""
        f = self.functions(z)[0]
        return np.hstack([part.real for unit in (1.0, 1j) for part in (np.conj(z)[:, None] * unit * f, unit * f)])

    def second(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """4 f' and P of the trial functions, (N, J) complex."""
        _, slope, curved = self.functions(z)
        first = [part for unit in (1.0, 1j) for part in (4 * unit * slope, 0 * slope)]
        other = [
            2 * part for unit in (1.0, 1j) for part in (z[:, None] * np.conj(unit * curved), np.conj(unit * curved))
        ]
        return np.hstack(first), np.hstack(other)

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients for C = 1.

        1. Rows of both conditions of each side, for the trial functions and for r^4.
        2. Columns of the constants of the free sides.
        3. Least squares, columns scaled to length one.
        """
        z, normal = self.rim
        slope, deviator = self.second(z)
        turned, of_square = deviator * normal[:, None] ** -2, 8 * z**2 * normal**-2
        nu, square = self.poisson, np.abs(z) ** 2
        distance, along = (np.conj(normal) * z).real, (np.conj(1j * normal) * z).real
        weight = np.abs(z[:, None] - self.corners).min(axis=1)
        free = np.repeat([is_free for _, is_free in SIDES], POINTS)
        moment = (1 + nu) * slope.real + (1 - nu) * turned.real, (1 + nu) * 16 * square + (1 - nu) * of_square.real
        force = slope.imag + (1 - nu) / 2 * turned.imag, 32 * distance * along + (1 - nu) / 2 * of_square.imag
        constants = -np.repeat(np.eye(len(SIDES))[:, 2:], POINTS, axis=0)
        none = 0 * constants
        blocks = (
            (self.deflection(z), square**2, none, ~free),
            (weight[:, None] * slope.real, weight * 16 * square, none, ~free),
            (weight[:, None] * moment[0], weight * moment[1], none, free),
            (weight[:, None] * force[0], weight * force[1], weight[:, None] * constants, free),
        )
        rows = np.vstack([np.hstack([matrix, more])[where] for matrix, _, more, where in blocks])
        right = -np.concatenate([known[where] for _, known, _, where in blocks])
        size = np.linalg.norm(rows, axis=0)
        size[size == 0.0] = 1.0
        return np.asarray(np.linalg.lstsq(rows / size, right, rcond=1e-15)[0] / size)[: -len(none[0])]


def skew_plate(side: float, thickness: float, young: float, pressure: float, trial: Trial) -> dict[str, float]:
    """Values of the plate under a pressure downward: m, J and Pa."""
    nu, q = trial.poisson, trial.coefficients
    bending = young * thickness**3 / (12 * (1 - nu**2))
    unit, scale = side / 2 / HALF, pressure / (64 * bending)

    def down(z: np.ndarray) -> Array:
        return np.asarray(scale * unit**4 * (np.abs(z) ** 4 + trial.deflection(z) @ q))

    # The lower face is pulled where the plate sags: 6 B / h^2 times the curvature, along principal axes.
    slope, deviator = (part[0] @ q for part in trial.second(np.zeros(1, complex)))
    both = [
        -3 * bending / thickness**2 * scale * unit**2 * ((1 + nu) * slope.real + s * (1 - nu) * abs(deviator))
        for s in (-1, 1)
    ]
    first, second = max(both), min(both)
    t, w = _panels()
    places = HALF * (t[:, None] + np.exp(1j * ANGLE) * t).ravel()
    area = (side / 2) ** 2 * np.sin(ANGLE) * np.outer(w, w).ravel()
    return {
        "centre_deflection": float(down(np.zeros(1, complex))[0]),
        "free_edge_deflection": float(down(np.array([-HALF + 0j]))[0]),
        "strain_energy": float(pressure * area @ down(places) / 2),
        "centre_stress": float(first),
        "centre_equivalent_stress": float(np.sqrt(first**2 - first * second + second**2)),
    }


def _panels() -> tuple[Array, Array]:
    """Points and weights on [-1, 1], on panels that shrink toward both ends."""
    toward = 0.25 ** np.arange(5)
    ends = np.unique(np.concatenate([[-1.0, 1.0], -1 + toward, 1 - toward]))
    t, w = np.polynomial.legendre.leggauss(10)
    half = np.diff(ends) / 2
    return (ends[:-1, None] + half[:, None] * (1 + t)).ravel(), np.outer(half, w).ravel()
