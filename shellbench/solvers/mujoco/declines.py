"""What cloth of MuJoCo can't take, each with its reason."""

from __future__ import annotations

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import EdgeLoad, MomentLoad

SAMPLES = 17  # points a side at which a surface is looked at
FLAT = 1e-9  # of its size: how far a flat surface may lie from its plane
INCOMPRESSIBLE = 0.5  # Poisson's ratio that the engine does not reach; its least one is 0


def reason(case: Case) -> str | None:
    """Return why a case can't be taken, as one clause; None if it can."""
    if case.dynamics is None:
        return "it is at rest, and this engine follows motions"
    if any(case.surface.domain.periodic) or not _is_flat(case):
        return "its surface is curved at rest, and the bending of this cloth is known for flat ones only"
    if any(support.motion is not None for support in case.supports):
        return "it moves its supports, and vertices of this cloth are held still or free"
    if any(support.holds_slope for support in case.supports):
        return "it holds slopes on edges, and this cloth has vertices only"
    if any(isinstance(load, EdgeLoad | MomentLoad) for load in case.loads):
        return "it has loads on edges, and this solver knows those on areas and at points"
    if not 0 <= case.material.poissons_ratio < INCOMPRESSIBLE:
        return "its Poisson's ratio is negative, which the engine refuses"
    return None


def _is_flat(case: Case) -> bool:
    x = case.surface.position(case.surface.domain.grid(SAMPLES, SAMPLES)).reshape(-1, 3)
    sizes = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    return bool(sizes[2] <= FLAT * sizes[0])
