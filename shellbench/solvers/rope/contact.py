"""Collisions, section 6 of the paper: masses inside an obstacle after a step are pushed out of it.

There are three pushes. "gradient" moves a mass by its depth along the gradient of phi. "reverse" moves it by its depth
back along the path of the step, as the paper proposes. Both may be repeated, and both miss a mass that has passed
through an obstacle within one step. "history" is an extension of the paper: it finds the point where the path enters
the obstacle, by steps of the length phi. These steps can't miss it unless phi comes from a formula and exceeds the
distance. The rest of the step continues with the velocity after the impact. A mass that is still inside then moves out
along the gradient.

All positions are relative to the obstacle. A place before the step is carried with it (section 6 of the paper).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.rope.placing import unit
from shellbench.solvers.rope.pulls import dot

Array = NDArray[np.float64]
Push = Literal["gradient", "reverse", "history"]
Normal = Literal["gradient", "reverse"]

CLOSE = 1e-12  # relative to the way: a mass so near has arrived
MARCHES = 200  # steps along a way toward an obstacle
LEAVING = 1e-6  # of the way, after which a mass that left the surface may meet it again
LAST_PUSHES = 3  # along the gradient, after which nothing of a smooth obstacle is left to leave


@dataclass(frozen=True)
class Impact:
    """Masses (C, 3) after a collision, their velocities, and which of them touch the obstacle."""

    places: Array
    velocities: Array
    touching: NDArray[np.bool_]


def rebound(velocities: Array, body: Array, normals: Array, friction: float) -> Array:
    """Return velocities after an impact, eqs. (14) to (16), with the factor N-hat that the printed eq. (15) lacks.

    Parameters
    ----------
    velocities, normals
        (C, 3), m/s, and of length one.
    body
        Velocity of the obstacle at the masses, (C, 3), m/s.
    """
    along = dot(velocities, normals)
    forced = dot(np.broadcast_to(body, normals.shape), normals)
    allowed = np.maximum(along, forced)
    dragged = body - forced[:, None] * normals
    sliding = velocities - along[:, None] * normals - dragged
    speed = np.linalg.norm(sliding, axis=-1)
    with np.errstate(all="ignore"):
        kept = np.where(speed > 0, np.maximum(0.0, 1.0 - friction * (allowed - along) / speed), 0.0)
    return np.asarray(allowed[:, None] * normals + dragged + kept[:, None] * sliding)


def push_out(obstacle: Any, offsets: Array, back: Array, push: Push, pushes: int) -> Array:
    """Return places relative to the obstacle after pushes by the depth; `back` (C, 3) leads to the way's start."""
    room = np.linalg.norm(back, axis=-1)
    direction = unit(back)
    for _ in range(pushes):
        depth = np.maximum(0.0, -obstacle.distance(offsets))
        if push == "reverse":
            depth = np.minimum(depth, room)  # else a long push would leave the way's start behind
            room = room - depth
            offsets = offsets + depth[:, None] * direction
        else:
            offsets = offsets + depth[:, None] * obstacle.gradient(offsets)
    return offsets


def entry_share(obstacle: Any, start: Array, way: Array) -> Array:
    """Return the share (C,) of each path (C, 3) before it meets the obstacle; 1 if it does not."""
    length = np.linalg.norm(way, axis=-1)
    moves, near = length > 0, CLOSE * length
    touching = obstacle.distance(start) <= near
    met = touching & moves & (dot(way, obstacle.gradient(start)) < 0)
    running = moves & ~met
    part = np.where(touching & ~met, LEAVING, 0.0)
    for _ in range(MARCHES):
        distance = obstacle.distance(start + np.minimum(part, 1.0)[:, None] * way)
        met |= running & (distance <= near)
        running &= ~met
        if not running.any():
            break
        part[running] += distance[running] / length[running]
        running &= part < 1.0
    return np.where(met | running, part, 1.0)  # a path that still runs has come close at a grazing angle


def collide(
    obstacle: Any,
    earlier: Array,
    places: Array,
    velocities: Array,
    times: tuple[float, float],
    push: Push,
    pushes: int,
    normal: Normal,
) -> Impact:
    """Return masses after their collisions with one obstacle.

    Parameters
    ----------
    earlier, places, velocities
        (C, 3): before the step, after it, and the velocity of the step.
    times
        Start and end of the step, s.
    """
    now = obstacle.at(times[1])[0]
    end = places - now
    inside = obstacle.distance(end) < 0
    if push != "history" and not inside.any():
        return Impact(places, velocities, inside)
    start = obstacle.carried(earlier, *times)
    if push == "history":
        return _follow(obstacle, start, end, velocities, times)
    offsets = push_out(obstacle, end, start - end, push, pushes)
    normals = obstacle.gradient(offsets) if normal == "gradient" else unit(start - end)
    after = rebound(velocities, obstacle.velocity(offsets, times[1]), normals, obstacle.friction)
    chosen = inside[:, None]
    return Impact(np.where(chosen, now + offsets, places), np.where(chosen, after, velocities), inside)


def _follow(obstacle: Any, start: Array, end: Array, velocities: Array, times: tuple[float, float]) -> Impact:
    """Follow the path to the obstacle, and continue with the velocity after the impact."""
    way = end - start
    part = entry_share(obstacle, start, way)
    inside = (part < 1.0) | (obstacle.distance(end) < 0)
    now, speeds = obstacle.at(times[1])[0], np.array(velocities)
    ends = now + end
    if inside.any():
        spent = np.where(part < 1.0, part, 0.0)[inside, None]
        met = start[inside] + spent * way[inside]
        body = obstacle.velocity(met, times[1])
        speeds[inside] = rebound(velocities[inside], body, obstacle.gradient(met), obstacle.friction)
        offsets = met + (1.0 - spent) * (times[1] - times[0]) * (speeds[inside] - body)
        ends[inside] = now + push_out(obstacle, offsets, offsets, "gradient", LAST_PUSHES)
    return Impact(ends, speeds, inside)
