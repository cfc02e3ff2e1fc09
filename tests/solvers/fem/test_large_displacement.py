"""The non-linear theory end to end: closed forms, the linear limit, balance on the deformed shell, what is kept."""

import re

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.alike import alike
from tests.solvers.fem.shells import LARGEST, MATERIAL, SURFACES, shell

NONLINEAR = "kirchhoff-love-nonlinear"
DEFLECTION = {"name": "w", "kind": "displacement", "primary": True, "points": ["tip"], "direction": [0, 0, 1]}
WALL = {"name": "wall", "on": ["xi1_min"], "clamped": True}


def data_of(name):
    return catalog.named_case(name).model_dump(mode="json", exclude_unset=True, exclude={"name"})


def solve(case, **settings):
    return FemSolver().solve(case, FemSettings(**settings))


def on_mesh(case, cells, steps=(1 / 8, 1e-4), trail=None):
    return large_displacement.solve(case, graded_mesh(case, cells, 2.0), 7, steps, trail)


def path_of(solution):
    return [step for step in solution.history if step.phase == "path"]


# closed forms


@pytest.mark.long
def test_a_shell_that_is_turned_as_prescribed_is_not_strained():
    case = catalog.named_case("rigid_rotation")
    solution = solve(case)
    material = case.material
    scale = material.bending_stiffness / 2 * solution.area / case.surface.radius**2  # of a change of curvature of 1 / R
    assert solution.states == (0.25, 0.5, 0.75, 1.0)
    for t in solution.states:
        assert sum(solution.energies(t)) < 1e-9
        assert sum(solution.energies(t)) < 1e-8 * scale
    fine = solve(case, cells=(64, 16))
    assert sum(fine.energies(1.0)) < 1e-9 * scale
    # what is left is the interpolation error of a circle, whose membrane energy falls with the sixth power
    coarse = [sum(solve(case, cells=(n, n)).energies(1.0)) for n in (8, 16)]
    assert np.log2(coarse[0] / coarse[1]) > 5.5
    points = case.surface.domain.grid(5, 5).reshape(-1, 2)
    x = case.surface.position(points)
    moved = x + solution.displacement(points, at=0.25)
    distances = [np.linalg.norm(p[:, None] - p[None], axis=-1) for p in (x, moved)]
    assert np.allclose(*distances, rtol=0, atol=1e-6)
    axis = np.array([1, 2, 3]) / np.sqrt(14)
    assert np.allclose((moved - x) @ axis, 0, atol=1e-9)


def test_a_rolled_plate_stores_the_bending_energy_of_its_curvature():
    case = catalog.named_case("rolled_plate")
    solution = solve(case, cells=(32, 4))
    stiffness = case.material.youngs_modulus * case.material.thickness**3 / 12
    for t in solution.states:
        expected = stiffness / 2 * (np.pi * t) ** 2 * 0.5  # of the area 1 x 0.5, nu = 0
        membrane, bending = solution.energies(t)
        assert bending == pytest.approx(expected, rel=1e-7)
        assert membrane < 1e-7 * bending
    points = case.surface.domain.grid(9, 3).reshape(-1, 2)
    moved = case.surface.position(points) + solution.displacement(points, at=0.5)
    assert np.allclose(np.hypot(moved[:, 0], moved[:, 2] - 2 / np.pi), 2 / np.pi, rtol=0, atol=1e-8)
    strain = solution.evaluate("bending_strain", points, at=0.5)
    assert np.allclose(np.abs(strain[:, 0]), np.pi / 2, rtol=1e-4)
    assert np.abs(strain[:, 1:]).max() < 1e-9


