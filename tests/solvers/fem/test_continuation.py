"""Paths from rest: load steps against the elastica, displacement control and arc length through turning points."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure
from shellbench.protocol.load_curve import Curve
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.path.continuation import arc_length_steps, displacement_steps, dof_row, load_steps
from shellbench.solvers.fem.path.newton import equilibrium
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import PathEndsError
from tests.solvers.fem.shells import PLANE, shell

SHORTEST = 2e-4  # load step
# a marched path and the marks on it: deflections of the roofs, mm
THICK, THICK_MARKS, THICK_END = "hinged_roof_thick", (10.0, 20.0), 30.0
THIN, THIN_MARKS, THIN_END = "hinged_roof_thin", (12.0, 16.5, 18.0, 24.0), 28.0


def problem_of(case, cells):
    mesh = graded_mesh(case, cells, 2.0)
    return FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))


def roof(name, cells=(4, 4)):
    problem = problem_of(catalog.named_case(name), cells)
    return problem, dof_row(problem, problem.case.quantity("deflection"))


def values(row, states):
    return np.array([float(np.sum(row * state.q)) for state in states])


def curve(row, states):
    return Curve(np.array([0.0, *(state.t for state in states)]), np.array([0.0, *values(row, states)]))


def followed(steps):
    """Return the states of a path, and why it ends."""
    states = []
    try:
        for state in steps:
            states.append(state)
    except PathEndsError as error:
        return states, str(error)
    return states, ""


def true_tangent(problem, state):
    """Return the tangent (n, n) at a state itself on what the supports leave free."""
    ties = problem.ties(state.t)
    matrix = ties.reduce(problem.tangent(state.q, state.t, state.strained, state.strained.stresses)).to_csr().toarray()
    free = np.flatnonzero(ties.free.ravel())
    return matrix[np.ix_(free, free)]


def elastica(force, stiffness, length):
    """Return the tip's shortening and deflection of an inextensible cantilever under a dead end force across it."""

    s = np.linspace(0, length, 41)
    y = np.zeros((4, len(s)))  # theta, its derivative, x, z
    y[2] = s
    for share in np.linspace(0.1, 1, 10):
        load = share * force / stiffness
        found = solve_bvp(
            lambda _, y, load=load: np.stack([y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]),
            lambda start, end: np.array([start[0], end[1], start[2], start[3]]),
            s, y, tol=1e-10, max_nodes=20_000,
        )  # fmt: skip
        assert found.success
        s, y = found.x, found.y
    return length - y[2, -1], y[3, -1]


def test_load_steps_of_a_strip_follow_the_elastica():
    case = catalog.named_case("cantilever_shear")
    problem = problem_of(case, (8, 1))
    shortening, deflection = (dof_row(problem, case.quantity(f"{name}_4")) for name in ("shortening", "deflection"))
    marks = (0.25, 0.5, 1.0)
    states = list(load_steps(problem, marks, 1 / 8, SHORTEST))
    stiffness = case.material.youngs_modulus * case.material.thickness**3 / 12
    for mark in marks:
        (state,) = [s for s in states if s.t == mark]
        expected = elastica(4 * mark, stiffness, 10.0)
        # the strip stretches by P / E h, 3e-5 at most, which the elastica does not
        assert float(np.sum(shortening * state.q)) == pytest.approx(expected[0], rel=1e-3)
        assert float(np.sum(deflection * state.q)) == pytest.approx(expected[1], rel=1e-3)


def test_load_steps_land_on_every_mark_and_never_turn_back():
    problem = problem_of(catalog.named_case("square_plate_nonlinear"), (2, 2))
    marks = (0.1, 0.101, 0.7, 1.0)
    states = list(load_steps(problem, marks, 0.3, SHORTEST))
    factors = [state.t for state in states]
    assert np.all(np.diff([0.0, *factors]) > 0)
    assert set(marks) <= set(factors)
    assert factors[-1] == 1.0
    assert np.diff([0.0, *factors]).max() <= 0.6 + 1e-12  # the first step, or twice as long after easy ones
    assert all(state.stable for state in states)


def test_load_steps_go_on_from_a_state():
    problem = problem_of(catalog.named_case("square_plate_nonlinear"), (2, 2))
    *_, half = load_steps(problem, (0.5,), 0.25, SHORTEST)
    *_, onward = load_steps(problem, (0.5, 1.0), 0.25, SHORTEST, half)
    *_, straight = load_steps(problem, (1.0,), 0.125, SHORTEST)
    assert onward.t == straight.t == 1.0
    assert np.allclose(onward.q, straight.q, rtol=0, atol=1e-9 * np.abs(straight.q).max())


def test_load_steps_end_at_a_limit_point():
    data = catalog.named_case(THICK).model_dump(mode="json", exclude_unset=True, exclude={"name"})
    deflection = next(q for q in data["quantities"] if q["name"] == "deflection")
    quantities = [deflection | {"at": 2.5, "primary": True}]
    case = build_case(data | {"path": {"until": 2.5}, "quantities": quantities}, "roof", "test")
    problem = problem_of(case, (4, 4))
    reached, reason = followed(load_steps(problem, case.states, 0.3, SHORTEST))
    assert re.fullmatch(r"no equilibrium was found at load factor 2\.2\d*", reason)
    assert all(state.stable for state in reached)
    # the limit load by displacement control on the same mesh
    other, row = roof(THICK)
    highest = max(state.t for state in displacement_steps(other, row, (), 15.0))
    assert reached[-1].t == pytest.approx(highest, rel=2e-3)


