"""Motions end to end: balances of momentum, the plane, supports that move, steps that are cut, levels, and failures."""

import copy
import math
import re

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import area_rule, measure, measure_all
from shellbench.solvers.fem.motion import motion, time_step
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.stepping.control import NotConvergedError
from tests.solvers.fem.shells import LARGEST, MATERIAL, shell

NONLINEAR = "kirchhoff-love-nonlinear"
DENSITY = MATERIAL["areal_density"]
MASS = 2 * DENSITY  # of the rectangle 2 x 1
SOFT = MATERIAL | {"youngs_modulus": 2e3}
CORNER = {"name": "corner", "on": ["xi1_min,xi2_max"]}
EDGE = {"name": "edge", "on": ["xi1_min"]}
FALLING = {"kind": "gravity", "acceleration": [1.5, 0.0, -9.8]}
HEAVY = {"kind": "gravity", "acceleration": [0.0, 0.0, -9.8]}
KINETIC = {"name": "kinetic", "kind": "kinetic_energy"}
STRAIN = {"name": "strain", "kind": "strain_energy"}


def moving(until=0.3, quantities=(), surface="plane", **fields):
    fields = {"theory": NONLINEAR, "supports": [CORNER], "loads": [FALLING], "material": SOFT, **fields}
    largest = LARGEST | {"at": until}
    return shell(surface, dynamics={"until": until}, quantities=[largest, *quantities], **fields)


def solve(case, **settings):
    return FemSolver().solve(case, FemSettings(**settings))


def momentum(solution, t):
    """Return momentum and angular momentum about the origin."""
    points, weights = area_rule(solution.case)
    v = solution.velocity(points, t)
    x = solution.case.surface.position(points) + solution.displacement(points, t)
    density = solution.case.material.areal_density
    return density * weights @ v, density * weights @ np.cross(x, v)


def steps_of(solution):
    return [step for step in solution.history if step.phase == "time"]


@pytest.fixture(scope="module")
def swinging():
    """A soft sheet that swings from a corner."""
    return solve(moving(), cells=(3, 3), time_step=2.5e-3)


# balances


def test_momentum_is_what_weight_and_support_gave(swinging):
    x, w = np.polynomial.legendre.leggauss(80)
    weight = MASS * np.array([1.5, 0, -9.8])
    given = np.zeros(3)
    for share, at in zip(w / 2, (x + 1) / 2, strict=True):
        t = 0.3 * at
        force, moment = swinging.reaction("corner", at=t)
        given += 0.3 * share * (weight + force)
        # the corner carries no moment about itself, wherever it is
        at_corner = swinging.case.surface.position(np.array([0.0, 1.0]))
        assert np.allclose(moment, np.cross(at_corner, force), rtol=0, atol=1e-8 * np.linalg.norm(weight))
    gained, _ = momentum(swinging, 0.3)
    assert np.linalg.norm(gained) > 0.1 * np.linalg.norm(0.3 * weight)
    assert np.allclose(gained, given, rtol=0, atol=5e-3 * np.linalg.norm(0.3 * weight))


def test_angular_momentum_about_the_held_corner_is_what_the_weight_gave(swinging):
    """The corner's force has no moment about it: d/dt of the angular momentum is that of the weight at the centre."""
    corner = np.array([0.0, 1.0, 0.0])
    x, w = np.polynomial.legendre.leggauss(40)
    points, weights = area_rule(swinging.case)
    given = np.zeros(3)
    for share, at in zip(w / 2, (x + 1) / 2, strict=True):
        t = 0.3 * at
        arms = swinging.case.surface.position(points) + swinging.displacement(points, t) - corner
        given += 0.3 * share * np.cross(DENSITY * weights @ arms, [1.5, 0, -9.8])
    p, about_origin = momentum(swinging, 0.3)
    found = about_origin - np.cross(corner, p)
    assert np.linalg.norm(given) > 0.5
    assert np.allclose(found, given, rtol=0, atol=2e-3 * np.linalg.norm(given))


