r"""Raasch's hook: two tangent arcs that curve in opposite senses, clamped at one end, sheared at the other.

The first arc of radius 14 turns by 60 degrees, the second of radius 46 back by 150 degrees; the strip is 20 wide along x and 2 thick,
E = 3300 and nu = 0.35 in units of inches and pounds (Knight 1997). At the clamped edge s = 0 of the first arc the displacement and
the rotation vanish. A force of 1 in total along the width, along x, is spread evenly over the free edge of the second arc. The other
two edges are free. At the joint, displacement and tangent plane are continuous, while the curvature jumps from -1/14 to 1/46: a
fold of no angle. About the middle of the width, u is even and v and w are odd: half of the hook is modelled.

The judge is a chain of two patches of splines, `folded_splines`, the second form polynomials, `folded_ritz`. Both converge at the rate
of the corners between the clamped edge and the free ones, toward which both are graded. Spans much smaller than the thickness
bring nothing more: the hook is soft, and rounding grows with the square of what they are divided by.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .estimate import Estimate
from .folded_ritz import Lengthwise, Prism, Section, Wall
from .folded_splines import Chain
from .patch import breaks

WIDTH, THICKNESS, YOUNG, POISSON, FORCE = 20.0, 2.0, 3300.0, 0.35, 1.0
RADII, ANGLES = (14.0, 46.0), (np.deg2rad(60.0), np.deg2rad(150.0))
LENGTHS = RADII[0] * ANGLES[0], RADII[1] * ANGLES[1]
HALF = WIDTH / 2
ARCS = (
    Wall(0, 1, np.pi / 2, LENGTHS[0], -1 / RADII[0]),
    Wall(1, 2, np.pi / 2 - ANGLES[0], LENGTHS[1], 1 / RADII[1]),
)
COARSE, FINE = (6, (6, 16, 5), 2), (6, (9, 24, 8), 3)
"""Degree, spans of both arcs and of half of the width, and halvings of the splines toward the corners and the joint."""
POLYNOMIALS = ((8, 7), (9, 8))
"""Degrees along s and x of the second form."""
SHARES = (0.06, 0.25, 0.75), (0.06, 0.3, 0.8)
"""Where the second form divides either arc, in shares of its length."""
WIDTHS = 0.0, 0.06 * HALF, 0.25 * HALF, HALF
ROUNDING_OF_HOOK = 3e-7
"""Relative: stiffness of the smallest span over that of the hook."""


def unit(name: str) -> str:
    """Unit of a quantity."""
    return "lbf in" if name.endswith("energy") else "in"


def _named(tip: float, points: dict[str, float], membrane: float, bending: float) -> dict[str, float]:
    """Values from the mean displacement of the tip, those of points, and the energies of half of the hook."""
    energies = {"membrane_energy": 2 * membrane, "bending_energy": 2 * bending}
    return {"tip_displacement": tip, **points, **energies, "strain_energy": 2 * (membrane + bending)}


def _by_splines(degree: int, spans: tuple[int, int, int], halvings: int) -> dict[str, float]:
    # 1. Spans halve toward the clamped edge, the joint and the free edge along x; toward the tip, where all is smooth, twice.
    first = breaks(0, LENGTHS[0], spans[0], (True, True), halvings)
    second = np.union1d(
        breaks(0, LENGTHS[1], spans[1], (True, False), halvings + 2), breaks(0, LENGTHS[1], spans[1], (False, True), 2)
    )
    odd, free = ("free", "zero"), ("free",) * 3
    chain = Chain(
        ARCS,
        (first, second),
        breaks(0, HALF, spans[2], (True,), halvings),
        degree,
        (("zero", "zero", "clamped"), free),
        (("free", "even"), odd, odd),
        (YOUNG, POISSON, THICKNESS),
    )
    # 2. The mean displacement of the tip, whose row is the load's but for its size.
    x, weights = (array.ravel() for array in chain.patches[1].splines[1].gauss)
    mean = np.sum([w / HALF * chain.place(1, 0, LENGTHS[1], at) for at, w in zip(x, weights, strict=True)], axis=0)
    found, membrane, bending = chain.solve(FORCE / 2 * mean)
    points = {
        "middle_displacement": float(chain.place(1, 0, LENGTHS[1], HALF) @ found),
        "joint_displacement": float(chain.place(1, 0, 0.0, HALF) @ found),
    }
    return _named(float(mean @ found), points, membrane, bending)


def _by_polynomials(across: int, along: int) -> dict[str, float]:
    walls: list[Wall] = []
    for arc, shares in zip(ARCS, SHARES, strict=True):
        ends = np.array([0.0, *shares, 1.0]) * arc.width
        for low, high in pairwise(ends):
            number = len(walls)
            direction = arc.direction + low * arc.curvature
            walls.append(Wall(number, number + 1, direction, high - low, arc.curvature))
    sets = {"u": Lengthwise(WIDTHS, along, "free", "even")}
    sets |= {kind: Lengthwise(WIDTHS, along, "free", "zero") for kind in "vw"}
    prism = Prism(Section(tuple(walls), across, {0: "uyzr"}), sets, THICKNESS, YOUNG, POISSON)
    last, joint = len(walls) - 1, len(SHARES[0]) + 1
    mean = prism.side_load(last, 0, 1 / HALF, walls[-1].width)
    found, membrane, bending = prism.solve(FORCE / 2 * mean)
    points = {
        "middle_displacement": float(prism.place(last, 0, walls[-1].width, HALF) @ found),
        "joint_displacement": float(prism.place(joint, 0, 0.0, HALF) @ found),
    }
    return _named(float(mean @ found), points, membrane, bending)


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    return {
        name: Estimate.between(value, coarse[name], unit(name), ROUNDING_OF_HOOK * abs(value))
        for name, value in fine.items()
    }


def raasch_hook() -> dict[str, Estimate]:
    """Known values by splines; the uncertainty is the change from fewer and larger spans."""
    return _estimates(_by_splines(*FINE), _by_splines(*COARSE))


def raasch_hook_by_polynomials() -> dict[str, Estimate]:
    """Known values by polynomials; the uncertainty is the change from lower degrees."""
    coarse, fine = (_by_polynomials(*degrees) for degrees in POLYNOMIALS)
    return _estimates(fine, coarse)
