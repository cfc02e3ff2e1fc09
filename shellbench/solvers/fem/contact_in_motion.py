"""Obstacles during one step in time: what presses at its end, and rubs along it.

Where a step ends no point is in an obstacle. Forces that keep it out are impulses at the step's begin: r = M^-1 R of
the nodal forces R moves the end by h^2 r and changes the velocity by h r, beside what the generalised-alpha method does
of all other forces (`time_step`). So an impact brings a velocity along the normal to zero in two steps, whatever the
part of the step at which it happens: nothing rebounds. What rests has its weight as R, and what slides the right
friction. Chung & Hulbert's own treatment of forces would rebound, by a velocity that depends on that part.

Friction is Coulomb's: along the obstacle a point moves with it as long as the force for that is at most the coefficient
times the pressure; else the force is that much, against the slip over the step.

Chen, Acary, Virlez & Brüls (2013), A nonsmooth generalized-alpha scheme for flexible multibody systems with unilateral
constraints, International Journal for Numerical Methods in Engineering 96, part smooth forces and impulses alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.contact import nearest_obstacle
from shellbench.solvers.fem.assembly import COMPONENTS, BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.contact import ContactPoints

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STIFFNESS = 100.0  # of a point in contact, in that of the mass that it stands for: each round divides gaps by that
CLOSED = 1e-8  # of the shell's size: depths that are rounding
SETTLED = 1e-4  # of the largest pressure: changes from round to round that end them
MOST_ROUNDS = 30
APART, SLIPS, STICKS = 0, 1, 2


@dataclass(frozen=True)
class Pressed:
    """What obstacles exert on a displaced shell.

    Attributes
    ----------
    energy
        Of the augmented Lagrangian, J: a potential of the forces.
    gap, pressure
        (n,) m, and Pa.
    traction
        (n, 3) of friction, Pa.
    tried
        (n,) magnitude of the force that would hold a point, Pa.
    normal
        (n, 3).
    status
        (n,) APART, SLIPS or STICKS.
    """

    energy: float
    gap: Array
    pressure: Array
    traction: Array
    tried: Array
    normal: Array
    status: Integers


@dataclass(frozen=True)
class StepContact:
    """Obstacles during a step; see the top.

    Attributes
    ----------
    points
        Where the gap is asked.
    begin, end
        Times, s.
    start
        (n, 3) displacement at the step's begin, m.
    stiffness
        k of the augmented Lagrangian, N/m^3.
    pressure, traction
        Its multipliers (n,) and (n, 3), Pa.
    frame
        (n, 3) normals to which friction is tangential: of the round before.
    """

    points: ContactPoints
    begin: float
    end: float
    start: Array
    stiffness: float
    pressure: Array
    traction: Array
    frame: Array

    @classmethod
    def on_step(
        cls, points: ContactPoints, times: tuple[float, float], q: Array, before: tuple[Array, Array]
    ) -> StepContact:
        """Begin a step from q (nodes, 12) with pressures (n,) and tractions (n, 3) of the one before."""
        start, h = points.displacement(q[..., None]), times[1] - times[0]
        _, normal, _ = nearest_obstacle(points.case, points.points, start, times[0])
        stiffness = STIFFNESS * points.case.material.areal_density / h**2
        return cls(points, times[0], times[1], start, stiffness, *before, normal)

    def at(self, q: Array) -> Pressed:
        """Return what obstacles exert where the step ends at q (nodes, 12)."""
        # Of a force f = t - k s with a multiplier t and a way s, cut to what is allowed, the potential is |f|^2 / 2 k
        # up to there, and linear beyond.
        case, k, area = self.points.case, self.stiffness, self.points.areas.ravel()
        u = self.points.displacement(q[..., None])
        gap, normal, nearest = nearest_obstacle(case, self.points.points, u, self.end)
        pressure = np.maximum(self.pressure - k * gap, 0.0)
        moved = np.array([o.at(self.end)[0] - o.at(self.begin)[0] for o in case.obstacles])
        slip = self._along(u - self.start - moved[nearest])
        tried = self._along(self.traction) - k * slip
        size = np.linalg.norm(tried, axis=-1)
        # the bound is that of the pressure's multiplier: with one that moves with q there is no potential
        bound = np.array([o.friction for o in case.obstacles])[nearest] * self.pressure
        sticks = size <= bound
        traction = tried * np.where(sticks, 1.0, bound / np.where(sticks, 1.0, size))[:, None]
        rubbed = np.where(sticks, size**2 / 2, bound * size - bound**2 / 2)
        status = np.where(pressure > 0, np.where(sticks & (bound > 0), STICKS, SLIPS), APART)
        energy = float(area @ (pressure**2 / 2 + rubbed)) / k
        return Pressed(energy, gap, pressure, traction, size, normal, status)

    def _along(self, vectors: Array) -> Array:
        """Return the parts of vectors (n, 3) along obstacles."""
        return np.asarray(vectors - np.sum(vectors * self.frame, axis=-1, keepdims=True) * self.frame)

    def forces(self, pressed: Pressed) -> Array:
        """Return the forces (n, 3) at the points, N."""
        both = pressed.pressure[:, None] * pressed.normal + pressed.traction
        return np.asarray(both * self.points.areas.reshape(-1, 1))

    def nodal(self, pressed: Pressed) -> Array:
        """Return the nodal forces (nodes, 12)."""
        return self.points.nodal(self.forces(pressed))[..., 0]

    def add_stiffness(self, matrix: BlockMatrix, pressed: Pressed, factor: float) -> None:
        """Add the second derivative of the potential, times a factor, to a matrix; curved obstacles count as planes."""
        points = self.points
        shape = points.areas.shape
        touching = (pressed.pressure > 0) | np.any(pressed.traction != 0, axis=-1)
        cells = np.flatnonzero(np.any(touching.reshape(shape), axis=1))
        if not len(cells):
            return
        size = np.linalg.norm(pressed.traction, axis=-1)
        heading = pressed.traction / np.where(size > 0, size, 1.0)[:, None]
        plane = np.eye(COMPONENTS) - self.frame[:, :, None] * self.frame[:, None]
        slips = size / np.where(pressed.tried > 0, pressed.tried, 1.0)
        rubs = slips[:, None, None] * (plane - heading[:, :, None] * heading[:, None])
        local = np.where((pressed.status == STICKS)[:, None, None], plane, rubs)
        local = local + np.where(pressed.pressure > 0, 1.0, 0.0)[:, None, None] * (
            pressed.normal[:, :, None] * pressed.normal[:, None]
        )
        local = local * (factor * self.stiffness * points.areas.ravel())[:, None, None]
        values = points.values[cells]
        weighted = local.reshape(*shape, COMPONENTS, COMPONENTS)[cells]
        terms = np.einsum("emij,emak,embl->eiakjbl", weighted, values, values, optimize=True)
        add_cell_matrices(matrix.blocks, points.mesh.nodes[cells], terms)

    def settled(self, pressed: Pressed, size: float) -> bool:
        """Return whether gaps are closed and pressures no longer change; `size` is the shell's, m."""
        change = np.maximum(np.abs(pressed.pressure - self.pressure).max(), self._turned(pressed))
        inside = np.where(pressed.pressure > 0, np.abs(pressed.gap), -pressed.gap).max()
        return bool(inside <= CLOSED * size and change <= SETTLED * pressed.pressure.max())

    def _turned(self, pressed: Pressed) -> float:
        return float(np.abs(pressed.traction - self.traction).max())

    def next_round(self, pressed: Pressed) -> StepContact:
        """Take what presses as multipliers."""
        return replace(self, pressure=pressed.pressure, traction=pressed.traction, frame=pressed.normal)

    def work(self, pressed: Pressed) -> float:
        """Return the work that moving obstacles do, J."""
        case = self.points.case
        _, _, nearest = nearest_obstacle(case, self.points.points, self.start, self.begin)
        moved = np.array([o.at(self.end)[0] - o.at(self.begin)[0] for o in case.obstacles])
        return float(np.sum(self.forces(pressed) * moved[nearest]))
