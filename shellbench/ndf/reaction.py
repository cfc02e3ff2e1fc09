"""What a support exerts on the shell, by virtual work.

For a virtual displacement v that is a rigid motion on the support and vanishes on all others, the work of the reaction
is a(u, v) - f(v). No stress is evaluated at the edge, so the error is of second order in that of the field.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from shellbench.case import Case
from shellbench.conditions import Support
from shellbench.errors import InputError
from shellbench.ndf.energy import BATCH
from shellbench.ndf.field import Field
from shellbench.ndf.geometry import geometry
from shellbench.ndf.jets import VALUE, Array, Placement, constant, from_derivatives, product
from shellbench.ndf.lift import edge_weight
from shellbench.ndf.loads import concentrated_forces, force_density
from shellbench.ndf.quadrature import RuleSpec, area_rule
from shellbench.ndf.strain import apply_rows, energy_rows
from shellbench.ndf.supports import edge_supports, point_supports
from shellbench.places import Edge


def virtual_edges(case: Case, support: Support) -> list[tuple[set[Edge], set[Edge]]]:
    """Return, for each component, the edges where a support's virtual motion is one and those where it is zero.

    Raises
    ------
    InputError
        If both kinds meet at a corner: the reaction there belongs to both supports.
    """
    result = []
    for c in range(3):
        own, others = set(), set()
        for s in edge_supports(case):
            holder = s.held.get(c)
            turns = s.slope is not None and holder is None
            if (holder is not None and holder.name == support.name) or (turns and s.slope.name == support.name):  # type: ignore[union-attr]
                own.add(s.edge)
            elif holder is not None or turns:
                others.add(s.edge)
        if own and others and len({e.axis for e in own | others}) > 1:
            raise InputError(
                f"case '{case.name}': the reaction of support '{support.name}' can't be told from that of"
                " another support which it meets at a corner"
            )
        result.append((own, others))
    return result


def edge_reaction(field: Field, support: Support, centre: Array, spec: RuleSpec, focal: Array, held: Array) -> Array:
    """Return force and moment (6,), N and N m, that a support exerts through its edges.

    `held` (k,) are the forces of the point supports, in the order of `point_supports`; they work on v as well.
    """
    case, placement, t = field.ansatz.case, field.features.placement, field.ansatz.t
    edges = virtual_edges(case, support)
    if not any(own for own, _ in edges):
        return np.zeros(6)
    rule = area_rule(case.surface.domain, focal, spec)
    total = placement.tensor(np.zeros(6))
    for start in range(0, len(rule.points), BATCH):
        points = rule.points[start : start + BATCH]
        reference = geometry(case.surface, points, placement)
        weights = placement.tensor(rule.weights[start : start + BATCH]) * reference.jacobian
        rows = energy_rows(reference, case.material) * weights[:, None, None, None].sqrt()
        force = placement.tensor(force_density(case, points, t)) * weights[:, None]
        strain = apply_rows(rows, field.jet(points))
        for k, v in enumerate(virtual_motions(case, edges, points, centre, placement)):
            total[k] += (strain * apply_rows(rows, v)).sum() - (force * v[VALUE]).sum()
    points, forces = concentrated_forces(case, spec, focal, t)
    at = point_supports(case, t)
    points = np.concatenate([points, np.array([p.point.xi for p in at]).reshape(-1, 2)])
    fixed = np.zeros((len(at), 3))
    fixed[np.arange(len(at)), [p.component for p in at]] = held
    forces = np.concatenate([forces, fixed])
    if len(points):
        for k, v in enumerate(virtual_motions(case, edges, points, centre, placement)):
            total[k] -= (placement.tensor(forces) * v[VALUE]).sum()
    return np.asarray(total.cpu().numpy())


def virtual_motions(
    case: Case, edges: list[tuple[set[Edge], set[Edge]]], points: Array, centre: Array, placement: Placement
) -> list[Tensor]:
    """Return the jets (6, N, 3) of three translations and three rotations about `centre`, weighted by edges."""
    x = from_derivatives(case.surface.derivatives(points, 2), placement)
    arm = x - constant(placement.tensor(np.broadcast_to(centre, (len(points), 3))))
    weights = torch.stack([_weight(case, own, others, points, placement) for own, others in edges], dim=-1)
    motions = []
    for axis in torch.eye(3, device=placement.device, dtype=placement.dtype):
        motions.append(product(weights, constant(axis.expand(len(points), 3))))
    for axis in torch.eye(3, device=placement.device, dtype=placement.dtype):
        motions.append(product(weights, torch.linalg.cross(axis.expand_as(arm), arm, dim=-1)))
    return motions


def _weight(case: Case, own: set[Edge], others: set[Edge], points: Array, placement: Placement) -> Tensor:
    total = constant(placement.tensor(np.zeros(len(points))))
    if not own:
        return total
    if not others:
        return constant(placement.tensor(np.ones(len(points))))
    for edge in own:
        total = total + edge_weight(case, edge, len(own | others) == 1, points, placement)
    return total
