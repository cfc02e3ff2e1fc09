"""Functions and constants that formulas can name, as they act on Taylor series."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from shellbench.problems.interval import Undecided
from shellbench.problems.taylor import (
    Taylor,
    cos_terms,
    cosh_terms,
    exp_terms,
    integrated,
    log_terms,
    one,
    sin_terms,
    sinh_terms,
    square_root,
    tangent_terms,
)

Function = Callable[[Taylor], Taylor]
FUNCTIONS: dict[str, Function] = {
    "sin": lambda x: x.compose(sin_terms),
    "cos": lambda x: x.compose(cos_terms),
    "tan": lambda x: x.compose(tangent_terms(np.tan, 1.0)),
    "exp": lambda x: x.compose(exp_terms),
    "log": lambda x: x.compose(log_terms),
    "sqrt": square_root,
    "sinh": lambda x: x.compose(sinh_terms),
    "cosh": lambda x: x.compose(cosh_terms),
    "tanh": lambda x: x.compose(tangent_terms(np.tanh, -1.0)),
    "asin": lambda x: x.compose(integrated(np.arcsin, lambda s: one(s) / square_root(one(s) - s * s))),
    "acos": lambda x: x.compose(integrated(np.arccos, lambda s: -one(s) / square_root(one(s) - s * s))),
    "atan": lambda x: x.compose(integrated(np.arctan, lambda s: one(s) / (one(s) + s * s))),
    "asinh": lambda x: x.compose(integrated(np.arcsinh, lambda s: one(s) / square_root(one(s) + s * s))),
}
CONSTANTS = {"pi": math.pi}


def _least(arguments: list[Taylor]) -> Taylor:
    least, *others = arguments
    for other in others:
        first = least.value <= other.value
        chosen = least.chosen(other, first, (least, other), known=1)
        if isinstance(first, Undecided):
            chosen.terms[0, 0] = np.minimum(least.value, other.value)
        least = chosen
    return least


def _magnitude(arguments: list[Taylor]) -> Taylor:
    (argument,) = arguments
    found = argument.chosen(-argument, argument.value >= 0, arguments, known=1)
    if not np.iscomplexobj(argument.value):  # the sharper bounds of an interval
        found.terms[0, 0] = np.abs(argument.value)
    return found


PIECEWISE: dict[str, Callable[[list[Taylor]], Taylor]] = {
    "min": _least,
    "max": lambda arguments: -_least([-argument for argument in arguments]),
    "abs": _magnitude,
}
"""Functions with kinks, of as many arguments as `_FEWEST` and `_MOST` say; `where` is read by itself."""
