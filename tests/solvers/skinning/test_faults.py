"""Faults in the cape and in what skins it: each must turn a property red."""

import numpy as np
import pytest

from shellbench.problems.skinning import cape, data
from shellbench.problems.skinning.body import distance, pushed_out
from shellbench.solvers.skinning import forward, linear, network
from tests.problems.skinning import test_cape as capes
from tests.solvers.skinning import test_skinning as skins


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    data._clips.cache_clear()
    yield
    data._clips.cache_clear()


def along_the_gradient(meshes, truth, axes, radii):
    return pushed_out(meshes, axes, radii, 0.0)


def all_the_way(meshes, truth, axes, radii):
    return np.where((distance(meshes, axes, radii) < 0)[..., None], truth, meshes)


FAULTS = {
    "weights of sum 1.1": (linear, "convex_weights", lambda g: np.full(len(g), 1.1 / len(g)), skins.test_rigid_bones_carry_a_rigid_motion_exactly),
    "bones that stretch what follows them": (linear, "_unit", lambda vectors: vectors, skins.test_rigid_bones_carry_a_rigid_motion_exactly),
    "coefficients about zero": (linear, "coefficients", lambda basis, moved: moved @ basis["modes"].T, skins.test_modes_are_orthonormal_and_as_many_as_there_is_to_see),
    "a penalty where none is due": (linear, "_cross_validation", lambda *_: np.arange(len(linear.PENALTIES), 0, -1.0), skins.test_ridge_finds_a_linear_map_exactly),
    "no penalty where one is due": (linear, "_cross_validation", lambda *_: np.arange(len(linear.PENALTIES)), skins.test_a_penalty_shrinks_noise_that_is_fitted),
    "the nearest bone alone": (linear, "hat_weights", lambda nodes, count: (np.abs(np.arange(count)[:, None] - nodes) < 0.5).astype(float), skins.test_bilinear_interpolation_is_exact_for_what_is_linear_in_row_and_column),
    "gates the wrong way": (forward, "sigmoid", lambda values: 1 / (1 + np.exp(values)), skins.test_what_numpy_makes_of_a_network_is_what_torch_trained),
    "pushes along the gradient": (network, "pushed_targets", along_the_gradient, skins.test_the_collision_gradient_is_parallel_to_the_data_gradient),
    "pushes to the truth": (network, "pushed_targets", all_the_way, skins.test_the_collision_gradient_is_parallel_to_the_data_gradient),
    "gravity upward": (cape, "GRAVITY", -cape.GRAVITY, capes.test_a_free_cloth_in_a_vacuum_falls_as_newton_says),
    "a body that lets through": (cape, "pushed_out", lambda places, *_: places, capes.test_the_held_row_follows_the_body_and_no_vertex_is_inside),
    "motions without seeds": (data, "body_motion", lambda seed, *counts: capes.body_motion(0, *counts), capes.test_a_seed_makes_the_same_clips_again_and_another_seed_others),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_turns_a_property_red(fault, monkeypatch):
    module, name, wrong, check = FAULTS[fault]
    monkeypatch.setattr(module, name, wrong)
    with pytest.raises(AssertionError):
        check()
