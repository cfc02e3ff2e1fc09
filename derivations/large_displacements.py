r"""Known values of large displacements: spline shells under rising loads.

Each is a patch between planes of symmetry, its load a fraction of the whole. A discretisation is named by the knot
spans along xi1 and xi2, the degree, and how often the last span before a point load or an edge of low regularity is
halved; a value is that of a fine one, its uncertainty the distance to a clearly coarser one.

- square_plate_nonlinear and scordelis_lo_nonlinear: quarters, under control of the load.
- cylinder_pull_out: an eighth. Its load has a maximum and a minimum near half of its value, so the displacement U_B
  is controlled on the way.
- semi_cylinder: a half. Its load rises throughout, but hardly between deflections of 0.8 and 1: the deflection is
  controlled on the way. In the plane of the shell the clamp's condition on slopes is one too many, on the first span
  alone, which is short.
- pinched_cylinder_nonlinear: an eighth; the deflection is controlled on the way, as steps of the load that are as long
  find no equilibrium. A fold runs along xi2 and travels along xi1 from the load toward the sides; spans along xi1 are
  short on its way.
- slit_annular_plate: the whole plate; the ends of the clamp and of the lifted edge limit the rate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .estimate import Estimate
from .patch import SYMMETRIC, Mesh, breaks, converged, cylinder, plane, ring, uniform
from .spline_path import Condition, State, displacement_control, equilibrium, load_control
from .spline_shell import Ends, Shell
from .surface_strains import Array

# --- plate and roof ------------------------------------------------------------------------------


def plate(mesh: Mesh) -> Shell:
    """A quarter of the square plate, its centre at (50, 50)."""
    splines = mesh.splines(*(breaks(0.0, 50.0, n) for n in mesh.spans))
    ends = [(("zero", "zero"), SYMMETRIC), (SYMMETRIC, ("zero", "zero")), (SYMMETRIC, SYMMETRIC)]
    return Shell(plane, splines, ends, 1e7, 0.0, 1.0, load=uniform(0.0, 0.0, -1.0))


def roof(mesh: Mesh) -> Shell:
    """A quarter of the Scordelis-Lo roof from a straight edge to the crown and from a diaphragm to mid-length."""
    one = breaks(np.radians(50.0), np.pi / 2, mesh.spans[0], (True, False), mesh.halvings)
    two = breaks(0.0, 25.0, mesh.spans[1], (True, False), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("free", "zero"), SYMMETRIC),
        (("free", "even"), SYMMETRIC),
        (("free", "even"), ("free", "zero")),
    ]
    load = uniform(0.0, -90.0, 0.0)
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


# --- semi-cylinder -------------------------------------------------------------------------------

PINCHED_RADIUS, PINCHED_LENGTH = 1.016, 3.048
LOADS = (0.1, 0.2, 0.4, 0.8, 1.0)
SUNK = tuple(float(value) for value in np.arange(1, 19) / 10)
LOAD_REACHED = 1e-7  # relative
"""Values of the deflection on the way, m."""
WIDTHS, LINE_POINTS = 9.0, 60
"""Standard deviations over which the line force is integrated, and points of Gauss's rule for it."""


def pinched_semi_cylinder(mesh: Mesh, spread: float = 0.015) -> Shell:
    """A half of the semi-cylinder, clamped at xi2 = 0, the load on the free edge about (90 degrees, 3.048)."""
    one = breaks(0.0, np.pi / 2, mesh.spans[0], (False, True), mesh.halvings)
    two = breaks(0.0, PINCHED_LENGTH, mesh.spans[1], (True, True), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("even", "zero"), ("clamped", "free")),
        (("even", "even"), ("zero", "free")),
        (("zero", "even"), ("clamped", "free")),
    ]
    x, w = np.polynomial.legendre.leggauss(LINE_POINTS)
    distance, weight = WIDTHS * spread * (1 + x) / 2, WIDTHS * spread * w / 2
    density = 2000.0 / (np.sqrt(2 * np.pi) * spread) * np.exp(-(distance**2) / (2 * spread**2))
    places = np.pi / 2 - distance / PINCHED_RADIUS
    forces = tuple((a, PINCHED_LENGTH, (0.0, 0.0, -q)) for a, q in zip(places, density * weight, strict=True))
    surface = cylinder(PINCHED_RADIUS, axis=1)
    return Shell(surface, mesh.splines(one, two), ends, 2.0685e7, 0.3, 0.03, forces=forces)


def _at_load(shell: Shell, row: Array, near: State, beyond: State, load: float) -> State:
    """Return the state between two others at which the load has a value.

    Where the load hardly rises, Newton's method under load control diverges: the displacement is controlled, and its
    value is found by the secant method.
    """
    (a, below), (b, above) = ((float(row @ state.free), state.factor - load) for state in (near, beyond))
    state = near if abs(below) < abs(above) else beyond
    while abs(state.factor - load) > LOAD_REACHED * load:
        at = b - above * (b - a) / (above - below)
        state, _ = equilibrium(shell, state, Condition(row, 0.0, at))
        (a, below), (b, above) = (b, above), (at, state.factor - load)
    return state


