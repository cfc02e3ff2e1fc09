r"""Naghdi's shells of revolution, one angular harmonic, by two ways: equilibrium collocated, and splines of vectors.

Meridian, normal and physical components (u, v, w) are those of `revolution`. The normal changes by psi_1 e_s + psi_2
e_theta. With n,1 = -k1 e_s and n,2 = -k2 e_theta the strains are, a prime for d/ds and a dot for d/dtheta,

    eps_1 = u' - k1 w               eps_2 = v./r + r' u/r - k2 w              2 eps_12 = u./r + v' - r' v/r
    chi_1 = psi_1' - k1 eps_1       chi_2 = psi_2./r + r' psi_1/r - k2 eps_2
    2 chi_12 = psi_1./r + psi_2' - r' psi_2/r - k1 (u./r - r' v/r) - k2 v'
    gamma_1 = w' + k1 u + psi_1     gamma_2 = w./r + k2 v + psi_2

u, w and psi_1 go with cos(n theta), v and psi_2 with sin(n theta). First way: with e = S0 q + S1 q', forces p = r S1 C e
of the section, p' = r S0 C e - r f, ten equations of first order, met at Gauss points of graded cells by polynomials.
Second way: least energy of u = (U, V, W) in the turning frame and psi, the strains products of vectors as in
`naghdi_ritz`, on splines with graded knots.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .hyperboloid import HARMONIC, OBLIQUE, POISSON, YOUNG, curve, pressure
from .revolution import Array, Meridian
from .revolution_splines import turned
from .spline_shell import Splines

FACTOR = 5.0 / 6.0  # of transverse shear
LEVELS = (16, 14), (12, 14)  # cells and degree of collocation, fine and coarse
SPLINES = (100, 9), (80, 9)  # spans and degree
REFINEMENTS = 3


def elasticity(thickness: float) -> Array:
    """Stiffness (8, 8) of membrane, bending and shear."""
    plane = YOUNG / (1 - POISSON**2) * np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, (1 - POISSON) / 2]])
    c = np.zeros((8, 8))
    c[:3, :3], c[3:6, 3:6] = thickness * plane, thickness**3 / 12 * plane
    c[6, 6] = c[7, 7] = FACTOR * YOUNG * thickness / (2 * (1 + POISSON))
    return c


def physical_strains(at: Meridian, n: int) -> tuple[Array, Array]:
    """S0 and S1 (points, 8, 5) of (u, v, w, psi_1, psi_2)."""
    r, dr, k1, k2 = at.radius, at.slope, at.first, at.second
    s0, s1 = np.zeros((2, len(r), 8, 5))
    s1[:, 0, 0], s0[:, 0, 2] = 1.0, -k1
    s0[:, 1, 1], s0[:, 1, 0], s0[:, 1, 2] = n / r, dr / r, -k2
    s0[:, 2, 0], s1[:, 2, 1], s0[:, 2, 1] = -n / r, 1.0, -dr / r
    s1[:, 3, 3] = 1.0
    s0[:, 4, 4], s0[:, 4, 3] = n / r, dr / r
    s0[:, 5, 3], s1[:, 5, 4], s0[:, 5, 4] = -n / r, 1.0, -dr / r
    for s in (s0, s1):
        s[:, 3] -= k1[:, None] * s[:, 0]
        s[:, 4] -= k2[:, None] * s[:, 1]
    s0[:, 5, 0], s0[:, 5, 1] = s0[:, 5, 0] + k1 * n / r, s0[:, 5, 1] + k1 * dr / r
    s1[:, 5, 1] -= k2
    s1[:, 6, 2], s0[:, 6, 0], s0[:, 6, 3] = 1.0, k1, 1.0
    s0[:, 7, 2], s0[:, 7, 1], s0[:, 7, 4] = -n / r, k2, 1.0
    return s0, s1


def graded(cells: int, thickness: float) -> Array:
    """Ends of cells on [0, 1]: denser toward the rim, where the last is as thin as the shell."""
    ratio = thickness ** (1 / (cells - 1))
    return np.concatenate([[0.0], 1 - ratio ** np.arange(1, cells), [1.0]])


def by_collocation(thickness: float, clamped: bool, cells: int, degree: int) -> dict[str, float]:
    """Values of the hyperboloid by the first way."""
    # 1. y' = M y + f at the Gauss points, y = (q, p / (E h)); cells share their ends.
    # 2. Ends: waist symmetric, rim held or free.
    # 3. Energies by the same points.
    ends, size = graded(cells, thickness), YOUNG * thickness
    x, w = np.polynomial.legendre.leggauss(degree)
    table = np.polynomial.legendre.legvander(x, degree)
    slope = np.stack(
        [np.polynomial.legendre.legval(x, np.polynomial.legendre.legder(row)) for row in np.eye(degree + 1)], -1
    )
    half = np.diff(ends) / 2
    t = (ends[:-1, None] + half[:, None] * (1 + x)).ravel()
    at, c, load = Meridian.at(curve, t), elasticity(thickness), pressure(thickness, clamped)
    s0, s1 = physical_strains(at, HARMONIC)
    inverse = np.linalg.inv(np.einsum("pia,ij,pjb->pab", s1, c, s1))
    forces = np.einsum("pia,ij,pjb->pab", s0, c, s1)  # S0 C S1
    r = at.radius[:, None, None]
    first = -inverse @ np.swapaxes(forces, 1, 2)
    matrix = np.block(
        [
            [first, inverse * size / r],
            [r / size * (np.einsum("pia,ij,pjb->pab", s0, c, s0) + forces @ first), -np.swapaxes(first, 1, 2)],
        ]
    )
    matrix *= at.stretch[:, None, None]
    right = np.zeros((len(t), 10))
    right[:, 7] = at.radius * load * at.stretch / size  # p' = ... - r f, f = -load along w
    n = degree + 1
    big, b = np.zeros((10 * cells * n, 10 * cells * n)), np.zeros(10 * cells * n)
    columns = np.arange(10 * cells * n).reshape(cells, 10, n)
    row = 0
    for cell in range(cells):
        for point in range(degree):
            here = cell * degree + point
            for i in range(10):
                big[row, columns[cell, i]] += slope[point] / half[cell]
                big[row, columns[cell].ravel()] -= np.kron(matrix[here, i], table[point])
                b[row] = right[here, i]
                row += 1
        for i in range(10 if cell + 1 < cells else 0):
            big[row, columns[cell, i]], big[row, columns[cell + 1, i]] = 1.0, -((-1.0) ** np.arange(n))
            row += 1
    for i in (0, 3, 6, 7, 9):  # u, psi_1, and the forces on v, w and psi_2
        big[row, columns[0, i]] = (-1.0) ** np.arange(n)
        row += 1
    for i in range(5):
        big[row, columns[-1, i if clamped else 5 + i]] = 1.0
        row += 1
    scale = 1 / np.abs(big).max(axis=1)
    big, b = big * scale[:, None], b * scale
    inverse_of = np.linalg.inv(big)
    y = inverse_of @ b
    for _ in range(REFINEMENTS):
        y += inverse_of @ (b - big @ y)
    coefficients = y.reshape(cells, 10, n)
    values = np.einsum("cik,pk->cpi", coefficients, table).reshape(-1, 10)
    slopes = np.einsum("pab,pb->pa", matrix[:, :5], values) / at.stretch[:, None]
    e = np.einsum("pia,pa->pi", s0, values[:, :5]) + np.einsum("pia,pa->pi", s1, slopes)
    weights = np.pi * (half[:, None] * w).ravel() * at.stretch * at.radius
    membrane, bending = (
        float(np.einsum("p,pi,ij,pj->", weights, e[:, of], c[of, of], e[:, of])) for of in (slice(3), slice(3, 8))
    )

    def amplitudes(z: float) -> Array:
        cell = min(int(np.searchsorted(ends, z, side="right")) - 1, cells - 1)
        local = np.polynomial.legendre.legvander(np.array([(z - ends[cell]) / half[cell] - 1]), degree)[0]
        u, v, w = coefficients[cell, :3] @ local
        here = Meridian.at(curve, np.array([z]))
        along = u * here.tangent[0] + w * here.normal[0]
        return np.array([along[0], v, along[1]])

    return _values(amplitudes(0.0), amplitudes(OBLIQUE[1]), membrane, bending)


def by_splines(thickness: float, clamped: bool, spans: int, degree: int) -> dict[str, float]:
    """Values of the hyperboloid by the second way."""
    splines = Splines(graded(spans, thickness), degree)
    t, weights = (part.ravel() for part in splines.gauss)
    value, slope = splines.matrix(t, 0), splines.matrix(t, 1)
    (r, r_t, r_tt, _), (_, z_t, z_tt, _) = curve(t)
    g, g_t = np.hypot(r_t, z_t), (r_t * r_tt + z_t * z_tt) / np.hypot(r_t, z_t)
    o, count = np.zeros_like(t), value.shape[1]
    a = np.stack([np.stack([r_t, o, z_t]), np.stack([o, r, o])])  # a_1, a_2 (2, 3, points)
    tangent, normal = a[0] / g, np.stack([-z_t, o, r_t]) / g
    tangent_t, normal_t = (
        np.stack([r_tt, o, z_tt]) / g - a[0] * g_t / g**2,
        np.stack([-z_tt, o, r_tt]) / g - normal * g_t / g,
    )
    normals = normal_t, np.stack([o, normal[0], o])  # n,1 and n,2: the frame turns
    u, u_t, d, d_t = np.zeros((4, 2, 3, len(t), 5, count))  # parts with cos and with sin, components
    for component, part in enumerate((0, 1, 0)):
        u[part, component, :, component], u_t[part, component, :, component] = value, slope
    d[0, :, :, 3] = tangent[..., None] * value
    d_t[0, :, :, 3] = tangent[..., None] * slope + tangent_t[..., None] * value
    d[1, 1, :, 4], d_t[1, 1, :, 4] = value, slope
    du, dd = (u_t, turned(u, HARMONIC)), (d_t, turned(d, HARMONIC))

    def dot(vector: Array, field: Array) -> Array:
        return np.einsum("cp,kcpfi->kpfi", vector, field)

    rows = []
    for i, j in ((0, 0), (1, 1), (0, 1)):
        length = np.hypot(*a[i][[0, 2]]) + a[i][1], np.hypot(*a[j][[0, 2]]) + a[j][1]
        scale = ((0.5 if i == j else 1.0) / (length[0] * length[1]))[None, :, None, None]
        rows.append(
            (
                scale * (dot(a[i], du[j]) + dot(a[j], du[i])),
                scale * (dot(a[i], dd[j]) + dot(a[j], dd[i]) + dot(normals[i], du[j]) + dot(normals[j], du[i])),
            )
        )
    shear = [(dot(normal, du[i]) + dot(a[i], d)) / (g, r)[i][None, :, None, None] for i in (0, 1)]
    parts = (0, 0, 1)  # with cos, cos, sin
    strain = np.stack(
        [
            *(rows[k][0][parts[k]] for k in range(3)),
            *(rows[k][1][parts[k]] for k in range(3)),
            shear[0][0],
            shear[1][1],
        ],
        axis=1,
    ).reshape(len(t), 8, -1)
    c, w = elasticity(thickness), np.pi * weights * g * r
    found = []
    for of in (slice(0, 3), slice(3, 8)):
        root = np.linalg.cholesky(c[of, of]).T
        b = (np.sqrt(w)[:, None, None] * (root @ strain[:, of])).reshape(-1, strain.shape[-1])
        found.append(b)
    load = -pressure(thickness, clamped) * np.einsum("p,cp,pi->ci", w, normal, value)
    force = np.zeros((5, count))
    force[[0, 2]] = load[[0, 2]]
    held = {(2, 0), (3, 0), *((field, count - 1) for field in range(5) if clamped)}  # W and psi_1 vanish at the waist
    free = np.array([f * count + i for f in range(5) for i in range(count) if (f, i) not in held])
    roots = np.concatenate(found)[:, free]
    scale = 1 / np.linalg.norm(roots, axis=0)
    roots, right = roots * scale, force.ravel()[free] * scale
    factor = cho_factor(roots.T @ roots)
    y = cho_solve(factor, right)
    for _ in range(REFINEMENTS):
        y += cho_solve(factor, right - roots.T @ (roots @ y))
    q = np.zeros(5 * count)
    q[free] = scale * y
    membrane, bending = (float(np.sum((b @ q) ** 2)) for b in found)
    at = splines.matrix(np.array([0.0, OBLIQUE[1]]), 0) @ q.reshape(5, count)[:3].T
    return _values(at[0], at[1], membrane, bending)


def _values(waist: Array, oblique: Array, membrane: float, bending: float) -> dict[str, float]:
    theta, _, direction = OBLIQUE
    phase = np.array([np.cos(HARMONIC * theta), np.sin(HARMONIC * theta), np.cos(HARMONIC * theta)])
    u_r, u_t, u_z = oblique * phase
    cos, sin = np.cos(theta), np.sin(theta)
    moved = np.array([cos * u_r - sin * u_t, sin * u_r + cos * u_t, u_z])
    return {
        "waist_displacement": float(waist[0]),
        "oblique_displacement": float(direction @ moved),
        "strain_energy": membrane + bending,
        "membrane_energy": membrane,
        "bending_energy": bending,
    }
