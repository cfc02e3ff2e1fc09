"""The solver `mass-spring`: masses on springs in rows and columns, at rest, by Newton's method.

A spring of stiffness k and length l between places a and b has the energy k (|a - b| - l)^2 / 2, whether it pulls or
pushes. The sum of these and of the weights' energy has its least value at rest. A Newton step whose matrix is not
positive definite, since springs that push give way sideways, gets a multiple of the identity (Levenberg). Each step is
halved until the energy falls. At the start each row is an arc. It is a coarse cloth as games have it: its springs along
diagonals keep it from shearing, and so from draping (figure 3 of Jin et al.).
"""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Step
from shellbench.problems.rope.case import Net, RopeCase
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.problems.rope.solving import RopeSolver
from shellbench.solvers.chain.solver import ChainSettings

Array = NDArray[np.float64]
Springs = tuple[NDArray[np.int64], Array, Array]
"""Ends (s, 2), lengths (s,), m, and stiffnesses (s,), N/m."""

STEPS, HALVINGS = 1000, 60  # more than nets take that were tried: the softest 40, the stiffest 300
SHIFT = 1e-6  # of the largest stiffness: the first multiple of the identity; each next one is ten times as large
ROUNDING = 1e-14  # of an energy


def springs_of(net: Net) -> Springs:
    """Return ends (s, 2), lengths (s,), m, and stiffnesses (s,), N/m: along rows, columns, then diagonals."""
    number = np.arange(net.rows * net.columns).reshape(net.rows, net.columns)
    pairs = [
        (number[:, :-1], number[:, 1:]), (number[:-1], number[1:]),
        (number[:-1, :-1], number[1:, 1:]), (number[:-1, 1:], number[1:, :-1]),
    ]  # fmt: skip
    families = [np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs]
    counts = [len(family) for family in families]
    lengths = np.repeat(net.spacing * np.array([1.0, 1.0, 2**0.5, 2**0.5]), counts)
    return (
        np.concatenate(families),
        lengths,
        np.repeat([net.stiffness, net.stiffness, net.shearing, net.shearing], counts),
    )


def energy_of(net: Net, nodes: Array, springs: Springs) -> tuple[float, Array, Array]:
    """Return the energy, J, its gradient (2 n,) and matrix (2 n, 2 n) at places (n, 2) of all nodes."""
    ends, lengths, stiffness = springs
    apart = nodes[ends[:, 1]] - nodes[ends[:, 0]]
    found = np.sqrt((apart**2).sum(axis=1))
    pull, along = stiffness * (found - lengths), apart / found[:, None]
    energy = float(0.5 * pull @ (found - lengths) + net.mass * net.gravity * nodes[:, 1].sum())
    slope = np.zeros_like(nodes)
    slope[:, 1] = net.mass * net.gravity
    np.add.at(slope, ends[:, 1], pull[:, None] * along)
    np.add.at(slope, ends[:, 0], -pull[:, None] * along)
    outer = along[:, :, None] * along[:, None]
    block = stiffness[:, None, None] * outer + (pull / found)[:, None, None] * (np.eye(2) - outer)
    matrix = np.zeros((len(nodes), len(nodes), 2, 2))
    for i, j, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
        np.add.at(matrix, (ends[:, i], ends[:, j]), sign * block)
    return energy, slope.ravel(), matrix.transpose(0, 2, 1, 3).reshape(2 * len(nodes), -1)


class NetSolver(RopeSolver):
    """Newton's method on the energy of a mass-spring net."""

    name: ClassVar[str] = "mass-spring"
    capabilities: ClassVar[Capabilities] = Capabilities(("springs",), "nets of masses and springs at rest, by Newton")
    settings_type: ClassVar[type[Settings]] = ChainSettings

    def declines(self, case: Any) -> str | None:
        """Return the reason that it declines a problem, or None: it takes nets at rest only."""
        return None if isinstance(case, RopeCase) and case.net else "it solves nets of springs only"

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> RopeMotion:
        """Find the net at rest; SolveFailure if Newton's method does not converge."""
        net, began = case.net, time.perf_counter()
        assert net is not None
        springs, nodes = springs_of(net), start_of(net)
        held = [0, net.columns - 1]
        free = np.setdiff1d(np.arange(2 * len(nodes)), [2 * n + k for n in held for k in (0, 1)])
        weight = net.mass * net.gravity * len(nodes)
        history: list[Step] = []
        for number in range(STEPS):
            energy, slope, matrix = energy_of(net, nodes, springs)
            residual, part = slope[free], matrix[np.ix_(free, free)]
            history.append(Step(number, time.perf_counter() - began, energy, len(free)))
            progress(Progress(number, None, f"residual {np.abs(residual).max():.2g} N"))
            shift = 0.0
            while (change := descent(part, residual, shift)) is None:
                shift = max(10 * shift, SHIFT * float(springs[2].max()))
            if np.abs(residual).max() <= settings.tolerance * weight and shift == 0:
                return at_rest(case, nodes, springs, tuple(history))
            for share in 0.5 ** np.arange(HALVINGS):
                moved = nodes.ravel().copy()
                moved[free] += share * change
                allowed = 1e-4 * share * float(residual @ change) + ROUNDING * abs(energy)
                if energy_of(net, moved.reshape(-1, 2), springs)[0] <= energy + allowed:
                    break
            nodes = moved.reshape(-1, 2)
        raise SolveFailure(f"the residual is {np.abs(residual).max():.2g} N after {STEPS} steps of Newton's method")


def descent(matrix: Array, residual: Array, shift: float) -> Array | None:
    """Return Newton's step with a shifted matrix; None if that is not positive definite."""
    try:
        lower = np.linalg.cholesky(matrix + shift * np.eye(len(matrix)))
    except np.linalg.LinAlgError:
        return None
    return np.asarray(-np.linalg.solve(lower.T, np.linalg.solve(lower, residual)))


def start_of(net: Net) -> Array:
    """Return places (n, 2) with all rows in an arc between the held corners, a spacing below each other."""
    across = np.linspace(0.0, 1.0, net.columns)
    sag = 0.5 * np.sqrt(max(((net.columns - 1) * net.spacing) ** 2 - net.span**2, 0.0))
    x, z = net.span * across, -4 * sag * across * (1 - across)
    down = net.spacing * np.arange(net.rows)[:, None]
    return np.stack([np.broadcast_to(x, (net.rows, net.columns)), z - down], axis=-1).reshape(-1, 2)


def at_rest(case: RopeCase, nodes: Array, springs: Springs, history: tuple[Step, ...]) -> RopeMotion:
    """Return the solution: springs along rows and columns have tensions, those along diagonals are not kept."""
    ends, lengths, stiffness = springs
    found = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)
    places = np.insert(nodes, 1, 0.0, axis=1)
    state = RopeState(places, np.zeros_like(places), (stiffness * (found - lengths))[: case.links])
    return RopeMotion(case, (state,), history)
