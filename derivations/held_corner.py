r"""A plate in constant strain, whose edges are moved, under loads that the clamped edges carry: cases/held_corner.toml.

The displacement u = G (x, y) is prescribed on three edges and the stress of it on the fourth: it is the solution, and

    N11 = E h / (1 - nu^2) (e11 + nu e22),    N22 likewise,    N12 = E h / (2 + 2 nu) 2 e12.

What holds an edge with outward normal n pulls by N n a length. Loads across the plate stand on edges that are clamped,
which give them back: nothing bends.

The second form takes no stress to be constant: it is Ritz's field of `constant_stress_by_ritz`, whose stresses are
integrated along the edges. Loads are integrated panel by panel, as the file has them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .constant_stress import OBLIQUE, POISSON, YOUNG
from .constant_stress_by_ritz import AGREED, DEGREE, Row, _edge, _Polynomials, minimum
from .estimate import Estimate
from .surface_strains import Array

SIDES, THICKNESS = (2.0, 1.0), 0.05  # m
GRADIENT = np.array([[1e-3, 3e-3], [1e-3, -2e-3]])
BREAKS = (0.0, 0.25, 1.25, 2 - 2.0**-10, 2.0), (0.0, 1 - 2.0**-11, 1.0)
HEIGHTS = (-200.0, 500.0, -200.0, -200.0 + 2e4), (300.0, -3e4)
"""Loads along z on the edges y = 0 and x = 0, N/m, and where they jump, m."""
AXIS, CENTRE = np.array([3.0, 4.0, 12.0]) / 13, np.array([0.2, 0.1, 0.3])
ROUNDING = 1e-9  # relative
MISPLACED = 1e-5
"""N and N m: coordinates of 8 that count 131072 m are rounded to 2e-10 m, where loads jump by 5e4 N/m in all."""


def _estimates(corner: Array, moment: Array, side: Array, u: Callable[[Array], Array], energy: float, share: float) -> dict[str, Estimate]:  # fmt: skip
    """Estimates of a force and a moment (3,) of the corner, a force of the side, a displacement (3,) by place, and J.

    The size of a displacement that is linear in the place is convex, so that it is largest in a corner.
    """
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * SIDES
    values = (
        ("corner_force", corner @ np.array([1.0, 2.0, 2.0]) / 3, "N"),
        ("side_force", side @ np.array([2.0, 1.0, 0.0]) / 5**0.5, "N"),
        ("corner_moment", moment @ AXIS, "N m"),
        ("far_displacement", u(np.array(SIDES)) @ OBLIQUE, "m"),
        ("largest_displacement", max(np.linalg.norm(u(p)) for p in corners), "m"),
        ("strain_energy", energy, "J"),
        ("membrane_energy", energy, "J"),
    )
    return {
        name: Estimate(float(value), share * abs(float(value)) + MISPLACED * name.startswith("corner"), unit)
        for name, value, unit in values
    }


def held_corner() -> dict[str, Estimate]:
    """Known values of cases/held_corner.toml, in closed form."""
    (length, width), stretch = SIDES, YOUNG * THICKNESS
    strain = (GRADIENT + GRADIENT.T) / 2
    forces = stretch / (1 - POISSON**2) * ((1 - POISSON) * strain + POISSON * np.trace(strain) * np.eye(2))
    # Force and first moment of the loads on the clamped edges; in the plane the edges pull at their middles.
    lifts = [np.diff(b) @ h for b, h in zip(BREAKS, HEIGHTS, strict=True)]
    firsts = [np.diff(np.square(b)) @ h / 2 for b, h in zip(BREAKS, HEIGHTS, strict=True)]
    left, below = (np.append(-side * n, 0.0) for side, n in ((width, forces[0]), (length, forces[1])))
    corner = left + below - [0.0, 0.0, sum(lifts)]
    moment = np.cross(np.array([0.0, width / 2, 0.0]) - CENTRE, left)
    moment += np.cross(np.array([length / 2, 0.0, 0.0]) - CENTRE, below)
    moment += np.array([-firsts[1], firsts[0], 0.0]) + np.cross(CENTRE, [0.0, 0.0, sum(lifts)])
    energy = length * width / 2 * float(np.sum(forces * strain))
    side = np.append(width * forces[0], 0.0)
    return _estimates(corner, moment, side, lambda p: np.append(GRADIENT @ p, 0.0), energy, ROUNDING)


def held_corner_by_ritz() -> dict[str, Estimate]:
    """Values of cases/held_corner.toml by polynomials, with the stresses of their field along the edges."""
    trial = _Polynomials(np.zeros(2), np.diag(SIDES))
    parts, _, _ = trial.parts(THICKNESS)
    pull = np.array([5e5 / 2.6 * 4e-3, 5e5 / 0.91 * (-2e-3 + 0.3 * 1e-3), 0.0])
    on_edge, shares = _edge(1, 1.0)
    load = np.einsum("p,c,pcn->n", shares * SIDES[0], pull, trial.rows(on_edge))
    rows: list[Row] = []
    for fixed, at in ((0, 0.0), (1, 0.0), (0, 1.0)):
        held = np.full((DEGREE + 1, 2), at)
        held[:, 1 - fixed] = np.linspace(0, 1, DEGREE + 1)
        for row, p in zip(trial.rows(held), held * SIDES, strict=True):
            wanted = (1e-3 * p[0] + 3e-3 * p[1], 1e-3 * p[0] - 2e-3 * p[1], 0.0)
            rows += list(zip(row, wanted, strict=True))[: 2 if at else 3]
        rows += [(trial.along(p, np.eye(2)[fixed])[2], 0.0) for p in held if not at]
    found = minimum(parts, load, rows)

    def drawn(fixed: int, at: float) -> tuple[Array, Array]:
        """Force and moment about the centre (3,) of what holds an edge in the plane."""
        points, weights = _edge(fixed, at)
        slope = np.stack([trial.rows(points, 1, 0) @ found.factors / SIDES[0], trial.rows(points, 0, 1) @ found.factors / SIDES[1]], 2)[:, :2]  # fmt: skip
        normal = np.sign(at - 0.5) * np.eye(2)[fixed]
        trace = slope[:, 0, 0] + slope[:, 1, 1]
        stress = (slope + np.swapaxes(slope, 1, 2)) / 2 * (1 - POISSON) + POISSON * trace[:, None, None] * np.eye(2)
        along = stress @ normal * (YOUNG * THICKNESS / (1 - POISSON**2) * weights * SIDES[1 - fixed])[:, None]
        force = np.concatenate([along, np.zeros((len(along), 1))], 1)
        arms = np.concatenate([points * SIDES, np.zeros((len(points), 1))], 1) - CENTRE
        return force.sum(0), np.cross(arms, force).sum(0)

    corner, moment = (a + b for a, b in zip(drawn(0, 0.0), drawn(1, 0.0), strict=True))
    loads = (  # the file's formulas
        (0, lambda x: np.where(abs(x - 0.75) < 0.5, 500.0, -200.0) + np.where(x < 2 - 2.0**-10, 0.0, 2e4)),
        (1, lambda y: np.where(y < 1 - 2.0**-11, 300.0, -3e4)),
    )
    for axis, height in loads:
        t, w = np.polynomial.legendre.leggauss(4)
        for start, end in zip(BREAKS[axis], BREAKS[axis][1:], strict=False):
            at = start + (end - start) * (t + 1) / 2
            arms = np.zeros((len(at), 3))
            arms[:, axis] = at
            push = -np.outer(height(at) * w * (end - start) / 2, [0.0, 0.0, 1.0])
            corner, moment = corner + push.sum(0), moment + np.cross(arms - CENTRE, push).sum(0)
    side, _ = drawn(0, 1.0)
    energy = found.membrane + found.bending
    return _estimates(
        corner, moment, side, lambda p: trial.rows(trial.parameters(p)[None])[0] @ found.factors, energy, AGREED
    )
