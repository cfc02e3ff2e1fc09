r"""Scordelis-Lo roof in Naghdi's theory: Fourier series along the axis, exact exponentials along the arc.

Coordinates and loads are those of `levy_roof`; the normal also has a change psi = psi_x e_x + psi_t e_t of its own, so
that there are five unknown functions. With a3,t = e_t the linear strains are, in physical components,

    eps_x = u_x      eps_t = (v_t + w) / R                    2 eps_xt = u_t / R + v_x
    chi_x = psi_x,x  chi_t = psi_t,t / R + (v_t + w) / R^2    2 chi_xt = psi_x,t / R + psi_t,x + v_x / R
    gamma_x = w_x + psi_x                                     gamma_t = (w_t - v) / R + psi_t

and for gamma = 0 those of `cylinder`. Forces N = D eps, moments M = B chi (nu = 0; shear by half the sum) and
Q = k G h gamma are in equilibrium with the load q:

    N_x,x + N_xt,t / R + q_x = 0      M_x,x + M_xt,t / R - Q_x = 0
    (N_xt + M_xt / R),x + (N_t + M_t / R),t / R + Q_t / R + q_t = 0
    Q_x,x + Q_t,t / R - (N_t + M_t / R) / R + q_w = 0      M_t,t / R + M_xt,x - Q_t = 0

A rigid diaphragm holds the section in its plane: v = w = psi_t = 0, while N_x = M_x = 0. All of it is met, harmonic by
harmonic, by u, psi_x ~ cos(alpha x) and v, w, psi_t ~ sin(alpha x). What is left is y' = A y + f with ten functions of
the angle t: five displacements, and the five forces that a free edge has none of. A is constant: y is a particular
solution under sin t and cos t, and ten exponentials, each of which is one at the end where it is largest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from .levy_roof import HALF_ANGLE, LOAD

RADIUS, LENGTH, YOUNG = 25.0, 50.0, 4.32e8
FACTOR = 5.0 / 6.0  # of transverse shear
U, V, W, PX, PT, NXT, NT, QT, MXT, MT = range(10)  # N_t stands for N_t + M_t / R
ODD = (V, PT, NXT, QT, MXT)  # functions of the angle from the crown that vanish there


@dataclass(frozen=True)
class Harmonic:
    """One harmonic: y(t) = sum_k c_k r_k exp(lambda_k (t - t_k)) + p_c cos t + p_s sin t."""

    alpha: float
    rates: np.ndarray
    anchors: np.ndarray
    vectors: np.ndarray
    particular: np.ndarray

    def functions(self, t: np.ndarray) -> np.ndarray:
        """Values (N, 10) at angles (N,)."""
        waves = np.exp((np.asarray(t)[:, None] - self.anchors) * self.rates)
        return (waves @ self.vectors.T).real + np.stack([np.cos(t), np.sin(t)], axis=-1) @ self.particular


def first_order(alpha: float, h: float, factor: float = FACTOR) -> tuple[np.ndarray, np.ndarray]:
    """A (10, 10) of y' = A y, and the strains and forces along x by y: rows N_x, M_x, Q_x, N_t, M_t."""
    r, stretch, bend = RADIUS, YOUNG * h, YOUNG * h**3 / 12.0
    shear = factor * YOUNG / 2.0 * h
    one = np.eye(10)
    a = np.zeros((10, 10))
    # Strains by y. Where two forces share a strain: N_t + M_t / R with M_t / B = chi_t = psi_t' / R + eps_t / R.
    eps_t = (one[NT] - one[MT] / r) / stretch
    psi_t = r * (one[MT] / bend - eps_t / r)
    shearing = 2.0 * one[NXT] / stretch - alpha * one[V]  # u' / R, from N_xt = D (u' / R + v_x) / 2
    # What belongs to v_x is N_xt + M_xt / R; M_xt = B (psi_x' / R + psi_t,x + v_x / R) / 2.
    twisting = 2.0 * one[MXT] / bend - alpha * one[PT] - alpha * one[V] / r
    n_x, m_x = -stretch * alpha * one[U], -bend * alpha * one[PX]
    q_x = shear * (alpha * one[W] + one[PX])
    a[U], a[V], a[W] = r * shearing, r * eps_t - one[W], r * (one[QT] / shear - one[PT]) + one[V]
    a[PX], a[PT] = r * twisting, psi_t
    a[NXT] = -r * alpha * n_x  # derivatives of sin along x are cos, those of cos are -sin
    a[NT] = r * (alpha * (one[NXT] + one[MXT] / r)) - one[QT]
    a[QT] = r * alpha * q_x + one[NT]
    a[MXT] = r * (q_x - alpha * m_x)
    a[MT] = r * (one[QT] + alpha * one[MXT])
    return a, np.array([n_x, m_x, q_x, stretch * eps_t, one[MT]])


