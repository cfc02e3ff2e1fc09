"""Clamped rims that turn by finite angles, critical loads, and stable states beyond them."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from shellbench.problems.shell.quantities.measure import measure
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs, graded_points
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.field.supports import edge_samples, edge_supports
from shellbench.solvers.ndf.linear.declines import violations, why_declined
from shellbench.solvers.ndf.motion.motion_solution import load_solution
from shellbench.solvers.ndf.path import buckling
from shellbench.solvers.ndf.path.buckling import NEUTRAL, follow_steps, trust_region_step
from shellbench.solvers.ndf.path.continuation import load_steps
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import PathState, equilibrium
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.stepping.control import NotConvergedError, PathEndsError
from tests.solvers.ndf.shells import differences, inner_points, shell, support

PLACEMENT = Placement()
NONLINEAR = "kirchhoff-love-nonlinear"


def turn(angle, axis=(0, 1, 0), centre=(0, 0, 0)):
    """A rotation by an angle in degrees, which may be a formula."""
    return {"kind": "rotation", "axis": list(axis), "centre": list(centre), "angle": angle}


def tube(bottom, top, surface="tube", **data):
    """A closed tube whose two rims are clamped."""
    rims = [
        support("bottom", "xi2_min", clamped=True, motion=bottom),
        support("top", "xi2_max", clamped=True, motion=top),
    ]
    return shell(surface, theory=NONLINEAR, **{"supports": rims, **data})


TWISTED = tube(turn("-40*t"), turn("40*t"))
SKEW = tube(turn("50*t", (1, 2, 0), (0.3, 0, 1)), turn("-70*t", (0, 1, 3), (0, 2, 0)))
MIXED = tube({"kind": "translation", "vector": ["0.3*t", "t", 0]}, turn("120*t"))
ONE = shell(
    "hypar", theory=NONLINEAR, supports=[support("wall", "xi1_min", clamped=True, motion=turn("100*t", (1, 2, 3)))]
)
CASES = {"twisted tube": TWISTED, "skew tube": SKEW, "turned and shifted": MIXED, "one wall": ONE}


def field_of(case, t, amplitude=0.3, width=12):
    """A random field on a case at load factor t."""
    spec = FieldSpec(strain="exact", stretched=False, multipliers=0, t=t)
    inputs = build_inputs(case, spec)
    features = build_features(
        case, spec, random_features(PLACEMENT.tensor(np.full(inputs.count, 1.5)), width, 0), PLACEMENT, inputs
    )
    output = torch.randn((3, features.count), generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    return Field(build_ansatz(case, spec), features, amplitude * output, torch.zeros(6).double())


def problem_of(case, width, scale, rule):
    spec = FieldSpec(strain="exact", stretched=False, multipliers=0)
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, scale)), width, 0)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    return PathProblem(spec, build_ansatz(case, spec), features, rule, graded_points(case, spec)).independent()


@pytest.mark.parametrize("t", [0.3, 1.0])
@pytest.mark.parametrize("name", CASES)
def test_a_clamped_rim_that_turns_carries_positions_and_normals_along(name, t):
    """Whatever the network says, at any angle."""
    case = CASES[name]
    field = field_of(case, t)
    for rim in edge_supports(case):
        points = edge_samples(case, rim.edge)
        u = field.jet(points).numpy()
        x = case.surface.derivatives(points, 1)
        motion = rim.slope.motion
        rotated, centre = Rotation.identity(), np.zeros(3)
        shift = np.zeros(3)
        if motion.kind == "rotation":
            axis = np.asarray(motion.axis) / np.linalg.norm(motion.axis)
            rotated = Rotation.from_rotvec(np.radians(case.scalar(motion.angle, t)) * axis)
            centre = np.asarray(motion.centre)
        else:
            shift = np.array([case.scalar(part, t) for part in motion.vector])
        where = centre + rotated.apply(x[0, 0] - centre) + shift
        np.testing.assert_allclose(x[0, 0] + u[VALUE], where, atol=1e-12)
        normals = [np.cross(a, b) for a, b in ((x[1, 0], x[0, 1]), (x[1, 0] + u[D1], x[0, 1] + u[D2]))]
        before, after = (n / np.linalg.norm(n, axis=-1, keepdims=True) for n in normals)
        np.testing.assert_allclose(after, rotated.apply(before), atol=1e-11)
        assert max(violations(field, rim)) < 1e-11
    assert why_declined(case) is None


def test_a_rim_whose_normal_stays_behind_is_seen():
    """The check of the supports tells a turned normal from one that was left where it was."""
    wrong = field_of(shell("tube", theory=NONLINEAR, supports=[
        support("bottom", "xi2_min", motion=turn("-40*t", (1, 0, 0))), support("top", "xi2_max", motion=turn("40*t")),
    ]), 1.0)  # fmt: skip
    right = field_of(tube(turn("-40*t", (1, 0, 0)), turn("40*t")), 1.0)
    rim = next(s for s in edge_supports(right.ansatz.case) if s.edge.name == "xi2_min")
    assert violations(right, rim)[1] < 1e-11
    value, slope = violations(Field(wrong.ansatz, right.features, right.output, right.rigid), rim)
    assert value < 1e-11
    assert slope > 1e-3


@pytest.mark.parametrize("name", CASES)
def test_lift_and_axes_are_differentiated_exactly(name):
    case = CASES[name]
    ansatz, points = field_of(case, 0.8).ansatz, inner_points(case)
    found = ansatz.lift.jet(points, PLACEMENT).numpy()
    expected = differences(lambda p: ansatz.lift.jet(p, PLACEMENT)[VALUE].numpy(), points)
    np.testing.assert_allclose(found, expected, atol=2e-7 * np.abs(expected).max())
    axes = ansatz.lift.axes(points, PLACEMENT).numpy()
    expected = differences(lambda p: ansatz.lift.axes(p, PLACEMENT)[VALUE].numpy(), points)
    np.testing.assert_allclose(axes, expected, atol=2e-7 * np.abs(expected).max())
    np.testing.assert_allclose(axes[VALUE] @ axes[VALUE].swapaxes(-1, -2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-13)


def test_a_rigid_rotation_of_both_rims_strains_nothing():
    same = turn("150*t", (1, 2, 3), (0.5, -1, 2))
    problem = problem_of(tube(same, same), 12, 1.5, RuleSpec((6, 3), 4))
    rest = PathState.rest(problem)
    turned = problem.deform(rest.weights, 1.0)
    stiffness = problem.ansatz.case.material.membrane_stiffness * problem.area
    assert turned.membrane + turned.bending < 1e-24 * stiffness
    found = equilibrium(problem, rest, 1.0)
    assert found.deformed.potential < 1e-24 * stiffness
    assert found.stable


def test_forces_and_tangents_of_turned_fields_match_differences():
    problem = problem_of(SKEW, 10, 1.5, RuleSpec((6, 3), 4))
    generator = torch.Generator().manual_seed(5)
    weights, direction = (torch.randn(3 * problem.features.count, generator=generator).double() for _ in range(2))
    t, step = 0.7, 1.0  # combinations of features are of unit energy, far less than the lift's

    def at(s):
        return problem.deform(weights + s * direction, t)

    slope = (8 * (at(step).potential - at(-step).potential) - at(2 * step).potential + at(-2 * step).potential) / 12
    assert float(-at(0.0).residual @ direction) == pytest.approx(slope, rel=1e-6)
    bend = (8 * (at(-step).residual - at(step).residual) + at(2 * step).residual - at(-2 * step).residual) / 12
    torch.testing.assert_close(problem.tangent(at(0.0), t) @ direction, bend, rtol=1e-6, atol=1e-8 * float(bend.norm()))


@pytest.mark.parametrize(
    ("reason", "change"),
    [
        ("in all components by one support", {"supports": [
            support("a", "xi2_min", clamped=True, motion=turn("t")), support("b", "xi2_max", components=["z"])]}),
        ("moved by prescribed values", {"supports": [
            support("a", "xi2_min", clamped=True, motion=turn("t")),
            support("b", "xi2_max", motion={"kind": "value", "x": "t*xi1"})]}),
        ("beside supports at points", {"points": {"p": [1, 1]}, "supports": [
            support("a", "xi2_min", clamped=True, motion=turn("t")), support("b", "p")]}),
        ("beside edge moments", {
            "supports": [support("a", "xi2_min", clamped=True, motion=turn("t"))],
            "loads": [{"kind": "moment", "on": ["xi2_max"], "axis": [1, 0, 0], "value": "t"}], "surface": "hypar"}),
        ("where supported edges meet", {"surface": "roof", "supports": [
            support("a", "xi2_min", clamped=True, motion=turn("t")), support("b", "xi1_min")]}),
    ],
)  # fmt: skip
def test_what_can_not_be_turned_is_declined(reason, change):
    data = {"surface": "tube", **change}
    case = shell(data.pop("surface"), theory=NONLINEAR, **data)
    assert reason in (why_declined(case) or "accepted")


@pytest.mark.parametrize("lowest", [2.0, 0.0, -0.7])
@pytest.mark.parametrize("slope", [0.0, 1e-3, 5.0])
def test_a_trust_region_step_is_the_best_one_in_the_ball(lowest, slope):
    """The conditions of Moré & Sorensen: (K + mu) s = -g with K + mu semidefinite, mu >= 0, and mu (|s| - r) = 0."""
    values = torch.tensor([lowest, 2.5, 3.0, 40.0]).double()
    gradient = torch.tensor([slope, -0.3, 0.0, 2.0]).double()
    radius = 0.2
    step = trust_region_step(values, gradient, radius)
    length = float(step.norm())
    assert length <= radius * (1 + 1e-9)
    model = float(gradient @ step + (values * step * step).sum() / 2)
    generator = torch.Generator().manual_seed(1)
    others = torch.randn(4000, 4, generator=generator).double()
    others = (
        radius * others / others.norm(dim=1, keepdim=True) * torch.rand(4000, 1, generator=generator).double() ** 0.2
    )
    assert model <= float((others @ gradient + (others**2 @ values) / 2).min()) + 1e-12
    used = step.abs() > 1e-9
    shift = -(gradient / step + values)[used]
    if length < radius * (1 - 1e-9):
        torch.testing.assert_close(shift, torch.zeros_like(shift), atol=1e-6, rtol=0)
    else:
        assert float(shift.min()) >= max(0.0, -lowest) - 1e-6
        torch.testing.assert_close(shift, shift[:1].expand_as(shift), atol=1e-5, rtol=1e-6)


LAST = {"name": "last", "kind": "reaction", "support": "right", "direction": [-1, 0, 0], "at": 0.6, "primary": True}
STRUT = {"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.3]}


def strut(**data):
    """A clamped plate strip whose ends are moved toward each other; its axial strain is t / 100."""
    ends = [
        support("left", "xi1_min", clamped=True),
        support("right", "xi1_max", clamped=True, motion={"kind": "translation", "vector": ["-t/100", 0, 0]}),
    ]
    return shell(
        STRUT, {"youngs_modulus": 1e6, "poissons_ratio": 0.0, "thickness": 0.02}, theory=NONLINEAR, supports=ends,
        **{"path": {"until": 0.6, "after_buckling": "follow", "states": [0.05, 0.3]}, "quantities": [LAST], **data},
    )  # fmt: skip


# A strip that shortens by e has the strain eps = -e + e^2/2, and buckles in a wave of 2 pi where D l^2 eps = -B (2 pi)^2
# / l^2, all per reference length and l its stretch: eps (1 + 2 eps) = -B/D (2 pi)^2 to the first order in B/D.
EULER = (2 * np.pi) ** 2 * 0.02**2 / 12


@pytest.fixture(scope="module")
def problem():
    return problem_of(strut(), 40, 2.5, RuleSpec((5, 2), 6))


@pytest.fixture(scope="module")
def states(problem):
    return list(follow_steps(problem, strut().states))


def test_a_strut_buckles_at_eulers_load(states):
    critical = next(state for state in states if state.critical)
    assert critical.t / 100 == pytest.approx(EULER, rel=5e-3)
    assert [s.t for s in states if s.critical] == [critical.t]


def test_a_path_may_end_where_the_shell_buckles(problem, states):
    critical = next(state for state in states if state.critical)
    asked = {"name": "load", "kind": "critical_point", "primary": True}

    def path_of(*marks):
        case = strut(path={"until": 0.6, "states": list(marks)}, quantities=[asked])
        return follow_steps(replace(problem, ansatz=replace(problem.ansatz, case=case)), case.path_marks)

    *others, last = path_of(0.05)
    assert last.critical
    assert last.t == pytest.approx(critical.t, rel=2e-4)
    assert 0.05 in [state.t for state in others]
    with pytest.raises(PathEndsError, match="the shell buckles at load factor"):
        list(path_of(0.3))


def test_the_critical_load_is_where_the_smallest_eigenvalue_changes_sign(problem, states):
    critical = next(state for state in states if state.critical)
    before, after = (equilibrium(problem, critical, share * critical.t) for share in (1 - 1e-3, 1 + 1e-3))
    assert before.tangent.lowest > 0 > after.tangent.lowest
    assert not after.stable
    zero = np.interp(0.0, [-before.tangent.lowest, -after.tangent.lowest], [before.t, after.t])
    assert critical.t == pytest.approx(zero, rel=2e-4)


def test_what_is_followed_is_stable_and_has_less_energy_than_the_flat_strut(problem, states):
    critical = next(state for state in states if state.critical)
    beyond = [state for state in states if state.t > critical.t]
    assert {0.3, 0.6} <= {state.t for state in beyond}
    flat = problem.ansatz.case.material.membrane_stiffness * problem.area
    for state in beyond:
        tangent = problem.basis.combine.T @ problem.tangent(state.deformed, state.t) @ problem.basis.combine
        assert float(torch.linalg.eigvalsh(tangent)[0]) > -NEUTRAL
        strain = -state.t / 100 + (state.t / 100) ** 2 / 2
        assert state.deformed.potential < flat * strain**2 / 2
        assert state.deformed.bending > 0.01 * state.deformed.potential


def test_the_axial_force_is_what_the_energy_says(problem, states):
    """The derivative of the energy in the load factor, by differences along the path, is the work of the support."""
    last = states[-1]
    ends = [equilibrium(problem, last, last.t + change) for change in (-1e-3, 1e-3)]
    along = (ends[1].deformed.potential - ends[0].deformed.potential) / 2e-3
    frozen = [problem.deform(last.weights, last.t + change).potential for change in (-1e-3, 1e-3)]
    assert (frozen[1] - frozen[0]) / 2e-3 == pytest.approx(along, rel=1e-4)


@pytest.mark.long
def test_a_finer_path_starts_from_the_states_of_a_coarser_one(problem, states):
    """It meets the same states as from rest, in fewer iterations; waves that buckle at another load do not serve."""
    marks = strut().states
    finer = problem_of(strut(), 60, 2.5, RuleSpec((5, 2), 6))
    near = []
    for state in states:
        if state.critical or state.t in marks:
            weights = finer.fit_weights(problem, state.weights)
            near.append(replace(state, weights=weights, deformed=finer.deform(weights, state.t), tangent=None))
            assert near[-1].deformed.potential == pytest.approx(state.deformed.potential, rel=1e-2)
    alone, led = list(follow_steps(finer, marks)), list(follow_steps(finer, marks, near))
    assert sum(state.iterations for state in led) < sum(state.iterations for state in alone)
    critical = [next(state.t for state in path if state.critical) for path in (alone, led)]
    assert critical[1] == pytest.approx(critical[0], rel=1e-3)
    for mark in marks:
        energies = [next(s.deformed.potential for s in path if s.t == mark) for path in (alone, led)]
        assert energies[1] == pytest.approx(energies[0], rel=1e-5)
    earlier = [replace(state, t=0.9 * state.t) if state.critical else state for state in near]
    assert len(list(follow_steps(finer, marks, earlier))) > len(led)


def test_without_following_the_path_ends_where_the_strut_buckles(problem):
    with pytest.raises(PathEndsError, match="not stable"):
        list(load_steps(problem, strut().states))


def test_a_shell_that_does_not_relax_keeps_what_was_found(problem, monkeypatch):
    def stuck(*_):
        raise NotConvergedError

    monkeypatch.setattr(buckling, "relax_to_stable", stuck)
    found = []
    with pytest.raises(PathEndsError, match="no stable state"):
        found.extend(follow_steps(problem, strut().states))
    solver, case = RitzSolver(), strut(quantities=[QUANTITIES[0]])
    partial = solver.solve(case, RitzSettings(neurons=40, scale=2.5, panels=(5, 2)))
    assert "no stable state" in partial.diagnostics["path_end"]
    assert [step.phase for step in partial.history].count("critical") == 1
    assert measure(partial, case.quantities[0]) == pytest.approx(100 * EULER, rel=5e-3)


def test_a_path_that_does_not_get_on_ends(problem, monkeypatch):
    """Where no step converges, however short, and nothing is about to buckle, the search must not go on for ever."""
    monkeypatch.setattr(buckling, "_step_to", lambda *_, **__: None)
    with pytest.raises(PathEndsError, match="no equilibrium was found at load factor"):
        list(islice(follow_steps(problem, strut().states), 20))


QUANTITIES = [
    {"name": "critical", "kind": "critical_point", "unit": "1", "primary": True},
    {"name": "critical_force", "kind": "critical_point", "gives": "force", "unit": "N"},
    {"name": "force", "kind": "reaction", "support": "right", "direction": [-1, 0, 0], "at": 0.3},
]


@pytest.mark.long
def test_quantities_at_the_critical_point_survive_a_file(tmp_path):
    case = strut(quantities=QUANTITIES)
    solution = RitzSolver().solve(case, RitzSettings(neurons=40, scale=2.5, panels=(5, 2)))
    critical, at_critical, beyond = (measure(solution, q) for q in case.quantities)
    width, stiffness = 0.3, case.material.membrane_stiffness
    strain = -critical / 100 + (critical / 100) ** 2 / 2
    assert at_critical == pytest.approx(-stiffness * width * strain * (1 - critical / 100), rel=1e-4)
    assert beyond < 1.02 * at_critical  # a clamped strut's load hardly grows once it has buckled
    read = load_solution(solution.save(tmp_path / "strut"), "ndf-ritz")
    assert [measure(read, q) for q in case.quantities] == pytest.approx([critical, at_critical, beyond], rel=1e-9)
    marks = [step.at for step in read.history if step.phase in ("path", "critical")]
    assert marks == sorted(marks)


SHORT_SLEEVE = {"kind": "cylinder", "axis": "y", "radius": 0.25, "closed": True, "xi1": [0, 360], "xi2": [0, 0.3]}


@pytest.mark.long
def test_the_torque_of_a_twisted_sleeve_is_the_derivative_of_its_energy(tmp_path):
    """And that of its membrane, 2 pi R^3 G h / L (1 + h^2 / (3 R^2)) per radian, as long as the twist is small."""
    nu, young, h, radius, length = 0.25, 5000.0, 0.012, 0.25, 0.3
    torque = {"name": "torque", "kind": "torque", "support": "top", "axis": [0, 1, 0], "at": 0.01, "primary": True}
    more = [{**torque, "name": "later", "at": 0.03, "primary": False}]
    sleeve = tube(
        turn("-t/2*180/pi"), turn("t/2*180/pi"), SHORT_SLEEVE, quantities=[torque, *more],
        path={"until": 0.03, "after_buckling": "follow", "states": [0.029]},
        material={"youngs_modulus": young, "poissons_ratio": nu, "thickness": h},
    )  # fmt: skip
    solution = RitzSolver().solve(sleeve, RitzSettings(neurons=90, panels=(10, 4)))
    shear = young / (2 * (1 + nu))
    stiffness = 2 * np.pi * radius**3 * shear * h / length * (1 + h**2 / (3 * radius**2))
    assert measure(solution, sleeve.quantities[0]) == pytest.approx(0.01 * stiffness, rel=1e-3)
    energies = [sum(solution.energies(t)) for t in (0.01, 0.03)]
    torques = [measure(solution, q) for q in sleeve.quantities]
    read = load_solution(solution.save(tmp_path / "sleeve"), "ndf-ritz")
    assert [measure(read, q) for q in sleeve.quantities] == pytest.approx(torques, rel=1e-9)
    assert energies[1] - energies[0] == pytest.approx(0.02 * sum(torques) / 2, rel=1e-3)  # the torque is next to linear


def test_a_load_step_that_jumps_to_the_buckled_shell_is_not_taken(problem, states):
    """From before the critical load Newton's method may land beyond it on a stable state: the path does not go there."""
    critical, last = next(state for state in states if state.critical), states[-1]
    start = equilibrium(problem, PathState.rest(problem), 0.9 * critical.t, NEUTRAL)
    aside = PathState(start.t, last.weights, problem.deform(last.weights, start.t), 1, start.tangent)
    assert buckling._step_to(problem, start, critical.t * 0.95) is not None
    landed = equilibrium(problem, aside, last.t, NEUTRAL)
    ahead = start.tangent.solve(problem.deform(start.weights, last.t).residual)
    assert problem.cosine(ahead, landed.weights - start.weights) < 0.7
    assert problem.cosine(ahead, 3 * ahead) == pytest.approx(1.0)
    assert problem.cosine(ahead, 0 * ahead) == 1.0
