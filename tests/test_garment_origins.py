"""The origins of garments: energies and forces belong together, rigid motions strain nothing, and hems fall freely."""

import numpy as np
import pytest

from derivations.explicit_motion import motion
from derivations.garments import DENSITY, GRAVITY, LENGTH, LOWER, SKIRT_WIND, UPPER, flag_of, skirt_of
from shellbench.bench.catalogue import catalog
from shellbench.problems.shell.case import build_case
from shellbench.solvers.fem.solver import FemSettings, FemSolver

HEM = np.array([-LOWER, 0.0, 0.0])
EARLY = 0.05  # s: a wave of 6.67 m/s has not come from the waist to the hem, which are .63 m apart


def fallen(time):
    """Position of the hem that nothing holds yet: gravity and wind, a sine of 2 t + 1, integrated twice."""
    twice = (np.sin(1) + 2 * time * np.cos(1) - np.sin(2 * time + 1)) / 4
    return HEM + time**2 / 2 * np.array(GRAVITY) + twice / DENSITY * np.array(SKIRT_WIND)


@pytest.mark.parametrize("cloth", [skirt_of(3, 3, 4), flag_of(4)], ids=["skirt", "flag"])
def test_forces_are_the_derivative_of_the_energy(cloth):
    rng, step = np.random.default_rng(1), 1e-5
    at, direction = 1e-2 * rng.normal(size=cloth.shape), rng.normal(size=cloth.shape)

    def energy(h):
        return sum(cloth.strain_forces(at + h * direction)[1:])

    slope = (8 * (energy(step) - energy(-step)) - energy(2 * step) + energy(-2 * step)) / (12 * step)
    assert np.sum(cloth.strain_forces(at)[0] * direction) == pytest.approx(slope, rel=1e-7)


def test_a_turned_skirt_is_not_strained():
    cloth = skirt_of(2, 3)
    s = cloth.splines[1]
    places = np.array([s.knots[i + 1 : i + 1 + s.degree].mean() for i in range(s.count)])  # of linear functions
    radius = LOWER + (UPPER - LOWER) / LENGTH * places
    rest = np.zeros(cloth.shape)  # 1, cos, cos 2, sin, sin 2
    rest[0, 1], rest[1, 0], rest[2, 3] = radius, places, radius
    c, d = np.cos(0.7), np.sin(0.7)
    turned = np.einsum("ij,jkl->ikl", [[c, -d, 0], [d, c, 0], [0, 0, 1]], rest)
    moved = np.zeros(cloth.shape)
    moved[0, 0] = 0.1
    assert max(cloth.strain_forces(turned - rest)[1:]) < 1e-25
    assert max(cloth.strain_forces(moved)[1:]) < 1e-25
    np.testing.assert_allclose(cloth.position(turned - rest, 0.0, 0.0), [c * LOWER, d * LOWER, 0], atol=1e-14)
    assert np.isclose(cloth.centre(rest * 0)[1], cloth._integrals[0] @ places / cloth._integrals[0].sum(), rtol=1e-12)


def test_the_hem_falls_freely_at_first():
    cloth = skirt_of(2, 12)
    (moment,) = motion(cloth, (EARLY,), 1e-5)
    np.testing.assert_allclose(cloth.position(moment.coefficients, np.pi, 0.0), fallen(EARLY), atol=3e-5)


@pytest.mark.long
def test_the_hem_of_the_elements_falls_freely_at_first():
    case = catalog.named_case("skirt")
    data = case.model_dump(mode="json", exclude_unset=True, exclude={"name"})
    asked = [next(q for q in data["quantities"] if q["name"] == "centre_y_200ms") | {"at": EARLY}]
    short = build_case(data | {"dynamics": {"until": EARLY}, "quantities": asked}, "skirt", "skirt")
    solution = FemSolver().solve(short, FemSettings(cells=(10, 4), time_step=1e-3))
    found = HEM + solution.displacement(np.array([[np.pi, 0.0]]), at=EARLY)[0]
    np.testing.assert_allclose(found, fallen(EARLY), atol=3e-4)
