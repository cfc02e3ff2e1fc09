r"""A closed box of four walls in uniform torsion: Bredt's formula with the twist of the walls.

The displacement v along a wall and w across it are held at both ends and turn there as a rigid section about the axis: by 0 at
x = 0 and by TWIST at x = L. Axial displacement and rotations are free, so N_x = M_x = 0. Then, exactly in the theory of Kirchhoff
and Love with rigid folds,

    u = u(s),   v = theta' x r,   w = theta' x s',   theta' = TWIST / L,

r the distance of the wall from the axis and s' that from the foot of its perpendicular. Every wall has the shear flow
q = G h (u_s + theta' r), alone of membrane forces, and the twist kap_xs = -theta', alone of curvatures. The rotation of each wall about
its fold is theta' x, so folds keep their angle; M_s = 0 and Q = M_s,s + 2 M_xs,x = 0, and q is continuous: a fold is in balance. The ring
integral of u_s vanishes, q = 2 A G h theta' / (ring integral of ds), A the enclosed area, and

    T = G theta' (4 A^2 / (ring integral of ds / h) + ring integral of h^3 ds / 3).

Half of the second part is the twisting moment M_xs over the ends of the walls, the other half the couple of the forces 2 M_xs at the
ends of the folds. The second form minimises the strain energy over polynomials by `folded_ritz`, the ends' displacement prescribed.

`held_girder` is the same box whose end x = 0 is clamped: it holds the axial displacement, and rotations too. Warping is then
restrained, and there is no closed form. By the planes y = 0 and z = 0, in which torsion is antisymmetric, a quarter is modelled, with
u = w = 0 on the middle lines of walls. Its judge is `folded_ritz`, its second form `folded_splines`, both graded toward the clamped end.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .folded_ritz import Lengthwise, Prism, Section, flat_walls
from .folded_splines import Chain
from .patch import breaks

DEPTH, WIDTH, LENGTH, THICKNESS = 0.6, 1.0, 3.0, 0.02  # along z, along y, along x, and of the walls, m
YOUNG, POISSON = 2.1e11, 0.3
TWIST = 1e-3
"""Turn of the end x = L about +x, rad."""
DEGREE = 5
"""Of the second form in s and x: the exact solution is of degree 1 in each."""
ROUNDING_OF_BOX = 1e-10


def unit(name: str) -> str:
    """Unit of a quantity."""
    units = {"energy": "J", "torque": "N m", "warping": "m", "flow": "N/m", "force": "N/m", "moment": "N"}
    return next(u for key, u in units.items() if key in name)


def box_girder() -> dict[str, Estimate]:
    """Known values in closed form; warping is that of the corner (y, z) = (WIDTH, DEPTH) / 2, the moment abs(M_xs)."""
    a, b, h, rate = WIDTH, DEPTH, THICKNESS, TWIST / LENGTH
    shear = YOUNG / (2 * (1 + POISSON))
    ring, area = 2 * (a + b), a * b
    flow = 2 * area * shear * h * rate / ring
    membrane = ring * LENGTH * flow**2 / (2 * shear * h)
    bending = shear * h**3 / 6 * ring * LENGTH * rate**2
    values = {
        "torque": shear * rate * (4 * area**2 * h / ring + ring * h**3 / 3),
        "shear_flow": flow,
        "twisting_moment": shear * h**3 / 6 * rate,
        "corner_warping": -rate * a * b * (a - b) / (4 * (a + b)),
        "membrane_energy": membrane,
        "bending_energy": bending,
        "strain_energy": membrane + bending,
    }
    return {name: Estimate.exact(value, unit(name)) for name, value in values.items()}


def box_girder_by_ritz() -> dict[str, Estimate]:
    """Known values by polynomials; the torque is twice the energy over the twist."""
    # 1. The walls counter-clockwise about +x: n = e_x cross t points inward.
    y, z = WIDTH / 2, DEPTH / 2
    nodes, strips = ((-y, -z), (y, -z), (y, z), (-y, z)), ((0, 1), (1, 2), (2, 3), (3, 0))
    section = Section(tuple(flat_walls(nodes, strips)), DEGREE, {})
    free, held = Lengthwise((0.0, LENGTH), DEGREE), Lengthwise((0.0, LENGTH), DEGREE, "zero")
    prism = Prism(section, {"u": free, "v": held, "w": held}, THICKNESS, YOUNG, POISSON)
    # 2. The end x = L: only its own value function moves it, by the turned section. Axially, no corner moves on average.
    given = np.full(prism.size, np.nan)
    turned, at_end = _turned(section, np.array([-y, -z])), held.at(np.array([LENGTH]))[0]
    moving = int(np.argmax(at_end))
    for kind in "vw":
        places = np.arange(prism.size)[prism.slots[kind]].reshape(-1, held.count)[:, moving]
        given[places] = TWIST * turned[prism.kinds[kind]] / at_end[moving]
    given[prism.slots["u"].start] = 0.0
    found, membrane, bending = prism.solve(np.zeros(prism.size), given)
    # 3. Values in the middle of the length; warping relative to the mean of two neighbouring corners.
    x = LENGTH / 2
    corners = [float(prism.place(wall, 0, 0.0, x) @ found) for wall in (2, 3)]
    values = {
        "torque": 2 * (membrane + bending) / TWIST,
        "shear_flow": float(prism.resultant("n_xs", 0, WIDTH / 3, x) @ found),
        "twisting_moment": -float(prism.resultant("m_xs", 0, WIDTH / 3, x) @ found),
        "corner_warping": (corners[0] - corners[1]) / 2,
        "membrane_energy": membrane,
        "bending_energy": bending,
        "strain_energy": membrane + bending,
    }
    return {name: Estimate(value, ROUNDING_OF_BOX * abs(value), unit(name)) for name, value in values.items()}


def _turned(section: Section, start: np.ndarray) -> np.ndarray:
    """Coefficients (columns,) of a unit turn of the section about e_x, (u_y, u_z) = (-z, y), of walls that begin at `start`."""
    rows, right = [], []
    for number, wall in enumerate(section.walls):
        for s in np.linspace(0, wall.width, 2 * section.degree):
            y, z = start + s * wall.frame(0.0)[0]
            table = section.tables(number, np.array([s]))[0, 0]
            rows += list(table[1:])
            right += list(wall.frame(0.0) @ [-z, y])
        start = start + wall.width * wall.frame(0.0)[0]
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]


# --- with a clamped end ------------------------------------------------------------------------------

QUARTER = flat_walls([(0.0, -DEPTH / 2), (WIDTH / 2, -DEPTH / 2), (WIDTH / 2, 0.0)], [(0, 1), (1, 2)])
STATION = 0.5
"""x of the axial force at the corner (y, z) = (WIDTH, -DEPTH) / 2, m."""
LEVELS = ((7, (0.0, 0.15, 0.6, 1.5, LENGTH)), (9, (0.0, 0.04, 0.15, 0.6, 1.5, LENGTH)))
"""Degree and breaks of x of the polynomials."""
DIVISION = 0.15
"""Share of a wall's width at which it is divided, from the corner."""
SPLINES = (5, 2, 16, 2), (6, 3, 30, 3)
"""Degree, spans of a wall and of the length, halvings toward the corner; one more toward x = 0."""


