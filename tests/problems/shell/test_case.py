"""Case files: data that is read into a case, or refused in one sentence."""

import copy
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case, read_case
from shellbench.problems.shell.question.places import Edge, Point, Whole
from shellbench.protocol.schema import read_toml
from tests import families

PLATE = read_toml(catalog.data_folder("cases") / "square_plate.toml")


def changed(change):
    data = copy.deepcopy(PLATE)
    change(data)
    return data


def refusal(change):
    return families.refusal(PLATE, change)


def test_every_case_of_the_suite_is_read():
    for name in catalog.case_names():
        case = catalog.named_case(name)
        assert case.name == name
        assert case.suites, name
        assert set(case.suites) <= set(catalog.suite_names()), name
        if case.kind == "shell" and case.linear and not case.modal:  # the shape of a mode has no size of its own
            asked = {q.kind for q in case.quantities}
            assert asked & {"largest_displacement", "derivative"} or "woven" in case.suites, name


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
        lambda d: d.update(theory="kirchhoff-love-nonlinear", loads=[{**d["loads"][0], "vector": [0, 0, "-t"]}]),
    ):
        assert build_case(changed(change), "plate", "p").digest() != base


def test_a_pressure_that_does_not_follow_is_the_one_that_says_nothing():
    """Records of dead pressures are older than those that follow."""

    def pressed(**more):
        return build_case(changed(lambda d: d.update(loads=[{"kind": "pressure", "value": "t", **more}])), "plate", "p")

    silent, dead, follows = pressed(), pressed(follows=False), pressed(follows=True)
    assert "follows" not in silent.physics()["loads"][0]
    assert silent.digest() == dead.digest() != follows.digest()


def test_a_pressure_follows_in_the_non_linear_theory_only():
    loads = [{"kind": "pressure", "value": "t", "follows": True}, {"kind": "pressure", "value": "2*t*xi1"}]
    linear = build_case(changed(lambda d: d.update(loads=loads)), "plate", "p")
    finite = linear.model_copy(update={"theory": "kirchhoff-love-nonlinear"})
    assert linear.following == ()
    assert linear.dead == linear.loads
    assert finite.following == finite.loads[:1]
    assert finite.dead == finite.loads[1:]
    assert np.allclose(finite.pressure([[1.0, 2.0], [3.0, 4.0]], 0.5), 0.5)


def _overlapping(data):
    data["edge_parts"] = {"a": {"edge": "xi1_min", "between": [1, 2]}}
    data["supports"].append({"name": "part", "on": ["a"]})


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
        (lambda d: d.update(theory="koiter"), ["theory", "koiter", "kirchhoff-love-linear"]),
        (lambda d: d["surface"].update(kind="sphere"), ["sphere", "plane", "cylinder", "expression"]),
        (lambda d: d["surface"].update(xi1=[5, 5]), ["xi1", "smaller"]),
        (lambda d: d["supports"][0].update(on=["north"]), ["rim", "north", "xi1_min"]),
        (lambda d: d["supports"][0].update(on=["a\n\x1bb"]), ["rim", r"a\n\x1bb", "xi1_min"]),
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
        (lambda d: d.update(edge_parts={"a": {"edge": "xi3_min", "between": [1, 2]}}), ["edge_parts.a", "xi3_min", "xi1_min"]),
        (lambda d: d.update(edge_parts={"a": {"edge": "xi1_min", "between": [2, 1]}}), ["edge_parts.a", "[2.0, 1.0]", "xi2"]),
        (lambda d: d.update(edge_parts={"a": {"edge": "xi1_min", "between": [1, 1000]}}), ["edge_parts.a", "bounds of xi2"]),
        (lambda d: d.update(edge_parts={"a": {"edge": "xi1_min", "between": [1, 1]}}), ["edge_parts.a", "shorter"]),
        (lambda d: d.update(edge_parts={"centre": {"edge": "xi1_min", "between": [1, 2]}}), ["edge_parts.centre", "another place"]),
        (lambda d: d.update(edge_parts={"a": {"edge": "xi1_min", "from": 1}}), ["edge_parts.a"]),
        (lambda d: _overlapping(d), ["component x", "'xi1_min' and 'a' overlap"]),
        (lambda d: d["quantities"].clear(), ["quantities"]),
        (lambda d: d["quantities"][0].update(primary=False), ["primary"]),
        (lambda d: d["quantities"][0].update(points=["xi1_min"]), ["centre_deflection", "'xi1_min' is none"]),
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


