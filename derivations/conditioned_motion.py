r"""The plane napkin on its soft pin at the held-out materials of the case `conditioned_napkin`, and a material's derivatives.

The materials are drawn as in `conditioned`. Asked is how far the middle has fallen at two times. In its plane the cloth
does not bend: thickness h and Young's modulus E enter by their product alone, so that derivatives by log h and log E
are equal. Two forms follow the motion: Legendre polynomials (`polynomial_napkin`), and splines (`spline_motion`). A value
is that of more functions; its uncertainty is the largest distance of those of fewer at any time, as a single one may
agree by chance.
"""

from __future__ import annotations

import math
from functools import cache

from .conditioned import BY, COUNT, drawn
from .estimate import Estimate
from .explicit_motion import motion
from .motion import GRAVITY, PIN, Resolution
from .polynomial_napkin import PolynomialNapkin
from .spline_motion import Cloth

NAME = "conditioned_napkin"
THICKNESS, YOUNG, POISSON, DENSITY = (0.001, 0.0015), (4000.0, 8000.0), (0.15, 0.35), 0.144
TIMES = (0.2, 0.4)
MIDDLE = (0.5, 0.5)
DERIVED = 1  # materials that have derivatives, of the last time
STEP = 0.02  # of difference quotients, in log h and nu; the coarser one takes twice that
TOLERANCE = 1e-7  # of the steps of time
ROUNDING = 1e-7  # what they leave, m
COUNTS = ((24, 16), (16, 12))  # functions a side: of polynomials, and spans of splines of the fourth degree
ORIGINS = ("Newton's law of Legendre polynomials", "Newton's law of tensor-product splines")
MODULES = ("polynomial_napkin", "motion")


def materials() -> list[tuple[float, float, float]]:
    """The held-out materials (h, E, nu)."""
    return drawn(THICKNESS, YOUNG, POISSON)


@cache
def fallen(form: int, count: int, stiffness: float, nu: float) -> tuple[float, ...]:
    """How far the middle has fallen at each time, m, from h E in N/m."""
    gravity = (0.0, -GRAVITY)
    cloth: PolynomialNapkin | Cloth
    if form == 0:
        cloth = PolynomialNapkin(count, gravity, young=stiffness, poisson=nu, thickness=1.0)
    else:
        cloth = Cloth(Resolution(count, 4).splines, stiffness, nu, 1.0, DENSITY, gravity, 1.0, PIN)
    return tuple(
        MIDDLE[1] - float(cloth.position(moment.coefficients, *MIDDLE)[1]) for moment in motion(cloth, TIMES, TOLERANCE)
    )


def values(number: int, form: int = 0) -> dict[str, Estimate]:
    """What is asked of a held-out material, at both times."""
    h, e, nu = materials()[number]
    fine, coarse = (fallen(form, count, h * e, nu) for count in COUNTS[form])
    apart = max(abs(one - other) for one, other in zip(fine, coarse, strict=True)) + ROUNDING
    return {
        f"value_{number:02d}_{1000 * at:.0f}ms": Estimate(one, apart, "m") for at, one in zip(TIMES, fine, strict=True)
    }


def sensitivities(number: int, form: int = 0) -> dict[str, Estimate]:
    """Derivatives of its logarithm at the last time: by log h, log E and nu, of fourth order."""
    h, e, nu = materials()[number]

    def derivative(count: int, by_ratio: bool) -> tuple[float, float]:
        def logarithm(step: float) -> float:
            moved = (h * e, nu + step) if by_ratio else (h * e * math.exp(step), nu)
            return math.log(fallen(form, count, *moved)[-1])

        near, far = ((logarithm(step) - logarithm(-step)) / (2 * step) for step in (STEP, 2 * STEP))
        return (4 * near - far) / 3, abs(near - far) / 3

    found = {}
    for by in BY:
        (fine, spread), (coarse, _) = (derivative(count, by == "poissons_ratio") for count in COUNTS[form])
        found[f"by_{by}_{number:02d}"] = Estimate(fine, spread + abs(fine - coarse) + ROUNDING / STEP, "")
    return found


def conditioned_napkin(form: int = 0, numbers: range = range(COUNT)) -> dict[str, Estimate]:
    """Known values by quantity; those of some materials if asked."""
    found: dict[str, Estimate] = {}
    for number in numbers:
        found |= values(number, form)
        if number < DERIVED:
            found |= sensitivities(number, form)
    return found


def written() -> str:
    """The file of known values: both forms of each quantity."""
    lines = [
        f"# Known values of {NAME}, written by `python -m derivations.conditioned_motion`, and recomputed by"
        " tests/test_conditioned_origins.py."
    ]
    both = [conditioned_napkin(form) for form in (0, 1)]
    for quantity in both[0]:
        for role, found, origin, module in zip(("judge", "origin"), both, ORIGINS, MODULES, strict=True):
            words = f"difference quotients: {origin}" if quantity.startswith("by_") else origin
            lines += [
                "", "[[values]]", f'quantity = "{quantity}"', f'role = "{role}"', f"value = {found[quantity].value!r}",
                f"uncertainty = {found[quantity].uncertainty:.1e}", 'theory = "kirchhoff-love-nonlinear-conditioned"',
                f'origin = "{words}"', 'source = "shellbench"',
                f'locator = "derivations/{module}.py, at the material drawn in derivations/conditioned_motion.py"',
            ]  # fmt: skip
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    from pathlib import Path

    (Path(__file__).parent.parent / "references" / f"{NAME}.toml").write_text(written(), encoding="utf-8")
