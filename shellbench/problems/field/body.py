"""A ball given by vertices, as the paper has its bodies: the distance is that to the nearest vertex's plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.model import Model, Positive, Vector

Array = NDArray[np.float64]
GOLDEN = math.pi * (3 - math.sqrt(5))  # the golden angle


class Ball(Model):
    """A ball whose surface is sampled by vertices on a Fibonacci spiral."""

    centre: Vector = Field((0.0, 0.0, 0.0), description="where it is, m")
    radius: Positive = Field(description="m")
    vertices: int = Field(ge=4, le=10_000_000, strict=True, description="how many")

    @property
    def normals(self) -> Array:
        """Outward unit normals (n, 3) at the vertices."""
        number = np.arange(self.vertices)
        height = 1 - (2 * number + 1) / self.vertices
        across = np.sqrt(1 - height**2)
        return np.stack([across * np.cos(GOLDEN * number), across * np.sin(GOLDEN * number), height], axis=1)

    @property
    def places(self) -> Array:
        """Places (n, 3) of the vertices, m."""
        return np.asarray(np.array(self.centre) + self.radius * self.normals)

    def distance(self, places: Array) -> Array:
        """Return the exact signed distance (n,) of places (n, 3) from its surface, m."""
        return np.asarray(np.linalg.norm(places - np.array(self.centre), axis=-1) - self.radius)
