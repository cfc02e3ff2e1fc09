r"""Pinched cylinder with free ends: Fourier series around, Legendre-Ritz along the axis.

Two opposite inward point loads P at mid-length, no support. With t measured from a load and x from
mid-length, only even n are loaded; u = U_n(x) cos(n t), v = V_n(x) sin(n t), w = W_n(x) cos(n t)
on half the length, x in [0, L/2]. Symmetry: U = 0 and W' = 0 at x = 0; the far end is free, the
natural condition of the energy. The load on a harmonic is a line load P e_n / (pi R) at x = 0
(e_0 = 1, e_n = 2), and each does the work 2 P W_n(0) over both loads. Rigid motions of the cylinder
have n = 0 (axial shift and turn, both excluded by symmetry) or n = 1: this solution is L2-orthogonal
to all of them, and its displacement under either load is the mean of the two.

Near a point load a shell bends like a plate, so that W_n(0) -> P R^2 / (2 pi B n^3)
(1 + O((h/R)^2)), the coefficient from int dalpha / (2 pi) (alpha^2 + k^2)^-2 = 1 / (4 k^3) with
k = n / R; corrections go in powers of n^-2. The tail is fitted with that rate and summed.

The same solution with V = W = 0 held at x = L/2 is a second form of the diaphragm case.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cylinder import Cylinder, strains_of_angular_harmonic
from .estimate import Estimate, algebraic_series_sum
from .pinched_diaphragm import LOAD, pinched_cylinder, pinched_estimates
from .strip import Strip

MID_LENGTH = ("U(left)", "W'(left)")
FREE_END: tuple[str, ...] = ()
DIAPHRAGM_END = ("V(right)", "W(right)")
TAIL_POWER = 3


@dataclass(frozen=True)
class PinchedSeries:
    """One row a harmonic n: Ritz coefficients, inward W_n(0) in m, membrane energies in J."""

    cylinder: Cylinder
    strip: Strip
    n: np.ndarray
    coefficients: np.ndarray
    load_displacements: np.ndarray
    membrane_energies: np.ndarray

    def displacement(self, x: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Truncated series of (u, v, w), w outward, in m, (len(x), len(t), 3); x >= 0."""
        amplitudes = np.einsum("pcj,nj->pnc", self.strip.basis(x)[0], self.coefficients)
        phase = np.asarray(t, float)[:, None] * self.n
        shapes = np.stack([np.cos(phase), np.sin(phase), np.cos(phase)], axis=-1)
        return np.einsum("xnc,tnc->xtc", amplitudes, shapes)

    def totals(self) -> tuple[float, float]:
        """Inward displacement under a load and membrane energy, summed to infinity."""
        return tuple(
            float(terms[0]) + algebraic_series_sum(self.n[1:], terms[1:], TAIL_POWER)
            for terms in (self.load_displacements, self.membrane_energies)
        )


def solve_pinched(cylinder: Cylinder, far_end: tuple[str, ...], last_harmonic: int, degree: int) -> PinchedSeries:
    """Solve the even harmonics up to the last one with Legendre-Ritz functions of the degree."""
    strip = Strip(0.0, cylinder.length / 2.0, degree)
    parts = cylinder.elasticity()
    even = np.arange(0, last_harmonic + 1, 2)
    load = np.zeros(3 * (degree + 1))
    load[strip.end_coefficient("W(left)")] = -2.0 * LOAD
    coefficients, membrane_energies = [], []
    for n in even:
        strains = strains_of_angular_harmonic(cylinder.radius, int(n))
        # Two halves of the length; R int cos^2 dt around.
        factor = 2.0 * cylinder.radius * np.pi * (2.0 if n == 0 else 1.0)
        stiffnesses = [factor * k for k in strip.stiffnesses(strains, parts)]
        # Axisymmetric torsion is unloaded and would leave the turn about the axis undetermined.
        no_turn = ("V(left)",) if n == 0 and "V(right)" not in far_end else ()
        q = strip.minimise(sum(stiffnesses), load, (*MID_LENGTH, *no_turn, *far_end))
        coefficients.append(q)
        membrane_energies.append(0.5 * q @ stiffnesses[0] @ q)
    coefficients = np.array(coefficients)
    inward = -coefficients[:, strip.end_coefficient("W(left)")]
    return PinchedSeries(cylinder, strip, even, coefficients, inward, np.array(membrane_energies))


def _summed(far_end: tuple[str, ...], last_harmonic: int, degree: int) -> dict[str, Estimate]:
    """Known values with that far end; the uncertainty is the change from 2/3 of harmonics and degree, both summed."""
    cylinder = pinched_cylinder()
    levels = (last_harmonic, degree), (2 * last_harmonic // 3, 2 * degree // 3)
    fine, coarse = (solve_pinched(cylinder, far_end, harmonic, p).totals() for harmonic, p in levels)
    return pinched_estimates(cylinder, fine, coarse)


def pinched_cylinder_free(last_harmonic: int = 160, degree: int = 64) -> dict[str, Estimate]:
    """Known values of the free cylinder.

    The largest abs(u) is the displacement under a load (the test looks for a larger one).
    """
    return _summed(FREE_END, last_harmonic, degree)


def diaphragm_by_polynomials(last_harmonic: int = 160, degree: int = 64) -> dict[str, Estimate]:
    """Values of the cylinder between diaphragms: the second form of `pinched_diaphragm`."""
    return _summed(DIAPHRAGM_END, last_harmonic, degree)
