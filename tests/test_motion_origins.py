"""The known values of shells in motion: mechanics, conservation, closed forms and second forms."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial

from derivations.explicit_motion import largest_frequency, leapfrog, motion
from derivations.free_fall import FreeFall, free_fall, free_fall_of_splines
from derivations.motion import PIN, Resolution, napkin, napkin_plane, napkin_soft_pin
from derivations.over_time import at_time, between, extrapolated
from derivations.paper_napkins import (
    CAPACITY,
    FRACTION,
    UNIFORM,
    corner_values,
    edges_values,
    held_corner,
    held_edges,
    moving_corners,
    moving_values,
    napkin_corner,
    napkin_fixed_edges,
    napkin_moving_corners,
    to_a_point,
    toward_both_ends,
)
from derivations.patch import plane
from derivations.polynomial_napkin import PolynomialNapkin, napkin_plane_polynomials, napkin_soft_pin_polynomials
from derivations.spline_motion import Cloth, Pin
from derivations.spline_shell import Shell, Splines
from derivations.swinging_strip import SwingingStrip, pendulum_polynomials, pendulum_strip, spline_strip

MATERIAL = (5000.0, 0.25, 0.0012, 0.144)


def small(gravity=(0.0, -1.0, -9.0), **changed):
    """A cloth of few, unequal spans with another degree along each side."""
    splines = Splines(np.array([0.0, 0.2, 0.5, 1.0]), 3), Splines(np.array([0.0, 0.4, 0.7]), 4)
    return Cloth(splines, *MATERIAL, gravity, **changed)


def rough(cloth, size=0.05, seed=0):
    return size * np.random.default_rng(seed).normal(size=cloth.shape)


def interpolated(spline, polynomial):
    """Coefficients of a polynomial, by its values at as many points as there are functions."""
    greville = np.array([spline.knots[i + 1 : i + 1 + spline.degree].mean() for i in range(spline.count)])
    return np.linalg.solve(spline.matrix(greville, 0), polynomial(greville))


# --- mechanics of the spline cloth -----------------------------------------------------------------


def test_kinetic_energy_of_a_polynomial_velocity_is_exact():
    cloth = small()
    along, across = Polynomial([0.3, -1.0, 2.0]), Polynomial([1.0, 0.5, 0.0, -2.0])
    one, two = (interpolated(s, f) for s, f in zip(cloth.splines, (along, across), strict=True))
    velocity = np.array([2.0, 0.0, -1.0])[:, None, None] * np.outer(one, two)
    squares = (along**2).integ()(1.0) * (across**2).integ()(0.7)
    energies = cloth.energies(np.zeros(cloth.shape), velocity)
    assert energies.kinetic == pytest.approx(0.144 / 2 * 5.0 * squares, rel=1e-13)
    assert energies.membrane == pytest.approx(0.0, abs=1e-28)


def test_forces_and_energies_are_those_of_the_static_spline_shell():
    cloth = small(bending_factor=1.0)
    shell = Shell(plane, cloth.splines, [(("free", "free"), ("free", "free"))] * 3, *MATERIAL[:3])
    coefficients = rough(cloth)
    force, membrane, bending = cloth.strain_forces(coefficients)
    expected = shell.linearised(coefficients.ravel()).forces().reshape(cloth.shape)
    assert np.allclose(force, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    assert (membrane, bending) == pytest.approx(shell.energies(coefficients.ravel()), rel=1e-12)


def test_the_bending_factor_multiplies_the_bending_energy_only():
    soft, stiff = small(), small(bending_factor=100.0)
    one, two = (c.strain_forces(rough(c))[1:] for c in (soft, stiff))
    assert two[0] == pytest.approx(one[0], rel=1e-14)
    assert two[1] == pytest.approx(100 * one[1], rel=1e-12)


def test_forces_are_the_derivative_of_strain_pin_and_gravity_energy():
    cloth = small(pin=Pin((0.0, 0.7), 2e4, 0.1), bending_factor=1e4)
    coefficients, direction = rough(cloth), rough(cloth, 1.0, 1)

    def energy(t):
        return cloth.energies(coefficients + t * direction, np.zeros(cloth.shape)).total

    step = 1e-3
    slope = (8 * (energy(step) - energy(-step)) - (energy(2 * step) - energy(-2 * step))) / (12 * step)
    assert -np.sum(cloth.forces(coefficients) * direction) == pytest.approx(slope, rel=1e-6)


def test_the_pin_has_the_stiffness_of_its_gaussian():
    """A translation of a cloth much wider than the pin strains a quarter of the Gaussian: pi s^2 / 2."""
    width = 0.02
    cloth = napkin(Resolution(16, 3, grading=0.1), tilt=0.0)
    cloth = Cloth(cloth.splines, *MATERIAL, (0.0, 0.0, 0.0), pin=Pin((0.0, 1.0), 2e4, width))
    energies = cloth.energies(np.full(cloth.shape, 0.3), np.zeros(cloth.shape))
    assert energies.potential == pytest.approx(2e4 / 2 * 3 * 0.3**2 * np.pi * width**2 / 2, rel=1e-9)
    assert energies.membrane == pytest.approx(0.0, abs=1e-24)


def test_plane_and_general_cloth_have_the_same_forces_in_the_plane():
    flat, general = small((0.0, -9.8)), small((0.0, -9.8, 0.0), bending_factor=1e4)
    coefficients = rough(flat)
    lifted = np.concatenate([coefficients, np.zeros((1, *flat.shape[1:]))])
    force = general.forces(lifted)
    assert np.allclose(force[:2], flat.forces(coefficients), rtol=0, atol=1e-13 * np.abs(force).max())
    assert np.abs(force[2]).max() < 1e-14 * np.abs(force).max()


# --- motion ------------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [lambda c, t: motion(c, t, 1e-9), lambda c, t: leapfrog(c, t, 0.8)])
def test_a_cloth_that_nothing_holds_falls_freely_without_strain(steps):
    cloth = small()
    (moment,) = steps(cloth, (0.7,))
    fall = np.array([0.0, -1.0, -9.0]) * 0.7**2 / 2
    assert np.allclose(moment.coefficients, fall[:, None, None], rtol=0, atol=1e-9)
    assert cloth.energies(moment.coefficients, moment.velocity).membrane < 1e-15
    expected = np.array([0.5, 0.35, 0.0]) + fall
    assert np.allclose(cloth.centre(moment.coefficients), expected, atol=1e-9)


def test_energy_is_conserved_and_held_coefficients_stay():
    cloth = small((0.0, -9.8), held=((0, 0), (0, 1)))
    for moment in motion(cloth, (0.1, 0.3), 1e-9):
        assert np.abs(moment.coefficients[:, 0, :2]).max() < 1e-12
        energies = cloth.energies(moment.coefficients, moment.velocity)
        assert energies.kinetic > 0.01
        assert abs(energies.total) < 1e-8


def test_reactions_of_a_held_cloth_are_what_its_momentum_lacks():
    cloth = small((0.0, 0.0, -9.8), held=tuple((0, j) for j in range(6)))
    (moment,) = motion(cloth, (0.2,), 1e-8)
    acceleration, reaction = cloth.acceleration(0.2, moment.coefficients)
    still = cloth.centre(np.zeros(cloth.shape))
    mass = 0.144 * 0.7
    expected = mass * (cloth.centre(acceleration) - still) - mass * np.array([0.0, 0.0, -9.8])
    assert np.allclose(reaction.sum(axis=1), expected, atol=1e-11)
    assert np.abs(moment.reaction - reaction).max() == 0.0


def test_moved_coefficients_follow_their_acceleration():
    cloth = small((0.0, -9.8), held=((0, 5),), moved=lambda t: np.array([[6 * t], [0.0]]))
    (moment,) = motion(cloth, (0.3,), 1e-9)
    assert moment.coefficients[0, 0, 5] == pytest.approx(0.3**3, abs=1e-10)
    assert moment.coefficients[1, 0, 5] == pytest.approx(0.0, abs=1e-10)


def test_largest_frequency_is_that_of_the_generalised_eigenproblem():
    cloth = small((0.0, 0.0))
    rest = np.zeros(cloth.shape)
    size = rest.size
    columns = [-cloth.acceleration(0.0, 1e-6 * e.reshape(cloth.shape))[0].ravel() / 1e-6 for e in np.eye(size)]
    expected = np.sqrt(np.linalg.eigvals(np.stack(columns, -1)).real.max())
    frequency, _ = largest_frequency(cloth, rest, rough(cloth), 300)
    assert frequency == pytest.approx(expected, rel=1e-3)


def test_the_leapfrog_converges_to_runge_kutta_with_the_square_of_its_step():
    cloth = napkin(Resolution(4, 3))
    (exact,) = motion(cloth, (0.3,), 1e-11)
    errors = [
        np.abs(next(leapfrog(cloth, (0.3,), fraction)).coefficients - exact.coefficients).max()
        for fraction in (0.4, 0.2, 0.1)
    ]
    rate = np.polyfit(np.log([0.4, 0.2, 0.1]), np.log(errors), 1)[0]
    assert rate == pytest.approx(2.0, abs=0.3)


def test_the_leapfrog_is_stable_when_another_mode_becomes_the_stiffest():
    """At first that is the free corners', later that of the stretched cloth about the held one: a quarter stiffer."""
    cloth = held_corner(Resolution(16, 3, grading=1e3))
    for moment in leapfrog(cloth, (0.2, 0.4), FRACTION):
        energies = cloth.energies(moment.coefficients, moment.velocity)
        assert abs(energies.total) < 1e-4 * energies.kinetic


