import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.iga_solution import integrals, strains
from shellbench_kratos.iga_solver import KratosIgaSolver

from shellbench.errors import InputError
from shellbench.problem import FIELDS
from tests.alike import alike
from tests.problems.shell.stated_shells import known, plate

SOLVER = KratosIgaSolver()


@pytest.fixture(scope="module")
def pinched():
    return SOLVER.solve(known("pinched_cylinder_free"), {"cells": (8, 6)})


@pytest.fixture(scope="module")
def sagging():
    case = plate(
        theory="kirchhoff-love-nonlinear",
        loads=[{"kind": "area", "vector": [0, 0, "-t"]}],
        path={"states": [0.5]},
    )
    return SOLVER.solve(case, {"cells": (3, 3), "load_steps": 2})


def test_points_keep_their_shape(pinched):
    points = pinched.case.surface.domain.grid(3, 4)
    assert pinched.displacement(points).shape == (3, 4, 3)
    assert pinched.velocity(points).shape == (3, 4, 3)
    assert pinched.displacement([1.0, 2.0]).shape == (3,)
    assert pinched.evaluate("membrane_strain", points).shape == (3, 4, 3)
    assert pinched.evaluate("bending_energy_density", points).shape == (3, 4)
    with pytest.raises(KeyError):
        pinched.evaluate("colour", points)


def test_the_field_is_symmetric_and_continuous_where_copies_meet(pinched):
    step = 1e-7
    for axis, at in ((0, 0.0), (0, np.pi / 2), (0, np.pi), (0, 3 * np.pi / 2), (1, 300.0)):
        first = np.array([1.1, 120.0])
        first[axis] = at
        offset = np.zeros(2)
        offset[axis] = step
        scale = np.abs(pinched.displacement(pinched.case.surface.domain.grid(9, 9))).max()
        before, after = pinched.displacement(first - offset), pinched.displacement(first + offset)
        np.testing.assert_allclose(before, after, atol=1e-5 * scale)
    turn = pinched.displacement([[0.0, 100.0], [2 * np.pi, 100.0]])
    np.testing.assert_allclose(turn[0], turn[1], atol=1e-15)


def test_rigid_motions_are_gone(pinched):
    """The mean displacement over the area is zero, and so is the mean of its moment about the middle."""
    domain = pinched.case.surface.domain
    x, w = np.polynomial.legendre.leggauss(40)
    first = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    second = domain.lower[1] + domain.size[1] * (x + 1) / 2
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)
    u, position = pinched.displacement(points), pinched.case.surface.position(points) - [0, 300, 0]
    size = np.abs(u).max()
    assert np.abs(np.einsum("gh...,h->...", u, w)).max() < 1e-10 * size * 160
    assert np.abs(np.einsum("gh...,h->...", np.cross(position, u), w)).max() < 1e-10 * size * 160 * 300


