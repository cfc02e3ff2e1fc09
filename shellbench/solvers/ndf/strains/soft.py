"""Soft supports: springs that pull held components to their prescribed values, instead of boundary factors.

The energy of the springs joins that of the shell as a loss term,

    P = 1/2 k sum_c [ int over edges of (u_c - ubar_c)^2 ds  +  L sum over points of (u_c - ubar_c)^2 ],

k = weight D / L in N/m^2, with D the membrane stiffness (N/m) and L the root of the midsurface's area. At weight 1 an
edge yields about as much as the shell itself when it is stretched over its own length. The weight does not follow from
the case, and supports yield by about 1 / weight for any choice (Kairanda et al. 2023, section F and figure II).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.places import Whole
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import VALUE, Array
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule, edge_rule
from shellbench.solvers.ndf.field.supports import edge_samples, edge_supports, point_supports
from shellbench.solvers.ndf.strains.energy import Certificate, NormalEquations, Polynomial, surface_area


def why_not_soft(case: Case) -> str | None:
    """Return the reason that springs can't hold the supports of a case, as one clause, or None if they can."""
    if not case.linear or case.dynamics:
        return 'supports = "soft" is for shells at rest in linear theory'
    if case.springs:
        return 'supports = "soft" is for shells that rest on no springs'
    if any(isinstance(place, Whole) for _, place in case.supported_places()):
        return 'supports = "soft" is for edges and points, and this case holds its whole surface'
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return 'supports = "soft" takes no edge moments'
    slope = next((s.name for s in case.supports if s.holds_slope), None)
    return f"supports = \"soft\" holds no slopes, and support '{slope}' has one" if slope else None


@dataclass(frozen=True)
class Springs:
    """Springs at P points, each on one component.

    Attributes
    ----------
    points
        (P, 2).
    components
        (P,): 0, 1 or 2.
    stiffness
        (P,), N/m; along edges with the weights of an edge rule.
    targets
        (P,): the displacement that the support prescribes, metres.
    at_points
        Number of springs at points; these are the last ones, in the order of `supports.point_supports`.
    """

    points: Array
    components: Array
    stiffness: Array
    targets: Array
    at_points: int

    @classmethod
    def from_spec(cls, ansatz: Ansatz, spec: RuleSpec, focal: Array, weight: float) -> Springs:
        """Put springs at the held places of a case, along edges by an edge rule as fine as `spec`."""
        case, domain = ansatz.case, ansatz.case.surface.domain
        length = surface_area(ansatz, area_rule(domain, focal, spec)) ** 0.5
        stiff = weight * case.material.membrane_stiffness
        points, components, stiffness, targets = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
        for support in edge_supports(case):
            rule = edge_rule(domain, support.edge, focal, spec)
            tangent = case.surface.derivatives(rule.points, 1)[(0, 1) if support.edge.axis == 0 else (1, 0)]
            share = rule.weights * np.linalg.norm(tangent, axis=-1) / length
            for c, holder in support.held.items():
                points.append(rule.points)
                components.append(np.full(len(share), c))
                stiffness.append(stiff * share)
                targets.append(case.motion(holder, support.edge, rule.points, ansatz.t)[0, 0][:, c])
        held = point_supports(case, ansatz.t)
        points += [np.array([p.point.xi for p in held]).reshape(-1, 2)]
        components += [np.array([p.component for p in held])]
        stiffness += [np.full(len(held), stiff)]
        targets += [np.array([p.value for p in held])]
        return cls(
            np.concatenate(points),
            np.concatenate(components).astype(int),
            np.concatenate(stiffness),
            np.concatenate(targets),
            len(held),
        )

    @property
    def moved(self) -> bool:
        """True if they pull any point away from its place."""
        return bool(np.any(self.targets))

    def rows(self, ansatz: Ansatz, features: Features) -> Tensor:
        """Return the rows (P, 3 M) that give the displacement at each spring from the output weights."""
        placement = features.placement
        matrix = ansatz.factors.matrix(self.points, placement)[VALUE]
        index = torch.arange(len(self.points), device=placement.device)
        held = matrix[index, torch.as_tensor(self.components, device=placement.device)]
        return (held[:, :, None] * features.values(self.points)[:, None, :]).flatten(1)

    def added_to(self, equations: NormalEquations, ansatz: Ansatz, features: Features) -> NormalEquations:
        """Return the energy of the output weights with that of the springs added."""
        rows, stiffness = self.rows(ansatz, features), features.placement.tensor(self.stiffness)
        drawn = features.placement.tensor(self.stiffness * self.targets)
        return replace(
            equations,
            stiffness=equations.stiffness + rows.T @ (stiffness[:, None] * rows),
            load=equations.load + rows.T @ drawn,
            constant=equations.constant + 0.5 * float(self.stiffness @ self.targets**2),
        )

    def certify(self, certified: Certificate, ansatz: Ansatz, features: Features, output: Tensor) -> Certificate:
        """Return certified energies with that of these springs added, for an output layer (3, M)."""
        u = (self.rows(ansatz, features) @ output.reshape(-1)).cpu().numpy()
        k, target = self.stiffness, self.targets
        springs: Polynomial = (float(k @ target**2) / 2, -float(k @ (target * u)), float(k @ u**2) / 2)
        return replace(certified, springs=springs)

    def point_forces(self, field: Field) -> tuple[float, ...]:
        """Return the forces (k,), N, of the springs at points on the shell."""
        last = slice(len(self.points) - self.at_points, None)
        if not self.at_points:
            return ()
        u = field.displacement(self.points[last]).cpu().numpy()[np.arange(self.at_points), self.components[last]]
        return tuple((self.stiffness[last] * (self.targets[last] - u)).tolist())


def support_error(field: Field) -> float:
    """Return the largest difference between a held component and its prescribed value, metres, over all held places."""
    case, t = field.ansatz.case, field.ansatz.t
    error = 0.0
    for support in edge_supports(case):
        points = edge_samples(case, support.edge)
        u = field.displacement(points).cpu().numpy()
        for c, holder in support.held.items():
            wanted = case.motion(holder, support.edge, points, t)[0, 0][:, c]
            error = max(error, float(np.abs(u[:, c] - wanted).max()))
    for held in point_supports(case, t):
        u = field.displacement(np.array([held.point.xi])).cpu().numpy()
        error = max(error, abs(float(u[0, held.component]) - held.value))
    return error
