"""Fields for motion: orthonormal in mass, and as good as polynomials of their degree."""

import numpy as np
import pytest
import torch

from shellbench.errors import InputError
from shellbench.solvers.ndf.field.build import build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import area_rule
from shellbench.solvers.ndf.motion.motion_problem import Motion
from shellbench.solvers.ndf.strains.smooth import degrees, finer, placed_features, rule_of, scales, smooth, width_for
from tests.solvers.ndf.shells import shell, support

RHO = 2.0
SPEC = FieldSpec(stretched=False, multipliers=0, strain="exact")
NOWHERE = np.zeros((0, 2))


def moving(surface="plane", **data):
    quantities = [{"name": "energy", "kind": "kinetic_energy", "at": 1.0, "primary": True}]
    return shell(surface, {"areal_density": RHO}, **{
        "theory": "kirchhoff-love-nonlinear", "supports": [], "dynamics": {"until": 1.0}, "quantities": quantities,
        **data,
    })  # fmt: skip


def motion(case, degree, spec=SPEC):
    inputs, placement = build_inputs(case, spec), Placement()
    network = random_features(placement.tensor(scales(case, inputs, degree)), width_for(case, degree), 0)
    features = build_features(case, spec, network, placement, inputs)
    rule_spec = rule_of(case, degree)
    whole = Motion(case, spec, features, rule_spec)
    rule = area_rule(case.surface.domain, NOWHERE, rule_spec)
    return Motion(case, spec, smooth(whole.ansatz(0.0), features, rule, degree), rule_spec)


@pytest.mark.parametrize("surface", ["plane", "roof", "tube"])
def test_features_are_orthonormal_and_the_mass_is_that_of_the_shell(surface):
    case = moving(surface)
    found = motion(case, 8)
    count = found.features.count
    np.testing.assert_allclose(found.mass, RHO * torch.eye(3 * count), rtol=0, atol=1e-4)
    assert found.basis.size == 3 * count
    area = {"plane": 4.0, "roof": 3 * np.radians(80) * 5, "tube": 3 * 2 * np.pi * 5}[surface]
    assert found.area == pytest.approx(area, rel=1e-10)
    one = torch.zeros(count, dtype=torch.float64)
    one[0] = area**0.5  # the first is the constant
    np.testing.assert_allclose(found.features.values(case.surface.domain.grid(4, 4).reshape(-1, 2)) @ one, 1.0)


def test_the_mass_of_held_components_is_that_of_their_factor():
    """With u_x = t F on a side of length 2 (t from 0 to 1), F = 1: the integral of t^2 over an area of 4 is 4/3."""
    case = moving(supports=[support("edge", "xi1_min", components=["x"])])
    found = motion(case, 6)
    values = found.features.values(case.surface.domain.grid(12, 12).reshape(-1, 2))
    one = torch.linalg.lstsq(values, torch.ones_like(values[:, :1])).solution[:, 0]
    count = found.features.count
    blocks = found.mass.view(3, count, 3, count)
    moments = [float(one @ blocks[c, :, c] @ one) for c in range(3)]
    np.testing.assert_allclose(moments, [RHO * 4 / 3, RHO * 4, RHO * 4], rtol=1e-6)
    assert float(blocks[0, :, 1].abs().max()) == 0
    np.testing.assert_allclose(found.basis.combine.T @ found.mass @ found.basis.combine, np.eye(3 * count), atol=1e-8)


def test_components_held_everywhere_have_no_unknowns():
    found = motion(moving(supports=[support("flat", "surface", components=["y"])]), 5)
    count = found.features.count
    assert found.basis.size == 2 * count
    assert float(found.basis.combine.view(3, count, -1)[1].abs().max()) == 0


def test_held_points_cost_an_unknown_each_and_exert_nothing_on_the_others():
    case = moving(supports=[support("corner", "xi1_min,xi2_max", components=["x", "z"])])
    found = motion(case, 6)
    basis, count = found.basis, found.features.count
    assert basis.size == 3 * count - 2
    assert float((basis.combine.T @ found.mass @ basis.held).abs().max()) < 1e-8
    at = found.features.values(np.array([[0.0, 1.0]]))[0]
    moved = basis.held.view(3, count, 2).permute(0, 2, 1) @ at
    np.testing.assert_allclose(moved, [[1, 0], [0, 0], [0, 1]], atol=1e-8)
    free = basis.combine.view(3, count, -1).permute(0, 2, 1) @ at
    assert float(free[[0, 2]].abs().max()) < 1e-8
    assert float(free[1].abs().max()) > 0.1


def test_fields_converge_as_polynomials_do_and_no_worse_at_edges():
    """A smooth function with slopes and curvatures at all edges is met faster than any power of the degree."""
    case = moving()
    points = case.surface.domain.grid(41, 41).reshape(-1, 2)
    wanted = torch.as_tensor(np.exp(0.8 * points[:, 0] - points[:, 1]))
    errors = []
    for degree in (4, 8, 12):
        found = motion(case, degree)
        values = found.features.values(found.sampled.points)
        weights = found.areas[:, None] * values
        share = (
            torch.linalg.inv(weights.T @ values)
            @ weights.T
            @ torch.as_tensor(np.exp(0.8 * found.sampled.points[:, 0] - found.sampled.points[:, 1]))
        )
        errors.append(float((found.features.values(points) @ share - wanted).abs().max() / wanted.max()))
    assert errors[1] < 1e-2 * errors[0]
    assert errors[2] < errors[0] / 3**5  # a plain stiffness, without slopes across edges, gives the second power


