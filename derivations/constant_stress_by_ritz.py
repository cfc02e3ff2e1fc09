"""The plates and the sleeve of `constant_stress` by Ritz's method, which takes no stress to be constant.

1. Trial functions are polynomials, on the sleeve times harmonics of the angle, for each component of the displacement.
2. Strains are products of vectors, eps_ab = (x,a . u,b + x,b . u,a) / 2 and kappa_ab = -u,ab . a3: in the parameters used
   here the second derivatives of the surface have no part in it. Gauss's rule integrates the energy.
3. Loads are those of the case files, integrated along edges. Supports are held at as many points as there are trial
   functions along an edge, by multipliers, which are the forces of the supports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from . import constant_stress as closed
from .estimate import Estimate
from .surface_strains import Array

DEGREE, HARMONICS, GAUSS, ANGLES = 4, 2, 8, 16
AGREED = 1e-8  # relative uncertainty: rounding of the equations

Row = tuple[Array, float]
"""A condition row . q = value on the trial functions' factors."""


@dataclass(frozen=True)
class Minimum:
    """Factors (n,) of the trial functions, forces of the conditions, and the membrane and bending energy, J."""

    factors: Array
    forces: Array
    membrane: float
    bending: float


def minimum(parts: Sequence[tuple[Array, Array]], load: Array, rows: Sequence[Row]) -> Minimum:
    """Minimise the energy less the work under conditions.

    Parameters
    ----------
    parts : for membrane and bending each the mixed tensors (p, 2, 2, n) of the trial functions, and stiffness times
        weights (p,)
    load : (n,) work of the loads
    rows : conditions
    """
    matrices = []
    for tensor, weights in parts:
        trace = np.trace(tensor, axis1=1, axis2=2)
        square = np.einsum("p,pabi,pbaj->ij", weights, tensor, tensor)
        matrices.append(
            closed.POISSON * np.einsum("p,pi,pj->ij", weights, trace, trace) + (1 - closed.POISSON) * square
        )
    stiffness, held = sum(matrices), np.array([row for row, _ in rows])
    scale = np.abs(stiffness).max()  # of the conditions, so that multipliers are of the size of factors
    zero = np.zeros((len(rows), len(rows)))
    system = np.block([[stiffness / scale, held.T], [held, zero]])
    right = np.concatenate([load / scale, [value for _, value in rows]])
    found = np.linalg.lstsq(system, right, rcond=1e-14)[0]
    q = found[: len(load)]
    membrane, bending = (float(q @ matrix @ q) / 2 for matrix in matrices)
    return Minimum(q, -found[len(load) :] * scale, membrane, bending)


def _strains(x: Array, normal: Array, first: Array, second: Array, scales: tuple[Array, Array]) -> list[tuple[Array, Array]]:  # fmt: skip
    """Return the parts of `minimum` of vectors x,a (p, 2, 3), u,a (p, 2, 3, n) and u,ab (p, 2, 2, 3, n)."""
    inverse = np.linalg.inv(np.einsum("pac,pbc->pab", x, x))
    strain = np.einsum("pac,pbcn->pabn", x, first)
    strain = (strain + np.swapaxes(strain, 1, 2)) / 2
    change = -np.einsum("pc,pabcn->pabn", normal, second)
    mixed = [np.einsum("pab,pbcn->pacn", inverse, tensor) for tensor in (strain, change)]
    return list(zip(mixed, scales, strict=True))


