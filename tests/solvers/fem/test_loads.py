"""Loads: their resultants are those of the integrals, whatever the mesh.

Edge moments: an angle without bounds, its two derivatives, and no work on a closed path.
"""

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import rotation_matrix
from shellbench.problems.shell.question.conditions import Rotation
from shellbench.solvers.fem.algebra.block_matrix import NEIGHBOURS, NODE_DOFS, BlockMatrix, neighbour_columns
from shellbench.solvers.fem.linear.equilibrium import nodal_rigid_motions
from shellbench.solvers.fem.mechanics.loads import Loading, edge_moments
from shellbench.solvers.fem.mesh.basis import KINDS
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.solvers.fem.shells import EVERY_EDGE, MATERIAL, MEAN, shell


def loading(surface, loads, cells=(6, 6), **fields):
    case = shell(surface, loads=loads, **fields)
    mesh = graded_mesh(case, cells, 2.0)
    return case, mesh, Loading.on_mesh(case, mesh, Quadrature.of_order(mesh, 7), [1.0])


def force(loads):
    return loads.resultant[:3, 0]


def test_nodal_forces_and_resultants_do_the_same_work():
    loads = [
        {"kind": "area", "vector": ["xi1", 0.2, "-xi2"]},
        {"kind": "pressure", "value": "1 + xi1*xi2"},
        {"kind": "edge", "on": ["xi1_max", "xi2_min"], "vector": [0, "xi2", 1]},
        {"kind": "point", "on": ["p"], "force": [1, 2, 3]},
    ]
    case, mesh, found = loading("hypar", loads, points={"p": [0.2, -0.3]}, quantities=[MEAN])
    work = np.einsum("ndm,nds->ms", nodal_rigid_motions(case, mesh), found.nodal)
    assert np.allclose(work, found.resultant, rtol=1e-12, atol=1e-12)  # bicubics hold the motions of a hypar exactly


def test_gravity_weighs_the_area():
    # helicoid: |a1 x a2|^2 = (1 + c^2) r^2 + p^2, with c = 0.2 the slope of its generators
    _, _, found = loading("helicoid", [{"kind": "gravity", "acceleration": [0, 0, -9.81]}])
    length = quad(lambda r: np.sqrt(1.04 * r**2 + 0.4**2), 0.5, 2.0)[0]
    weight = MATERIAL["areal_density"] * 9.81 * length * np.radians(150)
    assert np.allclose(force(found), [0, 0, -weight], rtol=1e-9)


def test_pressure_acts_along_a1_x_a2():
    # of the hypar x = (xi1 + .3 xi2, xi2, xi1 xi2 / 1.5): a1 x a2 = (-xi2, .3 xi2 - xi1, 1.5) / 1.5
    _, _, found = loading("hypar", [{"kind": "pressure", "value": "2 + xi2"}])
    expected = [dblquad(lambda s, r, k=k: (2 + s) * (-s, 0.3 * s - r, 1.5)[k] / 1.5, -1, 1, -1, 1)[0] for k in range(3)]
    assert np.allclose(force(found), expected, rtol=1e-12)


def test_pressure_inside_a_closed_shell_is_in_balance():
    _, _, found = loading("torus", [{"kind": "pressure", "value": 3.0}], cells=(8, 8))
    assert found.magnitude.max() > 10
    assert np.abs(found.resultant).max() < 1e-9 * found.magnitude.max()


def test_edge_loads_weigh_the_length():
    # the helicoid's outer edge: length sqrt(r^2 + p^2) per radian
    _, _, found = loading("helicoid", [{"kind": "edge", "on": ["xi1_max"], "vector": [0, 0, "xi2"]}])
    assert np.allclose(force(found), [0, 0, np.sqrt(4 + 0.16) * np.radians(150) ** 2 / 2], rtol=1e-12)


