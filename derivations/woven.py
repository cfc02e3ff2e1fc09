r"""Orthotropic shells: plates, an off-axis swatch, a tube and strips, in closed form or by equations of equilibrium.

The strain energy an area is 1/2 (A e . e + D k . k), of e = (e11, e22, 2 e12) and k = (k11, k22, 2 k12) along the axes of
the material. One layer has A = h Q, D = h^3 Q / 12, Q11 = E1 / (1 - nu12 nu21), Q22 = E2 / (1 - nu12 nu21),
Q12 = nu12 Q22, Q66 = G12, nu21 = nu12 E2 / E1.

**Supported plate**, its axes along the sides. With w = sum w_mn sin(m pi x / a) sin(n pi y / b) the energy is a sum of squares:

    U = a b / 8 sum S_mn w_mn^2,  S_mn = pi^4 (D11 (m/a)^4 + 2 (D12 + 2 D66) (m/a)^2 (n/b)^2 + D22 (n/b)^4).

So w_mn = 16 q / (pi^2 m n S_mn) for odd m and n, rho omega^2 = S_mn, and a compression N along x is S_mn / (m pi / a)^2.

**Swatch.** The compliances of the layer, 1/E1, 1/E2, -nu12/E1, 1/G12, turned by the angle of the stress.

**Tube.** u = w e_r + e y e_y without axial force, and with slopes held at the rims: with 1 around and 2 along, e = -A12 / A22 w / R,
and the energy (A11 - A12^2 / A22) (w/R)^2 / 2 + D11 (w/R^2)^2 / 2 - p w is least. The change of curvature w / R^2 is that
of bbar - b, also of a uniform growth.

**Heavy cantilever.** Without A12 and D12 a strip is `heavy_strip` with its own stretching and bending stiffness.

**Bias strip.** No closed form: polynomials in x and y, with D turned by multiples of the angle.

Cloth that stiffens is in `stiffening`. The second forms are in `woven_by_splines`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from .cusick_by_splines import cusick_drape
from .elastica import COARSE, Cantilever
from .estimate import ROUNDING, Estimate
from .heavy_strip import FINE, hung
from .stiffening import JUDGES as STIFFENING

Array = np.ndarray
Four = tuple[float, float, float, float]

WOOD = 1.2e10, 8e8, 0.35, 6e8, 0.01
"""E1, E2 in Pa, nu12, G12 in Pa, h in m."""
PLIES: Four = (700.0, 25.0, 150.0, 45.0)
"""D11, D12, D22, D66 of cases/woven_plate_modes.toml, N m."""
SIDES, LOAD, DENSITY, PRESSED = (1.5, 1.0), 200.0, 15.0, 1e4
POINTS = (0.75, 0.5), (0.3, 0.2), (1.1, 0.65)
FORCES = np.array([1e4, -2000.0, 500.0])
"""N11, N22, N12 of the swatch, N/m."""
ANGLE = np.radians(30.0)
TUBE = {
    "radius": 0.4,
    "length": 1.0,
    "pressure": 2000.0,
    "membrane": (2e5, 3e4, 8e4, 1e4),
    "bending": (60.0, 5.0, 20.0, 8.0),
}
TUBE_POINTS = (0.7, 70.0, (1.0, 2.0, -2.0)), (0.1, 335.0, (3.0, 0.0, 4.0))
"""y, xi2 in degrees, and the direction in which the displacement is asked."""
CLOTH = {"warp": (1.2e4, 1e-3, (4, 40)), "weft": (6e3, 4e-4, (10, 100))}
"""A and D along a strip, N/m and N m, and q L^3 / D."""
BIAS: Four = (1e-3, 1e-4, 4e-4, 1e-4)
STRIP, STRIP_LOAD = (1.0, 0.25), 1e-3
STRIP_POINTS = {"tip_deflection": (1.0, 0.125), "right_deflection": (1.0, 0.0), "left_deflection": (1.0, 0.25)}
TERMS, DEGREES = 400, ((48, 32), (64, 40))


def layer(young: float, other: float, poisson: float, shear: float, thickness: float) -> Four:
    """Return D11, D12, D22 and D66 of one layer, N m."""
    share = 1 - poisson**2 * other / young
    cube = thickness**3 / 12
    return cube * young / share, cube * poisson * other / share, cube * other / share, cube * shear


def across(bending: Four) -> Four:
    """Return the stiffnesses of a plate whose axes are exchanged."""
    first, coupled, second, shear = bending
    return second, coupled, first, shear


def waves(bending: Four, m: Array, n: Array) -> Array:
    """Return S_mn, N/m^3."""
    first, coupled, second, shear = bending
    x, y = (m / SIDES[0]) ** 2, (n / SIDES[1]) ** 2
    return np.asarray(np.pi**4 * (first * x**2 + 2 * (coupled + 2 * shear) * x * y + second * y**2))


def navier(bending: Four, terms: int) -> Array:
    """Return the deflections at `POINTS`, m, and the strain energy, J, with so many odd waves a side."""
    odd = np.arange(1, 2 * terms, 2, dtype=float)
    m, n = np.meshgrid(odd, odd, indexing="ij")
    heights = 16 * LOAD / (np.pi**2 * m * n * waves(bending, m, n))
    at = [np.sin(odd * np.pi * x / SIDES[0]) @ heights @ np.sin(odd * np.pi * y / SIDES[1]) for x, y in POINTS]
    work = LOAD / 2 * SIDES[0] * SIDES[1] * 4 / np.pi**2 * np.sum(heights / (m * n))
    return np.array([*at, work])


def of_plate(fine: Array, coarse: Array, rounding: float) -> dict[str, Estimate]:
    """Known values of cases/woven_plate.toml from deflections and energy; -2/3 of [1, 2, -2] is vertical."""
    both = [(values[0], (values[1] + values[2]) / 3, values[3]) for values in (fine, coarse)]
    names = ("centre_deflection", "m"), ("mean_oblique", "m"), ("strain_energy", "J")
    found = {
        name: Estimate.between(a, b, unit, rounding * abs(a)) for (name, unit), a, b in zip(names, *both, strict=True)
    }
    return found | {"bending_energy": found["strain_energy"]}


def woven_plate() -> dict[str, Estimate]:
    """Known values of cases/woven_plate.toml by Navier's double series."""
    bending = across(layer(*WOOD))
    return of_plate(navier(bending, TERMS), navier(bending, TERMS // 2), 10 * ROUNDING)


def numbered(name: str, unit: str, values: Array) -> dict[str, Estimate]:
    """Return closed forms by their number."""
    return {f"{name}_{k}": Estimate.exact(value, unit) for k, value in enumerate(values, 1)}


def woven_plate_modes() -> dict[str, Estimate]:
    """Known values of cases/woven_plate_modes.toml: products of sines."""
    squares = waves(PLIES, *np.meshgrid(np.arange(1, 30), np.arange(1, 30))) / DENSITY
    return numbered("frequency", "Hz", np.sqrt(np.sort(squares.ravel())[:6]) / (2 * np.pi))


def woven_plate_buckling() -> dict[str, Estimate]:
    """Known values of cases/woven_plate_buckling.toml: products of sines."""
    m, n = np.meshgrid(np.arange(1, 30), np.arange(1, 30))
    loads = waves(across(layer(*WOOD)), m, n) / (m * np.pi / SIDES[0]) ** 2
    return numbered("load_factor", "", np.sort(loads.ravel())[:3] / PRESSED)


def woven_swatch() -> dict[str, Estimate]:
    """Known values of cases/woven_swatch.toml: compliances in the axes of the material, stresses and strains turned."""
    young, other, poisson, shear, thickness = WOOD
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    x, y, xy = FORCES / thickness
    first, second = c * c * x + s * s * y + 2 * c * s * xy, s * s * x + c * c * y - 2 * c * s * xy
    turned = c * s * (y - x) + (c * c - s * s) * xy
    along = first / young - poisson / young * second
    aside, slide = second / other - poisson / young * first, turned / shear
    strain = np.array(
        [
            c * c * along + s * s * aside - c * s * slide,
            s * s * along + c * c * aside + c * s * slide,
            2 * c * s * (along - aside) + (c * c - s * s) * slide,
        ]
    )
    return of_swatch(strain, thickness * np.array([first, second]))


def of_swatch(strain: Array, forces: Array) -> dict[str, Estimate]:
    """Known values of cases/woven_swatch.toml from e11, e22 and 2 e12, and from the forces along the material's axes."""
    moved = {"stretch": strain[0] / 2, "contraction": -strain[1] / 2, "shear": strain[2] / 4}
    energy = Estimate.exact(float(FORCES @ strain) / 2, "J")
    return {name: Estimate.exact(value, "m") for name, value in moved.items()} | {
        "warp_force": Estimate.exact(forces[0], "N/m"),
        "weft_force": Estimate.exact(forces[1], "N/m"),
        "strain_energy": energy,
        "membrane_energy": energy,
    }


def woven_tube() -> dict[str, Estimate]:
    """Known values of cases/woven_tube.toml."""
    a, d, radius = TUBE["membrane"], TUBE["bending"], TUBE["radius"]
    growth = TUBE["pressure"] / ((a[0] - a[1] ** 2 / a[2]) / radius**2 + d[0] / radius**4)
    return of_tube(growth, -a[1] / a[2] * growth / radius, ROUNDING)


def of_tube(growth: float, longer: float, rounding: float) -> dict[str, Estimate]:
    """Known values of cases/woven_tube.toml from the growth of the radius, m, and the axial strain."""
    a, d, radius, length = TUBE["membrane"], TUBE["bending"], TUBE["radius"], TUBE["length"]
    around, area = growth / radius, 2 * np.pi * radius * length
    moved = []
    for y, degrees, direction in TUBE_POINTS:
        xi = np.radians(degrees)
        angle = xi + 0.1 * np.sin(xi)
        u = np.array([growth * np.cos(angle), longer * (y - length / 2), growth * np.sin(angle)])
        moved.append(u @ direction / np.linalg.norm(direction))
    membrane = area / 2 * (a[0] * around**2 + 2 * a[1] * around * longer + a[2] * longer**2)
    bending = area / 2 * d[0] * (growth / radius**2) ** 2
    found = {
        "mean_oblique": (np.mean(moved), "m"),
        "largest_displacement": (np.hypot(growth, longer * length / 2), "m"),
        "strain_energy": (membrane + bending, "J"),
        "membrane_energy": (membrane, "J"),
        "bending_energy": (bending, "J"),
    }
    return {name: Estimate(float(value), rounding * abs(value), unit) for name, (value, unit) in found.items()}


def strip(way: str) -> Cantilever:
    """Return the isotropic strip without lateral contraction that has the stiffnesses along a way of the cloth."""
    stretching, bending, _ = CLOTH[way]
    thickness = (12 * bending / stretching) ** 0.5
    return Cantilever(length=1.0, width=0.025, thickness=thickness, young=stretching / thickness)


def woven_cantilever(way: str) -> dict[str, Estimate]:
    """Known values of cases/woven_cantilever_*.toml: equilibrium, integrated from the tip."""
    own, values = strip(way), {}
    for gamma in CLOTH[way][2]:
        fine, coarse = (hung(own, gamma, tolerance) for tolerance in (FINE, COARSE))
        values[f"drop_{gamma}"] = Estimate.between(fine.drop, coarse.drop, "m", 100 * ROUNDING)
        values[f"shortening_{gamma}"] = Estimate.between(1 - fine.reach, 1 - coarse.reach, "m", 100 * ROUNDING)
    return values


def turned(stiffness: Four, angle: float) -> Array:
    """Return a matrix (3, 3) on 11, 22 and twice 12 in axes from which the material's are turned by an angle."""
    # Four invariants, and cosines and sines of twice and four times the angle (Tsai and Pagano).
    q11, q12, q22, q66 = stiffness
    u1, u2 = (3 * q11 + 3 * q22 + 2 * q12 + 4 * q66) / 8, (q11 - q22) / 2
    u3, u4 = (q11 + q22 - 2 * q12 - 4 * q66) / 8, (q11 + q22 + 6 * q12 - 4 * q66) / 8
    c2, c4, s2, s4 = np.cos(2 * angle), np.cos(4 * angle), np.sin(2 * angle), np.sin(4 * angle)
    u5 = (u1 - u4) / 2
    q16, q26 = u2 * s2 / 2 + u3 * s4, u2 * s2 / 2 - u3 * s4
    coupled = u4 - u3 * c4
    return np.array(
        [[u1 + u2 * c2 + u3 * c4, coupled, q16], [coupled, u1 - u2 * c2 + u3 * c4, q26], [q16, q26, u5 - u3 * c4]]
    )


def polynomials(count: tuple[int, int]) -> Array:
    """Return deflections at `STRIP_POINTS`, m, and the energy, J, with so many polynomials along and across."""
    lines, rules = [], []
    for size, number, zeros in zip(STRIP, count, (2, 0), strict=True):
        x, w = np.polynomial.legendre.leggauss(number + 4)
        lines.append(partial(_derivatives, size, number, zeros))
        rules.append((size * (1 + x) / 2, size * w / 2))
    (x, wx), (y, wy) = rules
    along, aside = lines[0](x), lines[1](y)
    hessian = (2, 0), (0, 2), (1, 1)
    matrix = turned(BIAS, ANGLE) * np.outer([1, 1, 2], [1, 1, 2])
    stiffness = sum(
        matrix[i, j] * np.kron((along[a].T * wx) @ along[c], (aside[b].T * wy) @ aside[d])
        for i, (a, b) in enumerate(hessian)
        for j, (c, d) in enumerate(hessian)
    )
    load = STRIP_LOAD * np.kron(along[0].T @ wx, aside[0].T @ wy)
    found = np.linalg.solve(np.asarray(stiffness), load)
    at = [np.kron(lines[0](np.array([p]))[0], lines[1](np.array([q]))[0])[0] @ found for p, q in STRIP_POINTS.values()]
    return np.array([*at, load @ found / 2])


def _derivatives(size: float, number: int, zeros: int, at: Array) -> list[Array]:
    """Return values and two derivatives (points, number) of polynomials with zeros at the beginning."""
    series = np.polynomial.Legendre
    factor = series([0.5, 0.5], domain=[0, size]) ** zeros
    basis = [factor * series.basis(k, domain=[0, size]) for k in range(number)]
    return [np.stack([(b.deriv(order) if order else b)(at) for b in basis], axis=1) for order in range(3)]


def of_bias_strip(fine: Array, coarse: Array, rounding: float) -> dict[str, Estimate]:
    """Known values of cases/woven_bias_strip.toml from deflections and energy."""
    names = [*((name, "m") for name in STRIP_POINTS), ("strain_energy", "J")]
    return {
        name: Estimate.between(a, b, unit, rounding * abs(a))
        for (name, unit), a, b in zip(names, fine, coarse, strict=True)
    }


def woven_bias_strip() -> dict[str, Estimate]:
    """Known values of cases/woven_bias_strip.toml by polynomials; the uncertainty is the change from fewer ones."""
    coarse, fine = (polynomials(count) for count in DEGREES)
    return of_bias_strip(fine, coarse, 1e-10)


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "woven_plate": woven_plate,
    "woven_plate_modes": woven_plate_modes,
    "woven_plate_buckling": woven_plate_buckling,
    "woven_swatch": woven_swatch,
    "woven_tube": woven_tube,
    "woven_cantilever_warp": partial(woven_cantilever, "warp"),
    "woven_cantilever_weft": partial(woven_cantilever, "weft"),
    "woven_bias_strip": woven_bias_strip,
    **STIFFENING,
    "cusick_drape": cusick_drape,
}
