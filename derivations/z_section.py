r"""NAFEMS LE5: a cantilever of Z section in torsion.

In the plane (y, z) the section is (-1, 1), (0, 1), (0, -1), (1, -1): two flanges 1 m wide and a web 2 m deep with rigid folds between,
0.1 m thick, 10 m long along x, E = 210 GPa, nu = 0.3. At x = 0 all displacements and rotations vanish. At x = 10 m each
flange carries a force of 0.6 MN in its plane, spread evenly over its end edge: along -y on the upper, along +y on the lower one. They
are a torque of 1.2 MN m about +x. All other edges are free.

The published axial stress at the flange's free edge at x = 2.5 m, -108 MPa (NAFEMS 1990), is that of Vlasov's theory of beams with
undeformed sections, sigma = T sinh(k (L - x)) / (k cosh(k L)) w / I_w = 107.9 MPa with k^2 = G J / (E I_w): `vlasov_stress`. The
shell bends its section, shears its flanges and restrains the clamped end more; it carries 1.5 % more.

A turn by 180 degrees about x leaves the shell and its loads as they are: the upper flange and the upper half of the web are modelled, on
whose lower edge v = w = 0. The judge is `folded_ritz`, polynomials; the second form `folded_splines`. Both are graded toward the corners at
both ends.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .folded_ritz import Lengthwise, Prism, Section, flat_walls
from .folded_splines import Chain
from .patch import breaks

FLANGE, HALF_WEB, LENGTH, THICKNESS = 1.0, 1.0, 10.0, 0.1
YOUNG, POISSON = 210e9, 0.3
FORCE = 0.6e6  # on a flange, N
STATION = 2.5
COARSE = 7, (0.15,), (0.0, 0.15, 1.0, 2.2, 4.0, 9.0, 10.0)
FINE = 9, (0.1,), (0.0, 0.05, 0.4, 2.0, 5.0, 9.7, 10.0)
"""Degree, distances of divisions from the edges of a wall, and breaks of x, m."""
SPLINES = (5, 2, 16, 2), (6, 3, 30, 3)
"""Of the second form: degree, spans of a wall and of the length, halvings toward the edges of a wall and toward x = LENGTH.

Toward x = 0 there is one halving more.
"""
ROUNDING_OF_SECTION = 1e-8


def unit(name: str) -> str:
    """Unit of a quantity."""
    return next((u for key, u in {"energy": "J", "turn": "rad", "stress": "Pa"}.items() if key in name), "m")


def vlasov_stress() -> float:
    """Axial stress, Pa, at the free edge of a flange at STATION by Vlasov's theory: warping is 0.75 m^2 there, for b = 1, h = 2."""
    b, h, t = FLANGE, 2 * HALF_WEB, THICKNESS
    inertia = b**3 * h**2 * t / 12 * (b + 2 * h) / (2 * b + h)
    torsion = YOUNG / (2 * (1 + POISSON)) * (2 * b + h) * t**3 / 3
    k = np.sqrt(torsion / (YOUNG * inertia))
    bimoment = FORCE * h * np.sinh(k * (LENGTH - STATION)) / (k * np.cosh(k * LENGTH))
    return float(-bimoment * b * h / 2 * (b + h) / (2 * b + h) / inertia)


def _named(work: float, membrane: float, bending: float, points: dict[str, float]) -> dict[str, float]:
    """Values from those of half of the shell: the work of its load, its energies, and values at points."""
    energies = {"membrane_energy": 2 * membrane, "bending_energy": 2 * bending}
    energies["strain_energy"] = 2 * (membrane + bending)
    return points | {"flange_displacement": work / FORCE} | energies


def _by_polynomials(degree: int, divisions: tuple[float, ...], places: tuple[float, ...]) -> dict[str, float]:
    # 1. Divided walls: the flange near both edges, half of the web near the fold.
    flange = np.array([0.0, *divisions, *(FLANGE - d for d in reversed(divisions)), FLANGE])
    web = np.array([*divisions, HALF_WEB])
    nodes = [(float(s - FLANGE), HALF_WEB) for s in flange] + [(0.0, float(HALF_WEB - s)) for s in web]
    last, fold = len(nodes) - 1, len(flange) - 1
    walls = tuple(flat_walls(nodes, [(i, i + 1) for i in range(last)]))
    # 2. At x = 0, v needs no slope but at folds, where it is w of another wall.
    held = Lengthwise(places, degree, "zero")
    sets = {"u": held, "v": held, "w": Lengthwise(places, degree, "clamped")}
    prism = Prism(Section(walls, degree, {last: "yz"}), sets, THICKNESS, YOUNG, POISSON)
    load = np.sum([prism.edge_load(i, 1, -FORCE / FLANGE, LENGTH) for i in range(fold)], axis=0)
    found, membrane, bending = prism.solve(load)
    points = {
        "edge_stress": float(prism.resultant("n_x", 0, 0.0, STATION) @ found) / THICKNESS,
        "fold_stress": float(prism.resultant("n_x", fold, 0.0, STATION) @ found) / THICKNESS,
        "web_turn": float(prism.place(last - 1, 2, walls[-1].width, LENGTH, 1) @ found),
    }
    return _named(float(load @ found), membrane, bending, points)


def _by_splines(degree: int, spans: int, lengthwise: int, halvings: int) -> dict[str, float]:
    flange, web = flat_walls([(-FLANGE, HALF_WEB), (0.0, HALF_WEB), (0.0, 0.0)], [(0, 1), (1, 2)])
    x = np.union1d(
        breaks(0, LENGTH, lengthwise, (True, False), halvings + 1),
        breaks(0, LENGTH, lengthwise, (False, True), halvings),
    )
    held = "zero", "free"
    chain = Chain(
        (flange, web),
        (breaks(0, FLANGE, spans, (True, True), halvings), breaks(0, HALF_WEB, spans, (True, False), halvings)),
        x,
        degree,
        (("free",) * 3, ("free", "zero", "zero")),
        (held, held, ("clamped", "free")),
        (YOUNG, POISSON, THICKNESS),
    )
    s, weights = (array.ravel() for array in chain.patches[0].splines[0].gauss)
    pull = -FORCE / FLANGE
    load = np.sum([pull * w * chain.place(0, 1, at, LENGTH) for at, w in zip(s, weights, strict=True)], axis=0)
    found, membrane, bending = chain.solve(load)

    def stress(patch: int, s: float) -> float:
        along = chain.place(patch, 0, s, STATION, (0, 1)) + POISSON * chain.place(patch, 1, s, STATION, (1, 0))
        return float(YOUNG / (1 - POISSON**2) * along @ found)

    points = {
        "edge_stress": stress(0, 0.0),
        "fold_stress": stress(1, 0.0),
        "web_turn": float(chain.place(1, 2, HALF_WEB, LENGTH, (1, 0)) @ found),
    }
    return _named(float(load @ found), membrane, bending, points)


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    return {
        name: Estimate.between(value, coarse[name], unit(name), ROUNDING_OF_SECTION * abs(value))
        for name, value in fine.items()
    }


def z_section() -> dict[str, Estimate]:
    """Known values by polynomials; the uncertainty is the change from lower degrees and larger spans."""
    return _estimates(_by_polynomials(*FINE), _by_polynomials(*COARSE))


def z_section_by_splines() -> dict[str, Estimate]:
    """Known values by splines; the uncertainty is the change from fewer spans of a lower degree."""
    coarse, fine = (_by_splines(*level) for level in SPLINES)
    return _estimates(fine, coarse)
