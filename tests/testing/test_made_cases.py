"""Cases that are made of others say the same physics in other numbers."""

import numpy as np
import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problems.formula_text import combined, substituted, times
from shellbench.problems.shell.quantities.measure import load_density
from shellbench.problems.shell.variants.placing import ABOUT, CYCLE, turning
from shellbench.problems.shell.variants.units import MILLIMETRES_KILONEWTONS, converted_points
from shellbench.problems.shell.variants.variants import size
from shellbench.testing.examination import scattered
from shellbench.testing.made_cases import MOVING, SHORT, amplified, relocated, rescaled, rotated, shifted, short_motion
from tests.alike import alike
from tests.families import shells, stated, with_something_new

SHELLS = shells()
MOVABLE = [name for name in SHELLS if stated(name)["surface"]["kind"] != "mesh"]  # meshes stay where they are
EVERY_CASE = [name for name in MOVABLE if "obstacles" not in stated(name)]  # and so do obstacles here
SHIFT = np.array([1.0, -2.0, 0.5])


@pytest.mark.parametrize("name", with_something_new(EVERY_CASE))
def test_other_units_change_numbers_as_their_dimensions_say(name):
    case = named_case(name)
    other, points = rescaled(case, MILLIMETRES_KILONEWTONS), scattered(case, 5)
    there = converted_points(case, MILLIMETRES_KILONEWTONS, points)
    # 1 m = 1000 mm; 1 N/m^2 = 1e-9 kN/mm^2; 1 N/m = 1e-6 kN/mm; 1 N m = 1 kN mm; 1 N/m^3 = 1e-12 kN/mm^3
    assert other.surface.position(there) == pytest.approx(1000 * case.surface.position(points))
    assert load_density(other, there, 0.5) == pytest.approx(1e-9 * load_density(case, points, 0.5))
    assert other.material.membrane_stiffness == pytest.approx(1e-6 * case.material.membrane_stiffness)
    assert other.material.bending_stiffness == pytest.approx(case.material.bending_stiffness)
    assert other.spring_stiffness(there) == pytest.approx(1e-12 * case.spring_stiffness(points))
    for (s, place), (t, there_place) in zip(case.supported_places(), other.supported_places(), strict=True):
        moved = case.motion(s, place, points, 0.5)[0, 0]
        assert other.motion(t, there_place, there, 0.5)[0, 0] == pytest.approx(1000 * moved, abs=1e-9)


@pytest.mark.parametrize("name", with_something_new(EVERY_CASE))
def test_a_relocated_case_is_the_turned_one(name):
    case = named_case(name)
    turned, points = turning(case), scattered(case, 5)
    rotation = np.array(turned)
    assert rotation @ rotation.T == pytest.approx(np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    other = relocated(case, turned, SHIFT)
    assert other.surface.position(points) == pytest.approx(case.surface.position(points) @ rotation.T + SHIFT)
    assert load_density(other, points, 0.5) == pytest.approx(load_density(case, points, 0.5) @ rotation.T)
    for (s, place), (t, _) in zip(case.supported_places(), other.supported_places(), strict=True):
        moved = case.motion(s, place, points, 0.5)[0, 0]
        assert other.motion(t, place, points, 0.5)[0, 0] == pytest.approx(moved @ rotation.T, abs=1e-12)
        held = np.isin(list("xyz"), s.held).astype(float)
        assert np.isin(list("xyz"), t.held).tolist() == (np.abs(rotation) @ held > 0.5).tolist()


def test_partly_held_cases_turn_about_their_axis_or_change_axes_only():
    assert turning(named_case("scordelis_lo")) is ABOUT[2]
    assert any(turning(named_case(name)) is CYCLE for name in EVERY_CASE)


def test_a_case_with_scaled_loads_has_the_loads_and_motions_times_the_factor():
    points = scattered(named_case("scordelis_lo"), 5)
    case, twice = named_case("scordelis_lo"), amplified(named_case("scordelis_lo"), 2.0)
    assert load_density(twice, points, 1.0) == pytest.approx(2 * load_density(case, points, 1.0))
    sleeve, more = named_case("sleeve_torque"), amplified(named_case("sleeve_torque"), 2.0)
    for (s, place), (t, _) in zip(sleeve.supported_places(), more.supported_places(), strict=True):
        assert more.motion(t, place, points)[0, 0] == pytest.approx(2 * sleeve.motion(s, place, points)[0, 0])


def test_a_rotated_case_has_no_load_and_one_rigid_motion():
    case = rotated(named_case("square_plate_nonlinear"))
    points = scattered(case, 20)
    (support, place), *rest = case.supported_places()
    u = case.motion(support, place, points, 1.0)[0, 0]
    x = case.surface.position(points)
    before, after = (np.linalg.norm(p[:, None] - p, axis=-1) for p in (x, x + u))
    assert after == pytest.approx(before)
    assert np.abs(u).max() > 0.01 * size(case)
    assert case.loads == ()
    for s, p in rest:
        alike(case.motion(s, p, points, 1.0)[0, 0], u)


def test_cases_that_supports_can_not_rotate_are_left_out():
    assert rotated(named_case("scordelis_lo")) is None
    assert rotated(named_case("napkin_plane")) is None


@pytest.mark.parametrize("name", MOVING)
def test_a_short_motion_ends_early_and_asks_for_its_end(name):
    case = short_motion(name)
    assert case.dynamics.until == SHORT == case.primary.at


def test_formulas_are_rewritten_whole_names_only():
    assert substituted("xi1 + sin(xi12)*xi1**2", {"xi1": "xi1/2"}) == "(xi1/2) + sin(xi12)*(xi1/2)**2"
    assert substituted(3.0, {"xi1": "xi1/2"}) == 3.0
    assert times("a + b", 2.0) == "2.0*(a + b)"
    assert combined([1.0, 2.0], [3.0, 4.0]) == 11.0
    assert combined(["xi1", 0.0], [0.0, 1.0]) == 0.0


def test_made_cases_of_a_manufactured_solution_prescribe_its_displacement():
    """Turned, in other units and under twice the load, the prescribed displacement is that of the case."""
    case = named_case("manufactured_oblique_cylinder")
    points = case.surface.domain.grid(5, 5)
    rotation = turning(case)

    def exact(made, at):
        return made.evaluate(made.quantity("field_error").exact, at)[0, 0]

    expected = exact(case, points)
    np.testing.assert_allclose(exact(relocated(case, rotation, SHIFT), points) @ rotation, expected, atol=1e-15)
    np.testing.assert_allclose(exact(amplified(case, 2.0), points), 2 * expected, atol=1e-15)
    moved = exact(rescaled(case, MILLIMETRES_KILONEWTONS), converted_points(case, MILLIMETRES_KILONEWTONS, points))
    np.testing.assert_allclose(moved / MILLIMETRES_KILONEWTONS.length, expected, atol=1e-15)


def test_a_plane_case_moves_along_its_plane_with_its_points():
    case = named_case("square_plate")
    other = shifted(case, (30.0, -70.0))
    assert other.surface.domain.lower == (30.0, -70.0)
    assert other.surface.domain.size == case.surface.domain.size
    np.testing.assert_allclose(other.points["centre"], (80.0, -20.0))


@pytest.mark.parametrize("name", ["scordelis_lo", "sharp_peak"])
def test_what_is_not_plane_or_asks_where_it_is_does_not_move(name):
    assert shifted(named_case(name), (30.0, -70.0)) is None