@pytest.mark.parametrize("name", FIELDS)
def test_strains_are_those_of_the_displacement(name, pinched, sagging):
    """Strains of differences of the displacement and the surface, taken without the splines' own derivatives."""
    for solution in (pinched, sagging):
        domain = solution.case.surface.domain
        point = np.asarray(domain.lower) + np.array([0.37, 0.71]) * domain.size
        steps = 2e-4 * np.asarray(domain.size)
        short = steps / 20  # for first derivatives, whose differences cancel in strains of thin shells

        def at(i, j, p=point, s=steps, field=solution.displacement):
            return field(p + s * [i, j])

        u = {
            (0, 0): at(0, 0),
            (1, 0): (at(1, 0, s=short) - at(-1, 0, s=short)) / (2 * short[0]),
            (0, 1): (at(0, 1, s=short) - at(0, -1, s=short)) / (2 * short[1]),
            (2, 0): (at(1, 0) - 2 * at(0, 0) + at(-1, 0)) / steps[0] ** 2,
            (0, 2): (at(0, 1) - 2 * at(0, 0) + at(0, -1)) / steps[1] ** 2,
            (1, 1): (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / (4 * steps[0] * steps[1]),
        }
        if not name.endswith("strain"):
            continue
        x = solution.case.surface.derivatives(point, order=2)
        wanted = strains(x, u, solution.case.linear)[0 if name.startswith("membrane") else 1]
        found = solution.evaluate(name, point)
        np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("linear", [True, False])
def test_forces_are_the_derivatives_of_the_energy(linear, pinched):
    """Central differences of the energy of a large displacement, along a direction at random."""
    case = pinched.case if linear else pinched.case.model_copy(update={"theory": "kirchhoff-love-nonlinear"})
    surface, rng = pinched.midsurface, np.random.default_rng(2)
    u, direction = (20 * rng.standard_normal((*surface.patch.shape, 3)) for _ in range(2))
    width = 1e-5

    def energy(field):
        return integrals(case, surface.patch, surface.control_points, field).energies.sum()

    slope = (energy(u + width * direction) - energy(u - width * direction)) / (2 * width)
    forces = np.moveaxis(integrals(case, surface.patch, surface.control_points, u).forces, 0, -1)
    assert np.sum(forces * direction) == pytest.approx(slope, rel=1e-7)


def test_densities_add_up_to_the_energies(pinched):
    domain = pinched.case.surface.domain
    x, w = np.polynomial.legendre.leggauss(6)
    lines = [np.linspace(low, high, n + 1) for low, high, n in zip(domain.lower, domain.upper, (32, 12), strict=True)]
    nodes = [(a[:-1, None] + np.diff(a)[:, None] * (x + 1) / 2).ravel() for a in lines]
    weights = [(np.diff(a)[:, None] * w / 2).ravel() for a in lines]
    points = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    area = np.outer(*weights) * 300.0  # |a1 x a2| = R
    found = [np.sum(area * pinched.evaluate(f"{part}_energy_density", points)) for part in ("membrane", "bending")]
    np.testing.assert_allclose(found, pinched.energies(), rtol=1e-3)


def test_work_is_twice_the_energy(pinched):
    """Of both unit loads, in linear theory (Clapeyron)."""
    top = pinched.displacement([np.pi / 2, 300.0])
    assert sum(pinched.energies()) == pytest.approx(-top[2], rel=1e-9)


@pytest.fixture(scope="module")
def unreduced():
    return SOLVER.solve(plate(), {"cells": (3, 2), "symmetry": False})


@pytest.mark.parametrize("which", ["pinched", "sagging", "unreduced"])
def test_what_is_saved_is_what_is_read(which, request, tmp_path):
    solution = request.getfixturevalue(which)
    loaded = SOLVER.load(solution.save(tmp_path / "answer"))
    points = np.asarray(solution.case.surface.domain.grid(7, 5))
    for at in solution.states:
        alike(loaded.displacement(points, at=at), solution.displacement(points, at=at))
        alike(loaded.energies(at), solution.energies(at))
    assert loaded.case == solution.case
    assert loaded.history == solution.history
    assert (loaded.parameters, loaded.storage_bytes) == (solution.parameters, solution.storage_bytes)
    assert dict(loaded.diagnostics) == dict(solution.diagnostics)


def test_a_file_of_something_else_is_refused(tmp_path, pinched):
    path = tmp_path / "other.npz"
    np.savez(path, words=np.asarray("{}"))
    with pytest.raises(InputError, match="kratos-iga"):
        SOLVER.load(path)
    with pytest.raises(InputError, match="kratos-iga"):
        SOLVER.load(tmp_path / "none.npz")
    saved = pinched.save(tmp_path / "answer")
    saved.write_bytes(saved.read_bytes()[:200])
    with pytest.raises(InputError, match="damaged"):
        SOLVER.load(saved)


def test_what_it_takes_to_keep(pinched, sagging):
    assert pinched.storage_bytes == (11 * 9 * 3 + 9 + 7) * 8
    assert sagging.storage_bytes == (6 * 6 * 3 * 2 + 4 + 4) * 8
    short, taken = pinched.rounded("float32")
    assert taken < pinched.storage_bytes
    points = pinched.case.surface.domain.grid(5, 5)
    scale = np.abs(pinched.coefficients).max()
    difference = np.abs(short.displacement(points) - pinched.displacement(points)).max()
    assert 0 < difference <= 2.0**-24 * scale * 1.01
    assert pinched.rounded("float64") == (pinched, pinched.storage_bytes)


def test_unknowns_are_what_is_free(sagging):
    """6 x 6 control points, two edges held whole: 4 x 4 x 3 less what two planes of symmetry tie or hold.

    Of 5 x 5 points off the held edges a plane holds one component in a row and ties two of the row beside it.
    """
    within = 5 * 5 * 3
    held = 5 + 5  # normal components on both planes
    tied = 2 * (5 + 5) - 1  # tangential components beside them; z of the common corner is tied once
    overlap = 1 + 1  # x beside the second plane on the first one is held already, and so is y
    assert sagging.parameters == within - held - tied + overlap


def test_it_answers_at_what_it_was_solved_for(sagging):
    assert sagging.states == (0.5, 1.0)
    with pytest.raises(InputError, match=r"0\.5, 1"):
        sagging.displacement([0.5, 0.5], at=0.7)
    with pytest.raises(InputError, match="rim"):
        sagging.reaction("wall")
