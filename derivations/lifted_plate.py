r"""A hinged plate whose rim is moved: cases/lifted_plate.toml.

Linear theory adds up what loads and supports do.

- In its plane all of the rim moves by u = G (x, y): so does the plate, and its strain is the same everywhere.
- The edge x = a is lifted by c sin(k y), k = pi / b: w = f(x) sin(k y), by `edits` for a square plate,

      f = A sinh k x + D x cosh k x,  D = -(1 - nu) k c / (2 sinh k a),  A sinh k a = c - D a cosh k a.

  It stores half of what its edge force, -B (f''' - (2 - nu) k^2 f') sin(k y), does on the lift.
- The pressure and the force bend the plate as if its rim rested: the series of `plate_series`. Their energies have a
  cross term, the work of the force on the deflection by the pressure. Neither has one with the lift: the deflection
  by loads is zero where the lift's edge forces act, and its edges take no moment.

The largest displacement is that of the lifted edge: what loads do is smaller, and downward.

The second form solves for f by collocation, integrates the density of its energy, and takes Navier's series for Levy's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq, minimize_scalar

from .estimate import Estimate
from .plate import LoadedPlate, Mean, Point, Rectangle, Uniform
from .plate_series import by_levy, by_navier

PLATE = Rectangle(100.0, 50.0, 1.0, 1e7, 0.3)
GRADIENT = np.array([[1e-4, 3e-4], [1e-4, -2e-4]])
LIFT, PRESSURE, FORCE = 1.0, 3.0, 2e4
"""m, Pa and N."""
PLACES = {"one": (70.0, 20.0), "two": (40.0, 35.0), "three": (90.0, 10.0), "pressed": (92.5, 45.0)}
WAVE = np.pi / PLATE.b
DEGREES, GAUSS = (36, 30), 40
ROUNDING = 1e-11

Shape = Callable[[np.ndarray, int], np.ndarray]
"""f and its derivatives, of x and an order."""


def closed(x: np.ndarray, order: int) -> np.ndarray:
    """Return f or a derivative of it."""
    k, a = WAVE, PLATE.a
    d = -(1 - PLATE.poisson) * k * LIFT / (2 * np.sinh(k * a))
    c = (LIFT - d * a * np.cosh(k * a)) / np.sinh(k * a)
    even, odd = (np.sinh(k * x), np.cosh(k * x)) if order % 2 == 0 else (np.cosh(k * x), np.sinh(k * x))
    return np.asarray(c * k**order * even + d * (x * k**order * odd + order * k ** (order - 1) * even))


def by_collocation(degree: int) -> Shape:
    """Return the same of Chebyshev's polynomials that satisfy the equation at points, of x = a (1 + s) / 2."""
    half, k, nu = PLATE.a / 2, WAVE, PLATE.poisson

    def values(s: np.ndarray, order: int) -> np.ndarray:
        rows = [chebyshev.chebval(s, chebyshev.chebder(row, order)) for row in np.eye(degree + 1)]
        return np.stack(rows, axis=-1) / half**order

    inside, ends = np.cos(np.pi * (np.arange(degree - 3) + 0.5) / (degree - 3)), np.array([-1.0, 1.0])
    rows = values(inside, 4) / k**4 - 2 * values(inside, 2) / k**2 + values(inside, 0)
    matrix = np.concatenate([rows, values(ends, 0), values(ends, 2) / k**2])
    factors = np.linalg.solve(matrix, np.concatenate([np.zeros(len(inside)), [0.0, LIFT, 0.0, nu * LIFT]]))
    return lambda x, order: values(x / half - 1, order) @ factors


def stored_by_edge(f: Shape) -> float:
    """Return the energy of the lift, J, by the force of its edge."""
    end = np.array([PLATE.a])
    force = -PLATE.bending_stiffness * (f(end, 3) - (2 - PLATE.poisson) * WAVE**2 * f(end, 1))
    return float(force[0]) * LIFT / 2 * PLATE.b / 2


