"""Input coordinates and singular features: exact jets, periodic, even at planes of symmetry, singular at forces."""

import numpy as np
import pytest
import torch

from shellbench.solvers.ndf.field.build import path_level_count, path_resolution, usual_resolution
from shellbench.solvers.ndf.field.field import FixedFeatures
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.inputs import Inputs, edge_layers, foci
from shellbench.solvers.ndf.field.jets import D1, Placement
from shellbench.solvers.ndf.field.supports import edge_samples, edge_supports
from tests.solvers.ndf.shells import FREE, differences, inner_points, shell, support, with_force

PLACEMENT = Placement()
QUARTER = [
    support("crown", "xi1_max", symmetry="x"),
    support("middle", "xi2_max", symmetry="z"),
    support("end", "xi2_min", components=["x", "y"]),
]
QUARTER_ROOF = {"kind": "cylinder", "axis": "z", "radius": 3, "xi1": [50, 90], "xi2": [0, 2.5]}


def loaded(surface, at=(70, 1.5), **data):
    return with_force(shell(surface, points={"p": list(at)}, **data), "p", (0, 1, 0))


CASES = {
    "plate": shell("plane"),
    "loaded roof": loaded("roof"),
    "loaded tube": loaded("tube"),
    "loaded torus": loaded("torus", (30, 200)),
    "quarter roof": loaded(QUARTER_ROOF, (90, 2.5), supports=QUARTER),
    "quarter roof, load inside": loaded(QUARTER_ROOF, (60, 1), supports=QUARTER),
}


@pytest.mark.sampled(7)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("periodic", ["both", "cosine", "none"])
def test_jets_of_inputs_match_differences(name, periodic):
    case = CASES[name]
    inputs = Inputs.from_case(case, periodic, foci(case), edge_layers(case))
    points = inner_points(case)
    expected = differences(lambda p: inputs.jets(p, PLACEMENT)[0].numpy(), points, 2e-4)
    np.testing.assert_allclose(inputs.jets(points, PLACEMENT).numpy(), expected, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["loaded roof", "loaded torus"])
def test_jets_of_singular_features_match_differences(name):
    case = CASES[name]
    features = FixedFeatures.from_case(case, foci(case), 6)
    focus = np.asarray(foci(case)[0].xi)
    points = focus + 0.1 * np.random.default_rng(0).uniform(0.5, 1, (20, 2))
    expected = differences(lambda p: features.jets(p, PLACEMENT)[0].numpy(), points, 2e-4)
    np.testing.assert_allclose(features.jets(points, PLACEMENT).numpy(), expected, atol=1e-6 * np.abs(expected).max())


def test_singular_feature_is_that_of_a_plate():
    """On a plane r^2 log r^2 in units of the reach, whose Laplacian is 4 log r^2 + 8."""
    case = loaded("plane", (1.2, 0.1))
    focus = foci(case)[0]
    features = FixedFeatures.from_case(case, (focus,), 1)
    points = inner_points(case)
    jet = features.jets(points, PLACEMENT)[..., 1].numpy()
    square = ((points - focus.xi) ** 2).sum(1) / focus.reach**2
    np.testing.assert_allclose(jet[0], square * np.log(square), rtol=1e-12)
    np.testing.assert_allclose(jet[3] + jet[5], (4 * np.log(square) + 8) / focus.reach**2, rtol=1e-10)
    here = features.jets(np.array([focus.xi]), PLACEMENT)[:3, 0, 1]
    assert here.abs().max() < 1e-12


@pytest.mark.parametrize("name", ["loaded tube", "loaded torus"])
def test_inputs_and_features_close_on_periodic_surfaces(name):
    case = CASES[name]
    domain = case.surface.domain
    inputs, features = Inputs.from_case(case, "both", foci(case)), FixedFeatures.from_case(case, foci(case))
    for axis in range(2):
        if domain.periodic[axis]:
            here = inner_points(case)
            there = here + np.eye(2)[axis] * domain.size[axis]
            for made in (inputs, features):
                torch.testing.assert_close(
                    made.jets(here, PLACEMENT), made.jets(there, PLACEMENT), rtol=1e-9, atol=1e-9
                )


