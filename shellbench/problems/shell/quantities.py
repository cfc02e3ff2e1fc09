"""Quantities of interest of shells: what a case asks of every solution, what each needs, and how it is measured.

A new quantity is one class, here or imported here: its `kind` is what case files call it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, Union

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from shellbench.errors import InputError
from shellbench.load_curve import Curve
from shellbench.model import Finite, Name, Vector
from shellbench.problems.shell.conditions import Places, VectorFormula
from shellbench.problems.shell.contact import deepest, edge_of_contact
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.measure import area_rule, kinetic_energy, total_energy, unit
from shellbench.problems.shell.modes import ModeQuantity as ModeQuantity
from shellbench.problems.shell.places import Point
from shellbench.problems.shell.quantity import ShellQuantity

Array = NDArray[np.float64]

GRID = 101  # points a side of the first search for the largest displacement
ZOOM = 9  # points a side of each closer look
LEVELS = 10  # closer looks; each is (ZOOM - 1) / 2 times finer than the one before


def _not_zero(direction: Vector) -> Vector:
    if not any(direction):
        raise ValueError("a direction can't be zero")
    return direction


Direction = Annotated[Vector, AfterValidator(_not_zero)]


class PointQuantity(ShellQuantity):
    """What is measured at points, as the mean over them.

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
        points, weights = area_rule(solution.case)
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
    """How far the displacement is from a prescribed one: the norm over the midsurface of u - v, over that of v.

    The norm is the root of the integral of the squared magnitude. A case whose load makes v the answer has the known
    value 0.

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
        points, _ = area_rule(shell)
        try:
            exact = shell.evaluate(self.exact, points, self.at)[0, 0]
        except InputError as error:
            raise ValueError(f"quantity '{self.name}': {error}") from None
        if not np.all(np.isfinite(exact)) or not np.any(exact):
            raise ValueError(f"the displacement of quantity '{self.name}' is zero, or not finite, on the shell")

    def measure(self, solution: DisplacementField) -> float:
        """Return the relative error in the mean square."""
        points, weights = area_rule(solution.case)
        exact = solution.case.evaluate(self.exact, points, self.at)[0, 0]
        error = solution.displacement(points, at=self.at) - exact
        return float(np.sqrt(weights @ np.sum(error**2, axis=-1) / (weights @ np.sum(exact**2, axis=-1))))


class EnergyQuantity(ShellQuantity):
    """Strain energy of the whole shell, or its membrane or bending part, J."""

    of_field: ClassVar[bool] = True
    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["strain_energy", "membrane_energy", "bending_energy"]
    unit: str = "J"

    def measure(self, solution: DisplacementField) -> float:
        """Return the energy, J."""
        membrane, bending = solution.energies(self.at)
        return {"membrane_energy": membrane, "bending_energy": bending}.get(self.kind, membrane + bending)


class MotionEnergy(ShellQuantity):
    """Kinetic energy of the whole shell, or its total energy, J.

    The total energy is kinetic energy, strain energy and that of the springs, less the work of the loads, all of which
    are constant in time: what starts from rest keeps it at zero.
    """

    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["kinetic_energy", "total_energy"]
    unit: str = "J"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError: what stands still has none."""
        raise ValueError(f"quantity '{self.name}' needs a case with [dynamics]")

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError if the total energy is asked for where it is not kept."""
        kept = constant and not shell.following and all(load.spread for load in shell.loads)
        if self.kind == "total_energy" and not kept:
            raise ValueError(
                f"quantity '{self.name}' needs supports at rest, and loads that are dead, constant and spread out"
            )

    def measure(self, solution: DisplacementField) -> float:
        """Return the energy, J."""
        if self.kind == "kinetic_energy":
            return kinetic_energy(solution, self.at)
        return total_energy(solution, self.at)


class PotentialEnergy(ShellQuantity):
    """The potential energy of a state of a path, J: strain energy less the work of its loads, as the history states it.

    Dead loads work on the displacement, a moment on the angle by which the normal has turned about its axis; each with
    its value at that state. Supports that are moved are no loads.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["potential_energy"]
    unit: str = "J"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if the path is not controlled by loads that have a potential."""
        if shell.linear or shell.path.control != "load" or shell.following:
            raise ValueError(
                f"quantity '{self.name}' needs the non-linear theory, a path with control = 'load', and loads that do"
                " not follow the shell"
            )

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError: what moves has a total energy."""
        raise ValueError(f"quantity '{self.name}' belongs to a [path], not to [dynamics]")

    def measure(self, solution: DisplacementField) -> float:
        """Return the energy, J."""
        there = [step.energy for step in solution.history if step.phase == "path" and math.isclose(step.at, self.at)]
        if not there:
            raise ValueError(f"the history has no state of the path at {self.at:g}")
        return float(there[-1])


