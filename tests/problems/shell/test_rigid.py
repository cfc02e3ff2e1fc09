"""Rigid motions and what holds a shell against them."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.posed.rigid import RIGID_MOTIONS, free_motions, rigid_modes


def plate(supports, removed=()):
    return {
        "title": "plate", "theory": "kirchhoff-love-linear", "surface": {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]},
        "material": {"youngs_modulus": 1.0, "poissons_ratio": 0.3, "thickness": 0.1}, "points": {"p": [1, 0.5], "q": [2, 0.5]},
        "supports": supports, "remove_rigid_motions": list(removed),
        "quantities": [{"name": "w", "kind": "largest_displacement", "primary": True}],
    }  # fmt: skip


@pytest.mark.parametrize("name", ["pinched_cylinder_free", "scordelis_lo"])
def test_modes_move_points_without_changing_distances(name):
    surface = catalog.named_case(name).surface
    xi = np.asarray(surface.domain.lower) + np.random.default_rng(1).uniform(0, 1, (6, 2)) * np.asarray(
        surface.domain.size
    )
    modes, x = rigid_modes(surface, xi)[0, 0], surface.position(xi)
    assert np.linalg.matrix_rank(modes.reshape(-1, 6)) == 6
    for p in range(6):
        for q in range(p):
            assert np.allclose((x[p] - x[q]) @ (modes[p] - modes[q]), 0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("square_plate", 0), ("scordelis_lo", 1), ("pinched_cylinder_diaphragm", 1), ("pinched_cylinder_free", 6), ("sleeve_torque", 0)],
)  # fmt: skip
def test_the_suite_knows_its_free_motions(name, expected):
    assert free_motions(catalog.named_case(name)).shape == (6, expected)


def test_a_clamped_edge_holds_everything_and_a_hinge_leaves_its_rotation():
    clamped = [{"name": "wall", "on": ["xi1_min"], "clamped": True}]
    assert free_motions(build_case(plate(clamped), "p", "p")).shape == (6, 0)
    hinge = [{"name": "wall", "on": ["xi1_min"]}]
    with pytest.raises(InputError, match="singular"):
        build_case(plate(hinge), "p", "p")
    case = build_case(plate(hinge, ["rotation_y", "translation_z"]), "p", "p")
    (motion,) = free_motions(case).T
    moved = dict(zip(RIGID_MOTIONS, motion, strict=True))
    assert abs(moved["rotation_y"]) > 0.1
    at_the_hinge = rigid_modes(case.surface, np.array([[0.0, 0.3]]))[0, 0] @ motion
    assert np.allclose(at_the_hinge, 0, atol=1e-12)


def test_three_points_hold_a_plate():
    supports = [
        {"name": "a", "on": ["xi1_min,xi2_min"]},
        {"name": "b", "on": ["xi1_max,xi2_min"], "components": ["y", "z"]},
        {"name": "c", "on": ["xi1_min,xi2_max"], "components": ["z"]},
    ]
    assert free_motions(build_case(plate(supports), "p", "p")).shape == (6, 0)
    with pytest.raises(InputError, match="singular"):
        build_case(plate(supports[:2]), "p", "p")


def test_a_plane_of_symmetry_holds_its_normal_and_two_rotations():
    supports = [{"name": "mirror", "on": ["xi1_min"], "symmetry": "x"}]
    removed = ["translation_y", "translation_z", "rotation_x"]
    assert free_motions(build_case(plate(supports, removed), "p", "p")).shape == (6, 3)


def test_what_is_prescribed_everywhere_leaves_nothing_free():
    for name in ("rolled_plate", "rigid_rotation"):
        assert free_motions(catalog.named_case(name)).shape == (6, 0)
    mould = [{"name": "mould", "on": ["surface"], "motion": {"kind": "translation", "vector": ["t", 0, 0]}}]
    assert free_motions(build_case(plate(mould), "p", "p")).shape == (6, 0)
    with pytest.raises(InputError, match="already hold"):
        build_case(plate(mould, ["translation_x"]), "p", "p")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("square_plate_nonlinear", 0), ("scordelis_lo_nonlinear", 1), ("cantilever_shear", 0), ("cantilever_moment", 0),
        ("slit_annular_plate", 0), ("cylinder_pull_out", 0), ("hinged_roof_thick", 0), ("hinged_roof_thin", 0),
        ("semi_cylinder", 0), ("pinched_cylinder_nonlinear", 0),
    ],
)  # fmt: skip
def test_of_the_non_linear_suite_the_roof_on_diaphragms_alone_can_slide(name, expected):
    free = free_motions(catalog.named_case(name))
    assert free.shape == (6, expected)
    if expected:
        assert np.allclose(np.abs(free[:, 0]), [0, 0, 1, 0, 0, 0], atol=1e-12)
