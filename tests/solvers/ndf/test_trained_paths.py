"""Hidden layers trained at the states of a path: exact slopes, certified gains, and faults that the gains show."""

from dataclasses import replace

import pytest
import torch

from shellbench.problems.shell.question.path import Path
from shellbench.solvers.ndf.field.build import (
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    path_resolution,
)
from shellbench.solvers.ndf.field.jets import VALUE, Placement
from shellbench.solvers.ndf.field.network import deep_random_features
from shellbench.solvers.ndf.path.continuation import load_steps
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.levels import PathLevel
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from shellbench.solvers.ndf.training import on_path, trainer
from shellbench.solvers.ndf.training.at_rest import field_spec
from shellbench.solvers.ndf.training.gauss_newton import flatten, unflatten
from tests.solvers.ndf.shells import shell, support

GAINED = 0.01  # of the energy, by three steps on a narrow network of the strip


def strip():
    """A strip that a force and a moment at its end bend far, and a pressure beside them."""
    return shell(
        {"kind": "plane", "xi1": [0, 3], "xi2": [0, 1]},
        {"youngs_modulus": 1e7, "thickness": 0.05, "poissons_ratio": 0.3},
        theory="kirchhoff-love-nonlinear",
        points={"tip": [3, 0.5]},
        supports=[support("wall", "xi1_min", clamped=True)],
        loads=[
            {"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "30*t"]},
            {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": "-20*t"},
            {"kind": "area", "vector": [0, 0, "5*t"]},
        ],
        quantities=[{"name": "up", "kind": "displacement", "points": ["tip"], "direction": [0, 0, 1], "primary": True}],
    )


def path(width=10):
    """Return a narrow level, its problem and the states of its path."""
    case = strip().model_copy(update={"path": Path(until=1.0)})
    spec = field_spec(TrainerSettings(), "exact")
    ansatz, inputs, placement = build_ansatz(case, spec), build_inputs(case, spec), Placement()
    values = inputs.jets(case.surface.domain.grid(20, 20).reshape(-1, 2), placement)[VALUE]
    chosen = path_resolution(case, 0)
    network = deep_random_features(values, placement.tensor(chosen.scales(inputs)), (4, 4, width), 0, "sine")
    features = build_features(case, spec, network, placement, inputs)
    focal = graded_points(case, spec)
    problem = PathProblem(spec, ansatz, features, chosen.rule, focal).independent()
    return PathLevel(features, chosen.rule, chosen.fine, focal, chosen), problem, list(load_steps(problem, (0.5, 1.0)))


@pytest.fixture(scope="module")
def bent():
    with torch.no_grad():
        yield path()


@torch.no_grad()
def test_the_slope_of_a_state_is_the_limit_of_differences(bent):
    """Loads on the area, the edge, and its moment all change with the hidden weights, at a fixed output layer."""
    level, problem, states = bent
    now = on_path.Trial.of_states(problem, states[-1:], level.fine)
    slope = on_path._energy_model(now, 0).slope * states[-1].deformed.magnitude
    theta, output = flatten(now.features.network), now.output(states[-1])
    way = torch.rand(theta.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64) - 0.5

    def energy(step):
        features = replace(now.features, network=unflatten(theta + step * way, now.features.network))
        here = replace(problem, features=features)
        return here.deform(output.reshape(-1), 1.0, states[-1].deformed.angles).potential

    assert float(slope @ way) == pytest.approx((energy(1e-5) - energy(-1e-5)) / 2e-5, rel=1e-5)


@torch.no_grad()
def gain(bent):
    """Return the mean relative energy that three steps gain, certified; 0 if there is none."""
    level, problem, states = bent
    gains = [0.0]
    on_path.trained_level(level, problem, states, 3, lambda iteration, total: gains.append(total))
    return gains[-1]


def test_training_gains_energy_at_all_states(bent):
    assert gain(bent) > GAINED


@pytest.mark.parametrize("fault", ["wrong sign", "frozen layers", "states not solved for"])
def test_faults_of_training_gain_nothing(bent, fault, monkeypatch):
    energy_gradient, network_of = on_path.energy_gradient, on_path.unflatten
    match fault:
        case "wrong sign":
            monkeypatch.setattr(on_path, "energy_gradient", lambda *a: -energy_gradient(*a))
            monkeypatch.setattr(on_path, "_moment_work", lambda now, state: 0.0)
        case "frozen layers":
            monkeypatch.setattr(on_path, "unflatten", lambda theta, like: network_of(flatten(like), like))
        case "states not solved for":
            monkeypatch.setattr(on_path, "equilibrium", lambda problem, near, t: near)
    assert not gain(bent) > GAINED


@pytest.mark.long
def test_a_trained_path_is_nearer_than_one_as_drawn():
    """At equal width, the trained network stores more of the energy of a wide one, which is right to 1e-4."""
    case = strip()
    wide, narrow, as_drawn = (
        NdfSolver().solve(case, TrainerSettings(widths=(width,), iterations=iterations, largest_gap=1.0))
        for width, iterations in ((120, 0), (10, 8), (10, 0))
    )
    up, short, drawn = (one.displacement([[3, 0.5]])[0, 2] for one in (wide, narrow, as_drawn))
    assert narrow.diagnostics["hidden_layers"] == "trained"
    assert as_drawn.diagnostics["hidden_layers"] == "as drawn"
    assert abs(short - up) < 0.1 * abs(drawn - up)


@pytest.mark.long
def test_a_trained_network_that_cannot_follow_the_path_is_dropped(monkeypatch):
    """The path of the drawn layers is an answer already, and stays."""

    def senseless(level, *given):
        network = level.features.network
        far = unflatten(1e6 * flatten(network), network)
        return replace(level, features=replace(level.features, network=far), trained=network.parameters)

    case, settings = strip(), TrainerSettings(widths=(30,), iterations=0, largest_gap=1.0)
    drawn = NdfSolver().solve(case, settings)
    monkeypatch.setattr(trainer, "trained_level", senseless)
    kept = NdfSolver().solve(case, settings.model_copy(update={"iterations": 1, "largest_gap": 1e-2}))
    assert kept.diagnostics["hidden_layers"] == "as drawn"
    assert kept.displacement([[3, 0.5]])[0, 2] == pytest.approx(drawn.displacement([[3, 0.5]])[0, 2], rel=1e-6)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"path": Path(control="displacement", quantity="up", until=0.1)}, "controlled by displacement"),
        ({"path": Path(until=1.0, after_buckling="follow")}, "buckling"),
    ],
)
def test_paths_without_a_least_energy_are_not_trained(changed, reason):
    assert reason in on_path.why_not_trained(strip().model_copy(update=changed), 60)
    assert on_path.why_not_trained(strip(), 60) is None
    assert "neurons" in on_path.why_not_trained(strip(), 600)
