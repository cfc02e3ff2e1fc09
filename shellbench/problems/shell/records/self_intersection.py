"""Self-intersection of a deformed surface: a measure of an answer, no mechanics.

The surface is sampled at a grid of material points, whose cells are nearly square and are cut into two triangles each.
The result is limited to these triangles:

- Crossings between triangles that share a point are not looked for: folds narrower than two cells are missed.
- The triangles differ from the surface by its sag, about the square of a cell times the curvature over 8. Sheets
  closer to each other than both their sags may be taken for crossing, or their crossing be missed.
- Sheets that only touch do not count as crossing, nor edges that reach through by less than `SHALLOW` of the surface's
  size.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.question.surface import Domain
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.problems.shell.records.sampling import GOLDEN, state_at
from shellbench.problems.shell.records.series import frames
from shellbench.protocol.history import SelfIntersection

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

POINTS = 10_000  # of the grid, about: twice as fine along each coordinate as pictures are
UNEVEN = 0.4  # of a cell, over which lines of the grid are strewn
FEWEST = 13  # points along a coordinate, however narrow the surface is
MOST_PAIRS = 40_000_000  # of near triangles, both orders counted: a gigabyte of numbers
SHALLOW = 1e-6  # of the size of the surface, by which an edge must reach through: solvers' errors are about as large
EDGEWISE = 1e-6  # sine of the angle at which a triangle is seen by its edge
TRIANGLE_EDGES = ((0, 1), (1, 2), (2, 0))


def self_intersection_study(solution: DisplacementField, case: Case) -> tuple[SelfIntersection, ...]:
    """Look at the kept states in order until the surface passes through itself.

    Linear cases, whose displacement is infinitesimal, and states that were not reached give no result. If triangles
    can't be compared, the words state this: an empty result would mean that the surface never intersects itself.
    """
    if case.linear or case.modal:
        return ()
    domain = case.surface.domain
    xi = uneven_grid(domain, grid_size(case))
    at_rest = case.surface.position(xi)
    triangles = triangulated(domain, xi.shape[:2])
    found = SelfIntersection(points=xi.shape[:2], states=0)
    for mark in frames(solution, case):
        displacement = state_at(solution, xi, mark)
        if displacement is None:
            continue
        shape = at_rest + displacement
        found = found.model_copy(update={"states": found.states + 1, "sag": max(found.sag, sag(shape, xi, domain))})
        try:
            simple = not any(domain.periodic) and lies_over_a_plane(shape)
            pairs = np.zeros((0, 2), dtype=np.intp) if simple else crossings(shape.reshape(-1, 3), triangles)
        except ValueError as error:
            told = (
                f"whether it passes through itself is not known from {ShellPortrait(case).mark_words(mark)} on: {error}"
            )
            return (found.model_copy(update={"words": told}),)
        if len(pairs):
            places = tuple(tuple(xi.reshape(-1, 2)[triangles[k, 0]].tolist()) for k in pairs[0])
            found = found.model_copy(update={"at": mark, "places": places})
            return (found.model_copy(update={"words": intersection_in_words(found, ShellPortrait(case).mark_words)}),)
        found = found.model_copy(update={"free_until": mark})
    return (found,) if found.states else ()


def intersection_in_words(found: SelfIntersection, mark_words: Callable[[float], str]) -> str:
    """Return as a clause when and where a surface passes through itself, and the grid of the check."""
    if found.at is None:
        return ""
    before = "" if found.free_until is None else f", not yet at {mark_words(found.free_until)}"
    places = " and ".join(f"({xi1:.3g}, {xi2:.3g})" for xi1, xi2 in found.places)
    first, second = found.points
    return (
        f"the surface passes through itself at {mark_words(found.at)}{before}, first where {places} meet;"
        f" seen by triangles on {first} x {second} points, which lie within about {found.sag:.1g} m of it"
    )


def grid_size(case: Case) -> tuple[int, int]:
    """Return the number of grid points along each coordinate: about `POINTS` in all, cells nearly square at rest."""
    shape = case.surface.position(case.surface.domain.grid(FEWEST, FEWEST))
    across = [float(np.linalg.norm(np.diff(shape, axis=axis), axis=-1).sum(axis=axis).mean()) for axis in (0, 1)]
    first = math.sqrt(POINTS * across[0] / across[1])
    return max(FEWEST, round(first)), max(FEWEST, round(POINTS / first))


def uneven_grid(domain: Domain, size: tuple[int, int]) -> Array:
    """Return (n1, n2, 2) points that include all bounds, on lines at uneven distances.

    Two sheets of a symmetric shape may cross along lines of an even grid: there corner meets corner, and no edge passes
    through a triangle.
    """
    lines = []
    for low, high, count in zip(domain.lower, domain.upper, size, strict=True):
        number = np.arange(count, dtype=float)
        number[1:-1] += UNEVEN * (GOLDEN * number[1:-1] % 1.0 - 0.5)
        lines.append(low + (high - low) / (count - 1) * number)
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)


def triangulated(domain: Domain, size: tuple[int, int]) -> Indices:
    """Return the triangles (m, 3) of a regular grid; points at both ends of a periodic coordinate are one."""
    number = np.arange(size[0] * size[1]).reshape(size)
    if domain.periodic[0]:
        number[-1] = number[0]
    if domain.periodic[1]:
        number[:, -1] = number[:, 0]
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])


def sag(shape: Array, xi: Array, domain: Domain) -> float:
    """Return the approximate distance, m, of triangles of a shape (n1, n2, 3) at points (n1, n2, 2) from the surface.

    A chord over h leaves a line of the grid, of second derivative x'', by |x''| h^2 / 8.
    """
    largest = 0.0
    for axis in (0, 1):
        x, s = np.moveaxis(shape, axis, 0), np.moveaxis(xi[..., axis], axis, 0)[:, 0]
        if domain.periodic[axis]:
            x, s = np.concatenate([x, x[1:2]]), np.append(s, s[-1] + s[1] - s[0])
        steps = np.diff(s)[:, None, None]
        second = 2 * np.diff(np.diff(x, axis=0) / steps, axis=0) / (steps[1:] + steps[:-1])
        sags = np.linalg.norm(second, axis=-1) * np.maximum(steps[1:], steps[:-1])[..., 0] ** 2 / 8
        largest = max(largest, float(sags.max()))
    return largest


def lies_over_a_plane(shape: Array) -> bool:
    """Return True if the triangles of a shape (n1, n2, 3) lie side by side as seen from some direction.

    Then none of them crosses another. False is no proof of the contrary.
    """
    # 1. Look along the mean normal. All triangles must turn the same side to the viewer, and none its edge.
    # 2. The border, as seen from there, must be one closed line that does not meet itself.
    # A map of a disc that keeps the orientation of all triangles covers a point as often as its border winds around it:
    # once or not at all. This test costs the time of the border alone, and most shells are bent by less than half a
    # turn.
    a, b, c, d = shape[:-1, :-1], shape[1:, :-1], shape[1:, 1:], shape[:-1, 1:]
    areas = np.concatenate([np.cross(b - a, c - a).reshape(-1, 3), np.cross(c - a, d - a).reshape(-1, 3)])
    mean = areas.sum(axis=0)
    if not np.linalg.norm(mean) > 0 or not np.all(
        areas @ mean > EDGEWISE * np.linalg.norm(areas, axis=1) * np.linalg.norm(mean)
    ):
        return False
    border = np.concatenate([shape[:-1, 0], shape[-1, :-1], shape[:0:-1, -1], shape[0, :0:-1]])
    first, second = np.linalg.svd(mean[None])[2][1:]
    return _is_simple(np.stack([border @ first, border @ second], axis=-1))


def _is_simple(corners: Array) -> bool:
    """Return True if the sides of a closed polygon (n, 2) meet at their common corners only."""

    def side(start: Array, end: Array, place: Array) -> NDArray[np.bool_]:
        one, other = end - start, place - start
        return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0] >= 0)

    start, end = corners, np.roll(corners, -1, axis=0)
    across = side(start[:, None], end[:, None], start) != side(start[:, None], end[:, None], end)  # by side, by side
    number = np.arange(len(corners))
    far = (number[:, None] - number) % len(corners)
    apart = (far > 1) & (far < len(corners) - 1)
    return not np.any(across & across.T & apart)


def crossings(points: Array, triangles: Indices) -> Indices:
    """Return the pairs (k, 2) of triangles that cross each other and share no point, in the order of the triangles.

    Parameters
    ----------
    points
        (n, 3) where points are, m.
    triangles
        (m, 3) numbers of their corners.

    Raises
    ------
    ValueError
        If the largest of the triangles is so large that most of them are near each other.
    """
    # 1. Pairs of triangles whose centroids are no farther apart than two of the largest ones may reach.
    # 2. Of these, pairs that share no corner and whose boxes overlap.
    # 3. Of these, pairs each of which has corners on both sides of the other's plane.
    # 4. Two such triangles cross if, and only if, an edge of one passes through the other.
    corners = points[triangles]
    size = float(np.ptp(points[triangles.ravel()], axis=0).max())
    pairs = _without_common_corner(triangles, _pairs_nearby(corners))
    for low, high in zip(*(extreme.T for extreme in _extremes(corners)), strict=True):
        one, other = pairs.T
        pairs = pairs[(low[one] <= high[other]) & (low[other] <= high[one])]  # each leaves fewer to the next component
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)  # none of a flat triangle
    heights = [_heights(corners, normals, pairs[:, order]) for order in ((0, 1), (1, 0))]
    (low1, high1), (low2, high2) = map(_extremes, heights)
    straddles = (low1 < 0) & (high1 > 0) & (low2 < 0) & (high2 > 0)
    pairs, heights = pairs[straddles], [h[straddles] for h in heights]
    crossed = np.zeros(len(pairs), dtype=bool)
    for order, above in zip(((0, 1), (1, 0)), heights, strict=True):
        crossed |= _edge_pierces(corners, pairs[:, order], above, SHALLOW * size)
    found = pairs[crossed]
    return np.asarray(found[np.lexsort(found.T[::-1])])


def _extremes(values: Array) -> tuple[Array, Array]:
    """Return the least and the largest (k, ...) of three values (k, 3, ...); NumPy's own takes ten times as long."""
    a, b, c = values[:, 0], values[:, 1], values[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _without_common_corner(triangles: Indices, pairs: Indices) -> Indices:
    """Return those of the pairs (k, 2) that share no corner."""
    corners = np.ascontiguousarray(triangles.T)
    ones, others = ([corner[number] for corner in corners] for number in map(np.ascontiguousarray, pairs.T))
    apart = np.ones(len(pairs), dtype=bool)
    for one in ones:
        for other in others:
            apart &= one != other
    return pairs[apart]


def _pairs_nearby(corners: Array) -> Indices:
    """Return pairs (k, 2), the smaller number first, of triangles (m, 3, 3) that may meet."""
    from scipy.spatial import cKDTree

    centroids = corners.mean(axis=1)
    reach = max(2 * float(np.linalg.norm(corners - centroids[:, None], axis=-1).max()), float(np.finfo(float).tiny))
    tree = cKDTree(centroids)
    # No more are near than there are in cubes of that side times their 27 neighbours: mostly that need not be counted.
    cubes = np.floor((centroids - centroids.min(axis=0)) / reach).astype(np.int64)
    _, crowd = np.unique(np.ravel_multi_index(cubes.T, tuple(cubes.max(axis=0) + 1)), return_counts=True)
    if 27 * len(centroids) * crowd.max() > MOST_PAIRS and tree.count_neighbors(tree, reach) > MOST_PAIRS:
        raise ValueError("the surface is stretched so unevenly that its triangles can't be compared")
    return np.asarray(tree.query_pairs(reach, output_type="ndarray"), dtype=np.intp)


def _heights(corners: Array, normals: Array, pairs: Indices) -> Array:
    """Return the heights (k, 3) of the second triangle's corners above the first one's plane, m."""
    first, second = pairs.T
    return np.asarray(np.einsum("kcj,kj->kc", corners[second] - corners[first][:, :1], normals[first]))


def _edge_pierces(corners: Array, pairs: Indices, heights: Array, shallow: float) -> NDArray[np.bool_]:
    """Return of which pairs (k,) an edge of the second triangle passes through the first one."""
    through = np.zeros(len(pairs), dtype=bool)
    target, source = corners[pairs[:, 0]], corners[pairs[:, 1]]
    for start, end in TRIANGLE_EDGES:
        above, below = heights[:, start], heights[:, end]
        deep = (above * below < 0) & (np.minimum(abs(above), abs(below)) > shallow)
        share = above / np.where(deep, above - below, 1.0)
        place = source[:, start] + share[:, None] * (source[:, end] - source[:, start])
        through |= deep & _inside_triangle(target, place)
    return through


def _inside_triangle(triangles: Array, places: Array) -> NDArray[np.bool_]:
    """Return a mask (k,): True if a place (k, 3) in the plane of its triangle (k, 3, 3) lies in it or on its border."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    turns = np.cross(edges, places[:, None] - triangles)
    same = np.einsum("kcj,kdj->kcd", turns, turns)
    return np.asarray(np.all(same >= 0, axis=(1, 2)))
