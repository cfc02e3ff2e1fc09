"""Shells of revolution: which cases are, by how much a cell turns, and the direction in which a state's waves travel."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shellbench.bench.catalogue import catalog
from shellbench.solvers.fem.mechanics.rigid_motions import Revolution
from shellbench.solvers.fem.mechanics.strain_energy import StrainEnergy
from shellbench.solvers.fem.mesh.basis import KINDS
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from tests.solvers.fem.shells import CYLINDER, LARGEST, shell, uniform

TWIST = catalog.named_case("sleeve_twist")
RIMS = [{"name": "rims", "on": ["xi2_min", "xi2_max"], "clamped": True}]


def tube(surface=CYLINDER, supports=RIMS, **fields):
    fields = {"theory": "kirchhoff-love-nonlinear", "quantities": [LARGEST | {"at": 1.0}], **fields}
    return shell(surface, supports=supports, **fields)


def of(case, cells=(8, 3)):
    return Revolution.from_case(case, uniform(case, cells))


def moved(kind, **fields):
    return [{"name": "rims", "on": ["xi2_max"], "clamped": True, "motion": {"kind": kind, **fields}}]


# what is one


@pytest.mark.parametrize("name", ["sleeve_twist", "sleeve_compression"])
def test_the_sleeve_is_one_about_its_axis(name):
    """x = (R cos xi1, xi2, R sin xi1) is turned about -y as xi1 grows."""
    case = catalog.named_case(name)
    found = Revolution.from_case(case, graded_mesh(case, (4, 2), 2.0))
    cells = found.mesh.cells[0]
    assert np.allclose(found.turn, Rotation.from_euler("y", -360 / cells, degrees=True).as_matrix(), atol=1e-12)


CONE = {"x": "3 + (2 - 0.3*xi2)*cos(xi1)", "y": "(2 - 0.3*xi2)*sin(xi1)", "z": "xi2 - 7"}
OVAL = {"x": "2*cos(xi1)", "y": "1.9*sin(xi1)", "z": "xi2"}
UNEVEN = {"x": "2*cos(xi1 + 0.1*sin(xi1))", "y": "2*sin(xi1 + 0.1*sin(xi1))", "z": "xi2"}


def expression(rows):
    return {"kind": "expression", "xi1": [0, 360], "xi2": [0, 3], "angles": ["xi1"], "periodic": ["xi1"], **rows}


def test_its_axis_lies_anywhere():
    found = of(tube(expression(CONE)))
    assert np.allclose(found.turn, Rotation.from_euler("z", 45, degrees=True).as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    "case",
    [
        tube(CYLINDER | {"closed": False, "xi1": [0, 180]}),
        tube(expression(OVAL)),
        tube(expression(UNEVEN)),
        tube("plane", [{"name": "e", "on": ["xi2_min"], "clamped": True}]),
        tube(loads=[{"kind": "area", "vector": [0, 0, "t"]}]),
        tube(supports=[*RIMS, {"name": "pin", "on": ["p"], "components": ["x"]}], points={"p": [90, 1.5]}),
        tube(supports=[{"name": "top", "on": ["xi2_max"]}, {"name": "low", "on": ["xi2_min"], "components": ["x"]}]),
        tube(supports=moved("translation", vector=["0.1*t", 0, 0])),
        tube(supports=moved("rotation", axis=[1, 0, 0], angle="10*t")),
        tube(supports=moved("rotation", axis=[0, 1, 0], centre=[0.1, 0, 0], angle="10*t")),
    ],
    ids=[
        "half open", "oval", "uneven coordinates", "a plane", "a load", "a pin", "components", "pushed across", "bent",
        "turned about another axis",
    ],
)  # fmt: skip
def test_what_is_none(case):
    assert of(case) is None


def test_on_a_mesh_that_is_not_uniform_around_it_is_none():
    domain = TWIST.surface.domain
    lines = np.linspace(0, 1, 9) ** 1.2 * 2 * np.pi, np.linspace(0, 1, 4)
    assert Revolution.from_case(TWIST, TensorMesh(domain, lines)) is None
    along = np.linspace(0, 2 * np.pi, 9), np.array([0, 0.1, 0.7, 1.0])
    assert Revolution.from_case(TWIST, TensorMesh(domain, along)) is not None


@pytest.mark.parametrize(
    "supports",
    [
        RIMS,
        moved("translation", vector=[0, "-0.1*t", 0]),
        moved("rotation", axis=[0, 2, 0], angle="10*t"),
        moved("rotation", axis=[0, 1, 0], centre=[0, 5, 0], angle="10*t"),
    ],
    ids=["held", "pushed along", "twisted", "twisted about a point of the axis"],
)
def test_what_the_rims_may_do(supports):
    assert of(tube(supports=supports)) is not None


# its direction


def waves(found, count=3, turn=0.0):
    """Return the interpolant (nodes, 12) of waves of normal and other displacements, turned around the y axis by a bit."""
    mesh = found.mesh
    phi, y = (mesh.domain.wrap(mesh.node_points) - [turn, 0]).T
    size = mesh.domain.size[1]
    values = np.zeros((mesh.node_count, 3, 4))
    profile, rise = np.sin(np.pi * y / size) ** 2, np.pi / size * np.sin(2 * np.pi * y / size)
    twist = count * phi + 2 * y
    c, s = np.cos(mesh.node_points[:, 0]), np.sin(mesh.node_points[:, 0])
    f, f1, f2, f12 = (
        np.cos(twist), -count * np.sin(twist), -2 * np.sin(twist), -2 * count * np.cos(twist),
    )  # fmt: skip
    w = {
        (0, 0): f * profile, (1, 0): f1 * profile, (0, 1): f2 * profile + f * rise, (1, 1): f12 * profile + f1 * rise,
    }  # fmt: skip
    for kind in KINDS:
        i, j = kind
        lower = w[0, j]
        values[:, 0, KINDS.index(kind)] = w[kind] * c - (lower * s if i else 0)
        values[:, 2, KINDS.index(kind)] = w[kind] * s + (lower * c if i else 0)
        values[:, 1, KINDS.index(kind)] = 0.3 * w[kind]
    return (0.1 * values * mesh.node_scales[:, None, :]).reshape(-1, 12)


@pytest.mark.parametrize("name", ["sleeve_twist", "sleeve_compression"])
def test_it_is_tangent_to_the_orbit(name):
    """The difference between waves turned on and back by a cell, and by a hundredth of one, are parallel."""
    case = catalog.named_case(name)
    found = of(case, (24, 3))
    q = waves(found)
    step = 2 * np.pi / 24
    direction = found.wave_direction(q)
    far = waves(found, turn=step) - waves(found, turn=-step)
    assert np.allclose(direction, far, rtol=0, atol=1e-12)
    near = waves(found, turn=step / 100) - waves(found, turn=-step / 100)
    cosine = np.sum(direction * near) / np.linalg.norm(direction) / np.linalg.norm(near)
    assert cosine > 0.999


def test_a_turn_by_a_cell_costs_no_energy():
    """Turn the shell node by node; the direction is the difference of two such turns."""
    found = of(TWIST)
    energy = StrainEnergy(found.mesh, TWIST.surface, TWIST.material, Quadrature.of_order(found.mesh, 7))
    q = np.random.default_rng(0).uniform(-0.02, 0.02, (found.mesh.node_count, 12))
    numbers = np.arange(found.mesh.node_count)
    points = found.mesh.node_points
    turned = {}
    for sign in (1, -1):
        turn = Rotation.from_euler("y", -sign * 45, degrees=True).as_matrix()
        shifted = (points - [sign * np.pi / 4, 0]) % [2 * np.pi, 10]
        source = [int(np.argmin(np.linalg.norm(np.exp(1j * points[:, :1]) - np.exp(1j * p[0]), axis=-1) + np.abs(points[:, 1] - p[1])))
                  for p in shifted]  # fmt: skip
        assert sorted(source) == list(numbers)
        turned[sign] = np.einsum("cd,ndk->nck", turn, q.reshape(-1, 3, 4)[source]).reshape(-1, 12)
        assert energy.deform(turned[sign]).energy == pytest.approx(energy.deform(q).energy, rel=1e-12)
    assert np.allclose(found.wave_direction(q), turned[1] - turned[-1], rtol=0, atol=1e-14)


def test_a_symmetric_state_has_none():
    found = of(TWIST)
    points = found.mesh.node_points
    values = np.zeros((found.mesh.node_count, 3, 4))
    values[:, 0, 0], values[:, 2, 0] = 0.01 * np.cos(points[:, 0]), 0.01 * np.sin(points[:, 0])
    values[:, 1, 0] = 0.03 * points[:, 1]
    assert found.wave_direction(values.reshape(-1, 12)) is None
    assert found.wave_direction(np.zeros((found.mesh.node_count, 12))) is None
    values[3, 0, 0] += 1e-4
    assert found.wave_direction(values.reshape(-1, 12)) is not None
