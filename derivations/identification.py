"""Data for the cases `identified_*`, from parameters that are then to be found, and the scatter under noise.

- `identified_strip`: a clamped strip without Poisson's effect whose end carries a pull N and a shear P per width. It
  bends to w(x) = P x^2 (3 L - x) / (6 B) and stretches by u = N L / (E h): data are w at three places, and u. E and the
  factor of the bending stiffness, B = f E h^3 / 12, are unknown. E is N L / (h u); by least squares of relative errors,
  all w being proportional to 1 / B, log B has the mean error of their logarithms.
- `identified_roof`: the Scordelis-Lo roof's edge deflection, the rise of its crown and the deflection of the edge at a
  quarter of its length, by `levy_roof`; the thickness is unknown. The second origin inverts the series by exponentials.

Scatter is the standard deviation over draws of errors, each with its own least squares by Gauss and Newton.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from .cylinder import strains_of_axial_harmonic
from .estimate import ROUNDING, Estimate
from .exponentials import roof_harmonic
from .levy_roof import HALF_ANGLE, LOAD, roof, solve_roof

Values = dict[str, Estimate]
DRAWS, SEED, NOISE = 200, 53, 0.01
LENGTH, HEIGHT, YOUNG, FACTOR = 10.0, 0.1, 1.2e6, 0.8  # of the strip
PULL, SHEAR = 10.0, 0.01
PLACES = 5.0, 7.5, 10.0  # m
THICKNESS = 0.27  # of the roof, m


def strip_data(young: float, factor: float) -> np.ndarray:
    """Deflections at the places, and the stretch of the strip, m."""
    x, bending = np.array(PLACES), factor * young * HEIGHT**3 / 12
    return np.append(SHEAR * x**2 * (3 * LENGTH - x) / (6 * bending), PULL * LENGTH / (young * HEIGHT))


def roof_by_polynomials(thickness: float) -> np.ndarray:
    """Deflections of the edge at mid-length and at a quarter of it, and of the crown, m."""
    series = solve_roof(roof(thickness), 199, 56)
    return np.array(
        [series.deflection(25.0, HALF_ANGLE), series.deflection(12.5, HALF_ANGLE), series.deflection(25.0, 0.0)]
    )


@cache
def _roof(thickness: float) -> tuple[float, ...]:
    return tuple(roof_by_polynomials(thickness))


def roof_by_exponentials(thickness: float) -> np.ndarray:
    """The same by exact exponentials along the arc."""
    cylinder, m = roof(thickness), np.arange(1, 200, 2)
    places = {}
    for angle in (0.0, HALF_ANGLE):
        rows = [
            roof_harmonic(
                strains_of_axial_harmonic(cylinder.radius, k * np.pi / cylinder.length),
                sum(cylinder.elasticity()),
                HALF_ANGLE,
                4 * LOAD / (k * np.pi),
            ).at(angle)
            for k in m
        ]
        _, v, w = np.moveaxis(np.array(rows), -1, 0)
        places[angle] = v * np.sin(angle) - w * np.cos(angle)

    def at(x: float, angle: float) -> float:
        return float(np.sin(m * np.pi * x / cylinder.length) @ places[angle])

    return np.array([at(25.0, HALF_ANGLE), at(12.5, HALF_ANGLE), at(25.0, 0.0)])


def least_squares(model: Callable[[np.ndarray], np.ndarray], data: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Logarithms of the parameters with the least relative residuals, by Gauss and Newton with differences."""
    x, step = np.array(start, dtype=float), 1e-3
    for _ in range(30):
        residual = model(x) / data - 1
        sides = [(model(x + step * e) - model(x - step * e)) / (2 * step) / data for e in np.eye(len(x))]
        change = np.linalg.lstsq(np.stack(sides, axis=1), -residual, rcond=None)[0]
        x = x + change
        if np.abs(change).max() < 1e-12:
            break
    return x


def scatter(model: Callable[[np.ndarray], np.ndarray], truth: np.ndarray) -> np.ndarray:
    """Standard deviations of the parameters over draws of noise."""
    rng, exact = np.random.default_rng(SEED), model(np.log(truth))
    found = [
        np.exp(least_squares(model, exact * (1 + NOISE * rng.normal(size=len(exact))), np.log(truth)))
        for _ in range(DRAWS)
    ]
    return np.std(found, axis=0, ddof=1)