# --- plates ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Polynomials:
    """Polynomials of two parameters from 0 to 1 on a parallelogram, for each of three components."""

    corner: Array
    edges: Array

    def rows(self, points: Array, one: int = 0, two: int = 0) -> Array:
        """Values or derivatives (p, 3, n) in the parameters."""
        basis = [Legendre.basis(k, [0, 1]) for k in range(DEGREE + 1)]
        values = [
            np.stack([(b.deriv(order) if order else b)(points[:, axis]) for b in basis], -1)
            for axis, order in ((0, one), (1, two))
        ]
        table = np.einsum("pi,pj->pij", *values).reshape(len(points), -1)
        return np.einsum("pk,cd->pcdk", table, np.eye(3)).reshape(len(points), 3, -1)

    def along(self, point: Array, direction: Array) -> Array:
        """Derivative (3, n) at a point in a direction (2,), by length."""
        share = np.linalg.solve(self.edges.T, direction)
        return share[0] * self.rows(point[None], 1, 0)[0] + share[1] * self.rows(point[None], 0, 1)[0]

    def parameters(self, position: Array) -> Array:
        """Parameters (2,) of a position."""
        return np.linalg.solve(self.edges.T, position - self.corner)

    def parts(self, thickness: float) -> tuple[list[tuple[Array, Array]], Array, Array]:
        """Strains, and the points and weights by area of their rule."""
        t, w = np.polynomial.legendre.leggauss(GAUSS)
        points = np.stack(np.meshgrid((t + 1) / 2, (t + 1) / 2, indexing="ij"), -1).reshape(-1, 2)
        weights = np.outer(w, w).ravel() / 4 * abs(np.linalg.det(self.edges))
        x = np.broadcast_to(np.concatenate([self.edges, np.zeros((2, 1))], 1), (len(points), 2, 3))
        first = np.stack([self.rows(points, 1, 0), self.rows(points, 0, 1)], 1)
        mixed = self.rows(points, 1, 1)
        second = np.stack([np.stack([self.rows(points, 2, 0), mixed], 1), np.stack([mixed, self.rows(points, 0, 2)], 1)], 1)  # fmt: skip
        stretch = closed.YOUNG * thickness / (1 - closed.POISSON**2)
        normal = np.broadcast_to([0.0, 0.0, 1.0], (len(points), 3))
        return _strains(x, normal, first, second, (stretch * weights, stretch * thickness**2 / 12 * weights)), points, weights  # fmt: skip


def _edge(fixed: int, at: float) -> tuple[Array, Array]:
    """Points (p, 2) of an edge where one parameter is fixed, and weights by the other."""
    t, w = np.polynomial.legendre.leggauss(GAUSS)
    points = np.full((GAUSS, 2), at)
    points[:, 1 - fixed] = (t + 1) / 2
    return points, w / 2


def parallelogram_by_ritz() -> dict[str, Estimate]:
    """Values of cases/twisted_parallelogram.toml."""
    plate = closed.parallelogram()
    trial = _Polynomials(plate.corner, plate.edges)
    parts, points, weights = trial.parts(plate.thickness)
    # The loads as the file has them.
    right, up = np.array([25000.0, -15000.0, 0.0]) / np.sqrt(1.25), np.array([-10000.0, 10000.0, 0.0])
    load = plate.force * trial.rows(np.ones((1, 2)))[0, 2]
    for fixed, at, force in ((0, 1.0, right), (0, 0.0, -right), (1, 1.0, up), (1, 0.0, -up)):
        on_edge, shares = _edge(fixed, at)
        shares = shares * np.linalg.norm(plate.edges[1 - fixed])
        load = load + np.einsum("p,c,pcn->n", shares, force, trial.rows(on_edge))
    held = np.stack([np.zeros(DEGREE + 1), np.linspace(0, 1, DEGREE + 1)], -1)
    places = plate.corner + held @ plate.edges
    rise = places[:, 1] - 1 / 3
    rows: list[Row] = list(zip(trial.rows(held)[:, 2], 0.02 - 0.075 * rise - 0.09 * rise**2, strict=True))
    rows.append((trial.rows(np.array([[1.0, 0.0]]))[0, 2], PROP))
    rows += [(row, 0.0) for row in trial.rows(np.full((1, 2), 0.5))[0, :2]]
    arms = (points - 0.5) @ plate.edges
    u = trial.rows(points)
    rows.append((np.einsum("p,pn->n", weights, arms[:, :1] * u[:, 1] - arms[:, 1:] * u[:, 0]), 0.0))
    found = minimum(parts, load, rows)
    forces = found.forces[: DEGREE + 1]
    levers = np.concatenate([places, np.zeros((len(places), 1))], 1) - closed.HINGE_CENTRE
    couple = np.cross(levers, forces[:, None] * [0.0, 0.0, 1.0]).sum(0)
    values = closed.measured(lambda p: trial.rows(trial.parameters(p)[None])[0] @ found.factors, plate)
    return {name: _agreed(value, "m") for name, value in values.items()} | _energies(found) | {
        "prop_force": _agreed(found.forces[DEGREE + 1], "N"),
        "hinge_moment": _agreed(couple @ closed.HINGE_AXIS, "N m"),
    }  # fmt: skip


