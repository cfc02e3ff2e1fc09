"""Plates whose deflection is asked at points: geometry, loads, and estimates from two levels of a method.

In linear theory a flat plate under transverse load does not stretch: w is all of the displacement, and an oblique
direction sees its share of it. The strain energy is all bending, half the work of the load (Clapeyron).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .estimate import ROUNDING, Estimate

OBLIQUE = 2.0 / 3.0
"""Share of a downward displacement along [1, 2, -2]."""


@dataclass(frozen=True)
class Rectangle:
    """Sides a, b and thickness in m, Young's modulus in Pa."""

    a: float
    b: float
    thickness: float
    young: float
    poisson: float

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / (12 (1 - nu^2)), N m."""
        return self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))


@dataclass(frozen=True)
class Uniform:
    """A uniform load, N/m^2, downward."""

    pressure: float = 1.0


@dataclass(frozen=True)
class Point:
    """A force, N, downward, at a place (x0, y0), m."""

    place: tuple[float, float]
    force: float = 1.0


Load = Uniform | Point


@dataclass(frozen=True)
class Mean:
    """A quantity: the mean over points (N, 2), m, of a share of the downward displacement."""

    points: tuple[tuple[float, float], ...]
    share: float = 1.0


Asked = Mapping[str, Mean]


def points_of(asked: Asked) -> np.ndarray:
    """All points, (N, 2), in the order of the quantities."""
    return np.array([point for mean in asked.values() for point in mean.points])


def estimates_of(
    asked: Asked, fine: tuple[np.ndarray, float], coarse: tuple[np.ndarray, float], rounding: float
) -> dict[str, Estimate]:
    """Estimates from the deflections at `points_of`, m, and the strain energy, J, of two levels."""
    values, start = {}, 0
    for name, mean in asked.items():
        part = slice(start, start := start + len(mean.points))
        levels = [mean.share * float(np.mean(deflections[part])) for deflections, _ in (fine, coarse)]
        values[name] = Estimate.between(*levels, "m", rounding * abs(levels[0]))
    energy = Estimate.between(fine[1], coarse[1], "J", rounding * fine[1])
    return values | {"strain_energy": energy, "membrane_energy": Estimate(0.0, 0.0, "J"), "bending_energy": energy}


@dataclass(frozen=True)
class LoadedPlate:
    """A plate, its load, and what is asked of it by name."""

    plate: Rectangle
    load: Load
    asked: Asked

    @property
    def points(self) -> np.ndarray:
        """All points, (N, 2), in the order of the quantities."""
        return points_of(self.asked)

    def estimates(
        self, fine: tuple[np.ndarray, float], coarse: tuple[np.ndarray, float], rounding: float = ROUNDING
    ) -> dict[str, Estimate]:
        """Estimates from deflections and energies of two levels."""
        return estimates_of(self.asked, fine, coarse, rounding)
