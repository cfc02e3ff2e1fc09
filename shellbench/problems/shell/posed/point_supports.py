"""Supports that hold single points, and the directions that they hold in the limit of fine meshes.

A point that is held along the midsurface yields without bound as the cells around it shrink, as under a force. The
support holds nothing in the limit, and its force goes to zero like one over the logarithm of the cell. This does no
harm if the support only prevents a rigid motion of a shell whose loads are in balance without it. With shear
deformation the same is true of a point held along the normal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.posed.rigid import free_of, held_rows, middle_and_size, rigid_modes
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.posed.spots import NO_PART, SLACK, Spot, held_at, orthonormal, spot_at
from shellbench.problems.shell.quantities.measure import rule_of, spread_forces, unit
from shellbench.problems.shell.quantities.modes import Frequency
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.quantities.resultant_quantities import along_edge
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Support
from shellbench.problems.shell.question.directions import in_space, local_directions
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.places import Edge, Point

Array = NDArray[np.float64]

LEANING = math.sqrt(0.5)  # largest part along the midsurface of a direction that counts as the normal: 45 degrees
NEEDED = 1e-3  # of all loads: a support that bears less yields by less than a hundredth of the loads' displacement


@dataclass(frozen=True)
class Hold:
    """Components of one point that supports hold beyond those held on edges through it.

    Attributes
    ----------
    supports
        Those that hold the point.
    rows
        Orthonormal directions (k, 3): the one that is nearest to the normal first.
    lean
        Sine of the angle between that and the normal.
    """

    spot: Spot
    supports: tuple[Support, ...]
    rows: Array
    lean: float

    @property
    def firm(self) -> int:
        """The number of rows that hold the point: the first one, unless it is nearer to the midsurface."""
        return int(self.lean <= LEANING and not self.spot.shears)


def _holds(case: Shell) -> Iterator[Hold]:
    points: dict[tuple[float, ...], tuple[Point, list[Support]]] = {}
    for support, place in case.supported_places():
        if isinstance(place, Point):
            points.setdefault(tuple(case.surface.domain.wrap(place.xi)), (place, []))[1].append(support)
    for place, supports in points.values():
        spot, edges = spot_at(case, place), held_at(case, place, points=False)
        basis = orthonormal(spot.held - spot.held @ edges.T @ edges)
        if len(basis):
            nearest = basis @ spot.normal
            turned = np.linalg.qr(np.column_stack([nearest, np.eye(len(basis))]))[0].T  # begins with +- the nearest
            lean = math.sqrt(max(0.0, 1.0 - float(nearest @ nearest)))
            yield Hold(spot, tuple(supports), turned @ basis, lean)


def mark_of(case: Shell, quantity: ShellQuantity) -> float:
    """Return the load factor of a quantity; 1 for a mode, whose mark is its number."""
    return 1.0 if case.modal else quantity.at


def leaning_supports(case: Shell) -> Iterator[tuple[Support, Spot, float]]:
    """Yield the supports that hold points by directions that lean from the normal, the points, and sines of angles."""
    for hold in _holds(case):
        if hold.firm and hold.lean > NO_PART:
            yield from ((support, hold.spot, hold.lean) for support in hold.supports)


def check_point_supports(case: Shell) -> None:
    """Check that no point has to be held along the midsurface.

    A support that only prevents a rigid motion has no force, as long as the loads are in balance without it. A support
    that holds more has a force on every mesh, and none in the limit.
    """
    holds = list(_holds(case))
    soft = [hold for hold in holds if hold.firm < len(hold.rows)]
    if not soft:
        return
    removed = np.eye(6)[:, [RIGID_MOTIONS.index(name) for name in case.remove_rigid_motions]]
    firm = [*(rows for place, rows in held_rows(case) if not isinstance(place, Point)), removed.T]
    firm += [_motions(case, hold)[: hold.firm] for hold in holds]
    free = free_of(firm)
    rows = np.concatenate([_motions(case, hold)[hold.firm :] for hold in soft]) @ free
    along = "" if soft[0].spot.shears else " along its midsurface"
    names, places = (
        ", ".join(f"'{name}'" for name in dict.fromkeys(found))
        for found in ((s.name for hold in soft for s in hold.supports), (hold.spot.name for hold in soft))
    )
    begin = f"support {names} holds the shell{along} at single points ({places})"
    instead = "hold a part of an edge of a stated length instead"
    for t in {mark_of(case, quantity) for quantity in case.quantities}:
        work, loads = _work(case, t)
        if np.linalg.norm(free.T @ work) > NEEDED * loads:
            raise ValueError(
                f"{begin}, where the loads pull at it: it yields without bound as meshes are refined, so that nothing"
                f" has a limit; {instead}"
            )
    shaken = bool(case.obstacles) or any(isinstance(quantity, Frequency) for quantity in case.quantities)
    if (shaken or np.linalg.matrix_rank(rows, SLACK) < len(rows)) and not _is_idle_plate(case, soft):
        raise ValueError(
            f"{begin} against more than rigid motions: the force there goes to zero as meshes are refined, and nothing"
            f" is near its limit on any of them; {instead}, or nothing but rigid motions"
        )


def _motions(case: Shell, hold: Hold) -> Array:
    """Return the displacements of a point in the six rigid motions, along the directions in which it is held (k, 6)."""
    return np.asarray(hold.rows @ rigid_modes(case.surface, np.array([hold.spot.xi]))[0, 0][0])


def _is_idle_plate(case: Shell, soft: Iterable[Hold]) -> bool:
    """Return True if the shell is flat, and no load or motion of it is along its midsurface."""
    if any(hold.spot.shears and hold.lean <= LEANING for hold in soft):
        return False
    narrow = (feature.division.middles for feature in case.features if feature.of is case.surface)
    points = np.concatenate([case.area_rule[0], *narrow])
    normals = local_directions(case.surface, points)[:, 2]
    marks = {mark_of(case, quantity) for quantity in case.quantities}
    vectors = [force for t in marks for force, _, _ in _forces(case, t)]
    for support, place in case.supported_places():
        if support.motion is not None:
            vectors += [case.motion(support, place, points, t)[0, 0] for t in marks]
    along = [np.cross(vector, normals[0]) for vector in (normals, *vectors)]
    return all(
        np.abs(part).max() <= NO_PART * np.abs(vector).max()
        for part, vector in zip(along, (normals, *vectors), strict=True)
    )


def _forces(case: Shell, t: float) -> Iterator[tuple[Array, Array, bool]]:
    """Yield forces or moments (n, 3) at points (n, 2), N or N m, each with True for moments."""
    yield from ((forces, points, False) for forces, points in spread_forces(case, t))
    for load in case.loads:
        if isinstance(load, PointLoad):
            for place in map(case.places.__getitem__, load.on):
                assert isinstance(place, Point)
                yield case.evaluate(load.force, np.array([place.xi]), t)[0, 0], np.array([place.xi]), False
        elif isinstance(load, EdgeLoad | MomentLoad):
            for edge in map(case.places.__getitem__, load.on):
                assert isinstance(edge, Edge)
                points, lengths = rule_of(case, load, edge) or along_edge(case, edge)
                if isinstance(load, MomentLoad):
                    values = case.formula(load.value).derivatives(points, 0, t)[0, 0]
                    yield (values * lengths)[:, None] * unit(load.axis), points, True
                else:
                    given = case.evaluate(load.vector, points, t)[0, 0]
                    local = load.frame == "local"
                    force = in_space(case.surface, given, points, edge) if local else given
                    yield force * lengths[:, None], points, False


def _work(case: Shell, t: float) -> tuple[Array, float]:
    """Return the work (6,) of the loads on rigid motions, and the sum of their magnitudes, N."""
    work, total = np.zeros(6), 0.0
    _, size = middle_and_size(case.surface)
    for acting, points, moments in _forces(case, t):
        if moments:
            work[3:] += acting.sum(axis=0) / size
        else:
            work += np.einsum("pi,pik->k", acting, rigid_modes(case.surface, points)[0, 0])
        total += float(np.linalg.norm(acting, axis=1).sum()) / (size if moments else 1.0)
    return work, total
