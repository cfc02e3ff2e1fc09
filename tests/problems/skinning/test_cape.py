"""The simulated cape: held rows, the body's surface, what falls, seeds, splits, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.errors import InputError
from shellbench.problems.skinning import data
from shellbench.problems.skinning.body import Capsule, directions, distance, pushed_out, segments
from shellbench.problems.skinning.cape import GRAVITY, Cloth
from shellbench.problems.skinning.data import clips_of
from shellbench.problems.skinning.motion import RATE, body_motion, rotations
from tests.problems.skinning.capes import small


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    data.simulated_clips.cache_clear()


def test_the_held_row_follows_the_body_and_no_vertex_is_inside():
    case = small()
    clips = clips_of(case)
    assert clips.meshes[:, 0] == pytest.approx(np.broadcast_to(case.cape.rest()[0], clips.meshes[:, 0].shape), abs=1e-7)
    phi = distance(clips.meshes[:, 1:].reshape(len(clips.meshes), -1, 3), clips.axes, clips.radii)
    assert case.margin - 1e-6 <= phi.min() <= case.margin + 1e-6  # it lies on the body; float32 is kept
    assert np.ptp(clips.meshes[:, -1], axis=0).max() > 1e-3  # it moves


def test_a_seed_makes_the_same_clips_again_and_another_seed_others():
    once = clips_of(small()).meshes
    for kept in data.kept_at(small().cape, small().body, small().margin).parent.iterdir():
        kept.unlink()
    data.simulated_clips.cache_clear()
    assert clips_of(small()).meshes == pytest.approx(once, abs=1e-6)
    assert np.abs(clips_of(small(cape={"seed": 1})).meshes - once).max() > 1e-3


def test_clips_are_kept_and_a_damaged_file_is_made_anew(capfd):
    case = small()
    once = clips_of(case).meshes
    path = data.kept_at(case.cape, case.body, case.margin)
    assert [one.name for one in path.parent.iterdir()] == [path.name]
    path.write_bytes(path.read_bytes()[:100])
    data.simulated_clips.cache_clear()
    assert clips_of(case).meshes == pytest.approx(once, abs=1e-6)
    assert data.kept_at(case.cape, case.body, 0.01) != path


def test_a_clip_is_the_same_however_many_there_are():
    few, many = body_motion(3, 2, 20), body_motion(3, 4, 20)
    assert many.places[:2] == pytest.approx(few.places, abs=1e-12)
    assert few.places[:, 0] == pytest.approx(0)


def test_a_runner_and_a_dancer_keep_their_speed_after_the_start():
    still, drifting = body_motion(3, 2, 120), body_motion(3, 2, 120, (2.0, 3.0))
    forward = np.diff(still.places - drifting.places, axis=1)[..., 1] * RATE
    turning = np.diff(drifting.angles - still.angles, axis=1)[..., 2] * RATE
    for speed, largest in ((forward, 2.0), (turning * [[1.0], [-1.0]], 3.0)):
        assert speed[:, 31:] == pytest.approx(np.broadcast_to(speed[:, -1:], speed[:, 31:].shape))
        assert (largest / 2 <= speed[:, -1]).all()
        assert (speed[:, -1] <= largest).all()
        assert (np.diff(speed[:, :30], axis=1) > 0).all()


def test_a_free_cloth_in_a_vacuum_falls_as_newton_says():
    case = small(cape={"air": 0.0})
    far = (Capsule(name="far", start=(0.0, 0.0, -90.0), end=(0.0, 0.0, -99.0), radius=0.1),)
    cloth = Cloth(case.cape, far, 0.0)
    places = np.moveaxis(cloth.rest, -1, 0)[..., None]
    velocity = np.tile(np.array([0.3, -0.2, 0.1])[:, None, None, None], (1, *places.shape[1:]))
    axes = segments(far, np.zeros(1))
    collar = places[:, 0] + velocity[:, 0] / RATE + (GRAVITY / RATE**2)[:, None, None]
    after, speed = cloth.step(places, velocity, collar, axes, axes)
    assert after - places == pytest.approx(np.broadcast_to((collar - places[:, 0])[:, None], places.shape), abs=1e-12)
    assert speed == pytest.approx(velocity + (GRAVITY / RATE)[:, None, None, None], abs=1e-10)


def test_a_turn_keeps_lengths_and_a_stride_swings_what_swings():
    angles = np.random.default_rng(0).normal(size=(5, 3))
    turns = rotations(angles)
    assert turns @ turns.swapaxes(-1, -2) == pytest.approx(np.broadcast_to(np.eye(3), turns.shape))
    case = small()
    axes = segments(case.body, np.array([0.0, 0.3]))
    assert axes[0] == pytest.approx(np.array([(part.start, part.end) for part in case.body]))
    assert axes[1, 0] == pytest.approx(axes[0, 0])
    assert axes[1, 1, 1] == pytest.approx([0.0, -0.8 * np.sin(0.3), -0.5 - 0.8 * np.cos(0.3)])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_what_is_pushed_is_outside_and_what_is_outside_stays(seed):
    draw = np.random.default_rng(seed)
    body = (Capsule(name="one", start=(0.0, 0.0, 0.0), end=(0.0, 0.3, -0.4), radius=0.2),)
    axes, radii = segments(body, np.zeros(1)), np.array([0.2])
    places = draw.normal(scale=0.3, size=(1, 40, 3))
    out = pushed_out(places, axes, radii, 0.01)
    before, after = distance(places, axes, radii), distance(out, axes, radii)
    assert after.min() >= 0.01 - 1e-12
    assert out[before > 0.01] == pytest.approx(places[before > 0.01], abs=1e-12)
    way = directions(places, axes)
    step = 1e-6
    assert distance(places + step * way[:, 0], axes, radii) - before == pytest.approx(step, rel=1e-6)


def test_splits_share_no_clip_and_no_frame():
    by_clips = small(cape={"clips": 4}, split={"by": "clips", "held_out": [3, 1]})
    frames = by_clips.cape.frames
    assert set(by_clips.held_out // frames) == {1, 3}
    assert set(by_clips.seen // frames) == {0, 2} == set(by_clips.groups)
    by_frames = small(split={"by": "frames", "share": 0.25})
    assert len(by_frames.held_out) == 5
    for case in (by_clips, by_frames):
        together = np.sort(np.concatenate([case.seen, case.held_out]))
        assert np.array_equal(together, np.arange(case.cape.clips * frames))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"split": {"by": "clips", "held_out": [2]}}, "clip 2 is held out, but there are only 2"),
        ({"split": {"by": "clips", "held_out": [0, 1]}}, "all clips are held out"),
        ({"split": {"by": "clips", "held_out": [1, 1]}}, "held out twice: 1, 1"),
        ({"split": {"by": "frames", "share": 0.01}}, "a share of 0.01 holds out 0 frames"),
        ({"split": {"by": "frames", "share": 1.0}}, "field 'split.share': found 1.0, but it must be less than 1"),
        ({"split": {"by": "seeds"}}, "field 'split.by': found 'seeds'"),
        ({"bones": {"nodes": 9}}, "there are 9 nodes of bones, but only 8 vertices"),
        ({"cape": {"rows": 2}}, "field 'cape.rows': found 2"),
        ({"cape": {"mass": -1.0}}, "field 'cape.mass': found -1.0, but it must be greater than 0"),
        ({"margin": -0.1}, "field 'margin': found -0.1"),
        ({"body": []}, "field 'body'"),
    ],
)
def test_bad_input_is_one_sentence(changes, words):
    with pytest.raises(InputError, match=r"^small\.toml: ") as caught:
        small(**changes)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
