r"""A raft: a plate on an elastic bed, free at two edges and between planes of symmetry, under forces at its free edges.

The planes leave w(x, y) = sum w_n(x) cos(n pi y / b), and with p = n pi / b and the bed's stiffness k

    B (w_n'''' - 2 p^2 w_n'' + p^4 w_n) + k w_n = 0,

whose solutions are exp(r x) with (r^2 - p^2)^2 = -k / B. Where x is an end there is no moment, w'' = nu p^2 w, and the
shear force is that of the load, -B (w''' - (2 - nu) p^2 w') = q_n at x = a (Timoshenko & Woinowsky-Krieger, sections 22
and 62; Hetenyi 1946). Along x the plate is a bar that a softer bed holds back, D u'' = c u, without strain across.

The second form minimises the potential energy: Legendre polynomials along x, the same cosines along y, the load integrated by
Gauss's rule.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss

from .estimate import Estimate
from .surface_strains import Array

LENGTH, WIDTH = 2.0, 1.0  # a, b, m
YOUNG, POISSON, THICKNESS = 1e7, 0.3, 0.05
BED, DRAG = 50.0, 0.02  # k and c, N/m^3
LOADED = ((0.0, 0.4, 10.0), (0.7, 1.0, -4.0))  # parts of the edge, m, and the downward load in their middle, N/m
PUSH = 0.01  # along x, N/m
STRETCHING = YOUNG * THICKNESS / (1 - POISSON**2)  # D
BENDING = STRETCHING * THICKNESS**2 / 12  # B
HARMONICS = 1200
"""Of the series: what follows is n^-4 of the first, 5e-13."""
CLOSED = 1e-12
"""Relative uncertainty of the series: rounding of the exponentials' coefficients."""
FEW, MANY = (30, 32), (48, 44)
"""Harmonics and polynomials of the second form; a deflection converges as n^-4."""
GAUSS = 120
CLOSE, LOOKS = 21, 9
"""Points of a look for the largest displacement, and how often it is repeated ever closer."""
INSIDE = (0.7, 0.3)
OBLIQUE, POINTS = np.array([1.0, 2.0, -2.0]) / 3, (INSIDE, (1.7, 0.9), (2.0, 0.4))

Field = Callable[[Array, Array], Array]
"""Deflection (n,), downward, m, at points x (n,), y (n,)."""


def load_coefficients(count: int) -> Array:
    """Cosine coefficients (count,) of the downward load along the edge, N/m, by product formulas."""
    p, total = np.pi * np.arange(count) / WIDTH, np.zeros(count)
    for start, end, peak in LOADED:
        side = end - start
        s = np.pi / side
        # The integral of sin(s t) cos(p (start + t)) over 0 < t < side, where s side = pi and no p is s.
        total += peak * s * (np.cos(p * start) + np.cos(p * end)) / (s**2 - p**2)
    return np.asarray(total * np.where(np.arange(count) == 0, 1, 2) / WIDTH)


def _modes(count: int) -> tuple[Array, Array]:
    """Roots r (count, 4) and coefficients (count, 4) of exp(r (x - anchor)), anchored where each is one."""
    p, q = np.pi * np.arange(count) / WIDTH, load_coefficients(count)
    square = p[:, None] ** 2 + 1j * np.sqrt(BED / BENDING) * np.array([1.0, -1.0])
    r = np.sqrt(square)
    r = np.concatenate([r, -r], axis=1)
    rows = []
    for x in (0.0, LENGTH):
        e = np.exp(r * (x - _anchors(r)))
        rows += [(r**2 - POISSON * p[:, None] ** 2) * e, (r**3 - (2 - POISSON) * p[:, None] ** 2 * r) * e]
    matrix = np.stack(rows, axis=1)
    right = np.zeros((count, 4), dtype=complex)
    right[:, 3] = -q / BENDING
    scale = np.abs(matrix).max(axis=2, keepdims=True)
    return r, np.linalg.solve(matrix / scale, (right / scale[..., 0])[..., None])[..., 0]


def _anchors(r: Array) -> Array:
    return np.where(r.real > 0, LENGTH, 0.0)


def series() -> tuple[Field, float, float]:
    """Return the deflection, the work of the load on it, and the energy of the bed under it, J."""
    p, q = np.pi * np.arange(HARMONICS) / WIDTH, load_coefficients(HARMONICS)
    r, c = _modes(HARMONICS)

    def of_harmonics(x: Array) -> Array:
        return np.einsum("nk,pnk->pn", c, np.exp(r * (np.asarray(x)[:, None, None] - _anchors(r)))).real

    def deflection(x: Array, y: Array) -> Array:
        return np.asarray(np.sum(of_harmonics(x) * np.cos(p * np.asarray(y)[:, None]), axis=1))

    norms = WIDTH * np.where(np.arange(HARMONICS) == 0, 1.0, 0.5)
    work = float(np.sum(norms * q * of_harmonics(np.array([LENGTH]))[0]))
    # Products of exponentials, integrated: r + s is never zero but for opposite roots.
    first, second = r[:, :, None], r[:, None, :]
    ends = [np.exp(first * (x - _anchors(r)[:, :, None]) + second * (x - _anchors(r)[:, None, :])) for x in (0, LENGTH)]
    total = first + second
    opposite = np.abs(total) < 1e-9 * np.abs(first)
    whole = LENGTH * np.exp(-first * _anchors(r)[:, :, None] - second * _anchors(r)[:, None, :])
    products = np.where(opposite, whole, (ends[1] - ends[0]) / np.where(opposite, 1.0, total))
    squares = np.einsum("nj,nk,njk->n", c, c, products).real
    return deflection, work, BED / 2 * float(norms @ squares)


