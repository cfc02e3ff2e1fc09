"""Views in three dimensions hold the fields of the records, and differences that rounding does not spoil."""

import base64
import gzip
import json

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import read_fields
from shellbench.report.page.view import (
    COARSE,
    FINE,
    LARGEST,
    MOST_STATES,
    packed,
    palettes_json,
    plotly,
    script_sources,
    scripts,
    stride,
    views,
)
from tests.report.conftest import COURSE, record, row
from tests.report.motion import BROKEN, OFFSET


def unpacked(kept):
    """Read a view as its script does, written from the description of the format alone."""
    n1, n2 = kept["shape"]
    steps = np.frombuffer(gzip.decompress(base64.b64decode(kept["data"])), dtype="<i2").reshape(-1, n1 * n2)
    planes = iter(np.cumsum(steps, axis=1, dtype=np.int16).reshape(-1, n1, n2).astype(float))

    def vector(step):
        return step * np.stack([next(planes) for _ in range(3)], axis=-1)

    position = vector(kept["position"]) + np.array(kept["centre"])
    if (kept["along"] or {}).get("inward"):
        assert np.linalg.norm(vector(kept["along"]["inward"]), axis=-1) == pytest.approx(1.0, abs=1e-3)
    answers = []
    for answer in kept["answers"]:
        states = []
        for mark, state in enumerate(answer["states"]):
            values = None if state is None else vector(state["step"])
            states.append(values + answers[0]["states"][mark] if state and state["relative"] else values)
        density = None if answer["density"] is None else answer["density"] * next(planes)
        answers.append({**answer, "states": states, "density": density})
    assert next(planes, None) is None
    return position, answers


def kept_views(store):
    by_id = {record.run_id: record for record in store.records}
    return {name: json.loads(one.json) for name, one in views(Evidence(by_id, store.rows, store.folder)).items()}


@pytest.fixture(scope="module")
def course(store):
    return kept_views(store)


@pytest.fixture(scope="module")
def cloth(motion):
    return kept_views(motion)


def test_every_case_has_a_view_of_every_solver(course):
    assert set(course) == set(COURSE)
    for kept in course.values():
        assert {answer["label"].split()[0] for answer in kept["answers"]} == {"fem", "ndf", "ndf-ritz"}
        assert kept["marks"] == [""]


def test_a_view_gives_back_the_fields_of_its_records(store, course):
    records = {record.run_id: record for record in store.records}
    for kept in course.values():
        position, answers = unpacked(kept)
        for answer in answers:
            fields = read_fields(records[answer["run"]], store.folder)
            thin = (len(fields.position) - 1) // (len(position) - 1)
            size = np.abs(fields.position).max()
            assert np.abs(position - fields.position[::thin, ::thin]).max() <= size / LARGEST
            rounding = np.abs(fields.displacement).max() / LARGEST
            assert np.abs(answer["states"][0] - fields.displacement[::thin, ::thin]).max() <= rounding


def test_differences_are_rounded_relative_to_themselves(store, course):
    """The two differ by some 1e-5, about a step of the displacement's own rounding, and are kept far more sharply."""
    records = {record.run_id: record for record in store.records}
    _, answers = unpacked(course["square_plate"])
    by_solver = {answer["label"]: answer for answer in answers}
    first, second = by_solver["fem"], by_solver["ndf-ritz"]
    assert answers[0] is first
    ours, theirs = (read_fields(records[one["run"]], store.folder).displacement for one in (second, first))
    exact = np.abs(ours - theirs).max()
    assert 0 < exact < 5 * np.abs(theirs).max() / LARGEST
    assert np.abs(second["states"][0] - first["states"][0]).max() == pytest.approx(exact, rel=2 / LARGEST)


def test_a_view_of_a_motion_has_its_frames(motion, cloth):
    records = {record.run_id: record for record in motion.records}
    for name, kept in cloth.items():
        assert len(kept["marks"]) <= MOST_STATES
        assert max(kept["shape"]) <= COARSE
        _, answers = unpacked(kept)
        for answer in answers:
            fields = read_fields(records[answer["run"]], motion.folder)
            assert any(state is not None for state in answer["states"]), name
            last = [state for state in answer["states"] if state is not None][-1]
            thin = (len(fields.position) - 1) // (len(last) - 1)
            ends = [np.abs(last - state[::thin, ::thin]).max() for state in fields.displacements]
            assert min(ends) <= np.abs(fields.displacements).max() / LARGEST


def test_a_motion_that_broke_has_no_states_afterwards(cloth):
    kept = cloth["pendulum_strip"]
    broken = next(answer for answer in kept["answers"] if "failed" in answer["label"])
    whole = next(answer for answer in kept["answers"] if "failed" not in answer["label"])
    assert whole["states"][-1] is not None
    assert broken["states"][-1] is None
    for words, state in zip(kept["marks"], broken["states"], strict=True):
        if float(words.split()[2]) > BROKEN:
            assert state is None