def test_what_nothing_holds_keeps_momentum_and_turns_by_its_loads():
    """A couple without resultant: the centre of mass stays, and the angular momentum is the moment's integral."""
    twist = {"kind": "area", "vector": [0, 0, "200*(xi1 - 1)*t"]}
    solution = solve(moving(0.2, supports=[], loads=[twist]), cells=(3, 2), time_step=2e-3)
    p, turning = momentum(solution, 0.2)
    points, weights = area_rule(solution.case)
    x = solution.case.surface.position(points) + solution.displacement(points, 0.2)
    assert np.allclose(weights @ x / weights.sum(), [1, 0.5, 0], rtol=0, atol=1e-6)
    assert np.abs(p).max() < 1e-4
    # moment about y of dead loads, - integral of (x - x_c) f_z: of the displaced shell
    t, w = np.polynomial.legendre.leggauss(20)
    given = 0.0
    for share, at in zip(w / 2, 0.1 * (t + 1), strict=True):
        x = solution.case.surface.position(points) + solution.displacement(points, at)
        given += 0.2 * share * -(weights @ (x[:, 0] * 200 * (points[:, 0] - 1) * at))
    assert abs(given) > 1
    assert turning[1] == pytest.approx(given, rel=2e-3)


def test_energy_is_kept_where_supports_are_at_rest(swinging):
    end = steps_of(swinging)[-1]
    turnover = measure_all(swinging)
    kinetic = measure(swinging, build_quantity(KINETIC, 0.3))
    assert turnover["largest"] > 0.3
    assert abs(end.energy) < 5e-3 * kinetic
    assert swinging.diagnostics["energy_drift"] >= abs(end.energy)
    assert swinging.diagnostics["energy_drift"] == pytest.approx(max(abs(s.energy) for s in steps_of(swinging)))
    finer = solve(swinging.case, cells=(3, 3), time_step=1.25e-3)
    assert finer.diagnostics["energy_drift"] < 0.4 * swinging.diagnostics["energy_drift"]


def build_quantity(data, at):
    return moving(quantities=[data | {"at": at}]).quantity(data["name"])


def test_in_plane_motion_stays_in_its_plane():
    napkin = catalog.named_case("napkin_plane").model_copy(update={"quantities": (moving(0.1).primary,)})
    napkin = napkin.model_copy(update={"dynamics": napkin.dynamics.model_copy(update={"until": 0.1})})
    solution = solve(napkin, cells=(3, 3), time_step=5e-3)
    points = napkin.surface.domain.grid(7, 7).reshape(-1, 2)
    for t in (0.03, 0.1):
        assert not np.any(solution.displacement(points, t)[:, 2])
        assert not np.any(solution.velocity(points, t)[:, 2])
        assert solution.energies(t)[1] == 0.0
    assert np.abs(solution.displacement(points, 0.1)).max() > 0.03


def test_in_its_plane_a_shell_stays_there_unless_it_is_pushed_out():
    """Without the support of the plane as well: symmetry is not broken by rounding."""
    loads = [{"kind": "gravity", "acceleration": [0.0, -9.8, 0.0]}]
    solution = solve(moving(0.1, loads=loads), cells=(3, 3), time_step=5e-3)
    points = solution.case.surface.domain.grid(7, 7).reshape(-1, 2)
    assert np.abs(solution.displacement(points, 0.1)[:, 2]).max() < 1e-12


def test_space_has_no_preferred_direction_and_time_no_preferred_place():
    """The sheet and its weight turned in space: the same motion, turned."""
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [0.6 * s, 0.6 * c, -0.8], [0.8 * s, 0.8 * c, 0.6]])
    rows = {n: f"{float(r[0])!r}*xi1 + {float(r[1])!r}*xi2" for n, r in zip("xyz", turn, strict=True)}
    surface = {"kind": "expression", "xi1": [0, 2], "xi2": [0, 1], **rows}
    weight = turn @ [1.5, 0, -9.8]
    loads = [{"kind": "gravity", "acceleration": [float(v) for v in weight]}]
    first = solve(moving(0.15), cells=(3, 2), time_step=5e-3)
    second = solve(moving(0.15, surface=surface, loads=loads), cells=(3, 2), time_step=5e-3)
    points = first.case.surface.domain.grid(5, 5).reshape(-1, 2)
    u = first.displacement(points, 0.15)
    assert np.allclose(second.displacement(points, 0.15), u @ turn.T, rtol=0, atol=1e-5 * np.abs(u).max())


# supports that move


