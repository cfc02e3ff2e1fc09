"""Stress resultants by equilibrium on patches."""

import numpy as np
import pytest
import torch

from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.linear import patches
from shellbench.solvers.ndf.linear.patches import Recovery, resultants
from tests.solvers.ndf.shells import MATERIAL, shell, support

LOAD, LENGTH, ERROR, STEEP = 3.0, 2.0, 1e-2, 10.0
STIFFNESS = MATERIAL["youngs_modulus"] * MATERIAL["thickness"] ** 3 / 12
BENT = {
    "material": {"poissons_ratio": 0.0},
    "supports": [support("walls", "xi1_min", "xi1_max", clamped=True)],
    "loads": [{"kind": "pressure", "value": LOAD}],
}


def layered(case):
    """The deflection q x^2 (L - x)^2 / 24 B of a plate between walls, and an error where it hardly costs energy."""
    spec = FieldSpec()
    inputs = build_inputs(case, spec)  # -1 at the wall
    weights = torch.zeros((1, inputs.count), dtype=torch.float64)
    weights[0, 0] = STEEP
    network = Network((weights,), (torch.full((1,), STEEP, dtype=torch.float64),), "tanh")
    features = build_features(case, spec, network, Placement(), inputs)
    output = torch.zeros((3, features.count), dtype=torch.float64)
    output[2, 0], output[2, 1] = ERROR, 1 - ERROR
    output *= LOAD * LENGTH**4 / (384 * STIFFNESS)  # the boundary matrix has 16 t^2 (1 - t)^2
    return Field(build_ansatz(case, spec), features, output, torch.zeros(6, dtype=torch.float64))


@torch.no_grad()
@pytest.mark.parametrize(
    ("name", "wanted", "tolerance"),
    [
        ("moment", LOAD * LENGTH**2 / 12, 1e-4),
        pytest.param("shear_force", LOAD * LENGTH / 2, 1e-3, marks=pytest.mark.long),
    ],
)
def test_at_a_wall_resultants_are_its_reactions(name, wanted, tolerance):
    """They err by a tenth of what the field's own derivatives do, or less: what errs there is out of balance."""
    case, wall = shell(**BENT), np.array([[0.0, 0.1]])
    field = layered(case)
    own = abs(resultants(case, "linear", field.jet, name, wall)[0, 0])
    coarser, finer = np.abs(Recovery(field, "linear", at_rest=True).resultants(name, wall)[:, 0, 0])
    assert finer == pytest.approx(wanted, rel=tolerance)
    assert abs(own / wanted - 1) > 10 * abs(finer / wanted - 1)
    assert abs(finer / coarser - 1) < 10 * tolerance


@torch.no_grad()
def test_a_point_asked_alone_has_the_value_it_has_beside_others(monkeypatch):
    monkeypatch.setattr(patches, "PATCH_DEGREES", (4, 6))  # quicker, and less alike
    case, turning = shell(**BENT), LENGTH * (1 / 2 - 1 / 12**0.5)  # where the moment changes sign
    field, points = layered(case), np.array([[0.0, 0.1], [turning, 0.1]])
    together = Recovery(field, "linear", at_rest=True)
    both = together.resultants("moment", points)
    assert np.abs(both[1, 1]).max() < 1e-3 * np.abs(both[1, 0]).max()
    for k, point in enumerate(points):
        alone = Recovery(field, "linear", at_rest=True, balances=together.balances)
        assert alone.resultants("moment", point[None])[:, 0] == pytest.approx(both[:, k], rel=1e-6, abs=1e-10)


@torch.no_grad()
@pytest.mark.parametrize(
    "more",
    [
        {"loads": [*BENT["loads"], {"kind": "edge", "on": ["xi2_min"], "vector": [0, 0, 1]}]},
        {"points": {"near": [0.1, -0.9]}, "loads": [{"kind": "point", "on": ["near"], "force": [0, 0, 1]}]},
    ],
    ids=["on an edge", "at a point"],
)
def test_beside_forces_resultants_are_the_fields_own(more):
    case, corner = shell(**BENT | more), np.array([[0.0, -1.0]])
    field = layered(case)
    both = Recovery(field, "linear", at_rest=True).resultants("moment", corner)
    assert both[0] == pytest.approx(both[1])
    assert both[1] == pytest.approx(resultants(case, "linear", field.jet, "moment", corner))
