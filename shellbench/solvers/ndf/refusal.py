"""What makes a solved field no answer, told from the field itself: no known answer is looked at."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from shellbench.solvers.ndf.build import FieldSpec
from shellbench.solvers.ndf.energy import NormalEquations
from shellbench.solvers.ndf.equilibrium import UNSTRAINED
from shellbench.solvers.ndf.jets import KINKED

CANCELLED = 1e-12  # share of the loads' work that is left on the feature that takes up most; rounding leaves 1e-15
LARGEST_UNSEEN = 1e-2  # of the changes of slope: smooth fields show 1e-6 and less, rectified ones 0.3 and more
LARGEST_ADDED = 1e-3  # of the energy: default fields show 1e-5 and less; beyond this the answer is visibly the jitter's


@dataclass(frozen=True)
class Signs:
    """Figures that tell whether a field is an answer.

    Attributes
    ----------
    gap
        Quadrature gap.
    taken_up
        Largest work of the loads on a feature, as a share of what it would be if no part of it cancelled.
    unseen_turning
        Share of the changes of slope that the second derivatives do not account for.
    jitter_share
        Work that what was added to the diagonal leaves unbalanced, as a share of the energy.
    """

    gap: float
    taken_up: float
    unseen_turning: float
    jitter_share: float


def taken_up(equations: NormalEquations) -> float:
    """Return the largest work of the loads on a feature, as a share of what it would be if no part cancelled."""
    return float(equations.load.abs().max()) / equations.uncancelled if equations.uncancelled > 0 else 1.0


def jitter_share(equations: NormalEquations, weights: Tensor, unbalanced: float, rounding: float) -> float:
    """Return what a jitter on the diagonal has left unbalanced, J, as a share of the energy of output weights (3 M,).

    `rounding` is an energy, J, below which there is nothing to take a share of.
    """
    stored = 0.5 * float(weights @ (equations.stiffness @ weights))
    return unbalanced / (max(stored, 0.0) + abs(equations.constant) + rounding)


def rounding_energy(stiffness: float, area: float) -> float:
    """Return an energy, J, that is rounding, from the membrane stiffness, N/m, and the area, m^2."""
    return UNSTRAINED * stiffness * area


def refusal(signs: Signs, spec: FieldSpec, largest_gap: float) -> str | None:
    """Return why a field is no answer, in one sentence, or None if nothing speaks against it."""
    if not signs.taken_up >= CANCELLED:
        even = " (with a cosine alone, every field is even about the seam)" if spec.periodic_input == "cosine" else ""
        return f"no field of this kind takes up the loads: their work cancels on every feature{even}"
    if not signs.unseen_turning <= LARGEST_UNSEEN:
        kinked = spec.activation in KINKED
        cause = f", as the second derivatives of activation '{spec.activation}' vanish" if kinked else ""
        return (
            f"the field folds where its bending energy does not look: {100 * signs.unseen_turning:.2g} % of its changes"
            f" of slope are kinks without curvature{cause}, so it is no equilibrium of the shell"
        )
    soft = spec.supports == "soft"
    if soft and not signs.jitter_share <= LARGEST_ADDED:  # before the gap: more panels would not help
        return ill_conditioned(signs.jitter_share, "a smaller penalty")
    if not signs.gap <= largest_gap:  # also where it is not a number
        return (
            f"the field exploits its quadrature: its energy on the finer one differs by {signs.gap:.2g},"
            f" more than the {largest_gap:g} allowed; use more panels or fewer neurons"
        )
    if not signs.jitter_share <= LARGEST_ADDED:
        return ill_conditioned(signs.jitter_share, "fewer neurons")
    return None


def ill_conditioned(share: float, remedy: str) -> str:
    """Say in one sentence that the equations could not be solved as they are."""
    return (
        f"the equations are too ill-conditioned: what keeps them definite takes {100 * share:.2g} % of the energy;"
        f" use {remedy}"
    )
