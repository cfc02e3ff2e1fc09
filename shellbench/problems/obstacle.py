"""Obstacles: bodies that masses and shells can't enter, given by their signed distance phi.

phi is negative inside. Its gradient has length one and points outward. All bodies can move without turning. For a
formula that is no distance, phi over the length of its gradient is a distance to first order, exact at the surface.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from shellbench.errors import InputError
from shellbench.problems.expression import Expression
from shellbench.problems.moving import Path, moved
from shellbench.problems.taylor import Taylor
from shellbench.protocol.schema import Finite, Model, Positive, Vector

Array = NDArray[np.float64]
FLAT = 1e-9  # height of a corner above a face of a convex mesh, of the mesh's size: rounding
TINY = 1e-300  # keeps directions at a centre finite
QUOTED = 60  # characters of a formula in a message


class Body(Model):
    """Base of all obstacles: a centre, friction and a signed distance."""

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

    def carried(self, places: Array, earlier: float, time: float) -> Array:
        """Return places (..., 3), m, of an earlier time relative to the centre, moved with the body since."""
        return np.asarray(places - self.at(earlier)[0])

    def velocity(self, offsets: Array, time: float) -> Array:
        """Return the body's velocity (..., 3), m/s, at places (..., 3) relative to the centre."""
        return np.broadcast_to(self.at(time)[1], offsets.shape)


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
    """The half-space below a plane through the centre."""

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
    """A ball swept along a segment."""

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


class Box(Body):
    """A box with faces across x, y and z."""

    kind: Literal["box"]
    half_sides: tuple[Positive, Positive, Positive] = Field(description="from the centre to a face, by axis, m")

    def distance(self, offsets: Array) -> Array:
        """Return the distance from the nearest face, edge or corner."""
        beyond = np.abs(offsets) - np.array(self.half_sides)
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0))

    def gradient(self, offsets: Array) -> Array:
        """Return the direction from the nearest place of the surface, or toward it from inside."""
        beyond = np.abs(offsets) - np.array(self.half_sides)
        nearest = beyond == beyond.max(axis=-1, keepdims=True)
        apart = np.where(np.any(beyond > 0, axis=-1, keepdims=True), np.maximum(beyond, 0), nearest)
        apart = apart * np.where(offsets >= 0, 1.0, -1.0)
        return np.asarray(apart / np.linalg.norm(apart, axis=-1, keepdims=True))


class ConvexMesh(Body):
    """A convex body, given by a closed mesh of triangles."""

    kind: Literal["mesh"]
    corners: tuple[Vector, ...] = Field(description="from the centre, m")
    triangles: tuple[tuple[int, int, int], ...] = Field(
        description="numbers of three corners each, from 0, counterclockwise from outside"
    )

    @model_validator(mode="after")
    def _encloses_a_convex_body(self) -> Self:
        edges = [(face[k], face[(k + 1) % 3]) for face in self.triangles for k in range(3)]
        if not edges or not all(0 <= corner < len(self.corners) for edge in edges for corner in edge):
            raise ValueError(f"triangles must name corners by 0 to {len(self.corners) - 1}")
        if len(set(edges)) < len(edges) or {edge[::-1] for edge in edges} != set(edges):
            raise ValueError("triangles must close, all of them counterclockwise from outside")
        places, (_, normals, levels) = np.array(self.corners), _faces(self.corners, self.triangles)
        heights, rounding = places @ normals.T + levels, FLAT * np.ptp(places, axis=0).max()
        if not (heights.max() <= rounding and (heights.min(axis=0) < -rounding).all()):
            raise ValueError("the mesh must be convex, not flat, and its triangles counterclockwise from outside")
        return self

    def _nearest(self, offsets: Array) -> tuple[Array, Array]:
        """Return the distance (...), m, and the direction (..., 3) from the nearest place of the surface."""
        # Inside, the nearest face counts. Outside it is that among the faces over which a place lies, and the edges.
        triangles, normals, levels = _faces(self.corners, self.triangles)
        places = offsets.reshape(-1, 1, 3)
        heights = places[:, 0] @ normals.T + levels
        face = heights.argmax(axis=1)
        distance, direction = heights.max(axis=1), normals[face]
        outside = np.flatnonzero(distance > 0)
        best, over = np.full(len(outside), np.inf), np.ones((len(outside), len(triangles)), dtype=bool)
        for k in range(3):
            start, along = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
            apart = places[outside] - start
            over &= np.einsum("pti,ti->pt", apart, np.cross(normals, along)) >= 0
            share = np.clip(np.einsum("pti,ti->pt", apart, along) / (along**2).sum(axis=-1), 0.0, 1.0)
            from_edge = apart - share[..., None] * along
            length = np.linalg.norm(from_edge, axis=-1)
            nearest = length.argmin(axis=1)[:, None]
            closer = np.take_along_axis(length, nearest, 1)[:, 0] < best
            best[closer] = length.min(axis=1)[closer]
            chosen = np.take_along_axis(from_edge, nearest[..., None], 1)[:, 0]
            direction[outside[closer]] = chosen[closer] / np.maximum(best[closer], TINY)[:, None]
        height = np.where(over & (heights[outside] > 0), heights[outside], np.inf)
        flat = height.min(axis=1) <= best
        direction[outside[flat]] = normals[height.argmin(axis=1)[flat]]
        distance[outside] = np.minimum(best, height.min(axis=1))
        return distance.reshape(offsets.shape[:-1]), direction.reshape(offsets.shape)

    def distance(self, offsets: Array) -> Array:
        """Return the distance from the nearest triangle, negative inside."""
        return self._nearest(offsets)[0]

    def gradient(self, offsets: Array) -> Array:
        """Return the direction from the nearest place of the surface, or toward it from inside."""
        return self._nearest(offsets)[1]


