"""What a support exerts on the shell, by virtual work.

For a virtual displacement v that is a rigid motion on the support and vanishes on all others, the work of the reaction
is a(u, v) - f(v). No stress is evaluated at the edge, so the error is of second order in that of the field.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import Support
from shellbench.problems.shell.places import Edge, Whole
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.energy import BATCH
from shellbench.solvers.ndf.factors import edge_weight
from shellbench.solvers.ndf.field import Field
from shellbench.solvers.ndf.jets import VALUE, Array, Placement, constant, from_derivatives, product
from shellbench.solvers.ndf.loads import concentrated_forces, force_density
from shellbench.solvers.ndf.moments import edge_moments
from shellbench.solvers.ndf.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.supports import edge_supports, point_supports
from shellbench.solvers.ndf.undeformed import Undeformed, stresses


def virtual_edges(case: Case, support: Support) -> list[tuple[set[Edge], set[Edge]]]:
    """Return, for each component, the edges where a support's virtual motion is one and those where it is zero.

    Raises
    ------
    InputError
        If both kinds meet at a corner: the reaction there belongs to both supports.
    """
    edges = {place for place in case.places.values() if isinstance(place, Edge)}
    everywhere = any(isinstance(place, Whole) for s, place in case.supported_places() if s.name == support.name)
    held = {"xyz".index(c) for c in support.held} if everywhere else set()
    result: list[tuple[set[Edge], set[Edge]]] = []
    for c in range(3):
        own: set[Edge] = set(edges) if c in held else set()
        others: set[Edge] = set()
        if c in held:
            result.append((own, others))
            continue
        for s in edge_supports(case):
            holder = s.held.get(c)
            turns = s.slope is not None and holder is None and c not in case.held_everywhere
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


def edge_reaction(
    field: Field,
    support: Support,
    centre: Array,
    spec: RuleSpec,
    focal: Array,
    held: Array,
    measure: StrainName = "linear",
    body: Callable[[Array], Array] | None = None,
) -> Array:
    """Return force and moment (6,), N and N m, that a support exerts through its edges.

    `held` (k,) are the forces of the point supports, in the order of `point_supports`; they work on v as well. `body`
    gives forces per area (N, 3) at points (N, 2) beside the loads, such as those of inertia. At finite strain the arms
    of forces are those of the deformed shell.
    """
    case, placement, t = field.ansatz.case, field.features.placement, field.ansatz.t
    edges = virtual_edges(case, support)
    if not any(own for own, _ in edges):
        return np.zeros(6)

    def moved(u: Tensor) -> Tensor | None:
        return None if measure == "linear" else u

    rule = area_rule(case.surface.domain, focal, spec)
    total = placement.tensor(np.zeros(6))
    for start in range(0, len(rule.points), BATCH):
        points = rule.points[start : start + BATCH]
        surface = Undeformed.at_points(case.surface, points, placement)
        weights = placement.tensor(rule.weights[start : start + BATCH]) * surface.geometry.jacobian
        density = force_density(case, points, t)
        force = placement.tensor(density if body is None else density + body(points)) * weights[:, None]
        u = field.jet(points)
        strained = surface.strained(measure, surface.gradients(u))
        stress = stresses(surface.elasticity(case.material), strained.strains) * weights[:, None]
        conjugate = (stress[:, None] @ strained.variation)[:, 0]
        for k, v in enumerate(virtual_motions(case, edges, points, centre, placement, moved(u))):
            total[k] += (conjugate * surface.gradients(v).flatten(1)).sum() - (force * v[VALUE]).sum()
    points, forces = concentrated_forces(case, spec, focal, t)
    at = point_supports(case, t)
    points = np.concatenate([points, np.array([p.point.xi for p in at]).reshape(-1, 2)])
    fixed = np.zeros((len(at), 3))
    fixed[np.arange(len(at)), [p.component for p in at]] = held
    forces = np.concatenate([forces, fixed])
    if len(points):
        u = field.jet(points)
        for k, v in enumerate(virtual_motions(case, edges, points, centre, placement, moved(u))):
            total[k] -= (placement.tensor(forces) * v[VALUE]).sum()
    for moment in edge_moments(field.ansatz, field.features, spec, focal, measure != "linear"):
        u = field.jet(moment.sampled.points)
        rows = moment.rows(moment.sampled.undeformed.gradients(u)) * moment.moments(t)[:, None]
        for k, v in enumerate(virtual_motions(case, edges, moment.sampled.points, centre, placement, moved(u))):
            total[k] -= (rows * moment.sampled.undeformed.gradients(v)[:, :2].flatten(1)).sum()
    return np.asarray(total.cpu().numpy())


def virtual_motions(
    case: Case,
    edges: list[tuple[set[Edge], set[Edge]]],
    points: Array,
    centre: Array,
    placement: Placement,
    displacement: Tensor | None = None,
) -> list[Tensor]:
    """Return the jets (6, N, 3) of three translations and three rotations about `centre`, weighted by edges.

    `displacement` (6, N, 3) is the jet of the shell's, where its arms are those of the deformed shell.
    """
    x = from_derivatives(case.surface.derivatives(points, 2), placement)
    if displacement is not None:
        x = x + displacement
    arm = x - constant(placement.tensor(np.tile(centre, (len(points), 1))))
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
