"""Settings of `ndf-material`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shellbench.problem import SeededSettings
from shellbench.protocol.schema import Positive


class ConditionedPublishedSettings(SeededSettings):
    """Settings of `ndf-material`; the defaults are the paper's."""

    iterations: int = Field(2000, ge=1, description="of Adam, each at one random material")
    layers: int = Field(5, ge=1, le=20, description="hidden layers")
    width: int = Field(512, ge=1, le=4096, description="of each hidden layer")
    omega0: Positive = Field(15.0, description="frequency of the sines")
    learning_rate: Positive = Field(1e-4, description="of Adam")
    cells: tuple[int, int] = Field((20, 20), description="of the grid of samples, along xi1 and xi2")
    dtype: Literal["float32", "float64"] = Field("float32", description="precision of the training")