def test_moved_supports_follow_their_formula():
    vector = ["0.2*t**2", "0.1*sin(t)**2", "-0.3*t**3"]
    case = moving(supports=[EDGE | {"motion": {"kind": "translation", "vector": vector}}])
    solution = solve(case, cells=(3, 2), time_step=5e-3)
    points = np.array([[0.0, 0.0], [0.0, 0.37], [0.0, 1.0]])
    for t in (0.1, 0.123, 0.3):
        expected = [0.2 * t**2, 0.1 * np.sin(t) ** 2, -0.3 * t**3]
        assert np.allclose(solution.displacement(points, t), expected, rtol=0, atol=1e-7)
        speed = [0.4 * t, 0.1 * np.sin(2 * t), -0.9 * t**2]
        assert np.allclose(solution.velocity(points, t), speed, rtol=0, atol=2e-4)


def test_a_hinge_turned_about_its_own_axis_moves_nothing():
    turned = EDGE | {"motion": {"kind": "rotation", "axis": [0, 1, 0], "angle": "90*t**2"}}
    solution = solve(moving(supports=[turned], loads=[]), cells=(2, 2), time_step=0.01)
    assert np.abs(solution.displacement([[2.0, 0.5]], 0.3)).max() < 1e-9


def test_what_is_carried_by_all_its_edge_moves_along():
    """A short stiff sheet on a slowly moved edge hardly lags behind, and the edge pushes it by its mass."""
    stiff = MATERIAL | {"youngs_modulus": 1e7, "thickness": 0.5}
    vector = ["2*t**2", 0, 0]
    case = moving(material=stiff, loads=[], supports=[EDGE | {"motion": {"kind": "translation", "vector": vector}}])
    solution = solve(case, cells=(2, 1), time_step=2e-3)
    assert solution.displacement([2.0, 0.5], 0.3) == pytest.approx([0.18, 0, 0], abs=1e-4)
    ts = np.linspace(0.1, 0.3, 201)
    mean = np.mean([solution.reaction("edge", at=t)[0] for t in ts], axis=0)  # it rings
    assert mean == pytest.approx([4 * MASS, 0, 0], rel=2e-2, abs=1e-3)


@pytest.mark.long
def test_a_clamped_rim_that_turned_slowly_ends_in_the_state_of_equilibrium():
    """A tube whose rims are clamped, one of them tilted: nodes, clamps between them and reactions are those of rest."""
    tilted = {"kind": "rotation", "axis": [1, 0, 0], "centre": [0, 3, 0], "angle": "1 - exp(-(t/20)**2)"}
    rims = [
        {"name": "bottom", "on": ["xi2_min"], "clamped": True},
        {"name": "top", "on": ["xi2_max"], "clamped": True, "motion": tilted},
    ]
    fields = {"theory": NONLINEAR, "supports": rims, "quantities": [LARGEST | {"at": 100.0}]}
    rest = solve(shell("cylinder", path={"until": 100.0}, **fields), cells=(4, 2))
    case = shell("cylinder", dynamics={"until": 100.0}, **fields)
    moved = solve(case, cells=(4, 2), time_step=2.0, spectral_radius=0.0)
    points = case.surface.domain.grid(7, 7).reshape(-1, 2)
    expected = rest.displacement(points, 100.0)
    assert np.abs(expected).max() > 0.02
    assert np.allclose(moved.displacement(points, 100.0), expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    for found, known in zip(moved.reaction("top", at=100.0), rest.reaction("top", at=100.0), strict=True):
        assert np.allclose(found, known, rtol=0, atol=1e-5 * np.linalg.norm(known))


def test_a_mirrored_half_moves_as_the_whole():
    edges = [{"name": "edges", "on": ["xi1_min", "xi1_max"], "clamped": True}]
    half = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}
    mirrored = [EDGE | {"clamped": True}, {"name": "mirror", "on": ["xi1_max"], "symmetry": "x"}]
    whole = solve(moving(0.05, supports=edges, loads=[HEAVY]), cells=(4, 2), time_step=5e-3, grading=1.0)
    part = solve(
        moving(0.05, surface=half, supports=mirrored, loads=[HEAVY]), cells=(2, 2), time_step=5e-3, grading=1.0
    )
    points = np.array([[0.3, 0.2], [0.7, 0.9], [1.0, 0.5]])
    expected = whole.displacement(points, 0.05)
    assert np.abs(expected).max() > 1e-3
    assert np.allclose(part.displacement(points, 0.05), expected, rtol=0, atol=1e-7 * np.abs(expected).max())


# time steps


