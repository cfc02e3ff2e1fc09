r"""Naghdi's roof and plate once more: splines across, slices along, each twice as long as the one before.

Coordinates and strains are the physical components of `naghdi_roof`, with s = R t and any Poisson's ratio; a plate has
R = infinity. Splines in s leave, with e = E0(s) q + E1(s) q,x,

    energy = 1/2 int (q . K00 q + 2 q . K01 q,x + q,x . K11 q,x) dx - int f . q dx.

Nothing of it depends on x. In a slice q is a Legendre polynomial in x, whose inner functions are eliminated. The energy
of a slice is

    1/2 y . A y - b . y - c,    y = (q at its begin, q at its end).

Slices are joined one by one from the supported end, where they are thin, to the middle; what lies between is eliminated.
Hard supports hold v, w and psi_s, soft ones leave psi_s free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from .spline_shell import Splines

FACTOR = 5.0 / 6.0  # of transverse shear
U, V, W, PX, PS = range(5)
NUDGE = 1e-2  # relative change of the membrane stiffness by which its energy is found
LEVELS = (16, 9, 11, 9), (14, 9, 10, 8)  # spans, degree, degree of slices and their number: fine, and coarser
POINTS = 4  # Gauss points more than the degree of the slice


@dataclass(frozen=True)
class Slices:
    """A quarter of a shell: from a supported end to the middle, and from the crown to a long edge.

    Attributes
    ----------
    radius, length, width : of the cylinder, of the quarter along x, and along s, m
    young, poisson, thickness : Pa, 1, m
    load : (N, 3) of s (N,), N/m^2, along u, v, w
    edge : fields that vanish at the long edge
    soft : whether the supported end leaves psi_s free
    """

    radius: float
    length: float
    width: float
    young: float
    poisson: float
    thickness: float
    load: object
    edge: tuple[int, ...]
    soft: bool

    def strains(self, values: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """E0 and E1 (points, 8, 5, functions): strains eps_x, eps_s, 2 eps_xs, the same of chi, gamma_x, gamma_s."""
        e0, e1 = np.zeros((2, len(values), 8, 5, values.shape[1]))
        k = 1.0 / self.radius
        e1[:, 0, U] = values
        e0[:, 1, V], e0[:, 1, W] = slopes, k * values
        e0[:, 2, U], e1[:, 2, V] = slopes, values
        e1[:, 3, PX] = values
        e0[:, 4, PS], e0[:, 4, V], e0[:, 4, W] = slopes, k * slopes, k * k * values
        e0[:, 5, PX], e1[:, 5, PS], e1[:, 5, V] = slopes, values, k * values
        e1[:, 6, W], e0[:, 6, PX] = values, values
        e0[:, 7, W], e0[:, 7, V], e0[:, 7, PS] = slopes, -k * values, values
        return e0, e1

    def elasticity(self, stretching: float) -> np.ndarray:
        """Stiffness (8, 8); that of the membrane times a factor."""
        e, nu, h = self.young, self.poisson, self.thickness
        plane = e / (1.0 - nu**2) * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, (1.0 - nu) / 2.0]])
        c = np.zeros((8, 8))
        c[:3, :3], c[3:6, 3:6] = stretching * h * plane, h**3 / 12.0 * plane
        c[6, 6] = c[7, 7] = FACTOR * e * h / (2.0 * (1.0 + nu))
        return c

    def potential(
        self, spans: int, degree: int, order: int, slices: int, stretching: float = 1.0
    ) -> tuple[float, np.ndarray]:
        """Least potential energy of the quarter, J, and the fields (5, 2) of the middle at the crown and at the edge."""
        # 1. Splines across, their knots denser toward the edge.
        splines = Splines(self.width * (1.0 - (1.0 - np.linspace(0.0, 1.0, spans + 1)) ** 2.5), degree)
        s, weights = (part.ravel() for part in splines.gauss)
        values, n = splines.matrix(s, 0), splines.count
        e0, e1 = (of.reshape(len(s), 8, -1) for of in self.strains(values, splines.matrix(s, 1)))
        c = self.elasticity(stretching)
        k00, k01, k11 = (
            np.einsum("p,pia,ij,pjb->ab", weights, one, c, other, optimize=True)
            for one, other in ((e0, e0), (e0, e1), (e1, e1))
        )
        force = np.zeros((5, n))
        force[:3] = (values.T @ (weights[:, None] * self.load(s))).T  # type: ignore[operator]
        # The crown is a plane of symmetry.
        vanish = {(V, 0), (PS, 0), *((field, n - 1) for field in self.edge)}
        kept = np.array([field * n + i for field in range(5) for i in range(n) if (field, i) not in vanish])
        k00, k01, k11 = (k[np.ix_(kept, kept)] for k in (k00, k01, k11))
        # 2. Slices from the supported end.
        half, length, right = len(kept), self.length / 2**slices, force.ravel()[kept]
        a, b, c0 = _slice(k00, k01, k11, right, length, order)
        for _ in range(slices):
            more, loaded, constant = _slice(k00, k01, k11, right, length, order)
            # 3. Joined: the middle of y = (begin, middle, end) is eliminated.
            across = np.block([[a[half:, :half], more[:half, half:]]])
            both = b[half:] + loaded[:half]
            found = np.linalg.solve(a[half:, half:] + more[:half, :half], np.column_stack([across, both]))
            outer = np.zeros_like(a)
            outer[:half, :half], outer[half:, half:] = a[:half, :half], more[half:, half:]
            c0 += constant + 0.5 * float(both @ found[:, -1])
            b = np.concatenate([b[:half], loaded[half:]]) - across.T @ found[:, -1]
            a = outer - across.T @ found[:, :-1]
            a = (a + a.T) / 2.0
            length *= 2.0
        # 4. Supports: the begin is supported, the end lies in a plane of symmetry.
        field = kept // n
        begin = ~np.isin(field, (V, W) if self.soft else (V, W, PS))
        free = np.concatenate([begin, ~np.isin(field, (U, PX))])
        y = np.zeros(2 * half)
        y[free] = np.linalg.solve(a[np.ix_(free, free)], b[free])
        last = np.zeros(5 * n)
        last[kept] = y[half:]
        ends = splines.matrix(np.array([0.0, self.width]), 0)
        return float(-0.5 * b @ y - c0), last.reshape(5, n) @ ends.T

    def membrane_energy(self, *levels: int) -> float:
        """Membrane energy of the quarter, J: the slope of the least energy by the membrane's stiffness."""
        first, second = (
            (self.potential(*levels, 1.0 + d)[0] - self.potential(*levels, 1.0 - d)[0]) / (2.0 * d)
            for d in (NUDGE, 2.0 * NUDGE)
        )
        return (4.0 * first - second) / 3.0


