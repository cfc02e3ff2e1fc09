"""The known values of the suite `shapes` that closed forms and series give: limits, symmetries, balances."""

import dataclasses

import numpy as np
import pytest

from derivations import (
    bent_in_plane,
    blown_tube,
    clamped_plate,
    guided_plate,
    oval_tube,
    pressed_motion,
    raft,
    rigid_turn,
    ring_twist,
)
from derivations.goursat_plate import goursat
from derivations.navier_plate import SquarePlate
from derivations.navier_plate import navier as navier_of_a_square
from derivations.plate import LoadedPlate, Mean, Point, Rectangle, Uniform
from derivations.plate_series import levy, navier, plate_2_1_point
from derivations.rhombic_elements import solve as by_elements
from derivations.rhombic_plate import Fit, Rhombus
from derivations.shapes_by_series import JUDGES, SECOND_FORMS
from shellbench.bench.catalogue import catalog

PLATE = Rectangle(100.0, 50.0, 1.0, 1e7, 0.3)


def test_every_case_has_two_forms_and_is_of_the_suite():
    assert JUDGES.keys() == SECOND_FORMS.keys()
    assert set(JUDGES) <= {
        case.name
        for suite in ("shapes", "bridge_shell", "cloth", "buckling", "benchmarks")
        for case in catalog.cases_of(suite)
    }


# --- simply supported rectangles ----------------------------------------------------------------


def test_series_of_the_plate_agree_with_timoshenko():
    """Table 8 for sides 2 : 1 and 1 : 1, rounded there."""
    for a, expected in ((100.0, 0.01013), (50.0, 0.00406)):
        plate = dataclasses.replace(PLATE, a=a)
        centre = levy(plate, Uniform(), 100, np.array([[a / 2, 25.0]]))[0][0]
        assert centre * plate.bending_stiffness / 50.0**4 == pytest.approx(expected, abs=5e-6)


def test_a_long_plate_is_a_beam_away_from_its_ends():
    plate = Rectangle(1.0, 50.0, 0.01, 1e7, 0.49)
    middle = levy(plate, Uniform(), 400, np.array([[0.5, 25.0]]))[0][0]
    assert middle == pytest.approx(5 / 384 / plate.bending_stiffness, rel=1e-10)


@pytest.mark.parametrize("solve", [lambda *p: levy(PLATE, *p), lambda *p: navier(PLATE, p[0], (p[1], p[1]), p[2])])
def test_a_force_here_moves_there_what_a_force_there_moves_here(solve):
    here, there = (30.0, 30.0), (65.0, 20.0)
    one = solve(Point(here), 400, np.array([there]))[0][0]
    other = solve(Point(there), 400, np.array([here]))[0][0]
    assert one == pytest.approx(other, rel=1e-12)


def test_sums_under_a_force_are_short_by_the_square_of_the_last_harmonic():
    case = plate_2_1_point()
    exact = JUDGES["plate_2_1_point"]()["strain_energy"].value
    terms = np.array([200, 400, 800])
    for solve in (lambda k: levy(case.plate, case.load, k, case.points), lambda k: navier(case.plate, case.load, (k, k), case.points)):  # fmt: skip
        errors = [exact - solve(k)[1] for k in terms]
        assert np.polyfit(np.log(terms), np.log(errors), 1)[0] == pytest.approx(-2, abs=0.02)


# --- clamped plates -----------------------------------------------------------------------------


def test_the_clamped_plate_agrees_with_timoshenko():
    values = JUDGES["clamped_plate_uniform"]()
    stiffness = clamped_plate.clamped_plate_uniform().plate.bending_stiffness
    assert values["centre_deflection"].value * stiffness / 1e8 == pytest.approx(0.00126, abs=6e-6)  # table 35


