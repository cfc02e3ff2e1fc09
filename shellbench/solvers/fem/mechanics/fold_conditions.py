"""Conditions at the folds of a surface, between the slopes on both sides of a line.

A node on a fold carries the mean of the slopes u,k across the line and their jump e: u,k is the mean plus or minus e/2
on the upper or lower side. A rigid fold keeps the rotation about its line, omega = u,n . a3, where n is the conormal
toward larger xi_k on both sides. On coordinate lines that meet at right angles

    omega = u,k . w,    w = N |a_t| / |N|^2,    N = a1 x a2,

so that w+ . (u,k + e/2) = w- . (u,k - e/2), and its derivative along the line, are two conditions of each node. Between
nodes they hold exactly where w is constant along the line, as in prisms; elsewhere the gap falls with the fourth power
of the cells. Hinges state nothing: a moment that nothing balances is zero.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.question.folds import ASIDE, Fold
from shellbench.problems.shell.question.places import Edge, Place, Point
from shellbench.solvers.fem.mechanics.sharing import Conditions, support_nodes
from shellbench.solvers.fem.mesh.basis import CUBIC, JUMP, SAME, Derivative
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

NOBODY = -1  # number of the support that states a fold's conditions
SAMPLES = 17  # points along a fold at which coordinate lines are compared


def sides(mesh: TensorMesh, place: Place) -> Iterator[tuple[Array, int]]:
    """Yield the points (n, 2) of a place's nodes and 0; where folds cross it, those of both sides and -1 and 1."""
    points = mesh.node_points[support_nodes(mesh, place)]
    crossed = mesh.basis.folded
    if crossed is None or isinstance(place, Point) or (isinstance(place, Edge) and place.axis == crossed):
        yield points, 0
        return
    on_fold = mesh.folded_nodes[support_nodes(mesh, place)]
    for side in (-1, 1):
        moved = points.copy()
        moved[on_fold, crossed] += side * 2 * ASIDE * mesh.domain.size[crossed]
        yield moved, side


def with_jumps(mesh: TensorMesh, nodes: Integers, rows: Array, side: int) -> Array:
    """Return rows (n, r, dofs) on slopes as rows on the slopes of one side, -1 or 1; 0 leaves them as they are."""
    result = rows.reshape(*rows.shape[:2], len(COMPONENTS), -1).copy()
    share = side / 2 * mesh.folded_nodes[nodes, None, None]
    for number, kind in enumerate(mesh.kinds):
        if JUMP in kind:
            slope = mesh.kinds.index((abs(kind[0]), abs(kind[1])))
            result[..., number] += share * result[..., slope]
    return result.reshape(rows.shape)


def why_not_at_folds(case: Case) -> str | None:
    """Return the reason that conditions at a fold can't be stated at nodes, as one clause, or None."""
    surface = case.surface
    if not surface.fold_lines:
        return None
    if not case.linear or case.dynamics is not None or case.obstacles:
        return "its surface has folds, which fem takes in linear theory at rest, without contact"
    if case.modal and case.loads:  # what the moment at a fold adds to the geometric stiffness is not known here
        return "its surface has folds, and fem finds frequencies of these only without loads, and no buckling loads"
    if any(support.local for support in case.supports):
        return "its surface has folds, and a support holds directions local to the shell, which turn there"
    if any(isinstance(place, Edge) and not place.whole for _, place in case.supported_places()):
        return "its surface has folds, and a support holds a part of an edge"
    for fold in surface.fold_lines:
        low, up = surface.domain.lower[1 - fold.axis], surface.domain.upper[1 - fold.axis]
        for x in _both_sides(case, fold, np.linspace(low, up, SAMPLES)):
            lengths = np.linalg.norm(x[1, 0], axis=-1) * np.linalg.norm(x[0, 1], axis=-1)
            if np.abs(np.sum(x[1, 0] * x[0, 1], axis=-1) / lengths).max() > SAME:
                return "its coordinate lines meet a fold obliquely, and fem takes right angles there only"
    return None


