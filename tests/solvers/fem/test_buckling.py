"""Through buckling: critical states of known load and mode, the tangent's sign change, and the states beyond."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse.linalg as spla

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path import buckling
from shellbench.solvers.fem.path.buckling import BRACKET, Buckling, following_steps
from shellbench.solvers.fem.path.large_displacement import solve as solve_on_mesh
from shellbench.solvers.fem.path.newton import equilibrium
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.stepping.control import NotConvergedError, PathEndsError
from tests.solvers.fem.shells import shell, uniform

YOUNG, THICKNESS, WIDTH, LENGTH = 1e4, 0.02, 0.2, 1.0
HALF_WAVES = {True: 2, False: 1}  # of a column that is clamped or hinged at both ends, per length


def critical_column(clamped):
    """Return shortening and force at which a strip without lateral contraction buckles between its moved ends.

    At the uniform Green strain -e the strip is shorter by the factor s = sqrt(1 - 2 e); its second variation,
    the integral of B w''^2 - D e w'^2, vanishes at D e = B (k pi / L)^2. The force is dW/d(shortening) = D e s.
    """
    e = THICKNESS**2 / 12 * (HALF_WAVES[clamped] * np.pi / LENGTH) ** 2
    s = np.sqrt(1 - 2 * e)
    return LENGTH * (1 - s), YOUNG * THICKNESS * WIDTH * e * s


def straight_energy(shortening):
    """Return the strain energy of the strip that stays straight."""
    e = (1 - (1 - shortening / LENGTH) ** 2) / 2
    return YOUNG * THICKNESS * WIDTH * LENGTH * e**2 / 2


def column(clamped, until, marks=(), after="follow", extra=(), **fields):
    ram = {"kind": "translation", "vector": ["-t", 0, 0]}
    supports = [
        {"name": "wall", "on": ["xi1_min"], "clamped": clamped},
        {"name": "ram", "on": ["xi1_max"], "clamped": clamped, "motion": ram},
    ]
    quantities = [
        {"name": "shortening", "kind": "critical_point", "primary": True},
        {"name": "force", "kind": "critical_point", "gives": "push"},
        {"name": "push", "kind": "reaction", "support": "ram", "direction": [-1, 0, 0], "at": until},
        *extra,
    ]
    if after == "stop":
        quantities = [quantities[2] | {"primary": True}]
    return shell(
        {"kind": "plane", "xi1": [0, LENGTH], "xi2": [0, WIDTH]}, theory="kirchhoff-love-nonlinear", supports=supports,
        material={"youngs_modulus": YOUNG, "poissons_ratio": 0.0, "thickness": THICKNESS},
        path={"until": until, "after_buckling": after, "states": list(marks)}, quantities=quantities, **fields,
    )  # fmt: skip


def solve(case, cells):
    return FemSolver().solve(case, FemSettings(cells=cells))


def problem_of(case, cells):
    mesh = uniform(case, cells)
    return FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))


@pytest.fixture(scope="module", params=[True, False], ids=["clamped", "hinged"])
def buckled(request):
    """A column that is shortened by three times what buckles it."""
    clamped = request.param
    until = 3 * critical_column(clamped)[0]
    return clamped, solve(column(clamped, until), (4, 1))


# Euler's column


def test_a_column_buckles_at_eulers_load(buckled):
    clamped, solution = buckled
    shortening, force = critical_column(clamped)
    found = measure_all(solution)
    assert found["shortening"] == pytest.approx(shortening, rel=2e-3)
    assert found["force"] == pytest.approx(force, rel=2e-3)
    assert found["push"] == pytest.approx(force, rel=1e-2)  # a buckled column carries hardly more


def ending_column(share):
    """A column whose path ends where it buckles, and its shortening there; its force is asked at a share of that."""
    shortening, _ = critical_column(True)
    data = column(True, 3 * shortening).model_dump(mode="json", exclude_unset=True, exclude={"name"})
    data["path"] = {"until": 3 * shortening}
    data["quantities"][2]["at"] = share * shortening
    return build_case(data, "column", "test"), shortening


def test_a_path_may_end_where_the_shell_buckles():
    case, shortening = ending_column(0.5)
    solution = solve(case, (4, 1))
    found = measure_all(solution)
    assert found["shortening"] == pytest.approx(shortening, rel=2e-3)
    assert found["force"] == pytest.approx(critical_column(True)[1], rel=2e-3)
    assert found["push"] < 0.51 * found["force"]
    path = [s for s in solution.history if s.phase in ("path", "critical")]
    assert [s.phase for s in path[-2:]] == ["path", "critical"]
    assert max(s.at for s in path) == pytest.approx(found["shortening"])


def test_the_critical_state_is_bracketed_as_closely_as_is_said():
    case, _ = ending_column(0.5)
    problem = problem_of(case, (6, 1))
    critical = list(following_steps(problem, case.path_marks, case.path.until / 8, 1e-6))[-1]
    area = Buckling(problem).area
    below, above = (equilibrium(problem, critical, critical.t * (1 + share)) for share in (-3 * BRACKET, 3 * BRACKET))
    assert smallest(problem, below, area)[0] > 0 > smallest(problem, above, area)[0]


def test_nothing_is_asked_beyond_buckling_of_a_path_that_ends_there():
    found = solve(ending_column(1.5)[0], (4, 1))
    assert re.match(r"the shell buckles at load factor 0\.0013.*; not reached: push$", found.unsettled)


def test_a_path_that_ends_before_the_shell_buckles_says_so():
    case, shortening = ending_column(0.5)
    short = case.path.model_copy(update={"until": 0.9 * shortening})
    with pytest.raises(SolveFailure, match="no critical state"):
        solve(case.model_copy(update={"path": short}), (4, 1))


def test_eulers_load_converges_with_the_fourth_power():
    shortening, _ = critical_column(True)
    errors = []
    for n in (2, 4):
        case = column(True, 1.5 * shortening)
        (state,) = [
            s for s in following_steps(problem_of(case, (2 * n, 1)), case.states, shortening / 4, 1e-6) if s.critical
        ]
        errors.append(state.t / shortening - 1)
    assert errors[1] > 0  # from above: the mesh is stiffer
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.4)


def test_the_history_goes_along_the_straight_path_and_leaves_it_at_the_critical_state(buckled):
    clamped, solution = buckled
    steps = [s for s in solution.history if s.phase in ("path", "critical")]
    (critical,) = [s for s in steps if s.phase == "critical"]
    number = steps.index(critical)
    assert 0 < number < len(steps) - 3
    assert np.all(np.diff([s.at for s in steps]) > 0)
    for step in steps[: number + 1]:
        assert step.energy == pytest.approx(straight_energy(step.at), rel=1e-8)
    lower = [1 - step.energy / straight_energy(step.at) for step in steps[number + 1 :]]
    assert lower[0] > 0
    assert np.all(np.diff(lower) > 0)
    assert lower[-1] > 0.4
    # it bends to a half wave or a whole one, in one direction
    shape = solution.displacement(np.stack([np.linspace(0, 1, 41), np.full(41, 0.1)], axis=-1))[:, 2]
    assert np.argmax(np.abs(shape)) == 20
    assert np.all(shape[1:-1] * shape[20] > 0)
    material = solution.case.material
    membrane, bending = solution.energies()
    assert bending > 1e-2 * membrane
    assert material.poissons_ratio == 0.0
    assert critical.at in solution.states
    assert solution.energies(critical.at)[1] < 1e-12 * membrane
    assert clamped == solution.case.supports[0].clamped


def test_the_force_is_the_derivative_of_the_energy_beyond_buckling():
    shortening, _ = critical_column(False)
    at = [shortening * s for s in (1.9, 2.0, 2.1)]
    case = column(False, at[2], at[:2])
    solution = solve(case, (3, 1))
    energy = {s.at: s.energy for s in solution.history if s.phase == "path"}
    push = -np.array([solution.reaction("ram", at=t)[0][0] for t in at])
    simpson = (push[0] + 4 * push[1] + push[2]) / 6
    assert (energy[at[2]] - energy[at[0]]) / (at[2] - at[0]) == pytest.approx(simpson, rel=1e-6)
    assert -solution.reaction("wall", at=at[1])[0][0] == pytest.approx(-push[1], rel=1e-6)


def test_the_softest_mode_is_that_of_the_smallest_eigenvalue():
    shortening, _ = critical_column(True)
    problem = problem_of(column(True, 2 * shortening), (6, 2))
    state = equilibrium(problem, problem.at_rest(), 0.9 * shortening)
    buckling, ties = Buckling(problem), problem.ties(state.t)
    mode, stiffness = buckling.softest_mode(ties, buckling.stiffness(buckling.tangent(state), state.t))
    value, vector = smallest(problem, state, buckling.area)
    assert stiffness == pytest.approx(value, rel=1e-5)
    assert ties.to_free(mode[..., None]).ravel() @ vector / np.linalg.norm(
        ties.to_free(mode[..., None])
    ) == pytest.approx(np.linalg.norm(vector) * np.sign(ties.to_free(mode[..., None]).ravel() @ vector), rel=1e-5)
    # D (e_c - e) (k pi / L)^2 of the shape 1 - cos: of w'^2 over w^2, a third
    e = (1 - (1 - state.t) ** 2) / 2
    e_c = THICKNESS**2 / 12 * (2 * np.pi) ** 2
    assert value == pytest.approx(YOUNG * THICKNESS * (e_c - e) * (2 * np.pi) ** 2 / 3, rel=5e-2)


def smallest(problem, state, area):
    """Return the smallest eigenvalue of the reduced tangent in the metric of the area, and its vector, by SciPy."""
    ties = problem.ties(state.t)
    stiffness = ties.reduce(problem.tangent(state.q, state.t, state.strained, state.strained.stresses)).to_csr()
    free = np.flatnonzero(ties.free.ravel())
    k, m = stiffness[free][:, free].tocsc(), ties.reduce(area).to_csr()[free][:, free].tocsc()
    shift = -1e-3 * abs(k.diagonal()).max() / m.diagonal().max()
    values, vectors = spla.eigsh(k, k=1, M=m, sigma=shift, which="LM")
    whole = np.zeros(ties.free.size)
    whole[free] = vectors[:, 0]
    return float(values[0]), whole


# the sleeve


def sleeve(until, **more):
    data = catalog.named_case("sleeve_twist").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    quantities = [{"name": "critical_twist", "kind": "critical_point", "primary": True}]
    path = {"until": until, "after_buckling": "follow"}
    return build_case(data | {"quantities": quantities, "path": path, **more}, "sleeve", "test")


CELLS = (12, 6)


@pytest.fixture(scope="module")
def twisted():
    """All states of a coarse sleeve through buckling."""
    problem = problem_of(sleeve(0.2), CELLS)
    return problem, list(following_steps(problem, (0.13, 0.2), 0.025, 1e-4))


@pytest.mark.long
def test_where_the_inertia_changes_the_smallest_eigenvalue_changes_sign(twisted):
    problem, states = twisted
    (critical,) = [s for s in states if s.critical]
    area = Buckling(problem).area
    values = []
    for t in (critical.t * (1 - 3 * BRACKET), critical.t * (1 + 3 * BRACKET)):
        state = equilibrium(problem, critical, t)
        values.append(smallest(problem, state, area)[0])
        # what a factorisation counts at the state itself, not one iteration before
        assert (equilibrium(problem, state, t).factor.negative_count > 0) == (values[-1] < 0)
    assert values[0] > 0 > values[1]
    far = smallest(problem, equilibrium(problem, critical, 0.9 * critical.t), area)[0]
    assert values[0] < 1e-2 * far
    rest = smallest(problem, problem.at_rest(), area)[0]
    assert Buckling(problem).softest_stiffness == pytest.approx(rest, rel=2e-2)


@pytest.mark.long
def test_beyond_it_states_are_stable_and_lower_than_those_that_stay_round(twisted):
    problem, states = twisted
    (number,) = [k for k, s in enumerate(states) if s.critical]
    assert states[-1].t == pytest.approx(0.2)
    assert any(abs(s.t - 0.13) < 1e-12 for s in states)
    assert all(s.stable for s in states)
    assert np.all(np.diff([s.t for s in states]) > 0)
    round_state = states[number]
    for state in states[number + 1 :: 3]:
        round_state = equilibrium(problem, round_state, state.t)
        assert not round_state.stable
        assert problem.potential(state) < problem.potential(round_state)
        assert problem.revolution.wave_direction(round_state.q) is None
        assert problem.revolution.wave_direction(state.q) is not None
        residual = problem.ties(state.t).to_free((problem.forces(state.q, state.t) - state.strained.forces)[..., None])
        # balance, but for what holds the waves where they are on the mesh
        assert np.abs(residual).max() < 1e-4 * np.abs(state.strained.forces).max()
    final = states[-1]
    value, _ = smallest(problem, final, Buckling(problem).area)
    assert value > -1e-2 * Buckling(problem).softest_stiffness  # but for the waves that may travel


def test_a_relaxation_goes_downhill_and_moves_the_supports_as_asked(twisted):
    problem, states = twisted
    (number,) = [k for k, s in enumerate(states) if s.critical]
    buckling, start = Buckling(problem), states[number]
    found = buckling.relax(start, 1.02 * start.t)
    assert found.stable
    unbuckled = equilibrium(problem, start, 1.02 * start.t)
    assert problem.potential(found) < problem.potential(unbuckled)
    ties = problem.ties(1.02 * start.t)
    free = ties.to_nodal(ties.to_free((found.q - ties.particular[..., 0])[..., None]))[..., 0]
    assert np.allclose(found.q - ties.particular[..., 0], free, rtol=0, atol=1e-12)


def test_waves_that_are_held_may_not_hide_a_state_that_is_unstable_otherwise(twisted):
    """Just one negative eigenvalue is forgiven, and only if holding the waves takes it away."""
    problem, states = twisted
    final = states[-1]
    assert final.forgiven in (0, 1)
    assert not replace(final, forgiven=final.factor.negative_count + 1).stable
    (critical,) = [s for s in states if s.critical]
    holding = replace(problem, holding=True)
    unstable = equilibrium(holding, critical, 0.1 + 0.05)
    assert problem.revolution.wave_direction(unstable.q) is None
    assert not unstable.stable


# where it ends


def test_without_following_the_path_ends_where_it_buckles():
    shortening, _ = critical_column(True)
    case = column(True, 2 * shortening, [shortening / 2], after="stop")
    with pytest.raises(SolveFailure) as caught:
        solve(case, (3, 1))
    message = str(caught.value)
    assert "is not stable" in message
    assert "\n" not in message
    partial = caught.value.partial
    assert partial.states[0] == pytest.approx(shortening / 2)
    assert partial.states[-1] == pytest.approx(shortening, rel=2e-2)
    assert partial.states[-1] < 1.01 * shortening
    assert sum(partial.energies(shortening / 2)) == pytest.approx(straight_energy(shortening / 2), rel=1e-9)


def test_where_no_stable_state_is_found_the_path_ends_with_what_was_reached(monkeypatch):
    def lost(self, start, t):
        raise NotConvergedError

    monkeypatch.setattr(Buckling, "relax", lost)
    shortening, _ = critical_column(True)
    case = column(True, 2 * shortening, [shortening / 2])
    with pytest.raises(PathEndsError, match=r"^no stable state was found at load factor \S+$"):
        list(following_steps(problem_of(case, (6, 1)), case.states, shortening / 4, 1e-6))
    partial = solve(case, (3, 1))
    assert re.match(r"no stable state was found at load factor [^\n]+; not reached: push$", partial.unsettled)
    assert [s.phase for s in partial.history][-1] == "critical"
    assert partial.states[-1] == pytest.approx(shortening, rel=5e-3)
    assert sum(partial.energies(shortening / 2)) == pytest.approx(straight_energy(shortening / 2), rel=1e-9)


def test_a_path_that_does_not_buckle_has_no_critical_point():
    shortening, _ = critical_column(True)
    case = column(True, 0.9 * shortening)
    found = solve_on_mesh(case, uniform(case, (6, 1)), 7, (1 / 4, 1e-4))[0].solution
    assert all(s.phase == "path" for s in found.history)
    with pytest.raises(ValueError, match="no critical state"):
        measure_all(found)
    with pytest.raises(SolveFailure, match="no critical state"):
        solve(case, (3, 1))


def test_what_never_buckles_is_followed_as_if_nothing_were_said():
    """A strip that is pulled: following and stopping give the same states."""
    case = column(True, 0.05)
    outward = case.supports[1].motion.model_copy(update={"vector": ("t", 0.0, 0.0)})
    supports = case.supports[0], case.supports[1].model_copy(update={"motion": outward})
    pulled = case.model_copy(update={"supports": supports})
    problem = problem_of(pulled, (4, 1))
    states = list(following_steps(problem, (0.02, 0.05), 0.01, 1e-4))
    assert not any(s.critical for s in states)
    assert states[-1].t == pytest.approx(0.05)
    assert problem.potential(states[-1]) == pytest.approx(straight_energy(-0.05), rel=1e-10)


@pytest.mark.parametrize("share", [1.0 + 2e-6, 1.001, 1.02])
def test_a_mark_close_beyond_the_critical_state_is_landed_on(share):
    """However little is left to go after the critical state has been bracketed."""
    problem = problem_of(column(True, 1.0), (6, 1))
    critical = next(s for s in following_steps(problem, (0.005,), 3e-4, 1e-7) if s.critical)
    mark = critical.t * share
    states = list(following_steps(problem, (mark, 2 * critical.t), 3e-4, 1e-7))
    assert any(s.t == mark for s in states)
    assert states[-1].t == 2 * critical.t
    assert sum(s.critical for s in states) == 1
    assert all(s.stable for s in states)
    assert problem.potential(states[-1]) < 0.9 * straight_energy(2 * critical.t)


def test_where_no_step_from_rest_converges_the_shell_is_left_to_itself_a_little_further_on(monkeypatch):
    def lost(self, start, t, **how):
        raise NotConvergedError

    monkeypatch.setattr(buckling, "equilibrium", lost)
    monkeypatch.setattr(Buckling, "relax", lambda self, start, t: replace(start, t=t))
    shortening, _ = critical_column(True)
    problem = problem_of(column(True, 2 * shortening), (4, 1))
    first = next(following_steps(problem, problem.case.states, shortening / 4, 1e-6))
    assert 0 < first.t <= 1e-6
