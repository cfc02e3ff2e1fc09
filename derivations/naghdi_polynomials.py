r"""Clamped hyperbolic paraboloid of Bastek & Kochmann in Naghdi's theory, two ways.

z = x^2 - y^2 over the unit square, clamped along x = -1/2, E = 1 Pa, h = .1 m, load h times 1 N/m^3 downward. First way:
`naghdi_hypar`, covariant turns of the normal on graded cells. Second way: polynomials of high degree over half of the
shell, in coordinates t with x = tanh(c t) / (2 tanh(c)), denser toward edges. Displacement u and change d of the normal are vectors, d = psi_1 t_1 + psi_2 t_2 with t_1 along x in the surface
and t_2 across it. The strains are products of vectors, those of `naghdi_ritz`,

    2 eps_ab = a_a . u,b + a_b . u,a      2 chi_ab = a_a . d,b + a_b . d,a + a3,a . u,b + a3,b . u,a
    gamma_a  = a3 . u,a + a_a . d

in the frame t_1, t_2, whose derivatives are complex steps.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate
from .naghdi_hypar import YOUNG as STEEL
from .naghdi_hypar import solved
from .naghdi_ritz import FACTOR, functions

THICKNESS, POISSON, LOAD = 0.1, 0.3, 0.1  # m, 1, N/m^2; Young's modulus is 1 Pa
OBLIQUE = np.array([0.3, 0.35]), np.array([1.0, 2.0, -2.0]) / 3
CELLS = (8, 4, 0.005, 4.0), (7, 3, 0.02, 3.0)  # levels of `naghdi_hypar`
DEGREES = (30, 20), (24, 16)
STARTS = -1.0, 0.0  # of the stretched coordinates, x and y; both end at 1
GRADING = 2.0
STEP = 1e-30
ENERGIES = "strain_energy", "membrane_energy", "bending_energy"


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    # Corners are singular: errors fall with a power, so that twice the change is their estimate.
    return {
        name: Estimate(value, 2 * abs(value - coarse[name]), "J" if name in ENERGIES else "m")
        for name, value in fine.items()
    }


def hypar_naghdi() -> dict[str, Estimate]:
    """Known values by graded cells; there E is that of steel, so that the load is as many times larger."""

    def values(level: tuple[int, int, float, float]) -> dict[str, float]:
        found = solved(THICKNESS, LOAD * STEEL, level)
        return {name: value / (STEEL if name in ENERGIES else 1) for name, value in found.items()}

    return _estimates(*map(values, CELLS))


def _frame(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """a_1, a_2, t_1, t_2, a_3 (5, points, 3) at complex places."""
    one, o = np.ones_like(x), np.zeros_like(x)
    first, second = np.stack([one, o, 2 * x], -1), np.stack([o, one, -2 * y], -1)
    normal = np.cross(first, second)
    normal = normal / np.sqrt((normal**2).sum(-1))[:, None]
    along = first / np.sqrt((first**2).sum(-1))[:, None]
    return np.stack([first, second, along, np.cross(normal, along), normal])


def _strains(x: np.ndarray, y: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Physical strains (8, points, 5, functions) of values, x- and y-slopes b (3, points, functions); area (points,)."""
    # 1. Covariant strains of a coefficient of u or psi.
    # 2. Components in the frame: e = T^T eps T with T^a_i = a^a . t_i.
    frame = _frame(x, y)
    slopes = [_frame(x + 1j * STEP, y + 0j).imag / STEP, _frame(x + 0j, y + 1j * STEP).imag / STEP]
    base, tangents, normal = frame[:2], frame[2:4], frame[4]
    du = [np.einsum("pf,cd->cpfd", b[1 + k], np.eye(3)) for k in (0, 1)]
    d = np.einsum("pf,ipd->ipfd", b[0], tangents)
    dd = [
        np.einsum("pf,ipd->ipfd", b[1 + k], tangents) + np.einsum("pf,ipd->ipfd", b[0], slopes[k][2:4]) for k in (0, 1)
    ]
    count = b.shape[2]
    eps, chi, gamma = (
        np.zeros((2, 2, len(x), 5, count)),
        np.zeros((2, 2, len(x), 5, count)),
        np.zeros((2, len(x), 5, count)),
    )

    def dot(vector: np.ndarray, of: np.ndarray) -> np.ndarray:
        return np.einsum("pd,cpfd->pcf", vector, of)

    for i in (0, 1):
        gamma[i, :, :3], gamma[i, :, 3:] = dot(normal, du[i]), dot(base[i], d)
        for j in (0, 1):
            eps[i, j, :, :3] = (dot(base[i], du[j]) + dot(base[j], du[i])) / 2
            chi[i, j, :, :3] = (dot(slopes[i][4], du[j]) + dot(slopes[j][4], du[i])) / 2
            chi[i, j, :, 3:] = (dot(base[i], dd[j]) + dot(base[j], dd[i])) / 2
    metric = np.einsum("apd,bpd->pab", base, base)
    turn = np.einsum("pab,bpd,ipd->pai", np.linalg.inv(metric), base, tangents)
    out = np.zeros((8, len(x), 5, count))
    for start, of in ((0, eps), (3, chi)):
        local = np.einsum("pai,abpcf,pbj->ijpcf", turn, of, turn, optimize=True)
        out[start], out[start + 1], out[start + 2] = local[0, 0], local[1, 1], 2 * local[0, 1]
    out[6:] = np.einsum("pai,apcf->ipcf", turn, gamma)
    return out, np.sqrt(np.linalg.det(metric))


