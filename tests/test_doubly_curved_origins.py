"""Shells of revolution and the hyperbolic paraboloid: strains of every form, values and their second forms."""

import numpy as np
import pytest

from derivations import hemisphere, hypar, hyperboloid, revolution
from derivations.hypar_polynomials import Polynomials, strain_operators
from derivations.linear_splines import LinearShell, cartesian
from derivations.revolution_splines import SplineRevolution, minimiser
from derivations.spline_shell import Splines
from derivations.surface_strains import DERIVATIVES, first_variation
from shellbench.bench.catalogue import catalog

STEP = 1e-3  # of central differences: their error is a millionth of it squared, their rounding a hundredth of that


def derivatives(function, one, two):
    """Value and the five derivatives of function(xi1, xi2) by central differences of fourth order, (6, ...)."""
    near, far = 8 / 12, 1 / 12

    def first(at):
        return (near * (at(1) - at(-1)) - far * (at(2) - at(-2))) / STEP

    def second(at):
        return (-far * (at(2) + at(-2)) + 16 / 12 * (at(1) + at(-1)) - 30 / 12 * at(0)) / STEP**2

    by_one, by_two = (lambda k: function(one + k * STEP, two)), (lambda k: function(one, two + k * STEP))
    mixed = first(lambda k: first(lambda m: function(one + k * STEP, two + m * STEP)))
    found = function(one, two), first(by_one), first(by_two), second(by_one), second(by_two), mixed
    return np.array(found)


def exact(position, displacement, one, two):
    """Linear strains (6,) as the first variation of the exact ones, for any surface and displacement."""
    moved = derivatives(displacement, one, two)[1:]
    return np.einsum("ikc,kc->i", first_variation(derivatives(position, one, two)[1:])[1], moved)


def waves(one, two):
    """A smooth Cartesian displacement."""
    return np.array([np.sin(one + 2 * two), np.cos(2 * one - two) + one * two, np.exp(0.5 * one) * np.sin(two)])


def of_revolution(curve):
    """Position of a surface of revolution by theta and t."""

    def position(theta, t):
        r, z = (c[0, 0] for c in curve(np.array([t])))
        return np.array([r * np.cos(theta), r * np.sin(theta), z])

    return position


# --- strains -------------------------------------------------------------------------------------


@pytest.mark.parametrize("curve", [hyperboloid.curve, hemisphere.curve])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_harmonics_have_the_strains_of_the_exact_theory(curve, n):
    """Rows by t come first there; coordinates are (t, theta), so that the normal is that of the module."""
    t, rng = 0.4, np.random.default_rng(n)
    coefficients = rng.normal(size=(3, 3))  # U, V and W are parabolas in t
    amplitudes = [np.polynomial.Polynomial(c) for c in coefficients]
    position = of_revolution(curve)

    def displacement(s, theta):
        at = revolution.Meridian.at(curve, np.array([s]))
        u, v, w = np.array([a(s) for a in amplitudes]) * np.array(
            [np.cos(n * theta), np.sin(n * theta), np.cos(n * theta)]
        )
        c, d = np.cos(theta), np.sin(theta)
        out, up = u * at.tangent[0] + w * at.normal[0]
        return np.array([c * out - d * v, d * out + c * v, up])

    at = revolution.Meridian.at(curve, np.array([t]))
    q = np.array([[a.deriv(k)(t) if k else a(t) for a in amplitudes] for k in range(3)])
    found = np.einsum("kic,kc->i", at.strains_of_harmonic(n)[:, 0], q)
    physical = np.array([at.stretch[0] ** 2, at.radius[0] ** 2, at.stretch[0] * at.radius[0]])
    for theta, rows in ((0.0, [0, 1, 3, 4]), (np.pi / (2 * n), [2, 5])):
        expected = exact(lambda s, a: position(a, s), displacement, t, theta) / np.tile(physical, 2)
        np.testing.assert_allclose(found[rows], expected[rows], atol=1e-6 * np.abs(q).max() * n**2 * at.stretch[0])


