"""The known values of the sleeve: variations, symmetries, classical limits, and the branch beyond buckling."""

from dataclasses import replace

import numpy as np
import pytest

from derivations import sleeve_tension as tension
from derivations.sleeve import Rims, Sleeve
from derivations.sleeve_buckling import (
    THICK,
    THIN,
    axisymmetric,
    bucklings,
    compressing,
    critical,
    softness,
    stiffness_at_rest,
    twisting,
)
from derivations.sleeve_functions import Around, along
from derivations.sleeve_path import (
    BEFORE,
    BEYOND,
    Level,
    buckled,
    margins,
    perturbed,
    states,
    thin_states,
    turned_over,
)
from derivations.sleeve_sector import Sector

RIMS = Rims(twist=0.3, shortening=0.02)


@pytest.fixture
def waved():
    """A sleeve of few functions with three waves, and random coefficients that move it by some thicknesses."""
    sleeve = Sleeve(THICK, functions=5, fold=3, harmonics=2)
    return sleeve, 0.02 * np.random.default_rng(4).normal(size=sleeve.size)


def slope(function, at, step):
    """Derivative of a function of one variable by a fourth-order difference."""
    return (8 * (function(at + step) - function(at - step)) - function(at + 2 * step) + function(at - 2 * step)) / (
        12 * step
    )


def position(sleeve, q, rims, theta, y):
    """Cartesian position at (points,) theta and y, (3, points): the definition of the deformation itself."""
    around = Around.real(theta, sleeve.fold, sleeve.harmonics).values[0]
    bases = [along(sleeve.functions, clamped, 2 * y / sleeve.length)[0] for clamped in (True, False, False)]
    values = [np.einsum("pm,mn,pn->p", around, c, b) for c, b in zip(q.reshape(sleeve.shape), bases, strict=True)]
    radial = sleeve.radius + values[0]
    axial = (1 - rims.shortening / sleeve.length) * y + values[1]
    turned = theta + rims.twist / sleeve.length * y
    c, s = np.cos(turned), np.sin(turned)
    return np.stack([radial * c - values[2] * s, axial, radial * s + values[2] * c])


def metric_and_curvature(surface, theta, y):
    """a_ab and b_ab of a surface (theta, y) -> (3, points) by nine-point differences, (2, 2, 2, points)."""
    nodes, step = np.arange(-4, 5), 0.02
    moments = np.vander(nodes, 9, increasing=True).T
    first, second = (np.linalg.solve(moments, np.eye(9)[k] * k) / step**k for k in (1, 2))
    grid = [
        theta[:, None, None] + step * nodes[:, None] + 0 * nodes,
        y[:, None, None] + step * nodes + 0 * nodes[:, None],
    ]
    x = surface(*(g.ravel() for g in grid)).reshape(3, -1, 9, 9)
    here = np.eye(9)[4]
    weights = {"1": (first, here), "2": (here, first), "11": (second, here), "22": (here, second), "12": (first, first)}
    d = {name: np.einsum("cpij,i,j->cp", x, *pair) for name, pair in weights.items()}
    n = np.cross(d["1"], d["2"], axis=0)
    n /= np.linalg.norm(n, axis=0)
    a = [[np.sum(d[i] * d[j], 0) for j in "12"] for i in "12"]
    b = [[np.sum(d[min(i, j) + max(i, j)] * n, 0) for j in "12"] for i in "12"]
    return np.array([a, b])


# --- functions and energy --------------------------------------------------------------------------


def test_rims_hold_the_displacement_and_its_normal_slope():
    ends = np.array([-1.0, 1.0])
    clamped, held = along(12, True, ends), along(12, False, ends)
    assert np.abs(clamped[:2]).max() < 1e-12
    assert np.abs(held[0]).max() < 1e-12
    assert np.abs(held[1]).min() > 0.1


