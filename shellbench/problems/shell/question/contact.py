"""Contact of shells with obstacles: the gap, the contact forces, and their measurement.

Static contact is without friction. The gap is that of the deformed midsurface, x + u, in the linear theory too. With
`thickness` a face of the shell touches: the midsurface keeps half a thickness from the obstacle, along the obstacle's
normal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problems.shell.question.search import largest
from shellbench.protocol.schema import Flag, Model

Array = NDArray[np.float64]

STARTS_INSIDE = 1e-9  # of the shell's size: a depth at rest that is more than rounding
REST_SAMPLES = 41  # points a side at which the gap of a shell at rest is checked
LINE = 512  # panels of a coordinate line, whose length is measured by two Gauss points each


class Contact(Model):
    """Options of the contact of the shell with obstacles."""

    thickness: Flag = Field(False, description="whether a face touches, half a thickness from the midsurface")


@dataclass(frozen=True)
class Touch:
    """Contact forces of obstacles on a shell, at the points where its solver computes them.

    Attributes
    ----------
    points
        (n, 2) in rows along both coordinates.
    forces
        (n, 3) on the shell, N.
    lengths
        (n, 2) lengths of the shell at rest that a point stands for in its row, by coordinate, m.
    reach
        (2,) length along either coordinate, m, over which forces make a pressure; below it they are numerical noise.
    """

    points: Array
    forces: Array
    lengths: Array
    reach: Array


def touch_at_vertices(case: Any, points: Array, steps: Array, forces: Array) -> Touch:
    """Return forces (v, 3), N, at the vertices (v, 2) of an even grid with steps (2,), as contact."""
    x = case.surface.derivatives(points, order=1)
    speeds = np.stack([np.linalg.norm(x[order], axis=-1) for order in ((1, 0), (0, 1))], axis=-1)
    domain = case.surface.domain
    at_end = (points - domain.lower <= 1e-9 * steps) | (np.asarray(domain.upper) - points <= 1e-9 * steps)
    lengths = speeds * steps * np.where(at_end & ~np.asarray(domain.periodic), 0.5, 1.0)
    return Touch(points, forces, lengths, 2 * lengths.max(axis=0))


def kept_touch(touching: Sequence[Touch]) -> dict[str, Array]:
    """Return the arrays that a file keeps of contact at some states, by name; empty if nothing was touched."""
    if not touching:
        return {}
    first = touching[0]
    forces = np.stack([touch.forces for touch in touching])
    return {
        "touch_points": first.points,
        "touch_lengths": first.lengths,
        "touch_forces": forces,
        "touch_reach": first.reach,
    }


def restored_touch(arrays: Mapping[str, NDArray[Any]]) -> tuple[Touch, ...]:
    """Return the contact at each state from the arrays of `kept_touch`."""
    if "touch_points" not in arrays:
        return ()
    points, lengths, reach = (arrays[f"touch_{name}"] for name in ("points", "lengths", "reach"))
    return tuple(Touch(points, forces, lengths, reach) for forces in arrays["touch_forces"])


def gaps(case: Any, points: Array, displacement: Array, t: float = 1.0) -> tuple[Array, Array]:
    """Return the gap (n,) to the nearest obstacle, m, and the direction (n, 3) in which it grows.

    Parameters
    ----------
    points, displacement
        (n, 2) on the shell, and (n, 3) there, m.
    t
        Load factor or time.
    """
    gap, normal, _ = nearest_obstacle(case, points, displacement, t)
    return gap, normal


def nearest_obstacle(
    case: Any, points: Array, displacement: Array, t: float, rest: Array | None = None
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return the results of `gaps`, and the numbers (n,) of the nearest obstacles; `rest` (n, 3) are points at rest."""
    places = (case.surface.position(points) if rest is None else rest) + displacement
    offsets = [places - obstacle.at(t)[0] for obstacle in case.obstacles]
    distances = [obstacle.distance(o) for obstacle, o in zip(case.obstacles, offsets, strict=True)]
    gradients = [obstacle.gradient(o) for obstacle, o in zip(case.obstacles, offsets, strict=True)]
    nearest = np.argmin(distances, axis=0)
    own = np.arange(len(places))
    gap, normal = np.array(distances)[nearest, own], np.array(gradients)[nearest, own]
    if case.contact.thickness:
        factor = case.material.factors(points, case.surface.named_constants)[1]
        gap = gap - factor * case.material.thickness / 2
    return gap, normal, nearest


def check_contact(case: Any) -> None:
    """Check that a case with obstacles can be followed.

    Raises
    ------
    ValueError
        In one clause that states the fault.
    """
    if not case.obstacles:
        if case.contact != type(case.contact)():  # a record has the defaults, too
            raise ValueError("[contact] says how obstacles are touched, but there are no [[obstacles]]")
        return
    if case.remove_rigid_motions:
        raise ValueError("obstacles stand in space: no rigid motion is removed where there are any")
    if case.modal or case.prescribed:
        raise ValueError("obstacles belong to a shell that loads move: not to modes, nor to a prescribed displacement")
    for obstacle in case.obstacles:
        if obstacle.friction and case.dynamics is None:
            raise ValueError(
                f"an obstacle of kind '{obstacle.kind}' has friction, but without [dynamics] shells slide freely"
            )
    points = case.surface.domain.grid(REST_SAMPLES, REST_SAMPLES).reshape(-1, 2)
    rest = np.zeros((len(points), 3))
    size = float(np.ptp(case.surface.position(points), axis=0).max())
    for number, obstacle in enumerate(case.obstacles, start=1):
        alone = case.model_copy(update={"obstacles": (obstacle,)})
        gap, _ = gaps(alone, points, rest, 1.0 if case.linear else 0.0)  # a linear shell has one state, at t = 1
        deepest = int(np.argmin(gap))
        if not gap[deepest] >= -STARTS_INSIDE * size:
            where = ", ".join(f"{v:.4g}" for v in case.surface.domain.wrap(points)[deepest])
            raise ValueError(
                f"the shell starts in obstacle {number}, of kind '{obstacle.kind}': at (xi1, xi2) = ({where}) it is"
                f" {-gap[deepest]:.3g} deep"
            )


