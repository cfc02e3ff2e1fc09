import numpy as np
import pytest

from shellbench.errors import SolveFailure
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.cst.solver import CstSolver
from tests.problems.shell.stated_shells import RIM, STEEL, plate
from tests.solvers.cst.shells import cylinder, largest

LOAD = 1e-3  # N/m^2
B = STEEL["youngs_modulus"] * STEEL["thickness"] ** 3 / 12


def solved(case, **settings):
    return CstSolver().solve(case, settings)


def centre(solution):
    return -solution.displacement([0.5, 0.5])[2]


def thin_plate(form):
    """Deflection of the middle of the plate whose energy per area is 1/2 k.form.k, k = (k11, k22, k12), times B.

    Ritz's method with the polynomials x (1 - x) P_m y (1 - y) P_n, exact integrals.
    """
    degree = 8
    x, weights = np.polynomial.legendre.leggauss(degree + 4)
    x, weights = (x + 1) / 2, weights / 2
    rim = np.polynomial.Polynomial([0, 1, -1])
    basis = [
        rim * np.polynomial.Legendre.basis(m, [0, 1]).convert(kind=np.polynomial.Polynomial) for m in range(degree)
    ]
    f, d, dd = (np.array([b.deriv(k)(x) if k else b(x) for b in basis]) for k in (0, 1, 2))
    both = np.outer(weights, weights).ravel()
    k = np.stack([_products(dd, f), _products(f, dd), _products(d, d)])
    stiffness = B * np.einsum("aip,ab,bjp,p->ij", k, form, k, both, optimize=True)
    amplitudes = np.linalg.solve(stiffness, LOAD * _products(f, f) @ both)
    middle = np.array([[b(0.5)] for b in basis])
    return float(amplitudes @ _products(middle, middle)[:, 0])


def _products(first, second):
    return np.einsum("mp,nq->mnpq", first, second).reshape(len(first) ** 2, -1)


ISOTROPIC = np.diag([1, 1, 2])
RIGHT = np.array([[1, 0, 1], [0, 1, 1], [1, 1, 6]])  # (k11 + k12)^2 + (k22 + k12)^2 + 4 k12^2
ALTERNATING = np.array([[5 / 6, -1 / 6, 0], [-1 / 6, 5 / 6, 0], [0, 0, 4]])


def test_the_ritz_method_of_these_tests_knows_the_isotropic_plate():
    assert thin_plate(ISOTROPIC) == pytest.approx(0.00406235 * LOAD / B, rel=1e-5)  # Timoshenko & W.-K., table 8


@pytest.mark.parametrize(("diagonal", "form", "order"), [("right", RIGHT, 1), ("alternating", ALTERNATING, 2)])
def test_meshes_converge_to_the_plate_that_the_docstring_of_hinges_states(diagonal, form, order):
    """And that is not the isotropic one: it is too stiff in twist."""
    limit = thin_plate(form)
    cells = np.array([16, 24, 48])
    errors = [abs(centre(solved(plate(), cells=(n, n), diagonal=diagonal)) / limit - 1) for n in cells]
    assert np.polyfit(np.log(cells), np.log(errors), 1)[0] == pytest.approx(-order, abs=0.25)
    assert errors[-1] < 5e-3
    assert limit < 0.76 * thin_plate(ISOTROPIC)


def test_diagonals_to_the_left_mirror_those_to_the_right():
    right, left = (solved(plate(), cells=(7, 7), diagonal=d) for d in ("right", "left"))
    points = np.random.default_rng(0).random((9, 2))
    mirrored = points * [-1, 1] + [1, 0]
    np.testing.assert_allclose(right.displacement(points), left.displacement(mirrored), rtol=1e-9, atol=1e-15)


def test_a_closed_cylinder_under_pressure_widens_as_a_membrane():
    """Far from the ends w = p R^2 / (E h); all of it where the ends are free to widen."""
    loads = [{"kind": "pressure", "value": -1.0}]
    case = cylinder(supports=[], loads=loads, remove_rigid_motions=[f"{k}_{c}" for k in ("translation", "rotation") for c in "xyz"])  # fmt: skip
    solution = solved(case, cells=(64, 8))
    expected = 1.0 * 2.0**2 / (STEEL["youngs_modulus"] * STEEL["thickness"])
    u = solution.displacement(case.surface.domain.grid(9, 5))
    np.testing.assert_allclose(np.hypot(u[..., 0], u[..., 2]), expected, rtol=5e-3)


