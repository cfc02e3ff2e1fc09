r"""A simply supported rectangle on an uneven bed: cases/bedded_plate.toml.

In Cartesian coordinates, on 0 < x < a, 0 < y < b, the prescribed displacement

    u = U sin(pi x / a) sin(pi y / b),    v = 0,    w = W sin(3 pi x / a) sin(2 pi y / b)

vanishes on the rim, where w has no moment either. Equilibrium of the plate (Timoshenko and Woinowsky-Krieger) asks for

    f_x = C (alpha^2 + (1 - nu) beta^2 / 2) u,    f_y = -C (1 + nu) / 2 u,xy,    f_z = B (kappa^2 + lambda^2)^2 w + k w,

with C = E h / (1 - nu^2), B = C h^2 / 12 and the wave numbers of u and w, for a bed k(x, y) of any form.

The judge evaluates these formulas. The second form is Ritz's method with polynomials of x and y under the loads and the
bed that the case declares, integrated between its kinks. It knows the displacement by its error alone.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import minimize_scalar

from shellbench.problems.shell.case import Case, read_case
from shellbench.problems.shell.question.loads import AreaLoad, PressureLoad

from .estimate import Estimate
from .manufactured import CASES, exact_formulas

NAME = "bedded_plate"
A, B = 4.0, 3.0
YOUNG, POISSON, THICKNESS = 1e7, 0.3, 0.05
STRETCHED, BENT = 2e-4, 1e-2
WAVES = 3, 2
"""Half waves of w along x and y."""
DEGREES = 17, 21
"""Of the polynomials beside those that vanish on the rim, coarser and finer."""
GAUSS = 24
"""Points of a rule between two kinks."""
ROUNDING = 1e-12

Array = np.ndarray
MEMBRANE = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = MEMBRANE * THICKNESS**2 / 12


def _units(name: str) -> str:
    return "J" if name.endswith("energy") else "" if name == "field_error" else "m"


def place(xi: Array) -> tuple[Array, Array]:
    """Return x and y at curvilinear coordinates (n, 2), by inverse functions of their own."""
    one, two = np.moveaxis(np.asarray(xi, dtype=float), -1, 0)

    def along(at: Array) -> Array:
        return np.asarray(2 * np.arcsin(at) - np.arccos(at))

    def across(at: Array) -> Array:
        return np.asarray(np.arctan(at) + np.arcsinh(at))

    return tuple(  # type: ignore[return-value]
        length * (f(at) - f(low)) / (f(high) - f(low))
        for f, at, (low, high), length in ((along, one, (-0.7, 0.6), A), (across, two, (-1.0, 1.5), B))
    )


def prescribed(x: Array, y: Array) -> Array:
    """Return the displacement (n, 3)."""
    first, second = np.pi * x / A, np.pi * y / B
    w = BENT * np.sin(WAVES[0] * first) * np.sin(WAVES[1] * second)
    return np.stack([STRETCHED * np.sin(first) * np.sin(second), 0 * w, w], axis=-1)


def bedded_plate() -> dict[str, Estimate]:
    """Known values by the closed form."""
    case = read_case(CASES / f"{NAME}.toml")
    alpha, beta = np.pi / A, np.pi / B
    kappa, lam = WAVES[0] * alpha, WAVES[1] * beta
    # The mean of each product of squared sines or cosines is a quarter.
    membrane = MEMBRANE * (alpha**2 + (1 - POISSON) / 2 * beta**2) * STRETCHED**2 * A * B / 8
    bending = BENDING * (kappa**2 + lam**2) ** 2 * BENT**2 * A * B / 8

    # u and w have their summit at x = a / 2 both, and at y about b / 4.
    def magnitude(y: float) -> float:
        return float(np.linalg.norm(prescribed(np.array(A / 2), np.array(y))))

    found = minimize_scalar(
        lambda y: -magnitude(y), bounds=(B / 8, 3 * B / 8), method="bounded", options={"xatol": 1e-9}
    )
    (points, direction) = _asked(case)
    values = {
        "largest_displacement": -float(found.fun),
        "field_error": 0.0,
        "inside_displacement": float(np.mean(prescribed(*place(points)) @ direction)),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }
    return {n: Estimate(v, ROUNDING * max(abs(v), n == "field_error"), _units(n)) for n, v in values.items()}


def _asked(case: Case) -> tuple[Array, Array]:
    """Points (n, 2), and the unit vector, of the displacement that is asked at points."""
    asked = next(q for q in case.quantities if q.name == "inside_displacement")
    direction = np.array(asked.directions[0])  # type: ignore[attr-defined]
    return np.array([case.places[name].xi for name in asked.points]), direction / np.linalg.norm(direction)  # type: ignore[attr-defined]


def bedded_plate_by_ritz() -> dict[str, Estimate]:
    """Known values by polynomials under the declared loads; uncertain by what fewer of them change."""
    coarse, fine = (_by_ritz(degree) for degree in DEGREES)
    return {
        n: Estimate.between(v, coarse[n], _units(n), ROUNDING * max(abs(v), n == "field_error"))
        for n, v in fine.items()
    }


def _functions(at: Array, length: float, degree: int) -> tuple[Array, Array, Array]:
    """Integrals of Legendre polynomials, which vanish at both ends, and two derivatives: (n, functions) each."""
    s = 2 * at / length - 1
    series = [legendre.legint(np.eye(n + 1)[n], lbnd=-1) for n in range(1, degree + 1)]
    return tuple(  # type: ignore[return-value]
        np.stack([legendre.legval(s, legendre.legder(c, k)) * (2 / length) ** k for c in series], axis=-1)
        for k in range(3)
    )


@cache
def _rule() -> tuple[Case, Array, Array]:
    """The case, points (n, 2) and weights (n,) of Gauss's rule between kinks, m^2."""
    case = read_case(CASES / f"{NAME}.toml")
    domain, (nodes, weights) = case.surface.domain, legendre.leggauss(GAUSS)
    lines = []
    for low, high, cuts in zip(domain.lower, domain.upper, ((-0.2, 0.1), (0.2, 0.5)), strict=True):
        ends = np.array([low, *cuts, high])
        half = np.diff(ends)[:, None] / 2
        lines.append(((ends[:-1, None] + half * (nodes + 1)).ravel(), (half * weights).ravel()))
    (first, along), (second, across) = lines
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    slope_x = A / (3 * (np.arcsin(0.6) + np.arcsin(0.7))) * 3 / np.sqrt(1 - points[:, 0] ** 2)
    grown = np.arctan(1.5) + np.arcsinh(1.5) + np.arctan(1) + np.arcsinh(1)
    slope_y = B / grown * (1 / (1 + points[:, 1] ** 2) + 1 / np.sqrt(1 + points[:, 1] ** 2))
    return case, points, np.outer(along, across).ravel() * slope_x * slope_y


