"""The content of a saved file, and the parts that matter."""

import pickle

import numpy as np
import pytest
from safetensors.numpy import save_file

from shellbench.testing.keeping import compressed_size, is_pickled, read_arrays, what_matters, write_altered


@pytest.fixture(params=["npz", "safetensors"])
def saved(request, tmp_path):
    arrays = {"field": np.arange(12.0).reshape(4, 3), "index": np.arange(5)}
    path = tmp_path / f"file.{request.param}"
    if request.param == "npz":
        np.savez(path, words=np.asarray("{}"), **arrays)
    else:
        save_file(arrays, path, metadata={"words": "{}"})
    return path


def test_arrays_are_read_and_altered_one_at_a_time(saved, tmp_path):
    found = read_arrays(saved)
    assert set(found.arrays) == {"field", "index"}
    again = read_arrays(write_altered(found, "field", (slice(None), 1), tmp_path / f"new{saved.suffix}"))
    changed = again.arrays["field"] != found.arrays["field"]
    assert changed[:, 1].all()
    assert not changed[:, [0, 2]].any()
    assert np.array_equal(again.arrays["index"], found.arrays["index"])
    assert (
        read_arrays(write_altered(found, "index", (), tmp_path / f"b{saved.suffix}")).arrays["index"] != np.arange(5)
    ).all()


def test_only_the_slices_that_matter_count():
    array = np.zeros((100, 6))
    assert what_matters(array, lambda part: part == () or part[-1] < 3).shape == (100, 3)
    assert what_matters(array, lambda _: False) is None
    assert what_matters(array, lambda _: True).shape == (100, 6)


def test_no_solution_file_is_a_pickle(saved):
    assert not is_pickled(saved)


def test_pickles_are_known(tmp_path):
    plain, archive = tmp_path / "a", tmp_path / "b.npz"
    plain.write_bytes(pickle.dumps({"a": 1}))
    np.savez(archive, a=np.array([{"a": 1}], dtype=object))
    assert is_pickled(plain)
    assert is_pickled(archive)


def test_noise_can_not_be_compressed_and_order_can():
    noise = np.random.default_rng(0).standard_normal(1000)
    assert 0.8 * noise.nbytes < compressed_size(noise) <= noise.nbytes
    assert compressed_size(np.zeros(1000)) < 100


def test_complex_numbers_are_numbers(tmp_path):
    np.savez(tmp_path / "waves.npz", waves=np.array([1 + 2j, 3 - 1j]), words="text")
    saved = read_arrays(tmp_path / "waves.npz")
    assert saved is not None
    assert list(saved.arrays) == ["waves"]
    with np.load(write_altered(saved, "waves", (), tmp_path / "other.npz")) as other:
        assert np.allclose(other["waves"], 1.001 * saved.arrays["waves"])
        assert str(other["words"]) == "text"