class SupportQuantity(ShellQuantity):
    """What a support exerts on the shell.

    Attributes
    ----------
    support
        Name of the support.
    """

    series: ClassVar[Literal["motion", "path", ""]] = "path"
    support: Name

    def check(self, shell: Any) -> None:
        """Raise ValueError if there is no such support."""
        names = [s.name for s in shell.supports]
        if self.support not in names:
            raise ValueError(f"quantity '{self.name}' names support '{self.support}'; known are {names}")


class ReactionQuantity(SupportQuantity):
    """The force that a support exerts on the shell, along a direction, N.

    Attributes
    ----------
    direction
        Direction along which the force is taken, of any length.
    """

    powers: ClassVar[tuple[int, int]] = (0, 1)
    kind: Literal["reaction"]
    direction: Vector
    unit: str = "N"

    def measure(self, solution: DisplacementField) -> float:
        """Return the force, N."""
        force, _ = solution.reaction(self.support, at=self.at)
        direction = unit(self.direction)
        asked = direction != 0  # a solver may not know the others, and has NaN there
        return float(force[asked] @ direction[asked])


class TorqueQuantity(SupportQuantity):
    """The moment that a support exerts on the shell, about an axis through a centre, N m.

    Attributes
    ----------
    axis
        Direction of the axis, of any length.
    centre
        Point through which the axis goes, m.
    """

    powers: ClassVar[tuple[int, int]] = (1, 1)
    kind: Literal["torque"]
    axis: Vector
    centre: Vector = (0.0, 0.0, 0.0)
    unit: str = "N m"

    def measure(self, solution: DisplacementField) -> float:
        """Return the moment, N m."""
        _, moment = solution.reaction(self.support, self.centre, at=self.at)
        return float(moment @ unit(self.axis))


class ContactQuantity(ShellQuantity):
    """What is measured of contact with obstacles."""

    series: ClassVar[Literal["motion", "path", ""]] = ""

    def check(self, shell: Any) -> None:
        """Raise ValueError if there is nothing to touch."""
        if not shell.obstacles:
            raise ValueError(f"quantity '{self.name}' is about contact, but the case has no [[obstacles]]")


class ContactForce(ContactQuantity):
    """The force that all obstacles exert on the shell, along a direction, N.

    Attributes
    ----------
    direction
        Direction along which the force is taken, of any length.
    """

    powers: ClassVar[tuple[int, int]] = (0, 1)
    kind: Literal["contact_force"]
    direction: Direction
    unit: str = "N"

    def measure(self, solution: DisplacementField) -> float:
        """Return the force, N."""
        return float(solution.touch(self.at).forces.sum(axis=0) @ unit(self.direction))


class LargestPenetration(ContactQuantity):
    """How deep the shell is in an obstacle anywhere, 0 if it is in none."""

    is_an_error: ClassVar[bool] = True

    kind: Literal["penetration"]

    def measure(self, solution: DisplacementField) -> float:
        """Return the depth, m."""
        return deepest(solution, self.at)


class ContactPoint(ContactQuantity):
    """How far it is from a point to where contact begins, along a coordinate line of the shell at rest.

    Attributes
    ----------
    point
        Where the line starts: a corner or a named point.
    along
        The coordinate that changes on the line.
    toward
        The end of that coordinate to which the line goes.
    """

    kind: Literal["contact_point"]
    point: str
    along: Literal["xi1", "xi2"]
    toward: Literal["min", "max"] = "max"

    @property
    def places(self) -> tuple[str, ...]:
        """Name of its point."""
        return (self.point,)

    def check(self, shell: Any) -> None:
        """Raise ValueError if there is nothing to touch, or the place is no point."""
        super().check(shell)
        if not isinstance(shell.places[self.point], Point):
            raise ValueError(f"quantity '{self.name}' needs a point, but '{self.point}' is none")

    def measure(self, solution: DisplacementField) -> float:
        """Return the distance, m; ValueError if nothing is touched."""
        place = solution.case.places[self.point]
        assert isinstance(place, Point)
        axis = int(self.along == "xi2")
        return edge_of_contact(solution.case, solution.touch(self.at), place.xi, axis, self.toward == "max")