def fold_conditions(case: Case, mesh: TensorMesh, states: int) -> Iterator[Conditions]:
    """Yield the conditions of each rigid fold."""
    # 1. w on both sides, and its derivative along the fold, at the nodes.
    # 2. Two rows on the vertex's slopes: the gap of the rotation, and its derivative.
    # 3. One row on each bubble along the fold, with w in the middle of the cell.
    for fold in mesh.folds:
        if fold.hinged:
            continue
        nodes = np.take(np.arange(mesh.node_count).reshape(mesh.shape), mesh.fold_column(fold), axis=fold.axis)
        line = mesh.lines[1 - fold.axis]
        middles = (line[:-1] + line[1:]) / 2
        rows = np.zeros((len(nodes), 2 + mesh.degree - CUBIC, len(COMPONENTS), len(mesh.kinds)))

        def kind(across: int, along: int, axis: int = fold.axis) -> int:
            return mesh.kinds.index((across, along) if axis == 0 else (along, across))

        lower, upper = (_weights(fold, x) for x in _both_sides(case, fold, line[: len(nodes)]))
        for row, terms in ((0, {0: 0}), (1, {1: 0, 0: 1})):
            for along, order in terms.items():
                rows[:, row, :, kind(1, along)] = upper[order] - lower[order]
                rows[:, row, :, kind(JUMP, along)] = (upper[order] + lower[order]) / 2
        lower, upper = (_weights(fold, x) for x in _both_sides(case, fold, middles))
        for bubble in range(2, mesh.degree - 1):
            rows[: len(middles), bubble, :, kind(1, bubble)] = upper[0] - lower[0]
            rows[: len(middles), bubble, :, kind(JUMP, bubble)] = (upper[0] + lower[0]) / 2
        flat = rows.reshape(*rows.shape[:2], -1) / np.tile(mesh.node_scales[nodes], len(COMPONENTS))[:, None]
        lengths = np.linalg.norm(flat, axis=-1, keepdims=True)
        flat = flat / np.where(lengths > 0, lengths, 1.0)  # no cell begins at the last node
        acting = np.zeros((len(nodes), flat.shape[-1]), dtype=bool)
        yield Conditions(NOBODY, nodes, flat, np.zeros((*flat.shape[:2], states)), acting, None)


def _both_sides(case: Case, fold: Fold, line: Array) -> Iterator[dict[Derivative, Array]]:
    """Yield derivatives of the surface at places along a fold, on its lower and on its upper side."""
    domain = case.surface.domain
    for side in (-1, 1):
        points = np.empty((len(line), 2))
        points[:, fold.axis] = fold.at + side * 2 * ASIDE * domain.size[fold.axis]
        points[:, 1 - fold.axis] = line
        yield case.surface.derivatives(domain.wrap(points), order=2)


def _weights(fold: Fold, x: dict[Derivative, Array]) -> tuple[Array, Array]:
    """Return w (n, 3) and its derivative along the fold."""
    along: Derivative = (0, 1) if fold.axis == 0 else (1, 0)
    first, second = ((1, 1), (0, 2)) if fold.axis == 0 else ((2, 0), (1, 1))  # of a1 and a2 along the fold
    normal = np.cross(x[1, 0], x[0, 1])
    turning = np.cross(x[first], x[0, 1]) + np.cross(x[1, 0], x[second])
    tangent, bent = x[along], x[2 * along[0], 2 * along[1]]
    square, speed = np.sum(normal**2, axis=-1, keepdims=True), np.linalg.norm(tangent, axis=-1, keepdims=True)
    w = normal * speed / square
    rate = np.sum(tangent * bent, axis=-1, keepdims=True) / speed**2
    rate = rate - 2 * np.sum(normal * turning, axis=-1, keepdims=True) / square
    return w, turning * speed / square + rate * w
