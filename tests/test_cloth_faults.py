"""The gated values of cloth are tested: mistakes in mass, time, springs, clamps and supports must move them visibly.

The gate itself takes minutes on these cases. Here they are solved on one coarse level, which misses the known values
by some tolerances; a fault must move a value by more than the gate forgives, against the same level without it. What it
would do to the converged answer is that, and the gate is then red.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case, build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.mechanics import constraints, kinematics, strain_energy
from shellbench.solvers.fem.motion import generalised_alpha, time_step
from shellbench.solvers.fem.path import problem
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.injecting import room
from tests.test_faults import stiffness


class Level(NamedTuple):
    """A case on one coarse level, up to a time or load factor."""

    case: str
    settings: FemSettings
    until: float | None = None


FALL = Level("free_fall", FemSettings(cells=(1, 1), time_step=0.02))
STRIP = Level("pendulum_strip", FemSettings(cells=(5, 1), time_step=1 / 150), until=0.5)
NAPKIN = Level("napkin_course", FemSettings(cells=(6, 6), time_step=1 / 150), until=0.2)
SOFT = Level("napkin_soft_pin", FemSettings(cells=(5, 5), time_step=1 / 150), until=0.4)
TWIST = Level("sleeve_course", FemSettings(cells=(8, 4), grading=1), until=0.1)
TWIST_FAR = Level("sleeve_twist", FemSettings(cells=(8, 4), grading=1), until=0.5)
COMPRESSION = Level("sleeve_compression", FemSettings(cells=(8, 4), grading=1), until=0.0265)
SKIRT = Level("skirt", FemSettings(cells=(5, 2), time_step=1 / 150), until=0.1)
FLAG = Level("flag", FemSettings(cells=(5, 3), time_step=1 / 150), until=0.1)
LEVELS = (FALL, STRIP, NAPKIN, SOFT, SKIRT, FLAG, TWIST, TWIST_FAR, COMPRESSION)
BEYOND = 1.2  # tolerances by which a fault must move a gated value: most do so by tens, clamps at small strain by 1.5
NEAR = 100.0  # tolerances within which the coarse level is of the known values, so that it is the same motion at all


def shortened(level: Level) -> Case:
    """Return a case with its quantities up to where the level goes."""
    case = catalog.named_case(level.case)
    if level.until is None:
        return case
    data = case.model_dump(mode="json", exclude_unset=True, exclude={"name"})
    asked = [q for q in data["quantities"] if q.get("at", 1.0) <= level.until or q["kind"] == "critical_point"]
    kept = [q | {"primary": number == 0} for number, q in enumerate(asked)]
    end = {"dynamics": {"until": level.until}} if case.dynamics else {"path": data["path"] | {"until": level.until}}
    return build_case(data | {"quantities": kept} | end, level.case, level.case)


def solved(level: Level) -> dict[str, float]:
    """Return the gated quantities of a case on a level, and infinity for each if it can't be solved."""
    case = shortened(level)
    gated = [q.name for q in case.quantities if np.isfinite(room(case, q.name, "fem"))]
    try:
        found = measure_all(FemSolver().solve(case, level.settings))
    except (SolveFailure, ArithmeticError):
        return dict.fromkeys(gated, np.inf)
    return {name: found[name] for name in gated}


def tolerances(level: Level, first: dict[str, float], second: dict[str, float]) -> dict[str, float]:
    """Return the number of tolerances between two answers."""
    case = catalog.named_case(level.case)
    return {name: abs(first[name] - value) / room(case, name, "fem") for name, value in second.items()}


right: dict[Level, dict[str, float]] = {}


@pytest.fixture
def without_fault():
    """Return the answers of a level without a fault, which are found once."""

    def answers(level: Level) -> dict[str, float]:
        if level not in right:
            right[level] = solved(level)
        return right[level]

    return answers


class Fault(NamedTuple):
    """A fault, and the place where it must show."""

    name: str
    level: Level
    inject: Callable[[pytest.MonkeyPatch], None]


def scaled_matrix(module, name: str, factor: float) -> Callable[[pytest.MonkeyPatch], None]:
    """Scale the mass or the springs."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = getattr(module, name)

        def scaled(*args):
            matrix = original(*args)
            return BlockMatrix(factor * matrix.blocks, matrix.columns)

        patch.setattr(module, name, scaled)

    return inject


def scheme(name: str, change: float) -> Callable[[pytest.MonkeyPatch], None]:
    """Shift one constant of the generalised-alpha method."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = getattr(generalised_alpha.Scheme, name).fget
        patch.setattr(generalised_alpha.Scheme, name, property(lambda self: original(self) + change))

    return inject


