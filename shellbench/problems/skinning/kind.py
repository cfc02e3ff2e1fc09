"""The kind `skinning`, as its entry point names it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Kind
from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.quantities import errors
from shellbench.protocol.picture import Portrait

WORST = ("simulated", "skinned")  # of what is kept


def keep(solution: Any, case: SkinningCase) -> dict[str, NDArray[np.float32]] | None:
    """Return the meshes of the worst frame that is held out; None if they are not finite."""
    if not np.isfinite(solution.meshes).all():
        return None
    worst = int(errors(solution).argmax())
    pair = solution.clips.meshes[case.held_out[worst]], solution.meshes[worst]
    return {name: mesh.astype(np.float32) for name, mesh in zip(WORST, pair, strict=True)}


class SkinningPortrait(Portrait):
    """A garment."""

    @property
    def worst(self) -> tuple[str, str]:
        """Names of the arrays of its worst mesh."""
        return WORST


SKINNING = Kind(problem=SkinningCase, keep=keep, portrait=SkinningPortrait)
