"""Newton's law for a field: free fall, a pendulum of rods, conserved energy, reactions, and how runs end."""

from functools import partial

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.quantities.measure import measure
from shellbench.solvers.ndf.field.build import build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.motion import integration, motion
from shellbench.solvers.ndf.motion.motion_solution import MotionSolution
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.strains.smooth import scales, width_for
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from tests.alike import alike
from tests.solvers.ndf.shells import shell, support

SOLVER = NdfSolver()
RHO, G = 0.2, 9.8
SOFT = {"youngs_modulus": 2e3, "poissons_ratio": 0.3, "thickness": 0.002, "areal_density": RHO}
PIN = {"name": "pin", "stiffness": "600*exp(-(xi1**2 + xi2**2)/(2*0.2**2))"}
FALL = {"kind": "gravity", "acceleration": [0, 0, -G]}
DOWN = {"kind": "gravity", "acceleration": [0, -G, 0]}
PLANE = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.8]}
AREA = 0.8
GRID = np.stack(np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 0.8, 5), indexing="ij"), axis=-1)
WIDTH = 67  # degree 6


def moving(until=0.2, material=None, **data):
    quantities = [{"name": "height", "kind": "centre_of_mass", "direction": [0, 0, 1], "at": until, "primary": True}]
    return shell(PLANE, {**SOFT, **(material or {})}, **{
        "theory": "kirchhoff-love-nonlinear", "supports": [], "loads": [FALL], "quantities": quantities,
        "dynamics": {"until": until}, **data,
    })  # fmt: skip


def solve(case, width=WIDTH, **choices):
    return SOLVER.solve(case, TrainerSettings(widths=(width,), **choices))


def equations(case, degree=5, points=2.0):
    """The equations of motion of random features up to a degree."""
    spec = FieldSpec(stretched=False, multipliers=0, strain="exact")
    inputs, placement = build_inputs(case, spec), Placement()
    spread = placement.tensor(scales(case, inputs, degree))
    network = random_features(spread, width_for(case, degree), 0)
    features = build_features(case, spec, network, placement, inputs)
    with torch.no_grad():
        return motion.prepare_motion(case, spec, motion.MotionLevel(degree, features), points)


@pytest.fixture(scope="module")
def hung():
    """A napkin in space that hangs from a soft pin, pulled out of its plane as well."""
    return solve(moving(springs=[PIN], loads=[{"kind": "gravity", "acceleration": [0, -G, 2.0]}]))


RITZ = {"neurons": RitzSettings(neurons=WIDTH), "placed": RitzSettings(degrees=(4,), hidden="placed")}


@pytest.mark.parametrize("recipe", ["ndf", *RITZ])
def test_a_free_shell_falls_and_is_not_strained(recipe):
    case = moving(until=0.5)
    solution = solve(case) if recipe == "ndf" else RitzSolver().solve(case, RITZ[recipe])
    for t in (0.0, 0.013, 0.31, 0.5):
        expected = np.tile([0, 0, -G * t**2 / 2], (*GRID.shape[:-1], 1))
        np.testing.assert_allclose(solution.displacement(GRID, t), expected, rtol=0, atol=1e-11)
        np.testing.assert_allclose(solution.velocity(GRID, t), 2 * expected / max(t, 1e-300), rtol=0, atol=1e-9)
        assert sum(solution.energies(t)) < 1e-15
    alike(solution.displacement(GRID), solution.displacement(GRID, 0.5))


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"degrees": (5,), "neurons": 60}, "it does not go with degrees"),
        ({"hidden": "placed", "activation": "tanh"}, "places sines, but found activation = 'tanh'"),
    ],
)
def test_settings_of_motions_that_do_not_fit_are_refused(settings, reason):
    with pytest.raises(InputError, match=reason):
        RitzSolver().solve(moving(), RitzSettings(**settings))
    with pytest.raises(InputError, match="square_plate stands still: settings degrees and hidden belong to motions"):
        RitzSolver().solve(named_case("square_plate"), RitzSettings(degrees=(5,)))


def test_energy_is_conserved(hung):
    steps = [step for step in hung.history if step.phase == "time"]
    assert [step.at for step in steps] == sorted(step.at for step in steps)
    assert steps[-1].at == 0.2
    exchanged = hung.balance(0.2).total
    assert exchanged > 1e-2
    assert hung.diagnostics["energy_drift"] == max(abs(step.energy) for step in steps) < 1e-7 * exchanged
    assert hung.diagnostics["energy_gap"] < 1e-4
    work = AREA * RHO * (np.array([0, -G, 2.0]) @ mean_displacement(hung, 0.2))
    assert abs(exchanged - work) < 1e-4 * work


def mean_displacement(solution, t):
    nodes, w = np.polynomial.legendre.leggauss(20)
    points = np.stack(np.meshgrid((nodes + 1) / 2, 0.4 * (nodes + 1), indexing="ij"), axis=-1)
    return np.einsum("i,j,ijc->c", w / 2, w / 2, solution.displacement(points, t))