@pytest.fixture(scope="module")
def thick():
    problem, row = roof(THICK)
    return problem, row, list(displacement_steps(problem, row, THICK_MARKS, THICK_END))


def test_displacement_control_passes_both_limit_points(thick):
    problem, row, states = thick
    load = np.array([state.t for state in states])
    deflection = values(row, states)
    assert np.all(np.diff(deflection) > 0)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load))))
    assert len(turns) == 2  # up, down, up
    top, valley = turns + 1
    assert 9 < deflection[top] < 13
    assert 17 < deflection[valley] < 21
    # between the limit points, and only there, the tangent under dead load is indefinite
    for state, value in zip(states, deflection, strict=True):
        negative = np.count_nonzero(np.linalg.eigvalsh(true_tangent(problem, state)) < 0)
        if value < deflection[top] - 1 or value > deflection[valley] + 1:
            assert negative == 0
        elif deflection[top] + 1 < value < deflection[valley] - 1:
            assert negative >= 1
        if min(abs(value - deflection[top]), abs(value - deflection[valley])) > 1:
            assert state.stable == (negative == 0)


def test_limit_points_do_not_depend_on_the_length_of_steps(thick):
    problem, row, states = thick
    coarse = list(displacement_steps(problem, row, THICK_MARKS, THICK_END, 1 / 12))
    assert len(coarse) < 0.7 * len(states)
    for number in (1, 2):
        (load, at), (other, there) = (curve(row, found).turning_point("load", number) for found in (states, coarse))
        assert other == pytest.approx(load, rel=1e-4)
        assert there == pytest.approx(at, rel=1e-3)


def test_every_state_of_the_path_is_in_equilibrium(thick):
    problem, _, states = thick
    for state in states:
        ties = problem.ties(state.t)
        unbalanced = ties.to_free((problem.forces(state.q, state.t) - state.strained.forces)[..., None])
        assert np.abs(unbalanced).max() <= 1e-5 * np.abs(state.strained.forces).max()


def test_displacement_control_lands_on_every_mark(thick):
    _, row, states = thick
    deflection = values(row, states)
    for mark in (*THICK_MARKS, THICK_END):
        assert np.abs(deflection - mark).min() <= 1e-11 * mark
    assert deflection[-1] == pytest.approx(THICK_END, rel=1e-11)


def test_displacement_and_load_control_meet_on_the_rising_branch(thick):
    problem, row, states = thick
    state = next(s for s, value in zip(states, values(row, states), strict=True) if value > 6)
    *_, loaded = load_steps(problem, (state.t,), state.t / 4, SHORTEST)
    assert np.allclose(loaded.q, state.q, rtol=0, atol=1e-5 * np.abs(state.q).max())


def test_displacement_control_ends_where_the_displacement_turns_back():
    """The thin roof's centre snaps back: beyond some 17 mm no state of this branch has a larger deflection."""
    problem, row = roof(THIN, (3, 3))
    reached, reason = followed(displacement_steps(problem, row, (), 40.0))
    assert re.fullmatch(r"no equilibrium was found at a displacement of 1\d\.\d*", reason)
    assert 16 < values(row, reached)[-1] < 18


@pytest.fixture(scope="module")
def thin():
    problem, row = roof(THIN, (3, 3))
    return problem, row, list(arc_length_steps(problem, row, THIN_MARKS, THIN_END))


def test_arc_length_passes_the_snap_back(thin):
    _, row, states = thin
    load, deflection = np.array([state.t for state in states]), values(row, states)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load))))
    backs = np.flatnonzero(np.diff(np.sign(np.diff(deflection))))
    assert len(turns) == 2
    assert len(backs) == 2
    assert turns[0] < backs[0] < backs[1] < turns[1]  # maximal load, snap-back and its return, minimal load
    assert load.min() < 0 < load.max()


def test_arc_length_never_turns_round(thin):
    problem, _, states = thin
    path = np.array([problem.at_rest().q, *(state.q for state in states)])[:, :, ::4].reshape(len(states) + 1, -1)
    steps = np.diff(path, axis=0)
    cosines = (
        np.sum(steps[1:] * steps[:-1], axis=1) / np.linalg.norm(steps[1:], axis=1) / np.linalg.norm(steps[:-1], axis=1)
    )
    assert cosines.min() > 0.5
    assert np.linalg.norm(steps, axis=1).max() < 0.1 * np.linalg.norm(path[-1])


