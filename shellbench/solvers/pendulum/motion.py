"""A chain in the plane (x, z) by the angles of its links, and its tensions.

With e_j = (sin a_j, -cos a_j) and e_j' = (cos a_j, sin a_j), node i is at r + sum_{j <= i} l_j e_j. Lagrange's
equations, with m_ij the mass beyond both links and q_i the force beyond link i,

    sum_j m_ij l_i l_j (cos(a_i - a_j) a_j'' + sin(a_i - a_j) a_j'^2) = l_i e_i' . q_i,

hold relative to the root r, whose acceleration counts as a force. The tension of a link follows from the equation of
motion of the masses beyond it, along the link. No equation of the scheme in `solvers.rope` occurs here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Root = Callable[[float], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Pendulum:
    """Lengths (n,), m, masses (n,), kg, gravity, m/s^2, drag, kg/s, wind (2,), m/s, the root, and damping, kg/s."""

    lengths: Array
    masses: Array
    gravity: float
    drag: float
    wind: Array
    root: Root
    damping: float = 0.0

    def directions(self, angles: Array) -> tuple[Array, Array]:
        """Return e and e' of all links, (n, 2)."""
        sines, cosines = np.sin(angles), np.cos(angles)
        return np.stack([sines, -cosines], axis=1), np.stack([cosines, sines], axis=1)

    def nodes(self, time: float, angles: Array, rates: Array) -> tuple[Array, Array]:
        """Return places and velocities of the root and all nodes, (n + 1, 2)."""
        along, across = self.directions(angles)
        place, velocity, _ = self.root(time)
        arms, moves = self.lengths[:, None] * along, (self.lengths * rates)[:, None] * across
        return np.cumsum(np.vstack([place, arms]), axis=0), np.cumsum(np.vstack([velocity, moves]), axis=0)

    def forces(self, time: float, angles: Array, rates: Array) -> Array:
        """Return weight, drag and damping of the nodes, (n, 2), N."""
        _, velocities = self.nodes(time, angles, rates)
        weight = np.outer(self.masses, [0.0, -self.gravity])
        dampers = self.damping * np.diff(velocities, axis=0)
        dampers = np.vstack([dampers[1:], np.zeros((1, 2))]) - dampers
        return np.asarray(weight + self.drag * (self.wind - velocities[1:]) + dampers)

    def accelerations(self, time: float, angles: Array, rates: Array) -> Array:
        """Return a'' of all links, (n,), rad/s^2."""
        number = np.arange(len(angles))
        beyond = np.cumsum(self.masses[::-1])[::-1][np.maximum(number[:, None], number)]
        apart = angles[:, None] - angles
        arms = beyond * np.outer(self.lengths, self.lengths)
        pushed = self.forces(time, angles, rates) - np.outer(self.masses, self.root(time)[2])
        carried = np.cumsum(pushed[::-1], axis=0)[::-1]
        across = self.directions(angles)[1]
        right = self.lengths * np.einsum("nk,nk->n", across, carried) - (arms * np.sin(apart)) @ rates**2
        return np.asarray(np.linalg.solve(arms * np.cos(apart), right))

    def tensions(self, time: float, angles: Array, rates: Array) -> Array:
        """Return the tensions of all links, (n,), N."""
        along, across = self.directions(angles)
        turning = self.accelerations(time, angles, rates)
        steps = self.lengths[:, None] * (turning[:, None] * across - (rates**2)[:, None] * along)
        moved = self.root(time)[2] + np.cumsum(steps, axis=0)
        lacking = self.forces(time, angles, rates) - self.masses[:, None] * moved
        return np.asarray(np.einsum("nk,nk->n", along, np.cumsum(lacking[::-1], axis=0)[::-1]))


def integrated(pendulum: Pendulum, start: Array, times: tuple[float, ...], tolerance: float) -> Array:
    """Return angles and their rates at times, (len(times), 2 n), by DOP853."""
    from scipy.integrate import solve_ivp

    def slope(time: float, state: Array) -> Array:
        angles, rates = np.split(state, 2)
        return np.concatenate([rates, pendulum.accelerations(time, angles, rates)])

    if times[-1] == 0:
        return start[None]
    found: Any = solve_ivp(
        slope, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=tolerance, atol=tolerance
    )
    return np.asarray(found.y.T)
