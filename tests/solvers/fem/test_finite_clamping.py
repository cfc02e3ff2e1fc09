"""Clamps at finite strain on edges along which the normal turns: a potential, free of force where nothing is bent."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case, rotation_matrix
from shellbench.problems.shell.question.conditions import Rotation
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix, neighbour_columns
from shellbench.solvers.fem.mechanics.clamping import finite_clamps
from shellbench.solvers.fem.mesh.basis import KINDS
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path.large_displacement import solve
from shellbench.solvers.fem.path.newton import equilibrium
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.fem.solver import FemSolver
from tests.solvers.fem.shells import HYPAR, LARGEST, MATERIAL, shell, uniform

NONLINEAR = "kirchhoff-love-nonlinear"
AXIS, ANGLE = (0.0, 1.0, 0.0), 50.0  # a turn that neither tube nor hypar is symmetric about


def turned(axis=AXIS, angle=f"{ANGLE}*t"):
    return {"kind": "rotation", "axis": list(axis), "centre": [0.2, 0.1, -0.3], "angle": angle}


def clamped(surface, on, motion=None, **fields):
    support = {"name": "clamp", "on": on, "clamped": True} | ({"motion": motion} if motion else {})
    return shell(surface, theory=NONLINEAR, supports=[support], quantities=[LARGEST | {"at": 1.0}], **fields)


def problem_of(case, cells):
    mesh = uniform(case, cells)
    return FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 7))


CASES = {
    "tube": lambda: clamped("cylinder", ["xi2_min", "xi2_max"], turned((1.0, 2.0, 0.5))),
    "hypar": lambda: clamped(HYPAR, ["xi1_min"], turned()),
}


@pytest.fixture(scope="module", params=CASES)
def edges(request):
    """Return a case, its mesh, its clamps, and random degrees of freedom."""
    case = CASES[request.param]()
    mesh = uniform(case, (5, 3))
    q = np.random.default_rng(0).uniform(-0.05, 0.05, (mesh.node_count, 12))
    return case, mesh, tuple(finite_clamps(case, mesh)), q


def test_there_is_one_on_each_edge_whose_normal_turns(edges):
    case, _, clamps, _ = edges
    assert len(clamps) == sum(len(s.on) for s in case.supports)
    flat = clamped("plane", ["xi1_min"])
    assert not tuple(finite_clamps(flat, uniform(flat, (2, 2))))
    straight = clamped("cylinder", ["xi2_min"])
    straight = straight.model_copy(update={"supports": (straight.supports[0].model_copy(update={"clamped": False}),)})
    assert not tuple(finite_clamps(straight, uniform(straight, (4, 2))))


def slope(of, q, step, d=1e-4):
    return (8 * (of(q + d * step) - of(q - d * step)) - (of(q + 2 * d * step) - of(q - 2 * d * step))) / (12 * d)


def test_the_gradient_is_the_potentials_derivative(edges):
    _, mesh, clamps, q = edges
    step = np.random.default_rng(1).normal(size=q.shape)
    for clamp in clamps:
        gradient = clamp.deform_edge(q, 0.7).gradient(mesh.node_count)
        expected = slope(lambda x, c=clamp: c.deform_edge(x, 0.7).potential, q, step)
        assert np.sum(gradient * step) == pytest.approx(expected, rel=1e-7)


def test_the_tangent_is_the_gradients_derivative_and_symmetric(edges):
    _, mesh, clamps, q = edges
    step = np.random.default_rng(1).normal(size=q.shape)
    for clamp in clamps:
        matrix = BlockMatrix(np.zeros((mesh.node_count, 9, 12, 12)), neighbour_columns(mesh))
        clamp.deform_edge(q, 0.7).add_tangent(matrix)
        expected = slope(lambda x, c=clamp: c.deform_edge(x, 0.7).gradient(mesh.node_count), q, step)
        found = (matrix @ step[..., None])[..., 0]
        assert np.allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
        dense = matrix.to_csr().toarray()
        assert np.allclose(dense, dense.T, rtol=0, atol=1e-12 * np.abs(dense).max())


def rigid(case, mesh, t):
    """Return the interpolant (nodes, 12) of the support's own motion, everywhere."""
    x = case.surface.derivatives(mesh.domain.wrap(mesh.node_points), order=2)
    motion = case.supports[0].motion
    turn = rotation_matrix(motion, ANGLE * t, linear=False)
    moved = {
        kind: (x[kind] - (np.asarray(motion.centre) if kind == (0, 0) else 0)) @ (turn - np.eye(3)).T for kind in KINDS
    }
    nodal = np.stack([moved[kind] for kind in KINDS], axis=-1) * mesh.node_scales[:, None, :]
    return nodal.reshape(mesh.node_count, 12)


