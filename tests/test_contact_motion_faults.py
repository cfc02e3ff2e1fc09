"""Contact in motion by fem: faults of its mechanics turn the gate red; energy only leaves."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench import catalog
from shellbench.errors import SolveFailure
from shellbench.problems import obstacle
from shellbench.problems.shell.measure import measure_all
from shellbench.solvers.fem import contact_in_motion
from shellbench.solvers.fem.contact_in_motion import StepContact
from shellbench.solvers.fem.solver import FemSettings, FemSolver

FALLS, SLIDES = "contact_patch_falls", "contact_patch_slides"
STEP = 0.02
LATE = {"slide_200ms", "slide_600ms", "slide_900ms", "kinetic_energy_900ms"}  # need a finer step


def solved(name, step=STEP):
    """Solve a case on one coarse mesh by long steps."""
    with np.errstate(all="ignore"):  # what is broken may overflow
        return FemSolver().solve(catalog.named_case(name), FemSettings(cells=(1, 1), time_step=step))


def worst(solution):
    """Return the largest error in units of what is allowed."""
    name, values, found = solution.case.name, measure_all(solution), []
    for quantity, allowed in catalog.tolerances()["fem"][name].items():
        known = catalog.known_values(name).judge(quantity, "kirchhoff-love-nonlinear").value
        if quantity not in LATE:
            found.append(abs(values[quantity] - known) / (allowed.absolute or allowed.relative * abs(known)))
    return np.max(found)  # NaN where one is


def pushed_in(patch):
    """A penalty of the wrong sign."""
    patch.setattr(contact_in_motion, "STIFFNESS", -contact_in_motion.STIFFNESS)


def turned_normal(patch):
    """A normal of the wrong side."""
    asked = contact_in_motion.nearest_obstacle

    def turned(*a):
        gap, normal, nearest = asked(*a)
        return gap, -normal, nearest

    patch.setattr(contact_in_motion, "nearest_obstacle", turned)


def standing(patch):
    """A floor that stays where it was."""
    asked = obstacle.Body.at
    patch.setattr(obstacle.Body, "at", lambda self, time: asked(self, 0.0))


def half_the_force(patch):
    """Half of the pressure acts."""
    forces = StepContact.forces
    patch.setattr(StepContact, "forces", lambda self, pressed: forces(self, pressed) / 2)


def left_open(patch):
    """Gaps that are not closed: one round is taken for all."""
    patch.setattr(StepContact, "settled", lambda self, pressed, size: True)


def rubbing(patch, friction):
    """Another coefficient of friction, whatever the case says."""
    at = StepContact.at

    def rubbed(self, q):
        case = self.points.case
        obstacles = tuple(body.model_copy(update={"friction": friction}) for body in case.obstacles)
        points = replace(self.points, case=case.model_copy(update={"obstacles": obstacles}))
        return at(replace(self, points=points), q)

    patch.setattr(StepContact, "at", rubbed)


def without_limit(patch):
    """Friction without limit."""
    rubbing(patch, 1e9)


def without_friction(patch):
    """No friction at all."""
    rubbing(patch, 0.0)


def pulling_along(patch):
    """Friction that drives instead of slowing down."""
    nodal = StepContact.nodal
    patch.setattr(StepContact, "nodal", lambda self, p: nodal(self, replace(p, traction=-p.traction)))


@pytest.mark.long
def test_one_coarse_mesh_is_green_and_energy_only_leaves():
    solution = solved(FALLS)
    assert worst(solution) < 1
    energy = np.array([step.energy for step in solution.history if step.phase == "time"])
    before = measure_all(solution)["kinetic_energy_210ms"]
    assert np.diff(energy).max() < 1e-9 * before
    assert energy[-1] < -before


@pytest.mark.long
def test_a_patch_that_slides_is_green_and_its_way_is_of_second_order():
    coarse, fine = solved(SLIDES), solved(SLIDES, STEP / 2)
    assert worst(coarse) < 1
    for name in ("slide_200ms", "slide_600ms", "slide_900ms"):
        known = catalog.known_values(SLIDES).judge(name, "kirchhoff-love-nonlinear").value
        before, after = (abs(measure_all(found)[name] - known) for found in (coarse, fine))
        assert 3 < before / after < 8


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (pushed_in, FALLS),
        (turned_normal, FALLS),
        (standing, FALLS),
        (half_the_force, FALLS),
        (left_open, FALLS),
        (without_limit, SLIDES),
        (without_friction, SLIDES),
        (pulling_along, SLIDES),
    ],
)
def test_a_fault_is_red(fault, name, monkeypatch):
    catalog.named_case(name)  # read before anything is broken
    monkeypatch.setattr(contact_in_motion, "MOST_ROUNDS", 10)  # what is right takes six
    fault(monkeypatch)
    try:
        found = worst(solved(name))
    except (SolveFailure, ValueError):
        return  # no answer is red as well
    assert not found < 1
