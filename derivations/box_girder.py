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

The second part is twice what 2 M_xs per width carries by couples in the plane of the walls: corner forces at the ends of the folds
give the other half. An end that holds axial displacement or rotations adds a layer that decays slowly, and no closed form.
The second form minimises the strain energy over polynomials by `folded_ritz` with the ends' displacement prescribed.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .folded_ritz import Lengthwise, Prism, Section, flat_walls

DEPTH, WIDTH, LENGTH, THICKNESS = 0.6, 1.0, 3.0, 0.02  # along z, along y, along x, and of the walls, m
YOUNG, POISSON = 2.1e11, 0.3
TWIST = 1e-3
"""Turn of the end x = L about +x, rad."""
DEGREE = 5
"""Of the second form in s and x: the exact solution is of degree 1 in each."""
ROUNDING_OF_BOX = 1e-10


def unit(name: str) -> str:
    """Unit of a quantity."""
    units = {"energy": "J", "torque": "N m", "warping": "m", "flow": "N/m", "moment": "N"}
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
    turned, at_end = _turned(section), held.at(np.array([LENGTH]))[0]
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


def _turned(section: Section) -> np.ndarray:
    """Coefficients (columns,) of a unit turn of the section about e_x, (u_y, u_z) = (-z, y), by its end functions."""
    rows, right = [], []
    start = np.array([-WIDTH / 2, -DEPTH / 2])
    for number, wall in enumerate(section.walls):
        for s in np.linspace(0, wall.width, 2 * section.degree):
            y, z = start + s * wall.frame(0.0)[0]
            table = section.tables(number, np.array([s]))[0, 0]
            rows += list(table[1:])
            right += list(wall.frame(0.0) @ [-z, y])
        start = start + wall.width * wall.frame(0.0)[0]
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