NAPKIN = read_toml(catalog.data_folder("cases") / "napkin_plane.toml")
FUZZED = {  # cases, and what of them is changed
    "plate": (PLATE, PLATE.keys()),
    "roof": (read_toml(catalog.data_folder("cases") / "hinged_roof_thick.toml"), {"path", "loads", "quantities"}),
    "napkin": (NAPKIN, {"dynamics", "springs", "supports", "loads", "quantities", "material"}),
}


@pytest.mark.parametrize("name", FUZZED)
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(drawn=st.data())
def test_a_fuzzed_case_is_a_case_or_a_clear_sentence(name, drawn):
    data, parts = copy.deepcopy(FUZZED[name][0]), FUZZED[name][1]
    *outer, last = drawn.draw(st.sampled_from(sorted((place for place in paths(data) if place[0] in parts), key=str)))
    place = data
    for key in outer:
        place = place[key]
    place[last] = drawn.draw(VALUES)
    try:
        case = build_case(data, name=name, where="case.toml")
    except InputError as error:
        refused = str(error)
    else:
        assert len(case.digest()) == 64
        if name == "roof" or case.dynamics is not None:
            assert all(0 < state <= (case.dynamics or case.path).until for state in case.states)
        assert np.all(case.spring_stiffness(case.surface.domain.grid(5, 5)) >= 0)
        return
    assert re.fullmatch(r"case\.toml: [^\n]*", refused)


@settings(max_examples=50, deadline=None)
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
    with pytest.raises(InputError, match="no regular file, but a folder"):
        read_case(tmp_path)


def test_places_are_named():
    places = build_case(PLATE, "plate", "p").places
    assert places["xi2_max"] == Edge("xi2_max", axis=1, side="max")
    assert places["xi1_min,xi2_max"] == Point("xi1_min,xi2_max", (0.0, 100.0))
    closed = catalog.named_case("pinched_cylinder_free").places
    assert set(closed) == {"xi2_min", "xi2_max", "surface", "top", "bottom"}


def moving(motion, theory="kirchhoff-love-linear"):
    def change(data):
        data["theory"] = theory
        data["loads"] = []
        data["supports"] = [{"name": "rim", "on": ["xi1_min"], "clamped": True, "motion": motion}]

    return build_case(changed(change), "plate", "p")