def _by_polynomials(degrees: tuple[int, int]) -> dict[str, float]:
    # 1. Functions: all but the one that does not vanish at the clamp; in y those of u_y and psi_2 vanish at 0.
    # 2. Matrix row of points by row of points.
    # 3. Solve, with one correction.
    rules = [np.polynomial.legendre.leggauss(degree + 16) for degree in degrees]
    tables = [functions(s, degree) for (s, _), degree in zip(rules, degrees, strict=True)]
    places, widths = [], []
    for (s, w), table, start in zip(rules, tables, STARTS, strict=True):
        t = start + (1 - start) * (s + 1) / 2
        stretch = (1 - start) / 2 * 0.5 * GRADING / np.tanh(GRADING) / np.cosh(GRADING * t) ** 2
        table[1] /= stretch[:, None]
        places.append(0.5 * np.tanh(GRADING * t) / np.tanh(GRADING))
        widths.append(w * stretch)
    x, y = places
    kept = [np.r_[1 : degrees[0] + 1], np.arange(degrees[1] + 1)]
    count = len(kept[0]) * len(kept[1])
    held = np.zeros((5, len(kept[0]), len(kept[1])), dtype=bool)
    held[[1, 4], :, 0] = True
    free = np.flatnonzero(~held.ravel())
    plane = np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, (1 - POISSON) / 2]]) / (1 - POISSON**2)
    shear = FACTOR / (2 * (1 + POISSON)) * np.eye(2)
    stiffness = {"membrane": THICKNESS * plane, "bending": THICKNESS**3 / 12 * plane, "shear": THICKNESS * shear}
    rows = {"membrane": slice(0, 3), "bending": slice(3, 6), "shear": slice(6, 8)}
    matrices = {name: np.zeros((len(free), len(free))) for name in rows}
    force = np.zeros((5, count))
    for q, at in enumerate(x):
        f = tables[0][:, q][:, kept[0]]
        pairs = (f[0], tables[1][0]), (f[1], tables[1][0]), (f[0], tables[1][1])
        b = np.stack([np.einsum("i,pj->pij", u, v).reshape(len(y), -1) for u, v in pairs])
        strain, area = _strains(np.full_like(y, at), y, b)
        weights = widths[0][q] * widths[1] * area
        force[2] -= LOAD * (weights @ b[0])
        for name, of in rows.items():
            root = np.linalg.cholesky(stiffness[name]).T
            part = np.einsum("ij,jpcf,p->ipcf", root, strain[of], np.sqrt(weights), optimize=True)
            part = part.reshape(-1, 5 * count)[:, free]
            matrices[name] += part.T @ part
    matrix, right = sum(matrices.values()), force.ravel()[free]
    scale = 1 / np.sqrt(np.diag(matrix))
    scaled = matrix * np.outer(scale, scale)
    inverse = np.linalg.inv(np.linalg.cholesky(scaled))
    answer = inverse.T @ (inverse @ (scale * right))
    answer = scale * (answer + inverse.T @ (inverse @ (scale * right - scaled @ answer)))
    coefficients = np.zeros(5 * count)
    coefficients[free] = answer
    coefficients = coefficients.reshape(5, len(kept[0]), len(kept[1]))

    def displacement(px: float, py: float) -> np.ndarray:
        f, g = (
            functions(
                np.array([2 * (np.arctanh(2 * at * np.tanh(GRADING)) / GRADING - start) / (1 - start) - 1]), degree
            )[0, 0]
            for at, start, degree in zip((px, py), STARTS, degrees, strict=True)
        )
        return np.einsum("cij,i,j->c", coefficients[:3], f[kept[0]], g)

    energy = {name: float(answer @ (of @ answer)) for name, of in matrices.items()}  # both halves
    return {
        "tip_deflection": -float(displacement(0.5, 0.0)[2]),
        "oblique_displacement": float(displacement(*OBLIQUE[0]) @ OBLIQUE[1]),
        "strain_energy": float(right @ answer),
        "membrane_energy": energy["membrane"],
        "bending_energy": energy["bending"] + energy["shear"],
    }


def hypar_naghdi_by_polynomials() -> dict[str, Estimate]:
    """The same by polynomials; the uncertainty is twice the change from lower degrees."""
    return _estimates(*map(_by_polynomials, DEGREES))
