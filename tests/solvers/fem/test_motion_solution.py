"""A motion between its instants: continuous, of fourth order in time, kept in a file, and asked at any time."""

import json

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.quantities.quantities import MotionEnergy
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.motion.motion_solution import MotionSolution
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.alike import alike
from tests.solvers.fem.shells import LARGEST, MATERIAL, shell

UNTIL = 2.0
NONLINEAR = "kirchhoff-love-nonlinear"
HELD = {"name": "edge", "on": ["xi1_min"]}
POINTS = np.array([[0.3, 0.2], [1.7, 0.9], [2.0, 1.0]])


def case():
    return shell(theory=NONLINEAR, supports=[HELD], dynamics={"until": UNTIL}, quantities=[LARGEST | {"at": UNTIL}])


def motion(times, of, rate, force=None):
    """Return the solution u = f(t) (xi1 xi2, xi1^2, 1 + xi1^3 xi2), v = f'(t) (...), at these instants."""
    of_case = case()
    lines = np.array([0.0, 0.7, 2.0]), np.array([0.0, 0.4, 1.0])
    mesh = TensorMesh(of_case.surface.domain, lines)
    x, y = mesh.node_points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    shape = np.stack([
        [x * y, y, x, one],
        [x**2, 2 * x, zero, zero],
        [1 + x**3 * y, 3 * x**2 * y, x**3, 3 * x**2],
    ]).transpose(2, 0, 1)  # fmt: skip
    nodes = mesh.edge_nodes(of_case.places["xi1_min"])
    between = (times[1:] + times[:-1]) / 2 if force else times[1:]
    forces = np.zeros((1, len(nodes), 3, 4, len(between)))
    if force:
        forces[0, 0, 0, 0] = force(between)
    return MotionSolution(
        case=of_case,
        mesh=mesh,
        times=times,
        coefficients=shape[..., None] * of(times),
        rates=shape[..., None] * rate(times),
        support_nodes=nodes,
        reaction_times=between,
        support_forces=forces,
        quadrature_order=7,
        parameters=17,
        history=(Step(0, 1.5, 0.1, 17, 2.0, phase="time", iterations=3, quantities={"a": 1.0}),),
        diagnostics={"energy_drift": 1e-6},
        uncertainty={"largest": 0.1},
        extrapolated={"largest": 0.2},
    )


def exact(points):
    x, y = points.T
    return np.stack([x * y, x**2, 1 + x**3 * y], axis=-1)


def swing(count, uneven=0.0):
    times = np.linspace(0, UNTIL, count + 1)
    times[1:-1] += uneven * UNTIL / count * np.sin(np.arange(1, count))
    return motion(times, lambda t: np.sin(3 * t) - 3 * t + t**2, lambda t: 3 * np.cos(3 * t) - 3 + 2 * t)


def errors(solution):
    """Return the largest errors of displacement and velocity between the instants."""
    f, rate = (lambda t: np.sin(3 * t) - 3 * t + t**2), (lambda t: 3 * np.cos(3 * t) - 3 + 2 * t)
    found = np.zeros(2)
    for t in np.linspace(0, UNTIL, 97):
        u, v = solution.displacement(POINTS, t), solution.velocity(POINTS, t)
        now = np.abs(u - f(t) * exact(POINTS)).max(), np.abs(v - rate(t) * exact(POINTS)).max()
        found = np.maximum(found, now)
    return found


def test_it_is_of_fourth_order_in_time():
    counts = np.array([4, 8, 16])
    found = np.array([errors(swing(count)) for count in counts])
    slopes = np.polyfit(np.log(counts), np.log(found), 1)[0]
    assert slopes[0] < -3.6
    assert slopes[1] < -2.6  # a velocity is one order less
    uneven = np.array([errors(swing(count, 0.3)) for count in counts])
    assert np.polyfit(np.log(counts), np.log(uneven[:, 0]), 1)[0] < -3.3


def test_a_cubic_motion_is_exact():
    times = np.array([0.0, 0.1, 0.7, 2.0])
    solution = motion(times, lambda t: t**2 - t**3 / 3, lambda t: 2 * t - t**2)
    for t in (0.0, 0.05, 0.1, 0.43, 1.9, 2.0):
        assert np.allclose(solution.displacement(POINTS, t), (t**2 - t**3 / 3) * exact(POINTS), rtol=0, atol=1e-13)
        assert np.allclose(solution.velocity(POINTS, t), (2 * t - t**2) * exact(POINTS), rtol=0, atol=1e-13)


