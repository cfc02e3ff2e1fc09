"""The step of `stepping`, chain by chain in plain loops, which numba compiles (extra `compiled`).

It is the direct solve without obstacles. Each chain takes these steps by itself, so that its numbers stay in the cache:

    1  directions and lengths of links, and which are taut
    2  rows of tensions or of impulses; one elimination along the links, links that would push let go, links that would
       be stretched are caught, until none is left
    3  half a velocity update, impulses, the position update root to tip, the other half, impulses

Chains are independent: each thread takes a block of them (`step_in_parallel`).

Departure from `pulls`: a violation is measured relative to the chain's own largest right side. Answers agree to
rounding. Without numba the functions run in Python, slowly; tests compare them so.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.rope.pulls import ROUNDS, SLACK

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Function = TypeVar("Function", bound=Callable[..., Any])

HERE = find_spec("numba") is not None
TAUT_ROUNDING = 1e-12  # relative to a link's length: a link that is shorter by no more is taut
TINY = 1e-300
MOST_ROUNDS = 100_000
ENOUGH = 2000  # links of a thread: their step takes some ten times as long as starting it
DIAGONAL, LOWER, UPPER, RIGHT = range(4)  # of a chain's rows, (4, m): see `pulls.Rows`


def jit(function: Function) -> Function:
    """Return the function, compiled at its first call if numba is installed."""
    if not HERE:
        return function
    import numba

    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


@jit
def _links(x: Array, root: Array, lengths: Array, room: float, e: Array, found: Array, taut: Mask) -> None:
    """Find directions e (m, 3) and lengths (m,) of one chain's links, and which are taut."""
    for i in range(len(lengths)):
        for k in range(3):
            e[i, k] = x[i, k] - (x[i - 1, k] if i else root[k])
        found[i] = math.sqrt(e[i, 0] * e[i, 0] + e[i, 1] * e[i, 1] + e[i, 2] * e[i, 2])
        taut[i] = found[i] >= lengths[i] - room - TAUT_ROUNDING * lengths[i]
        for k in range(3):
            e[i, k] /= max(found[i], TINY)


@jit
def _solve_chain(rows: Array, taut: Mask, active: Mask, T: Array) -> None:
    """Solve one chain's inequalities, as `pulls.direct_pulls` does; T (m,) is the answer."""
    diagonal, lower, upper, right = rows[DIAGONAL], rows[LOWER], rows[UPPER], rows[RIGHT]
    m = len(right)
    ahead = np.empty(m)
    least = 0.0
    for i in range(m):
        active[i] = taut[i]
        least = max(least, abs(right[i]))
    least *= SLACK
    for attempt in range(MOST_ROUNDS):
        for i in range(m):
            if not active[i]:
                ahead[i], T[i] = 0.0, 0.0
            elif i == 0:
                ahead[i], T[i] = upper[i] / diagonal[i], right[i] / diagonal[i]
            else:
                pivot = diagonal[i] - lower[i] * ahead[i - 1]
                ahead[i] = upper[i] / pivot
                T[i] = (right[i] + lower[i] * T[i - 1]) / pivot
        for i in range(m - 2, -1, -1):
            T[i] += ahead[i] * T[i + 1]
        wrong, last = False, 0
        for i in range(m):
            lack = right[i] - diagonal[i] * T[i]
            if i > 0:
                lack += lower[i] * T[i - 1]
            if i < m - 1:
                lack += upper[i] * T[i + 1]
            if (active[i] and T[i] < 0.0) or (taut[i] and not active[i] and lack > least):
                wrong, last = True, i
                if attempt < ROUNDS:
                    active[i] = not active[i]
        if not wrong:
            break
        if attempt >= ROUNDS:
            active[last] = not active[last]
    for i in range(m):
        if not active[i]:
            T[i] = 0.0


@jit
def _difference(v: Array, root: Array, i: int, k: int) -> float:
    """Return a component of a node's vector less that of the node before it."""
    return float(v[i, k] - (v[i - 1, k] if i else root[k]))


