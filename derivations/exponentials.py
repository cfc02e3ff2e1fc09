r"""The second form of one harmonic: exact exponentials instead of Legendre polynomials.

The Euler-Lagrange equations of 1/2 int (S q) . C (S q) ds - int f . q ds have constant coefficients,
A(d/ds) q = f with A(z) = S(-z)^T C S(z), S(z) = S[0] + S[1] z + S[2] z^2 (see `cylinder`). The
homogeneous solutions are q_j exp(z_j s), where z_j are the eight roots of det A(z), a polynomial in
z^2, and A(z_j) q_j = 0; a load f exp(z s) has the particular solution A(z)^-1 f exp(z s). Coefficients
follow from the stationarity of the same energy over this complex space (bilinear, no conjugate),
whose integrals are elementary, so that natural end conditions again need no formula.

This is exact, but it loses digits where roots come together (high harmonics, n = 0 or 1): a check
of the Legendre-Ritz method, not a replacement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import null_space


def symbol_coefficients(strains: np.ndarray, elasticity: np.ndarray) -> np.ndarray:
    """Coefficients (5, 3, 3) of A(z) = S(-z)^T C S(z) by powers of z."""
    out = np.zeros((5, 3, 3))
    for i in range(3):
        for j in range(3):
            out[i + j] += (-1) ** i * strains[i].T @ elasticity @ strains[j]
    return out


def symbol(coefficients: np.ndarray, z: complex) -> np.ndarray:
    """A(z), (3, 3)."""
    return np.tensordot(z ** np.arange(5), coefficients, axes=1)


def characteristic_roots(coefficients: np.ndarray) -> np.ndarray:
    """The eight roots z of det A(z) = 0."""
    # Unit of length and of each component: make the entries' coefficients comparable.
    balance = 1.0 / np.sqrt(np.abs(np.diagonal(coefficients[0])))
    length = (coefficients[4, 2, 2] / coefficients[0, 2, 2]) ** 0.25
    scaled = coefficients * balance[:, None] * balance
    scaled = scaled / length ** np.arange(5)[:, None, None]
    a = [[Polynomial(scaled[:, i, j]) for j in range(3)] for i in range(3)]
    determinant = sum(
        a[0][i] * (a[1][j] * a[2][k] - a[1][k] * a[2][j]) for i, j, k in [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
    )
    squares = Polynomial(determinant.coef[0:9:2]).roots().astype(complex)
    roots = np.sqrt(squares) / length
    return np.concatenate([roots, -roots])


@dataclass(frozen=True)
class ExponentialTerms:
    """Vectors (3, J) times exp(z_j (s - anchor_j)) on [left, right]; the anchors avoid overflow."""

    left: float
    right: float
    exponents: np.ndarray
    vectors: np.ndarray

    @classmethod
    def homogeneous(cls, coefficients: np.ndarray, left: float, right: float) -> ExponentialTerms:
        """The eight solutions of A(d/ds) q = 0."""
        roots = characteristic_roots(coefficients)
        # The null vector is the right singular vector of the least singular value.
        vectors = [np.linalg.svd(symbol(coefficients, z))[2][-1].conj() for z in roots]
        return cls(left, right, roots, np.array(vectors).T)

    @property
    def anchors(self) -> np.ndarray:
        """The end at which each exponential is one: it decays into the interval."""
        return np.where(self.exponents.real > 0, self.right, self.left)

    def evaluate(self, s: float, derivative: int = 0) -> np.ndarray:
        """Each term at one point, (3, J)."""
        growth = np.exp(self.exponents * (s - self.anchors))
        return self.vectors * self.exponents**derivative * growth

    def strains(self, strains: np.ndarray) -> np.ndarray:
        """Strain vectors S(z_j) q_j, (6, J), which multiply the same exponentials."""
        powers = self.exponents ** np.arange(3)[:, None]
        return np.einsum("kec,kj,cj->ej", strains, powers, self.vectors)

    def overlap(self, other: ExponentialTerms) -> np.ndarray:
        """Int exp(z_i (s - a_i)) exp(z_j (s - a_j)) ds, (I, J)."""
        total = self.exponents[:, None] + other.exponents

        def at(s: float) -> np.ndarray:
            return np.exp((self.exponents * (s - self.anchors))[:, None] + other.exponents * (s - other.anchors))

        length = self.right - self.left
        vanishing = np.abs(total) * length < 1e-10
        safe = np.where(vanishing, 1.0, total)
        return np.where(vanishing, length * at(self.left), (at(self.right) - at(self.left)) / safe)


def constrained_stationary_point(matrix: np.ndarray, right_side: np.ndarray, constraints: np.ndarray) -> np.ndarray:
    """Stationary point of c.M c / 2 - r.c (bilinear, complex) over constraints @ c = 0."""
    constraints = constraints / np.linalg.norm(constraints, axis=1, keepdims=True)
    basis = null_space(constraints)
    reduced = basis.T @ matrix @ basis
    # The complex symmetric matrix is badly scaled and nearly singular where roots are close.
    scale = 1.0 / np.sqrt(np.abs(np.diagonal(reduced)))
    balanced = scale[:, None] * reduced * scale
    return basis @ (scale * np.linalg.solve(balanced, scale * (basis.T @ right_side)))


@dataclass(frozen=True)
class ExponentialSum:
    """A solution of one harmonic: exponential terms with their coefficients (J,)."""

    terms: ExponentialTerms
    coefficients: np.ndarray

    def at(self, s: float, derivative: int = 0) -> np.ndarray:
        """(U, V, W) or a derivative of it at one point, real (3,)."""
        return (self.terms.evaluate(s, derivative) @ self.coefficients).real

    def energies(self, strains: np.ndarray, elasticities: tuple[np.ndarray, ...]) -> list[float]:
        """Energy 1/2 int (S q) . C (S q) ds for each C (6, 6); the integrals are elementary."""
        own, overlap = self.terms.strains(strains), self.terms.overlap(self.terms)
        return [
            float((self.coefficients @ ((own.T @ c @ own) * overlap) @ self.coefficients).real) / 2
            for c in elasticities
        ]


def roof_harmonic(strains: np.ndarray, elasticity: np.ndarray, half_angle: float, load: float) -> ExponentialSum:
    """One harmonic of the roof under (0, load sin t, -load cos t), V(0) = W'(0) = 0, free at t = half_angle.

    The particular solution is the real part of A(i)^-1 f exp(i t), f = load (0, -i, -1): U and W are
    even and V is odd, which meets the conditions at the crown.
    """
    coefficients = symbol_coefficients(strains, elasticity)
    terms = ExponentialTerms.homogeneous(coefficients, 0.0, half_angle)
    force = load * np.array([[0, 0], [-0.5j, 0.5j], [-0.5, -0.5]])
    pair = np.array([1j, -1j])
    response = [np.linalg.solve(symbol(coefficients, z), f) for z, f in zip(pair, force.T, strict=True)]
    particular = ExponentialTerms(0.0, half_angle, pair, np.array(response).T)

    own = terms.strains(strains)
    matrix = (own.T @ elasticity @ own) * terms.overlap(terms)
    cross = (own.T @ elasticity @ particular.strains(strains)) * terms.overlap(particular)
    work = (terms.vectors.T @ force) * terms.overlap(particular)
    constraints = np.array([terms.evaluate(0.0)[1], terms.evaluate(0.0, 1)[2]])
    c = constrained_stationary_point(matrix, (work - cross).sum(axis=1), constraints)
    exponents = np.concatenate([terms.exponents, pair])
    both = ExponentialTerms(0.0, half_angle, exponents, np.hstack([terms.vectors, particular.vectors]))
    return ExponentialSum(both, np.concatenate([c, np.ones(2)]))


def point_load_harmonic(strains: np.ndarray, elasticity: np.ndarray, length: float, load: float) -> ExponentialSum:
    """A strip [0, length] with U(0) = W'(0) = 0, load on W at 0, the far end free."""
    coefficients = symbol_coefficients(strains, elasticity)
    terms = ExponentialTerms.homogeneous(coefficients, 0.0, length)
    own = terms.strains(strains)
    matrix = (own.T @ elasticity @ own) * terms.overlap(terms)
    constraints = np.array([terms.evaluate(0.0)[0], terms.evaluate(0.0, 1)[2]])
    return ExponentialSum(terms, constrained_stationary_point(matrix, load * terms.evaluate(0.0)[2], constraints))


def edge_displacement_of_roof_harmonic(
    strains: np.ndarray, elasticity: np.ndarray, half_angle: float, load: float
) -> np.ndarray:
    """(U, V, W) of a harmonic of the roof at its free edge t = half_angle; see `roof_harmonic`."""
    return roof_harmonic(strains, elasticity, half_angle, load).at(half_angle)


def end_displacement_under_point_load(strains: np.ndarray, elasticity: np.ndarray, length: float, load: float) -> float:
    """W(0) of a strip under a load on W at 0; see `point_load_harmonic`."""
    return float(point_load_harmonic(strains, elasticity, length, load).at(0.0)[2])