def test_the_steps_stand_in_the_history_and_end_where_they_must():
    for until in (0.3, 0.1 * np.pi, 0.0123):
        solution = solve(moving(until), cells=(2, 2), time_step=7e-3)
        at = [0.0, *(s.at for s in steps_of(solution))]
        assert at[-1] == pytest.approx(until, rel=1e-12)
        assert solution.times[-1] == pytest.approx(until, rel=1e-12)
        assert np.all(np.diff(at) > 0)
        assert max(np.diff(at)) <= 7e-3 * (1 + 1e-9)
        assert len(at) - 1 == np.ceil(until / 7e-3)
        assert [s.iteration for s in solution.history] == list(range(len(solution.history)))
        assert np.all(np.diff([s.seconds for s in steps_of(solution)]) >= 0)
        assert all(s.iterations >= 1 for s in steps_of(solution))
        solution.displacement([1.0, 0.5], until)
        with pytest.raises(InputError, match="solved from 0"):
            solution.displacement([1.0, 0.5], 1.01 * until)


JOLT = {"kind": "area", "vector": [0, 0, "2000*exp(-((t - 0.11)/0.004)**2)"]}


def test_a_jolt_cuts_the_step_and_it_grows_again():
    solution = solve(moving(0.4, loads=[JOLT], supports=[]), cells=(2, 2), time_step=1e-2)
    at = np.array([0.0, *(s.at for s in steps_of(solution))])
    lengths = np.diff(at)
    short = at[1:-1][lengths[:-1] < 0.9e-2]  # but for the last one, which lands on the end
    assert lengths.min() < 4e-3
    assert solution.diagnostics["shortest_time_step"] == pytest.approx(lengths.min())
    assert np.all(np.abs(short - 0.11) < 0.05)  # neither before it comes nor long after
    assert lengths[0] == pytest.approx(1e-2)
    assert lengths[-2] == pytest.approx(1e-2)
    # its impulse per area is sqrt(pi) 2000 * 0.004
    assert momentum(solution, 0.4)[0] == pytest.approx([0, 0, 2 * 2000 * 0.004 * np.sqrt(np.pi)], rel=1.5e-2)


def test_of_many_steps_some_are_kept_evenly_and_the_last(monkeypatch):
    case = moving(0.1)
    whole = solve(case, cells=(2, 2), time_step=0.01)
    monkeypatch.setattr(motion, "FRAMES", 4)
    solution = solve(case, cells=(2, 2), time_step=0.01)
    assert whole.times == pytest.approx(np.linspace(0, 0.1, 11))
    assert solution.times == pytest.approx([0, 0.03, 0.06, 0.09, 0.1])
    assert len(steps_of(solution)) == len(steps_of(whole)) == 10
    points = case.surface.domain.grid(3, 3).reshape(-1, 2)
    for t in (0.0, 0.03, 0.09, 0.1):
        assert np.allclose(solution.displacement(points, t), whole.displacement(points, t), rtol=0, atol=1e-12)


def failing(after, least=np.inf):
    """Return a step that does not converge after a time, unless it is shorter than `least`."""
    original = time_step.MovingShell.step

    def step(self, start, h):
        if start.t + h > after and h > least:
            raise NotConvergedError
        return original(self, start, h)

    return step


def test_a_step_that_does_not_converge_is_cut_and_grows_again(monkeypatch):
    original = time_step.MovingShell.step
    refused = []

    def step(self, start, h):
        if 0.1 < start.t + h < 0.15 and h > 0.003:
            refused.append(h)
            raise NotConvergedError
        return original(self, start, h)

    monkeypatch.setattr(time_step.MovingShell, "step", step)
    solution = solve(moving(), cells=(2, 2), time_step=1e-2)
    lengths = np.diff([0.0, *(s.at for s in steps_of(solution))])
    assert refused
    assert lengths.min() < 0.003
    assert lengths[-2] == pytest.approx(1e-2)
    assert steps_of(solution)[-1].at == pytest.approx(0.3)


