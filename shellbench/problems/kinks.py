"""Where piecewise formulas have kinks or jump, found from the formulas: lines along the coordinates, or a refusal.

`min`, `max`, `abs` and `where` change over where a difference changes its sign. If that depends on one coordinate
alone, the places are coordinate lines, which meshes and quadratures can take for their own. Others can't be taken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, without_middle
from shellbench.problems.expression import Expression

SAMPLES = 1009  # of a coordinate, between which, and kinks of parts, a sign is taken to change once at most
GRID = 65  # points a side at which a difference that depends on both coordinates is looked at
HALVINGS = 60  # of the interval in which a sign changes
MOST = 32  # lines of one formula across a coordinate
NAMES = ("xi1", "xi2")

Array = NDArray[np.float64]
Bounds = tuple[tuple[float, float], tuple[float, float]]


def kink_lines(formula: Expression, bounds: Bounds) -> tuple[list[float], list[float]]:
    """Return the values of xi1, and of xi2, at which a formula changes over, within their bounds.

    Raises
    ------
    InputError
        If it changes over along other lines, at some time, or too often.
    """
    lines: tuple[list[float], list[float]] = [], []
    for switch in formula.switches[::-1]:  # what stands inside first: |x - a| - w is least at the kink of |.|
        if switch.depends_on("t"):
            raise InputError(f"'{formula.text}' changes over at some t, and formulas may only at coordinate lines")
        axes = [axis for axis, name in enumerate(NAMES) if switch.depends_on(name)]
        if len(axes) == 2:
            points = np.stack(np.meshgrid(*(np.linspace(*b, GRID) for b in bounds), indexing="ij"), axis=-1)
            signs = np.sign(switch.derivatives(points, 0)[0, 0])
            if signs.min() < 0 < signs.max():
                raise InputError(
                    f"'{formula.text}' changes over where {without_middle(switch.text)} is zero, which is no"
                    " coordinate line"
                )
        elif axes:
            (axis,) = axes
            lines[axis].extend(_changes(switch, axis, bounds[axis], lines[axis]))
            if len(lines[axis]) > MOST:
                raise InputError(f"'{formula.text}' changes over at more than {MOST} values of {NAMES[axis]}")
    return lines


def _changes(switch: Expression, axis: int, bounds: tuple[float, float], known: list[float]) -> list[float]:
    """Return where in the bounds the sign of a function of one coordinate changes; it may turn at `known` places."""

    def sign(at: Array) -> Array:
        points = np.zeros((len(at), 2))
        points[:, axis] = at
        return np.sign(switch.derivatives(points, 0)[0, 0])

    at = np.union1d(np.linspace(*bounds, SAMPLES), known)
    signs = sign(at)
    (changed,) = np.nonzero(signs[1:] != signs[:-1])
    low, high, before = at[changed], at[changed + 1], signs[changed]
    for _ in range(HALVINGS if len(changed) else 0):
        middle = (low + high) / 2
        same = sign(middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    slack = 1e-9 * (bounds[1] - bounds[0])
    found: list[float] = []
    for place in high:
        inside = bounds[0] + slack < place < bounds[1] - slack
        if inside and (not found or place - found[-1] > slack):  # a zero is left on both sides
            found.append(float(place))
    return found
