"""Base of the solvers for ranges of materials: the protocol, and the answer with its history."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Solution, Step
from shellbench.problems.series.conditioned import ConditionedCase, Material
from shellbench.problems.series.quantities import Parameter
from shellbench.problems.solving import FreshSolver

THEORIES = ("kirchhoff-love-linear-conditioned",)
IN_MOTION = (*THEORIES, "kirchhoff-love-nonlinear-conditioned")
SECONDS_BEFORE, SECONDS_EACH = "seconds_before", "seconds_each"
"""Diagnostics of every answer: wall time, s, until the first material can be answered, and of each answer from then."""


@dataclass(frozen=True, kw_only=True)
class ConditionedAnswer(ABC):
    """An answer for all materials of a range; see `shellbench.problem.Solution`."""

    case: ConditionedCase
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)
    unsettled: str | None = None

    @abstractmethod
    def value(self, number: int) -> float:
        """Return the asked displacement, m, at a held-out material."""

    @property
    def kept_values(self) -> NDArray[np.float64]:
        """The asked displacement at all held-out materials, m."""
        return np.array([self.value(number) for number in range(len(self.case.materials))])

    @abstractmethod
    def sensitivity(self, number: int, by: Parameter) -> float:
        """Return the derivative of its logarithm; see `shellbench.problems.series.quantities.Sensitivity`."""


def stepped(material: Material, by: Parameter, step: float) -> Material:
    """Return a material shifted by a step: in log h or log E, or in nu."""
    if by == "poissons_ratio":
        return material._replace(poissons_ratio=material.poissons_ratio + step)
    return material._replace(**{by: getattr(material, by) * math.exp(step)})


class ConditionedSolver(FreshSolver):
    """A solver of problems of kind `conditioned`."""

    def declines(self, case: Any) -> str | None:
        """Return the reason that the solver declines a problem, as one clause, or None if it takes it."""
        if not isinstance(case, ConditionedCase):
            return "it solves problems of kind 'conditioned' only"
        if case.theory not in self.capabilities.theories:
            return f"it does not solve the theory {case.theory}"
        return self.refuses(case)

    def refuses(self, case: ConditionedCase) -> str | None:
        """Return the reason that the solver declines a problem of its kind, or None if it takes it."""
        return None

    @abstractmethod
    def load(self, path: Path) -> Solution:
        """Read the file of an answer."""