class PathQuantity(ShellQuantity):
    """What belongs to a path and not to one of its kept states.

    Attributes
    ----------
    scale
        Load at the load factor 1, N.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    powers: ClassVar[tuple[int, int]] = (0, 0)  # a load is given by `scale`, in whatever unit that is
    scale: Finite = 1.0
    unit: str = "N"

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if a load alone controls the path."""
        if shell.path.quantity is None:
            raise ValueError(f"quantity '{self.name}' needs a path with control 'displacement' or 'arc_length'")

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError: a motion has no path."""
        raise ValueError(f"quantity '{self.name}' belongs to a [path], not to [dynamics]")


class LoadQuantity(PathQuantity):
    """The load at which the path's displacement first is `at`: the load factor times `scale`, N."""

    kind: Literal["load"]

    def measure(self, solution: DisplacementField) -> float:
        """Return the load, N."""
        return self.scale * curve(solution).factor_at(self.at)


class Unmarked(PathQuantity):
    """A quantity of a state that the path itself marks."""

    @property
    def mark(self) -> float | None:
        """None."""
        return None


class LimitPoint(Unmarked):
    """A turning point of the path, counted from rest.

    Attributes
    ----------
    turning
        What has an extremum there: the load at a limit point, the displacement where the path snaps back.
    number
        Which one, from 1.
    gives
        Its load, the load factor times `scale` (N), or the path's displacement there (m).
    """

    kind: Literal["limit_point"]
    turning: Literal["load", "displacement"] = "load"
    number: int = Field(1, ge=1)
    gives: Literal["load", "displacement"] = "load"

    def dimension(self, shell: Any) -> tuple[int, int]:
        """Return the powers of length and of force in its unit."""
        return (0, 0) if self.gives == "load" else (1, 0)

    def measure(self, solution: DisplacementField) -> float:
        """Return the load, N, or the displacement, m."""
        factor, displacement = curve(solution).turning(self.turning, self.number)
        return self.scale * factor if self.gives == "load" else displacement


class CriticalPoint(Unmarked):
    """The first state of a path at which the shell can buckle: its stiffness ceases to be positive definite.

    Attributes
    ----------
    gives
        "load", the load factor times `scale`; or the name of another quantity, whose value there is given.
    """

    kind: Literal["critical_point"]
    gives: Name = "load"

    def check(self, shell: Any) -> None:
        """Raise ValueError if it gives a quantity that is not there."""
        others = [q.name for q in shell.quantities if q.mark is not None]
        if self.gives not in ("load", *others):
            raise ValueError(f"quantity '{self.name}' gives '{self.gives}'; known are {others}")

    def check_path(self, shell: Any) -> None:
        """Raise ValueError if the path is not controlled by its load, or there is none."""
        if shell.linear or shell.path.control != "load":
            raise ValueError(f"quantity '{self.name}' needs the non-linear theory and a path with control = 'load'")

    def dimension(self, shell: Any) -> tuple[int, int]:
        """Return the powers of length and of force in its unit."""
        given: tuple[int, int] = (0, 0) if self.gives == "load" else shell.quantity(self.gives).dimension(shell)
        return given

    def measure(self, solution: DisplacementField) -> float:
        """Return the load factor of the first critical state, or the value there of the quantity that is named."""
        step = next((step for step in solution.history if step.phase == "critical"), None)
        if step is None:
            raise ValueError("the path has no critical state")
        if self.gives == "load":
            return float(self.scale * step.at)
        other = solution.case.quantity(self.gives)
        return float(other.model_copy(update={"at": step.at}).measure(solution))


def _kinds(base: type[ShellQuantity]) -> list[type[ShellQuantity]]:
    """Return the quantities that case files can ask for: the classes that have a `kind`."""
    own = [base] if "kind" in base.model_fields else []
    return [*own, *(kind for derived in base.__subclasses__() for kind in _kinds(derived))]


if TYPE_CHECKING:
    QuantityModel = ShellQuantity
else:
    QuantityModel = Annotated[Union[tuple(_kinds(ShellQuantity))], Field(discriminator="kind")]  # noqa: UP007


def largest_displacement(solution: DisplacementField, at: float | None = None) -> float:
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


def curve(solution: DisplacementField) -> Curve:
    """Return the load-displacement curve of a solution, by its case's own path; ValueError if it has none."""
    quantity = solution.case.path.quantity
    if quantity is None:
        raise ValueError("the case's path has no displacement quantity")
    return Curve.of(solution.history, quantity)
