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
from shellbench.solvers.ndf.strains.energy import NormalEquations, why_exploited
from shellbench.solvers.ndf.strains.strain_measures import UNSTRAINED

CANCELLED = 1e-12  # share of the loads' work that remains on the feature with the most; rounding leaves 1e-15
LARGEST_UNSEEN = 1e-2  # of the changes of slope: smooth fields would show 1e-6 and less, rectified ones show 0.3
LARGEST_ADDED = (
    1e-3  # of the energy on springs: default fields show 1e-5 and less; beyond this the answer is the jitter's
)
MOST_ADDED = 0.1  # of the energy on exact supports, where the share is part of the uncertainty: the limit


@dataclass(frozen=True)
class Signs:
    """Numbers that decide if a field is an answer.

    Attributes
    ----------
    gap
        Quadrature gap.
    taken_up
        Largest work of the loads on a feature, as a share of the work without cancellation.
    unseen_turning
        Share of the changes of slope that the second derivatives do not account for.
    jitter_share
        Work left unbalanced by the number added to the diagonal, as a share of the energy.
    """

    gap: float
    taken_up: float
    unseen_turning: float
    jitter_share: float


def net_work(equations: NormalEquations) -> float:
    """Return the largest work of the loads on a feature, as a share of the work without cancellation."""
    return float(equations.load.abs().max()) / equations.uncancelled if equations.uncancelled > 0 else 1.0


def jitter_share(equations: NormalEquations, weights: Tensor, unbalanced: float, rounding: float) -> float:
    """Return the imbalance, J, by a jitter on the diagonal, as a share of the energy of output weights (3 M,).

    `rounding` is an energy, J, that keeps the share finite for a field without energy.
    """
    stored = 0.5 * float(weights @ (equations.stiffness @ weights))
    return unbalanced / (max(stored, 0.0) + abs(equations.constant) + rounding)


def rounding_energy(stiffness: float, area: float) -> float:
    """Return the energy, J, that counts as rounding, from the membrane stiffness, N/m, and the area, m^2."""
    return UNSTRAINED * stiffness * area


def refusal(signs: Signs, spec: FieldSpec, largest_gap: float) -> str | None:
    """Return the reason that a field is no answer, in one sentence, or None if no sign speaks against it."""
    # The order is that of causes: the sentence names the first one to correct. Each comparison is written so that NaN
    # refuses.
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
    if (reason := why_exploited(signs.gap, largest_gap)) is not None:
        return f"{reason}; use more panels or fewer neurons"
    if not signs.jitter_share <= MOST_ADDED:
        return ill_conditioned(signs.jitter_share, "fewer neurons")
    return None


def ill_conditioned(share: float, remedy: str) -> str:
    """Return a sentence: the equations could not be solved without a change."""
    return (
        f"the equations are too ill-conditioned: what keeps them definite takes {100 * share:.2g} % of the energy;"
        f" use {remedy}"
    )


LINES = inner_shares(4)  # of the other coordinate, at which lines run


def unseen_turning(field: Field, spec: RuleSpec, focal: Array) -> float:
    """Return the share of a field's changes of slope that its second derivatives do not account for, 0 to 1.

    It is computed along coordinate lines, panel by panel of the rule `spec`: the sum of |slope(b) - slope(a) - integral
    of u,dd| over the sum of |slope(b) - slope(a)| + integral of |u,dd|, or over the slopes if these are larger.
    """
    # Smooth activations have no kinks.
    if field.features.network.activation not in KINKED:
        return 0.0
    # By the fundamental theorem slope(b) - slope(a) is the integral of u,dd over a panel, unless the slope jumps
    # within.
    # 1. Take lines along both coordinates, off all symmetry, with the panels of the rule of the solve.
    # 2. Evaluate slopes at the ends of panels, and second derivatives at their Gauss points.
    # 3. Sum the mismatch of both over panels and lines, as a share of all turning.
    # A finer rule, the usual check, does not detect a kink either, since none of its points lies on one.
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
            # For a field that hardly turns the share would be undefined. Then the mismatch is compared with its slopes.
            total += float(max(turned, np.linalg.norm(slope, axis=-1).max()))
    return unseen / total if total > 0 else 0.0
