"""Planes of symmetry of a case: which there are, the part that they leave, and the part as a case of its own."""

import numpy as np
import pytest

from shellbench.problems.shell.posed.mirrors import mirrored_supports, point_forces
from shellbench.problems.shell.posed.rigid import check_held
from shellbench.problems.shell.quantities.measure import area_rule, load_density
from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of
from tests.families import shells, stated, with_something_new
from tests.problems.shell.stated_shells import LARGEST, RIM, known, plate, ring

STATIC = [name for name in shells() if "dynamics" not in stated(name)]


@pytest.mark.parametrize("name", with_something_new(STATIC))
def test_the_part_and_its_images_are_the_shell(name):
    """Folded points are in the part, and reflecting their positions gives those of the points they came from."""
    case = known(name)
    part = part_of(case)
    points = case.surface.domain.grid(14, 11)
    folded = part.fold(points)
    assert np.all(folded.points >= np.asarray(part.lower) - 1e-12)
    assert np.all(folded.points <= np.asarray(part.upper) + 1e-12)
    middle = np.zeros(3)
    for mirror in part.mirrors:
        middle[mirror.normal] = mirror.offset
    found = middle + (case.surface.position(folded.points) - middle) * folded.signs
    np.testing.assert_allclose(found, case.surface.position(points), atol=1e-9 * np.abs(found).max())
    sizes = np.subtract(part.upper, part.lower)
    assert np.prod(sizes) * part.copies == pytest.approx(np.prod(case.surface.domain.size))


@pytest.mark.parametrize(
    ("name", "copies", "planes"),
    [
        ("square_plate", 4, {(0, "max"): 0, (1, "max"): 1}),
        ("scordelis_lo", 4, {(0, "max"): 0, (1, "max"): 2}),
        ("pinched_cylinder_free", 8, {(0, "min"): 2, (0, "max"): 0, (1, "max"): 1}),
        ("pinched_cylinder_diaphragm", 8, {(0, "min"): 2, (0, "max"): 0, (1, "max"): 1}),
        ("annular_plate", 4, {(0, "min"): 1, (0, "max"): 0}),
        ("cantilever_shear", 2, {(1, "max"): 1}),
        ("slit_annular_plate", 1, {}),
        ("hinged_roof_thick", 1, {}),
        ("cylinder_pull_out", 1, {}),
    ],
)
def test_planes_of_the_suite(name, copies, planes):
    part = part_of(known(name))
    assert (part.copies, dict(part.planes)) == (copies, planes)


@pytest.mark.parametrize(
    ("changes", "axes"),
    [
        ({}, {0, 1}),
        ({"loads": [{"kind": "area", "vector": [0, 0, "xi1"]}]}, {1}),
        ({"loads": [{"kind": "area", "vector": [0, 0, "(xi1 - 1/2)**2 * xi2"]}]}, {0}),
        ({"loads": [{"kind": "area", "vector": [1, 0, 0]}]}, {1}),
        ({"loads": [{"kind": "area", "vector": [0, 0, "exp(-((xi1 - 0.3)**2 + (xi2 - 0.5)**2)*5000)"]}]}, {1}),
        ({"loads": [{"kind": "area", "vector": ["xi1 - 1/2", 0, 0]}]}, {0, 1}),
        ({"loads": [{"kind": "point", "on": ["beside"], "force": [0, 0, 1]}]}, {0}),
        ({"loads": [{"kind": "point", "on": ["centre"], "force": [0, 1, 1]}]}, {0}),
        ({"loads": [{"kind": "edge", "on": ["xi1_min"], "vector": [0, 0, 1]}]}, {1}),
        ({"loads": [{"kind": "edge", "on": ["xi1_min", "xi1_max"], "vector": [0, 0, "xi2"]}]}, {0}),
        ({"loads": [{"kind": "edge", "on": ["xi1_min", "xi1_max"], "vector": [1, 0, 0]}]}, {1}),
        ({"supports": [RIM | {"on": RIM["on"][:3]}]}, {0}),
        ({"supports": [RIM | {"on": RIM["on"][1:]}, {"name": "other", "on": ["xi1_min"], "clamped": True}]}, {1}),
        ({"supports": [RIM | {"on": RIM["on"][:2]}, {"name": "ends", "on": RIM["on"][2:3], "components": ["z"]}]}, {0}),
        ({"supports": [RIM | {"on": RIM["on"][:2]}, {"name": "corner", "on": ["xi1_min,xi2_min"]}]}, set()),
        ({"surface": {"kind": "expression", "x": "xi1", "y": "xi2", "z": "xi1**3/9", "xi1": [-1, 1], "xi2": [0, 1]},
          "points": {}}, {1}),
    ],
)  # fmt: skip
def test_only_what_is_symmetric_is_found(changes, axes):
    assert {mirror.axis for mirror in part_of(plate(**changes)).mirrors} == axes


