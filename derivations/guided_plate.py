r"""A plate on a bed whose one end is moved and whose other end is guided: cases/guided_plate.toml, in mm and N.

In Cartesian coordinates, on 0 < x < a, 0 < y < b, with X = x / a and Y = y / b, the prescribed displacement

    u = U0 + U sin(p X) (1 + cos(pi Y) / 2),    v = 0,
    w = W0 + W1 (1 - cos(4 pi X)) + W2 X^2 (3 - 2 X) + W3 (1 - cos(2 pi X)) cos(pi Y)

is that of the wall where x = 0, with its slope; at the guide, x = a, nothing turns, and at y = 0 and b are planes of symmetry.
Equilibrium of the plate (Timoshenko and Woinowsky-Krieger) asks for

    f_x = -C (u,xx + (1 - nu) / 2 u,yy) + k u,    f_y = -C (1 + nu) / 2 u,xy,    f_z = B (w,xx + w,yy),aa + k w

and at the guide for the edge forces C u,x and -B w,xxx, with C = E h / (1 - nu^2) and B = C h^2 / 12. The bed's stiffness k is
such that it stores as much as the plate, to five digits: who subtracts one from the other is left with nothing.

The judge evaluates these formulas. The second form is Ritz's method, polynomials along x times harmonics along y, under the
loads, the bed and the motion that the case declares. It knows the displacement by its error alone.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import minimize_scalar

from shellbench.problems.shell.case import Case, read_case
from shellbench.problems.shell.question.loads import AreaLoad, EdgeLoad

from .estimate import Estimate
from .manufactured import CASES, exact_formulas

NAME = "guided_plate"
A, B = 800.0, 500.0  # mm
YOUNG, POISSON, THICKNESS = 2000.0, 0.3, 8.0  # N/mm^2, mm
LIFT = 1.5, 6.0  # of the wall, along x and z, mm
STRETCHED, RATE = 0.9, 2.2  # U, mm, and p
BENT = 5.0, -4.2, 1.5  # W1, W2 and W3, mm
BED = 1.3416e-3  # k, N/mm^3
DEGREES = 24, 28
"""Of the polynomials beyond those that the supports ask for, coarser and finer."""
HARMONICS = 2
GAUSS = 40
ROUNDING = 1e-12

Array = np.ndarray
MEMBRANE = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = MEMBRANE * THICKNESS**2 / 12


def place(xi: Array) -> tuple[Array, Array]:
    """Return x and y, mm, at curvilinear coordinates (n, 2)."""
    one, two = np.moveaxis(np.asarray(xi, dtype=float), -1, 0)
    return A * one, B * two * (1 + 1.5 * one * (1 - one) ** 2 * (1 - two))


def prescribed(x: Array, y: Array) -> Array:
    """Return the displacement (n, 3), mm."""
    along, across = x / A, np.cos(np.pi * y / B)
    u = LIFT[0] + STRETCHED * np.sin(RATE * along) * (1 + across / 2)
    w = LIFT[1] + BENT[0] * (1 - np.cos(4 * np.pi * along)) + BENT[1] * along**2 * (3 - 2 * along)
    w = w + BENT[2] * (1 - np.cos(2 * np.pi * along)) * across
    return np.stack([u, 0 * u, w], axis=-1)


def stored() -> tuple[float, float, float]:
    """Return membrane energy, bending energy and that of a bed of unit stiffness, by Gauss's rule, N mm and mm^4."""
    nodes, weights = legendre.leggauss(GAUSS)
    x, y = (c.ravel() for c in np.meshgrid(A * (nodes + 1) / 2, B * (nodes + 1) / 2, indexing="ij"))
    area = np.outer(weights, weights).ravel() * A * B / 4
    q, along, c, s = np.pi / B, x / A, np.cos(np.pi * y / B), np.sin(np.pi * y / B)
    u_x = STRETCHED * RATE / A * np.cos(RATE * along) * (1 + c / 2)
    u_y = -STRETCHED * np.sin(RATE * along) * q * s / 2
    membrane = MEMBRANE / 2 * (area @ (u_x**2 + (1 - POISSON) / 2 * u_y**2))
    wave = 2 * np.pi / A
    w_xx = 4 * wave**2 * BENT[0] * np.cos(2 * wave * x) + BENT[1] * (6 - 12 * along) / A**2
    w_xx = w_xx + BENT[2] * wave**2 * np.cos(wave * x) * c
    w_yy = -BENT[2] * (1 - np.cos(wave * x)) * q**2 * c
    w_xy = -BENT[2] * wave * np.sin(wave * x) * q * s
    bending = BENDING / 2 * (area @ ((w_xx + w_yy) ** 2 - 2 * (1 - POISSON) * (w_xx * w_yy - w_xy**2)))
    moved = prescribed(x, y)
    return float(membrane), float(bending), float(area @ np.sum(moved**2, axis=-1)) / 2


