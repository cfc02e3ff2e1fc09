"""The solution as a continuous field, and as a file."""

import json

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.problem import FIELDS
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.alike import alike
from tests.solvers.fem.shells import EVERY_EDGE, EVERY_MOTION, TORUS, shell, surface_points

LOADS = [{"kind": "pressure", "value": "1 + xi1"}, {"kind": "area", "vector": [0.3, 0, 0.1]}]


@pytest.fixture(scope="module")
def solution():
    supports = [{"name": "wall", "on": ["xi1_min"], "clamped": True}, {"name": "rim", "on": ["xi2_max"]}]
    return FemSolver().solve(shell("hypar", supports=supports, loads=LOADS), FemSettings(max_unknowns=4000))


def test_the_field_and_its_first_derivatives_are_continuous(solution):
    line = solution.mesh.lines[0][3]
    gap = 1e-9
    sides = [np.array([[line + s * gap, 0.2], [line + s * gap, -0.7]]) for s in (-1, 1)]
    for order, bound in (((0, 0), 1e-7), ((1, 0), 1e-6), ((0, 1), 1e-6)):
        before, after = (solution.partial(p, order) for p in sides)
        assert np.abs(before - after).max() <= bound * np.abs(before).max()


def test_derivatives_against_differences(solution):
    points = surface_points(solution.case.surface, 10)
    step = 1e-6
    for axis, (first, second) in enumerate((((1, 0), (2, 0)), ((0, 1), (0, 2)))):
        shift = step * np.eye(2)[axis]
        for lower, higher in (((0, 0), first), (first, second)):
            slope = (solution.partial(points + shift, lower) - solution.partial(points - shift, lower)) / (2 * step)
            exact = solution.partial(points, higher)
            assert np.allclose(slope, exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("degree", [3, 4, 5])
@pytest.mark.parametrize("closed", [False, True])
def test_a_grid_is_answered_as_its_points_one_by_one(closed, degree):
    """A field on a grid is made axis by axis, beyond the seams too, whatever points are asked for beside it."""
    rim = {"supports": [{"name": "rim", "on": EVERY_EDGE}], "loads": LOADS}
    case = shell(TORUS, remove_rigid_motions=EVERY_MOTION) if closed else shell("hypar", **rim)
    domain, mesh = case.surface.domain, graded_mesh(case, (4, 4), 2.0, degree=degree)
    coefficients = np.random.default_rng(1).standard_normal((mesh.node_count, 3, len(mesh.kinds), 1))
    forces = np.zeros((len(case.supports), 0, 3, len(mesh.kinds), 1))
    nodes = np.zeros(0, dtype=np.int64)
    field = FemSolution(case, mesh, coefficients, (1.0,), nodes, forces, 2 * degree + 1, 1)
    grid = domain.grid(40, 31).reshape(-1, 2) + np.where(domain.periodic, 0.7, 0.0) * domain.size
    points = np.concatenate([surface_points(case.surface, 5), grid])
    for order in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1)):
        together = field.partial(points, order)
        few = np.concatenate([field.partial(part, order) for part in np.array_split(points, 7)])
        assert np.abs(together - few).max() <= 1e-12 * np.abs(few).max()


def test_energy_densities_add_up_to_the_energies(solution):
    n = 96
    x, w = np.polynomial.legendre.leggauss(n)
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    area = np.sqrt(points[..., 1] ** 2 + (0.3 * points[..., 1] - points[..., 0]) ** 2 + 2.25) / 1.5
    for name, whole in zip(("membrane", "bending"), solution.energies(), strict=True):
        total = np.einsum("i,j,ij,ij->", w, w, area, solution.evaluate(f"{name}_energy_density", points))
        assert total == pytest.approx(whole, rel=1e-3)


def test_work_of_the_loads_is_twice_the_energy(solution):
    # not to rounding: the curved clamped edge is held weakly between its nodes
    assert solution.history[-1].energy == pytest.approx(-sum(solution.energies()), rel=1e-5)


def test_shapes_and_names(solution):
    points = solution.case.surface.domain.grid(3, 4)
    assert solution.displacement(points).shape == (3, 4, 3)
    assert solution.displacement([0.1, 0.2]).shape == (3,)
    assert solution.evaluate("bending_strain", points).shape == (3, 4, 3)
    assert solution.evaluate("membrane_energy_density", points).shape == (3, 4)
    with pytest.raises(KeyError):
        solution.evaluate("stress", points)
    with pytest.raises(InputError, match="no support is called"):
        solution.reaction("nobody")


