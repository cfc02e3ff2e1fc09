"""The kind `rope`, as its entry point names it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Kind
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.portrait import RopePortrait


def keep(solution: Any, case: RopeCase) -> dict[str, NDArray[np.float64]] | None:
    """Return the arrays of the solution by name; None if they are not finite."""
    arrays = solution.stacked()
    return arrays if all(np.all(np.isfinite(array)) for array in arrays.values()) else None


ROPE = Kind(
    problem=RopeCase,
    keep=keep,
    portrait=RopePortrait,
    headline="Places and tensions",
    exam=("rope",),
    quick=("rope",),
)
