"""The frame of a case's mirrors, in which the shell's planes of symmetry are coordinate planes.

Mirrors are searched in coordinate planes only (`shellbench.problems.shell.posed.mirrors`). A shell at an oblique angle
in space has mirrors too: a reflection of a coordinate moves all points along one direction, the normal of the plane.
The case is rotated so that these normals are axes. The symmetry of loads and supports is checked in that frame.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.mirrors import IMAGE_ROUNDING, ComparisonPoints, Mirror
from shellbench.problems.shell.variants.placing import keeps_components, placed_data

Array = NDArray[np.float64]

NOTHING = 1e-12  # entry of a rotation that counts as rounding: planes turned by less are still found as mirrors


def in_frame_of_mirrors(case: Case) -> tuple[Case, Array] | None:
    """Return a case turned into the frame of its mirrors, and the rotation (3, 3), x' = R x.

    None if its midsurface has no mirror, if the frame is already that of the case, or if supports of single components
    would not be so there.
    """
    rotation = _rotation(case)
    if rotation is None or np.abs(rotation - np.eye(3)).max() <= NOTHING or not keeps_components(case, rotation):
        return None
    first, second, third = (tuple(row) for row in rotation.tolist())
    try:
        return Case.model_validate(placed_data(case, (first, second, third))), rotation
    except (InputError, ValidationError):  # a case that is invalid in that frame keeps its own
        return None


def _rotation(case: Case) -> Array | None:
    """Return the least rotation after which the normals of the midsurface's mirrors are axes; None if it has none."""
    # 1. Find the normals of the middle of an open coordinate, and of two lines a quarter of a turn apart of a closed
    #    one.
    # 2. Complete them to an orthonormal basis.
    # 3. Assign to each axis the vector of the basis that is nearest to it, with the axis's sign.
    domain, points = case.surface.domain, ComparisonPoints.spread_over(case).points
    normals: list[Array] = []
    for axis in (0, 1):
        lower, size = domain.lower[axis], domain.size[axis]
        for at in (lower, lower + size / 4) if domain.periodic[axis] else (lower + size / 2,):
            normal = _normal(case, Mirror(axis, at, 0), points)
            if normal is not None and all(abs(normal @ other) <= IMAGE_ROUNDING for other in normals):
                normals.append(normal)
    if not normals:
        return None
    basis = np.linalg.qr(np.column_stack([*normals, np.eye(3)]))[0].T
    basis[: len(normals)] = normals
    order = max(permutations(range(3)), key=lambda chosen: float(np.abs(basis[list(chosen), range(3)]).sum()))
    rotation = basis[list(order)]
    rotation *= np.where(np.diagonal(rotation) < 0, -1.0, 1.0)[:, None]
    if np.linalg.det(rotation) < 0:
        return None
    return np.asarray(np.where(np.abs(rotation) <= NOTHING, 0.0, rotation))


def _normal(case: Case, mirror: Mirror, points: Array) -> Array | None:
    """Return the unit vector (3,) along which a reflection moves all points (n, 2) of the shell; None if none is."""
    wrap, position = case.surface.domain.wrap, case.surface.position
    moved = position(wrap(mirror.image(points))) - position(wrap(points))
    _, sizes, directions = np.linalg.svd(moved, full_matrices=False)
    return directions[0] if sizes[1] <= IMAGE_ROUNDING * sizes[0] else None
