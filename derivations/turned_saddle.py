r"""A loaded saddle whose clamped edge is turned: cases/turned_saddle.toml.

In linear theory the loads act where the saddle rests. The edge alone holds it, so that its force and moment balance those of
the load, whatever the edge's motion and the saddle's stiffness:

    F = - int f dA,    M = - int (x - c) x f dA.

The judge integrates by Gauss's rule, dA = |x,1 x x,2| from derivatives by hand. The second form integrates the load that the file
has by Simpson's rule, with vectors x,a by steps in the complex plane.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import simpson

from shellbench.problems.shell.case import read_case
from shellbench.problems.shell.question.loads import AreaLoad

from .estimate import Estimate
from .manufactured import CASES
from .rigid_turn import COMPLEX_STEP, saddle
from .surface_strains import Array

AXIS, CENTRE = np.array([2.0, -2.0, 1.0]) / 3, np.array([0.2, 0.1, 0.3])
DIRECTION = np.array([1.0, 2.0, 2.0]) / 3
GAUSS = 20, 30
INTERVALS = 128, 256
ROUNDING = 1e-13
"""N and N m: loads and arms are of the order of one."""


def load(one: Array, two: Array) -> Array:
    """The load (..., 3), N/m^2."""
    return np.stack([0.3 - 0.6 * one * two, 0 * one - 0.2, -0.1 - two**2], -1)


def _borne(place: Array, force: Array) -> tuple[Array, Array]:
    """Densities (...) of the moment about the axis and the force along the direction, of forces (..., 3) at places."""
    return -np.cross(place - CENTRE, force) @ AXIS, -force @ DIRECTION


def _by_gauss(count: int) -> tuple[float, float]:
    t, weights = np.polynomial.legendre.leggauss(count)
    one, two = np.meshgrid((t + 1) / 2, t / 2, indexing="ij")
    area = np.outer(weights, weights) / 4 * np.sqrt(1 + (0.8 * one + 0.2) ** 2 + (0.8 * two) ** 2)
    moment, force = _borne(saddle(one, two), load(one, two))
    return float(np.sum(area * moment)), float(np.sum(area * force))


def _by_simpson(intervals: int) -> tuple[float, float]:
    case = read_case(CASES / "turned_saddle.toml")
    (given,) = (each.vector for each in case.loads if isinstance(each, AreaLoad))
    x1, x2 = np.linspace(0, 1, intervals + 1), np.linspace(-0.5, 0.5, intervals + 1)
    one, two = np.meshgrid(x1, x2, indexing="ij")
    step = 1j * COMPLEX_STEP
    first, second = saddle(one + step, two).imag / COMPLEX_STEP, saddle(one, two + step).imag / COMPLEX_STEP
    area = np.linalg.norm(np.cross(first, second), axis=-1)
    points = np.stack([one, two], -1)
    force = case.evaluate(given, points.reshape(-1, 2))[0, 0].reshape(*one.shape, 3)
    moment, along = (simpson(simpson(area * part, x=x2), x=x1) for part in _borne(saddle(one, two), force))
    return float(moment), float(along)


def _estimates(coarse: tuple[float, float], fine: tuple[float, float]) -> dict[str, Estimate]:
    names = (("handle_moment", "N m"), ("handle_force", "N"))
    return {
        name: Estimate.between(value, rough, unit, ROUNDING)
        for (name, unit), value, rough in zip(names, fine, coarse, strict=True)
    }


def turned_saddle() -> dict[str, Estimate]:
    """Known values of cases/turned_saddle.toml."""
    coarse, fine = (_by_gauss(count) for count in GAUSS)
    return _estimates(coarse, fine)


def turned_saddle_by_simpson() -> dict[str, Estimate]:
    """Values of cases/turned_saddle.toml by the second form."""
    coarse, fine = (_by_simpson(intervals) for intervals in INTERVALS)
    return _estimates(coarse, fine)
