"""Newton's method for the equilibrium of one mesh: its order, its reach, and what a state knows of itself."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem.algebra.factor import factorise
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path.continuation import dof_row
from shellbench.solvers.fem.path.finite_state import Constraint
from shellbench.solvers.fem.path.newton import equilibrium, state_on_path
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError

TIGHT = 1e-20  # square of the last step's relative size: iterations go on to rounding
PLATE, CURVED, ROOF, STRIP, RING = (
    ("square_plate_nonlinear", (3, 3), 0.25),
    ("scordelis_lo_nonlinear", (4, 4), 0.25),
    ("hinged_roof_thick", (4, 4), 1.0),
    ("cantilever_shear", (8, 1), 0.25),
    ("cantilever_moment", (8, 1), 0.1),
)


def problem_of(name, cells):
    case = catalog.named_case(name)
    mesh = graded_mesh(case, cells, 2.0)
    return FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))


def dense(problem, q, t):
    """Return the tangent (n, n) on what the supports leave free."""
    strained, ties = problem.energy.deform(q), problem.ties(t)
    matrix = ties.reduce(problem.tangent(q, t, strained, strained.stresses)).to_csr().toarray()
    free = np.flatnonzero(ties.free.ravel())
    return matrix[np.ix_(free, free)]


def newton_step(problem, q, t, stressed=True):
    """Return the displacement after one plain Newton step; without stresses its tangent lacks the geometric part."""
    strained, ties = problem.energy.deform(q), problem.ties(t)
    right = ties.to_free((problem.forces(q, t) - strained.forces)[..., None])
    stresses = strained.stresses if stressed else tuple(np.zeros_like(s) for s in strained.stresses)
    factor = factorise(ties.reduce(problem.tangent(q, t, strained, stresses)), problem.dissection, "reported")
    return q + ties.to_nodal(factor.solve(right) * ties.free[..., None])[..., 0]


@pytest.fixture(scope="module", params=[PLATE, CURVED, ROOF, STRIP, RING], ids=lambda p: p[0])
def solved(request):
    name, cells, t = request.param
    problem = problem_of(name, cells)
    return problem, equilibrium(problem, problem.at_rest(), t, TIGHT)


def test_a_plain_newton_step_squares_the_error(solved):
    """Started ever closer to the solution, one step leaves an error that falls with the square of the start's."""
    problem, state = solved
    ties = problem.ties(state.t)
    away = ties.to_nodal(ties.to_free(state.q[..., None]))[..., 0]
    starts = 6e-6 * 0.5 ** np.arange(4)  # a slender strip's membrane strains leave no more
    left = [np.abs(newton_step(problem, state.q + s * away, state.t) - state.q).max() for s in starts]
    assert np.log2(np.array(left[:-1]) / left[1:]) == pytest.approx([2.0] * 3, abs=0.1)
    # a tangent that lacks a part converges with order one at best: the test can tell
    left = [np.abs(newton_step(problem, state.q + s * away, state.t, stressed=False) - state.q).max() for s in starts]
    assert np.log2(left[-2] / left[-1]) < 1.3


@pytest.mark.parametrize(("problem_and_load", "t"), [(PLATE, 1.0), (ROOF, 1.8), (ROOF, 2.0)])
def test_the_solvers_own_residuals_fall_quadratically(problem_and_load, t):
    """With stresses predicted by the step before the order stays two (Magisano et al. 2017)."""
    problem = problem_of(*problem_and_load[:2])
    residuals = np.array(equilibrium(problem, problem.at_rest(), t, TIGHT).residuals)
    assert residuals[0] == pytest.approx(1.0)  # at rest all of the load is residual
    assert residuals[-1] < 1e-12
    asymptotic = residuals[(residuals < 0.1) & (residuals > 1e-12)]
    assert len(asymptotic) >= 3
    falls = np.diff(np.log(asymptotic))
    assert falls[-1] / falls[-2] > 1.8  # the observed order
    assert np.all(asymptotic[1:] <= 5 * asymptotic[:-1] ** 2)


def test_a_state_is_in_equilibrium_and_obeys_its_supports(solved):
    problem, state = solved
    ties = problem.ties(state.t)
    unbalanced = problem.forces(state.q, state.t) - problem.energy.deform(state.q).forces
    scale = np.abs(problem.energy.deform(state.q).forces).max()
    assert np.abs(ties.to_free(unbalanced[..., None])).max() <= 1e-9 * scale
    free = ties.to_nodal(ties.to_free(state.q[..., None]))[..., 0]
    assert np.allclose(free + ties.particular[..., 0], state.q, rtol=0, atol=1e-14 * np.abs(state.q).max())
    assert state.iterations == len(state.residuals)


def test_a_stable_state_is_a_minimum_of_the_potential(solved):
    problem, state = solved
    assert state.stable
    assert np.linalg.eigvalsh(dense(problem, state.q, state.t)).min() > 0
    lowest, ties = problem.potential(state), problem.ties(state.t)
    for seed in range(4):
        step = np.random.default_rng(seed).normal(size=state.q.shape) * 1e-3 * np.abs(state.q).max()
        step = ties.to_nodal(ties.to_free(step[..., None]))[..., 0]
        for sign in (1, -1):
            moved = problem.state_at(state.t, state.q + sign * step, state)
            assert problem.potential(moved) > lowest