def guided_plate() -> dict[str, Estimate]:
    """Known values by the closed form."""
    case = read_case(CASES / f"{NAME}.toml")
    membrane, bending, bed = stored()

    # All that varies along y is largest where y = 0.
    def magnitude(x: float) -> float:
        return float(np.linalg.norm(prescribed(np.array(x), np.array(0.0))))

    found = minimize_scalar(
        lambda x: -magnitude(x), bounds=(0.2 * A, 0.3 * A), method="bounded", options={"xatol": 1e-9 * A}
    )
    points, direction = _asked(case)
    values = {
        "inside_displacement": float(np.mean(prescribed(*place(points)) @ direction)),
        "largest_displacement": -float(found.fun),
        "field_error": 0.0,
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
        "potential_energy": membrane + bending + BED * bed - work(),
    }
    return {n: Estimate(v, ROUNDING * max(abs(v), n == "field_error"), unit(n)) for n, v in values.items()}


def unit(name: str) -> str:
    """Return the unit of a quantity in a case of mm and N."""
    return "N mm" if name.endswith("energy") else "" if name == "field_error" else "mm"


def _asked(case: Case) -> tuple[Array, Array]:
    """Points (n, 2), and the unit vector, of the displacement that is asked at points."""
    asked = next(q for q in case.quantities if q.name == "inside_displacement")
    direction = np.array(asked.directions[0])  # type: ignore[attr-defined]
    return np.array([case.places[name].xi for name in asked.points]), direction / np.linalg.norm(direction)  # type: ignore[attr-defined]


# --- the second form ---------------------------------------------------------------------------------


def guided_plate_by_ritz() -> dict[str, Estimate]:
    """Known values by polynomials and harmonics under the declared loads; uncertain by what fewer polynomials change."""
    coarse, fine = (_by_ritz(degree) for degree in DEGREES)
    return {
        n: Estimate.between(v, coarse[n], unit(n), 10 * ROUNDING * max(abs(v), n == "field_error"))
        for n, v in fine.items()
    }


def _polynomials(x: Array, degree: int, order: int, kind: str) -> Array:
    """Derivatives (n, functions) of polynomials along x that vanish at the wall, as slopes of `w` do at both ends.

    Those of `v` vanish at the guide.
    """
    s, scale = 2 * x / A - 1, (2 / A) ** order
    unit = np.eye(degree + 1)
    if kind == "u":
        series = [legendre.legint(unit[n], lbnd=-1) for n in range(degree)]
    elif kind == "v":
        series = [legendre.legint(unit[n], lbnd=1) for n in range(degree)]
    else:  # the slope is an integral that vanishes at both ends
        series = [legendre.legint(legendre.legint(unit[n], lbnd=-1), lbnd=-1) for n in range(1, degree)]
    return np.stack([legendre.legval(s, legendre.legder(c, order)) * scale for c in series], axis=-1)


def _harmonics(y: Array, order: int, odd: bool) -> Array:
    """Derivatives (n, functions) of cosines along y, from the mean on, or of sines."""
    waves = np.pi / B * np.arange(1 if odd else 0, HARMONICS + 1)
    return waves**order * np.cos(waves * y[:, None] + (order - odd) * np.pi / 2)


def _table(x: Array, y: Array, degree: int, component: str) -> dict[tuple[int, int], Array]:
    """Derivatives (n, functions) in x and y up to the second order."""
    return {
        (i, j): np.einsum(
            "nf,ng->nfg", _polynomials(x, degree, i, component), _harmonics(y, j, component == "v")
        ).reshape(len(x), -1)
        for i in range(3)
        for j in range(3 - i)
    }


@cache
def _rule() -> tuple[Case, Array, Array]:
    """The case, points (n, 2) and weights (n,) of Gauss's rule, mm^2."""
    case = read_case(CASES / f"{NAME}.toml")
    nodes, weights = legendre.leggauss(GAUSS)
    points = np.stack(np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2, indexing="ij"), axis=-1).reshape(-1, 2)
    density = A * B * (1 + 1.5 * points[:, 0] * (1 - points[:, 0]) ** 2 * (1 - 2 * points[:, 1]))
    return case, points, np.outer(weights, weights).ravel() / 4 * density