def _slice(
    k00: np.ndarray, k01: np.ndarray, k11: np.ndarray, force: np.ndarray, length: float, order: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """A, b and c of a slice, by Legendre polynomials in x; the first two functions are one at its begin and its end."""
    x, w = legendre.leggauss(order + POINTS)
    shapes = np.zeros((order + 1, order + 1))  # coefficients of Legendre polynomials, by function
    shapes[0, :2], shapes[1, :2] = (0.5, -0.5), (0.5, 0.5)
    for k in range(2, order + 1):
        shapes[k, k], shapes[k, k - 2] = 1.0, -1.0
    f = np.array([legendre.legval(x, row) for row in shapes])
    g = np.array([legendre.legval(x, legendre.legder(row)) for row in shapes])
    w = w * length / 2.0
    g = g * 2.0 / length
    ff, fg, gg = (f * w) @ f.T, (f * w) @ g.T, (g * w) @ g.T
    whole = np.kron(ff, k00) + np.kron(gg, k11) + np.kron(fg, k01) + np.kron(fg.T, k01.T)
    right = np.kron(f @ w, force)
    outer = 2 * len(force)
    inside = np.linalg.solve(whole[outer:, outer:], np.column_stack([whole[outer:, :outer], right[outer:]]))
    a = whole[:outer, :outer] - whole[:outer, outer:] @ inside[:, :-1]
    b = right[:outer] - whole[:outer, outer:] @ inside[:, -1]
    return (a + a.T) / 2.0, b, 0.5 * float(right[outer:] @ inside[:, -1])


def roof(thickness: float, soft: bool) -> Slices:
    """The roof of `levy_roof`."""
    radius, angle = 25.0, np.deg2rad(40.0)

    def weight(s: np.ndarray) -> np.ndarray:
        return 90.0 * np.stack([0 * s, np.sin(s / radius), -np.cos(s / radius)], axis=-1)

    return Slices(radius, 25.0, radius * angle, 4.32e8, 0.0, thickness, weight, (), soft)


def roof_values(thickness: float, soft: bool, *levels: int) -> dict[str, float]:
    """Values of the case of the roof; its largest displacement is that of the edge."""
    shell = roof(thickness, soft)
    least, fields = shell.potential(*levels)
    (v, w), t = fields[[V, W], 1], np.deg2rad(40.0)
    return {
        "edge_deflection": float(v * np.sin(t) - w * np.cos(t)),
        "largest_displacement": float(np.hypot(v, w)),
        "strain_energy": -4.0 * least,
        "membrane_energy": 4.0 * shell.membrane_energy(*levels),
    }


def plate_values(
    side: float, thickness: float, young: float, poisson: float, pressure: float, soft: bool, *levels: int
) -> dict[str, float]:
    """Values of a square plate that is supported all around."""

    def load(s: np.ndarray) -> np.ndarray:
        return pressure * np.stack([0 * s, 0 * s, -1 + 0 * s], axis=-1)

    edge = (U, W) if soft else (U, W, PX)
    least, fields = Slices(np.inf, side / 2, side / 2, young, poisson, thickness, load, edge, soft).potential(*levels)
    deflection = -float(fields[W, 0])
    return {"centre_deflection": deflection, "largest_displacement": deflection, "strain_energy": -4.0 * least}
