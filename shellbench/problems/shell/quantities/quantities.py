"""Quantities of interest of shells, which a case asks of every solution: their data and their measurement.

A new quantity is one class in a module that is imported here: its `kind` is its name in case files. It measures itself
in SI units; the field `unit` only names the unit. Some classes have a special treatment in `records.history` (parts of
one vector), `posed.point_actions` (values without a limit) and `variants.reparametrisation` (values that turn with the
normal).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from shellbench.problems.shell.quantities.derivative_quantities import DerivativeQuantity
from shellbench.problems.shell.quantities.displacement_quantities import (
    CentreOfMass,
    DisplacementQuantity,
    FieldError,
    LargestDisplacement,
    PointQuantity,
    PositionQuantity,
    largest_displacement,
)
from shellbench.problems.shell.quantities.energy_quantities import EnergyQuantity, MotionEnergy, PotentialEnergy
from shellbench.problems.shell.quantities.force_quantities import (
    ContactForce,
    ContactPoint,
    LargestPenetration,
    ReactionQuantity,
    SupportQuantity,
    TorqueQuantity,
)
from shellbench.problems.shell.quantities.modes import ModeQuantity
from shellbench.problems.shell.quantities.path_quantities import (
    CriticalPoint,
    LimitPoint,
    LoadQuantity,
    PathQuantity,
    Unmarked,
    curve,
)
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.quantities.resultant_quantities import PlacedQuantity, ResultantQuantity
from shellbench.problems.shell.quantities.shadow_quantities import Shadow
from shellbench.problems.shell.quantities.stress_quantities import Stress

__all__ = [
    "CentreOfMass",
    "ContactForce",
    "ContactPoint",
    "CriticalPoint",
    "DerivativeQuantity",
    "DisplacementQuantity",
    "EnergyQuantity",
    "FieldError",
    "LargestDisplacement",
    "LargestPenetration",
    "LimitPoint",
    "LoadQuantity",
    "ModeQuantity",
    "MotionEnergy",
    "PathQuantity",
    "PlacedQuantity",
    "PointQuantity",
    "PositionQuantity",
    "PotentialEnergy",
    "QuantityModel",
    "ReactionQuantity",
    "ResultantQuantity",
    "Shadow",
    "Stress",
    "SupportQuantity",
    "TorqueQuantity",
    "Unmarked",
    "curve",
    "largest_displacement",
]


def _kinds(base: type[ShellQuantity]) -> list[type[ShellQuantity]]:
    """Return the quantities that case files can ask for: the classes that have a `kind`."""
    own = [base] if "kind" in base.model_fields else []
    return [*own, *(kind for derived in base.__subclasses__() for kind in _kinds(derived))]


if TYPE_CHECKING:
    QuantityModel = ShellQuantity
else:
    QuantityModel = Annotated[Union[tuple(_kinds(ShellQuantity))], Field(discriminator="kind")]  # noqa: UP007
