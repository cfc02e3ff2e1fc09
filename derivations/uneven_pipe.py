r"""A slice of a long pipe under a pressure that goes around it unevenly: a ring in plane strain.

With the outward displacement w, v along the circle, and D, B of the shell, `cylinder`'s strains leave

    N = D (v' + w) / R,   M = B (w'' - 2 v' - w) / R^2,   energy per length  int (N^2 / D + M^2 / B) R dt / 2.

The outward load f is a trigonometric polynomial on either half, with a kink where they meet, and has no harmonic 1.

- Harmonics: f = sum f_n cos(n t - a_n), and each is two equations for the amplitudes of v and w.
- Statics: the energy is stationary where N = c + 2 M / R and M'' + M = R^2 f - R c. From the forces, the displacement:
  w'' + w = R^2 M / B + 2 R N / D, v' = R N / D - w. Green's functions of the circle solve both, with no harmonic 1,

      y'' + y = g:  G(p) = ((pi - p) sin p - cos(p) / 2) / (2 pi),    y' = g:  H(p) = (pi - p) / (2 pi),    0 <= p <= 2 pi,

  and c is what closes the ring: v' has no mean. Each half is smooth: polynomials interpolate there, Gauss's rule integrates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss
from scipy.optimize import minimize_scalar

from .cylinder import Cylinder, strains_of_angular_harmonic
from .estimate import Estimate
from .surface_strains import Array

PIPE = Cylinder(radius=1.0, length=0.2, thickness=0.1, young=1e9, poisson=0.3)
PRESSURE = 4e5  # Pa
HALVES = ((-np.pi, 0.0), (0.0, np.pi))
POINTS = {  # theta, degrees, and direction
    "side_deflection": ((40.0, (1.0, 0.0, 1.0)),),
    "mean_oblique": ((-75.0, (1.0, 2.0, -2.0)), (100.0, (3.0, 0.0, 4.0)), (165.0, (0.0, -1.0, 1.0))),
}
HARMONICS = 400
NODES = 40
"""Of a half: of its polynomials, and of Gauss's rule."""

Around = Callable[[Array], Array]


def outward(t: Array) -> Array:
    """Return the load, Pa."""
    s, c = np.sin(t), np.cos(t)
    return np.asarray(PRESSURE * (-2 + np.where(s < 0, -s * (3 - 4 * s**2), -s * c * (6 - 35 * s**2 + 35 * s**4))))


@dataclass(frozen=True)
class Ring:
    """Displacements (w outward, v along) at angles, (2, n), m, and the energies of membrane and bending, J."""

    moved: Around
    energies: tuple[float, float]

    def values(self) -> dict[str, float]:
        """Return the values of the case."""
        found = {}
        for name, asked in POINTS.items():
            t = np.radians([degrees for degrees, _ in asked])
            (w, v), (c, s) = self.moved(t), (np.cos(t), np.sin(t))
            vectors = np.stack([w * c - v * s, 0 * t, w * s + v * c], -1)
            directions = [np.array(d) / np.linalg.norm(d) for _, d in asked]
            found[name] = float(np.mean(np.sum(vectors * directions, -1)))
        membrane, bending = self.energies
        energies = {"strain_energy": membrane + bending, "membrane_energy": membrane, "bending_energy": bending}
        return found | {"largest_displacement": self._largest()} | energies

    def _largest(self) -> float:
        t = np.linspace(-np.pi, np.pi, 721)
        sizes = np.linalg.norm(self.moved(t), axis=0)
        best, step = t[np.argmax(sizes)], t[1] - t[0]

        def drop(at: float) -> float:
            return float(-np.linalg.norm(self.moved(np.array([at]))) / sizes.max())

        # a parabola has its top to half the digits, and its value to all of them
        found = minimize_scalar(drop, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-9})
        return float(-found.fun * sizes.max())


