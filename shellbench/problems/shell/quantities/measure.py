"""Measurement of a shell's solution: its quantities, and integrals over the midsurface."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Quantity
from shellbench.problems.features import ORDER, Division
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.question.directions import in_space
from shellbench.problems.shell.question.features import narrow_division
from shellbench.problems.shell.question.loads import AreaLoad, GravityLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge

Array = NDArray[np.float64]

PANELS, PANEL_POINTS = 24, 4  # a side, of the rule that integrals over the midsurface are taken by


def measure(solution: DisplacementField, quantity: Quantity) -> float:
    """Return the value of a quantity; see `shellbench.problem.Quantity.measure`."""
    return quantity.measure(solution)


def measure_all(solution: DisplacementField, case: Any = None) -> Mapping[str, float]:
    """Return all quantities of the case by name."""
    return {q.name: measure(solution, q) for q in (case or solution.case).quantities}


def measure_reached(solution: DisplacementField) -> Mapping[str, float]:
    """Return by name the quantities that a path has reached; it may have ended early."""
    found = {}
    for quantity in solution.case.quantities:
        with contextlib.suppress(ValueError):
            found[quantity.name] = measure(solution, quantity)
    return found


def area_rule(case: Any) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,), m^2, that integrate over the midsurface: Gauss's rule on panels.

    The panels are equal, and cut where loads or stiffnesses have kinks. `Shell.area_rule` caches the rule of a case.
    """
    (first, along), (second, across) = (_interval_rule(ends[:-1], ends[1:], PANEL_POINTS) for ends in panel_ends(case))
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    return points, np.outer(along, across).ravel() * _area(case, points)


def panel_ends(case: Any) -> tuple[Array, Array]:
    """Return the ends of the panels of `area_rule` along each coordinate."""
    domain = case.surface.domain
    first, second = (
        np.unique([*np.linspace(low, high, PANELS + 1), *cuts])
        for low, high, cuts in zip(domain.lower, domain.upper, case.kinks, strict=True)
    )
    return first, second


def cells_rule(case: Any, division: Division, edge: Edge | None = None) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,) of Gauss's rule on cells that resolve a formula, m^2, or m on an edge."""
    low, high = division.low, division.high
    if edge is not None:
        running = 1 - edge.axis
        at, weights = _interval_rule(low[:, running], high[:, running], ORDER)
        points = edge.points(case.surface.domain, at)
        return points, weights * np.linalg.norm(
            case.surface.derivatives(points, 1)[(0, 1) if running else (1, 0)], axis=-1
        )
    (first, along), (second, across) = (_interval_rule(low[:, axis], high[:, axis], ORDER) for axis in (0, 1))
    first, along, second, across = (each.reshape(-1, ORDER) for each in (first, along, second, across))
    shape = (len(low), ORDER, ORDER)
    each = (np.broadcast_to(first[:, :, None], shape), np.broadcast_to(second[:, None, :], shape))
    points = np.stack(each, axis=-1).reshape(-1, 2)
    return points, (along[:, :, None] * across[:, None, :]).ravel() * _area(case, points)


def rule_of(case: Any, of: Any, edge: Edge | None = None) -> tuple[Array, Array] | None:
    """Return points and weights that integrate a narrow load or spring of the case; None if it is not narrow."""
    division = narrow_division(case, of, edge)
    return None if division is None else cells_rule(case, division, edge)


def _interval_rule(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Return points (n count,) and weights (n count,) of Gauss's rule on n intervals."""
    x, w = np.polynomial.legendre.leggauss(count)
    half = (high - low)[:, None] / 2
    return (low[:, None] + half * (x + 1)).ravel(), (half * w).ravel()


def _area(case: Any, points: Array) -> Array:
    tangents = case.surface.derivatives(points, order=1)
    return np.asarray(np.linalg.norm(np.cross(tangents[1, 0], tangents[0, 1]), axis=-1))


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
    work = sum(float(np.sum(force * solution.displacement(points, at=at))) for force, points in spread_forces(case, at))
    return kinetic_energy(solution, at) + sum(solution.energies(at)) + springs - work


def spread_forces(case: Any, t: float) -> Iterator[tuple[Array, Array]]:
    """Yield the loads spread over the area as forces (n, 3), N, at points (n, 2); narrow ones have their own points."""
    wide, (points, weights) = [], case.area_rule
    for load in case.loads:
        if (own := rule_of(case, load)) is None:
            wide.append(load)
        else:
            yield load_density(case, own[0], t, [load]) * own[1][:, None], own[0]
    yield load_density(case, points, t, wide) * weights[:, None], points


def load_density(case: Any, points: Array, t: float, loads: Iterable[Any] | None = None) -> Array:
    """Return the force per area (n, 3), N/m^2, at points (n, 2) of the given area loads, or of all."""
    density = np.zeros((len(points), 3))
    for load in case.loads if loads is None else loads:
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
