"""The stiffness matrix of all degrees; of 4 and 5 the bubbles, how fast they converge, and that all answers as cubics do."""

from functools import cache

import numpy as np
import pytest

from derivations.annular_plate import annular_plate
from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem.mechanics.assembly import stiffness
from shellbench.solvers.fem.mechanics.rigid_motions import nodal_rigid_motions
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.basis import SAME, Basis, axis_functions, kinds_of, present_functions, tabulate
from shellbench.solvers.fem.mesh.bubbles import interpolation_coefficients
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.solver import FemSettings, FemSolver, takes_bubbles
from tests.solvers.fem.shells import EVERY_EDGE, SURFACES, shell

HIGHER = [4, 5]
EVERY = [3, *HIGHER]
PRESSURE = {"kind": "pressure", "value": "1 + xi1*xi2"}


def assembled(name, degree, cells=(4, 4)):
    case = shell(name)
    mesh = graded_mesh(case, cells, 2.0, degree=degree)
    return case, mesh, stiffness(mesh, case.surface, case.material, Quadrature.of_order(mesh, 2 * degree + 1))


def field(case, mesh, q):
    kinds = len(mesh.kinds)
    coefficients = q.reshape(-1, 3, kinds, 1) / mesh.node_scales[:, None, :, None]
    forces = np.zeros((0, 0, 3, kinds, 1))
    order = 2 * mesh.degree + 1
    return FemSolution(case, mesh, coefficients, (1.0,), np.zeros(0, dtype=np.int64), forces, order, q.size)


def solved(case, **settings):
    return FemSolver().solve(case, FemSettings(**settings))


@pytest.mark.parametrize("degree", HIGHER)
def test_bubbles_and_their_slopes_vanish_at_both_ends(degree):
    for derivative in (0, 1):
        assert not np.any(axis_functions(np.array([0.0, 1.0]), derivative, degree)[:, 0, 2:])
    # independent: with the cubics they span all polynomials of the degree
    x = np.linspace(0, 1, 9)
    table = axis_functions(x, 0, degree)
    functions = np.concatenate([table[:, 0], table[:, 1, :2]], axis=1)
    assert np.linalg.matrix_rank(functions) == functions.shape[1] == degree + 1
    assert not np.any(table[:, 1, 2:])


@pytest.mark.parametrize("degree", EVERY)
def test_a_cell_has_the_square_of_degree_and_one_functions(degree):
    table = tabulate(np.random.default_rng(0).uniform(size=(80, 2)), (0, 0), Basis(degree)).reshape(80, -1)
    present = present_functions(Basis(degree))
    assert table.shape[1] == 4 * len(kinds_of(Basis(degree)))
    assert np.array_equal(np.flatnonzero(np.abs(table).max(axis=0) > 1e-9 * np.abs(table).max()), present)
    assert np.linalg.matrix_rank(table[:, present]) == (degree + 1) ** 2