def _named(found: dict[str, float], membrane: float, bending: float) -> dict[str, float]:
    """Values from those of points and the energies of a quarter."""
    total = 4 * (membrane + bending)
    energies = {"membrane_energy": 4 * membrane, "bending_energy": 4 * bending, "strain_energy": total}
    return {"torque": 2 * total / TWIST} | found | energies


def _quarter_by_polynomials(degree: int, places: tuple[float, ...]) -> dict[str, float]:
    y, z = WIDTH / 2, DEPTH / 2
    nodes = [(0.0, -z), ((1 - DIVISION) * y, -z), (y, -z), (y, (DIVISION - 1) * z), (y, 0.0)]
    section = Section(tuple(flat_walls(nodes, [(i, i + 1) for i in range(4)])), degree, {0: "uw", 4: "uw"})
    held = Lengthwise(places, degree, "zero")
    clamped = Lengthwise(places, degree, "clamped")
    prism = Prism(section, {"u": held, "v": held, "w": clamped}, THICKNESS, YOUNG, POISSON)
    given = np.full(prism.size, np.nan)
    turned = _turned(section, np.array([0.0, -z]))
    for kind in "vw":
        at_end = prism.sets[kind].at(np.array([LENGTH]))[0]
        moving = int(np.argmax(at_end))
        places_of_kind = np.arange(prism.size)[prism.slots[kind]].reshape(-1, prism.sets[kind].count)[:, moving]
        given[places_of_kind] = TWIST * turned[prism.kinds[kind]] / at_end[moving]
    found, membrane, bending = prism.solve(np.zeros(prism.size), given)
    points = {
        "end_warping": float(prism.place(2, 0, 0.0, LENGTH) @ found),
        "corner_force": float(prism.resultant("n_x", 2, 0.0, STATION) @ found),
    }
    return _named(points, membrane, bending)


