"""Motion of a body: sums of sines by clip; a seed of the clip draws amplitudes, frequencies and phases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RATE = 60.0  # frames a second
SINES = 3  # of each coordinate
SLOWEST, FASTEST = 0.25, 0.9  # Hz
RAMP = 0.5  # s in which a motion begins
AMPLITUDES = (0.14, 0.18, 0.03, np.radians(6), np.radians(6), np.radians(25), np.radians(10))
"""Largest of each sine: of the neck's place (x, y, z), m; of lean about x, roll about y, yaw about z; of the stride."""
FORWARD, YAW = 1, 5  # numbers of coordinates
LEAST_DRIFT = 0.5  # of the largest: each clip draws its own speeds
Drift = tuple[float, float]
"""Largest speed forward, m/s, and about z, rad/s; clips turn by turns to the left and to the right."""


@dataclass(frozen=True)
class BodyMotion:
    """The body's frames: places (k, n, 3), m; rotations to the world (k, n, 3, 3); angles (k, n, 4), rad.

    The angles are lean, roll, yaw, and that of the stride.
    """

    places: Array
    rotations: Array
    angles: Array

    @classmethod
    def of(cls, found: Array) -> Self:
        """Return the motion of coordinates (k, n, 7), m and rad."""
        return cls(found[..., :3], rotations(found[..., 3:6]), found[..., 3:])

    @property
    def stride(self) -> Array:
        """Angles of the stride, (k, n), rad."""
        return self.angles[..., 3]

    @property
    def pose(self) -> Array:
        """Input of a quasistatic network, (k, n, 3): the direction of gravity across the body, and the stride."""
        down = -self.rotations[..., 2, :]  # of the world, in the frame of the body
        return np.concatenate([down[..., :2], self.stride[..., None]], axis=-1)

    @property
    def course(self) -> Array:
        """Input of a recurrent network, (k, n, 9): pose, and velocities of neck and turns in the body's frame."""
        velocity = np.gradient(self.places, axis=1) * RATE if self.places.shape[1] > 1 else np.zeros_like(self.places)
        local = np.einsum("knji,knj->kni", self.rotations, velocity)
        turns = np.gradient(self.angles[..., :3], axis=1) * RATE if self.places.shape[1] > 1 else 0.0 * local
        return np.concatenate([self.pose, local, turns], axis=-1)


def body_motion(seed: int, clips: int, frames: int, drift: Drift = (0.0, 0.0)) -> BodyMotion:
    """Return the motion of clips, which begin at rest; a clip does not depend on the number of clips."""
    return BodyMotion.of(np.stack([coordinates(seed, clip, np.arange(frames) / RATE, drift) for clip in range(clips)]))


def coordinates(seed: int, clip: int, time: Array, drift: Drift) -> Array:
    """Return places, m, and angles, rad, (n, 7) of a clip at times (n,), s; before the time 0 it is at rest."""
    part = np.clip(time / RAMP, 0.0, 1.0)
    ramp = part**2 * (3 - 2 * part)
    draw = np.random.default_rng([seed, clip])
    size = draw.uniform(0.2, 1.0, (SINES, len(AMPLITUDES), 1)) * np.array(AMPLITUDES)[:, None]
    pace = draw.uniform(SLOWEST, FASTEST, size.shape)
    phase = draw.uniform(0, 2 * np.pi, size.shape)
    waves = size * (np.sin(2 * np.pi * pace * time + phase) - np.sin(phase))
    found = (ramp * waves.mean(axis=0) * SINES**0.5).T
    gone = RAMP * part**3 * (1 - part / 2) + np.maximum(time - RAMP, 0.0)  # the integral of the ramp
    forward, turning = np.random.default_rng([seed, clip, 1]).uniform(LEAST_DRIFT, 1.0, 2) * drift
    found[:, FORWARD] -= forward * gone  # the back is where y grows
    found[:, YAW] += (-1) ** clip * turning * gone
    return np.asarray(found)


def rotations(angles: Array) -> Array:
    """Return the matrices (..., 3, 3) that lean about x, then roll about y, then turn about z, angles (..., 3), rad."""
    lean, roll, yaw = np.moveaxis(angles, -1, 0)
    one, none = np.ones_like(lean), np.zeros_like(lean)

    def stacked(*rows: tuple[Array, Array, Array]) -> Array:
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    about_x = stacked((one, none, none), (none, np.cos(lean), -np.sin(lean)), (none, np.sin(lean), np.cos(lean)))
    about_y = stacked((np.cos(roll), none, np.sin(roll)), (none, one, none), (-np.sin(roll), none, np.cos(roll)))
    about_z = stacked((np.cos(yaw), -np.sin(yaw), none), (np.sin(yaw), np.cos(yaw), none), (none, none, one))
    return about_z @ about_y @ about_x