@pytest.mark.parametrize("degree", EVERY)
def test_polynomials_of_the_degree_are_interpolated_exactly(degree):
    case, poly = shell("plane"), np.polynomial.polynomial
    mesh = graded_mesh(case, (2, 3), 2.0, degree=degree)
    c = np.random.default_rng(0).normal(size=(degree + 1, degree + 1))

    def derivative(at, kind):
        d = poly.polyder(poly.polyder(c, kind[0], axis=0), kind[1], axis=1)
        return poly.polyval2d(at[:, 0], at[:, 1], d)

    found = interpolation_coefficients(
        mesh, lambda at: {k: derivative(at, k)[:, None] * np.ones(3) for k in ((0, 0), (1, 0), (0, 1), (1, 1))}
    )
    solution = field(case, mesh, (found * mesh.node_scales[:, None]).reshape(mesh.node_count, -1))
    points = np.random.default_rng(1).uniform(size=(50, 2)) * [2, 1]
    for kind in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)):
        assert np.allclose(solution.partial(points, kind)[:, 0], derivative(points, kind), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("degree", EVERY)
@pytest.mark.parametrize("name", SURFACES)
def test_stiffness_is_the_derivative_of_the_energy(name, degree):
    case, mesh, matrix = assembled(name, degree)
    u, v = np.random.default_rng(0).normal(size=(2, mesh.node_count, 3 * len(mesh.kinds), 1))
    difference = (sum(field(case, mesh, u + v).energies()) - sum(field(case, mesh, u - v).energies())) / 2
    assert np.sum(v * (matrix @ u)) == pytest.approx(difference, rel=1e-9)
    assert np.sum(u * (matrix @ u)) / 2 == pytest.approx(sum(field(case, mesh, u).energies()), rel=1e-12)
    sparse = matrix.to_csr()
    assert np.allclose((sparse @ (u * mesh_mask(mesh)).reshape(-1, 1)).reshape(u.shape), matrix @ u, rtol=1e-9)


@pytest.mark.parametrize("name", ["plane", "cylinder", "torus"])
def test_the_matrix_is_symmetric_and_has_no_negative_eigenvalues(name):
    sparse = assembled(name, 3, (3, 3))[2].to_csr()
    assert abs(sparse - sparse.T).max() <= 1e-14 * abs(sparse).max()
    assert np.linalg.eigvalsh(sparse.toarray()).min() >= -1e-12 * abs(sparse).max()


def test_four_gauss_points_a_direction_are_enough():
    case = shell("helicoid")
    mesh = graded_mesh(case, (4, 4), 2.0)
    rules = [stiffness(mesh, case.surface, case.material, Quadrature.of_order(mesh, n)) for n in (7, 15)]
    u = nodal_rigid_motions(case, mesh)[..., :1] * mesh.node_points[:, :1, None] ** 2
    coarse, fine = (float(np.sum(u * (m @ u))) for m in rules)
    assert coarse == pytest.approx(fine, rel=1e-5)


def mesh_mask(mesh):
    return np.tile(mesh.used_dofs, 3)[..., None]


@pytest.mark.sampled(7)
@pytest.mark.parametrize("degree", EVERY)
@pytest.mark.parametrize("name", SURFACES)
def test_rigid_motions_cost_nothing_or_next_to_nothing(name, degree):
    costs = []
    for n in (4, 8):
        case, mesh, matrix = assembled(name, degree, (n, n))
        motions = nodal_rigid_motions(case, mesh)
        costs.append(np.einsum("ndm,ndm->m", motions, matrix @ motions) / np.abs(matrix.blocks).max())
    assert np.abs(costs[0][:3]).max() < 1e-12
    # a rotation is interpolated; the energy of its error falls with the power 2 (p - 1) of the mesh size at least
    assert np.all(costs[1][3:] <= costs[0][3:] / (14 / 16 * 4 ** (degree - 1)) + 1e-12)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("degree", "rate"), [(3, 4), (4, 6), (5, 8)])
def test_energies_of_manufactured_shells_converge_with_twice_the_degree_less_two(degree, rate):
    # The energy of the error is the missing energy (Ritz) up to what prescribed motions at the edges change.
    case = catalog.named_case("manufactured_oblique_cylinder")
    cells = {3: (8, 11, 16), 4: (6, 8, 11), 5: (4, 6, 8)}[degree]
    errors = [measure_all(solved(case, cells=(n, n), degree=degree))["field_error"] for n in cells]
    slope = -np.polyfit(np.log(cells), np.log(errors), 1)[0]
    assert slope >= rate / 2 + 1  # in the mean square, two orders beyond the strains' p - 1, or more


@cache
def clamped_and_hinged(name, degree, cells):
    edges = EVERY_EDGE if name != "cylinder" else ["xi2_min", "xi2_max"]
    supports = [{"name": "clamp", "on": edges[:1], "clamped": True}, {"name": "hinge", "on": edges[1:]}]
    case = shell(name, supports=supports, loads=[PRESSURE])
    return solved(case, cells=(cells, cells), degree=degree, grading=1)


@pytest.mark.parametrize("degree", HIGHER)
@pytest.mark.parametrize(
    "name", ["helicoid", *(pytest.param(n, marks=pytest.mark.long) for n in ("hypar", "cylinder"))]
)
def test_clamped_and_hinged_shells_answer_as_with_cubics(name, degree):
    # edges whose normal turns, oblique coordinates, a seam; loads that are not symmetric
    fine, found = clamped_and_hinged(name, 3, 24), clamped_and_hinged(name, degree, 12)
    assert sum(found.energies()) == pytest.approx(sum(fine.energies()), rel=2e-4)
    for number in range(2):
        ours, theirs = (np.concatenate(s.reaction_at(number, np.zeros(3), None)) for s in (found, fine))
        assert np.allclose(ours, theirs, atol=1e-2 * np.abs(theirs).max())  # corners share forces


