"""Measuring a solution of a shell: what quantities are made of, and integrals over the midsurface."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Quantity
from shellbench.problems.shell.conditions import AreaLoad, GravityLoad, PressureLoad
from shellbench.problems.shell.directions import in_space
from shellbench.problems.shell.field import DisplacementField

Array = NDArray[np.float64]

PANELS, PANEL_POINTS = 24, 4  # a side, of the rule that integrals over the midsurface are taken by


def measure(solution: DisplacementField, quantity: Quantity) -> float:
    """Return the value of a quantity; see `shellbench.problem.Quantity.measure`."""
    return quantity.measure(solution)


def measure_all(solution: DisplacementField, case: Any = None) -> Mapping[str, float]:
    """Return all quantities of the case by name."""
    return {q.name: measure(solution, q) for q in (case or solution.case).quantities}


def measure_reached(solution: DisplacementField) -> Mapping[str, float]:
    """Return the quantities of the case by name that a path has reached, which may have ended early."""
    found = {}
    for quantity in solution.case.quantities:
        with contextlib.suppress(ValueError):
            found[quantity.name] = measure(solution, quantity)
    return found


def area_rule(case: Any) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,), m^2, that integrate over the midsurface: Gauss's rule on panels.

    They are equal, and cut where loads or stiffnesses have kinks. A case has its own at hand, `Shell.area_rule`.
    """
    domain = case.surface.domain
    (first, along), (second, across) = map(_panels, domain.lower, domain.upper, case.kinks)
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    tangents = case.surface.derivatives(points, order=1)
    area = np.linalg.norm(np.cross(tangents[1, 0], tangents[0, 1]), axis=-1)
    return points, np.outer(along, across).ravel() * area


def _panels(low: float, high: float, cuts: Iterable[float]) -> tuple[Array, Array]:
    """Return points (n,) and weights (n,) along a coordinate."""
    x, w = np.polynomial.legendre.leggauss(PANEL_POINTS)
    ends = np.unique([*np.linspace(low, high, PANELS + 1), *cuts])
    half = np.diff(ends)[:, None] / 2
    return (ends[:-1, None] + half * (x + 1)).ravel(), (half * w).ravel()


def kinetic_energy(solution: DisplacementField, at: float) -> float:
    """Return half the areal density times the velocity squared, over the whole shell, J."""
    points, weights = solution.case.area_rule
    velocity = solution.velocity(points, at)
    return float(solution.case.material.areal_density / 2 * (weights @ np.sum(velocity**2, axis=-1)))


def total_energy(solution: DisplacementField, at: float) -> float:
    """Return kinetic energy, strain energy and that of springs, less the work of constant loads, J."""
    case = solution.case
    points, weights = case.area_rule
    u = solution.displacement(points, at=at)
    springs = float(weights @ np.sum(case.spring_stiffness(points) * u**2, axis=-1)) / 2
    work = float(weights @ np.sum(load_density(case, points, at) * u, axis=-1))
    return kinetic_energy(solution, at) + sum(solution.energies(at)) + springs - work


def load_density(case: Any, points: Array, t: float) -> Array:
    """Return the loads that are spread over the area as a force per area (n, 3), N/m^2, at points (n, 2)."""
    density = np.zeros((len(points), 3))
    for load in case.loads:
        match load:
            case AreaLoad(vector=vector, frame=frame):
                given = case.evaluate(vector, points, t)[0, 0]
                density += given if frame == "global" else in_space(case.surface, given, points)
            case GravityLoad(acceleration=acceleration):
                density += case.material.areal_density * case.evaluate(acceleration, points, t)[0, 0]
            case PressureLoad(value=value):
                x = case.surface.derivatives(points, order=1)
                normal = np.cross(x[1, 0], x[0, 1])
                normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
                density += case.formula(value).derivatives(points, 0, t)[0, 0][:, None] * normal
    return density


def unit(vector: tuple[float, float, float]) -> Array:
    """Return the vector divided by its length."""
    array = np.asarray(vector, dtype=float)
    normalised: Array = array / np.linalg.norm(array)
    return normalised