def _semi_cylinder(mesh: Mesh) -> dict[str, float]:
    shell = pinched_semi_cylinder(mesh)
    down = shell.row(np.pi / 2, PINCHED_LENGTH, (0.0, 0.0, -1.0))
    found: dict[str, float] = {}
    waiting = list(LOADS)
    near = state = State(np.zeros_like(down), 0.0)
    for beyond in displacement_control(shell, down, SUNK):
        while waiting and beyond.factor >= waiting[0]:
            state = _at_load(shell, down, near, beyond, waiting.pop(0))
            found[f"W_{round(100 * state.factor)}"] = float(down @ state.free)
        if not waiting:
            break
        near = beyond
    membrane, bending = shell.energies(state.free)
    energies = {"strain_energy": membrane + bending, "membrane_energy": membrane, "bending_energy": bending}
    return found | energies


# --- cylinder over diaphragms --------------------------------------------------------------------

WIDE, HALF_LENGTH, NARROW = 100.0, 100.0, 0.5
FOLDED = np.pi / 6
"""The fold does not get nearer to the sides than this, rad."""
FACTORS = (0.05, 0.075, 0.1, 0.125)
PUSHED = (3.0, 6.0, 9.6, 12.7, 15.9, 18.5, 21.0, 23.7, 27.0, 30.1)
"""Values of the deflection on the way, m: some lie closely beyond the load factors."""


def pinched_cylinder(mesh: Mesh, spread: float = NARROW) -> Shell:
    """An eighth of the cylinder over rigid diaphragms, the load at (90 degrees, 0)."""
    flat = mesh.spans[0] // 6
    folded = breaks(FOLDED, np.pi / 2, mesh.spans[0] - flat, (False, True), mesh.halvings)
    one = np.concatenate([np.linspace(0.0, FOLDED, flat, endpoint=False), folded])
    two = breaks(0.0, HALF_LENGTH, mesh.spans[1], (True, False), mesh.halvings)
    ends: list[tuple[Ends, Ends]] = [
        (("even", "zero"), ("even", "zero")),
        (("even", "even"), ("zero", "free")),
        (("zero", "even"), ("even", "zero")),
    ]

    def load(angle: Array, along: Array) -> Array:
        distance = (WIDE * (angle - np.pi / 2)) ** 2 + along**2
        density = 6000.0 / (np.pi * spread**2) * np.exp(-distance / (2 * spread**2))
        return density[:, None] * np.array([0.0, 0.0, -1.0])

    return Shell(cylinder(WIDE, axis=1), mesh.splines(one, two), ends, 30e3, 0.3, 1.0, load=load)


def _pinched_cylinder(mesh: Mesh) -> dict[str, float]:
    shell = pinched_cylinder(mesh)
    down = shell.row(np.pi / 2, 0.0, (0.0, 0.0, -1.0))
    outward = shell.row(0.0, 0.0, (1.0, 0.0, 0.0))
    found: dict[str, float] = {}
    waiting = list(FACTORS)
    for beyond in displacement_control(shell, down, PUSHED):
        if beyond.factor < waiting[0]:
            continue
        state, _ = equilibrium(shell, beyond, Condition(np.zeros_like(down), 1.0, waiting.pop(0)))
        name = f"{round(1000 * state.factor):03d}"
        found |= {f"W_{name}": float(down @ state.free), f"U_{name}": float(outward @ state.free)}
    membrane, bending = shell.energies(state.free)
    return found | {"strain_energy": membrane + bending, "membrane_energy": membrane, "bending_energy": bending}


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


def square_plate_nonlinear() -> dict[str, Estimate]:
    """Known values of the square plate."""
    return converged(_square_plate, Mesh((8, 8), 6), Mesh((6, 6), 5))


def scordelis_lo_nonlinear() -> dict[str, Estimate]:
    """Known values of the Scordelis-Lo roof."""
    return converged(_scordelis_lo, Mesh((10, 8), 6, 3), Mesh((8, 6), 5, 1))


def cylinder_pull_out() -> dict[str, Estimate]:
    """Known values of the pulled cylinder."""
    return converged(_cylinder_pull_out, Mesh((24, 20), 5, 5), Mesh((16, 14), 5, 4))


def semi_cylinder() -> dict[str, Estimate]:
    """Known values of the pinched semi-cylinder."""
    return converged(_semi_cylinder, Mesh((32, 40), 4, 2), Mesh((24, 30), 4, 2))


def pinched_cylinder_nonlinear() -> dict[str, Estimate]:
    """Known values of the cylinder over diaphragms, up to an eighth of its published load."""
    return converged(_pinched_cylinder, Mesh((60, 24), 4, 3), Mesh((50, 20), 4, 3))


def slit_annular_plate() -> dict[str, Estimate]:
    """Known values of the slit annular plate."""
    return converged(_slit_annular_plate, Mesh((96, 6), 5, 1), Mesh((64, 5), 5))
