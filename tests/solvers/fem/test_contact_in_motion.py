"""Contact in motion by fem: its laws at points, the points, and supports beside an obstacle."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.motion.contact_balance import Balance
from shellbench.solvers.fem.motion.contact_in_motion import TouchingPoints
from shellbench.solvers.fem.motion.time_step import mass_matrix
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver


def test_forces_among_points_obey_signorini_and_coulomb():
    random, count = np.random.default_rng(0), 12
    root = random.normal(size=(3 * count, 3 * count))
    compliance = (root @ root.T + 3 * count * np.eye(3 * count)).reshape(count, 3, count, 3)
    normal = random.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    friction = np.where(np.arange(count) < 8, 0.3, 0.0)
    gap, slip = random.normal(size=count), 0.3 * random.normal(size=(count, 3))
    small = Balance(compliance, normal, friction, gap, slip, 1e-12)
    forces = small.forces(np.zeros((count, 3)))
    moved = np.einsum("iajb,jb->ia", compliance, forces)
    pressure, open_ = np.sum(forces * normal, axis=-1), gap + np.sum(moved * normal, axis=-1)
    assert min(open_.min(), pressure.min()) > -1e-9
    assert np.abs(open_ * pressure).max() < 1e-9
    rubbing, way = small._tangential_parts(forces), small._tangential_parts(slip + moved)
    size, limit = np.linalg.norm(rubbing, axis=-1), friction * pressure
    assert np.all(size <= limit + 1e-9)
    slips = (pressure > 0) & (np.linalg.norm(way, axis=-1) > 1e-9) & (friction > 0)
    sticks = (pressure > 0) & ~slips & (friction > 0)
    assert all(np.any(kind) for kind in (slips, sticks, pressure == 0))
    heading = way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-30)
    np.testing.assert_allclose(rubbing[slips], -(limit[:, None] * heading)[slips], atol=1e-5)


@pytest.mark.parametrize("cells", [(1, 1), (2, 3)])
def test_points_press_evenly_and_leave_no_freedom(cells):
    case = catalog.named_case("contact_patch_slides")
    domain = case.surface.domain
    mesh = TensorMesh(domain, tuple(np.linspace(domain.lower[k], domain.upper[k], cells[k] + 1) for k in (0, 1)))
    points = TouchingPoints.on_mesh(case, mesh)
    even = points.nodal_forces(np.prod(points.lengths, axis=-1)[:, None] * np.ones(3))
    mass = mass_matrix(case, mesh, Quadrature.of_order(mesh, 7))
    ones = np.zeros((mesh.node_count, 12, 1))
    ones[:, ::4] = 1 / case.material.areal_density
    np.testing.assert_allclose(even, (mass @ ones)[..., 0], atol=1e-15)
    freedom = np.prod(2 * np.array(cells) + 2)
    assert np.linalg.matrix_rank(points.operator.toarray()) == 3 * (freedom if min(cells) > 1 else 9)


def test_a_floor_and_a_hinge_share_what_lies_on_both():
    given = tomllib.loads((Path(__file__).parents[3] / "cases/contact_patch_falls.toml").read_text(encoding="utf-8"))
    given["obstacles"][0]["centre"] = [0, 0, 0]
    given["dynamics"]["until"] = 0.1
    given["supports"] = [{"name": "hinge", "on": ["xi1_min"], "components": ["x", "y", "z"]}]
    given["quantities"] = [
        {"name": "floor", "kind": "contact_force", "direction": [0, 0, 1], "at": 0.1, "primary": True},
        {"name": "hinge", "kind": "reaction", "support": "hinge", "direction": [0, 0, 1], "at": 0.1},
    ]
    case = build_case(given, "lying", "lying")
    hinge = []
    for cells in ((2, 1), (4, 1)):
        found = measure_all(FemSolver().solve(case, FemSettings(cells=cells, time_step=0.02)))
        assert found["floor"] + found["hinge"] == pytest.approx(0.08, rel=1e-6)  # the weight: nothing bends
        hinge.append(found["hinge"])
    assert hinge[1] == pytest.approx(hinge[0] / 2, rel=1e-3)  # what lies on its edge: a share of the cells there


def test_others_decline_what_they_leave_out():
    """Fields obstacles in motion, the mesh of triangles their friction."""
    assert "obstacles" in RitzSolver().declines(catalog.named_case("contact_patch_falls"))
    assert "friction" in CstSolver().declines(catalog.named_case("contact_patch_slides"))
