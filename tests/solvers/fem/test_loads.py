"""Loads: their resultants are those of the integrals, whatever the mesh."""

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from shellbench.solvers.fem.assembly import Quadrature
from shellbench.solvers.fem.equilibrium import nodal_rigid_motions
from shellbench.solvers.fem.loads import Loading
from shellbench.solvers.fem.mesh import graded_mesh
from tests.solvers.fem.shells import MATERIAL, shell


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
    case, mesh, found = loading("hypar", loads, points={"p": [0.2, -0.3]})
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
    case, mesh, found = loading("cylinder", [load], points={"p": [angle, 1], "q": [180, 3]})
    assert np.allclose(force(found), [2, 4, 6])
    assert np.allclose(found.nodal[mesh.node_at(case.places["p"].xi), ::4, 0], [1, 2, 3])
    assert np.count_nonzero(np.abs(found.nodal) > 1e-9) == 6


def test_loads_follow_the_load_factor():
    case = shell(loads=[{"kind": "area", "vector": [0, 0, "xi1*t**2"]}])
    mesh = graded_mesh(case, (2, 2), 2.0)
    found = Loading.on_mesh(case, mesh, Quadrature.of_order(mesh, 7), [1.0, 3.0])
    assert np.allclose(found.nodal[..., 1], 9 * found.nodal[..., 0])
    assert found.resultant[2, 0] == pytest.approx(2.0)
