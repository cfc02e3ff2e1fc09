"""Nested dissection of a grid of vertices: an order of elimination that fills a factor little (George 1973)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

REACH = 2  # lines of vertices that part a grid: a hinge couples vertices two cells apart
SMALLEST = 5  # vertices a side of a block that is not parted again


def dissected(shape: tuple[int, int], periodic: tuple[bool, bool]) -> Integers:
    """Return the vertices of a grid in such an order; the parts of each block come before the lines between them.

    Parameters
    ----------
    shape
        Vertices along each coordinate; the second runs fastest in their numbers.
    periodic
        Which coordinates close on themselves: a cut is made at the start of these first.
    """
    block, last = np.arange(shape[0] * shape[1]).reshape(shape), []
    for axis in (0, 1):
        if periodic[axis] and block.shape[axis] > REACH:
            cut, block = np.split(block, [REACH], axis=axis)
            last.append(cut.ravel())
    return np.concatenate([*_parted(block), *last[::-1]])


def _parted(block: Integers) -> list[Integers]:
    axis = int(block.shape[1] > block.shape[0])
    if block.shape[axis] <= SMALLEST:
        return [block.ravel()]
    start = (block.shape[axis] - REACH) // 2
    first, between, second = np.split(block, [start, start + REACH], axis=axis)
    return [*_parted(first), *_parted(second), between.ravel()]
