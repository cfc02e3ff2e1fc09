"""Why the published functional of motion has no motion by Newton's law: the derivation, as the report tells it.

Kairanda et al., eq. (35), add the kinetic energy to the potential energy and minimise the sum over time: the inertia
has the wrong sign.
"""

from __future__ import annotations

from shellbench.report.evidence import Formula

TITLE = "Newton’s law and the published functional"

DERIVATION: tuple[str, ...] = (
    (
        "Cloth moves by Newton’s law: areal density times acceleration is the load less the force of the strains. With"
        " the displacement u(ξ, t), the strain energy E(u) and the load f, from rest:"
    ),
    Formula("ρ ü = f − ∂E/∂u,   u(0) = 0,   u̇(0) = 0."),
    (
        "The published loss (Kairanda et al., eq. (35)) is the mean over space and time of potential energy plus"
        " kinetic energy, and training makes it as small as it can:"
    ),
    Formula("I[u] = ∫₀ᵀ ( E(u) − f·u + ½ ρ |u̇|² ) dt,   u(0) = 0."),
    (
        "(The integral over the surface is left out of the notation.) Vary u by δu with δu(0) = 0 and integrate the"
        " last term by parts:"
    ),
    Formula("δI = ∫₀ᵀ ( ∂E/∂u − f − ρ ü ) · δu dt + ρ u̇(T)·δu(T)."),
    "Nothing is prescribed at the final time T, so that I is stationary only where",
    Formula("ρ ü = ∂E/∂u − f   and   u̇(T) = 0."),
    (
        "The right-hand side is Newton’s with the opposite sign: as if the mass were negative, and with a condition at"
        " the end of time in place of rest at its beginning. The functional of mechanics has the difference,"
        " ½ ρ |u̇|² − E(u) + f·u (Hamilton’s principle), and is stationary at the motion, not minimal: no loss that is"
        " only made smaller finds it. Step by step in time a minimum does exist: what an implicit time integrator"
        " solves is the minimum of E(u) − f·u + (a positive factor) |u − predicted u|², an incremental potential."
    ),
    "Free fall. Nothing holds the napkin and nothing strains it: E = 0, f = ρ g, and the sum is stationary at",
    Formula("ü = −g,   u̇(T) = 0,   u = g (T t − t²/2)   in place of   u = g t²/2."),
    (
        "So it starts at full speed and comes to rest at T, where the two meet. At T/2 it has fallen"
        " (T²/2 − T²/8)/(T²/8) = 3.00 times as far as it should. The published field, u = F(ξ, t) t², starts at rest,"
        " and so can come as near to that motion as its network lets it, but not reach it at t = 0."
    ),
    (
        "Cloth that is held. As long as it moves little, each mode, of frequency ω and static displacement uₛ, swings"
        " by Newton’s law, and creeps by the published one:"
    ),
    Formula("u = uₛ (1 − cos ωt)   becomes   u = uₛ (1 − cosh ω(T − t) / cosh ωT)."),
    (
        "Where ωT is large it goes to its static shape at once, without overshoot and without swinging. Such a drape"
        " looks plausible and is no motion; only figures over time tell the two apart."
    ),
)
