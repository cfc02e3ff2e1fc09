"""Shell elements of CalculiX: what they decline, patch tests, the roof beside a deck written by hand, and limits."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

if shutil.which("ccx") is None:
    pytest.skip("needs CalculiX: its package calculix-ccx", allow_module_level=True)

from shellbench_calculix import input_deck, program
from shellbench_calculix.solvers import S3, S4, S4R, S6, S8, S8R

import shellbench
from derivations import naghdi_slices
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.symmetry.symmetry import whole_of

ALL, CURVED = (S3, S4, S6, S8, S8R), (S6, S8, S8R)
MODULUS, THICKNESS, LOAD = 2e6, 0.1, 3.0


def by_hand(shell, element, n):
    path = Path(__file__).parents[1] / "decks" / "deck.py"
    spec = importlib.util.spec_from_file_location("deck", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.deflection(shell, element, n)


def flat(**changes):
    data = {
        "title": "flat",
        "theory": "naghdi-linear",
        "surface": {"kind": "plane", "xi1": [0, 3], "xi2": [0, 2]},
        "material": {"youngs_modulus": MODULUS, "poissons_ratio": 0.3, "thickness": THICKNESS},
        "quantities": [{"name": "largest", "kind": "largest_displacement", "primary": True}],
    }
    return build_case(data | changes, "flat", "flat")


def stretched():
    """A sheet that is pulled along x and free to contract, and its exact displacement."""
    supports = [{"name": f"s{c}", "on": [f"xi{k}_min"], "components": [c]} for k, c in ((1, "x"), (2, "y"))]
    case = flat(
        supports=supports,
        remove_rigid_motions=["translation_z", "rotation_x", "rotation_y"],
        loads=[{"kind": "edge", "on": ["xi1_max"], "vector": [LOAD, 0, 0]}],
    )
    return case, lambda x: LOAD / (MODULUS * THICKNESS) * x * [1, -0.3, 0]


def rolled(**changes):
    """A strip that is clamped at one end and bent by a moment at the other, without Poisson's effect."""
    data = {
        "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
        "loads": [{"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": LOAD}],
        "material": {"youngs_modulus": MODULUS, "poissons_ratio": 0.0, "thickness": THICKNESS},
    }
    curvature = LOAD / (MODULUS * THICKNESS**3 / 12)
    return flat(**data | changes), lambda x: curvature / 2 * x[:, :1] ** 2 * [0, 0, 1]


def displaced(case):
    return case.without([q.name for q in case.quantities if S8R().declines_quantity(case, q)])


def solved(kind, case, *counts, **settings):
    return kind().solve(displaced(case), kind.settings_type(cells=counts, **settings))


@pytest.mark.parametrize(("kind", "distortion"), [(S3, 0.2), (S4, 0.0), (S6, 0.2), (S8, 0.2), (S8R, 0.2)])
def test_constant_strain_is_exact(kind, distortion):
    case, exact = stretched()
    answer = solved(kind, case, (4, 3), distortion=distortion)
    expected = exact(answer.deck.nodes)
    np.testing.assert_allclose(answer.moved, expected, atol=3e-6 * np.abs(expected).max())


def test_s4_fails_the_patch_test_as_calculix_issue_88_says():
    case, exact = stretched()
    errors = []
    for n in (1, 4):
        answer = solved(S4, case, (4 * n, 3 * n), distortion=0.2)
        errors.append(np.abs(answer.moved - exact(answer.deck.nodes)).max() / np.abs(answer.moved).max())
    assert min(errors) > 1e-3  # smaller cells don't help


@pytest.mark.parametrize("kind", CURVED)
def test_constant_curvature_is_exact_in_quadratic_elements(kind):
    case, exact = rolled()
    answer = solved(kind, case, (4, 3))
    expected = exact(answer.deck.nodes)
    np.testing.assert_allclose(answer.moved, expected, atol=3e-6 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ALL)
