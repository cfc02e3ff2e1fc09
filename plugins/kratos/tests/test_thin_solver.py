import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.thin_solver import KratosThinSettings, KratosThinSolver
from shellbench_kratos.thin_solving import usual_cells
from thin_shells import STEEL, cantilever, cylinder, plate

from derivations.navier_plate import SquarePlate, navier
from shellbench.bench.plugins import registry
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of

SOLVER = KratosThinSolver()
NAVIER = navier(SquarePlate(side=10.0, thickness=0.1, young=1e5, poisson=0.0, pressure=1e-4), 200)


def solve(case, cells, **settings):
    return SOLVER.solve(case, {"cells": cells, **settings})


def test_it_is_found_like_any_solver():
    assert isinstance(registry.load_solver(registry.find_solver("kratos-thin")), KratosThinSolver)


def test_the_linear_answer_doubles_with_the_load():
    """It is the linear solution, whatever the size of displacements: here they are larger than the shell."""
    loads = [[{"kind": "area", "vector": [1e2, 3e2, -f * 1e3]}, {"kind": "area", "vector": [0, 0, 0]}] for f in (1, 2)]
    loads[1][0]["vector"] = [2e2, 6e2, -2e3]
    once, twice = (solve(plate(loads=load), (6, 5), symmetry=False) for load in loads)
    assert np.abs(once.frames).max() > 10
    np.testing.assert_allclose(twice.frames, 2 * once.frames, atol=1e-10 * np.abs(twice.frames).max())


def test_a_strip_bends_like_a_beam():
    """w = P L^3 / (3 B b): the discrete Kirchhoff element bends with cubic deflections, and nu is 0."""
    tip = solve(cantilever(), (4, 1)).displacement([10, 0.5])
    np.testing.assert_allclose(tip, [0, 0, 1e-3 * 1e3 / (3 * 100)], rtol=1e-9, atol=1e-12)


def test_a_strip_that_is_bent_in_its_plane_converges_to_a_deep_beam():
    """Timoshenko's cantilever, P L^3 / 3 E I + 6 P L / 5 G A. The membrane does not lock, it is too soft if coarse."""
    load = [{"kind": "edge", "on": ["xi1_max"], "vector": [0, 1.0, 0]}]
    area, inertia, young = 0.1, 0.1 / 12, STEEL["youngs_modulus"]
    expected = 1e3 / (3 * young * inertia) + 6 * 10 / (5 * young / 2 * area)
    found = [solve(cantilever(loads=load), (20 * n, 2 * n)).displacement([10, 0.5])[1] for n in (1, 2, 4)]
    errors = np.array(found) / expected - 1
    assert abs(errors[-1]) < 0.02
    assert -np.polyfit(np.log([1, 2, 4]), np.log(np.abs(errors)), 1)[0] == pytest.approx(2, abs=0.2)


def test_a_strip_rolls_up_under_a_moment():
    """A moment M at the end bends it into an arc of radius B / M per width, half a circle here."""
    moment = 100 * np.pi / 10
    case = cantilever(
        theory="kirchhoff-love-nonlinear",
        loads=[{"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": f"{moment}*t"}],
        path={"states": [0.5]},
    )
    solution = solve(case, (20, 1))
    for at in (0.5, 1.0):
        radius, angle = 10 / (np.pi * at), np.pi * at
        expected = [radius * np.sin(angle) - 10, 0, radius * (1 - np.cos(angle))]
        np.testing.assert_allclose(solution.displacement([10, 0.5], at), expected, atol=0.02)
    membrane, bending = solution.energies()
    assert bending == pytest.approx(moment * np.pi / 2, rel=1e-3)  # half of moment times angle
    assert membrane < 1e-9 * bending


def test_the_plate_converges_to_navier_with_rate_two():
    cells = np.array([8, 16, 32])
    found = [solve(plate(), (n, n)) for n in cells]
    for errors in (
        [abs(s.displacement([5, 5])[2] + NAVIER[0]) for s in found],
        [abs(sum(s.energies()) - NAVIER[1]) for s in found],
    ):
        rate = -np.polyfit(np.log(cells), np.log(errors), 1)[0]
        assert rate == pytest.approx(2, abs=0.15)
    assert found[-1].displacement([5, 5])[2] == pytest.approx(-NAVIER[0], rel=5e-5)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_the_symmetric_part_answers_as_the_whole_does(nonlinear):
    changes = {"loads": [{"kind": "area", "vector": [0, 0, "-0.01*t" if nonlinear else -0.01]}]}
    if nonlinear:
        changes["theory"] = "kirchhoff-love-nonlinear"
    case = plate(**changes)
    part, whole = solve(case, (4, 4)), solve(case, (8, 8), symmetry=False)
    assert part.diagnostics["copies"] == 4
    assert whole.diagnostics["copies"] == 1
    _agree(part, whole, case, "rim")


