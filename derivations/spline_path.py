r"""Equilibria of a spline shell along a path: Newton's method under load, displacement or arc-length control.

An equilibrium is a root of (forces(u) - t f, c(u, t) - value), c linear: c = t is control of the load, c = row . u of a
displacement, and a step of a path continues along its own tangent, which passes limit points of both kinds
(Crisfield 1981, with a plane instead of a sphere). The tangent is formed with stresses predicted linearly from the
last step of Newton's method instead of those of the displacement: large rotations of a thin shell then need a few
large steps instead of many small ones (Magisano et al. 2017, "MIP Newton"); the roots are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import splu

from .spline_shell import Array, Shell, State

CONVERGED = 1e-9
"""Largest last correction relative to the largest coefficient: Newton's next one would be its square."""
ITERATIONS = 30
SHORTEST = 1e-4
"""Smallest fraction of the asked step that is tried."""


class NoEquilibriumError(RuntimeError):
    """Newton's method found no root."""


@dataclass(frozen=True)
class Condition:
    """The linear condition row . u + slope t = value that picks a state of a path."""

    row: Array
    slope: float
    value: float

    def defect(self, state: State) -> float:
        """Difference between the wanted value and the state's."""
        return float(self.value - self.row @ state.free - self.slope * state.factor)


def equilibrium(shell: Shell, start: State, condition: Condition) -> tuple[State, int]:
    """Return the equilibrium that meets a condition, and the iterations, from an equilibrium nearby.

    Raises
    ------
    NoEquilibriumError
        If the iteration doesn't converge.
    """
    state, stress = start, None
    for iteration in range(ITERATIONS):
        at = shell.linearised(state.free)
        residual = state.factor * shell.load_vector - at.forces()
        solve = splu(at.stiffness(stress).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01).solve
        by_load, by_residual = solve(np.stack([shell.load_vector, residual], axis=1)).T
        missing = condition.defect(state) - condition.row @ by_residual
        factor = missing / (condition.row @ by_load + condition.slope)
        step = by_residual + factor * by_load
        stress = at.predicted_stress(step)
        state = State(state.free + step, state.factor + float(factor))
        size = np.abs(step).max() / max(np.abs(state.free).max(), np.finfo(float).tiny)
        if not np.isfinite(size) or (iteration > 1 and np.abs(step).max() > 1e3 * np.abs(start.free).max() > 0):
            break
        if size < CONVERGED:
            return state, iteration + 1
    raise NoEquilibriumError(f"no equilibrium after {iteration + 1} iterations, last correction {size:.1e}")


def under(shell: Shell, conditions: Callable[[float], Condition], marks: Sequence[float]) -> Iterator[State]:
    """Yield the equilibria at rising positive marks, each from the last one; a step that fails is halved."""
    place, state = 0.0, State(np.zeros(shell.reduction.shape[1]), 0.0)
    for mark in marks:
        step = mark - place
        while place < mark:
            at = min(place + step, mark)
            try:
                state, _ = equilibrium(shell, state, conditions(at))
            except NoEquilibriumError:
                step /= 2
                if step < SHORTEST * mark:
                    raise
            else:
                place, step = at, 2 * step
        yield state


def load_control(shell: Shell, factors: Sequence[float]) -> Iterator[State]:
    """Yield the equilibria under rising load factors."""
    nothing = np.zeros(shell.reduction.shape[1])
    return under(shell, lambda factor: Condition(nothing, 1.0, factor), factors)


def displacement_control(shell: Shell, row: Array, values: Sequence[float]) -> Iterator[State]:
    """Yield the equilibria at rising values of a displacement."""
    return under(shell, lambda value: Condition(row, 0.0, value), values)


def arc_length(shell: Shell, rows: Array, load_scale: float, length: float, first: State) -> Iterator[State]:
    """Yield equilibria along a path from rest over `first`, at about equal distances.

    Parameters
    ----------
    rows : (displacements, free) of the displacements whose changes, with that of the load, make up the distance
    load_scale : change of the load factor that counts as much as a unit of displacement
    length : distance between states
    first : an equilibrium near to rest on the path
    """
    last, state = State(np.zeros(rows.shape[1]), 0.0), first
    while True:
        yield state
        step = state.free - last.free
        change, factor = rows @ step, (state.factor - last.factor) / load_scale
        norm = float(np.hypot(np.linalg.norm(change), factor))
        row, slope = (change / norm) @ rows, factor / norm / load_scale
        distance = length
        while True:
            ahead = State(state.free + distance / norm * step, state.factor + distance / norm * factor * load_scale)
            value = float(row @ state.free + slope * state.factor + distance)
            try:
                found, _ = equilibrium(shell, ahead, Condition(row, slope, value))
                break
            except NoEquilibriumError:
                distance /= 2
                if distance < SHORTEST * length:
                    raise
        last, state = state, found
