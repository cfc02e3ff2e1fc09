"""What a case asks for along the way: quantities that measure the same thing at several times are one series.

A case asks for the same thing at several times by several quantities, `corner_x_200ms` and `corner_x_300ms`; they
are one series. Of a motion the energies are kept too, whether or not the case asks for them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from pydantic import ValidationError

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities import (
    EnergyQuantity,
    LargestDisplacement,
    LoadQuantity,
    MotionEnergy,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
    Unmarked,
)

MARK = re.compile(r"_\d+[a-z]*$")  # how the name of a quantity ends that carries its time: corner_x_200ms
APART = {"name", "description", "unit", "primary", "at", "tolerance", "absolute", "open_finding"}
TOTAL = MotionEnergy(name="total_energy", kind="total_energy")
ENERGIES: tuple[QuantityModel, ...] = (
    MotionEnergy(name="kinetic_energy", kind="kinetic_energy"),
    EnergyQuantity(name="membrane_energy", kind="membrane_energy"),
    EnergyQuantity(name="bending_energy", kind="bending_energy"),
)


@dataclass(frozen=True)
class Asked:
    """One thing that a case measures, whenever it does.

    Attributes
    ----------
    name
        Of its quantities, without their mark.
    quantities
        Those that measure it, by name; none for an energy that the case does not ask for.
    """

    name: str
    quantity: QuantityModel
    quantities: tuple[str, ...]


def asked_series(case: Case) -> tuple[Asked, ...]:
    """Return the series of a case, in its order: all that it measures in motion; of a path forces and torques."""
    moving = case.dynamics is not None
    kinds = LargestDisplacement | LoadQuantity | Unmarked
    wanted = [q for q in case.quantities if not isinstance(q, kinds)]
    if not moving:
        wanted = [q for q in wanted if isinstance(q, ReactionQuantity | TorqueQuantity)] if _by_load(case) else []
    alike: dict[str, list[QuantityModel]] = {}
    for quantity in wanted:
        alike.setdefault(_meaning(quantity), []).append(quantity)
    for quantity in (*ENERGIES, *((TOTAL,) if _keeps_energy(case) else ())) if moving else ():
        alike.setdefault(_meaning(quantity), [])
    energies = {_meaning(quantity): quantity for quantity in (*ENERGIES, TOTAL)}
    found: dict[str, Asked] = {}
    for meaning, quantities in alike.items():
        first = quantities[0] if quantities else energies[meaning]
        short = MARK.sub("", first.name)
        name = short if short not in found else first.name
        found[name] = Asked(name, first, tuple(quantity.name for quantity in quantities))
    return tuple(found.values())


def _by_load(case: Case) -> bool:
    return not case.linear and case.path.quantity is None


def _meaning(quantity: QuantityModel) -> str:
    """Return what two quantities have in common that measure the same thing."""
    return quantity.model_dump_json(exclude=APART)


def _keeps_energy(case: Case) -> bool:
    """Tell whether a case might ask for its total energy."""
    data = case.model_dump(mode="json", exclude_unset=True)
    name = "total_energy_of_the_whole_motion"
    data["quantities"] = [*data["quantities"], {"name": name, "kind": "total_energy", "at": case.states[-1]}]
    try:
        Case.model_validate(data)
    except ValidationError:
        return False
    return True
