"""A case in another system of units, for its sheet."""

from __future__ import annotations

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.variants.units import Units, converted_data
from shellbench.protocol.units import System, factor_between, length_of


def in_system(case: Case, name: str) -> tuple[Case, System, bool]:
    """Return a case in a system of units, the system, and whether the case's own numbers stayed.

    Raises
    ------
    InputError
        If there is no such system, or the case can't be converted.
    """
    system = System.read(name)
    # Forces of cases are in newtons always.
    length, force = factor_between(length_of(case.units) or "m", system.length), factor_between("N", system.force)
    if (length, force) == (1.0, 1.0):
        return case, system, True
    try:
        if any(quantity.factor != 1 for quantity in case.quantities):
            raise InputError("a quantity has a factor, whose unit is not known")
        data = converted_data(case, Units(length, force, name))
    except InputError as error:
        raise InputError(f"{case.name} can't be given in {name}: {error}") from None
    for quantity in data["quantities"]:
        quantity.pop("factor", None)  # which would lead back to the old units
    return Case.model_validate(data | {"name": case.name}), system, False


def unit_in(system: System, own: bool, case: Case, quantity: ShellQuantity) -> str:
    """Return the unit of a quantity of a case in a system; the quantity's own where the case's own numbers stayed."""
    length, force = quantity.dimension(case)
    return quantity.unit if own or (length, force) == (0, 0) else system.unit(length, force)
