r"""Resultants of curved shells: the roof by series along its axis, and a prescribed displacement of a paraboloid.

Both give (n, 8) at points (n, 2) of the case: n_11, n_22, n_12, m_11, m_22, m_12, q_1, q_2 in the orthonormal frame of the
shell (see `resultants`).

- Roof: each harmonic's strains S[0] q + S[1] q' + S[2] q'' (see `cylinder`) give forces and moments. Shear forces are
  Q_t = M_t,t / R + M_xt,x and Q_x = M_x,x + M_xt,t / R. The amplitudes q are Legendre polynomials (`levy_roof`) or exact
  exponentials (`exponentials`).
- Paraboloid: stresses of the prescribed displacement as Taylor series (`manufactured`), q^a = m^ab|_b with Christoffel's
  symbols. The second form varies the metric and the curvature of the surface x + i e u by a complex step, and takes
  q^a = a^a . (J m^bc x,c),b / J, the divergence of vectors in space, in which there are none. Slopes there are those of
  polynomials through Chebyshev points.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev, legendre

from shellbench.problems.shell.case import Case

from .cylinder import strains_of_axial_harmonic
from .exponentials import roof_harmonic
from .levy_roof import HALF_ANGLE, LOAD, roof, solve_roof
from .manufactured import PAIRS, _state, exact_formulas

Array = np.ndarray
Fields = Callable[[Array], Array]

CROWN = np.pi / 2
"""xi1 of the roof's crown, from which `levy_roof` counts its angle on either side."""
STEP = 1e-30
"""Of the complex step."""
NODES, HALF_LINE = 15, 0.1
"""Chebyshev points of a line along which moments are differentiated, and half its length."""


def of_roof(last_harmonic: int, degree: int) -> Fields:
    """Resultants of the roof by Legendre polynomials."""
    series = solve_roof(roof(), last_harmonic, degree)
    nodes, _ = legendre.leggauss(degree + 1)
    half = HALF_ANGLE / 2
    _, slopes, second = series.strip.basis((nodes + 1) * half)
    second[:, :2] = 0.0  # of U and V, for which the strip has none
    tables = np.stack([slopes, second]).reshape(2, degree + 1, -1)
    further = legendre.legder(np.linalg.solve(legendre.legvander(nodes, degree), tables), axis=1)

    def amplitudes(t: float) -> Array:
        basis = series.strip.basis(np.array([t]))[:, 0]
        once, twice = (legendre.legval(t / half - 1, table).reshape(basis.shape[1:]) / half for table in further)
        basis[2, :2] = once[:2]
        return np.einsum("kcj,mj->kmc", np.concatenate([basis, twice[None]]), series.coefficients)

    return _roof_fields(series.harmonics, amplitudes)


def of_roof_by_exponentials(last_harmonic: int) -> Fields:
    """Resultants of the roof by exact exponentials."""
    shell = roof()
    harmonics = np.arange(1, last_harmonic + 1, 2)
    sums = []
    for m in harmonics:
        strains = strains_of_axial_harmonic(shell.radius, m * np.pi / shell.length)
        sums.append(roof_harmonic(strains, sum(shell.elasticity()), HALF_ANGLE, 4 * LOAD / (m * np.pi)))
    return _roof_fields(harmonics, lambda t: np.array([[s.at(t, k) for s in sums] for k in range(4)]))


def _roof_fields(harmonics: Array, amplitudes: Callable[[float], Array]) -> Fields:
    """Resultants from the amplitudes and three derivatives of them (4, m, 3), as functions of the angle."""
    shell = roof()
    alpha = harmonics * np.pi / shell.length
    matrices = np.array([strains_of_axial_harmonic(shell.radius, a) for a in alpha])  # (m, 3, 6, 3)
    elasticity = sum(shell.elasticity())

    def at(point: Array) -> Array:
        t, x = point[0] - CROWN, point[1]
        q = amplitudes(abs(float(t)))
        stress, slope = (np.einsum("ef,mkfc,kmc->me", elasticity, matrices, q[k : k + 3]) for k in (0, 1))
        # along the axis rows go with the sine, those of shear with the cosine
        sine, cosine = np.sin(alpha * x), np.cos(alpha * x)
        n_x, n_t, _, m_x, m_t, _ = sine @ stress
        n_xt, m_xt = cosine @ stress[:, 2], cosine @ stress[:, 5]
        q_t = sine @ slope[:, 4] / shell.radius - (alpha * sine) @ stress[:, 5]
        q_x = (alpha * cosine) @ stress[:, 3] + cosine @ slope[:, 5] / shell.radius
        side = 1.0 if t >= 0 else -1.0  # the angle grows with xi1 on one side of the crown only
        return np.array([n_t, n_x, side * n_xt, m_t, m_x, side * m_xt, side * q_t, q_x])

    return lambda points: np.array([at(point) for point in points])


