"""Settings of `fem-repeated`."""

from __future__ import annotations

from pydantic import Field, PositiveInt

from shellbench.problem import Settings


class RepeatedSettings(Settings):
    """Settings of `fem-repeated`.

    Attributes
    ----------
    cells
        As of `fem`: one fixed mesh, which tells nothing of its error. None: refine until converged.
    step
        Of difference quotients, in log h, log E and nu.
    """

    cells: tuple[PositiveInt, PositiveInt] | None = None
    step: float = Field(0.005, gt=0, lt=0.1)
