"""Settings of `bspline-ritz`."""

from __future__ import annotations

from pydantic import Field

from shellbench.problem import Settings
from shellbench.protocol.schema import Finite


class SplineSettings(Settings):
    """Settings of `bspline-ritz`."""

    cells: int | None = Field(
        None, ge=4, le=96, strict=True, description="along a side, twice as many around; None: from 8 on, until settled"
    )
    most_cells: int = Field(48, ge=4, le=96, strict=True, description="up to which it refines")
    degree: int = Field(3, ge=1, le=5, strict=True, description="of the splines; 1 has no curvature, and is declined")
    grading: Finite = Field(
        2.0, ge=1, le=3, description="exponent of the cells' distances from point forces; 1: equal cells"
    )
    symmetry: bool = Field(True, description="whether a part is solved where planes of symmetry allow it")
    layers: bool = Field(
        True, description="whether cells narrow toward the edges of curved shells without point forces"
    )
