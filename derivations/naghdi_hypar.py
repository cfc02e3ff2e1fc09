r"""Clamped hyperbolic paraboloid in Naghdi's theory: covariant turns of the normal, Bernstein polynomials on graded cells.

z = x^2 - y^2 over the unit square. The displacement is a Cartesian vector u; the normal a3 changes by theta_a a^a. So

    2 eps_ab = a_a . u,b + a_b . u,a      gamma_a = a3 . u,a + theta_a
    2 chi_ab = theta_a,b + theta_b,a - 2 Gamma^c_ab theta_c + a3,a . u,b + a3,b . u,a

with Gamma^c_ab = x,ab . a^c. Least energy on products of Bernstein polynomials, half of the shell: u_y and theta_2 are odd
in y. Cells are graded toward all edges: layers there are as wide as the thickness, and corners of a clamped and a free
edge are singular.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu
from scipy.special import comb

YOUNG, POISSON, FACTOR = 2e11, 0.3, 5.0 / 6.0
CASES = {"1e_2": (1e-2, 80.0), "1e_3": (1e-3, 8.0), "1e_4": (1e-4, 0.8)}
OBLIQUE = np.array([0.3, 0.35]), np.array([1.0, 2.0, -2.0]) / 3
PAIRS = (0, 0), (1, 1), (0, 1)
REFINEMENTS = 2
LEVELS = {
    "1e_2": ((8, 4, 0.002, 4.0), (7, 4, 0.005, 3.0)),
    "1e_3": ((7, 8, 0.02, 3.0), (6, 6, 0.02, 3.0)),
}
Level = tuple[int, int, float, float]
"""Degree, even cells along half of a side, the thinnest cell at edges in thicknesses, ratio of their distances."""


def bernstein(s: np.ndarray, degree: int) -> np.ndarray:
    """Values and slopes (2, points, degree + 1) on [0, 1]."""

    def values(p: int) -> np.ndarray:
        k = np.arange(p + 1)
        return comb(p, k) * s[:, None] ** k * (1 - s[:, None]) ** (p - k)

    lower = np.pad(values(degree - 1), ((0, 0), (1, 1)))
    return np.stack([values(degree), degree * (lower[:, :-1] - lower[:, 1:])])


def cells(start: float, open_start: bool, even: int, thinnest: float, ratio: float) -> np.ndarray:
    """Ends of cells from `start` to 1/2: even, but graded toward 1/2, and toward `start` if it is an edge."""
    largest, layers, distance = 0.5 / even, [], thinnest
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
    # 1. Matrix of half of the shell, cell by cell, and the work of the weight.
    # 2. Supports, and a solve.
    # 3. Energies, cell by cell, and displacements.
    degree, even, thinnest, ratio = level
    ends = [cells(start, start < 0, even, thinnest * thickness, ratio) for start in (-0.5, 0.0)]
    counts = [(len(of) - 1) * degree + 1 for of in ends]
    number = np.arange(5 * counts[0] * counts[1]).reshape(5, *counts)
    s, w = np.polynomial.legendre.leggauss(degree + 3)
    s, w, n = (s + 1) / 2, w / 2, degree + 1
    table = bernstein(s, degree)
    force, rows, columns, data = np.zeros(number.size), [], [], []

    def cell(i: int, j: int) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
        """Numbers of its functions; roots of its membrane energy and of the rest; values times weights."""
        (x0, y0), (dx, dy) = (ends[0][i], ends[1][j]), (np.diff(ends[0])[i], np.diff(ends[1])[j])
        x, y = (part.ravel() for part in np.meshgrid(x0 + dx * s, y0 + dy * s, indexing="ij"))
        pairs = (table[0], table[0]), (table[1] / dx, table[0]), (table[0], table[1] / dy)
        b = np.stack([np.einsum("pi,qj->pqij", *pair).reshape(len(x), -1) for pair in pairs])
        strain, inverse, area = strains(x, y, b)
        weights = np.outer(w * dx, w * dy).ravel() * area
        parts = []
        for of in (slice(0, 3), slice(3, 8)):
            root = np.swapaxes(np.linalg.cholesky(elasticity(thickness, inverse)[:, of, of]), 1, 2)
            whole = root @ strain[:, of].reshape(len(x), root.shape[1], -1)
            parts.append((np.sqrt(weights)[:, None, None] * whole).reshape(-1, 5 * n * n))
        here = number[:, i * degree : i * degree + n, j * degree : j * degree + n].reshape(5, -1)
        return here, parts, weights @ b[0]

    every = list(np.ndindex(len(ends[0]) - 1, len(ends[1]) - 1))
    for place in every:
        here, parts, work = cell(*place)
        rows.append(np.repeat(here.ravel(), here.size))
        columns.append(np.tile(here.ravel(), here.size))
        data.append(sum(part.T @ part for part in parts).ravel())
        force[here[2]] -= weight * work
    shape = number.size, number.size
    matrix = csc_matrix(coo_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape))
    held = np.zeros(number.shape, dtype=bool)
    held[:, 0] = True
    held[1, :, 0] = held[4, :, 0] = True
    free = np.flatnonzero(~held.ravel())
    inner = matrix[free][:, free]
    scale = 1 / np.sqrt(inner.diagonal())
    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    factor = splu(csc_matrix(diags(scale) @ inner @ diags(scale)), **options)
    q, energies = np.zeros(number.size), np.zeros(2)
    for correction in range(REFINEMENTS + 1):
        # Residuals by strains: those of the matrix have lost digits, as stretching and bending are summed in it.
        left, energies = force.copy(), np.zeros(2)
        for place in every if correction else ():
            here, parts, _ = cell(*place)
            for k, part in enumerate(parts):
                strained = part @ q[here.ravel()]
                left[here.ravel()] -= part.T @ strained
                energies[k] += float(strained @ strained)  # of two halves
        if correction < REFINEMENTS:
            q[free] += scale * factor.solve(scale * left[free])
    membrane, bending = map(float, energies)

    def moved(x: float, y: float) -> np.ndarray:
        found = q.reshape(number.shape)[:3]
        for axis, at in enumerate((x, y)):
            k = min(int(np.searchsorted(ends[axis], at, side="right")) - 1, len(ends[axis]) - 2)
            share = np.array([(at - ends[axis][k]) / (ends[axis][k + 1] - ends[axis][k])])
            found = np.tensordot(found[:, k * degree : k * degree + n], bernstein(share, degree)[0, 0], (1, 0))
        return found

    return {
        "tip_deflection": -float(moved(0.5, 0.0)[2]),
        "oblique_displacement": float(OBLIQUE[1] @ moved(*OBLIQUE[0])),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }
