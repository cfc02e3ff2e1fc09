r"""Edited shells of the cases `edit_*`: plate, roof and strip as they are after the edit.

The plate with the load q0 x / a has the double series (Timoshenko & Woinowsky-Krieger 1959, art. 29)

    w = sum_{m, n odd} 8 q0 (-1)^(m+1) / (pi^6 B m n (m^2/a^2 + n^2/b^2)^2) sin(m pi x / a) sin(n pi y / b)

and the single one w = sum_m 2 q0 (-1)^(m+1) / (B m pi k^4) g(y) sin(k x), k = m pi / a, y from the middle, alpha = k b / 2,

    g(y) = 1 - ((alpha tanh alpha + 2) cosh k y - k y sinh k y) / (2 cosh alpha);

uniform load q has 4 q / (m pi) in the place of 2 q0 (-1)^(m+1) / (m pi), m odd. An edge x = a that is lifted by
c sin(pi y / b) adds f(x) sin(pi y / b), with k = pi / b,

    f'''' - 2 k^2 f'' + k^4 f = 0,  f(0) = f''(0) = 0,  f(a) = c,  f''(a) = nu k^2 c,

for no edge takes a moment: f = A sinh k x + D x cosh k x, D = -(1 - nu) k c / (2 sinh k a). The second form solves this
by collocation. The roof is that of `conditioned`, and the strip that of `elastica` and `plane_strip`: a wall that is
turned by an angle is the straight strip with the force turned back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.polynomial import chebyshev

from .conditioned import QUESTIONS
from .elastica import COARSE, FINE, Cantilever, extensible
from .estimate import ROUNDING, Estimate
from .navier_plate import SquarePlate
from .plane_strip import SPREAD, PlaneStrip

Point = tuple[float, float]
PLACES: dict[str, Point] = {"centre": (50.0, 50.0), "aside": (75.0, 50.0)}
LARGEST = 2.0  # of the growing load, Pa, and of the lift, m
TURN = float(np.radians(20.0))
EDITED = {"force": (5.0, 0.1, 0.0), "thickness": (4.0, 0.11, 0.0), "pose": (4.0, 0.1, TURN)}  # P, h, wall


def harmonics(m: np.ndarray, grows: bool) -> np.ndarray:
    """Sine coefficients of the load along x, Pa: uniform 1 Pa, or growing from 0 to `LARGEST`."""
    odd = m % 2 == 1
    return np.where(odd, 1.0, -1.0) * 2 * LARGEST / (m * np.pi) if grows else np.where(odd, 4 / (m * np.pi), 0.0)


def by_double_series(plate: SquarePlate, grows: bool, at: Point, terms: int) -> float:
    """Deflection, m, with so many harmonics a direction."""
    x, y = (np.pi * coordinate / plate.side for coordinate in at)
    m, n = np.arange(1.0, terms + 1), np.arange(1.0, terms + 1, 2)
    k4 = (np.pi / plate.side) ** 4 * (m[:, None] ** 2 + n**2) ** 2
    load = np.outer(harmonics(m, grows) * np.sin(m * x), 4 / (n * np.pi) * np.sin(n * y))
    return float(np.sum(load / k4) / plate.bending_stiffness)


def by_single_series(plate: SquarePlate, grows: bool, at: Point, terms: int) -> float:
    """Deflection, m, on the line in the middle between the edges y = 0 and y = b."""
    m = np.arange(1.0, terms + 1)
    k, alpha = m * np.pi / plate.side, m * np.pi / 2
    sech = 2 * np.exp(-alpha) / (1 + np.exp(-2 * alpha))
    middle = 1 - (alpha * np.tanh(alpha) + 2) * sech / 2
    return float(np.sum(harmonics(m, grows) / k**4 * middle * np.sin(k * at[0])) / plate.bending_stiffness)


def lift(plate: SquarePlate, at: Point) -> float:
    """Displacement, m, of a point on the middle line by the lifted edge, in closed form."""
    k, a, nu = np.pi / plate.side, plate.side, plate.poisson
    across = -(1 - nu) * k * LARGEST / (2 * np.sinh(k * a))
    along = (LARGEST - across * a * np.cosh(k * a)) / np.sinh(k * a)
    return float(along * np.sinh(k * at[0]) + across * at[0] * np.cosh(k * at[0]))


def lift_by_collocation(plate: SquarePlate, at: Point, degree: int) -> float:
    """The same by Chebyshev's polynomials that satisfy the equation at points, of x = a (1 + s) / 2."""
    half, k, nu = plate.side / 2, np.pi / plate.side, plate.poisson
    basis = np.eye(degree + 1)

    def values(s: np.ndarray, order: int) -> np.ndarray:
        return np.stack([chebyshev.chebval(s, chebyshev.chebder(row, order)) for row in basis], axis=-1) / half**order

    inside, ends = np.cos(np.pi * (np.arange(degree - 3) + 0.5) / (degree - 3)), np.array([-1.0, 1.0])
    rows = values(inside, 4) - 2 * k**2 * values(inside, 2) + k**4 * values(inside, 0)
    matrix = np.concatenate([rows / k**4, values(ends, 0), values(ends, 2) / k**2])
    right = np.concatenate([np.zeros(len(inside)), [0.0, LARGEST, 0.0, nu * LARGEST]])
    return float(values(np.array([at[0] / half - 1]), 0)[0] @ np.linalg.solve(matrix, right))


def _plate(poisson: float, form: int, grows: bool, at: Point) -> tuple[float, float]:
    plate, series = SquarePlate(poisson=poisson), (by_double_series, by_single_series)[form]
    many = (1000, 4000)[form]
    return series(plate, grows, at, many), series(plate, grows, at, many // 2)


def plate_force(form: int = 0) -> dict[str, Estimate]:
    """Known values of the plate under the growing load."""
    found = {}
    for name, at in PLACES.items():
        fine, coarse = _plate(0.0, form, True, at)
        found[f"{name}_deflection"] = Estimate.between(fine, coarse, "m", 100 * ROUNDING * fine)
    return found


def plate_pose(form: int = 0) -> dict[str, Estimate]:
    """Known values of the plate whose edge is lifted."""
    found, plate = {}, SquarePlate(poisson=0.3)
    for name, at in PLACES.items():
        fine, coarse = _plate(0.3, form, False, at)
        lifted = (lift(plate, at),) * 2 if form == 0 else tuple(lift_by_collocation(plate, at, n) for n in (28, 22))
        found[f"{name}_lift"] = Estimate.between(lifted[0] - fine, lifted[1] - coarse, "m", 100 * ROUNDING)
    return found


def roof_thickness(form: int = 0) -> dict[str, Estimate]:
    """Known values of the thicker roof."""
    question = QUESTIONS["conditioned_roof"]
    fine, coarse = (question.first, question.second)[form](0.3, 4.32e8, 0.0)
    rounding = question.rounding(0.3, 4.32e8, 0.0) * abs(fine)
    return {"edge_deflection": Estimate.between(fine, coarse, "m", rounding)}


def cantilever(what: str, form: int = 0) -> dict[str, Estimate]:
    """Known values of the edited strip."""
    force, thickness, wall = EDITED[what]
    case = Cantilever(thickness=thickness)
    if form == 0:
        fine, coarse = (extensible(case, force, tolerance, wall) for tolerance in (FINE, COARSE))
        return {
            "shortening": Estimate.between(fine.shortening, coarse.shortening, "m", SPREAD),
            "deflection": Estimate.between(fine.deflection, coarse.deflection, "m", SPREAD),
        }
    strip = PlaneStrip(case.length, case.thickness, case.young)
    load = force / case.width
    *_, bent = strip.path(np.arange(1, 9) / 8, force=load * np.cos(wall), pull=load * np.sin(wall))
    along, across = case.length - bent.shortening, bent.deflection
    x, z = along * np.cos(wall) - across * np.sin(wall), along * np.sin(wall) + across * np.cos(wall)
    found = {"shortening": case.length - x, "deflection": z}
    return {name: Estimate(float(value), SPREAD * case.length, "m") for name, value in found.items()}


Form = Callable[[int], dict[str, Estimate]]
EDITS: dict[str, Form] = {
    "edit_plate_force": plate_force,
    "edit_plate_pose": plate_pose,
    "edit_roof_thickness": roof_thickness,
    **{f"edit_cantilever_{what}": partial(cantilever, what) for what in EDITED},
}
PLANE = ("plane equations of equilibrium, integrated from the tip", "plane Ritz polynomials of the position")
ORIGINS = {
    "edit_plate_force": ("Navier's double sine series", "Levy's single series"),
    "edit_plate_pose": ("Navier's double sine series, the lift in closed form", "Levy's single series, the lift by collocation"),
    "edit_roof_thickness": QUESTIONS["conditioned_roof"].origins,
    **{f"edit_cantilever_{what}": PLANE for what in EDITED},
}  # fmt: skip


def written(name: str) -> str:
    """The file of known values: both forms of each quantity."""
    theory = "nonlinear" if "cantilever" in name else "linear"
    lines = [
        f"# Known values of {name}, written by `python -m derivations.edits`, and recomputed by tests/test_editing_origins.py."
    ]
    both = [EDITS[name](form) for form in (0, 1)]
    for quantity in both[0]:
        for role, found, origin in zip(("judge", "origin"), both, ORIGINS[name], strict=True):
            estimate = found[quantity]
            lines += [
                "", "[[values]]", f'quantity = "{quantity}"', f'role = "{role}"', f"value = {estimate.value!r}",
                f"uncertainty = {estimate.uncertainty:.1e}", f'theory = "kirchhoff-love-{theory}-edited"',
                f'origin = "{origin if isinstance(origin, str) else origin[0]}"', 'source = "shellbench"',
                'locator = "derivations/edits.py"',
            ]  # fmt: skip
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    import sys
    from pathlib import Path

    for case in sys.argv[1:] or EDITS:
        path = Path(__file__).parent.parent / "references" / f"{case}.toml"
        path.write_text(written(case), encoding="utf-8")