def loads(change: Callable[[float], float], factor: float = 1.0) -> Callable[[pytest.MonkeyPatch], None]:
    """Change when loads act, or how strong they are."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = problem.FiniteProblem.loads.func

        def changed(self):
            at = original(self)
            return lambda t: factor * at(change(t))

        patch.setattr(problem.FiniteProblem, "loads", property(changed))

    return inject


def reversed_inertia(patch: pytest.MonkeyPatch) -> None:
    """Let rho u'' = + dE/du - f: the sign of inertia that follows from the sum of kinetic and potential energy."""
    loads(lambda t: t, -1.0)(patch)
    original = strain_energy.StrainEnergy.deform

    def negative(self, q):
        found = original(self, q)
        return replace(found, membrane=-found.membrane, bending=-found.bending, forces=-found.forces)

    patch.setattr(strain_energy.StrainEnergy, "deform", negative)
    tangent = strain_energy.StrainEnergy.tangent

    def softening(self, *args):
        matrix = tangent(self, *args)
        return BlockMatrix(-matrix.blocks, matrix.columns)

    patch.setattr(strain_energy.StrainEnergy, "tangent", softening)


def free_slopes(patch: pytest.MonkeyPatch) -> None:
    """Forget that rims are clamped, at the nodes and between them."""
    patch.setattr(problem, "finite_clamps", lambda *args: ())
    original = constraints._slope_conditions

    def free(*args):
        rows, values = original(*args)
        return rows[:, :0], values[:, :0]

    patch.setattr(constraints, "_slope_conditions", free)


def normals_left_behind(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Case, "turn", lambda self, support, t=1.0: np.eye(3))


def first_component_leaks(patch: pytest.MonkeyPatch) -> None:
    """Hold one component less at every support."""
    original = constraints._component_conditions

    def leaking(support, *args):
        rows, values = original(support, *args)
        count = len(rows[0]) // len(support.held)
        return rows[:, count:], values[:, count:]

    patch.setattr(constraints, "_component_conditions", leaking)


def wrong_poisson(patch: pytest.MonkeyPatch) -> None:
    original = kinematics.elasticity
    patch.setattr(kinematics, "elasticity", lambda surface, nu: original(surface, nu + 0.05))


FAULTS = [
    Fault("a mass that is 10 % too large", FALL, scaled_matrix(time_step, "mass_matrix", 1.1)),
    Fault("gravity that points upward", FALL, loads(lambda t: t, -1.0)),
    Fault("a mass that is 10 % too large", STRIP, scaled_matrix(time_step, "mass_matrix", 1.1)),
    Fault("damping of first order", STRIP, scheme("gamma", 0.1)),
    Fault("reversed inertia", STRIP, reversed_inertia),
    Fault("half the bending stiffness", STRIP, stiffness("bending_stiffness", 0.5)),
    Fault("one percent less membrane stiffness", STRIP, stiffness("membrane_stiffness", 0.99)),
    Fault("a support that leaks", STRIP, first_component_leaks),
    Fault("a mass that is 10 % too large", NAPKIN, scaled_matrix(time_step, "mass_matrix", 1.1)),
    Fault("no springs", NAPKIN, scaled_matrix(time_step, "spring_matrix", 0.0)),
    Fault("springs of ten percent less", NAPKIN, scaled_matrix(time_step, "spring_matrix", 0.9)),
    Fault("damping of first order", NAPKIN, scheme("gamma", 0.1)),
    Fault("a wrong Poisson ratio", NAPKIN, wrong_poisson),
    Fault("half the bending stiffness", SOFT, stiffness("bending_stiffness", 0.5)),
    Fault("a mass that is 10 % too large", SKIRT, scaled_matrix(time_step, "mass_matrix", 1.1)),
    Fault("a wind that stays as it is at first", SKIRT, loads(lambda t: 0.0)),
    Fault("a waist that leaks", SKIRT, first_component_leaks),
    Fault("one percent less membrane stiffness", SKIRT, stiffness("membrane_stiffness", 0.99)),
    Fault("a wind that stays as it is at first", FLAG, loads(lambda t: 0.0)),
    Fault("springs of ten percent less", FLAG, scaled_matrix(time_step, "spring_matrix", 0.9)),
    Fault("a wind that begins a step late", FLAG, loads(lambda t: t - 1 / 150)),
    Fault("free slopes", TWIST, free_slopes),
    Fault("normals that are left behind", TWIST_FAR, normals_left_behind),
    Fault("half the bending stiffness", TWIST, stiffness("bending_stiffness", 0.5)),
    Fault("one percent more membrane stiffness", TWIST, stiffness("membrane_stiffness", 1.01)),
    Fault("a support that leaks", TWIST, first_component_leaks),
    Fault("free slopes", COMPRESSION, free_slopes),
    Fault("half the bending stiffness", COMPRESSION, stiffness("bending_stiffness", 0.5)),
]


@pytest.mark.long
@pytest.mark.parametrize("level", LEVELS, ids=lambda level: f"{level.case} until {level.until}")
def test_without_a_fault_the_coarse_level_is_near_the_known_values(level, without_fault):
    found, case = without_fault(level), catalog.named_case(level.case)
    judges = {name: catalog.known_values(case.name).judge(name, case.theory).value for name in found}
    assert len(found) >= 2
    distances = tolerances(level, found, judges)
    assert max(distances.values()) < NEAR, distances


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f"{f.level.case}: {f.name}")
def test_a_fault_moves_a_gated_value_beyond_its_tolerance(fault, without_fault, monkeypatch):
    expected = without_fault(fault.level)
    fault.inject(monkeypatch)
    moved = tolerances(fault.level, solved(fault.level), expected)
    assert max(moved.values()) > BEYOND, moved


def test_every_fault_is_another_one():
    assert len({(fault.name, fault.level) for fault in FAULTS}) == len(FAULTS)