def _by_ritz(degree: int) -> dict[str, float]:
    case, points, weights = _rule()
    x, y = place(points)

    def products(at_x: Array, at_y: Array) -> dict[tuple[int, int], Array]:
        first, second = _functions(at_x, A, degree), _functions(at_y, B, degree)
        return {
            (i, j): np.einsum("nf,ng->nfg", first[i], second[j]).reshape(len(at_x), -1)
            for i in range(3)
            for j in range(3 - i)
        }

    def integral(one: Array, two: Array, factor: float | Array = 1.0) -> Array:
        return (one * (weights * factor)[:, None]).T @ two

    # 1. What the case declares, Cartesian: its local directions are those of x and y on this chart.
    density = np.zeros((len(points), 3))
    for load in case.loads:
        if isinstance(load, AreaLoad):
            density += case.evaluate(load.vector, points)[0, 0]
        elif isinstance(load, PressureLoad):
            density[:, 2] += case.formula(load.value).derivatives(points, 0)[0, 0]
    bed = case.spring_stiffness(points)[:, 2]
    f = products(x, y)
    # 2. Bending, with the Gaussian curvature's term that the rim does not need and the energy has; and the bed.
    plate = integral(f[2, 0] + f[0, 2], f[2, 0] + f[0, 2], BENDING)
    twist = integral(f[1, 1], f[1, 1]) - (integral(f[2, 0], f[0, 2]) + integral(f[0, 2], f[2, 0])) / 2
    plate += 2 * (1 - POISSON) * BENDING * twist
    w = np.linalg.solve(plate + integral(f[0, 0], f[0, 0], bed), f[0, 0].T @ (weights * density[:, 2]))
    # 3. Stretching.
    shear = MEMBRANE * (1 - POISSON) / 2
    mixed = POISSON * MEMBRANE * integral(f[1, 0], f[0, 1]) + shear * integral(f[0, 1], f[1, 0])
    sheet = np.block(
        [
            [MEMBRANE * integral(f[1, 0], f[1, 0]) + shear * integral(f[0, 1], f[0, 1]), mixed],
            [mixed.T, MEMBRANE * integral(f[0, 1], f[0, 1]) + shear * integral(f[1, 0], f[1, 0])],
        ]
    )
    uv = np.linalg.solve(sheet, np.concatenate([f[0, 0].T @ (weights * density[:, c]) for c in (0, 1)]))
    shapes = [*np.split(uv, 2), w]

    def displacement(at: Array) -> Array:
        values = products(*place(at))[0, 0]
        return np.stack([values @ shape for shape in shapes], axis=-1)

    # 4. What is asked. The summit is sought by a parabola through displacements near the middle of x.
    asked, direction = _asked(case)
    error = displacement(points) - case.evaluate(exact_formulas(case), points)[0, 0]
    size = case.evaluate(exact_formulas(case), points)[0, 0]
    square = (float(weights @ np.sum(e**2, axis=-1)) for e in (error, size))
    membrane, bending = float(uv @ sheet @ uv) / 2, float(w @ plate @ w) / 2
    return {
        "largest_displacement": _summit(products, shapes),
        "field_error": float(np.sqrt(next(square) / next(square))),
        "inside_displacement": float(np.mean(displacement(asked) @ direction)),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }


def _summit(products: object, shapes: list[Array]) -> float:
    """Return the largest magnitude near x = a / 2, y = b / 4, by ever finer grids."""
    centre, reach = np.array([A / 2, B / 4]), np.array([A / 12, B / 8])
    steps = np.linspace(-1, 1, 9)
    best = 0.0
    for _ in range(12):
        x, y = (c.ravel() for c in np.meshgrid(*(centre[:, None] + reach[:, None] * steps), indexing="ij"))
        values = products(x, y)[0, 0]  # type: ignore[operator]
        size = np.linalg.norm(np.stack([values @ shape for shape in shapes], axis=-1), axis=-1)
        best, top = max(best, float(size.max())), int(np.argmax(size))
        centre, reach = np.array([x[top], y[top]]), reach / 3
    return best
