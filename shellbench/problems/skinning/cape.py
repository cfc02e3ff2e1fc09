"""The cape: a cloth by projective dynamics (Bouaziz et al. 2014) on a moving body, all clips at once.

A step of length h finds the x that minimises sum m/(2 h^2) |x - y|^2 + sum w/2 |x_a - x_b - p|^2. Here y is the
position by inertia, air and gravity alone, and p has the spring's rest length along its present direction. The local
step finds p. The global step finds x by a matrix that is inverted once for all steps and clips. Departure from the
textbook: after each global step, vertices inside the body are pushed out to its margin, the way they came. At the end
of a step they are pushed along the gradient of its distance, so that no vertex ends in the body. The upper row is held,
and is no unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problems.skinning.body import Capsule, directions, pushed_out, segments
from shellbench.problems.skinning.motion import RATE, BodyMotion, Drift
from shellbench.protocol.schema import Finite, Model, Positive

Array = NDArray[np.float64]
Slices = tuple[slice, slice]
Say = Callable[[int, int], None]
GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s^2
WHOLE = 360.0  # degrees
SETTLED = 0.9  # share of the velocity that a step of settling keeps


class Cape(Model):
    """The cape and its clips, in SI units. A sector of a cone, open in front; or a skirt, all around.

    Attributes
    ----------
    radii
        Radii of the upper and the lower edge, m.
    around
        Angle of the sector, degrees; 360 for a closed cone.
    mass
        Mass of the whole cape, kg.
    shearing
        Stiffness of springs along diagonals, N/m.
    bending
        Stiffness of springs from a vertex to the one after the next, N/m.
    air
        Air drag: deceleration over velocity, 1/s.
    """

    rows: int = Field(ge=4, le=200, strict=True, description="vertices from the neck down; the first is held")
    columns: int = Field(ge=4, le=200, strict=True, description="vertices around")
    length: Positive = Field(1.0, description="from the neck down, m")
    radii: tuple[Positive, Positive] = Field((0.17, 0.42), description="of the upper and the lower edge, m")
    around: Annotated[Finite, Field(gt=0, le=360)] = Field(170.0, description="of the sector, degrees")
    mass: Positive = Field(0.4, description="of all, kg")
    stretching: Positive = Field(400.0, description="stiffness of springs along the threads, N/m")
    shearing: Positive = Field(40.0, description="of springs along diagonals, N/m")
    bending: Positive = Field(1.0, description="of springs to the vertex after the next, N/m")
    air: Annotated[Finite, Field(ge=0)] = Field(1.5, description="deceleration over velocity, 1/s")
    iterations: int = Field(10, ge=1, le=1000, strict=True, description="local and global steps of each step in time")
    settling: int = Field(120, ge=0, le=10_000, strict=True, description="steps in which it comes to rest at the start")
    clips: int = Field(ge=1, le=100, strict=True, description="number of clips")
    frames: int = Field(ge=2, le=10_000, strict=True, description="of each clip, 60 a second")
    seed: int = Field(0, ge=0, le=2**31 - 1, strict=True, description="of the motions")
    running: Annotated[Finite, Field(ge=0)] = Field(0.0, description="largest speed forward of a clip, m/s")
    twirling: Annotated[Finite, Field(ge=0)] = Field(0.0, description="largest speed about z of a clip, degrees/s")

    @property
    def closed(self) -> bool:
        """True if the last column of vertices is beside the first one."""
        return self.around == WHOLE

    @property
    def drift(self) -> Drift:
        """Largest speeds of a clip: forward, m/s, and about z, rad/s."""
        return self.running, float(np.radians(self.twirling))

    def rest(self) -> Array:
        """Return the pattern, vertices (rows, columns, 3), m, in the frame of the neck."""
        down = np.linspace(0.0, 1.0, self.rows)[:, None]
        angle = np.radians(self.around) * np.linspace(-0.5, 0.5, self.columns + self.closed)[: self.columns]
        radius = self.radii[0] + down * (self.radii[1] - self.radii[0])
        height = -down * np.sqrt(max(self.length**2 - (self.radii[1] - self.radii[0]) ** 2, 0.0)) * np.ones_like(angle)
        return np.stack([radius * np.sin(angle), radius * np.cos(angle), height], axis=-1)


class Cloth:
    """The cape in time steps: springs as pairs of slices of the grid, and the inverse matrix of the free vertices."""

    def __init__(self, cape: Cape, body: Sequence[Capsule], margin: float) -> None:
        self.cape, self.body, self.margin = cape, body, margin
        self.radii = np.array([part.radius for part in body])
        self.rest = cape.rest()
        self.families = [(weight, *pair) for weight, pairs in self._pairs() for pair in pairs]
        self.lengths = [np.linalg.norm(self.rest[a] - self.rest[b], axis=-1) for _, a, b in self.families]
        self.inertia = cape.mass / (cape.rows * cape.columns) * RATE**2
        matrix = self.inertia * np.eye(cape.rows * cape.columns)
        numbers = np.arange(cape.rows * cape.columns).reshape(cape.rows, cape.columns)
        for weight, a, b in self.families:
            one, other = numbers[a].ravel(), numbers[b].ravel()
            matrix[one, one] += weight  # within a family no vertex is the first end twice, nor the second
            matrix[other, other] += weight
            matrix[one, other] -= weight
            matrix[other, one] -= weight
        self.inverse = np.linalg.inv(matrix[cape.columns :, cape.columns :])
        self.held = matrix[cape.columns :, : cape.columns]

    def _pairs(self) -> list[tuple[float, list[tuple[Slices, Slices]]]]:
        """Return stiffnesses with the pairs of slices whose vertices they join."""

        def shifted(down: int, across: int) -> tuple[Slices, Slices]:
            upper, lower = slice(None, -down or None), slice(down, None)
            left, right = slice(None, -abs(across) or None), slice(abs(across), None)
            return ((upper, left), (lower, right)) if across >= 0 else ((upper, right), (lower, left))

        def seam(down: int, across: int) -> list[tuple[Slices, Slices]]:
            upper, lower = slice(None, -down or None), slice(down, None)
            last, first = slice(-abs(across), None), slice(None, abs(across))
            one, other = (last, first) if across > 0 else (first, last)
            return [((upper, one), (lower, other))] if cape.closed else []

        cape = self.cape
        return [
            (cape.stretching, [shifted(1, 0), shifted(0, 1), *seam(0, 1)]),
            (cape.shearing, [shifted(1, 1), shifted(1, -1), *seam(1, 1), *seam(1, -1)]),
            (cape.bending, [shifted(2, 0), shifted(0, 2), *seam(0, 2)]),
        ]

    def step(self, now: Array, velocity: Array, collar: Array, before: Array, axes: Array) -> tuple[Array, Array]:
        """Return places and velocities, (3, rows, columns, k), after a step.

        Parameters
        ----------
        now, velocity
            (3, rows, columns, k), m and m/s: components first, for sums over them are then fast.
        collar
            The held row after the step, (3, columns, k), m.
        before, axes
            Of the capsules before and after the step, (k, c, 2, 3), m.
        """
        cape, free = self.cape, len(self.inverse)
        ahead = now + velocity * (1 - cape.air / RATE) / RATE + (GRAVITY / RATE**2)[:, None, None, None]
        found = ahead.copy()
        found[:, 0] = collar
        boundary = np.einsum("fc,dck->fdk", self.held, collar).reshape(free, -1)
        way = directions(self._by_clip(now), before)
        for _ in range(cape.iterations):
            pull = self.inertia * ahead
            for (weight, a, b), length in zip(self.families, self.lengths, strict=True):  # the local step
                span = found[:, *a] - found[:, *b]
                span *= weight * length[..., None] / np.sqrt(span[0] ** 2 + span[1] ** 2 + span[2] ** 2)
                pull[:, *a] += span
                pull[:, *b] -= span
            wanted = np.moveaxis(pull[:, 1:], 0, 2).reshape(free, -1)  # the global step
            moved = (self.inverse @ (wanted - boundary)).reshape(free, 3, -1).transpose(2, 0, 1)
            out = pushed_out(moved, axes, self.radii, self.margin, way)
            found[:, 1:] = out.transpose(2, 1, 0).reshape(found[:, 1:].shape)
        out = pushed_out(self._by_clip(found), axes, self.radii, self.margin)
        found[:, 1:] = out.transpose(2, 1, 0).reshape(found[:, 1:].shape)
        return found, (found - now) * RATE

    def _by_clip(self, places: Array) -> Array:
        """Return the free vertices (k, f, 3) of places (3, rows, columns, k)."""
        return places[:, 1:].reshape(3, len(self.inverse), -1).transpose(2, 1, 0)


def draped(cape: Cape, body: Sequence[Capsule], margin: float) -> Array:
    """Return the shape of the cape at rest on the body at rest, (rows, columns, 3), m."""
    cloth = Cloth(cape, body, margin)
    at_rest = segments(body, np.zeros(1))
    places = np.moveaxis(cloth.rest, -1, 0)[..., None]
    velocity, collar = np.zeros_like(places), places[:, 0]
    for _ in range(cape.settling):
        places, velocity = cloth.step(places, SETTLED * velocity, collar, at_rest, at_rest)
    return np.moveaxis(places[..., 0], 0, -1)


def simulated(cape: Cape, body: Sequence[Capsule], margin: float, motion: BodyMotion, rest: Array, say: Say) -> Array:
    """Return the clips (k, n, rows, columns, 3), m, in the frame of the neck; they start with the cape at rest."""
    cloth = Cloth(cape, body, margin)
    places = np.repeat(np.moveaxis(rest, -1, 0)[..., None], cape.clips, axis=-1)
    velocity = np.zeros_like(places)
    clips = np.empty((cape.clips, cape.frames, cape.rows, cape.columns, 3))
    axes = segments(body, motion.stride)
    ends = axes[:, 0]  # both frames coincide at the start
    for frame in range(cape.frames):
        turn, place = motion.rotations[:, frame], motion.places[:, frame]
        collar = np.einsum("kij,cj->ick", turn, cloth.rest[0]) + place.T[:, None]
        before, ends = ends, np.einsum("kij,kcej->kcei", turn, axes[:, frame]) + place[:, None, None]
        if frame:
            places, velocity = cloth.step(places, velocity, collar, before, ends)
        clips[:, frame] = np.einsum("kji,jrck->krci", turn, places - place.T[:, None, None])
        say(frame + 1, cape.frames)
    return clips
