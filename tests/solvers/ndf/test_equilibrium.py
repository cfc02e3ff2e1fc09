"""Equilibrium at finite strain: forces and tangents against differences, the unknowns, and Newton's method."""

from functools import cache

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs, graded_points
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import Basis, Constraint, PathState, Tangent, equilibrium, on_path, path_rate
from shellbench.solvers.stepping.control import NotConvergedError
from tests.solvers.ndf.shells import FREE, inner_points, shell, support, with_force

PLACEMENT = Placement()
RULE = RuleSpec((3, 3), 5)
NONLINEAR = "kirchhoff-love-nonlinear"
ALL = ("xi1_min", "xi1_max", "xi2_min", "xi2_max")
WALL = support("wall", "xi1_min", clamped=True)
AREA = {"kind": "area", "vector": ["3*t*sin(xi1)", "20*t", "-50*t*xi2"]}
GRAVITY = {"kind": "gravity", "acceleration": [0, "-40*t", 0]}
EDGE = {"kind": "edge", "on": ["xi1_max"], "vector": ["30*t", "10*t*xi2", "-90*t"]}
MOMENT = {"kind": "moment", "on": ["xi1_max"], "axis": [0.1, -1, 0.3], "value": "200*t*(1 + xi2)"}
SHIFT = {"kind": "translation", "vector": ["0.2*t", "-0.1*t", "0.3*t"]}
CASES = {
    "hypar": with_force(
        shell("hypar", theory=NONLINEAR, points={"p": [0.2, 0.3]}, supports=[WALL], loads=[AREA, EDGE]),
        "p", ("5*t", "-20*t", "100*t"),
    ),
    "moved roof": shell(
        "roof", theory=NONLINEAR, loads=[GRAVITY],
        supports=[support("end", "xi2_min"), support("jaw", "xi2_max", clamped=True, motion=SHIFT)],
    ),
    "strip with a moment": shell("plane", theory=NONLINEAR, supports=[WALL], loads=[MOMENT, EDGE]),
    "helicoid with a moment": shell("helicoid", theory=NONLINEAR, supports=[WALL], loads=[MOMENT]),
    "roof that slides": shell(
        "roof", theory=NONLINEAR, supports=[support("d", "xi2_min", "xi2_max", components=["x", "y"])],
        remove_rigid_motions=FREE[2:3], loads=[{"kind": "area", "vector": [0, "-60*t", 0]}],
    ),
    "plate on a foot": shell(
        "plane", theory=NONLINEAR, points={"p": [1.5, 0.5]},
        supports=[WALL, support("foot", "p", components=["x", "z"],
                                motion={"kind": "translation", "vector": [0, 0, "0.2*t"]})],
        loads=[{"kind": "area", "vector": [0, 0, "-50*t"]}],
    ),
}  # fmt: skip
STRAINS = ("exact", "published", "linear")


@cache
def problem_of(name, strain="exact", width=10):
    """The equilibrium of one of `CASES`."""
    return problem_for(CASES[name], strain, width)


def problem_for(case, strain="exact", width=10):
    """The equilibrium of a few random features."""
    spec = FieldSpec(strain=strain, stretched=False, multipliers=0)
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 2.0)), width, 0)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    return PathProblem(spec, build_ansatz(case, spec), features, RULE, graded_points(case, spec))


def drawn(problem, size=1.0, seed=0):
    """Output weights (3 M,) of displacements about as large as `size`."""
    generator = torch.Generator().manual_seed(seed)
    count = problem.features.count
    return size * torch.randn(3 * count, generator=generator, dtype=torch.float64) / count**0.5


def derivative(function, step):
    """Fourth-order central difference of a function of one number at zero."""
    return (8 * (function(step) - function(-step)) - function(2 * step) + function(-2 * step)) / (12 * step)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("t", [0.4, 1.0])
def test_gradients_are_those_of_the_field(name, t):
    problem = problem_of(name)
    weights = drawn(problem)
    ansatz, output = problem.ansatz_at(t), weights.view(3, -1)
    field = Field(ansatz, problem.features, output, torch.zeros(6, dtype=torch.float64))
    sampled = problem.sampled
    found = sampled.gradients(output, sampled.lift_gradients(ansatz))
    expected = sampled.undeformed.gradients(field.jet(sampled.points))
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-11 * float(expected.abs().max()))


