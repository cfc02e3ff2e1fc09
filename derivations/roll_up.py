r"""A strip under an end moment, in closed form: it rolls up into a circle, and contracts a little.

A strip without Poisson's effect whose normal turns at the rate theta' along the reference length and whose
midline is stretched by lambda stores, a unit of length and width,

    W = 1/2 E h eps^2 + 1/2 B lambda^2 theta'^2,  eps = (lambda^2 - 1) / 2,  B = E h^3 / 12,

because b_11 = x'' . n = lambda theta'. The moment is conjugate to theta, M = B lambda^2 theta', and nothing holds the
length: E h eps + B theta'^2 = 0, so eps = -(h theta')^2 / 12. Both together are a cubic for theta',
B (1 - (h theta')^2 / 6) theta' = M. The strip is an arc of length lambda L that turns by theta' L:

    shortening = L - lambda sin(theta' L) / theta',  deflection = lambda (1 - cos(theta' L)) / theta'.

The second form is the inextensible circle, lambda = 1 and theta' = M / B; it differs by terms of (h theta')^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .estimate import Estimate

MARKS = {0.25: "25", 0.5: "50", 0.75: "75", 1.0: "100"}
PAST_HALF = 0.625  # of the moment: the tip has turned by more than half a turn


@dataclass(frozen=True)
class Strip:
    """Length, width and thickness in m, Young's modulus in Pa, and the end moment in N m per width at full load."""

    length: float = 12.0
    width: float = 0.5
    thickness: float = 0.1
    young: float = 1.2e6
    moment: float = 50.0 * np.pi / 3.0

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / 12 of a strip without Poisson's effect, N m."""
        return self.young * self.thickness**3 / 12.0


@dataclass(frozen=True)
class Arc:
    """Stretch, turning of the normal per reference length (1/m) and the reference length (m)."""

    stretch: float
    turning: float
    length: float

    @property
    def shortening(self) -> float:
        """Displacement of the tip toward the wall, m."""
        return float(self.length - self.stretch * np.sin(self.turning * self.length) / self.turning)

    @property
    def deflection(self) -> float:
        """Displacement of the tip across the strip, m."""
        # 1 - cos without cancellation near a full turn
        return float(2.0 * self.stretch * np.sin(self.turning * self.length / 2.0) ** 2 / self.turning)


def rolled_strip(strip: Strip, factor: float) -> Arc:
    """Equilibrium under a fraction of the moment: the root of the cubic that starts at rest."""
    moment = factor * strip.moment / strip.bending_stiffness
    roots = np.roots([-(strip.thickness**2) / 6.0, 0.0, 1.0, -moment])
    turning = min(r.real for r in roots if abs(r.imag) < 1e-9 * abs(r) and r.real > 0)
    for _ in range(3):  # the companion matrix leaves rounding that is far above the root's own
        defect = turning - strip.thickness**2 * turning**3 / 6.0 - moment
        turning -= defect / (1.0 - strip.thickness**2 * turning**2 / 2.0)
    stretch = np.sqrt(1.0 - (strip.thickness * turning) ** 2 / 6.0)
    return Arc(float(stretch), float(turning), strip.length)


def circle(strip: Strip, factor: float) -> Arc:
    """The inextensible elastica under a fraction of the moment."""
    return Arc(1.0, factor * strip.moment / strip.bending_stiffness, strip.length)


def energies(strip: Strip, arc: Arc) -> tuple[float, float]:
    """Membrane and bending energy, J."""
    area = strip.length * strip.width
    strain = (arc.stretch**2 - 1.0) / 2.0
    membrane = 0.5 * strip.young * strip.thickness * strain**2 * area
    return membrane, 0.5 * strip.bending_stiffness * (arc.stretch * arc.turning) ** 2 * area


def potential(strip: Strip, arc: Arc, turned: float = 0.0, factor: float = 1.0) -> float:
    """Potential energy under a fraction of the moment, J: it works on the angle of the tip; `turned`, rad: its wall's part."""
    work = factor * strip.moment * strip.width * (arc.turning * arc.length + turned)
    return sum(energies(strip, arc)) - work


def inextensible_circle() -> dict[str, Estimate]:
    """Values of the inextensible circle; the uncertainty bounds what the stretch changes.

    The strip contracts by (h theta')^2 / 12 and turns by (h theta')^2 / 6 of its angle more.
    """
    strip = Strip()
    values = {}
    for factor, name in MARKS.items():
        arc = circle(strip, factor)
        spread = (strip.thickness * arc.turning) ** 2 / 4 * strip.length
        values[f"shortening_{name}"] = Estimate(arc.shortening, spread, "m")
        if factor < 1.0:
            values[f"deflection_{name}"] = Estimate(arc.deflection, spread, "m")
    return values


def cantilever_moment() -> dict[str, Estimate]:
    """Known values of the strip under an end moment, of which half the width is modelled."""
    strip = Strip()
    values = {}
    for factor, name in MARKS.items():
        arc = rolled_strip(strip, factor)
        values[f"shortening_{name}"] = Estimate.exact(arc.shortening, "m")
        if factor < 1.0:
            values[f"deflection_{name}"] = Estimate.exact(arc.deflection, "m")
    arc = rolled_strip(strip, 1.0)
    membrane, bending = energies(strip, arc)
    past_half = rolled_strip(strip, PAST_HALF)
    return values | {
        "strain_energy": Estimate.exact(membrane + bending, "J"),
        "membrane_energy": Estimate.exact(membrane, "J"),
        "bending_energy": Estimate.exact(bending, "J"),
        "potential_energy_63": Estimate.exact(potential(strip, past_half, factor=PAST_HALF), "J"),
        "potential_energy": Estimate.exact(potential(strip, arc), "J"),
    }