def test_the_momentum_of_a_hung_napkin_obeys_newton(hung):
    """Mean acceleration, by differences of the displacement: gravity less the pin's pull over the mass."""
    nodes, w = np.polynomial.legendre.leggauss(40)
    points = np.stack(np.meshgrid((nodes + 1) / 2, 0.4 * (nodes + 1), indexing="ij"), axis=-1)
    weights = np.multiply.outer(w, w) * AREA / 4
    t, step = 0.12, 2e-3
    before, now, after = (hung.displacement(points, at) for at in (t - step, t, t + step))
    acceleration = np.einsum("ij,ijc->c", weights, before - 2 * now + after) / step**2 / AREA
    stiffness = 600 * np.exp(-np.sum(points**2, axis=-1) / (2 * 0.2**2))
    pull = np.einsum("ij,ijc->c", weights * stiffness, now)
    assert np.linalg.norm(pull) > 0.1 * RHO * AREA * G
    np.testing.assert_allclose(acceleration, np.array([0, -G, 2.0]) - pull / (RHO * AREA), atol=2e-3 * G)


def test_motion_is_the_same_seen_from_another_side():
    """The same napkin in another plane, with springs and gravity turned along, moves as the turned field."""
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x -> y -> z -> x
    surface = {"kind": "expression", "x": "0", "y": "xi1", "z": "xi2", "xi1": [0, 1], "xi2": [0, 0.8]}
    first = moving(until=0.1, springs=[PIN], loads=[{"kind": "gravity", "acceleration": [1, -G, 2]}])
    data = first.model_dump(mode="json", exclude_unset=True, exclude={"name"})
    data |= {"surface": surface, "loads": [{"kind": "gravity", "acceleration": [2, 1, -G]}]}
    second = shell(**{k: v for k, v in data.items() if k != "title"})
    one, other = solve(first), solve(second)
    u = one.displacement(GRID)
    np.testing.assert_allclose(other.displacement(GRID), u @ turn.T, rtol=0, atol=1e-6 * np.abs(u).max())


def test_plane_motion_stays_in_its_plane():
    case = moving(supports=[support("plane", "surface", components=["z"])], springs=[PIN],
                  loads=[{"kind": "gravity", "acceleration": [0, -G, 5.0]}])  # fmt: skip
    solution = solve(case)
    u = solution.displacement(GRID, 0.15)
    assert np.all(u[..., 2] == 0)
    assert np.abs(u[..., 1]).max() > 0.05
    force, _ = solution.reaction("plane", at=0.15)
    assert force[2] == pytest.approx(-RHO * AREA * 5.0, rel=1e-9)
    assert solution.parameters == 2 * solution.diagnostics["independent_features"]


def test_a_held_edge_takes_up_what_the_momentum_lacks():
    solution = solve(moving(supports=[support("edge", "xi1_min")]), 81)
    t, step = 0.1, 1e-3
    assert np.abs(solution.displacement([[0, 0.3], [0, 0.8]], t)).max() < 1e-12
    before, after = (momentum(solution, at) for at in (t - step, t + step))
    force, _ = solution.reaction("edge", at=t)
    weight = np.array([0, 0, -G * RHO * AREA])
    np.testing.assert_allclose(force, (after - before) / (2 * step) - weight, rtol=0, atol=1e-3 * abs(weight[2]))


def momentum(solution, t):
    nodes, w = np.polynomial.legendre.leggauss(30)
    points = np.stack(np.meshgrid((nodes + 1) / 2, 0.4 * (nodes + 1), indexing="ij"), axis=-1)
    return RHO * AREA / 4 * np.einsum("i,j,ijc->c", w, w, solution.velocity(points, t))


def test_points_are_moved_as_prescribed_and_their_work_is_counted():
    path = ["0.3*t**2", "0", "0.5*t**2"]
    corner = support("corner", "xi1_min,xi2_min", motion={"kind": "translation", "vector": path})
    solution = solve(moving(supports=[corner], loads=[]))
    for t in (0.05, 0.2):
        np.testing.assert_allclose(solution.displacement([0, 0], t), [0.3 * t**2, 0, 0.5 * t**2], rtol=0, atol=1e-8)
    force, _ = solution.reaction("corner", at=0.1)
    before, after = (momentum(solution, at) for at in (0.1 - 1e-3, 0.1 + 1e-3))
    np.testing.assert_allclose(force, (after - before) / 2e-3, rtol=0, atol=2e-3 * np.linalg.norm(force))
    assert solution.diagnostics["energy_drift"] < 1e-6 * solution.balance(0.2).total


def test_edges_are_moved_as_prescribed_and_their_work_is_counted():
    edge = support("edge", "xi1_min", motion={"kind": "translation", "vector": ["0.5*t**2", 0, "t**2"]})
    solution = solve(moving(until=0.05, supports=[edge], loads=[{"kind": "area", "vector": [0, "3*t", 0]}]), 25)
    for t in (0.03, 0.05):
        moved = np.array([[0.5 * t**2, 0, t**2]] * 2)
        np.testing.assert_allclose(solution.displacement([[0, 0.1], [0, 0.7]], t), moved, rtol=0, atol=1e-12)
        np.testing.assert_allclose(solution.velocity([[0, 0.1], [0, 0.7]], t), 2 * moved / t, rtol=0, atol=1e-8)
    assert solution.diagnostics["energy_drift"] < 1e-6 * solution.balance(0.2).total


