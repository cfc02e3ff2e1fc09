"""Shell elements of OpenSees: what they decline, patch tests, the roof beside a deck written by hand, and limits."""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("openseespy", reason="needs OpenSees: python -m pip install ./plugins/opensees")

from shellbench_opensees import program
from shellbench_opensees.solvers import AsdShellQ4, AsdShellT3, Dkgq, Dkgt, Mitc4

import shellbench
from derivations import levy_roof
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.symmetry.symmetry import whole_of

ALL = (AsdShellQ4, AsdShellT3, Dkgq, Dkgt, Mitc4)
DECKS = Path(__file__).parents[1] / "decks"
MODULUS, THICKNESS, LOAD = 2e6, 0.1, 3.0


def by_hand(name):
    spec = importlib.util.spec_from_file_location(name, DECKS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def flat(theory, **changes):
    data = {
        "title": "flat",
        "theory": theory,
        "surface": {"kind": "plane", "xi1": [0, 3], "xi2": [0, 2]},
        "material": {"youngs_modulus": MODULUS, "poissons_ratio": 0.3, "thickness": THICKNESS},
        "quantities": [{"name": "largest", "kind": "largest_displacement", "primary": True}],
    }
    return build_case(data | changes, "flat", "flat")


def rolled(theory):
    """A strip that is clamped at one end and bent by a moment at the other, without Poisson's effect."""
    case = flat(
        theory,
        supports=[{"name": "wall", "on": ["xi1_min"], "clamped": True}],
        loads=[{"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": LOAD}],
        material={"youngs_modulus": MODULUS, "poissons_ratio": 0.0, "thickness": THICKNESS},
    )
    curvature = LOAD / (MODULUS * THICKNESS**3 / 12)
    return case, lambda x: curvature / 2 * x[:, :1] ** 2 * [0, 0, 1]


def solved(kind, case, counts, **settings):
    case = displaced(case)
    return kind().solve(case, kind.settings_type(cells=(counts,), **settings))


def displaced(case):
    return case.without([q.name for q in case.quantities if Dkgq().declines_quantity(case, q)])


@pytest.mark.parametrize("kind", ALL)
def test_a_patch_whose_rim_is_stretched_and_sheared_is_in_constant_strain(kind):
    case = flat("kirchhoff-love-linear", supports=[{"name": "s", "on": ["xi1_min"], "clamped": True}])
    mesh = Deck.of(whole_of(case), (4, 3), kind.shape, 0.2)
    exact = np.zeros((len(mesh.nodes), 6))
    exact[:, :3] = mesh.nodes @ [[1e-3, 2e-4, 0], [2e-4, -5e-4, 0], [0, 0, 0]]
    rim = (mesh.nodes[:, :2] == [0, 0]) | (mesh.nodes[:, :2] == [3, 2])
    held = np.repeat(rim.any(axis=-1)[:, None], 6, axis=-1)
    names = ("nodes", "cells", "thickness", "youngs_modulus", "poissons_ratio")
    patch = SimpleNamespace(**{n: getattr(mesh, n) for n in names}, held=held, prescribed=exact, forces=0 * exact)
    assert 0 < np.count_nonzero(~held[:, 0]) < len(held)
    np.testing.assert_allclose(program.displacements(patch, kind.entry, ()), exact[:, :3], atol=1e-12)


@pytest.mark.parametrize("kind", ALL)
def test_a_moment_rolls_a_distorted_mesh_into_a_cylinder(kind):
    case, exact = rolled(kind.capabilities.theories[0])
    answer = solved(kind, case, (4, 3), symmetry=False, distortion=0.2)
    expected = exact(answer.deck.nodes)
    np.testing.assert_allclose(answer.moved, expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ALL)
def test_the_roof_is_that_of_a_deck_by_hand_with_other_loads(kind):
    theory = "" if kind in (Dkgq, Dkgt) else "@naghdi_soft"
    case = shellbench.case("scordelis_lo" + theory)
    values = [solved(kind, case, (n, n), symmetry=False).history[0].quantities["edge_deflection"] for n in (8, 16)]
    hand = [by_hand("deck").deflection("roof", kind.entry, n) for n in (8, 16)]
    apart = np.abs(np.subtract(values, hand))
    assert np.all(apart < [2e-3, 5e-4])  # beside a distance of .01 between the coarse values
    half = solved(kind, case, (8, 8), symmetry=True).history[0].quantities["edge_deflection"]
    if kind.shape == "quad4":  # triangles' diagonals have no mirror
        assert half == pytest.approx(values[1], rel=1e-8)


@pytest.mark.parametrize(("kind", "case"), [(Dkgq, "hemisphere_hole"), (Dkgt, "square_plate"), (Dkgq, "square_plate")])
def test_thin_elements_tend_to_the_known_value(kind, case):
    case = displaced(shellbench.case(case))
    answer = kind().solve(case, kind.settings_type(cells=(4, 8, 16)))
    known = {"hemisphere_hole": 0.09352155074, "square_plate": 0.487482319281}
    value = answer.history[-1].quantities[case.primary.name]
    assert value == pytest.approx(known[case.name], rel=2e-3)
    assert abs(value - known[case.name]) <= 1.5 * answer.uncertainty[case.primary.name]


@pytest.mark.long
def test_flat_elements_tend_to_a_roof_whose_curvature_lacks_the_stretch_over_the_radius(monkeypatch):
    def strains(radius, alpha):
        found = whole(radius, alpha)
        found[:, 4] -= found[:, 1] / radius  # kappa_11 and eps_11
        return found

    whole = levy_roof.strains_of_axial_harmonic
    monkeypatch.setattr(levy_roof, "strains_of_axial_harmonic", strains)
    limit = levy_roof.solve_roof(levy_roof.roof(), 59, 24).deflection(25.0, levy_roof.HALF_ANGLE)
    case = displaced(shellbench.case("scordelis_lo"))
    answer = Dkgq().solve(case, {"cells": ((12, 12), (24, 24), (48, 48))})
    assert answer.extrapolated["edge_deflection"] == pytest.approx(limit, rel=3e-5)  # Kirchhoff and Love: 1.9e-4 more


def test_warped_cells_resist_rigid_rotations_in_elements_that_are_flat():
    script = by_hand("rigid_motions")
    for kind, forced in (("ASDShellQ4", False), ("ShellMITC4", True), ("ShellDKGQ", True)):
        assert script.resistance(kind, script.FLAT)[0] < 1e-12
        assert (script.resistance(kind, script.WARPED)[0] > 1e-3) == forced


def test_what_it_cannot_do_is_declined():
    assert "theory" in Mitc4().declines(shellbench.case("scordelis_lo"))
    for name, why in (("angle_frame", "folds"), ("cantilever_shear", "theory"), ("contact_plate", "obstacles")):
        assert why in Dkgq().declines(shellbench.case(name))
    with pytest.raises(ValueError, match=r"openseespy 3.*no other can be asked for"):
        program.OpenSeesSettings(engine="openseespy 0.1")


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr("shellbench.protocol.engine.engine_version", lambda name: None)
    monkeypatch.delitem(sys.modules, "shellbench_opensees.program")
    with pytest.raises(InputError, match="openseespy is not installed: python -m pip install"):
        importlib.import_module("shellbench_opensees.program")


def test_a_singular_model_is_a_failure(monkeypatch):
    case, _ = rolled("naghdi-linear")
    monkeypatch.setattr("shellbench.problems.shell.deck.deck.Deck.held", np.zeros((6, 6), bool))
    with pytest.raises(SolveFailure, match="OpenSees"):
        solved(AsdShellQ4, case, (2, 1), symmetry=False)


def test_a_fault_in_the_section_fails_the_patch_test(monkeypatch):
    built = program._build
    monkeypatch.setattr(program, "_build", lambda ops, deck, *rest: built(_FaultyOps(ops), deck, *rest))
    case, exact = rolled("kirchhoff-love-linear")
    answer = solved(Dkgq, case, (4, 3), symmetry=False)
    assert np.abs(answer.moved - exact(answer.deck.nodes)).max() > 1e-3 * np.abs(answer.moved).max()


class _FaultyOps:
    """OpenSees, but for a section that is a thousandth too thick."""

    def __init__(self, ops):
        self._ops = ops

    def __getattr__(self, name):
        return getattr(self._ops, name)

    def section(self, kind, tag, modulus, poisson, thickness, density):
        self._ops.section(kind, tag, modulus, poisson, 1.001 * thickness, density)