@jit
def _apply_pulls(v: Array, e: Array, masses: Array, T: Array, factor: float) -> None:
    """Add what pulls do to velocities, times a factor: eqs. (2) and (6)."""
    m = len(masses)
    for i in range(m):
        for k in range(3):
            pull = -T[i] * e[i, k]
            if i < m - 1:
                pull += T[i + 1] * e[i + 1, k]
            v[i, k] += factor * pull / masses[i]


@jit
def _rows(e: Array, masses: Array, printed: bool, rows: Array) -> None:
    """Fill one chain's rows except the right side: J M^-1 J^T, or those of tensions as printed (4)."""
    diagonal, lower, upper = rows[DIAGONAL], rows[LOWER], rows[UPPER]
    m = len(masses)
    for i in range(m):
        near, far = (1.0 / masses[i - 1] if i else 0.0), 1.0 / masses[i]
        lower[i], upper[i] = 0.0, 0.0
        if i:
            lower[i] = e[i, 0] * e[i - 1, 0] + e[i, 1] * e[i - 1, 1] + e[i, 2] * e[i - 1, 2]
        if i < m - 1:
            upper[i] = e[i, 0] * e[i + 1, 0] + e[i, 1] * e[i + 1, 1] + e[i, 2] * e[i + 1, 2]
        if printed:
            diagonal[i] = 2.0 if i else 1.0
        else:
            diagonal[i] = near + far
            lower[i] *= near
            upper[i] *= far


@jit
def step_chains(
    places: Array,
    velocities: Array,
    lengths: Array,
    masses: Array,
    root: Array,
    later: Array,
    wind: Array,
    numbers: tuple[float, float, float, float],
    choices: tuple[bool, bool, bool],
    block: tuple[int, int],
) -> None:
    """Take one step of some chains, in place.

    Parameters
    ----------
    places, velocities
        (C, m, 3), m and m/s: chains first, unlike everywhere else.
    lengths, masses
        (C, m), m and kg.
    root, later
        (3, C, 3): position, velocity and acceleration of the roots before and after the step.
    wind
        (3,), m/s.
    numbers
        Step, s, gravity, m/s^2, drag, kg/s, and the largest shortness of a taut link, m.
    choices
        Three flags: tensions are the printed ones; nodes turn rather than being projected; impulses are applied again.
    block
        First chain, and the one after the last.
    """
    # For each chain, two halves, with the position update (and impulses if `again`) before the second one:
    # 1. Find directions, lengths and taut links, and external accelerations.
    # 2. Fill the rows of tensions and solve them by elimination along the links.
    # 3. Add half a velocity update by external forces and tensions.
    # 4. Apply impulses so that no taut link grows.
    (step, gravity, drag, room), (printed, turns, again) = numbers, choices
    m = lengths.shape[1]
    e, found, external = np.empty((m, 3)), np.empty(m), np.empty((m, 3))
    rows, T = np.empty((4, m)), np.empty(m)
    taut, active = np.empty(m, dtype=np.bool_), np.empty(m, dtype=np.bool_)
    x, v, halfway = np.empty((m, 3)), np.empty((m, 3)), np.empty(3)
    for c in range(block[0], block[1]):
        L, M = lengths[c], masses[c]
        x[:], v[:] = places[c], velocities[c]
        for k in range(3):
            halfway[k] = root[1, c, k] + 0.5 * step * root[2, c, k]
        for half in range(2):
            moves = root if half == 0 else later
            speed = root[1, c] if half == 0 else halfway
            if half == 1:
                _move_nodes(x, v, later[0, c], L, step, turns)
                if again:
                    _apply_impulses(x, v, later[0, c], halfway, L, M, room, e, found, rows, T, taut, active)
            # tensions: relative accelerations along taut links balance the centripetal ones
            _links(x, moves[0, c], L, room, e, found, taut)
            for i in range(m):
                for k in range(3):
                    external[i, k] = drag / M[i] * (wind[k] - v[i, k])
                external[i, 2] -= gravity
            for i in range(m):
                along, square, given = 0.0, 0.0, 0.0
                for k in range(3):
                    apart = _difference(v, speed, i, k)
                    along += apart * e[i, k]
                    square += apart * apart
                    if not printed:
                        given += _difference(external, moves[2, c], i, k) * e[i, k]
                    elif i:
                        given += (M[i] * external[i, k] - M[i - 1] * external[i - 1, k]) * e[i, k]
                    else:
                        given += M[0] * (external[0, k] - moves[2, c, k]) * e[0, k]
                centripetal = (square - along * along) / found[i] if found[i] > 0 else 0.0
                near = 1.0 / M[i - 1] if i else 0.0
                if printed:
                    centripetal *= (2.0 if i else 1.0) / (near + 1.0 / M[i])
                rows[RIGHT, i] = given + centripetal
            _rows(e, M, printed, rows)
            _solve_chain(rows, taut, active, T)
            for i in range(m):
                for k in range(3):
                    v[i, k] += 0.5 * step * external[i, k]
            _apply_pulls(v, e, M, T, 0.5 * step)
            after = halfway if half == 0 else later[1, c]
            _apply_impulses(x, v, moves[0, c], after, L, M, room, e, found, rows, T, taut, active)
        places[c], velocities[c] = x, v


