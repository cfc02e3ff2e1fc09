"""The field of all solvers here: features of a point, and layers that decode them.

Features are those of multi-resolution grids (Shu et al., eq. (4) and (5)), sines and cosines of a positional encoding,
or the point itself. Without layers the levels of a grid, of three features each, are added.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.field.case import Disc
from shellbench.problems.field.quantities import AXES
from shellbench.problems.field.solution import FieldSolution
from shellbench.solvers.field.basis import matrix

Array = NDArray[np.float64]
AT_ONCE = 4096  # points
OMEGA = (
    30.0  # of a sine's argument, Sitzmann et al., "Implicit Neural Representations with Periodic Activation Functions"
)


def encode(points: Array, frequencies: int) -> Array:
    """Return points (n, 2) followed by their sines and cosines at frequencies pi, 2 pi, 4 pi, ...: (n, 2 + 4 f)."""
    angles = np.pi * (points[:, None, :] * 2.0 ** np.arange(frequencies)[:, None]).reshape(len(points), -1)
    return np.concatenate([points, np.sin(angles), np.cos(angles)], axis=1)


def free_factor(points: Array, held: list[str], disc: Disc | None = None) -> Array:
    """Return the factor of a displacement at points (n, 2): zero on held edges and rims, one far from them."""
    factor = np.ones(len(points)) if disc is None else disc.level(points)
    for edge in held if disc is None else ():
        x = points[:, "uv".index(edge[0])]
        factor *= 1 - x if edge.endswith("max") else x
    return factor


def pin_shares(points: Array, pinned: Array) -> Array:
    """Return the share (n, k) that pinned points (k, 2) have at points (n, 2): by inverse squares of distances.

    A trained displacement less its shared values at the pins is zero at each pin; one pin has the share 1 everywhere.
    """
    apart = np.sum((points[:, None] - pinned) ** 2, axis=2)
    nearest = apart.min(axis=1, keepdims=True)
    shares = np.where(apart == 0, 1.0, nearest / np.where(apart == 0, 1.0, apart))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


@dataclass(frozen=True)
class LayeredField(FieldSolution):
    """A field by its weights.

    `form` has `cells` of each level and the `degree`; `frequencies` of the encoding; `layers`, their number, and the
    `activation`; `held` edges, `pinned` points and `confined` components. `tensors` are `grid_0`, ... (splines,
    features), `weight_0`, ... (in, out) and `bias_0`, ... (out,).
    """

    def displacement(self, points: Array, orders: tuple[int, int] = (0, 0)) -> Array:
        """Return the displacement (n, 3), m, or a derivative of it; ValueError if there is none."""
        form = self.form
        if sum(orders) and (form["layers"] or form["held"] or self.case.disc):
            raise ValueError("only a grid without layers, solved for, has derivatives here")
        parts = np.array_split(points, max(1, len(points) // AT_ONCE))  # memory that fits caches
        values = np.concatenate([self.decode(part, orders) for part in parts])
        if pinned := form.get("pinned"):
            values = values - pin_shares(points, np.array(pinned)) @ self.decode(np.array(pinned))
        values = values * free_factor(points, form["held"], self.case.disc)[:, None]
        values[:, [AXES.index(axis) for axis in form["confined"]]] = 0.0
        return np.asarray(values)

    def decode(self, points: Array, orders: tuple[int, int] = (0, 0)) -> Array:
        """Return the output of the layers, (n, 3); without layers, the features themselves."""
        form, values = self.form, self.features(points, orders)
        for number in range(form["layers"]):
            values = values @ self.tensors[f"weight_{number}"] + self.tensors[f"bias_{number}"]
            if number < form["layers"] - 1:
                values = np.maximum(values, 0) if form["activation"] == "relu" else np.sin(OMEGA * values)
        return values

    def features(self, points: Array, orders: tuple[int, int] = (0, 0)) -> Array:
        """Return the input of the first layer, or the displacement of a field without layers."""
        form: Any = self.form
        if not form["cells"]:
            return encode(points, form["frequencies"])
        levels = [
            matrix(points, cells, form["degree"], orders) @ self.tensors[f"grid_{number}"].astype(float)
            for number, cells in enumerate(form["cells"])
        ]
        return np.concatenate(levels, axis=1) if form["layers"] else np.asarray(sum(levels))