def test_a_step_that_cannot_be_cut_ends_the_motion_and_keeps_what_was_reached(monkeypatch):
    asked = [KINETIC | {"at": 0.1}, STRAIN | {"at": 0.3}]
    case = moving(quantities=asked)
    whole = solve(case, cells=(2, 2), time_step=1e-2)
    monkeypatch.setattr(time_step.MovingShell, "step", failing(0.2, least=0.0))
    with pytest.raises(SolveFailure) as caught:
        solve(case, cells=(2, 2), time_step=1e-2)
    message = str(caught.value)
    assert re.fullmatch(
        r"on 2 x 2 cells a step of \S+ s did not converge at t = 0\.(2|19\d*) s, and it can't be cut further", message
    )
    partial = caught.value.partial
    assert 0.15 < partial.times[-1] <= 0.2 + 1e-12
    assert steps_of(partial)[-1].at == partial.times[-1]
    assert partial.diagnostics["time_steps"] == len(steps_of(partial))
    kinetic = case.quantity("kinetic")
    assert measure(partial, kinetic) == pytest.approx(measure(whole, kinetic), rel=1e-9)
    with pytest.raises(InputError, match=r"solved from 0 to 0\."):
        measure(partial, case.quantity("strain"))


def test_a_load_that_blows_up_ends_the_motion_in_one_sentence():
    """It is harmless at the nine times that a case is checked at."""
    blast = {"kind": "area", "vector": [0, 0, "1e12*exp(-((t - 0.13)/0.002)**2)"]}
    with pytest.raises(SolveFailure) as caught:
        solve(moving(loads=[FALLING, blast]), cells=(2, 2), time_step=1e-2)
    assert "\n" not in str(caught.value)
    assert "can't be cut further" in str(caught.value)
    assert 0.1 < caught.value.partial.times[-1] < 0.15


def test_when_not_even_the_first_step_converges_there_is_no_motion(monkeypatch):
    monkeypatch.setattr(time_step.MovingShell, "step", failing(0.0, least=0.0))
    with pytest.raises(SolveFailure, match=r"^on 2 x 2 cells a step of .*: no step in time converged$") as caught:
        solve(moving(), cells=(2, 2), time_step=1e-2)
    assert caught.value.partial is None


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_an_interrupt_is_not_swallowed(monkeypatch, error):
    def step(self, start, h):
        raise error

    monkeypatch.setattr(time_step.MovingShell, "step", step)
    with pytest.raises(error):
        solve(moving(), cells=(2, 2), time_step=1e-2)


def test_too_little_memory_is_one_sentence(monkeypatch):
    def step(self, start, h):
        raise MemoryError

    monkeypatch.setattr(time_step.MovingShell, "step", step)
    with pytest.raises(SolveFailure, match="memory"):
        solve(moving(), cells=(2, 2), time_step=1e-2)


# levels


SPRUNG = {"name": "bed", "stiffness": 40}


def test_levels_are_refined_and_say_how_sure_they_are(monkeypatch):
    """A rigid sheet on springs: its mean height is known, and the last level's uncertainty covers its error."""
    monkeypatch.setattr(motion, "BASE", 4)
    monkeypatch.setattr(motion, "MOST_STEPS", 16)
    monkeypatch.setattr(motion, "FEWEST_STEPS", 16)
    quantities = [
        {"name": "height", "kind": "centre_of_mass", "direction": [0, 0, 1], "at": 0.5},
        KINETIC | {"at": 0.5},
    ]
    case = moving(0.5, quantities, supports=[], springs=[SPRUNG], loads=[FALLING])
    solution = solve(case, tolerance=1e-12)
    levels = [s for s in solution.history if s.phase == "solve"]
    assert len(levels) == motion.MOST_LEVELS
    assert all(set(level.quantities) == {"largest", "height", "kinetic"} for level in levels)
    assert levels[0].unknowns < levels[1].unknowns < levels[2].unknowns
    assert dict(levels[-1].quantities) == pytest.approx(dict(measure_all(solution)), rel=1e-9)
    w = np.sqrt(40 / DENSITY)
    expected = -9.8 / w**2 * (1 - np.cos(0.5 * w))
    errors = [abs(level.quantities["height"] - expected) for level in levels]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.15)
    assert errors[2] <= solution.uncertainty["height"] <= 10 * errors[2]
    assert abs(solution.extrapolated["height"] - expected) < 0.1 * errors[2]
    assert solution.diagnostics["rates"]["height"] == pytest.approx(2, abs=0.2)
    assert not solution.diagnostics["converged"]
    assert solution.diagnostics["relative_uncertainty"] > 1e-12
    steps = [solution.diagnostics["usual_time_step"], 0.5 / len(steps_of(solution))]
    assert steps[0] == pytest.approx(steps[1], rel=1e-2)
    loose = solve(case, tolerance=1e-2)
    assert loose.diagnostics["converged"]
    assert len([s for s in loose.history if s.phase == "solve"]) == 2


