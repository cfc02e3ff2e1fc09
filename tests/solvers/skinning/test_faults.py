"""Faults in the cape and in what skins it: each must turn a property red."""

import numpy as np
import pytest

from shellbench.problems.skinning import cape, data, quantities
from shellbench.problems.skinning.body import distance, pushed_out
from shellbench.solvers.rope import stepping
from shellbench.solvers.skinning import driven, forward, linear, network, units
from tests.problems.skinning import test_cape as capes
from tests.solvers.skinning import test_driven as ropes
from tests.solvers.skinning import test_skinning as skins


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    data.simulated_clips.cache_clear()
    driven.driven.cache_clear()
    yield
    data.simulated_clips.cache_clear()


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
    "the nearest bone alone": (quantities, "hat_weights", lambda nodes, count, _=None: (np.abs(np.arange(count)[:, None] - nodes) < 0.5).astype(float), skins.test_bilinear_interpolation_is_exact_for_what_is_linear_in_row_and_column),
    "gates the wrong way": (units, "sigmoid", lambda values: 1 / (1 + np.exp(values)), skins.test_what_numpy_makes_of_a_network_is_what_torch_trained),
    "pushes along the gradient": (network, "pushed_targets", along_the_gradient, skins.test_the_collision_gradient_is_parallel_to_the_data_gradient),
    "pushes to the truth": (network, "pushed_targets", all_the_way, skins.test_the_collision_gradient_is_parallel_to_the_data_gradient),
    "gravity upward": (cape, "GRAVITY", -cape.GRAVITY, capes.test_a_free_cloth_in_a_vacuum_falls_as_newton_says),
    "a body that lets through": (cape, "pushed_out", lambda places, *_: places, capes.test_the_held_row_follows_the_body_and_no_vertex_is_inside),
    "bodies that push as if they stood still": (driven.TurningBody, "velocity", lambda body, places, time: 0.0 * places, ropes.test_what_is_fixed_to_a_leg_that_swings_is_carried_with_it),
    "bodies that carry nothing along": (driven, "_carried", lambda places, *_: places, ropes.test_what_is_fixed_to_a_leg_that_swings_is_carried_with_it),
    "ropes through the body": (driven.TurningBody, "distance", lambda body, places: np.ones(places.shape[:-1]), ropes.test_chains_hang_from_the_neck_outside_the_body_and_no_longer_than_the_pattern),
    "links of twice the length": (driven, "Chains", lambda lengths, *rest, **more: stepping.Chains(2 * lengths, *rest, **more), ropes.test_chains_hang_from_the_neck_outside_the_body_and_no_longer_than_the_pattern),
    "a skirt without its seam": (cape.Cape, "closed", property(lambda skirt: False), ropes.test_a_skirt_without_motion_stays_symmetric_across_its_seam),
    "edges without those at the seam": (quantities, "edge_lengths", lambda skirt, x: [np.linalg.norm(np.diff(x, axis=k), axis=-1) for k in (-3, -2)], ropes.test_quantities_without_a_true_mesh),
    "jitter of the first difference": (quantities.Jitter, "measure", lambda asked, made: float(np.sqrt((np.diff(made.meshes, axis=0) ** 2).sum(-1).mean())), ropes.test_quantities_without_a_true_mesh),
    "weights that are not orthonormal": (np.linalg, "qr", lambda hats: (hats, None), ropes.test_fine_and_coarse_errors_add_up_and_bilinear_fields_are_coarse),
    "details that are left out": (network, "shape_skin", forward.bone_skin, ropes.test_a_shape_network_learns_what_the_skinning_network_leaves),
    "one unit for all chains": (units, "chain", lambda number: "chain_0_", ropes.test_a_unit_a_chain_infers_bones_and_the_perceptron_skins_them),
    "motions without seeds": (data, "body_motion", lambda seed, *counts: capes.body_motion(0, *counts), capes.test_a_seed_makes_the_same_clips_again_and_another_seed_others),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_turns_a_property_red(fault, monkeypatch):
    module, name, wrong, check = FAULTS[fault]
    monkeypatch.setattr(module, name, wrong)
    with pytest.raises(AssertionError):
        check()
