"""Measuring a solution: every quantity of interest by the same few lines, whatever the solver."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from shellbench.case import Case
from shellbench.load_curve import Curve
from shellbench.places import Point
from shellbench.quantities import (
    DisplacementQuantity,
    EnergyQuantity,
    LargestDisplacement,
    LimitPoint,
    LoadQuantity,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
)
from shellbench.solution import Solution

Array = NDArray[np.float64]

GRID = 101  # points a side of the first search for the largest displacement
ZOOM = 9  # points a side of each closer look
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