def test_half_of_the_strip_with_a_plane_of_symmetry_is_stable_to_the_full_circle():
    case = catalog.named_case("cantilever_moment")
    found, _ = on_mesh(case, (8, 1))
    solution = found.solution
    tip = case.places["tip"].xi
    for t in (0.25, 0.5, 0.75, 1.0):  # an arc of 2 pi t of a circle of radius L / 2 pi t
        angle = 2 * np.pi * t
        expected = [12 * np.sin(angle) / angle - 12, 0, 12 * (1 - np.cos(angle)) / angle]
        assert np.allclose(solution.displacement(tip, at=t), expected, rtol=0, atol=0.02)
    assert sum(solution.energies(1.0)) == pytest.approx(
        1.2e6 * 0.1**3 / 12 / 2 * (2 * np.pi / 12) ** 2 * 12 * 0.5, rel=1e-3
    )


@pytest.mark.parametrize("name", ["square_plate_nonlinear", "scordelis_lo_nonlinear", "cantilever_shear", "cantilever_moment", "slit_annular_plate"])  # fmt: skip
def test_at_small_loads_it_is_the_linear_theory(name):
    data, small = data_of(name), 1e-6
    quantities = [q | {"at": small} for q in data["quantities"]]
    nonlinear = build_case(data | {"path": {"until": small}, "quantities": quantities}, "small", "test")
    quantities = [q | {"at": 1.0} for q in data["quantities"]]
    linear = build_case(data | {"theory": "kirchhoff-love-linear", "path": {}, "quantities": quantities}, "linear", "t")
    found, expected = (solve(case, cells=(4, 3), degree=3, grading=1) for case in (nonlinear, linear))
    points = linear.surface.domain.grid(7, 7).reshape(-1, 2)
    u, v = found.displacement(points) / small, expected.displacement(points)
    assert np.allclose(u, v, rtol=0, atol=1e-5 * np.abs(v).max())
    assert sum(found.energies()) / small**2 == pytest.approx(sum(expected.energies()), rel=1e-5)
    assert path_of(found)[-1].energy / small**2 == pytest.approx(expected.history[-1].energy, rel=1e-5)
    reactions, true = (np.array([s.reaction(name.name) for name in linear.supports]) for s in (found, expected))
    assert np.allclose(reactions / small, true, rtol=0, atol=1e-4 * np.abs(true).max())


# balance


def test_reactions_balance_a_dead_load_on_the_deformed_strip():
    case = catalog.named_case("cantilever_shear")
    solution = on_mesh(case, (8, 1))[0].solution
    for t in (0.25, 1.0):
        force, moment = solution.reaction("wall", at=t)
        assert np.allclose(force, [0, 0, -4 * t], rtol=0, atol=1e-6)
        x, w = np.polynomial.legendre.leggauss(5)
        edge = np.stack([np.full(5, 10.0), (x + 1) / 2], axis=-1)
        arms = case.surface.position(edge) + solution.displacement(edge, at=t)
        expected = -np.sum(w[:, None] / 2 * np.cross(arms, [0, 0, 4 * t]), axis=0)
        assert np.allclose(moment, expected, rtol=0, atol=1e-5)
        assert abs(moment[1]) < 0.95 * 4 * t * 10  # the tip has moved toward the wall


def test_the_wall_carries_the_moment_of_a_rolled_strip_at_any_angle():
    case = catalog.named_case("cantilever_moment")
    solution = on_mesh(case, (8, 1))[0].solution
    for t in solution.states:
        force, moment = solution.reaction("wall", at=t)
        assert np.allclose(force[[0, 2]], 0, atol=1e-5)
        assert moment[1] == pytest.approx(50 * np.pi / 3 * t * 0.5, rel=1e-6)  # against -y, on half of the width


def test_the_area_below_the_load_displacement_curve_is_the_strain_energy():
    """The point load is the only one to work: through both limit points, up and down."""
    case = catalog.named_case("hinged_roof_thick")
    solution = solve(case, cells=(4, 4))
    path = path_of(solution)
    deflection = np.array([0, *(step.quantities["deflection"] for step in path)])
    load = 250 * np.array([0, *(step.at for step in path)])
    for mark in (10.0, 20.0, 30.0):
        area = float(CubicSpline(deflection, load).integrate(0, mark))
        assert sum(solution.energies(mark)) == pytest.approx(area, rel=1e-4)
    final = path[-1]
    assert final.energy == pytest.approx(sum(solution.energies()) - 250 * final.at * 30.0, rel=1e-9)