def test_no_points_are_answered_by_no_rows(solution):
    nowhere = np.zeros((0, 2))
    assert solution.displacement(nowhere).shape == (0, 3)
    assert solution.evaluate("bending_strain", nowhere).shape == (0, 3)
    assert solution.evaluate("bending_energy_density", nowhere).shape == (0,)


def test_a_saved_solution_comes_back_whole(solution, tmp_path):
    path = solution.save(tmp_path / "run.1")
    assert path.name == "run.1.npz"
    back = FemSolver().load(path)
    points = surface_points(solution.case.surface, 20)
    for name in ("coefficients", "support_forces"):
        assert np.array_equal(getattr(back, name), getattr(solution, name))
    alike(back.displacement(points), solution.displacement(points))
    for name in FIELDS:
        alike(back.evaluate(name, points), solution.evaluate(name, points))
    for support in ("wall", "rim"):
        alike(back.reaction(support), solution.reaction(support))
    for name in ("history", "diagnostics", "uncertainty", "extrapolated", "parameters", "storage_bytes", "states"):
        assert getattr(back, name) == getattr(solution, name)
    assert back.case.digest() == solution.case.digest()
    json.dumps(dict(solution.diagnostics), allow_nan=False)


def test_symmetry_planes_survive_the_file(tmp_path):
    supports = [{"name": "mirror", "on": ["xi1_min"], "symmetry": "x"}, {"name": "rim", "on": ["xi1_max"]}]
    solution = FemSolver().solve(shell(supports=supports, loads=LOADS), FemSettings(cells=(2, 2)))
    assert FemSolution.load(solution.save(tmp_path / "s")).case == solution.case


@pytest.mark.parametrize("damage", ["missing", "empty", "text", "cut", "flipped", "pickle", "other"])
def test_a_damaged_file_is_said_in_one_sentence(solution, tmp_path, damage):
    path = solution.save(tmp_path / "s")
    data = path.read_bytes()
    match damage:
        case "missing":
            path.unlink()
        case "empty":
            path.write_bytes(b"")
        case "text":
            path.write_text("no solution")
        case "cut":
            path.write_bytes(data[: len(data) // 2])
        case "flipped":
            path.write_bytes(data[:2000] + bytes(255 - b for b in data[2000:2400]) + data[2400:])
        case "pickle":
            np.savez(path, words=np.array([{"a": 1}], dtype=object), allow_pickle=True)
        case "other":
            np.savez(path, words=np.array("{}"), lines1=np.zeros(3))
    with pytest.raises(InputError, match=r"s\.npz: ") as failure:
        FemSolver().load(path)
    assert "\n" not in str(failure.value)


def test_reactions_balance_the_loads(solution):
    force = sum(solution.reaction(name)[0] for name in ("wall", "rim"))
    x, w = np.polynomial.legendre.leggauss(40)
    p = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    r, s = p[..., 0], p[..., 1]
    product = np.stack([-s, 0.3 * s - r, 1.5 + 0 * r], axis=-1) / 1.5
    area = np.linalg.norm(product, axis=-1, keepdims=True)
    density = (1 + r)[..., None] * product + np.array([0.3, 0, 0.1]) * area
    weights = w[:, None, None] * w[:, None]
    assert np.allclose(force, -(weights * density).sum(axis=(0, 1)), atol=1e-8)
    for centre in ((0.0, 0, 0), (1.0, -2, 0.5)):
        position = solution.case.surface.position(p) - np.array(centre)
        moment = sum(solution.reaction(name, centre)[1] for name in ("wall", "rim"))
        expected = -(weights * np.cross(position, density)).sum(axis=(0, 1))
        assert np.allclose(moment, expected, atol=1e-8)


def test_reactions_of_several_supports_meet_at_corners():
    supports = [{"name": name, "on": [name]} for name in EVERY_EDGE]
    solution = FemSolver().solve(
        shell(supports=supports, loads=[{"kind": "area", "vector": [0, 0, -3]}]), FemSettings(cells=(4, 4))
    )
    forces = {name: solution.reaction(name)[0] for name in EVERY_EDGE}
    assert np.allclose(sum(forces.values()), [0, 0, 6])
    assert np.allclose(forces["xi1_min"], forces["xi1_max"])
    assert np.allclose(forces["xi2_min"], forces["xi2_max"])
