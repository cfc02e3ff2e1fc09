"""Search for the largest value of a function on the parameter domain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.surface import Domain

Array = NDArray[np.float64]

GRID = 101  # points a side of the first look
ZOOM = 9  # points a side of each closer look
LOOKS = 10  # closer looks; each is (ZOOM - 1) / 2 times finer than the one before


def largest(domain: Domain, value: Callable[[Array], Array], starts: Array) -> float:
    """Return the largest value (n,) of a function of points (n, 2), which lie in the domain.

    It climbs from the best point of a grid and of `starts` (m, 2). A peak that is narrower than a hundredth of a side
    is found only if one of these points lies on it and is the best of all.
    """
    # Departure from a gradient search: a regular grid and the starts, then ever finer grids around the best point so
    # far.
    lower, upper = np.asarray(domain.lower), np.asarray(domain.upper)
    offsets = np.linspace(-1.0, 1.0, ZOOM)
    window = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    candidates = np.concatenate([domain.grid(GRID, GRID).reshape(-1, 2), starts])
    reach = (upper - lower) / (GRID - 1)
    found = -np.inf
    for _ in range(LOOKS + 1):
        values = value(candidates)
        best = int(np.argmax(values))
        found = max(found, float(values[best]))
        around = candidates[best] + reach * window
        candidates = np.where(domain.periodic, domain.wrap(around), np.clip(around, lower, upper))
        reach = reach * 2 / (ZOOM - 1)
    return found
