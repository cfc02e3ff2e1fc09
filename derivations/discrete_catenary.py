"""The discrete catenary: a chain of equal masses on rigid links between two ends at one height.

The horizontal part H of the tension is the same in all links. The vertical part falls by M g from link to link, and is
M g (n + 1 - 2 j) / 2 in link j of n by symmetry. A link points along its tension, so that

    span = l sum_j H / sqrt(H^2 + V_j^2),

which grows with H from 0 to n l and has one root. A second form minimises the height of the masses over the angles of
the links with the ends held, by `scipy.optimize`, and knows no tension.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq, minimize

from derivations.estimate import ROUNDING, Estimate


def vertical_parts(links: int, weight: float) -> np.ndarray:
    """Return the vertical tensions (links,) of all links, upward along the chain's first half negative z, N."""
    return weight * (links + 1 - 2 * np.arange(1, links + 1)) / 2


def horizontal_tension(links: int, length: float, weight: float, span: float) -> float:
    """Return H, N."""
    vertical = vertical_parts(links, weight)

    def excess(logarithm: float) -> float:
        force = math.exp(logarithm)
        return float(np.sum(length * force / np.hypot(force, vertical))) - span

    return math.exp(brentq(excess, math.log(1e-9 * weight), math.log(1e9 * weight), xtol=1e-15, rtol=1e-15))


def catenary(links: int, length: float, weight: float, span: float) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (links + 1, 2), m, and tensions (links,), N."""
    vertical = vertical_parts(links, weight)
    force = horizontal_tension(links, length, weight, span)
    tensions = np.hypot(force, vertical)
    steps = length * np.stack([np.full(links, force), -vertical], axis=1) / tensions[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), tensions


def hanging_chain() -> dict[str, Estimate]:
    """Return the known values of the case of this name."""
    nodes, tensions = catenary(9, 0.1, 9.81, 0.6)
    return {
        "sag": Estimate(float(nodes[4, 1]), ROUNDING, "m"),
        "first_node_x": Estimate(float(nodes[1, 0]), ROUNDING, "m"),
        "end_tension": Estimate(float(tensions[0]), 50 * ROUNDING, "N"),
        "middle_tension": Estimate(float(tensions[4]), 50 * ROUNDING, "N"),
    }


def lowest_by_angles(links: int, length: float, weight: float, span: float) -> np.ndarray:
    """Return the nodes (links + 1, 2) of least potential energy, found over the links' angles."""

    def nodes(angles: np.ndarray) -> np.ndarray:
        steps = length * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    start = np.linspace(-1.0, 1.0, links)
    found = minimize(
        lambda a: weight * nodes(a)[1:-1, 1].sum(),
        start,
        constraints=[{"type": "eq", "fun": lambda a: nodes(a)[-1] - [span, 0.0]}],
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 1000},
    )
    return nodes(found.x)
