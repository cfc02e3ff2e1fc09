"""Signs that a solved field is no answer, computed from the field itself.

The first sign is a turning that the energy does not see. Bending energy is integrated from second derivatives at
points. A field with kinks turns at lines on which no point lies; these turns should cost infinite energy, but cost
none. Between the ends of a panel the slope changes by the integral of the second derivative: if it changes by more, the
energy has missed the turning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import D1, D2, D11, D22, KINKED, Array
from shellbench.solvers.ndf.field.mirrors import inner_shares
from shellbench.solvers.ndf.field.quadrature import RuleSpec, line_rule, panel_ends
from shellbench.solvers.ndf.strains.energy import NormalEquations, exploits
from shellbench.solvers.ndf.strains.strain_measures import UNSTRAINED

CANCELLED = 1e-12  # share of the loads' work that is left on the feature that takes up most; rounding leaves 1e-15
LARGEST_UNSEEN = 1e-2  # of the changes of slope: smooth fields would show 1e-6 and less, rectified ones show 0.3
LARGEST_ADDED = (
    1e-3  # of the energy on springs: default fields show 1e-5 and less; beyond this the answer is the jitter's
)
MOST_ADDED = 0.1  # of the energy on exact supports, where the share is part of the uncertainty: beyond, little is told


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
    """Return the imbalance, J, by a jitter on the diagonal, as a share of the energy of output weights (3 M,).

    `rounding` is an energy, J, below which there is nothing to take a share of.
    """
    stored = 0.5 * float(weights @ (equations.stiffness @ weights))
    return unbalanced / (max(stored, 0.0) + abs(equations.constant) + rounding)


def rounding_energy(stiffness: float, area: float) -> float:
    """Return an energy, J, that is rounding, from the membrane stiffness, N/m, and the area, m^2."""
    return UNSTRAINED * stiffness * area


def refusal(signs: Signs, spec: FieldSpec, largest_gap: float) -> str | None:
    """Return the reason that a field is no answer, in one sentence, or None if no sign speaks against it."""
    # In the order of causes: the sentence names what to mend first. Each comparison is written so that a figure which
    # is not a number refuses.
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
    if (reason := exploits(signs.gap, largest_gap)) is not None:
        return f"{reason}; use more panels or fewer neurons"
    if not signs.jitter_share <= MOST_ADDED:
        return ill_conditioned(signs.jitter_share, "fewer neurons")
    return None


def ill_conditioned(share: float, remedy: str) -> str:
    """Say in one sentence that the equations could not be solved as they are."""
    return (
        f"the equations are too ill-conditioned: what keeps them definite takes {100 * share:.2g} % of the energy;"
        f" use {remedy}"
    )


LINES = inner_shares(4)  # of the other coordinate, at which lines run


def unseen_turning(field: Field, spec: RuleSpec, focal: Array) -> float:
    """Return the share of a field's changes of slope that its second derivatives do not account for, 0 to 1.

    Along coordinate lines, panel by panel of the rule `spec`: the sum of |slope(b) - slope(a) - integral of u,dd| over
    the sum of |slope(b) - slope(a)| + integral of |u,dd|, or over the slopes where these are larger.
    """
    # Smooth activations have no kinks.
    if field.features.network.activation not in KINKED:
        return 0.0
    # By the fundamental theorem slope(b) - slope(a) is the integral of u,dd over a panel, unless the slope jumps
    # within.
    # 1. Lines along both coordinates, off all symmetry, with the panels of the rule that was solved on.
    # 2. Slopes at the ends of panels, second derivatives at its Gauss points.
    # 3. The mismatch of both, summed over panels and lines, as a share of all turning.
    # A finer rule, the usual check, sees no kink either, as none of its points lies on one.
    domain = field.ansatz.case.surface.domain
    unseen, total = 0.0, 0.0
    for axis, first, second in ((0, D1, D11), (1, D2, D22)):
        lower, upper, size = domain.lower[axis], domain.upper[axis], domain.size[axis]
        ends = panel_ends(lower, upper, [float(f) for f in focal[:, axis]], spec, axis, domain.periodic[axis])
        inner, weights = line_rule(ends, spec.order)
        for share in LINES:
            across = domain.lower[1 - axis] + share * domain.size[1 - axis]
            points = np.full((len(ends) + len(inner), 2), across)
            points[:, axis] = np.concatenate([ends, inner])
            jet = field.jet(points).cpu().numpy() * size
            slope, bend = jet[first, : len(ends)], jet[second, len(ends) :] * weights[:, None]
            change, bend = np.diff(slope, axis=0), bend.reshape(len(ends) - 1, spec.order, 3)
            unseen += float(np.linalg.norm(change - bend.sum(1), axis=-1).sum())
            turned = np.linalg.norm(change, axis=-1).sum() + np.linalg.norm(bend, axis=-1).sum()
            # A field that hardly turns would make a share of nothing. Then its slopes are what a mismatch is compared
            # with.
            total += float(max(turned, np.linalg.norm(slope, axis=-1).max()))
    return unseen / total if total > 0 else 0.0