def test_energy_is_that_of_the_cartesian_surface(waved):
    sleeve, q = waved
    y, weights = sleeve.gauss
    theta, along_axis = (g.ravel() for g in np.meshgrid(sleeve.angles, y, indexing="ij"))
    a, b = metric_and_curvature(lambda t, s: position(sleeve, q, RIMS, t, s), theta, along_axis)
    metric, curvature = metric_and_curvature(lambda t, s: position(sleeve, 0 * q, Rims(), t, s), theta, along_axis)
    inverse = np.linalg.inv(metric[..., 0])
    nu, h = sleeve.poisson, sleeve.thickness
    elastic = nu * np.einsum("ab,cd->abcd", inverse, inverse)
    elastic += (1 - nu) / 2 * np.einsum("ac,bd->abcd", inverse, inverse)
    elastic += (1 - nu) / 2 * np.einsum("ad,bc->abcd", inverse, inverse)
    stretching = sleeve.young * h / (1 - nu**2)
    area = np.tile(weights, len(sleeve.angles)) * sleeve.radius * 2 * np.pi / len(sleeve.angles)
    energies = [
        factor / 2 * np.einsum("abp,abcd,cdp,p->", strain, elastic, strain, area)
        for factor, strain in ((stretching, (a - metric) / 2), (stretching * h**2 / 12, curvature - b))
    ]
    assert sleeve.state(q, RIMS).energies == pytest.approx(energies, rel=1e-6)


def test_variations_are_derivatives_of_the_energy(waved):
    sleeve, q = waved
    state = sleeve.state(q, RIMS)
    way = np.random.default_rng(5).normal(size=sleeve.size)
    assert state.residual @ way == pytest.approx(
        slope(lambda s: sleeve.state(q + s * way, RIMS).energy, 0.0, 1e-4), rel=1e-7
    )
    turning = slope(lambda s: sleeve.state(q + s * way, RIMS).residual, 0.0, 1e-4)
    stiffness = state.second_variation()
    assert stiffness == pytest.approx(stiffness.T, rel=1e-12, abs=1e-12 * np.abs(stiffness).max())
    assert stiffness @ way == pytest.approx(turning, abs=1e-6 * np.abs(turning).max())


def test_torque_and_force_are_derivatives_of_the_energy(waved):
    sleeve, q = waved
    state = sleeve.state(q, RIMS)
    torque = slope(lambda t: sleeve.state(q, replace(RIMS, twist=t)).energy, RIMS.twist, 1e-3)
    force = slope(lambda d: sleeve.state(q, replace(RIMS, shortening=d)).energy, RIMS.shortening, 1e-4)
    assert state.torque == pytest.approx(torque, rel=1e-7)
    assert state.force == pytest.approx(force, rel=1e-7)


# --- symmetries ------------------------------------------------------------------------------------


def test_wave_numbers_of_an_axisymmetric_state_decouple():
    sleeve = Sleeve(THICK, functions=8)
    state = axisymmetric(sleeve, Rims(0.08, 0.004))
    ring = replace(sleeve, harmonics=2)
    q = np.zeros(ring.shape)
    q[:, :1] = state.coefficients.reshape(sleeve.shape)
    whole = ring.state(q.ravel(), state.rims).second_variation(ring.waves(0)).reshape(3, 5, 8, 3, 5, 8)
    for i, number in enumerate(range(-2, 3)):
        alone = state.second_variation(sleeve.waves(number)).reshape(3, 8, 3, 8)
        assert whole[:, i, :, :, i] == pytest.approx(alone, abs=1e-10 * np.abs(alone).max())
        for j in range(5):
            assert i == j or np.abs(whole[:, i, :, :, j]).max() < 1e-10 * np.abs(alone).max()


def test_bloch_numbers_of_a_sector_make_up_the_ring():
    sector = Sleeve(THICK, functions=4, fold=3, harmonics=1)
    q = 1e-3 * np.random.default_rng(6).normal(size=sector.size)
    rims = Rims(twist=0.15)
    ring = replace(sector, fold=1, harmonics=4)
    spread = np.zeros(ring.shape)
    spread[:, [0, 5, 6]] = q.reshape(sector.shape)  # 1, cos 3 theta, sin 3 theta
    state, whole = sector.state(q, rims), ring.state(spread.ravel(), rims)
    assert whole.energy == pytest.approx(state.energy, rel=1e-9)
    parts = [np.linalg.eigvalsh(state.second_variation(sector.waves(m))) for m in (-1, 0, 1)]
    together = np.linalg.eigvalsh(whole.second_variation(ring.waves(0)))
    assert np.sort(np.concatenate(parts)) == pytest.approx(together, rel=1e-5)


