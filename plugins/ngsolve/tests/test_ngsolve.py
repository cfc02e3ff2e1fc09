"""NGSolve's shells: known values, patch tests, symmetric parts and closed shells, what they decline, and faults."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ngsolve", reason="needs NGSolve: python -m pip install ./plugins/ngsolve")

from shellbench_ngsolve import elements, solving
from shellbench_ngsolve.solvers import HHJ, TDNNS, NGSolveSettings

import shellbench
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of

REFERENCES = Path(shellbench.__file__).parents[1] / "references"
STRIP = {
    "title": "strip",
    "description": "a strip",
    "surface": {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]},
    "material": {"youngs_modulus": 1e7, "poissons_ratio": 0.0, "thickness": 0.01},
    "points": {"end": [2, 0.5]},
    "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
    "quantities": [{"name": "end", "kind": "displacement", "primary": True, "points": ["end"], "direction": [0, 0, 1]}],
    "loads": [{"kind": "edge", "on": ["xi1_max"], "vector": [3.0, 0, 0.001]}],
}


def known(name):
    values = tomllib.loads((REFERENCES / f"{name}.toml").read_text(encoding="utf-8"))["values"]
    primary = shellbench.case(name).primary.name
    return next(v["value"] for v in values if v["role"] == "judge" and v["quantity"] == primary)


def primary_of(name, solver, counts, symmetry=True, **settings):
    case = shellbench.case(name)
    case = case.without([q.name for q in case.quantities if not q.primary])
    answer = solver.solve(case, NGSolveSettings(cells=(counts,), symmetry=symmetry, **settings))
    return answer.history[-1].quantities[case.primary.name]


@pytest.mark.parametrize(
    ("name", "solver", "cells", "error"),
    [
        ("square_plate", HHJ(), 4, 1e-6),
        ("scordelis_lo", HHJ(), 8, 1e-6),
        ("hyperboloid_free_1e_2", HHJ(), 8, 3e-5),
        ("twisted_beam_thick_y", HHJ(), (24, 2), 1e-4),
        ("square_plate@naghdi", TDNNS(), 4, 1e-6),
        ("thick_plate_naghdi", TDNNS(), 8, 1e-6),
        ("hypar_clamped_1e_2@naghdi", TDNNS(), 8, 5e-3),
    ],
)
def test_known_values_are_reached(name, solver, cells, error):
    assert primary_of(name, solver, cells) == pytest.approx(known(name), rel=error)


@pytest.mark.parametrize("solver", [HHJ(), TDNNS()], ids=lambda solver: solver.name)
def test_a_distorted_mesh_stretches_evenly_and_bends_as_a_beam(solver):
    shear = solver is not None and "naghdi" in solver.capabilities.theories[0]
    case = build_case({**STRIP, "theory": solver.capabilities.theories[0]}, "strip", "a test")
    deck = Deck.of(whole_of(case), (4, 3), "tri6", 0.2)
    found, _ = solver.solve_mesh(deck, NGSolveSettings())
    x = deck.nodes[:, 0]
    np.testing.assert_allclose(found[:, 0], x * 3.0 / (1e7 * 0.01), rtol=1e-9, atol=1e-15)
    bending, shearing = 1e7 * 0.01**3 / 12, 5 / 6 * 0.5e7 * 0.01
    beam = 0.001 * (x**2 * (6 - x) / 6 / bending + (x / shearing if shear else 0))  # a cubic, within the degree
    np.testing.assert_allclose(found[:, 2], beam, atol=1e-8 * beam.max())


def test_a_part_and_the_whole_agree_and_closed_shells_are_solved():
    for name, solver, part, whole in (
        ("scordelis_lo", HHJ(), (3, 3), (6, 6)),
        ("scordelis_lo@naghdi", TDNNS(), (3, 3), (6, 6)),
        ("hyperboloid_free_1e_2", HHJ(), (4, 4), (16, 8)),
    ):
        half = primary_of(name, solver, part)
        assert primary_of(name, solver, whole, symmetry=False) == pytest.approx(half, rel=2e-3)
        assert half == pytest.approx(known(name), rel=1e-2)


def test_what_it_does_not_take_is_declined():
    for name, words in (
        ("scordelis_lo_nonlinear", "theory"),
        ("angle_frame", "folds"),
        ("bent_plate", "kinks"),
        ("lifted_plate", "moves"),
        ("scordelis_lo@naghdi", "theory"),
    ):
        assert words in (HHJ().declines(shellbench.case(name)) or ""), name
    assert "theory" in TDNNS().declines(shellbench.case("scordelis_lo"))


def test_another_engine_than_the_installed_one_is_refused():
    with pytest.raises(ValueError, match="no other can be asked for"):
        NGSolveSettings(engine="ngsolve 1.0")


@pytest.mark.parametrize(
    ("where", "name", "wrong"),
    [
        (elements.CurvedMesh, "curve", lambda curved: None),  # facets
        (solving, "held_sides", lambda deck: ({}, set(), set())),  # supports at corners only
        (elements, "load_density", lambda case, points, t: 0.9 * np.ones((len(points), 3)) * [0, -90, 0]),
    ],
    ids=["flat", "unsupported", "loads"],
)
def test_faults_show_in_the_known_value(monkeypatch, where, name, wrong):
    monkeypatch.setattr(where, name, wrong)
    try:
        found = primary_of("scordelis_lo", HHJ(), (4, 4))
    except SolveFailure:
        return
    assert abs(found / known("scordelis_lo") - 1) > 1e-3


def test_singular_equations_are_a_failure(monkeypatch):
    case = build_case({**STRIP, "theory": "kirchhoff-love-linear"}, "strip", "a test")
    deck = Deck.of(part_of(case), (2, 2), "tri6")
    monkeypatch.setattr(Deck, "held", np.zeros((len(deck.nodes), 6), dtype=bool))
    with pytest.raises(SolveFailure, match="NGSolve"):
        solving.solve(deck, 3, shear=False)
