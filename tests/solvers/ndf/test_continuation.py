"""Following a path: three ways along it, landing on marks, and what happens at a limit point."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from shellbench.protocol.load_curve import Curve
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs, graded_points
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.path.continuation import arc_length_steps, displacement_steps, load_steps
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.stepping.control import PathEndsError
from tests.solvers.ndf.shells import shell, support

PLACEMENT = Placement()
ARCH = {"kind": "cylinder", "axis": "y", "radius": 10, "xi1": [80, 90], "xi2": [0, 1]}
DOWN = np.array([[0.0, 0.0, -1.0]])


def problem_of(case, width=24, scale=2.0):
    spec = FieldSpec(strain="exact", stretched=False, multipliers=0)
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, scale)), width, 0)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    rule = RuleSpec((4, 3), 5)
    return PathProblem(spec, build_ansatz(case, spec), features, rule, graded_points(case, spec)).independent()


@pytest.fixture(scope="module")
def arch():
    """Half of a shallow arch on a hinge under its own weight, which snaps through; and its crown's deflection."""
    case = shell(
        ARCH, {"poissons_ratio": 0.0, "thickness": 0.04}, theory="kirchhoff-love-nonlinear",
        supports=[support("hinge", "xi1_min"), support("crown", "xi1_max", symmetry="x")],
        loads=[{"kind": "area", "vector": [0, 0, "-500*t"]}],
    )  # fmt: skip
    problem = problem_of(case)
    return problem, problem.row(np.array([[np.pi / 2, 0.5]]), DOWN)


@pytest.fixture(scope="module")
def plate():
    """A held plate, which stiffens; and its centre's deflection."""
    rim = support("rim", "xi1_min", "xi1_max", "xi2_min", "xi2_max")
    case = shell("plane", theory="kirchhoff-love-nonlinear", supports=[rim],
                 loads=[{"kind": "area", "vector": [0, 0, "-300*t"]}])  # fmt: skip
    problem = problem_of(case, 16)
    return problem, problem.row(np.array([[1.0, 0.0]]), DOWN)


@pytest.fixture(scope="module")
def snapped(arch):
    problem, row = arch
    return list(displacement_steps(problem, row, (0.1, 0.2), 0.36))


def test_marks_are_landed_on(plate):
    problem, row = plate
    states = list(load_steps(problem, (0.3, 0.31, 1.0)))
    factors = [s.t for s in states]
    assert {0.3, 0.31, 1.0} <= set(factors)
    assert factors == sorted(set(factors))
    assert all(s.stable for s in states)
    values = [float(row @ s.weights) for s in displacement_steps(problem, row, (0.01, 0.025), 0.03)]
    assert values == sorted(values)
    for mark in (0.01, 0.025, 0.03):
        assert min(abs(v - mark) for v in values) < 1e-12


@pytest.mark.parametrize("follow", [displacement_steps, pytest.param(arc_length_steps, marks=pytest.mark.long)])
def test_all_ways_along_a_path_meet_the_same_states(plate, follow):
    problem, row = plate
    *_, loaded = load_steps(problem, (0.8,))
    deflection = float(row @ loaded.weights)
    *_, reached = follow(problem, row, (deflection / 2,), deflection)
    assert reached.t == pytest.approx(0.8, rel=1e-6)
    assert reached.deformed.potential == pytest.approx(loaded.deformed.potential, rel=1e-6)


def test_displacement_control_passes_a_limit_point(arch, snapped):
    _, row = arch
    curve = Curve(np.array([0.0, *(s.t for s in snapped)]), np.array([0.0, *(float(row @ s.weights) for s in snapped)]))
    (top, at_top), (valley, at_valley) = (curve.turning_point("load", k) for k in (1, 2))
    assert 0 < at_top < at_valley < 0.36
    assert valley < top
    assert snapped[-1].t > valley
    for state in snapped:  # between the two no load holds the arch
        value = float(row @ state.weights)
        if at_top * 1.05 < value < at_valley * 0.95:
            assert not state.stable
        elif value < at_top * 0.95 or value > at_valley * 1.05:
            assert state.stable


def test_arc_length_passes_the_same_limit_point(arch, snapped):
    """Its first step is long against the bend of the path; it must not end on another branch."""
    problem, row = arch
    states = list(arc_length_steps(problem, row, (0.1, 0.2), 0.36))
    values = np.array([float(row @ s.weights) for s in states])
    for mark in (0.1, 0.2, 0.36):
        assert np.abs(values - mark).min() < 1e-12
        by_arc = states[int(np.abs(values - mark).argmin())]
        by_displacement = min(snapped, key=lambda s: abs(float(row @ s.weights) - mark))
        assert by_arc.t == pytest.approx(by_displacement.t, rel=1e-5)
    curves = [
        Curve(np.array([0.0, *(s.t for s in path)]), np.array([0.0, *(float(row @ s.weights) for s in path)]))
        for path in (states, snapped)
    ]
    (first, _), (second, _) = (c.turning_point("load", 1) for c in curves)
    assert first == pytest.approx(second, rel=1e-2)  # as well as either curve's few states tell it


def test_load_control_ends_at_the_limit_point(arch, snapped):
    """It gets within a thousandth of it, by stable states alone, and says where it ended."""
    problem, row = arch
    limit = max(s.t for s in snapped if float(row @ s.weights) < 0.2)
    states = []
    with pytest.raises(PathEndsError, match="load factor"):
        states.extend(load_steps(problem, (4 * limit,)))
    assert all(s.stable for s in states)
    assert limit * 0.999 < states[-1].t < limit * 1.01


def test_work_along_the_path_is_the_strain_energy(plate):
    """The loads grow in proportion: U = integral of t d(f . w), by the trapezoidal rule along the states."""
    problem, _ = plate
    states = list(load_steps(problem, tuple(np.linspace(0.02, 1.0, 50))))
    works = [0.0, *(s.deformed.work / s.t for s in states)]  # of the full load
    factors = [0.0, *(s.t for s in states)]
    total = sum((b + a) / 2 * (w - v) for (a, b), (v, w) in zip(pairwise(factors), pairwise(works), strict=True))
    assert total == pytest.approx(states[-1].deformed.membrane + states[-1].deformed.bending, rel=1e-3)


def test_small_loads_give_the_linear_answer():
    """At t = 1e-6 every weight is a millionth of the linear one."""
    case = shell("hypar", theory="kirchhoff-love-nonlinear", supports=[support("wall", "xi1_min", clamped=True)],
                 loads=[{"kind": "gravity", "acceleration": [0, 0, "-t"]}])  # fmt: skip
    problem = problem_of(case, 12)
    (*_, small) = load_steps(problem, (1e-6,))
    linear = torch.linalg.solve(problem._stiffness, problem.forces(1.0)[0])
    torch.testing.assert_close(1e6 * small.weights, linear, rtol=0, atol=1e-5 * float(linear.abs().max()))
