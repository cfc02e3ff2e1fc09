"""Protocol of a shell's solution: a continuous displacement field that can be evaluated anywhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problem import NumberFormat, Solution
from shellbench.problems.shell.question.contact import Touch

Array = NDArray[np.float64]

RESULTANTS = ("membrane_force", "moment", "shear_force")
"""Stress resultants that `DisplacementField.evaluate` may give beside `FIELDS`, in the shell's orthonormal frame."""


class DisplacementField(Solution, Protocol):
    """A continuous displacement field with its history."""

    def displacement(
        self, points: ArrayLike, at: float | None = None, material: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at any points (..., 2), angles in radians.

        `at` is the time, s, or the load factor (the last one if None); a motion answers at any time that it has
        reached. `material` chooses one, for fields that are conditioned on materials; others refuse it by
        InputError, in one sentence.
        """
        ...

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) in m/s at points (..., 2) and a time; zero in a static case."""
        ...

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `FIELDS` or `RESULTANTS` at points (..., 2); KeyError for an unknown name.

        Resultants are components 11, 22, 12 (..., 3), of shear forces 1, 2 (..., 2), N/m and N; see
        `shellbench.problems.shell.quantities.resultant_quantities`. Plug-ins may lack them.
        """
        ...

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        ...

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        ...

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of obstacles on the shell; called only for cases with obstacles."""
        ...

    def rounded(self, format: NumberFormat) -> tuple[DisplacementField, int]:
        """Return the solution with all numbers that `displacement` needs rounded to a format, and the bytes it takes.

        The rounded solution is evaluated in double precision. Each array may be kept with a power of two as its scale
        (see `shellbench.problems.shell.solution`). Plug-ins may lack this method; no precision is studied then.
        """
        ...
