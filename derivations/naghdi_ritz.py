r"""Naghdi's theory by the Ritz method: polynomials in two directions, strains from products of vectors.

The displacement u and the change d of the normal are vectors, and the linear strains

    2 eps_ab = a_a . u,b + a_b . u,a      2 chi_ab = a_a . d,b + a_b . d,a + a3,a . u,b + a3,b . u,a
    gamma_a  = a3 . u,a + a_a . d

With u = (u, v, w) and d = (psi_1, psi_2, 0) in the orthonormal frame of a plane or a cylinder, e,b = e Omega_b, the
coefficients are constant. Shell and load are symmetric: a quarter is solved for, on integrated Legendre functions in
both directions, of which those at an end are left out where the function vanishes there. Everything else is natural.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import bmat, csc_matrix, kron
from scipy.sparse.linalg import splu

FACTOR = 5.0 / 6.0
ZERO = 1e-14  # of the largest entry: what integrals of orthogonal functions leave of it
PARTS = {"membrane": slice(0, 3), "bending": slice(3, 6), "shear": slice(6, 8)}


def functions(s: np.ndarray, degree: int) -> np.ndarray:
    """Values and slopes (2, N, degree + 1) on [-1, 1]: two linear functions, and ones that vanish at both ends."""
    legendre, k = np.polynomial.legendre.legvander(s, degree), np.arange(1, degree)
    out = np.zeros((2, len(s), degree + 1))
    out[0, :, 0], out[0, :, 1], out[1, :, 0], out[1, :, 1] = (1 - s) / 2, (1 + s) / 2, -0.5, 0.5
    scale = np.sqrt((2 * k + 1) / 2.0)
    out[0, :, 2:] = scale * (legendre[:, k + 1] - legendre[:, k - 1]) / (2 * k + 1)
    out[1, :, 2:] = scale * legendre[:, k]
    return out


def strains(radius: float) -> np.ndarray:
    """S (3, 8, 5): strain = S[0] q + S[1] q,x + S[2] q,s, s the arc; of a plane if the radius is infinite."""
    turn = np.zeros((3, 3, 3))  # e,x = 0; e_2,s = -e_3 / R, e_3,s = e_2 / R
    turn[2, 2, 1], turn[2, 1, 2] = -1.0 / radius, 1.0 / radius
    e, u, d = np.eye(3), np.eye(3, 5), np.zeros((3, 5))
    d[0, 3] = d[1, 4] = 1.0

    def slope(of: np.ndarray, b: int) -> list[np.ndarray]:
        # Derivative of a vector along b: coefficients of q, q,x and q,s, each (3, 5).
        parts = [turn[b] @ of, np.zeros((3, 5)), np.zeros((3, 5))]
        parts[b] = of
        return parts

    out = np.zeros((3, 8, 5))
    for k in range(3):
        du, dd = (np.array([slope(of, b)[k] for b in (1, 2)]) for of in (u, d))
        normal = [turn[b] @ e[2] for b in (1, 2)]
        for row, (a, b) in enumerate([(0, 0), (1, 1), (0, 1)]):
            double = 1.0 if a == b else 2.0  # the third strain is twice the shear
            out[k, row] = double / 2 * (e[a] @ du[b] + e[b] @ du[a])
            out[k, 3 + row] = double / 2 * (e[a] @ dd[b] + e[b] @ dd[a] + normal[a] @ du[b] + normal[b] @ du[a])
        for a in (0, 1):
            out[k, 6 + a] = e[2] @ du[a] + (e[a] @ d if k == 0 else 0.0)
    return out


@dataclass(frozen=True)
class Quarter:
    """A quarter of a shell, its load and where its functions vanish.

    Attributes
    ----------
    lengths
        Of its sides, the first coordinate's first, m; both begin at 0.
    vanish
        For each function of (u, v, w, psi_1, psi_2): whether it is zero at the begin and end of either coordinate.
    load
        Load (N, 5) at the second coordinate (N,), N/m^2; the same along the first.
    """

    radius: float
    lengths: tuple[float, float]
    young: float
    poisson: float
    thickness: float
    vanish: tuple[tuple[tuple[bool, bool], tuple[bool, bool]], ...]
    load: Callable[[np.ndarray], np.ndarray]

    def elasticity(self) -> np.ndarray:
        """Stiffness (8, 8) of membrane, bending and shear."""
        e, nu, h = self.young, self.poisson, self.thickness
        plane = np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, (1.0 - nu) / 2.0]]) / (1.0 - nu**2)
        c = np.zeros((8, 8))
        c[:3, :3], c[3:6, 3:6] = e * h * plane, e * h**3 / 12.0 * plane
        c[6, 6] = c[7, 7] = FACTOR * e * h / (2.0 * (1.0 + nu))
        return c

    def solve(self, degrees: tuple[int, int]) -> Polynomials:
        """Minimise the potential energy."""
        values, weights, rules = [], [], []
        for length, degree in zip(self.lengths, degrees, strict=True):
            s, w = np.polynomial.legendre.leggauss(degree + 8)
            f = functions(s, degree)
            f[1] *= 2.0 / length
            values.append(f)
            weights.append(w * length / 2)
            rules.append((s + 1) * length / 2)
        one = [
            [[_sparse(f[i].T @ (w[:, None] * f[j])) for j in (0, 1)] for i in (0, 1)]
            for f, w in zip(values, weights, strict=True)
        ]
        kept = [
            [
                np.setdiff1d(np.arange(degree + 1), np.flatnonzero(zero))
                for zero, degree in zip(of, degrees, strict=True)
            ]
            for of in self.vanish
        ]
        operators, c = strains(self.radius), self.elasticity()
        matrices = {name: self._matrix(operators[:, rows], c[rows, rows], one, kept) for name, rows in PARTS.items()}
        q = self.load(rules[1])
        along = values[0][0].T @ weights[0]
        right = np.concatenate(
            [np.kron(along[x], (values[1][0].T @ (weights[1] * q[:, a]))[t]) for a, (x, t) in enumerate(kept)]
        )
        matrix = csc_matrix(sum(matrices.values()))
        scale = 1.0 / np.sqrt(matrix.diagonal())
        scaled = csc_matrix(matrix.multiply(scale[:, None]).multiply(scale))
        factor = splu(scaled)
        y = factor.solve(scale * right)
        y += factor.solve(scale * right - scaled @ y)
        answer = scale * y
        energies = {name: float(0.5 * answer @ (k @ answer)) for name, k in matrices.items()}
        table, start = [], 0
        for x, t in kept:
            full = np.zeros((degrees[0] + 1, degrees[1] + 1))
            full[np.ix_(x, t)] = answer[start : start + len(x) * len(t)].reshape(len(x), len(t))
            table.append(full)
            start += len(x) * len(t)
        return Polynomials(self.lengths, degrees, np.array(table), energies, float(0.5 * right @ answer))

    def _matrix(self, s: np.ndarray, c: np.ndarray, one: list, kept: list) -> csc_matrix:
        blocks = [[None] * 5 for _ in range(5)]
        for a in range(5):
            for b in range(5):
                total = 0
                for k in range(3):
                    for j in range(3):
                        if factor := float(s[k, :, a] @ c @ s[j, :, b]):
                            x = one[0][int(k == 1)][int(j == 1)][kept[a][0]][:, kept[b][0]]
                            t = one[1][int(k == 2)][int(j == 2)][kept[a][1]][:, kept[b][1]]
                            total = total + factor * kron(x, t)
                shape = len(kept[a][0]) * len(kept[a][1]), len(kept[b][0]) * len(kept[b][1])
                blocks[a][b] = total if not isinstance(total, int) else csc_matrix(shape)
        return csc_matrix(bmat(blocks))


def _sparse(matrix: np.ndarray) -> csc_matrix:
    return csc_matrix(np.where(np.abs(matrix) > ZERO * np.abs(matrix).max(), matrix, 0.0))


@dataclass(frozen=True)
class Polynomials:
    """The answer on a quarter, its energies by part, and half the work of the load there, J."""

    lengths: tuple[float, float]
    degrees: tuple[int, int]
    coefficients: np.ndarray
    energies: dict[str, float]
    half_work: float

    def displacement(self, x: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Components (len(x), len(s), 3), m."""
        first, second = (
            functions(2.0 * np.asarray(at) / length - 1.0, degree)[0]
            for at, length, degree in zip((x, s), self.lengths, self.degrees, strict=True)
        )
        return np.einsum("xi,aij,sj->xsa", first, self.coefficients[:3], second, optimize=True)

    def largest(self) -> float:
        """Largest displacement, m."""
        x, s = (np.linspace(0, length, 41) for length in self.lengths)
        size = np.linalg.norm(self.displacement(x, s), axis=-1)
        i, j = np.unravel_index(np.argmax(size), size.shape)
        scale = np.array(self.lengths)

        def negative(at: np.ndarray) -> float:
            return -float(np.linalg.norm(self.displacement(at[:1] * scale[0], at[1:] * scale[1])))

        start = np.array([x[i], s[j]]) / scale
        return -float(minimize(negative, start, method="L-BFGS-B", bounds=[(0, 1), (0, 1)]).fun)


