r"""A cantilever strip under a dead end force, bent far: the plane problem of the shell theory, and the elastica.

With x' = lambda (cos phi, sin phi) along the reference length of a strip without Poisson's effect, b_11 = x'' . n =
lambda phi', and the potential energy a unit of width is

    int_0^L 1/2 A eps^2 + 1/2 B (lambda phi')^2 - P lambda sin phi ds,  eps = (lambda^2 - 1) / 2,

A = E h, B = E h^3 / 12, P the force per width. With the moment m = B lambda^2 phi' its stationarity is

    m' = -P lambda cos phi,  phi' = m / (B lambda^2),  A eps lambda + m^2 / (B lambda^3) = P sin phi,

phi(0) = 0, m(L) = 0. `extensible` integrates this from the tip and looks for the angle there that ends level at the
wall. The second form is the inextensible elastica in elliptic integrals (Bisshopp & Drucker 1945): with phi_L the
angle of the tip, k^2 = (1 + sin phi_L) / 2 and sin psi = 1 / (k sqrt 2),

    L sqrt(P / B) = K(k) - F(psi, k),  deflection = L - 2 sqrt(B / P) (E(k) - E(psi, k)),
    shortening = L - sqrt(2 B sin phi_L / P).

The two theories differ by terms of (h phi')^2: up to 4e-5 of the displacement at the largest force of the case.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from .estimate import ROUNDING, Estimate

FINE, COARSE = 1e-13, 1e-10
"""Relative tolerances of the integration along the strip."""
STEEPEST = np.pi / 2 - 1e-6
"""Bound of the tip's angle in its first equilibrium, rad."""
FORCES = 1.0, 2.0, 4.0
SWUNG, SOFT = float(np.radians(20.0)), 1e-14
"""Turn of the wall, rad, and stiffness and force of cases/swung_cantilever.toml, in units of those here."""


@dataclass(frozen=True)
class Cantilever:
    """Length, width and thickness in m and Young's modulus in Pa."""

    length: float = 10.0
    width: float = 1.0
    thickness: float = 0.1
    young: float = 1.2e6

    @property
    def stretching_stiffness(self) -> float:
        """A = E h, N / m."""
        return self.young * self.thickness

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / 12, N m."""
        return self.young * self.thickness**3 / 12.0


@dataclass(frozen=True)
class Bent:
    """Displacement of the tip toward the wall and along the force (m), membrane and bending energy (J)."""

    shortening: float
    deflection: float
    membrane: float
    bending: float


def stretch(strip: Cantilever, moment: float, pull: float) -> float:
    """Root of A (l^2 - 1) l / 2 + m^2 / (B l^3) = pull next to 1, by Newton's method."""
    a, b = strip.stretching_stiffness, strip.bending_stiffness
    value = 1.0
    for _ in range(6):
        defect = a * (value**2 - 1) * value / 2 + moment**2 / (b * value**3) - pull
        value -= defect / (a * (3 * value**2 - 1) / 2 - 3 * moment**2 / (b * value**4))
    return value


def extensible(strip: Cantilever, force: float, tolerance: float = FINE, wall: float = 0.0) -> Bent:
    """Equilibrium of the plane problem under a dead end force (N); the wall is turned toward it by an angle (rad)."""
    load = force / strip.width
    b = strip.bending_stiffness

    def along(_: float, state: np.ndarray) -> list[float]:
        """Derivatives of phi, m, x, z and of both energies from the tip to the wall."""
        phi, moment = state[:2]
        longer = stretch(strip, moment, load * np.sin(phi))
        turning = moment / (b * longer**2)
        membrane = strip.stretching_stiffness * (longer**2 - 1) ** 2 / 8
        x, z = longer * np.cos(phi), longer * np.sin(phi)
        return [-turning, load * x, -x, -z, membrane, b * (longer * turning) ** 2 / 2]

    def to_the_wall(tip: float) -> np.ndarray:
        start = [tip, 0.0, 0.0, 0.0, 0.0, 0.0]
        solution = solve_ivp(along, (0.0, strip.length), start, method="DOP853", rtol=tolerance, atol=tolerance)
        return np.asarray(solution.y[:, -1])

    tip = brentq(lambda angle: to_the_wall(angle)[0] - wall, wall, STEEPEST, xtol=tolerance, rtol=1e-14)
    _, _, x, z, membrane, bending = to_the_wall(tip)
    return Bent(strip.length + x, -z, membrane * strip.width, bending * strip.width)