def test_uniform_pulling_of_a_free_shell_by_a_load_that_grows():
    """rho u'' = 3 t: u = t^3 / (2 rho)."""
    solution = solve(moving(loads=[{"kind": "area", "vector": [0, 0, "3*t"]}]))
    np.testing.assert_allclose(solution.displacement(GRID)[..., 2], 0.2**3 / (2 * RHO), rtol=1e-9)


def test_rungs_are_climbed_until_the_motion_stands_still():
    case = moving(until=0.05, springs=[PIN], loads=[DOWN], supports=[support("plane", "surface", components=["z"])])
    solution = SOLVER.solve(case, TrainerSettings(widths=(16, 67, 110, 600)))
    rungs = [step for step in solution.history if step.phase == "solve"]
    assert len(rungs) == 3
    assert solution.diagnostics["settled"]
    assert solution.diagnostics["motion_change"] <= motion.SETTLED_MOTION
    assert [step.iteration for step in solution.history] == list(range(len(solution.history)))
    last, earlier = (step.quantities["height"] for step in (rungs[-1], rungs[-2]))
    assert solution.uncertainty["height"] == pytest.approx(abs(last - earlier), abs=1e-12)
    assert last == pytest.approx(measure(solution, case.primary), rel=1e-12)


def test_a_motion_that_needs_too_many_steps_ends_with_what_was_done(monkeypatch):
    monkeypatch.setattr(motion, "Stepping", partial(integration.Stepping, most_steps=6))
    with pytest.raises(
        SolveFailure, match=r"needs more than 6 time steps; the last time reached is 0\.\d+ s"
    ) as caught:
        solve(moving(springs=[PIN]))
    done = caught.value.partial
    assert isinstance(done, MotionSolution)
    end = float(done.course.times[-1])
    assert 0 < end < 0.2
    assert np.isfinite(done.displacement(GRID, end)).all()
    with pytest.raises(InputError, match=r"not at 0\.2 s"):
        done.displacement(GRID, 0.2)


def test_forces_that_are_no_numbers_end_a_motion_with_what_was_done():
    case = moving(until=0.2, springs=[PIN])
    run = equations(case, 3)
    accelerate = run.accelerate

    def breaks(y, velocity, t):
        acceleration, power = accelerate(y, velocity, t)
        return (acceleration * float("nan"), power) if t > 0.05 else (acceleration, power)

    object.__setattr__(run, "accelerate", breaks)
    track = integration.Track()
    with pytest.raises(integration.StuckError, match="can't be cut any further"), torch.no_grad():
        for _ in integration.integrate(run, case.states, integration.Stepping(), track):
            pass
    assert 0.02 < track.times[-1] <= 0.05
    assert all(np.isfinite(np.concatenate(known)).all() for known, _ in track.states)


def test_an_exploited_quadrature_is_refused():
    with pytest.raises(SolveFailure, match="exploits its quadrature") as caught:
        solve(moving(springs=[PIN]), 16, largest_gap=1e-13)
    assert caught.value.partial.course.times[-1] == 0.2


def test_what_can_not_be_followed_is_declined():
    moment = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": 1}
    assert "edge moments" in SOLVER.declines(moving(loads=[moment]))
    assert SOLVER.declines(moving()) is None
    with pytest.raises(InputError, match="can't take test"):
        solve(moving(loads=[moment]))


def test_a_clamped_edge_is_not_credited_with_what_the_plane_exerts():
    plane = {"name": "plane", "on": ["surface"], "components": ["z"]}
    edge = {"name": "edge", "on": ["xi1_min"], "components": ["x", "y"], "clamped": True}
    pushed = {"kind": "gravity", "acceleration": [0.5, -G, 2.0]}
    solution = solve(moving(0.03, supports=[plane, edge], loads=[pushed]))
    of_plane, of_edge = (solution.reaction(name, at=0.02)[0] for name in ("plane", "edge"))
    assert of_plane == pytest.approx([0, 0, -2.0 * RHO * AREA], abs=1e-9)
    assert of_edge[2] == pytest.approx(0, abs=1e-12)
    assert of_edge[1] > 0


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("DefaultCPUAllocator: can't allocate memory")])
def test_a_finer_field_that_does_not_fit_into_memory_leaves_the_coarser_motion(monkeypatch, error):
    original, calls = motion.prepare_motion, []

    def prepare_motion(*arguments):
        calls.append(arguments)
        if len(calls) > 1:
            raise error
        return original(*arguments)

    monkeypatch.setattr(motion, "prepare_motion", prepare_motion)
    monkeypatch.setattr(motion, "SETTLED_MOTION", 0.0)
    with pytest.raises(SolveFailure, match="does not fit into memory; what is kept is the whole motion") as caught:
        SOLVER.solve(moving(springs=[PIN]), TrainerSettings())
    assert caught.value.partial.course.times[-1] == 0.2
