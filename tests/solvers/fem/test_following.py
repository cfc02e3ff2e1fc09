"""Pressure that follows the shell: what its forces are, their derivative, and states of equilibrium under it."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.quantities.measure import area_rule
from shellbench.solvers.fem.algebra.block_matrix import NEIGHBOURS, NODE_DOFS, BlockMatrix, neighbour_columns
from shellbench.solvers.fem.mechanics.loads import Loading
from shellbench.solvers.fem.mechanics.strain_energy import StrainEnergy
from shellbench.solvers.fem.mesh.basis import COMPONENTS, KINDS
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.motion import motion
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.path.following import FollowingPressure
from shellbench.solvers.fem.path.newton import equilibrium
from shellbench.solvers.fem.path.problem import FiniteProblem
from tests.solvers.fem.shells import EVERY_EDGE, shell
from tests.solvers.fem.test_large_displacement import NONLINEAR, WALL, data_of, on_mesh, solve

FOLLOWING = {"kind": "pressure", "value": "t*(2 + xi1*xi2)", "follows": True}
EVEN = FOLLOWING | {"value": "2*t"}
SHELLS = ["plane", "cylinder", "helicoid", "hypar", "torus"]


def pressed(surface="plane", load=FOLLOWING, cells=(3, 2), order=7):
    """Return a mesh and the pressure on it; forces do not ask what holds the shell."""
    case = shell(surface, loads=[load], supports=[{"name": "held", "on": EVERY_EDGE}] if surface == "plane" else [])
    case = case.model_copy(update={"theory": NONLINEAR})
    mesh = graded_mesh(case, cells, 1.0)
    return mesh, FollowingPressure(
        case, StrainEnergy(mesh, case.surface, case.material, Quadrature.of_order(mesh, order))
    )


@pytest.fixture(autouse=True)
def _unheld(monkeypatch):
    """Let shells be held by nothing: they are not solved for here."""
    monkeypatch.setattr("shellbench.problems.shell.case.check_held", lambda case: None)


def random_displacement(mesh, size=0.2, seed=0):
    return np.random.default_rng(seed).uniform(-size, size, (mesh.node_count, NODE_DOFS))


def times(matrix, vector):
    return (matrix @ vector[..., None])[..., 0]


def derivative(pressure, q, t):
    """Return the symmetric and the antisymmetric part of the forces' derivative."""
    mesh = pressure.energy.mesh
    matrix = BlockMatrix(np.zeros((mesh.node_count, len(NEIGHBOURS), NODE_DOFS, NODE_DOFS)), neighbour_columns(mesh))
    pressure.add_tangent(matrix, q, t)
    return BlockMatrix(-matrix.blocks, matrix.columns), pressure.skew(q, t)


@pytest.mark.parametrize("surface", SHELLS)
def test_the_tangent_is_the_derivative_of_the_forces(surface):
    mesh, pressure = pressed(surface)
    q, step, t = random_displacement(mesh), random_displacement(mesh, 1.0, seed=1), 0.7
    # The forces are quadratic in the displacement, so that a central difference of any length is exact.
    expected = (pressure.forces(q + step, t) - pressure.forces(q - step, t)) / 2
    symmetric, skew = derivative(pressure, q, t)
    scale = np.abs(expected).max()
    assert np.allclose(times(symmetric, step) + times(skew, step), expected, rtol=0, atol=1e-12 * scale)
    for matrix, sign in ((symmetric, 1), (skew, -1)):
        sparse = matrix.to_csr()
        assert np.abs(sparse - sign * sparse.T).max() <= 1e-14 * scale


def on_rim(mesh):
    """Return a mask of the degrees of freedom (nodes, 12) that displace an edge of a plane."""
    points, domain = mesh.node_points, mesh.domain
    found = np.zeros((mesh.node_count, COMPONENTS, len(KINDS)), dtype=bool)
    for axis in (0, 1):
        at = np.isin(points[:, axis], (domain.lower[axis], domain.upper[axis]))
        along = [kind[axis] == 0 for kind in KINDS]  # values, and derivatives along the edge
        found |= at[:, None, None] & np.array(along)
    return found.reshape(mesh.node_count, -1)


