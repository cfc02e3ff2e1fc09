"""Bones by rope chains: bodies that turn, chains that stay outside, and quantities that need no true mesh."""

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problems.skinning import data
from shellbench.problems.skinning.body import distance
from shellbench.problems.skinning.cape import Cloth
from shellbench.problems.skinning.data import clips_of
from shellbench.problems.skinning.motion import BodyMotion, coordinates
from shellbench.solvers.skinning import driven, forward, linear, solver, units
from shellbench.solvers.skinning.solution import Skinned
from tests.problems.skinning.capes import small

ROPES = {"lateral": 1.0, "damping": 0.02}
MOVED = [
    {"name": name, "kind": name} for name in ("edge_strain", "bone_distance", "jitter", "bone_jitter", "bone_error")
]
FINE = [{"name": name, "kind": name} for name in ("fine_error", "coarse_error")]


def by_ropes(**changes):
    asked = [
        {"name": "inside", "kind": "penetration_share", "primary": True},
        *MOVED,
        *FINE,
        {"name": "error", "kind": "error"},
    ]
    return small(ropes=ROPES, quantities=asked, **changes)


def measured(case, meshes):
    """Measure meshes (n, rows, columns, 3) as an answer to a case, bones among their vertices."""

    class Answer:
        clips = clips_of(case)
        bones = driven.bone_grid(case, meshes)

    Answer.case, Answer.meshes = case, meshes
    return {q.name: q.measure(Answer) for q in case.quantities if q.kind not in ("bone_error",)}


def test_chains_hang_from_the_neck_outside_the_body_and_no_longer_than_the_pattern():
    case = by_ropes(cape={"frames": 30, "running": 2.0})
    clips = clips_of(case)
    found = driven.bone_places(case, clips, case.held_out)
    assert found[0] == pytest.approx(driven.bone_grid(case, clips.rest[None])[0])
    collar = case.cape.rest()[0, case.grid[1]]
    assert found[:, 0] == pytest.approx(np.broadcast_to(collar, found[:, 0].shape), abs=1e-12)
    phi = distance(found[:, 1:].reshape(len(found), -1, 3), clips.axes[case.held_out], clips.radii)
    assert phi.min() > 0.9 * case.margin
    lengths = np.linalg.norm(np.diff(found, axis=1), axis=-1)
    steps = np.linalg.norm(np.diff(case.cape.rest()[:, case.grid[1]], axis=0), axis=-1)
    longest = np.add.reduceat(steps, case.grid[0][:-1], axis=0)
    assert (lengths[1:] / longest).max() < 1.02  # a push out of the body may stretch a link
    assert np.abs(found[-1] - found[0]).max() > 0.02
    seen = driven.bone_places(case, clips, case.seen)
    assert seen == pytest.approx(driven.bone_grid(case, clips.meshes[case.seen]))


def test_what_is_fixed_to_a_leg_that_swings_is_carried_with_it():
    case = small(cape={"twirling": 90.0})
    step, times = 1e-5, np.array([0.4, 0.4 + 1e-5])
    axes = driven.frames_of(case.body, BodyMotion.of(coordinates(0, 1, times, case.cape.drift)[None]))
    body = driven.TurningBody(
        np.array([p.radius for p in case.body]), *(tuple(a[n] for a in axes) for n in (0, 1)), step
    )
    knee = axes[1][:, 1] + np.einsum("nij,j->ni", axes[2][:, 1], [0.1, 0.36, -0.5])  # near the second capsule, outside
    assert body.carried(knee[:1], 0.0, step) == pytest.approx(knee[1:], abs=1e-12)
    assert body.velocity(knee[1:], step) == pytest.approx((knee[1:] - knee[:1]) / step, rel=1e-6)
    assert np.linalg.norm(body.velocity(knee[1:], step)) > 0.1
    foot = axes[0][:, 1, 1]  # the end of the capsule's own axis
    assert body.carried(foot[:1], 0.0, step) == pytest.approx(foot[1:], abs=1e-12)
    places = np.random.default_rng(0).normal(size=(50, 3))
    for axis in np.eye(3):
        slope = (body.distance(places + 1e-6 * axis) - body.distance(places - 1e-6 * axis)) / 2e-6
        assert slope == pytest.approx(body.gradient(places) @ axis, abs=1e-6)
    assert body.distance(places) == pytest.approx(distance(places, axes[0][1], body.radii), abs=1e-7)


def test_a_skirt_without_motion_stays_symmetric_across_its_seam():
    case = small(
        cape={"around": 360.0, "columns": 8},
        body=[{"name": "pole", "start": [0.0, 0.0, -0.1], "end": [0.0, 0.0, -2.0], "radius": 0.1}],
    )
    rest = clips_of(case).rest
    turned = np.linalg.norm(rest[..., :2], axis=-1)
    assert turned == pytest.approx(np.broadcast_to(turned[:, :1], turned.shape), abs=1e-6)
    assert rest[..., 2] == pytest.approx(np.broadcast_to(rest[:, :1, 2], turned.shape), abs=1e-6)
    assert len(Cloth(case.cape, case.body, 0.0).families) == 10  # six inside, four at the seam