@cache
def _faces(
    corners: tuple[tuple[float, ...], ...], triangles: tuple[tuple[int, ...], ...]
) -> tuple[Array, Array, Array]:
    """Return places of triangles (n, 3, 3), m, their normals (n, 3) and levels (n,), m; no number if one is flat."""
    places = np.array(corners)[np.array(triangles)]
    across = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    with np.errstate(invalid="ignore"):
        normals = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return places, normals, -np.einsum("ti,ti->t", normals, places[:, 0])


@cache
def _parsed(formula: str) -> Expression:
    return Expression(formula, variables=("x", "y", "z"), piecewise=True)


class FormulaBody(Body):
    """The body where a formula is negative. Distances are phi over the length of its gradient."""

    kind: Literal["formula"]
    centre: Path = Field((0.0, 0.0, 0.0), description="where x = y = z = 0, m: numbers, or formulas of the time t")
    phi: str = Field(description="formula of x, y and z from the centre, m; negative inside, zero at the surface")

    @field_validator("phi")
    @classmethod
    def _is_a_formula_of_the_place(cls, phi: str) -> str:
        _parsed(phi)
        return phi

    def _to_first_order(self, offsets: Array) -> tuple[Array, Array]:
        """Return phi (...) and its gradient (..., 3), both over the gradient's length; InputError if that is zero."""
        x, y, z = np.moveaxis(offsets, -1, 0)
        # series have two variables: one pass for x and y, one for z
        across = {"x": Taylor.variable(x, 0, 1), "y": Taylor.variable(y, 1, 1), "z": Taylor.constant(z, 1)}
        upward = {"x": Taylor.constant(x, 1), "y": Taylor.constant(y, 1), "z": Taylor.variable(z, 0, 1)}
        level, rising = (_parsed(self.phi).series(values, 1) for values in (across, upward))
        slopes = (level.derivative(1, 0), level.derivative(0, 1), rising.derivative(1, 0))
        phi = np.broadcast_to(level.value, x.shape)
        gradient = np.stack([np.broadcast_to(slope, x.shape) for slope in slopes], axis=-1)
        steep = np.linalg.norm(gradient, axis=-1)
        somewhere = np.isfinite(offsets).all(axis=-1)  # divergence is reported elsewhere
        wrong = somewhere & ~(np.isfinite(phi) & np.isfinite(steep) & (steep > 0))
        if wrong.any():
            place = ", ".join(f"{value:g}" for value in offsets[wrong][0])
            raise InputError(f"phi = '{self.phi[:QUOTED]}' has no gradient, or no value, at x, y, z = {place}")
        return phi / steep, gradient / steep[..., None]

    def distance(self, offsets: Array) -> Array:
        """Return phi over the length of its gradient."""
        return self._to_first_order(offsets)[0]

    def gradient(self, offsets: Array) -> Array:
        """Return the direction of its gradient."""
        return self._to_first_order(offsets)[1]


Obstacle = Annotated[Sphere | HalfSpace | Plate | Capsule | Box | ConvexMesh | FormulaBody, Field(discriminator="kind")]


def deepest(obstacles: tuple[Any, ...], places: Array, time: float) -> float:
    """Return the largest depth, m, of places (n, 3) in obstacles at a time; 0 if none is inside."""
    depths = [-obstacle.distance(places - obstacle.at(time)[0]).min() for obstacle in obstacles if len(places)]
    return float(max([0.0, *depths]))