def test_the_symmetric_part_of_a_closed_shell_answers_as_the_whole_does():
    case = cylinder()
    part, whole = solve(case, (6, 4)), solve(case, (24, 8), symmetry=False)
    assert part.diagnostics["copies"] == 8
    _agree(part, whole, case, "ends")


def test_supports_that_a_mirror_swaps_have_each_its_own_reaction():
    """Two edges of a plate that are pulled apart, each by a support of its own; the part has one of them."""
    pull = {"kind": "translation", "vector": [1e-3, 0, 0]}
    supports = [{"name": "left", "on": ["xi1_min"]}, {"name": "right", "on": ["xi1_max"], "motion": pull}]
    supports[0]["motion"] = pull | {"vector": [-1e-3, 0, 0]}
    case = plate(supports=supports, loads=[{"kind": "area", "vector": [0, 0, -1e-4]}])
    part, whole = solve(case, (4, 4)), solve(case, (8, 8), symmetry=False)
    assert part.part.copies == 4
    for support in ("left", "right"):
        _agree(part, whole, case, support)
    np.testing.assert_allclose(part.reaction("left")[0] + part.reaction("right")[0], [0, 0, 1e-2], atol=1e-9)
    assert part.reaction("right")[0][0] > 1


def _agree(part, whole, case, support):
    domain = case.surface.domain
    points = np.asarray(domain.lower) + np.random.default_rng(2).random((40, 2)) * domain.size
    scale = np.abs(whole.frames[:, :3]).max()
    np.testing.assert_allclose(part.displacement(points), whole.displacement(points), atol=1e-8 * scale)
    np.testing.assert_allclose(part.energies(), whole.energies(), atol=1e-7 * sum(whole.energies()))
    for name in ("membrane_strain", "bending_strain"):
        one, other = part.evaluate(name, points), whole.evaluate(name, points)
        np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(other).max() + 1e-15)
    for one, other in zip(part.reaction(support, (1, 2, 3)), whole.reaction(support, (1, 2, 3)), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7 * np.abs(other).max() + 1e-9)


def test_a_declared_plane_of_symmetry_is_one():
    """A quarter of the plate, its planes of symmetry among its supports."""
    quarter = plate(
        surface={"kind": "plane", "xi1": [0, 5], "xi2": [0, 5]},
        supports=[
            {"name": "rim", "on": ["xi1_min", "xi2_min"]},
            {"name": "first", "on": ["xi1_max"], "symmetry": "x"},
            {"name": "second", "on": ["xi2_max"], "symmetry": "y"},
        ],
    )
    found, expected = solve(quarter, (6, 6)), solve(plate(), (6, 6))
    np.testing.assert_allclose(found.frames, expected.frames, atol=1e-12 * np.abs(expected.frames).max())
    assert sum(found.energies()) == pytest.approx(sum(expected.energies()) / 4, rel=1e-9)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_a_support_that_moves_takes_the_shell_with_it(nonlinear):
    """A strip that is pulled by 0.01 m: F = E A u / L; 1e-3 of it is the element's, at the strip's corners."""
    size = "0.01*t" if nonlinear else 0.01
    case = cantilever(
        theory=f"kirchhoff-love-{'nonlinear' if nonlinear else 'linear'}",
        loads=[],
        supports=[
            {"name": "wall", "on": ["xi1_min"], "clamped": True},
            {"name": "grip", "on": ["xi1_max"], "motion": {"kind": "translation", "vector": [size, 0, 0]}},
        ],
    )
    solution = solve(case, (20, 2))
    np.testing.assert_allclose(solution.displacement([[10, 0.3], [5, 0.5]])[:, 0], [0.01, 0.005], rtol=1e-3)
    np.testing.assert_allclose(solution.reaction("grip")[0], [1.2e6 * 0.1 * 1e-3, 0, 0], rtol=2e-3, atol=1e-6)
    assert solution.history[-1].energy == pytest.approx(1.2e6 * 0.1 * 1e-6 * 10 / 2, rel=2e-3)
    np.testing.assert_allclose(solution.reaction("wall")[0], -solution.reaction("grip")[0], rtol=1e-6, atol=1e-6)


def test_what_nothing_holds_is_taken_away_in_the_mean():
    case = cylinder(
        supports=[],
        loads=[{"kind": "pressure", "value": "cos(2*xi1)*(1 + xi2)"}],
        remove_rigid_motions=[f"{kind}_{axis}" for kind in ("translation", "rotation") for axis in "xyz"],
    )
    solution = solve(case, (24, 6), symmetry=False)
    problem = solution.problem
    arms, moved, areas = problem.positions, solution.frames[:, :3, 0], problem.loads.areas[:, None]
    arms = arms - np.sum(areas * arms, axis=0) / areas.sum()
    size = np.abs(moved).max() * areas.sum()
    assert np.abs(np.sum(areas * moved, axis=0)).max() < 1e-8 * size
    assert np.abs(np.sum(areas * np.cross(arms, moved), axis=0)).max() < 1e-8 * size
    folded = solve(case, (6, 6))
    np.testing.assert_allclose(folded.displacement([0.7, 1.3]), solution.displacement([0.7, 1.3]), rtol=1e-6)


