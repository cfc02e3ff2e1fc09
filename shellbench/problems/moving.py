"""Prescribed motions: places in space as formulas of the time, for roots and obstacles."""

from __future__ import annotations

from functools import cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from shellbench.errors import InputError
from shellbench.problems.expression import Expression
from shellbench.problems.taylor import Taylor
from shellbench.protocol.schema import Finite

Array = NDArray[np.float64]
SECOND = 2  # order of the series: position, velocity, acceleration


def _is_a_formula_of_time(formula: Finite | str) -> Finite | str:
    _parsed(formula)
    return formula


Formula = Annotated[Finite | str, AfterValidator(_is_a_formula_of_time)]
Path = tuple[Formula, Formula, Formula]
"""A place (x, y, z), m, as numbers or formulas of t, s."""


@cache
def _parsed(formula: float | str) -> Expression:
    return Expression(formula, variables=("t",))


def moved(path: Path, time: float) -> tuple[Array, Array, Array]:
    """Return position (3,), m, velocity (3,), m/s, and acceleration (3,), m/s^2, at a time, s.

    Raises
    ------
    InputError
        If a formula is not finite there.
    """
    if not any(isinstance(formula, str) for formula in path):
        return np.array(path, dtype=float), np.zeros(3), np.zeros(3)
    now = {"t": Taylor.variable(time, axis=0, order=SECOND)}
    series = [_parsed(formula).series(now, SECOND) for formula in path]
    position, velocity, acceleration = (
        np.array([float(s.derivative(order, 0)) for s in series]) for order in range(SECOND + 1)
    )
    if not all(np.all(np.isfinite(part)) for part in (position, velocity, acceleration)):
        raise InputError(f"the place {list(path)} is not finite at t = {time:g}")
    return position, velocity, acceleration