def test_a_rigid_motion_of_everything_leaves_no_gap(edges):
    case, mesh, clamps, _ = edges
    q = rigid(case, mesh, 0.7)
    assert np.abs(q).max() > 0.5
    for clamp in clamps:
        scale = np.linalg.norm(clamp.raised, axis=-1).max()
        assert np.abs(clamp.deform_edge(q, 0.7).gap).max() < 1e-12 * scale
        assert np.abs(clamp.deform_edge(q, 0.7).gap_forces(mesh.node_count)).max() < 1e-12
        assert abs(clamp.deform_edge(q, 0.7).potential) < 1e-12
        assert np.abs(clamp.deform_edge(q, 0.6).gap).max() > 0.01 * scale  # where the support has not come so far
        assert np.abs(clamp.deform_edge(0 * q, 0.0).gap).max() < 1e-14 * scale


def test_a_tilt_of_the_edge_is_its_gap():
    """u = phi d(xi2) a3 at the rim of a tube: u,2 . a3 = phi, and the outward conormal of the lower rim is -y."""
    case = clamped("cylinder", ["xi2_min"])
    mesh = uniform(case, (24, 2))
    (clamp,) = finite_clamps(case, mesh)
    points = mesh.node_points
    normal = np.stack([np.cos(points[:, 0]), 0 * points[:, 0], np.sin(points[:, 0])], axis=-1)
    along = np.stack([-np.sin(points[:, 0]), 0 * points[:, 0], np.cos(points[:, 0])], axis=-1)
    values = np.zeros((mesh.node_count, 3, 4))
    inward = -1.0  # a1 x a2 = (-sin, 0, cos) x (0, 1, 0) points to the axis
    for kind, field in (
        ((0, 0), points[:, 1:] * normal),
        ((1, 0), points[:, 1:] * along),
        ((0, 1), normal),
        ((1, 1), along),
    ):
        values[:, :, KINDS.index(kind)] = 0.01 * field
    q = (values * mesh.node_scales[:, None, :]).reshape(-1, 12)
    assert np.allclose(clamp.deform_edge(q, 0.0).gap, -inward * 0.01, rtol=1e-4)


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_rims_that_turn_together_cost_no_energy(axis):
    """By a right angle in a few steps, about the axis of the tube and across it."""
    energies = []
    for cells in ((8, 2), (16, 2)):
        case = clamped("cylinder", ["xi2_min", "xi2_max"], turned(axis, "90*t"))
        problem = problem_of(case, cells)
        state = problem.at_rest()
        for t in (0.25, 0.5, 0.75, 1.0):
            state = equilibrium(problem, state, t)
            assert state.stable
        expected = rotation_matrix(case.supports[0].motion, 90.0, linear=False)
        x = case.surface.derivatives(problem.mesh.domain.wrap(problem.mesh.node_points), order=1)
        moved = (x[0, 0] - [0.2, 0.1, -0.3]) @ (expected - np.eye(3)).T
        assert np.allclose(state.q.reshape(-1, 3, 4)[:, :, 0], moved, rtol=0, atol=2e-2 if cells[0] == 8 else 2e-3)
        energies.append(state.strained.energy)
    material, area = case.material, 2 * np.pi * 2 * 3
    assert energies[1] < 1e-6 * material.membrane_stiffness / 2 * area
    assert np.log2(energies[0] / energies[1]) > 5  # what is left is the interpolation of a circle


