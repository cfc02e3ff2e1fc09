"""Supports as linear ties between the degrees of freedom of one node, and the form u = T q + u0 that satisfies them.

On a held edge the value and the tangential derivative of the held components are prescribed at every node. The trace of
the bicubic element is the Hermite interpolant of both, so that a constant or linear motion is exact on the whole edge.
A clamped edge also prescribes, for the fixed coordinate k and the running coordinate t,

    c(u) = (a_tt u,k - a_kt u,t) . N  =  (a positive factor) u,n . a3,      N = a1 x a2,

and its derivative along the edge: u,n is the derivative along the conormal. The right-hand sides are c of the
prescribed motion, so that a support that turns carries its normal along. At finite strain N is the turned normal: on
an edge whose position is prescribed, the condition that the surface be normal to it is linear all the same. Across a
plane of symmetry the components in the plane have no derivative at all.

All conditions of all supports at a node are resolved together by a singular value decomposition: repeated conditions
count once, and contradictions are found (`ties`). A clamp has two more parts: `bubble_conditions` holds bubbles, and
`clamping` holds the rotation between nodes of edges on which the normal turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import COMPONENTS, LOCAL, Support
from shellbench.problems.shell.question.places import Edge, Place, Whole
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS
from shellbench.solvers.fem.mechanics.bubble_conditions import Motion, bubble_conditions, motion_at
from shellbench.solvers.fem.mechanics.fold_conditions import fold_conditions, sides, with_jumps
from shellbench.solvers.fem.mechanics.kinematics import Midsurface, local_axes
from shellbench.solvers.fem.mechanics.sharing import RANK_TOLERANCE, Conditions, support_nodes
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.basis import CUBIC, KINDS, ROUNDING, SAME, Derivative
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

MIRROR_SAMPLES = 17  # points of an edge at which coordinate lines are compared with a plane of symmetry


def support_ties(case: Case, mesh: TensorMesh, states: Sequence[float]) -> Ties:
    """Return the ties of all supports of a case at load factors.

    Raises
    ------
    InputError
        If a clamp can't be a condition at nodes, or supports contradict each other at a common node.
    """
    return Ties.from_conditions(case, mesh, list(support_conditions(case, mesh, states)), states)


def support_conditions(case: Case, mesh: TensorMesh, states: Sequence[float]) -> Iterator[Conditions]:
    """Yield the conditions of each support at each of its places.

    Raises
    ------
    InputError
        If a clamp can't be a condition at nodes.
    """
    # 1. State the held components at the nodes, with their derivative along an edge, on both sides of folds.
    # 2. Add rows of the slope, or of the mirror, and rows of bubbles on edges.
    # 3. Scale all rows to length one, and mark the degrees of freedom on which the support acts.
    # 4. Folds add conditions of their own.
    for number, support in enumerate(case.supports):
        for name in support.on:
            place = case.places[name]
            edge = place if isinstance(place, Edge) else None
            nodes = support_nodes(mesh, place)
            stated = [_on_side(case, mesh, support, place, states, points, side) for points, side in sides(mesh, place)]
            if edge is not None and mesh.degree > CUBIC:
                stated.append(bubble_conditions(case, mesh, support, edge, states))
            rows, values = (np.concatenate(parts, axis=1) for parts in zip(*stated, strict=True))
            # Rows have length one in scaled degrees of freedom; otherwise the rank of conditions from different
            # supports would depend on units.
            scales = np.tile(mesh.node_scales[nodes], len(COMPONENTS))
            rows = rows / scales[:, None]
            lengths = np.linalg.norm(rows, axis=-1, keepdims=True)
            rows, values = rows / lengths, values / lengths
            acting = np.any(np.abs(rows) > RANK_TOLERANCE, axis=1)
            if edge is not None and support.clamped:
                # Ties and the terms between nodes both hold a clamp. The latter act on all slopes across the edge.
                slopes = np.array([kind[edge.axis] == 1 for kind in mesh.kinds])
                acting[:, np.tile(slopes, len(COMPONENTS))] = True
            yield Conditions(number, nodes, rows, values, acting, edge)
    yield from fold_conditions(case, mesh, len(states))


def _on_side(
    case: Case, mesh: TensorMesh, support: Support, place: Place, states: Sequence[float], points: Array, side: int
) -> tuple[Array, Array]:
    """Return rows and values of a support's displacements and slopes at points of nodes; on one side, if at folds."""
    edge = place if isinstance(place, Edge) else None
    motion, carried = motion_at(case, support, place, mesh.domain, points, states), len(mesh.kinds)
    rows, values = (
        _direction_conditions(case, support, edge, mesh.domain.wrap(points), motion)
        if support.local
        else _component_conditions(support, place, motion, carried)
    )
    if edge is not None and support.holds_slope:
        x = case.surface.derivatives(mesh.domain.wrap(points), order=2)
        turn = case.turn(support, states[-1])  # at finite strain there is one state at a time
        if support.symmetry:
            slope = _mirror_condition(edge, x, support, carried)
        else:
            slope = _slope_conditions(edge, x, support, motion, turn, carried)
        slope = slope[0], np.broadcast_to(slope[1], (*slope[0].shape[:2], len(states)))
        rows = np.concatenate([rows, slope[0]], axis=1)
        values = np.concatenate([values, slope[1]], axis=1)
    return (with_jumps(mesh, support_nodes(mesh, place), rows, side) if mesh.folds else rows), values