@pytest.mark.parametrize("solve", [lambda c: clamped_plate.ritz(c, 32), lambda c: goursat(c, 36, 20)])
def test_clamped_plates_are_reciprocal_and_still_on_their_rim(solve):
    here, there = (40.0, 22.0), (60.0, 28.0)
    rim, near = ((0.0, 20.0), (100.0, 35.0), (60.0, 0.0), (45.0, 50.0)), ((1e-3, 20.0),)
    ask = {"far": Mean((there,)), "rim": Mean(rim), "near": Mean(near)}
    one = solve(LoadedPlate(PLATE, Point(here), ask))[0]
    other = solve(LoadedPlate(PLATE, Point(there), ask | {"far": Mean((here,))}))[0]
    assert one[0] == pytest.approx(other[0], rel=1e-6)
    assert np.abs(one[1:5]).max() < 1e-6 * one[0]
    assert abs(one[5]) < 1e-6 * one[0]  # the slope vanishes too: with any, a thousandth from the rim would show it


def test_a_turned_plate_deflects_alike():
    load, places = Point((30.0, 40.0)), ((65.0, 20.0), (50.0, 25.0))
    turned = dataclasses.replace(PLATE, a=PLATE.b, b=PLATE.a)
    one = clamped_plate.ritz(LoadedPlate(PLATE, load, {"w": Mean(places)}), 20)
    back = LoadedPlate(turned, Point(load.place[::-1]), {"w": Mean(tuple(p[::-1] for p in places))})
    other = clamped_plate.ritz(back, 20)
    assert other[0] == pytest.approx(one[0], rel=1e-9)
    assert other[1] == pytest.approx(one[1], rel=1e-9)


# --- rhombic plates -----------------------------------------------------------------------------


def test_a_rhombus_of_right_angles_is_the_square_plate():
    square = Rhombus(90.0)
    plate = SquarePlate(poisson=0.3)
    centre, energy = navier_of_a_square(plate, 300)
    deflections, found = by_elements(square, 8, 10, np.array([[50.0, 50.0]]))
    assert deflections[0] == pytest.approx(centre, rel=1e-7)
    assert found == pytest.approx(energy, rel=1e-7)


@pytest.mark.parametrize("angle", [60.0, 30.0])
def test_a_rhombus_is_still_and_free_of_moments_on_its_rim(angle):
    fit = Fit(Rhombus(angle), 10, 10)
    long, short = fit.rhombus.half_diagonals
    t = np.linspace(0.003, 0.997, 201)
    z = t * long + 1j * (1 - t) * short
    values, laplacians = fit.functions(z)
    w = fit.deflection(z)
    bending = np.abs(z) ** 2 / 4 + laplacians @ fit.coefficients
    assert values.shape == laplacians.shape
    assert np.abs(w).max() < 1e-8 * fit.deflection(np.zeros(1))[0]
    assert np.abs(bending).max() < 1e-7


@pytest.mark.parametrize(("angle", "quoted"), [(60.0, 9.318e-4), (30.0, 1.485e-4)])
def test_rhombic_plates_agree_with_morley(angle, quoted):
    """Side 1, h .01, E 3e7, nu .3, load 1; he is quoted with four digits, cut off or rounded."""
    plate = Rhombus(angle, side=1.0, thickness=0.01, young=3e7)
    assert Fit(plate, 10, 10).deflection(np.zeros(1))[0] * plate.unit == pytest.approx(quoted, abs=1e-7)


# --- ring, tube ---------------------------------------------------------------------------------


def test_the_rings_energy_is_half_the_work_of_its_loads():
    ring = ring_twist.closed_form()
    r, weights = ring.points, ring.weights
    f, v = np.array([ring.at(x) for x in r]).T
    across = np.pi * ring_twist.LOAD * (weights * r) @ f / 2
    around = 2 * np.pi * ring_twist.TRACTION * (weights * r) @ v / 2
    assert ring.bending_energy()[0] == pytest.approx(across, rel=1e-10)
    assert ring.membrane_energy() == pytest.approx(around, rel=1e-10)