@pytest.mark.parametrize("name", CASES)
def test_what_is_pulled_back_does_the_same_work(name):
    problem = problem_of(name)
    weights, sampled = drawn(problem), problem.sampled
    conjugate = torch.randn(len(problem.weights), 15, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    work = (conjugate * sampled.gradients(weights.view(3, -1)).flatten(1)).sum()
    assert float(sampled.pull_back(conjugate) @ weights) == pytest.approx(float(work), rel=1e-11)


def anchored(problem, weights, t):
    """The potential energy with what holds the free rigid motions."""
    return problem.deform(weights, t).potential + float((problem.anchor @ weights).square().sum()) / 2


@pytest.mark.sampled(7)
@pytest.mark.parametrize("strain", STRAINS)
@pytest.mark.parametrize("name", CASES)
def test_the_residual_is_the_slope_of_the_potential(name, strain):
    problem, t = problem_of(name, strain), 0.7
    weights = drawn(problem)
    residual = problem.deform(weights, t).residual
    for seed in (1, 2):
        direction = drawn(problem, seed=seed)
        slope = derivative(lambda s, v=direction: anchored(problem, weights + s * v, t), 1e-3)
        assert float(residual @ direction) == pytest.approx(-slope, rel=1e-6)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("strain", STRAINS)
@pytest.mark.parametrize("name", CASES)
def test_the_tangent_is_the_slope_of_the_residual(name, strain):
    problem, t = problem_of(name, strain), 0.7
    weights = drawn(problem)
    tangent = problem.tangent(problem.deform(weights, t), t, weights)
    torch.testing.assert_close(tangent, tangent.T, rtol=0, atol=0)
    for seed in (1, 2):
        direction = drawn(problem, seed=seed)
        slope = derivative(lambda s, v=direction: problem.deform(weights + s * v, t).residual, 1e-3)
        torch.testing.assert_close(tangent @ direction, -slope, rtol=1e-7, atol=1e-8 * float(slope.abs().max()))


def test_the_linear_measure_makes_a_quadratic_energy():
    problem = problem_of("hypar", "linear")
    rest, weights = torch.zeros_like(drawn(problem)), drawn(problem)
    at_rest, loaded = (problem.tangent(problem.deform(w, 1.0), 1.0, w) for w in (rest, weights))
    torch.testing.assert_close(at_rest, loaded, rtol=1e-13, atol=0)


@pytest.mark.parametrize("name", ["hypar", "moved roof"])
def test_stresses_are_predicted_to_first_order(name):
    problem = problem_of(name)
    weights, change = drawn(problem), drawn(problem, seed=1)
    deformed = problem.deform(weights, 1.0)
    errors = []
    for step in (1e-3, 5e-4):
        exact = problem.deform(weights + step * change, 1.0).stresses
        errors.append(float((problem.predicted_stresses(deformed, step * change) - exact).norm()))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("name", ["hypar", "strip with a moment"])
def test_the_rate_of_the_forces_is_their_derivative(name):
    problem = problem_of(name)
    weights = drawn(problem)
    rate = derivative(lambda s: problem.deform(weights, 0.5 + s).residual, 1e-2)
    expected = problem.force_rate(weights)
    torch.testing.assert_close(expected, rate, rtol=1e-7, atol=1e-8 * float(rate.abs().max()))


@pytest.mark.parametrize("name", ["hypar", "plate on a foot", "roof that slides"])
def test_unknowns_are_of_unit_stiffness_and_keep_what_is_held(name):
    problem = problem_of(name, width=40)  # nearly dependent features
    for chosen in (problem, problem.independent()):
        stiffness = chosen.tangent(PathState.rest(chosen).deformed, 0.0)
        basis, held = Basis.from_stiffness(stiffness, chosen.constraints), chosen.constraints
        identity = torch.eye(basis.size, dtype=torch.float64)
        torch.testing.assert_close(basis.combine.T @ stiffness @ basis.combine, identity, rtol=0, atol=1e-3)
        size = float(basis.combine.abs().max() * held.abs().max()) if len(held) else 1.0
        assert float((held @ basis.combine).abs().max() if len(held) else 0.0) < 1e-12 * size
        torch.testing.assert_close(held @ basis.held, torch.eye(len(held), dtype=torch.float64), rtol=0, atol=1e-9)
    assert problem.independent().features.count <= problem.features.count


def test_independent_combinations_are_as_good_as_the_features():
    """The state is the same, whichever basis the unknowns are in."""
    problem = problem_of("hypar", width=16)
    states = [equilibrium(p, PathState.rest(p), 0.5) for p in (problem, problem.independent())]
    first, second = (s.deformed for s in states)
    assert first.potential == pytest.approx(second.potential, rel=1e-9)
    torch.testing.assert_close(
        first.strained.strains, second.strained.strains, rtol=0, atol=1e-6 * float(first.strained.strains.abs().max())
    )


def test_a_rotated_shell_has_no_energy_and_no_forces():
    """The lift of a support on the whole surface is the finite rotation, whose strains are rounding."""
    turn = {"kind": "rotation", "axis": [1, 2, 3], "centre": [0.5, 0, 0], "angle": "270*t"}
    case = shell("hypar", theory=NONLINEAR, supports=[support("all", "surface", motion=turn)])
    problem = problem_for(case)
    deformed = problem.deform(0 * drawn(problem), 1.0)
    assert deformed.membrane + deformed.bending < 1e-20 * case.material.membrane_stiffness * problem.area
    points = inner_points(case)
    x = case.surface.position(points)
    matrix = Rotation.from_rotvec(np.radians(270) * np.array([1, 2, 3]) / np.sqrt(14)).as_matrix()
    centre = np.array([0.5, 0, 0])
    lift = problem.ansatz_at(1.0).lift.jet(points, PLACEMENT)[0].numpy()
    np.testing.assert_allclose(lift, (x - centre) @ matrix.T + centre - x, atol=1e-13)


def in_basis(problem, state):
    return float((problem.basis.combine.T @ state.residual).norm())


def residuals(problem, t, mixed, most=25):
    """Norms of the residual by Newton iteration, from rest in one step to a load factor."""
    weights = torch.zeros(3 * problem.features.count, dtype=torch.float64)
    weights = weights + problem.basis.held @ problem.targets(t)
    deformed, geometric, norms = problem.deform(weights, t), None, []
    for _ in range(most):
        norms.append(in_basis(problem, deformed))
        if norms[-1] < 1e-9 * norms[0]:
            break
        change = Tangent(problem, deformed, t, weights, geometric).solve(deformed.residual)
        geometric = problem.predicted_stresses(deformed, change) if mixed else None
        weights = weights + change
        deformed = problem.deform(weights, t, deformed.angles)
    return np.array(norms)


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("name", ["hypar", "strip with a moment", "plate on a foot"])
def test_newtons_method_converges_quadratically(name, mixed):
    """r_k+1 < C r_k^2 near the end, down to rounding, with the stresses of the state or predicted ones."""
    norms = residuals(problem_of(name), 0.05, mixed)
    near = norms[norms < 2e-2]
    assert len(near) >= 3
    assert near[-1] < 1e-8
    assert np.all(near[1:] < np.maximum(10 * near[:-1] ** 2, 1e-12))


def test_predicted_stresses_make_thin_shells_take_large_steps():
    problem = problem_of("hypar", width=16)
    pure, mixed = (len(residuals(problem, 1.0, choice)) for choice in (False, True))
    assert mixed < pure


def test_equilibrium_holds_on_the_path():
    problem = problem_of("plate on a foot", width=16)
    state = PathState.rest(problem)
    for t in (0.3, 0.6, 1.0):
        state = equilibrium(problem, state, t)
        assert state.t == t
        assert state.stable
        assert in_basis(problem, state.deformed) < 1e-6 * in_basis(problem, problem.deform(0 * state.weights, t))
        torch.testing.assert_close(problem.constraints @ state.weights, problem.targets(t), rtol=0, atol=1e-9)
    torch.testing.assert_close(problem.targets(1.0), torch.tensor([0.0, 0.2], dtype=torch.float64), rtol=0, atol=1e-15)


def test_feet_stand_where_they_are_put_though_the_wall_moves():
    """The lift of a moved wall reaches the foot: what the features add there is the difference."""
    wall = {**WALL, "motion": {"kind": "translation", "vector": [0, 0, "0.1*t"]}}
    foot = support("foot", "p", components=["y", "z"], motion={"kind": "translation", "vector": [0, 0, "-0.05*t"]})
    case = shell("plane", theory=NONLINEAR, points={"p": [1.5, 0.5]}, supports=[wall, foot])
    problem = problem_for(case)
    for t in (0.5, 1.0):
        state = equilibrium(problem, PathState.rest(problem), t)
        field = Field(problem.ansatz_at(t), problem.features, state.weights.view(3, -1), torch.zeros(6).double())
        u = field.displacement(np.array([[1.5, 0.5], [0.0, 0.3]])).numpy()
        np.testing.assert_allclose(u[0, 1:], [0, -0.05 * t], atol=1e-10)
        np.testing.assert_allclose(u[1], [0, 0, 0.1 * t], atol=1e-14)


def test_the_drift_is_the_slope_of_the_path():
    problem = problem_of("hypar", width=16)
    before, here, after = (
        equilibrium(problem, equilibrium(problem, PathState.rest(problem), 0.25), t) for t in (0.299, 0.3, 0.301)
    )
    slope = (after.weights - before.weights) / 0.002
    moved = problem.sampled.gradients
    exact, found = (moved(w.view(3, -1)) for w in (slope, path_rate(problem, here)))
    torch.testing.assert_close(found, exact, rtol=0, atol=1e-3 * float(exact.abs().max()))


def test_a_state_is_found_by_its_displacement_as_by_its_load():
    problem = problem_of("strip with a moment", width=16)
    row = problem.row(np.array([[2.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]))
    known = equilibrium(problem, PathState.rest(problem), 0.2)
    value = float(row @ known.weights)
    start = equilibrium(problem, PathState.rest(problem), 0.15)
    rate = path_rate(problem, start)
    change = (value - float(row @ start.weights)) / float(row @ rate)
    found = on_path(problem, start, Constraint(row, value), (change * rate, change))
    assert found.t == pytest.approx(0.2, rel=1e-7)
    assert float(row @ found.weights) == pytest.approx(value, rel=1e-12)


def test_rigid_motions_that_nothing_holds_cost_loads_in_balance_nothing():
    problem = problem_of("roof that slides", width=30)
    assert len(problem.anchor) == 1
    state = equilibrium(problem, PathState.rest(problem), 1.0)
    scale = state.deformed.membrane + state.deformed.bending
    assert float((problem.anchor @ state.weights).square().sum()) < 1e-12 * scale


def test_a_step_that_is_too_long_is_told():
    problem = problem_of("hypar", width=16)
    with pytest.raises(NotConvergedError):
        equilibrium(problem, PathState.rest(problem), 3e4)
