"""Strains by differences, against deformations whose strains are known in closed form."""

import numpy as np
import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.testing.examination import scattered
from shellbench.testing.mechanics import differences, energy_densities, strains


def strained(case, field, step=1e-3):
    points = scattered(case, 10, margin=0.05)
    return strains(case, points, differences(field, points, step * np.asarray(case.surface.domain.size)))


def test_a_plate_rolled_into_an_arc_has_its_curvature_and_no_stretch():
    case, radius = named_case("rolled_plate"), 2.0

    def rolled(xi):
        s = xi[:, 0] / radius
        return np.stack([radius * np.sin(s) - xi[:, 0], np.zeros(len(xi)), radius * (1 - np.cos(s))], axis=-1)

    membrane, bending = strained(case, rolled)
    assert membrane == pytest.approx(np.zeros((10, 3)), abs=1e-6)
    assert bending[:, 0] == pytest.approx(-1 / radius, rel=1e-5)  # kappa = bbar - b, and b_11 = 1/R toward the normal
    assert bending[:, 1:] == pytest.approx(np.zeros((10, 2)), abs=1e-6)


def test_a_widened_cylinder_in_linear_theory():
    case = named_case("scordelis_lo")  # R = 25, xi1 the angle
    w = 0.01

    def widened(xi):
        return w * np.stack([np.cos(xi[:, 0]), np.sin(xi[:, 0]), np.zeros(len(xi))], axis=-1)

    membrane, bending = strained(case, widened)
    # eps_11 = R w; b_11 = -R + w for the outward normal and linear kappa_11 = -(u,11 - Gamma u) . n = w
    assert membrane[:, 0] == pytest.approx(25 * w, rel=1e-5)
    assert np.abs(bending[:, 0]) == pytest.approx(w, rel=1e-4)
    assert membrane[:, 1:] == pytest.approx(np.zeros((10, 2)), abs=1e-8)


def test_an_infinitesimal_turn_strains_nothing_in_linear_theory():
    case, axis = named_case("scordelis_lo"), np.array([0.1, 0.2, -0.3])
    membrane, bending = strained(case, lambda xi: np.cross(axis, case.surface.position(xi)))
    assert np.abs(membrane).max() < 1e-4
    assert np.abs(bending).max() < 1e-4


def test_energy_densities_are_those_of_plane_stress():
    case = named_case("hinged_roof_thin")  # nu = 0.3, a cylinder of radius 2540 about y
    points = scattered(case, 3)
    e, radius = np.array([1e-3, 2e-3, 5e-4]), case.surface.radius
    physical = np.array([radius**2, 1.0, radius])
    membrane, bending = energy_densities(case, points, np.tile(e * physical, (3, 1)), np.tile(e * physical, (3, 1)))
    nu = case.material.poissons_ratio
    quadratic = e[0] ** 2 + e[1] ** 2 + 2 * nu * e[0] * e[1] + 2 * (1 - nu) * e[2] ** 2
    assert membrane == pytest.approx(case.material.membrane_stiffness / 2 * quadratic)
    assert bending == pytest.approx(case.material.bending_stiffness / 2 * quadratic)