def test_motions_have_the_derivatives_of_their_values():
    motions = [
        {"kind": "rotation", "axis": [1, 2, 3], "centre": [5, 0, 1], "angle": "30*t"},
        {"kind": "value", "x": "t*sin(xi2/10)", "z": "t*xi2**2"},
        {"kind": "translation", "vector": ["t", "t**2", "3*t"]},
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
    spin = {"kind": "rotation", "axis": [0, 1, 1], "centre": [1, 2, 3], "angle": "140*t"}
    case = moving(spin, "kirchhoff-love-nonlinear")
    x = case.surface.position(xi)
    moved = x + case.motion(*next(case.supported_places()), xi)[0, 0]
    assert np.linalg.norm(moved[0] - moved[1]) == pytest.approx(np.linalg.norm(x[0] - x[1]), rel=1e-14)
    small = {**spin, "angle": "1e-4*t"}
    exact, linear = (
        case.motion(*next(case.supported_places()), xi)[0, 0]
        for case in (moving(small, "kirchhoff-love-nonlinear"), moving(small))
    )
    assert np.abs(exact - linear).max() < 1e-5 * np.abs(exact).max()


# the non-linear theory: paths, moments, and what is prescribed everywhere

ROOF = read_toml(catalog.data_folder("cases") / "hinged_roof_thick.toml")
SHEET = read_toml(catalog.data_folder("cases") / "rolled_plate.toml")
MOULD = {"name": "mould", "on": ["surface"], "motion": {"kind": "value", "z": "t*xi1**2"}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["path"].update(quantity="depth"), ["'depth'", "no displacement quantity"]),
        (lambda d: d["path"].update(quantity="limit_load"), ["'limit_load'", "no displacement quantity"]),
        (lambda d: d["path"].pop("quantity"), ["path", "displacement quantity"]),
        (lambda d: d["path"].update(control="load"), ["path", "'load'"]),
        (lambda d: d["path"].update(control="steps"), ["path.control", "'steps'", "arc_length"]),
        (lambda d: d["path"].update(until=0), ["path.until", "greater than 0"]),
        (lambda d: d["path"].update(states=[31]), ["ends at 30", "beyond"]),
        (lambda d: d["path"].update(until=25, states=[10, 20]), ["asked for at 30", "from 0 to 25"]),
        (lambda d: d["quantities"][3].update(at=-1), ["asked for at -1", "from 0 to 30"]),
        (lambda d: d["quantities"][3].update(at=0), ["asked for at 0", "from 0 to 30"]),
        (lambda d: d.update(theory="kirchhoff-love-linear"), ["'displacement'", "belongs to the non-linear theory"]),
        (lambda d: d.update(path={}), ["'limit_load'", "needs a path", "'arc_length'"]),
        (lambda d: d["loads"][0].update(force=[0, 0, -250]), ["kind 'point'", "acts at t = 0", "load factor"]),
        (lambda d: d["loads"][0].update(force=[0, 0, "-250*t**2"]), ["kind 'point'", "not proportional to t", "'displacement'"]),
        (lambda d: d["loads"][0].update(force=[0, 0, "-sin(t)"]), ["kind 'point'", "not proportional to t"]),
        (lambda d: d["loads"].append({"kind": "gravity", "acceleration": [0, 0, -9.81]}), ["kind 'gravity'", "acts at t = 0"]),
        (lambda d: d["loads"].append({"kind": "pressure", "value": "1 + t"}), ["kind 'pressure'", "acts at t = 0"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["xi2_max"], "axis": [1, 0, 0], "value": 1}), ["kind 'moment'", "acts at t = 0"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["xi2_max"], "axis": [0, 0, 0], "value": "t"}), ["axis of a moment", "zero"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["xi2_max"], "axis": [0, 0, 2], "value": "t"}), ["axis of a moment", "normal"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["centre"], "axis": [1, 0, 0], "value": "t"}), ["moment", "can't act on 'centre'"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["rim"], "axis": [1, 0, 0], "value": "t"}), ["kind 'moment'", "'rim'", "not a place"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["xi2_max"], "axis": [1, 0, 0], "value": "t*log(-1)"}), ["moment", "finite"]),
        (lambda d: d["loads"].append({"kind": "moment", "on": ["xi2_max"], "axis": [1, 0, 0], "value": "t*eval(1)"}), ["moment", "eval"]),
        (lambda d: d["supports"][0].update(motion={"kind": "translation", "vector": [0, 0, 1]}), ["motion of support 'hinge'", "acts at t = 0"]),
        (lambda d: d["supports"][0].update(motion={"kind": "rotation", "axis": [0, 1, 0], "angle": "5*t"}), ["motion of support 'hinge'", "not proportional"]),
        (lambda d: d["quantities"][0].update(number=0), ["number", "greater than or equal to 1"]),
        (lambda d: d["quantities"][0].update(turning="force"), ["turning", "'force'"]),
        (lambda d: d["quantities"][0].update(gives="energy"), ["gives", "'energy'"]),
    ],
)  # fmt: skip
def test_an_impossible_path_is_one_sentence(change, words):
    message = families.refusal(ROOF, change)
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["supports"][0].pop("motion"), ["'mould'", "surface", "motion"]),
        (lambda d: d["supports"].append({"name": "edge", "on": ["xi1_min"]}), ["'mould'", "no other"]),
        (lambda d: d["supports"][0].update(on=["surface", "xi1_min"]), ["'mould'", "no other place"]),
        (lambda d: d["supports"][0].update(on=["xi1_min", "surface"]), ["no"]),
        (lambda d: d["supports"][0].update(components=["z"]), ["'mould'", "all components"]),
        (lambda d: d["supports"][0].update(clamped=True), ["clamped", "'surface'", "only edges"]),
        (lambda d: d.update(points={"surface": [0.5, 0.1]}), ["points.surface", "surface"]),
        (lambda d: d.update(loads=[{"kind": "edge", "on": ["surface"], "vector": [0, 0, "t"]}]), ["edge", "can't act on 'surface'"]),
        (lambda d: d.update(loads=[{"kind": "moment", "on": ["surface"], "axis": [1, 0, 0], "value": "t"}]), ["can't act on 'surface'"]),
        (lambda d: d["quantities"].append({"name": "u", "kind": "displacement", "points": ["surface"], "direction": [1, 0, 0]}), ["'u'", "'surface' is none"]),
        (lambda d: d["supports"][0]["motion"].update(z="1/xi1"), ["'mould'", "finite"]),
        (
            lambda d: d.update(points={"p": [1, 0]}, path={"control": "displacement", "quantity": "w", "until": 0.5},
                quantities=[{"name": "w", "kind": "displacement", "primary": True, "points": ["p"], "direction": [0, 0, 1], "at": 0.5}]),
            ["everything is prescribed", "'displacement'"],
        ),
    ],
)  # fmt: skip
def test_what_is_prescribed_everywhere_is_prescribed_whole(change, words):
    message = families.refusal(SHEET, change)
    for word in words:
        assert word in message