@pytest.mark.long
def test_between_the_nodes_of_turned_rims_the_gap_closes_with_the_fourth_power():
    """The ties hold it and its derivative along the rim at the nodes, about the turned normal."""
    loads = [{"kind": "area", "vector": ["-0.1*t*sin(xi1)", 0, "0.1*t*(1 + cos(xi1))"]}]
    case = clamped("cylinder", ["xi2_min", "xi2_max"], turned((1.0, 0.0, 0.0), "40*t"), loads=loads)
    gaps = []
    for cells in ((12, 4), (24, 4)):
        problem = problem_of(case, cells)
        state = problem.at_rest()
        for t in (0.25, 0.5, 0.75, 1.0):
            state = equilibrium(problem, state, t)
        gaps.append(max(np.abs(clamp.deform_edge(state.q, 1.0).gap).max() for clamp in problem.clamps))
    assert np.log2(gaps[0] / gaps[1]) > 3.9


def test_a_rim_whose_normal_stays_behind_is_bent():
    """Complement the test above, which would pass without clamping: turned rims that keep their normals do cost energy."""
    case = clamped("cylinder", ["xi2_min", "xi2_max"], turned((1.0, 0.0, 0.0), "20*t"))
    problem = problem_of(case, (8, 2))
    carried = equilibrium(problem, problem.at_rest(), 1.0)
    left = {
        "supports": (
            case.supports[0].model_copy(update={"motion": Rotation(kind="rotation", axis=(1, 0, 0), angle=0)}),
        )
    }
    behind = replace(problem, clamps=tuple(finite_clamps(case.model_copy(update=left), problem.mesh)))
    assert behind.potential(behind.state_at(1.0, carried.q, carried)) > 100 * carried.strained.energy


def test_torque_is_the_derivative_of_the_energy():
    """The sleeve in its regular range, by differences over one degree, on a mesh too coarse for its boundary layer."""
    data = catalog.named_case("sleeve_twist").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    quantities = [q for q in data["quantities"] if q["name"] == "torque_50mrad"]
    case = build_case(
        data | {"quantities": [quantities[0] | {"primary": True}], "path": {"until": 0.06, "states": [0.04]}}, "s", "s"
    )
    found, _ = solve(case, uniform(case, (8, 4)), 7, (1.0, 1e-3))
    solution = found.solution
    energy = {round(s.at, 9): s.energy for s in solution.history}
    d = 0.01
    torque = [solution.reaction("top_rim", at=t)[1][1] for t in solution.states]
    simpson = (torque[0] + 4 * torque[1] + torque[2]) / 6
    assert (energy[0.06] - energy[0.04]) / (2 * d) == pytest.approx(simpson, rel=1e-7)
    (force, moment), (opposite, _) = (solution.reaction(name, at=0.05) for name in ("bottom_rim", "top_rim"))
    assert moment[1] == pytest.approx(-torque[1], rel=1e-6)
    assert np.allclose(force + opposite, 0, rtol=0, atol=1e-7)
    # thin-walled torsion, 2 pi R^3 G h / L per radian
    assert torque[1] == pytest.approx(2 * np.pi * 0.25**3 * 2000 * 0.012 * 0.05, rel=3e-3)


