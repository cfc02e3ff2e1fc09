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
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shellbench.protocol.schema import Finite, Model, Positive, Vector

Array = NDArray[np.float64]
GOLDEN = math.pi * (3 - math.sqrt(5))  # the golden angle
TINY = 1e-300  # m: keeps places in a core from a division by zero


class FromCore(NamedTuple):
    """Signed distances (n,), m, of places, and data along axes of each place.

    Attributes
    ----------
    axes
        The axes (n, 3, 3) as rows, or one set (3, 3) for all places.
    normal
        The outward unit normal (n, 3).
    bends, near
        The Hessian of the distance is the diagonal of `bends` (n, 3) less `near` (n,) times the normal's square, 1/m.
    """

    distance: Array
    axes: Array
    normal: Array
    bends: Array
    near: Array


class Solid(Model):
    """Base of the bodies: distances, normals and their slopes."""

    centre: Vector = Field((0.0, 0.0, 0.0), description="where it is, m")

    @abstractmethod
    def from_core(self, places: Array) -> FromCore:
        """Return the data of places (n, 3) relative to the centre."""

    @property
    def is_exact(self) -> bool:
        """True if a cloth sees exact distances, False if it sees planes of vertices."""
        return True

    def distance(self, places: Array) -> Array:
        """Return the exact signed distance (n,) of places (n, 3) from its surface, m."""
        return self.from_core(places - np.array(self.centre)).distance

    def contact(self, places: Array) -> tuple[Array, Array]:
        """Return signed distances (n,), m, of places (n, 3) as collision sees them, and outward unit normals (n, 3)."""
        found = self.from_core(places - np.array(self.centre))
        return found.distance, (found.normal[:, None] @ found.axes)[:, 0]

    def curvature(self, places: Array) -> Array:
        """Return the Hessian (n, 3, 3) of the exact distance at places (n, 3), 1/m: the slope of the normal."""
        _, axes, normal, bends, near = self.from_core(places - np.array(self.centre))
        along = bends[:, :, None] * np.eye(3) - near[:, None, None] * normal[:, :, None] * normal[:, None]
        return np.asarray(np.swapaxes(axes, -1, -2) @ along @ axes)


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

    def from_core(self, places: Array) -> FromCore:
        """Return the data of places (n, 3) relative to the centre."""
        far = length(places)
        bends = np.broadcast_to(1 / far[:, None], places.shape)
        return FromCore(far - self.radius, np.eye(3), places / far[:, None], bends, 1 / far)

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

    def from_core(self, places: Array) -> FromCore:
        """Return the data of places (n, 3) relative to the centre; axes point outward, around, and upward."""
        out = length(places[:, :2])
        apart = np.stack([out - self.ring, np.zeros_like(out), places[:, 2]], axis=1)
        far = length(apart)
        normal = apart / far[:, None]
        bends = np.stack([1 / far, normal[:, 0] / out, 1 / far], axis=1)  # the second: axes turn around the hole
        return FromCore(far - self.tube, upright_axes(np.arctan2(places[:, 1], places[:, 0])), normal, bends, 1 / far)


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

    def from_core(self, places: Array) -> FromCore:
        """Return the data of places (n, 3) relative to the centre; axes are those of the nearest side.

        Along an axis on which a place is beyond the core, the nearest point of the core stays. Along others it follows.
        """
        sector = 2 * math.pi / self.corners
        inner = self.radius * math.cos(sector / 2) - self.rounding  # from the axis to a side of the core
        angle = np.arctan2(places[:, 1], places[:, 0])
        side = (np.floor((angle - math.radians(self.turn)) / sector) + 0.5) * sector + math.radians(self.turn)
        axes = upright_axes(side)
        along = (axes @ places[:, :, None])[:, :, 0]
        sizes = np.array([inner, inner * math.tan(sector / 2), self.height / 2 - self.rounding])
        beyond = np.abs(along) - sizes
        signs = np.where(along < 0, -1.0, 1.0)
        apart = np.maximum(beyond, 0.0) * signs
        far = length(apart)
        # Within the core the nearest surface is its top, its bottom or this side.
        inside = beyond.max(axis=1) <= 0
        depth, upward = beyond[:, [0, 2]].max(axis=1), beyond[:, 2] > beyond[:, 0]
        face = np.where(upward[:, None], signs * [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
        near = np.where(inside, 0.0, 1 / far)
        normal = np.where(inside[:, None], face, apart / far[:, None])
        return FromCore(np.where(inside, depth, far) - self.rounding, axes, normal, near[:, None] * (beyond > 0), near)


def length(vectors: Array) -> Array:
    """Return the lengths (n,) of vectors (n, k), none of them zero."""
    return np.asarray(np.maximum(np.sqrt(np.einsum("nk,nk->n", vectors, vectors)), TINY))


def upright_axes(angles: Array) -> Array:
    """Return axes (n, 3, 3) as rows: at angles (n,) from x, a quarter of a turn on, and upward."""
    axes = np.zeros((len(angles), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(angles)
    axes[:, 0, 1], axes[:, 1, 0], axes[:, 2, 2] = np.sin(angles), -np.sin(angles), 1.0
    return axes


Body = Annotated[Ball | Torus | Prism, Field(discriminator="kind")]
