"""A study of precision: what is left of a solution whose stored numbers are rounded to a shorter format."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.account import PrecisionStep, finite
from shellbench.errors import InputError
from shellbench.problem import NumberFormat
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.measure import measure
from shellbench.problems.shell.probes import probes_of, state_at
from shellbench.problems.shell.series import frames
from shellbench.problems.shell.shell import Shell

Array = NDArray[np.float64]

FORMATS: tuple[NumberFormat, ...] = ("float64", "float32", "float16")
MARKS = 5  # states at which the fields are compared, the last one among them
UNREACHED = (InputError, ValueError)


def precision_study(solution: DisplacementField, case: Shell, values: Mapping[str, float]) -> tuple[PrecisionStep, ...]:
    """Compare a solution with itself in shorter formats; nothing if it can't be rounded or has no state.

    `values` are the quantities of the solution as solved, by name: a format in which it stays the very same is not
    measured again.
    """
    rounded: Callable[[NumberFormat], tuple[DisplacementField, int] | None] | None = getattr(solution, "rounded", None)
    points = probes_of(case.surface.domain)
    exact = {
        mark: field for mark in marks_of(solution, case) if (field := state_at(solution, points, mark)) is not None
    }
    if rounded is None or not exact:
        return ()
    steps: list[PrecisionStep] = []
    for number_format in FORMATS:
        answer = rounded(number_format)
        if answer is None:  # of a plug-in that has nothing but the protocol's own stub
            return ()
        short, storage_bytes = answer
        found = [state_at(short, points, mark) for mark in exact]
        compared: dict[str, Any] = {}
        if all(field is not None for field in found):
            gaps = np.linalg.norm(np.array(found) - np.array(list(exact.values())), axis=-1)
            compared = {
                "largest_difference": float(np.max(gaps)),
                "rms_difference": float(np.sqrt(np.mean(gaps**2))),
                "quantities": quantities_of(short, case, values if short is solution else {}),
            }
        steps.append(PrecisionStep(format=number_format, storage_bytes=int(storage_bytes), **compared))
    return tuple(steps)


def marks_of(solution: DisplacementField, case: Shell) -> tuple[float | None, ...]:
    """Return the states that are compared: the only one of a linear case (None), else some that are evenly spread."""
    if case.linear:
        return (None,)
    every = frames(solution, case)
    chosen = np.linspace(len(every), 0, MARKS, endpoint=False).round().astype(int) - 1
    return tuple(every[k] for k in sorted({*chosen.tolist()}) if k >= 0)


def quantities_of(solution: DisplacementField, case: Shell, known: Mapping[str, float]) -> dict[str, float]:
    """Return the finite values of the quantities that a field alone defines; those known are not measured again."""
    found: dict[str, float] = {}
    for quantity in case.quantities:
        if quantity.of_field:
            with contextlib.suppress(*UNREACHED):
                value = known[quantity.name] if quantity.name in known else measure(solution, quantity)
                if finite(value) is not None:
                    found[quantity.name] = value
    return found