def _quarter_by_splines(degree: int, spans: int, lengthwise: int, halvings: int) -> dict[str, float]:
    def turned(place: np.ndarray, x: np.ndarray, order: int) -> np.ndarray:
        """Turn by TWIST times 3 r^2 - 2 r^3, r = x / L: it is at rest at x = 0."""
        rise = np.polynomial.Polynomial([0.0, 0.0, 3 / LENGTH**2, -2 / LENGTH**3])
        turn = TWIST * (rise.deriv(order) if order else rise)(x)
        return np.stack([0 * turn, -turn * place[:, 1], turn * place[:, 0]], axis=-1)

    middle = ("zero", "free", "zero")
    chain = Chain(
        tuple(QUARTER),
        (
            breaks(0, WIDTH / 2, spans, (False, True), halvings),
            breaks(0, DEPTH / 2, spans, (True, False), halvings),
        ),
        breaks(0, LENGTH, lengthwise, (True, False), halvings + 1),
        degree,
        (middle, middle),
        (("zero", "free"), ("zero", "zero"), ("clamped", "zero")),
        (YOUNG, POISSON, THICKNESS),
        (0.0, -DEPTH / 2),
        turned,
    )
    found, membrane, bending = chain.solve(np.zeros(chain.offsets[-1]))
    stretching = YOUNG * THICKNESS / (1 - POISSON**2)
    along, across = chain.place(1, 0, 0.0, STATION, (0, 1)), chain.place(1, 1, 0.0, STATION, (1, 0))
    points = {
        "end_warping": float(chain.place(1, 0, 0.0, LENGTH) @ found),
        "corner_force": stretching * float((along + POISSON * across) @ found),
    }
    return _named(points, membrane, bending)


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    return {
        name: Estimate.between(value, coarse[name], unit(name), ROUNDING_OF_BOX * abs(value))
        for name, value in fine.items()
    }


def held_girder() -> dict[str, Estimate]:
    """Known values of the clamped box by polynomials; the uncertainty is the change from a lower degree and fewer spans."""
    coarse, fine = (_quarter_by_polynomials(*level) for level in LEVELS)
    return _estimates(fine, coarse)


def held_girder_by_splines() -> dict[str, Estimate]:
    """Known values of the clamped box by splines; the uncertainty is the change from fewer spans of a lower degree."""
    coarse, fine = (_quarter_by_splines(*level) for level in SPLINES)
    return _estimates(fine, coarse)