def test_turning_the_sleeve_over_is_a_symmetry_of_the_twist(waved):
    sleeve, q = waved
    kept = turned_over(sleeve)
    symmetric = np.zeros_like(q)
    symmetric[kept] = q[kept]
    theta, y = np.array([0.3, 1.1, 2.0]), np.array([0.4, -0.2, 0.1])
    one, other = (position(sleeve, symmetric, Rims(0.3), s * theta, s * y) for s in (1, -1))
    assert other == pytest.approx(one * np.array([[1], [-1], [-1]]))  # by pi about the first Cartesian axis
    residual = sleeve.state(symmetric, Rims(twist=0.3)).residual
    assert np.abs(np.delete(residual, kept)).max() < 1e-10 * np.abs(residual).max()


# --- before and at buckling ------------------------------------------------------------------------


def test_torque_before_buckling_is_that_of_a_membrane():
    sleeve = Sleeve(THIN, functions=40)
    membrane = 2 * np.pi * 0.25**3 * 2000.0 * THIN * 0.0045
    assert axisymmetric(sleeve, twisting(0.0045)).torque == pytest.approx(membrane, rel=1e-4)


def test_without_lateral_contraction_the_compressed_sleeve_stays_a_cylinder():
    sleeve = Sleeve(THICK, poisson=0.0, functions=10)
    state = axisymmetric(sleeve, compressing(0.02))
    assert np.abs(state.coefficients).max() < 1e-12
    assert state.force == pytest.approx(2 * np.pi * 0.25 * 5000.0 * THICK * (1 - 0.98**2) / 2 * 0.98, rel=1e-10)


@pytest.mark.long
def test_critical_force_of_a_thin_cylinder_is_the_classical_one():
    """2 pi E h^2 / sqrt(3) without lateral contraction; corrections are of order h / R and 1 / n^2."""
    sleeve = Sleeve(THIN, poisson=0.0, functions=44)
    classical = 2 * np.pi * 5000.0 * THIN**2 / np.sqrt(3)
    whole = classical / (2 * np.pi * 0.25 * THIN * 5000.0)
    first = bucklings(sleeve, compressing, range(11, 15), (0.9 * whole, 1.02 * whole))[0]
    assert first.state.force == pytest.approx(classical, rel=0.02)


@pytest.mark.long
def test_critical_torque_of_a_long_tube():
    """Timoshenko and Gere, Theory of Elastic Stability, ch. 11: two waves; clamped ends raise it less and less."""
    h, nu = 0.006, 0.25
    stress = 5000.0 / (3 * np.sqrt(2) * (1 - nu**2) ** 0.75) * (h / 0.25) ** 1.5
    torque = 2 * np.pi * 0.25**2 * h * stress
    excess = []
    for length, functions in ((16.0, 36), (32.0, 44)):
        scale = stress / 2000.0 * length / 0.25
        tube = Sleeve(h, length=length, functions=functions)
        found = bucklings(tube, twisting, (1, 2, 3), (0.95 * scale, 1.15 * scale))
        assert found[0].number == 2
        excess.append(found[0].state.torque / torque - 1)
    assert 0 < excess[1] < 0.03
    assert excess[0] > 2 * excess[1]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("path", "loads"), [(twisting, (0.05, 0.09)), (compressing, (0.015, 0.0265))])
def test_one_wave_number_turns_unstable_first(path, loads):
    sleeve = Sleeve(THICK, functions=24)
    first = bucklings(sleeve, path, range(13), loads)[0]
    below, beyond = (axisymmetric(sleeve, path(s * first.load), first.state.coefficients) for s in (0.9999, 1.0001))
    for number in range(13):
        at_rest = stiffness_at_rest(sleeve, number)
        assert softness(below, number, at_rest) > 0
        assert (softness(beyond, number, at_rest) < 0) == (number == first.number)


