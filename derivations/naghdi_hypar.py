r"""Clamped hyperbolic paraboloid in Naghdi's theory: covariant turns of the normal, splines with graded knots.

z = x^2 - y^2 over the unit square. The displacement is a Cartesian vector u; the normal a3 changes by theta_a a^a. So

    2 eps_ab = a_a . u,b + a_b . u,a      gamma_a = a3 . u,a + theta_a
    2 chi_ab = theta_a,b + theta_b,a - 2 Gamma^c_ab theta_c + a3,a . u,b + a3,b . u,a

with Gamma^c_ab = x,ab . a^c. Least energy on products of splines, half of the shell: u_y and theta_2 are odd in y. Knots
are denser toward all edges: layers there are as wide as the thickness, and corners of a clamped and a free edge are
singular.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu

from .spline_shell import Splines

YOUNG, POISSON, FACTOR = 2e11, 0.3, 5.0 / 6.0
CASES = {"1e_2": (1e-2, 80.0), "1e_3": (1e-3, 8.0), "1e_4": (1e-4, 0.8)}
OBLIQUE = np.array([0.3, 0.35]), np.array([1.0, 2.0, -2.0]) / 3
PAIRS = (0, 0), (1, 1), (0, 1)
LEVELS = {"1e_2": ((9, 12, 0.02, 1.5), (9, 8, 0.02, 1.7))}
REFINEMENTS = 4
Level = tuple[int, int, float, float]
"""Degree, even spans along x (half of them along y), the thinnest span at edges in thicknesses, ratio of spans."""


def knots(start: float, open_start: bool, spans: int, thinnest: float, ratio: float) -> np.ndarray:
    """Ends of spans from `start` to 1/2: even, but graded toward 1/2, and toward `start` if it is an edge."""
    largest, layers, distance = (0.5 - start) / spans, [], thinnest
    while distance < largest:
        layers.append(distance)
        distance *= ratio
    near = np.array(layers)
    low, high = (start + (layers[-1] if open_start else 0.0)), 0.5 - layers[-1]
    inner = np.linspace(low, high, max(2, round((high - low) / largest) + 1))
    first = [start, *(start + near[:-1])] if open_start else []
    return np.array([*first, *inner, *(0.5 - near[:-1])[::-1], 0.5])


def strains(x: np.ndarray, y: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Strains (points, 8, 5, functions) of values, x- and y-slopes b (3, points, functions); metric's inverse; area."""
    o, one = np.zeros_like(x), np.ones_like(x)
    a = np.stack([np.stack([one, o, 2 * x], -1), np.stack([o, one, -2 * y], -1)])
    n, slopes = np.stack([-2 * x, 2 * y, one], -1), np.array([[-2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    g = np.sqrt(1 + 4 * x**2 + 4 * y**2)[:, None]
    a3, turns = n / g, [s / g - n * (n @ s)[:, None] / g**3 for s in slopes]
    inverse = np.linalg.inv(np.einsum("apc,bpc->pab", a, a))
    dual = np.einsum("pab,bpc->apc", inverse, a)
    christoffel = {(0, 0): 2 * dual[:, :, 2], (1, 1): -2 * dual[:, :, 2], (0, 1): 0 * dual[:, :, 2]}
    out = np.zeros((len(x), 8, 5, b.shape[2]))
    for row, (i, j) in enumerate(PAIRS):
        double = 0.5 if i == j else 1.0  # the third strain is twice the shear
        for c in range(3):
            out[:, row, c] = double * (a[i][:, c, None] * b[1 + j] + a[j][:, c, None] * b[1 + i])
            out[:, 3 + row, c] = double * (turns[i][:, c, None] * b[1 + j] + turns[j][:, c, None] * b[1 + i])
        out[:, 3 + row, 3 + i] += double * b[1 + j]
        out[:, 3 + row, 3 + j] += double * b[1 + i]
        for c in range(2):
            out[:, 3 + row, 3 + c] -= 2 * double * christoffel[i, j][c][:, None] * b[0]
    for i in (0, 1):
        for c in range(3):
            out[:, 6 + i, c] = a3[:, c, None] * b[1 + i]
        out[:, 6 + i, 3 + i] = b[0]
    return out, inverse, g[:, 0]


def elasticity(thickness: float, m: np.ndarray) -> np.ndarray:
    """Stiffness (points, 8, 8) by covariant strains, with the metric's inverse m (points, 2, 2)."""
    d, nu = YOUNG * thickness / (1 - POISSON**2), POISSON
    c = np.zeros((len(m), 8, 8))
    for p, (i, j) in enumerate(PAIRS):
        for q, (k, n) in enumerate(PAIRS):
            plane = nu * m[:, i, j] * m[:, k, n] + (1 - nu) / 2 * (m[:, i, k] * m[:, j, n] + m[:, i, n] * m[:, j, k])
            c[:, p, q], c[:, 3 + p, 3 + q] = d * plane, d * thickness**2 / 12 * plane
    c[:, 6:, 6:] = FACTOR * YOUNG * thickness / (2 * (1 + nu)) * m
    return c


def solved(thickness: float, weight: float, level: Level) -> dict[str, float]:
    """Values of the paraboloid at a level."""
    # 1. Matrix of half of the shell, span by span, and the work of the weight.
    # 2. Supports; a solve with corrections by residuals of strains.
    # 3. Energies and displacements.
    degree, spans, thinnest, ratio = level
    first = Splines(knots(-0.5, True, spans, thinnest * thickness, ratio), degree)
    second = Splines(knots(0.0, False, max(2, spans // 2), thinnest * thickness, ratio), degree)
    counts = first.count, second.count
    size = 5 * counts[0] * counts[1]
    (xs, wx), (ys, wy) = first.gauss, second.gauss
    fx, fy = (np.stack([of.local(0), of.local(1)]) for of in (first, second))
    number = np.arange(size).reshape(5, *counts)
    force, pieces, rows, columns, data = np.zeros(size), [], [], [], []
    for i, j in np.ndindex(len(xs), len(ys)):
        x, y = (part.ravel() for part in np.meshgrid(xs[i], ys[j], indexing="ij"))
        b = np.stack([
            np.einsum("pi,qj->pqij", fx[k, i], fy[m, j]).reshape(len(x), -1) for k, m in ((0, 0), (1, 0), (0, 1))
        ])  # fmt: skip
        strain, inverse, area = strains(x, y, b)
        w = np.outer(wx[i], wy[j]).ravel() * area
        here = number[:, i : i + degree + 1, j : j + degree + 1].ravel()
        parts = []
        for of in (slice(0, 3), slice(3, 8)):
            root = np.swapaxes(np.linalg.cholesky(elasticity(thickness, inverse)[:, of, of]), 1, 2)
            parts.append(np.sqrt(w)[:, None, None] * (root @ strain[:, of].reshape(len(x), root.shape[1], -1)))
        whole = np.concatenate(parts, axis=1).reshape(-1, len(here))
        pieces.append((here, parts))
        rows.append(np.repeat(here, len(here)))
        columns.append(np.tile(here, len(here)))
        data.append((whole.T @ whole).ravel())
        np.add.at(force, number[2, i : i + degree + 1, j : j + degree + 1].ravel(), -weight * (w @ b[0]))
    matrix = csc_matrix(
        coo_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size))
    )
    held = np.zeros((5, *counts), dtype=bool)
    held[:, 0] = True
    held[1, :, 0] = held[4, :, 0] = True
    free = np.flatnonzero(~held.ravel())
    inner = matrix[free][:, free]
    scale = 1 / np.sqrt(inner.diagonal())
    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    factor = splu(csc_matrix(diags(scale) @ inner @ diags(scale)), **options)
    q = np.zeros(size)
    for _ in range(1 + REFINEMENTS):
        left = force.copy()
        for here, parts in pieces:
            for part in parts:
                flat = part.reshape(-1, len(here))
                left[here] -= flat.T @ (flat @ q[here])
        q[free] += scale * factor.solve(scale * left[free])
    membrane, bending = (sum(float(np.sum((parts[k] @ q[here]) ** 2)) for here, parts in pieces) for k in (0, 1))
    table = q.reshape(5, *counts)[:3]

    def moved(x: float, y: float) -> np.ndarray:
        return np.einsum("i,cij,j->c", first.matrix(np.array([x]), 0)[0], table, second.matrix(np.array([y]), 0)[0])

    # The largest displacement is at a free corner, or on the edge beside it.
    most = minimize(lambda y: -float(np.linalg.norm(moved(0.5, y[0]))), [0.5], bounds=[(0.25, 0.5)], method="L-BFGS-B")
    return {
        "tip_deflection": -float(moved(0.5, 0.0)[2]),
        "largest_displacement": -float(most.fun),
        "oblique_displacement": float(OBLIQUE[1] @ moved(*OBLIQUE[0])),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }
