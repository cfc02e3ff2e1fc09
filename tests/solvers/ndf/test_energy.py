"""Energies, loads, the solve and the certificate."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from shellbench.errors import InputError, SolveFailure
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import check_balance, concentrated_forces, force_density
from shellbench.solvers.ndf.linear.constraints import point_constraints
from shellbench.solvers.ndf.linear.solve import potential_energy, solve_output, solve_part
from shellbench.solvers.ndf.strains.energy import NormalEquations, certify, concentrated, energy_gap, normal_equations
from tests.solvers.ndf.shells import FREE, shell, support
from tests.solvers.ndf.test_factors import CASES, random_field

PLACEMENT = Placement()
NO_FOCI = np.zeros((0, 2))
SPEC = RuleSpec((3, 3), 5)
EDGE = {"kind": "edge", "on": ["xi2_max"], "vector": [0.3, "xi1", -1]}
AREA = {"kind": "area", "vector": ["sin(xi1)", 2, "xi2"]}
PRESSURE = {"kind": "pressure", "value": 3}
GRAVITY = {"kind": "gravity", "acceleration": [0, -9.8, 0]}


def setting(case, rule_spec=SPEC):
    field = random_field(case)
    rule = area_rule(case.surface.domain, NO_FOCI, rule_spec)
    forces = concentrated(field.ansatz, rule_spec, NO_FOCI, PLACEMENT)
    return field, rule, forces


MECHANICS = {
    "roof": shell(
        "roof", supports=CASES["diaphragms"].supports, remove_rigid_motions=FREE[2:3], loads=[AREA, PRESSURE]
    ),
    "moved": shell("tube", supports=CASES["twisted tube"].supports, loads=[EDGE, GRAVITY]),
    "clamped": shell("hypar", supports=CASES["clamped hypar"].supports, loads=[AREA, EDGE]),
}


@pytest.mark.parametrize("name", MECHANICS)
def test_matrix_and_field_give_the_same_energy(name):
    """1/2 w K w - f w + c of the output weights against the energy of the field that they make."""
    field, rule, forces = setting(MECHANICS[name])
    equations = normal_equations(field.ansatz, field.features, rule, forces)
    certified = certify(field.ansatz, field.features, [field.output], rule, forces)[0]
    by_matrix = potential_energy(equations, field.output.reshape(-1))
    assert certified.potential() == pytest.approx(by_matrix, rel=1e-11)
    assert certified.potential(0.0) == pytest.approx(equations.constant, rel=1e-11, abs=1e-12 * abs(by_matrix))
    middle = potential_energy(equations, 0.3 * field.output.reshape(-1))
    assert certified.potential(0.3) == pytest.approx(middle, rel=1e-11)
    if not field.ansatz.lift.moves:
        assert certified.potential(certified.best) < min(certified.potential(certified.best + s) for s in (-0.1, 0.1))


@pytest.mark.parametrize("name", MECHANICS)
def test_gradient_of_the_energy_matches_differences(name):
    field, rule, forces = setting(MECHANICS[name])
    equations = normal_equations(field.ansatz, field.features, rule, forces)
    weights = field.output.reshape(-1)
    gradient = equations.stiffness @ weights - equations.load
    direction = torch.randn(len(weights), dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    step = 1e-3

    def energy(s):
        output = (weights + s * step * direction).view(3, -1)
        return certify(field.ansatz, field.features, [output], rule, forces)[0].potential()

    assert (energy(1) - energy(-1)) / (2 * step) == pytest.approx(float(gradient @ direction), rel=1e-7)


def test_work_of_the_loads_on_a_translation_is_their_resultant():
    case = shell("roof", loads=[AREA, PRESSURE, GRAVITY, EDGE])
    rule = area_rule(case.surface.domain, NO_FOCI, RuleSpec((6, 6), 8))
    x = case.surface.derivatives(rule.points, 1)
    area = rule.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    _, edge_forces = concentrated_forces(case, RuleSpec((6, 6), 8), NO_FOCI)
    total = (force_density(case, rule.points) * area[:, None]).sum(0) + edge_forces.sum(0)
    low, high, radius, length = np.radians(50), np.radians(130), 3.0, 5.0
    arc = radius * (high - low)
    normal = np.array([np.sin(high) - np.sin(low), np.cos(low) - np.cos(high), 0]) * radius * length
    expected = np.array([(np.cos(low) - np.cos(high)) * radius * length, 2 * arc * length, arc * length**2 / 2])
    expected += 3 * normal + np.array([0, -9.8 * 2 * arc * length, 0])
    expected += np.array([0.3 * arc, (high**2 - low**2) / 2 * radius, -arc])
    np.testing.assert_allclose(total, expected, rtol=1e-12, atol=1e-11)


def test_loads_out_of_balance_are_refused():
    free = shell("tube", loads=[{"kind": "area", "vector": [0, 0, 1]}])
    rule = area_rule(free.surface.domain, NO_FOCI, SPEC)
    with pytest.raises(InputError, match="translation_z"):
        check_balance(free, rule, SPEC, NO_FOCI)
    turned = shell("tube", loads=[{"kind": "area", "vector": ["-sin(xi1)", 0, "cos(xi1)"]}])
    with pytest.raises(InputError, match="rotation_y"):
        check_balance(turned, rule, SPEC, NO_FOCI)
    check_balance(shell("tube", loads=[PRESSURE]), rule, SPEC, NO_FOCI)


def test_solving_minimises_under_exact_constraints():
    generator = torch.Generator().manual_seed(0)
    root = torch.randn(12, 9, dtype=torch.float64, generator=generator)
    equations = NormalEquations(root.T @ root, torch.arange(9.0).double(), torch.zeros(0, 9).double(), 0.0)
    constraints = torch.randn(2, 9, dtype=torch.float64, generator=generator)
    targets = torch.tensor([0.3, -1.0], dtype=torch.float64)
    solved = solve_output(equations, constraints, targets, 1.0)
    torch.testing.assert_close(constraints @ solved.weights, targets, rtol=1e-13, atol=1e-13)
    residual = equations.stiffness @ solved.weights - equations.load
    torch.testing.assert_close(residual, constraints.T @ solved.reactions, rtol=1e-9, atol=1e-9)


def test_energy_that_is_not_finite_is_a_failure_in_one_sentence():
    broken = NormalEquations(
        torch.full((3, 3), torch.nan).double(), torch.ones(3).double(), torch.zeros(0, 3).double(), 0.0
    )
    with pytest.raises(SolveFailure, match="not finite"):
        solve_output(broken, torch.zeros(0, 3).double(), torch.zeros(0).double(), 1.0)


def test_point_supports_hold_in_the_solved_field():
    feet = [support("a", "xi1_min,xi2_min", components=["x", "y", "z"]), support("b", "xi1_max,xi2_min", components=["y", "z"]),
            support("c", "xi1_min,xi2_max", components=["z"], motion={"kind": "translation", "vector": [0, 0, 0.01]})]  # fmt: skip
    case = shell("plane", supports=feet, loads=[{"kind": "area", "vector": [0, 0, -1]}])
    field, rule, forces = setting(case, RuleSpec((4, 4), 6))
    equations = normal_equations(field.ansatz, field.features, rule, forces)
    solved = solve_part(field.ansatz, field.features, equations, np.arange(field.features.count))
    rows, targets = point_constraints(field.ansatz, field.features)
    assert len(targets) == 6
    torch.testing.assert_close(rows @ solved.weights, targets, rtol=0, atol=1e-12)
    found = replace(field, output=solved.weights.view(3, -1))
    corners = found.displacement(np.array([[0, -1.0], [2, -1], [0, 1]]))
    assert corners[0].abs().max() < 1e-12
    assert corners[2, 2].item() == pytest.approx(0.01, rel=1e-10)
    vertical = sum(solved.reactions[k].item() for k in (2, 4, 5))
    assert vertical == pytest.approx(4.0, rel=1e-6)  # the load of 1 N/m^2 on 4 m^2


def test_certificate_detects_a_field_that_exploits_its_quadrature():
    """Sixty features find motions that are cheap at the points alone: at four of them, or at many of low order."""
    case = CASES["clamped plate"].model_copy(update={"loads": shell("plane", loads=[AREA]).loads})
    field = random_field(case, width=60)

    def gap(panels, order):
        rule_spec, fine_spec = RuleSpec((panels, panels), order), RuleSpec((8, 8), 7)
        rule, fine = (area_rule(case.surface.domain, NO_FOCI, s) for s in (rule_spec, fine_spec))
        forces = concentrated(field.ansatz, fine_spec, NO_FOCI, PLACEMENT)
        equations = normal_equations(field.ansatz, field.features, rule, forces)
        solved = solve_part(field.ansatz, field.features, equations, np.arange(field.features.count))
        output = solved.weights.view(3, -1)
        certified = certify(field.ansatz, field.features, [output], fine, forces)[0]
        return energy_gap(potential_energy(equations, solved.weights), certified, moved=False)

    assert gap(1, 2) > 0.1
    assert gap(12, 2) > 0.1
    assert gap(4, 6) < 1e-5  # as many points as before


def test_the_rigid_part_of_a_field_is_taken_away_in_the_mean_over_the_area():
    case = shell("tube", loads=[PRESSURE])
    field = random_field(case)
    rule = area_rule(case.surface.domain, NO_FOCI, RuleSpec((6, 6), 6))
    cleaned = field.without_rigid_part(rule)
    assert field.rigid_part(rule).norm() > 1e-2
    x = case.surface.derivatives(rule.points, 1)
    area = rule.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    u = cleaned.displacement(rule.points).numpy()
    size = area @ np.linalg.norm(u, axis=1)
    assert np.abs(area @ u).max() < 1e-12 * size
    assert np.abs(area @ np.cross(x[0, 0], u)).max() < 1e-11 * size * 5
    bare = Field(field.ansatz, field.features, field.output, torch.zeros(6, dtype=torch.float64))
    torch.testing.assert_close(cleaned.jet(rule.points[:5]), bare.jet(rule.points[:5]))