def test_the_ring_twists():
    total, twist = ring_twist.closed_form().bending_energy()
    assert 0.3 < twist / total < 0.4


def test_the_tubes_energy_is_half_the_work_of_its_pressure():
    tube = oval_tube.tube()
    x, weights = np.polynomial.legendre.leggauss(60)
    x, weights = (1 + x) * tube.length / 2, weights * tube.length / 2
    for solution in (oval_tube.by_polynomials(tube, 48), oval_tube.by_exponentials(tube)):
        outward = np.array([solution.amplitudes(s)[2] for s in x])
        work = np.pi * tube.radius * oval_tube.LOAD * weights @ outward
        assert sum(solution.energies) == pytest.approx(work / 2, rel=1e-9)


# --- rigid turns --------------------------------------------------------------------------------


def test_a_turn_keeps_distances_and_its_axis():
    x = rigid_turn.saddle(*np.random.default_rng(0).uniform(-1, 1, (2, 6)))
    moved = x + rigid_turn.turn(x, 77.0)
    apart = [np.linalg.norm(p[:, None] - p, axis=-1) for p in (x, moved)]
    np.testing.assert_allclose(*apart, atol=1e-14)
    on_axis = rigid_turn.CENTRE + 0.7 * rigid_turn.AXIS
    assert np.abs(rigid_turn.turn(on_axis, 77.0)).max() < 1e-15


def test_a_small_turn_is_the_large_one_to_first_order():
    x = rigid_turn.saddle(np.array([0.8]), np.array([0.3]))
    assert rigid_turn.turn(x, 1e-6) == pytest.approx(rigid_turn.small_turn(x, 1e-6), rel=1e-7)


def test_a_large_turn_is_strained_in_linear_theory(monkeypatch):
    """The energy sees what is no motion: a turn by 60 degrees, taken as small."""
    matrix = rigid_turn.expm(np.radians(60.0) * rigid_turn.generator()) - np.eye(4)
    monkeypatch.setattr(rigid_turn, "generator", lambda: matrix / np.radians(60.0))
    assert rigid_turn.sampled_energy(60.0, linear=True) > 1.0


# --- motion -------------------------------------------------------------------------------------


def test_the_pressed_plate_obeys_newton_from_rest():
    t, step = 0.043, 1e-4
    for m, pressure in pressed_motion.PRESSURES.items():
        ahead, now, behind = (pressed_motion.amplitude(m, s)[0] for s in (t + step, t, t - step))
        acceleration = (ahead - 2 * now + behind) / step**2
        force = pressure * np.sin(pressed_motion.RATE * t) - pressed_motion.frequency(m) ** 2 * now
        assert acceleration == pytest.approx(force, rel=1e-4)
        assert pressed_motion.amplitude(m, t)[1] == pytest.approx((ahead - behind) / (2 * step), rel=1e-4)
        assert pressed_motion.amplitude(m, 0.0) == (0.0, 0.0)


def test_the_work_of_the_pressure_is_in_the_plate():
    until = pressed_motion.TIMES[-1]
    t, weights = np.polynomial.legendre.leggauss(40)
    t, weights = (1 + t) * until / 2, weights * until / 2
    area = pressed_motion.A * pressed_motion.B / 4
    work = sum(
        area * p * weights @ (np.sin(pressed_motion.RATE * t) * [pressed_motion.amplitude(m, s)[1] for s in t])
        for m, p in pressed_motion.PRESSURES.items()
    )
    values = pressed_motion.pressed_motion()
    stored = values["kinetic_energy_100ms"].value + values["bending_energy_100ms"].value
    assert stored == pytest.approx(work, rel=1e-10)


def test_the_pressed_plate_stays_so_flat_that_it_is_linear():
    largest = max(abs(sum(pressed_motion.amplitude(m, t)[0] for m in (1, 2))) for t in np.linspace(0, 0.1, 101))
    assert (largest / pressed_motion.THICKNESS) ** 2 < pressed_motion.STIFFENING