def test_compressed_thin_sleeve_buckles_at_either_rim():
    """Where the state bends: two modes, one at each rim, that hardly feel one another; the next is another one."""
    sleeve = Sleeve(THIN, functions=48)
    state, at_rest = axisymmetric(sleeve, compressing(0.0026)), stiffness_at_rest(sleeve, 13)
    first, second, third = (softness(state, 13, at_rest, rank) for rank in range(3))
    assert second - first < 1e-3 * (third - first)


def test_path_that_starts_beyond_buckling_is_refused():
    with pytest.raises(ValueError, match="first load"):
        bucklings(Sleeve(THICK, functions=12), twisting, (4,), (0.1, 0.12))


@pytest.mark.long
def test_thin_sleeve_buckles_into_eight_waves():
    """L. H. Donnell's equations with clamped rims give eight waves at 1.207e-3 N m: shallow waves, so too high."""
    first = bucklings(Sleeve(THIN, functions=30), twisting, range(5, 12), (0.004, 0.0055))[0]
    assert first.number == 8
    assert 0.94 < first.state.torque / 1.207e-3 < 1


@pytest.mark.long
def test_critical_loads_converge_faster_than_any_power():
    found = [critical(THICK, twisting, (4,), (0.07, 0.09), n).rims.twist for n in (10, 14, 18, 24)]
    errors = np.abs(np.array(found[:-1]) - found[-1])
    assert (errors[1:] < errors[:-1] / 30).all()


# --- beyond buckling -------------------------------------------------------------------------------

COARSE = Sleeve(THICK, functions=14, fold=4, harmonics=3)


def test_branch_begins_where_the_second_variation_vanishes():
    """The amplitude of the waves grows as the root of the twist beyond the critical one."""
    start = critical(THICK, twisting, (4,), (0.07, 0.09), COARSE.functions).rims.twist
    twists = start * np.array([1.004, 1.008])
    amplitudes = [np.abs(s.coefficients.reshape(COARSE.shape)[0, 1:3]).max() ** 2 for s in buckled(COARSE, twists)]
    crossing = twists[0] - amplitudes[0] * (twists[1] - twists[0]) / (amplitudes[1] - amplitudes[0])
    assert crossing == pytest.approx(start, rel=2e-4)


def test_torque_beyond_buckling_is_the_slope_of_the_energy():
    found = list(buckled(COARSE, (0.12, 0.16, 0.198, 0.199, 0.2, 0.201, 0.202)))
    e = [s.energy for s in found[2:]]
    assert found[4].torque == pytest.approx((8 * (e[3] - e[1]) - e[4] + e[0]) / 0.012, rel=1e-7)


def test_waves_take_energy_off_the_sleeve_and_may_turn_about_its_axis():
    (state,) = buckled(COARSE, (0.11,))
    plain = axisymmetric(Sleeve(THICK, functions=14), twisting(0.11))
    assert state.energy < 0.99 * plain.energy
    softest = margins(state)
    assert abs(softest[0]) < 1e-8
    assert min(softest[1], softest[2]) > 0.01


def test_branch_does_not_depend_on_how_it_is_entered():
    late = list(buckled(COARSE, (0.14,)))[-1]
    early = list(buckled(COARSE, (0.088, 0.1, 0.12, 0.14)))[-1]
    assert late.energy == pytest.approx(early.energy, rel=1e-9)
    assert np.abs(perturbed(COARSE, twisting(0.14))).max() > 0


@pytest.mark.long
def test_four_waves_stay_stable_to_half_a_radian():
    for state in states(Level(5, 24))[len(BEFORE) :]:
        softest = margins(state)
        assert softest[0] > -1e-9
        assert min(softest[1], softest[2]) > 0.005


@pytest.mark.long
def test_eight_waves_of_the_thin_sleeve_stay_stable_to_twice_the_critical_twist():
    coarse, fine = thin_states(Level(2, 28)), thin_states(Level(3, 34))
    for state in fine:
        softest = margins(state)
        assert abs(softest.pop(0)) < 1e-9
        assert min(softest.values()) > 5e-4
    assert [s.torque for s in coarse] == pytest.approx([s.torque for s in fine], rel=0.01 / 3)


