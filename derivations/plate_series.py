r"""Simply supported rectangular plates, uniform load or a point load anywhere: Levy's single series and Navier's double one.

On [0, a] x [0, b] with w = 0 and no bending moment on the rim, B laplace^2 w = q.

- Levy (along the first coordinate): w = sum_m Y_m(y) sin(alpha x), alpha = m pi / a, with a closed form across. For a point
  load P at (x0, y0), Y'''' - 2 alpha^2 Y'' + alpha^4 Y = (2 P / (a B)) sin(alpha x0) delta(y - y0) is solved by images: with
  g(d) = (1 + alpha d) exp(-alpha d) / (4 alpha^3), the answer of the infinite strip at a distance d,

      Y = (2 P / (a B)) sin(alpha x0) sum_k [g(|y - y0 + 2 k b|) - g(|y + y0 + 2 k b|)].

  For a uniform load Y solves the same equation with (4 q / (m pi B)), m odd:
  Y = (4 q / (m pi B alpha^4)) [1 - cosh(alpha z) / cosh(beta) + (alpha z sinh(alpha z) - beta tanh(beta) cosh(alpha z))
  / (2 cosh(beta))], z = y - b / 2, beta = alpha b / 2 (Timoshenko & Woinowsky-Krieger 1959, section 30).
- Navier: w = (4 / (a b B)) sum_mn Q_mn sin(alpha_m x) sin(gamma_n y) / (alpha_m^2 + gamma_n^2)^2 with
  Q = P sin sin, or 4 q a b / (pi^2 m n) with m and n odd (ibid., sections 28 and 34).

Strain energy: half the work of the load (Clapeyron).

Under its force a sum of either series is short by a series in even powers of 1 / K, K the last harmonic, if the signs repeat
with a period that divides K: here the coordinates are multiples of a 40th of the sides. Two cut-offs remove the first power.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .plate import OBLIQUE, Load, LoadedPlate, Mean, Point, Rectangle, Uniform

IMAGES = 12
"""Images on each side: those left out are exp(-2 pi 12 b / a), below rounding for b > a / 2."""


def levy_uniform(plate: Rectangle, load: Uniform, terms: int, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Deflections (N,) at points (N, 2), m, and strain energy, J, of a uniform load, with so many odd harmonics."""
    m = np.arange(1, 2 * terms, 2, dtype=float)
    alpha, beta = m * np.pi / plate.a, m * np.pi * plate.b / (2 * plate.a)
    amplitude = 4.0 * load.pressure / (m * np.pi * plate.bending_stiffness * alpha**4)
    tanh = np.tanh(beta)
    sech = 2.0 * np.exp(-beta) / (1.0 + np.exp(-2.0 * beta))
    d = np.abs(points[:, 1:] - plate.b / 2) * alpha
    # Hyperbolic functions over cosh(beta), written so that nothing overflows.
    decay = np.exp(d - beta) / (1.0 + np.exp(-2.0 * beta))
    cosh, sinh = decay * (1.0 + np.exp(-2.0 * d)), decay * (1.0 - np.exp(-2.0 * d))
    across = 1.0 - cosh + (d * sinh - beta * tanh * cosh) / 2.0
    deflections = (amplitude * across * np.sin(points[:, :1] * alpha)).sum(axis=1)
    integral = amplitude * (plate.b - (3.0 * tanh - beta * sech**2) / alpha) * 2.0 / alpha
    return deflections, float(0.5 * load.pressure * integral.sum())


