r"""Plate, roof, pinched cylinder and plane napkin at the held-out materials of the cases `conditioned_*`, and their derivatives.

The materials are drawn here again: thickness h and Young's modulus E evenly by their logarithm, Poisson's ratio nu evenly.
The displacements come from the series of `navier_plate`, `levy_roof` and `pinched_diaphragm`, which take any material,
and from their second forms. Under loads that do not depend on the material all are inversely proportional to E, so that

    d log w / d log E = -1  exactly, and for the plate, w = c q a^4 / B, B = E h^3 / (12 (1 - nu^2)),
    d log w / d log h = -3,  d log w / d nu = -2 nu / (1 - nu^2).

The other derivatives are difference quotients of fourth order of the series.

The napkin moves in its plane, from its soft pin (`motion`, `polynomial_napkin`). There h and E enter by their product
alone. A value or derivative is as uncertain as the most uncertain of its kind: a single one may agree by chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from .cylinder import Cylinder, strains_of_axial_harmonic
from .estimate import ROUNDING, Estimate
from .explicit_motion import motion
from .exponentials import edge_displacement_of_roof_harmonic
from .levy_roof import HALF_ANGLE, solve_roof
from .levy_roof import LOAD as ROOF_LOAD
from .motion import GRAVITY, PIN, Resolution
from .navier_plate import SquarePlate, levy, navier
from .pinched_diaphragm import LOAD, extrapolate, flexibility_sums
from .pinched_free import DIAPHRAGM_END, solve_pinched
from .polynomial_napkin import DENSITY, PolynomialNapkin
from .spline_motion import Cloth

SEED, COUNT, DERIVED = 20, 20, 3  # of the draw, materials, and how many of them have derivatives
STEP = 0.04  # of difference quotients, in log h and nu; the coarser one takes twice that
LOST = 10.0  # digits of rounding that exact exponentials lose, as in `exponential_shells`
BY = ("thickness", "youngs_modulus", "poissons_ratio")

Pair = tuple[float, float]
"""The same displacement, m, with many terms and with fewer."""


def drawn(thickness: Pair, young: Pair, poisson: Pair) -> list[tuple[float, float, float]]:
    """The held-out materials (h, E, nu)."""
    shares = np.random.default_rng(SEED).random((COUNT, 3))
    h = np.exp(np.log(thickness[0]) + shares[:, 0] * np.log(thickness[1] / thickness[0]))
    e = np.exp(np.log(young[0]) + shares[:, 1] * np.log(young[1] / young[0]))
    nu = poisson[0] + shares[:, 2] * (poisson[1] - poisson[0])
    return list(zip(h.tolist(), e.tolist(), nu.tolist(), strict=True))


def plate_by_navier(h: float, e: float, nu: float) -> Pair:
    plate = SquarePlate(thickness=h, young=e, poisson=nu)
    return navier(plate, 500)[0], navier(plate, 250)[0]


def plate_by_levy(h: float, e: float, nu: float) -> Pair:
    plate = SquarePlate(thickness=h, young=e, poisson=nu)
    return levy(plate, 2000)[0], levy(plate, 1000)[0]


def _roof(h: float, e: float, nu: float) -> Cylinder:
    return Cylinder(radius=25.0, length=50.0, thickness=h, young=e, poisson=nu)


def roof_by_polynomials(h: float, e: float, nu: float) -> Pair:
    fine, coarse = (
        solve_roof(_roof(h, e, nu), last, degree).deflection(25.0, HALF_ANGLE) for last, degree in ((99, 48), (65, 32))
    )
    return fine, coarse


def roof_by_exponentials(h: float, e: float, nu: float) -> Pair:
    cylinder = _roof(h, e, nu)
    m = np.arange(1, 100, 2)
    edge = np.array([
        edge_displacement_of_roof_harmonic(
            strains_of_axial_harmonic(cylinder.radius, k * np.pi / cylinder.length),
            sum(cylinder.elasticity()), HALF_ANGLE, 4 * ROOF_LOAD / (k * np.pi),
        )
        for k in m
    ])  # fmt: skip

    def summed(terms: int) -> float:
        _, v, w = np.sin(m[:terms] * np.pi / 2) @ edge[:terms]
        return float(v * np.sin(HALF_ANGLE) - w * np.cos(HALF_ANGLE))

    return summed(len(m)), summed(len(m) // 2)


def _cylinder(h: float, e: float, nu: float) -> Cylinder:
    return Cylinder(radius=300.0, length=600.0, thickness=h, young=e, poisson=nu)


def cylinder_by_double_series(h: float, e: float, nu: float) -> Pair:
    cylinder = _cylinder(h, e, nu)
    cutoffs = 800.0 * np.array([0.25, 0.35, 0.5, 0.7, 1.0])
    sums = np.array([flexibility_sums(cylinder, cutoff)[0] for cutoff in cutoffs])
    factor = 2.0 * LOAD / (np.pi * cylinder.radius * cylinder.length)
    return factor * extrapolate(cutoffs[2:], sums[2:]), factor * extrapolate(cutoffs[:3], sums[:3])


def cylinder_by_polynomials(h: float, e: float, nu: float) -> Pair:
    fine, coarse = (
        solve_pinched(_cylinder(h, e, nu), DIAPHRAGM_END, last, degree).totals()[0]
        for last, degree in ((200, 72), (132, 48))
    )
    return fine, coarse


NAPKIN = "conditioned_napkin"
UNTIL = 0.4
MIDDLE = (0.5, 0.5)
COUNTS = ((24, 16), (16, 12))  # of polynomials a side, and of spans of splines of the fourth degree
STEPPING = 1e-7  # tolerance of the steps of time, and what they leave of what is asked


@cache
def _fallen(form: int, count: int, stiffness: float, nu: float) -> float:
    """Fall of the middle, m, for E h in N/m."""
    gravity = (0.0, -GRAVITY)
    cloth: PolynomialNapkin | Cloth
    if form == 0:
        cloth = PolynomialNapkin(count, gravity, young=stiffness, poisson=nu, thickness=1.0)
    else:
        cloth = Cloth(Resolution(count, 4).splines, stiffness, nu, 1.0, DENSITY, gravity, 1.0, PIN)
    moment = next(motion(cloth, [UNTIL], STEPPING))
    return MIDDLE[1] - float(cloth.position(moment.coefficients, *MIDDLE)[1])


def _napkin(form: int, h: float, e: float, nu: float) -> Pair:
    fine, coarse = (_fallen(form, count, h * e, nu) for count in COUNTS[form])
    return fine, coarse


def napkin_by_polynomials(h: float, e: float, nu: float) -> Pair:
    return _napkin(0, h, e, nu)


def napkin_by_splines(h: float, e: float, nu: float) -> Pair:
    return _napkin(1, h, e, nu)


@dataclass(frozen=True)
class Question:
    """Ranges of h, E and nu, and two forms of the displacement; relative rounding of each at a material."""

    thickness: Pair
    young: Pair
    first: Callable[[float, float, float], Pair]
    second: Callable[[float, float, float], Pair]
    origins: tuple[tuple[str, str], tuple[str, str]]  # of both forms: what it is, and in which module
    rounding: Callable[[float, float, float], float]
    poisson: Pair = (0.0, 0.45)
    theory: str = "kirchhoff-love-linear-conditioned"

    @property
    def materials(self) -> list[tuple[float, float, float]]:
        return drawn(self.thickness, self.young, self.poisson)


QUESTIONS = {
    "conditioned_plate": Question(
        (0.4, 2.0), (3e6, 3e7), plate_by_navier, plate_by_levy,
        (("Navier's double sine series", "navier_plate"), ("Levy's single series", "navier_plate")),
        lambda h, e, nu: 100 * ROUNDING,
    ),
    "conditioned_roof": Question(
        (0.1, 0.5), (1e8, 1e9), roof_by_polynomials, roof_by_exponentials,
        (
            ("Fourier series along the axis, Legendre-Ritz along the arc", "levy_roof"),
            ("Fourier series along the axis, exact exponentials along the arc", "exponentials"),
        ),
        lambda h, e, nu: LOST * _roof(h, e, nu).rounding,
    ),
    "conditioned_cylinder": Question(
        (1.5, 7.5), (1e6, 1e7), cylinder_by_double_series, cylinder_by_polynomials,
        (
            ("double Fourier series, its plate part summed in closed form, its tail extrapolated", "pinched_diaphragm"),
            ("Fourier series along the arc, Legendre-Ritz along the axis, tail extrapolated", "pinched_free"),
        ),
        lambda h, e, nu: LOST * _cylinder(h, e, nu).rounding,
    ),
    NAPKIN: Question(
        (0.001, 0.0015), (4000.0, 8000.0), napkin_by_polynomials, napkin_by_splines,
        (
            ("Newton's law of Legendre polynomials", "polynomial_napkin"),
            ("Newton's law of tensor-product splines", "motion"),
        ),
        lambda h, e, nu: STEPPING, (0.15, 0.35), "kirchhoff-love-nonlinear-conditioned",
    ),
}  # fmt: skip


def value(name: str, number: int, form: int = 0) -> Estimate:
    """The displacement at a held-out material; the uncertainty is the change from fewer terms, plus rounding."""
    question = QUESTIONS[name]
    material = question.materials[number]
    fine, coarse = (question.first, question.second)[form](*material)
    return Estimate.between(fine, coarse, "m", question.rounding(*material) * abs(fine))


def sensitivity(name: str, number: int, by: str, form: int = 0) -> Estimate:
    """A derivative of its logarithm: by log h or nu, by difference quotients; by log E, -1, or of the napkin the same."""
    question = QUESTIONS[name]
    h, e, nu = question.materials[number]
    if by == "youngs_modulus" and name != NAPKIN:
        return Estimate.exact(-1.0, "") if form == 0 else numeric_modulus(name, number)
    if name == "conditioned_plate" and form == 0:
        return Estimate.exact(-3.0 if by == "thickness" else -2 * nu / (1 - nu**2), "")
    solve = (question.first, question.second)[form]

    def logarithms(step: float) -> np.ndarray:
        pair = solve(h, e, nu + step) if by == "poissons_ratio" else solve(h * math.exp(step), e, nu)
        return np.log(np.abs(pair))

    # Central differences over one, two and four steps, with many terms and with fewer; two of them give one of fourth
    # order.
    first, second, third = ((logarithms(step) - logarithms(-step)) / (2 * step) for step in (STEP / 2, STEP, 2 * STEP))
    near, far = (4 * first - second) / 3, (4 * second - third) / 3
    rounding = question.rounding(h, e, nu) / STEP
    return Estimate(float(near[0]), float(abs(near[0] - far[0]) + abs(near[0] - near[1]) + rounding), "")


def conditioned(name: str, form: int = 0, numbers: range = range(COUNT)) -> dict[str, Estimate]:
    """Known values of a case, by quantity; those of some materials if asked."""
    found = {f"value_{k:02d}": value(name, k, form) for k in numbers}
    found |= {f"by_{by}_{k:02d}": sensitivity(name, k, by, form) for k in numbers if k < DERIVED for by in BY}
    return as_uncertain_as_their_kind(found) if name == NAPKIN else found


def as_uncertain_as_their_kind(found: dict[str, Estimate]) -> dict[str, Estimate]:
    """The same values, each with the largest uncertainty of all that differ from it by the material alone."""
    worst: dict[str, float] = {}
    for quantity, estimate in found.items():
        kind = quantity.rpartition("_")[0]
        worst[kind] = max(worst.get(kind, 0.0), estimate.uncertainty)
    return {q: replace(estimate, uncertainty=worst[q.rpartition("_")[0]]) for q, estimate in found.items()}


def written(name: str) -> str:
    """The file of known values: both forms of each quantity."""
    lines = [
        f"# Known values of {name}, written by `python -m derivations.conditioned`, and recomputed by tests/test_conditioned_origins.py."
    ]
    both = [conditioned(name, form) for form in (0, 1)]
    for quantity in both[0]:
        for role, found, (origin, module) in zip(("judge", "origin"), both, QUESTIONS[name].origins, strict=True):
            estimate, locator = (
                found[quantity],
                f"derivations/{module}.py, at the material drawn in derivations/conditioned.py",
            )
            if quantity.startswith("by_"):
                locator = "derivations/conditioned.py"
                closed = role == "judge" and name != NAPKIN and ("youngs" in quantity or name == "conditioned_plate")
                origin = "closed form: a power of it" if closed else f"difference quotients: {origin}"
            lines += [
                "", "[[values]]", f'quantity = "{quantity}"', f'role = "{role}"', f"value = {estimate.value!r}",
                f"uncertainty = {estimate.uncertainty:.1e}", f'theory = "{QUESTIONS[name].theory}"',
                f'origin = "{origin}"', 'source = "shellbench"', f'locator = "{locator}"',
            ]  # fmt: skip
    return "\n".join(lines) + "\n"


def numeric_modulus(name: str, number: int) -> Estimate:
    """The derivative by log E from the second form itself, over one step."""
    question = QUESTIONS[name]
    h, e, nu = question.materials[number]
    above, below = (question.second(h, e * math.exp(way * STEP), nu)[0] for way in (1, -1))
    rounding = question.rounding(h, e, nu) / STEP + 1e-12
    return Estimate(math.log(above / below) / (2 * STEP), rounding, "")


if __name__ == "__main__":
    import sys
    from pathlib import Path

    for case in sys.argv[1:] or QUESTIONS:
        path = Path(__file__).parent.parent / "references" / f"{case}.toml"
        path.write_text(written(case), encoding="utf-8")