def test_a_sector_of_splines_rests_without_energy_and_its_variations_are_derivatives():
    sector, rng = Sector(6, 5), np.random.default_rng(7)
    assert sum(sector.energies(sector.rest())) < 1e-25
    assert np.abs(sector.gradient(sector.rest())).max() < 1e-13
    c = sector.held(sector.rest() + 1e-3 * rng.normal(size=sector.rest().shape), 0.02)
    way = (sector.freedom(0.02) @ rng.normal(size=sector.freedom(0.02).shape[1])).reshape(c.shape)
    energy = slope(lambda s: sum(sector.energies(c + s * way)), 0.0, 1e-5)
    assert sector.gradient(c) @ way.ravel() == pytest.approx(energy, rel=1e-7)
    turning = slope(lambda s: sector.gradient(c + s * way), 0.0, 1e-5)
    assert sector.stiffness(c) @ way.ravel() == pytest.approx(turning, abs=1e-6 * np.abs(turning).max())
    assert sector.held(c + way, 0.02) == pytest.approx(c + way, abs=1e-12)  # free numbers leave the rims as they are


@pytest.mark.long
def test_values_beyond_buckling_converge_faster_than_any_power():
    torques = np.array(
        [[s.torque for s in states(Level(k, n))[-len(BEYOND) :]] for k, n in ((3, 16), (5, 24), (7, 32))]
    )
    errors = np.abs(torques[:2] - torques[2])
    assert (errors[1] < errors[0] / 50).all()


@pytest.mark.long
def test_five_waves_are_stable_only_far_from_where_they_begin():
    sleeve = Sleeve(THICK, functions=20, fold=5, harmonics=4)
    found = {s.rims.twist: min(list(margins(s).values())[1:]) for s in buckled(sleeve, (0.115, 0.15, 0.2, 0.3, 0.4))}
    assert found[0.115] < 0 < found[0.4]


# --- the sleeve twisted far: the least membrane energy between two bounds -----------------------


@pytest.mark.parametrize("twist", [0.2, 1.0, 2.0, 3.0])
def test_the_bounds_of_the_twisted_sleeve_meet_and_their_slope_is_the_torque(twist):
    below, torque = tension.lower_bound(twist)
    assert below < tension.upper_bound(twist) < 1.001 * below
    assert slope(lambda t: tension.lower_bound(t)[0], twist, 1e-3) == pytest.approx(torque, rel=1e-8)


def test_no_surface_between_twisted_rims_has_less_energy_than_the_bound():
    """Random smooth surfaces, evenly and unevenly strained: the quadratic energy of their exact strains is above."""
    theta = np.arange(24) * 2 * np.pi / 24
    s = (np.polynomial.legendre.leggauss(24)[0] + 1) / 2
    w = np.polynomial.legendre.leggauss(24)[1] / 2
    rng = np.random.default_rng(2)
    moduli = tension.YOUNG * tension.THICKNESS / (1 - tension.POISSON**2)
    for twist in (0.5, 2.0, 3.0):
        for size in (0.0, 0.02, 0.2):
            waist, waves = rng.uniform(-0.9, 0.1), size * rng.normal(size=(3, 2))

            def place(c, s, twist=twist, waist=waist, waves=waves):
                radius, bump = tension.RADIUS * (1 + waist * np.sin(np.pi * s)), np.sin(np.pi * s)
                turned = c + twist * s
                x = np.stack([radius * np.cos(turned), radius * np.sin(turned), tension.LENGTH * s + 0 * c])
                return x + bump * (waves @ np.stack([np.cos(2 * c), np.sin(3 * c)]).reshape(2, -1)).reshape(x.shape)

            c, y = np.meshgrid(theta, s, indexing="ij")
            d = 1e-5
            around = (place(c + d, y) - place(c - d, y)) / (2 * d * tension.RADIUS)
            along = (place(c, y + d) - place(c, y - d)) / (2 * d * tension.LENGTH)
            e1, e2 = (np.sum(around**2, axis=0) - 1) / 2, (np.sum(along**2, axis=0) - 1) / 2
            shear = np.sum(around * along, axis=0) / 2
            trace = e1 + e2
            density = moduli / 2 * (trace**2 - 2 * (1 - tension.POISSON) * (e1 * e2 - shear**2))
            energy = tension.AREA * float(np.mean(density, axis=0) @ w)
            assert energy > tension.lower_bound(twist)[0]
