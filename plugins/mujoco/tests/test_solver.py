"""Motions whose answers are known, what the solver declines, and how its settings speak."""

from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install ./plugins/mujoco")

from cloths import plate
from pydantic import ValidationError
from shellbench_mujoco.elasticity import Elasticity
from shellbench_mujoco.grid import Grid, Loading
from shellbench_mujoco.solver import FlexSettings, MujocoFlexSolver
from shellbench_mujoco.solving import usual_step

from shellbench.errors import InputError
from shellbench.problems.shell.quantities.measure import kinetic_energy, total_energy
from tests.alike import alike
from tests.solvers.cst.shells import CLOTH, cloth

CORNER = {"name": "corner", "on": ["xi1_min,xi2_max"]}
INSIDE = np.array([[0.31, 0.44], [0.9, 0.05], [0.0, 1.0]])
STRIP = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.25]}
SOFT = CLOTH | {"poissons_ratio": 0.0}


def follow(case, **settings):
    return MujocoFlexSolver().solve(case, FlexSettings(**{"cells": (8, 8), **settings}))


@pytest.mark.parametrize(("settings", "ahead"), [
    ({"integrator": "Euler"}, 0.0),
    ({"integrator": "RK4"}, 0.0),
    ({"integrator": "Euler", "staggered": False}, 1.0),
    ({"integrator": "discrete"}, 1.0),
])  # fmt: skip
def test_free_fall(settings, ahead):
    """-g t^2/2; a rule of first order is ahead by -g h t/2, and no frame rate changes that."""
    answer = follow(cloth(until=0.5), frame_rate=20, **settings)
    step = answer.diagnostics["time_step"]
    for t in (0.1, 0.35, 0.5):
        fallen = answer.displacement(INSIDE, at=t)
        assert np.allclose(fallen, [0, 0, -9.8 * t * (t + ahead * step) / 2], atol=1e-12)
        assert np.allclose(answer.velocity(INSIDE, at=t), [0, 0, -9.8 * t], atol=1e-11)
        assert sum(answer.energies(t)) < 1e-20


def test_a_load_that_grows_moves_free_cloth_as_newton_says():
    """f = t/2 along x: u = t^3/(12 rho). Leapfrog from rest is behind by exactly h^2 t/(12 rho), by its recurrence."""
    case = cloth(until=0.4, loads=[{"kind": "area", "vector": ["t/2", 0, 0]}])
    exact, errors = 0.4**3 / 12 / 0.144, {}
    for integrator in ("Euler", "RK4"):
        answer = follow(case, integrator=integrator, time_step=1e-3)
        scale = 0.4 * answer.diagnostics["time_step"] ** 2 / 12 / 0.144
        errors[integrator] = (answer.displacement(INSIDE, at=0.4)[:, 0] - exact) / scale
        kinetic = (0.4**2 / 4 / 0.144) ** 2 * 0.144 / 2
        assert answer.history[-1].energy == pytest.approx(0, abs=1e-5 * kinetic)
    assert np.allclose(errors["Euler"], -1, atol=1e-4)
    assert np.all(np.abs(errors["RK4"]) < 1)  # its loads are those at mid-step


def test_even_springs_swing_a_cloth_as_one_body():
    """rho u'' = f - k u from rest: u = f/k (1 - cos(w t)), w^2 = k/rho; along y nothing holds it."""
    springs = [
        {"name": "weak", "stiffness": 30.0, "components": ["x", "z"]},
        {"name": "more", "stiffness": 20.0, "components": ["z"]},
    ]
    case = cloth(until=0.2, springs=springs, loads=[{"kind": "area", "vector": [0.3, 0.1, -0.2]}])
    answer = follow(case, time_step=5e-4)
    for t in (0.07, 0.2):
        x, z = (force / k * (1 - np.cos(np.sqrt(k / 0.144) * t)) for force, k in ((0.3, 30), (-0.2, 50)))
        assert np.allclose(answer.displacement(INSIDE, at=t), [x, 0.1 * t**2 / 2 / 0.144, z], atol=1e-6)
    assert abs(answer.history[-1].energy) < 1e-7


