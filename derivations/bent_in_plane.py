r"""A plate whose stress in its plane is linear, held along two edges that meet: cases/bent_in_plane.toml.

Membrane forces of a cubic Airy function are in equilibrium without loads on the area, and compatible:

    N11 = p y + s x,    N22 = q x + r y,    N12 = -(r x + s y).

The strains E h e11 = N11 - nu N22, E h e22 = N22 - nu N11, E h g12 = 2 (1 + nu) N12 integrate to

    E h u = p x y + s x^2 / 2 - nu (q x^2 / 2 + r x y) - (q + (2 + nu) s) y^2 / 2
    E h v = q x y + r y^2 / 2 - nu (p y^2 / 2 + s x y) - (p + (2 + nu) r) x^2 / 2,

which the supports prescribe where x = 0 and where y = 0. What holds an edge with outward normal n pulls by N n a length: its
force and its moment are integrals of linear functions and of their products with y.

The second form is Ritz's field of `constant_stress_by_ritz` under the loads and the motion that the case file has; it takes no
stress to be linear. Its stresses are integrated along the edges.
"""

from __future__ import annotations

import numpy as np

from .constant_stress import OBLIQUE, POISSON, YOUNG
from .constant_stress_by_ritz import AGREED, DEGREE, Row, _edge, _Polynomials, minimum
from .estimate import Estimate
from .surface_strains import Array

SIDES, THICKNESS = (1.6, 1.0), 0.05  # m
P, Q, R, S = 600.0, 300.0, 400.0, -200.0  # N/m^2
CENTRE = np.array([0.5, -0.25])
BRIM, INSIDE = np.array([0.7, 1.0]), np.array([0.9, 0.4])
ROUNDING = 1e-12  # relative
STRETCHING = YOUNG * THICKNESS


def forces(place: Array) -> Array:
    """Membrane forces (2, 2), N/m, at a place (2,)."""
    x, y = place
    shear = -(R * x + S * y)
    return np.array([[P * y + S * x, shear], [shear, Q * x + R * y]])


def displacement(place: Array) -> Array:
    """Displacement (3,), m, at a place (2,)."""
    x, y = place
    u = P * x * y + S * x**2 / 2 - POISSON * (Q * x**2 / 2 + R * x * y) - (Q + (2 + POISSON) * S) * y**2 / 2
    v = Q * x * y + R * y**2 / 2 - POISSON * (P * y**2 / 2 + S * x * y) - (P + (2 + POISSON) * R) * x**2 / 2
    return np.array([u, v, 0.0]) / STRETCHING


def _estimates(left: Array, below: Array, moment: float, stretch: float, u: Array, largest: float, energy: float, share: float) -> dict[str, Estimate]:  # fmt: skip
    """Estimates of what holds the left edge and the one below, (2,), and of the rest that is asked."""
    values = (
        ("left_force", left @ np.array([3.0, 4.0]) / 5, "N"),
        ("bottom_force", below @ np.array([1.0, -2.0]) / 5**0.5, "N"),
        ("left_moment", moment, "N m"),
        ("brim_stretch", stretch, "N/m"),
        ("inside_displacement", u @ OBLIQUE, "m"),
        ("largest_displacement", largest, "m"),
        ("strain_energy", energy, "J"),
    )
    return {name: Estimate(float(value), share * abs(float(value)), unit) for name, value, unit in values}


def _grid() -> Array:
    """Places (n, 2), corners included, among which the displacement is largest in a corner."""
    return np.stack(np.meshgrid(*(np.linspace(0, side, 41) for side in SIDES), indexing="ij"), -1).reshape(-1, 2)