def work() -> float:
    """Return the work of the loads that equilibrium asks for on the prescribed displacement, by Gauss's rule, N mm."""
    nodes, weights = legendre.leggauss(GAUSS)
    x, y = (c.ravel() for c in np.meshgrid(A * (nodes + 1) / 2, B * (nodes + 1) / 2, indexing="ij"))
    area, edge = np.outer(weights, weights).ravel() * A * B / 4, weights * B / 2
    q, wave = np.pi / B, 2 * np.pi / A
    c, moved = np.cos(q * y), prescribed(x, y)
    stretch = STRETCHED * np.sin(RATE * x / A) * ((RATE / A) ** 2 * (1 + c / 2) + (1 - POISSON) / 2 * q**2 * c / 2)
    bend = BENT[2] * c * (q**4 - (wave**2 + q**2) ** 2 * np.cos(wave * x)) - BENT[0] * (2 * wave) ** 4 * np.cos(
        2 * wave * x
    )
    density = np.stack([MEMBRANE * stretch, BENDING * bend], axis=-1) + BED * moved[:, ::2]
    along = B * (nodes + 1) / 2
    end = prescribed(np.full(GAUSS, A), along)
    pull = MEMBRANE * STRETCHED * RATE / A * np.cos(RATE) * (1 + np.cos(q * along) / 2)
    shear = 12 * BENDING * BENT[1] / A**3  # -B w,xxx, of the cubic alone
    return float(area @ np.sum(density * moved[:, ::2], axis=-1) + edge @ (pull * end[:, 0] - shear * -end[:, 2]))


def _by_ritz(degree: int) -> dict[str, float]:
    # 1. What the case declares: loads, bed and the wall's translation, about which the plate's own motion is a sum.
    case, points, weights = _rule()
    x, y = place(points)
    area, edge = (next(load for load in case.loads if isinstance(load, kind)).vector for kind in (AreaLoad, EdgeLoad))
    density = case.evaluate(area, points)[0, 0]
    nodes, along = legendre.leggauss(GAUSS)
    ends = np.stack([np.ones(GAUSS), (nodes + 1) / 2], axis=-1)
    force = case.evaluate(edge, ends)[0, 0] * (along / 2 * B)[:, None]
    bed = case.spring_stiffness(points)
    lift = np.array([float(text) for text in case.supports[0].motion.vector])  # type: ignore[union-attr]
    f = {c: _table(x, y, degree, c) for c in "uvw"}
    at_end = {c: _table(*place(ends), degree, c)[0, 0] for c in "uvw"}

    def integral(one: Array, two: Array, factor: float | Array = 1.0) -> Array:
        return (one * (weights * factor)[:, None]).T @ two

    def right(c: int, name: str) -> Array:
        return f[name][0, 0].T @ (weights * (density[:, c] - bed[:, c] * lift[c])) + at_end[name].T @ force[:, c]

    # 2. Bending.
    w = f["w"]
    plate = integral(w[2, 0] + w[0, 2], w[2, 0] + w[0, 2], BENDING)
    twist = integral(w[1, 1], w[1, 1]) - (integral(w[2, 0], w[0, 2]) + integral(w[0, 2], w[2, 0])) / 2
    plate += 2 * (1 - POISSON) * BENDING * twist
    bent = np.linalg.solve(plate + integral(w[0, 0], w[0, 0], bed[:, 2]), right(2, "w"))
    # 3. Stretching.
    u, v, shear = f["u"], f["v"], MEMBRANE * (1 - POISSON) / 2
    mixed = POISSON * MEMBRANE * integral(u[1, 0], v[0, 1]) + shear * integral(u[0, 1], v[1, 0])
    sheet = np.block(
        [
            [MEMBRANE * integral(u[1, 0], u[1, 0]) + shear * integral(u[0, 1], u[0, 1]), mixed],
            [mixed.T, MEMBRANE * integral(v[0, 1], v[0, 1]) + shear * integral(v[1, 0], v[1, 0])],
        ]
    )
    held = sheet.copy()
    split = u[0, 0].shape[1]
    held[:split, :split] += integral(u[0, 0], u[0, 0], bed[:, 0])
    held[split:, split:] += integral(v[0, 0], v[0, 0], bed[:, 1])
    uv = np.linalg.solve(held, np.concatenate([right(0, "u"), right(1, "v")]))
    shapes = {"u": uv[:split], "v": uv[split:], "w": bent}

    def displacement(at_x: Array, at_y: Array) -> Array:
        return lift + np.stack([_table(at_x, at_y, degree, c)[0, 0] @ shapes[c] for c in "uvw"], axis=-1)

    # 4. What is asked.
    asked, direction = _asked(case)
    moved, size = displacement(x, y), case.evaluate(exact_formulas(case), points)[0, 0]
    error = (float(weights @ np.sum(e**2, axis=-1)) for e in (moved - size, size))
    membrane, bending = float(uv @ sheet @ uv) / 2, float(bent @ plate @ bent) / 2
    springs = float(weights @ np.sum(bed * moved**2, axis=-1)) / 2
    worked = float(weights @ np.sum(density * moved, axis=-1) + np.sum(force * displacement(*place(ends))))
    return {
        "inside_displacement": float(np.mean(displacement(*place(asked)) @ direction)),
        "largest_displacement": -float(
            minimize_scalar(
                lambda at: -float(np.linalg.norm(displacement(np.array([at]), np.zeros(1)))),
                bounds=(0.2 * A, 0.3 * A),
                method="bounded",
                options={"xatol": 1e-8 * A},
            ).fun
        ),
        "field_error": float(np.sqrt(next(error) / next(error))),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
        "potential_energy": membrane + bending + springs - worked,
    }
