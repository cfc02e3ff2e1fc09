import numpy as np
import pytest

from shellbench.bench import catalog
from shellbench.solvers.kratos.symmetry import part_of, point_forces
from tests.solvers.kratos.iga_cases import LARGEST, RIM, known, plate, ring

STATIC = sorted(name for name in catalog.case_names() if getattr(catalog.named_case(name), "dynamics", name) is None)


@pytest.mark.parametrize("name", STATIC)
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
    """What the part carries, reflected into all copies, is the whole load: checked on the sum of magnitudes."""
    case = known(name)
    part, forces = part_of(case), point_forces(case, 1.0)
    places = [part.place(tuple(xi)) for xi, _ in forces]
    carried = sum(found[1] * np.linalg.norm(force) for found, (_, force) in zip(places, forces, strict=True) if found)
    assert carried * part.copies == pytest.approx(sum(np.linalg.norm(force) for _, force in forces))


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
    assert {motion for motion in motions if part.holds(motion)} == held
