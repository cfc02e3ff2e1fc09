"""Boundary factors and lifts: exactly the prescribed motion on the support, whatever the network says."""

import re

import numpy as np
import pytest
import torch

from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.factors import Lift
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import VALUE, Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.supports import edge_samples, edge_supports
from shellbench.solvers.ndf.linear.declines import violations, why_declined
from tests.solvers.ndf.shells import FREE, differences, inner_points, shell, support

PLACEMENT = Placement()
ALL = ("xi1_min", "xi1_max", "xi2_min", "xi2_max")
QUARTER_ROOF = {"kind": "cylinder", "axis": "z", "radius": 3, "xi1": [50, 90], "xi2": [0, 2.5]}
TURN = {"kind": "rotation", "axis": [0.2, 1, 0.1], "centre": [0, 1, 0], "angle": 3.0}
SHIFT = {"kind": "translation", "vector": [0.1, -0.2, 0.3]}


def value(**formulas):
    return {"kind": "value", **formulas}


CASES = {
    "held plate": shell("plane", supports=[support("rim", *ALL)]),
    "clamped plate": shell("plane", supports=[support("rim", *ALL, clamped=True)]),
    "plate with one clamped and one sliding edge": shell(
        "plane", supports=[support("a", "xi1_min", clamped=True), support("b", "xi2_max", components=["z"])]
    ),
    "plate held in slope alone": shell(
        "plane", supports=[support("a", "xi1_min", components=["z"], clamped=True)],
        remove_rigid_motions=["translation_x", "translation_y", "rotation_z"],
    ),
    "diaphragms": shell(
        "roof", supports=[support("d", "xi2_min", "xi2_max", components=["x", "y"])], remove_rigid_motions=FREE[2:3]
    ),
    "clamped hypar": shell("hypar", supports=[support("wall", "xi1_min", "xi2_max", clamped=True)]),
    "clamped helicoid on a moving wall": shell("helicoid", supports=[support("w", "xi1_min", clamped=True, motion=TURN)]),
    "twisted tube": shell(
        "tube", supports=[support("b", "xi2_min", clamped=True), support("t", "xi2_max", clamped=True, motion=TURN)]
    ),
    "tube on a diaphragm and a clamp": shell(
        "tube", supports=[support("b", "xi2_min", components=["x", "z"]), support("t", "xi2_max", clamped=True)]
    ),
    "quarter roof": shell(
        QUARTER_ROOF,
        supports=[support("crown", "xi1_max", symmetry="x"), support("middle", "xi2_max", symmetry="z"),
                  support("end", "xi2_min", components=["x", "y"])],
    ),
    "half roof, clamped": shell(
        QUARTER_ROOF, supports=[support("crown", "xi1_max", symmetry="x"), support("end", "xi2_min", clamped=True)]
    ),
    "plate moved by formulas": shell(
        "plane",
        supports=[support("a", "xi1_min", motion=value(z="0.1*cos(pi*xi2/2)")), support("b", "xi1_max"),
                  support("c", "xi2_min", motion=value(x="0.3*xi1*(2 - xi1)")), support("d", "xi2_max")],
    ),
    "plate moved as a whole": shell("plane", supports=[support("a", *ALL, motion=SHIFT)]),
    "roof, one end moved": shell(
        "roof", supports=[support("a", "xi2_min"), support("b", "xi2_max", motion=value(y="0.1*sin(xi1)"))]
    ),
}  # fmt: skip


