"""The kind `field`, as its entry point names it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Kind
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.portrait import FieldPortrait


def keep(solution: Any, case: FieldCase) -> dict[str, NDArray[Any]] | None:
    """Return the arrays of the solution by name; None if they are not finite."""
    arrays: dict[str, NDArray[Any]] = solution.kept()
    return arrays if all(np.all(np.isfinite(array)) for array in arrays.values()) else None


FIELD = Kind(problem=FieldCase, keep=keep, portrait=FieldPortrait, exam=("field",), quick=("field",))
