"""The published boundary functions: the paper's formulas, and exact where they hold the shell."""

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.published.published_network import SIGMA, PublishedFactors
from tests.solvers.ndf.shells import FREE, differences, inner_points, shell

PLACEMENT = Placement()
PINCHED = named_case("pinched_cylinder_free")


def values(case, points):
    return PublishedFactors(case).matrix(np.atleast_2d(points), PLACEMENT)[0].numpy()


def diagonal(case, points):
    matrix = values(case, points)
    assert not np.any(matrix * (1 - np.eye(3)))
    return np.einsum("pii->pi", matrix)


def test_plate_roof_and_diaphragm_have_the_published_factors_with_maximum_one():
    plate, roof, tube = map(named_case, ("square_plate", "scordelis_lo", "pinched_cylinder_diaphragm"))
    for case, held in ((plate, [0, 1, 2]), (roof, [0, 1]), (tube, [0, 2])):
        points = case.surface.domain.grid(21, 21).reshape(-1, 2)
        lower, upper = case.surface.domain.lower, case.surface.domain.upper
        published = (points[:, 1] - lower[1]) * (upper[1] - points[:, 1])
        if case is plate:
            published = published * (points[:, 0] - lower[0]) * (upper[0] - points[:, 0])
        expected = np.ones((len(points), 3))
        expected[:, held] = (published / published.max())[:, None]
        np.testing.assert_allclose(diagonal(case, points), expected, atol=1e-15)


def test_the_free_cylinder_is_pinned_beside_its_loads_only():
    load = np.array([np.pi / 2, 300.0])
    assert np.array_equal(diagonal(PINCHED, load), [[0, 0, 1]])
    assert np.array_equal(diagonal(PINCHED, load + np.array([np.pi, 0])), [[0, 0, 1]])
    for degrees, metres in ((0.1, 0.0), (0.0, 0.05), (-0.03, 0.1)):  # eq. (66)
        b = 1 - np.exp(-(degrees**2 + metres**2) / SIGMA)
        got = diagonal(PINCHED, load + np.array([np.radians(degrees), metres]))
        np.testing.assert_allclose(got, [[b, b, 1]], atol=1e-12)
    elsewhere = PINCHED.surface.domain.grid(20, 20).reshape(-1, 2)  # an even grid, so no point at a load
    assert np.array_equal(diagonal(PINCHED, elsewhere), np.ones((400, 3)))


def test_a_pin_is_the_same_seen_across_the_seam():
    case = shell(
        "tube",
        points={"a": [0, 2], "b": [180, 2]},
        loads=[{"kind": "point", "on": ["a"], "force": [1, 0, 0]}, {"kind": "point", "on": ["b"], "force": [-1, 0, 0]}],
    )
    near = np.radians(0.05)
    before, after = values(case, [[2 * np.pi - near, 2.0], [near, 2.0]])
    np.testing.assert_allclose(before, after, atol=1e-12)
    assert 0 < before[1, 1] < 1


def test_points_are_held_against_all_directions_but_that_of_their_load():
    force = np.array([1.0, 1.0, -2.0])
    case = shell(
        "plane",
        points={"a": [0.5, 0.0], "b": [1.5, 0.3]},
        loads=[{"kind": "point", "on": ["a"], "force": force.tolist()},
               {"kind": "point", "on": ["b"], "force": (-force).tolist()}],
    )  # fmt: skip
    free = np.random.default_rng(0).normal(size=3)
    for point in ([0.5, 0.0], [1.5, 0.3]):
        u = values(case, point)[0] @ free
        np.testing.assert_allclose(np.cross(u, force), 0, atol=1e-12)
        assert u @ force == pytest.approx(free @ force)


def test_a_shell_with_supports_or_without_point_loads_has_no_pins():
    assert not PublishedFactors(named_case("pinched_cylinder_diaphragm")).pins
    assert not PublishedFactors(shell("tube", remove_rigid_motions=FREE)).pins
    assert len(PublishedFactors(PINCHED).pins) == 2


def test_derivatives_of_the_pins():
    load = np.array([np.pi / 2, 300.0])
    points = load + np.random.default_rng(1).uniform(-1, 1, (6, 2)) * [np.radians(0.1), 0.1]
    step = np.array([np.radians(1), 1.0])  # coordinates in units of the case file, where the pin has one width
    jet = PublishedFactors(PINCHED).matrix(points, PLACEMENT)[..., 0, 0].numpy()
    wanted = differences(lambda y: values(PINCHED, y * step)[:, 0, 0], points / step, step=2e-4)
    units = np.array([1, step[0], step[1], step[0] ** 2, step[0] * step[1], step[1] ** 2])[:, None]
    np.testing.assert_allclose(jet * units, wanted, rtol=1e-6, atol=1e-4)


def test_far_from_a_pin_nothing_underflows_to_nan():
    points = inner_points(PINCHED, 200)
    for dtype in (torch.float32, torch.float64):
        jet = PublishedFactors(PINCHED).matrix(points, Placement(dtype=dtype))
        assert bool(torch.isfinite(jet).all())


@pytest.mark.parametrize("name", ["scordelis_lo", "pinched_cylinder_free"])
def test_the_covariant_components_of_a_vector_give_what_its_cartesian_ones_give(name):
    case, vector = named_case(name), np.array([0.3, -1.2, 0.7])
    points = np.vstack([inner_points(case, 20), [[np.pi / 2 + 1e-3, 300.05]] if "pinched" in name else [[2.0, 20.0]]])
    x = case.surface.derivatives(points, 1)
    base = np.stack([x[1, 0], x[0, 1], np.cross(x[1, 0], x[0, 1])], axis=-2)
    base[:, 2] /= np.linalg.norm(base[:, 2], axis=-1, keepdims=True)
    covariant = PublishedFactors(case, covariant=True).matrix(points, PLACEMENT)[0].numpy()
    found = np.einsum("nij,nj->ni", covariant, base @ vector)
    np.testing.assert_allclose(found, values(case, points) @ vector, rtol=0, atol=1e-12)