def test_velocity_is_the_displacements_derivative_and_both_are_continuous():
    solution = swing(6, 0.3)
    d = 1e-4
    for t in (0.2, 0.5, 1.1, 1.77):
        u = [solution.displacement(POINTS, t + k * d) for k in (-2, -1, 1, 2)]
        slope = (u[0] - 8 * u[1] + 8 * u[2] - u[3]) / (12 * d)
        assert np.allclose(solution.velocity(POINTS, t), slope, rtol=0, atol=1e-8)
    for t in solution.times[1:-1]:
        for of in (solution.displacement, solution.velocity):
            assert np.allclose(of(POINTS, t - 1e-9), of(POINTS, t + 1e-9), rtol=0, atol=1e-6)
            assert np.allclose(of(POINTS, t), of(POINTS, t + 1e-12), rtol=0, atol=1e-9)


def test_at_its_instants_it_is_what_it_was_made_of():
    solution = swing(5)
    for number, t in enumerate(solution.times):
        node = solution.mesh.node_points[4]
        assert np.allclose(solution.displacement(node, t), solution.coefficients[4, :, 0, number], rtol=0, atol=1e-14)
        assert np.allclose(solution.velocity(node, t), solution.rates[4, :, 0, number], rtol=0, atol=1e-13)


def test_without_a_time_it_answers_for_the_last():
    solution = swing(5)
    alike(solution.displacement(POINTS), solution.displacement(POINTS, UNTIL))
    alike(solution.velocity(POINTS), solution.velocity(POINTS, UNTIL))
    alike(solution.energies(), solution.energies(UNTIL))


@pytest.mark.parametrize("at", [-0.01, 2.01, 1e9, float("nan"), float("inf")])
def test_beyond_the_last_time_is_one_sentence(at):
    solution = swing(5)
    for ask in (solution.displacement, solution.velocity):
        with pytest.raises(InputError, match=r"^test: solved from 0 to 2 s, not at \S+ s$"):
            ask(POINTS, at)
    with pytest.raises(InputError, match="from 0 to 2 s"):
        solution.energies(at)
    with pytest.raises(InputError, match="from 0 to 2 s"):
        solution.reaction("edge", at=at)


def test_reactions_are_interpolated_between_the_times_at_which_they_are_balanced():
    times = np.array([0.0, 0.3, 0.5, 1.0, 1.4, 1.8, 2.0])
    solution = motion(times, np.zeros_like, np.zeros_like, force=lambda t: 1 - 2 * t + t**3)
    for t in (0.0, 0.15, 0.4, 0.9, 1.5, 1.99, 2.0):
        force, _ = solution.reaction("edge", at=t)
        assert force == pytest.approx([1 - 2 * t + t**3, 0, 0], abs=1e-12)
    short = motion(np.array([0.0, 2.0]), np.zeros_like, np.zeros_like, force=lambda t: 5 + 0 * t)
    assert short.reaction("edge", at=0.3)[0] == pytest.approx([5, 0, 0])


def test_a_jump_of_a_reaction_is_not_seen_from_afar():
    """The nearest four are interpolated through, two on either side."""
    times = np.linspace(0, 2, 41)
    solution = motion(times, np.zeros_like, np.zeros_like, force=lambda t: np.where(t < 1, 2.0, 7.0))
    for share, expected in ((0.88, 2.0), (1.12, 7.0)):
        assert solution.reaction("edge", at=share)[0] == pytest.approx([expected, 0, 0], abs=1e-12)


def test_kinetic_energy_is_that_of_the_velocity():
    """u = f(t) (xi1 xi2, xi1^2, 1 + xi1^3 xi2) on [0, 2] x [0, 1]; the integral of |.|^2 by hand."""
    solution = motion(np.array([0.0, 1.0, 2.0]), lambda t: t**2, lambda t: 2 * t)
    square = 8 / 9 + 32 / 5 + (2 + 2 * 4 * 0.5 + 128 / 7 / 3)
    quantity = MotionEnergy(name="k", kind="kinetic_energy", at=1.5)
    assert measure(solution, quantity) == pytest.approx(MATERIAL["areal_density"] / 2 * 9 * square, rel=1e-10)