def by_harmonics(count: int) -> Ring:
    """The ring by so many harmonics."""
    n = np.arange(count + 1)
    x, weights = leggauss(2 * count)
    half = np.pi / 2
    coefficients = sum(
        (half * weights * outward(t)) @ np.exp(1j * np.outer(t, n)) / np.pi
        for t in (low + half * (x + 1) for low, _ in HALVES)
    )
    coefficients[0] /= 2
    elasticity, amplitudes, energies = PIPE.elasticity(), np.zeros((2, count + 1), dtype=complex), [0.0, 0.0]
    for k in n[n != 1]:  # the first one is a force, which f has not
        strain = strains_of_angular_harmonic(PIPE.radius, int(k))[0][:, 1:]  # of (V, W) in V sin(k t), W cos(k t)
        parts = [strain.T @ c @ strain for c in elasticity]
        force = np.array([0.0, 1.0])
        unit = np.linalg.solve(sum(parts), force) if k else np.array([0.0, 1 / sum(parts)[1, 1]])
        amplitudes[:, k] = unit[::-1] * coefficients[k]
        mean = np.pi * (2.0 if k == 0 else 1.0)
        for which, part in enumerate(parts):
            energies[which] += mean * PIPE.radius * PIPE.length * abs(coefficients[k]) ** 2 * unit @ part @ unit / 2

    def moved(t: Array) -> Array:
        waves = np.exp(-1j * np.outer(n, t))  # of f_n exp(i a_n): the real part is cos(n t - a_n), v goes as the sine
        return np.stack([(amplitudes[0] @ waves).real, -(amplitudes[1] @ waves).imag])

    return Ring(moved, (energies[0], energies[1]))


def by_statics(nodes: int) -> Ring:
    """The ring by its forces, with so many nodes on either half."""
    r, membrane, bending = PIPE.radius, PIPE.membrane_stiffness, PIPE.bending_stiffness
    x, weights = leggauss(nodes)
    t = np.concatenate([low + np.pi / 2 * (x + 1) for low, _ in HALVES])
    whole = np.tile(np.pi / 2 * weights, 2)
    mean = float(whole @ outward(t)) / (2 * np.pi)
    c = mean * (r**4 / bending + 2 * r**2 / membrane) / (r**3 / bending + r / membrane)
    moment = _solved(_of_two, lambda s: r**2 * outward(s) - r * c, t)
    normal = c + 2 * moment / r
    w_of = _smooth(t, r**2 * moment / bending + 2 * r * normal / membrane)
    slope = _smooth(t, r * normal / membrane - _solved(_of_two, w_of, t))

    def moved(at: Array) -> Array:
        return np.stack([_solved(_of_two, w_of, at), _solved(_of_one, slope, at)])

    area = whole * r * PIPE.length / 2
    return Ring(moved, (float(area @ normal**2 / membrane), float(area @ moment**2 / bending)))


def _of_two(p: Array) -> Array:
    return np.asarray(((np.pi - p) * np.sin(p) - np.cos(p) / 2) / (2 * np.pi))


def _of_one(p: Array) -> Array:
    return np.asarray((np.pi - p) / (2 * np.pi))


def _smooth(t: Array, values: Array) -> Around:
    """Interpolate on either half."""
    halves = zip(np.split(t, 2), np.split(values, 2), HALVES, strict=True)
    lower, upper = (Legendre.fit(a, b, len(a) - 1, domain) for a, b, domain in halves)
    return lambda s: np.where(s < 0, lower(s), upper(s))


def _solved(green: Around, right: Around, at: Array) -> Array:
    """Integrate a Green's function times a right side, cut where either is not smooth."""
    x, weights = leggauss(NODES)
    cuts = np.sort(np.stack([np.full_like(at, -np.pi), 0 * at, np.full_like(at, np.pi), at]), axis=0)
    found = np.zeros_like(at)
    for low, high in pairwise(cuts):
        s = low + np.outer(x + 1, high - low) / 2
        found += (high - low) / 2 * (weights @ (green((at - s) % (2 * np.pi)) * right(s)))
    return found


def _estimates(fine: Ring, coarse: Ring) -> dict[str, Estimate]:
    values, rough = fine.values(), coarse.values()
    found = {}
    for name, value in values.items():
        energy = name.endswith("energy")
        rounding = 10 * PIPE.rounding * abs(values["strain_energy" if energy else "largest_displacement"])
        found[name] = Estimate.between(value, rough[name], "J" if energy else "m", rounding)
    return found


def uneven_pipe() -> dict[str, Estimate]:
    """Known values by harmonics; the uncertainty is the change from half of them."""
    return _estimates(by_harmonics(HARMONICS), by_harmonics(HARMONICS // 2))


def uneven_pipe_by_statics() -> dict[str, Estimate]:
    """Values by the forces; the uncertainty is the change from 3/4 of the nodes."""
    return _estimates(by_statics(NODES), by_statics(3 * NODES // 4))