def bent_in_plane() -> dict[str, Estimate]:
    """Known values of cases/bent_in_plane.toml, in closed form."""
    a, b = SIDES
    left = np.array([-P, S]) * b**2 / 2
    below = np.array([R, -Q]) * a**2 / 2
    # The left edge's forces go as y, so that they act at two thirds of it.
    arm = np.array([0.0, 2 * b / 3]) - CENTRE
    # Energies of quadratic densities: Gauss's rule of two points is exact.
    t, w = np.polynomial.legendre.leggauss(2)
    energy = 0.0
    for one, first in zip(a * (t + 1) / 2, w * a / 2, strict=True):
        for two, second in zip(b * (t + 1) / 2, w * b / 2, strict=True):
            n = forces(np.array([one, two]))
            squares = n[0, 0] ** 2 + n[1, 1] ** 2 - 2 * POISSON * n[0, 0] * n[1, 1] + 2 * (1 + POISSON) * n[0, 1] ** 2
            energy += float(first * second * squares) / (2 * STRETCHING)
    largest = max(float(np.linalg.norm(displacement(p))) for p in _grid())
    stretch = forces(BRIM)[0, 0]
    moment = float(arm[0] * left[1] - arm[1] * left[0])
    return _estimates(left, below, moment, stretch, displacement(INSIDE), largest, energy, ROUNDING)


def bent_in_plane_by_ritz() -> dict[str, Estimate]:
    """Values of cases/bent_in_plane.toml by polynomials, with the stresses of their field along the edges."""
    trial = _Polynomials(np.zeros(2), np.diag(SIDES))
    parts, _, _ = trial.parts(THICKNESS)
    # The file's loads and motions.
    on_right, shares = _edge(0, 1.0)
    y = on_right[:, 1] * SIDES[1]
    pull = np.stack([600 * y - 200 * 1.6, -400 * 1.6 + 200 * y, 0 * y], -1)
    load = np.einsum("p,pc,pcn->n", shares * SIDES[1], pull, trial.rows(on_right))
    on_top, shares = _edge(1, 1.0)
    x = on_top[:, 0] * SIDES[0]
    pull = np.stack([-400 * x + 200, 300 * x + 400, 0 * x], -1)
    load += np.einsum("p,pc,pcn->n", shares * SIDES[0], pull, trial.rows(on_top))
    motions = ((1.6e-4, 2.2e-4), (-2.9e-4, -1.52e-3))
    rows: list[Row] = []
    for fixed, factors in enumerate(motions):
        held = np.zeros((DEGREE + 1, 2))
        held[:, 1 - fixed] = np.linspace(0, 1, DEGREE + 1)
        for row, p in zip(trial.rows(held), held * SIDES, strict=True):
            along = p[1 - fixed] ** 2
            rows += list(zip(row, (factors[0] * along, factors[1] * along, 0.0), strict=True))
    found = minimum(parts, load, rows)

    def stresses(points: Array) -> Array:
        """Membrane forces (p, 2, 2)."""
        slope = np.stack([trial.rows(points, 1, 0) @ found.factors / SIDES[0], trial.rows(points, 0, 1) @ found.factors / SIDES[1]], 2)[:, :2]  # fmt: skip
        trace = slope[:, 0, 0] + slope[:, 1, 1]
        strain = (slope + np.swapaxes(slope, 1, 2)) / 2 * (1 - POISSON) + POISSON * trace[:, None, None] * np.eye(2)
        return np.asarray(strain * STRETCHING / (1 - POISSON**2))

    def drawn(fixed: int) -> tuple[Array, float]:
        """Force (2,) and moment of what holds a lower edge."""
        points, weights = _edge(fixed, 0.0)
        pulls = -stresses(points)[:, fixed] * (weights * SIDES[1 - fixed])[:, None]
        arms = points * SIDES - CENTRE
        return pulls.sum(0), float(np.sum(arms[:, 0] * pulls[:, 1] - arms[:, 1] * pulls[:, 0]))

    (left, moment), (below, _) = drawn(0), drawn(1)
    places = np.vstack([INSIDE, _grid()]) / SIDES
    moved = trial.rows(places) @ found.factors
    return _estimates(
        left,
        below,
        moment,
        float(stresses((BRIM / SIDES)[None])[0, 0, 0]),
        moved[0],
        float(np.linalg.norm(moved[1:], axis=1).max()),
        found.membrane + found.bending,
        AGREED,
    )
