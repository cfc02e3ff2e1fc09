import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.solvers.cst.solver import CstSolver
from tests.alike import alike
from tests.problems.shell.stated_shells import RIM, plate
from tests.solvers.cst.shells import GRAVITY, cloth, cylinder

EDGE = {"name": "edge", "on": ["xi1_min"]}


@pytest.fixture(scope="module")
def roof():
    return CstSolver().solve(cylinder(), {"cells": (10, 5), "diagonal": "alternating"})


@pytest.fixture(scope="module")
def sheet():
    return CstSolver().solve(cloth(supports=[EDGE]), {"cells": (4, 3), "time_step": 0.01})


def test_a_vertex_has_its_own_displacement(roof):
    np.testing.assert_allclose(roof.displacement(roof.mesh.points), roof.vertices(), atol=1e-15)


def test_the_field_is_continuous_across_edges_and_the_seam(roof):
    rng = np.random.default_rng(0)
    corners = roof.mesh.corners
    for a, b in ((0, 1), (1, 2), (2, 0)):
        s = rng.random((len(corners), 1))
        on_edge = (1 - s) * corners[:, a] + s * corners[:, b]
        inward = corners.mean(axis=1) - on_edge
        scale = np.abs(roof.vertices()).max()
        inside = roof.displacement(on_edge + 1e-7 * inward)
        outside = roof.displacement(on_edge - 1e-7 * inward)
        fits = roof.mesh.domain.contains(on_edge - 1e-7 * inward, slack=0.0)
        assert np.abs(inside - outside)[fits].max() < 1e-5 * scale
    turn = roof.displacement([[0.0, 1.1], [2 * np.pi, 1.1]])
    np.testing.assert_allclose(turn[0], turn[1], atol=1e-15)


def test_points_keep_their_shape(roof):
    points = roof.mesh.domain.grid(3, 4)
    assert roof.displacement(points).shape == (3, 4, 3)
    assert roof.velocity(points).shape == (3, 4, 3)
    assert roof.evaluate("membrane_strain", points).shape == (3, 4, 3)
    assert roof.evaluate("bending_energy_density", points).shape == (3, 4)
    with pytest.raises(KeyError):
        roof.evaluate("colour", points)


def test_densities_add_up_to_the_energies(roof):
    middle = roof.mesh.corners.mean(axis=1)
    areas = roof.problem.elastic.membrane.areas
    parts = [areas @ roof.evaluate(f"{part}_energy_density", middle) for part in ("membrane", "bending")]
    np.testing.assert_allclose(parts, roof.energies(), rtol=1e-12)


def test_what_it_takes_to_keep(roof, sheet):
    assert roof.storage_bytes == 10 * 6 * 3 * 8
    assert sheet.storage_bytes == 5 * 4 * 3 * 8 * 11
    assert roof.parameters == 3 * 10 * 6 - 2 * 2 * 10 - 1


@pytest.mark.parametrize("name", ["roof", "sheet"])
def test_a_file_gives_back_the_solution(name, request, tmp_path):
    solution = request.getfixturevalue(name)
    path = solution.save(tmp_path / "answer.x")
    assert path.name == "answer.x.npz"
    again = CstSolver().load(path)
    points = solution.mesh.domain.grid(5, 7)
    np.testing.assert_array_equal(again.frames, solution.frames)
    alike(again.displacement(points), solution.displacement(points))
    alike(again.evaluate("bending_strain", points), solution.evaluate("bending_strain", points))
    assert again.history == solution.history
    assert again.case == solution.case
    assert again.diagnostics == solution.diagnostics
    assert again.parameters == solution.parameters


def test_a_bad_file_is_refused_in_one_sentence(roof, tmp_path):
    with pytest.raises(InputError, match="can't be read"):
        CstSolver().load(tmp_path / "none.npz")
    path = roof.save(tmp_path / "cut")
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(InputError, match="damaged"):
        CstSolver().load(path)
    np.savez(tmp_path / "other.npz", words=np.asarray("{}"))
    with pytest.raises(InputError, match="not a solution of cst-hinge"):
        CstSolver().load(tmp_path / "other.npz")


@pytest.mark.parametrize(("kind", "bits", "size"), [("float16", 11, 2), ("float32", 24, 4)])
def test_rounding_changes_answers_by_its_own_size(roof, kind, bits, size):
    short, taken = roof.rounded(kind)
    assert 10 * 6 * 3 * size <= taken <= 10 * 6 * 3 * size + 8
    exact, rough = roof.vertices(), short.vertices()
    assert 0 < np.abs(rough - exact).max() <= 2.0**-bits * np.abs(exact).max()


def test_no_rounding_changes_nothing(sheet):
    same, taken = sheet.rounded("float64")
    assert taken == sheet.storage_bytes
    np.testing.assert_array_equal(same.frames, sheet.frames)