FREE, BEGIN, END = (False, False), (True, False), (False, True)


def roof(thickness: float, soft: bool = False) -> Quarter:
    """The roof of `levy_roof`: the first coordinate along the axis from a diaphragm, the second from the crown.

    A soft diaphragm leaves the normal free to turn in its plane.
    """
    radius = 25.0
    return Quarter(
        radius, (25.0, radius * np.deg2rad(40.0)), 4.32e8, 0.0, thickness,
        ((END, FREE), (BEGIN, BEGIN), (BEGIN, FREE), (END, FREE), (FREE if soft else BEGIN, BEGIN)),
        lambda s: 90.0 * np.stack([0 * s, np.sin(s / radius), -np.cos(s / radius), 0 * s, 0 * s], axis=-1),
    )  # fmt: skip


def roof_values(thickness: float, degrees: tuple[int, int], soft: bool = False) -> dict[str, float]:
    """Values of the case of the roof."""
    found, t = roof(thickness, soft).solve(degrees), np.deg2rad(40.0)
    _, v, w = found.displacement(np.array([25.0]), np.array([25.0 * t]))[0, 0]
    return {
        "edge_deflection": float(v * np.sin(t) - w * np.cos(t)),
        "largest_displacement": found.largest(),
        "strain_energy": 4.0 * found.half_work,
        "membrane_energy": 4.0 * found.energies["membrane"],
    }


def plate(side: float, thickness: float, young: float, poisson: float, pressure: float, soft: bool = False) -> Quarter:
    """A square plate whose rim holds the displacement, and the normal's change along it unless it is soft.

    Fields are (u, v, w, psi_1, psi_2).
    """
    half, along = side / 2, FREE if soft else BEGIN
    return Quarter(
        np.inf, (half, half), young, poisson, thickness,
        (((True, True), BEGIN), (BEGIN, (True, True)), (BEGIN, BEGIN), (END, along), (along, END)),
        lambda s: pressure * np.stack([0 * s, 0 * s, -1 + 0 * s, 0 * s, 0 * s], axis=-1),
    )  # fmt: skip
