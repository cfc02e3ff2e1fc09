"""Quantities of the forces of supports and obstacles on the shell."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.displacement_quantities import Direction
from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.question.contact import edge_of_contact, largest_depth, line_length
from shellbench.problems.shell.question.places import Point
from shellbench.protocol.schema import Name, Vector


class SupportQuantity(ShellQuantity):
    """Base of quantities of the forces that a support exerts on the shell.

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

    If supports that hold the same direction meet, each has the force along its own edges, and an equal share of a force
    that is concentrated there, such as at a plate's corner.

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
        asked = direction != 0  # a solver may not know the other components, which are then NaN
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
    """Base of quantities of contact with obstacles."""

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
    """Largest depth of the shell in an obstacle; 0 if it is in none."""

    is_an_error: ClassVar[bool] = True

    kind: Literal["penetration"]

    def measure(self, solution: DisplacementField) -> float:
        """Return the depth, m."""
        return largest_depth(solution, self.at)


class ContactPoint(ContactQuantity):
    """Distance from a point to the start of contact, along a coordinate line of the shell at rest.

    Attributes
    ----------
    point
        Start of the line: a corner or a named point.
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

    def line(self, case: Any) -> tuple[tuple[float, float], int, bool]:
        """Return where its line starts, the coordinate that changes, and whether it grows."""
        place = case.places[self.point]
        assert isinstance(place, Point)
        return place.xi, int(self.along == "xi2"), self.toward == "max"

    def length(self, case: Any) -> float:
        """Return the length of its line, m."""
        return line_length(case, *self.line(case))

    def measure(self, solution: DisplacementField) -> float:
        """Return the distance, m; ValueError if nothing is touched."""
        return edge_of_contact(solution.case, solution.touch(self.at), *self.line(solution.case))