def levy_point(plate: Rectangle, load: Point, terms: int, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Deflections (N,) at points (N, 2), m, and strain energy, J, of a point load, with so many harmonics."""
    alpha = np.arange(1, terms + 1) * np.pi / plate.a
    x0, y0 = load.place
    amplitude = 2.0 * load.force / (plate.a * plate.bending_stiffness) * np.sin(alpha * x0)

    def strip(distance: np.ndarray) -> np.ndarray:
        return (1.0 + alpha * distance) * np.exp(-alpha * distance) / (4.0 * alpha**3)

    def deflection(x: float, y: float) -> float:
        shifts = 2.0 * plate.b * np.arange(-IMAGES, IMAGES + 1)
        across = sum(strip(np.abs(y - y0 + s)) - strip(np.abs(y + y0 + s)) for s in shifts)
        return float((amplitude * across * np.sin(alpha * x)).sum())

    return np.array([deflection(*point) for point in points]), 0.5 * load.force * deflection(x0, y0)


def levy(plate: Rectangle, load: Load, terms: int, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Deflections (N,) at points (N, 2), m, and strain energy, J, by Levy's series."""
    solve = levy_uniform if isinstance(load, Uniform) else levy_point
    return solve(plate, load, terms, points)


def navier(plate: Rectangle, load: Load, cutoff: tuple[int, int], points: np.ndarray) -> tuple[np.ndarray, float]:
    """The same by Navier's series, cut off at so many harmonics along each side."""
    m, n = (np.arange(1, last + 1) for last in cutoff)
    alpha, gamma = m * np.pi / plate.a, n * np.pi / plate.b
    if isinstance(load, Uniform):
        along, across = (np.where(k % 2 == 1, 2.0 / k, 0.0) * side / np.pi for k, side in ((m, plate.a), (n, plate.b)))
        force = load.pressure
    else:
        along, across = np.sin(alpha * load.place[0]), np.sin(gamma * load.place[1])
        force = load.force
    response = 4.0 * force / (plate.a * plate.b * plate.bending_stiffness)
    flexibility = response / (alpha[:, None] ** 2 + gamma**2) ** 2
    shapes = np.sin(points[:, :1] * alpha) * along, np.sin(points[:, 1:] * gamma) * across
    deflections = np.einsum("pm,pm->p", shapes[0], shapes[1] @ flexibility.T)
    return deflections, float(0.5 * force * (along**2 @ flexibility @ across**2))


def plate_2_1_uniform() -> LoadedPlate:
    """The plate of cases/plate_2_1_uniform.toml."""
    asked = {
        "centre_deflection": Mean(((50.0, 25.0),)),
        "corner_deflection": Mean(((30.0, 10.0),)),
        "mean_oblique": Mean(((30.0, 10.0), (65.0, 35.0), (85.0, 20.0)), OBLIQUE),
        "largest_displacement": Mean(((50.0, 25.0),)),
    }
    return LoadedPlate(Rectangle(100.0, 50.0, 1.0, 1e7, 0.3), Uniform(), asked)


def plate_2_1_point() -> LoadedPlate:
    """The plate of cases/plate_2_1_point.toml."""
    asked = {
        "far_deflection": Mean(((65.0, 20.0),)),
        "load_deflection": Mean(((30.0, 30.0),)),
        "mean_oblique": Mean(((65.0, 20.0), (15.0, 40.0), (45.0, 10.0)), OBLIQUE),
    }
    return LoadedPlate(Rectangle(100.0, 50.0, 1.0, 1e7, 0.3), Point((30.0, 30.0)), asked)


def strip_plate_1_50() -> LoadedPlate:
    """The plate of cases/strip_plate_1_50.toml, its coordinates exchanged: the first is the short one."""
    asked = {
        "centre_deflection": Mean(((0.5, 25.0),)),
        "end_deflection": Mean(((0.3, 0.7),)),
        "mean_oblique": Mean(((0.3, 0.7), (0.25, 20.0), (0.6, 49.4)), OBLIQUE),
    }
    return LoadedPlate(Rectangle(1.0, 50.0, 0.01, 1e7, 0.49), Uniform(), asked)


LEVY_TERMS = 4000
NAVIER_TERMS = 800


def _without_the_first_power(fine: tuple[np.ndarray, float], coarse: tuple[np.ndarray, float]) -> tuple:
    """Limit of what is short by c K^-2, from K and K / 2."""
    return tuple((4.0 * f - c) / 3.0 for f, c in zip(fine, coarse, strict=True))


def _three_levels(case: LoadedPlate, solve, terms: tuple) -> dict[str, Estimate]:
    """Estimates from sums of K, K / 2 and K / 4 harmonics; a point load's are extrapolated in pairs."""
    fine, middle, coarse = (solve(case.plate, case.load, level, case.points) for level in terms)
    if isinstance(case.load, Point):
        fine, middle = _without_the_first_power(fine, middle), _without_the_first_power(middle, coarse)
    return case.estimates(fine, middle)


def by_levy(case: LoadedPlate, terms: int = LEVY_TERMS) -> dict[str, Estimate]:
    """Values by Levy's series; the uncertainty is the change from half as many harmonics."""
    return _three_levels(case, levy, (terms, terms // 2, terms // 4))


def by_navier(case: LoadedPlate, terms: int = NAVIER_TERMS) -> dict[str, Estimate]:
    """Values by Navier's series; a side twice as long has twice as many harmonics."""
    a, b = case.plate.a, case.plate.b
    along, across = max(1, round(a / b)), max(1, round(b / a))
    return _three_levels(case, navier, tuple((k * along, k * across) for k in (terms, terms // 2, terms // 4)))