def slide(x: Array) -> Array:
    """Displacement along x (n,), m: the bar's."""
    rate = np.sqrt(DRAG / STRETCHING)
    return np.asarray(PUSH * np.cosh(rate * (LENGTH - x)) / (STRETCHING * rate * np.sinh(rate * LENGTH)))


def raft() -> dict[str, Estimate]:
    """Known values of cases/raft.toml."""
    deflection, work, bed = series()
    squeezed = POISSON * STRETCHING * float(slide(np.array([0.0]))[0] - slide(np.array([LENGTH]))[0])
    pushed = WIDTH * PUSH * float(slide(np.array([0.0]))[0])
    return _values(deflection, slide, work / 2 - bed, -(work + pushed) / 2, squeezed, CLOSED)


def _values(
    deflection: Field,
    along: Callable[[Array], Array],
    bending: float,
    potential: float,
    squeezed: float,
    error: float,
) -> dict[str, Estimate]:
    def moved(x: Array, y: Array) -> Array:
        return np.stack([along(x), np.zeros_like(x), -deflection(x, y)], axis=-1)

    x, y = np.array(POINTS).T
    values = {
        "inside_deflection": -moved(x, y)[0, 2],
        "mean_oblique": float(np.mean(moved(x, y) @ OBLIQUE)),
        "corner_slide": moved(np.array([0.0]), np.array([WIDTH]))[0, 0],
        "largest_displacement": _largest(moved),
    }
    whole = float(np.abs(values["largest_displacement"]))
    return (
        {name: Estimate(float(v), error * whole, "m") for name, v in values.items()}
        | {"bending_energy": Estimate(bending, 1e2 * error * bending, "J")}
        | {"potential_energy": Estimate(potential, 1e2 * error * abs(potential), "J")}
        | {"bank_force": Estimate(squeezed, 1e2 * error * squeezed, "N")}
    )


def _largest(moved: Callable[[Array, Array], Array]) -> float:
    """Largest displacement, which is at the loaded edge: looks at it, ever closer."""
    low, high = 0.0, WIDTH
    for _ in range(LOOKS):
        y = np.linspace(low, high, CLOSE)
        size = np.linalg.norm(moved(np.full(CLOSE, LENGTH), y), axis=-1)
        best, step = y[np.argmax(size)], y[1] - y[0]
        low, high = max(0.0, best - step), min(WIDTH, best + step)
    return float(size.max())


# --- the second form ---------------------------------------------------------------------------------


def raft_by_ritz() -> dict[str, Estimate]:
    """Values of the raft by Ritz's method, uncertain by the change from fewer functions."""
    coarse, fine = (_by_ritz(*count) for count in (FEW, MANY))
    return {name: Estimate.between(e.value, coarse[name].value, e.unit, e.uncertainty) for name, e in fine.items()}


def _by_ritz(harmonics: int, degree: int) -> dict[str, Estimate]:
    x, weights = leggauss(GAUSS)
    half = LENGTH / 2
    basis = [Legendre.basis(k) for k in range(degree)]

    def table(places: Array, order: int) -> Array:
        at = places / half - 1
        return np.array([(b.deriv(order) if order else b)(at) for b in basis]) / half**order

    points, dx = half * (x + 1), half * weights
    v, s, c = (table(points, order) for order in range(3))
    mass, slopes, mixed, curved = v * dx @ v.T, s * dx @ s.T, v * dx @ c.T, c * dx @ c.T
    end = table(np.array([LENGTH]), 0)[:, 0]
    y = np.array([start + (stop - start) / 2 * (x + 1) for start, stop, _ in LOADED])
    pressed = np.array(
        [(stop - start) / 2 * peak * weights * np.sin(np.pi / 2 * (x + 1)) for start, stop, peak in LOADED]
    )
    found, bending, potential = [], 0.0, 0.0
    for n in range(harmonics):
        p, share = n * np.pi / WIDTH, WIDTH * (1.0 if n == 0 else 0.5)
        # (w_xx + w_yy)^2 - 2 (1 - nu) (w_xx w_yy - w_xy^2), over y
        plate = curved + p**4 * mass - POISSON * p**2 * (mixed + mixed.T) + 2 * (1 - POISSON) * p**2 * slopes
        right = float(np.sum(pressed * np.cos(p * y))) * end
        found.append(np.linalg.solve(share * (BENDING * plate + BED * mass), right))
        bending += share * BENDING / 2 * float(found[-1] @ plate @ found[-1])
        potential += share / 2 * float(found[-1] @ (BENDING * plate + BED * mass) @ found[-1]) - float(
            right @ found[-1]
        )
    stretch = WIDTH * (STRETCHING * slopes + DRAG * mass)
    push = WIDTH * PUSH * table(np.zeros(1), 0)[:, 0]
    bar = np.linalg.solve(stretch, push)
    potential += float(bar @ stretch @ bar) / 2 - float(push @ bar)
    coefficients, waves = np.array(found), np.pi * np.arange(harmonics) / WIDTH

    def deflection(one: Array, two: Array) -> Array:
        cosines = np.cos(waves * np.asarray(two)[:, None])
        return np.asarray(np.einsum("pn,nk,kp->p", cosines, coefficients, table(np.asarray(one), 0)))

    strained = float(dx @ (s.T @ bar))
    rounding = 1e-8  # the condition of the bar on its soft bed
    squeezed = -POISSON * STRETCHING * strained
    return _values(deflection, lambda at: table(at, 0).T @ bar, bending, potential, squeezed, rounding)
