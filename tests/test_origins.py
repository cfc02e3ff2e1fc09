"""The known values of the linear obstacle course: strains, limits, rates and second forms."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import zeta

from derivations import large_displacements as large
from derivations import pinched_cylinder_diaphragm, pinched_cylinder_free, scordelis_lo, square_plate, torsion
from derivations import pinched_diaphragm as diaphragm
from derivations import pinched_free as free
from derivations.cylinder import (
    Cylinder,
    strains_of_angular_harmonic,
    strains_of_axial_harmonic,
    strains_of_double_harmonic,
)
from derivations.elastica import Cantilever, extensible
from derivations.estimate import algebraic_series_sum
from derivations.exponentials import edge_displacement_of_roof_harmonic, end_displacement_under_point_load
from derivations.hinged_roof import Path, hinged_roof
from derivations.levy_roof import CROWN, HALF_ANGLE, LOAD, roof, solve_roof
from derivations.navier_plate import SquarePlate, levy, navier
from derivations.patch import Mesh, breaks, cylinder, plane, ring
from derivations.roll_up import Strip as RolledStrip
from derivations.roll_up import energies, rolled_strip
from derivations.spline_path import Condition, arc_length, displacement_control, equilibrium, load_control
from derivations.spline_shell import Shell, Splines, State
from derivations.strip import Strip
from derivations.surface_strains import first_variation, second_variation, strains


def slope(sizes, errors):
    """Fitted exponent of errors = constant * sizes^exponent."""
    return np.polyfit(np.log(sizes), np.log(np.abs(errors)), 1)[0]


def with_bending_stiffness_times(cylinder, factor):
    """The same cylinder with B multiplied and D kept."""
    stretch = np.sqrt(factor)
    return dataclasses.replace(cylinder, thickness=cylinder.thickness * stretch, young=cylinder.young / stretch)


# --- strains -----------------------------------------------------------------------------------


def strains_of_deformed_surface(radius, displacement, x, t):
    """Linearised (a - abar) / 2 and bbar - b, physical, shear doubled, from the deformed surface itself.

    Derivatives along the surface are by nine-point differences of position, in Cartesian components; the
    linearisation in the amplitude is by a complex step. displacement(x, t) gives (u, v, w) with w outward.
    """
    nodes = np.arange(-4, 5)
    moments = np.vander(nodes, 9, increasing=True).T
    first, second = (np.linalg.solve(moments, np.eye(9)[k] * [1, 1, 2][k]) for k in (1, 2))
    step_x, step_t = 0.05 * radius, 0.05
    value = np.eye(9)[4]
    xs, ts = np.meshgrid(x + step_x * nodes, t + step_t * nodes, indexing="ij")
    zero = np.zeros_like(xs)
    radial = np.stack([zero, np.cos(ts), np.sin(ts)])
    around = np.stack([zero, -np.sin(ts), np.cos(ts)])
    axial = np.stack([zero + 1, zero, zero])
    u, v, w = displacement(xs, ts)
    amplitude = 1e-20
    position = xs * axial + radius * radial + 1j * amplitude * (u * axial + v * around + w * radial)

    def derivative(along_x, along_t):
        return np.einsum("cij,i,j->c", position, along_x, along_t)

    a1, a2 = derivative(first, value) / step_x, derivative(value, first) / (radius * step_t)
    a11 = derivative(second, value) / step_x**2
    a22 = derivative(value, second) / (radius * step_t) ** 2
    a12 = derivative(first, first) / (step_x * radius * step_t)
    # Outward, as in `cylinder`: around x axial = radial.
    a3 = np.cross(a2, a1)
    a3 = a3 / np.sqrt(a3 @ a3)
    changes = [a1 @ a1 / 2, a2 @ a2 / 2, a1 @ a2, -a11 @ a3, -a22 @ a3, -2 * a12 @ a3]
    return np.imag(changes) / amplitude


@pytest.mark.parametrize("form", ["axial", "angular", "double"])
def test_strains_are_those_of_the_deformed_surface(form):
    radius, alpha, n = 2.0, 0.7, 3
    q = np.array([0.3, -0.8, 0.5])
    x, t = 0.37, 0.61
    cx, sx, ct, st = np.cos(alpha * x), np.sin(alpha * x), np.cos(n * t), np.sin(n * t)

    def displacement(x, t):
        return (
            q[0] * np.cos(alpha * x) * np.cos(n * t),
            q[1] * np.sin(alpha * x) * np.sin(n * t),
            q[2] * np.sin(alpha * x) * np.cos(n * t),
        )

    normal, shear = np.array([1, 1, 0, 1, 1, 0]), np.array([0, 0, 1, 0, 0, 1])
    if form == "axial":
        s = strains_of_axial_harmonic(radius, alpha)
        amplitudes = q * [ct, st, ct], q * n * [-st, ct, -st], -q * n**2 * [ct, st, ct]
        phase = normal * sx + shear * cx
    elif form == "angular":
        s = strains_of_angular_harmonic(radius, n)
        amplitudes = q * [cx, sx, sx], q * alpha * [-sx, cx, cx], -q * alpha**2 * [cx, sx, sx]
        phase = normal * ct + shear * st
    else:
        s = strains_of_double_harmonic(radius, alpha, n)[None]
        amplitudes = (q,)
        phase = normal * sx * ct + shear * cx * st
    strains = sum(s[k] @ amplitudes[k] for k in range(len(amplitudes))) * phase
    assert strains == pytest.approx(strains_of_deformed_surface(radius, displacement, x, t), rel=1e-7, abs=1e-9)


def test_rigid_motions_strain_nothing():
    radius, x = 3.0, 1.3
    across = strains_of_angular_harmonic(radius, 1)
    assert across[0] @ [0, -1, 1] == pytest.approx(np.zeros(6))  # shift across the axis
    tilt = across[0] @ [-radius, -x, x] + across[1] @ [0, -1, 1]
    assert tilt == pytest.approx(np.zeros(6))
    assert strains_of_angular_harmonic(radius, 0)[0] @ [1, 0, 0] == pytest.approx(np.zeros(6))  # along the axis


# --- the tail of a series ----------------------------------------------------------------------


def test_algebraic_tail_gives_the_zeta_function():
    n = np.arange(2.0, 60.0, 2.0)
    assert algebraic_series_sum(n, n**-3.0, power=3) == pytest.approx(zeta(3) / 8, rel=1e-12)


# --- plate -------------------------------------------------------------------------------------


def test_navier_and_levy_agree():
    assert navier(SquarePlate(), 500) == pytest.approx(levy(SquarePlate(), 2000), rel=1e-12)


def test_navier_agrees_with_timoshenko():
    plate = SquarePlate()
    unit = plate.pressure * plate.side**4 / plate.bending_stiffness
    assert navier(plate, 50)[0] / unit == pytest.approx(0.00406, abs=5e-6)  # table 8, rounded there


def test_navier_converges_with_its_rate():
    terms = np.array([8, 16, 32, 64])
    energies = np.array([navier(SquarePlate(), n)[1] for n in terms])
    assert slope(terms, energies - levy(SquarePlate(), 2000)[1]) == pytest.approx(-5, abs=0.1)


# --- roof --------------------------------------------------------------------------------------


@pytest.mark.parametrize("thickness", [0.5, 0.25, 0.025])
def test_roof_by_polynomials_and_by_exponentials(thickness):
    cylinder = roof(thickness)
    series = solve_roof(cylinder, last_harmonic=59, degree=64)
    edge = np.array([HALF_ANGLE])
    by_polynomials = np.einsum("pcj,mj->mc", series.strip.basis(edge)[0], series.coefficients)
    by_exponentials = [
        edge_displacement_of_roof_harmonic(
            strains_of_axial_harmonic(cylinder.radius, m * np.pi / cylinder.length),
            sum(cylinder.elasticity()),
            HALF_ANGLE,
            4 * LOAD / (m * np.pi),
        )
        for m in series.harmonics
    ]
    for ours, exact in zip(by_polynomials, by_exponentials, strict=True):
        assert ours == pytest.approx(exact, abs=1e-9 * np.linalg.norm(exact))


def test_roof_harmonics_converge_exponentially_in_the_degree():
    exact = solve_roof(roof(), 1, 64).load_works[0]
    errors = [abs(solve_roof(roof(), 1, p).load_works[0] / exact - 1) for p in (3, 6, 9)]
    assert errors[0] > 1e3 * errors[1] > 1e6 * errors[2]


def test_short_waves_of_the_roof_are_a_plate_in_bending_and_in_shear():
    """f^2 [cos^2 t / (B alpha^4) + 2 sin^2 t / ((1 - nu) D alpha^2)] over the arc, nu = 0: the rate of the series."""
    cylinder = roof(0.5)
    series = solve_roof(cylinder, 399, 80)
    alpha = series.harmonics * np.pi / cylinder.length
    load = 4 / np.pi / series.harmonics * LOAD
    cos2, sin2 = ((HALF_ANGLE + sign * np.sin(2 * HALF_ANGLE) / 2) / 2 for sign in (1, -1))
    bending = cos2 / (cylinder.bending_stiffness * alpha**4)
    shear = 2 * sin2 / (cylinder.membrane_stiffness * alpha**2)
    expected = load**2 * (bending + shear) * cylinder.radius * cylinder.length
    departure = np.abs(series.load_works / expected - 1)
    assert shear[-1] > bending[-1]  # the last harmonics see the slower term
    assert departure[series.harmonics > 50].max() < 0.01


def test_long_waves_of_a_roof_are_a_beam():
    """At a length far beyond the radius the first harmonic bends like a beam with the arc as section."""
    cylinder = dataclasses.replace(roof(), length=5000.0, thickness=2.5)
    series = solve_roof(cylinder, 1, 40)
    r, h, phi = cylinder.radius, cylinder.thickness, HALF_ANGLE
    inertia = h * r**3 * (phi + np.sin(phi) * np.cos(phi) - 2 * np.sin(phi) ** 2 / phi)
    inertia += h**3 / 12 * r * (phi + np.sin(phi) * np.cos(phi))  # the wall's own, by its slope cos t
    alpha = np.pi / cylinder.length
    beam = 4 / np.pi * LOAD * 2 * r * phi / (cylinder.young * inertia * alpha**4)
    assert series.deflection(cylinder.length / 2, HALF_ANGLE) == pytest.approx(beam, rel=2e-3)


def test_largest_displacement_of_the_roof_is_at_mid_length_of_the_straight_edge():
    series = solve_roof(roof(), 39, 48)
    largest, x, t = series.largest_displacement()
    assert (x, t) == pytest.approx((25.0, HALF_ANGLE))
    assert largest == pytest.approx(np.linalg.norm(series.displacement(np.array([25.0]), np.array([HALF_ANGLE]))))
    assert largest > series.deflection(25.0, HALF_ANGLE)


def test_held_coefficients_hold_the_crown():
    series = solve_roof(roof(), 3, 32)
    basis = series.strip.basis(np.array([0.0]))
    assert CROWN == ("V(left)", "W'(left)")
    assert np.abs(basis[0, 0, 1] @ series.coefficients.T).max() < 1e-15
    assert np.abs(basis[1, 0, 2] @ series.coefficients.T).max() < 1e-12


# --- pinched cylinders -------------------------------------------------------------------------


def test_diaphragm_by_double_fourier_and_by_ritz():
    ritz, membrane = free.solve_pinched(free.pinched_cylinder(), free.DIAPHRAGM_END, 160, 64).totals()
    values = pinched_cylinder_diaphragm()
    assert values["load_displacement"].value == pytest.approx(ritz, rel=1e-9)
    assert values["membrane_energy"].value == pytest.approx(membrane, rel=1e-8)


def test_plain_double_fourier_series_is_short_by_the_square_of_its_cutoff():
    cylinder = diaphragm.pinched_cylinder()
    cutoffs = np.array([100.0, 200.0, 400.0])
    at_load = (np.array([cylinder.length / 2]), np.array([0.0]))
    plain = [-diaphragm.displacement(cylinder, k, *at_load)[0, 0, 2] for k in cutoffs]
    exact = pinched_cylinder_diaphragm()["load_displacement"].value
    assert np.all(np.array(plain) < exact)
    assert slope(cutoffs, np.array(plain) - exact) == pytest.approx(-2, abs=0.05)


def test_plate_part_of_the_double_series_agrees_with_brute_force():
    cylinder = diaphragm.pinched_cylinder()
    cutoffs = np.array([400.0, 560.0, 800.0])
    sums = []
    for cutoff in cutoffs:
        m, n = diaphragm.harmonics(cylinder, cutoff)
        k2 = (m * np.pi / cylinder.length) ** 2 + (n / cylinder.radius) ** 2
        sums.append(np.sum(np.where(n == 0, 1, 2) / k2**2) / cylinder.bending_stiffness)
    assert diaphragm.plate_series(cylinder) > sums[-1]
    assert diaphragm.extrapolate(cutoffs, np.array(sums)) == pytest.approx(diaphragm.plate_series(cylinder), rel=1e-6)


def test_free_cylinder_by_polynomials_and_by_exponentials():
    cylinder = free.pinched_cylinder()
    series = free.solve_pinched(cylinder, free.FREE_END, 60, 64)
    # A harmonic's line load P / (pi R) a unit of arc, on half the length.
    load = free.LOAD / (np.pi * cylinder.radius)
    exact = [
        end_displacement_under_point_load(
            strains_of_angular_harmonic(cylinder.radius, int(n)), sum(cylinder.elasticity()), cylinder.length / 2, load
        )
        for n in series.n[1:]
    ]
    assert series.load_displacements[1:] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("end", [free.FREE_END, free.DIAPHRAGM_END])
def test_high_harmonics_of_a_point_load_are_those_of_a_plate(end):
    """W_n(0) -> P R^2 / (2 pi B n^3), with a remainder of order (h/R)^2 that does not fall with n."""
    cylinder = free.pinched_cylinder()
    series = free.solve_pinched(cylinder, end, 240, 64)
    plate = cylinder.radius**2 / (2 * np.pi * cylinder.bending_stiffness * series.n[1:] ** 3.0)
    departure = np.abs(series.load_displacements[1:] / plate - 1)
    assert departure[-1] < (cylinder.thickness / cylinder.radius) ** 2
    assert departure[-1] < departure[len(departure) // 2] < departure[len(departure) // 4]


def test_thin_free_cylinder_tends_to_the_inextensional_one_from_above():
    """Rayleigh: V = -W / n, W constant: W_n = 2 P R^3 / (pi B L (n^2 - 1)^2), a bound for each harmonic."""
    excess = []
    thicknesses = np.array([0.75, 0.1875, 0.046875])
    for thickness in thicknesses:
        cylinder = dataclasses.replace(free.pinched_cylinder(), thickness=thickness)
        series = free.solve_pinched(cylinder, free.FREE_END, 4, 80)
        n = series.n[1:].astype(float)
        bound = 2 * cylinder.radius**3 / (np.pi * cylinder.bending_stiffness * cylinder.length * (n**2 - 1) ** 2)
        excess.append(series.load_displacements[1:] / bound - 1)
    assert np.all(np.array(excess) > 0)
    # Bending of the free ends relaxes the Poisson moment in layers of width sqrt(R h).
    assert slope(thicknesses, np.array(excess)[:, 0]) == pytest.approx(0.5, abs=0.05)


def test_inextensional_series_gives_the_quoted_lower_bound():
    """0.149 P R^3 / (2 B L) (Timoshenko & Woinowsky-Krieger 1959, art. 121) is below the answer."""
    cylinder = free.pinched_cylinder()
    n = np.arange(2.0, 4000.0, 2.0)
    factor = cylinder.radius**3 / (cylinder.bending_stiffness * cylinder.length)
    series = 2 / np.pi * np.sum(1 / (n**2 - 1) ** 2)
    assert 2 * series == pytest.approx(0.149, abs=5e-4)
    assert pinched_cylinder_free()["load_displacement"].value > series * factor


@pytest.mark.parametrize("end", [free.FREE_END, free.DIAPHRAGM_END])
def test_largest_displacement_of_a_pinched_cylinder_is_under_the_load(end):
    series = free.solve_pinched(free.pinched_cylinder(), end, 80, 48)
    x, t = np.linspace(0, 300, 61), np.linspace(0, np.pi / 2, 91)
    field = series.displacement(x, t)
    magnitude = np.linalg.norm(field, axis=-1)
    assert np.unravel_index(np.argmax(magnitude), magnitude.shape) == (0, 0)
    assert field[0, 0, :2] == pytest.approx([0, 0], abs=1e-18)


def test_double_fourier_field_agrees_with_the_ritz_field():
    cylinder = free.pinched_cylinder()
    x, t = np.array([40.0, 170.0, 290.0]), np.array([0.4, 1.0, 1.5])
    ritz = free.solve_pinched(cylinder, free.DIAPHRAGM_END, 80, 64).displacement(x, t)
    fourier = diaphragm.displacement(cylinder, 160.0, cylinder.length / 2 + x, t)
    assert fourier == pytest.approx(ritz, abs=1e-4 * np.abs(ritz).max())


# --- energies ----------------------------------------------------------------------------------


def roof_energies(cylinder):
    series = solve_roof(cylinder, 39, 48)
    return series.load_works.sum() / 2, series.membrane_energies.sum(), series.bending_energies.sum()


def free_energies(cylinder):
    displacement, membrane = free.solve_pinched(cylinder, free.FREE_END, 120, 48).totals()
    return displacement, membrane, displacement - membrane


def diaphragm_energies(cylinder):
    factor = 2 / (np.pi * cylinder.radius * cylinder.length)
    displacement, membrane = (factor * s for s in diaphragm.flexibility_sums(cylinder, 200.0))
    return displacement, membrane, displacement - membrane


@pytest.mark.parametrize(
    ("energies", "cylinder"),
    [(roof_energies, roof()), (free_energies, free.pinched_cylinder()), (diaphragm_energies, free.pinched_cylinder())],
)
def test_energy_split_is_the_sensitivity_to_the_bending_stiffness(energies, cylinder):
    """dW/d(log B) = -W_bending at a given load, and Clapeyron: membrane and bending make half the work."""
    total, membrane, bending = energies(cylinder)
    step = 1e-3
    stiffer, softer = (energies(with_bending_stiffness_times(cylinder, np.exp(s)))[0] for s in (step, -step))
    assert (softer - stiffer) / (2 * step) == pytest.approx(bending, rel=1e-5)
    assert membrane + bending == pytest.approx(total, rel=1e-9)


# --- sleeve ------------------------------------------------------------------------------------


def test_twisted_sleeve_is_stationary_and_has_the_energy_of_the_strains():
    """Axisymmetric torsion among all Legendre trial functions with held, clamped rims.

    The angular harmonic 0 has sin(0) = 0 for V; its shear rows hold for V alone all the same.
    """
    sleeve = torsion.Sleeve()
    cylinder = Cylinder(sleeve.radius, sleeve.length, sleeve.thickness, sleeve.young, sleeve.poisson)
    strip = Strip(-sleeve.length / 2, sleeve.length / 2, 12)
    s = strains_of_angular_harmonic(sleeve.radius, 0)
    membrane, bending = (2 * np.pi * sleeve.radius * k for k in strip.stiffnesses(s, cylinder.elasticity()))
    twist = 0.3
    q = np.zeros(len(membrane))
    rims = [strip.end_coefficient(name) for name in ("V(left)", "V(right)")]
    q[rims] = -sleeve.radius * twist / 2, sleeve.radius * twist / 2
    force = (membrane + bending) @ q
    assert np.abs(np.delete(force, rims)).max() < 1e-12 * np.abs(force).max()
    assert q @ membrane @ q / 2 == pytest.approx(torsion.membrane_energy(sleeve, twist))
    assert q @ bending @ q / 2 == pytest.approx(torsion.bending_energy(sleeve, twist))
    assert force[rims[1]] * sleeve.radius == pytest.approx(torsion.torque_per_radian(sleeve) * twist)


def test_torque_of_a_thin_sleeve_is_that_of_a_membrane_tube():
    ratios = []
    thicknesses = np.array([0.05, 0.025, 0.0125])
    for thickness in thicknesses:
        sleeve = torsion.Sleeve(thickness=thickness)
        tube = 2 * np.pi * sleeve.radius**3 * sleeve.shear_modulus * thickness / sleeve.length
        ratios.append(torsion.torque_per_radian(sleeve) / tube - 1)
    assert slope(thicknesses, ratios) == pytest.approx(2, abs=1e-6)


# --- the values --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "compute", [square_plate, scordelis_lo, pinched_cylinder_diaphragm, pinched_cylinder_free, torsion.sleeve_torque]
)
def test_every_value_is_known_to_a_millionth(compute):
    values = compute()
    for name, estimate in values.items():
        assert estimate.uncertainty <= 1e-7 * abs(estimate.value), name
    energy = values["membrane_energy"].value + values["bending_energy"].value
    assert energy == pytest.approx(values["strain_energy"].value, rel=1e-9)


@pytest.mark.parametrize(
    ("compute", "coarse"),
    [
        (scordelis_lo, {"last_harmonic": 39, "degree": 30}),
        (pinched_cylinder_free, {"last_harmonic": 60, "degree": 32}),
        (pinched_cylinder_diaphragm, {"cutoff": 200.0}),
    ],
)
def test_uncertainty_of_a_coarse_value_covers_the_fine_one(compute, coarse):
    fine = compute()
    for name, estimate in compute(**coarse).items():
        assert abs(estimate.value - fine[name].value) <= estimate.uncertainty + fine[name].uncertainty, name


@pytest.mark.parametrize(
    ("compute", "quantity", "elements"),
    [
        # Extrapolated bicubic Hermite finite elements, in the digits given.
        (scordelis_lo, "edge_deflection", 0.3005925),
        (pinched_cylinder_diaphragm, "load_displacement", 1.828195e-5),
        (pinched_cylinder_free, "load_displacement", 4.64625e-4),
    ],
)
def test_series_agree_with_finite_elements(compute, quantity, elements):
    assert compute()[quantity].value == pytest.approx(elements, rel=1e-6)


# --- large displacements -----------------------------------------------------------------------


def central_difference(function, x, step):
    """Derivative of function(x) by every entry of x, its axes last."""
    columns = []
    for place in np.ndindex(x.shape):
        shift = np.zeros_like(x)
        shift[place] = step
        columns.append((function(x + shift) - function(x - shift)) / (2 * step))
    return np.moveaxis(np.array(columns), 0, -1).reshape(*columns[0].shape, *x.shape)


def test_variations_of_the_strains_are_their_derivatives():
    rng = np.random.default_rng(0)
    x, stress = rng.normal(size=(5, 3)), rng.normal(size=6)
    values, gradient = first_variation(x)
    np.testing.assert_array_equal(values, strains(x))
    np.testing.assert_allclose(gradient, central_difference(strains, x, 1e-6), atol=1e-7)
    hessian = second_variation(x, stress)
    expected = central_difference(lambda y: np.einsum("i,ikc->kc", stress, first_variation(y)[1]), x, 1e-6)
    np.testing.assert_allclose(hessian, expected, atol=1e-6)


@pytest.mark.parametrize("surface", [plane, ring, cylinder(2.0, 1), cylinder(2.0, 2)])
@pytest.mark.parametrize("orders", [(1, 0), (0, 1), (2, 0), (0, 2), (1, 1)])
def test_derivatives_of_the_surfaces(surface, orders):
    i, j = orders
    one, two, step = np.array([0.4]), np.array([1.7]), 1e-5
    a, b = (1, 0) if i else (0, 1)
    expected = (surface(one + a * step, two + b * step, i - a, j - b) - surface(one - a * step, two - b * step, i - a, j - b)) / (2 * step)  # fmt: skip
    np.testing.assert_allclose(surface(one, two, i, j), expected, atol=1e-9)


@pytest.mark.parametrize(("end", "value", "slope"), [("zero", 0, None), ("even", None, 0), ("clamped", 0, 0)])
def test_conditions_on_the_ends_of_splines(end, value, slope):
    splines = Splines(breaks(0.0, 3.0, 4, (True, True), 2), 4)
    reduction = splines.reduction((end, end)).toarray()
    for order, expected in ((0, value), (1, slope)):
        at_ends = splines.matrix(splines.breaks[[0, -1]], order) @ reduction
        assert (np.abs(at_ends).max() < 1e-12) == (expected == 0)
    assert np.linalg.matrix_rank(reduction) == reduction.shape[1] == splines.count - {"clamped": 4}.get(end, 2)


def free_plate(force=None):
    """A strip of 10 x 1, clamped at xi1 = 0."""
    splines = Splines(breaks(0.0, 10.0, 10), 6), Splines(breaks(0.0, 1.0, 1), 3)
    free = ("free", "free")
    ends = [(("zero", "free"), free), (("zero", "free"), free), (("clamped", "free"), free)]
    return Shell(plane, splines, ends, 1.2e6, 0.0, 0.1, edge_load=force)


def test_a_turned_plate_is_not_strained():
    splines = Splines(breaks(0.0, 2.0, 3), 4)
    shell = Shell(plane, (splines, splines), [(("free", "free"),) * 2] * 3, 1e6, 0.3, 0.01)
    # coefficients of a linear function are its values at the means of degree successive knots
    means = np.array([splines.knots[i + 1 : i + 5].mean() for i in range(splines.count)])
    x = np.stack([*np.meshgrid(means, means, indexing="ij"), np.zeros((len(means),) * 2)])
    turn = np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]])
    moved = (np.einsum("ij,jab->iab", turn, x) - x).ravel()
    stored = shell.energies(moved)
    assert max(stored) < 1e-18
    assert sum(shell.energies(0.1 * moved)) > 1.0


@pytest.mark.parametrize("make", [large.roof, large.pulled_cylinder, large.slit_ring])
def test_forces_and_tangent_are_derivatives_of_the_energy(make):
    shell = make(Mesh((2, 2), 3))
    rng = np.random.default_rng(1)
    free, direction = rng.normal(size=(2, shell.reduction.shape[1])) * 0.05
    step = 1e-6
    at = shell.linearised(free)
    ahead, behind = (shell.linearised(free + sign * step * direction) for sign in (1, -1))
    energy = sum(shell.energies(free + step * direction)) - sum(shell.energies(free - step * direction))
    assert at.forces() @ direction == pytest.approx(energy / (2 * step), rel=1e-6)
    change = (ahead.forces() - behind.forces()) / (2 * step)
    np.testing.assert_allclose(at.stiffness() @ direction, change, atol=1e-6 * np.abs(change).max())
    expected = at.stress + (ahead.stress - behind.stress) / 2
    np.testing.assert_allclose(at.predicted_stress(step * direction), expected, atol=1e-9 * np.abs(at.stress).max())


@pytest.mark.parametrize(
    ("make", "mesh", "place", "direction", "linear"),
    [
        (large.plate, Mesh((5, 5), 6), (50.0, 50.0), (0, 0, -1), square_plate),
        pytest.param(
            *(large.roof, Mesh((8, 6), 6), (np.radians(50), 25.0), (0, -1, 0), scordelis_lo), marks=pytest.mark.long
        ),
    ],
)
def test_small_loads_give_the_linear_values(make, mesh, place, direction, linear):
    shell, factor = make(mesh), 1e-3
    row = shell.row(*place, direction)
    rest = State(np.zeros_like(row), 0.0)
    there, back = (row @ equilibrium(shell, rest, Condition(0 * row, 1.0, sign * factor))[0].free for sign in (1, -1))
    expected = next(iter(linear().values())).value
    assert (there - back) / (2 * factor) == pytest.approx(expected, rel=2e-6)


def test_a_spline_shell_bends_as_the_plane_strip():
    shell = free_plate((0.0, 0.0, 4.0))
    *_, state = load_control(shell, [0.25, 0.5, 0.75, 1.0])
    expected = extensible(Cantilever(), 4.0)
    tip = shell.displacements(state.free, np.array([10.0]), np.array([0.0, 0.5, 1.0]))[0]
    np.testing.assert_allclose(tip[:, 0], -expected.shortening, rtol=1e-6)
    np.testing.assert_allclose(tip[:, 2], expected.deflection, rtol=1e-6)
    np.testing.assert_allclose(tip[:, 1], 0.0, atol=1e-9)
    np.testing.assert_allclose(shell.energies(state.free), (expected.membrane, expected.bending), rtol=1e-4)


def test_an_equilibrium_balances_its_load_and_meets_its_condition():
    shell = free_plate((0.0, 0.0, 4.0))
    up = shell.row(10.0, 0.5, (0.0, 0.0, 1.0))
    (state,) = displacement_control(shell, up, [5.0])
    assert up @ state.free == pytest.approx(5.0, rel=1e-12)
    unbalanced = state.factor * shell.load_vector - shell.linearised(state.free).forces()
    assert np.abs(unbalanced).max() < 1e-8 * np.abs(shell.load_vector).max()
    again, iterations = equilibrium(shell, state, Condition(np.zeros_like(up), 1.0, state.factor))
    assert iterations <= 2
    assert again.factor == pytest.approx(state.factor, rel=1e-12)


@pytest.mark.long
def test_a_path_passes_limit_points_of_both_kinds():
    path = Path.follow(hinged_roof(6.35, Mesh((3, 3), 4)), 28.0)
    deflections, loads = path.points.T
    for column in (0, 1):
        values = path.points[:, column]
        turn = path.turning(column, 1)
        first = np.flatnonzero(np.diff(values) < 0)[0]
        assert values[first] <= turn[column] <= values[first] + 0.05 * np.ptp(values)
    assert loads.min() < 0
    assert np.diff(deflections).min() < 0
    # on the path the load works: the energy is the integral of load over deflection
    work = 0.25 * np.sum(np.diff(deflections) * (loads[1:] + loads[:-1]) / 2)
    stored = sum(path.shell.energies(path.states[-1].free))
    assert work == pytest.approx(stored, rel=0.02)


def test_arc_length_states_are_equally_far_apart():
    shell = free_plate((0.0, 0.0, 4.0))
    rows = shell.row(10.0, 0.5, (0.0, 0.0, 1.0))[None]
    (first,) = displacement_control(shell, rows[0], [0.1])
    states = [State(np.zeros(rows.shape[1]), 0.0), first]
    for state, _ in zip(arc_length(shell, rows, 0.1, 0.5, first), range(6), strict=False):
        states.append(state)
    distances = [np.hypot(rows[0] @ (b.free - a.free), (b.factor - a.factor) / 0.1) for a, b in pairwise(states[2:])]  # fmt: skip
    np.testing.assert_allclose(distances, 0.5, rtol=0.02)


def test_the_rolled_strip_is_stationary():
    strip = RolledStrip()
    for factor in (0.25, 0.5, 1.0):
        arc = rolled_strip(strip, factor)

        def potential(stretch, turning, arc=arc, factor=factor):
            moved = dataclasses.replace(arc, stretch=stretch, turning=turning)
            work = factor * strip.moment * strip.width * moved.turning * moved.length
            return sum(energies(strip, moved)) - work

        scale = abs(potential(arc.stretch, arc.turning))
        step = 1e-5
        by_stretch = potential(arc.stretch + step, arc.turning) - potential(arc.stretch - step, arc.turning)
        by_turning = potential(arc.stretch, arc.turning + step) - potential(arc.stretch, arc.turning - step)
        assert abs(by_stretch) < 1e-9 * scale
        assert abs(by_turning) < 1e-9 * scale


def test_the_end_force_stores_its_work():
    strip = Cantilever()
    forces, weights = np.polynomial.legendre.leggauss(8)
    forces, weights = 2 * (forces + 1), 2 * weights
    end = extensible(strip, 4.0)
    complementary = weights @ [extensible(strip, force, 1e-10).deflection for force in forces]
    assert 4.0 * end.deflection - complementary == pytest.approx(end.membrane + end.bending, rel=1e-7)
