r"""Known values of large displacements: spline shells of the cases that have no closed form.

Each is a patch between planes of symmetry, its load a fraction of the whole. A discretisation is named by the knot
spans along xi1 and xi2, the degree, and how often the last span before a point load or an edge of low regularity is
halved; a value is that of a fine one, its uncertainty the distance to a clearly coarser one.

- square_plate_nonlinear and scordelis_lo_nonlinear: quarters, under control of the load.
- hinged_roof_thick and _thin: a quarter along its path; turning points from states between the neighbours of the
  extremal one, interpolated by a polynomial.
- cylinder_pull_out: an eighth. Its load has a maximum and a minimum near half of its value, so the displacement U_B
  is controlled on the way.
- slit_annular_plate: the whole plate; the ends of the clamp and of the lifted edge limit the rate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .estimate import Estimate
from .spline_path import Condition, State, arc_length, displacement_control, equilibrium, load_control
from .spline_shell import Array, Ends, Shell, Splines


@dataclass(frozen=True)
class Mesh:
    """Knot spans along xi1 and xi2, degree, and halvings of the span at a singular place."""

    spans: tuple[int, int]
    degree: int
    halvings: int = 0

    def splines(self, one: Array, two: Array) -> tuple[Splines, Splines]:
        """Splines of both variables over the given breaks."""
        return Splines(one, self.degree), Splines(two, self.degree)


def breaks(start: float, end: float, spans: int, halve: Sequence[bool] = (), halvings: int = 0) -> Array:
    """Equal spans, of which the first or last (both if told) are halved again and again toward the end."""
    uniform = np.linspace(start, end, spans + 1)
    finer = (end - start) / spans * 0.5 ** np.arange(1, halvings + 1)
    more = [place for place, wanted in zip((start + finer, end - finer), halve, strict=False) if wanted]
    return np.unique(np.concatenate([uniform, *more]))


# --- surfaces ------------------------------------------------------------------------------------


def _power(x: Array, order: int) -> Array:
    return x if order == 0 else np.full_like(x, 1.0 if order == 1 else 0.0)


def plane(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of (xi1, xi2, 0)."""
    zero = np.zeros_like(one)
    return np.stack([_power(one, i) if j == 0 else zero, _power(two, j) if i == 0 else zero, zero], -1)


def ring(angle: Array, radius: Array, i: int, j: int) -> Array:
    """Derivative of (xi2 cos xi1, xi2 sin xi1, 0)."""
    out = _power(radius, j)
    turned = angle + i * np.pi / 2
    return np.stack([out * np.cos(turned), out * np.sin(turned), np.zeros_like(out)], -1)


def cylinder(radius: float, axis: int) -> Callable[[Array, Array, int, int], Array]:
    """Derivative of a cylinder about y (axis 1) or z (axis 2); xi1 = 0 is on x."""

    def surface(angle: Array, along: Array, i: int, j: int) -> Array:
        out = radius if j == 0 else 0.0
        turned = angle + i * np.pi / 2
        axial = _power(along, j) if i == 0 else np.zeros_like(along)
        parts = [out * np.cos(turned), out * np.sin(turned)]
        return np.stack([parts[0], axial, parts[1]] if axis == 1 else [*parts, axial], -1)

    return surface


def _uniform(*force: float) -> Callable[[Array, Array], Array]:
    return lambda one, two: np.broadcast_to(force, (*one.shape, 3))


# --- plate and roof ------------------------------------------------------------------------------

SYMMETRIC: Ends = ("zero", "even")


def plate(mesh: Mesh) -> Shell:
    """A quarter of the square plate, its centre at (50, 50)."""
    splines = mesh.splines(*(breaks(0.0, 50.0, n) for n in mesh.spans))
    ends = [(("zero", "zero"), SYMMETRIC), (SYMMETRIC, ("zero", "zero")), (SYMMETRIC, SYMMETRIC)]
    return Shell(plane, splines, ends, 1e7, 0.0, 1.0, load=_uniform(0.0, 0.0, -1.0))