@pytest.mark.parametrize(
    "load",
    [
        {"kind": "area", "vector": ["cos(xi1)*sin(xi1)**2", 0, "t"]},
        {"kind": "area", "vector": ["cos(3*xi1 - 0.4)", 0, "sin(3*xi1 - 0.4)"]},
    ],
)
def test_a_closed_shell_without_two_planes_is_not_quartered(load):
    part = part_of(ring(loads=[load]))
    assert len([m for m in part.mirrors if m.axis == 0]) < 2


def test_a_load_that_is_symmetric_at_its_end_only_is_none():
    case = plate(theory="kirchhoff-love-nonlinear", loads=[{"kind": "area", "vector": ["t*(1 - t)", 0, "t"]}])
    assert {mirror.axis for mirror in part_of(case).mirrors} == {1}


@pytest.mark.parametrize("theory", ["kirchhoff-love-linear", "kirchhoff-love-nonlinear"])
def test_a_load_that_is_skew_only_at_a_state_that_is_asked_for_is_none(theory):
    """Next to nothing is skew at t = 1, or on the way but for a moment at 0.7."""
    skew = "t*(1 + xi1*exp(-(40*(t - 0.7))**2))"
    asked = [LARGEST, {"name": "energy", "kind": "strain_energy", "at": 0.7}]
    case = plate(theory=theory, loads=[{"kind": "pressure", "value": skew}], quantities=asked)
    assert {mirror.axis for mirror in part_of(case).mirrors} == {1}


def test_a_half_turn_is_found_where_a_quarter_is_not():
    part = part_of(ring(loads=[{"kind": "area", "vector": [0, 0, "sin(xi1)**2"]}]))
    assert part.copies == 4  # half a turn, and half of the length
    assert part.upper[0] - part.lower[0] == pytest.approx(np.pi)
    assert part.planes[0, "min"] == part.planes[0, "max"] == 0


@pytest.mark.parametrize("name", ["pinched_cylinder_free", "pinched_cylinder_diaphragm", "hinged_roof_thick"])
def test_shares_of_point_loads_add_up(name):
    """Compare sums of magnitudes: the loads of the part, reflected into all copies, are the whole load."""
    case = known(name)
    part = part_of(case)
    carried, whole = (sum(np.linalg.norm(f) for _, f in point_forces(c, 1.0)) for c in (part.case, case))
    assert carried * part.copies == pytest.approx(whole)


@pytest.mark.parametrize(
    ("changes", "held"),
    [
        ({}, {"translation_x", "translation_y", "rotation_x", "rotation_y", "rotation_z"}),
        ({"loads": [{"kind": "area", "vector": [0, 0, "xi2"]}]}, {"translation_x", "rotation_y", "rotation_z"}),
    ],
)
def test_planes_exclude_the_motions_that_they_must(changes, held):
    part = part_of(plate(**changes))
    motions = [f"{kind}_{axis}" for kind in ("translation", "rotation") for axis in "xyz"]
    assert {motion for motion in motions if part.excludes_motion(motion)} == held