def stored_inside(f: Shape) -> float:
    """Return the same by the curvatures f'' sin, -k^2 f sin and k f' cos."""
    t, w = np.polynomial.legendre.leggauss(GAUSS)
    x, weights, nu = PLATE.a * (t + 1) / 2, PLATE.a * w / 2, PLATE.poisson
    first, second, mixed = f(x, 2), -(WAVE**2) * f(x, 0), WAVE * f(x, 1)
    density = first**2 + second**2 + 2 * nu * first * second + 2 * (1 - nu) * mixed**2
    return float(weights @ density) * PLATE.bending_stiffness / 2 * PLATE.b / 2


def _rim(y: float) -> np.ndarray:
    """Return the displacement (3,) of the lifted edge."""
    return np.append(GRADIENT @ [PLATE.a, y], LIFT * np.sin(WAVE * y))


def largest_by_search() -> float:
    """Return the largest displacement of the lifted edge, m."""
    return float(np.sqrt(-minimize_scalar(lambda y: -_rim(y) @ _rim(y), bounds=(0, PLATE.b), method="bounded").fun))


def largest_by_slope() -> float:
    """Return the same, where its derivative is zero."""

    def slope(y: float) -> float:
        return float(_rim(y) @ np.append(GRADIENT[:, 1], LIFT * WAVE * np.cos(WAVE * y)))

    return float(np.linalg.norm(_rim(brentq(slope, 0.25 * PLATE.b, 0.75 * PLATE.b))))


def _values(shape: tuple[Shape, Shape], stored: Callable[[Shape], float], largest: float, series: Callable[[LoadedPlate], dict[str, Estimate]]) -> dict[str, Estimate]:  # fmt: skip
    asked = {name: Mean((place,)) for name, place in PLACES.items()}
    pressed, pushed = (series(LoadedPlate(PLATE, q, asked)) for q in (Uniform(PRESSURE), Point(PLACES["pressed"], FORCE)))  # fmt: skip

    def lifted(name: str) -> Estimate:
        x, y = PLACES[name]
        fine, coarse = (float(f(np.array([x]), 0)[0]) * np.sin(WAVE * y) for f in shape)
        down = pressed[name].value + pushed[name].value
        spread = pressed[name].uncertainty + pushed[name].uncertainty + abs(fine - coarse) + ROUNDING
        return Estimate(fine - down, spread, "m")

    w = {name: lifted(name) for name in PLACES}
    three = [name for name in PLACES if name != "pressed"]
    in_plane = np.mean([GRADIENT @ PLACES[name] for name in three], axis=0) @ [1.0, 2.0]
    oblique = (in_plane - 2 * np.mean([w[name].value for name in three])) / 3
    strain = (GRADIENT + GRADIENT.T) / 2
    stretch, nu = PLATE.young * PLATE.thickness / (1 - PLATE.poisson**2), PLATE.poisson
    membrane = stretch / 2 * PLATE.a * PLATE.b * float((1 - nu) * np.sum(strain**2) + nu * np.trace(strain) ** 2)
    fine, coarse = (stored(f) for f in shape)
    loads = pressed["strain_energy"].value + pushed["strain_energy"].value + FORCE * pressed["pressed"].value
    spread = abs(fine - coarse) + ROUNDING * membrane + FORCE * pressed["pressed"].uncertainty
    spread += pressed["strain_energy"].uncertainty + pushed["strain_energy"].uncertainty
    return {
        "lift": w["three"],
        "mean_oblique": Estimate(float(oblique), max(w[name].uncertainty for name in three), "m"),
        "pressed_deflection": Estimate(-w["pressed"].value, w["pressed"].uncertainty, "m"),
        "largest_displacement": Estimate(largest, ROUNDING, "m"),
        "strain_energy": Estimate(membrane + fine + loads, spread, "J"),
        "membrane_energy": Estimate(membrane, ROUNDING * membrane, "J"),
        "bending_energy": Estimate(fine + loads, spread, "J"),
    }


def lifted_plate() -> dict[str, Estimate]:
    """Known values of cases/lifted_plate.toml."""
    return _values((closed, closed), stored_by_edge, largest_by_search(), by_levy)


def lifted_plate_by_navier() -> dict[str, Estimate]:
    """The same by collocation and Navier's series."""
    fine, coarse = (by_collocation(degree) for degree in DEGREES)
    return _values((fine, coarse), stored_inside, largest_by_slope(), by_navier)
