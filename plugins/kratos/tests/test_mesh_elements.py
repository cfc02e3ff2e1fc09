"""Kratos' elements of linear statics on ladders of meshes: declines, patches, and the roof beside a deck by hand."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.engine import kratos
from shellbench_kratos.mesh_elements import Dkq, Dkt, Thick3, Thick4
from shellbench_kratos.thin_elements import Elements
from shellbench_kratos.thin_solver import KratosThinSolver

import shellbench
from shellbench.bench.plugins import registry
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.symmetry.symmetry import whole_of

assert kratos  # imported without its banner before decks import it
ALL = (Dkq, Dkt, Thick4, Thick3)
DECKS = Path(__file__).parents[1] / "decks"
MODULUS, THICKNESS, LOAD = 2e6, 0.1, 3.0
COROTATED = 2e-5  # Kratos' corotational triangle at rest: forces of a rigid motion are 7.5e-7 of its stiffness


def by_hand(name):
    spec = importlib.util.spec_from_file_location(name, DECKS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def flat(theory, poissons_ratio=0.3, **changes):
    data = {
        "title": "flat",
        "theory": theory,
        "surface": {"kind": "plane", "xi1": [0, 3], "xi2": [0, 2]},
        "material": {"youngs_modulus": MODULUS, "poissons_ratio": poissons_ratio, "thickness": THICKNESS},
        "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
        "quantities": [{"name": "largest", "kind": "largest_displacement", "primary": True}],
    }
    return build_case(data | changes, "flat", "flat")


def displaced(case):
    return case.without([q.name for q in case.quantities if Dkq().declines_quantity(case, q)])


def solved(kind, case, *counts, **settings):
    case = displaced(case)
    return kind().solve(case, kind.settings_type(cells=counts, **settings))


@pytest.mark.parametrize("kind", ALL)
def test_it_is_found_like_any_solver(kind):
    assert isinstance(registry.load_solver(registry.find_solver(kind.name)), kind)


def off_constant_strain(kind, distortion):
    """Return the largest error of a patch whose rim is stretched and sheared, relative to the largest displacement."""
    mesh = Deck.of(whole_of(flat(kind.capabilities.theories[0])), (4, 3), kind.shape, distortion)
    exact = np.zeros((len(mesh.nodes), 6))
    exact[:, :3] = mesh.nodes @ [[1e-3, 2e-4, 0], [2e-4, -5e-4, 0], [0, 0, 0]]
    rim = ((mesh.nodes[:, :2] == [0, 0]) | (mesh.nodes[:, :2] == [3, 2])).any(axis=-1)
    held = np.repeat(rim[:, None], 6, axis=-1)
    patch = SimpleNamespace(
        part=mesh.part, nodes=mesh.nodes, cells=mesh.cells, held=held, prescribed=exact, forces=0 * exact
    )
    assert 0 < np.count_nonzero(~rim) < len(rim)
    return np.abs(kind().solve_mesh(patch, None) - exact[:, :3]).max() / np.abs(exact).max()


@pytest.mark.parametrize(("kind", "rounding"), [(Dkt, 1e-9), (Thick4, 1e-9), (Thick3, COROTATED)])
def test_a_distorted_patch_is_in_constant_strain(kind, rounding):
    assert off_constant_strain(kind, 0.2) < rounding


def test_the_thin_quadrilateral_is_so_on_parallelograms_alone_as_a_deck_by_hand_finds_too():
    assert off_constant_strain(Dkq, 0.0) < 1e-9
    assert off_constant_strain(Dkq, 0.2) > 1e-2
    deck = by_hand("patch")
    errors = {shape: deck.error(Dkq.entry, shape) for shape in deck.PLACES}
    assert max(errors["squares"], errors["parallelograms"]) < 1e-5
    assert errors["trapezoids"] > 1e-4
    assert max(deck.error(kind.entry, "trapezoids") for kind in (Dkt, Thick4)) < 1e-9


MOMENT = [{"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": LOAD}]


def rolled(kind, **settings):
    """Return the distance of a strip that a moment rolls from a cylinder, over its largest displacement."""
    answer = solved(kind, flat(kind.capabilities.theories[0], 0.0, loads=MOMENT), (4, 3), symmetry=False, **settings)
    curvature = LOAD / (MODULUS * THICKNESS**3 / 12)
    exact = curvature / 2 * answer.deck.nodes[:, :1] ** 2 * [0, 0, 1]
    return np.abs(answer.moved - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize("kind", ALL)
def test_a_moment_rolls_a_distorted_mesh_into_a_cylinder(kind):
    assert rolled(kind, distortion=0.2) < (COROTATED if kind is Thick3 else 1e-8)


def test_a_fault_in_the_section_fails_the_patch_test(monkeypatch):
    of = Elements.__init__

    def thicker(self, positions, cells, material, *names):
        of(self, positions, cells, material.model_copy(update={"thickness": 1.001 * material.thickness}), *names)

    monkeypatch.setattr(Elements, "__init__", thicker)
    assert rolled(Dkq) > 1e-3


@pytest.mark.parametrize("kind", [Dkq, Dkt, Thick4])
def test_the_roof_is_that_of_a_deck_by_hand(kind):
    case = shellbench.case("scordelis_lo" + ("" if kind in (Dkq, Dkt) else "@naghdi_soft"))
    history = solved(kind, case, (8, 8), (16, 16), symmetry=False).history
    hand = [by_hand("deck").deflection(kind.entry, n) for n in (8, 16)]
    np.testing.assert_allclose([step.quantities["edge_deflection"] for step in history], hand, rtol=1e-9)
    if kind.shape == "quad4":  # triangles' diagonals have no mirror
        half = solved(kind, case, (8, 8)).history[0].quantities["edge_deflection"]
        assert half == pytest.approx(hand[1], rel=1e-8)


def test_discrete_shear_gaps_depend_on_which_corner_is_first_and_others_do_not():
    deck = by_hand("deck")
    value = solved(Thick3, shellbench.case("scordelis_lo@naghdi_soft"), (8, 8), symmetry=False)
    by_corner = [deck.deflection(Thick3.entry, 8, first) for first in range(3)]
    assert min(by_corner) - 1e-9 < value.history[0].quantities["edge_deflection"] < max(by_corner) + 1e-9
    assert max(by_corner) / min(by_corner) > 1.05
    assert np.ptp([deck.deflection(Dkt.entry, 8, first) for first in range(3)]) < 1e-9


def test_kratos_own_example_of_all_four_elements_has_its_reference():
    example = by_hand("own_example")
    assert example.deflection() == pytest.approx(example.REFERENCE, rel=1e-8)  # places there have ten digits


def test_the_corotational_solver_on_the_same_mesh_has_the_same_value():
    case = displaced(shellbench.case("scordelis_lo"))
    other = KratosThinSolver().solve(case, {"cells": (8, 8)})
    value = solved(Dkq, case, (8, 8)).history[0].quantities["edge_deflection"]
    assert other.history[-1].quantities["edge_deflection"] == pytest.approx(value, rel=1e-8)


@pytest.mark.parametrize("kind", [Dkq, Dkt])
def test_thin_elements_tend_to_the_plate_of_navier(kind):
    answer = solved(kind, shellbench.case("square_plate"), 4, 8, 16)
    assert answer.history[-1].quantities[answer.case.primary.name] == pytest.approx(0.487482319281, rel=2e-3)


def test_what_it_cannot_do_is_declined():
    assert "theory" in Thick4().declines(shellbench.case("scordelis_lo"))
    for name, why in (("angle_frame", "folds"), ("cantilever_shear", "theory"), ("contact_plate", "obstacles")):
        assert why in Dkq().declines(shellbench.case(name))
    case = shellbench.case("scordelis_lo")
    assert any("displacements of nodes only" in (Dkt().declines_quantity(case, q) or "") for q in case.quantities)


def test_a_singular_model_is_a_failure(monkeypatch):
    monkeypatch.setattr("shellbench.problems.shell.deck.deck.Deck.held", np.zeros((6, 6), bool))
    with pytest.raises(SolveFailure, match="singular"):
        solved(Thick4, flat("naghdi-linear", loads=MOMENT), (2, 1), symmetry=False)