@pytest.mark.long
def test_placed_features_meet_polynomials_that_drawn_ones_miss():
    """Products of Legendre's polynomials of 80 % of a high degree; at degree 9 it is the other way round."""
    case, degree = moving({"kind": "plane", "xi1": [-1, 1], "xi2": [-1, 1]}), 18
    inputs, placement = build_inputs(case, SPEC), Placement()
    drawn = random_features(placement.tensor(scales(case, inputs, degree)), width_for(case, degree), 0)
    placed = placed_features(case, inputs, degree, placement)
    assert len(placed.biases[0]) < len(drawn.biases[0])
    rule = area_rule(case.surface.domain, NOWHERE, rule_of(case, degree, order=2 * degree))
    root = np.sqrt(rule.weights)[:, None]
    first, second = (np.polynomial.legendre.legvander(rule.points[:, k], degree) for k in (0, 1))
    most = 0.8 * degree * (0.8 * degree + 1)
    low = [(m, n) for m in range(degree) for n in range(degree) if m * (m + 1) + n * (n + 1) <= most]
    wanted = root * np.stack([first[:, m] * second[:, n] for m, n in low], axis=1)
    missed = []
    for network in (drawn, placed):
        features = build_features(case, SPEC, network, placement, inputs)
        found = smooth(Motion(case, SPEC, features, rule_of(case, degree)).ansatz(0.0), features, rule, degree)
        basis, _ = np.linalg.qr(root * found.values(rule.points).numpy())
        left = wanted - basis @ (basis.T @ wanted)
        missed.append(np.max(np.linalg.norm(left, axis=0) / np.linalg.norm(wanted, axis=0)))
    assert missed[1] < missed[0] / 5


def test_placed_features_need_plain_coordinates():
    tube = moving("tube")
    with pytest.raises(InputError, match='setting hidden = "placed" needs two coordinates that are not periodic'):
        placed_features(tube, build_inputs(tube, SPEC), 5, Placement())


def test_degrees_follow_the_sides():
    case = moving({"kind": "plane", "xi1": [0, 9], "xi2": [0, 1]})
    assert degrees(case, 12) == pytest.approx((12.0, 4.0))
    spec = rule_of(case, 12)
    assert spec.panels[0] > spec.panels[1]
    assert finer(spec).order > spec.order


def test_quadrature_takes_a_narrow_spring_in():
    """The integral of exp(-r^2 / (2 s^2)) over a quarter of the plane is pi s^2 / 2."""
    width = 0.02
    spring = {"name": "pin", "stiffness": f"exp(-(xi1**2 + (xi2 + 1)**2)/(2*{width}**2))"}
    plain, sprung = moving(), moving(springs=[spring])
    assert rule_of(sprung, 6).panels[0] > rule_of(plain, 6).panels[0]
    rule = area_rule(sprung.surface.domain, NOWHERE, rule_of(sprung, 6))
    total = rule.weights @ sprung.spring_stiffness(rule.points)
    np.testing.assert_allclose(total, np.pi * width**2 / 2, rtol=1e-5)


def test_slopes_of_the_smoothest_fields_are_small():
    """Ordered by the operator: the first fields are a constant and nearly straight lines."""
    found = motion(moving(), 8)
    jets = found.sampled.jets.permute(1, 0, 2)
    slopes = [float((found.areas[:, None] * jets[plane] ** 2).sum(0)[0]) for plane in (D1, D2)]
    assert max(slopes) < 1e-20
    line = jets[VALUE][:, 1:3]
    xi = torch.as_tensor(found.sampled.points)
    design = torch.cat([torch.ones_like(xi[:, :1]), xi], dim=1)
    rest = line - design @ torch.linalg.lstsq(design, line).solution
    assert float(rest.abs().max() / line.abs().max()) < 1e-4


@pytest.mark.parametrize("components", [["x", "y", "z"], ["x"]])
def test_resistance_is_the_derivative_of_the_energy(components):
    """Compare with central differences along a direction, with all components held alike and not."""
    spring = {"name": "pin", "stiffness": "3e4*(1 + xi1)"}
    case = moving("roof", supports=[support("edge", "xi2_min", components=components)], springs=[spring])
    found = motion(case, 4)
    count = 3 * found.features.count
    generator = torch.Generator().manual_seed(0)
    w, along = (0.3 * torch.randn(count, generator=generator, dtype=torch.float64) for _ in range(2))
    at = [found.energies(w + side * 1e-5 * along, torch.zeros_like(w), 0.0).strain for side in (1, -1)]
    assert float(found.resistance(w, 0.0)[0] @ along) == pytest.approx((at[0] - at[1]) / 2e-5, rel=1e-6)
