"""Contact in motion by fem: faults of its mechanics turn the gate red; energy only leaves."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems import obstacle
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.motion import contact_in_motion, time_step
from shellbench.solvers.fem.motion.contact_balance import APART, SLIPS, Balance
from shellbench.solvers.fem.motion.time_step import MovingShell
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.injecting import given, shares_of_tolerances, wrapped

FALLS, SLIDES, BAR = "contact_patch_falls", "contact_patch_slides", "contact_bar"
STEP = 0.02
LATE = {"slide_200ms", "slide_600ms", "slide_900ms", "kinetic_energy_900ms"}  # need a finer step


def solved(name, step=STEP):
    """Solve a case on one coarse mesh by long steps."""
    settings = FemSettings(cells=(8, 1), time_step=0.001) if name == BAR else FemSettings(cells=(1, 1), time_step=step)
    with np.errstate(all="ignore"):  # what is broken may overflow
        return FemSolver().solve(catalog.named_case(name), settings)


def worst(solution):
    """Return the largest error in units of what is allowed."""
    errors = shares_of_tolerances(solution, "fem")
    return np.max([error for name, error in errors.items() if name not in LATE])  # NaN where one is


def pulling(patch):
    """Forces of the wrong sign."""
    wrapped(Balance, "forces", lambda forces: -forces)(patch)


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
    """Half of the force acts."""
    wrapped(Balance, "forces", lambda forces: forces / 2)(patch)


def glued(patch):
    """Keep every contact closed for good."""

    def stuck(self, before):
        held = np.any(before != 0, axis=-1) | (self.gap < 0)
        return self._forces_by_status(np.where(held, SLIPS, APART), np.zeros_like(self.normal))

    patch.setattr(Balance, "forces", stuck)


def without_edges(patch):
    """Gaps are asked within cells only."""
    given(contact_in_motion, "_rule_of_cell", lambda first, last: (False, False))(patch)


def as_a_smooth_force(patch):
    """Impulses count as much as other forces do."""
    patch.setattr(time_step._StepPotential, "impulse_factor", 1.0)


def without_impulse(patch):
    """The velocity forgets impulses."""
    wrapped(MovingShell, "step", lambda now: replace(now, v=now.v - now.impulse))(patch)


def rubbing(patch, friction):
    """Another coefficient of friction, whatever the case says."""
    balanced = Balance.forces
    patch.setattr(Balance, "forces", lambda self, b: balanced(replace(self, friction=0 * self.gap + friction), b))


def without_limit(patch):
    """Friction without limit."""
    rubbing(patch, 1e9)


def without_friction(patch):
    """No friction at all."""
    rubbing(patch, 0.0)


def pulling_along(patch):
    """Friction that drives instead of slowing down."""
    balanced = Balance.forces

    def turned(self, before):
        forces = balanced(self, before)
        return forces - 2 * self._tangential_parts(forces)

    patch.setattr(Balance, "forces", turned)


@pytest.mark.long
def test_one_coarse_mesh_is_green_and_energy_only_leaves():
    solution = solved(FALLS)
    assert worst(solution) < 1
    energy = np.array([step.energy for step in solution.history if step.phase == "time"])
    before = measure_all(solution)["kinetic_energy_210ms"]
    assert np.diff(energy).max() < 1e-9 * before
    assert energy[-1] < -before


@pytest.mark.long
def test_a_bar_that_bounces_is_green():
    assert worst(solved(BAR)) < 1


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
        (pulling, FALLS),
        (turned_normal, FALLS),
        (standing, FALLS),
        (half_the_force, FALLS),
        (turned_normal, BAR),
        (glued, BAR),
        (without_edges, BAR),
        (as_a_smooth_force, BAR),
        (without_impulse, BAR),
        (without_limit, SLIDES),
        (without_friction, SLIDES),
        (pulling_along, SLIDES),
    ],
)
def test_a_fault_is_red(fault, name, monkeypatch):
    catalog.named_case(name)  # read before anything is broken
    fault(monkeypatch)
    try:
        found = worst(solved(name))
    except (SolveFailure, ValueError):
        return  # no answer is red as well
    assert not found < 1
