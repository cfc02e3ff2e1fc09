"""Measuring: exact on fields that are known in closed form."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import Step
from shellbench.problems.shell.case import build_case
from shellbench.problems.shell.quantities.measure import area_rule, measure, measure_all
from shellbench.problems.shell.quantities.quantities import curve, largest_displacement
from shellbench.protocol.schema import read_toml
from tests.bench.falling import FallSolution


class ClosedFormField:
    """A displacement given by a function of the points."""

    def __init__(self, case, field):
        self.case, self.field = case, field

    def displacement(self, points, at=None, material=None):
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
    assert measure(pinch, case.primary) == pytest.approx(2.0)


def test_the_error_of_a_field_is_relative_and_in_the_mean_square():
    """A field that is a tenth too large errs by a tenth; one that lacks a part errs by the part's share of the norm."""
    case = catalog.named_case("manufactured_oblique_cylinder")
    quantity = case.quantity("field_error")
    exact = quantity.exact
    tenth = ClosedFormField(case, lambda p: 1.1 * case.evaluate(exact, p)[0, 0])
    assert measure(tenth, quantity) == pytest.approx(0.1, rel=1e-12)
    points, weights = area_rule(case)
    squares = weights @ case.evaluate(exact, points)[0, 0] ** 2
    without_y = ClosedFormField(case, lambda p: case.evaluate(exact, p)[0, 0] * [1.0, 0.0, 1.0])
    assert measure(without_y, quantity) == pytest.approx(np.sqrt(squares[1] / squares.sum()), rel=1e-12)


@pytest.mark.parametrize(
    ("exact", "words"),
    [
        ([0, 0, "0*xi1"], "the displacement of quantity 'error' is zero, or not finite, on the shell"),
        ([0, 0, "1/(xi1 - xi1)"], "the displacement of quantity 'error' is zero, or not finite, on the shell"),
        ([0, 0, "xi3"], "quantity 'error': 'xi3' uses the unknown name 'xi3'"),
    ],
)
def test_an_error_needs_a_field_that_it_is_an_error_of(exact, words):
    data = read_toml(catalog.data_folder("cases") / "square_plate.toml")
    data["quantities"].append({"name": "error", "kind": "field_error", "exact": exact})
    with pytest.raises(InputError, match=re.escape(words)):
        build_case(data, "plate", "plate.toml")


@pytest.mark.parametrize("depth", [0.0, 1e-4, 0.02])
def test_the_depth_in_a_floor_is_that_of_the_shell_s_lower_face(depth):
    """The strip at z = 0 is moved rigidly to a floor at z = -.4, and so much deeper."""
    case = catalog.named_case("contact_heavy_strip")
    lower_face = case.material.thickness / 2 if case.contact.thickness else 0.0
    sunk = ClosedFormField(case, lambda p: np.broadcast_to([0.0, 0.0, lower_face - 0.4 - depth], (*p.shape[:-1], 3)))
    sunk.touch = lambda at: SimpleNamespace(points=np.zeros((0, 2)))
    assert measure(sunk, case.quantity("penetration")) == pytest.approx(depth, abs=1e-12)


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


# motion


def test_the_rule_of_integrals_is_exact_on_the_plane_and_finds_a_cylinders_area():
    points, weights = area_rule(catalog.named_case("napkin_plane"))
    assert weights.sum() == pytest.approx(1.0, rel=1e-13)
    x, y = points.T
    assert weights @ (x**7 * y**6) == pytest.approx(1 / 8 / 7, rel=1e-12)  # four points a panel: degree 7
    _, weights = area_rule(catalog.named_case("sleeve_twist"))
    assert weights.sum() == pytest.approx(2 * np.pi * 0.25 * 1.0, rel=1e-13)


@pytest.mark.parametrize("t", [0.0, 0.3, 0.5, 1.0])
def test_free_fall_is_measured_as_newton_has_it(t):
    case = catalog.named_case("free_fall")
    rho, g, area = 0.144, 9.8, 1.0
    fallen = g * t**2 / 2
    expected = {
        "fall_500ms": fallen,
        "centre_z_500ms": -fallen,
        "kinetic_energy_500ms": rho * area * (g * t) ** 2 / 2,
        "strain_energy_500ms": 0.0,
        "total_energy_500ms": 0.0,  # what is gained in motion is lost in height
    }
    for name, value in expected.items():
        quantity = case.quantity(name).model_copy(update={"at": t})
        assert measure(FallSolution(case), quantity) == pytest.approx(value, abs=1e-12)