def by_splines_of_log(model: Callable[[float], np.ndarray], centre: float) -> Callable[[np.ndarray], np.ndarray]:
    """A model of one parameter near a value, as a polynomial of its logarithm: a series at each draw takes minutes."""
    nodes = np.cos((np.arange(9) + 0.5) * np.pi / 9)
    values = np.log(np.abs([model(centre * np.exp(0.2 * node)) for node in nodes]))
    signs = np.sign(model(centre))
    fits = [np.polynomial.Chebyshev.fit(nodes, column, 8, domain=[-1, 1]) for column in values.T]
    return lambda x: signs * np.exp([fit((x[0] - np.log(centre)) / 0.2) for fit in fits])


def _values(truth: dict[str, tuple[float, str]], spread: np.ndarray, error: float) -> Values:
    found = {name: Estimate(value, error * value, unit) for name, (value, unit) in truth.items()}
    sampling = 1 / np.sqrt(2 * DRAWS)  # of a standard deviation over draws
    return found | {
        f"{name}_scatter": Estimate(float(s), float(0.2 * sampling * s), unit)
        for (name, (_, unit)), s in zip(truth.items(), spread, strict=True)
    }


STRIP = {"modulus": (YOUNG, "Pa"), "bending_factor": (FACTOR, "")}
ROOF = {"thickness": (THICKNESS, "m")}


def identified_strip() -> Values:
    """The parameters from which the data were computed, and the scatter over draws."""
    return _values(STRIP, scatter(lambda x: strip_data(*np.exp(x)), np.array([YOUNG, FACTOR])), ROUNDING)


def identified_strip_closed() -> Values:
    """The closed form of the least squares, and its scatter to first order.

    log E has the error of u; log f that of the mean of w, less that of log E.
    """
    *deflections, stretch = strip_data(YOUNG, FACTOR)
    young = PULL * LENGTH / (HEIGHT * stretch)
    x = np.array(PLACES)
    bending = np.exp(np.mean(np.log(SHEAR * x**2 * (3 * LENGTH - x) / 6 / deflections)))
    truth = {"modulus": (float(young), "Pa"), "bending_factor": (float(bending * 12 / young / HEIGHT**3), "")}
    values = _values(truth, NOISE * np.array([YOUNG, FACTOR * np.sqrt(1 + 1 / 3)]), 10 * ROUNDING)
    loose = 4 / np.sqrt(2 * DRAWS)
    return {
        n: Estimate(v.value, loose * v.value if n.endswith("scatter") else v.uncertainty, v.unit)
        for n, v in values.items()
    }


def identified_roof() -> Values:
    """The thickness from which the data were computed, and the scatter over draws."""
    model = by_splines_of_log(lambda h: np.array(_roof(h)), THICKNESS)
    return _values(ROOF, scatter(model, np.array([THICKNESS])), ROUNDING)


def identified_roof_by_exponentials() -> Values:
    """The thickness with which the other series gives the data, and its scatter to first order."""
    data = np.array(_roof(THICKNESS))
    model = by_splines_of_log(roof_by_exponentials, THICKNESS)
    found = float(np.exp(least_squares(model, data, np.log([0.25])))[0])
    slopes = (model(np.log([THICKNESS * 1.001])) / model(np.log([THICKNESS * 0.999])) - 1) / 0.002
    spread = NOISE * THICKNESS / np.sqrt(np.sum(slopes**2))
    values = _values({"thickness": (found, "m")}, np.array([spread]), 1e-8)
    loose = 4 / np.sqrt(2 * DRAWS)
    return {
        n: Estimate(v.value, loose * v.value if n.endswith("scatter") else v.uncertainty, v.unit)
        for n, v in values.items()
    }


JUDGES = {"identified_strip": identified_strip, "identified_roof": identified_roof}
SECOND_FORMS = {"identified_strip": identified_strip_closed, "identified_roof": identified_roof_by_exponentials}