def largest_depth(solution: Any, at: float | None) -> float:
    """Return the largest depth of the displaced shell in obstacles, m; 0 if it is in none."""
    # The search includes the points where forces act.
    case, t = solution.case, at
    if t is None:
        t = 1.0 if case.dynamics is None else case.dynamics.until

    def depth(points: Array) -> Array:
        gap, _ = gaps(case, points, solution.displacement(points, at=at), t)
        return -gap

    return max(0.0, largest(case.surface.domain, depth, solution.touch(at).points))


def edge_of_contact(case: Any, touch: Touch, start: tuple[float, float], axis: int, forward: bool) -> float:
    """Return the distance from a point to the start of contact along a coordinate line, m; ValueError if none.

    The edge lies within a cell: a line force at the edge and a pressure behind it have the resultant and the moment of
    the forces that the solver found.
    """
    # 1. Find the row of points nearest to the line, and their distances from the start.
    # 2. From the first force on, over the reach, sum the resultant T, and the moment M about the reach's end X.
    # 3. Take the pressure p from the next reach.
    # 4. A line force P at the edge and p from there on have T = P + p s and M = P s + p s^2 / 2, with s from the edge
    #    to X. This gives T s - p s^2 / 2 = M, so that s = 2 M / (T + sqrt(T^2 - 2 p M)).
    # Departure from the usual choices: the last active point, or the place where the gap opens, is accurate to a cell
    # only.
    domain, other = case.surface.domain, 1 - axis
    rows = touch.points[:, other]
    nearest = rows[np.argmin(np.abs(rows - start[other]))]
    chosen = np.flatnonzero(np.abs(rows - nearest) <= 1e-9 * domain.size[other])
    chosen = chosen[np.argsort(touch.points[chosen, axis])]
    distance = _distances(case, start, axis)
    at, length = distance(touch.points[chosen, axis]), touch.lengths[chosen, axis]
    force = np.linalg.norm(touch.forces[chosen], axis=-1) / touch.lengths[chosen, other]  # on a strip 1 m wide
    ends = distance(np.array([domain.lower[axis]])) + np.cumsum(length)
    if not forward:
        at, force, ends = -at[::-1], force[::-1], -(ends - length)[::-1]
    kept = at >= 0
    at, force, ends = at[kept], force[kept], ends[kept]
    pressed = np.flatnonzero(force > 0)
    if not len(pressed):
        raise ValueError("nothing touches an obstacle along the line")
    begin = pressed[0]
    stop = min(int(np.searchsorted(ends, at[begin] + touch.reach[axis])), len(ends) - 1)
    beyond = min(int(np.searchsorted(ends, ends[stop] + touch.reach[axis])), len(ends) - 1)
    near = slice(begin, stop + 1)
    total, moment = float(force[near].sum()), float(force[near] @ (ends[stop] - at[near]))
    pressure = float(force[stop + 1 : beyond + 1].sum()) / (ends[beyond] - ends[stop]) if beyond > stop else 0.0
    root = np.sqrt(max(total**2 - 2 * pressure * moment, 0.0))
    return float(ends[stop] - 2 * moment / (total + root))


def line_length(case: Any, start: tuple[float, float], axis: int, forward: bool) -> float:
    """Return the length of a coordinate line from a point to the end of the domain, m."""
    domain = case.surface.domain
    end = (domain.upper if forward else domain.lower)[axis]
    return abs(float(_distances(case, start, axis)(np.array([end]))[0]))


def _distances(case: Any, start: tuple[float, float], axis: int) -> Callable[[Array], Array]:
    """Return the signed distance along a coordinate line from a point, m, as a function of the coordinate (n,)."""
    domain = case.surface.domain
    ends = np.linspace(domain.lower[axis], domain.upper[axis], LINE + 1)
    x, w = np.polynomial.legendre.leggauss(2)
    half = np.diff(ends)[:, None] / 2
    points = np.zeros((LINE * 2, 2)) + np.asarray(start)
    points[:, axis] = (ends[:-1, None] + half * (x + 1)).ravel()
    order = (1, 0) if axis == 0 else (0, 1)
    speed = np.linalg.norm(case.surface.derivatives(points, order=1)[order], axis=-1).reshape(LINE, 2)
    along = np.concatenate([[0.0], np.cumsum(np.sum(half * w * speed, axis=1))])
    origin = np.interp(start[axis], ends, along)
    return lambda coordinate: np.asarray(np.interp(coordinate, ends, along) - origin)
