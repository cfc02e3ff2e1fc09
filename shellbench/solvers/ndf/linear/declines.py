"""Cases that a field declines: supports that boundary factors can't hold, paths and motions that it can't follow.

A random field is used to test what boundary factors hold.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import Quantity
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.quantities import (
    CriticalPoint,
    ReactionQuantity,
    ResultantQuantity,
    TorqueQuantity,
)
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Rotation, Value
from shellbench.problems.shell.question.folds import NEAR_EDGE
from shellbench.problems.shell.question.loads import MomentLoad, PointLoad
from shellbench.problems.shell.question.places import Point
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.corners import held_corners
from shellbench.solvers.ndf.field.factors import turns_clamps, why_not_turned
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Placement, from_derivatives
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.field.strips import oblique_at_folds
from shellbench.solvers.ndf.field.supports import EdgeSupport, edge_samples, edge_supports
from shellbench.solvers.ndf.linear.ritz_field import is_path
from shellbench.solvers.ndf.strains.reaction import Virtual
from shellbench.solvers.ndf.strains.soft import why_not_soft

PROBE_WIDTH = 4  # features of the random field that probes the factors


def why_declined(case: Case, spec: FieldSpec | None = None) -> str | None:
    """Return the reason that a field with exact boundary factors can't solve a case, as one clause, or None if it can.

    `spec` are the choices of the field: for example, covariant components can't be even at a plane of symmetry.
    """
    if reason := why_not_moved(case) if case.dynamics else None if case.linear else why_not_followed(case):
        return reason
    if case.linear and not case.modal and len(case.states) > 1 and not is_path(case):
        return "it answers a linear case at its last state alone"
    if case.springs and case.linear and case.dynamics is None and is_path(case):
        return "it takes no springs beside edge moments, or where all of the displacement is prescribed"
    if case.surface.fold_lines and (reason := _why_not_folded(case, spec or FieldSpec())):
        return reason
    if spec is not None and spec.supports == "soft":
        return why_not_soft(case)
    probe = _random_field(case, spec or FieldSpec())
    for support in edge_supports(case):
        value, slope = violations(probe, support)
        if not value < ROUNDING:
            return f"its boundary factors can't move '{support.edge.name}' as prescribed where it meets other supports"
        by_rows = support.free and spec is not None and spec.slopes == "rows"
        if not by_rows and not slope < ROUNDING:
            return f"its boundary factors can't hold the slope on '{support.edge.name}' of this surface"
        if support.free and not by_rows and _slides_across(case, support):
            return f"it holds the slope on '{support.edge.name}', which slides, by features that take no shear there"
    return None


def _why_not_folded(case: Case, spec: FieldSpec) -> str | None:
    """Return the reason that a field can't have the folds of a surface, as one clause, or None if it can."""
    if not case.linear or case.dynamics or case.modal or case.obstacles or is_path(case):
        return "its surface has folds, which it takes in linear theory at rest, without contact or edge moments"
    if spec.supports == "soft" or spec.components == "covariant" or spec.slopes == "even":
        return "its surface has folds, which it takes with Cartesian components and exact supports only"
    forced = (case.places[name] for load in case.loads if isinstance(load, PointLoad) for name in load.on)
    places = [place for place in forced if isinstance(place, Point)]
    size, folds = case.surface.domain.size, case.surface.fold_lines
    if any(abs(place.xi[f.axis] - f.at) <= NEAR_EDGE * size[f.axis] for place in places for f in folds):
        return "a force acts at a point of a fold, where its singular features don't fit"
    return None


def why_not_given(case: Case, quantity: Quantity) -> str | None:
    """Return the reason that a field can't give a quantity of a case that it takes, as a clause, or None if it can."""
    if isinstance(quantity, ReactionQuantity | TorqueQuantity):
        if case.dynamics is not None and case.dynamics.stiffness_damping:
            return "its reactions know no stresses of damping by stiffness"
        if oblique_at_folds(case.surface):  # the virtual motions would turn the shell there
            return "coordinate lines meet a fold obliquely, where virtual motions break its condition"
        support = next(s for s in case.supports if s.name == quantity.support)
        return Virtual.from_support(case, support).why_not_told(quantity)
    if isinstance(quantity, ResultantQuantity) and (corner := quantity.corner_of(case)) and held_corners(case):
        return f"its powers about corners have no second derivatives at the corner '{corner[0]}'"
    return None


def why_not_moved(case: Case) -> str | None:
    """Return the reason that a field can't follow a motion, as one clause, or None if it can."""
    if case.obstacles:
        return "it touches obstacles at rest alone"
    if turns_clamps(case):
        return "it can't turn clamped edges by finite angles in motion"
    for support in case.supports:
        if support.clamped and isinstance(support.motion, Value):
            return f"it can't tell how far the clamped support '{support.name}' turns"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it can't follow edge moments in motion"
    if case.following:
        return "its pressures keep the normal of the shell at rest in motion"
    return None


