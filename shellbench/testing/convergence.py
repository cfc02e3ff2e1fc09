"""Check of convergence under refinement: the rate and the limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.problem import Problem
from shellbench.problems.shell.case import Case
from shellbench.protocol.limit import limit_of
from shellbench.testing.examination import Examination, Findings, Verdict, not_applicable, not_shown

FEWEST, MOST = 3, 5  # least and largest number of levels for a rate
FLOOR = 1e-9  # relative error below which rounding and the known value's digits dominate
FALLS = 0.5  # largest ratio of the last difference or error to the largest one in a converging sequence
ELSEWHERE = 3.0  # multiple of the remaining difference; a larger error is no lack of resolution
STUDY = "resolution"
UNKNOWNS, STEPS = ("unknowns", 2), ("steps", 1)  # numbers that refinement increases, on a surface and in time


@dataclass(frozen=True)
class Refinement:
    """One refinement.

    Attributes
    ----------
    unknowns
        The answer's `parameters`; if refinement adds none, the product of the numbers among the settings.
    value
        The headline quantity.
    """

    settings: Mapping[str, Any]
    unknowns: float
    value: float


def convergence(exam: Examination, case: Problem) -> Verdict:
    """Check that the headline's error falls under refinement; without a known value, that its steps fall."""
    levels = solve_refinements(exam, case)
    if isinstance(levels, str):
        return not_applicable(levels)
    known = catalog.known_values(case.name).judge(case.primary.name, case.theory)
    of_shell = isinstance(case, Case)
    return judge(levels, known.value if known else None, *(UNKNOWNS if of_shell else STEPS))


def solve_refinements(exam: Examination, case: Problem) -> list[Refinement] | str:
    """Solve a case at each refinement, from few unknowns to many; or return the reason why this is impossible."""
    chosen, words = refinements(exam, case)
    if len(chosen) < FEWEST:
        return words
    levels = []
    for settings in chosen:
        answer = exam.solve(case, settings)
        unknowns = answer.facts["parameters"] if isinstance(case, Case) else float(np.prod(_numbers(settings)))
        levels.append(Refinement(settings, unknowns if isinstance(unknowns, int | float) else 0, answer.headline()))
    return levels


def refinements(exam: Examination, case: Problem) -> tuple[list[Mapping[str, Any]], str]:
    """Return settings from coarse to fine: the given ones, the solver's own, or a suite's; or the reason for none."""
    own = exam.refinements or tuple(exam.facts["refinements"])
    found = list(own) if own else _swept(exam.entry.name, case.name)
    reason = f"it has no refinements, and no suite on {STUDY} sweeps it on {case.name}: give some by --refine"
    return spread_out(found, MOST), reason


def spread_out(refinements: Sequence[Mapping[str, Any]], most: int) -> list[Mapping[str, Any]]:
    """Return a limited number of a sequence of settings, with the first and the last, at about equal factors."""
    sizes = np.array([np.prod(_numbers(settings)) for settings in refinements], dtype=float)
    if len(sizes) <= most or sizes.min() <= 0:
        return list(refinements)[-most:]
    wanted = np.linspace(np.log(sizes[0]), np.log(sizes[-1]), most)
    return [refinements[i] for i in sorted({int(np.argmin(np.abs(np.log(sizes) - size))) for size in wanted})]


def _numbers(value: Any) -> list[float]:
    """Return all numbers in settings: their product measures the refinement, up to a common factor."""
    match value:
        case bool() | str() | None:
            return []
        case int() | float():
            return [float(value)]
        case Mapping():
            return [number for part in value.values() for number in _numbers(part)]
        case list() | tuple():
            return [number for part in value for number in _numbers(part)]
    return []


def _swept(solver: str, case: str) -> list[Mapping[str, Any]]:
    """Return the longest sweep that a suite declares for a solver and a case."""
    sweeps: dict[str, list[Mapping[str, Any]]] = {}
    for name in catalog.suite_names():
        suite = catalog.find_suite(name)
        if suite.study != STUDY:
            continue
        for run in suite.runs:
            if run.solver == solver and (not run.cases or case in run.cases) and run.settings:
                rest = {k: v for k, v in run.settings.items() if not isinstance(v, list)}
                sweeps.setdefault(f"{sorted(run.settings)} {rest if len(rest) < len(run.settings) else ''}", []).append(
                    run.settings
                )
    return max(sweeps.values(), key=len, default=[])


def judge(levels: Sequence[Refinement], known: float | None, what: str = "unknowns", dimension: int = 2) -> Verdict:
    """Judge a sequence of refinements.

    Parameters
    ----------
    what
        Name of the numbers that refinement increases.
    dimension
        Number of directions of refinement: the order is this number times the slope.
    """
    found = Findings()
    unknowns = np.array([level.unknowns for level in levels], dtype=float)
    values = np.array([level.value for level in levels])
    scale = abs(known) if known else float(np.abs(values).max())
    if scale == 0:
        return not_shown("the headline quantity is zero at all refinements")
    if np.any(np.diff(unknowns) <= 0):
        counts = ", ".join(f"{n:.0f}" for n in unknowns)
        return not_shown(
            f"its parameters do not grow with refinement, so there is nothing to measure a rate by: {counts}"
        )
    steps = np.abs(np.diff(values)) / scale
    if steps.max() == 0 and (known is None or abs(values[0] - known) > FLOOR * scale):
        found.faults.append(f"refined from {unknowns[0]:.0f} to {unknowns[-1]:.0f} {what} it answers the same")
        return found.verdict()
    settles = steps[-1] <= max(FALLS * steps.max(), FLOOR)
    if known is None:
        words = f"steps {', '.join(f'{s:.1e}' for s in steps)}"
        found.hold(bool(settles), f"it does not settle: {words}", f"no known value; {words}")
        return found.verdict()
    errors = np.abs(values - known) / scale
    words = f"errors {', '.join(f'{e:.1e}' for e in errors)} with {', '.join(f'{n:.0f}' for n in unknowns)} {what}"
    limit = limit_of(unknowns**-0.5, values).value if settles else None
    if limit is not None and errors[-1] > FLOOR:
        missing = max(abs(limit - values[-1]), abs(values[-1] - values[-2])) / scale
        if abs(limit - known) / scale > max(ELSEWHERE * missing, FLOOR):
            return not_shown(f"it converges to {limit:.6g}, known is {known:.6g}: accuracy is not shown; {words}")
    found.hold(bool(errors[-1] <= max(FALLS * errors.max(), FLOOR)), f"it does not converge: {words}")
    rate = slope(unknowns, errors)
    found.figures.append(
        words if rate is None else f"{words}; error ~ {what}^(-{rate / 2:.2f}), order {dimension * rate / 2:.1f}"
    )
    return found.verdict()


def slope(unknowns: np.ndarray, errors: np.ndarray) -> float | None:
    """Return the slope of log error against log unknowns^(-1/2), above rounding; None for fewer than two errors."""
    seen = errors > FLOOR
    if np.count_nonzero(seen) < 2:
        return None
    return float(np.polyfit(-np.log(unknowns[seen]) / 2, np.log(errors[seen]), 1)[0])
