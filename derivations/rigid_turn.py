r"""A saddle turned as a rigid body about an axis through a point: closed form, and an exponential of motions.

A turn by the angle phi about the unit axis n through c moves x to c + n (n.d) + cos(phi) (d - n (n.d)) + sin(phi) n x d,
d = x - c (Rodrigues), in linear theory by phi n x d. It stores nothing.

The second form never splits d: a turn about c is exp(phi G) of a 4 x 4 matrix G on homogeneous coordinates, whose last column
is -n x c. The displacement is read from it, in linear theory from phi G. The energies are computed from positions at points
only: their interpolating polynomials give both forms of the surface before and after, and the changes of these the
energy. In linear theory the changes are the imaginary part over e of those under the displacement i e u, e = 1e-20.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from .estimate import Estimate
from .surface_strains import Array

AXIS, CENTRE = np.array([2.0, -1.0, 2.0]) / 3.0, np.array([0.3, -0.7, 1.1])
LARGE, SMALL = 120.0, 0.5  # degrees
YOUNG, POISSON, THICKNESS = 1e6, 0.3, 0.02
POINTS = (0.8, 0.3), (0.35, -0.45), (1.0, 0.1)
DIRECTION = np.array([1.0, 2.0, -2.0]) / 3.0
DIRECTIONS = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, 0.8], [0.5**0.5, -(0.5**0.5), 0.0]])
NODES = 8
COMPLEX_STEP = 1e-20
SAMPLED = 1e-14
"""Uncertainty of a sampled energy, J: rounding of the forms, squared, times E h."""


def saddle(one: Array, two: Array) -> Array:
    """Positions (..., 3) of the midsurface."""
    return np.stack([one, two, 0.4 * (one**2 - two**2) + 0.2 * one], -1)


def turn(x: Array, degrees: float) -> Array:
    """Displacements (..., 3) of positions, m, by Rodrigues' formula."""
    angle, arm = np.radians(degrees), x - CENTRE
    along = (arm @ AXIS)[..., None] * AXIS
    return (np.cos(angle) - 1) * (arm - along) + np.sin(angle) * np.cross(AXIS, arm)


def small_turn(x: Array, degrees: float) -> Array:
    """The same, linearised."""
    return np.radians(degrees) * np.cross(AXIS, x - CENTRE)


def generator() -> Array:
    """The 4 x 4 matrix of turning about the axis through the centre at unit rate."""
    g = np.zeros((4, 4))
    g[:3, :3] = np.cross(AXIS, np.eye(3)).T  # its columns are n x e_i
    g[:3, 3] = -g[:3, :3] @ CENTRE
    return g


def _measured(moved: Array) -> tuple[float, float]:
    """Displacement of the first point along the direction, and the mean along the three, m."""
    return float(moved[0] @ DIRECTION), float(np.mean(np.sum(moved * DIRECTIONS, axis=1)))


def _points() -> Array:
    one, two = np.array(POINTS).T
    return saddle(one, two)


def rigid_turn_about_point() -> dict[str, Estimate]:
    """Known values of cases/rigid_turn_about_point.toml."""
    (half, _), (whole, mean) = (_measured(turn(_points(), angle)) for angle in (LARGE / 2, LARGE))
    moved = {"turn_60": half, "turn_120": whole, "mean_turn_120": mean}
    return {name: Estimate.exact(value, "m") for name, value in moved.items()} | {
        f"strain_energy_{angle}": Estimate(0.0, 0.0, "J") for angle in (60, 120)
    }


def rigid_turn_by_edge() -> dict[str, Estimate]:
    """Known values of cases/rigid_turn_by_edge.toml."""
    one, mean = _measured(small_turn(_points(), SMALL))
    return {
        "turn": Estimate.exact(one, "m"),
        "mean_turn": Estimate.exact(mean, "m"),
        "strain_energy": Estimate(0.0, 0.0, "J"),
    }


