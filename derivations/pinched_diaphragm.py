r"""Pinched cylinder between rigid diaphragms: a double Fourier series with a closed-form tail.

Two opposite inward point loads P at mid-length. The diaphragms hold v = w = 0 and leave u free,
which cos(alpha x) cos(n t), sin(alpha x) sin(n t), sin(alpha x) cos(n t), alpha = m pi / L, meet
term by term. With t measured from a load, only odd m and even n are loaded, by the amplitude
2 P e_n sin(m pi / 2) / (pi R L), e_0 = 1, e_n = 2; each (m, n) is a 3 x 3 system K q = load. With
c = (K^-1)_ww, the inward displacement under a load and the strain energy are

    w = 2 P / (pi R L) sum_{m, n} e_n c_mn,      W = 1/2 (2 P w) = P w  (Clapeyron, two loads).

For short waves a shell bends like a plate: c -> 1 / (B k^4), k^2 = alpha^2 + (n / R)^2, and the
plain sum, truncated at k = K, is short by O(K^-2): that is why truncated series in the literature
come out low (1.8248e-5). Here 1 / (B k^4) is subtracted and summed in closed form, by

    sum_{j in Z} 1 / (j^2 + a^2)^2 = pi coth(pi a) / (2 a^3) + pi^2 / (2 a^2 sinh^2(pi a)).

What is left falls as k^-6, apart from a residue of relative size (h/R)^2 in k^-4 which bending
keeps through its coupling with v: the rest of the sum, short by a K^-2 + b K^-4, is extrapolated.
"""

from __future__ import annotations

import numpy as np

from .cylinder import Cylinder, strains_of_double_harmonic
from .estimate import Estimate

LOAD = 1.0


def pinched_cylinder() -> Cylinder:
    """Midsurface and material of the two pinched cylinders of the obstacle course."""
    return Cylinder(radius=300.0, length=600.0, thickness=3.0, young=3e6, poisson=0.3)


