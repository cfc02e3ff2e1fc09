"""Static cases: one linear solve, or Newton's method along a path of load factors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.solvers.cst.problem import TriangleProblem, factorised, minimise

Array = NDArray[np.float64]

BALANCE = 1e-6  # of all loads: the force of a pin that says that loads are not in balance
REFINEMENTS = 2  # of a linear solve, by its residual
MOST_STEPS = 60  # Newton steps to one state
SHORTEST = 2.0**-8  # of the way to the next state: the smallest increment of the load factor


@dataclass(frozen=True)
class TriangleState:
    """One state of equilibrium.

    Attributes
    ----------
    at
        Load factor.
    displacement
        (v, 3).
    energy
        Potential energy, J.
    iterations
        Newton steps since the state before.
    residual
        Largest force that is not in balance, relative to the largest force of all.
    """

    at: float
    displacement: Array
    energy: float
    iterations: int
    residual: float


def solve_linear(problem: TriangleProblem, states: tuple[float, ...]) -> list[TriangleState]:
    """Solve a linear case at each load factor.

    Raises
    ------
    SolveFailure
        If the stiffness matrix is singular, or loads are not in balance where nothing holds the shell.
    """
    free = problem.pattern.free
    rest = np.zeros_like(problem.elastic.rest)
    solve = factorised(
        problem.pattern.matrix(problem.elastic.tangent_values(rest), problem.loading.springs.ravel()[free])
    )
    found = []
    for t in states:
        force, u = problem.loading.forces(t), problem.supports.prescribe(rest, t)
        for _ in range(1 + REFINEMENTS):
            u.ravel()[free] += solve((force - problem.internal(u)).ravel()[free])
        found.append(_state(problem, t, u, force, 1))
    return found


def follow_path(
    problem: TriangleProblem, states: tuple[float, ...], tolerance: float, tell: Callable[[TriangleState], None]
) -> None:
    """Find the equilibrium at each load factor, from the one before it.

    Parameters
    ----------
    problem
        Case and mesh.
    states
        Load factors, increasing.
    tolerance
        Newton's last step, relative to the shell's size.
    tell
        Is given each of the states as it is found.

    Raises
    ------
    SolveFailure
        If Newton's method does not converge even for small increments of the load factor.
    """
    still = np.zeros(problem.mesh.vertex_count)
    u, t = np.zeros_like(problem.elastic.rest), 0.0
    size = float(np.ptp(problem.elastic.rest, axis=0).max())
    for mark in states:
        increment, iterations = mark - t, 0
        while t < mark:
            goal = mark if t + 1.001 * increment >= mark else t + increment
            force = problem.loading.forces(goal)
            try:
                start = problem.supports.prescribe(u, goal)
                found = minimise(problem, start, force, still, start, tolerance * size, MOST_STEPS)
            except SolveFailure as failure:
                increment /= 2
                if increment < SHORTEST * mark:
                    raise SolveFailure(f"{failure} beyond load factor {t:.4g}") from None
                continue
            u, t, iterations = found.displacement, goal, iterations + found.iterations
        tell(_state(problem, t, u, force, iterations))


def _state(problem: TriangleProblem, t: float, u: Array, force: Array, iterations: int) -> TriangleState:
    internal = problem.internal(u)
    gap = (internal - force).ravel()
    acting = float(np.abs(force).sum())
    moved = problem.loading.case.material.membrane_stiffness * float(np.abs(u).max(initial=0.0))
    scale = max(acting if acting else moved, np.finfo(float).tiny)
    if np.abs(gap[problem.loose.pins]).max(initial=0.0) > BALANCE * scale:
        raise SolveFailure("the loads are not in balance, and nothing holds the shell")
    if len(problem.loose.pins):
        u = problem.loose.removed(u, problem.loading.areas)
    energy = problem.strain_energy(u) - float(np.sum(force * u))
    return TriangleState(t, u, energy, iterations, float(np.abs(gap[problem.pattern.free]).max(initial=0.0)) / scale)