def test_quantities_without_a_true_mesh():
    case = by_ropes(cape={"around": 360.0, "columns": 8})
    rest, frames = case.cape.rest(), case.cape.frames
    time = np.arange(frames)[:, None, None, None]
    still = measured(case, rest + 0.1 * time * np.array([1.0, 2.0, 3.0]))
    assert still["edge_strain"] == pytest.approx(0.0, abs=1e-12)
    assert (still["jitter"], still["bone_jitter"]) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert measured(case, 1.1 * rest + 0.0 * time)["edge_strain"] == pytest.approx(0.1)
    assert measured(case, rest + 0.5 * 0.01 * time**2 * np.array([0.6, 0.0, 0.8]))["jitter"] == pytest.approx(0.01)
    cut = (
        rest + np.where(np.arange(8) == 0, 0.5, 0.0)[:, None] + 0.0 * time
    )  # the first column is torn off, at the seam too
    edges = np.linalg.norm(np.diff(np.concatenate([cut[0], cut[0][:, :1]], axis=1), axis=1), axis=-1)
    base = np.linalg.norm(np.diff(np.concatenate([rest, rest[:, :1]], axis=1), axis=1), axis=-1)
    assert measured(case, cut)["edge_strain"] == pytest.approx(
        np.sqrt(((edges / base - 1) ** 2).sum() / (8 * 8 + 7 * 8))
    )


def test_fine_and_coarse_errors_add_up_and_bilinear_fields_are_coarse():
    case = by_ropes()
    truth = clips_of(case).meshes[case.held_out]
    rough = truth + np.random.default_rng(0).normal(size=truth.shape)
    found = measured(case, rough)
    assert found["fine_error"] ** 2 + found["coarse_error"] ** 2 == pytest.approx(found["error"] ** 2)
    assert min(found["fine_error"], found["coarse_error"]) > 0.1
    rows, columns = np.meshgrid(np.arange(8.0), np.arange(6.0), indexing="ij")
    smooth = measured(case, truth + np.stack([1 + 0.1 * rows, 0.2 * columns, 0.3 * rows * columns], axis=-1))
    assert smooth["fine_error"] == pytest.approx(0.0, abs=1e-12)


def roughness(case, modes):
    """Return the share of modes (k, 3 v) that is finer than the bones."""
    down, across = (np.linalg.qr(hats)[0] for hats in linear.bone_hats(case))
    grid = modes.reshape(len(modes), case.cape.rows, case.cape.columns, 3)
    coarse = np.einsum("ri,si,ck,dk,nsdx->nrcx", down, down, across, across, grid, optimize=True)
    return 1 - (coarse**2).sum() / (grid**2).sum()


def test_a_shape_network_learns_what_the_skinning_network_leaves():
    case = by_ropes(cape={"frames": 30})
    settings = {"epochs": 30, "widths": (20,), "learning_rate": 3e-3, "collision": False, "modes": 5}
    coarse = solver.NetworkSolver().solve(case, settings)
    made = solver.ShapeSolver().solve(case, settings | {"shape_rate": 3e-3})
    first = Skinned(case, "skin-network", forward.bone_skin, {n: a for n, a in made.arrays.items() if "shape" not in n})
    assert first.fitted == pytest.approx(coarse.fitted, abs=1e-6)
    truth = made.clips.meshes[case.seen]
    before, after = (((one.fitted - truth) ** 2).sum() for one in (first, made))
    assert after < before
    basis = units.part(made.arrays, forward.SHAPE)
    left = (truth - first.fitted).reshape(len(truth), -1)
    kept = left - linear.from_modes(basis, linear.coefficients(basis, left))
    values = np.linalg.svd(left - left.mean(axis=0), compute_uv=False)
    assert (kept**2).sum() == pytest.approx((values[5:] ** 2).sum(), rel=1e-6)  # Eckart and Young
    assert roughness(case, basis["modes"]) > roughness(case, coarse.arrays["modes"])  # figure 8 of the paper


def test_a_unit_a_chain_infers_bones_and_the_perceptron_skins_them():
    case = small(cape={"frames": 30})
    options = {"epochs": 60, "skin_epochs": 2, "width": 8, "learning_rate": 2e-2}
    made = solver.ChainsSolver().solve(case, options)
    assert made.bones.shape == (30, *(case.bones.nodes, case.bones.chains), 3)
    given = (made.bones - driven.bone_grid(case, made.clips.rest[None])).reshape(30, -1)
    moved = forward.dense(made.arrays, given).reshape(made.meshes.shape)
    assert made.meshes == pytest.approx(made.clips.rest + moved)
    true = driven.bone_grid(case, made.clips.meshes)
    seen = units.bones_used(made.arrays, case, made.clips, case.seen)
    still = ((true[case.seen] - true[case.seen].mean(axis=0)) ** 2).sum()
    assert ((seen - true[case.seen]) ** 2).sum() < 0.3 * still
    assert made.bones[:, :, 0] != pytest.approx(true[case.held_out][:, :, 0], abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ropes": ROPES, "split": {"by": "frames", "share": 0.2}}, "ropes move whole clips: hold out by clips"),
        ({"ropes": {"lateral": -1.0, "damping": 0.0}}, "field 'ropes.lateral': found -1.0"),
        ({"cape": {"around": 350.0}}, "the cape is open by 10 degrees: at least 30 must be, or none"),
    ],
)
def test_bad_input_is_one_sentence(changes, words):
    with pytest.raises(InputError, match=r"^small\.toml: ") as caught:
        small(**changes)
    assert words in str(caught.value)


@pytest.fixture(scope="module", autouse=True)
def _own_folder(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(data.FOLDER, str(tmp_path_factory.mktemp("clips")))
        data.simulated_clips.cache_clear()
        driven.driven.cache_clear()
        yield
    data.simulated_clips.cache_clear()