def _dof(component: int, kind: Derivative, kinds: int) -> int:
    return component * kinds + KINDS.index(kind)


def _component_conditions(support: Support, place: Place, motion: Motion, carried: int) -> tuple[Array, Array]:
    """Prescribe the held components: on an edge with their tangential derivative, on the whole surface with all."""
    # A Lagrange element holds values only. The Hermite trace needs the slope along the edge too, or the edge bulges
    # between the nodes. The slopes across are left free: to hold them all would clamp, and stop membrane shear.
    kinds: list[Derivative] = [(0, 0)]
    if isinstance(place, Edge):
        kinds.append((1, 0) if place.axis == 1 else (0, 1))
    elif isinstance(place, Whole):
        kinds = list(KINDS)
    chosen = [(COMPONENTS.index(c), kind) for c in support.held for kind in kinds]
    count, _, states = motion[0, 0].shape
    rows = np.zeros((count, len(chosen), len(COMPONENTS) * carried))
    values = np.zeros((count, len(chosen), states))
    for row, (component, kind) in enumerate(chosen):
        rows[:, row, _dof(component, kind, carried)] = 1.0
        values[:, row] = motion[kind][:, component]
    return rows, values


def _direction_conditions(
    case: Case, support: Support, edge: Edge | None, points: Array, motion: Motion
) -> tuple[Array, Array]:
    """Prescribe u . d for directions d that may turn along an edge, with its derivative, u,t . d + u . d,t."""
    # Between the nodes u . d is a cubic times a varying direction. Its error is at most of the element's order.
    count, _, states = motion[0, 0].shape
    axes, turns = local_axes(case.surface.derivatives(points, order=2), edge)
    rows, values = [], []
    for number in (LOCAL.index(name) for name in support.held):
        # terms of u . d, and along an edge of its derivative: kind of derivative of u -> factor (n, 3)
        conditions: list[dict[Derivative, Array]] = [{(0, 0): axes[:, number]}]
        if edge is not None:
            running: Derivative = (0, 1) if edge.axis == 0 else (1, 0)
            conditions.append({(0, 0): turns[:, number], running: axes[:, number]})
        for terms in conditions:
            row, value = np.zeros((count, NODE_DOFS)), np.zeros((count, states))
            for kind, factor in terms.items():
                row[:, [_dof(c, kind, len(KINDS)) for c in range(len(COMPONENTS))]] = factor
                value += np.einsum("nc,ncs->ns", factor, motion[kind])
            rows.append(row)
            values.append(value)
    return np.stack(rows, axis=1), np.stack(values, axis=1)


def why_no_mirror(case: Case) -> str | None:
    """Return the reason that a mirror at an edge is no condition on these coordinates, as a clause, or None.

    A base vector has to point across the plane of symmetry; otherwise the conditions of the mirror would mix
    derivatives.
    """
    for support, place in case.supported_places():
        if support.symmetry is None or not isinstance(place, Edge):
            continue
        points = place.samples(case.surface.domain, MIRROR_SAMPLES)
        surface = Midsurface.from_position(case.surface.derivatives(case.surface.domain.wrap(points), order=2))
        across = COMPONENTS.index(support.held[0])
        base = surface.base / np.linalg.norm(surface.base, axis=-1, keepdims=True)
        # The edge lies in the plane, and the shell crosses it at right angles: only the coordinate lines are wrong.
        inside = np.abs([base[:, 1 - place.axis, across], surface.normal[:, across]]).max() <= SAME
        if inside and np.abs(np.delete(base[:, place.axis], across, axis=-1)).max() > SAME:
            return f"it mirrors shells at coordinate lines alone, and those at '{place.name}' are oblique"
    return None


def _mirror_condition(edge: Edge, x: Mapping[Derivative, Array], support: Support, carried: int) -> tuple[Array, Array]:
    """Make a field its own mirror image: components in the plane of symmetry have no derivative across it.

    This holds the slope, and is also the natural condition of the membrane shear. A part of a symmetric mesh therefore
    has exactly the solution of the whole.
    """
    fixed, running = ((1, 0), (0, 1)) if edge.axis == 0 else ((0, 1), (1, 0))
    across = COMPONENTS.index(support.held[0])
    tangents = [x[key] / np.linalg.norm(x[key], axis=-1, keepdims=True) for key in (fixed, running)]
    if np.abs(np.delete(tangents[0], across, axis=-1)).max() > SAME or np.abs(tangents[1][:, across]).max() > SAME:
        raise InputError(
            f"support '{support.name}': the shell does not cross the plane of symmetry along '{edge.name}' at right"
            " angles in its coordinates"
        )
    inside = [c for c in range(len(COMPONENTS)) if c != across]
    rows = np.zeros((len(x[0, 0]), 2 * len(inside), len(COMPONENTS) * carried))
    for row, (component, kind) in enumerate((c, kind) for c in inside for kind in (fixed, (1, 1))):
        rows[:, row, _dof(component, kind, carried)] = 1.0
    return rows, np.zeros(1)