@pytest.mark.parametrize("degree", HIGHER)
def test_reactions_balance_loads(degree):
    supports = [{"name": "clamp", "on": ["xi1_min"], "clamped": True}]
    case = shell("helicoid", supports=supports, loads=[{"kind": "area", "vector": [1, 2, -3]}])
    found = solved(case, cells=(6, 6), degree=degree)
    force, moment = found.reaction_at(0, np.zeros(3), None)
    assert np.allclose(force, -found.area * np.array([1, 2, -3]), rtol=1e-8)
    points, weights = Quadrature.of_order(found.mesh, 15).on_cells(found.mesh, slice(None))
    flat = points.reshape(-1, 2)
    x = case.surface.derivatives(flat, order=1)
    area = np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1) * weights.ravel()
    asked = -np.sum(np.cross(x[0, 0], [1, 2, -3]) * area[:, None], axis=0)
    assert np.allclose(moment, asked, rtol=1e-5, atol=1e-5 * np.abs(asked).max())


@pytest.mark.parametrize("degree", HIGHER)
@pytest.mark.parametrize("name", ["scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free"])
def test_a_part_answers_as_the_whole(name, degree):
    case = catalog.named_case(name)
    part, whole = (solved(case, cells=(4, 4), degree=degree, symmetry=s) for s in (True, False))
    assert part.images != (1, 1)
    points = case.surface.domain.grid(9, 9)
    size = np.abs(whole.displacement(points)).max()
    # a whole that may turn freely is pinned at a few nodes, and misses a turn by its interpolation
    slack = 1e-4 if name.endswith("free") else 1e-8
    assert np.abs(part.displacement(points) - whole.displacement(points)).max() <= slack * size
    for theirs, ours in zip(whole.energies(), part.energies(), strict=True):
        assert ours == pytest.approx(theirs, rel=slack)


@pytest.mark.parametrize("degree", HIGHER)
def test_superlu_and_the_dissection_agree(degree):
    supports = [{"name": "rim", "on": ["xi2_min"], "clamped": True}]
    for name in ("cylinder", "helicoid"):
        case = shell(name, supports=supports, loads=[PRESSURE])
        found = [
            solved(case, cells=(5, 6), degree=degree, direct_solver=how, symmetry=False).coefficients
            for how in ("dissection", "superlu")
        ]
        assert np.allclose(*found, rtol=0, atol=1e-8 * np.abs(found[1]).max())


@pytest.mark.parametrize("degree", [4, pytest.param(5, marks=pytest.mark.long)])
def test_springs_hold_as_with_cubics(degree):
    bed = {"name": "bed", "stiffness": "5*(2 + xi1)", "components": ["x", "y", "z"]}
    data = {"springs": [bed], "loads": [PRESSURE], "remove_rigid_motions": []}
    ours, theirs = (solved(shell("hypar", **data), cells=c, degree=d) for d, c in ((degree, (8, 8)), (3, (32, 32))))
    points = ours.case.surface.domain.grid(7, 7)
    size = np.abs(theirs.displacement(points)).max()
    assert np.abs(ours.displacement(points) - theirs.displacement(points)).max() <= 1e-4 * size


def test_higher_degrees_are_declined_where_they_are_not_built():
    case = catalog.named_case("scordelis_lo_nonlinear")
    assert FemSolver().declines_with(case, FemSettings()) is None
    with pytest.raises(InputError, match="degree 5 is for shells at rest: in the linear theory"):
        solved(case, degree=5)