def test_a_bar_under_its_own_weight_swings_to_twice_its_rest_length_change():
    """d'Alembert: until a wave has come from the held end the free end falls freely; after 2 L/c it is down at g L^2/c^2.

    c^2 = E h/rho; that is twice rho g L^2/(2 E h), where it would hang at rest. Strains of 1e-3 leave a change of c.
    """
    pull = 2e-3 * SOFT["youngs_modulus"] * SOFT["thickness"] / SOFT["areal_density"]
    c = np.sqrt(SOFT["youngs_modulus"] * SOFT["thickness"] / SOFT["areal_density"])
    load = {"kind": "gravity", "acceleration": [pull, 0, 0]}
    held = [{"name": "end", "on": ["xi1_min"]}, {"name": "plane", "on": ["surface"], "components": ["z"]}]
    held[0]["components"] = ["x", "y"]
    answer = follow(cloth(until=2 / c, surface=STRIP, material=SOFT, loads=[load], supports=held), cells=(60, 15))
    tip = [[1.0, 0.125]]
    assert answer.displacement(tip, at=0.8 / c)[0, 0] == pytest.approx(pull * (0.8 / c) ** 2 / 2, rel=2e-3)
    assert answer.displacement(tip, at=2 / c)[0, 0] == pytest.approx(pull / c**2, rel=5e-3)


def test_a_damped_bar_comes_to_hang_as_statics_says():
    """rho g L^2/(2 E h) at the tip, and the support bears the weight."""
    pull = 2e-4 * SOFT["youngs_modulus"] * SOFT["thickness"] / SOFT["areal_density"]
    load = {"kind": "gravity", "acceleration": [pull, 0, 0]}
    case = cloth(until=3.0, surface=STRIP, material=SOFT, loads=[load], supports=[{"name": "end", "on": ["xi1_min"]}])
    answer = follow(case, cells=(24, 6), integrator="discrete", damping=0.05, time_step=0.02, frame_rate=10)
    extension = pull * SOFT["areal_density"] / (2 * SOFT["youngs_modulus"] * SOFT["thickness"])
    assert answer.displacement([[1.0, 0.1]])[0, 0] == pytest.approx(extension, rel=5e-3)
    force, moment = answer.reaction("end", centre=(0.0, 0.125, 0.0))
    assert force == pytest.approx(
        [-pull * SOFT["areal_density"] * 0.25, 0, 0], abs=1e-4 * pull * SOFT["areal_density"] * 0.25
    )
    assert np.abs(moment).max() < 1e-3 * 0.25 * -force[0]


def test_damping_is_that_of_rayleigh():
    """A bar in its first mode is an oscillator of ratio beta w/2, w = pi c/(2 L), beta times the stiffness its damping."""
    omega = np.pi / 2 * np.sqrt(SOFT["youngs_modulus"] * SOFT["thickness"] / SOFT["areal_density"])
    ratio = 0.2
    case = cloth(
        until=4 / omega,
        surface=STRIP,
        material=SOFT,
        loads=[{"kind": "area", "vector": [f"{float(1e-4 * 0.144 * omega**2)!r}*sin(pi*xi1/2)", 0, 0]}],
        supports=[{"name": "end", "on": ["xi1_min"]}],
    )
    answer = follow(case, cells=(24, 6), damping=2 * ratio / omega)
    slow = np.sqrt(1 - ratio**2)
    for phase in (2.0, 4.0):
        swing = np.cos(slow * phase) + ratio / slow * np.sin(slow * phase)
        expected = 1e-4 * (1 - np.exp(-ratio * phase) * swing)
        assert answer.displacement([[1.0, 0.125]], at=phase / omega)[0, 0] == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("factor", [1.0, 9.0])
