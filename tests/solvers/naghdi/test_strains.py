"""Strains of Naghdi's theory: rigid motions strain nothing, and measures of moved positions have them as slopes."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import Case, build_case
from shellbench.solvers.naghdi.strains import Frame

STEP = 0.1  # of displacements: the measures are quadratic in them, so that central differences are exact
DOME = {
    "title": "dome", "theory": "naghdi-linear",
    "surface": {"kind": "expression", "xi1": [0, 1], "xi2": [0, 1], "x": "xi1 + 0.2*xi2", "y": "xi2", "z": "0.3*xi1**2*xi2 + 0.2*xi2**2"},
    "material": {"youngs_modulus": 3.0, "poissons_ratio": 0.3, "thickness": 0.2},
    "supports": [{"name": "rim", "on": ["xi1_min"], "clamped": True}], "loads": [{"kind": "area", "vector": [0, 0, -1]}],
    "quantities": [{"name": "energy", "kind": "strain_energy", "primary": True}, {"name": "largest_displacement", "kind": "largest_displacement"}],
}  # fmt: skip
POINTS = np.array([[0.3, 0.4], [0.7, 0.2], [0.9, 0.8]])


def dome(clamped: bool = True) -> Case:
    rim = {"name": "rim", "on": ["xi1_min"], "clamped": clamped}
    return build_case({**DOME, "supports": [rim]}, "dome", "test")


def normal(case, xi):
    x = case.surface.derivatives(xi, order=1)
    cross = np.cross(x[1, 0], x[0, 1])
    return cross / np.linalg.norm(cross, axis=-1)[..., None]


def tangents(case, xi):
    first = case.surface.derivatives(xi, order=1)[1, 0]
    first = first / np.linalg.norm(first, axis=-1)[..., None]
    return first, np.cross(normal(case, xi), first)


def jets(fields, xi, step=1e-5):
    """Fields and slopes (N, 15) of a function of points, by central differences."""
    parts = [fields(xi)]
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        parts.append((fields(xi + shift) - fields(xi - shift)) / (2 * step))
    return np.concatenate(parts, axis=1)


def waves(case):
    """Five smooth fields."""
    rates, phases = np.array([[1.3, 0.4], [0.7, 1.9], [1.1, 0.9], [0.5, 1.4], [1.7, 0.3]]), np.arange(5)
    return lambda xi: np.sin(xi @ rates.T + phases)


@pytest.mark.parametrize("name", ["dome", "scordelis_lo_naghdi", "thick_plate_naghdi"])
def test_rigid_motions_strain_nothing(name):
    case = dome() if name == "dome" else catalog.named_case(name)
    domain = case.surface.domain
    xi = np.asarray(domain.lower) + POINTS * np.asarray(domain.size)
    turn = np.array([[0, -0.3, 0.5], [0.3, 0, -0.7], [-0.5, 0.7, 0]])

    def moved(points):
        u = case.surface.position(points) @ turn.T + [1.0, 2.0, 3.0]
        d = normal(case, points) @ turn.T
        return np.concatenate([u, *(np.sum(d * t, axis=-1)[:, None] for t in tangents(case, points))], axis=1)

    frame = Frame.at(case, xi)
    strain = np.einsum("nsz,nz->ns", frame.operator(), jets(moved, xi, 1e-5 * min(domain.size)))
    assert np.abs(strain).max() < 1e-7 * np.abs(frame.base).max() ** 2


def test_strains_are_slopes_of_the_measures_of_moved_positions():
    """a_a . a_b / 2, a_a . d,b and a_a . d of the moved surface and its moved normal, by differences."""
    case, at = dome(), waves(dome())

    def measures(size, xi):
        def position(p):
            return case.surface.position(p) + size * at(p)[:, :3]

        def director(p):
            first, second = tangents(case, p)
            return normal(case, p) + size * (at(p)[:, 3:4] * first + at(p)[:, 4:] * second)

        h = 1e-4
        shift = h * np.eye(2)
        a = [(position(xi + s) - position(xi - s)) / (2 * h) for s in shift]
        d = [(director(xi + s) - director(xi - s)) / (2 * h) for s in shift]

        def dot(p, q):
            return np.sum(p * q, axis=-1)

        return np.stack(
            [
                dot(a[0], a[0]) / 2, dot(a[1], a[1]) / 2, dot(a[0], a[1]),
                dot(a[0], d[0]), dot(a[1], d[1]), dot(a[0], d[1]) + dot(a[1], d[0]),
                dot(a[0], director(xi)), dot(a[1], director(xi)),
            ],
            axis=1,
        )  # fmt: skip

    slopes = (measures(STEP, POINTS) - measures(-STEP, POINTS)) / (2 * STEP)
    strain = np.einsum("nsz,nz->ns", Frame.at(case, POINTS).operator(), jets(at, POINTS))
    np.testing.assert_allclose(strain, slopes, atol=3e-7)


def test_normals_that_stay_normal_have_kirchhoffs_strains():
    """On a cylinder: chi_t = -(w_tt - 2 v_t - w) / R^2 and 2 chi_xt = -2 (w_xt - v_x) / R, and no shear."""
    case = catalog.named_case("scordelis_lo_naghdi")
    radius, xi = case.surface.radius, np.array([[1.1, 10.0], [1.9, 31.0]])
    t, x = xi.T
    e_r = np.stack([np.cos(t), np.sin(t), 0 * t], -1)
    assert np.allclose(np.abs(np.sum(normal(case, xi) * e_r, -1)), 1)
    sign = float(np.sum(normal(case, xi) * e_r, -1)[0])

    def fields(points):
        t, x = points.T
        v, w = np.sin(2 * t) * np.cos(x / 9), np.cos(3 * t) * np.sin(x / 7)
        w_t, w_x = -3 * np.sin(3 * t) * np.sin(x / 7), np.cos(3 * t) * np.cos(x / 7) / 7
        r = np.stack([np.cos(t), np.sin(t), 0 * t], -1)
        along = np.stack([-np.sin(t), np.cos(t), 0 * t], -1)
        u = v[:, None] * along + w[:, None] * r
        d = sign * (((v - w_t) / radius)[:, None] * along - w_x[:, None] * np.array([0, 0, 1.0]))
        return np.concatenate([u, *(np.sum(d * f, -1)[:, None] for f in tangents(case, points))], axis=1)

    strain = np.einsum("nsz,nz->ns", Frame.at(case, xi).operator(), jets(fields, xi))
    w, w_tt = np.cos(3 * t) * np.sin(x / 7), -9 * np.cos(3 * t) * np.sin(x / 7)
    v_t, v_x = 2 * np.cos(2 * t) * np.cos(x / 9), -np.sin(2 * t) * np.sin(x / 9) / 9
    w_xt = -3 * np.sin(3 * t) * np.cos(x / 7) / 7
    assert np.abs(strain[:, 6:]).max() < 1e-8
    np.testing.assert_allclose(strain[:, 3], -sign * (w_tt - 2 * v_t - w), atol=1e-7)
    np.testing.assert_allclose(strain[:, 5], -sign * 2 * (w_xt - v_x), atol=1e-7)