def test_a_load_on_next_to_nothing_of_the_shell_is_seen():
    spot = "where(abs(xi1 - 0.3) < 1e-4, 1, 0)*where(abs(xi2 - 0.4) < 1e-4, 1, 0)"
    loads = [{"kind": "area", "vector": [0, 0, spot]}]
    assert part_of(plate()).copies > part_of(plate(loads=loads)).copies == 1
    spot = "where(abs(xi1 - 0.3) < 1e-4, 1, 0)"
    loads = [{"kind": "edge", "on": ["xi2_max", "xi2_min"], "vector": [0, 0, spot]}]
    assert part_of(plate(loads=loads)).copies == 2


@pytest.mark.parametrize("name", with_something_new(STATIC))
def test_the_part_is_a_case_that_carries_its_share(name):
    """Its loads over the area are the whole's in magnitude; its planes, its supports and what is removed hold it."""
    case = known(name)
    part = part_of(case)
    sizes = []
    for one in (part.case, case):
        points, weights = area_rule(one)
        sizes.append(weights @ np.linalg.norm(load_density(one, points, 1.0), axis=-1))
    assert part.copies * sizes[0] == pytest.approx(sizes[1], rel=1e-6)
    check_held(part.case)
    assert whole_of(case).case is case


@pytest.mark.parametrize("start", [0, 100, 250, -80])
def test_the_part_of_a_closed_shell_lies_within_its_domain(start):
    """Wherever the coordinate begins: formulas need not hold beyond it."""
    surface = {"kind": "cylinder", "radius": 3.0, "closed": True, "xi1": [start, start + 360], "xi2": [0, 4]}
    pinched = [{"kind": "point", "on": ["a"], "force": [0, 0, -1]}, {"kind": "point", "on": ["b"], "force": [0, 0, 1]}]
    case = ring(surface=surface, points={"a": [90, 2], "b": [270, 2]}, loads=pinched)
    part = part_of(case)
    assert part.copies == 8
    assert part.lower[0] >= case.surface.domain.lower[0] - 1e-12
    assert part.upper[0] <= case.surface.domain.upper[0] + 1e-12
    np.testing.assert_allclose(part.case.surface.domain.size, [np.pi / 2, 2.0])
    (point,) = part.case.points  # one of the two, at a corner
    xi = part.case.places[point].xi
    assert all(
        min(abs(x - low), abs(x - high)) < 1e-12 for x, low, high in zip(xi, part.lower, part.upper, strict=True)
    )
    np.testing.assert_allclose([np.linalg.norm(force) for _, force in point_forces(part.case, 1.0)], [0.25])


def test_a_mirror_carries_supports_to_their_images():
    """Two supports that a mirror swaps are each other's images; two that share what one holds opposite have none."""
    left, right = ({"name": name, "on": [f"xi1_{end}"]} for name, end in (("left", "min"), ("right", "max")))
    (first, second) = part_of(plate(supports=[left, right])).mirrors
    case = plate(supports=[left, right])
    assert (first.axis, mirrored_supports(case, first)) == (0, (1, 0))
    assert (second.axis, mirrored_supports(case, second)) == (1, (0, 1))
    several = plate(supports=[left | {"components": ["x", "y"]}, left | {"name": "up", "components": ["z"]}, right])
    mirrors = part_of(several).mirrors
    assert [mirrored_supports(several, mirror) for mirror in mirrors] == [None, (0, 1, 2)]
    seen = [(number, place.name) for number, _, place in part_of(several).supported((mirrors[0],))]
    assert seen == [(2, "xi1_min")]  # where the part is held, its image is held by the other support


@pytest.mark.parametrize(("there", "axes"), [(0.1, {0, 1}), (0.1001, {1}), (-0.1, {1})])
def test_points_that_move_are_held_against_their_images(there, axes):
    """Two points that are lifted alike; one of them a thousandth too far, or the other way."""
    supports = [
        {"name": name, "on": [name], "components": ["z"], "motion": {"kind": "translation", "vector": [0, 0, z]}}
        for name, z in (("a", 0.1), ("b", there))
    ]
    case = plate(points={"a": [0.25, 0.5], "b": [0.75, 0.5]}, supports=[RIM, *supports])
    assert {mirror.axis for mirror in part_of(case).mirrors} == axes