def roof(mesh: Mesh) -> Shell:
    """A quarter of the Scordelis-Lo roof from a straight edge to the crown and from a diaphragm to mid-length."""
    one = breaks(np.radians(50.0), np.pi / 2, mesh.spans[0], (True, False), mesh.halvings)
    two = breaks(0.0, 25.0, mesh.spans[1], (True, False), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("free", "zero"), SYMMETRIC),
        (("free", "even"), SYMMETRIC),
        (("free", "even"), ("free", "zero")),
    ]
    load = _uniform(0.0, -90.0, 0.0)
    return Shell(cylinder(25.0, axis=2), mesh.splines(one, two), ends, 4.32e8, 0.0, 0.25, load=load)


def _sagging(shell: Shell, name: str, place: tuple[float, float], direction: Sequence[float]) -> dict[str, float]:
    """Displacement at a place, largest displacement and energies of a quarter under its full load."""
    *_, state = load_control(shell, (0.25, 0.5, 0.75, 1.0))
    moved = shell.displacements(state.free, *(np.linspace(*s.breaks[[0, -1]], 101) for s in shell.splines))
    membrane, bending = (4 * energy for energy in shell.energies(state.free))
    return {
        name: float(shell.row(*place, direction) @ state.free),
        "largest_displacement": float(np.linalg.norm(moved, axis=-1).max()),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }


def _square_plate(mesh: Mesh) -> dict[str, float]:
    return _sagging(plate(mesh), "centre_deflection", (50.0, 50.0), (0.0, 0.0, -1.0))


def _scordelis_lo(mesh: Mesh) -> dict[str, float]:
    return _sagging(roof(mesh), "edge_deflection", (float(np.radians(50.0)), 25.0), (0.0, -1.0, 0.0))


# --- hinged roofs --------------------------------------------------------------------------------

LOAD_SCALE = 0.05  # load factor that counts as 1 mm along the path of a roof
ARC_STEP = 2.0  # mm
SAMPLES = 6
"""States between the neighbours of an extremal one, and again in a narrower range about the extremum."""
NARROW = 0.1
"""Width of that range relative to the first."""
RISE, HALF_LENGTH = np.radians(84.27042204869177), 254.0


def hinged_roof(thickness: float, mesh: Mesh) -> Shell:
    """A quarter of the hinged roof under a quarter of 1000 N at (90 degrees, 0)."""
    one = breaks(RISE, np.pi / 2, mesh.spans[0], (False, True), mesh.halvings)
    two = breaks(0.0, HALF_LENGTH, mesh.spans[1], (True, False), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("zero", "zero"), ("even", "free")),
        (("zero", "even"), ("zero", "free")),
        (("zero", "even"), ("even", "free")),
    ]
    force = (np.pi / 2, 0.0, (0.0, 0.0, -250.0))
    surface = cylinder(2540.0, axis=1)
    return Shell(surface, mesh.splines(one, two), ends, 3102.75, 0.3, thickness, forces=(force,))


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

    def turning(self, column: int, number: int) -> Array:
        """Deflection and load at a turning point of the deflection (column 0) or the load (1), counted from 1."""
        rises = np.diff(self.points[:, column]) > 0
        i = int(np.flatnonzero(rises[1:] != rises[:-1])[number - 1]) + 1
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


# --- cylinder ------------------------------------------------------------------------------------

RADIUS, HALF_CYLINDER, SPREAD = 4.953, 5.175, 0.047
PULLED = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.4)
"""Values of U_B on the way, m."""


def pulled_cylinder(mesh: Mesh) -> Shell:
    """An eighth of the pulled cylinder, the load at (90 degrees, 0)."""
    one = breaks(0.0, np.pi / 2, mesh.spans[0], (False, True), mesh.halvings)
    two = breaks(0.0, HALF_CYLINDER, mesh.spans[1], (True, False), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("even", "zero"), ("even", "free")),
        (("even", "even"), ("zero", "free")),
        (("zero", "even"), ("even", "free")),
    ]

    def load(angle: Array, along: Array) -> Array:
        distance = (RADIUS * (angle - np.pi / 2)) ** 2 + along**2
        density = 20000.0 / (np.pi * SPREAD**2) * np.exp(-distance / (2 * SPREAD**2))
        return density[:, None] * np.array([0.0, 0.0, 1.0])

    return Shell(cylinder(RADIUS, axis=1), mesh.splines(one, two), ends, 10.5e6, 0.3125, 0.094, load=load)


