"""A ball: with its exact distance, or, as bodies in the paper, with vertices and the plane of the nearest vertex."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.protocol.schema import Model, Positive, Vector

Array = NDArray[np.float64]
GOLDEN = math.pi * (3 - math.sqrt(5))  # the golden angle


class Ball(Model):
    """A ball; its surface may be sampled by vertices on a Fibonacci spiral."""

    centre: Vector = Field((0.0, 0.0, 0.0), description="where it is, m")
    radius: Positive = Field(description="m")
    vertices: int | None = Field(
        None, ge=4, le=10_000_000, strict=True, description="how many; none: distances are exact"
    )

    @property
    def normals(self) -> Array:
        """Outward unit normals (n, 3) at the vertices."""
        count = self.vertices or 0
        number = np.arange(count)
        height = 1 - (2 * number + 1) / count
        across = np.sqrt(1 - height**2)
        return np.stack([across * np.cos(GOLDEN * number), across * np.sin(GOLDEN * number), height], axis=1)

    @property
    def places(self) -> Array:
        """Places (n, 3) of the vertices, m."""
        return np.asarray(np.array(self.centre) + self.radius * self.normals)

    def distance(self, places: Array) -> Array:
        """Return the exact signed distance (n,) of places (n, 3) from its surface, m."""
        return np.asarray(np.linalg.norm(places - np.array(self.centre), axis=-1) - self.radius)

    def contact(self, places: Array) -> tuple[Array, Array]:
        """Return signed distances (n,), m, of places (n, 3) as collision sees them, and outward unit normals (n, 3).

        The distances are exact, or those from the plane of the nearest vertex: eq. (26) with epsilon = 0.
        """
        if self.vertices is None:
            apart = places - np.array(self.centre)
            far = np.linalg.norm(apart, axis=-1)
            return far - self.radius, apart / far[..., None]
        normals, nearest = self.normals, self._tree.query(places)[1]
        return np.asarray(np.sum((places - self.places[nearest]) * normals[nearest], axis=-1)), normals[nearest]

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.places)
