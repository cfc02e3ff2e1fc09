"""Layers along held edges, thin compared with the distance to the middle of the shell, and meshes graded toward them.

At a clamped edge, bending decays inward as exp(-x / l). On a curved shell this is the simple edge effect of
Goldenveizer and Novozhilov, B w'''' + E h k^2 w = 0 with k the normal curvature along the edge, so that

    1 / l = (E h k^2 / (4 B))^(1/4),    which is (3 (1 - nu^2))^(1/4) sqrt(k / h) of a homogeneous shell.

Along asymptotic lines k is zero: the layers there scale as h^(1/3) or h^(1/4), are wider, and are not graded. On a
slender shell the effect of an end support decays as the least harmonic between its sides, l = width / pi, whatever its
curvature. Edges that may turn have edge effects as well, but roofs and cylinders on diaphragms converge as soon on
uniform meshes, at any thickness of the study of thinness. Other edges are graded if the opposite one is. Planes of
symmetry are never graded: they have no layer.

Uniform cells as long as the layer would be many. With lines at (i/n)^g of the distance to the middle, a part `SHARE` of
them falls into the layer if g = log(l / distance) / log(SHARE). Layers wider than `THIN` are not graded.

Goldenveizer (1961), Theory of elastic thin shells, part IV; Novozhilov (1959), The theory of thin shells, section 40.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.places import Edge, Side
from shellbench.solvers.fem.mechanics.kinematics import Midsurface, stiffness_moduli
from shellbench.solvers.fem.mesh.grading import Ends

Array = NDArray[np.float64]

SIDES: tuple[Side, Side] = ("min", "max")

# Of the distance from an edge to the middle: meshes that converge without grading have cells of about this length.
THIN = 0.05
# Share of the cells from an edge to the middle that lie in a layer. A smaller one leaves it unresolved, a larger one
# coarsens the middle. Set on layers along held edges and at the ends of slender plates; the cost of other values is not
# recorded.
SHARE = 0.25
STEEPEST = 4.5  # grading: layers of 1/500 of the way; more would cost digits at the edge
EDGE_SAMPLES = 33  # points along an edge at which the layer's thickness is looked at


def layer_gradings(case: Case) -> Ends:
    """Return by coordinate the exponents g of the mesh lines' distances from its lower and its upper edge."""
    found = {(axis, side): 1.0 for axis in (0, 1) for side in SIDES}
    mirrors: set[tuple[int, str]] = set()
    for support, place in case.supported_places():
        if isinstance(place, Edge) and support.symmetry is None:
            steep = _exponent(relative_layer(case, replace(place, between=None), support.clamped))
            found[place.axis, place.side] = max(found[place.axis, place.side], steep)
        elif isinstance(place, Edge):
            mirrors.add((place.axis, place.side))
    # A mesh that is graded at one end only is coarsest at the other, where a free edge has a layer as thin.
    for axis in (0, 1):
        for side, other in zip(SIDES, reversed(SIDES), strict=True):
            if found[axis, other] > found[axis, side] == 1 and (axis, side) not in mirrors:
                found[axis, side] = _exponent(relative_layer(case, Edge(f"xi{axis + 1}_{side}", axis, side), True))
    return (found[0, "min"], found[0, "max"]), (found[1, "min"], found[1, "max"])


def _exponent(relative: float) -> float:
    """Return the exponent that puts `SHARE` of the cells into a layer; 1 if the layer is not thin."""
    return min(math.log(relative) / math.log(SHARE), STEEPEST) if relative < THIN else 1.0


def relative_layer(case: Case, edge: Edge, clamped: bool) -> float:
    """Return the length l of the thinnest layer along an edge over the way to the middle, in the coordinate across."""
    domain, axis, along = case.surface.domain, edge.axis, 1 - edge.axis
    points = domain.wrap(edge.samples(domain, EDGE_SAMPLES))
    surface = Midsurface.from_position(case.surface.derivatives(points, order=2))
    tangent = np.linalg.norm(surface.base[:, along], axis=-1)
    across = surface.area / tangent  # m a unit of the coordinate, normal to the edge
    curvature = np.abs(np.sum(surface.second[:, along] * surface.normal, axis=-1)) / tangent**2
    membrane, bending = stiffness_moduli(case.surface, case.material, points).T
    stretching = membrane * (1 - case.material.poissons_ratios[0] ** 2)  # E h
    decay = (stretching * curvature**2 / (4 * bending)) ** (1 / 4)
    width = float(tangent.mean()) * domain.size[along]
    thinnest = 1 / np.maximum(decay if clamped else 0.0, math.pi / width) * np.ones(len(points))
    return float((thinnest / across).min()) / (domain.size[axis] / 2)
