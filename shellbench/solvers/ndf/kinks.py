"""Whether a field turns where its energy does not look.

Bending energy is integrated from second derivatives at points. A field with kinks turns at lines that no point lies
on, and those turns would cost infinite energy, not none. Between the ends of a panel the slope changes by the integral
of the second derivative: where it changes by more, the energy has missed it. This needs no known answer.
"""

from __future__ import annotations

import numpy as np

from shellbench.solvers.ndf.field import Field
from shellbench.solvers.ndf.jets import D1, D2, D11, D22, Array
from shellbench.solvers.ndf.quadrature import RuleSpec, line_rule, panel_ends

LINES = (0.17, 0.38, 0.61, 0.84)  # shares of the other coordinate at which lines run, off all symmetry


def unseen_turning(field: Field, spec: RuleSpec, focal: Array) -> float:
    """Return the share of a field's changes of slope that its second derivatives do not account for, 0 to 1.

    Along coordinate lines, panel by panel of the rule `spec`: the sum of |slope(b) - slope(a) - integral of u,dd| over
    the sum of |slope(b) - slope(a)| + integral of |u,dd|, or over the slopes where these are larger.
    """
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
            total += float(max(turned, np.linalg.norm(slope, axis=-1).max()))
    return unseen / total if total > 0 else 0.0