# --- a plate on a bed, and a tube under pressure ------------------------------------------------


@pytest.mark.long
def test_the_bed_carries_what_presses_the_raft():
    deflection, work, bed = raft.series()
    (x, v), (y, w) = (np.polynomial.legendre.leggauss(n) for n in (40, 60))
    one, two = np.meshgrid((x + 1) * raft.LENGTH / 2, (y + 1) * raft.WIDTH / 2, indexing="ij")
    carried = (
        raft.BED * raft.LENGTH * raft.WIDTH / 4 * (v @ deflection(one.ravel(), two.ravel()).reshape(one.shape) @ w)
    )
    pressed = sum(peak * 2 / np.pi * (end - start) for start, end, peak in raft.LOADED)
    assert carried == pytest.approx(pressed, rel=1e-10)
    assert 0 < bed < work / 2


def test_the_bed_stores_what_the_guided_plate_stores_to_five_digits():
    membrane, bending, of_unit = guided_plate.stored()
    assert 0 < 1 - guided_plate.BED * of_unit / (membrane + bending) < 1e-5


def test_the_wall_of_the_guided_plate_is_moved_and_nothing_turns_at_its_ends():
    y, step = np.linspace(0.0, guided_plate.B, 7), 1e-3
    for x, inward in ((0.0, step), (guided_plate.A, -step)):
        end, beside, beyond = (guided_plate.prescribed(np.full(7, x + k * inward), y)[:, 2] for k in (0, 1, 2))
        assert np.abs(4 * beside - 3 * end - beyond).max() < 1e-9 * step * guided_plate.BENT[0]
    assert guided_plate.prescribed(np.zeros(7), y) == pytest.approx(np.tile([1.5, 0.0, 6.0], (7, 1)))


def test_a_tube_that_grows_little_is_barlow_s():
    small = 1e-6 * blown_tube.STRETCHING
    circumferential = blown_tube.STRETCHING + blown_tube.BENDING / blown_tube.RADIUS**2
    growth = small * blown_tube.RADIUS**2 / circumferential
    assert blown_tube.radius(small) - blown_tube.RADIUS == pytest.approx(growth, rel=1e-5)


# --- a plate bent in its plane --------------------------------------------------------------------


def test_what_holds_the_plate_that_is_bent_in_its_plane_balances_its_loads():
    """Forces on all four edges, and their moments about the centre that the case names, by Gauss's rule."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    force, moment = np.zeros(2), 0.0
    for axis, side in enumerate(bent_in_plane.SIDES):
        run = bent_in_plane.SIDES[1 - axis]
        for at, outward in ((0.0, -1.0), (side, 1.0)):
            for node, weight in zip(run * (nodes + 1) / 2, weights * run / 2, strict=True):
                place = np.array([at, node] if axis == 0 else [node, at])
                pull = weight * outward * bent_in_plane.forces(place)[axis]
                arm = place - bent_in_plane.CENTRE
                force, moment = force + pull, moment + arm[0] * pull[1] - arm[1] * pull[0]
    assert force == pytest.approx(np.zeros(2), abs=1e-9)
    assert moment == pytest.approx(0.0, abs=1e-9)


def test_the_strains_of_the_plate_that_is_bent_in_its_plane_are_those_of_its_forces():
    place, step = np.array([0.9, 0.4]), 1e-4
    slope = np.array(
        [
            (bent_in_plane.displacement(place + e) - bent_in_plane.displacement(place - e))[:2] / (2 * step)
            for e in step * np.eye(2)
        ]
    )
    strain, nu = (slope + slope.T) / 2, bent_in_plane.POISSON
    forces = bent_in_plane.STRETCHING / (1 - nu**2) * ((1 - nu) * strain + nu * np.trace(strain) * np.eye(2))
    assert forces == pytest.approx(bent_in_plane.forces(place), rel=1e-9)