def test_the_potential_falls_along_the_path_by_the_work_of_growing_loads(solved):
    """d/dt of the least potential is - dW/dt at fixed displacement: here the loads' work at t = 1."""
    problem, state = solved
    h = 1e-3 * state.t
    up, down = (equilibrium(problem, state, state.t + s * h, TIGHT) for s in (1, -1))
    work = problem.loads(1.0).ravel() @ state.q.ravel()
    work += sum(float(m.moments(1.0) @ a) for m, a in zip(problem.moments, state.angles, strict=True))
    assert work > 0
    assert (problem.potential(up) - problem.potential(down)) / (2 * h) == pytest.approx(-work, rel=1e-4)


def test_the_drift_is_the_paths_derivative(solved):
    problem, state = solved
    h = 1e-3 * state.t
    up, down = (equilibrium(problem, state, state.t + s * h, TIGHT).q for s in (1, -1))
    expected = (up - down) / (2 * h)
    assert np.allclose(problem.path_rate(state), expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def test_a_large_step_of_a_slender_strip_takes_few_iterations():
    """A quarter of the load from rest turns the strip by more than a radian; plain Newton wanders."""
    name, cells, t = STRIP
    problem = problem_of(name, cells)
    state = equilibrium(problem, problem.at_rest(), t)
    assert state.iterations <= 7
    q = np.zeros_like(state.q)
    for _ in range(state.iterations):
        q = newton_step(problem, q, t)
    assert np.abs(q - state.q).max() > 1e-3 * np.abs(state.q).max()


def test_the_supports_motion_is_the_first_step():
    """A strip whose far edge is moved toward the wall: the path has prescribed displacements and no load."""
    data = catalog.named_case("cantilever_shear").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    pushed = {"name": "push", "on": ["xi1_max"], "components": ["z"], "motion": {"kind": "translation", "vector": [0, 0, "t"]}}  # fmt: skip
    case = build_case(data | {"supports": [*data["supports"], pushed], "loads": []}, "pushed", "test")
    mesh = graded_mesh(case, (8, 1), 2.0)
    problem = FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))
    state = problem.at_rest()
    for t in (0.5, 1.0, 3.0):
        state = equilibrium(problem, state, t)
        assert float(np.sum(dof_row(problem, case.quantity("deflection_4")) * state.q)) == pytest.approx(t, rel=1e-9)
    ties = problem.ties(state.t)
    assert np.abs(ties.to_free(state.strained.forces[..., None])).max() <= 1e-8 * np.abs(state.strained.forces).max()


def test_the_constraint_of_a_path_is_met_and_its_load_factor_found():
    name, cells, _ = ROOF
    problem = problem_of(name, cells)
    row = dof_row(problem, problem.case.quantity("deflection"))
    rest = problem.at_rest()
    drift = problem.path_rate(rest)
    t = 2.0 / float(np.sum(row * drift))
    state = state_on_path(problem, rest, Constraint(row, 0.0, 2.0), (t * drift, t))
    assert float(np.sum(row * state.q)) == pytest.approx(2.0, rel=1e-12)
    same = equilibrium(problem, rest, state.t, TIGHT)
    assert np.allclose(same.q, state.q, rtol=0, atol=1e-6 * np.abs(same.q).max())
    mixed = state_on_path(problem, rest, Constraint(row, 3.0, 2.0 + 3 * state.t), (t * drift, t))
    assert mixed.t == pytest.approx(state.t, rel=1e-7)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("t", [1e6, 1e12])
def test_a_step_that_is_far_too_long_is_refused(t):
    name, cells, _ = ROOF
    problem = problem_of(name, cells)
    with pytest.raises(NotConvergedError):
        equilibrium(problem, problem.at_rest(), t)


@pytest.mark.parametrize(("problem_and_load", "start"), [(PLATE, 0.9), (ROOF, 0.9), (STRIP, 0.95), (RING, 0.99)])
def test_a_frugal_step_ends_at_the_same_state_by_fewer_tangents(monkeypatch, problem_and_load, start):
    name, cells, t = problem_and_load
    problem = problem_of(name, cells)
    made = []
    factorised = FiniteProblem.factorised
    monkeypatch.setattr(FiniteProblem, "factorised", lambda *given: made.append(1) or factorised(*given))
    near = equilibrium(problem, problem.at_rest(), start * t).without_step_data
    near = problem.state_at(near.t, near.q, near)
    counts, states = [], []
    for how in ({"tolerance": TIGHT}, {}, {"frugal": True}):
        made.clear()
        states.append(equilibrium(problem, near, t, **how))
        counts.append(len(made))
    exact, plain, frugal = states
    plainly, frugally = (np.abs(state.q - exact.q).max() for state in (plain, frugal))
    assert frugally <= max(1e-7 * np.abs(exact.q).max(), 2 * plainly)
    assert counts[2] < counts[1]
    assert frugal.stable == plain.stable
    assert frugal.residuals[-1] < 1e-2  # the last residual that was seen, before the step that ended it
