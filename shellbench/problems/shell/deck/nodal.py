"""Supports and loads on the nodes of a mesh.

Supports hold displacements and rotations of nodes along x, y and z. A clamp holds the rotation about the edge's
tangent, and all three where that is along no axis and the edge can't move. A hard support keeps the normals of a shell
with shear from turning along the edge: it holds the rotation about the direction across the edge. A plane of symmetry
holds the rotations about the axes in it.

Loads are consistent with the shape functions of the displacement, by Gauss's rule on the true midsurface and its true
edges: a node gets the work of the load at its shape function. They put no moments on nodes but those of the question.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.grid import Grid
from shellbench.problems.shell.posed.rigid import middle_and_size, rigid_modes
from shellbench.problems.shell.quantities.measure import load_density
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Support
from shellbench.problems.shell.question.directions import held_directions, in_space, local_directions
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.places import Edge, Place, Point

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

SAMPLES = 33  # points of an edge at which its directions are looked at
STRAIGHT = 1e-9  # sine of an angle that is rounding
CONTRADICTION = 1e-9  # of the shell's size: how far two supports may move one node apart
GAUSS_POINTS = 4  # along a side of a cell


def _constant_axis(vectors: Array) -> int | None:
    """Return the Cartesian direction (0, 1, 2) that all vectors (n, 3) are along; None if there is none."""
    sizes = np.abs(vectors) / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return next((a for a in range(3) if np.delete(sizes, a, axis=-1).max() < STRAIGHT), None)


def _others(axis: int) -> set[int]:
    return {0, 1, 2} - {axis}


def held_components(case: Case, support: Support, place: Place) -> tuple[int, ...] | None:
    """Return the displacements (0, 1, 2) and rotations (3, 4, 5) that a support holds at a place.

    None if no single components along x, y and z do.
    """
    points = _samples(case, place)
    directions = held_directions(case.surface, support, place, points)
    axes = [_constant_axis(directions[:, k]) for k in range(directions.shape[1])]
    if any(axis is None for axis in axes):
        return None
    moved = {axis for axis in axes if axis is not None}
    if support.symmetry is not None:
        return tuple(sorted(moved | {3 + a for a in _others("xyz".index(support.symmetry))}))
    if not isinstance(place, Edge):
        return tuple(sorted(moved))
    frame = local_directions(case.surface, points, place)
    turned: set[int] = set()
    tangent, across, normal = (_constant_axis(frame[:, k]) for k in range(3))
    still = np.linalg.norm(np.delete(frame[:, 2], sorted(moved), axis=-1), axis=-1).max(initial=0.0) < STRAIGHT
    hard = case.theory == "naghdi-linear" and support.shear != "soft" and still
    if support.clamped and hard and normal is not None:
        turned = _others(normal)
    else:
        for asked, axis in ((support.clamped, tangent), (hard, across)):
            if asked and axis is not None:
                turned.add(axis)
            elif asked and support.clamped and len(moved) == 3:
                turned = {0, 1, 2}
            elif asked and normal is not None and still:
                turned |= _others(normal)
            elif asked:
                return None
    return tuple(sorted(moved | {3 + axis for axis in turned}))


def _samples(case: Case, place: Place) -> Array:
    if isinstance(place, Edge):
        return place.samples(case.surface.domain, SAMPLES)
    return np.array([place.xi]) if isinstance(place, Point) else case.surface.domain.grid(9, 9).reshape(-1, 2)


def why_not_held(case: Case) -> str | None:
    """Return the reason that supports hold no single components of nodes along x, y and z; None if they do."""
    for support, place in case.supported_places():
        if held_components(case, support, place) is None:
            return f"support '{support.name}' holds '{place.name}' in directions that are not along x, y or z"
        if support.holds_slope and support.motion is not None and support.motion.kind != "translation":
            return f"the clamped edge '{place.name}' turns"
    return None


def held(case: Case, grid: Grid) -> Mask:
    """Return the displacements and rotations (v, 6) of nodes that supports prescribe.

    Raises
    ------
    InputError
        If a point that is held lies on no node.
    """
    mask = np.zeros((len(grid.nodes), 6), dtype=bool)
    for support, place in case.supported_places():
        for component in held_components(case, support, place) or ():
            mask[grid.nodes_of(place), component] = True
    return mask


def prescribed(case: Case, grid: Grid, t: float) -> Array:
    """Return the displacements (v, 6) that supports prescribe at a load factor; zero where none does.

    Raises
    ------
    InputError
        If two supports move a node that they share to different places.
    """
    result, told = np.zeros((len(grid.nodes), 6)), np.zeros((len(grid.nodes), 6), dtype=bool)
    size = float(np.ptp(case.surface.position(grid.nodes), axis=0).max())
    for support, place in case.supported_places():
        nodes = grid.nodes_of(place)
        moved = np.zeros((len(nodes), 3))
        if support.motion is not None:
            moved = case.motion(support, place, grid.nodes[nodes], t)[0, 0]
        for component in (c for c in held_components(case, support, place) or () if c < 3):
            gap = np.abs(result[nodes, component] - moved[:, component])[told[nodes, component]]
            if gap.max(initial=0.0) > CONTRADICTION * size:
                raise InputError(f"{case.name}: two supports move a node on '{place.name}' to different places")
            result[nodes, component], told[nodes, component] = moved[:, component], True
    return result


def areas(case: Case, grid: Grid) -> Array:
    """Return the area of each node (v,), m^2: the integral of its shape function."""
    return _spread(grid, lambda points: _stretch(case, points)[:, None])[:, 0]


def _stretch(case: Case, points: Array) -> Array:
    x = case.surface.derivatives(points, order=1)
    return np.asarray(np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1))


def _spread(grid: Grid, density: Callable[[Array], Array]) -> Array:
    """Return the nodes' shares (v, k) in densities (e, k) per d xi1 d xi2, a function of points (e, 2)."""
    total = None
    for points, weights, shares in grid.mesh.rule(GAUSS_POINTS):
        parts = weights[:, None, None] * shares[None, :, None] * density(points)[:, None]
        total = np.zeros((len(grid.nodes), parts.shape[-1])) if total is None else total
        np.add.at(total, grid.cells, parts)
    assert total is not None
    return total