def violations(field: Field, support: EdgeSupport) -> tuple[float, float]:
    """Return the errors of a field in the prescribed motion and slope on an edge, relative to its own size.

    The ends of the edge are left out: there two supports may contradict each other.
    """
    case, placement = field.ansatz.case, field.features.placement
    points = edge_samples(case, support.edge)[1:-1]
    u = field.jet(points)
    x = from_derivatives(case.surface.derivatives(points, 2), placement)
    value = 0.0
    for c, holder in support.held.items():
        wanted = case.motion(holder, support.edge, points, field.ansatz.t)[0, 0][:, c]
        scale = np.abs(wanted).max(initial=0.0) + float(u[VALUE].abs().max()) + _largest_displacement(field)
        value = max(value, float((u[VALUE, :, c] - placement.tensor(wanted)).abs().max()) / scale)
    if support.slope is None:
        return value, 0.0
    motion = case.motion(support.slope, support.edge, points, field.ansatz.t, 1)
    moved = torch.stack([placement.tensor(motion[k]) for k in ((0, 0), (1, 0), (0, 1))])
    turned = x[:3] + moved if turns_clamps(case) and isinstance(support.slope.motion, Rotation) else x[:3]
    normal = torch.linalg.cross(turned[D1], turned[D2], dim=-1)
    normal = normal / normal.norm(dim=-1, keepdim=True)
    wanted_tilt = _conormal_slope(moved, x, normal, support.edge.axis)
    tilt = _conormal_slope(u, x, normal, support.edge.axis)
    largest = (u[[D1, D2]].norm(dim=-1) / x[[D1, D2]].norm(dim=-1)).max()
    return value, float((tilt - wanted_tilt).abs().max() / (largest + wanted_tilt.abs().max()))


def _slides_across(case: Case, support: EdgeSupport) -> bool:
    """Return True if free components have a part across an edge that holds the slope: it is no plane of symmetry."""
    x = from_derivatives(case.surface.derivatives(edge_samples(case, support.edge), 2), Placement())
    _, conormal = _conormal(x, support.edge.axis)
    free = [c for c in range(3) if c not in support.held]
    return bool((conormal[:, free].norm(dim=-1) > ROUNDING * conormal.norm(dim=-1)).any())


def _conormal(x: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """Return a share (N, 1) and n = a_across - share a_along (N, 3), across an edge within the surface."""
    across, along = (x[D1], x[D2]) if axis == 0 else (x[D2], x[D1])
    share = ((across * along).sum(-1) / (along * along).sum(-1))[:, None]
    return share, across - share * along


def _conormal_slope(u: Tensor, x: Tensor, normal: Tensor, axis: int) -> Tensor:
    """Return u,n . normal along an edge, n the unit conormal (the direction across the edge within the surface)."""
    du, dv = (u[D1], u[D2]) if axis == 0 else (u[D2], u[D1])
    share, conormal = _conormal(x, axis)
    tilt: Tensor = ((du - share * dv) * normal).sum(-1) / conormal.norm(dim=-1)
    return tilt


def _largest_displacement(field: Field) -> float:
    """Return the largest component of the displacement at 25 points, metres."""
    domain = field.ansatz.case.surface.domain
    middle = np.asarray(domain.grid(5, 5)).reshape(-1, 2)
    return float(field.displacement(middle).abs().max())


def _random_field(case: Case, spec: FieldSpec) -> Field:
    """Return a random field on the shell."""
    placement = Placement()
    inputs = build_inputs(case, spec)
    network = random_features(placement.tensor(np.full(inputs.count, math.pi)), PROBE_WIDTH, seed=0)
    features = build_features(case, spec, network, placement, inputs)
    generator = torch.Generator().manual_seed(1)
    output = torch.randn((3, features.count), generator=generator, dtype=torch.float64)
    return Field(build_ansatz(case, spec), features, output, torch.zeros(6, dtype=torch.float64))


def why_not_followed(case: Case) -> str | None:
    """Return the reason that a field can't follow a non-linear case, as one clause, or None if it can."""
    if case.obstacles and (reason := _why_not_touched(case)) is not None:
        return reason
    for support in case.supports:
        if support.clamped and isinstance(support.motion, Value):
            return f"it can't tell how far the clamped support '{support.name}' turns"
    if (reason := why_not_turned(case)) is not None:
        return reason
    moved = next((support for support in case.supports if support.motion is not None), None)
    if case.path.quantity is not None and moved is not None:
        return f"it can't move support '{moved.name}' on a path with control = '{case.path.control}'"
    free = free_motions(case)
    if case.following and (case.path.quantity is not None or case.path.after_buckling == "follow"):
        return "it follows a pressure along the deformed normal by load steps before buckling only"
    if case.following and free.size:
        return "it needs supports against all rigid motions where a pressure follows the shell"
    if free.size and np.abs(free[3:]).max() > ROUNDING:
        name = RIGID_MOTIONS[3 + int(np.argmax(np.abs(free[3:]).max(axis=1)))]
        return f"it needs supports against {name} at finite strain"
    return None


def _why_not_touched(case: Case) -> str | None:
    if case.path.control != "load" or case.path.after_buckling == "follow":
        return "it touches obstacles by load steps before buckling only"
    if any(isinstance(q, CriticalPoint) for q in case.quantities):
        return "it tells of no critical points where there are obstacles"
    if case.following or any(isinstance(load, MomentLoad) for load in case.loads) or turns_clamps(case):
        return "it touches obstacles at finite strain under dead forces alone, without moments or edges that turn"
    return None
