"""Rows of the output layer that hold point supports, and slopes at edges that no factor holds (`choices.Slopes`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.question.folds import ASIDE
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.ndf.field.ansatz import Ansatz, FeatureSet
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Array, Placement, from_derivatives
from shellbench.solvers.ndf.field.quadrature import NOWHERE, Rule, RuleSpec, edge_rule
from shellbench.solvers.ndf.field.strips import sides_along
from shellbench.solvers.ndf.field.supports import PointSupport, edge_supports, point_supports

SAME_ROW = 1e-6  # share of the softest combination of constraints below which a combination is lost in rounding
SLOPES = RuleSpec((12, 12), 6)  # along an edge whose slope is held by rows; as many for each half of a turn or strip


def point_constraints(ansatz: Ansatz, features: FeatureSet) -> tuple[Tensor, Tensor]:
    """Return rows (k, 3 M) and targets (k,), metres, that hold the point supports."""
    if ansatz.soft:
        return features.placement.zeros(0, 3 * features.count), features.placement.zeros(0)
    return point_rows(ansatz, features), point_targets(ansatz, features.placement)


def point_rows(ansatz: Ansatz, features: FeatureSet) -> Tensor:
    """Return rows (k, 3 M) whose products with the output weights are the components of M F held at points."""
    placement, supports = features.placement, point_supports(ansatz.case)
    if not supports:
        return placement.zeros(0, 3 * features.count)
    points, components = _held_components(supports)
    held = ansatz.factors.matrix(points, placement)[VALUE][range(len(supports)), components]
    return (held[:, :, None] * features.values(points)[:, None, :]).reshape(len(supports), -1)


def point_targets(ansatz: Ansatz, placement: Placement) -> Tensor:
    """Return the displacements that point supports prescribe (k,), metres, less the lift."""
    supports = point_supports(ansatz.case, ansatz.t)
    targets = placement.tensor(np.array([s.value for s in supports]))
    if not supports or not ansatz.lift.moves:
        return targets
    points, components = _held_components(supports)
    return targets - ansatz.lift.jet(points, placement)[VALUE][range(len(supports)), components]


def _held_components(supports: Sequence[PointSupport]) -> tuple[Array, list[int]]:
    """Return the points (k, 2) of point supports, and the component that each of them holds."""
    return np.array([s.point.xi for s in supports]), [s.component for s in supports]


def slope_constraints(
    ansatz: Ansatz, features: FeatureSet, spec: RuleSpec | None = None, focal: Array = NOWHERE
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield, edge by edge, rows (k, 3 M) and targets (k,), metres, that hold slopes if the ansatz uses rows.

    `spec` and the points (k, 2) that it is graded toward give the Gauss points; None: those of `SLOPES`.
    A row is u,n . a3 at a Gauss point, times sqrt(h ds): as stiff as the membrane, it is as stiff as bending over h.
    """
    case, placement = ansatz.case, features.placement
    for support in edge_supports(case):
        edge, held = support.edge, support.slope
        if held is None or not support.free or ansatz.slopes == "even":
            continue
        rule = edge_rule(case.surface.domain, edge, focal, spec or _slope_rule(case.surface))
        rows, slopes = _slopes(ansatz, features, edge.axis, rule)
        wanted = from_derivatives(case.motion(held, edge, rule.points, ansatz.t, 2), placement)
        yield rows, slopes(wanted - ansatz.lift.jet(rule.points, placement))
    yield from _fold_constraints(ansatz, features)


def _slope_rule(surface: Surface) -> RuleSpec:
    first, second = (n * sides for n, sides in zip(SLOPES.panels, sides_along(surface), strict=True))
    return replace(SLOPES, panels=(first, second))


def _fold_constraints(ansatz: Ansatz, features: FeatureSet) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield, for each rigid fold, rows (k, 3 M) and targets (k,), metres, that equate u,n . a3 on its two sides."""
    surface, placement = ansatz.case.surface, features.placement
    for fold in surface.fold_lines:
        if fold.hinged:
            continue
        line = edge_rule(surface.domain, Edge("", fold.axis, "min"), NOWHERE, _slope_rule(surface))
        both = []
        for side in (-1, 1):
            points = line.points.copy()
            points[:, fold.axis] = fold.at + 2 * side * ASIDE * surface.domain.size[fold.axis]
            rule = Rule(surface.domain.wrap(points), line.weights)
            rows, slopes = _slopes(ansatz, features, fold.axis, rule)
            both.append((rows, slopes(ansatz.lift.jet(rule.points, placement))))
        (below, lifted_below), (above, lifted_above) = both
        yield above - below, lifted_below - lifted_above


def _slopes(ansatz: Ansatz, features: FeatureSet, axis: int, rule: Rule) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
    """Return rows (N, 3 M) of scaled slopes u,n . a3 across a coordinate line, and their function (N,) of a jet."""
    case, placement = ansatz.case, features.placement
    x = from_derivatives(case.surface.derivatives(rule.points, 2), placement)
    across, along = (D1, D2) if axis == 0 else (D2, D1)
    length = x[along].norm(dim=-1)
    share = (x[across] * x[along]).sum(-1) / length**2
    conormal = torch.zeros_like(x[..., 0])  # the planes of a jet that give its derivative along n
    conormal[across], conormal[along] = 1.0, -share
    conormal /= (x[across] - share[:, None] * x[along]).norm(dim=-1)
    normal = torch.linalg.cross(x[D1], x[D2], dim=-1)
    normal /= normal.norm(dim=-1, keepdim=True)
    normal *= (case.material.thickness * placement.tensor(rule.weights) * length).sqrt()[:, None]
    matrix, jets = ansatz.factors.matrix(rule.points, placement), features.jets(rule.points)
    turned = torch.einsum("nc,pn,pncd->nd", normal, conormal, matrix)
    moved = torch.einsum("nc,ncd->nd", normal, matrix[VALUE])
    slopes = torch.einsum("pn,pnj->nj", conormal, jets)
    rows = turned[:, :, None] * jets[VALUE][:, None] + moved[:, :, None] * slopes[:, None]

    def of_jet(jet: Tensor) -> Tensor:
        return torch.einsum("nc,pn,pnc->n", normal, conormal, jet)

    return rows.reshape(len(rows), -1), of_jet
