r"""Known values of the hinged roofs: spline shells along their paths.

A quarter between planes of symmetry is followed by arc length. A turning point is found from states between the
neighbours of the extremal one: load and deflection are interpolated by polynomials of the distance along the chord,
and once more in a narrow range about the extremum. Knots crowd at the load and where hinge and free edge meet: that
corner, not the load, is what limits the rate of an even mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .estimate import Estimate
from .patch import Mesh, breaks, converged, cylinder
from .spline_path import Condition, arc_length, displacement_control, equilibrium
from .spline_shell import Ends, Shell, State
from .surface_strains import Array

LOAD_SCALE = 0.05  # load factor that counts as 1 mm along the path of a roof
ARC_STEP = 2.0  # mm
SAMPLES = 6
"""States between the neighbours of an extremal one, and again in a narrower range about the extremum."""
NARROW = 0.1
"""Width of that range relative to the first."""
CHANCE = 1e-6
"""Relative uncertainty added to all values: finer meshes than these move some of them by so much."""
HINGE, HALF_LENGTH = np.radians(84.27042204869177), 254.0  # rad, mm


def hinged_roof(thickness: float, mesh: Mesh, young: float = 3102.75, load: float = 1.0) -> Shell:
    """A quarter of the hinged roof under a quarter of 1000 N, times a factor, at (90 degrees, 0)."""
    one = breaks(HINGE, np.pi / 2, mesh.spans[0], (True, True), mesh.halvings)
    two = breaks(0.0, HALF_LENGTH, mesh.spans[1], (True, True), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("zero", "zero"), ("even", "free")),
        (("zero", "even"), ("zero", "free")),
        (("zero", "even"), ("even", "free")),
    ]
    force = (np.pi / 2, 0.0, (0.0, 0.0, -250.0 * load))
    surface = cylinder(2540.0, axis=1)
    return Shell(surface, mesh.splines(one, two), ends, young, 0.3, thickness, forces=(force,))


@dataclass(frozen=True)
class Path:
    """States of a hinged roof from rest, and the rows of the deflections of its centre and its free edge."""

    shell: Shell
    rows: Array
    states: tuple[State, ...]

    @classmethod
    def follow(cls, shell: Shell, until: float) -> Path:
        """Follow the path until the deflection of the centre first exceeds a value."""
        down = (0.0, 0.0, -1.0)
        rows = np.stack([shell.row(np.pi / 2, place, down) for place in (0.0, HALF_LENGTH)])
        (first,) = displacement_control(shell, rows[0], [ARC_STEP / 2])
        states = [State(np.zeros(rows.shape[1]), 0.0)]
        for state in arc_length(shell, rows, LOAD_SCALE, ARC_STEP, first):
            states.append(state)
            if rows[0] @ state.free > until:
                break
        return cls(shell, rows, tuple(states))

    @property
    def points(self) -> Array:
        """Deflection of the centre and load, (states, 2)."""
        return np.array([(self.rows[0] @ s.free, 1000.0 * s.factor) for s in self.states])

    def _extremal(self, column: int, number: int) -> int:
        """Number of the extremal state, counted from rest."""
        rises = np.diff(self.points[:, column]) > 0
        return int(np.flatnonzero(rises[1:] != rises[:-1])[number - 1]) + 1

    def turning(self, column: int, number: int) -> Array:
        """Deflection and load at a turning point of the deflection (column 0) or the load (1), counted from 1."""
        i = self._extremal(column, number)
        before, state, after = self.states[i - 1 : i + 2]
        chord = np.append(self.rows @ (after.free - before.free), (after.factor - before.factor) / LOAD_SCALE)
        chord /= np.linalg.norm(chord)
        row, slope = chord[:-1] @ self.rows, float(chord[-1] / LOAD_SCALE)
        start, end = (row @ s.free + slope * s.factor for s in (before, after))
        centre, half = (start + end) / 2, (end - start) / 2
        nodes = np.cos(np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES)
        for narrower in (1.0, NARROW):
            found = []
            for value in centre + narrower * half * nodes:
                state, _ = equilibrium(self.shell, state, Condition(row, slope, float(value)))
                found.append((self.rows[0] @ state.free, 1000.0 * state.factor))
            curves = [np.polynomial.Chebyshev.fit(nodes, y, SAMPLES - 1, domain=[-1, 1]) for y in np.array(found).T]
            extremal = curves[column].deriv().roots()
            real = extremal[np.abs(extremal.imag) < 1e-9].real
            place = real[np.argmin(np.abs(real))]
            centre += narrower * half * place
        return np.array([curve(place) for curve in curves])

    def beside(self, shell: Shell) -> Path:
        """States of another shell near to this one, at the same deflections of the centre."""
        states = []
        for state in self.states:
            condition = Condition(self.rows[0], 0.0, float(self.rows[0] @ state.free))
            states.append(equilibrium(shell, state, condition)[0])
        return Path(shell, self.rows, tuple(states))

    def about(self, column: int, number: int) -> Path:
        """The three states about a turning point; see `turning`."""
        i = self._extremal(column, number)
        return Path(self.shell, self.rows, self.states[i - 1 : i + 2])

    def at(self, deflection: float) -> State:
        """First state at which the centre has a deflection."""
        near = self.states[int(np.argmax(self.points[:, 0] >= deflection))]
        return equilibrium(self.shell, near, Condition(self.rows[0], 0.0, deflection))[0]


def _hinged_roof_thick(mesh: Mesh) -> dict[str, float]:
    path = Path.follow(hinged_roof(12.7, mesh), 30.0)
    limit, valley = path.turning(1, 1), path.turning(1, 2)
    return {
        "limit_load": limit[1],
        "limit_deflection": limit[0],
        "valley_load": valley[1],
        "load_20": 1000.0 * path.at(20.0).factor,
        "free_edge_deflection": float(path.rows[1] @ path.at(30.0).free),
    }


def _hinged_roof_thin(mesh: Mesh) -> dict[str, float]:
    path = Path.follow(hinged_roof(6.35, mesh), 28.0)
    limit, valley, back = path.turning(1, 1), path.turning(1, 2), path.turning(0, 1)
    return {
        "limit_load": limit[1],
        "limit_deflection": limit[0],
        "valley_load": valley[1],
        "snap_back_deflection": back[0],
        "snap_back_load": back[1],
        "free_edge_deflection": float(path.rows[1] @ path.at(28.0).free),
    }


def hinged_roof_thick() -> dict[str, Estimate]:
    """Known values of the thick hinged roof, N and mm."""
    return converged(_hinged_roof_thick, Mesh((8, 8), 4, 5), Mesh((8, 8), 4, 2), length="mm", rounding=CHANCE)


def hinged_roof_thin() -> dict[str, Estimate]:
    """Known values of the thin hinged roof, N and mm."""
    return converged(_hinged_roof_thin, Mesh((12, 12), 4, 4), Mesh((8, 8), 4, 3), length="mm", rounding=CHANCE)
