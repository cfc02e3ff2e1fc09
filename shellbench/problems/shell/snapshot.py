"""Snapshots: a solution at one time that remembers its answers, for many quantities ask for the same field."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.field import DisplacementField

Array = NDArray[np.float64]


def snapshot_of(solution: DisplacementField, mark: float) -> DisplacementField:
    """Return the solution as it is at a mark: it answers there whatever mark it is asked for, and computes it once."""
    return cast(DisplacementField, _Snapshot(solution, mark))


class _Snapshot:
    """What measuring asks of a solution is remembered; all else is the solution's own."""

    def __init__(self, solution: DisplacementField, mark: float) -> None:
        self._solution = solution
        self._mark = mark
        self._answers: dict[object, Any] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solution, name)

    def displacement(self, points: ArrayLike, at: float | None = None, material: object = None) -> Any:
        return self._field(self._solution.displacement, points)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Any:
        return self._field(self._solution.velocity, points)

    def energies(self, at: float | None = None) -> Any:
        return self._once(("energies",), lambda: self._solution.energies(self._mark))

    def reaction(self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None) -> Any:
        about = np.asarray(centre, dtype=float)
        key = ("reaction", support, about.tobytes())
        return self._once(key, lambda: self._solution.reaction(support, about, at=self._mark))

    def _field(self, ask: Callable[..., Array], points: ArrayLike) -> Any:
        xi = np.asarray(points, dtype=float)
        return self._once((ask.__name__, xi.shape, xi.tobytes()), lambda: ask(xi, at=self._mark))

    def _once(self, key: object, ask: Callable[[], Any]) -> Any:
        if key not in self._answers:
            self._answers[key] = ask()
        return self._answers[key]
