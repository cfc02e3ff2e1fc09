"""Patches of spline shells: their knots, their reference surfaces, and what two discretisations of one tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .estimate import Estimate
from .spline_shell import Ends, Splines
from .surface_strains import Array

SYMMETRIC: Ends = ("zero", "even")
"""A component from a support to a plane of symmetry."""
ROUNDING = 1e-9
"""Relative uncertainty that Newton's last correction and the rounding of a thin shell's forces leave."""


@dataclass(frozen=True)
class Mesh:
    """Knot spans along xi1 and xi2, degree, and halvings of the span at a singular place."""

    spans: tuple[int, int]
    degree: int
    halvings: int = 0

    def splines(self, one: Array, two: Array) -> tuple[Splines, Splines]:
        """Splines of both variables over the given breaks."""
        return Splines(one, self.degree), Splines(two, self.degree)


def breaks(start: float, end: float, spans: int, halve: Sequence[bool] = (), halvings: int = 0) -> Array:
    """Equal spans, of which the first or last (both if told) are halved again and again toward the end."""
    uniform = np.linspace(start, end, spans + 1)
    finer = (end - start) / spans * 0.5 ** np.arange(1, halvings + 1)
    more = [place for place, wanted in zip((start + finer, end - finer), halve, strict=False) if wanted]
    return np.unique(np.concatenate([uniform, *more]))


def _power(x: Array, order: int) -> Array:
    return x if order == 0 else np.full_like(x, 1.0 if order == 1 else 0.0)


def plane(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of (xi1, xi2, 0)."""
    zero = np.zeros_like(one)
    return np.stack([_power(one, i) if j == 0 else zero, _power(two, j) if i == 0 else zero, zero], -1)


def ring(angle: Array, radius: Array, i: int, j: int) -> Array:
    """Derivative of (xi2 cos xi1, xi2 sin xi1, 0)."""
    out = _power(radius, j)
    turned = angle + i * np.pi / 2
    return np.stack([out * np.cos(turned), out * np.sin(turned), np.zeros_like(out)], -1)


def cylinder(radius: float, axis: int) -> Callable[[Array, Array, int, int], Array]:
    """Derivative of a cylinder about y (axis 1) or z (axis 2); xi1 = 0 is on x."""

    def surface(angle: Array, along: Array, i: int, j: int) -> Array:
        out = radius if j == 0 else 0.0
        turned = angle + i * np.pi / 2
        axial = _power(along, j) if i == 0 else np.zeros_like(along)
        parts = [out * np.cos(turned), out * np.sin(turned)]
        return np.stack([parts[0], axial, parts[1]] if axis == 1 else [*parts, axial], -1)

    return surface


def uniform(*force: float) -> Callable[[Array, Array], Array]:
    """Force per area that is the same everywhere."""
    return lambda one, two: np.broadcast_to(force, (*one.shape, 3))


def converged(
    compute: Callable[[Mesh], dict[str, float]],
    fine: Mesh,
    coarse: Mesh,
    length: str = "m",
    rounding: float = ROUNDING,
) -> dict[str, Estimate]:
    """Take the values of a fine discretisation; their distances from a clearly coarser one are the errors.

    A relative rounding is added, because two levels may agree by chance.
    """
    near, far = compute(fine), compute(coarse)
    # Membrane and bending energy trade with one another: the sum may be the only one that converges from one side.
    energies = max((abs(near[name] - far[name]) for name in near if name.endswith("energy")), default=0.0)
    values = {}
    for name, value in near.items():
        kind = name.split("_")[-1]
        least = rounding * abs(value)
        if kind == "energy":
            values[name] = Estimate(value, energies + least, "J")
        else:
            values[name] = Estimate.between(value, far[name], "N" if "load" in name.split("_") else length, least)
    return values