def test_without_periodic_inputs_the_shell_is_slit():
    case = CASES["loaded tube"]
    domain = case.surface.domain
    ends = np.array([[domain.lower[0], 1.0], [domain.upper[0], 1.0]])
    values = Inputs.from_case(case, "none", foci(case)).jets(ends, PLACEMENT)[0]
    assert (values[0] - values[1]).abs().max() > 0.5


@pytest.mark.parametrize("name", ["quarter roof", "quarter roof, load inside"])
def test_inputs_and_features_are_even_at_planes_of_symmetry(name):
    case = CASES[name]
    for edge in edge_supports(case):
        if edge.free:
            points = edge_samples(case, edge.edge)[1:-1]
            for made in (
                Inputs.from_case(case, "both", foci(case), edge_layers(case)),
                FixedFeatures.from_case(case, foci(case)),
            ):
                assert made.jets(points, PLACEMENT)[D1 + edge.edge.axis].abs().max() < 1e-9


def test_singular_features_that_are_not_even_are_left_out():
    on_the_planes, inside = (CASES[name] for name in ("quarter roof", "quarter roof, load inside"))
    assert FixedFeatures.from_case(on_the_planes, foci(on_the_planes), 1).count == 2
    assert FixedFeatures.from_case(inside, foci(inside), 1).count == 1


def test_inputs_are_independent_of_each_other():
    """Opposite loads on a tube have the same tangential chords up to sign: they enter once."""
    points = {"p": [90, 2.5], "q": [270, 2.5]}
    forces = [{"kind": "point", "on": [n], "force": [0, 0, f]} for n, f in (("p", 1), ("q", -1))]
    case = shell("tube", points=points, loads=forces)
    inputs = Inputs.from_case(case, "both", foci(case))
    assert len(foci(case)) == 2
    assert inputs.stretched == (False, False, False, True, True)
    values = inputs.jets(case.surface.domain.grid(20, 20).reshape(-1, 2), PLACEMENT)[0]
    singular = torch.linalg.svdvals(torch.cat([values, torch.ones(400, 1, dtype=torch.float64)], dim=1))
    assert singular[-1] > 1e-3 * singular[0]


def test_lengths_around_a_force_follow_the_shell():
    """l = 1.2 sqrt(h R) on a cylinder of radius R; the same in any unit of length."""
    case = loaded("tube")
    assert foci(case)[0].reach == pytest.approx(3.0)
    assert foci(case)[0].layer == pytest.approx(1.2 * np.sqrt(0.05 * 3.0), rel=1e-9)
    surface = {"kind": "cylinder", "axis": "y", "radius": 3000, "closed": True, "xi1": [0, 360], "xi2": [0, 5000]}
    scaled = loaded(surface, (70, 1500), material={"thickness": 50})
    assert foci(scaled)[0].layer == pytest.approx(1000 * foci(case)[0].layer)


def test_layers_at_edges_are_those_of_the_strongest_curvature():
    """sqrt(h R) in the coordinate's own unit: an angle across a roof, a length along it; none where it is flat."""
    layers = edge_layers(shell("roof"))
    assert layers == pytest.approx((np.sqrt(0.05 * 3.0) / 3.0, np.sqrt(0.05 * 3.0)), rel=1e-9)
    assert edge_layers(shell("plane")) is None
    inputs = Inputs.from_case(shell("roof"), "both", (), layers)
    assert inputs.stretched == (False, False, True, True, True, True)
    tube = shell("tube")
    assert sum(Inputs.from_case(tube, "both", (), edge_layers(tube)).stretched) == 2