def why_no_slope(case: Case) -> str | None:
    """Return the reason that a slope held at an edge can't be a condition at nodes, as a clause, or None."""
    for support, place in case.supported_places():
        if not isinstance(place, Edge) or support.symmetry or not support.holds_slope:
            continue
        points = place.samples(case.surface.domain, MIRROR_SAMPLES)
        x = case.surface.derivatives(case.surface.domain.wrap(points), order=2)
        if _needs_missing_derivative(place, x, support, np.cross(x[1, 0], x[0, 1])):
            return (
                f"on oblique lines, as at '{place.name}', it holds a slope only with the displacement along the normal"
            )
    return None


def _needs_missing_derivative(edge: Edge, x: Mapping[Derivative, Array], support: Support, normal: Array) -> bool:
    """Return True if the slope about an edge, at points of it, contains a derivative that is no degree of freedom.

    On oblique lines it contains u,tt . N. This is known only if the support prescribes the edge's displacement along N.
    """
    x_k, x_t = (x[(1, 0)], x[(0, 1)]) if edge.axis == 0 else (x[(0, 1)], x[(1, 0)])
    tt, kt = (np.sum(x_t * v, axis=-1, keepdims=True) for v in (x_t, x_k))
    oblique = np.abs(kt) > ROUNDING * np.sqrt(tt) * np.linalg.norm(x_k, axis=-1, keepdims=True)
    loose = [number for number, c in enumerate(COMPONENTS) if c not in support.held]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    if support.local:
        # A local support determines u,tt . N if it holds all components, or if its normal does not turn.
        straight = np.ptp(normal / length, axis=0).max() <= SAME
        known = len(support.held) == len(COMPONENTS) or (straight and "normal" in support.held)
        loose = [] if known else loose
    return bool(np.any(oblique & (np.abs(normal[:, loose]) > ROUNDING * length)))


def _slope_conditions(
    edge: Edge, x: Mapping[Derivative, Array], support: Support, motion: Motion, turn: Array, carried: int
) -> tuple[Array, Array]:
    """Prescribe the rotation about an edge, and its derivative along the edge; `turn` carries its normal along."""
    # 1. Compute the geometry on the edge, with the normal turned by the support.
    # 2. Form c(u), and its derivative along the edge, as factors of derivatives of u.
    # 3. Refuse if they need a derivative that is no degree of freedom.
    # 4. Fill the rows, with c of the prescribed motion as right-hand side.
    fixed, running = ((1, 0), (0, 1)) if edge.axis == 0 else ((0, 1), (1, 0))
    # c(u) and its derivative along the edge, by the product rule, in the degrees of freedom u,k u,t u,kt (and u,tt).
    # c'(u) = (a_tt u,k - a_kt u,t) . N' + (a_tt' u,k + a_tt u,kt - a_kt' u,t - a_kt u,tt) . N.
    twice = (2 * running[0], 2 * running[1])
    x_k, x_t, x_tt, x_kt = x[fixed], x[running], x[twice], x[1, 1]
    along = x_tt if edge.axis == 0 else x_kt  # derivative of a2 or of a1 along the edge
    normal = np.cross(x[1, 0], x[0, 1])
    turning = np.cross(x_kt if edge.axis == 0 else x_tt, x[0, 1]) + np.cross(x[1, 0], along)
    # At finite strain the support carries N along by its rotation.
    normal, turning = normal @ turn.T, turning @ turn.T
    tt, kt = (np.sum(x_t * v, axis=-1, keepdims=True) for v in (x_t, x_k))
    tt_t = 2 * np.sum(x_t * x_tt, axis=-1, keepdims=True)
    kt_t = np.sum(x_kt * x_t + x_k * x_tt, axis=-1, keepdims=True)
    functional = {
        0: {fixed: tt * normal, running: -kt * normal},
        1: {
            fixed: tt_t * normal + tt * turning,
            running: -kt_t * normal - kt * turning,
            (1, 1): tt * normal,
            twice: -kt * normal,
        },
    }
    if _needs_missing_derivative(edge, x, support, normal):
        raise InputError(
            f"support '{support.name}' holds the slope of '{edge.name}', where the coordinate lines are oblique,"
            " without holding the displacement along the normal: fem can't state that at its nodes"
        )
    count, _, states = motion[0, 0].shape
    rows, values = np.zeros((count, 2, len(COMPONENTS) * carried)), np.zeros((count, 2, states))
    for row, terms in functional.items():
        for kind, factor in terms.items():
            if kind in KINDS:
                for component in range(len(COMPONENTS)):
                    rows[:, row, _dof(component, kind, carried)] = factor[:, component]
                values[:, row] += np.einsum("nc,ncs->ns", factor, motion[kind])
            # the second derivative along the edge is the motion's own on both sides, and drops out
    return rows, values
