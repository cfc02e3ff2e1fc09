"""The solvers of ropes as solvers: what they refuse, state and keep."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.solving import settled
from shellbench.solvers.pbd.solver import PbdSolver
from shellbench.solvers.pendulum.solver import PendulumSolver
from shellbench.solvers.rope.compiled import HERE
from shellbench.solvers.rope.solver import ExactSolver, PrintedSolver
from shellbench.solvers.rope.stepping import spring_forces

ALL = (ExactSolver, PrintedSolver, PendulumSolver)


def changed(name, **rope):
    data = {key: value for key, value in catalog.named_case(name).data().items() if key != "name"}
    return RopeCase.build(data | {"rope": data["rope"] | rope}, name, "test")


@pytest.mark.parametrize("solver", ALL)
def test_a_chain_at_rest_and_a_start_are_refused(solver):
    case = catalog.named_case("hanging_chain")
    assert "in motion only" in solver().declines(case)
    with pytest.raises(InputError, match="in motion only"):
        solver().solve(case, None)
    with pytest.raises(InputError, match="can't go on from an earlier solution"):
        solver().solve(catalog.named_case("rope_static"), None, start="here")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rope_ball", "ropes in motion only"),
        ("rope_drop", "slack at the start"),
        ("rope_jerk", "in the plane"),
        ("square_plate", "ropes in motion only"),
    ],
)
def test_the_pendulum_declines_what_has_no_angles(name, words):
    assert words in PendulumSolver().declines(catalog.named_case(name))


def test_the_pendulum_declines_velocities_that_stretch():
    case = changed("rope_pendulum", velocities=[[1.0, 0.0, 0.0]])
    assert PendulumSolver().declines(case) == "velocities at the start change the length of a link"


def test_the_pendulum_ends_where_a_link_lets_go():
    """From 150 degrees it would have to push at once."""
    with pytest.raises(SolveFailure, match="lets go") as failure:
        PendulumSolver().solve(changed("rope_static", angle=150.0), None)
    assert failure.value.partial.kept == ()


@pytest.mark.parametrize("solver", ALL)
def test_every_figure_has_an_uncertainty_and_the_history_ends_with_it(solver):
    case = catalog.named_case("rope_pendulum")
    solution = solver().solve(case, {"steps_per_second": 60.0} if solver is not PendulumSolver else None)
    values = {quantity.name: quantity.measure(solution) for quantity in case.quantities}
    assert solution.uncertainty.keys() == values.keys() == solution.history[-1].quantities.keys()
    assert solution.history[-1].quantities == values
    assert all(value > 0 for value in solution.uncertainty.values())


def test_a_stated_uncertainty_covers_the_error():
    case, known = catalog.named_case("rope_nine_links"), catalog.known_values("rope_nine_links")
    solution = ExactSolver().solve(case, {"steps_per_second": 60.0})
    for quantity in case.quantities:
        error = abs(quantity.measure(solution) - known.judge(quantity.name, case.theory).value)
        assert error <= 3 * solution.uncertainty[quantity.name] + 1e-14


def test_what_settled_is_the_larger_of_both_halvings():
    assert settled([1.0, 2.0, 2.1]) == pytest.approx(0.5)
    assert settled([1.0, 1.0, 2.0]) == pytest.approx(1.0)
    assert settled([1.0, 1.5]) == pytest.approx(0.5)


def test_coarser_steps_that_diverge_do_not_end_the_solve():
    """Nine links at 15 steps a second turn by more than the scheme can take; at 30 and 60 they do not."""
    solution = ExactSolver().solve(catalog.named_case("rope_nine_links"), {"steps_per_second": 60.0})
    assert [step.iteration for step in solution.history] == [1, 2]
    assert solution.uncertainty.keys() == {q.name for q in solution.case.quantities}


def test_a_step_that_diverges_fails_and_keeps_what_came_before():
    """A mass that circles by three radians a step gets five times as fast in each."""
    data = {key: value for key, value in catalog.named_case("rope_circle").data().items() if key != "name"}
    data["rope"] = data["rope"] | {"velocities": [[30.0, 0.0, 0.0]]}
    data["quantities"] = [*data["quantities"], {"name": "early", "kind": "speed", "node": 1, "at": 0.1}]
    for quantity in data["quantities"][:-1]:
        quantity["at"] = 40.0
    case = RopeCase.build(data, "circle", "test")
    with pytest.raises(SolveFailure, match="diverges at t = ") as failure:
        ExactSolver().solve(case, {"steps_per_second": 10.0})
    assert len(failure.value.partial.kept) == 1
    assert np.isfinite(failure.value.partial.state(0.1).nodes).all()


@pytest.mark.parametrize("settings", [{"steps_per_second": 0.0}, {"solve": "guess"}, {"sweeps": 0}, {"taut": -1.0}])
def test_settings_have_ranges(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        ExactSolver().solve(catalog.named_case("rope_static"), settings)


@pytest.mark.parametrize("solver", ALL)
def test_a_solution_survives_its_file(solver, tmp_path):
    solution = solver().solve(catalog.named_case("rope_static"), None)
    again = solver().load(solution.save(tmp_path / "rope"))
    for name, array in solution.stacked().items():
        assert np.array_equal(again.stacked()[name], array)


def test_the_printed_tensions_are_the_exact_ones_for_equal_masses_only():
    equal = changed("rope_nine_links", angle=30.0)
    unequal = changed("rope_nine_links", masses=[1.0, 2.0] * 4 + [1.0])
    for case, same in ((equal, True), (unequal, False)):
        tensions = [
            solver().solve(case, {"steps_per_second": 60.0, "taut": 0.4}).state(1.0).tensions
            for solver in (ExactSolver, PrintedSolver)
        ]
        assert np.allclose(*tensions, rtol=1e-9) == same


@pytest.mark.parametrize("solver", ALL)
def test_frames_are_at_the_same_times_whatever_the_steps(solver):
    """A frame each sixtieth of a second; between two steps on a straight line."""
    solution = solver().solve(catalog.named_case("rope_pendulum"), None)
    case = solution.case
    assert np.diff(solution.frame_times) == pytest.approx(max(1 / 60, case.states[-1] / 120))
    assert len(solution.frames) == len(solution.frame_times) == 121
    lengths = np.linalg.norm(np.diff(solution.frames, axis=1), axis=-1)
    assert lengths == pytest.approx(1.0, abs=1e-3)
    assert solution.frames[-1] == pytest.approx(solution.kept[-1].nodes, abs=1e-3)


def test_who_knows_no_dampers_and_no_springs_says_so():
    words = "it knows no damping of links and no springs between chains"
    for name in ("rope_decay", "rope_lateral"):
        assert PbdSolver().declines(catalog.named_case(name)) == words
    assert PendulumSolver().declines(catalog.named_case("rope_lateral")) == "it solves one chain only"
    if HERE:
        with pytest.raises(InputError, match="compiled steps know no obstacles, no damping and no springs"):
            ExactSolver().solve(catalog.named_case("rope_decay"), {"compiled": True})


def test_springs_and_dampers_keep_momentum_and_a_ring_is_closed():
    """Forces on loose ends add up to what the roots hold; each of three chains has a spring to both others."""
    draw = np.random.default_rng(0)
    places, rest = draw.normal(size=(4, 3, 3)), np.full((4, 3), 0.5)
    forces = spring_forces(places, rest, 7.0)
    assert forces.sum(axis=1) == pytest.approx(np.zeros((4, 3)), abs=1e-12)
    wanted = sum(
        7.0 * (1 - 0.5 / np.linalg.norm(d, axis=-1))[:, None] * d
        for d in (places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    )
    assert forces[:, 0] == pytest.approx(wanted)
    assert not spring_forces(places, rest[:, :1], 7.0)[:, 2].any()  # two chains of three are joined