def solve_harmonic(m: int, h: float, factor: float = FACTOR) -> Harmonic:
    """Solve one odd harmonic under the weight."""
    alpha = m * np.pi / LENGTH
    a, _ = first_order(alpha, h, factor)
    # Scaled by size of the columns: forces are in N/m, displacements in m.
    scale = np.ones(10)
    scale[[NXT, NT, QT]], scale[[MXT, MT]] = YOUNG * h, YOUNG * h**2
    scaled = a * scale / scale[:, None]
    rates, vectors = np.linalg.eig(scaled)
    # q_t = q sin t, q_w = -q cos t: f has -R q_t in N_t' and -R q_w in Q_t'.
    size = 4.0 / (m * np.pi) * LOAD * RADIUS
    f_cos, f_sin = np.zeros(10), np.zeros(10)
    f_sin[NT], f_cos[QT] = -size / scale[NT], size / scale[QT]
    # p_c cos + p_s sin: -p_c sin + p_s cos = A (p_c cos + p_s sin) + f_c cos + f_s sin.
    block = np.block([[-scaled, np.eye(10)], [-np.eye(10), -scaled]])
    p = np.linalg.solve(block, np.concatenate([f_cos, f_sin])).reshape(2, 10)
    anchors = np.where(rates.real > 0, HALF_ANGLE, 0.0)
    at = [vectors * np.exp((t - anchors) * rates) for t in (0.0, HALF_ANGLE)]
    edge = p[0] * np.cos(HALF_ANGLE) + p[1] * np.sin(HALF_ANGLE)
    matrix = np.concatenate([at[0][list(ODD)], at[1][NXT:]])
    right = -np.concatenate([p[0][list(ODD)], edge[NXT:]])
    rows = 1.0 / np.abs(matrix).max(axis=1)
    matrix, right = rows[:, None] * matrix, rows * right
    c = np.linalg.solve(matrix, right.astype(complex))
    c += np.linalg.solve(matrix, right - matrix @ c)
    return Harmonic(alpha, rates, anchors, scale[:, None] * vectors * c, p * scale)


@dataclass(frozen=True)
class NaghdiRoof:
    """All harmonics of a roof."""

    thickness: float
    harmonics: tuple[Harmonic, ...]

    def displacement(self, x: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Physical components (u, v, w) of shape (len(x), len(t), 3), m."""
        total = np.zeros((len(x), len(t), 3))
        for one in self.harmonics:
            y, phase = one.functions(t), np.asarray(x, float)[:, None] * one.alpha
            total += np.stack([np.cos(phase), np.sin(phase), np.sin(phase)], axis=-1) * y[None, :, : W + 1]
        return total

    def energies(self, points: int) -> np.ndarray:
        """Membrane, bending and shear energies, J, and half the work of the load."""
        s, weights = np.polynomial.legendre.leggauss(points)
        # Layers at the free edge are as thin as the shell: the points are graded toward it.
        t = HALF_ANGLE * (1.0 - ((1.0 - s) / 2.0) ** 3)
        weights = weights * HALF_ANGLE * 1.5 * ((1.0 - s) / 2.0) ** 2
        h, total = self.thickness, np.zeros(4)
        stretch, bend, shear = YOUNG * h, YOUNG * h**3 / 12.0, FACTOR * YOUNG / 2.0 * h
        for m, one in zip(self._numbers, self.harmonics, strict=True):
            y = one.functions(t)
            n_x, m_x, q_x, n_t, m_t = (y @ row for row in first_order(one.alpha, h)[1])
            membrane = (n_x**2 + n_t**2 + 2.0 * y[:, NXT] ** 2) / stretch
            bending = (m_x**2 + m_t**2 + 2.0 * y[:, MXT] ** 2) / bend
            shearing = (q_x**2 + y[:, QT] ** 2) / shear
            work = 4.0 / (m * np.pi) * LOAD * (y[:, V] * np.sin(t) - y[:, W] * np.cos(t))
            total += [weights @ part for part in (membrane, bending, shearing, work)]
        return 0.5 * RADIUS * LENGTH * total  # two halves, int sin^2 dx = L / 2, and 1/2 of the energy

    @property
    def _numbers(self) -> list[int]:
        return [round(one.alpha * LENGTH / np.pi) for one in self.harmonics]

    def values(self, points: int) -> dict[str, float]:
        """Values of the case."""
        middle, edge = np.array([LENGTH / 2]), np.array([HALF_ANGLE])
        _, v, w = self.displacement(middle, edge)[0, 0]
        membrane, _, _, work = self.energies(points)
        return {
            "edge_deflection": float(v * np.sin(HALF_ANGLE) - w * np.cos(HALF_ANGLE)),
            "largest_displacement": self._largest(),
            "strain_energy": float(work),
            "membrane_energy": float(membrane),
        }

    def _largest(self) -> float:
        x, t = np.linspace(0, LENGTH / 2, 21), np.linspace(0, HALF_ANGLE, 41)
        size = np.linalg.norm(self.displacement(x, t), axis=-1)
        i, j = np.unravel_index(np.argmax(size), size.shape)
        scale = np.array([x[-1], t[-1]])

        def negative(at: np.ndarray) -> float:
            return -float(np.linalg.norm(self.displacement(at[:1] * scale[0], at[1:] * scale[1])))

        start = np.array([x[i], t[j]]) / scale
        return -float(minimize(negative, start, method="L-BFGS-B", bounds=[(0, 1), (0, 1)]).fun)


def solve_roof(thickness: float, last_harmonic: int) -> NaghdiRoof:
    """Solve the odd harmonics up to the last one."""
    numbers = range(1, last_harmonic + 1, 2)
    return NaghdiRoof(thickness, tuple(solve_harmonic(m, thickness) for m in numbers))