def of_prescribed(case: Case) -> Fields:
    """Resultants of the displacement that a case prescribes, by covariant derivatives."""

    def fields(points: Array) -> Array:
        state = _state(case, points)
        forces, moments = ({pair: t.value for pair, t in stress.items()} for stress in state.stresses)
        tangents = np.stack([[c.value + 0 * points[:, 0] for c in a] for a in state.tangents])  # (2, 3, n)
        normal = np.stack([c.value for c in state.normal])
        gamma = {key: t.value for key, t in state.christoffel.items()}

        def slope(a: int, b: int) -> Array:
            return np.asarray(state.stresses[1][min(a, b), max(a, b)].terms[(1, 0) if b == 0 else (0, 1)])

        def moment(a: int, b: int) -> Array:
            return np.asarray(moments[min(a, b), max(a, b)])

        def symbol(a: int, b: int, c: int) -> Array:
            return np.asarray(gamma[a, (min(b, c), max(b, c))])

        shear = [
            sum(slope(a, b) for b in (0, 1))
            + sum(symbol(a, b, c) * moment(c, b) + symbol(b, b, c) * moment(a, c) for b in (0, 1) for c in (0, 1))
            for a in (0, 1)
        ]
        return _in_frame(
            tangents, normal, np.array([forces[p] for p in PAIRS]), np.array([moments[p] for p in PAIRS]), shear
        )

    return fields


def of_prescribed_by_varied_metric(case: Case) -> Fields:
    """The same by a complex step of metric and curvature, and by divergences of vectors in space."""

    def stresses(points: Array) -> tuple[Array, Array, Array, Array]:
        """Tangents (n, 2, 3), J (n,), and n^ab and m^ab (n, 2, 2)."""
        x = case.surface.derivatives(points, 2)
        u = case.evaluate(exact_formulas(case), points, order=2)
        moved = {key: x[key] + 1j * STEP * u[key] for key in x}
        tangents = np.stack([moved[1, 0], moved[0, 1]], axis=1)
        second = np.stack([moved[2, 0], moved[1, 1], moved[1, 1], moved[0, 2]], axis=1).reshape(-1, 2, 2, 3)
        metric = np.einsum("nac,nbc->nab", tangents, tangents)
        normal = np.cross(tangents[:, 0], tangents[:, 1])
        area = np.sqrt(np.sum(normal**2, axis=-1))
        curvature = np.einsum("nabc,nc->nab", second, normal / area[:, None])
        inverse = np.linalg.inv(metric.real)
        material, nu = case.material, case.material.poissons_ratio
        stretching = material.youngs_modulus * material.thickness / (1 - nu**2)
        found = []
        for strain, factor in (
            (metric.imag / 2, stretching),
            (-curvature.imag, stretching * material.thickness**2 / 12),
        ):
            raised = inverse @ (strain / STEP) @ inverse
            trace = np.einsum("nab,nab->n", inverse, strain / STEP)
            found.append(factor * (nu * trace[:, None, None] * inverse + (1 - nu) * raised))
        return tangents.real, area.real, found[0], found[1]

    def fields(points: Array) -> Array:
        tangents, area, forces, moments = stresses(points)
        dual = np.linalg.inv(np.einsum("nac,nbc->nab", tangents, tangents)) @ tangents
        divergence = np.zeros((len(points), 3))
        nodes = HALF_LINE * chebyshev.chebpts1(NODES)
        rates = np.array([chebyshev.chebval(0.0, chebyshev.chebder(c)) for c in np.eye(NODES)])
        row = rates @ np.linalg.inv(chebyshev.chebvander(nodes / HALF_LINE, NODES - 1)) / HALF_LINE
        for b in (0, 1):
            along = np.repeat(points[:, None], NODES, axis=1)
            along[:, :, b] += nodes
            there, size, _, m = stresses(along.reshape(-1, 2))
            vectors = size[:, None] * np.einsum("nc,nci->ni", m[:, b], there)
            divergence += np.einsum("k,nki->ni", row, vectors.reshape(len(points), NODES, 3))
        shear = np.einsum("nai,ni->an", dual, divergence / area[:, None])
        normal = np.cross(tangents[:, 0], tangents[:, 1]) / area[:, None]
        pairs = [np.array([t[:, a, b] for a, b in PAIRS]) for t in (forces, moments)]
        return _in_frame(np.moveaxis(tangents, 0, -1), normal.T, *pairs, list(shear))

    return fields


def _in_frame(tangents: Array, normal: Array, forces: Array, moments: Array, shear: list[Array]) -> Array:
    """Resultants (n, 8) from components 11, 22, 12 (3, n) along tangents (2, 3, n)."""
    first = tangents[0] / np.linalg.norm(tangents[0], axis=0)
    frame = np.stack([first, np.cross(normal, first, axis=0)])
    parts = np.einsum("acn,icn->ain", tangents, frame)
    rows = []
    for tensor in (forces, moments):
        full = tensor[[[0, 2], [2, 1]]]
        turned = np.einsum("abn,ain,bjn->ijn", full, parts, parts)
        rows += [turned[0, 0], turned[1, 1], turned[0, 1]]
    return np.stack([*rows, *np.einsum("an,ain->in", np.array(shear), parts)], axis=-1)