def _cylinder_pull_out(mesh: Mesh) -> dict[str, float]:
    shell = pulled_cylinder(mesh)
    inward = shell.row(0.0, 0.0, (-1.0, 0.0, 0.0))
    *_, state = displacement_control(shell, inward, PULLED)
    state, _ = equilibrium(shell, state, Condition(np.zeros_like(inward), 1.0, 1.0))
    membrane, bending = shell.energies(state.free)
    return {
        "W_A": float(shell.row(np.pi / 2, 0.0, (0.0, 0.0, 1.0)) @ state.free),
        "U_B": float(inward @ state.free),
        "U_C": float(shell.row(0.0, HALF_CYLINDER, (-1.0, 0.0, 0.0)) @ state.free),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }


# --- annulus -------------------------------------------------------------------------------------

LIFTS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


def slit_ring(mesh: Mesh) -> Shell:
    """The slit annular plate, clamped at xi1 = 0 and lifted at xi1 = 360 degrees."""
    one = breaks(0.0, 2 * np.pi, mesh.spans[0], (True, True), mesh.halvings)
    two = breaks(6.0, 10.0, mesh.spans[1], (True, True), mesh.halvings)
    ends = [(("zero", "free"), ("free", "free"))] * 2 + [(("clamped", "free"), ("free", "free"))]
    return Shell(ring, mesh.splines(one, two), ends, 21e6, 0.0, 0.03, edge_load=(0.0, 0.0, 0.8))


def _slit_annular_plate(mesh: Mesh) -> dict[str, float]:
    shell = slit_ring(mesh)
    *_, state = load_control(shell, LIFTS)
    membrane, bending = shell.energies(state.free)
    up = (0.0, 0.0, 1.0)
    return {
        "inner_lift": float(shell.row(2 * np.pi, 6.0, up) @ state.free),
        "outer_lift": float(shell.row(2 * np.pi, 10.0, up) @ state.free),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }


# --- estimates -----------------------------------------------------------------------------------


ROUNDING = 1e-9
"""Relative uncertainty that Newton's last correction and the rounding of a thin shell's forces leave."""
UNITS = {"load": "N", "20": "N"}
"""By the last word of a quantity; a length otherwise, in mm for the hinged roofs."""


def _converged(compute: Callable[[Mesh], dict[str, float]], fine: Mesh, coarse: Mesh) -> dict[str, Estimate]:
    near, far = compute(fine), compute(coarse)
    # Membrane and bending energy trade with one another: the sum may be the only one that converges from one side.
    energies = max((abs(near[name] - far[name]) for name in near if name.endswith("energy")), default=0.0)
    values = {}
    for name, value in near.items():
        kind = name.split("_")[-1]
        rounding = ROUNDING * abs(value)
        if kind == "energy":
            values[name] = Estimate(value, energies + rounding, "J")
        else:
            values[name] = Estimate.between(value, far[name], UNITS.get(kind, "m"), rounding)
    return values


def square_plate_nonlinear() -> dict[str, Estimate]:
    """Known values of the square plate."""
    return _converged(_square_plate, Mesh((8, 8), 6), Mesh((6, 6), 5))


def scordelis_lo_nonlinear() -> dict[str, Estimate]:
    """Known values of the Scordelis-Lo roof."""
    return _converged(_scordelis_lo, Mesh((10, 8), 6, 3), Mesh((8, 6), 5, 1))


def hinged_roof_thick() -> dict[str, Estimate]:
    """Known values of the thick hinged roof, N and mm."""
    return _converged(_hinged_roof_thick, Mesh((12, 12), 4, 4), Mesh((8, 8), 4, 3))


def hinged_roof_thin() -> dict[str, Estimate]:
    """Known values of the thin hinged roof, N and mm."""
    return _converged(_hinged_roof_thin, Mesh((12, 12), 4, 4), Mesh((8, 8), 4, 3))


def cylinder_pull_out() -> dict[str, Estimate]:
    """Known values of the pulled cylinder."""
    return _converged(_cylinder_pull_out, Mesh((24, 20), 5, 5), Mesh((18, 16), 5, 5))


def slit_annular_plate() -> dict[str, Estimate]:
    """Known values of the slit annular plate."""
    return _converged(_slit_annular_plate, Mesh((96, 6), 5, 1), Mesh((64, 5), 5))
