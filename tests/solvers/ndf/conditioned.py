"""A small conditioned field, and what judges it: the frozen tolerances and known values of its case."""

from dataclasses import replace
from functools import cache

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import Tolerance
from shellbench.solvers.ndf.conditioned_solver import ConditionedFieldSolver, ConditionedSettings

PLATE = "conditioned_plate"
SMALL = ConditionedSettings(neurons=60, snapshots=6)


@cache
def small_field(name=PLATE, **settings):
    case = catalog.named_case(name)
    return ConditionedFieldSolver().solve(case, SMALL.model_copy(update=settings))


def missed(solution, solver="ndf-conditioned"):
    """Names of gated quantities whose error is beyond the tolerance."""
    # The case is made anew: it keeps its materials once they are drawn.
    case, found = type(solution.case).model_validate(solution.case.data()), []
    solution = replace(solution, case=case)
    allowed: dict[str, Tolerance] = catalog.tolerances()[solver][case.name]
    for quantity in case.quantities:
        known = catalog.known_values(case.name).judge(quantity.name, case.theory)
        assert known is not None
        bound = allowed[quantity.name]
        largest = bound.absolute if bound.is_absolute else bound.relative * abs(known.value)
        if not abs(quantity.measure(solution) - known.value) <= largest:
            found.append(quantity.name)
    return found
