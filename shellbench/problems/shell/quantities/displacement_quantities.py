"""Quantities of the displacement field: at points, over the whole shell, and its distance from a known field."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from shellbench.errors import InputError
from shellbench.problems.features import MOST_CELLS, Division, divided
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.measure import cells_rule, panel_ends, unit
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.question.conditions import Places, VectorFormula
from shellbench.problems.shell.question.features import shown_place
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.question.search import largest
from shellbench.protocol.schema import Vector

Array = NDArray[np.float64]


def _not_zero(direction: Vector) -> Vector:
    if not any(direction):
        raise ValueError("a direction can't be zero")
    return direction


Direction = Annotated[Vector, AfterValidator(_not_zero)]


class PointQuantity(ShellQuantity):
    """Base of quantities that are measured at points, as the mean over them.

    Attributes
    ----------
    points
        Corners and named points.
    """

    of_field: ClassVar[bool] = True
    points: Places

    @property
    def places(self) -> tuple[str, ...]:
        """Names of its points."""
        return self.points

    def check(self, shell: Any) -> None:
        """Raise ValueError if a place is no point."""
        for name in self.points:
            if not isinstance(shell.places[name], Point):
                raise ValueError(f"quantity '{self.name}' needs points, but '{name}' is none")

    def coordinates(self, solution: DisplacementField) -> Array:
        """Return the points (n, 2)."""
        places = [solution.case.places[name] for name in self.points]
        return np.array([place.xi for place in places if isinstance(place, Point)])


class DisplacementQuantity(PointQuantity):
    """The displacement along a direction at a point, or its mean over points.

    Attributes
    ----------
    direction
        One direction for all points, or one for each, of any length.
    """

    kind: Literal["displacement"]
    direction: Vector | Annotated[tuple[Vector, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _has_a_direction_for_each_point(self) -> Self:
        given = self.direction
        several = isinstance(given[0], tuple)
        if several and len(given) != len(self.points):
            raise ValueError(f"{len(given)} directions for {len(self.points)} points; give one, or one for each point")
        if not all(any(d) for d in self.directions):
            raise ValueError("a direction can't be zero")
        return self

    @property
    def directions(self) -> tuple[Vector, ...]:
        """One direction for each point, as given (not normalised)."""
        if isinstance(self.direction[0], tuple):
            return self.direction
        return (self.direction,) * len(self.points)

    def measure(self, solution: DisplacementField) -> float:
        """Return the displacement along the directions, averaged over the points, metres."""
        displacement = solution.displacement(self.coordinates(solution), at=self.at)
        directions = np.array([unit(d) for d in self.directions])
        return float(np.mean(np.sum(displacement * directions, axis=-1)))


class PositionQuantity(PointQuantity):
    """The position x + u along a direction at a point, or its mean over points.

    Attributes
    ----------
    direction
        Direction along which it is taken, of any length.
    """

    kind: Literal["position"]
    direction: Direction

    def measure(self, solution: DisplacementField) -> float:
        """Return the position along the direction, averaged over the points, metres."""
        points = self.coordinates(solution)
        position = solution.case.surface.position(points) + solution.displacement(points, at=self.at)
        return float(np.mean(position @ unit(self.direction)))


class CentreOfMass(ShellQuantity):
    """The position of the shell's centre of mass along a direction.

    Attributes
    ----------
    direction
        Direction along which it is taken, of any length.
    """

    of_field: ClassVar[bool] = True
    kind: Literal["centre_of_mass"]
    direction: Direction

    def measure(self, solution: DisplacementField) -> float:
        """Return the position along the direction, metres."""
        points, weights = solution.case.area_rule
        position = solution.case.surface.position(points) + solution.displacement(points, at=self.at)
        return float(weights @ position @ unit(self.direction) / weights.sum())


class LargestDisplacement(ShellQuantity):
    """The largest magnitude of the displacement anywhere on the shell."""

    series: ClassVar[Literal["motion", "path", ""]] = ""
    of_field: ClassVar[bool] = True
    kind: Literal["largest_displacement"]

    def measure(self, solution: DisplacementField) -> float:
        """Return the largest magnitude, metres."""
        return largest_displacement(solution, self.at)


class FieldError(ShellQuantity):
    """Error of the displacement u against a prescribed one, v: the norm of u - v over the midsurface, over that of v.

    The norm is the root of the integral of the squared magnitude. If the load of the case makes v the exact solution,
    the known value is 0.

    Attributes
    ----------
    exact
        v by component, m: numbers or formulas in xi1, xi2 and t.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    of_field: ClassVar[bool] = True
    powers: ClassVar[tuple[int, int]] = (0, 0)
    kind: Literal["field_error"]
    exact: VectorFormula
    unit: str = ""

    def check(self, shell: Any) -> None:
        """Raise ValueError if the prescribed displacement is no formula, not finite, or zero everywhere."""
        points, _ = shell.area_rule
        try:
            exact = shell.evaluate(self.exact, points, self.at)[0, 0]
        except InputError as error:
            raise ValueError(f"quantity '{self.name}': {error}") from None
        if not np.all(np.isfinite(exact)) or not np.any(exact):
            raise ValueError(f"the displacement of quantity '{self.name}' is zero, or not finite, on the shell")
        if (at := self._division(shell).undecided) is not None:
            raise ValueError(
                f"the displacement of quantity '{self.name}' varies more quickly than {MOST_CELLS} cells tell, at"
                f" {shown_place(shell, at)}"
            )

    def _division(self, shell: Any) -> Division:
        """Return cells that resolve the prescribed displacement, none larger than panels of the rule of the case."""
        first, second = (tuple(ends) for ends in panel_ends(shell))
        domain = shell.surface.domain
        (low, bottom), (high, top) = domain.lower, domain.upper
        formulas = [shell.formula(text) for text in self.exact]
        return divided([(formulas, self.at)], ((low, high), (bottom, top)), lines=(first, second))

    def _rule(self, shell: Any) -> tuple[Array, Array]:
        division = self._division(shell)
        return cells_rule(shell, division) if division.narrow.any() else shell.area_rule

    def measure(self, solution: DisplacementField) -> float:
        """Return the relative error in the mean square."""
        points, weights = self._rule(solution.case)
        exact = solution.case.evaluate(self.exact, points, self.at)[0, 0]
        error = solution.displacement(points, at=self.at) - exact
        return float(np.sqrt(weights @ np.sum(error**2, axis=-1) / (weights @ np.sum(exact**2, axis=-1))))


def largest_displacement(solution: DisplacementField, at: float | None = None) -> float:
    """Return the largest magnitude of the displacement, metres; the search includes the points of the case."""
    named = [place.xi for place in solution.case.places.values() if isinstance(place, Point)]

    def magnitudes(points: Array) -> Array:
        return np.asarray(np.linalg.norm(solution.displacement(points, at=at), axis=-1))

    return largest(solution.case.surface.domain, magnitudes, np.array(named).reshape(-1, 2))
