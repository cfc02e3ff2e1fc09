"""Displacements of nodes in a file .vtu of another program."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.mesh.other import meshio_mesh

Array = NDArray[np.float64]

NAMES = ("displacement", "displacements", "disp", "u")  # of the array in a file that has several, in small letters


def read_vtu(content: bytes) -> tuple[Any, Array]:
    """Return the mesh that meshio reads, and the displacements (n, 3) of its nodes.

    Raises
    ------
    InputError
        As a clause, if it is no such file, or does not have one field of displacements.
    """
    mesh = meshio_mesh(content, ".vtu")
    arrays = {name: np.asarray(a) for name, a in mesh.point_data.items() if np.ndim(a) == 2 and np.shape(a)[1] >= 3}
    named = [name for name in arrays if name.lower() in NAMES]
    chosen = list(arrays) if len(arrays) == 1 else named
    if len(chosen) != 1:
        raise InputError(f"field 'PointData': found {', '.join(arrays) or 'no vectors'}; call one displacement")
    return mesh, arrays[chosen[0]][:, :3].astype(float)
