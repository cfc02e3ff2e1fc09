"""Settings of `ndf-conditioned`."""

from __future__ import annotations

from pydantic import Field

from shellbench.problem import SeededSettings
from shellbench.protocol.schema import Positive
from shellbench.solvers.ndf.field.choices import LARGEST_GAP


class ConditionedSettings(SeededSettings):
    """Settings of `ndf-conditioned`; what is None follows from the case."""

    neurons: int | None = Field(None, ge=1, le=4000, description="width of the random layer, without challengers")
    snapshots: int = Field(
        32, ge=3, le=63, description="materials at which the output layer is solved for, at most; at rest"
    )
    tolerance: Positive = Field(
        1e-6, description="change of the asked displacement, by the last two fields, that ends it; at rest"
    )
    largest_gap: Positive = Field(LARGEST_GAP, description="largest admissible quadrature gap")
