"""The kinds `conditioned` and `editing`, as their entry points name them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Kind
from shellbench.problems.series.conditioned import ConditionedCase, Material
from shellbench.problems.series.edited import EditingCase
from shellbench.problems.series.quantities import Sensitivity, Value
from shellbench.problems.series.shell_table import SeriesCase
from shellbench.protocol.picture import Portrait


def keep(solution: Any, case: SeriesCase) -> dict[str, NDArray[Any]] | None:
    """Return all values that an answer has, m; None if one is not finite.

    For a range of materials: the asked displacement at each held-out material. For an edited shell: its quantities (2,
    n), from the earlier solution and from scratch.
    """
    values = np.asarray(solution.kept_values)
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


class EditingPortrait(Portrait):
    """A shell and an edit of it."""

    problem: Any

    @property
    def edit(self) -> str | None:
        """The kind of edit: of a force, a pose or a thickness."""
        return str(self.problem.edit.what)


CONDITIONED = Kind(problem=ConditionedCase, keep=keep, portrait=ConditionedPortrait, headline="Displacements")
EDITING = Kind(problem=EditingCase, keep=keep, portrait=EditingPortrait, headline="Displacements")
