"""Pressure that follows the shell, for fields: its forces and their derivative, balance, and what is declined."""

import numpy as np
import torch

from shellbench.problems.shell.quantities.measure import area_rule
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.linear.declines import why_not_followed, why_not_moved
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from tests.solvers.ndf.test_large_displacement import STRIP, UP, WALL, solve, strip

PRESSED = {"kind": "pressure", "value": "4*t*(1 + xi1*xi2)", "follows": True}
EVEN = PRESSED | {"value": "4*t"}


def problem_of(case):
    spec, placement = FieldSpec(strain="exact"), Placement()
    inputs = build_inputs(case, spec)
    network = random_features(placement.tensor(np.full(inputs.count, 2.0)), 12, seed=0)
    features = build_features(case, spec, network, placement, inputs)
    return PathProblem(spec, build_ansatz(case, spec), features, RuleSpec((3, 3), 6), np.zeros((0, 2)))


def test_the_tangent_is_the_derivative_of_the_forces():
    problem = problem_of(strip(PRESSED, thickness=0.3))
    generator = torch.Generator().manual_seed(0)
    weights, step = 0.1 * torch.randn(2, 3 * problem.features.count, generator=generator, dtype=torch.float64)
    bare = problem_of(strip(PRESSED | {"value": "0*t"}, thickness=0.3))

    def forces(at):
        return problem.deform(at, 0.7).residual - bare.deform(at, 0.7).residual

    # They are quadratic in the weights, so that a central difference of any length is exact; the residuals round.
    expected = (forces(weights + step) - forces(weights - step)) / 2
    scale = float(problem.deform(weights, 0.7).residual.abs().max())
    load = problem.load_stiffness(weights, 0.7)
    torch.testing.assert_close(load @ step, expected, rtol=1e-9, atol=1e-11 * scale)
    assert float((load - load.T).abs().max()) > 1e-2 * float(load.abs().max())


def test_reactions_balance_the_pressure_on_the_deformed_strip():
    solution = solve(strip(EVEN), **STRIP)
    case = solution.case
    points, weights = area_rule(case)
    x, h = case.surface.derivatives(points, 1), 1e-5

    def slope(key):
        shift = h * np.array(key) * np.where(points > np.mean(points, axis=0), -1, 1)
        return (solution.displacement(points + shift) - solution.displacement(points)) / shift.sum(axis=1)[:, None]

    push = 4.0 * weights[:, None] * np.cross(*(x[key] + slope(key) for key in ((1, 0), (0, 1))))
    force, _ = solution.reaction("wall")
    assert np.allclose(force, -push.sum(axis=0), rtol=0, atol=2e-4)
    assert force[0] > 0.3  # it draws the strip back, which a dead pressure would not


def test_what_can_not_be_followed_is_declined():
    case = strip(EVEN)
    control = {"control": "displacement", "quantity": "up", "until": 0.5}
    controlled = strip(EVEN, path=control, quantities=[UP | {"at": 0.5}])
    loose = strip(EVEN, supports=[WALL | {"components": ["x", "z"]}], remove_rigid_motions=["translation_y"])
    moving = strip(EVEN, supports=[WALL | {"clamped": False}], dynamics={"until": 1.0})
    assert why_not_followed(case) is None
    assert "keep the normal of the shell at rest in motion" in why_not_moved(moving)
    assert "by load steps before buckling only" in why_not_followed(controlled)
    assert "against all rigid motions where a pressure follows" in why_not_followed(loose)
