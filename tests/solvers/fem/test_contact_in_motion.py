"""Contact in motion by fem: forces and tangent are derivatives, and supports beside an obstacle carry their share."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shellbench.bench import catalog
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.measure import measure_all
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.fem.assembly import Quadrature
from shellbench.solvers.fem.contact import ContactPoints
from shellbench.solvers.fem.contact_in_motion import APART, SLIPS, STICKS, StepContact
from shellbench.solvers.fem.mesh import TensorMesh
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.fem.time_step import mass_matrix
from shellbench.solvers.ndf.ritz_solver import RitzSolver


@pytest.fixture(scope="module")
def pressed():
    """A patch that is half in its obstacle: points apart, that slip, and that stick; and where it is."""
    case = catalog.named_case("contact_patch_slides")
    domain = case.surface.domain
    mesh = TensorMesh(domain, tuple(np.linspace(domain.lower[k], domain.upper[k], 3) for k in (0, 1)))
    random = np.random.default_rng(0)
    points = ContactPoints.on_mesh(case, mesh)
    q = 1e-3 * random.normal(size=(mesh.node_count, 12))
    count = len(points.points)
    contact = StepContact.on_step(points, (0.1, 0.12), q, (random.uniform(0.5, 1, count), np.zeros((count, 3))))
    contact = replace(contact, stiffness=1e3, traction=contact._along(0.1 * random.normal(size=(count, 3))))
    moved = q + 1e-3 * random.normal(size=q.shape)
    assert set(contact.at(moved).status) == {APART, SLIPS, STICKS}
    return contact, moved


def test_forces_are_the_slope_of_the_energy_and_the_tangent_is_theirs(pressed):
    contact, q = pressed
    way = np.random.default_rng(1).normal(size=q.shape)
    small = 1e-9
    ahead, behind = contact.at(q + small * way), contact.at(q - small * way)
    forces = contact.nodal(contact.at(q))
    assert (ahead.energy - behind.energy) / (2 * small) == pytest.approx(-np.sum(forces * way), rel=1e-5)
    mesh = contact.points.mesh
    matrix = mass_matrix(contact.points.case, mesh, Quadrature.of_order(mesh, 7))
    matrix = replace(matrix, blocks=np.zeros_like(matrix.blocks))
    contact.add_stiffness(matrix, contact.at(q), 1.0)
    change = (contact.nodal(ahead) - contact.nodal(behind)) / (2 * small)
    found = (matrix @ way[..., None])[..., 0]
    np.testing.assert_allclose(found, -change, atol=1e-4 * np.abs(change).max())


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
    found = measure_all(FemSolver().solve(case, FemSettings(cells=(1, 1), time_step=0.02)))
    assert found["floor"] == pytest.approx(0.08, rel=1e-6)  # all of the weight: nothing bends
    assert abs(found["hinge"]) < 1e-6 * 0.08


def test_fields_and_engines_decline():
    for solver in (RitzSolver(), CstSolver()):
        assert "obstacles" in solver.declines(catalog.named_case("contact_patch_falls"))
