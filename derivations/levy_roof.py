r"""Scordelis-Lo roof: Fourier series along the axis, Legendre-Ritz across it (a Levy-type solution).

The roof hangs between rigid diaphragms (v = w = 0 at x = 0, L; u free), which

    u = sum U_m(t) cos(alpha_m x),  v = sum V_m(t) sin(alpha_m x),  w = sum W_m(t) sin(alpha_m x),

alpha_m = m pi / L, meets term by term together with the natural conditions N_x = M_x = 0. Here t is
the angle from the crown, so that a load q downward per unit area is -q cos t outward and q sin t
along t; its Fourier coefficients are 4 q / (m pi), m odd. By symmetry only t in [0, 40 degrees] is
solved for, with v = 0 and w' = 0 at the crown; the straight edges are free, the natural condition.
Short waves are those of a plate in bending under q cos t, W_m = O(m^-5), and in shear under q sin t,
V_m = O(m^-3), though smaller by (h/R)^2: the work of the loads falls like m^-6, at last like m^-4. At
mid-length the terms alternate.

Geometry, material and load are those of Scordelis & Lo (1964) in the units of Belytschko et al.
(1985); the load stays 90 per unit area at every thickness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from .cylinder import Cylinder, strains_of_axial_harmonic
from .estimate import Estimate
from .strip import Strip

HALF_ANGLE = np.deg2rad(40.0)
LOAD = 90.0
CROWN = ("V(left)", "W'(left)")


def roof(thickness: float = 0.25) -> Cylinder:
    """Midsurface and material of the roof."""
    return Cylinder(radius=25.0, length=50.0, thickness=thickness, young=4.32e8, poisson=0.0)


@dataclass(frozen=True)
class RoofSeries:
    """Solution of the roof: one row of Ritz coefficients a harmonic, and its energies, N m."""

    cylinder: Cylinder
    strip: Strip
    harmonics: np.ndarray
    coefficients: np.ndarray
    membrane_energies: np.ndarray
    bending_energies: np.ndarray
    load_works: np.ndarray

    def displacement(self, x: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Physical components (u, v, w) of shape (len(x), len(t), 3), m, on the grid x by t."""
        alpha = self.harmonics * np.pi / self.cylinder.length
        amplitudes = np.einsum("pcj,mj->mpc", self.strip.basis(t)[0], self.coefficients)
        phase = np.asarray(x, float)[:, None] * alpha
        shapes = np.stack([np.cos(phase), np.sin(phase), np.sin(phase)], axis=-1)
        return np.einsum("xmc,mpc->xpc", shapes, amplitudes)

    def deflection(self, x: float, t: float) -> float:
        """Downward displacement -u_y at one point, m."""
        _, v, w = self.displacement(np.array([x]), np.array([t]))[0, 0]
        return float(v * np.sin(t) - w * np.cos(t))

    def largest_displacement(self) -> tuple[float, float, float]:
        """Largest abs(u) over the shell, m, with its x and its angle from the crown."""
        x, t = np.linspace(0, self.cylinder.length / 2, 41), np.linspace(0, HALF_ANGLE, 81)
        magnitude = np.linalg.norm(self.displacement(x, t), axis=-1)
        i, j = np.unravel_index(np.argmax(magnitude), magnitude.shape)
        # Polished in coordinates scaled to [0, 1]; a maximum on the boundary stays there.
        scale = np.array([x[-1], t[-1]])

        def negative(at: np.ndarray) -> float:
            point = at * scale
            return -float(np.linalg.norm(self.displacement(point[:1], point[1:])))

        start = np.array([x[i], t[j]]) / scale
        best = minimize(negative, start, method="L-BFGS-B", bounds=[(0, 1), (0, 1)])
        x_best, t_best = best.x * scale
        return -float(best.fun), float(x_best), float(t_best)


def solve_roof(cylinder: Cylinder, last_harmonic: int, degree: int) -> RoofSeries:
    """Solve the odd harmonics up to the last one with Legendre-Ritz functions of the degree."""
    strip = Strip(0.0, HALF_ANGLE, degree)
    unit_load = strip.distributed_load(lambda t: LOAD * np.stack([0 * t, np.sin(t), -np.cos(t)], axis=-1))
    parts = cylinder.elasticity()
    harmonics = np.arange(1, last_harmonic + 1, 2)
    # Two halves, R dt along the arc, int sin^2 dx = L/2.
    area_factor = cylinder.radius * cylinder.length
    coefficients, energies = [], []
    for m in harmonics:
        strains = strains_of_axial_harmonic(cylinder.radius, m * np.pi / cylinder.length)
        stiffnesses = strip.stiffnesses(strains, parts)
        load = 4.0 / (m * np.pi) * unit_load
        q = strip.minimise(sum(stiffnesses), load, CROWN)
        coefficients.append(q)
        energies.append([0.5 * q @ k @ q for k in stiffnesses] + [load @ q])
    energies = area_factor * np.array(energies).T
    return RoofSeries(cylinder, strip, harmonics, np.array(coefficients), *energies)


def scordelis_lo(thickness: float = 0.25, last_harmonic: int = 199, degree: int = 64) -> dict[str, Estimate]:
    """Known values of the roof; the uncertainty is the change from 2/3 of terms and degree."""
    levels = [(last_harmonic, degree), (2 * last_harmonic // 3, 2 * degree // 3)]
    rows = []
    for harmonic, p in levels:
        series = solve_roof(roof(thickness), harmonic, p)
        membrane, bending = series.membrane_energies.sum(), series.bending_energies.sum()
        rows.append(
            {
                "edge_deflection": series.deflection(series.cylinder.length / 2, HALF_ANGLE),
                "largest_displacement": series.largest_displacement()[0],
                "strain_energy": series.load_works.sum() / 2,
                "membrane_energy": membrane,
                "bending_energy": bending,
            }
        )
    estimates = {}
    for name, (fine, coarse) in {name: (rows[0][name], rows[1][name]) for name in rows[0]}.items():
        energy = name.endswith("energy")
        scale = rows[0]["strain_energy" if energy else "largest_displacement"]
        rounding = roof(thickness).rounding * scale
        estimates[name] = Estimate.between(fine, coarse, "J" if energy else "m", rounding)
    return estimates