def test_removed_rigid_motions_have_no_mean():
    loads = [
        {"kind": "point", "on": ["top"], "force": [0, 0, -1]},
        {"kind": "point", "on": ["bottom"], "force": [0, 0, 1]},
    ]
    names = [f"{k}_{c}" for k in ("translation", "rotation") for c in "xyz"]
    case = cylinder(
        supports=[], loads=loads, points={"top": [90, 1.5], "bottom": [270, 1.5]}, remove_rigid_motions=names
    )
    solution = solved(case, cells=(17, 5))
    areas, rest = solution.problem.loading.areas, solution.problem.elastic.rest
    u = solution.vertices()
    scale = np.abs(u).max() * areas.sum()
    assert np.abs(areas @ u).max() < 1e-9 * scale
    assert np.abs(areas @ np.cross(rest - [0, 1.5, 0], u)).max() < 1e-9 * scale


def test_loads_that_nothing_balances_are_a_failure_in_one_sentence():
    names = [f"{k}_{c}" for k in ("translation", "rotation") for c in "xyz"]
    with pytest.raises(SolveFailure, match="not in balance"):
        solved(plate(supports=[], remove_rigid_motions=names), cells=(4, 4))


def test_reactions_carry_the_load_and_energy_is_half_its_work():
    solution = solved(plate(), cells=(9, 7))
    force, moment = solution.reaction("rim", centre=(0.5, 0.5, 0.0))
    np.testing.assert_allclose(force, [0, 0, LOAD], atol=1e-10 * LOAD)
    np.testing.assert_allclose(moment, 0, atol=1e-8 * LOAD)
    work = np.sum(solution.problem.loading.forces(1.0) * solution.vertices())
    assert sum(solution.energies()) == pytest.approx(work / 2, rel=1e-9)
    assert solution.history[-1].energy == pytest.approx(-work / 2, rel=1e-9)


def large(load):
    return plate(
        theory="kirchhoff-love-nonlinear",
        loads=[{"kind": "area", "vector": [0, 0, f"-{load}*t"]}],
        path={"states": [0.5]},
        quantities=[
            largest(),
            {"name": "middle", "kind": "displacement", "points": ["centre"], "direction": [0, 0, -1]},
        ],
    )


def test_large_displacements_stiffen_a_plate_whose_rim_is_held():
    small, big = (solved(large(load), cells=(8, 8)) for load in (1e-5, 10.0))
    linear = solved(plate(loads=[{"kind": "area", "vector": [0, 0, -1e-5]}]), cells=(8, 8))
    assert centre(small) == pytest.approx(centre(linear), rel=1e-6)
    assert centre(big) < 0.5 * 1e6 * centre(linear)
    path = [step for step in big.history if step.phase == "path"]
    assert [step.at for step in path] == [0.5, 1.0]
    assert path[-1].quantities["middle"] == pytest.approx(centre(big))
    assert centre(big) > big.displacement([0.5, 0.5], at=0.5)[2] * -1 > 0.5 * centre(big)


def test_a_state_of_a_path_is_in_equilibrium():
    solution = solved(large(10.0), cells=(8, 8))
    for t in (0.5, 1.0):
        u, problem = solution.vertices(t), solution.problem
        gap = (problem.internal_forces(u) - problem.loading.forces(t)).ravel()
        assert np.abs(gap[problem.pattern.free]).max() < 1e-8 * 10.0


def test_supports_of_a_path_move_the_shell_as_prescribed():
    """A plate turned by a quarter about one edge, held at that edge and the opposite one, is not strained."""
    ends = {
        "name": "ends",
        "on": ["xi1_min", "xi1_max"],
        "motion": {"kind": "rotation", "axis": [0, 1, 0], "angle": "90*t"},
    }
    case = plate(theory="kirchhoff-love-nonlinear", supports=[ends], loads=[])
    solution = solved(case, cells=(5, 4))
    x, y, z = case.surface.position(case.surface.domain.grid(4, 4)).reshape(-1, 3).T
    moved = np.stack([x, y, z], axis=-1) + solution.displacement(case.surface.domain.grid(4, 4)).reshape(-1, 3)
    np.testing.assert_allclose(moved, np.stack([z, y, -x], axis=-1), atol=1e-8)
    assert sum(solution.energies()) < 1e-12


def test_quantities_are_in_the_history():
    case = plate(supports=[RIM])
    solution = solved(case, cells=(6, 6))
    assert solution.history[0].quantities == pytest.approx(measure_all(solution), rel=1e-12)
    assert solution.history[0].unknowns == solution.parameters == 3 * 25
