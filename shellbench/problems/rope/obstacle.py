"""Obstacles: bodies that masses can't enter, given by their signed distance phi.

phi is negative inside. Its gradient has length one and points outward. All bodies can move without turning.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from shellbench.model import Finite, Model, Positive, Vector
from shellbench.problems.rope.motion import Path, moved

Array = NDArray[np.float64]
TINY = 1e-300  # keeps directions at a centre finite


class Body(Model):
    """What obstacles have in common."""

    centre: Path = Field(description="where it is, m: numbers, or formulas of the time t")
    friction: Annotated[Finite, Field(ge=0)] = Field(0.0, description="Coulomb's coefficient")

    def distance(self, offsets: Array) -> Array:
        """Return phi (...), m, at places (..., 3) relative to the centre, m."""
        raise NotImplementedError

    def gradient(self, offsets: Array) -> Array:
        """Return the gradient of phi (..., 3) at places (..., 3) relative to the centre, m."""
        raise NotImplementedError

    def at(self, time: float) -> tuple[Array, Array]:
        """Return its centre (3,), m, and its velocity (3,), m/s."""
        position, velocity, _ = moved(self.centre, time)
        return position, velocity


class Sphere(Body):
    """A ball."""

    kind: Literal["sphere"]
    radius: Positive = Field(description="m")

    def distance(self, offsets: Array) -> Array:
        """Return the distance from the centre less the radius."""
        return np.asarray(np.linalg.norm(offsets, axis=-1) - self.radius)

    def gradient(self, offsets: Array) -> Array:
        """Return the direction from the centre."""
        return np.asarray(offsets / np.maximum(np.linalg.norm(offsets, axis=-1, keepdims=True), TINY))


class Directed(Body):
    """An obstacle with a direction."""

    normal: Vector = Field(description="outward direction; of any length but zero")

    @field_validator("normal")
    @classmethod
    def _points_somewhere(cls, normal: tuple[float, ...]) -> tuple[float, ...]:
        if not np.linalg.norm(normal) > 0:
            raise ValueError("a normal of zero length points nowhere")
        return normal

    @property
    def unit(self) -> Array:
        """The normal (3,), of length one."""
        return np.asarray(np.array(self.normal) / np.linalg.norm(self.normal))


class HalfSpace(Directed):
    """All that is below a plane through the centre."""

    kind: Literal["plane"]

    def distance(self, offsets: Array) -> Array:
        """Return the height above the plane."""
        return np.asarray(offsets @ self.unit)

    def gradient(self, offsets: Array) -> Array:
        """Return the normal."""
        return np.array(np.broadcast_to(self.unit, offsets.shape))


class Plate(Directed):
    """A plate without end, with two faces."""

    kind: Literal["plate"]
    half_thickness: Positive = Field(description="from its middle to a face, m")

    def distance(self, offsets: Array) -> Array:
        """Return the distance from the middle less half the thickness."""
        return np.abs(offsets @ self.unit) - self.half_thickness

    def gradient(self, offsets: Array) -> Array:
        """Return the normal of the nearer face."""
        side = np.where(offsets @ self.unit >= 0, 1.0, -1.0)
        return np.asarray(side[..., None] * self.unit)


class Capsule(Body):
    """A ball that is drawn along a segment."""

    kind: Literal["capsule"]
    half_axis: Vector = Field(description="from the centre to an end of the segment, m")
    radius: Positive = Field(description="m")

    def _from_axis(self, offsets: Array) -> Array:
        half = np.array(self.half_axis)
        along = np.clip(offsets @ half / max(float(half @ half), TINY), -1.0, 1.0)
        return np.asarray(offsets - along[..., None] * half)

    def distance(self, offsets: Array) -> Array:
        """Return the distance from the segment less the radius."""
        return np.asarray(np.linalg.norm(self._from_axis(offsets), axis=-1) - self.radius)

    def gradient(self, offsets: Array) -> Array:
        """Return the direction from the nearest point of the segment."""
        apart = self._from_axis(offsets)
        return np.asarray(apart / np.maximum(np.linalg.norm(apart, axis=-1, keepdims=True), TINY))


Obstacle = Annotated[Sphere | HalfSpace | Plate | Capsule, Field(discriminator="kind")]


def deepest(obstacles: tuple[Any, ...], places: Array, time: float) -> float:
    """Return the largest depth, m, of places (n, 3) in obstacles at a time; 0 if none is inside."""
    depths = [-obstacle.distance(places - obstacle.at(time)[0]).min() for obstacle in obstacles if len(places)]
    return float(max([0.0, *depths]))
