"""The kind `conditioned`, as its entry point names it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Kind
from shellbench.problems.conditioned.case import ConditionedCase, Material
from shellbench.problems.conditioned.quantities import Sensitivity, Value
from shellbench.protocol.picture import Portrait


def keep(solution: Any, case: ConditionedCase) -> dict[str, NDArray[Any]] | None:
    """Return the asked displacement at all held-out materials; None if it is not finite."""
    values = np.array([solution.value(number) for number in range(len(case.materials))])
    return {"values": values} if np.isfinite(values).all() else None


class ConditionedPortrait(Portrait):
    """A shell of many materials."""

    problem: Any

    @property
    def materials(self) -> Mapping[str, Material]:
        """The held-out material of each quantity that is a displacement there, by name."""
        of = self.problem.materials
        return {q.name: of[q.material] for q in self.problem.quantities if isinstance(q, Value)}

    @property
    def derivatives(self) -> tuple[str, ...]:
        """Names of the quantities that are derivatives."""
        return tuple(q.name for q in self.problem.quantities if isinstance(q, Sensitivity))


CONDITIONED = Kind(problem=ConditionedCase, keep=keep, portrait=ConditionedPortrait, headline="Displacements")
