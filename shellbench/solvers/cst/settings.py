"""Settings of the solver `cst-hinge`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shellbench.problem import Settings
from shellbench.protocol.schema import Finite

Diagonal = Literal["right", "left", "alternating"]
TOLERANCE = 1e-9  # of Newton's last step, relative to the shell's size


class CstSettings(Settings):
    """Settings of `CstSolver`."""

    cells: tuple[int, int] | None = Field(None, description="cells along xi1 and xi2; None: 32 on the longer side")
    diagonal: Diagonal = Field("right", description="how cells are cut into triangles")
    time_step: Finite | None = Field(
        None, gt=0, description="longest step in time, s; None: 1/240 s; static cases have none"
    )
    tolerance: Finite = Field(TOLERANCE, gt=0, le=1e-2, description="Newton's last step, relative to the shell's size")
