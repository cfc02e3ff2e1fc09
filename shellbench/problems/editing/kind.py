"""The kind `editing`, as its entry point names it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Kind
from shellbench.problems.editing.case import EditingCase
from shellbench.protocol.picture import Portrait


def keep(solution: Any, case: EditingCase) -> dict[str, NDArray[Any]] | None:
    """Return what is asked, from the earlier solution and from scratch, (2, n); None if it is not finite."""
    values = np.asarray(solution.values)
    return {"values": values} if np.isfinite(values).all() else None


class EditingPortrait(Portrait):
    """A shell and an edit of it."""

    problem: Any

    @property
    def edit(self) -> str | None:
        """What is edited."""
        return str(self.problem.edit.what)


EDITING = Kind(problem=EditingCase, keep=keep, portrait=EditingPortrait, headline="Displacements")