def test_a_motion_is_no_surer_for_being_small(monkeypatch):
    monkeypatch.setattr(motion, "BASE", 3)
    monkeypatch.setattr(motion, "MOST_STEPS", 8)
    monkeypatch.setattr(motion, "FEWEST_STEPS", 8)

    def pressed(by):
        case = moving(0.05, [STRAIN | {"at": 0.05}], loads=[{"kind": "area", "vector": [0, 0, by]}], material=MATERIAL)
        return solve(case, tolerance=1e-6)

    # So small that all is linear: a thousandth of the load moves the shell a thousandth as far.
    more, less = pressed(1e-6), pressed(1e-9)
    assert less.uncertainty["largest"] == pytest.approx(1e-3 * more.uncertainty["largest"], rel=1e-3)
    assert less.diagnostics["relative_uncertainty"] == pytest.approx(more.diagnostics["relative_uncertainty"], rel=1e-3)
    assert less.diagnostics["relative_uncertainty"] > 1e-6


def test_levels_on_one_mesh_say_nothing_of_its_error(monkeypatch):
    """Between kinks there is a least number of cells, which may be more than any level asks for."""
    monkeypatch.setattr(motion, "BASE", 3)
    monkeypatch.setattr(motion, "MOST_STEPS", 4)
    monkeypatch.setattr(motion, "FEWEST_STEPS", 4)
    steps = " + ".join(f"where(xi1 < {at}, 1, 0)" for at in (0.5, 1.0, 1.5))
    load = {"kind": "area", "vector": [0, 0, steps]}
    solution = solve(moving(0.02, supports=[EDGE], loads=[load]), tolerance=1e-12)
    levels = [s for s in solution.history if s.phase == "solve"]
    assert len({level.unknowns for level in levels}) == 1
    assert len(levels) == motion.MOST_LEVELS
    assert levels[0].quantities["largest"] != levels[-1].quantities["largest"]  # the steps are shorter
    assert not solution.uncertainty
    assert solution.diagnostics["relative_uncertainty"] is None
    assert not solution.diagnostics["converged"]


def test_meshes_that_hardly_grow_leave_all_of_an_error_of_fourth_order(monkeypatch):
    """Two levels whose values differ by such an error alone, on meshes of 3 x 2 and 4 x 2 cells."""
    asked, cells = [KINETIC | {"at": 0.02}], [(3, 2), (4, 2)]
    monkeypatch.setattr(motion, "MOST_LEVELS", 2)
    monkeypatch.setattr(motion, "usual_cells", lambda case, level, grading: cells[level])
    monkeypatch.setattr(
        motion,
        "measure_all",
        lambda found: dict.fromkeys(("largest", "kinetic"), 1.0 + math.prod(found.mesh.cells) ** -2.0),
    )
    solution = solve(moving(0.02, asked), tolerance=1e-12)
    assert solution.uncertainty["kinetic"] == pytest.approx(8.0**-2, rel=1e-9)


@pytest.mark.parametrize("order", [1.0, 1.5])
def test_three_meshes_that_grow_unevenly_by_whole_cells_show_the_rate_of_time(monkeypatch, order):
    """Errors fall with the step alone, which halves; a rate by the cells' growth would be near nothing."""
    asked, cells, error = [KINETIC | {"at": 0.02}], [(2, 1), (3, 1), (4, 1)], 1e-2
    monkeypatch.setattr(motion, "usual_cells", lambda case, level, grading: cells[level])
    fallen = iter(1.0 + error * 2.0 ** (-order * level) for level in range(3))
    monkeypatch.setattr(motion, "measure_all", lambda found: dict.fromkeys(("largest", "kinetic"), next(fallen)))
    solution = solve(moving(0.02, asked), tolerance=1e-12)
    left = error * 2.0 ** (-2 * order)
    assert left <= solution.uncertainty["kinetic"] <= 4 * left