def step_in_parallel(threads: int, places: Array, *others: Any) -> None:
    """Take one step of all chains, in place, on so many threads at most; arguments are those of `step_chains`."""
    chains, m, _ = places.shape
    share = max(1, min(threads, chains * m // ENOUGH))
    blocks = [(chains * i // share, chains * (i + 1) // share) for i in range(share)]
    take: Callable[..., None] = step_chains
    if share == 1:
        take(places, *others, blocks[0])
        return
    with ThreadPoolExecutor(share) as pool:
        list(pool.map(lambda block: take(places, *others, block), blocks))


@jit
def _apply_impulses(
    x: Array, v: Array, root: Array, speed: Array, L: Array, M: Array, room: float,
    e: Array, found: Array, rows: Array, T: Array, taut: Mask, active: Mask,
) -> None:  # fmt: skip
    """Change velocities so that no taut link grows: eqs. (6) to (9)."""
    _links(x, root, L, room, e, found, taut)
    for i in range(len(M)):
        rows[RIGHT, i] = 0.0
        for k in range(3):
            rows[RIGHT, i] += _difference(v, speed, i, k) * e[i, k]
    _rows(e, M, False, rows)
    _solve_chain(rows, taut, active, T)
    _apply_pulls(v, e, M, T, 1.0)


@jit
def _move_nodes(x: Array, v: Array, later: Array, L: Array, step: float, turns: bool) -> None:
    """Move all nodes, root to tip, as `placing.move_nodes` does."""
    before, out, offset = later.copy(), np.empty(3), np.empty(3)
    for i in range(len(L)):
        square, half, inside, free = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            offset[k] = x[i, k] - before[k]
            inside += offset[k] * offset[k]
            half += offset[k] * v[i, k]
            square += v[i, k] * v[i, k]
            free += (offset[k] + step * v[i, k]) ** 2
        if free <= L[i] * L[i]:
            for k in range(3):
                x[i, k] = before[k] + offset[k] + step * v[i, k]
        elif not turns:
            for k in range(3):
                x[i, k] = before[k] + L[i] * (offset[k] + step * v[i, k]) / math.sqrt(free)
        else:
            discriminant = half * half - square * (inside - L[i] * L[i])
            at = (-half + math.sqrt(max(discriminant, 0.0))) / square if square > 0 else math.inf
            if discriminant < 0 or not 0 <= at <= step:
                at = 0.0
            size, along, speed = 0.0, 0.0, 0.0
            for k in range(3):
                out[k] = offset[k] + at * v[i, k]
                size += out[k] * out[k]
            for k in range(3):
                out[k] /= max(math.sqrt(size), TINY)
                along += v[i, k] * out[k]
            for k in range(3):
                speed += (v[i, k] - along * out[k]) ** 2
            speed = math.sqrt(speed)
            angle = speed * (step - at) / L[i]
            for k in range(3):
                across = (v[i, k] - along * out[k]) / max(speed, TINY)
                x[i, k] = before[k] + L[i] * (math.cos(angle) * out[k] + math.sin(angle) * across)
        for k in range(3):
            before[k] = x[i, k]