PROP = -0.17936089286871
"""Prescribed displacement of the corner, m, as the file has it."""


def swatch_by_ritz() -> dict[str, Estimate]:
    """Values of cases/swatch.toml."""
    trial = _Polynomials(np.zeros(2), closed.SIDE * np.eye(2))
    parts, points, weights = trial.parts(closed.SWATCH_THICKNESS)
    load = closed.CORNER_FORCE * trial.rows(np.ones((1, 2)))[0, 2]
    for fixed in (0, 1):
        for at, sense in ((1.0, 1.0), (0.0, -1.0)):
            on_edge, shares = _edge(fixed, at)
            force = sense * closed.SIDE * np.append(closed.SWATCH_FORCES[fixed], 0.0)
            load = load + np.einsum("p,c,pcn->n", shares, force, trial.rows(on_edge))
    corners = trial.rows(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))[:, 2]
    rows: list[Row] = [(row, 0.0) for row in (*corners, *trial.rows(np.full((1, 2), 0.5))[0, :2])]
    arms, u = closed.SIDE * (points - 0.5), trial.rows(points)
    rows.append((np.einsum("p,pn->n", weights, arms[:, :1] * u[:, 1] - arms[:, 1:] * u[:, 0]), 0.0))
    found = minimum(parts, load, rows)
    values = closed.measured_swatch(lambda p: trial.rows(trial.parameters(p)[None])[0] @ found.factors)
    return {name: _agreed(value, "m") for name, value in values.items()} | _energies(found)


def bent_plate_by_ritz() -> dict[str, Estimate]:
    """Values of cases/bent_plate.toml."""
    plate = closed.BentPlate()
    width = plate.sides[1] - plate.sides[0]
    trial = _Polynomials(np.array([0.0, plate.sides[0]]), np.diag([plate.length, width]))
    parts, points, weights = trial.parts(plate.thickness)
    load = np.zeros(trial.rows(points[:1]).shape[-1])
    # A moment about -y turns the normal toward -x, one about x toward -y: their works are on w,x and on w,y.
    for fixed, at, moment in ((0, 1.0, 12.0), (1, 1.0, -5.0), (1, 0.0, 5.0)):
        on_edge, shares = _edge(fixed, at)
        direction = np.eye(2)[fixed]
        for point, share in zip(on_edge, shares * trial.edges[1 - fixed, 1 - fixed], strict=True):
            load += share * moment * trial.along(point, direction)[2]
    held = np.stack([np.zeros(DEGREE + 1), np.linspace(0, 1, DEGREE + 1)], -1)
    rows: list[Row] = [(trial.along(point, np.array([1.0, 0.0]))[2], 0.0) for point in held]
    rows += [(row, 0.0) for row in trial.rows(held)[:, 0]]
    u, arms = trial.rows(points), (points[:, 1] - 0.5) * width
    rows += [(weights @ u[:, 1], 0.0), (weights @ u[:, 2], 0.0), ((weights * arms) @ u[:, 2], 0.0)]
    found = minimum(parts, load, rows)
    values = closed.measured_deflection(
        lambda p: float(trial.rows(trial.parameters(p)[None])[0, 2] @ found.factors), plate
    )
    energies = _energies(found)
    del energies["membrane_energy"]
    energies["potential_energy"] = _agreed(found.membrane + found.bending - float(load @ found.factors), "J")
    return {name: _agreed(value, "m") for name, value in values.items()} | energies | {
        "mirror_moment": _agreed(-found.forces[: DEGREE + 1].sum(), "N m")
    }  # fmt: skip


# --- the sleeve --------------------------------------------------------------------------------------


def _sleeve_rows(sleeve: closed.Sleeve, points: Array, order: int = 0) -> Array:
    """Parts along e_r, e_t, e_y (p, 3, n) of the trial functions, or their derivative along the axis."""
    basis = [Legendre.basis(k, list(sleeve.ends)) for k in range(DEGREE + 1)]
    along = np.stack([(b.deriv(order) if order else b)(points[:, 1]) for b in basis], -1)
    turns = [np.cos(k * points[:, 0]) for k in range(HARMONICS + 1)]
    turns += [np.sin(k * points[:, 0]) for k in range(1, HARMONICS + 1)]
    table = np.einsum("pi,pj->pij", np.stack(turns, -1), along).reshape(len(points), -1)
    return np.einsum("pk,cd->pcdk", table, np.eye(3)).reshape(len(points), 3, -1)


