"""One field for a range of materials: energies by parts, what it scales with, what it refuses, and its file."""

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.series.conditioned import Material
from shellbench.problems.series.conditioned_answer import stepped
from shellbench.solvers.ndf.conditioned.conditioned import ConditionedField
from shellbench.solvers.ndf.conditioned.reduced import Equations, stiffness_rates, stiffnesses
from shellbench.solvers.ndf.conditioned_published_solver import ConditionedPublishedSettings, ConditionedPublishedSolver
from shellbench.solvers.ndf.field.build import (
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    usual_resolution,
)
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.published.conditioned_published import drawn_material
from shellbench.solvers.ndf.strains.energy import concentrated, normal_equations
from tests.solvers.ndf.conditioned import missed, small_field

SPEC, RULE = FieldSpec(slopes="rows", edge_stretched=True), RuleSpec((3, 3), 4)
BY = Material._fields


@pytest.fixture(scope="module")
def field():
    return small_field()


def parts_of(shell):
    inputs = build_inputs(shell, SPEC)
    network = random_features(torch.as_tensor(usual_resolution(shell).scales(inputs)), 9, 1)
    return build_ansatz(shell, SPEC), build_features(shell, SPEC, network, Placement(), inputs)


@pytest.mark.parametrize("name", ["conditioned_roof", "conditioned_cylinder"])
def test_four_parts_make_the_energy_of_any_material(name):
    case = catalog.named_case(name)
    focal = graded_points(case.shell_of(case.middle), SPEC)
    rule = area_rule(case.shell_of(case.middle).surface.domain, focal, RULE)
    ansatz, features = parts_of(case.shell_of(case.middle))
    equations = Equations.from_rule(ansatz, features, rule, RULE, focal)
    for material in case.materials[:2]:
        own, _ = parts_of(case.shell_of(material))
        forces = concentrated(own, RULE, focal, Placement())
        whole = normal_equations(own, features, rule, forces)
        at = equations.at(material)
        assert torch.allclose(at.stiffness, whole.stiffness, rtol=1e-12, atol=1e-12 * float(whole.stiffness.max()))
        assert torch.allclose(at.load, whole.load, rtol=1e-12, atol=1e-12 * float(whole.load.abs().max()))


@pytest.mark.parametrize("by", BY)
def test_rates_of_the_stiffnesses_are_their_derivatives(by):
    material, step = Material(0.7, 3e6, 0.31), 1e-4
    ahead, behind = (stiffnesses(stepped(material, by, way * step)) for way in (1, -1))
    assert stiffness_rates(material, by) == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


def test_a_plate_deflects_by_the_inverse_of_its_bending_stiffness(field):
    ranges = field.case.ranges

    def stiffness(material):
        h, young, nu = material
        return young * h**3 / 12 / (1 - nu**2)

    products = [
        field.asked(material) * stiffness(material)
        for material in (ranges.material(shares) for shares in ((0, 0, 0), (1, 0, 1), (0.3, 1, 0.5), (1, 1, 0)))
    ]
    assert products == pytest.approx([products[0]] * 4, rel=1e-6)
    assert missed(field) == []


def test_derivatives_are_those_of_its_own_answers(field):
    material, step = field.case.materials[2], 1e-3
    for by in BY:
        ahead, behind = (field.asked(stepped(material, by, way * step)) for way in (1, -1))
        assert field.derivative(material, by) == pytest.approx(np.log(ahead / behind) / (2 * step), abs=1e-5)


def test_the_field_has_the_asked_displacement_and_keeps_it_in_a_file(field, tmp_path):
    points, material = np.array([[50.0, 50.0], [20.0, 70.0], [0.0, 30.0]]), field.case.materials[4]
    found = field.displacement(points, material=material._asdict())
    assert -found[0, 2] == pytest.approx(field.asked(material), rel=1e-9)
    assert np.abs(found[2]).max() == 0.0
    again = ConditionedField.load(field.save(tmp_path / "field"))
    assert again.displacement(points, material=material) == pytest.approx(found, rel=1e-12)
    assert again.value(3) == field.value(3)
    assert again.uncertainty == field.uncertainty
    (tmp_path / "none.safetensors").write_bytes(b"nothing")
    with pytest.raises(InputError, match="no safetensors file"):
        ConditionedField.load(tmp_path / "none.safetensors")


def test_materials_beyond_the_ranges_are_refused(field):
    with pytest.raises(InputError, match=r"thickness is 5, but the range goes from 0\.4 to 2"):
        field.asked({"thickness": 5.0, "youngs_modulus": 1e7, "poissons_ratio": 0.3})
    with pytest.raises(InputError, match="a material has thickness, youngs_modulus, poissons_ratio, but found h"):
        field.asked({"h": 1.0})


def test_uncertainties_hold_the_error(field):
    for quantity in field.case.quantities:
        known = catalog.known_values(field.case.name).judge(quantity.name, field.case.theory)
        assert abs(quantity.measure(field) - known.value) <= field.uncertainty[quantity.name] + known.uncertainty


def test_the_published_network_sees_the_material(tmp_path):
    case = catalog.named_case("conditioned_plate")
    settings = ConditionedPublishedSettings(iterations=2, layers=1, width=8, cells=(3, 3))
    found = ConditionedPublishedSolver().solve(case, settings)
    assert found.value(0) != found.value(1)
    again = ConditionedPublishedSolver().load(found.save(tmp_path / "trained"))
    assert again.value(1) == found.value(1)
    first = drawn_material(case, 0, 1)
    assert case.ranges.outside(first) is None
    assert first != drawn_material(case, 0, 2)
