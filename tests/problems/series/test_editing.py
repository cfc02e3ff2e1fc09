"""Edited shells: bad files, refused starts, the same answer from a start as from scratch; and faults that show."""

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import read_problem
from shellbench.errors import InputError
from shellbench.problems.series.edited import EditingCase
from shellbench.problems.shell import solution
from shellbench.problems.shell.variants.edit import between
from shellbench.solvers.fem.editing_solver import FemEditSolver
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.editing_solver import NdfEditSolver

PLATE, STRIP = "edit_plate_force", "edit_cantilever_thickness"
COARSE = FemSettings(cells=(6, 1))
APART = 1e-8  # relative: Newton's method ends far below


def departs(name=STRIP, settings=COARSE):
    """Return True if the answer from the start differs from the edited shell's own answer from scratch."""
    case = catalog.named_case(name)
    found = FemEditSolver().solve(case, settings)
    truth = FemSolver().solve(catalog.named_case(name).edited, settings)
    quantity = case.primary.name
    known = truth.case.quantity(quantity).measure(truth)
    return abs(found.value(quantity) - known) > APART * abs(known)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("material.thickness", "material.youngs_modulus", "is no part of an edit of the thickness"),
        ("to = 0.11", "to = 0.1", "the edit changes nothing"),
        ("to = 0.11", "to = -1.0", "of the edited shell"),
    ],
)
def test_a_bad_file_is_one_sentence(tmp_path, old, new, words):
    text = (catalog.data_folder("cases") / f"{STRIP}.toml").read_text()
    file = tmp_path / "mine.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=words):
        read_problem(file)


def test_shells_between_fade_loads_and_go_by_the_logarithm():
    thicker, pushed = catalog.named_case(STRIP), catalog.named_case("edit_cantilever_force")
    assert between(thicker.original, thicker.edited, 0.5).material.thickness == pytest.approx((0.1 * 0.11) ** 0.5)
    both = between(pushed.original, pushed.edited, 0.25).loads
    assert [load.vector[2] for load in both] == ["0.75*(4*t)", "0.25*(5*t)"]
    turned = catalog.named_case("edit_cantilever_pose")
    assert "0.5*(-20*t)" in between(turned.original, turned.edited, 0.5).supports[0].motion.angle


@pytest.mark.long
@pytest.mark.parametrize("name", [STRIP, "edit_cantilever_pose", "edit_cantilever_force"])
def test_a_path_from_a_start_is_that_from_rest(name):
    assert not departs(name)


@pytest.mark.long
def test_a_trained_field_is_as_right_from_a_start():
    found = NdfEditSolver().solve(catalog.named_case(PLATE), {})
    for name in ("centre_deflection", "aside_deflection"):
        known = catalog.known_values(PLATE).judge(name, found.case.theory).value
        assert abs(found.value(name) - known) <= found.uncertainty[name]
    assert found.diagnostics["steps_start"] == 1


@pytest.fixture(scope="module")
def of_another_shell():
    plate = catalog.named_case(PLATE).original
    return FemSolver().solve(plate, FemSettings(cells=(2, 2)))


def test_a_start_of_another_shell_is_refused(of_another_shell):
    lifted = catalog.named_case("edit_plate_pose").original
    with pytest.raises(InputError, match="of which 'edit_plate_pose_original' is no edit"):
        FemSolver().solve(lifted, FemSettings(cells=(2, 2)), of_another_shell)


def test_fault_a_start_of_another_shell_is_accepted(monkeypatch, of_another_shell):
    monkeypatch.setattr(solution, "why_no_edit", lambda original, edited: None)
    with pytest.raises(pytest.fail.Exception):
        test_a_start_of_another_shell_is_refused(of_another_shell)


def test_fault_an_edited_force_is_ignored(monkeypatch):
    monkeypatch.setattr(EditingCase, "edited", property(lambda self: self.original))
    found = FemEditSolver().solve(catalog.named_case(PLATE), FemSettings(cells=(2, 2)))
    known = catalog.known_values(PLATE).judge("aside_deflection", found.case.theory).value
    assert abs(found.value("aside_deflection") - known) > 1e-2 * known


@pytest.mark.long
def test_fault_a_stale_state_is_kept(monkeypatch):
    """The edited shell keeps the earlier displacement: Newton's method is left out where a path goes on."""
    usual = large_displacement.equilibrium

    def stale(problem, start, t, **how):
        kept = usual(problem, start, t, **how)
        return start if start.t == t else kept

    def with_factor(self, t, q, near):
        state = FiniteProblem.at_rest(self)
        return type(state)(t, q, self.energy.deform(q), self.angles(q, near), state.factor, residuals=(0.0,))

    monkeypatch.setattr(large_displacement, "equilibrium", stale)
    monkeypatch.setattr(FiniteProblem, "state_at", with_factor)
    assert departs()
