"""Measuring a solution: every quantity of interest by the same few lines, whatever the solver."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Solution
from shellbench.problems.load_curve import Curve
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import AreaLoad, GravityLoad, PressureLoad
from shellbench.problems.shell.places import Point
from shellbench.problems.shell.quantities import (
    CentreOfMass,
    CriticalPoint,
    DisplacementQuantity,
    EnergyQuantity,
    LargestDisplacement,
    LimitPoint,
    LoadQuantity,
    MotionEnergy,
    PositionQuantity,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
)

Array = NDArray[np.float64]

GRID = 101  # points a side of the first search for the largest displacement
ZOOM = 9  # points a side of each closer look
PANELS, PANEL_POINTS = 24, 4  # a side, of the rule that integrals over the midsurface are taken by
LEVELS = 10  # closer looks; each is (ZOOM - 1) / 2 times finer than the one before


def measure(solution: Solution, quantity: QuantityModel) -> float:
    """Return the value of a quantity, in SI units (see the classes of quantities for which).

    Raises
    ------
    ValueError
        If it belongs to a point of the path that the solution did not reach.
    """
    match quantity:
        case DisplacementQuantity():
            return mean_displacement(solution, quantity)
        case PositionQuantity():
            return mean_position(solution, quantity)
        case CentreOfMass():
            return centre_of_mass(solution, quantity)
        case MotionEnergy(kind="kinetic_energy"):
            return kinetic_energy(solution, quantity.at)
        case MotionEnergy():
            return total_energy(solution, quantity.at)
        case CriticalPoint():
            return at_critical_point(solution, quantity)
        case LargestDisplacement():
            return largest_displacement(solution, quantity.at)
        case EnergyQuantity():
            membrane, bending = solution.energies(quantity.at)
            return {"membrane_energy": membrane, "bending_energy": bending}.get(quantity.kind, membrane + bending)
        case ReactionQuantity():
            force, _ = solution.reaction(quantity.support, at=quantity.at)
            return float(force @ unit(quantity.direction))
        case LoadQuantity():
            return quantity.scale * curve(solution).factor_at(quantity.at)
        case LimitPoint():
            factor, displacement = curve(solution).turning(quantity.turning, quantity.number)
            return quantity.scale * factor if quantity.gives == "load" else displacement
        case TorqueQuantity():
            _, moment = solution.reaction(quantity.support, quantity.centre, at=quantity.at)
            return float(moment @ unit(quantity.axis))


def measure_all(solution: Solution, case: Case | None = None) -> Mapping[str, float]:
    """Return all quantities of the case by name."""
    return {q.name: measure(solution, q) for q in (case or solution.case).quantities}


def mean_displacement(solution: Solution, quantity: DisplacementQuantity) -> float:
    """Return the displacement along the quantity's directions, averaged over its points, metres."""
    places = [solution.case.places[name] for name in quantity.points]
    points = np.array([place.xi for place in places if isinstance(place, Point)])
    displacement = solution.displacement(points, at=quantity.at)
    directions = np.array([unit(d) for d in quantity.directions])
    return float(np.mean(np.sum(displacement * directions, axis=-1)))


def largest_displacement(solution: Solution, at: float | None = None) -> float:
    """Return the largest magnitude of the displacement, metres.

    A search on a regular grid and at the case's own points, then ever closer looks around the best point.
    """
    domain = solution.case.surface.domain
    lower, upper = np.asarray(domain.lower), np.asarray(domain.upper)
    named = [place.xi for place in solution.case.places.values() if isinstance(place, Point)]
    candidates = np.concatenate([domain.grid(GRID, GRID).reshape(-1, 2), np.array(named).reshape(-1, 2)])
    reach = (upper - lower) / (GRID - 1)
    offsets = np.linspace(-1.0, 1.0, ZOOM)
    window = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    largest = 0.0
    for _ in range(LEVELS + 1):
        magnitudes = np.linalg.norm(solution.displacement(candidates, at=at), axis=-1)
        best = int(np.argmax(magnitudes))
        largest = max(largest, float(magnitudes[best]))
        candidates = candidates[best] + reach * window
        inside = np.asarray(domain.periodic) | ((candidates >= lower) & (candidates <= upper))
        candidates = np.where(inside, candidates, np.clip(candidates, lower, upper))
        reach = reach * 2 / (ZOOM - 1)
    return largest