def test_the_difference_of_two_motions_is_that_of_their_formulas(cloth):
    _, answers = unpacked(cloth["napkin_plane"])
    last = [answer["states"][-1] for answer in answers]
    apart = np.abs(np.linalg.norm(last[1] - last[0], axis=-1))
    assert apart == pytest.approx(np.full_like(apart, OFFSET), rel=1e-4)  # records keep frames in single precision


def test_energy_density_is_the_sum_of_its_parts(tmp_path):
    case = catalog.named_case("square_plate")
    made = record(tmp_path, case, "fem")
    with np.load(tmp_path / made.fields_file) as stored:
        arrays = dict(stored)
    x = arrays["xi"][..., 0]
    arrays |= {"membrane_energy_density": (x**2).astype(np.float32), "bending_energy_density": (3 * x).astype("f4")}
    np.savez_compressed(tmp_path / made.fields_file, **arrays)
    kept = json.loads(views(Evidence({made.run_id: made}, [row(made)], tmp_path))["square_plate"].json)
    _, (answer,) = unpacked(kept)
    thin = len(x) // (kept["shape"][0] - 1)
    density = (x**2 + 3 * x)[::thin, ::thin]
    assert np.abs(answer["density"] - density).max() <= density.max() / LARGEST


@pytest.mark.parametrize("spoilt", [float("nan"), float("inf")])
def test_a_density_that_is_not_finite_is_not_shown(tmp_path, spoilt):
    made = record(tmp_path, catalog.named_case("square_plate"), "fem")
    with np.load(tmp_path / made.fields_file) as stored:
        arrays = dict(stored)
    whole = np.ones(arrays["xi"].shape[:2], dtype=np.float32)
    bad = whole.copy()
    bad[0, 0] = spoilt
    np.savez(tmp_path / made.fields_file, membrane_energy_density=bad, bending_energy_density=whole, **arrays)
    shown = views(Evidence({made.run_id: made}, [row(made)], tmp_path))["square_plate"]
    assert json.loads(shown.json)["answers"][0]["density"] is None
    assert not shown.dense


def test_runs_without_fields_have_no_view(tmp_path):
    made = record(tmp_path, catalog.named_case("square_plate"), "fem")
    (tmp_path / made.fields_file).write_bytes(b"not an archive")
    assert views(Evidence({made.run_id: made}, [row(made)], tmp_path)) == {}


@pytest.mark.parametrize(
    ("points", "most", "expected"), [(61, FINE, 1), (61, COARSE, 2), (41, COARSE, 2), (9, COARSE, 1), (101, COARSE, 4)]
)
def test_grids_are_thinned_so_that_both_ends_stay(points, most, expected):
    assert stride(points, most) == expected
    assert (points - 1) % expected == 0


def test_planes_wrap_around_and_back():
    extremes = np.array([LARGEST, -LARGEST, LARGEST, 0], dtype=np.int16)
    steps = np.frombuffer(gzip.decompress(base64.b64decode(packed([extremes]))), dtype="<i2")
    assert np.cumsum(steps, dtype=np.int16).tolist() == extremes.tolist()


def test_no_word_of_a_case_ends_the_script_that_holds_it(store):
    title = "</script><script>alert(1)</script>"
    plates = {record.run_id: record for record in store.records if record.case_name == "square_plate"}
    evil = {
        run_id: record.model_copy(update={"case": record.case | {"title": title}}) for run_id, record in plates.items()
    }
    (one,) = views(Evidence(evil, store.rows, store.folder)).values()
    assert "<" not in one.json
    assert json.loads(one.json)["title"] == title


def test_the_run_of_the_still_picture_comes_first(store, course):
    by_id = {record.run_id: record for record in store.records}
    for answer in course["square_plate"]["answers"]:
        shown = views(Evidence(by_id, store.rows, store.folder), {"square_plate": answer["run"]})["square_plate"]
        assert shown.run_ids[0] == answer["run"]
        assert [one["run"] for one in json.loads(shown.json)["answers"]] == list(shown.run_ids)


def test_colours_are_those_of_the_still_pictures():
    maps = json.loads(palettes_json())["maps"]
    assert maps["sequential"][0] == [0.0, "#440154"]  # viridis, from its authors' table
    assert maps["sequential"][-1] == [1.0, "#fde725"]
    assert all([stop for stop, _ in stops] == sorted(stop for stop, _ in stops) for stops in maps.values())


def test_a_page_without_views_carries_no_library():
    assert len(script_sources(viewing=False)) == len(scripts(viewing=False)) == 1
    assert plotly() not in scripts(viewing=True)
    allowed = set(script_sources(viewing=True))
    assert "'self'" in allowed  # the library is a file beside the pages, and runs by its hash only
    assert len(allowed) == len(scripts(viewing=True)) + 2
