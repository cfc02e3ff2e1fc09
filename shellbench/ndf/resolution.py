"""How fine a Ritz field and its quadrature must be, from the case alone.

What decides is whether the midsurface is curved (then edges have layers of the length sqrt(R h)) and whether forces act
at points (then the solution is resolved over that length, away from edges). The figures were chosen by certified energy
on plates, roofs of four thicknesses, a hyperbolic paraboloid, and pinched and twisted cylinders.
"""

from __future__ import annotations

from dataclasses import dataclass

from shellbench.case import Case
from shellbench.ndf.lengths import foci, strongest_curvature
from shellbench.ndf.quadrature import RuleSpec


@dataclass(frozen=True)
class Resolution:
    """Width and scales of random features, and the rules that they are integrated with."""

    neurons: int
    scale: float
    stretched_scale: float
    rule: RuleSpec
    fine: RuleSpec


def is_flat(case: Case) -> bool:
    """Tell whether the midsurface has no curvature."""
    return not strongest_curvature(case)


def resolution(case: Case) -> Resolution:
    """Return the resolution that a case asks for."""
    flat = is_flat(case)
    if foci(case):
        neurons = 700 if any(case.surface.domain.periodic) else 300 if flat else 400
        return Resolution(neurons, 3.0, 2.0, _rule(case, 6, 7, 1.5, 1), _rule(case, 10, 7, 1.5, 2))
    if flat:
        neurons = 240 if any(case.surface.domain.periodic) else 120  # a whole turn is twice as long as a side
        panels = 8 if any(case.surface.domain.periodic) else 5
        return Resolution(neurons, 3.5, 2.0, _rule(case, panels, 6), _rule(case, panels + 1, 7))
    return Resolution(240, 3.0, 2.0, _rule(case, 8, 6, 2.0), _rule(case, 11, 7, 2.0, 1))


def _rule(case: Case, panels: int, order: int, grading: float = 1.0, cuts: int = 0) -> RuleSpec:
    """Return a rule with twice the panels along a periodic coordinate, whose inputs run through a whole turn."""
    first, second = (2 * panels if periodic else panels for periodic in case.surface.domain.periodic)
    return RuleSpec((first, second), order, grading, cuts)
