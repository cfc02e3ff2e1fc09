"""Systems of units of sheets, and a case in one of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

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
    """Names of units."""

    length: str
    force: str
    stress: str

    def unit(self, length: int, force: int) -> str:
        """Return the unit of a dimension length**length force**force, such as "N mm"."""
        if not force:
            return {0: "", 1: self.length}.get(length, f"{self.length}^{length}")
        if length == -2:
            return self.stress
        over = f"/{self.length}" + (f"^{-length}" if length < -1 else "")
        return f"{self.force} {self.length}" if length > 0 else self.force + (over if length else "")

    def of(self, case: Case, quantity: ShellQuantity) -> str:
        """Return the unit of a quantity of a case in these units."""
        powers = quantity.dimension(case)
        if powers == (0, 0) or (self.force, self.length, quantity.unit) == ("N", "m", "J"):
            return quantity.unit
        return self.unit(*powers)


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
    new, system = SYSTEMS[name], System(*name.split("-"))
    ratio = Units(new.length / old.length, new.force / old.force, new.words)
    if (ratio.length, ratio.force) == (1.0, 1.0):
        return case, system
    try:
        data = converted_data(case, ratio)
    except InputError as error:
        raise InputError(f"{case.name}: it can't be given in {name}: {error}") from None
    for quantity, asked in zip(data["quantities"], case.quantities, strict=True):
        quantity["factor"] = asked.factor
    return Case.model_validate(data | {"name": case.name}), system
