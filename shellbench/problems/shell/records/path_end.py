"""A path that ends early: the states that it reached are kept, and the missing quantities are named."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_reached
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.solution import ShellSolution
from shellbench.problems.shell.symmetry.symmetry import part_of

Solved = TypeVar("Solved", bound=ShellSolution)


def cut_short(solution: Solved, why: str) -> Solved:
    """Return a path that ended early, marked as not settled if it lacks an asked quantity.

    Parameters
    ----------
    solution
        The path as far as it came.
    why
        Reason for its end, as a clause.

    Raises
    ------
    SolveFailure
        If the primary quantity was not reached; the solution comes with it.
    """
    case, found = solution.case, measure_reached(solution)
    missing = [quantity for quantity in case.quantities if quantity.name not in found]
    if any(quantity.primary for quantity in missing):
        raise SolveFailure(why, partial=solution)
    names = [quantity.name for quantity in missing]
    return replace(
        solution,
        unsettled=f"{why}; not reached: {', '.join(names)}" if names else None,
        diagnostics={**solution.diagnostics, "path_end": why, "not_reached": names},
    )


def branch_passed(case: Case, factor: float) -> str:
    """Return a sentence on the branch that a path passed before a load factor, with the way to go on if one is known.

    A model of the part between the mirrors does not have a branch that breaks a symmetry of the case.
    """
    found = f"a branch of other equilibria was passed before load factor {factor:.6g}"
    planes = sorted({f"{COMPONENTS[m.normal]} = {m.offset:.6g}" for m in part_of(case).mirrors})
    if not planes:
        return found
    return (
        f"{found}; a model of one half, with a support of symmetry at {' or '.join(planes)}, answers the rest"
        " if the branch breaks that symmetry"
    )
