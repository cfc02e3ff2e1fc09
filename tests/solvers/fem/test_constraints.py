"""Supports: satisfied along the whole edge, resolved at corners, and contradictions found."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.solvers.fem.mechanics.constraints import support_ties
from shellbench.solvers.fem.mechanics.loads import Loading
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from tests.solvers.fem.shells import EVERY_EDGE, shell

PUSH = {"kind": "area", "vector": ["1.0 + xi1", 0.5, "-2.0 + xi2"]}
COARSE = FemSettings(cells=(3, 3))
CLAMPED = [{"name": "rim", "on": EVERY_EDGE, "clamped": True}]


def solved(surface, supports, settings=COARSE, **fields):
    return FemSolver().solve(shell(surface, supports=supports, **fields), settings)


def along(solution, name, count=23):
    domain = solution.case.surface.domain
    edge = solution.case.places[name]
    running = 1 - edge.axis
    return edge.points(domain, np.linspace(domain.lower[running], domain.upper[running], count))


def tilt(solution, points, axis):
    """Return u,n . a3 with the unit conormal n of the edge, from first principles."""
    x = solution.case.surface.derivatives(points, 1)
    bases = np.stack([x[1, 0], x[0, 1]], axis=1)
    normal = np.cross(x[1, 0], x[0, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    tangent = bases[:, 1 - axis] / np.linalg.norm(bases[:, 1 - axis], axis=1, keepdims=True)
    conormal = np.cross(tangent, normal)
    contravariant = np.linalg.inv(bases @ np.swapaxes(bases, 1, 2)) @ bases
    parts = np.einsum("pai,pi->pa", contravariant, conormal)
    gradient = np.stack([solution.partial(points, d) for d in ((1, 0), (0, 1))], axis=1)
    return np.einsum("pa,pai,pi->p", parts, gradient, normal)


@pytest.mark.parametrize("surface", ["plane", "hypar", "helicoid"])
def test_held_edges_do_not_move_anywhere_and_others_do(surface):
    solution = solved(
        surface,
        [{"name": "a", "on": ["xi1_min"]}, {"name": "b", "on": ["xi2_max"], "components": ["x", "z"]}],
        loads=[PUSH],
    )
    largest = np.abs(solution.coefficients[:, :, 0]).max()
    assert np.abs(solution.displacement(along(solution, "xi1_min"))).max() <= 1e-13 * largest
    sliding = np.abs(solution.displacement(along(solution, "xi2_max"))).max(axis=0)
    assert sliding[[0, 2]].max() <= 1e-13 * largest
    assert sliding[1] > 1e-3 * largest
    assert np.abs(tilt(solution, along(solution, "xi1_min"), 0)).max() > 1e-3 * largest  # not clamped


@pytest.mark.parametrize("surface", ["plane", "hypar", "helicoid"])
def test_a_clamped_edge_does_not_turn_even_in_oblique_coordinates(surface):
    turned = []
    for n in (4, 8):
        solution = solved(surface, CLAMPED, FemSettings(cells=(n, n)), loads=[PUSH])
        size = np.abs(solution.coefficients[:, :, 1:3]).max()
        edge = solution.case.places["xi1_min"]
        nodes = solution.mesh.node_points[solution.mesh.edge_nodes(edge)]
        assert np.abs(tilt(solution, nodes, 0)).max() <= 1e-12 * size
        turned.append(np.sqrt(np.mean(tilt(solution, along(solution, "xi1_min", 200), 0) ** 2)) / size)
    # between the nodes the rotation about an edge whose normal turns is held weakly; without that it falls with
    # the first order only
    assert turned[1] <= turned[0] / 4 + 1e-12


@pytest.mark.long
def test_a_clamped_curved_shell_converges_with_order_four():
    """Nodal ties alone leave an error of first order, of 3e-4 here: see `shellbench.solvers.fem.mechanics.clamping`."""
    thick = {"youngs_modulus": 1e4, "poissons_ratio": 0.3, "thickness": 0.2}
    energies = [
        sum(solved("hypar", CLAMPED, FemSettings(cells=(n, n)), loads=[PUSH], material=thick).energies())
        for n in (4, 8, 16)
    ]
    assert np.log2((energies[1] - energies[0]) / (energies[2] - energies[1])) >= 3.3
    assert abs(energies[2] / energies[1] - 1) < 1e-4


@pytest.mark.parametrize("surface", ["hypar", "helicoid"])
def test_clamps_balance_the_loads(surface):
    case = shell(surface, supports=CLAMPED, loads=[PUSH])
    mesh = graded_mesh(case, (8, 8), 2.0)
    loads = Loading.on_mesh(case, mesh, Quadrature.of_order(mesh, 7), [1.0])
    solution = FemSolver().solve(case, FemSettings(cells=(8, 8)))
    force, moment = solution.reaction("rim")
    assert np.allclose(force, -loads.resultant[:3, 0], atol=1e-9 * np.abs(force).max())
    sample = case.surface.position(case.surface.domain.grid(9, 9)).reshape(-1, 3)
    centre = (sample.max(axis=0) + sample.min(axis=0)) / 2
    size = np.linalg.norm(sample - centre, axis=1).max()
    _, moment = solution.reaction("rim", centre)
    assert np.allclose(moment / size, -loads.resultant[3:, 0], atol=1e-4 * np.abs(force).max())


def test_a_clamp_resists_a_prescribed_turn_with_the_moment_of_its_energy():
    """The torque on a turned rim is the derivative of the energy with respect to the angle, here twice E / angle."""
    turn = {"kind": "rotation", "axis": [1.0, 0.3, 0.2], "centre": [0.1, 0.2, 0.0], "angle": 0.5}
    supports = [
        {"name": "fixed", "on": ["xi2_max"], "clamped": True},
        {"name": "turned", "on": ["xi2_min"], "clamped": True, "motion": turn},
    ]
    thick = {"youngs_modulus": 1e4, "poissons_ratio": 0.3, "thickness": 0.2}
    solution = solved("cylinder", supports, FemSettings(cells=(20, 10)), material=thick)
    _, moment = solution.reaction("turned", turn["centre"])
    axis = np.array(turn["axis"]) / np.linalg.norm(turn["axis"])
    assert moment @ axis * np.radians(0.5) == pytest.approx(2 * sum(solution.energies()), rel=1e-5)


def test_a_turning_rim_carries_its_normals_along():
    motion = {"kind": "rotation", "axis": [1.0, 2.0, 0.5], "centre": [0.3, 0.0, 0.1], "angle": 2.0}
    for surface in ("hypar", "cylinder"):
        edge = "xi2_min"
        solution = solved(
            surface, [{"name": "rim", "on": [edge], "clamped": True, "motion": motion}], FemSettings(cells=(10, 4))
        )
        # nothing else holds the shell: it must follow as a rigid body
        points = solution.mesh.node_points
        x = solution.case.surface.position(points)
        axis = np.array(motion["axis"]) / np.linalg.norm(motion["axis"])
        expected = np.radians(2.0) * np.cross(axis, x - np.array(motion["centre"]))
        assert np.abs(solution.displacement(points) - expected).max() < 2e-4 * np.abs(expected).max()


def test_prescribed_values_are_met_along_the_edge():
    motion = {"kind": "value", "x": 0, "y": "0.02*xi2*t", "z": "0.01*xi2**3 - 0.01*xi2"}
    solution = solved(
        "plane", [{"name": "a", "on": ["xi1_min"], "motion": motion}, {"name": "b", "on": ["xi1_max"], "clamped": True}]
    )
    points = along(solution, "xi1_min")
    y = points[:, 1]
    # the trace is cubic, so that a cubic motion is met exactly
    assert np.allclose(
        solution.displacement(points), np.stack([0 * y, 0.02 * y, 0.01 * (y**3 - y)], axis=1), atol=1e-16
    )


def test_motions_depend_on_the_load_factor():
    motion = {"kind": "translation", "vector": [0, 0, "0.1*t**2"]}
    quantities = [{"name": f"w{k}", "kind": "largest_displacement", "primary": k == 1, "at": k} for k in (1.0, 3.0)]
    quantities = [q | {"name": f"w{int(q['at'])}"} for q in quantities]
    solution = solved(
        "plane", [{"name": "a", "on": ["xi1_min"], "motion": motion, "clamped": True}], quantities=quantities
    )
    assert np.allclose(solution.displacement([1.7, 0.4], at=1.0), [0, 0, 0.1])
    assert np.allclose(solution.displacement([1.7, 0.4], at=3.0), [0, 0, 0.9])
    assert np.allclose(solution.displacement([1.7, 0.4]), [0, 0, 0.9])
    with pytest.raises(InputError, match="not at 2"):
        solution.displacement([1.7, 0.4], at=2.0)


def test_a_point_support_holds_its_point_alone():
    supports = [{"name": "wall", "on": ["xi1_min"], "clamped": True}, {"name": "pin", "on": ["p"], "components": ["z"]}]
    solution = solved("plane", supports, points={"p": [1.3, 0.6]}, loads=[PUSH])
    at = solution.displacement([1.3, 0.6])
    assert at[2] == 0
    assert abs(at[0]) > 0
    assert abs(solution.displacement([1.5, 0.6])[2]) > 0


def test_what_corners_say_twice_counts_once():
    supports = [{"name": n, "on": [n], "clamped": True} for n in EVERY_EDGE]
    for surface in ("plane", "hypar"):
        case = shell(surface, supports=supports)
        mesh = graded_mesh(case, (2, 2), 2.0)
        ties = support_ties(case, mesh, [1.0])
        free = ties.free.sum(axis=1).reshape(mesh.shape)
        assert free[1:-1, 1:-1].min() == 12
        assert np.all(free[0, 1:-1] == 4)  # u and u,t are held, and of the slopes those of the normal
        assert np.all(free[[0, 0, -1, -1], [0, -1, 0, -1]] == 2)
        assert np.allclose(ties.basis @ np.swapaxes(ties.basis, 1, 2), np.eye(12), atol=1e-13)


def test_contradictions_are_found_and_agreement_is_not_one():
    lifted = {"kind": "translation", "vector": [0, 0, 0.1]}
    first = {"name": "first", "on": ["xi1_min"]}
    with pytest.raises(InputError, match=r"'first' and 'second' contradict each other at \(xi1, xi2\) = \(0, 0\)"):
        solved("plane", [first, {"name": "second", "on": ["xi2_min"], "motion": lifted}])
    solved("plane", [first | {"motion": lifted}, {"name": "second", "on": ["xi2_min"], "motion": lifted}])


def test_a_slope_that_nodes_cannot_state_is_refused_in_one_sentence():
    supports = [
        {"name": "s", "on": ["xi1_min"], "components": ["x"], "clamped": True},
        {"name": "t", "on": ["xi1_max"]},
    ]
    with pytest.raises(InputError, match="on oblique lines, as at 'xi1_min'"):
        solved("hypar", supports)


def test_a_plane_of_symmetry_must_be_one():
    for surface, plane in (("plane", "y"), ("hypar", "x")):
        supports = [{"name": "mirror", "on": ["xi1_min"], "symmetry": plane}, {"name": "wall", "on": ["xi1_max"]}]
        with pytest.raises(
            InputError, match="'mirror': the shell does not cross the plane of symmetry along 'xi1_min'"
        ):
            solved(surface, supports)


def test_nodal_forces_are_shared_without_loss():
    supports = [{"name": n, "on": [n], "clamped": n.endswith("min")} for n in EVERY_EDGE]
    case = shell("hypar", supports=supports)
    ties = support_ties(case, graded_mesh(case, (2, 2), 2.0), [1.0])
    forces = (
        np.random.default_rng(0).normal(size=(len(ties.nodes), 12, 1)) * ties.sharing.holders.any(axis=1)[..., None]
    )
    assert np.allclose(ties.sharing.shares(forces).sum(axis=0), forces)


@pytest.mark.parametrize("tilt", [1e-13, 1e-9])
def test_supports_that_hold_the_same_but_for_rounding_share_a_corner_alike(tilt):
    def reaction(tilt):
        plane = {"kind": "expression", "x": "xi1", "y": "xi2", "z": f"{tilt}*xi1", "xi1": [0, 1], "xi2": [0, 1]}
        supports = [
            {"name": "a", "on": ["xi1_min", "xi1_max"], "components": ["normal"]},
            {"name": "b", "on": ["xi2_min", "xi2_max"], "components": ["z"]},
            {"name": "c", "on": ["xi1_min,xi2_min"], "components": ["x", "y"]},
            {"name": "d", "on": ["xi1_max,xi2_min"], "components": ["y"]},
        ]
        load = {"kind": "area", "vector": [0, 0, "-1.0 - xi1"]}
        return solved(plane, supports, loads=[load]).reaction("a")[0][2]

    assert reaction(tilt) == pytest.approx(reaction(0.0), rel=1e-6)


@pytest.mark.parametrize("alone", [False, True])
def test_a_support_bears_what_its_edges_do_and_half_of_a_force_at_a_corner(alone):
    # On a tilted plate with the strains e of its plane and the twist k resultants are the same everywhere. Alone, "a"
    # holds the normal, and all of the force at a corner where it meets an edge with a load.
    young, nu, h, width, k = 1e4, 0.3, 0.05, 1.0, 0.03
    first, second, normal = np.array([[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]])
    e = np.array([[-nu * 1e-3, 0], [0, 1e-3]] if alone else [[0.002, 0.0005], [0.0005, -0.001]])
    tension = young * h / (1 - nu**2) * (e + nu * (np.trace(e) * np.eye(2) - e))
    moved = np.stack([first, second], axis=1) @ e  # u = moved . xi + k xi1 xi2 normal
    motion = {
        c: f"({m[0]})*xi1 + ({m[1]})*xi2 + ({k * n})*xi1*xi2" for c, m, n in zip("xyz", moved, normal, strict=True)
    }
    held = {"components": ["normal"]} if alone else {"motion": {"kind": "value", **motion}}
    supports = [
        {"name": "a", "on": ["xi1_min"], **held},
        {"name": "b", "on": ["xi1_max", "xi2_max", "xi2_min"][: 3 - alone], "motion": {"kind": "value", **motion}},
    ]
    loads = [{"kind": "edge", "on": ["xi2_min"], "vector": list(-tension[1, 1] * second)}] if alone else []
    tilted = {"kind": "expression", "x": "xi1", "y": "0.8*xi2", "z": "0.6*xi2", "xi1": [0, 2], "xi2": [0, width]}
    solution = solved(tilted, supports, FemSettings(cells=(4, 4), degree=3), loads=loads)
    half = young * h**3 / (12 * (1 + nu)) * k  # of twice the twisting moment
    force, moment = solution.reaction("a", centre=second * width / 2)
    known = -width * (tension[0, 0] * first + tension[0, 1] * second) + alone * half * normal
    assert np.allclose(force, known, rtol=1e-9, atol=1e-12)
    assert np.allclose(moment, -(1 + alone / 2) * width * half * first, rtol=1e-9, atol=1e-12)


def test_a_mirror_that_oblique_lines_meet_is_declined():
    answered, declined = (catalog.named_case(f"guided_plate@{chart}") for chart in ("warped", "oblique"))
    assert FemSolver().declines(answered) is None
    assert "those at 'xi2_min' are oblique" in str(FemSolver().declines(declined))


def test_a_slope_held_alone_on_oblique_lines_is_declined_and_not_refused_later():
    declined, answered = (catalog.find_case(f"sheared_sleeve{variant}") for variant in ("@helical", "@warped"))
    assert "on oblique lines, as at 'xi1_min'" in str(FemSolver().declines(declined))
    assert FemSolver().declines(answered) is None
    # With the displacement along the normal held, oblique lines do no harm.
    assert FemSolver().declines(catalog.find_case("clamped_plate_uniform@oblique")) is None