# files


def test_a_saved_motion_comes_back_whole(tmp_path):
    solution = swing(7, 0.2)
    path = solution.save(tmp_path / "swing")
    assert path.suffix == ".npz"
    back = FemSolver().load(path)
    assert isinstance(back, MotionSolution)
    assert back.case == solution.case
    assert back.case.digest() == solution.case.digest()
    assert back.history == solution.history
    assert (back.diagnostics, back.uncertainty) == (solution.diagnostics, solution.uncertainty)
    assert (back.extrapolated, back.parameters) == (solution.extrapolated, solution.parameters)
    assert back.storage_bytes == solution.storage_bytes
    for name in ("coefficients", "rates"):
        assert np.array_equal(getattr(back, name), getattr(solution, name))
    for t in (0.0, 0.33, 1.9, UNTIL):
        alike(back.displacement(POINTS, t), solution.displacement(POINTS, t))
        alike(back.velocity(POINTS, t), solution.velocity(POINTS, t))
        alike(back.energies(t), solution.energies(t))
        alike(back.reaction("edge", at=t), solution.reaction("edge", at=t))


def rewritten(path, change):
    """Write a file again with other contents."""
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in data.files}
    words = json.loads(str(arrays.pop("words")))
    change(arrays, words)
    np.savez(path, allow_pickle=False, words=np.asarray(json.dumps(words)), **arrays)


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays, words: arrays.pop("rates"),
        lambda arrays, words: arrays.pop("times"),
        lambda arrays, words: arrays.update(times=arrays["times"][:-1]),
        lambda arrays, words: arrays.update(rates=arrays["rates"][..., :-1]),
        lambda arrays, words: arrays.update(coefficients=arrays["coefficients"][:-1]),
        lambda arrays, words: arrays.update(support_forces=arrays["support_forces"][:, :-1]),
        lambda arrays, words: arrays.update(reaction_times=arrays["reaction_times"][:-1]),
        lambda arrays, words: arrays.update(times=arrays["times"][::-1]),
        lambda arrays, words: arrays.update(
            times=arrays["times"][:1], rates=arrays["rates"][..., :1], coefficients=arrays["coefficients"][..., :1]
        ),
        lambda arrays, words: words.update(history=[{"iteration": 0}]),
        lambda arrays, words: words.pop("diagnostics"),
        lambda arrays, words: words["case"].pop("dynamics"),
        lambda arrays, words: words["case"].update(surface=1),
    ],
)
def test_a_damaged_file_is_one_sentence(change, tmp_path):
    path = swing(5).save(tmp_path / "swing.npz")
    rewritten(path, change)
    with pytest.raises(InputError) as caught:
        FemSolver().load(path)
    assert "swing.npz" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_cut_or_missing_file_is_one_sentence(tmp_path):
    path = swing(5).save(tmp_path / "swing")
    path.write_bytes(path.read_bytes()[:-200])
    for wrong in (path, tmp_path / "none.npz"):
        with pytest.raises(InputError, match="solution of fem"):
            FemSolver().load(wrong)


def test_a_motion_is_no_static_solution(tmp_path):
    path = swing(5).save(tmp_path / "swing")
    with pytest.raises(InputError, match="solution of fem"):
        FemSolution.load(path)
    static = shell(supports=[HELD | {"clamped": True}], loads=[{"kind": "area", "vector": [0, 0, 1]}])
    still = FemSolver().solve(static, FemSettings(cells=(2, 1)))
    back = FemSolver().load(still.save(tmp_path / "still"))
    assert isinstance(back, FemSolution)
    assert not np.any(back.velocity(POINTS))


def test_nothing_in_a_file_is_run(tmp_path):
    """A pickle in place of an array is refused, not read."""
    path = swing(5).save(tmp_path / "swing")
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in data.files}
    arrays["times"] = np.array([object()], dtype=object)
    np.savez(path, allow_pickle=True, **arrays)
    with pytest.raises(InputError, match="damaged"):
        FemSolver().load(path)