def test_a_coarse_napkin_is_near_its_known_values():
    """Eight spans: within a hundred times what the fine mesh leaves, and its energy is conserved."""
    cloth = napkin(Resolution(8, 4))
    for moment in motion(cloth, (0.2,), 1e-8):
        energies = cloth.energies(moment.coefficients, moment.velocity)
        assert abs(energies.total) < 1e-8
        assert cloth.centre(moment.coefficients)[1] == pytest.approx(0.32779, abs=1e-4)


@pytest.mark.parametrize(("gravity", "factor"), [((0.0, -9.8), 1.0), ((0.0, -9.0, 3.0), 1e4)])
def test_polynomials_and_splines_of_one_displacement_have_the_same_forces(gravity, factor):
    """Cubic displacements, which both hold: their energies, and the work of their forces on a cubic motion."""
    napkin_of_polynomials = PolynomialNapkin(16, gravity, factor)
    one = Splines(np.linspace(0, 1, 13), 5)
    cloth = Cloth((one, one), *MATERIAL, gravity, factor, PIN)
    rng = np.random.default_rng(5)
    fields = []
    for size in (0.03, 1.0):
        low = size * rng.normal(size=(len(gravity), 4, 4))
        polynomials = np.zeros(napkin_of_polynomials.shape)
        polynomials[:, :4, :4] = low
        rows = np.stack([interpolated(one, Legendre.basis(k, domain=[0.0, 1.0])) for k in range(4)], -1)
        fields.append((polynomials, np.einsum("ik,ckl,jl->cij", rows, low, rows)))
    (u, w), (du, dw) = fields
    first, second = napkin_of_polynomials.energies(u, 0 * u), cloth.energies(w, 0 * w)
    assert first.membrane == pytest.approx(second.membrane, rel=1e-9)
    assert first.bending == pytest.approx(second.bending, rel=1e-5)
    assert first.potential == pytest.approx(second.potential, rel=1e-5)
    work = float(np.sum(napkin_of_polynomials.forces(u) * du))
    assert work == pytest.approx(float(np.sum(cloth.forces(w) * dw)), rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(
    ("by_splines", "by_polynomials", "sure"),
    [
        (napkin_plane, napkin_plane_polynomials, lambda name: 1e-4),
        (napkin_soft_pin, napkin_soft_pin_polynomials, lambda name: np.inf),
        (pendulum_strip, pendulum_polynomials, lambda name: 2e-3 if name.startswith("hinge") else 1e-5),
    ],
)
def test_values_are_the_same_by_splines_and_by_polynomials(by_splines, by_polynomials, sure):
    values, second = by_splines(), by_polynomials()
    assert values.keys() == second.keys()
    for name, estimate in values.items():
        assert abs(second[name].value - estimate.value) < second[name].uncertainty + estimate.uncertainty, name
        assert estimate.uncertainty < sure(name), name


# --- strip and free fall ---------------------------------------------------------------------------


def test_forces_of_the_strip_are_those_of_a_cloth_that_bends_to_the_same_shape():
    """Two mechanics of one strip: polynomials of positions in a plane, and splines of a surface in space."""
    strip, cloth = SwingingStrip(5), spline_strip(32, 4)
    coefficients = strip.start + 0.01 * np.random.default_rng(2).normal(size=(2, 5))
    moved = np.zeros(cloth.shape)
    for component, line, start in ((0, coefficients[0], 1.0), (2, coefficients[1], 0.0)):
        shape = Legendre(line, domain=[0.0, 1.0])
        moved[component] = interpolated(cloth.splines[0], lambda s, f=shape, a=start: f(s) - a * s)[:, None]
    _, membrane, bending = cloth.strain_forces(moved)
    expected = SwingingStrip(24).strain_forces(np.pad(coefficients, ((0, 0), (0, 19))))[1:]
    assert (membrane, bending) == pytest.approx(expected, rel=1e-7)


def test_forces_of_the_strip_are_the_derivative_of_its_energy():
    strip, rng = SwingingStrip(8), np.random.default_rng(3)
    coefficients, direction = strip.start + 0.02 * rng.normal(size=(2, 8)), rng.normal(size=(2, 8))

    def energy(t):
        return sum(strip.strain_forces(coefficients + t * direction)[1:])

    step = 1e-4
    slope = (8 * (energy(step) - energy(-step)) - (energy(2 * step) - energy(-2 * step))) / (12 * step)
    assert np.sum(strip.strain_forces(coefficients)[0] * direction) == pytest.approx(slope, rel=1e-8)


def test_the_strip_starts_as_gravity_and_hinge_have_it():
    """With stiffness out of play at rest, only the hinge keeps the strip from falling freely."""
    strip = SwingingStrip(12)
    acceleration, hinge = strip.acceleration(strip.start)
    assert acceleration[1] @ (-1.0) ** np.arange(12) == pytest.approx(0.0, abs=1e-9)
    weight = 0.144 * 0.1 * 9.8
    assert 0.0144 * acceleration[1, 0] == pytest.approx(hinge[1] - weight, rel=1e-12)
    assert hinge[0] == pytest.approx(0.0, abs=1e-12)


def test_the_strip_conserves_energy_and_stays_on_its_hinge():
    strip = SwingingStrip(12)
    for swing in strip.motion((0.1, 0.3), 1e-8):
        assert swing.kinetic > 0.005
        assert abs(swing.kinetic + swing.membrane + swing.bending + swing.potential) < 1e-9


def test_strip_and_cloth_swing_alike():
    """A short time: the hinge's force, which converges last, is left out."""
    expected = next(SwingingStrip(14).motion((0.1,), 1e-8))
    cloth = spline_strip(12, 4)
    (moment,) = motion(cloth, (0.1,), 1e-8)
    assert cloth.position(moment.coefficients, 1.0, 0.05)[[0, 2]] == pytest.approx(expected.tip, abs=2e-5)
    assert cloth.centre(moment.coefficients)[[0, 2]] == pytest.approx(expected.centre, abs=1e-6)
    assert np.ptp(moment.coefficients, axis=2).max() < 1e-9


def published_minimum(case, start, count):
    """Least value of rho int (s'^2 / 2 - g s) dt over s = t^start times polynomials, and s there."""
    powers = [Polynomial.basis(k + start) for k in range(count)]
    until = case.until
    stiffness = [[(a.deriv() * b.deriv()).integ()(until) for b in powers] for a in powers]
    load = np.array([case.gravity * a.integ()(until) for a in powers])
    coefficients = np.linalg.solve(stiffness, load)
    s = sum(c * p for c, p in zip(coefficients, powers, strict=True))
    return -case.density * case.side**2 * float(load @ coefficients) / 2, s


def test_the_published_functional_makes_a_square_fall_three_times_as_far_at_half_time():
    case = FreeFall()
    least, s = published_minimum(case, 1, 4)
    assert least == pytest.approx(case.published_functional, rel=1e-12)
    for time in (0.2, 0.5, 0.9):
        assert s(time) == pytest.approx(case.published_fall(time), rel=1e-10)
    assert case.published_fall(0.5) / case.fall(0.5) == pytest.approx(3.0, rel=1e-15)
    assert case.published_fall(1.0) / case.fall(1.0) == pytest.approx(1.0, rel=1e-15)
    assert s.deriv()(1.0) == pytest.approx(0.0, abs=1e-9)


def test_the_factor_of_the_published_field_leaves_an_infimum_and_no_minimum():
    """With t^2 before the field the value falls toward the same bound for ever, and the start is at rest in vain."""
    case = FreeFall()
    gaps = [published_minimum(case, 2, count)[0] - case.published_functional for count in (1, 2, 4, 8)]
    assert all(0 < finer < coarser / 1.5 for coarser, finer in pairwise(gaps))
    falls = [published_minimum(case, 2, count)[1] for count in (2, 4, 8)]
    assert all(s.deriv()(0.0) == 0.0 for s in falls)
    ratios = [s(0.5) / case.fall(0.5) for s in falls]
    assert ratios[0] < ratios[1] < ratios[2] < 3.0
    assert ratios[2] == pytest.approx(3.0, abs=0.1)


def test_free_fall_solves_newtons_law():
    values = free_fall()
    assert values["centre_z_500ms"].value == pytest.approx(-1.225, rel=1e-14)
    for label in ("500ms", "1000ms"):
        lost = 0.144 * 9.8 * -values[f"centre_z_{label}"].value
        assert values[f"kinetic_energy_{label}"].value == pytest.approx(lost, rel=1e-13)


# --- the paper's napkins ---------------------------------------------------------------------------


def test_corners_move_inward_by_the_ramp_of_the_case():
    cloth = moving_corners(Resolution(4, 3, 0.2))
    (moment,) = motion(cloth, (0.2,), 1e-8)
    inward = 0.2 * (0.2 - 0.05 * (1 - np.exp(-0.2 / 0.05)))
    assert cloth.position(moment.coefficients, 0.0, 1.0) == pytest.approx([inward, 1.0], abs=1e-8)
    assert cloth.position(moment.coefficients, 1.0, 1.0) == pytest.approx([1 - inward, 1.0], abs=1e-8)
    assert cloth.centre(moment.coefficients)[0] == pytest.approx(0.5, abs=1e-9)


def test_held_edges_stay_and_the_motion_is_symmetric():
    cloth = held_edges(Resolution(5, 3))
    (moment,) = motion(cloth, (0.2,), 1e-7)
    u = moment.coefficients
    rounding = 1e-12  # m, of displacements of .2 m: what is left depends on the processor
    assert np.abs(u[:, 0]).max() < rounding
    assert np.abs(u[:, :, 0]).max() < rounding
    assert np.allclose(u[0], u[1].T, rtol=0, atol=1e-9)
    assert cloth.centre(u)[2] < -0.1
    assert abs(cloth.energies(u, moment.velocity).total) < 1e-7


def test_breaks_are_symmetric_and_as_dense_at_both_ends():
    resolution = Resolution(8, 3, 0.05)
    both = toward_both_ends(resolution)
    assert both == pytest.approx(1 - both[::-1], abs=1e-15)
    assert len(both) == 9
    assert np.diff(both)[:4] == pytest.approx(np.sort(np.diff(both)[:4]))


@pytest.mark.long
def test_napkin_corner_is_the_limit_of_graded_meshes_too():
    """With grading the error at the support is of the same order, with another constant."""
    values = napkin_corner()
    graded = to_a_point(corner_values, [Resolution(n, 3, grading=0.03) for n in (16, 24, 32)])
    for name, estimate in values.items():
        room = 2 if name.startswith("corner") else 1  # graded meshes leave the whip of the free corner coarse
        assert abs(graded[name].value - estimate.value) < room * graded[name].uncertainty + estimate.uncertainty, name


def test_a_point_support_costs_the_power_of_its_capacity():
    """Steps between meshes whose spans have a ratio of 3/2 shrink by 1.5 ** CAPACITY, not by 1.5 as at first order."""
    coarse, medium, fine = (corner_values(Resolution(n, 3, UNIFORM), (0.2,)) for n in (8, 12, 18))
    for name in ("centre_x_200ms", "centre_y_200ms", "kinetic_energy_200ms", "membrane_energy_200ms"):
        order = np.log((medium[name] - coarse[name]) / (fine[name] - medium[name])) / np.log(1.5)
        assert order == pytest.approx(CAPACITY, abs=0.15), name


@pytest.mark.long
def test_napkins_with_moved_corners_and_held_edges_agree_with_other_meshes():
    moved, other = napkin_moving_corners(), moving_values(Resolution(40, 3, 0.05))
    for name, estimate in moved.items():
        assert abs(other[name] - estimate.value) < 5e-3, name  # the other is not extrapolated
    held, other = napkin_fixed_edges(), edges_values(Resolution(36, 4))
    for name, estimate in held.items():
        assert abs(other[name] - estimate.value) < 3 * estimate.uncertainty, name


def test_a_falling_cloth_of_splines_has_the_closed_forms_values():
    values, second = free_fall(), free_fall_of_splines()
    assert values.keys() == second.keys()
    for name, estimate in values.items():
        assert second[name].value == pytest.approx(estimate.value, abs=second[name].uncertainty), name


# --- names and uncertainties -----------------------------------------------------------------------


def test_names_carry_place_direction_and_time():
    values = at_time(0.25, {"tip": np.array([1.0, 2.0])}, {"kinetic": 3.0}, "xz")
    assert values == {"tip_x_250ms": 1.0, "tip_z_250ms": 2.0, "kinetic_energy_250ms": 3.0}


def test_uncertainties_are_shared_by_the_components_of_a_vector_at_one_time():
    fine = {"hinge_x_100ms": 1.0, "hinge_z_100ms": 2.0, "hinge_z_200ms": 3.0, "kinetic_energy_100ms": 4.0}
    coarse = {"hinge_x_100ms": 1.5, "hinge_z_100ms": 2.0, "hinge_z_200ms": 3.0, "kinetic_energy_100ms": 3.75}
    found = between(fine, coarse, 0.125)
    assert {name: e.uncertainty for name, e in found.items()} == {
        "hinge_x_100ms": 0.625, "hinge_z_100ms": 0.625, "hinge_z_200ms": 0.125, "kinetic_energy_100ms": 0.375,
    }  # fmt: skip
    assert [e.unit for e in found.values()] == ["N", "N", "N", "J"]


def test_power_series_are_extrapolated_to_their_limit():
    meshes = [(h, {"tip_x_100ms": 2.0 + 3.0 * h, "tip_z_100ms": 1.0 - h + h**2}) for h in (0.4, 0.2, 0.1)]
    found = extrapolated(meshes, 0.0)
    assert found["tip_x_100ms"].value == pytest.approx(2.0, abs=1e-14)
    assert found["tip_z_100ms"].value == pytest.approx(1.0, abs=1e-14)
    assert found["tip_x_100ms"].uncertainty == pytest.approx(0.1 * 0.2, abs=1e-14)  # the last line misses as much