def test_a_time_that_was_not_reached_is_refused(sheet, roof):
    with pytest.raises(InputError, match=r"solved from 0 to 0.1 s, not at 0.2 s"):
        sheet.displacement([0, 0], 0.2)
    with pytest.raises(InputError, match=r"solved at 1, not at 0\.5"):
        roof.displacement([0, 0], 0.5)


def test_an_unknown_support_is_refused(sheet):
    with pytest.raises(InputError, match="no support is called 'nail'; known are edge"):
        sheet.reaction("nail")


def test_the_hinge_of_a_swinging_sheet_carries_weight_and_what_accelerates_it(sheet):
    """Force = rate of momentum - weight, whatever the sheet does."""
    force, _ = sheet.reaction("edge", at=0.1)
    mass = sheet.problem.loading.mass[:, None]
    rate = np.sum(mass * (sheet._velocities_of_step(10) - sheet._velocities_of_step(9)), axis=0) / 0.01
    np.testing.assert_allclose(force, rate + np.array([0, 0, 0.144 * 9.8]), atol=1e-7)


def test_settings_and_supports_are_refused_where_they_do_not_fit():
    with pytest.raises(InputError, match="at least 4 cells"):
        CstSolver().solve(cylinder(), {"cells": (3, 3)})
    with pytest.raises(InputError, match="from 1 to 5000"):
        CstSolver().solve(plate(), {"cells": (0, 3)})
    with pytest.raises(InputError, match="an even number alternates"):
        CstSolver().solve(cylinder(), {"cells": (9, 4), "diagonal": "alternating"})
    nail = {"name": "nail", "on": ["centre"]}
    case = cloth(supports=[nail], points={"centre": [0.5, 0.5]})
    with pytest.raises(InputError, match="lies on no vertex of 3 x 3 cells"):
        CstSolver().solve(case, {"cells": (3, 3)})


def test_supports_that_contradict_each_other_are_refused():
    pull = {"name": "pull", "on": ["xi2_min"], "motion": {"kind": "translation", "vector": [0.1, 0, 0]}}
    with pytest.raises(InputError, match="two supports move a vertex on 'xi2_min' to different places"):
        CstSolver().solve(plate(supports=[EDGE, pull]), {"cells": (3, 3)})


CLAMP = {"name": "clamp", "on": ["xi1_min"], "clamped": True}
MOMENT = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": 1}
LARGE = {"theory": "kirchhoff-love-nonlinear", "loads": [{"kind": "area", "vector": [0, 0, "-t"]}]}
DISPLACED = {
    "name": "middle",
    "kind": "displacement",
    "points": ["centre"],
    "direction": [0, 0, -1],
    "primary": True,
    "at": 0.1,
}
CRITICAL = {"name": "critical", "kind": "critical_point", "primary": True}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"supports": [CLAMP | {"motion": {"kind": "value", "z": 0.1}}]}, "holds slopes"),
        ({"loads": [MOMENT]}, "moments on edges"),
        (LARGE | {"loads": [{"kind": "pressure", "value": "t", "follows": True}]}, "pressure follows"),
        (LARGE | {"quantities": [CRITICAL]}, "buckling or turning points"),
        (
            LARGE | {"quantities": [DISPLACED], "path": {"control": "displacement", "quantity": "middle", "until": 0.1}},
            "by displacement or arc length",
        ),
        (LARGE | {"supports": [], "remove_rigid_motions": [f"{k}_{c}" for k in ("translation", "rotation") for c in "xyz"], "loads": []}, "removes rotations"),
    ],
)  # fmt: skip
def test_what_it_can_not_do_is_declined_in_one_clause(changes, reason):
    case = plate(**changes)
    assert reason in CstSolver().declines(case)
    with pytest.raises(InputError, match=r"cst-hinge can't take plate: .*"):
        CstSolver().solve(case, {})


@pytest.mark.parametrize("case", [plate(), cylinder(), cloth(loads=[GRAVITY]), plate(supports=[RIM], **LARGE)])
def test_what_it_can_do_is_not_declined(case):
    assert CstSolver().declines(case) is None


def test_supports_that_meet_share_what_their_common_vertices_bear():
    """A square plate that two pairs of edges hold, by two supports: a mirror takes one pair into the other."""
    pairs = [{"name": name, "on": [f"{axis}_min", f"{axis}_max"]} for name, axis in (("a", "xi1"), ("b", "xi2"))]
    case = plate(supports=pairs, loads=[{"kind": "area", "vector": [0, 0, -1]}])
    solution = CstSolver().solve(case, {"cells": (8, 8)})
    first, second = (solution.reaction(name)[0][2] for name in "ab")
    area = np.prod(case.surface.domain.size)
    assert first + second == pytest.approx(area, rel=1e-9)
    assert first == pytest.approx(second, rel=1e-9)
