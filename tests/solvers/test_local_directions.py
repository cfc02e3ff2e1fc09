"""Supports and loads in directions that go with the shell: closed forms, and the same question in Cartesian words."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.posed.rigid import free_motions, rigid_modes
from shellbench.problems.shell.quantities.measure import load_density, measure_all
from shellbench.problems.shell.question.conditions import LOCAL
from shellbench.problems.shell.question.directions import in_space, local_directions
from shellbench.problems.shell.question.places import Edge
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.mechanics.kinematics import local_axes
from shellbench.solvers.fem.mechanics.loads import Loading
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.field.supports import concentrated_forces, force_density
from shellbench.solvers.ndf.published_solver import PublishedSolver
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver
from tests.solvers.fem.shells import EVERY_EDGE, EVERY_MOTION, SURFACES, shell

RADIUS, LENGTH, HEIGHT, YOUNG, NU = 1.0, 2.0, 0.01, 1e7, 0.3
TUBE = {"kind": "cylinder", "axis": "y", "radius": RADIUS, "closed": True, "xi1": [0, 360], "xi2": [0, LENGTH]}
STEEL = {"youngs_modulus": YOUNG, "poissons_ratio": NU, "thickness": HEIGHT}
RIMS = ["xi2_min", "xi2_max"]


def tube(**fields):
    common = {"material": STEEL, "points": {"rim": [0, LENGTH], "middle": [0, LENGTH / 2]}}
    return shell(TUBE, **{**common, **fields})


def along(name, point, direction):
    return {"name": name, "kind": "displacement", "points": [point], "direction": direction}


def solved(case, **settings):
    # local supports are solved in degree 3, and so is what they are held against
    return FemSolver().solve(case, FemSettings(degree=3, **settings))


def first(quantity):
    return {**quantity, "primary": True}


# --- what the words mean -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["plane", "helicoid", "hypar"])
@pytest.mark.parametrize("edge", EVERY_EDGE)
def test_directions_are_orthonormal_leave_the_surface_and_turn_as_fem_says(name, edge):
    case = shell(name)
    place = case.places[edge]
    assert isinstance(place, Edge)
    domain, running = case.surface.domain, 1 - place.axis
    points = place.samples(domain, 5)
    axes = local_directions(case.surface, points, place)
    assert axes @ np.swapaxes(axes, 1, 2) == pytest.approx(np.tile(np.eye(3), (5, 1, 1)), abs=1e-12)
    x = case.surface.derivatives(points, 1)
    assert np.all(np.sum(axes[:, 0] * x[(1, 0) if running == 0 else (0, 1)], axis=-1) > 0)
    outward = x[(1, 0) if place.axis == 0 else (0, 1)] * (1 if place.side == "max" else -1)
    assert np.all(np.sum(axes[:, 1] * outward, axis=-1) > 0)
    own, rates = local_axes(case.surface.derivatives(points, 2), place)
    assert own == pytest.approx(axes, abs=1e-12)
    step = np.zeros(2)
    step[running] = 1e-5
    ahead, behind = (local_directions(case.surface, points + s * step, place) for s in (1, -1))
    assert rates == pytest.approx((ahead - behind) / 2e-5, abs=1e-8)


@pytest.mark.parametrize(
    ("support", "words"),
    [
        ({"components": ["x", "normal"]}, "in part Cartesian"),
        ({"on": ["surface"], "components": ["normal"]}, "'normal' on 'surface'"),
        ({"on": ["middle"], "components": ["normal", "along"]}, "'along' on 'middle'"),
        ({"components": ["tangential"]}, "along"),
    ],
)
def test_what_has_no_such_direction_is_refused(support, words):
    with pytest.raises(InputError, match=words):
        tube(supports=[{"name": "s", "on": RIMS, **support}])


# --- supports ----------------------------------------------------------------------------------------------------


def test_a_rim_that_slides_along_itself_leaves_the_turn_about_the_axis():
    case = tube(supports=[{"name": "s", "on": RIMS, "components": ["normal", "across"]}],
                remove_rigid_motions=["rotation_y"])  # fmt: skip
    free = free_motions(case)
    assert free.shape == (6, 1)
    assert abs(free[EVERY_MOTION.index("rotation_y"), 0]) == pytest.approx(1)


def test_a_tube_under_pressure_minds_no_freedom_along_its_rims():
    """Axisymmetric, nothing moves along a rim, whether it could or not; there is none of x and z that says so."""
    quantities = [first(along("w", "middle", [1, 0, 0])), {"name": "energy", "kind": "strain_energy"}]
    loads = [{"kind": "pressure", "value": 100.0}]
    local = tube(supports=[{"name": "s", "on": RIMS, "components": ["normal", "across"]}],
                 remove_rigid_motions=["rotation_y"], loads=loads, quantities=quantities)  # fmt: skip
    held = tube(supports=[{"name": "s", "on": RIMS}], loads=loads, quantities=quantities)
    one, other = (measure_all(solved(case, max_unknowns=12_000)) for case in (local, held))
    assert one == pytest.approx(other, rel=1e-5)


def test_three_local_directions_are_all_directions():
    loads = [{"kind": "area", "vector": [1, 2, 3]}]
    edges = ["xi1_min", "xi2_max"]
    for clamped in (False, True):
        one, other = (
            shell("helicoid", loads=loads, supports=[{"name": "s", "on": edges, "components": c, "clamped": clamped}])
            for c in (["x", "y", "z"], list(LOCAL))
        )
        found = [measure_all(solved(case, cells=(6, 6)))["largest"] for case in (one, other)]
        assert found[1] == pytest.approx(found[0], rel=1e-8)


@pytest.mark.parametrize("theory", ["kirchhoff-love-linear", "kirchhoff-love-nonlinear"])
def test_a_local_support_is_the_cartesian_one_on_a_straight_edge(theory):
    loads = [{"kind": "area", "vector": ["0.1*t", "0.2*t", "0.3*t"]}]
    wall = {"name": "wall", "on": ["xi1_min"], "clamped": True}
    one, other = (
        shell(loads=loads, theory=theory, supports=[wall, {"name": "s", "on": ["xi1_max"], "components": c}])
        for c in (["z", "y"], ["normal", "along"])
    )
    found = [measure_all(solved(case, cells=(6, 6)))["largest"] for case in (one, other)]
    assert found[1] == pytest.approx(found[0], rel=1e-8)


def test_a_local_support_moves_by_its_part_of_the_motion():
    """A tube blown up by its rims: radial motion given in x and z, of which the rims take the normal part alone."""
    radial = {"kind": "value", "x": "1e-3*cos(xi1) - 7e-3*sin(xi1)", "z": "1e-3*sin(xi1) + 7e-3*cos(xi1)"}
    rims = {"name": "s", "on": RIMS, "components": ["normal"], "motion": radial}
    case = tube(supports=[rims, {"name": "level", "on": ["xi2_min"], "components": ["along", "across"]}],
                quantities=[first(along("x", "rim", [1, 0, 0])), along("z", "rim", [0, 0, 1])])  # fmt: skip
    found = measure_all(solved(case, cells=(6, 6)))
    assert found["x"] == pytest.approx(1e-3, rel=1e-6)
    assert found["z"] == pytest.approx(0, abs=1e-8)


# --- loads -------------------------------------------------------------------------------------------------------

SHEAR = 1000.0  # N/m along the rim


def twisted(**fields):
    """A tube, clamped at one rim and twisted by forces along the other one, which is held normal to itself."""
    wall = {"name": "wall", "on": ["xi2_min"]}
    guide = {"name": "guide", "on": ["xi2_max"], "components": ["normal"]}
    load = {"kind": "edge", "on": ["xi2_max"], "vector": [SHEAR, 0, 0], "frame": "local"}
    # xi1 grows from x toward z
    quantities = [first(along("turned", "rim", [0, 0, 1]))]
    return tube(**{"supports": [wall, guide], "loads": [load], "quantities": quantities, **fields})


def test_forces_along_a_rim_twist_a_tube():
    # Saint-Venant: the shear strain is SHEAR / (G h); bending stiffens by (h/R)^2 / 12 times a number of order one
    closed = SHEAR / (YOUNG / (2 * (1 + NU)) * HEIGHT) * LENGTH
    found = measure_all(solved(twisted(), max_unknowns=6000))["turned"]
    assert found == pytest.approx(closed, rel=10 * (HEIGHT / RADIUS) ** 2 / 12)
    field = RitzSolver().solve(twisted(supports=[{"name": "wall", "on": ["xi2_min"]}]), RitzSettings(neurons=150))
    assert measure_all(field)["turned"] == pytest.approx(closed, rel=1e-3)


def test_a_local_load_is_the_same_for_all_who_read_it():
    vector = ["1 + xi1", "2*xi2", 3]
    case = shell("hypar", loads=[{"kind": "area", "vector": vector, "frame": "local"},
                                 {"kind": "edge", "on": EVERY_EDGE, "vector": vector, "frame": "local"}])  # fmt: skip
    points = case.surface.domain.grid(3, 4).reshape(-1, 2)
    own = np.einsum("pk,pkc->pc", case.evaluate(vector, points)[0, 0], local_directions(case.surface, points))
    assert load_density(case, points, 1.0) == pytest.approx(own, abs=1e-12)
    assert force_density(case, points) == pytest.approx(own, abs=1e-12)
    at, forces = concentrated_forces(case, RuleSpec((2, 2), 3), np.zeros((0, 2)))
    start = 0
    for name in EVERY_EDGE:
        count = len(at) // len(EVERY_EDGE)
        here = slice(start, start + count)
        axes = local_directions(case.surface, at[here], case.places[name])
        parts = np.einsum("pc,pkc->pk", forces[here], axes)
        given = case.evaluate(vector, at[here])[0, 0]
        assert parts / parts[:, 2:] == pytest.approx(given / 3, rel=1e-12)
        start += count


@pytest.mark.parametrize("surface", ["plane", "hypar"])
def test_the_work_of_a_local_load_is_that_of_its_cartesian_one(surface):
    """In fem: on rigid motions, by an independent rule of integration."""
    vector = ["1 + xi1", "2*xi2", 3]
    case = shell(surface, loads=[{"kind": "edge", "on": EVERY_EDGE, "vector": vector, "frame": "local"}])
    mesh = graded_mesh(case, (6, 6), 1.0)
    found = Loading.on_mesh(case, mesh, Quadrature.of_order(mesh, 7), (1.0,)).resultant[:, 0]
    expected = np.zeros(6)
    x, w = np.polynomial.legendre.leggauss(30)
    for name in EVERY_EDGE:
        edge = case.places[name]
        low, up = edge.bounds(case.surface.domain)
        points = edge.points(case.surface.domain, low + (up - low) * (x + 1) / 2)
        speed = np.linalg.norm(case.surface.derivatives(points, 1)[(0, 1) if edge.axis == 0 else (1, 0)], axis=-1)
        force = in_space(case.surface, case.evaluate(vector, points)[0, 0], points, edge)
        expected += np.einsum("p,pc,pcm->m", w / 2 * (up - low) * speed, force, rigid_modes(case.surface, points)[0, 0])
    assert found == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


# --- variants and other solvers ------------------------------------------------------------------------------------


def local_shell():
    load = {"kind": "area", "vector": [1, "2 + xi2", 3], "frame": "local"}
    rim = {"kind": "edge", "on": ["xi1_max"], "vector": ["xi2", 1, 2], "frame": "local"}
    wall = {"name": "wall", "on": ["xi1_min"], "components": list(LOCAL), "clamped": True}
    guide = {"name": "guide", "on": ["xi2_max"], "components": ["across"]}
    surface = SURFACES["helicoid"]
    return shell(surface, loads=[load, rim], supports=[wall, guide])


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["axes", "turned", "units", "flipped", "stretched", "warped"])
def test_variants_carry_local_directions(name):
    case = local_shell()
    variant = catalog.variant_of(case, name)
    settings = {"cells": (8, 8), "grading": 1.0}
    one, other = (measure_all(solved(c, **settings))["largest"] * c.primary.factor for c in (case, variant))
    assert other == pytest.approx(one, rel=2e-3 if name == "warped" else 1e-6)  # on the same mesh, but for the warp


def test_edges_keep_their_local_loads_where_coordinates_change_places():
    case = local_shell()
    edges_only = case.model_copy(update={"loads": case.loads[1:]})
    variant = catalog.variant_of(edges_only, "swapped")
    one, other = (measure_all(solved(c, cells=(8, 8), grading=1.0))["largest"] for c in (edges_only, variant))
    assert other == pytest.approx(one, rel=1e-6)
    with pytest.raises(InputError, match="along xi1, which is another direction"):
        catalog.variant_of(case, "swapped")


@pytest.mark.parametrize("solver", [CstSolver(), PublishedSolver(), NdfSolver(), RitzSolver()])
def test_other_solvers_decline_local_supports(solver):
    said = solver.declines(tube(supports=[{"name": "s", "on": RIMS, "components": list(LOCAL)}]))
    assert said == "a support holds directions local to the shell, and this solver takes x, y and z only"


@pytest.mark.parametrize("solver", [CstSolver(), PublishedSolver()])
def test_other_solvers_decline_local_loads(solver):
    said = solver.declines(twisted(supports=[{"name": "wall", "on": ["xi2_min"]}]))
    assert said == "a load is local to the shell, and this solver takes loads along x, y and z only"