def test_space_has_no_preferred_direction():
    """The strip and its load turned in space, x -> R x: the same shell, displaced by R u."""
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [0.6 * s, 0.6 * c, -0.8], [0.8 * s, 0.8 * c, 0.6]])
    assert np.allclose(turn @ turn.T, np.eye(3))
    flat = {"kind": "expression", "x": "xi1", "y": "xi2", "z": "0", "xi1": [0, 10], "xi2": [0, 1]}
    rows = {name: f"{float(r[0])!r}*xi1 + {float(r[1])!r}*xi2" for name, r in zip("xyz", turn, strict=True)}
    answers = []
    for surface, frame in ((flat, np.eye(3)), (flat | rows, turn)):
        load = frame @ [0, 0.3, 4]
        vector = [f"{float(v)!r}*t" for v in load]
        material = {"youngs_modulus": 1.2e6, "poissons_ratio": 0.3, "thickness": 0.1}
        case = shell(
            surface, theory=NONLINEAR, supports=[WALL], points={"tip": [10, 0.5]}, quantities=[DEFLECTION], material=material,
            loads=[{"kind": "edge", "on": ["xi1_max"], "vector": vector}],
        )  # fmt: skip
        solution = on_mesh(case, (4, 1))[0].solution
        points = case.surface.domain.grid(6, 3).reshape(-1, 2)
        answers.append((solution.displacement(points), solution.energies(), frame))
    (first, energies, _), (second, others, frame) = answers
    assert np.abs(first).max() > 5
    assert np.allclose(second, first @ frame.T, rtol=0, atol=1e-6)
    assert np.allclose(others, energies, rtol=1e-6)


# what is kept


def test_the_path_stands_in_the_history_and_the_marks_in_the_states():
    case = catalog.named_case("hinged_roof_thick")
    solution = solve(case, cells=(4, 4))
    path = path_of(solution)
    assert solution.states == pytest.approx((10, 20, 30), rel=1e-11)
    assert [step.iteration for step in solution.history] == list(range(len(solution.history)))
    assert all(step.iterations >= 1 for step in path)
    assert np.all(np.diff([step.seconds for step in path]) >= 0)
    point = case.places["centre"].xi
    for mark in (10, 20, 30):
        assert solution.displacement(point, at=mark)[2] == pytest.approx(-mark, rel=1e-11)
        (step,) = [s for s in path if abs(s.quantities["deflection"] - mark) < 1e-9]
        edge = case.places["free_edge"].xi
        assert -solution.displacement(edge, at=mark)[2] == pytest.approx(step.quantities["free_edge_deflection"])
    # of the marks, one lies on the branch that rises at first, one in the valley, one on the branch that rises again
    loads = [next(s.at for s in path if abs(s.quantities["deflection"] - mark) < 1e-9) for mark in (10, 20, 30)]
    assert loads[1] < loads[0] < loads[2]
    (measured,) = [step.quantities for step in solution.history if step.phase == "solve"]
    assert measured["load_20"] == 1000 * loads[1]
    with pytest.raises(InputError, match="solved at 10, 20, 30, not at 15"):
        solution.displacement(point, at=15)


def test_a_saved_path_comes_back_whole(tmp_path):
    solution = solve(catalog.named_case("hinged_roof_thick"), cells=(3, 3))
    back = FemSolver().load(solution.save(tmp_path / "roof"))
    assert back.history == solution.history
    assert back.states == solution.states
    points = solution.case.surface.domain.grid(4, 4).reshape(-1, 2)
    assert np.array_equal(back.coefficients, solution.coefficients)
    for mark in solution.states:
        alike(back.displacement(points, at=mark), solution.displacement(points, at=mark))
        alike(back.energies(mark), solution.energies(mark))
        alike(back.reaction("hinge", at=mark), solution.reaction("hinge", at=mark))