def test_the_sums_stationary_motion_keeps_no_energy():
    """u = g (T t - t^2/2): at T/2 it has fallen three times too far, and its total energy is not zero."""
    case = catalog.named_case("free_fall")
    values = measure_all(FallSolution(case, reversed_inertia=True))
    exact = measure_all(FallSolution(case))
    assert values["fall_500ms"] / exact["fall_500ms"] == pytest.approx(3.0, rel=1e-12)
    assert values["fall_1000ms"] == pytest.approx(exact["fall_1000ms"], rel=1e-12)
    assert values["kinetic_energy_1000ms"] == pytest.approx(0.0, abs=1e-12)
    assert values["total_energy_500ms"] == pytest.approx(0.144 * 9.8**2 * (0.5**2 / 2 - 3 / 8), rel=1e-12)


class Moving(FallSolution):
    """A displacement u = t^2 a(xi) with a given a, and strain energies t and 2 t."""

    def __init__(self, case, field):
        super().__init__(case)
        self.field = field

    def displacement(self, points, at=None, material=None):
        return at**2 * self.field(np.asarray(points))

    def velocity(self, points, at=None):
        return 2 * at * self.field(np.asarray(points))

    def energies(self, at=None):
        return at, 2 * at


def test_the_total_energy_counts_springs_motion_strain_and_the_work_of_loads():
    """u_y = t^2 xi1, u_x = 0 on the unit square, by hand: k = 12 xi2 on y, gravity 0 but p = 6 xi1 along y."""
    data = read_toml(catalog.data_folder("cases") / "napkin_plane.toml")
    data["springs"] = [{"name": "bed", "stiffness": "12*xi2", "components": ["y"]}]
    data["loads"] = [{"kind": "area", "vector": [100, "6*xi1", 0]}]
    case = build_case(data, "by_hand", "by_hand.toml")
    solution = Moving(case, lambda xi: np.stack([0 * xi[..., 0], xi[..., 0], 0 * xi[..., 0]], axis=-1))
    t, rho = 0.4, case.material.areal_density
    kinetic = rho / 2 * (2 * t) ** 2 / 3  # mean of xi1^2 is 1/3
    springs = (12 / 2) * t**4 / 3 / 2  # mean of xi2 xi1^2 is 1/6
    work = 6 * t**2 / 3
    asked = next(q for q in case.quantities if q.kind == "total_energy").model_copy(update={"at": t})
    assert measure(solution, asked) == pytest.approx(kinetic + 3 * t + springs - work, rel=1e-12)
    kinetic_asked = next(q for q in case.quantities if q.kind == "kinetic_energy").model_copy(update={"at": t})
    assert measure(solution, kinetic_asked) == pytest.approx(kinetic, rel=1e-12)


def test_a_centre_of_mass_is_where_the_material_is():
    """Mass goes by reference area: stretching one half of the napkin moves its mass, not its weight per point."""
    case = catalog.named_case("napkin_plane")
    solution = Moving(case, lambda xi: np.stack([xi[..., 0] ** 2, -xi[..., 1], 0 * xi[..., 0]], axis=-1))
    for quantity in case.quantities:
        if quantity.kind == "centre_of_mass":
            t = quantity.at
            expected = {0: 0.5 + t**2 / 3, 1: 0.5 - t**2 / 2}[quantity.direction.index(1)]
            assert measure(solution, quantity) == pytest.approx(expected, rel=1e-12)


def test_a_position_is_the_reference_point_moved():
    case = catalog.named_case("napkin_plane")
    solution = Moving(case, lambda xi: np.zeros((*xi.shape[:-1], 3)) + np.array([0.5, -1.0, 0.0]))
    for quantity in (q for q in case.quantities if q.kind == "position"):
        (name,) = quantity.points
        axis = quantity.direction.index(1)
        expected = case.places[name].xi[axis] + quantity.at**2 * (0.5, -1.0)[axis]
        assert measure(solution, quantity) == pytest.approx(expected, rel=1e-12)


class Buckled:
    """A path of a sleeve whose torque is its twist squared, with a critical state or without one."""

    def __init__(self, critical):
        self.case = catalog.named_case("sleeve_twist")
        self.history = tuple(Step(i, 0.0, 0.0, 1, at=t, phase="critical") for i, t in enumerate(critical))

    def reaction(self, support, centre=(0.0, 0.0, 0.0), at=None):
        return np.zeros(3), np.array([0.0, at**2, 7.0])