def random_field(case, covariant=False, width=6, seed=0):
    spec = FieldSpec(components="covariant" if covariant else "cartesian")
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 3.0)), width, seed)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    output = torch.randn(3, features.count, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return Field(build_ansatz(case, spec), features, output, torch.zeros(6, dtype=torch.float64))


@pytest.mark.sampled(11)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("covariant", [False, True])
def test_supports_are_held_exactly(name, covariant):
    case = CASES[name]
    if covariant and name in {"quarter roof", "half roof, clamped"}:  # the basis turns, so components can't be even
        assert "hold the slope" in why_declined(case, FieldSpec(components="covariant"))
        return
    field = random_field(case, covariant)
    size = field.displacement(inner_points(case)).abs().max().item()
    for s in edge_supports(case):
        points = edge_samples(case, s.edge)
        u = field.displacement(points).numpy()
        for c, holder in s.held.items():
            wanted = case.motion(holder, s.edge, points)[0, 0][:, c]
            assert np.abs(u[:, c] - wanted).max() < 1e-14 * (1 + size)
        assert violations(field, s)[1] < 1e-13
    assert why_declined(case) is None


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", CASES)
def test_the_field_is_free_to_move_inside_and_where_nothing_is_held(name):
    case = CASES[name]
    first, second = (random_field(case, seed=seed) for seed in (0, 1))
    difference = (first.displacement(inner_points(case)) - second.displacement(inner_points(case))).abs()
    assert difference.amax(0).min() > 1e-2
    for s in edge_supports(case):
        points = edge_samples(case, s.edge)[1:-1]
        difference = (first.displacement(points) - second.displacement(points)).abs().amax(0)
        for c in set(range(3)) - set(s.held):
            assert difference[c] > 1e-3


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", CASES)
def test_jets_of_fields_match_differences(name):
    case = CASES[name]
    field = random_field(case)
    points = inner_points(case)
    expected = differences(lambda p: field.displacement(p).numpy(), points, 2e-4)
    np.testing.assert_allclose(field.jet(points).numpy(), expected, atol=3e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["held plate", "clamped plate", "diaphragms", "twisted tube"])
def test_factors_are_at_most_one(name):
    case = CASES[name]
    matrix = random_field(case).ansatz.factors.matrix(case.surface.domain.grid(21, 21).reshape(-1, 2), PLACEMENT)[VALUE]
    norms = torch.linalg.matrix_norm(matrix, ord=2)
    assert norms.max() <= 1 + 1e-12
    assert norms.max() > 0.99


def test_a_rigid_motion_of_all_supports_is_lifted_as_a_rigid_motion():
    case = CASES["plate moved as a whole"]
    lift = random_field(case).ansatz.lift.jet(inner_points(case), PLACEMENT)
    torch.testing.assert_close(lift[0], torch.tensor([[0.1, -0.2, 0.3]], dtype=torch.float64).expand(20, 3))
    assert lift[1:].abs().max() < 1e-14


@pytest.mark.parametrize(
    ("reason", "case"),
    [
        (
            "can't turn the clamped support 'rim' by finite angles",
            shell(
                "plane",
                theory="kirchhoff-love-nonlinear",
                supports=[support("rim", *ALL, clamped=True, motion=TURN | {"angle": "3*t"})],
            ),
        ),
        (
            "hold the slope on 'xi1_min'",  # the edge lies in no plane of symmetry of this surface
            shell("hypar", supports=[support("a", "xi1_min", symmetry="x"), support("b", "xi1_max")]),
        ),
        (
            "can't move 'xi1_min'|can't move 'xi2_min'",  # contradiction along a whole edge: motions differ at the corner
            shell("plane", supports=[support("a", "xi1_min", motion=SHIFT), support("b", "xi2_min")]),
        ),
    ],
)
def test_what_the_factors_cannot_hold_is_declined(reason, case):
    assert re.search(reason, why_declined(case) or "accepted")


@pytest.mark.parametrize("motion", [TURN, SHIFT, value(x="0.1*xi1*xi2", z="sin(t*xi1)")])
@pytest.mark.parametrize("t", [0.5, 1.0])
def test_a_support_on_the_surface_leaves_nothing_free(motion, t):
    """Whatever the network says, the field and its derivatives are the prescribed motion's."""
    case = shell("roof", theory="kirchhoff-love-nonlinear", supports=[support("all", "surface", motion=motion)])
    first, second = (random_field(case, seed=seed) for seed in (0, 1))
    points = inner_points(case)
    assert first.ansatz.factors.matrix(points, PLACEMENT).abs().max() == 0
    torch.testing.assert_close(first.jet(points), second.jet(points), rtol=0, atol=0)
    lift = Lift(case, t).jet(points, PLACEMENT).numpy()
    place = case.places["surface"]
    expected = differences(lambda p: case.motion(case.supports[0], place, p, t)[0, 0], points)
    np.testing.assert_allclose(lift, expected, atol=1e-6 * np.abs(expected).max())
    assert Lift(case, t).moves
    assert why_declined(case) is None


def test_lifts_follow_the_load_factor():
    """On a moved edge u is the motion at t, formulas included, and zero at rest."""
    jaw = support("jaw", "xi2_max", motion=value(x="0.1*t**2*sin(xi1)", z="0.2*t"))
    case = shell("roof", theory="kirchhoff-love-nonlinear", supports=[support("end", "xi2_min"), jaw])
    (edge,) = (s.edge for s in edge_supports(case) if s.edge.name == "xi2_max")
    points = edge_samples(case, edge)
    for t in (0.0, 0.3, 1.0):
        found = Lift(case, t).jet(points, PLACEMENT)[VALUE].numpy()
        expected = np.stack([0.1 * t**2 * np.sin(points[:, 0]), 0 * points[:, 0], 0.2 * t + 0 * points[:, 0]], axis=-1)
        np.testing.assert_allclose(found, expected, atol=1e-15)
