"""The shells of the thinness study: roofs and pinched cylinders, each known by two independent forms."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from derivations import pinched_diaphragm as diaphragm
from derivations import pinched_free as free
from derivations.cylinder import strains_of_axial_harmonic
from derivations.exponentials import edge_displacement_of_roof_harmonic
from derivations.levy_roof import HALF_ANGLE, LOAD, roof, scordelis_lo, solve_roof
from shellbench.bench.catalogue import catalog

RATIOS = {
    "roof_thinness_1e_2": 1e-2,
    "roof_thinness_3e_3": 3e-3,
    "roof_thinness_1e_3": 1e-3,
    "roof_thinness_3e_4": 3e-4,
    "roof_thinness_1e_4": 1e-4,
}
CYLINDERS = {"cylinder_thinness_5e_3": 5e-3, "cylinder_thinness_5e_4": 5e-4, "cylinder_thinness_5e_5": 5e-5}
ORIGINALS = dict.fromkeys(RATIOS, "scordelis_lo") | dict.fromkeys(CYLINDERS, "pinched_cylinder_diaphragm")
LENGTHS = {"scordelis_lo": 50.0, "pinched_cylinder_diaphragm": 600.0}
CUTOFFS = 3200.0 * np.array([0.25, 0.35, 0.5, 0.7, 1.0])  # of the double series: the thinnest takes the longest
LEVELS = {  # last harmonic and degree, coarse and fine, of the second form; a harmonic is a plate from n^2 >> R / h on
    "cylinder_thinness_5e_3": ((106, 42), (160, 64)),
    "cylinder_thinness_5e_4": ((320, 85), (480, 128)),
    "cylinder_thinness_5e_5": ((640, 106), (960, 160)),
}
LAST_HARMONIC = 399  # of the exponentials: the values are in the references with that many


@cache
def thickness_of(name):
    return catalog.named_case(name).material.thickness


@cache
def computed(name):
    return scordelis_lo(thickness_of(name))


@cache
def by_exponentials(name, last_harmonic):
    """Edge deflection and largest displacement, m, harmonic by harmonic."""
    cylinder = roof(thickness_of(name))
    m = np.arange(1, last_harmonic + 1, 2)
    edge = [
        edge_displacement_of_roof_harmonic(
            strains_of_axial_harmonic(cylinder.radius, k * np.pi / cylinder.length),
            sum(cylinder.elasticity()),
            HALF_ANGLE,
            4 * LOAD / (k * np.pi),
        )
        for k in m
    ]
    _, v, w = np.sin(m * np.pi / 2) @ np.array(edge)
    return {"edge_deflection": v * np.sin(HALF_ANGLE) - w * np.cos(HALF_ANGLE), "largest_displacement": np.hypot(v, w)}


def cylinder_of(name):
    return dataclasses.replace(diaphragm.pinched_cylinder(), thickness=thickness_of(name))


@cache
def by_double_series(name):
    """Estimates of the pinched cylinder; the uncertainty is the change from half the cutoff, both extrapolated."""
    cylinder = cylinder_of(name)
    sums = np.array([diaphragm.flexibility_sums(cylinder, cutoff) for cutoff in CUTOFFS])
    factor = 2 * diaphragm.LOAD / (np.pi * cylinder.radius * cylinder.length)
    fine, coarse = (
        tuple(factor * diaphragm.extrapolate(CUTOFFS[part], column[part]) for column in sums.T)
        for part in (slice(2, 5), slice(0, 3))
    )
    values = diaphragm.pinched_estimates(cylinder, fine, coarse)
    return {"load_deflection" if q == "load_displacement" else q: value for q, value in values.items()}


@cache
def series_around(name, level):
    return free.solve_pinched(cylinder_of(name), free.DIAPHRAGM_END, *LEVELS[name][level])


def test_the_shells_are_those_of_the_obstacle_course_but_for_their_thickness():
    suite = catalog.find_suite("thinness")
    assert suite.study == "thinness"
    assert suite.order == tuple(ORIGINALS)
    assert {case.name for case in catalog.cases_of("thinness")} == set(ORIGINALS)
    for name, ratio in (RATIOS | CYLINDERS).items():
        case, original = catalog.named_case(name), catalog.named_case(ORIGINALS[name])
        assert case.material.thickness == pytest.approx(ratio * LENGTHS[original.name], rel=1e-14)
        assert case.model_copy(update={"material": original.material}).digest() == original.digest()
        assert not any(name in held for held in catalog.tolerances().values())


QUICK = ("roof_thinness_1e_2", "roof_thinness_1e_4")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.long]) for name in ORIGINALS]
)
def test_judges_are_what_the_series_gives(name):
    known = catalog.known_values(name)
    estimates = computed(name) if name in RATIOS else by_double_series(name)
    assert {value.quantity for value in known.values} == {q.name for q in catalog.named_case(name).quantities}
    for quantity, estimate in estimates.items():
        judge = known.judge(quantity, "kirchhoff-love-linear")
        assert abs(judge.value - estimate.value) <= 0.5 * judge.uncertainty
        assert 0.9 * estimate.uncertainty <= judge.uncertainty <= 2e-6 * judge.value


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", RATIOS)
def test_second_origins_are_what_the_exponentials_give_and_agree(name):
    known = catalog.known_values(name)
    fine, coarse = by_exponentials(name, LAST_HARMONIC), by_exponentials(name, LAST_HARMONIC // 2)
    rounding = roof(thickness_of(name)).rounding * fine["largest_displacement"]
    for quantity, value in fine.items():
        judge = known.judge(quantity, "kirchhoff-love-linear")
        (second,) = known.of(quantity, "origin")
        assert second.origin != judge.origin
        assert abs(second.value - value) <= 0.5 * second.uncertainty
        assert abs(value - coarse[quantity]) + rounding <= 1.1 * second.uncertainty
        assert abs(second.value - judge.value) <= second.uncertainty + judge.uncertainty


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.long]) for name in RATIOS]
)
def test_the_split_of_the_energy_is_how_the_energy_depends_on_the_thickness(name):
    """At a fixed load dW / d ln h = -(W_m + 3 W_b), W the strain energy: D grows like h, B like h^3."""
    step, offsets, weights = 0.005, np.array([-2, -1, 1, 2]), np.array([1, -8, 8, -1]) / 12
    energies = [solve_roof(roof(thickness_of(name) * np.exp(step * k)), 199, 64).load_works.sum() / 2 for k in offsets]
    slope = weights @ energies / step
    known = {v.quantity: v.value for v in catalog.known_values(name).values if v.role == "judge"}
    bending = (-slope - known["strain_energy"]) / 2
    assert known["bending_energy"] == pytest.approx(bending, rel=2e-5)
    assert known["membrane_energy"] == pytest.approx(known["strain_energy"] - bending, rel=2e-5)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] if ratio < 1e-3 else []) for name, ratio in CYLINDERS.items()]
)
def test_second_origins_of_the_cylinders_are_what_the_series_around_gives_and_agree(name):
    known = catalog.known_values(name)
    coarse, fine = (series_around(name, level).totals() for level in (0, 1))
    rounding = cylinder_of(name).rounding * fine[0]
    for quantity, value, rough in zip(("load_deflection", "membrane_energy"), fine, coarse, strict=True):
        judge = known.judge(quantity, "kirchhoff-love-linear")
        (second,) = known.of(quantity, "origin")
        assert second.origin != judge.origin
        assert abs(second.value - value) <= 0.5 * second.uncertainty
        assert abs(value - rough) + rounding <= 1.1 * second.uncertainty
        assert abs(second.value - judge.value) <= second.uncertainty + judge.uncertainty


@pytest.mark.parametrize("name", ["cylinder_thinness_5e_3", "cylinder_thinness_5e_4"])
def test_the_largest_displacement_of_a_thin_cylinder_is_under_the_load(name):
    x, t = np.linspace(0, LENGTHS[ORIGINALS[name]] / 2, 61), np.linspace(0, np.pi / 2, 91)
    size = np.linalg.norm(series_around(name, 0).displacement(x, t), axis=-1)
    assert np.unravel_index(np.argmax(size), size.shape) == (0, 0)
