"""Candidates: the answers of one level of features of a linear shell at rest, and the estimate of their error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from shellbench.problem import Step
from shellbench.problems.shell.quantities.measure import measure, measure_all
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.linear.refinement import ErrorBounds, Level, gain_left, probe, quantity_changes
from shellbench.solvers.ndf.linear.regularised import JITTER
from shellbench.solvers.ndf.linear.signs import Signs
from shellbench.solvers.ndf.linear.solution import NdfSolution

STRONGER = 10.0  # times the usual regularisation, a decade: for answers that estimate the effect of the usual one
STEPS_LEFT = math.log(JITTER / np.finfo(float).eps) / math.log(STRONGER)  # from the usual one down to rounding: 3.7
EXPLOITED = ROUNDING  # of the stored energy: a larger rise of energy on a finer rule means exploitation


@dataclass(frozen=True)
class Candidate:
    """One answer of a level.

    Attributes
    ----------
    solution
        The solution, without history.
    potential
        Certified potential energy, J.
    stored
        Energy stored by shell and springs, or rounding, J.
    signs
        Signs that decide if it is an answer.
    step
        Of the history.
    """

    solution: NdfSolution
    potential: float
    stored: float
    signs: Signs
    step: Step

    @cached_property
    def values(self) -> dict[str, float]:
        """Values of all quantities of the case."""
        return dict(measure_all(replace(self.solution, history=(self.step,))))

    @cached_property
    def probes(self) -> Array:
        """Displacement (n, 3) at points all over the shell, metres."""
        return probe(self.solution)

    def exploits_rule(self, other: float) -> bool:
        """Return True if its certified energy is above another one, J, by more than rounding."""
        return self.potential - other > EXPLOITED * self.stored

    def error_bounds(self, finer: Candidate) -> ErrorBounds:
        """Return lower bounds of its errors, from its difference to a finer answer."""
        # Relative to the stored energy: with loads only, strain energies and displacements on which loads work change
        # by this share.
        changed = quantity_changes(self.solution.case, self.values, finer.values, (self.probes, finer.probes))
        return ErrorBounds(changed, abs(self.potential - finer.potential) / finer.stored)


@dataclass(frozen=True)
class SolvedLevel:
    """A level with its answers.

    Attributes
    ----------
    narrower
        Answers with parts of the usual features, for the convergence curve.
    first
        With the usual features.
    regularised
        With the challengers' features, regularised by `STRONGER` twice, once, and not more than usual.
    energies
        Returns the potential energy on the training rule with one kind of challenger, J, by kind.
    """

    level: Level
    narrower: tuple[Candidate, ...]
    first: Candidate
    regularised: tuple[Candidate, Candidate, Candidate]
    energies: Callable[[], dict[str, float]]

    @property
    def with_challengers(self) -> Candidate:
        """The answer of least certified energy with the challengers' features; in a tie, the usual one."""
        # Less regularisation lowers the energy on the rule of the solve. If it raises the energy on the finer rule, the
        # field exploits its rule: hardly in displacements, much in their third derivatives.
        *_, usual = self.regularised
        best = min(self.regularised, key=lambda answer: answer.potential)
        return best if usual.exploits_rule(best.potential) else usual

    @property
    def best(self) -> Candidate:
        """The answer of the level: with the challengers' features, unless these lose certified energy."""
        return self.first if self.with_challengers.exploits_rule(self.first.potential) else self.with_challengers

    def error_bounds(self) -> ErrorBounds:
        """Return lower bounds of the errors: changes by challengers, and changes by less regularisation."""
        # Combinations of features that are softer than rounding are excluded. Challengers do not show their effect,
        # since they are regularised too. But energies show the gain of each step of regularisation, down to that of
        # rounding. If the last step loses energy, no further one would gain any: the change by one step is the bound.
        (stiffest, stiffer, usual), best = self.regularised, self.with_challengers
        left = gain_left((stiffest.potential, stiffer.potential, usual.potential), STEPS_LEFT) if best is usual else 1.0
        softer = (stiffest if best is stiffer else stiffer).error_bounds(best).times(left)
        return self.first.error_bounds(best).or_larger(softer)


@dataclass(frozen=True)
class BestLevel:
    """The answer of least certified energy among the levels so far, its level, and lower bounds of its errors."""

    answer: Candidate
    solved: SolvedLevel
    missed: ErrorBounds


def displacement_values(solution: NdfSolution) -> dict[str, float]:
    """Return the displacement quantities of a solution's case, by name."""
    quantities = [q for q in solution.case.quantities if isinstance(q, DisplacementQuantity)]
    return {q.name: measure(solution, q) for q in quantities}
