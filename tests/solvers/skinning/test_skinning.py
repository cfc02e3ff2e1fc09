"""Skinning: what is exact must be, floors are floors, and the collision loss pulls where the data pull."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.skinning import data
from shellbench.problems.skinning.body import distance, segments
from shellbench.problems.skinning.data import clips_of
from shellbench.problems.skinning.kind import SKINNING
from shellbench.problems.skinning.motion import rotations
from shellbench.solvers.skinning import forward, linear, network, solver, units
from shellbench.solvers.skinning.solution import Skinned
from tests.problems.skinning.capes import small

SOLVERS = {
    solver.FloorSolver: {},
    solver.BilinearSolver: {},
    solver.BlendSolver: {},
    solver.RidgeSolver: {},
    solver.NetworkSolver: {"epochs": 3, "widths": (7, 5)},
    solver.QuasistaticSolver: {"epochs": 3, "widths": (7,)},
    solver.RecurrentSolver: {"epochs": 3, "width": 6},
}


@pytest.fixture(scope="module", autouse=True)
def _own_folder(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(data.FOLDER, str(tmp_path_factory.mktemp("clips")))
        data.simulated_clips.cache_clear()
        yield
    data.simulated_clips.cache_clear()


@pytest.fixture(scope="module")
def answers():
    return {one: one().solve(small(), options) for one, options in SOLVERS.items()}


@pytest.mark.parametrize("of", SOLVERS)
def test_a_solution_is_the_same_when_it_is_read_again(answers, of, tmp_path):
    made = answers[of]
    again = of().load(made.save(tmp_path / "kept"))
    assert again.meshes == pytest.approx(made.meshes, abs=1e-12)
    assert (again.parameters, again.storage_bytes) == (made.parameters, made.storage_bytes)
    values = {quantity.name: quantity.measure(made) for quantity in made.case.quantities}
    assert values["worst_frame"] >= values["error"] > 0
    assert values["deepest"] >= values["depth"]
    kept = SKINNING.keep(made, made.case)
    assert np.sqrt(((kept["skinned"] - kept["simulated"]) ** 2).sum(-1).mean()) == pytest.approx(values["worst_frame"])


def test_a_file_of_another_solver_or_of_none_is_refused(answers, tmp_path):
    file = answers[solver.RidgeSolver].save(tmp_path / "kept")
    with pytest.raises(InputError, match=r"was written by solver 'skin-ridge', not by 'skin-floor'"):
        solver.FloorSolver().load(file)
    (tmp_path / "none.safetensors").write_bytes(b"no tensors")
    with pytest.raises(InputError, match="holds no skinned cape"):
        solver.FloorSolver().load(tmp_path / "none.safetensors")
    with pytest.raises(InputError, match="can't go on from an earlier solution"):
        solver.RidgeSolver().solve(small(), start=file)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_no_method_is_below_the_floor_of_its_modes(count):
    case = small(cape={"clips": 3, "frames": 12})
    floors = [
        float(np.sqrt((quantity_errors(solver.FloorSolver().solve(case, {"modes": count, "of": of})) ** 2).mean()))
        for of in ("held out", "seen")
    ]
    assert floors[0] <= floors[1]
    for method, options in ((solver.RidgeSolver, {}), (solver.NetworkSolver, {"epochs": 2, "widths": (5,)})):
        found = method().solve(case, {"modes": count, **options})
        assert float(np.sqrt((quantity_errors(found) ** 2).mean())) >= floors[1]


def quantity_errors(made):
    from shellbench.problems.skinning.quantities import errors

    return errors(made)


def test_modes_are_orthonormal_and_as_many_as_there_is_to_see():
    draw = np.random.default_rng(0)
    moved = draw.normal(size=(20, 3)) @ draw.normal(size=(3, 30)) + 5
    basis = linear.modes_of(moved, 10)
    assert basis["modes"].shape == (3, 30)
    assert basis["modes"] @ basis["modes"].T == pytest.approx(np.eye(3), abs=1e-12)
    assert linear.from_modes(basis, linear.coefficients(basis, moved)) == pytest.approx(moved, abs=1e-12)


def test_ridge_finds_a_linear_map_exactly():
    draw = np.random.default_rng(1)
    map_, shift = draw.normal(size=(6, 4)), draw.normal(size=4)
    x, new = draw.normal(size=(40, 6)), draw.normal(size=(7, 6))
    found, penalty = linear.ridge_fit(x, x @ map_ + shift, np.arange(40) // 10, None)
    assert penalty == min(linear.PENALTIES)
    assert (new - found["bones"]) @ found["map"] + found["centre"] == pytest.approx(new @ map_ + shift, abs=1e-8)


def test_a_penalty_shrinks_noise_that_is_fitted():
    draw = np.random.default_rng(2)
    x = draw.normal(size=(12, 10))
    noise = draw.normal(size=(12, 1))
    assert linear.ridge_fit(x, noise, np.arange(12) // 3, None)[1] > 1e-3


def test_rigid_bones_carry_a_rigid_motion_exactly():
    """Whatever the weights, as long as their sum is 1."""
    case = small()
    rest = clips_of(case).rest
    turn, shift = rotations(np.array([0.4, -0.3, 1.2])), np.array([0.1, 0.2, -0.3])
    moved = rest @ turn.T + shift
    clips = data.Clips(rest, moved[None], None, None, None)
    arrays = solver.BlendSolver().solve(case).arrays
    assert arrays["weights"].sum(-1) == pytest.approx(1, abs=1e-14)
    assert arrays["weights"].min() >= 0
    found = linear.blend_skin(arrays, case, clips, np.array([0]))
    assert found.reshape(rest.shape) == pytest.approx(moved - rest, abs=1e-13)


def test_bones_themselves_are_where_they_are(answers):
    for of in (solver.BilinearSolver, solver.BlendSolver):
        made = answers[of]
        truth = clips_of(made.case).meshes[made.case.held_out]
        found, wanted = (linear.bone_grid(made.case, meshes) for meshes in (made.meshes, truth))
        assert found == pytest.approx(wanted, abs=1e-6), of.name


def test_weights_are_those_of_the_nearest_point_of_a_triangle():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for place, weights in (([0.2, 0.3], [0.5, 0.2, 0.3]), ([0.25, -1.0], [0.75, 0.25, 0.0]), ([3.0, -1.0], [0, 1, 0])):
        apart = corners - place
        assert linear.convex_weights(apart @ apart.T) == pytest.approx(weights, abs=1e-6)


def test_bilinear_interpolation_is_exact_for_what_is_linear_in_row_and_column():
    case = small()
    clips = clips_of(case)
    rows, columns = np.meshgrid(np.arange(8.0), np.arange(6.0), indexing="ij")
    moved = np.stack([1 + 0.1 * rows, 0.2 * columns, 0.3 * rows * columns], axis=-1)
    flat = data.Clips(clips.rest, (clips.rest + moved)[None], None, None, None)
    # Rows of bones are rounded: a product is linear between them all the same.
    assert linear.bilinear_skin({}, case, flat, np.array([0])).reshape(moved.shape) == pytest.approx(moved, abs=1e-12)


def test_what_numpy_makes_of_a_network_is_what_torch_trained():
    draw = np.random.default_rng(3)
    unit = torch.nn.GRU(9, 5, batch_first=True).double()
    case = small()
    clips = clips_of(case)
    arrays = {name: tensor.detach().numpy() for name, tensor in unit.named_parameters()}
    arrays |= {"out": draw.normal(size=(5, 4)), "out_bias": draw.normal(size=4), "scale": np.ones(1)}
    arrays |= {"input_mean": np.zeros(9), "input_spread": np.ones(9), "mean": np.zeros(4), "modes": np.eye(4)}
    hidden, _ = unit(torch.from_numpy(units.course(clips)))
    wanted = hidden.detach().numpy().reshape(-1, 5) @ arrays["out"] + arrays["out_bias"]
    assert forward.recurrent_skin(arrays, case, clips, np.arange(20)) == pytest.approx(wanted, abs=1e-12)


def test_networks_learn_and_repeat():
    case = small(split={"by": "frames", "share": 0.2})
    for of, options in (
        (solver.NetworkSolver, {"epochs": 60, "widths": (40,), "learning_rate": 1e-2, "collision": False}),
        (solver.RecurrentSolver, {"epochs": 60, "width": 10, "learning_rate": 3e-2}),
    ):
        made = of().solve(case, options)
        assert made.history[-1].energy < 0.2 * made.history[0].energy
        measured = {q.name: q.measure(made) for q in case.quantities}
        assert made.history[-1].quantities == {"error": pytest.approx(measured["error"])}
    short = {"epochs": 2, "widths": (8,)}
    one, two, other = (solver.NetworkSolver().solve(case, short | {"seed": seed}) for seed in (4, 4, 5))
    assert one.meshes == pytest.approx(two.meshes, abs=1e-9)
    assert np.abs(one.meshes - other.meshes).max() > 1e-6


def test_the_collision_loss_counts_what_is_inside_the_expanded_body():
    case = small()
    training = network.Training(case, "any", forward.bone_skin, 5, lambda _: None)
    batch = torch.arange(4)
    found = torch.from_numpy(2 * training.wanted[:4]).float().requires_grad_()
    expansion = 0.03  # the held row is still outside, much of the rest inside
    loss = network.Collision(training, expansion)(found, batch)
    moved = linear.from_modes(training.basis, 2 * training.wanted[:4])
    places = (training.clips.rest.reshape(-1) + moved).reshape(4, -1, 3)
    frames = case.seen[:4]
    depth = -distance(places, training.clips.axes[frames], training.clips.radii + expansion)
    assert float(loss.detach()) == pytest.approx((np.maximum(depth, 0) ** 2).sum() / 4, rel=1e-4)
    loss.backward()
    assert np.abs(found.grad.numpy()).max() > 0


def test_a_training_that_diverges_fails_and_keeps_what_was():
    case = small()
    with pytest.raises(SolveFailure, match="diverged in epoch") as caught:
        solver.NetworkSolver().solve(case, {"epochs": 50, "learning_rate": 1e30, "widths": (5,)})
    assert caught.value.partial is None or isinstance(caught.value.partial, Skinned)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_the_collision_gradient_is_parallel_to_the_data_gradient(seed):
    """Case L1, section 7 of the paper: the cosine is 1 for each vertex inside, and a step never passes the truth."""
    draw = np.random.default_rng(seed)
    body = small().body
    axes, radii = segments(body, draw.normal(size=2)), np.array([part.radius for part in body])
    truth = draw.normal(scale=0.5, size=(2, 60, 3))
    truth = np.where((distance(truth, axes, radii) < 0.01)[..., None], truth + 2.0, truth)
    meshes = torch.from_numpy(draw.normal(scale=0.3, size=(2, 60, 3))).requires_grad_()
    target = network.pushed_targets(meshes.detach().numpy(), truth, axes, radii)
    data_gradient, collision_gradient = (
        torch.autograd.grad(((meshes - torch.from_numpy(to)) ** 2).sum(), meshes)[0].numpy() for to in (truth, target)
    )
    depth = -distance(meshes.detach().numpy(), axes, radii)
    inside = depth > 1e-3
    sizes = [np.linalg.norm(one, axis=-1) for one in (data_gradient, collision_gradient)]
    cosine = (data_gradient * collision_gradient).sum(-1)[inside] / (sizes[0] * sizes[1])[inside]
    assert cosine == pytest.approx(1.0, abs=1e-12)
    assert not collision_gradient[depth < 0].any()
    assert sizes[1][inside] == pytest.approx(2 * depth[inside], rel=1e-9)
    assert np.all(sizes[1] <= sizes[0] * (1 + 1e-12))
