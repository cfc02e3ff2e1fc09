"""Bodies that a cloth touches: a ball, a torus and a prism, with exact distances.

The paper shows the three (Shu et al., figures 8 to 10) and states the geometry of none. Its bodies are vertices: the
distance is that from the plane of the nearest one. A ball may have vertices too.

Each body has a core: the centre of a ball, the circle within a torus, a smaller prism with sharp edges. Its surface is
at one distance from the core.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shellbench.protocol.schema import Finite, Model, Positive, Vector

Array = NDArray[np.float64]
GOLDEN = math.pi * (3 - math.sqrt(5))  # the golden angle
TINY = 1e-300  # m: keeps places in a core from a division by zero


class Solid(Model):
    """Base of the bodies: distances, normals and their slopes."""

    centre: Vector = Field((0.0, 0.0, 0.0), description="where it is, m")

    @abstractmethod
    def from_core(self, places: Array) -> tuple[Array, Array, Array, Array]:
        """Return signed distances (n,), m, of places (n, 3) relative to the centre, and data along axes of each place.

        These are the axes (n, 3, 3) as rows, the unit normal (n, 3) and the distance's Hessian (n, 3, 3), 1/m.
        """

    @property
    def is_exact(self) -> bool:
        """True if a cloth sees exact distances, False if it sees planes of vertices."""
        return True

    def distance(self, places: Array) -> Array:
        """Return the exact signed distance (n,) of places (n, 3) from its surface, m."""
        return self.from_core(places - np.array(self.centre))[0]

    def contact(self, places: Array) -> tuple[Array, Array]:
        """Return signed distances (n,), m, of places (n, 3) as collision sees them, and outward unit normals (n, 3)."""
        distance, axes, normal, _ = self.from_core(places - np.array(self.centre))
        return distance, np.asarray(np.einsum("ni,nia->na", normal, axes))

    def curvature(self, places: Array) -> Array:
        """Return the Hessian (n, 3, 3) of the exact distance at places (n, 3), 1/m: the slope of the normal."""
        _, axes, _, hessian = self.from_core(places - np.array(self.centre))
        return np.asarray(np.swapaxes(axes, 1, 2) @ hessian @ axes)


def along_axes(apart: Array, moves: Array) -> tuple[Array, Array, Array]:
    """Return lengths (n,) of vectors (n, 3) from a core, their directions (n, 3), and their Hessians (n, 3, 3).

    `moves` (n, 3) is zero along axes in which the nearest point of the core moves along with a place.
    """
    length = np.maximum(np.linalg.norm(apart, axis=1), TINY)
    normal = apart / length[:, None]
    across = moves[:, :, None] * np.eye(3) - normal[:, :, None] * normal[:, None, :]
    return length, normal, across / length[:, None, None]


class Ball(Solid):
    """A ball; its surface may be sampled by vertices on a Fibonacci spiral."""

    kind: Literal["ball"] = "ball"
    radius: Positive = Field(description="m")
    vertices: int | None = Field(
        None, ge=4, le=10_000_000, strict=True, description="how many; none: distances are exact"
    )

    @property
    def is_exact(self) -> bool:
        """True without vertices."""
        return self.vertices is None

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

    def from_core(self, places: Array) -> tuple[Array, Array, Array, Array]:
        """Return the data of `Solid.from_core` about the centre."""
        far, normal, hessian = along_axes(places, np.ones_like(places))
        return far - self.radius, np.broadcast_to(np.eye(3), hessian.shape), normal, hessian

    def contact(self, places: Array) -> tuple[Array, Array]:
        """Return signed distances (n,), m, of places (n, 3) as collision sees them, and outward unit normals (n, 3).

        The distances are exact, or those from the plane of the nearest vertex: eq. (26) with epsilon = 0.
        """
        if self.is_exact:
            return super().contact(places)
        normals, nearest = self.normals, self._tree.query(places)[1]
        return np.asarray(np.sum((places - self.places[nearest]) * normals[nearest], axis=-1)), normals[nearest]

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.places)


class Torus(Solid):
    """A torus about a vertical axis."""

    kind: Literal["torus"]
    ring: Positive = Field(description="radius of the circle within it, m")
    tube: Positive = Field(description="radius of the tube about that circle, m; smaller than `ring`")

    @model_validator(mode="after")
    def _has_a_hole(self) -> Self:
        if self.tube >= self.ring:
            raise ValueError(f"'body.tube' is {self.tube:g}, but it must be smaller than 'body.ring', {self.ring:g}")
        return self

    def from_core(self, places: Array) -> tuple[Array, Array, Array, Array]:
        """Return the data of `Solid.from_core` about the circle; axes point outward, around, and upward."""
        out = np.maximum(np.hypot(places[:, 0], places[:, 1]), TINY)
        axes = upright_axes(np.arctan2(places[:, 1], places[:, 0]))
        apart = np.stack([out - self.ring, np.zeros_like(out), places[:, 2]], axis=1)
        far, normal, hessian = along_axes(apart, np.array([[1.0, 0.0, 1.0]]))
        hessian[:, 1, 1] = normal[:, 0] / out  # the axes turn around the hole
        return far - self.tube, axes, normal, hessian


class Prism(Solid):
    """An upright prism on a regular polygon, with rounded edges."""

    kind: Literal["prism"]
    corners: int = Field(ge=3, le=100, strict=True, description="of the polygon")
    radius: Positive = Field(description="of the circle about the polygon, m")
    height: Positive = Field(description="m")
    rounding: Positive = Field(description="radius of edges, m; fits into the prism")
    turn: Finite = Field(0.0, description="angle of a corner from x, degrees")

    @model_validator(mode="after")
    def _has_a_core(self) -> Self:
        most = min(self.radius * math.cos(math.pi / self.corners), self.height / 2)
        if self.rounding >= most:
            raise ValueError(f"'body.rounding' is {self.rounding:g}, but it must be smaller than {most:g}")
        return self

    def from_core(self, places: Array) -> tuple[Array, Array, Array, Array]:
        """Return the data of `Solid.from_core` about the sharp prism; axes are those of the nearest side."""
        sector = 2 * math.pi / self.corners
        inner = self.radius * math.cos(sector / 2) - self.rounding  # from the axis to a side of the core
        angle = np.arctan2(places[:, 1], places[:, 0])
        side = (np.floor((angle - math.radians(self.turn)) / sector) + 0.5) * sector + math.radians(self.turn)
        axes = upright_axes(side)
        along = np.einsum("nia,na->ni", axes, places)
        sizes = np.array([inner, inner * math.tan(sector / 2), self.height / 2 - self.rounding])
        beyond = np.abs(along) - sizes
        signs = np.where(along < 0, -1.0, 1.0)
        far, normal, hessian = along_axes(np.maximum(beyond, 0.0) * signs, (beyond > 0).astype(float))
        # Within the core the nearest surface is its top, its bottom or this side.
        inside = beyond.max(axis=1) <= 0
        depth, upward = beyond[:, [0, 2]].max(axis=1), beyond[:, 2] > beyond[:, 0]
        face = np.where(upward[:, None], signs * [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
        distance = np.where(inside, depth, far) - self.rounding
        normal = np.where(inside[:, None], face, normal)
        return distance, axes, normal, np.where(inside[:, None, None], 0.0, hessian)


def upright_axes(angles: Array) -> Array:
    """Return axes (n, 3, 3) as rows: at angles (n,) from x, a quarter of a turn on, and upward."""
    axes = np.zeros((len(angles), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(angles)
    axes[:, 0, 1], axes[:, 1, 0], axes[:, 2, 2] = np.sin(angles), -np.sin(angles), 1.0
    return axes


Body = Annotated[Ball | Torus | Prism, Field(discriminator="kind")]
