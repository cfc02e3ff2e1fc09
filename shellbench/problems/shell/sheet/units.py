"""Systems of units of sheets, and a case in one of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.variants.units import MILLIMETRES_KILONEWTONS, MILLIMETRES_TONNES, Units, converted_data
from shellbench.protocol.spelling import did_you_mean

SI = "m-N-Pa"
SYSTEMS: Mapping[str, Units] = {  # by their units of length, force and stress
    SI: Units(1.0, 1.0, SI),
    "mm-N-MPa": MILLIMETRES_TONNES,
    "mm-kN-GPa": MILLIMETRES_KILONEWTONS,
}


@dataclass(frozen=True)
class System:
    """Names of units.

    Attributes
    ----------
    own
        True if the numbers of the case are in them as they are: units of its quantities stay.
    """

    length: str
    force: str
    stress: str
    own: bool = False

    def unit(self, length: int, force: int) -> str:
        """Return the unit of a dimension length**length force**force, such as "N mm"; neither is above 1."""
        over = f"/{self.length}" + (f"^{-length}" if length < -1 else "") if length < 0 else ""
        if not force:
            return f"1{over}" if over else self.length
        return self.stress if length == -2 else f"{self.force} {self.length}" if length > 0 else self.force + over

    def of(self, case: Case, quantity: ShellQuantity) -> str:
        """Return the unit of a quantity of a case in these units."""
        length, force = quantity.dimension(case)
        return quantity.unit if self.own or (length, force) == (0, 0) else self.unit(length, force)


def in_system(case: Case, name: str) -> tuple[Case, System]:
    """Return a case in a system of units, and their names; the factors of its quantities stay.

    Raises
    ------
    InputError
        If there is no such system, or the case can't be converted.
    """
    if name not in SYSTEMS:
        raise InputError(f"--units: found '{name}'{did_you_mean(name, SYSTEMS)}; allowed are {', '.join(SYSTEMS)}")
    words = set(re.findall(r"\w+", case.units))
    old = Units(1e3 if "mm" in words else 1e-3 if "km" in words else 1.0, 1.0, case.units)  # of force: always newtons
    length, force, stress = name.split("-")
    new, system = SYSTEMS[name], System(length, force, stress)
    ratio = Units(new.length / old.length, new.force / old.force, new.words)
    if (ratio.length, ratio.force) == (1.0, 1.0):
        return case, replace(system, own=True)
    try:
        if any(quantity.factor != 1 for quantity in case.quantities):
            raise InputError("a quantity has a factor, whose unit is not known")
        data = converted_data(case, ratio)
    except InputError as error:
        raise InputError(f"{case.name} can't be given in {name}: {error}") from None
    for quantity in data["quantities"]:
        quantity.pop("factor", None)  # which would lead back to the old units
    return Case.model_validate(data | {"name": case.name}), system
