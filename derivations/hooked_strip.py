r"""A strip under a moment at its end and a pressure that follows the part beyond a line: cases/hooked_cantilever.toml.

The equations of equilibrium are those of `spiral`, from the tip to the wall, with the moment at the tip and no pressure between
the line and the wall. The second form is the virtual work of `plane_strip`, in polynomials on either side of the line that are
joined by place and slope. The moment of the wall is that of the loads about it: of the tip's, and of P (-p2, p1) ds at its arm.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.integrate import solve_ivp

from .elastica import COARSE, FINE, Cantilever, stretch
from .estimate import ROUNDING, Estimate
from .plane_strip import PlaneStrip

STRIP = Cantilever(length=4.0, width=0.8, thickness=0.1, young=1.2e6)
LINE = 1.37  # m
PRESSURE, MOMENT = 8.0, -12.0  # N/m^2, and N: positive toward +z
LOADS = {0.5: "50", 1.0: "100"}
COUNTS = 16, 20
STEPS = 4

Array = np.ndarray


def _named(tips: dict[float, tuple[float, float]], energies: tuple[float, float], moment: float) -> dict[str, float]:
    """Values from the tip's displacement along x and z by load factor, energies and the wall's moment about +y."""
    values = {f"tip_{c}_{name}": tips[at][k] for at, name in LOADS.items() for k, c in enumerate("xz")}
    return values | {"strain_energy": sum(energies), "bending_energy": energies[1], "wall_moment": moment}


def _integrated(tolerance: float) -> dict[str, float]:
    b, tips = STRIP.bending_stiffness, {}
    for factor in LOADS:
        state, start = np.concatenate([[0.0, 0.0, factor * MOMENT], np.zeros(5)]), 0.0

        def along(_: float, state: Array, pressure: float) -> list[float]:
            """Derivatives of T, Q, m, phi, x, z and of both energies from the tip to the wall."""
            pull, shear, moment, phi = state[:4]
            longer = stretch(STRIP, moment, pull)
            turning = moment / (b * longer**2)
            membrane = STRIP.stretching_stiffness * (longer**2 - 1) ** 2 / 8
            force = [-shear * turning, pressure * longer + pull * turning, longer * shear]
            place = [-turning, -longer * np.cos(phi), -longer * np.sin(phi)]
            return [*force, *place, membrane, b * (longer * turning) ** 2 / 2]

        for stop, pressure in ((STRIP.length - LINE, factor * PRESSURE), (STRIP.length, 0.0)):
            found = solve_ivp(along, (start, stop), state, "DOP853", args=(pressure,), rtol=tolerance, atol=tolerance)
            state, start = found.y[:, -1], stop
        _, _, moment, phi, x, z, membrane, bending = state
        # The tip is at the origin and level so far. Seen from the wall it is at -(x, z), turned by -phi.
        x, z = -(x * np.cos(phi) + z * np.sin(phi)), x * np.sin(phi) - z * np.cos(phi)
        tips[factor] = x - STRIP.length, z
    # a moment that turns x toward z is about -y, and the wall's is against it
    return _named(tips, (membrane * STRIP.width, bending * STRIP.width), moment * STRIP.width)


def hooked_cantilever() -> dict[str, Estimate]:
    """Known values by the equations of equilibrium; the uncertainty is the change from a coarser integration."""
    fine, coarse = _integrated(FINE), _integrated(COARSE)
    return {
        name: Estimate.between(value, coarse[name], unit(name), 100 * ROUNDING * max(abs(value), 1.0))
        for name, value in fine.items()
    }


def unit(name: str) -> str:
    """Unit of a quantity."""
    return "J" if name.endswith("energy") else "N m" if name.endswith("moment") else "m"


class HookedStrip(PlaneStrip):
    """The strip with a polynomial on either side of the line, joined by place and slope; `count` is of both together."""

    @property
    def _rule(self) -> tuple[Array, Array]:
        x, w = np.polynomial.legendre.leggauss(2 * self.count)
        parts = [
            (LINE * (1 + x) / 2, LINE * w / 2),
            (LINE + (self.length - LINE) * (1 + x) / 2, (self.length - LINE) * w / 2),
        ]
        points, weights = zip(*parts, strict=True)
        return np.concatenate(points), np.concatenate(weights)

    def derivative(self, s: Array, order: int) -> Array:
        """Derivative of the functions of x, then of z, at points: (2, points, count)."""
        # 1. Those that have neither place nor slope at the line, of each part, and are held at the wall.
        # 2. Those that have either there, and go on as rigid motions.
        line, count = Polynomial([-LINE, 1.0]), self.count // 2 - 1
        inner, outer = [0.0, LINE], [LINE, self.length]
        beside = [
            (line**2)(Chebyshev.identity(domain=ends)) * Chebyshev.basis(i, domain=ends)
            for ends in (inner, outer)
            for i in range(count)
        ]
        shares = Polynomial([0.0, 1 / LINE])
        joints = (
            (shares * (2 - shares), Polynomial([0.0, 1.0]) * (shares - 1)),
            (shares**2 * (3 - 2 * shares), shares * Polynomial([0.0, 1.0]) * (shares - 1)),
        )
        rigid = (Polynomial([1.0]), line)
        rows = []
        for power, pair in zip((1, 2), joints, strict=True):
            held = Chebyshev.identity(domain=inner) ** power
            first = [(f * held).deriv(order) for f in beside[:count]] + [f.deriv(order) for f in pair]
            second = [f.deriv(order) for f in (*beside[count:], *rigid)]
            within, after = (np.stack([f(s) + 0 * s for f in part], axis=-1) for part in (first, second))
            at_wall, beyond = (s <= LINE)[:, None], (s > LINE)[:, None]
            rows.append(
                np.concatenate(
                    [
                        np.where(at_wall, within[:, :count], 0.0),
                        np.where(beyond, after[:, :count], 0.0),
                        np.where(beyond, after[:, count:], within[:, count:]),
                    ],
                    axis=-1,
                )
            )
        return np.array(rows)

    def _push(self, coefficients: Array, pressure: float) -> tuple[Array, Array]:
        """Forces of the pressure beyond the line per width, and their derivative, by the coefficients."""
        weight, first, _ = self._gauss
        weight, values = np.where(self._rule[0] > LINE, weight, 0.0), self._values
        p1, p2 = np.einsum("cpi,ci->cp", first, coefficients) + np.array([[1.0], [0.0]])
        force = pressure * np.concatenate([-(weight * p2) @ values[0], (weight * p1) @ values[1]])
        across = pressure * (weight[:, None] * values[0]).T @ first[1]
        along = pressure * (weight[:, None] * values[1]).T @ first[0]
        zero = np.zeros_like(across)
        return force, np.block([[zero, -across], [along, zero]])

    def about_wall(self, coefficients: Array, moment: float, pressure: float) -> float:
        """Moment of the loads about the wall per width, from x toward z, N."""
        weight, first, _ = self._gauss
        s = self._rule[0]
        x, z = np.einsum("cpi,ci->cp", self._values, coefficients) + np.array([s, 0 * s])
        p1, p2 = np.einsum("cpi,ci->cp", first, coefficients) + np.array([[1.0], [0.0]])
        return moment + pressure * float(np.where(s > LINE, weight, 0.0) @ (x * p1 + z * p2))


def _by_polynomials(count: int) -> dict[str, float]:
    strip = HookedStrip(STRIP.length, STRIP.thickness, STRIP.young, count)
    factors = np.arange(1, STEPS + 1) / STEPS
    found = {bent.factor: bent for bent in strip.path(factors, moment=MOMENT, pressure=PRESSURE)}
    bent, width = found[1.0], STRIP.width
    tips = {at: (-found[at].shortening, found[at].deflection) for at in LOADS}
    moment = width * strip.about_wall(bent.coefficients, MOMENT, PRESSURE)
    return _named(tips, (width * bent.membrane, width * bent.bending), moment)


def hooked_cantilever_by_polynomials() -> dict[str, Estimate]:
    """Known values by virtual work; the uncertainty is what fewer polynomials change."""
    coarse, fine = (_by_polynomials(count) for count in COUNTS)
    return {
        name: Estimate.between(value, coarse[name], unit(name), 1e4 * ROUNDING * max(abs(value), 1.0))
        for name, value in fine.items()
    }
