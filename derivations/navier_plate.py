r"""Square plate under uniform pressure: Navier's double series and, independently, Levy's single one.

All three displacement components are fixed on the four edges and rotations are free: a simply
supported Kirchhoff plate, B laplace^2 w = q, because bending and stretching do not couple in the
linear theory of a flat midsurface. The strain energy is all bending, W = 1/2 int q w.

- Navier: w = 16 q / (pi^6 B) sum_{m, n odd} sin(m pi x / L) sin(n pi y / L)
  / (m n (m^2/L^2 + n^2/L^2)^2) (Timoshenko & Woinowsky-Krieger 1959, art. 28).
- Levy: w(L/2, L/2) = 4 q L^4 / (pi^5 B) sum_{m odd} (-1)^((m-1)/2) / m^5
  [1 - (alpha tanh alpha + 2) / (2 cosh alpha)], alpha = m pi / 2 (ibid., art. 30). Its integral
  over the plate is 8 q L^6 / (pi^6 B) sum 1 / m^6 [1 + sech^2(alpha) / 2 - 3 tanh(alpha) /
  (2 alpha)], found by integrating the series term by term.

The terms of Navier's sums fall like k^-6 (with alternating signs at the centre) and k^-8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .estimate import ROUNDING, Estimate


@dataclass(frozen=True)
class SquarePlate:
    """Side length and thickness in m, Young's modulus and pressure in Pa."""

    side: float = 100.0
    thickness: float = 1.0
    young: float = 1e7
    poisson: float = 0.0
    pressure: float = 1.0

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / (12 (1 - nu^2)), N m."""
        return self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))


def navier(plate: SquarePlate, terms: int) -> tuple[float, float]:
    """Centre deflection (m) and strain energy (J) with so many odd harmonics a direction."""
    m = np.arange(1, 2 * terms, 2, dtype=float)
    sign = np.where(m % 4 == 1, 1.0, -1.0)
    k4 = (m[:, None] ** 2 + m**2) ** 2
    factor = plate.pressure * plate.side**4 / (np.pi**6 * plate.bending_stiffness)
    centre = 16.0 * factor * np.sum(np.outer(sign / m, sign / m) / k4)
    mean = 64.0 * factor / np.pi**2 * np.sum(1.0 / (np.outer(m, m) ** 2 * k4))
    return float(centre), float(0.5 * plate.pressure * mean * plate.side**2)


def levy(plate: SquarePlate, terms: int) -> tuple[float, float]:
    """Centre deflection (m) and strain energy (J) by Levy's series with so many odd harmonics."""
    m = np.arange(1, 2 * terms, 2, dtype=float)
    sign = np.where(m % 4 == 1, 1.0, -1.0)
    alpha = m * np.pi / 2
    tanh = np.tanh(alpha)
    sech = 2.0 * np.exp(-alpha) / (1.0 + np.exp(-2.0 * alpha))
    factor = plate.pressure * plate.side**4 / (np.pi**5 * plate.bending_stiffness)
    centre = 4.0 * factor * np.sum(sign / m**5 * (1.0 - (alpha * tanh + 2.0) * sech / 2.0))
    bracket = 1.0 + sech**2 / 2.0 - 1.5 * tanh / alpha
    mean = 8.0 * factor / np.pi * np.sum(bracket / m**6)
    return float(centre), float(0.5 * plate.pressure * mean * plate.side**2)


def _estimates(fine: tuple[float, float], coarse: tuple[float, float]) -> dict[str, Estimate]:
    deflection = Estimate.between(fine[0], coarse[0], "m", ROUNDING * fine[0])
    bending = Estimate.between(fine[1], coarse[1], "J", ROUNDING * fine[1])
    return {
        "centre_deflection": deflection,
        # By symmetry and the maximum principle for w and its Laplacian, at the centre.
        "largest_displacement": deflection,
        "strain_energy": bending,
        "membrane_energy": Estimate(0.0, 0.0, "J"),
        "bending_energy": bending,
    }


def square_plate(terms: int = 500) -> dict[str, Estimate]:
    """Known values of the plate; the uncertainty is the change from half as many terms."""
    return _estimates(*(navier(SquarePlate(), count) for count in (terms, terms // 2)))


def square_plate_by_levy(terms: int = 2000) -> dict[str, Estimate]:
    """Values of the plate by Levy's series, the second form; the uncertainty is the change from half as many terms."""
    return _estimates(*(levy(SquarePlate(), count) for count in (terms, terms // 2)))
