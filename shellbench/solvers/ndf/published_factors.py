"""The published boundary functions, derived from the supports of any case.

Held edges carry xi (L - xi) on the held components (Kairanda et al., eqs. (61), (64), (65)), with its maximum brought
to 1: as printed it is up to 6e6 on the plate and the training does not start. That is `BoundaryFactors` of this
package, clamps included.

A shell that nothing holds is kept from drifting by holding the points under its point loads against all directions
but that of the load, by factors 1 - exp(-d^2 / sigma) (eq. (66)). For loads along one axis this is the published pair
of factors on the other two components; for any directions it is the product of the matrices
I - exp(-d^2 / sigma) (I - f f^T / |f|^2), exact where no second load is within a few sqrt(sigma). The distance is taken
in the units of the case file, degrees for angles, as eq. (66) is written: in radians the samples strike its steep
flank every few dozen iterations, and Adam does not recover from the gradient there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import PointLoad
from shellbench.problems.shell.places import Edge, Point
from shellbench.solvers.ndf.build import FieldSpec
from shellbench.solvers.ndf.factors import BoundaryFactors
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.jets import VALUE, Array, Placement, compose, constant, coordinates, matrix_product
from shellbench.solvers.ndf.lift import Lift

SIGMA = 0.01  # Kairanda et al., section 5.2; in squared units of the case file's coordinates
FAR = 700.0  # d^2 / sigma beyond this is taken as this: exp underflows to nothing


@dataclass(frozen=True)
class PublishedFactors:
    """The matrix M of the published ansatz u = M F of a case."""

    case: Case
    t: float = 1.0

    @cached_property
    def pins(self) -> tuple[tuple[Point, Array], ...]:
        """Points that are held beside their load, with the matrices (3, 3) of the directions held there."""
        if self.case.supports or not self.case.remove_rigid_motions:
            return ()
        pins = []
        for load in (load for load in self.case.loads if isinstance(load, PointLoad)):
            for place in (self.case.places[name] for name in load.on):
                if isinstance(place, Point):
                    force = self.case.evaluate(load.force, np.asarray(place.xi), self.t)[0, 0]
                    square = float(force @ force)
                    if square > 0:
                        pins.append((place, np.eye(3) - np.outer(force, force) / square))
        return tuple(pins)

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        matrix = BoundaryFactors(self.case).matrix(points, placement)
        for point, directions in self.pins:
            bump = self._bump(point, points, placement)
            identity = constant(torch.eye(3, device=placement.device, dtype=placement.dtype).expand(len(points), 3, 3))
            factor = identity - bump[..., None, None] * placement.tensor(directions)
            matrix = matrix_product(matrix, factor)
        return matrix

    def _bump(self, point: Point, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N) of exp(-d^2 / sigma), d in the units of the case file."""
        first, second = (180 / math.pi if angle else 1.0 for angle in self.case.surface.domain.angle)
        return soft_bump(self.case, point, (first, second), points, placement)


def soft_bump(
    case: Case, place: Edge | Point, units: tuple[float, float], points: Array, placement: Placement
) -> Tensor:
    """Return the jet (6, N) of exp(-d^2 / sigma) at points (N, 2), d the distance from a place (eq. (27)).

    Differences of xi1 and xi2 count as so many `units` each; that from an edge is across it alone. A periodic
    coordinate goes the shorter way round.
    """
    domain = case.surface.domain
    exponent = constant(placement.tensor(np.zeros(len(points))))
    for axis, coordinate in enumerate(coordinates(points, placement)):
        if isinstance(place, Edge) and axis != place.axis:
            continue
        offset = points[:, axis] - (place.coordinate(domain) if isinstance(place, Edge) else place.xi[axis])
        if domain.periodic[axis]:
            offset = offset - domain.size[axis] * np.round(offset / domain.size[axis])
        distance = coordinate * (units[axis] / math.sqrt(SIGMA))
        distance[VALUE] = placement.tensor(offset * (units[axis] / math.sqrt(SIGMA)))
        exponent = exponent - _square(distance)
    value = torch.exp(exponent[VALUE].clamp_min(-FAR))
    value = torch.where(exponent[VALUE] <= -FAR, torch.zeros_like(value), value)
    return compose((value, value, value), exponent)


def _square(z: Tensor) -> Tensor:
    v = z[VALUE]
    return compose((v * v, 2 * v, torch.full_like(v, 2.0)), z)


def published_ansatz(case: Case, spec: FieldSpec) -> Ansatz:
    """Return the published way of building in the supports of a case."""
    return Ansatz(case, PublishedFactors(case, spec.t), Lift(case, spec.t), spec.t)
