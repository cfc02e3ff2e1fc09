"""Cases that are solved on the part that mirrors make the whole of: the answer is that on the whole mesh."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problem import FIELDS
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.symmetry.mirror_frame import in_frame_of_mirrors
from shellbench.problems.shell.variants.placing import ASKEW, placed_data, turning
from shellbench.solvers.fem.linear.symmetry import SYMMETRIC, FoldedMesh
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.solvers.fem.shells import EVERY_EDGE, EVERY_MOTION, TORUS, shell, surface_points

PIN = {"name": "rim", "on": EVERY_EDGE}
DOWN = {"kind": "area", "vector": [0, 0, -1]}
ROOF = {"kind": "cylinder", "axis": "z", "radius": 2.0, "xi1": [50, 130], "xi2": [0, 3]}
TUBE = {"kind": "cylinder", "axis": "z", "radius": 2.0, "closed": True, "xi1": [0, 360], "xi2": [0, 3]}
TUBE_ALONG_XI1 = {
    "kind": "expression", "x": "2*cos(xi2)", "y": "xi1", "z": "2*sin(xi2)",
    "xi1": [0, 3], "xi2": [0, 360], "angles": ["xi2"], "periodic": ["xi2"],
}  # fmt: skip
ENDS = {"name": "ends", "on": ["xi2_min", "xi2_max"]}


def wall(name, edge, **fields):
    return {"name": name, "on": [edge], **fields}


def point(name, *force):
    return {"kind": "point", "on": [name], "force": list(force)}


def edge(name, *vector):
    return {"kind": "edge", "on": [name], "vector": list(vector)}


def pull(*vector):
    return {"kind": "translation", "vector": list(vector)}


# name: the case, its cells, and the images along each coordinate
SYMMETRIC_CASES = {
    "pressure_on_a_plate": (shell(supports=[PIN], loads=[{"kind": "pressure", "value": "1 + (xi1 - 1)**2"}]), (3, 2), (2, 2)),
    "load_that_varies_along_one_side": (
        shell(supports=[PIN], loads=[{"kind": "area", "vector": [0, "0.1*sin(xi1)", "-exp(xi1)"]}]), (3, 2), (1, 1)
    ),
    "load_that_varies_along_the_other_side": (
        shell(supports=[PIN], loads=[{"kind": "area", "vector": ["0.1*(xi1 - 1)", 0, "-exp(xi2)"]}]), (3, 2), (2, 1)
    ),
    "pulled_by_two_supports": (
        shell(
            supports=[
                wall("left", "xi1_min", motion=pull("-0.1*t", 0, 0), clamped=True),
                wall("right", "xi1_max", motion=pull("0.1*t", 0, 0), clamped=True),
            ]
        ), (3, 2), (2, 2)
    ),
    "pulled_by_one_support": (
        shell(supports=[wall("left", "xi1_min"), wall("right", "xi1_max", motion=pull(0.1, 0, 0))], loads=[DOWN]),
        (3, 2), (1, 2),
    ),
    "clamped_roof_with_edge_loads": (
        shell(
            ROOF,
            supports=[wall("front", "xi2_min", clamped=True), wall("back", "xi2_max", clamped=True)],
            loads=[edge("xi1_min", "1 + xi2*(3 - xi2)", 0.5, 0), edge("xi1_max", "-1 - xi2*(3 - xi2)", 0.5, 0),
                   {"kind": "gravity", "acceleration": [0, -9.81, 0]}],
        ), (3, 2), (2, 2)
    ),
    "turned_plate": (
        shell(
            supports=[
                wall("left", "xi1_min", motion={"kind": "rotation", "axis": [0, 1, 0], "angle": "3*t"}, clamped=True),
                wall("right", "xi1_max", clamped=True,
                     motion={"kind": "rotation", "axis": [0, -1, 0], "centre": [2, 0, 0], "angle": "3*t"}),
            ]
        ), (3, 2), (2, 2)
    ),
    "forces_at_points_and_point_supports": (
        shell(
            points={"a": [0.5, 0.25], "b": [1.5, 0.25], "c": [0.5, 0.75], "d": [1.5, 0.75], "m": [1, 0.5], "n": [1, 0.2],
                    "o": [1, 0.8]},
            supports=[{"name": "first", "on": ["a", "b"]}, {"name": "second", "on": ["c", "d"]}],
            loads=[point("m", 0, 0, 3), point("n", 0, 0, -1), point("o", 0, 0, "-t")],
        ), (4, 4), (2, 2)
    ),
    "pinched_tube": (
        shell(TUBE, points={"a": [30, 1.5], "b": [210, 1.5]}, supports=[ENDS],
              loads=[point("a", -1, 0, 0), point("b", -1, 0, 0)]), (4, 3), (1, 2)
    ),
    "tube_under_its_weight": (shell(TUBE, supports=[ENDS], loads=[{"kind": "area", "vector": [0, -1, 0]}]), (4, 3), (1, 2)),
    "tube_that_is_pressed_across": (
        shell(TUBE, supports=[ENDS], loads=[{"kind": "area", "vector": ["cos(xi1)", 0, 0]}]), (4, 3), (4, 2)
    ),
    "tube_under_a_load_from_one_side": (
        shell(TUBE, points={"a": [90, 1]}, supports=[wall("end", "xi2_min", clamped=True)], loads=[point("a", 0, -1, 0)]),
        (4, 3), (2, 1)
    ),
    "tube_whose_only_mirror_is_off_the_first_mesh_line": (  # energies are integrated over the whole, then
        shell(TUBE, supports=[wall("end", "xi2_min", clamped=True)],
              loads=[{"kind": "area", "vector": [0, "1 + sin(xi1)", 0]}]), (8, 4), (1, 1)
    ),
    "tube_under_a_load_from_below": (
        shell(TUBE, points={"a": [270, 1.5]}, supports=[ENDS], loads=[point("a", 0, 1, 0), edge("xi2_min", 0, 1, 0),
              edge("xi2_max", 0, 1, 0)]), (4, 3), (2, 2)
    ),
    "free_tube": (
        shell(TUBE, points={"a": [300, 1.5], "b": [120, 1.5]}, remove_rigid_motions=EVERY_MOTION,
              loads=[{"kind": "pressure", "value": "cos(2*xi1)"}]), (4, 3), (4, 2)
    ),
    "tube_closed_in_its_other_coordinate": (
        shell(TUBE_ALONG_XI1, points={"a": [1.5, 90], "b": [1.5, 270]}, remove_rigid_motions=EVERY_MOTION,
              loads=[point("a", 0, 0, -1), point("b", 0, 0, 1)]), (8, 8), (2, 4)  # coarser ones miss free rotations
    ),
    "axial_force_on_a_tube": (
        shell(TUBE, supports=[{**ENDS, "components": ["x", "y"]}], remove_rigid_motions=["translation_z"],
              loads=[edge("xi2_min", 0, 0, "-cos(xi1)**2"), edge("xi2_max", 0, 0, "cos(xi1)**2")]), (4, 3), (4, 2)
    ),
    "tube_that_slides": (
        shell(TUBE, supports=[{**ENDS, "components": ["x", "y"]}], remove_rigid_motions=["translation_z"],
              loads=[{"kind": "area", "vector": ["0.1*cos(xi1)", 0, "xi2*cos(2*xi1)"]}]), (4, 3), (4, 1)
    ),
    "torus": (
        shell(TORUS, remove_rigid_motions=EVERY_MOTION, loads=[{"kind": "pressure", "value": "cos(xi1)**2*cos(xi2)"}]),
        (4, 4), (4, 2)
    ),
}  # fmt: skip


def both(case, cells, **settings):
    return [
        FemSolver().solve(case, FemSettings(cells=cells, max_unknowns=100, symmetry=symmetry, **settings))
        for symmetry in (False, True)
    ]


def agree(whole, part):
    """Assert that two solutions tell the same of everything, up to what rounding may hide in either.

    The last corrections tell of it but for rotations that nothing holds and a mesh of an expression nearly knows: they
    move by 260 times as much from one instruction set to another (the tube closed in its other coordinate).
    """
    case = whole.case
    tolerance = max(1e-10, 2000 * max(s.diagnostics["last_correction"] for s in (whole, part)))
    points = surface_points(case.surface, 60)

    def alike(one, other, scale=None):
        one, other = np.asarray(one), np.asarray(other)
        scale = np.abs(one).max() if scale is None else scale
        assert np.abs(one - other).max() <= tolerance * scale

    alike(whole.displacement(points), part.displacement(points))
    fields = {name: whole.evaluate(name, points) for name in FIELDS}
    largest = {name: np.abs(field).max() for name, field in fields.items()}
    thickness = case.material.thickness
    strain = max(largest["membrane_strain"], thickness * largest["bending_strain"])
    density = max(largest["membrane_energy_density"], largest["bending_energy_density"])
    scales = dict(zip(FIELDS, (strain, strain / thickness, density, density), strict=True))
    for name, field in fields.items():
        alike(field, part.evaluate(name, points), scales[name])
    alike(whole.energies(), part.energies(), sum(whole.energies()))
    assert np.array_equal(whole.support_nodes, part.support_nodes)
    if whole.support_forces.size:
        lengths = whole.mesh.node_scales[whole.support_nodes][:, None, :, None]
        alike(whole.support_forces / lengths, part.support_forces / lengths)
        size = np.abs(whole.support_forces[..., 0, :]).sum()
        for support in case.supports:
            for one, other in zip(whole.reaction(support.name), part.reaction(support.name), strict=True):
                alike(one, other, size * max(1.0, np.abs(case.surface.position(points)).max()))
    assert whole.history[-1].energy == pytest.approx(part.history[-1].energy, rel=tolerance)
    for name, value in whole.history[-1].quantities.items():
        assert part.history[-1].quantities[name] == pytest.approx(
            value, rel=tolerance, abs=tolerance * sum(whole.energies())
        )
    assert whole.mesh.lines[0].shape == part.mesh.lines[0].shape
    assert np.array_equal(whole.mesh.node_points, part.mesh.node_points)
    assert whole.storage_bytes == part.storage_bytes


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", SYMMETRIC_CASES)
def test_the_part_answers_as_the_whole(name):
    case, cells, images = SYMMETRIC_CASES[name]
    whole, part = both(case, cells)
    assert (whole.images, part.images) == ((1, 1), images)
    assert part.parameters < whole.parameters or name == "load_that_varies_along_one_side"
    agree(whole, part)


@pytest.mark.parametrize(
    ("name", "cells", "images"),
    [
        ("square_plate", (4, 3), (2, 2)),
        ("scordelis_lo", (6, 4), (2, 2)),
        ("annular_plate", (4, 6), (4, 1)),
        ("pinched_cylinder_diaphragm", (6, 5), (4, 2)),
        ("pinched_cylinder_free", (6, 5), (4, 2)),
    ],
)
def test_the_cases_of_the_suites(name, cells, images):
    whole, part = both(catalog.named_case(name), cells)
    assert part.images == images
    assert part.parameters <= 1.05 * whole.parameters / np.prod(images)
    agree(whole, part)


def askew(case, rotation=None):
    return Case.model_validate(placed_data(case, rotation or turning(case), (0.4, -2.0, 1.3)))


# Where nothing holds a turn, the whole mesh is pinned at other nodes than the part. A rotation that is none across a
# mirror is rounding after a turn, and what is compared with its image then is rounding too: solved whole.
NOT_ASKEW = {"free_tube", "torus", "tube_closed_in_its_other_coordinate", "turned_plate"}


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", sorted(SYMMETRIC_CASES.keys() - NOT_ASKEW))
def test_a_shell_that_stands_askew_is_folded_as_one_that_does_not(name):
    """Its mirrors are no coordinate planes; whatever the frame, the answer is that on the whole mesh."""
    case, cells, images = SYMMETRIC_CASES[name]
    whole, part = both(askew(case), cells)
    assert (whole.images, part.images) == ((1, 1), images)
    agree(whole, part)


def test_components_that_would_be_oblique_among_the_mirrors_are_not_turned():
    """A rim that is held along one axis stays as it stands where the mirrors lie between this axis and another."""
    between = {"kind": "expression", "x": "0.8*xi1 - 0.6*xi2", "y": "0.6*xi1 + 0.8*xi2", "z": "0"}
    between |= {"xi1": [0, 2], "xi2": [0, 1]}
    loose = ["translation_y", "translation_z", "rotation_x", "rotation_y"]
    flat = shell(between, supports=[{"name": "rim", "on": EVERY_EDGE, "components": ["z"]}], loads=[DOWN],
                 remove_rigid_motions=["translation_x", "translation_y", "rotation_z"])  # fmt: skip
    assert in_frame_of_mirrors(flat) is not None
    held = shell(between, supports=[{"name": "rim", "on": EVERY_EDGE, "components": ["x"]}], remove_rigid_motions=loose)
    assert in_frame_of_mirrors(held) is None
    assert in_frame_of_mirrors(shell(supports=[PIN], loads=[DOWN])) is None  # its mirrors are coordinate planes already
    assert in_frame_of_mirrors(askew(shell("hypar", supports=[PIN], loads=[DOWN]), ASKEW)) is None  # it has none


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("variant", "copies"), [("flipped", 8), ("swapped", 8), ("stretched", 8), ("warped", 4), ("oblique", 2)]
)
def test_variants_whose_points_are_written_in_12_digits_are_folded_too(variant, copies):
    """Loads and mesh lines miss their mirror images by the last of them, and the part answers as the whole."""
    case = catalog.named_case(f"pinched_cylinder_diaphragm@{variant}")
    whole, part = both(case, (4, 4))
    assert part.parameters <= 1.1 * whole.parameters / copies
    for name, value in whole.history[-1].quantities.items():
        assert part.history[-1].quantities[name] == pytest.approx(value, rel=1e-8, abs=1e-8 * sum(whole.energies()))
    points = surface_points(case.surface, 60)
    gap = np.abs(whole.displacement(points) - part.displacement(points)).max()
    assert gap <= 1e-8 * np.abs(whole.displacement(points)).max()


@pytest.mark.parametrize("digit", [1e-9, 1e-10])
def test_a_force_that_misses_its_image_by_more_than_the_last_digit_is_no_symmetry(digit):
    case = shell(points={"a": [1 + digit, 0.5 - digit]}, supports=[PIN], loads=[point("a", 0, 0, 1)])
    assert both(case, (4, 4))[1].images == (1, 1)


BUMP = "1e-9*exp(-50*(xi1 - 0.3)**2)"


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(shell("hypar", supports=[PIN], loads=[DOWN]), id="a surface that turns into itself"),
        pytest.param(
            shell({"kind": "expression", "x": "xi1", "y": "xi2", "z": f"{BUMP}*(1 + xi2)", "xi1": [0, 2], "xi2": [0, 1]},
                  supports=[PIN], loads=[DOWN]),
            id="a surface that is almost symmetric",
        ),
        pytest.param(
            shell({"kind": "expression", "x": "xi1", "y": "xi2", "z": f"{BUMP}*(1 + xi2)", "xi1": [0, 2], "xi2": [0, 1]},
                  supports=[{**PIN, "clamped": True}], loads=[DOWN]),
            id="the same, clamped",
        ),
        pytest.param(
            shell(supports=[PIN], loads=[{"kind": "pressure", "value": f"(1 + {BUMP})*(1 + 1e-9*xi2)"}]),
            id="a load that is almost symmetric",
        ),
        pytest.param(
            shell(supports=[PIN], loads=[{"kind": "pressure", "value": "exp(-(xi1 - 0.4)**2*1e4 - (xi2 - 0.1)**2*1e4)"}]),
            id="a load on a small spot",
        ),
        pytest.param(shell(supports=[PIN], loads=[{"kind": "area", "vector": [1, 1, 0]}]), id="a load along the shell"),
        pytest.param(shell(supports=[PIN], loads=[{"kind": "pressure", "value": "sin(pi*xi1)*sin(2*pi*xi2)"}]), id="odd"),
        pytest.param(
            shell(supports=[wall("left", "xi1_min", clamped=True), wall("front", "xi2_min")], loads=[DOWN]),
            id="supports on two sides",
        ),
        pytest.param(
            shell(
                supports=[
                    wall("left", "xi1_min"), wall("right", "xi1_max", clamped=True), wall("front", "xi2_min"),
                    wall("back", "xi2_max", components=["x", "z"]),
                ],
                loads=[DOWN],
            ),
            id="supports of different kinds",
        ),
        pytest.param(
            shell(
                supports=[
                    wall("left", "xi1_min", motion=pull(0, "1e-9*t", 0)), wall("right", "xi1_max"),
                    {"name": "more", "on": ["xi2_min", "xi2_max"], "components": ["z"]},
                ],
                loads=[DOWN],
            ),
            id="a support that moves a little",
        ),
        pytest.param(
            shell(points={"a": [1 + 1e-9, 0.5 - 1e-9]}, supports=[PIN], loads=[point("a", 0, 0, 1)]),
            id="a force beside the middle",
        ),
        pytest.param(
            shell(points={"a": [1, 0.5]}, supports=[PIN], loads=[point("a", 1e-9, 1e-9, 1)]), id="a force that leans"
        ),
        pytest.param(
            shell(supports=[PIN], loads=[DOWN, edge("xi1_min", 1, 1, 0), edge("xi1_max", -1, 1 + 1e-9, 0)]), id="edge loads"
        ),
        pytest.param(
            shell(supports=[wall("left", "xi1_min", clamped=True)],
                  loads=[{"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": 1}]),
            id="a moment, which is not looked at",
        ),
    ],
)  # fmt: skip
def test_what_is_not_symmetric_is_solved_whole(case):
    assert FoldedMesh.from_case(case, graded_mesh(case, (4, 4), 2.0), 7) is None
    whole, part = both(case, (4, 4))
    assert part.images == (1, 1)
    assert np.abs(whole.coefficients - part.coefficients).max() <= 1e-9 * np.abs(whole.coefficients).max()


def test_a_mesh_that_is_not_symmetric_is_solved_whole():
    """A focus grades the mesh, though nothing acts there."""
    case = shell(supports=[PIN], loads=[DOWN], points={"a": [0.5, 0.2]}, focus=["a"])
    assert both(case, (4, 4))[1].images == (1, 1)


def test_a_sequence_of_meshes_ends_with_the_same():
    case = catalog.named_case("scordelis_lo")
    whole, part = (FemSolver().solve(case, FemSettings(symmetry=symmetry)) for symmetry in (False, True))
    assert whole.mesh.cells == part.mesh.cells
    agree(whole, part)
    # a part of it is rounding, which differs
    assert part.uncertainty["edge_deflection"] == pytest.approx(whole.uncertainty["edge_deflection"], rel=1e-2)
    assert part.diagnostics["converged"]


def test_what_a_file_brings_back_and_what_is_rounded(tmp_path):
    case, cells, images = SYMMETRIC_CASES["tube_that_is_pressed_across"]
    whole, part = both(case, cells)
    back = FemSolver().load(part.save(tmp_path / "part"))
    assert back.images == images
    assert back.energies() == pytest.approx(part.energies(), rel=1e-12)
    for short in ("float32", "float16"):
        one, other = (s.rounded(short)[0].energies() for s in (whole, part))
        assert one == pytest.approx(other, rel=1e-2)
        assert one != pytest.approx(whole.energies(), rel=1e-12)


def test_symmetric_means_to_rounding():
    """Where the coordinates are not exactly mirrored in floating point, the case is symmetric all the same."""
    third = {"kind": "plane", "xi1": [0.1, 0.7], "xi2": [-1 / 3, 0.9]}
    case = shell(third, supports=[PIN], loads=[{"kind": "pressure", "value": "exp(-(xi1 - 0.4)**2)"}])
    assert both(case, (5, 5))[1].images == (2, 2)
    assert 1e-15 < SYMMETRIC < 1e-9


@pytest.mark.parametrize("wrong", ["signs", "parity"])
def test_a_wrong_image_would_be_seen(monkeypatch, wrong):
    """The comparison above is not blind: an image with a wrong sign differs."""
    case, cells, _ = SYMMETRIC_CASES["clamped_roof_with_edge_loads"]
    whole, _ = both(case, cells)
    honest = FoldedMesh.from_case

    def spoilt(*args):
        folded = honest(*args)
        first, second = folded.images
        change = {"signs": -first[1].signs} if wrong == "signs" else {"parity": -first[1].parity}
        folded.__dict__["images"] = ((first[0], replace(first[1], **change)), second)
        return folded

    monkeypatch.setattr(FoldedMesh, "from_case", staticmethod(spoilt))
    spoiled = both(case, cells)[1]
    with pytest.raises(AssertionError):
        agree(whole, spoiled)
