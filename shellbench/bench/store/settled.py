"""Settled answers, by their stated uncertainty: one rule for all solvers.

An answer has not settled if the stated uncertainty of its headline exceeds `SETTLED`, unless its case allows more.
An answer without a stated uncertainty counts as settled.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import allowed_by_file
from shellbench.bench.store.record import Measured
from shellbench.problem import Problem, Solution

SETTLED = 0.01  # largest stated uncertainty of a value that has settled, relative to it


def with_drifts(
    case: Problem, solution: Solution, values: Mapping[str, Measured]
) -> tuple[dict[str, Measured], str | None]:
    """Add the drifts of values without a limit to their uncertainties.

    Returns
    -------
    tuple
        The values, and a clause on those whose drift is too large; None if there are none.
    """
    result, far = dict(values), []
    for name, drift in case.drifts(solution).items():
        if name in result:
            one, moved = result[name], drift * case.quantity(name).factor
            total = None if one.uncertainty is None else one.uncertainty + moved
            result[name] = one.model_copy(update={"uncertainty": total})
            if not moved <= SETTLED * abs(one.value):
                far.append(f"{name} by {moved:.2g}")
    why = f"the drift is more than {SETTLED:.0%} of the value ({', '.join(far)}): {case.remark}"
    return result, why if far else None


def why_uncertain(case: Problem, solver: str, own_case: bool, values: Mapping[str, Measured]) -> str | None:
    """Return the reason why the stated uncertainty of the headline is too large, as a clause; None if it is not.

    A headline near zero is compared with the largest value of its unit among the answers. A tolerance that the case
    states, or that is frozen for the solver, counts if it is larger.
    """
    headline = case.primary
    found = values.get(headline.name)
    if found is None or found.uncertainty is None or headline.is_an_error:
        return None
    value = abs(found.value)
    largest = max(abs(values[q.name].value) for q in case.quantities if q.unit == headline.unit and q.name in values)
    near_zero = headline.absolute or value <= SETTLED * largest
    allowed = SETTLED * (largest if near_zero else value)
    for largest_error, absolute in _tolerances(case, solver, own_case):
        allowed = max(allowed, largest_error * (1.0 if absolute else value))
    if found.uncertainty <= allowed:
        return None
    share = f" ({found.uncertainty / value:.2g} of it)" if value else ""
    return (
        f"{headline.name} is uncertain by {found.uncertainty:.2g} {headline.unit}".rstrip()
        + f"{share}, and at most {allowed:.2g} counts as settled"
    )


def _tolerances(case: Problem, solver: str, own_case: bool) -> Iterator[tuple[float, bool]]:
    """Yield the tolerances of the headline from a user's own case or frozen ones, with True for those in its unit."""
    headline = case.primary
    frozen = allowed_by_file(case, headline) if own_case else catalog.tolerance(case.name, headline.name, solver)
    if frozen:
        yield frozen.largest, frozen.is_absolute
    if own_case and solver in headline.tolerance:
        yield headline.tolerance[solver], headline.absolute