def test_a_hinged_strip_bends_as_a_beam_does_but_for_its_twist(factor):
    """A load p sin(pi x/L) from rest: w = p/(rho w1^2) (1 - cos(w1 t)), w1 = (pi/L)^2 sqrt(s B/rho).

    A beam has s = 1. Hinges on cells cut like these have (k11 + k12)^2 + (k22 + k12)^2 + 4 k12^2, which is k11^2 only
    if nothing twists, and 4/5 of it where k12 and k22 are free: the strip lies between. Its time scale is sqrt(B).
    """
    material = SOFT | {"thickness": 0.05, "bending_factor": factor}
    stiffness = factor * material["youngs_modulus"] * 0.05**3 / 12
    omega = np.pi**2 * np.sqrt(stiffness / 0.144)
    size = 1e-4 * 0.144 * omega**2
    case = cloth(
        until=np.pi / omega,
        surface=STRIP,
        material=material,
        loads=[{"kind": "area", "vector": [0, 0, f"{float(size)!r}*sin(pi*xi1)"]}],
        supports=[
            {"name": "left", "on": ["xi1_min"]},
            {"name": "right", "on": ["xi1_max"], "components": ["z"]},
        ],
    )
    answer = follow(case, cells=(24, 6), frame_rate=60)
    found = answer.displacement([[0.5, 0.125]])[0, 2]
    stiff, soft = (1e-4 / s * (1 - np.cos(np.pi * np.sqrt(s))) for s in (1.0, 0.8))
    assert 0.99 * stiff < found < soft


def test_energy_is_kept_to_second_order_in_the_step():
    case = cloth(until=0.3, supports=[CORNER])
    work = 0.144 * 9.8 * 0.1
    found = [follow(case, time_step=step).diagnostics for step in (1e-3, 5e-4, 2.5e-4)]
    assert abs(found[0]["energy_drift"]) < 1e-4 * work
    for long, short in pairwise(found):
        rate = np.log(long["energy_drift"] / short["energy_drift"]) / np.log(long["time_step"] / short["time_step"])
        assert rate == pytest.approx(2, abs=0.2)
    implicit = follow(case, integrator="discrete", time_step=1e-3)
    assert implicit.history[-1].energy < -100 * abs(found[0]["energy_drift"])  # what a rule of first order loses


def test_total_energy_as_it_is_measured_is_that_of_the_history():
    """Lumped and consistent masses differ by O(h^2): an eighth of a cell here."""
    case = cloth(until=0.2, supports=[CORNER])
    answer = follow(case, cells=(24, 24))
    assert total_energy(answer, 0.2) == pytest.approx(answer.history[-1].energy, abs=0.02 * kinetic_energy(answer, 0.2))


def test_a_mirrored_case_has_the_mirrored_answer():
    """Exchanging xi1 and xi2 maps the grid and its diagonals onto themselves."""
    one = cloth(until=0.2, supports=[CORNER], loads=[{"kind": "gravity", "acceleration": [1, -3, 2]}])
    two = cloth(
        until=0.2,
        supports=[{"name": "corner", "on": ["xi1_max,xi2_min"]}],
        loads=[{"kind": "gravity", "acceleration": [-3, 1, 2]}],
    )
    u, v = follow(one).displacement(INSIDE), follow(two).displacement(INSIDE[:, ::-1])
    assert np.abs(u).max() > 0.01
    assert np.allclose(u, v[:, [1, 0, 2]], atol=1e-9)


def test_what_is_held_stays_and_the_rest_keeps_to_its_plane():
    case = cloth(
        until=0.2,
        supports=[{"name": "plane", "on": ["surface"], "components": ["z"]}, CORNER | {"components": ["x", "y"]}],
        loads=[{"kind": "gravity", "acceleration": [0, -9.8, 3]}],
    )
    answer = follow(case)
    assert np.all(answer.displacement([[0.0, 1.0]]) == 0)
    assert np.all(answer.displacement(INSIDE)[:, 2] == 0)
    assert answer.displacement([[1.0, 0.0]])[0, 1] < -0.1
    assert answer.parameters == 2 * 81 - 2
    force, moment = answer.reaction("plane")
    masses = Loading(answer.grid).masses
    centre = masses @ (answer.grid.rest + answer.vertices()) / 0.144
    assert force[2] == pytest.approx(-0.144 * 3)
    assert moment[:2] == pytest.approx(np.cross(centre, [0, 0, force[2]])[:2])


