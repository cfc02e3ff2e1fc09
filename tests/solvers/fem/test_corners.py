"""Exponents of corners against published ones and closed forms, and meshes that are graded by them."""

import numpy as np
import pytest
from scipy.optimize import brentq

from shellbench.bench.catalogue import catalog
from shellbench.solvers.fem.mechanics.corners import (
    SMOOTH,
    Rim,
    Singularities,
    bending_exponent,
    corner_exponents,
    membrane_exponent,
)
from shellbench.solvers.fem.mesh.convergence import ASYMPTOTIC
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.solvers.fem.shells import shell

FREE, FIXED = Rim(), Rim(held=(2, 0.0))
ALONG, ACROSS = Rim(held=(1, 0.0)), Rim(held=(1, np.pi / 2))
NU = 0.3


@pytest.mark.parametrize("degrees", [100, 120, 135, 150, 170])
def test_a_simply_supported_corner_has_the_exponent_of_two_poisson_problems(degrees):
    # w = r^(pi / angle) sin: s + 1 = pi / angle, whatever Poisson's ratio
    angle = np.radians(degrees)
    for nu in (0.0, 0.3, 0.49):
        assert bending_exponent(angle, "supported", "supported", nu) == pytest.approx(np.pi / angle - 1, abs=1e-6)


@pytest.mark.parametrize(
    ("degrees", "published"),
    # Williams (1952); e.g. Grisvard (1992), Leguillon & Sanchez-Palencia (1987): notches with free faces in extension
    [(270, 0.5445), (240, 0.6157), (225, 0.6736), (210, 0.7520)],
)
def test_notches_have_published_exponents(degrees, published):
    angle = np.radians(degrees)
    assert membrane_exponent(angle, FREE, FREE, NU) == pytest.approx(published, abs=6e-5)
    # the static-geometric analogy: Airy's function of free faces is the deflection of a clamped plate
    assert bending_exponent(angle, "clamped", "clamped", NU) == pytest.approx(published, abs=6e-5)


def test_cracks_have_the_square_root():
    for kind in ("clamped", "free"):
        assert bending_exponent(2 * np.pi, kind, kind, NU) == pytest.approx(0.5, abs=1e-6)
    assert membrane_exponent(2 * np.pi, FREE, FREE, NU) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("nu", [0.1, 0.2, 0.3, 0.45])
def test_clamped_and_free_edges_meet_as_williams_says(nu):
    # Williams (1952) in extension, plane stress: sin^2(s a) = (4 - (1 + nu)^2 s^2 sin^2 a) / ((3 - nu) (1 + nu))
    angle = np.pi / 2

    def equation(s: float) -> float:
        right = (4 - (1 + nu) ** 2 * s**2 * np.sin(angle) ** 2) / ((3 - nu) * (1 + nu))
        return float(np.sin(s * angle) ** 2 - right)

    expected = brentq(equation, 0.3, 0.999)
    assert membrane_exponent(angle, FIXED, FREE, nu) == pytest.approx(expected, abs=1e-7)


def test_a_quarter_is_half_of_its_mirror_image():
    # a symmetric or antisymmetric field of the doubled corner is one of the half
    angle = np.radians(75.0)
    halves = [bending_exponent(angle, kind, "free", NU) for kind in ("mirrored", "supported")]
    assert min(halves) == pytest.approx(bending_exponent(2 * angle, "free", "free", NU), abs=1e-6)
    halves = [membrane_exponent(angle, rim, FREE, NU) for rim in (ALONG, ACROSS)]
    assert min(halves) == pytest.approx(membrane_exponent(2 * angle, FREE, FREE, NU), abs=1e-6)


@pytest.mark.parametrize("kinds", [("supported", "supported"), ("clamped", "clamped"), ("supported", "free")])
def test_right_angles_of_common_plates_are_smooth(kinds):
    assert bending_exponent(np.pi / 2, *kinds, NU) == SMOOTH


@pytest.mark.parametrize(
    ("name", "exponent"), [("rhombic_plate_30", np.pi / np.radians(150) - 1), ("rhombic_plate_60", 0.5)]
)
def test_obtuse_corners_of_a_rhombus_are_found(name, exponent):
    found = corner_exponents(catalog.named_case(name))
    assert set(found) == {("min", "max"), ("max", "min")}
    assert list(found.values()) == pytest.approx([exponent, exponent], abs=1e-6)


def test_the_course_is_graded_toward_no_edge():
    for name in ("square_plate", "scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free"):
        case = catalog.named_case(name)
        found = Singularities.of_case(case)
        assert found.edge_gradings == ((1.0, 1.0), (1.0, 1.0))
        assert found.slowest_rate == ASYMPTOTIC


def test_edges_beside_a_clamp_are_graded():
    case = shell("hypar", supports=[{"name": "wall", "on": ["xi1_min"], "clamped": True}],
                 loads=[{"kind": "area", "vector": [0, 0, 1]}])  # fmt: skip
    (near, far), sides = Singularities.of_case(case).edge_gradings
    assert near > 1
    assert far == 1.0  # free corners are not singular
    assert min(sides) == 1.0  # nor is the acute one beside the clamp
    assert max(sides) > 1


@pytest.mark.long
def test_a_graded_mesh_restores_the_rate_that_a_corner_takes():
    # the rhombus of 60 degrees under its load: 2 s = 1 on uniform meshes, 2 s g = 4 on graded ones
    case = catalog.named_case("rhombic_plate_60")
    energies = {
        grading: [FemSolver().solve(case, FemSettings(cells=(n, n), grading=grading)).history[0].energy for n in (4, 8)]
        for grading in (1.0, 2.0)
    }
    finest = FemSolver().solve(case, FemSettings(cells=(16, 16))).history[0].energy
    uniform, graded = (np.log2((coarse - finest) / (fine - finest)) for coarse, fine in energies.values())
    assert uniform == pytest.approx(1.0, abs=0.35)
    assert graded > 3.0
