r"""The ring of the drape test by least energy: its round states, the folds it buckles into, and what becomes of them.

In a frame that turns with the angle theta the position is p_r e_r + p_t e_t + p_z e_z. A state of n folds that is its own
mirror image has

    p_r, p_z = sum over k of c_k(r) cos(k n theta),   p_t = sum over k of c_k(r) sin(k n theta),   k = 0 ... K,

with splines c_k of the radius. A round state has k = 0 alone; it buckles into n folds where the energy's second derivative by
c_1 ceases to be positive. Strains and their variations are those of `surface_strains`; forces and moments do not occur.

A minimum is sought by Newton's method with K + s K0, K0 the stiffness of the flat ring, s as small as it may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh
from scipy.optimize import brentq

from .cusick import BENDING, INNER, MEMBRANE, OUTER, POISSON, UNITS, Round, by_collocation, values, weight
from .estimate import Estimate
from .surface_strains import Array, first_variation, second_variation, strains

DEGREE = 5
DECREMENT, NEWTON_STEPS = 1e-15, 300
FIRST_SHIFT = 1e-4
END = 0.015  # bending length, m, at the load factor 1
WAVE = 1e-3  # amplitude, m, of the first folds
FINE, COARSE = 16, 10
"""Knot spans."""


@dataclass(frozen=True)
class Ring:
    """Splines times harmonics: knot spans, folds, and harmonics beside the round part.

    Coefficients (functions, K + 1, 3) are those of p_r, p_t and p_z.
    """

    spans: int = FINE
    folds: int = 1
    harmonics: int = 0
    membrane: float = MEMBRANE

    @cached_property
    def knots(self) -> Array:
        """Knots along the radius."""
        inner = np.linspace(INNER, OUTER, self.spans + 1)
        return np.concatenate([[INNER] * DEGREE, inner, [OUTER] * DEGREE])

    @cached_property
    def _rule(self) -> tuple[Array, Array, Array]:
        """Radii (spans, points), angles, and weights (spans, points, angles), m^2, of all folds."""
        x, w = np.polynomial.legendre.leggauss(DEGREE + 1)
        half = (OUTER - INNER) / self.spans / 2
        r = INNER + half * (2 * np.arange(self.spans)[:, None] + 1 + x)
        count = 4 * self.harmonics + 4 if self.harmonics else 1
        angles = (np.arange(count) + 0.5) * np.pi / self.folds / count
        return r, angles, (half * w * r)[..., None] * np.full(count, 2 * np.pi / count)

    @cached_property
    def _tables(self) -> Array:
        """From the coefficients of a span to x,1 x,2 x,11 x,22 x,12: (spans, points, 15, functions K+1 3)."""
        r, angles, _ = self._rule
        spline = BSpline(self.knots, np.eye(self.spans + DEGREE), DEGREE)
        every = [spline(r.ravel(), nu=order).reshape(*r.shape, -1) for order in range(3)]
        radial = [np.stack([v[:, i : i + DEGREE + 1] for i, v in enumerate(e)]) for e in every]
        n = self.folds * np.arange(self.harmonics + 1)
        c, s = np.cos(np.outer(angles, n)), np.sin(np.outer(angles, n))
        around = [np.stack(f, -1) for f in ((c, s, c), (-n * s, n * c, -n * s), (-n * n * c, -n * n * s, -n * n * c))]
        same, turn = np.eye(3), np.zeros((3, 3))
        turn[1, 0], turn[0, 1] = 1, -1  # e_r' = e_t, e_t' = -e_r
        parts = (
            ((1, 0, same),),
            ((0, 1, same), (0, 0, turn)),
            ((2, 0, same),),
            ((0, 2, same), (0, 1, 2 * turn), (0, 0, turn @ turn)),
            ((1, 1, same), (1, 0, turn)),
        )
        vectors = [sum(np.einsum("eqf,akc,dc->eqadfkc", radial[i], around[j], m) for i, j, m in p) for p in parts]
        return np.stack(vectors, axis=3).reshape(self.spans, -1, 15, 3 * (DEGREE + 1) * (self.harmonics + 1))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the coefficients."""
        return self.spans + DEGREE, self.harmonics + 1, 3

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        numbers = np.arange(np.prod(self.shape)).reshape(self.shape)
        return np.stack([numbers[i : i + DEGREE + 1].ravel() for i in range(self.spans)])

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Coefficients that the clamp leaves free, without those of sin 0: it holds the slope, not the stretch."""
        free = np.ones(self.shape, bool)
        free[0] = False
        free[1, :, 2] = False
        free[:, 0, 1] = False
        return free.ravel()

    @cached_property
    def flat(self) -> Array:
        """Coefficients of the ring at rest."""
        c = np.zeros(self.shape)
        c[:, 0, 0] = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], DEGREE).mean(axis=1)
        return c.ravel()

    @cached_property
    def _stiffness(self) -> Array:
        """(2, spans, points, 3, 3) from strains to forces, and from bending strains to moments."""
        r, _, weights = self._rule
        by = np.broadcast_to(r[..., None], weights.shape).reshape(self.spans, -1)
        scale = np.stack([np.ones_like(by), by**-2, 1 / by], -1)
        plane = np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, (1 - POISSON) / 2]])
        moduli = scale[..., :, None] * plane * scale[..., None, :] * weights.reshape(self.spans, -1)[..., None, None]
        return np.stack([self.membrane * moduli, BENDING * moduli])

    @cached_property
    def _rest(self) -> Array:
        return strains(self._vectors(self.flat))

    @cached_property
    def _down(self) -> Array:
        """Derivative of the volume that the ring sinks by, m^2, by the coefficients."""
        r, _, weights = self._rule
        spline = BSpline(self.knots, np.eye(self.spans + DEGREE), DEGREE)
        down = np.zeros(self.shape)
        down[:, 0, 2] = -np.einsum("eqf,eq->f", spline(r.ravel()).reshape(*r.shape, -1), weights.sum(-1))
        return down.ravel()

    def _vectors(self, c: Array) -> Array:
        return np.einsum("epxf,ef->epx", self._tables, c[self._numbers]).reshape(self.spans, -1, 5, 3)

    def energies(self, c: Array) -> tuple[float, float]:
        """Return membrane and bending energy, J."""
        e = strains(self._vectors(c)) - self._rest
        membrane, bending = (
            float(np.einsum("epi,epij,epj->", part, s, part)) / 2
            for part, s in zip((e[..., :3], e[..., 3:]), self._stiffness, strict=True)
        )
        return membrane, bending

    def potential(self, c: Array, w: float) -> float:
        """Return the energy less the work of the weight w, J."""
        return sum(self.energies(c)) - w * float(self._down @ c)

    def derivatives(self, c: Array, w: float) -> tuple[Array, Array]:
        """Return the first and the second derivatives of the potential by all coefficients."""
        x = self._vectors(c)
        e, by = first_variation(x)
        e, by = e - self._rest, by.reshape(*by.shape[:3], 15)
        moduli = np.zeros((*e.shape, 6))
        moduli[..., :3, :3], moduli[..., 3:, 3:] = self._stiffness
        stress = np.einsum("epij,epj->epi", moduli, e)
        slope = np.einsum("epi,epix->epx", stress, by)
        form = second_variation(x, stress).reshape(*x.shape[:2], 15, 15) + np.swapaxes(by, 2, 3) @ (moduli @ by)
        gradient, matrix = -w * self._down, np.zeros((c.size, c.size))
        for numbers, table, g, h in zip(self._numbers, self._tables, slope, form, strict=True):
            rows = table.reshape(-1, table.shape[-1])
            gradient[numbers] += rows.T @ g.ravel()
            matrix[np.ix_(numbers, numbers)] += rows.T @ (h @ table).reshape(rows.shape)
        return gradient, matrix

    @cached_property
    def _at_rest(self) -> Array:
        return self.derivatives(self.flat, 0.0)[1][np.ix_(self.free, self.free)]

    def minimum(self, c: Array, w: float) -> Array:
        """Return the coefficients of least potential near c; ArithmeticError if none is found."""
        f, shift, least = self.free, 0.0, self.potential(c, w)
        for _ in range(NEWTON_STEPS):
            gradient, matrix = self.derivatives(c, w)
            gradient, matrix = gradient[f], matrix[np.ix_(f, f)]
            while True:
                try:
                    step = -cho_solve(cho_factor(matrix + shift * self._at_rest), gradient)
                except LinAlgError:
                    shift = max(4 * shift, FIRST_SHIFT)
                    continue
                tried = c.copy()
                tried[f] += step
                now = self.potential(tried, w)
                if now <= least + 1e-13 * abs(least) or -(gradient @ step) < 1e-12 * abs(least):
                    break
                shift = max(4 * shift, FIRST_SHIFT)
            c, least = tried, now
            if -(gradient @ step) < DECREMENT * abs(least) and shift < FIRST_SHIFT:
                return c
            shift = shift / 6 if shift > FIRST_SHIFT**2 else 0.0
        raise ArithmeticError(f"no minimum with {self.folds} folds at a weight of {w:g} N/m^2")

    def lifted(self, c: Array) -> Array:
        """Return these coefficients of fewer harmonics, the others zero."""
        given = c.reshape(self.shape[0], -1, 3)
        lifted = np.zeros(self.shape)
        lifted[:, : given.shape[1]] = given
        return lifted.ravel()

    def softest(self, c: Array, w: float) -> tuple[float, Array]:
        """Return the least eigenvalue of K by K0 in the first harmonic of a round state, and its wave in all of c."""
        mask = np.zeros(self.shape, bool)
        mask[:, 1] = self.free.reshape(self.shape)[:, 1]
        at = mask.ravel()[self.free]
        matrix = self.derivatives(c, w)[1][np.ix_(self.free, self.free)]
        found, vectors = eigh(matrix[np.ix_(at, at)], self._at_rest[np.ix_(at, at)], subset_by_index=[0, 0])
        wave = np.zeros(c.size)
        wave[mask.ravel()] = vectors[:, 0]
        return float(found[0]), wave / np.abs(wave).max()

    def positions(self, c: Array, radii: int = 121, angles: int = 361) -> tuple[Array, Array, Array]:
        """Return distance from the axis, m, angle and height, m, (radii, angles) on half of a fold."""
        spline = BSpline(self.knots, np.eye(self.shape[0]), DEGREE)(np.linspace(INNER, OUTER, radii))
        theta, n = np.linspace(0, np.pi / self.folds, angles), self.folds * np.arange(self.shape[1])
        v = np.einsum("rf,fkc->rkc", spline, c.reshape(self.shape))
        cosine, sine = np.cos(np.outer(n, theta)), np.sin(np.outer(n, theta))
        out, along, up = v[..., 0] @ cosine, v[..., 1] @ sine, v[..., 2] @ cosine
        return np.hypot(out, along), theta + np.arctan2(along, out), up

    def coefficient(self, c: Array) -> float:
        """Return the drape coefficient: the outline is the largest distance in each direction; no line turns back."""
        distance, angle, _ = self.positions(c)
        rays = np.linspace(0, np.pi / self.folds, 2001)
        outline = np.max([np.interp(rays, a, d) for a, d in zip(angle, distance, strict=True)], axis=0)
        area = np.trapezoid(outline**2, rays) * self.folds / np.pi
        return float((area - INNER**2) / (OUTER**2 - INNER**2))


def round_path(ring: Ring, lengths: Sequence[float]) -> Iterator[Array]:
    """Yield the round states at falling bending lengths, m, stable or not."""
    c = ring.flat
    for length in lengths:
        c = ring.minimum(c, weight(length))
        yield c


def buckling_length(folds: int, spans: int = FINE, membrane: float = MEMBRANE, low: float = 0.02) -> float:
    """Return the bending length, m, at which the round ring buckles into these folds."""
    plain, waved = Ring(spans, membrane=membrane), Ring(spans, folds, 1, membrane)

    def margin(length: float) -> float:
        (c,) = round_path(plain, [length])
        return waved.softest(waved.lifted(c), weight(length))[0]

    return float(brentq(margin, low, 0.25, xtol=1e-10))


def first_buckling(spans: int = FINE, membrane: float = MEMBRANE, low: float = 0.02) -> tuple[float, int]:
    """Return the longest bending length at which the ring buckles, m, and its folds."""
    return max((buckling_length(n, spans, membrane, low), n) for n in range(3, 8))


def folded_path(ring: Ring, lengths: Sequence[float]) -> Iterator[tuple[float, Array]]:
    """Yield bending length, m, and state of the ring's folds, from the first length at which it has buckled."""
    plain = Ring(ring.spans, membrane=ring.membrane)
    states: list[tuple[float, Array]] = []
    for length in lengths:
        w = weight(length)
        if not states:
            (even,) = round_path(plain, [length])
            start = ring.lifted(even)
            least, wave = ring.softest(start, w)
            if least > 0:
                continue
            start = start + WAVE * wave
        elif len(states) == 1:
            start = states[-1][1]
        else:  # along the chord of the last two
            (before, c), (now, d) = states[-2:]
            start = d + (d - c) * np.log(length / now) / np.log(now / before)
        states.append((length, ring.minimum(start, w)))
        yield states[-1]


def _round(ring: Ring, length: float) -> Round:
    (c,) = round_path(ring, [length])
    return Round(-float(c.reshape(ring.shape)[-1, 0, 2]), ring.coefficient(c), *ring.energies(c))


def cusick_drape_by_splines() -> dict[str, Estimate]:
    """Return the round states of cases/cusick_drape.toml by least energy."""
    fine, coarse = (values(_round(Ring(n), 0.1), _round(Ring(n), 0.12)) for n in (FINE, COARSE))
    return {
        name: Estimate.between(value, coarse[name], UNITS.get(name, "m"), 1e-10 * abs(value))
        for name, value in fine.items()
    }


def cusick_drape() -> dict[str, Estimate]:
    """Return the known values: round states by collocation, and the load factor of the first folds by splines."""
    fine, coarse = (END / first_buckling(n)[0] for n in (FINE, COARSE))
    return by_collocation() | {"buckling": Estimate.between(fine, coarse, "", 1e-9)}
