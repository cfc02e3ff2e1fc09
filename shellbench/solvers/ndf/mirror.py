"""Which functions of a point are even about the seam of a periodic coordinate, found out by looking."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.surface import Domain
from shellbench.solvers.ndf.jets import Array

SAMPLES = 24  # points a side of the grid on which functions are compared with their mirror images
ODD = 1e-9  # of a function's own size: far above rounding, far below what is odd by design


def even_columns(columns: Callable[[Array], Tensor], domain: Domain, axes: Sequence[int]) -> Tensor:
    """Tell which of several functions are even about the lower bound of each of the given coordinates.

    Parameters
    ----------
    columns
        Values (N, n) of n functions at points (N, 2).

    Returns
    -------
    Tensor
        (n,) of bool.
    """
    points = domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
    here = columns(points)
    even = torch.ones(here.shape[1], dtype=torch.bool, device=here.device)
    for axis in axes:
        mirrored = np.array(points)
        mirrored[:, axis] = domain.lower[axis] + domain.upper[axis] - points[:, axis]  # the bounds are one line
        even &= (here - columns(mirrored)).abs().amax(0) <= ODD * here.abs().amax(0)
    return even