def test_arc_length_lands_on_every_mark_at_its_first_passage(thin):
    _, row, states = thin
    deflection = values(row, states)
    for mark in (*THIN_MARKS, THIN_END):
        there = np.flatnonzero(np.abs(deflection - mark) <= 1e-9 * mark)
        assert len(there) == 1
        assert np.all(deflection[: there[0]] < mark)  # also where the deflection later takes this value again
    assert np.flatnonzero(np.diff(np.sign(deflection - 16.5))).size >= 3
    assert deflection[-1] == pytest.approx(THIN_END, rel=1e-11)


def test_both_controls_follow_the_same_path(thick):
    problem, row, states = thick
    along = list(arc_length_steps(problem, row, THICK_MARKS, THICK_END))
    for mark in (*THICK_MARKS, THICK_END):
        first, second = (s[int(np.argmin(np.abs(values(row, s) - mark)))] for s in (states, along))
        assert second.t == pytest.approx(first.t, rel=1e-6)
        assert np.allclose(first.q, second.q, rtol=0, atol=1e-6 * np.abs(first.q).max())


def test_arc_length_does_not_depend_on_the_unit_of_load(thin):
    """Loads a thousand times smaller, load factors a thousand times larger: the same states."""
    data = catalog.named_case(THIN).model_dump(mode="json", exclude_unset=True, exclude={"name"})
    (load,) = data["loads"]
    case = build_case(data | {"loads": [load | {"force": [0, 0, "-0.25*t"]}]}, "roof", "test")
    problem = problem_of(case, (3, 3))
    states = list(arc_length_steps(problem, dof_row(problem, case.quantity("deflection")), THIN_MARKS, THIN_END))
    assert len(states) == len(thin[2])
    factors = np.array([[ours.t, theirs.t] for ours, theirs in zip(states, thin[2], strict=True)])
    assert np.allclose(factors[:, 0], 1000 * factors[:, 1], rtol=0, atol=1e-3)


def test_turning_points_by_arc_length_do_not_depend_on_the_length_of_steps(thin):
    """Short steps crowd at them, so that a curve through the states turns where the path does."""
    problem, row, states = thin
    fine = list(arc_length_steps(problem, row, THIN_MARKS, THIN_END, 1 / 96))
    assert len(states) < 0.6 * len(fine)
    for of in ("load", "displacement"):
        for number in (1, 2):
            (load, at), (other, there) = (curve(row, found).turning_point(of, number) for found in (states, fine))
            exact, loose = (load / other, at / there) if of == "load" else (at / there, load / other)
            assert exact == pytest.approx(1, abs=1e-8)
            assert loose == pytest.approx(1, abs=3e-5)


@pytest.mark.long
def test_states_on_a_coarser_mesh_lead_along_the_path_on_a_finer_one(monkeypatch):
    case = catalog.named_case(THIN)
    made = []
    tangent = FiniteProblem.tangent
    monkeypatch.setattr(FiniteProblem, "tangent", lambda self, *args: made.append(self) or tangent(self, *args))

    def followed_on(cells, trail=None):
        found, states = large_displacement.solve(case, graded_mesh(case, cells, 2.0), 7, (1 / 8, SHORTEST), trail)
        count = len(made)
        made.clear()
        return found.solution, states, count

    _, trail, _ = followed_on((5, 5))
    (led, again, few), (alone, _, many) = followed_on((7, 6), trail), followed_on((7, 6))
    for at in case.states:
        one, other = (found.coefficients[..., found.state(at)] for found in (led, alone))
        assert np.allclose(one, other, rtol=0, atol=1e-7 * np.abs(other).max())
    ours, others = (Curve.of(found.history, "deflection") for found in (led, alone))
    for own, of in enumerate(("load", "displacement")):
        found, expected = ours.turning_point(of, 1), others.turning_point(of, 1)
        assert found[own] == pytest.approx(expected[own], rel=1e-6)
        assert found[1 - own] == pytest.approx(expected[1 - own], rel=1e-3)  # where something else has its extremum
    assert few < 0.8 * many
    assert len(again.states) == len(led.history)


def test_the_functional_is_the_displacement_quantity():
    """At points that are no nodes as well, with several directions."""
    mean = {
        "name": "mean", "kind": "displacement", "primary": True,
        "points": ["a", "b"], "direction": [[0, 0, 2], [3, 4, 0]],
    }  # fmt: skip
    supports = [{"name": "wall", "on": ["xi1_min"], "clamped": True}]
    case = shell(
        PLANE, theory="kirchhoff-love-nonlinear", supports=supports, points={"a": [0.3, 0.77], "b": [2, 1]}, quantities=[mean],
        loads=[{"kind": "area", "vector": [0, 0, "t"]}],
    )  # fmt: skip
    problem = problem_of(case, (3, 3))
    row = dof_row(problem, case.primary)
    state = equilibrium(problem, problem.at_rest(), 0.5)
    mesh = problem.mesh
    coefficients = (state.q.reshape(-1, 3, 4) / mesh.node_scales[:, None, :])[..., None]
    solution = FemSolution(case, mesh, coefficients, (1.0,), np.zeros(0, dtype=int), np.zeros((1, 0, 3, 4, 1)), 7, 0)
    assert float(np.sum(row * state.q)) == pytest.approx(measure(solution, case.primary), rel=1e-12)