def test_a_trail_leads_to_the_same_answer():
    """Under load control a finer mesh starts from the states of the coarser one, and ends where it would anyway."""
    case = catalog.named_case("cantilever_shear")
    _, trail = on_mesh(case, (4, 1))
    led, states = on_mesh(case, (6, 1), trail=trail)
    alone, _ = on_mesh(case, (6, 1))
    assert states.states == trail.states
    points = case.surface.domain.grid(6, 3).reshape(-1, 2)
    for t in case.states:
        expected = alone.solution.displacement(points, at=t)
        assert np.allclose(
            led.solution.displacement(points, at=t), expected, rtol=0, atol=1e-6 * np.abs(expected).max()
        )
    assert led.potential_energy == pytest.approx(alone.potential_energy, rel=1e-9)


def test_a_free_translation_is_taken_away_in_the_mean():
    """A tube that rests on two diaphragms can slide along its axis; its answer does not."""
    tube = SURFACES["cylinder"]
    rims = [{"name": "rims", "on": ["xi2_min", "xi2_max"], "components": ["x", "z"]}]
    case = shell(
        tube, theory=NONLINEAR, supports=rims, remove_rigid_motions=["translation_y"], material=MATERIAL,
        loads=[{"kind": "pressure", "value": "-0.5*t*(1 + 0.3*sin(xi1))*(1 + xi2/6)"}], quantities=[LARGEST | {"at": 1.0}],
    )  # fmt: skip
    solution = on_mesh(case, (8, 4))[0].solution
    x, w = np.polynomial.legendre.leggauss(4)
    points, weights = [], []
    for line in solution.mesh.lines:  # on every cell the field is a bicubic
        h = np.diff(line)[:, None]
        points.append((line[:-1, None] + h * (x + 1) / 2).ravel())
        weights.append((h * w / 2).ravel())
    along = solution.displacement(np.stack(np.meshgrid(*points, indexing="ij"), axis=-1))[..., 1]
    assert np.abs(along).max() > 1e-4
    mean, magnitude = (np.einsum("i,j,ij->", *weights, values) for values in (along, np.abs(along)))
    assert abs(mean) <= 1e-11 * magnitude


def test_what_is_prescribed_everywhere_is_not_solved_for_in_linear_theory_either():
    data = data_of("rolled_plate")
    bent = data["supports"][0] | {"motion": {"kind": "value", "z": "0.01*xi1**2"}}
    energy = [{"name": "energy", "kind": "bending_energy", "primary": True}]
    changes = {"theory": "kirchhoff-love-linear", "supports": [bent], "quantities": energy, "path": {}}
    case = build_case(data | changes, "bent", "test")
    stiffness = case.material.youngs_modulus * case.material.thickness**3 / 12
    assert solve(case, cells=(4, 2)).energies()[1] == pytest.approx(stiffness / 2 * 0.02**2 * 0.5, rel=1e-9)


def test_a_mould_carries_the_loads():
    """Internal forces are in balance whatever the displacement, so that the mould's resultant is the loads'."""
    case = build_case(data_of("rolled_plate") | {"loads": [{"kind": "area", "vector": [0, 0, "3*t"]}]}, "laden", "test")
    force, _ = solve(case, cells=(4, 2)).reaction("mould")
    assert np.allclose(force, [0, 0, -3 * 0.5], rtol=0, atol=1e-6)


def test_progress_tells_mesh_and_load_factor():
    told = []
    case = catalog.named_case("cantilever_shear")
    FemSolver().solve(case, FemSettings(cells=(3, 1)), progress=told.append)
    factors = [
        float(found[1]) for p in told if (found := re.fullmatch(r"\d+ x \d+ cells, load factor ([\d.]+)", p.message))
    ]
    assert factors == sorted(factors)
    assert factors[-1] == 1.0
    assert "error" in told[-1].message
