"""Measuring: exact on fields that are known in closed form."""

import numpy as np
import pytest

from shellbench import catalog
from shellbench.measure import curve, largest_displacement, mean_displacement, measure
from shellbench.solution import Step


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


class SnappingPath:
    """A solution of the thick roof that is known by its path alone: t = w^3 - 4.5 w^2 + 6 w, w in units of 10 mm."""

    def __init__(self, case, end=3.0, states=60):
        self.case = case
        w = np.linspace(0, end, states + 1)[1:]
        path = (
            Step(n, 0.0, 0.0, 1, at=x**3 - 4.5 * x**2 + 6 * x, quantities={"deflection": 10 * x}, phase="path")
            for n, x in enumerate(w, start=2)
        )
        refinements = (Step(n, 0.0, 0.0, 1, at=30.0, quantities={"deflection": 30.0}) for n in (0, 1))
        self.history = (*refinements, *path)


def test_loads_and_limit_points_are_read_off_the_path():
    solution = SnappingPath(catalog.named_case("hinged_roof_thick"))
    expected = {"limit_load": 2500, "limit_deflection": 10, "valley_load": 2000, "load_20": 2000}
    for name, value in expected.items():
        assert measure(solution, solution.case.quantity(name)) == pytest.approx(value, rel=1e-4)
    half = solution.case.quantity("load_20").model_copy(update={"at": 5.0, "scale": -2.0})
    assert measure(solution, half) == pytest.approx(-2 * 2.0, rel=1e-5)


def test_a_snap_back_is_read_off_the_path():
    case = catalog.named_case("hinged_roof_thin")
    s = np.linspace(0, 1.5 * np.pi, 200)[1:]
    solution = SnappingPath(case)
    solution.history = tuple(
        Step(n, 0.0, 0.0, 1, at=t, quantities={"deflection": w}, phase="path")
        for n, (t, w) in enumerate(zip(np.sin(2 * s), s + 2 * np.sin(s), strict=True))
    )
    turn = 2 * np.pi / 3
    displacement = measure(solution, case.quantity("snap_back_deflection"))
    assert displacement == pytest.approx(turn + 2 * np.sin(turn), rel=1e-5)
    assert measure(solution, case.quantity("snap_back_load")) == pytest.approx(1000 * np.sin(2 * turn), rel=1e-3)


def test_what_the_path_does_not_reach_is_said():
    short = SnappingPath(catalog.named_case("hinged_roof_thick"), end=0.9)
    with pytest.raises(ValueError, match="has 0 turning points of the load, not 1"):
        measure(short, short.case.quantity("limit_load"))
    with pytest.raises(ValueError, match="does not reach the displacement 20"):
        measure(short, short.case.quantity("load_20"))
    with pytest.raises(ValueError, match="too few states"):
        measure(SnappingPath(short.case, states=2), short.case.quantity("load_20"))


def test_a_case_without_a_path_quantity_has_no_curve():
    solution = SnappingPath(catalog.named_case("cantilever_shear"))
    with pytest.raises(ValueError, match="has no displacement quantity"):
        curve(solution)