def test_only_free_edges_and_an_uneven_pressure_make_it_unsymmetric():
    mesh, even = pressed(load=EVEN, order=9)  # exact: the products are of degree 8
    q, v, w = (random_displacement(mesh, seed=seed) for seed in range(3))
    skew = even.skew(q, 1.0)
    free = abs(np.sum(v * times(skew, w)))
    inner_v, inner_w = (np.where(on_rim(mesh), 0.0, x) for x in (v, w))
    assert abs(np.sum(inner_v * times(skew, inner_w))) < 1e-13 < 1e-4 < free
    assert abs(np.sum(inner_v * times(pressed(order=9)[1].skew(q, 1.0), inner_w))) > 1e-6


def test_the_force_on_a_shell_whose_edge_is_held_does_not_change():
    """The area vector of a surface is that of its edge: p times the plane's, whatever goes on inside."""
    mesh, pressure = pressed(load=EVEN)
    bulge = np.where(on_rim(mesh), 0.0, random_displacement(mesh, 0.5))
    forces = pressure.forces(bulge, 1.0)
    values = forces.reshape(mesh.node_count, COMPONENTS, len(KINDS))[..., 0]
    assert np.abs(forces).max() > 0.1
    assert np.allclose(values.sum(axis=0), [0, 0, 2.0 * 2.0 * 1.0], rtol=0, atol=1e-12)


def test_the_force_on_a_closed_shell_is_nothing():
    mesh, pressure = pressed("torus", EVEN, cells=(6, 6), order=19)
    forces = pressure.forces(random_displacement(mesh, 0.1), 1.0).reshape(mesh.node_count, COMPONENTS, len(KINDS))
    total, magnitude = forces[..., 0].sum(axis=0), np.abs(forces[..., 0]).sum()
    assert np.allclose(total, 0, atol=1e-10 * magnitude)


def test_the_forces_turn_with_the_shell():
    mesh, pressure = pressed()
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    position = pressure.case.surface.derivatives(mesh.node_points, 2)
    x = np.stack([position[kind] for kind in KINDS], axis=-1) * mesh.node_scales[:, None, :]
    u = random_displacement(mesh).reshape(x.shape)
    turned = np.einsum("ab,nbk->nak", turn, x + u) - x
    forces, expected = (pressure.forces(v.reshape(mesh.node_count, -1), 0.7).reshape(x.shape) for v in (turned, u))
    assert np.allclose(forces, np.einsum("ab,nbk->nak", turn, expected), rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("surface", SHELLS)
def test_at_rest_and_in_linear_theory_it_is_the_dead_pressure(surface):
    mesh, pressure = pressed(surface)
    rule = pressure.energy.quadrature
    linear = pressure.case.model_copy(update={"theory": "kirchhoff-love-linear"})
    dead = pressure.case.model_copy(update={"loads": (pressure.case.loads[0].model_copy(update={"follows": False}),)})
    expected = Loading.on_mesh(dead, mesh, rule, (0.7,)).nodal[..., 0]
    assert np.allclose(pressure.forces(0 * expected, 0.7), expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    in_linear_theory = Loading.on_mesh(linear, mesh, rule, (0.7,)).nodal[..., 0]
    assert np.allclose(in_linear_theory, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    assert not Loading.on_mesh(pressure.case, mesh, rule, (0.7,)).nodal.any()


# equilibrium


def test_steps_are_solved_with_the_whole_tangent():
    case = catalog.named_case("cantilever_pressure")
    mesh = graded_mesh(case, (8, 2), 1.0)
    problem = FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))
    state = equilibrium(problem, problem.at_rest(), 0.1)
    ties = problem.ties(0.1)
    right = np.where(ties.free, random_displacement(mesh), 0.0)
    found = state.factor.solve(right[..., None])[..., 0]
    # The tangent of the last iteration is that before its step, which is next to nothing.
    matrix = problem.tangent(state.q, 0.1, state.strained, state.strained.stresses)
    skew = problem.pressure.skew(state.q, 0.1)
    left = times(ties.reduce(matrix), found) - np.where(ties.free, times(ties.reduce(skew), found), 0.0)
    assert np.abs(times(skew, found)).max() > 1e-3 * np.abs(right).max()
    assert np.allclose(left, right, rtol=0, atol=1e-5 * np.abs(right).max())


def test_newtons_method_converges_quadratically():
    case = catalog.named_case("cantilever_pressure")
    mesh = graded_mesh(case, (8, 1), 1.0)
    problem = FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))
    state = equilibrium(problem, equilibrium(problem, problem.at_rest(), 0.2), 0.4, tolerance=1e-20)
    first, second, third = state.residuals[-4:-1]
    assert third < 1e-4 < first
    assert np.log(third / second) < 1.5 * np.log(second / first)