def test_the_critical_state_is_the_first_and_has_quantities_of_its_own():
    solution = Buckled((0.078, 0.2))
    assert measure(solution, solution.case.quantity("critical_twist")) == 0.078
    assert measure(solution, solution.case.quantity("critical_torque")) == pytest.approx(0.078**2)
    doubled = solution.case.quantity("critical_twist").model_copy(update={"scale": 2.0})
    assert measure(solution, doubled) == 2 * 0.078
    with pytest.raises(ValueError, match="no critical state"):
        measure(Buckled(()), solution.case.quantity("critical_torque"))


def test_a_field_error_counts_what_the_panels_of_the_rule_miss():
    data = read_toml(catalog.data_folder("cases") / "square_plate.toml")
    spike = "exp(-((xi1 - 33.3)/0.007)**2)"
    error = {"name": "error", "kind": "field_error", "exact": [0.0, 0.0, f"1 + 40*{spike}"]}
    case = build_case({**data, "quantities": [*data["quantities"], error]}, "plate", "plate.toml")
    square = 40**2 * 0.007 * np.sqrt(np.pi / 2)  # the integrals of the spike's square, and of twice the spike
    twice = 2 * 40 * 0.007 * np.sqrt(np.pi)
    field = ClosedFormField(case, lambda points: np.ones((len(points), 1)) * np.array([0.0, 0.0, 1.0]))
    found = measure(field, case.quantities[-1])
    assert found == pytest.approx(np.sqrt(square / (100 + twice + square)), rel=1e-6)


def test_a_field_that_no_cells_tell_is_no_exact_one():
    data = read_toml(catalog.data_folder("cases") / "square_plate.toml")
    error = {
        "name": "error",
        "kind": "field_error",
        "exact": [0.0, 0.0, "1 + exp(-((xi1 - 0.7*xi2 - 0.1)/1e-5)**2)/1e-5"],
    }
    with pytest.raises(
        InputError, match=r"quantity 'error' varies more quickly than 20000 cells tell, at \(xi1, xi2\)"
    ):
        build_case({**data, "quantities": [*data["quantities"], error]}, "plate", "plate.toml")


def test_the_shadow_of_a_folded_ring_has_the_area_and_the_folds_of_its_outline():
    case = catalog.named_case("cusick_drape")
    asked = case.quantity("drape_coefficient_100mm")
    folds = type(asked)(name="folds", kind="folds", direction=(0, 0, 2))

    def ring(overhang, waves=5, drawn=0.02):
        def displacement(points):
            angle, r = points[..., 0], points[..., 1]
            out = r + (r - 0.09) * (drawn * np.cos(waves * angle) / 0.06 - 0.3)
            turned = angle - overhang * (r - 0.09) / 0.06 * np.sin(2 * waves * angle)
            place = np.stack([out * np.cos(turned), out * np.sin(turned), -r], axis=-1)
            return place - np.stack([r * np.cos(angle), r * np.sin(angle), 0 * r], axis=-1)

        return ClosedFormField(case, displacement)

    exact = (0.132**2 + 0.02**2 / 2 - 0.09**2) / (0.15**2 - 0.09**2)
    assert measure(ring(0.0), asked) == pytest.approx(exact, abs=1e-5)
    assert measure(ring(0.0), folds) == 5
    assert measure(ring(0.0, drawn=0.0), folds) == 0
    # An outline that turns back covers more; the largest radius by brute force
    angle = np.linspace(0, 2 * np.pi, 400_001)
    out, turned = 0.132 + 0.02 * np.cos(5 * angle), angle - 0.2 * np.sin(10 * angle)
    rays = np.zeros(2000)
    np.maximum.at(rays, (turned / (2 * np.pi) * 2000).astype(int) % 2000, out)
    assert measure(ring(0.2), asked) == pytest.approx((np.mean(rays**2) - 0.09**2) / (0.15**2 - 0.09**2), abs=2e-3)
    data = read_toml(catalog.data_folder("cases") / "cusick_drape.toml")
    data["surface"] |= {"xi1": [0, 90], "periodic": []}
    for changed, fault in (
        ({"kind": "folds"}, "counts the folds of a closed ring, and this shell is open"),
        ({"centre": [0.1, 0.1, 0]}, "needs a ring whose inner rim is a circle about its centre"),
    ):
        data["quantities"][-2] |= changed
        with pytest.raises(InputError, match=fault):
            build_case(data, "ring", "ring.toml")
        data["quantities"][-2] |= {"kind": "drape_coefficient"}