def test_it_is_needed():
    """A thick tube under pressure and torsion between fixed rims: with ties at the nodes alone its rims give way."""
    case = clamped(
        "cylinder", ["xi2_min", "xi2_max"], material=MATERIAL | {"thickness": 0.2},
        loads=[{"kind": "pressure", "value": "-40*t"}, {"kind": "area", "vector": ["-20*t*sin(xi1)", 0, "20*t*cos(xi1)"]}],
    )  # fmt: skip

    def potential(cells):
        problem = problem_of(case, cells)
        state = equilibrium(problem, problem.at_rest(), 1.0)
        assert state.stable
        return problem.potential(state)

    def tied(cells):
        problem = replace(problem_of(case, cells), clamps=())
        return problem.potential(equilibrium(problem, problem.at_rest(), 1.0))

    fine = potential((20, 10))
    errors, without = ([abs(of((n, n)) / fine - 1) for n in (4, 8)] for of in (potential, tied))
    assert errors[1] < 2e-3
    assert np.log2(errors[0] / errors[1]) > 3
    assert without[1] > 10 * errors[1]


def test_reactions_of_clamped_rims_balance_the_loads():
    loads = [{"kind": "area", "vector": ["0.05*t", "0.15*t", "-0.2*t*(1 + 0.3*sin(xi1))"]}]
    case = clamped("cylinder", ["xi2_min"], loads=loads)
    solution = solve(case, uniform(case, (8, 4)), 7, (0.5, 1e-3))[0].solution
    area = 2 * np.pi * 2 * 3
    force, moment = solution.reaction("clamp")
    assert force == pytest.approx([-0.05 * area, -0.15 * area, 0.2 * area], rel=1e-6)
    t, w = np.polynomial.legendre.leggauss(5)
    lines = solution.mesh.lines
    (x, weight), (y, weight_y) = (
        ((a[:-1, None] + np.diff(a)[:, None] * (t + 1) / 2).ravel(), (np.diff(a)[:, None] * w / 2).ravel())
        for a in lines
    )
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    arms = case.surface.position(points) + solution.displacement(points)
    density = np.stack(np.broadcast_arrays(0.05, 0.15, -0.2 * (1 + 0.3 * np.sin(points[..., 0]))), axis=-1)
    total = np.einsum("i,j,ijc->c", weight * 2.0, weight_y, np.cross(arms, density))
    assert moment == pytest.approx(-total, rel=1e-3, abs=1e-3 * np.abs(total).max())


def test_a_formula_can_not_move_a_clamp_at_finite_strain():
    case = clamped("cylinder", ["xi2_min"], {"kind": "value", "y": "t*0.1*sin(xi1)"})
    assert "can't move the clamped support 'clamp' by a formula" in FemSolver().declines(case)
    assert FemSolver().declines(clamped("cylinder", ["xi2_min"], turned())) is None


def test_a_clamp_that_turns_a_shell_about_a_point_only_moves_it():
    # neither force nor energy is left to compare rounding with: the path has to end all the same
    turned = catalog.named_case("rigid_turn_about_point").model_dump(mode="json", exclude_unset=True, exclude={"name"})
    (support,) = turned["supports"]
    case = build_case({**turned, "supports": [{**support, "on": ["xi1_min"], "clamped": True}]}, "test", "test")
    mesh = TensorMesh(case.surface.domain, (np.linspace(0, 1, 5), np.linspace(-0.5, 0.5, 5)))
    _, trail = solve(case, mesh, 7, (1 / 8, 1e-3))
    points = np.random.default_rng(0).uniform([0, -0.5], [1, 0.5], (20, 2))
    centre = np.array(support["motion"]["centre"])
    axis = np.array(support["motion"]["axis"]) / np.linalg.norm(support["motion"]["axis"])
    arms = case.surface.position(points) - centre
    for t in (0.5, 1.0):
        angle = np.radians(120 * t)  # Rodrigues' formula
        along = np.outer(arms @ axis, axis)
        exact = along + np.cos(angle) * (arms - along) + np.sin(angle) * np.cross(axis, arms) - arms
        assert np.allclose(trail.displacement(points, at=t), exact, atol=1e-11)
        assert sum(trail.energies(t)) < 1e-20