def test_supports_that_meet_in_a_corner_share_its_force():
    apart = [{"name": "left", "on": ["xi1_min"]}, {"name": "front", "on": ["xi2_min"]}]
    together = [{"name": "both", "on": ["xi1_min", "xi2_min"]}]
    one = follow(cloth(until=0.05, supports=together)).reaction("both")
    two = follow(cloth(until=0.05, supports=apart))
    for whole, left, front in zip(one, two.reaction("left"), two.reaction("front"), strict=True):
        assert np.allclose(whole, left + front, atol=1e-14)


def test_the_same_settings_give_the_same_numbers():
    case = cloth(until=0.05, supports=[CORNER])
    alike(follow(case).frames, follow(case).frames, 1e-9)


MOVING = {"name": "corner", "on": ["xi1_min,xi2_max"], "motion": {"kind": "translation", "vector": ["t**2", 0, 0]}}
EDGE = {"name": "edge", "on": ["xi1_min"]}


@pytest.mark.parametrize(("case", "reason"), [
    (plate(), "at rest"),
    (cloth(surface={"kind": "cylinder", "radius": 1, "closed": True, "xi1": [0, 360], "xi2": [0, 1]}), "curved"),
    (cloth(surface={"kind": "cylinder", "radius": 1, "xi1": [0, 90], "xi2": [0, 1]}), "curved"),
    (cloth(supports=[MOVING]), "moves its supports"),
    (cloth(supports=[EDGE | {"clamped": True}]), "holds slopes"),
    (cloth(loads=[{"kind": "edge", "on": ["xi1_min"], "vector": [0, 0, 1]}]), "loads on edges"),
    (cloth(loads=[{"kind": "moment", "on": ["xi1_min"], "axis": [0, 1, 0], "value": 1}]), "loads on edges"),
    (cloth(loads=[{"kind": "pressure", "value": 1, "follows": True}]), "pressure follows"),
    (cloth(material=CLOTH | {"poissons_ratio": -0.1}), "Poisson's ratio"),
])  # fmt: skip
def test_declines(case, reason):
    declined = MujocoFlexSolver().declines(case)
    assert declined is not None
    assert reason in declined
    with pytest.raises(InputError, match=reason):
        MujocoFlexSolver().solve(case, FlexSettings(cells=(2, 2)))


def test_a_held_point_must_be_a_vertex():
    case = cloth(points={"pin": [0.5, 0.3]}, supports=[{"name": "pin", "on": ["pin"]}])
    assert MujocoFlexSolver().declines(case) is None
    with pytest.raises(InputError, match="'pin' is held, and no vertex of 8 x 8 cells lies there"):
        follow(case)
    assert np.all(follow(case, cells=(10, 10)).displacement([[0.5, 0.3]]) == 0)


@pytest.mark.parametrize(("settings", "message"), [
    ({"cells": (0, 4)}, "must be from 1"),
    ({"engine": "mujoco 1.0"}, "is installed, and no other"),
    ({"integrator": "implicitfast"}, "Euler"),
    ({"damping": -1.0}, "greater than or equal to 0"),
])  # fmt: skip
def test_settings_that_are_refused(settings, message):
    with pytest.raises(ValidationError, match=message):
        FlexSettings(**settings)


def test_too_many_frames_are_refused_before_the_work():
    with pytest.raises(InputError, match="'frame_rate'"):
        follow(cloth(), frame_rate=1e8, time_step=1e-7)


def test_the_engines_version_is_part_of_the_settings():
    assert FlexSettings().engine.startswith("mujoco ")
    assert "engine" in FlexSettings().model_dump()


def test_refinements_halve_the_cells_and_so_the_steps():
    grids = [Grid(cloth(supports=[CORNER]), settings["cells"]) for settings in MujocoFlexSolver.refinements]
    steps = [usual_step(Elasticity(grid), Loading(grid)) for grid in grids]
    assert [grid.cells for grid in grids] == [(10, 10), (20, 20), (40, 40)]
    assert steps[0] / steps[1] == pytest.approx(2, rel=0.1)
    assert steps[1] / steps[2] == pytest.approx(2, rel=0.1)