def _differentiation(ends: tuple[float, float]) -> tuple[Array, list[Array], Array]:
    """Points, matrices of derivatives of order 0, 1, 2 there, and weights of the interpolating polynomial."""
    t, weights = np.polynomial.legendre.leggauss(NODES)
    half = (ends[1] - ends[0]) / 2
    vander = np.polynomial.legendre.legvander(t, NODES - 1)
    values = np.linalg.inv(vander)
    basis = [np.polynomial.Legendre.basis(k) for k in range(NODES)]
    matrices = [np.array([(b.deriv(o) if o else b)(t) for b in basis]).T @ values / half**o for o in range(3)]
    return ends[0] + half * (1 + t), matrices, half * weights


def _forms(x: Array, one: list[Array], two: list[Array]) -> tuple[Array, Array]:
    """Metric and curvature (n, n, 2, 2) of positions (n, n, 3) at points, complex ones included."""
    first = [np.einsum("pi,qj,ijc->pqc", one[i], two[1 - i], x) for i in (1, 0)]
    second = [[np.einsum("pi,qj,ijc->pqc", one[2 - k], two[k], x) for k in pair] for pair in ((0, 1), (1, 2))]
    normal = np.cross(*first)
    normal = normal / np.sqrt(np.sum(normal**2, axis=-1))[..., None]
    metric = np.array([[np.sum(a * b, axis=-1) for b in first] for a in first])
    curvature = np.array([[np.sum(s * normal, axis=-1) for s in row] for row in second])
    return np.moveaxis(metric, (0, 1), (-2, -1)), np.moveaxis(curvature, (0, 1), (-2, -1))


def sampled_energy(degrees: float, linear: bool) -> float:
    """Strain energy (J) of the turned saddle, from positions at points."""
    (x1, one, w1), (x2, two, w2) = (_differentiation(ends) for ends in ((0.0, 1.0), (-0.5, 0.5)))
    rest = saddle(*np.meshgrid(x1, x2, indexing="ij"))
    metric, curvature = _forms(rest, one, two)
    motion = np.radians(degrees) * generator()
    move = motion if linear else expm(motion) - np.eye(4)
    u = rest @ move[:3, :3].T + move[:3, 3]
    bent = _forms(rest + (1j * COMPLEX_STEP if linear else 1.0) * u, one, two)
    if linear:
        strain, change = bent[0].imag / (2 * COMPLEX_STEP), bent[1].imag / COMPLEX_STEP
    else:
        strain, change = (bent[0] - metric) / 2, bent[1] - curvature
    inverse = np.linalg.inv(metric)
    density = 0.0
    stiffness = YOUNG * THICKNESS / (1 - POISSON**2)
    for tensor, factor in ((strain, stiffness), (change, stiffness * THICKNESS**2 / 12)):
        mixed = inverse @ tensor
        trace = np.trace(mixed, axis1=-2, axis2=-1)
        square = np.trace(mixed @ mixed, axis1=-2, axis2=-1)
        density = density + factor * (POISSON * trace**2 + (1 - POISSON) * square) / 2
    return float(w1 @ (density * np.sqrt(np.linalg.det(metric))) @ w2)


def _moved(move: Array) -> tuple[float, float]:
    return _measured(_points() @ move[:3, :3].T + move[:3, 3])


def rigid_turn_by_exponential() -> dict[str, Estimate]:
    """Values of the large turn by the exponential."""
    half, whole = (expm(np.radians(angle) * generator()) - np.eye(4) for angle in (LARGE / 2, LARGE))
    moved = {"turn_60": _moved(half)[0], "turn_120": _moved(whole)[0], "mean_turn_120": _moved(whole)[1]}
    return {name: Estimate(value, 1e-13, "m") for name, value in moved.items()} | {
        f"strain_energy_{angle}": Estimate(sampled_energy(angle, False), SAMPLED, "J") for angle in (60, 120)
    }


def small_turn_by_generator() -> dict[str, Estimate]:
    """Values of the small turn by the generator."""
    one, mean = _moved(np.radians(SMALL) * generator())
    return {
        "turn": Estimate(one, 1e-15, "m"),
        "mean_turn": Estimate(mean, 1e-15, "m"),
        "strain_energy": Estimate(sampled_energy(SMALL, True), SAMPLED, "J"),
    }