def test_loads_out_of_balance_are_said_to_be():
    case = cylinder(loads=[{"kind": "area", "vector": [0, 1, 0]}])
    with pytest.raises(SolveFailure, match="not in balance"):
        solve(case, (12, 4))


def test_a_path_says_that_stability_was_not_looked_at():
    """A limit point may have been jumped over; in the linear theory there is none."""
    load = [{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "t"]}]
    bent = solve(cantilever(theory="kirchhoff-love-nonlinear", loads=load), (4, 1))
    assert bent.diagnostics["stability_checked"] is False
    assert "stability_checked" not in solve(cantilever(), (4, 1)).diagnostics


def test_a_path_that_is_too_much_for_newton_keeps_what_it_reached():
    case = cantilever(
        theory="kirchhoff-love-nonlinear",
        loads=[{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "t + 1e12*t**60"]}],
        path={"states": [0.1]},
    )
    with pytest.raises(SolveFailure, match="beyond load factor") as failure:
        solve(case, (4, 1))
    assert failure.value.partial.marks.tolist() == [0.1]


@pytest.mark.parametrize(
    ("case", "because"),
    [
        (plate(material=STEEL | {"bending_factor": 2.0}), "homogeneous"),
        (
            cylinder(
                supports=[{"name": "ends", "on": ["xi2_min", "xi2_max"], "clamped": True}], remove_rigid_motions=[]
            ),
            "'xi2_min' is clamped",
        ),
        (
            cantilever(theory="kirchhoff-love-nonlinear", loads=[{"kind": "pressure", "value": "t", "follows": True}]),
            "pressure follows",
        ),
        (cantilever(loads=[{"kind": "moment", "on": ["xi1_max"], "axis": [1, 0, 0], "value": 1}]), "along its edge"),
        (
            cantilever(
                theory="kirchhoff-love-nonlinear",
                loads=[],
                supports=[
                    {
                        "name": "wall",
                        "on": ["xi1_min"],
                        "clamped": True,
                        "motion": {"kind": "rotation", "axis": [0, 1, 0], "angle": "t"},
                    }
                ],
            ),
            "'xi1_min' turns",
        ),
    ],
)
def test_what_it_can_not_do_is_declined_in_a_clause(case, because):
    reason = SOLVER.declines(case)
    assert because in reason
    assert not reason.endswith(".")
    with pytest.raises(InputError, match=because):
        SOLVER.solve(case, {})


def test_paths_by_displacement_are_declined():
    case = cantilever(
        theory="kirchhoff-love-nonlinear",
        loads=[{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "t"]}],
        path={"control": "displacement", "quantity": "lift", "until": 1.0},
        quantities=[
            {"name": "lift", "kind": "displacement", "points": ["tip"], "direction": [0, 0, 1], "primary": True},
        ],
    )
    assert "prescribes the load only" in SOLVER.declines(case)


@pytest.mark.parametrize(
    "bad", [{"cells": [0, 4]}, {"cells": [4, 1000]}, {"steps": 0}, {"engine": "Kratos 1"}, {"mesh": 3}]
)
def test_settings_that_make_no_sense_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        SOLVER.solve(plate(), bad)


def test_a_load_between_nodes_asks_for_other_cells():
    case = plate(loads=[{"kind": "point", "on": ["centre"], "force": [0, 0, -1]}])
    with pytest.raises(InputError, match=r"'centre' lies on no node of 5 x 4 cells"):
        solve(case, (5, 4), symmetry=False)


def test_refinements_are_settings_from_coarse_to_fine():
    cells = [np.prod(KratosThinSettings.model_validate(s).cells) for s in KratosThinSolver.refinements]
    assert len(cells) >= 3
    assert np.all(np.diff(cells) > 0)


def test_usual_cells_are_about_square_and_those_of_the_whole_shell():
    narrow = cantilever(theory="kirchhoff-love-nonlinear", loads=[])
    assert usual_cells(part_of(plate())) == (64, 64)
    assert usual_cells(whole_of(plate())) == (128, 128)
    longer = {"kind": "cylinder", "radius": 2, "closed": True, "xi1": [0, 360], "xi2": [0, 6]}
    assert usual_cells(part_of(cylinder(surface=longer))) == (64, 64)
    for part in (whole_of(narrow), part_of(narrow)):
        n1, n2 = usual_cells(part)
        along, across = 10 / n1, (part.upper[1] - part.lower[1]) / n2
        assert n1 * n2 == 32 * 32
        assert 1 / 2 <= along / across <= 2
