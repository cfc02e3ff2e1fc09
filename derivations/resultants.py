r"""Values of the suite `resultants`: membrane forces, moments and shear forces from answers known in series.

Each origin gives the resultants (n, 8) at points (n, 2) of the case's coordinates, in the shell's orthonormal frame: n_11,
n_22, n_12, m_11, m_22, m_12, q_1, q_2. `asked_of` takes components, principal values and means along edges of them.

Plates under a downward deflection w, with the normal upward: m_ab = B ((1 - nu) w,ab + nu w,cc delta_ab), q_a = B w,cca.

- Levy's series (Timoshenko & Woinowsky-Krieger 1959, section 30), w = w_p(x) + sum_m [A_m cosh z + C_m z sinh z] sin(alpha x),
  z = alpha (y - b/2). The strip's own deflection w_p is a polynomial and is used as such. The rest falls exponentially
  with the distance from the edges y = 0, b. Each point therefore uses the direction whose edges are farther from it.
- Navier's double series (ibid., section 28). The error of the shear forces at edges is a series of odd powers of 1 / N, N
  the number of harmonics; three cut-offs remove its first terms.
- Clamped plates: polynomials (`clamped_plate`), and Goursat's functions (`goursat_plate`), with
  w,xx - w,yy - 2 i w,xy = 2 (conj(z) f'' + g''), w,cc = 4 Re f', (d/dx - i d/dy) w,cc = 4 f''.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise

import numpy as np

from shellbench.problems.shell.case import Case, read_case
from shellbench.problems.shell.question.places import Edge

from . import pulled_ring
from .clamped_plate import solve_clamped
from .estimate import Estimate
from .exponential_shells import roof_by_exponentials
from .goursat_plate import solve_goursat
from .levy_roof import scordelis_lo
from .manufactured import CASES, exact_formulas, largest
from .plate import LoadedPlate, Rectangle, Uniform
from .plate_series import levy_uniform
from .shell_resultants import of_prescribed, of_prescribed_by_varied_metric, of_roof, of_roof_by_exponentials

Array = np.ndarray
Fields = Callable[[Array], Array]
"""Resultants (n, 8) at points (n, 2)."""
Levels = tuple[Fields, Fields]
"""The same by a fine and by a clearly coarser level."""

ROUNDING = 1e-10
"""Of the largest magnitude of a resultant."""
COLUMNS = {"membrane_force": 0, "moment": 3, "shear_force": 6}
UNITS = {"membrane_force": "N/m", "moment": "N", "shear_force": "N/m"}
ALONG = 60
"""Gauss points along an edge."""


def asked_of(case: Case, fields: Fields) -> dict[str, float]:
    """Return the values of a case's resultants."""
    found = {}
    for quantity in case.quantities:
        if quantity.kind not in COLUMNS:
            continue
        places = [case.places[name] for name in quantity.on]
        x, weights = np.polynomial.legendre.leggauss(ALONG)
        if isinstance(places[0], Edge):  # straight ones, of constant length per coordinate
            (edge,) = places
            low, high = edge.bounds(case.surface.domain)
            points = edge.points(case.surface.domain, low + (high - low) * (x + 1) / 2)
        else:
            points, weights = np.array([place.xi for place in places]), np.ones(len(places))
        values = fields(points)[:, COLUMNS[quantity.kind] :]
        if quantity.component.startswith("principal"):
            tensors = values[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
            chosen = np.linalg.eigvalsh(tensors)[:, 1 if quantity.component.endswith("1") else 0]
        else:
            chosen = values[
                :,
                ("11", "22", "12").index(quantity.component)
                if len(quantity.component) == 2
                else int(quantity.component) - 1,
            ]
        found[quantity.name] = float(weights @ chosen / weights.sum())
    return found


def estimates(
    name: str, levels: Levels, largest: Callable[[], Estimate], rounding: float = ROUNDING
) -> dict[str, Estimate]:
    """Return a case's known values from two levels, and the largest displacement as it is known."""
    case = read_case(CASES / f"{name}.toml")
    fine, coarse = (asked_of(case, level) for level in levels)
    kinds = {q.name: q.kind for q in case.quantities}
    scales = {kind: max(abs(v) for n, v in fine.items() if kinds[n] == kind) for kind in {kinds[n] for n in fine}}
    values = {n: Estimate.between(fine[n], coarse[n], UNITS[kinds[n]], rounding * scales[kinds[n]]) for n in fine}
    return values | {"largest_displacement": largest()}


# --- simply supported plates -------------------------------------------------------------------------

PLATE = LoadedPlate(Rectangle(2.0, 1.0, 0.01, 2e11, 0.3), Uniform(1e4), {})
LEVY_TERMS, NAVIER_TERMS = 60, 1000


def levy_slopes(plate: Rectangle, pressure: float, terms: int, x: float, y: float) -> Array:
    """Return w,xx w,yy w,xy w,xxx+w,xyy w,xxy+w,yyy (5,) at a point, by harmonics along x."""
    b = plate.bending_stiffness
    m = np.arange(1, 2 * terms, 2, dtype=float)
    alpha = m * np.pi / plate.a
    beta, z = alpha * plate.b / 2, alpha * (y - plate.b / 2)
    # cosh(z) / cosh(beta) and sinh(z) / cosh(beta), without overflow
    up, down, one = np.exp(z - beta), np.exp(-z - beta), 1 + np.exp(-2 * beta)
    cosh, sinh = (up + down) / one, (up - down) / one
    c = 4 * pressure / (m * np.pi * b * alpha**4) / 2
    a = -c * (2 + beta * np.tanh(beta))
    f = a * cosh + c * z * sinh
    f1 = alpha * ((a + c) * sinh + c * z * cosh)
    f2 = alpha**2 * ((a + 2 * c) * cosh + c * z * sinh)
    f3 = alpha**3 * ((a + 3 * c) * sinh + c * z * cosh)
    s, k = np.sin(alpha * x), alpha * np.cos(alpha * x)
    strip = pressure / (2 * b) * np.array([x**2 - plate.a * x, 2 * x - plate.a])
    return np.array(
        [strip[0] - (alpha**2 * f) @ s, f2 @ s, f1 @ k, strip[1] + (f2 - alpha**2 * f) @ k, (f3 - alpha**2 * f1) @ s]
    )


def plate_by_levy(case: LoadedPlate, terms: int) -> Fields:
    """Resultants by Levy's series."""
    plate, pressure = case.plate, case.load.pressure
    turned = Rectangle(plate.b, plate.a, plate.thickness, plate.young, plate.poisson)

    def at(x: float, y: float) -> Array:
        if min(y, plate.b - y) / plate.a >= min(x, plate.a - x) / plate.b:
            return levy_slopes(plate, pressure, terms, x, y)
        return levy_slopes(turned, pressure, terms, y, x)[[1, 0, 2, 4, 3]]

    return lambda points: bent(plate, np.array([at(*point) for point in points]))


def bent(plate: Rectangle, slopes: Array) -> Array:
    """Return resultants (n, 8) of a plate from w,xx w,yy w,xy and the slopes of w,cc (n, 5)."""
    xx, yy, xy, first, second = slopes.T
    nu, none = plate.poisson, np.zeros(len(slopes))
    rows = [none, none, none, xx + nu * yy, yy + nu * xx, (1 - nu) * xy, first, second]
    return plate.bending_stiffness * np.stack(rows, axis=-1)


def navier_slopes(case: LoadedPlate, terms: int, x: float, y: float) -> Array:
    """Return the result of `levy_slopes` by Navier's series of `terms` odd harmonics a direction."""
    m = np.arange(1, 2 * terms, 2, dtype=float)
    alpha, gamma = m * np.pi / case.plate.a, m * np.pi / case.plate.b
    square = alpha[:, None] ** 2 + gamma**2
    w = 16 * case.load.pressure / (np.pi**2 * case.plate.bending_stiffness) / np.outer(m, m) / square**2
    sx, cx, sy, cy = (f(k) for k in (alpha * x, gamma * y) for f in (np.sin, np.cos))
    terms_of = [
        -(sx * alpha**2) @ w @ sy,
        -sx @ w @ (sy * gamma**2),
        (cx * alpha) @ w @ (cy * gamma),
        -(cx * alpha) @ (w * square) @ sy,
        -sx @ (w * square) @ (cy * gamma),
    ]
    return np.array(terms_of)


def plate_by_navier(case: LoadedPlate, terms: int) -> Fields:
    """Resultants by Navier's series, its error in odd powers of 1 / N removed twice."""

    def at(point: Array) -> Array:
        sums = [navier_slopes(case, terms // k, *point) for k in (4, 2, 1)]
        once = [2 * fine - coarse for coarse, fine in pairwise(sums)]
        return np.asarray((8 * once[1] - once[0]) / 7)

    return lambda points: bent(case.plate, np.array([at(point) for point in points]))


def _centre_deflection(case: LoadedPlate) -> Estimate:
    middle = np.array([[case.plate.a / 2, case.plate.b / 2]])
    fine, coarse = (levy_uniform(case.plate, case.load, terms, middle)[0][0] for terms in (2000, 1000))
    return Estimate.between(fine, coarse, "m", 1e-13 * fine)


def _centre_by_navier(case: LoadedPlate) -> Estimate:
    m = np.arange(1, 601, 2, dtype=float)
    sign = np.where(m % 4 == 1, 1.0, -1.0)
    square = (m[:, None] / case.plate.a) ** 2 + (m / case.plate.b) ** 2
    terms = (
        16 * case.load.pressure / (np.pi**6 * case.plate.bending_stiffness) * np.outer(sign / m, sign / m) / square**2
    )
    fine, coarse = terms.sum(), terms[:150, :150].sum()
    return Estimate.between(fine, coarse, "m", 1e-13 * fine)


# --- clamped plates ----------------------------------------------------------------------------------

CLAMPED = LoadedPlate(Rectangle(1.0, 1.0, 0.01, 2e11, 0.3), Uniform(1e4), {})
DEGREE, GOURSAT = 36, (34, 18)
LOST = 1e-8
"""Rounding of third derivatives at an edge, relative to the largest resultant."""


def clamped_by_polynomials(case: LoadedPlate, degree: int) -> Fields:
    """Resultants of a clamped plate by Ritz's method; third derivatives are those of the polynomials."""
    sides, coefficients, _ = solve_clamped(case, degree)

    def at(points: Array) -> Array:
        (f, f1, f2, f3), (g, g1, g2, g3) = (_four(side, points[:, k]) for k, side in enumerate(sides))

        def product(one: Array, two: Array) -> Array:
            return np.einsum("pi,ij,pj->p", one, coefficients, two)

        slopes = product(f3, g) + product(f1, g2), product(f2, g1) + product(f, g3)
        return bent(case.plate, np.stack([product(f2, g), product(f, g2), product(f1, g1), *slopes], axis=-1))

    return at


def _four(side: object, x: Array) -> list[Array]:
    """Values and three derivatives (len(x), degree + 1); the third by the polynomial through the second ones."""
    nodes, _ = np.polynomial.legendre.leggauss(side.degree + 1)  # type: ignore[attr-defined]
    half = side.length / 2  # type: ignore[attr-defined]
    second = side.basis((nodes + 1) * half)[2]  # type: ignore[attr-defined]
    table = np.linalg.solve(np.polynomial.legendre.legvander(nodes, side.degree), second)  # type: ignore[attr-defined]
    third = np.polynomial.legendre.legval(x / half - 1, np.polynomial.legendre.legder(table)).T / half
    return [*side.basis(x), third]  # type: ignore[attr-defined]


def clamped_by_goursat(case: LoadedPlate, degree: int, poles: int) -> Fields:
    """Resultants of a clamped plate by Goursat's functions."""
    trial, coefficients, unit = solve_goursat(case, degree, poles)
    a = coefficients.reshape(4, -1)
    of_f, of_g = a[0] + 1j * a[2], a[1] + 1j * a[3]
    centre = complex(case.plate.a, case.plate.b) / 2

    def at(points: Array) -> Array:
        place = points @ np.array([1, 1j]) - centre
        _, first, second = trial.functions(place / unit)
        f1, f2, g2 = first @ of_f / unit, second @ of_f / unit**2, second @ of_g / unit**2
        # w = Re(conj(z / unit) f + g), f and g functions of z / unit
        mixed = 2 * (np.conj(place) / unit * f2 + g2)
        total, rise = 4 * f1.real / unit, 4 * f2 / unit
        load = case.load.pressure / case.plate.bending_stiffness
        mixed = mixed + load * np.conj(place) ** 2 / 8
        total, rise = total + load * np.abs(place) ** 2 / 4, rise + load * np.conj(place) / 2
        slopes = [(total + mixed.real) / 2, (total - mixed.real) / 2, -mixed.imag / 2, rise.real, -rise.imag]
        return bent(case.plate, np.stack(slopes, axis=-1))

    return at


def _clamped_centre(fields: str) -> Estimate:
    """The deflection of the middle, by either form."""
    from .clamped_plate import ritz
    from .goursat_plate import goursat
    from .plate import Mean

    case = LoadedPlate(CLAMPED.plate, CLAMPED.load, {"centre": Mean(((0.5, 0.5),))})
    values = (
        [ritz(case, d)[0][0] for d in (DEGREE, 24)]
        if fields == "ritz"
        else [goursat(case, *d)[0][0] for d in (GOURSAT, (22, 12))]
    )
    return Estimate.between(*values, "m", 1e-11 * values[0])


def _plate(name: str, by: str) -> dict[str, Estimate]:
    if by == "levy":
        levels = _placed(name, plate_by_levy(PLATE, LEVY_TERMS)), _placed(name, plate_by_levy(PLATE, LEVY_TERMS // 2))
        return estimates(name, levels, partial(_centre_deflection, PLATE))
    levels = (
        _placed(name, plate_by_navier(PLATE, NAVIER_TERMS)),
        _placed(name, plate_by_navier(PLATE, NAVIER_TERMS // 2)),
    )
    return estimates(name, levels, partial(_centre_by_navier, PLATE))


def _placed(name: str, fields: Fields) -> Fields:
    """Return the resultants of a plate whose corner is at the origin where a case has it."""
    corner = np.array(read_case(CASES / f"{name}.toml").surface.domain.lower)
    return lambda points: fields(points - corner)


def _clamped(by: str) -> dict[str, Estimate]:
    if by == "ritz":
        levels = clamped_by_polynomials(CLAMPED, DEGREE), clamped_by_polynomials(CLAMPED, 2 * DEGREE // 3)
    else:
        levels = clamped_by_goursat(CLAMPED, *GOURSAT), clamped_by_goursat(CLAMPED, 22, 12)
    return estimates("resultants_clamped_plate", levels, partial(_clamped_centre, by), LOST)


# --- curved shells -----------------------------------------------------------------------------------

PARABOLOID = "resultants_paraboloid"
TRUNCATED = 1e-9
"""Of resultants: the load of the case is a polynomial that is exact to 1e-11 of itself."""


def _roof(by: str) -> dict[str, Estimate]:
    if by == "polynomials":
        levels = of_roof(399, 64), of_roof(265, 42)
        return estimates("resultants_roof", levels, lambda: scordelis_lo()["largest_displacement"], 1e-9)
    levels = of_roof_by_exponentials(199), of_roof_by_exponentials(133)
    return estimates("resultants_roof", levels, lambda: roof_by_exponentials()["largest_displacement"], 1e-7)


def _paraboloid(by: str) -> dict[str, Estimate]:
    case = read_case(CASES / f"{PARABOLOID}.toml")

    def moved(points: Array) -> Array:
        return case.evaluate(exact_formulas(case), points)[0, 0]

    if by == "series":
        value = largest(case, moved)
        fields = of_prescribed(case)
        return estimates(PARABOLOID, (fields, fields), lambda: Estimate(value, TRUNCATED * value, "m"), TRUNCATED)
    value = _largest_on_grids(case, moved)
    fields = of_prescribed_by_varied_metric(case)
    return estimates(PARABOLOID, (fields, fields), lambda: Estimate(value, TRUNCATED * value, "m"), TRUNCATED)


def _largest_on_grids(case: Case, moved: Callable[[Array], Array]) -> float:
    """Return the largest displacement by ever finer grids about the best point."""
    domain = case.surface.domain
    centre, half = np.add(domain.lower, domain.upper) / 2, np.array(domain.size) / 2
    t = np.linspace(-1.0, 1.0, 41)
    window = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
    best = 0.0
    for _ in range(9):
        points = np.clip(centre + half * window, domain.lower, domain.upper)
        size = np.linalg.norm(moved(points), axis=-1)
        best = max(best, float(size.max()))
        centre, half = points[size.argmax()], half / 8
    return best


Values = Callable[[], dict[str, Estimate]]
JUDGES: Mapping[str, Values] = {
    "resultants_plate": partial(_plate, "resultants_plate", "levy"),
    "resultants_plate_edges": partial(_plate, "resultants_plate_edges", "levy"),
    "resultants_clamped_plate": partial(_clamped, "goursat"),
    "resultants_roof": partial(_roof, "polynomials"),
    PARABOLOID: partial(_paraboloid, "series"),
    "pulled_ring": pulled_ring.by_lame,
}
SECOND_FORMS: Mapping[str, Values] = {
    "resultants_plate": partial(_plate, "resultants_plate", "navier"),
    "resultants_plate_edges": partial(_plate, "resultants_plate_edges", "navier"),
    "resultants_clamped_plate": partial(_clamped, "ritz"),
    "resultants_roof": partial(_roof, "exponentials"),
    PARABOLOID: partial(_paraboloid, "varied metric"),
    "pulled_ring": pulled_ring.by_collocation,
}
LONG = frozenset({"resultants_roof", "resultants_clamped_plate", "resultants_paraboloid"})
"""Those whose values take seconds."""