def test_settings_fix_one_level():
    case = moving(0.1)
    for settings in ({"cells": (3, 2)}, {"time_step": 0.01}, {"cells": (3, 2), "time_step": 0.01}):
        solution = solve(case, **settings)
        assert len([s for s in solution.history if s.phase == "solve"]) == 1
        assert not solution.uncertainty
        assert solution.diagnostics["relative_uncertainty"] is None
        if "time_step" in settings:
            assert len(steps_of(solution)) == 10
        if "cells" in settings:
            assert solution.mesh.cells == (3, 2)


def test_the_spectral_radius_damps():
    """Ringing that a step does not resolve dies out, and the sooner the less the radius."""
    energies = []
    for radius in (0.0, 0.9):
        stiff = MATERIAL | {"youngs_modulus": 1e7}
        case = moving(0.4, material=stiff, supports=[EDGE], loads=[{"kind": "area", "vector": [100, 0, 0]}])
        solution = solve(case, cells=(2, 1), time_step=0.02, spectral_radius=radius)
        assert solution.diagnostics["spectral_radius"] == radius
        points, weights = area_rule(case)
        energies.append(float(weights @ np.sum(solution.velocity(points, 0.4) ** 2, axis=-1)))
    assert energies[0] < 0.1 * energies[1]


@pytest.mark.parametrize(
    "settings", [{"time_step": 0}, {"time_step": -1}, {"spectral_radius": 1.0}, {"spectral_radius": -0.1}]
)
def test_impossible_settings_are_refused(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        FemSettings(**settings)


# what is declined


def test_what_it_can_not_do_is_declined_in_a_clause():
    solver = FemSolver()
    bent = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": 1.0}
    lifted = EDGE | {"clamped": True, "motion": {"kind": "value", "z": "xi2*t**2"}}
    turned = EDGE | {"clamped": True, "motion": {"kind": "rotation", "axis": [0, 1, 0], "angle": "9*t**2"}}
    floor = {"kind": "plane", "centre": [0, 0, -1], "normal": [0, 0, 1]}
    for case, words in (
        (moving(supports=[lifted]), "clamped support 'edge' by a formula"),
        (moving(supports=[turned], obstacles=[floor]), "turn the clamped support 'edge' beside obstacles"),
        (moving(loads=[bent]), "moments on edges"),
    ):
        assert words in solver.declines(case)
        with pytest.raises(InputError, match="fem can't take test: "):
            solver.solve(case, FemSettings())
    for name in (
        "free_fall",
        "pendulum_strip",
        "napkin_plane",
        "napkin_soft_pin",
        "napkin_corner",
        "napkin_moving_corners",
    ):
        assert solver.declines(catalog.named_case(name)) is None


def test_progress_tells_mesh_and_time():
    told = []
    FemSolver().solve(moving(0.1), FemSettings(cells=(2, 2), time_step=0.01), progress=told.append)
    assert [p.step for p in told] == sorted(p.step for p in told)
    assert (told[-1].step, told[-1].total) == (1000, 1000)
    assert re.fullmatch(r"2 x 2 cells, t = 0.1 s", told[-1].message)


def test_free_fall_end_to_end():
    case = catalog.named_case("free_fall")
    solution = solve(case, cells=(1, 1), time_step=0.05)
    assert measure_all(solution)["fall_500ms"] == pytest.approx(9.8 / 8, rel=1e-8)
    assert measure_all(solution)["fall_1000ms"] == pytest.approx(4.9, rel=1e-8)
    assert measure_all(solution)["kinetic_energy_1000ms"] == pytest.approx(0.144 * 9.8**2 / 2, rel=1e-8)
    assert abs(measure_all(solution)["total_energy_1000ms"]) < 1e-7


@pytest.mark.long
def test_the_napkin_in_its_plane_drifts_less_than_a_tenth_of_a_millijoule():
    solution = solve(catalog.named_case("napkin_plane"), cells=(8, 8), time_step=1 / 240)
    assert solution.mesh.cells == (16, 16)
    assert len(steps_of(solution)) == 120
    assert solution.diagnostics["energy_drift"] < 1e-4


def test_data_of_a_case_are_not_touched():
    data = {"title": "t", "theory": NONLINEAR, "surface": {"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}, "material": SOFT,
            "dynamics": {"until": 0.1}, "quantities": [LARGEST | {"at": 0.1}], "loads": [FALLING]}  # fmt: skip
    case = build_case(copy.deepcopy(data), "a", "b")
    before = case.digest()
    solve(case, cells=(1, 1), time_step=0.05)
    assert case.digest() == before
