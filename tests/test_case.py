"""Case files: data that is read into a case, or refused in one sentence."""

import copy

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from shellbench import catalog
from shellbench.case import build_case, read_case
from shellbench.errors import InputError
from shellbench.model import read_toml
from shellbench.places import Edge, Point

PLATE = read_toml(catalog.data_folder("cases") / "square_plate.toml")


def changed(change):
    data = copy.deepcopy(PLATE)
    change(data)
    return data


def refusal(change):
    with pytest.raises(InputError) as caught:
        build_case(changed(change), name="plate", where="plate.toml")
    message = str(caught.value)
    assert message.startswith("plate.toml: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("name", catalog.case_names())
def test_every_case_of_the_suite_is_read(name):
    case = catalog.named_case(name)
    assert case.name == name
    assert case.suites
    for suite in case.suites:
        assert suite in catalog.suite_names()
    assert any(q.kind == "largest_displacement" for q in case.quantities)


@pytest.mark.parametrize("name", catalog.suite_names())
def test_every_suite_has_cases_and_names_only_its_own(name):
    suite = catalog.find_suite(name)
    names = {case.name for case in catalog.cases_of(name)}
    assert names
    assert set(suite.order) <= names
    for run in suite.runs:
        assert set(run.cases) <= names


def test_the_digest_knows_physics_and_nothing_else():
    base = build_case(PLATE, "plate", "p").digest()
    prose = changed(
        lambda d: (d.update(title="x", suites=["obstacle_course"]), d["quantities"][0].update(tolerance={"fem": 1.0}))
    )
    assert build_case(prose, "other", "p").digest() == base
    for change in (
        lambda d: d["material"].update(thickness=1.0000001),
        lambda d: d["loads"][0].update(vector=[0, 0, "-1"]),
        lambda d: d["supports"][0].update(on=["xi1_min", "xi1_max", "xi2_min"]),
        lambda d: d["supports"][0].update(clamped=True),
        lambda d: d["quantities"][0].update(direction=[0, 0, 1]),
        lambda d: d.update(theory="kirchhoff-love-nonlinear"),
    ):
        assert build_case(changed(change), "plate", "p").digest() != base


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["material"].update(poissons_ratio=0.7), ["material.poissons_ratio", "0.7", "less than 0.5"]),
        (lambda d: d["material"].update(thickness=0), ["material.thickness", "greater than 0"]),
        (lambda d: d["material"].update(thickness="1"), ["material.thickness", "'1'", "number"]),
        (lambda d: d["material"].update(thickness=True), ["material.thickness", "number"]),
        (lambda d: d["material"].update(youngs_modulus=float("nan")), ["youngs_modulus", "nan"]),
        (lambda d: d["material"].pop("thickness"), ["material.thickness", "missing"]),
        (lambda d: d["material"].update(yield_stress=1), ["material.yield_stress", "not known"]),
        (lambda d: d.update(name="x"), ["'name'", "file"]),
        (lambda d: d.update(theory="naghdi"), ["theory", "naghdi", "kirchhoff-love-linear"]),
        (lambda d: d["surface"].update(kind="sphere"), ["sphere", "plane", "cylinder", "expression"]),
        (lambda d: d["surface"].update(xi1=[5, 5]), ["xi1", "smaller"]),
        (lambda d: d["supports"][0].update(on=["north"]), ["rim", "north", "xi1_min"]),
        (lambda d: d["supports"][0].update(components=["w"]), ["components", "'w'"]),
        (lambda d: d["supports"][0].update(components=["z", "z"]), ["repeat"]),
        (lambda d: d["supports"][0].update(on=["centre"], clamped=True), ["clamped", "centre", "edges"]),
        (lambda d: d["supports"].append(dict(d["supports"][0], name="again")), ["held by two supports"]),
        (lambda d: d["supports"].append(d["supports"][0]), ["'rim'", "differ"]),
        (lambda d: d["supports"][0].update(symmetry="x", clamped=True), ["symmetry"]),
        (lambda d: d["supports"][0].update(motion={"kind": "rotation", "axis": [0, 0, 0], "angle": 1}), ["axis", "zero"]),
        (lambda d: d["supports"][0].update(motion={"kind": "value", "z": "1/xi1"}), ["rim", "finite"]),
        (lambda d: d["supports"][0].update(motion={"kind": "value", "z": "exit()"}), ["rim", "exit"]),
        (lambda d: d["loads"][0].update(vector=[0, 0, "log(-1)"]), ["area", "finite"]),
        (lambda d: d["loads"][0].update(vector=[0, 0]), ["vector"]),
        (lambda d: d["loads"].append({"kind": "point", "on": ["xi1_min"], "force": [0, 0, 1]}), ["point", "xi1_min"]),
        (lambda d: d["loads"].append({"kind": "edge", "on": ["centre"], "vector": [0, 0, 1]}), ["edge", "centre"]),
        (lambda d: d["points"].update(far=[1000, 0]), ["points.far", "outside"]),
        (lambda d: d["points"].update(xi1_min=[1, 1]), ["xi1_min", "edge"]),
        (lambda d: d["quantities"].clear(), ["quantities"]),
        (lambda d: d["quantities"][0].update(primary=False), ["primary"]),
        (lambda d: d["quantities"][0].update(points=["xi1_min"]), ["centre_deflection", "edge"]),
        (lambda d: d["quantities"][0].update(direction=[0, 0, 0]), ["zero"]),
        (lambda d: d["quantities"][0].update(tolerance={"fem": -1}), ["tolerance.fem", "greater than 0"]),
        (lambda d: d["quantities"].append({"name": "r", "kind": "reaction", "support": "wall", "direction": [0, 0, 1]}), ["wall", "rim"]),
        (lambda d: d["supports"].clear(), ["singular", "translation_x"]),
        (lambda d: d["supports"][0].update(components=["z"]), ["singular"]),
        (lambda d: d.update(remove_rigid_motions=["rotation_z"]), ["rotation_z", "already hold"]),
        (lambda d: d.update(remove_rigid_motions=["spin"]), ["remove_rigid_motions", "'spin'"]),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence_that_names_field_and_cause(change, words):
    message = refusal(change)
    for word in words:
        assert word in message


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12) | st.sampled_from(["xi1", "1/xi1", "xi2_min"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["kind", "on", "x", "name", "vector"]), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip


def paths(data, prefix=()):
    """All places in nested data."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*prefix, key)
        yield from paths(value, (*prefix, key))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(sorted(paths(PLATE), key=str)), VALUES)
def test_a_fuzzed_case_is_a_case_or_a_clear_sentence(path, value):
    data = copy.deepcopy(PLATE)
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    try:
        assert len(build_case(data, name="plate", where="plate.toml").digest()) == 64
    except InputError as error:
        message = str(error)
    else:
        return
    assert message.startswith("plate.toml: ")
    assert "\n" not in message


@settings(max_examples=100, deadline=None)
@given(content=st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_file_is_a_case_or_a_clear_sentence(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("fuzz") / "case.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"case\.toml"):
        read_case(path)


def test_hostile_files_are_refused(tmp_path):
    for content in (b"x = " + b"[" * 100_000, b"a" * 2_000_000, b"\xff\xfe", b"title = 1"):
        path = tmp_path / "case.toml"
        path.write_bytes(content)
        with pytest.raises(InputError):
            read_case(path)
    with pytest.raises(InputError, match="can't be read"):
        read_case(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="can't be read"):
        read_case(tmp_path)


def test_places_are_named():
    places = build_case(PLATE, "plate", "p").places
    assert places["xi2_max"] == Edge("xi2_max", axis=1, side="max")
    assert places["xi1_min,xi2_max"] == Point("xi1_min,xi2_max", (0.0, 100.0))
    closed = catalog.named_case("pinched_cylinder_free").places
    assert set(closed) == {"xi2_min", "xi2_max", "top", "bottom"}


def moving(motion, theory="kirchhoff-love-linear"):
    def change(data):
        data["theory"] = theory
        data["supports"] = [{"name": "rim", "on": ["xi1_min"], "clamped": True, "motion": motion}]

    return build_case(changed(change), "plate", "p")


def test_motions_have_the_derivatives_of_their_values():
    motions = [
        {"kind": "rotation", "axis": [1, 2, 3], "centre": [5, 0, 1], "angle": "30*t"},
        {"kind": "value", "x": "sin(xi2/10)", "z": "t*xi2**2"},
        {"kind": "translation", "vector": [1, "t**2", 3]},
    ]
    xi = np.array([[20.0, 30.0], [70.0, 10.0]])
    for motion in motions:
        case = moving(motion, "kirchhoff-love-nonlinear")
        support, place = next(case.supported_places())
        exact = case.motion(support, place, xi, t=0.7, order=2)
        for key, lower, step in [
            ((1, 0), (0, 0), [1e-3, 0]), ((0, 1), (0, 0), [0, 1e-3]), ((0, 2), (0, 1), [0, 1e-3]), ((1, 1), (0, 1), [1e-3, 0]),
        ]:  # fmt: skip
            up, down = (case.motion(support, place, xi + s * np.array(step), t=0.7, order=2)[lower] for s in (1, -1))
            assert np.allclose(exact[key], (up - down) / 2e-3, rtol=1e-5, atol=1e-7)


def test_a_value_belongs_to_its_edge_and_tilts_nothing():
    case = moving({"kind": "value", "z": "xi1 + xi2"})
    support, place = next(case.supported_places())
    motion = case.motion(support, place, np.array([[60.0, 7.0]]), order=1)
    assert motion[0, 0].tolist() == [[0, 0, 7]]
    assert motion[1, 0].tolist() == [[0, 0, 0]]
    assert motion[0, 1].tolist() == [[0, 0, 1]]


def test_a_large_rotation_keeps_distances_and_a_linear_one_is_its_tangent():
    xi = np.array([[20.0, 30.0], [70.0, 10.0]])
    spin = {"kind": "rotation", "axis": [0, 1, 1], "centre": [1, 2, 3], "angle": 140}
    case = moving(spin, "kirchhoff-love-nonlinear")
    x = case.surface.position(xi)
    moved = x + case.motion(*next(case.supported_places()), xi)[0, 0]
    assert np.linalg.norm(moved[0] - moved[1]) == pytest.approx(np.linalg.norm(x[0] - x[1]), rel=1e-14)
    small = {**spin, "angle": 1e-4}
    exact, linear = (
        case.motion(*next(case.supported_places()), xi)[0, 0]
        for case in (moving(small, "kirchhoff-love-nonlinear"), moving(small))
    )
    assert np.abs(exact - linear).max() < 1e-5 * np.abs(exact).max()
