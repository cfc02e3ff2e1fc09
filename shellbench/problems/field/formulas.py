"""Formulas of u and v in case files: parsed by the shared language, with exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from shellbench.problems.expression import Expression
from shellbench.problems.taylor import Taylor
from shellbench.protocol.schema import Finite

Array = NDArray[np.float64]


def _is_a_formula(formula: Finite | str) -> Finite | str:
    _parsed(formula)
    return formula


Formula = Annotated[Finite | str, AfterValidator(_is_a_formula)]
Formulas = tuple[Formula, Formula, Formula]
"""Components x, y, z as numbers, or as formulas of u and v."""


@cache
def _parsed(formula: float | str) -> Expression:
    return Expression(formula, variables=("u", "v"))


def evaluated(formulas: Sequence[float | str], points: Array, orders: tuple[int, int] = (0, 0)) -> Array:
    """Return the components (n, k) of formulas at points (n, 2), or of their derivative of these orders in u and v."""
    total = sum(orders)
    named = {name: Taylor.variable(points[:, axis], axis=axis, order=total) for axis, name in enumerate("uv")}
    columns = [np.broadcast_to(_parsed(f).series(named, total).derivative(*orders), len(points)) for f in formulas]
    return np.stack(columns, axis=1).astype(float)