@pytest.mark.parametrize("angle", [0, 77, 360])
def test_point_forces_arrive_whole(angle):
    load = {"kind": "point", "on": ["p", "q"], "force": [1, "2*t", 3]}
    case, mesh, found = loading("cylinder", [load], points={"p": [angle, 1], "q": [180, 3]}, quantities=[MEAN])
    assert np.allclose(force(found), [2, 4, 6])
    assert np.allclose(found.nodal[mesh.node_at(case.places["p"].xi), ::4, 0], [1, 2, 3])
    assert np.count_nonzero(np.abs(found.nodal) > 1e-9) == 6


def test_loads_follow_the_load_factor():
    case = shell(loads=[{"kind": "area", "vector": [0, 0, "xi1*t**2"]}])
    mesh = graded_mesh(case, (2, 2), 2.0)
    found = Loading.on_mesh(case, mesh, Quadrature.of_order(mesh, 7), [1.0, 3.0])
    assert np.allclose(found.nodal[..., 1], 9 * found.nodal[..., 0])
    assert found.resultant[2, 0] == pytest.approx(2.0)


STRIP = {"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]}
ROOF = {"kind": "cylinder", "axis": "y", "radius": 2.0, "xi1": [40, 140], "xi2": [0, 3]}
TWIST = {
    "kind": "expression", "x": "xi1 + 0.3*xi2", "y": "xi2", "z": "xi1*xi2/c",
    "xi1": [-1, 1], "xi2": [-1, 1], "constants": {"c": 1.5},
}  # fmt: skip
SHELLS = [(STRIP, "xi1_max", (0, -1, 0)), (ROOF, "xi1_min", (0, 1, 0)), (ROOF, "xi2_max", (1, 0.2, 0.1)), (TWIST, "xi2_min", (1, 1, 0))]  # fmt: skip


def moment_on(surface=STRIP, edge="xi1_max", axis=(0, -1, 0), value="3*t", cells=(4, 3)):
    """Return the mesh and the one edge moment of a case."""
    load = {"kind": "moment", "on": [edge], "axis": list(axis), "value": value}
    case = shell(surface, theory="kirchhoff-love-nonlinear", loads=[load])
    domain = case.surface.domain
    lines = [np.linspace(low, high, n + 1) for low, high, n in zip(domain.lower, domain.upper, cells, strict=True)]
    mesh = TensorMesh(domain, (lines[0], lines[1]))
    (moment,) = edge_moments(case, mesh)
    return mesh, moment


def random_displacement(mesh, size=0.05, seed=0):
    return np.random.default_rng(seed).uniform(-size, size, (mesh.node_count, NODE_DOFS))


def turned(mesh, surface, axis, degrees):
    """Return the degrees of freedom of a rigid rotation."""
    turn = rotation_matrix(Rotation(kind="rotation", axis=axis, angle=degrees), degrees, linear=False) - np.eye(3)
    x = surface.derivatives(mesh.domain.wrap(mesh.node_points), 2)
    nodal = np.stack([x[kind] @ turn.T for kind in KINDS], axis=-1) * mesh.node_scales[:, None, :]
    return nodal.reshape(mesh.node_count, NODE_DOFS)


def work(moment, q, t, near):
    return float(moment.moments(t) @ moment.angles(q, near))


@pytest.mark.parametrize("degrees", [30.0, -75.0, 179.0])
@pytest.mark.parametrize(("surface", "edge", "axis"), SHELLS)
def test_a_rotation_about_the_axis_turns_every_normal_by_its_angle(surface, edge, axis, degrees):
    mesh, moment = moment_on(surface, edge, axis)
    angles = moment.angles(turned(mesh, moment.case.surface, axis, degrees), np.zeros(len(moment.points)))
    # by the right hand; the interpolant of a curved surface turns its normals almost by that
    assert np.allclose(angles, np.radians(degrees), atol=1e-12 if surface is not ROOF else 3e-3)


def test_the_angle_is_followed_past_half_turns_and_full_turns():
    mesh, moment = moment_on()
    for direction in (1, -1):
        near = np.zeros(len(moment.points))
        for degrees in np.arange(0, 1000, 35):
            near = moment.angles(turned(mesh, moment.case.surface, (0, -1, 0), direction * float(degrees)), near)
            assert np.allclose(near, direction * np.radians(degrees), atol=1e-11)
    # a state that has turned half way round more is another angle, but the same forces
    q = turned(mesh, moment.case.surface, (0, -1, 0), 40.0)
    first, later = (moment.angles(q, np.full(len(moment.points), near)) for near in (0.0, 4 * np.pi))
    assert np.allclose(later - first, 4 * np.pi, atol=1e-12)


def test_the_share_of_the_edge_is_its_length_whatever_the_coordinates():
    for surface, edge, length in (
        (STRIP, "xi1_max", 1.0),
        (ROOF, "xi1_min", 3.0),
        (ROOF, "xi2_max", 2 * np.radians(100)),
    ):
        _, moment = moment_on(surface, edge, (1, 0, 0), value="3*t")
        assert moment.moments(0.5).sum() == pytest.approx(1.5 * length, rel=1e-12)
    _, moment = moment_on(value="t*xi2**2")
    assert moment.moments(2.0).sum() == pytest.approx(2 / 3, rel=1e-13)


@pytest.mark.parametrize(("surface", "edge", "axis"), SHELLS)
@pytest.mark.parametrize("degrees", [0.0, 120.0])
def test_forces_are_the_gradient_of_the_work(surface, edge, axis, degrees):
    mesh, moment = moment_on(surface, edge, axis)
    q = turned(mesh, moment.case.surface, axis, degrees) + random_displacement(mesh)
    near, h, t = moment.angles(q, np.full(len(moment.points), np.radians(degrees))), 1e-4, 0.7
    forces = moment.forces(q, t)
    for seed in range(4):
        step = random_displacement(mesh, 1.0, seed=seed + 1)
        w = {k: work(moment, q + k * h * step, t, near) for k in (-2, -1, 1, 2)}
        expected = (8 * (w[1] - w[-1]) - (w[2] - w[-2])) / (12 * h)
        assert np.sum(forces * step) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(("surface", "edge", "axis"), SHELLS)
@pytest.mark.parametrize("degrees", [0.0, 120.0])
def test_the_tangent_is_the_derivative_of_the_forces_and_symmetric(surface, edge, axis, degrees):
    mesh, moment = moment_on(surface, edge, axis)
    q, t, h = turned(mesh, moment.case.surface, axis, degrees) + random_displacement(mesh), 0.7, 1e-4
    step = random_displacement(mesh, 1.0, seed=9)
    matrix = BlockMatrix(np.zeros((mesh.node_count, len(NEIGHBOURS), NODE_DOFS, NODE_DOFS)), neighbour_columns(mesh))
    moment.add_tangent(matrix, q, t)
    f = {k: moment.forces(q + k * h * step, t) for k in (-2, -1, 1, 2)}
    expected = -(8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * h)
    assert np.abs(expected).max() > 0.1
    assert np.allclose((matrix @ step[..., None])[..., 0], expected, atol=1e-7 * np.abs(expected).max())
    sparse = matrix.to_csr()
    assert np.abs(sparse - sparse.T).max() <= 1e-14 * np.abs(sparse).max()


@pytest.mark.parametrize(("surface", "edge", "axis"), SHELLS)
def test_a_closed_path_takes_no_work(surface, edge, axis):
    """The line integral of the forces round a loop of large displacements vanishes: a moment about a fixed axis that
    followed its material slope, or acted on a rotation vector, would not."""
    mesh, moment = moment_on(surface, edge, axis, cells=(2, 2))
    first, second = (random_displacement(mesh, 0.15, seed=s) for s in (1, 2))
    phases = 2 * np.pi * np.arange(400) / 400  # the trapezoidal rule on a period converges like no other
    total = largest = 0.0
    for phase in phases:
        q = first * np.cos(phase) + second * np.sin(phase)
        rate = second * np.cos(phase) - first * np.sin(phase)
        power = float(np.sum(moment.forces(q, 1.0) * rate))
        total += power * 2 * np.pi / len(phases)
        largest = max(largest, abs(power))
    assert largest > 0.1
    assert abs(total) <= 1e-8 * largest


def test_a_full_turn_takes_the_work_of_the_moment_times_a_full_turn():
    """Rolled by the forces themselves: the angle is no function of the position, only its change is."""
    mesh, moment = moment_on()
    phases = np.linspace(0, 360, 721)
    total = 0.0
    middles = np.radians((phases[1:] + phases[:-1]) / 2)
    for degrees in np.degrees(middles):
        q = turned(mesh, moment.case.surface, (0, -1, 0), float(degrees))
        ahead, behind = (turned(mesh, moment.case.surface, (0, -1, 0), float(degrees) + s) for s in (1e-4, -1e-4))
        total += float(np.sum(moment.forces(q, 1.0) * (ahead - behind))) / 2e-4 * (phases[1] - phases[0])
    assert total == pytest.approx(3.0 * 1.0 * 2 * np.pi, rel=1e-6)


def test_every_edge_of_a_load_is_its_own_moment():
    load = {"kind": "moment", "on": EVERY_EDGE, "axis": [1, 1, 0], "value": "t"}
    case = shell(STRIP, theory="kirchhoff-love-nonlinear", loads=[load, load | {"on": ["xi1_min"]}])
    mesh = TensorMesh(case.surface.domain, (np.linspace(0, 2, 4), np.linspace(0, 1, 3)))
    assert [len(m.nodes) for m in edge_moments(case, mesh)] == [2, 2, 3, 3, 2]


# in linear theory


def strip(supports, moments, removed=()):
    loads = [{"kind": "moment", "on": [edge], "axis": [0, -1, 0], "value": value} for edge, value in moments]
    fields = {"remove_rigid_motions": list(removed)} if removed else {}
    material = MATERIAL | {"poissons_ratio": 0.0}
    return shell(STRIP, supports=supports, loads=loads, material=material, **fields)


def test_an_end_moment_bends_a_cantilever_into_a_parabola():
    case = strip([{"name": "wall", "on": ["xi1_min"], "clamped": True}], [("xi1_max", 0.01)])
    solution = FemSolver().solve(case, FemSettings(cells=(2, 1)))
    stiffness = MATERIAL["youngs_modulus"] * MATERIAL["thickness"] ** 3 / 12
    x = np.linspace(0, 2, 7)
    found = solution.displacement(np.stack([x, 0.4 + 0 * x], axis=-1))
    assert np.allclose(found, np.outer(0.01 * x**2 / 2 / stiffness, [0, 0, 1]), rtol=0, atol=1e-11)
    force, moment = solution.reaction("wall")
    assert np.allclose(force, 0, atol=1e-12)
    assert np.allclose(moment, [0, 0.01, 0], atol=1e-12)  # against the load's -y
    assert sum(solution.energies()) == pytest.approx(0.01**2 * 2 / 2 / stiffness, rel=1e-11)


def test_moments_on_a_free_strip_are_in_balance_or_refused():
    loose = ["rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z"]
    balanced = strip([], [("xi1_max", 0.01), ("xi1_min", -0.01)], loose)
    solution = FemSolver().solve(balanced, FemSettings(cells=(2, 1)))
    stiffness = MATERIAL["youngs_modulus"] * MATERIAL["thickness"] ** 3 / 12
    ends = solution.displacement([[0, 0.5], [1, 0.5], [2, 0.5]])[:, 2]
    assert ends[0] + ends[2] - 2 * ends[1] == pytest.approx(0.01 / stiffness, rel=1e-9)  # curvature times 1^2
    with pytest.raises(SolveFailure, match="the loads are not in balance"):
        FemSolver().solve(strip([], [("xi1_max", 0.01)], loose), FemSettings(cells=(2, 1)))
