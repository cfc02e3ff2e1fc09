"""Whether an answer has settled, by what its solver states of it: one rule for all solvers.

An answer whose headline is stated to be uncertain by more than `SETTLED` has not settled, unless its case allows more.
One that states no uncertainty is taken as it is.
"""

from __future__ import annotations

from collections.abc import Mapping

from shellbench.bench import catalog
from shellbench.bench.compare import allowed_by_file
from shellbench.bench.record import Measured
from shellbench.bench.reference import Tolerance
from shellbench.problem import Problem, Solution

SETTLED = 0.01  # largest stated uncertainty of a value that has settled, relative to it


def with_drifts(
    case: Problem, solution: Solution, values: Mapping[str, Measured]
) -> tuple[dict[str, Measured], str | None]:
    """Add the drift of values that have no limit to their uncertainties.

    Returns
    -------
    tuple
        The values, and a clause on those that drift too far to be given; None if there are none.
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
    """Return why the stated uncertainty of the headline is too large, as a clause; None if it is not.

    A headline near zero is compared with the largest value of its unit among the answers. A tolerance that the case
    states for it, or that is frozen for it, counts if it is larger.
    """
    headline = case.primary
    found = values.get(headline.name)
    if found is None or found.uncertainty is None or headline.is_an_error:
        return None
    value = abs(found.value)
    largest = max(abs(values[q.name].value) for q in case.quantities if q.unit == headline.unit and q.name in values)
    near_zero = headline.absolute or value <= SETTLED * largest
    allowed = SETTLED * (largest if near_zero else value)
    for tolerance in _tolerances(case, solver, own_case):
        allowed = max(allowed, tolerance.largest * (1.0 if tolerance.is_absolute else value))
    if found.uncertainty <= allowed:
        return None
    share = f" ({found.uncertainty / value:.2g} of it)" if value else ""
    return (
        f"{headline.name} is uncertain by {found.uncertainty:.2g} {headline.unit}".rstrip()
        + f"{share}, and at most {allowed:.2g} counts as settled"
    )


def _tolerances(case: Problem, solver: str, own_case: bool) -> list[Tolerance]:
    """Return what is allowed of the headline: by the user's own case, or frozen for one of the suites'."""
    headline = case.primary
    if not own_case:
        frozen = catalog.tolerance(case.name, headline.name, solver)
        return [frozen] if frozen else []
    stated = headline.tolerance.get(solver)
    own = Tolerance.model_validate({"absolute" if headline.absolute else "relative": stated}) if stated else None
    return [one for one in (own, allowed_by_file(case, headline)) if one]