def mean_position(solution: Solution, quantity: PositionQuantity) -> float:
    """Return the position along the quantity's direction, averaged over its points, metres."""
    places = [solution.case.places[name] for name in quantity.points]
    points = np.array([place.xi for place in places if isinstance(place, Point)])
    position = solution.case.surface.position(points) + solution.displacement(points, at=quantity.at)
    return float(np.mean(position @ unit(quantity.direction)))


def area_rule(case: Case) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,), m^2, that integrate over the midsurface: Gauss's rule on equal panels."""
    domain = case.surface.domain
    x, w = np.polynomial.legendre.leggauss(PANEL_POINTS)
    start = np.arange(PANELS)[:, None]
    local, weights = ((start + (x + 1) / 2) / PANELS).ravel(), np.tile(w / 2 / PANELS, PANELS)
    first, second = (low + size * local for low, size in zip(domain.lower, domain.size, strict=True))
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    tangents = case.surface.derivatives(points, order=1)
    area = np.linalg.norm(np.cross(tangents[1, 0], tangents[0, 1]), axis=-1)
    return points, np.outer(weights, weights).ravel() * np.prod(domain.size) * area


def centre_of_mass(solution: Solution, quantity: CentreOfMass) -> float:
    """Return the position of the centre of mass along the quantity's direction, metres."""
    points, weights = area_rule(solution.case)
    position = solution.case.surface.position(points) + solution.displacement(points, at=quantity.at)
    return float(weights @ position @ unit(quantity.direction) / weights.sum())


def kinetic_energy(solution: Solution, at: float) -> float:
    """Return half the areal density times the velocity squared, over the whole shell, J."""
    points, weights = area_rule(solution.case)
    velocity = solution.velocity(points, at)
    return float(solution.case.material.areal_density / 2 * (weights @ np.sum(velocity**2, axis=-1)))


def total_energy(solution: Solution, at: float) -> float:
    """Return kinetic energy, strain energy and that of springs, less the work of constant loads, J."""
    case = solution.case
    points, weights = area_rule(case)
    u = solution.displacement(points, at=at)
    springs = float(weights @ np.sum(case.spring_stiffness(points) * u**2, axis=-1)) / 2
    work = float(weights @ np.sum(load_density(case, points, at) * u, axis=-1))
    return kinetic_energy(solution, at) + sum(solution.energies(at)) + springs - work


def load_density(case: Case, points: Array, t: float) -> Array:
    """Return the loads that are spread over the area as a force per area (n, 3), N/m^2, at points (n, 2)."""
    density = np.zeros((len(points), 3))
    for load in case.loads:
        match load:
            case AreaLoad(vector=vector):
                density += case.evaluate(vector, points, t)[0, 0]
            case GravityLoad(acceleration=acceleration):
                density += case.material.areal_density * case.evaluate(acceleration, points, t)[0, 0]
            case PressureLoad(value=value):
                x = case.surface.derivatives(points, order=1)
                normal = np.cross(x[1, 0], x[0, 1])
                normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
                density += case.formula(value).derivatives(points, 0, t)[0, 0][:, None] * normal
    return density


def at_critical_point(solution: Solution, quantity: CriticalPoint) -> float:
    """Return the load factor of the first critical state, or the value there of the quantity that is named.

    Raises
    ------
    ValueError
        If the path has no critical state.
    """
    step = next((step for step in solution.history if step.phase == "critical"), None)
    if step is None:
        raise ValueError("the path has no critical state")
    if quantity.gives == "load":
        return quantity.scale * step.at
    other = solution.case.quantity(quantity.gives)
    return measure(solution, other.model_copy(update={"at": step.at}))


def curve(solution: Solution) -> Curve:
    """Return the load-displacement curve of a solution, by its case's own path; ValueError if it has none."""
    quantity = solution.case.path.quantity
    if quantity is None:
        raise ValueError("the case's path has no displacement quantity")
    return Curve.of(solution.history, quantity)


def unit(vector: tuple[float, float, float]) -> Array:
    """Return the vector divided by its length."""
    array = np.asarray(vector, dtype=float)
    normalised: Array = array / np.linalg.norm(array)
    return normalised
