"""Options of a case for its pictures."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shellbench.protocol.schema import Finite, Model


class Picture(Model):
    """Options of the report's picture of the deformed shell.

    Without a `scale` the report chooses one by which the largest displacement can be seen.

    Attributes
    ----------
    up
        Axis that points upward in pictures.
    """

    scale: Finite | None = Field(None, description="factor of the displacement")
    direction: tuple[Finite, Finite, Finite] | Literal["inward"] | None = Field(
        None, description="colour by this component; of a surface that encloses something, by the one into it"
    )
    view: tuple[Finite, Finite] = Field((25.0, -60.0), description="elevation and azimuth of the camera, degrees")
    up: Literal["x", "y", "z"] = "z"
