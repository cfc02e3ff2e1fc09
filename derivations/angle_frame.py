r"""Two plates at an angle in cylindrical bending: a frame whose bars have the stiffnesses D and B of a plate.

Planes of symmetry at x = 0 and x = WIDTH leave no strain along x: N_s = D eps_s, M = B omega', with omega the rotation about
e_x. The lower plate rises from its clamped edge (y, z) = (0, 0) to the fold (0, HEIGHT); the upper one rises by SLOPE to (REACH
cos SLOPE, HEIGHT + REACH sin SLOPE).

- `angle_frame`: the fold is rigid, and a force per length pulls at the free edge. Forces and moments follow from balance; the edge
  moves by the sum of N / D t and of M / B times the lever. The integrands are quadratic: Simpson's rule is exact.
- `hinged_angle`: the fold is a hinge, and the upper edge keeps its height z but slides along y. A pressure per area points down
  on the upper plate, and a force along y pulls at its edge. Both plates are statically determinate.

Moments m = B kap_s stretch the side of n = e_x cross t, left of the path from clamp to edge, and are -B omega'. The second forms
minimise the potential energy over polynomials of s by `folded_ritz`.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .folded_ritz import Lengthwise, Prism, Section, flat_walls
from .surface_strains import Array

HEIGHT, REACH, SLOPE = 1.0, 0.8, np.deg2rad(30.0)
WIDTH, THICKNESS, YOUNG, POISSON = 0.5, 0.04, 2e9, 0.3
STRETCHING = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = STRETCHING * THICKNESS**2 / 12
PULL = 30.0, -50.0
"""Force on the free edge along y and z, N/m."""
SLIDE, WEIGHT = 40.0, 100.0
"""Force along y on the edge that slides, N/m, and downward force on the upper plate, N/m^2."""
FOLD = np.array([0.0, HEIGHT])
EDGE = FOLD + REACH * np.array([np.cos(SLOPE), np.sin(SLOPE)])
DEGREE = 8
"""Of the second form in s: the exact solution is of degree 4 at most."""
ROUNDING_OF_FRAME = 1e-10


def unit(name: str) -> str:
    """Unit of a quantity: a moment is per length."""
    units = {"energy": "J", "turn": "rad", "moment": "N"}
    return next((u for key, u in units.items() if key in name), "m")


def _moment(place: Array) -> float:
    """Moment of the pull about a place, counter-clockwise from y to z, N."""
    arm = EDGE - place
    return float(arm[0] * PULL[1] - arm[1] * PULL[0])


def angle_frame() -> dict[str, Estimate]:
    """Known values of the rigid fold."""
    moved, turns, membrane, bending = np.zeros(2), [], 0.0, 0.0
    for first, second in ((np.zeros(2), FOLD), (FOLD, EDGE)):
        length = float(np.linalg.norm(second - first))
        t = (second - first) / length
        pull = float(t @ PULL)
        places = [first, (first + second) / 2, second]
        weights = length * np.array([1, 4, 1]) / 6
        moments = np.array([_moment(place) for place in places])
        levers = np.array([[-(EDGE - place)[1], (EDGE - place)[0]] for place in places])
        moved = moved + length * pull / STRETCHING * t + (weights * moments / BENDING) @ levers
        turns.append(float(weights @ moments) / BENDING)
        membrane += length * pull**2 / (2 * STRETCHING)
        bending += float(weights @ moments**2) / (2 * BENDING)
    return _exact(
        {
            "tip_y": moved[0],
            "tip_deflection": -moved[1],
            "fold_turn": turns[0],
            "fold_moment": -_moment(FOLD),
            "base_moment": -_moment(np.zeros(2)),
            "membrane_energy": WIDTH * membrane,
            "bending_energy": WIDTH * bending,
            "strain_energy": WIDTH * (membrane + bending),
        }
    )


def hinged_angle() -> dict[str, Estimate]:
    """Known values of the hinge."""
    # 1. Balance of the upper plate: the support's force, the force on the lower plate, the pull along the upper one.
    c, s = np.cos(SLOPE), np.sin(SLOPE)
    whole = WEIGHT * REACH
    support = whole / 2 + SLIDE * s / c
    down = whole - support
    pulls = np.array([SLIDE * c + support * s - whole * s, SLIDE * c + support * s])
    # 2. The lower plate is a cantilever, the upper one a bar on two supports that turns until its edge keeps its height.
    y, z = SLIDE * HEIGHT**3 / (3 * BENDING), -down * HEIGHT / STRETCHING
    longer = REACH * pulls.mean() / STRETCHING
    chord = -(z + longer * s) / (REACH * c)
    membrane = HEIGHT * down**2 / 2 + REACH * (pulls[0] ** 2 + pulls[0] * pulls[1] + pulls[1] ** 2) / 6
    bending = SLIDE**2 * HEIGHT**3 / 6 + (WEIGHT * c) ** 2 * REACH**5 / 240
    membrane, bending = WIDTH * membrane / STRETCHING, WIDTH * bending / BENDING
    return _exact(
        {
            "tip_y": y + longer * c - REACH * chord * s,
            "fold_y": y,
            "fold_turn_below": -SLIDE * HEIGHT**2 / (2 * BENDING),
            "fold_turn_above": chord - WEIGHT * c * REACH**3 / (24 * BENDING),
            "base_moment": SLIDE * HEIGHT,
            "middle_moment": -WEIGHT * c * REACH**2 / 8,
            "membrane_energy": membrane,
            "bending_energy": bending,
            "strain_energy": membrane + bending,
        }
    )


def _exact(values: dict[str, float]) -> dict[str, Estimate]:
    return {name: Estimate.exact(float(value), unit(name)) for name, value in values.items()}


def plane_strain(section: Section, width: float, thickness: float, young: float, poisson: float) -> Prism:
    """Trial functions that are constant along x: a degree that a cubic has, with planes of symmetry and one span."""
    even = Lengthwise((0.0, width), 3, "even", "even")
    return Prism(
        section,
        {"u": Lengthwise((0.0, width), 3, "clamped", "clamped"), "v": even, "w": even},
        thickness,
        young,
        poisson,
    )


def _solved(held: str, hinged: bool, load: tuple[float, float], weight: float) -> tuple[Prism, Array, float, float]:
    walls = tuple(flat_walls([(0.0, 0.0), tuple(FOLD), tuple(EDGE)], [(0, 1), (1, 2)]))
    section = Section(walls, DEGREE, {0: "uyzr", 2: held}, (1,) if hinged else ())
    prism = plane_strain(section, WIDTH, THICKNESS, YOUNG, POISSON)
    work = np.zeros(prism.size)
    for component, axis in zip((1, 2), walls[1].frame(0.0), strict=True):
        work += prism.side_load(1, component, float(axis @ load), REACH)
        work += prism.area_load(1, component, float(axis @ [0.0, -weight]))
    return prism, *prism.solve(work)


def _read(prism: Prism, found: Array, membrane: float, bending: float) -> dict[str, float]:
    x = WIDTH / 3

    def moved(wall: int, s: float) -> Array:
        return prism.section.walls[wall].frame(s).T @ [prism.place(wall, i, s, x) @ found for i in (1, 2)]

    return {
        "tip_y": moved(1, REACH)[0],
        "tip_deflection": -moved(1, REACH)[1],
        "fold_y": moved(0, HEIGHT)[0],
        "fold_turn": float(prism.place(0, 2, HEIGHT, x, 1) @ found),
        "fold_turn_below": float(prism.place(0, 2, HEIGHT, x, 1) @ found),
        "fold_turn_above": float(prism.place(1, 2, 0.0, x, 1) @ found),
        "fold_moment": float(prism.resultant("m_s", 0, HEIGHT, x) @ found),
        "base_moment": float(prism.resultant("m_s", 0, 0.0, x) @ found),
        "middle_moment": float(prism.resultant("m_s", 1, REACH / 2, x) @ found),
        "membrane_energy": membrane,
        "bending_energy": bending,
        "strain_energy": membrane + bending,
    }


def _by_ritz(exact: dict[str, Estimate], values: dict[str, float]) -> dict[str, Estimate]:
    return {
        name: Estimate(
            values[name], ROUNDING_OF_FRAME * abs(values["strain_energy" if "energy" in name else name]), unit(name)
        )
        for name in exact
    }


def angle_frame_by_ritz() -> dict[str, Estimate]:
    """Known values of the rigid fold by polynomials."""
    return _by_ritz(angle_frame(), _read(*_solved("", False, PULL, 0.0)))


def hinged_angle_by_ritz() -> dict[str, Estimate]:
    """Known values of the hinge by polynomials."""
    return _by_ritz(hinged_angle(), _read(*_solved("z", True, (SLIDE, 0.0), WEIGHT)))