def inextensible(strip: Cantilever, force: float) -> tuple[float, float]:
    """Shortening and deflection (m) of the elastica under a dead end force (N), in elliptic integrals."""
    b, load = strip.bending_stiffness, force / strip.width
    scale = np.sqrt(b / load)

    def parameters(tip: float) -> tuple[float, float]:
        m = (1 + np.sin(tip)) / 2
        return m, np.arcsin(1 / np.sqrt(2 * m))

    def excess(tip: float) -> float:
        m, psi = parameters(tip)
        return float(scale * (ellipk(m) - ellipkinc(psi, m)) - strip.length)

    tip = brentq(excess, 1e-12, STEEPEST, xtol=1e-15, rtol=1e-14)
    m, psi = parameters(tip)
    deflection = strip.length - 2 * scale * (ellipe(m) - ellipeinc(psi, m))
    return float(strip.length - scale * np.sqrt(2 * np.sin(tip))), float(deflection)


def elastica() -> dict[str, Estimate]:
    """Values of the inextensible elastica; the uncertainty bounds what the stretch changes.

    The strip contracts by (h phi')^2 / 12 and turns by (h phi')^2 / 6 of its angle more.
    """
    strip = Cantilever()
    values = {}
    for force in FORCES:
        shortening, deflection = inextensible(strip, force)
        bend = force / strip.width * (strip.length - shortening) / strip.bending_stiffness
        spread = (strip.thickness * bend) ** 2 / 4 * strip.length
        values[f"shortening_{force:g}"] = Estimate(shortening, spread, "m")
        values[f"deflection_{force:g}"] = Estimate(deflection, spread, "m")
    return values


def cantilever_shear() -> dict[str, Estimate]:
    """Known values of the strip under an end force; the uncertainty is the change from a coarser integration."""
    strip = Cantilever()
    values = {}
    for force in FORCES:
        fine, coarse = (extensible(strip, force, tolerance) for tolerance in (FINE, COARSE))
        for kind in ("shortening", "deflection"):
            near, far = getattr(fine, kind), getattr(coarse, kind)
            values[f"{kind}_{force:g}"] = Estimate.between(near, far, "m", 100 * ROUNDING * strip.length)
    rounding = 100 * ROUNDING * fine.bending
    total = fine.membrane + fine.bending
    return values | {
        "strain_energy": Estimate.between(total, coarse.membrane + coarse.bending, "J", rounding),
        "membrane_energy": Estimate.between(fine.membrane, coarse.membrane, "J", rounding),
        "bending_energy": Estimate.between(fine.bending, coarse.bending, "J", rounding),
    }


def swung_cantilever() -> dict[str, Estimate]:
    """Known values of the soft strip whose wall turns while the force grows; displacements are those of the stiff one."""
    values = {}
    for factor, name in ((0.5, "_50"), (1.0, "")):
        both = [
            extensible(Cantilever(), factor * FORCES[-1], tolerance, factor * SWUNG) for tolerance in (FINE, COARSE)
        ]
        for kind in ("shortening", "deflection"):
            near, far = (getattr(bent, kind) for bent in both)
            values[f"{kind}{name}"] = Estimate.between(near, far, "m", 100 * ROUNDING * Cantilever().length)
    fine, coarse = ((bent.membrane + bent.bending, bent.bending) for bent in both)
    for kind, near, far in zip(("strain", "bending"), fine, coarse, strict=True):
        values[f"{kind}_energy"] = Estimate.between(SOFT * near, SOFT * far, "J", 100 * ROUNDING * SOFT * fine[0])
    return values