def test_the_roof_is_that_of_a_deck_by_hand_with_other_loads(kind):
    case = shellbench.case("scordelis_lo@naghdi_soft")
    for n, apart in ((8, 5e-3), (16, 2e-3)):
        points = np.array([case.places[f"{side}_edge"].xi for side in ("right", "left")])
        edges = -solved(kind, case, (n, n)).displacement(points)[:, 1]
        hand = by_hand("roof", kind.entry, n)
        assert min(np.abs(edges / hand - 1)) < apart  # triangles' diagonals make the edges differ


def test_on_a_soft_support_s8r_has_the_limit_of_shear_factor_one(monkeypatch):
    plate = solved(S8R, shellbench.case("square_plate@naghdi_soft"), (16, 16)).history[-1].quantities
    values = {}
    for factor in (5 / 6, 1.0):
        monkeypatch.setattr(naghdi_slices, "FACTOR", factor)
        values[factor] = naghdi_slices.plate_values(100, 1, 1e7, 0, 1, True, *naghdi_slices.LEVELS[1])
    assert plate["centre_deflection"] == pytest.approx(values[1.0]["centre_deflection"], rel=5e-5)
    assert plate["centre_deflection"] < (1 - 1e-3) * values[5 / 6]["centre_deflection"]


def test_a_plane_of_symmetry_is_right_along_the_axes_and_refused_elsewhere():
    case, exact = rolled()
    answer = solved(S8R, case, (4, 2), symmetry=True)
    assert answer.deck.part.mirrors
    expected = exact(answer.deck.nodes)
    np.testing.assert_allclose(answer.moved, expected, atol=3e-6 * np.abs(expected).max())
    with pytest.raises(SolveFailure, match="along no axis"):
        solved(S8R, shellbench.case("scordelis_lo@naghdi_soft"), (4, 4), symmetry=True)


def test_numbers_are_no_longer_than_the_program_reads():
    deck = Deck.of(whole_of(shellbench.case("hyperboloid_free_1e_2@naghdi")), (24, 8), "quad8")
    text = input_deck.input_deck(deck, "S8R", normals=True)
    numbers = [word for line in text.splitlines() if not line.startswith("*") for word in line.split(",")]
    assert max(map(len, numbers)) <= 20
    assert np.abs(program.displacements(text, len(deck.nodes))).max() == pytest.approx(2.1e-6, rel=0.2)


def test_what_it_cannot_do_is_declined():
    roof = shellbench.case("scordelis_lo@naghdi_soft")
    assert S8R().declines(roof) is None
    assert "not stiff enough in bending" in S4R().declines(roof)
    assert "theory" in S8R().declines(shellbench.case("scordelis_lo"))
    with pytest.raises(ValueError, match=r"CalculiX-.*no other can be asked for"):
        program.CalculixSettings(engine="CalculiX-1.0-00000000")


def test_a_missing_program_is_named(monkeypatch):
    monkeypatch.setenv(program.VARIABLE, "no-such-program")
    program.program.cache_clear()
    with pytest.raises(InputError, match="install its package calculix-ccx"):
        program.program()
    program.program.cache_clear()


def test_faults_are_seen(monkeypatch):
    case, exact = rolled()
    monkeypatch.setattr(input_deck, "held_rotations", lambda mask, normal: [])  # the clamp lets go
    try:
        answer = solved(S8R, case, (4, 3))
    except SolveFailure:
        return
    assert np.abs(answer.moved - exact(answer.deck.nodes)).max() > 0.01 * np.abs(answer.moved).max()


def test_the_program_s_own_error_is_told():
    with pytest.raises(SolveFailure, match=r"CalculiX stopped: ERROR"):
        program.displacements("*NODE\n1,0,0,0\n*NONSENSE\n*STEP\n*STATIC\n*CLOAD\n9,1,1.\n*END STEP\n", 1)
