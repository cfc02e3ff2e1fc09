"""Stress resultants of a displacement, by its derivatives; `patches` says of which displacement.

Membrane forces and moments are made of first and second derivatives of the displacement, which are exact. In contra-
variant components n = D H eps and m = B H kappa; with e_1 along a_1 and e_2 = a_3 x e_1 they become physical ones.

Shear forces need the moments' slopes, third derivatives of the displacement. Jets end at the second. So moments are
taken at Chebyshev points of a short line through the point, along either coordinate, and the polynomial through them is
differentiated: a field is smooth, and on so short a line its polynomial errs by less than rounding.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.polynomial import chebyshev
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.choices import StrainName
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.strains.strain_measures import Undeformed, stresses

LINE_NODES = 9  # moments on a line, through which the polynomial goes
HALF_LINE = 0.02  # of a side: half the length of a line


def resultants(case: Case, measure: StrainName, jet: Callable[[Array], Tensor], name: str, points: Array) -> Array:
    """Return resultants at points (N, 2) of a field with this displacement jet (6, N, 3); see `RESULTANTS`."""
    if name == "shear_force":
        return _shear_forces(case, measure, jet, points)
    surface, membrane, moments = _conjugate(case, measure, jet, points)
    frame = _frame(surface)
    full = _full(membrane if name == "membrane_force" else moments)
    turned = frame.mT @ full @ frame
    return np.asarray(torch.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], dim=-1).cpu().numpy())


def _conjugate(
    case: Case, measure: StrainName, jet: Callable[[Array], Tensor], points: Array
) -> tuple[Undeformed, Tensor, Tensor]:
    """Return the surface, and membrane forces and moments (N, 3) in contravariant components 11, 22, 12."""
    moved = jet(points)
    surface = Undeformed.at_points(case.surface, points, Placement(moved.device, moved.dtype))
    strains = surface.strained(measure, surface.gradients(moved)).strains
    # The strain 12 counts for 21, too: what is conjugate to it is the component itself.
    found = stresses(surface.elasticity(case.material), strains)
    return surface, found[:, :3], found[:, 3:]


def _full(pairs: Tensor) -> Tensor:
    """Return tensors (N, 2, 2) of components 11, 22, 12 (N, 3)."""
    return pairs[:, [0, 2, 2, 1]].view(-1, 2, 2)


def _frame(surface: Undeformed) -> Tensor:
    """Return a_a . e_i (N, 2, 2)."""
    tangents = surface.geometry.tangents
    first = tangents[:, 0] / tangents[:, 0].norm(dim=-1, keepdim=True)
    second = torch.linalg.cross(surface.geometry.normal, first, dim=-1)
    return tangents @ torch.stack([first, second], dim=-1)


def _shear_forces(case: Case, measure: StrainName, jet: Callable[[Array], Tensor], points: Array) -> Array:
    """Return q_i (N, 2): q^a = m^ab,b + Gamma^a_bc m^cb + Gamma^b_bc m^ac, in the orthonormal frame."""
    surface, _, here = _conjugate(case, measure, jet, points)
    christoffel = surface.geometry.christoffel[:, [0, 2, 2, 1]].view(-1, 2, 2, 2)  # (N, b, c, a)
    moments = _full(here)
    total = torch.einsum("nbca,ncb->na", christoffel, moments) + torch.einsum("nbcb,nac->na", christoffel, moments)
    for axis in (0, 1):
        lines = [_line(case, axis, point) for point in points]
        along = np.repeat(points[:, None], LINE_NODES, axis=1)
        along[:, :, axis] = [nodes for nodes, _ in lines]
        _, _, there = _conjugate(case, measure, jet, along.reshape(-1, 2))
        rows = here.new_tensor(np.array([row for _, row in lines]))
        total = total + torch.einsum("np,npa->na", rows, _full(there).view(len(points), LINE_NODES, 2, 2)[..., axis])
    return np.asarray((total[:, None] @ _frame(surface))[:, 0].cpu().numpy())


def _line(case: Case, axis: int, point: Array) -> tuple[Array, Array]:
    """Return coordinates (k,) of a line through a point, and what they are weighted by (k,) for a slope there."""
    domain = case.surface.domain
    half = HALF_LINE * domain.size[axis]
    cuts = sorted(
        case.kinks[axis] if domain.periodic[axis] else (domain.lower[axis], *case.kinks[axis], domain.upper[axis])
    )
    low = max((cut for cut in cuts if cut <= point[axis]), default=-np.inf)
    high = min((cut for cut in cuts if cut > point[axis]), default=np.inf)
    if not np.isfinite(high) and len(cuts) > 1:  # on the upper edge
        low, high = cuts[-2], cuts[-1]
    middle = min(max(point[axis], low + half), max(high - half, low + half))
    nodes = chebyshev.chebpts1(LINE_NODES)
    slopes = [chebyshev.chebval((point[axis] - middle) / half, chebyshev.chebder(c)) for c in np.eye(LINE_NODES)]
    weights = np.array(slopes) @ np.linalg.inv(chebyshev.chebvander(nodes, LINE_NODES - 1)) / half
    return middle + half * nodes, weights