def harmonics(cylinder: Cylinder, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Odd m as a column and even n as a row with alpha R and n up to the cutoff."""
    m = np.arange(1, int(cutoff * cylinder.length / (np.pi * cylinder.radius)) + 1, 2)
    return m[:, None], np.arange(0, int(cutoff) + 1, 2)[None, :]


def unit_responses(cylinder: Cylinder, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes q (M, N, 3) under a unit outward pressure, with their (M, N) membrane shares.

    The share is that of the membrane energy in the work q_w of the unit load.
    """
    m, n = harmonics(cylinder, cutoff)
    strains = strains_of_double_harmonic(cylinder.radius, m * np.pi / cylinder.length, n)
    transposed = np.swapaxes(strains, -1, -2)
    membrane, bending = (transposed @ part @ strains for part in cylinder.elasticity())
    pressure = np.array([[0.0], [0.0], [1.0]])
    q = np.linalg.solve(membrane + bending, pressure)
    work = (np.swapaxes(q, -1, -2) @ membrane @ q)[..., 0, 0]
    return q[..., 0], work / q[..., 2, 0]


def plate_series(cylinder: Cylinder, terms: int = 200000) -> float:
    """Sum over odd m and all even n, of both signs, of 1 / (B k^4): sum over n in closed form."""
    m = np.arange(1, 2 * terms, 2, dtype=float)
    a = m * np.pi / cylinder.length * cylinder.radius / 2.0
    b = np.pi * a
    sinh2 = np.exp(-2.0 * b) / ((1.0 - np.exp(-2.0 * b)) / 2.0) ** 2  # 1 / sinh^2, no overflow
    inner = np.pi / (2.0 * a**3) / np.tanh(b) + np.pi**2 / (2.0 * a**2) * sinh2
    # sum over odd m > 2 terms of m^-3 is 1 / (16 terms^2) - ..., the rest is below rounding.
    tail = np.pi / 2.0 * (cylinder.length / (np.pi * cylinder.radius / 2.0)) ** 3
    tail *= 1.0 / (16.0 * terms**2)
    return float((inner.sum() + tail) * (cylinder.radius / 2.0) ** 4 / cylinder.bending_stiffness)


def flexibility_sums(cylinder: Cylinder, cutoff: float) -> tuple[float, float]:
    """Sums of e_n c_mn and of its membrane share, the plate's part replaced by its full sum."""
    m, n = harmonics(cylinder, cutoff)
    q, membrane_share = unit_responses(cylinder, cutoff)
    k2 = (m * np.pi / cylinder.length) ** 2 + (n / cylinder.radius) ** 2
    weight = np.where(n == 0, 1.0, 2.0)
    short = weight * (q[..., 2] - 1.0 / (cylinder.bending_stiffness * k2**2))
    total = float(short.sum()) + plate_series(cylinder)
    return total, float((weight * q[..., 2] * membrane_share).sum())


def extrapolate(cutoffs: np.ndarray, sums: np.ndarray) -> float:
    """Limit of sums that are short by a K^-2 + b K^-4, from three cutoffs."""
    columns = np.asarray(cutoffs)[:, None] ** -np.array([0.0, 2.0, 4.0])
    return float(np.linalg.solve(columns, sums)[0])


def displacement(cylinder: Cylinder, cutoff: float, x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Truncated series of (u, v, w), w outward, in m, of shape (len(x), len(t), 3)."""
    m, n = harmonics(cylinder, cutoff)
    q, _ = unit_responses(cylinder, cutoff)
    weight = np.where(n == 0, 1.0, 2.0) * np.where(m % 4 == 1, 1.0, -1.0)
    amplitude = -2.0 * LOAD / (np.pi * cylinder.radius * cylinder.length) * weight[..., None] * q
    along = np.asarray(x)[:, None] * (m[:, 0] * np.pi / cylinder.length)
    around = np.asarray(t)[:, None] * n[0]
    along = np.stack([np.cos(along), np.sin(along), np.sin(along)], axis=-1)
    around = np.stack([np.cos(around), np.sin(around), np.cos(around)], axis=-1)
    return np.einsum("xmc,mnc,tnc->xtc", along, amplitude, around, optimize=True)


def pinched_cylinder_diaphragm(cutoff: float = 800.0) -> dict[str, Estimate]:
    """Known values; the uncertainty is the change from half the cutoff, both extrapolated.

    The largest abs(u) is the displacement under a load, where u = v = 0 by symmetry (the test
    looks for a larger one over the whole shell). The solution has no mean axial displacement.
    """
    cylinder = pinched_cylinder()
    cutoffs = cutoff * np.array([0.25, 0.35, 0.5, 0.7, 1.0])
    sums = np.array([flexibility_sums(cylinder, k) for k in cutoffs])
    factor = 2.0 * LOAD / (np.pi * cylinder.radius * cylinder.length)
    fine, coarse = (
        [factor * extrapolate(cutoffs[part], column[part]) for column in sums.T] for part in (slice(2, 5), slice(0, 3))
    )
    return pinched_estimates(cylinder, (fine[0], LOAD * fine[1]), (coarse[0], LOAD * coarse[1]))


def pinched_estimates(
    cylinder: Cylinder, fine: tuple[float, float], coarse: tuple[float, float]
) -> dict[str, Estimate]:
    """Known values from the displacement under a load (m) and the membrane energy (J) at two levels.

    The strain energy is P w by Clapeyron: half the work of two loads.
    """

    def estimate(fine_value: float, coarse_value: float, unit: str) -> Estimate:
        scale = LOAD * fine[0] if unit == "J" else fine[0]
        return Estimate.between(fine_value, coarse_value, unit, cylinder.rounding * scale)

    deflection = estimate(fine[0], coarse[0], "m")
    energy, coarse_energy = LOAD * fine[0], LOAD * coarse[0]
    return {
        "load_displacement": deflection,
        "largest_displacement": deflection,
        "strain_energy": estimate(energy, coarse_energy, "J"),
        "membrane_energy": estimate(fine[1], coarse[1], "J"),
        "bending_energy": estimate(energy - fine[1], coarse_energy - coarse[1], "J"),
    }
