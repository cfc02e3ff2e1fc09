"""Quantities of interest: what a case asks of every solution."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from shellbench.model import Finite, Model, Positive, Vector
from shellbench.problems.shell.conditions import Name, Places


def _not_zero(direction: Vector) -> Vector:
    if not any(direction):
        raise ValueError("a direction can't be zero")
    return direction


Direction = Annotated[Vector, AfterValidator(_not_zero)]


class Quantity(Model):
    """What all quantities have in common.

    Attributes
    ----------
    tolerance, open_finding
        By solver, in a user's own case only, and judged by no gate: what our cases allow is frozen in
        references/tolerances/, and so are their open findings (see `shellbench.bench.tolerances`).
    absolute
        Whether an error relative to the known value would say nothing, so that it is given in the unit.
    at
        Time, s, or load factor; on a path that no load factor marks, the value of the path's displacement, m
        (see `shellbench.problems.shell.path.Path`).
    """

    name: Name
    description: str = ""
    unit: str = "m"
    primary: bool = False
    at: Finite = 1.0
    tolerance: dict[str, Positive] = Field(default_factory=dict)
    absolute: bool = False
    open_finding: dict[str, str] = Field(default_factory=dict)


class DisplacementQuantity(Quantity):
    """The displacement along a direction at a point, or its mean over points."""

    kind: Literal["displacement"]
    points: Places
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


class PositionQuantity(Quantity):
    """The position x + u along a direction at a point, or its mean over points."""

    kind: Literal["position"]
    points: Places
    direction: Direction


class CentreOfMass(Quantity):
    """The position of the shell's centre of mass along a direction."""

    kind: Literal["centre_of_mass"]
    direction: Direction


class LargestDisplacement(Quantity):
    """The largest magnitude of the displacement anywhere on the shell."""

    kind: Literal["largest_displacement"]


class EnergyQuantity(Quantity):
    """Strain energy of the whole shell, or its membrane or bending part, J."""

    kind: Literal["strain_energy", "membrane_energy", "bending_energy"]
    unit: str = "J"


class MotionEnergy(Quantity):
    """Kinetic energy of the whole shell, or its total energy, J.

    The total energy is kinetic energy, strain energy and that of the springs, less the work of the loads, all of which
    are constant in time: what starts from rest keeps it at zero.
    """

    kind: Literal["kinetic_energy", "total_energy"]
    unit: str = "J"


class ReactionQuantity(Quantity):
    """The force that a support exerts on the shell, along a direction, N."""

    kind: Literal["reaction"]
    support: Name
    direction: Vector
    unit: str = "N"


class TorqueQuantity(Quantity):
    """The moment that a support exerts on the shell, about an axis through a centre, N m."""

    kind: Literal["torque"]
    support: Name
    axis: Vector
    centre: Vector = (0.0, 0.0, 0.0)
    unit: str = "N m"


class LoadQuantity(Quantity):
    """The load at which the path's displacement first is `at`: the load factor times `scale`, N."""

    kind: Literal["load"]
    scale: Finite = 1.0
    unit: str = "N"


class LimitPoint(Quantity):
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
    scale: Finite = 1.0
    unit: str = "N"


class CriticalPoint(Quantity):
    """The first state of a path at which the shell can buckle: its stiffness ceases to be positive definite.

    Attributes
    ----------
    gives
        "load", the load factor times `scale`; or the name of another quantity, whose value there is given.
    """

    kind: Literal["critical_point"]
    gives: Name = "load"
    scale: Finite = 1.0
    unit: str = "N"


Unmarked = LimitPoint | CriticalPoint
"""Quantities of a state that the path itself marks."""

QuantityModel = Annotated[
    DisplacementQuantity
    | PositionQuantity
    | CentreOfMass
    | LargestDisplacement
    | EnergyQuantity
    | MotionEnergy
    | ReactionQuantity
    | TorqueQuantity
    | LoadQuantity
    | LimitPoint
    | CriticalPoint,
    Field(discriminator="kind"),
]
