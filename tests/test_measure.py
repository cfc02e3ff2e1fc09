"""Measuring: exact on fields that are known in closed form."""

import numpy as np
import pytest

from shellbench import catalog
from shellbench.measure import largest_displacement, mean_displacement


class ClosedFormField:
    """A displacement given by a function of the points."""

    def __init__(self, case, field):
        self.case, self.field = case, field

    def displacement(self, points, at=None, parameters=None):
        return self.field(np.asarray(points, dtype=float))


@pytest.mark.parametrize("peak", [(50.0, 50.0), (13.37, 71.11), (0.0, 100.0), (99.9, 0.1)])
def test_the_largest_displacement_is_found_wherever_it_is(peak):
    case = catalog.named_case("square_plate")

    def hill(points):
        height = np.exp(-np.sum((points - np.asarray(peak)) ** 2, axis=-1) / 50.0)
        return height[..., None] * np.array([0.6, 0.0, -0.8])

    assert largest_displacement(ClosedFormField(case, hill)) == pytest.approx(1.0, rel=1e-9)


def test_a_sharp_peak_at_a_named_point_is_not_missed():
    case = catalog.named_case("pinched_cylinder_free")
    load = np.asarray(case.places["top"].xi)
    sharp = ClosedFormField(case, lambda p: np.exp(-np.abs(p - load).sum(axis=-1) * 1e6)[..., None] * np.eye(3)[0])
    assert largest_displacement(sharp) == 1.0


def test_a_peak_across_the_seam_of_a_periodic_surface():
    case = catalog.named_case("pinched_cylinder_free")
    ring = ClosedFormField(case, lambda p: np.cos(p[..., :1] + 0.001) * np.array([0.0, 1.0, 0.0]))
    assert largest_displacement(ring) == pytest.approx(1.0, rel=1e-12)


def test_directions_are_normalised_and_points_averaged():
    case = catalog.named_case("pinched_cylinder_free")
    pinch = ClosedFormField(case, lambda p: np.stack([0 * p[..., 0], 0 * p[..., 0], -np.sin(p[..., 0]) * 2.0], axis=-1))
    assert mean_displacement(pinch, case.primary) == pytest.approx(2.0)
