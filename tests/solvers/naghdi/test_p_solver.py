"""`p-naghdi`: functions, supports, loads on edges, removed motions, files, and the uncertainty that it states."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.symmetry import symmetry
from shellbench.problems.shell.symmetry.symmetry import whole_of
from shellbench.solvers.naghdi import p_solution, supports
from shellbench.solvers.naghdi.equilibrium import Equilibrium
from shellbench.solvers.naghdi.grid import Grid, functions, graded_ends
from shellbench.solvers.naghdi.p_solution import GridSolution
from shellbench.solvers.naghdi.p_solver import GridSettings, PNaghdiSolver
from tests.solvers.naghdi.test_strains import dome

SOLVER, SMALL = PNaghdiSolver(), GridSettings(degree=3, last_degree=5, smallest=1.0, ratio=9.0)


def changed(name, **more):
    return Case.model_validate({**catalog.named_case(name).data(), **more})


def test_functions_have_their_slopes_and_meet_at_ends():
    s, step = np.linspace(-0.9, 0.9, 7), 1e-6
    slopes = functions(s, 8)[1]
    np.testing.assert_allclose((functions(s + step, 8)[0] - functions(s - step, 8)[0]) / (2 * step), slopes, atol=1e-8)
    ends = functions(np.array([-1.0, 1.0]), 8)[0]
    np.testing.assert_allclose(ends, np.eye(2, 9), atol=1e-14)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_grid_is_continuous_where_cells_meet(periodic):
    grid = Grid((np.array([0.0, 0.3, 1.0, 2.5]), np.array([0.0, 1.0])), 5, (periodic, False))
    q = np.random.default_rng(1).normal(size=grid.count(0))

    def value(x):
        cell, found = grid.at(0, np.array([x]))
        return (q[grid.numbers(0)[cell]] * found[0]).sum()

    for end in (0.3, 1.0):
        assert value(end - 1e-12) == pytest.approx(value(end), abs=1e-10)
    assert (value(2.5) == pytest.approx(value(0.0), abs=1e-10)) == periodic


def test_cells_are_graded_toward_edges_but_not_toward_planes_of_symmetry():
    part = p_solution.part_of(catalog.named_case("scordelis_lo_naghdi"))
    widths = np.diff(graded_ends(part, 1, 0.05, 3.0))
    assert widths[0] == pytest.approx(0.05 * 0.25, rel=1e-9)  # of the thickness
    assert widths[-1] == pytest.approx(widths.max(), rel=1e-9)


def test_rigid_motions_strain_nothing():
    """A translation, and a rotation of a plate, of which the normals turn with it."""
    case = catalog.named_case("thick_plate_naghdi")
    shell = Equilibrium.of(case, Grid((np.array([0.0, 3.0, 10.0]), np.array([0.0, 10.0])), 4, (False, False)))
    moved, turned = np.zeros_like(shell.forces), np.zeros_like(shell.forces)
    moved[:3, :2, :3] = [0.3, -1.0, 0.7]
    turned[:3, :2, 2] = np.array([0.0, 3.0, 10.0])[:, None]  # w = x, and the normal changes by -1 along x
    turned[:3, :2, 3] = -1.0
    size = np.abs(shell.strained(np.ones_like(moved))).max()
    assert np.abs(shell.strained(moved)).max() <= 1e-12 * size
    assert np.abs(shell.strained(turned)).max() <= 1e-12 * size


def test_a_strip_under_tension_stretches_as_in_closed_form():
    """u = n L / (E h) along the pull, and nu of it across."""
    case = changed(
        "thick_plate_naghdi",
        supports=[{"name": "left", "on": ["xi1_min"], "components": ["x"]},
                  {"name": "low", "on": ["xi2_min"], "components": ["y"]},
                  {"name": "flat", "on": ["xi1_min", "xi2_min"], "components": ["z"]}],
        loads=[{"kind": "edge", "on": ["xi1_max"], "vector": [5e4, 0, 0]}],
        quantities=[{"name": "energy", "kind": "strain_energy", "primary": True}],
    )  # fmt: skip
    found = SOLVER.answer(case, SMALL, None, lambda step: None)
    u = found.displacement(np.array([[10.0, 10.0], [4.0, 0.0]]))
    np.testing.assert_allclose(u, [[0.05, -0.015, 0.0], [0.02, 0.0, 0.0]], atol=1e-9)
    assert measure_all(found)["energy"] == pytest.approx(0.5 * 5e5 * 0.05, rel=1e-9)


def test_a_free_motion_is_removed_in_the_mean():
    case = changed("scordelis_lo_naghdi", loads=[{"kind": "area", "vector": ["xi1-1", -90, "xi2-25"]}])
    found = SOLVER.answer(case, SMALL, None, lambda step: None)
    points, weights = case.area_rule
    u = found.displacement(points)[:, 2]
    assert abs(weights @ u) <= 1e-8 * weights @ np.abs(u)


def test_a_part_and_the_whole_have_one_answer(monkeypatch):
    case = catalog.named_case("thick_plate_naghdi@naghdi_soft")
    xi, fine = np.array([[2.0, 7.0], [8.5, 4.0]]), GridSettings(degree=6, last_degree=8, smallest=0.5)

    def answers():
        found = SOLVER.answer(case, fine, None, lambda step: None)
        names = "membrane_strain", "bending_strain", "bending_energy_density"
        return found.displacement(xi), *(found.evaluate(name, xi) for name in names)

    part = answers()
    monkeypatch.setattr(symmetry, "part_of", whole_of)
    monkeypatch.setattr(p_solution, "part_of", whole_of)
    for one, other in zip(part, answers(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-15)


def test_a_soft_support_holds_the_displacement_alone():
    hard, soft = (supports.held_fields(catalog.named_case(f"scordelis_lo@naghdi{end}")) for end in ("", "_soft"))
    assert [len(edges) for edges in hard] == [2, 2, 0, 2, 0]
    assert [len(edges) for edges in soft] == [2, 2, 0, 0, 0]


@pytest.mark.parametrize("name", ["thick_plate_naghdi", "thick_plate_naghdi@naghdi_soft"])
def test_the_stated_uncertainty_covers_the_error(name):
    case = catalog.named_case(name)
    found = SOLVER.answer(case, SMALL, None, lambda step: None)
    for quantity, value in measure_all(found).items():
        known = catalog.known_values(name).judge(quantity, case.theory).value
        assert abs(value - known) <= found.uncertainty[quantity] <= 1e-2 * abs(known), quantity


def test_a_file_gives_the_same_answer(tmp_path):
    found = SOLVER.answer(catalog.named_case("thick_plate_naghdi"), SMALL, None, lambda step: None)
    again = GridSolution.load(found.save(tmp_path / "answer"))
    assert measure_all(again) == measure_all(found)
    assert again.uncertainty == found.uncertainty


@pytest.mark.parametrize(
    ("name", "why"),
    [("annular_plate@naghdi", ""), ("hypar_clamped_1e_2@naghdi", ""), ("square_plate", "theory"), ("raft@naghdi", "springs")],
)  # fmt: skip
def test_cases_are_taken_or_declined_with_the_reason(name, why):
    found = SOLVER.declines(catalog.named_case(name)) or ""
    assert (not found) == (not why)
    assert why in found


def test_moments_and_skew_supports_are_declined():
    moment = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": 1.0}
    assert "moments" in SOLVER.declines(changed("thick_plate_naghdi", loads=[moment]))
    assert "skew" in SOLVER.declines(dome(clamped=False))
