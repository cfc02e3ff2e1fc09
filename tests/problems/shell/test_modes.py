"""Modes as a question: what a case must say, and one sentence for each slip."""

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import headline_of
from shellbench.errors import InputError
from shellbench.problems.shell.records.portrait import ShellPortrait
from shellbench.solvers.ndf.published_solver import PublishedSolver
from tests.families import altered

SLIPS = {
    "no mass": ("plate_modes", lambda d: d["material"].pop("areal_density"), "needs a mass"),
    "no load": ("plate_compression", lambda d: d.update(loads=[]), "nothing loads the shell"),
    "from zero": ("plate_modes", lambda d: d["quantities"][0].update(number=0), "greater than or equal to 1"),
    "mixed": ("plate_modes", lambda d: d["quantities"].append({"name": "w", "kind": "largest_displacement"}), "no other kind"),
    "at": ("plate_modes", lambda d: d["quantities"][0].update(at=2.0), "has a 'number', and no 'at'"),
    "path": ("plate_modes", lambda d: d.update(theory="kirchhoff-love-nonlinear"), "kirchhoff-love-linear"),
    "turns": ("plate_compression", lambda d: (d["supports"].__setitem__(0, {**d["supports"][0], "components": ["z"]}), d["supports"].__setitem__(1, {**d["supports"][1], "components": ["z"]}), d.update(remove_rigid_motions=["translation_x", "translation_y", "rotation_z"])), "turn freely"),
}  # fmt: skip


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_one_sentence(slip):
    name, change, words = SLIPS[slip]
    with pytest.raises(InputError, match=words) as raised:
        altered(catalog.named_case(name).data(), change)
    assert "\n" not in str(raised.value)


def test_the_states_of_a_case_are_the_numbers_of_its_modes():
    case = catalog.named_case("cylinder_compression")
    assert case.modal
    assert case.states == (1.0, 3.0)
    assert case.mark_words(3.0) == "mode 3"


def test_a_solver_without_modes_declines():
    assert "modes" in (PublishedSolver().declines(catalog.named_case("plate_modes")) or "")


def test_a_page_says_what_is_shown():
    units = {name: catalog.named_case(name).primary.unit for name in ("plate_modes", "plate_shear", "resultants_plate")}
    assert [headline_of("shell", unit) for unit in units.values()] == [
        "Frequencies",
        "Load factors",
        "Forces and moments",
    ]
    assert headline_of("shell", catalog.named_case("square_plate").primary.unit) == "Displacements"
    assert ShellPortrait(catalog.named_case("plate_modes")).unit_of_shape == ""
    assert ShellPortrait(catalog.named_case("resultants_plate")).unit_of_shape == "m"
