"""Portrait of a field: the data from which a report draws its training."""

from __future__ import annotations

from typing import Any

import numpy as np

from shellbench.protocol.picture import Portrait, Scene

VIEW = (18.0, -60.0)  # elevation and azimuth of the camera, degrees


class FieldPortrait(Portrait):
    """A field over the unit square, or points of a density."""

    problem: Any

    @property
    def learns(self) -> bool:
        """True if the case asks for a field."""
        return bool(self.problem.has_field)

    @property
    def sampled(self) -> tuple[str, str] | None:
        """Names of the density and of the samples, for answers that have samples."""
        return ("density", "points") if self.problem.has_field else None

    @property
    def scene(self) -> Scene | None:
        """Scene of a cloth on a body, true to scale."""
        if self.problem.body is None or not self.problem.has_field:
            return None
        pins = tuple(np.array(point) for pin in self.problem.pins for point in pin.at)
        held = tuple(("uv".index(edge[0]), edge[2:]) for pin in self.problem.pins for edge in pin.on)
        return Scene((1.0, 1.0), 1.0, True, (0.0, 0.0, 1.0), VIEW, "z", held, pins, ())