def test_a_shift_of_a_shell_of_revolution_stores_nothing():
    """The shift along x is the harmonic 1 of amplitudes (1, -1, 0) in (e_r, e_theta, e_z)."""
    shell = SplineRevolution(hyperboloid.curve, Splines(np.linspace(0, 1, 5), 4), 1.0, 0.3, 0.1)
    one = np.ones(shell.splines.count)
    shift = np.concatenate([one, -one, 0 * one])
    for stiffness in shell.stiffnesses(1):
        assert abs(shift @ stiffness @ shift) < 1e-12 * np.trace(stiffness)
        assert np.abs(stiffness @ np.roll(shift, 1)).max() > 1e-3


@pytest.mark.parametrize(
    ("surface", "frame"),
    [(hemisphere.sphere, cartesian), (hypar.surface, cartesian), (hypar.surface, hypar.frame)],
    ids=["sphere", "hypar", "hypar in its frame"],
)
def test_splines_have_the_strains_of_the_exact_theory(surface, frame):
    one, two = 0.3, 0.2
    shell = LinearShell(surface, frame, (Splines(np.linspace(0, 1, 3), 3),) * 2, [], 1.0, 0.3, 0.1)

    def at(function, a, b):
        return function(np.array([a]), np.array([b]), 0, 0)[0]

    operator = shell._point_matrices(np.array([one]), np.array([two]))[0][0]
    parts = derivatives(lambda a, b: np.linalg.solve(at(frame, a, b).T, waves(a, b)), one, two)
    expected = exact(lambda a, b: at(surface, a, b), waves, one, two)
    np.testing.assert_allclose(np.einsum("rkc,kc->r", operator, parts), expected, atol=1e-6 * np.abs(expected).max())


def test_covariant_derivatives_have_the_strains_of_the_exact_theory():
    one, two = 0.3, 0.2

    def at(a, b):
        return hypar.surface(np.array([a]), np.array([b]), 0, 0)[0]

    def covariant(a, b):
        tangents = [hypar.surface(np.array([a]), np.array([b]), *order)[0] for order in ((1, 0), (0, 1))]
        normal = np.cross(*tangents)
        return np.array([*tangents, normal / np.linalg.norm(normal)]) @ waves(a, b)

    operator = strain_operators(np.array([one]), np.array([two]))[0][0]
    expected = exact(at, waves, one, two)
    found = np.einsum("rck,kc->r", operator, derivatives(covariant, one, two))
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("function", [hemisphere.sphere, hypar.surface, hypar.frame])
def test_derivatives_of_surfaces_and_frames(function):
    found = derivatives(lambda a, b: function(np.array([a]), np.array([b]), 0, 0)[0], 0.3, 0.2)[1:]
    expected = [function(np.array([0.3]), np.array([0.2]), *order)[0] for order in DERIVATIVES]
    np.testing.assert_allclose(found, expected, atol=1e-7)


# --- the values ----------------------------------------------------------------------------------


def test_what_minimises_leaves_held_rows_at_zero():
    rng = np.random.default_rng(0)
    root, load, row = rng.normal(size=(4, 4)), rng.normal(size=4), rng.normal(size=4)
    found = minimiser(root.T @ root, load, [row])
    left = load - root.T @ root @ found
    assert abs(row @ found) < 1e-12
    np.testing.assert_allclose(left - row * (row @ left) / (row @ row), 0.0, atol=1e-9)


@pytest.mark.parametrize("clamped", [True, False])
def test_a_hyperboloid_stores_half_the_work_of_its_load(clamped):
    values = hyperboloid.hyperboloid(1e-2, clamped)
    parts = values["membrane_energy"].value + values["bending_energy"].value
    assert parts == pytest.approx(values["strain_energy"].value, rel=1e-9)


def test_a_free_hyperboloid_bends_and_a_clamped_one_stretches():
    free, held = (hyperboloid.hyperboloid(1e-3, clamped) for clamped in (False, True))
    assert free["membrane_energy"].value < 1e-3 * free["bending_energy"].value
    assert held["bending_energy"].value < 0.02 * held["membrane_energy"].value