def _around(sleeve: closed.Sleeve, rows: Array) -> Array:
    """Differentiate parts (p, 3, n) of the trial functions by the angle, at equal angles: their frame turns as well."""
    by_angle = rows.reshape(ANGLES, -1, *rows.shape[1:])
    waves = np.fft.fftfreq(ANGLES, 1 / ANGLES)
    slope = np.fft.ifft(1j * waves[:, None, None, None] * np.fft.fft(by_angle, axis=0), axis=0).real.reshape(rows.shape)
    turned = np.stack([-rows[:, 1], rows[:, 0], np.zeros_like(rows[:, 0])], 1)  # e_r' = e_t, e_t' = -e_r
    return slope + turned


def sleeve_by_ritz() -> dict[str, Estimate]:
    """Values of cases/sheared_sleeve.toml."""
    sleeve = closed.Sleeve()
    radius, length = sleeve.radius, sleeve.ends[1] - sleeve.ends[0]
    angles = 2 * np.pi * np.arange(ANGLES) / ANGLES
    t, w = np.polynomial.legendre.leggauss(GAUSS)
    grid = np.meshgrid(angles, sleeve.ends[0] + length * (t + 1) / 2, indexing="ij")
    points = np.stack(grid, -1).reshape(-1, 2)
    weights = np.tile(w / 2 * length, ANGLES) * 2 * np.pi / ANGLES * radius
    # 1. Vectors by their parts along e_r, e_t, e_y.
    u, along, twice = (_sleeve_rows(sleeve, points, order) for order in range(3))
    around = _around(sleeve, u)
    mixed = _around(sleeve, along)
    first = np.stack([around, along], 1)
    second = np.stack([np.stack([_around(sleeve, around), mixed], 1), np.stack([mixed, twice], 1)], 1)
    x = np.broadcast_to([[0.0, radius, 0.0], [0.0, 0.0, 1.0]], (len(points), 2, 3))
    normal = np.broadcast_to([-1.0, 0.0, 0.0], (len(points), 3))
    parts = _strains(x, normal, first, second, (sleeve.membrane_stiffness * weights, sleeve.bending_stiffness * weights))  # fmt: skip
    # 2. Pressure outward, and shear forces at the rims.
    load = sleeve.pressure * weights @ u[:, 0]
    rows: list[Row] = []
    for end, sense in zip(sleeve.ends, (-1.0, 1.0), strict=True):
        rim = np.stack([angles, np.full(ANGLES, end)], -1)
        load += sense * sleeve.shear * 2 * np.pi * radius / ANGLES * _sleeve_rows(sleeve, rim)[:, 1].sum(0)
        rows += [(row, 0.0) for row in _sleeve_rows(sleeve, rim[: 2 * HARMONICS + 1], 1)[:, 0]]
    # 3. Rigid motions that nothing holds.
    cos, sin = np.cos(points[:, 0]), np.sin(points[:, 0])
    rows += [(weights @ mode, 0.0) for mode in (u[:, 2], u[:, 1], cos[:, None] * u[:, 0] - sin[:, None] * u[:, 1])]
    rows.append((weights @ (sin[:, None] * u[:, 0] + cos[:, None] * u[:, 1]), 0.0))
    found = minimum(parts, load, rows)
    values = closed.measured_sleeve(
        lambda angle, y: _sleeve_rows(sleeve, np.array([[angle, y]]))[0] @ found.factors, sleeve
    )
    return {name: _agreed(value, "m") for name, value in values.items()} | _energies(found)


def _energies(found: Minimum) -> dict[str, Estimate]:
    return {
        "strain_energy": _agreed(found.membrane + found.bending, "J"),
        "membrane_energy": _agreed(found.membrane, "J"),
        "bending_energy": _agreed(found.bending, "J"),
    }


def _agreed(value: float, unit: str) -> Estimate:
    return Estimate(float(value), AGREED * abs(float(value)), unit)