def test_reactions_balance_the_pressure_on_the_deformed_strip():
    solution = on_mesh(catalog.named_case("cantilever_pressure"), (12, 1))[0].solution
    points, weights = area_rule(solution.case)
    x = solution.case.surface.derivatives(points, 1)
    for t in (0.25, 1.0):
        force, moment = solution.reaction("wall", at=t)
        a1, a2 = (x[key] + solution.partial(points, key, t) for key in ((1, 0), (0, 1)))
        push = t * weights[:, None] * np.cross(a1, a2)
        arms = x[0, 0] + solution.displacement(points, at=t)
        assert np.allclose(force, -push.sum(axis=0), rtol=0, atol=1e-5)
        assert np.allclose(moment, -np.cross(arms, push).sum(axis=0), rtol=0, atol=1e-4)
        assert force[0] > 0.3 * 10 * t  # it draws the strip back, which a dead pressure would not


def test_at_small_pressures_it_is_the_linear_theory():
    data, small = data_of("cantilever_pressure"), 1e-6
    tip = [data["quantities"][1] | {"primary": True}]
    nonlinear = data | {"path": {"until": small}, "quantities": [tip[0] | {"at": small}]}
    linear = data | {"theory": "kirchhoff-love-linear", "quantities": [tip[0] | {"at": 1.0}]}
    found, expected = (solve(shell(**case), cells=(4, 1)) for case in (nonlinear, linear))
    points = expected.case.surface.domain.grid(7, 7).reshape(-1, 2)
    u, v = found.displacement(points) / small, expected.displacement(points)
    assert np.allclose(u, v, rtol=0, atol=1e-5 * np.abs(v).max())


def test_what_can_not_be_followed_is_declined():
    data = {"theory": NONLINEAR, "loads": [EVEN]}
    tip = {"name": "tip", "kind": "displacement", "points": ["tip"], "direction": [0, 0, 1], "primary": True}
    control = {"control": "displacement", "quantity": "tip", "until": 1.0}
    held = data | {"supports": [WALL], "points": {"tip": [2, 0.5]}, "quantities": [tip]}
    for_path = shell(**held, path=control)
    loose = shell(**data, remove_rigid_motions=["translation_y"], supports=[WALL | {"components": ["x", "z"]}])
    moving = shell(**data, supports=[{"name": "rim", "on": ["xi1_min"]}], dynamics={"until": 1.0})
    assert large_displacement.why_declined(shell(**held)) is None
    assert "by load steps before buckling only" in large_displacement.why_declined(for_path)
    assert "against all rigid motions where a pressure follows" in large_displacement.why_declined(loose)
    assert "keep the normal of the shell at rest in time" in motion.why_declined(moving)