def test_the_forces_of_the_hemisphere_are_what_its_harmonics_say():
    """The series of the line load, 4 F / (pi R) sum cos n theta, has the resultant F on each quarter's first half."""
    n = np.arange(2, 4001, 4)
    half = np.pi / 4
    resultant = 4 * hemisphere.FORCE / np.pi * np.sum(np.sin(n * half) / n)
    assert resultant == pytest.approx(hemisphere.FORCE / 2, rel=1e-3)


def second_form(name):
    if name == "hemisphere_hole":
        return hemisphere.hemisphere_by_splines()
    rims, thickness = name.removeprefix("hyperboloid_").split("_", 1)
    return hyperboloid.hyperboloid_by_splines(float(thickness.replace("_", "-")), rims == "clamped")


@pytest.mark.parametrize("name", [*hyperboloid.HYPERBOLOIDS, pytest.param("hemisphere_hole", marks=pytest.mark.long)])
def test_second_forms_are_what_they_compute_and_agree(name):
    check_second_form(name, second_form(name))


def check_second_form(name, found):
    """The stored values are the computed ones, and agree with those that judge."""
    known = catalog.known_values(name)
    assert set(found) == {q.name for q in catalog.named_case(name).quantities} - {"largest_displacement"}
    for quantity, estimate in found.items():
        (second,) = known.of(quantity, "origin")
        judge = known.judge(quantity, "kirchhoff-love-linear")
        assert abs(second.value - estimate.value) <= 0.5 * second.uncertainty
        assert abs(second.value - judge.value) <= second.uncertainty + judge.uncertainty


# --- hyperbolic paraboloid -----------------------------------------------------------------------


def test_a_clamped_hypar_stores_half_the_work_of_its_load():
    answer = hypar.hypar_shell(1e-2, (6, 4), 4, 2).solve()
    assert answer.membrane + answer.bending == pytest.approx(answer.work, rel=1e-8)
    edge = [answer.displacement(-0.5, y) for y in (0.0, 0.2, 0.5)]
    inside = [answer.displacement(-0.5 + 1e-4, y) for y in (0.0, 0.2, 0.5)]
    assert np.abs(edge).max() < 1e-20
    normals = np.array([[1.0, 2 * y, 1.0] for y in (0.0, 0.2, 0.5)])
    turned = np.abs(np.sum(inside * normals, axis=1)).max() / 1e-4  # the slope, of the order of the distance
    assert turned < 1e-2 * abs(answer.displacement(0.5, 0.0)[2])


def test_ritz_values_of_the_hypar_rise_with_functions_and_stay_below_the_limit():
    limit = catalog.known_values("hypar_clamped_1e_2").judge("strain_energy", "kirchhoff-love-linear").value
    by_splines = [2 * hypar.hypar_shell(1e-2, *level).solve().work for level in (((4, 3), 4, 1), ((8, 6), 4, 2))]
    by_polynomials = [Polynomials(d, hypar.YOUNG, hypar.POISSON).solve(1e-2, hypar.LOAD * 1e-2)[1] for d in ((8, 6), (14, 11))]  # fmt: skip
    for coarse, fine in (by_splines, by_polynomials):
        assert 0.9 * limit < coarse < fine < limit


def test_coarse_polynomials_are_as_uncertain_as_they_say():
    known = catalog.known_values("hypar_clamped_1e_2")
    (found,) = hypar.hypars_by_polynomials([1e-2], (18, 14), (12, 10))
    for quantity, estimate in found.items():
        judge = known.judge(quantity, "kirchhoff-love-linear")
        assert abs(estimate.value - judge.value) <= estimate.uncertainty + judge.uncertainty


@pytest.mark.long
def test_second_forms_of_the_hypar_are_what_they_compute_and_agree():
    thicknesses = [catalog.named_case(name).material.thickness for name in hypar.HYPARS]
    for name, found in zip(hypar.HYPARS, hypar.hypars_by_polynomials(thicknesses), strict=True):
        check_second_form(name, found)