@pytest.mark.parametrize("degree", HIGHER)
def test_a_saved_solution_comes_back_whole(degree, tmp_path):
    solution = solved(catalog.named_case("scordelis_lo"), cells=(2, 3), degree=degree)
    again = FemSolver().load(solution.save(tmp_path / "roof"))
    assert again.mesh.degree == degree
    points = solution.case.surface.domain.grid(5, 5)
    expected = solution.displacement(points)
    assert np.allclose(again.displacement(points), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.long
def test_no_shell_has_converged_before_both_coordinates_were_refined():
    """Counts of cells are rounded: two meshes may have as many cells around, and repeat the same ripple."""
    solution = FemSolver().solve(catalog.named_case("annular_plate@warped"), FemSettings())
    true = annular_plate()["largest_displacement"].value
    assert abs(measure_all(solution)["largest_displacement"] - true) <= 2 * solution.uncertainty["largest_displacement"]


def test_a_clamp_holds_on_an_edge_whose_normal_hardly_turns():
    def sunk(height):
        surface = {"kind": "expression", "x": "xi1", "y": "xi2", "z": f"{height}*xi1*xi2", "xi1": [0, 1], "xi2": [0, 1]}
        supports = [{"name": "rim", "on": EVERY_EDGE, "clamped": True}]
        case = shell(surface, supports=supports, loads=[{"kind": "pressure", "value": 1.0}])
        return solved(case, cells=(3, 3), degree=5, symmetry=False).displacement(np.array([[0.5, 0.5]]))[0, 2]

    assert sunk(1.01 * SAME) == pytest.approx(sunk(0.0), rel=1e-4)


@pytest.mark.parametrize(("degree", "rate"), [(3, 4), (5, 8)])
def test_a_prescribed_field_is_interpolated_in_any_degree(degree, rate):
    # A rigid turn in coordinates in which no polynomial is one: its spurious bending energy goes as h^(2 (degree - 1)).
    case = catalog.named_case("rigid_turn_about_point@warped")
    energies = [FemSolver().solve(case, FemSettings(cells=(n, n), degree=degree)).energies(1.0)[1] for n in (6, 12)]
    assert np.log2(energies[0] / energies[1]) == pytest.approx(rate, abs=0.6)


def test_a_prescribed_field_that_a_moment_follows_is_left_to_cubics():
    case = catalog.named_case("rigid_turn_about_point")
    assert takes_bubbles(case)
    moment = {"kind": "moment", "on": ["xi1_max"], "axis": [0, 1, 0], "value": "t"}
    assert not takes_bubbles(
        Case.model_validate(case.model_dump(mode="json", exclude_unset=True) | {"loads": [moment]})
    )


def test_cells_with_matrices_of_their_own_leave_the_others_and_the_first_matrix_alone():
    _, mesh, matrix = assembled("hypar", 5, (2, 2))
    before, dense = matrix.blocks.copy(), matrix.to_csr().toarray()
    own = matrix.with_cells_copied(np.array([3, 1])).with_cells_copied(np.array([1, 2]))
    assert own.changed.tolist() == [1, 2, 3]
    assert np.allclose(own.to_csr().toarray(), dense, rtol=0, atol=1e-14 * np.abs(dense).max())
    own.instead[0] *= 3.0  # of cell 1
    other = own.with_cells_copied(np.array([0]))
    other.instead[0] *= 5.0  # of cell 0, which the first copy has not
    q = np.random.default_rng(0).normal(size=(mesh.node_count, 3 * len(mesh.kinds), 2))
    for found, factors in ((matrix, (1, 1)), (own, (1, 3)), (other, (5, 3))):
        expected = dense.copy()
        for cell, factor in enumerate(factors):
            expected[np.ix_(matrix.dofs[cell], matrix.dofs[cell])] += (factor - 1) * before[cell]
        carried = np.isin(np.arange(len(dense)), matrix.dofs)
        flat = q.reshape(-1, 2) * carried[:, None]
        product = (found @ flat.reshape(q.shape)).reshape(-1, 2)
        assert np.allclose(product, expected @ flat, rtol=0, atol=1e-12 * np.abs(expected @ flat).max())
        assert np.allclose(found.to_csr().toarray(), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert matrix.blocks.tobytes() == before.tobytes()  # nothing has written to them


@pytest.mark.parametrize("place", ["blocks", "instead"])
def test_a_matrix_that_is_not_finite_anywhere_has_no_largest_entry(place):
    own = assembled("hypar", 5, (2, 2))[2].with_cells_copied(np.array([1, 3]))
    assert own.largest == pytest.approx(np.abs(own.blocks).max())
    own.instead[1] *= 1e3
    assert own.largest == pytest.approx(np.abs(own.instead).max())
    getattr(own, place)[1, 2, 3] = np.nan
    assert not np.isfinite(own.largest)