def test_marks_are_what_is_asked_for_and_what_is_kept():
    roof = build_case(ROOF, "roof", "r")
    assert roof.states == (10, 20, 30)  # not that of the limit points, whose place is unknown
    assert roof.path.states == (10, 20)
    assert catalog.named_case("rolled_plate").states[0] == 0.0833333333
    assert catalog.named_case("cantilever_shear").states == (0.25, 0.5, 0.75, 1.0)


def test_loads_may_grow_as_they_like_under_load_control():
    data = copy.deepcopy(PLATE) | {"theory": "kirchhoff-love-nonlinear"}
    data["loads"] = [{"kind": "area", "vector": [0, "sin(t)", "-t**2"]}]
    assert not build_case(data, "plate", "p").linear


def test_a_case_without_a_path_is_what_it_was_before_there_were_any():
    """Known values and records refer to digests: a path that says nothing new must be told by the physics, though."""
    base = build_case(ROOF, "roof", "r").digest()
    for change in (
        lambda d: d["path"].update(until=31),
        lambda d: d["path"].update(states=[10]),
        lambda d: d["path"].update(control="arc_length"),
    ):
        data = copy.deepcopy(ROOF)
        change(data)
        assert build_case(data, "roof", "r").digest() != base


def test_the_whole_surface_takes_a_value_with_all_its_derivatives():
    case = build_case(
        SHEET | {"supports": [MOULD | {"motion": {"kind": "value", "x": "xi2", "z": "t*xi1**2*xi2"}}]}, "s", "s"
    )
    support, place = next(case.supported_places())
    assert place == Whole("surface")
    points = np.array([[0.3, 0.2], [0.9, 0.4]])
    motion = case.motion(support, place, points, t=0.5, order=2)
    a, b = points.T
    zero, one = np.zeros(2), np.ones(2)
    expected = {
        (0, 0): (b, zero, 0.5 * a**2 * b), (1, 0): (zero, zero, a * b), (0, 1): (one, zero, 0.5 * a**2),
        (2, 0): (zero, zero, b), (1, 1): (zero, zero, a), (0, 2): (zero, zero, zero),
    }  # fmt: skip
    for key, value in expected.items():
        assert np.allclose(motion[key], np.stack(value, axis=-1), rtol=1e-14, atol=1e-15)


def test_a_load_that_is_infinite_on_the_way_is_one_sentence():
    data = read_toml(catalog.data_folder("cases") / "square_plate_nonlinear.toml")
    data["loads"] = [{"kind": "area", "vector": [0, 0, "t/(t-0.25)"]}]
    with pytest.raises(InputError, match=r"kind 'area' is not finite at t = 0\.25, on the way to 1"):
        build_case(data, "pole", "case.toml")


def test_gravity_needs_a_mass_to_act_on():
    pull = [{"kind": "gravity", "acceleration": [0, 0, -9.8]}]
    for density in ({}, {"areal_density": 0}):
        message = refusal(lambda d, rho=density: (d.update(loads=pull), d["material"].update(rho)))
        assert "'material.areal_density': found 0" in message
        assert "kind 'gravity'" in message
    build_case(changed(lambda d: (d.update(loads=pull), d["material"].update(areal_density=0.1))), "plate", "case.toml")