def test_point_supports_are_foci_as_well():
    feet = [support("foot", "p", components=["x", "y", "z"])]
    case = shell("plane", points={"p": [1, 0]}, supports=feet, remove_rigid_motions=FREE[3:])
    assert [focus.xi for focus in foci(case)] == [(1.0, 0.0)]


@pytest.mark.parametrize(
    ("surface", "periodic", "axes"),
    [
        ("plane", "both", (0, 1)),
        ("roof", "both", (0, 1, None, None, None, None)),  # stretched toward its four edges
        ("tube", "both", (0, 0, 1, None, None)),  # cosine and sine of the angle, stretched toward two edges
        ("tube", "none", (0, 1, None, None)),
        ("tube", "cosine", (0, 1, None, None)),
        ("torus", "both", (0, 0, 1, 1)),
        ("torus", "cosine", (0, 1)),
    ],
)
def test_axes_of_inputs_are_the_coordinates_that_they_are(surface, periodic, axes):
    case = shell(surface)
    inputs = Inputs.from_case(case, periodic, (), edge_layers(case))
    assert inputs.axes == axes
    jets = inputs.jets(inner_points(case), PLACEMENT)
    for column, axis in enumerate(axes):
        if axis is not None:
            assert jets[D1 + axis, :, column].abs().max() > 0.1
            assert jets[D1 + 1 - axis, :, column].abs().max() == 0


def test_rungs_are_ever_wider_and_longer_along_a_strip():
    """A strip of 10 by 1: scales and panels grow along its length alone, whichever coordinate runs along it."""
    lying, standing = (shell({"kind": "plane", "xi1": [0, a], "xi2": [0, b]}) for a, b in ((10, 1), (1, 10)))
    widths = [path_resolution(lying, number).neurons for number in range(path_level_count(lying))]
    assert widths == sorted(set(widths))
    for number in range(path_level_count(lying)):
        first, second = path_resolution(lying, number), path_resolution(standing, number)
        assert first.along == second.along[::-1]
        assert first.rule.panels == second.rule.panels[::-1]
        assert first.fine.panels == second.fine.panels[::-1]
    coarse, fine = path_resolution(lying, 0), path_resolution(lying, path_level_count(lying) - 1)
    assert coarse.along == (1, 1)
    assert fine.along[0] > 3
    assert fine.along[1] <= 1
    assert fine.rule.panels[0] > 3 * coarse.rule.panels[0]
    assert fine.rule.panels[1] == coarse.rule.panels[1]
    assert fine.fine.panels[0] > fine.rule.panels[0]
    scales = fine.scales(Inputs.from_case(lying))
    np.testing.assert_allclose(scales / coarse.scales(Inputs.from_case(lying)), fine.along)


def test_a_last_rung_of_slender_strips_is_longer_and_no_wider():
    strip = shell({"kind": "plane", "xi1": [0, 40], "xi2": [0, 1]})
    before, last = (path_resolution(strip, path_level_count(strip) - k) for k in (2, 1))
    assert last.neurons == before.neurons
    assert last.along[0] == pytest.approx(40**0.6)
    assert last.along[0] > before.along[0]
    assert last.rule.panels[0] > before.rule.panels[0]


@pytest.mark.parametrize("case", [shell("plane"), shell("roof"), shell("tube")])
def test_rungs_of_squares_and_of_curved_shells_keep_scales_and_panels(case):
    usual = usual_resolution(case)
    for number in range(path_level_count(case)):
        found = path_resolution(case, number)
        assert (found.scale, found.stretched_scale, found.along) == (usual.scale, usual.stretched_scale, (1, 1))
        assert (found.rule.panels, found.fine.panels) == (usual.rule.panels, usual.fine.panels)


def test_sides_are_measured_along_the_surface():
    assert side_lengths(shell("plane")) == pytest.approx((2, 2))
    assert side_lengths(shell("roof")) == pytest.approx((3 * np.radians(80), 5), rel=1e-3)