def forces(case: Case, grid: Grid, t: float) -> Array:
    """Return forces and moments (v, 6) of all loads at a load factor, N and N m."""
    total = np.zeros((len(grid.nodes), 6))
    total[:, :3] = _spread(grid, lambda points: load_density(case, points, t) * _stretch(case, points)[:, None])
    for load in case.loads:
        for name in load.on if isinstance(load, EdgeLoad | MomentLoad | PointLoad) else ():
            place = case.places[name]
            if isinstance(load, PointLoad) and isinstance(place, Point):
                total[grid.nodes_of(place), :3] += case.evaluate(load.force, np.asarray(place.xi), t)[0, 0]
            elif isinstance(load, EdgeLoad | MomentLoad) and isinstance(place, Edge):
                _add_edge(case, grid, place, load, t, total[:, :3] if isinstance(load, EdgeLoad) else total[:, 3:])
    return total


def _add_edge(case: Case, grid: Grid, edge: Edge, load: EdgeLoad | MomentLoad, t: float, total: Array) -> None:
    """Add the shares (v, 3) of nodes in a load on an edge."""
    running, order = 1 - edge.axis, grid.order
    x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    local = (x + 1) / 2
    count, step = grid.counts[running], grid.steps[running]
    at = grid.lower[running] + (np.arange(count)[:, None] + local).ravel() * step
    points = edge.points(case.surface.domain, at)
    tangent = case.surface.derivatives(points, order=1)[(0, 1) if running == 1 else (1, 0)]
    lengths = np.linalg.norm(tangent, axis=-1) * np.tile(w / 2 * step, count)
    if isinstance(load, EdgeLoad):
        density = case.evaluate(load.vector, points, t)[0, 0]
        density = density if load.frame == "global" else in_space(case.surface, density, points, edge)
    else:
        axis = np.asarray(load.axis) / np.linalg.norm(load.axis)
        density = case.formula(load.value).derivatives(points, 0, t)[0, 0][:, None] * axis
    parts = (lengths[:, None] * density).reshape(count, GAUSS_POINTS, 3)
    nodes = grid.edge(edge.axis, edge.side == "max")
    shares = (
        [1 - local, local]
        if order == 1
        else [(1 - local) * (1 - 2 * local), 4 * local * (1 - local), local * (2 * local - 1)]
    )
    for k, share in enumerate(shares):
        np.add.at(total, nodes[k : k + order * (count - 1) + 1 : order], np.einsum("q,nqc->nc", share, parts))


def loose(case: Case, grid: Grid, mask: Mask) -> tuple[Array, Integers]:
    """Return the rigid motions (v, 6, k) that nothing holds, and the components 6 v + c to pin, which resist them best.

    Pins are chosen one after the other: each resists best what those before it leave free.
    """
    names = case.remove_rigid_motions
    xi = grid.nodes
    modes = rigid_modes(case.surface, xi)[0, 0]
    motions = np.zeros((len(xi), 6, len(names)))
    for k, name in enumerate(names):
        number = RIGID_MOTIONS.index(name)
        motions[:, :3, k] = modes[..., number]
        if number >= 3:
            motions[:, number, k] = 1 / middle_and_size(case.surface)[1]
    rows = np.where(mask[:, :3, None], 0.0, motions[:, :3]).reshape(3 * len(xi), len(names))
    rows = rows / np.maximum(np.abs(rows).max(axis=0, initial=0.0), np.finfo(float).tiny)
    pins = []
    for _ in names:
        best = int(np.argmax(np.sum(rows**2, axis=-1)))
        unit = rows[best] / np.linalg.norm(rows[best])
        rows = rows - np.outer(rows @ unit, unit)
        pins.append(6 * (best // 3) + best % 3)
    return motions, np.array(pins, dtype=np.int64)
