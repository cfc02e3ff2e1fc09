"""Contact at rest and finite strain: faults of its mechanics turn the gate red."""

from dataclasses import replace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.fem import solving
from shellbench.solvers.fem.mechanics.contact_points import ContactPoints
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path import contact_at_finite_strain as touching
from shellbench.solvers.fem.path import newton
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.fem.solver import FemSettings, FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver
from tests.test_contact_faults import errors

STRIP, DRAPE = "contact_heavy_strip", "contact_drape"
CELLS = {STRIP: (40, 1), DRAPE: (16, 10)}  # fine enough where nothing is broken


def upside_down(patch):
    """Normals of the wrong side."""
    asked = touching.gaps
    patch.setattr(touching, "gaps", lambda *a: (asked(*a)[0], -asked(*a)[1]))


def at_rest(patch):
    """Gaps of the shell at rest instead of the displaced one."""
    asked = touching.gaps
    patch.setattr(touching, "gaps", lambda case, points, u, t: asked(case, points, 0 * u, t))


def glued(patch):
    """Points that have touched an obstacle stay in contact for good."""
    patch.setattr(touching.Obstacles, "contact_at", stuck(touching.Obstacles.contact_at))


def stuck(asked):
    touched = {}

    def at(self, q):
        found = asked(self, q)
        held = touched.get(len(found.active), False) | found.active
        touched[len(held)] = held
        return asked(replace(self, held=held), q)

    return at


def soft(patch):
    """An obstacle that never hardens, and whose gaps nobody looks at."""
    patch.setattr(ContactPoints, "penalty", property(lambda self: 1e-6 * self.stiffness.ravel()))
    patch.setattr(touching.ContactState, "gaps_are_closed", property(lambda self: True))


def doubled(patch):
    """Forces twice as large as what presses."""
    touch = ContactPoints.touch
    patch.setattr(ContactPoints, "touch", lambda self, forces: touch(self, 2 * forces))


@pytest.mark.long
@pytest.mark.parametrize("name", CELLS)
def test_one_coarse_mesh_is_green(name):
    assert max(errors(name, CELLS[name]).values()) < 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "name"),
    [
        (upside_down, STRIP),
        (at_rest, STRIP),
        (glued, STRIP),
        (soft, STRIP),
        (doubled, STRIP),
        (upside_down, DRAPE),
        (soft, DRAPE),
    ],
)
def test_a_fault_is_red(fault, name, monkeypatch):
    catalog.named_case(name)  # read before anything is broken
    monkeypatch.setattr(solving, "SMALLEST_STEP", 0.1)  # of the path: what is right takes 0.1 and more
    monkeypatch.setattr(newton, "MOST_IN_CONTACT", 30)
    fault(monkeypatch)
    try:
        found = errors(name, CELLS[name])
    except (SolveFailure, ValueError):
        return  # no answer is red as well
    assert not max(found.values()) < 1


def test_the_stiffness_of_an_obstacle_is_the_derivative_of_its_forces():
    case = catalog.named_case(DRAPE)
    mesh = TensorMesh(case.surface.domain, (np.array([0, 0.5]), np.array([0, 0.3])))
    points = ContactPoints.on_mesh(case, mesh)
    problem = FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, 5))
    random = np.random.default_rng(0)
    q, step = (size * random.standard_normal((4, 12)) for size in (0.02, 1e-6))
    every = np.ones(len(points.points), dtype=bool)
    pressing = touching.Obstacles(points, 1.0, 1e3 * every, every)
    matrix = problem.energy.tangent(problem.energy.deform(q))
    before = matrix.blocks.copy()
    pressing.add_stiffness(matrix, pressing.contact_at(q))
    matrix.blocks[...] -= before
    change = pressing.contact_at(q - step).nodal - pressing.contact_at(q + step).nodal
    assert (matrix @ (2 * step)[..., None])[..., 0] == pytest.approx(change, rel=1e-5, abs=1e-6 * np.abs(change).max())


@pytest.mark.long
def test_a_wall_and_a_floor_that_press_on_one_cell_share_the_weight():
    case = catalog.named_case(STRIP)
    floor = case.obstacles[0].model_copy(update={"centre": (0, 0, -0.003)})  # reached within the cell at the wall
    asked = tuple(q for q in case.quantities if q.name in ("contact_force", "wall_force"))
    near = case.model_copy(update={"obstacles": (floor,), "quantities": asked})
    found = measure_all(FemSolver().solve(near, FemSettings(cells=(1, 1))))
    assert found["contact_force"] + found["wall_force"] == pytest.approx(0.1 * 0.05, rel=1e-6)
    assert found["wall_force"] > 0


def test_obstacles_at_finite_strain_are_declined_on_paths_by_displacement():
    case = catalog.named_case(STRIP)
    path = case.path.model_copy(update={"quantity": "tip_shortening", "control": "displacement"})
    words = "it touches obstacles at finite strain by load steps before buckling only"
    assert FemSolver().declines(case.model_copy(update={"path": path})) == words
    words = "it touches obstacles by load steps before buckling only"
    assert RitzSolver().declines(case.model_copy(update={"path": path})) == words
