"""Points of a shell at which something acts: their held directions, and the softness of the shell there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.posed.rigid import middle_and_size
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.question.directions import held_directions, local_directions
from shellbench.problems.shell.question.places import Place, Point, Whole
from shellbench.problems.shell.question.surface import Domain

Array = NDArray[np.float64]

NO_PART = 1e-6  # of a vector: a smaller part of it is rounding
SLACK = 1e-9  # of a side, or of a row: a smaller difference counts as none
EFFECTIVE = 4.0  # a force on a cell acts as if spread over a length between the cell and its quarter


@dataclass(frozen=True)
class Spot:
    """A point of the shell at which something acts.

    Attributes
    ----------
    normal
        Unit normal (3,) there.
    held
        Orthonormal directions (n, 3) in which supports hold it.
    softness
        Displacement that a unit force along the midsurface adds with each halving of the cell, m/N.
    halvings
        Number of halvings from a cell as large as the shell to one as small as the thickness.
    bent
        Thickness times the largest curvature there.
    shears
        Whether, in its theory, a force along the normal too moves it without bound.
    """

    name: str
    xi: tuple[float, float]
    normal: Array
    held: Array
    softness: float
    halvings: float
    bent: float
    shears: bool

    def free_part(self, vector: ArrayLike) -> Array:
        """Return the part (3,) of a vector that no support holds."""
        given = np.asarray(vector, dtype=float)
        return np.asarray(given - self.held.T @ (self.held @ given))

    def unlimited_part(self, vector: ArrayLike) -> Array:
        """Return the part (3,) of a vector along which the point moves without bound."""
        free = self.free_part(vector)
        return free if self.shears else free - self.normal * (self.normal @ free)

    def unlimited_share(self, direction: ArrayLike) -> float:
        """Return the relative length, from 0 to 1, of the unlimited part of a direction; 0 if it is rounding."""
        share = float(np.linalg.norm(self.unlimited_part(direction)) / np.linalg.norm(direction))
        return share if share > NO_PART else 0.0


def spot_at(case: Shell, place: Point) -> Spot:
    """Return the data of a point at which something acts: normal, held directions, softness and others."""
    domain, point = case.surface.domain, np.array([place.xi])
    x = case.surface.derivatives(point, order=2)
    normal = local_directions(case.surface, point)[0, 2]
    modulus, thickness = (float(f[0]) for f in case.material.factors(point, case.surface.named_constants))
    nu = case.material.poissons_ratios[0]
    stretching = case.material.membrane_stiffness * (1 - nu**2) * modulus * thickness  # E h
    thickness *= case.material.thickness
    first, second = x[1, 0][0], x[0, 1][0]
    metric = np.array([[first @ first, first @ second], [first @ second, second @ second]])
    curvature = np.array([[x[2, 0][0], x[1, 1][0]], [x[1, 1][0], x[0, 2][0]]]) @ normal
    largest = thickness * float(np.abs(np.linalg.eigvals(np.linalg.solve(metric, curvature))).max())
    angle = _angle(domain, place.xi, first, second)
    unit = (1 + nu) * (3 - nu) / (4 * math.pi) if angle is None else 2 / (angle - math.sin(angle))
    return Spot(
        name=place.name,
        xi=place.xi,
        normal=normal,
        held=held_at(case, place, points=True),
        softness=unit * math.log(2) / stretching,
        halvings=math.log2(EFFECTIVE * max(1.0, 2 * middle_and_size(case.surface)[1] / thickness)),
        bent=largest if largest > NO_PART else 0.0,
        shears=case.theory == "naghdi-linear",
    )


def _angle(domain: Domain, xi: tuple[float, float], first: Array, second: Array) -> float | None:
    """Return the angle of the shell's sector around a point of its edge; None inside."""
    ends = []
    for axis, tangent in enumerate((first, second)):
        at = (xi[axis] - domain.lower[axis]) / domain.size[axis]
        if not domain.periodic[axis] and min(abs(at), abs(at - 1)) <= SLACK:
            ends.append(tangent / np.linalg.norm(tangent) * (1 if at < 0.5 else -1))
    if len(ends) < len(xi):
        return math.pi if ends else None
    return math.acos(float(np.clip(ends[0] @ ends[1], -1.0, 1.0)))


def is_on(case: Shell, place: Place, xi: tuple[float, float]) -> bool:
    """Return True if a point lies on a place."""
    if isinstance(place, Whole):
        return True
    domain = case.surface.domain
    point = domain.wrap(xi)
    at = place.xi if isinstance(place, Point) else place.project(domain, point)
    covered = isinstance(place, Point) or bool(place.covers(domain, point[1 - place.axis]))
    return covered and bool(np.all(np.abs(domain.wrap(at) - point) <= SLACK * np.asarray(domain.size)))


def held_at(case: Shell, place: Point, points: bool) -> Array:
    """Return orthonormal directions (k, 3) in which supports hold a point; supports on points count if `points`."""
    rows = [np.zeros((1, 3))]
    for support, other in case.supported_places():
        if (points or not isinstance(other, Point)) and is_on(case, other, place.xi):
            rows.append(held_directions(case.surface, support, other, np.array([place.xi]))[0])
    return orthonormal(np.concatenate(rows))


def orthonormal(rows: Array) -> Array:
    """Return an orthonormal basis (k, 3) of the span of rows (n, 3) of lengths up to 1."""
    _, sizes, basis = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(basis[sizes > SLACK])
