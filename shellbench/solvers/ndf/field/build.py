"""Construction of the parts of a field from a case and a few choices, which a file keeps beside its tensors.

The module also derives the resolution of a Ritz field and its quadrature from the case alone. It depends on two
properties. If the midsurface is curved, edges have layers of the length sqrt(R h). If forces act at points, the
solution is resolved over that length, away from edges. The constants were chosen by certified energy on plates, roofs
of four thicknesses, a hyperbolic paraboloid, and pinched and twisted cylinders.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.corners import CornerPowers
from shellbench.solvers.ndf.field.factors import (
    BoundaryFactors,
    EdgeRotations,
    Lift,
    MirroredFactors,
    NoFactors,
    NoLift,
    TurnedFactors,
    turns_clamps,
)
from shellbench.solvers.ndf.field.field import Features, FixedFeatures
from shellbench.solvers.ndf.field.geometry import LINE, side_lengths
from shellbench.solvers.ndf.field.inputs import Inputs, edge_layers, foci, seam_mirrors, strongest_curvature
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.lines import TOGETHER, Creases, Hinges, hinges_of
from shellbench.solvers.ndf.field.mirrors import Mirrors, mirrors_of, samples
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import ROUNDING, RuleSpec
from shellbench.solvers.ndf.field.strips import sides_along, strips_along


def field_mirrors(case: Case, spec: FieldSpec) -> Mirrors | None:
    """Return the planes of symmetry to build into a field; None if there are none, or if the choices exclude them.

    Only planes about which the boundary matrix is its own image are built in.
    """
    plain = spec.supports == "hard" and spec.components == "cartesian" and spec.periodic_input == "both"
    if not spec.mirrors or not plain or turns_clamps(case):
        return None
    found, factors = mirrors_of(case), BoundaryFactors(case, slopes=spec.slopes)

    def matrix(points: Array) -> Array:
        return factors.matrix(points, Placement(planes=1))[VALUE].numpy()

    points, kept = samples(found.domain), []
    for mirror in found.each:
        image = matrix(found.domain.wrap(mirror.image(points))) * mirror.signs[:, None] * mirror.signs
        if np.abs(image - matrix(points)).max() <= ROUNDING:
            kept.append(mirror)
    return replace(found, each=tuple(kept)) if kept else None


def build_inputs(case: Case, spec: FieldSpec) -> Inputs:
    """Return the input coordinates."""
    around = foci(case, spec.layer)
    asked = spec.edge_stretched and (spec.detail > 0 or not around)
    edges = edge_layers(case, flat=spec.detail > 0) if asked else None
    near = around if spec.stretched else ()
    hinged = tuple((hinge.axis, hinge.at) for hinge in (hinges_of(case) if spec.detail else ()))
    return Inputs.from_case(case, spec.periodic_input, near, edges, spec.slopes, field_mirrors(case, spec), hinged)


def build_features(case: Case, spec: FieldSpec, network: Network, placement: Placement, inputs: Inputs) -> Features:
    """Return the features of which the field is a linear combination."""
    # Other components, and soft supports, would need other powers.
    exact = spec.supports == "hard" and spec.components == "cartesian" and not turns_clamps(case)
    corners = CornerPowers.from_case(case, spec.detail) if exact and spec.detail else None
    creases = Creases(case.surface.domain, spec.creases) if spec.creases else None
    found = hinges_of(case) if spec.detail else ()
    hinges = Hinges(case, found) if found else None
    around = foci(case, spec.layer)
    mirrors, closed = field_mirrors(case, spec), seam_mirrors(case.surface.domain, spec.periodic_input)
    fixed = FixedFeatures.from_case(
        case, around, spec.multipliers, closed, corners, spec.slopes, creases, mirrors, hinges
    )
    return Features(inputs, network, fixed, placement)


def build_ansatz(case: Case, spec: FieldSpec) -> Ansatz:
    """Return the ansatz with the case's supports built in."""
    if spec.supports == "soft":
        return Ansatz(case, NoFactors(case, spec.components == "covariant"), NoLift(), spec.t, soft=True)
    if spec.vanishing:
        return Ansatz(case, NoFactors(case), NoLift(), spec.t)
    factors = BoundaryFactors(case, spec.components == "covariant", spec.slopes)
    if turns_clamps(case):
        turning = EdgeRotations(case, spec.t)
        return Ansatz(case, TurnedFactors(factors, turning), turning, spec.t)
    mirrors = field_mirrors(case, spec)
    held = factors if mirrors is None else MirroredFactors(factors, mirrors)
    return Ansatz(case, held, Lift(case, spec.t), spec.t, slopes=spec.slopes, mirrors=mirrors)


def focal_points(case: Case) -> Array:
    """Return the points (k, 2) toward which quadrature is graded."""
    return np.array([focus.xi for focus in foci(case)]).reshape(-1, 2)


def graded_points(case: Case, spec: FieldSpec) -> Array:
    """Return the points (k, 2) toward which the quadrature of a field is graded: forces, or else stretched edges.

    A coordinate without grading is NaN.
    """
    focal, domain = focal_points(case), case.surface.domain
    if len(focal) or not spec.edge_stretched or edge_layers(case) is None:
        return focal
    return np.where(domain.periodic, np.nan, np.array([domain.lower, domain.upper]))


# Standard deviations of the weights of plain inputs, on curved shells and on flat ones, and of stretched inputs. Tuned
# on the shells of the top. At a scale of 2 the certified energy of the Scordelis-Lo roof is higher by 4e-8, that of a
# pinched cylinder by 3e-5.
SCALE, FLAT_SCALE, STRETCHED_SCALE = 3.0, 3.5, 2.0
FLAT_NEURONS, CURVED_NEURONS = 120, 240  # of open shells without forces at points
# With folds: factors of the scale of plain inputs, and of the number of challengers. Waves run through a strip, not a
# side: with .7 the certified energies of a folded roof and of a frame are 8 and 14 times closer to the exact ones than
# with 1, and Raasch's hook's hardly differs; with .5 the roof gains again, and the frame loses. At ends of folds fields
# gain slowly.
SCALE_OF_STRIPS, CHALLENGED_STRIPS = 0.7, 2.0


@dataclass(frozen=True)
class Resolution:
    """Width and scales of random features, and the rules that they are integrated with.

    `along` multiplies the scale of the plain inputs of each coordinate; `edge_scale` is that of inputs stretched toward
    edges. The number of challengers that estimate the error is the `share` of the neurons.
    """

    neurons: int
    scale: float
    stretched_scale: float
    rule: RuleSpec
    fine: RuleSpec
    along: tuple[float, float] = (1.0, 1.0)
    edge_scale: float = 2.0
    share: float = 0.25  # neighbours are not on record

    def scales(self, inputs: Inputs) -> Array:
        """Return the standard deviation (n,) of the weights of each input."""
        plain = [1.0 if axis is None else self.scale * self.along[axis] for axis in inputs.axes]
        stretched = np.where(inputs.from_edges, self.edge_scale, self.stretched_scale)
        return np.where(inputs.stretched, stretched, plain)


def is_flat(case: Case) -> bool:
    """Return True if the midsurface has no curvature."""
    return not strongest_curvature(case)


def usual_resolution(case: Case) -> Resolution:
    """Return the default resolution of a case; between folds, each strip has as many neurons as an open side."""
    usual, strips = _without_folds(case), max(len(strips_along(case.surface, axis)) for axis in (0, 1))
    if not strips:
        return usual
    least = strips * (FLAT_NEURONS if is_flat(case) else CURVED_NEURONS)
    scale, share = SCALE_OF_STRIPS * usual.scale, CHALLENGED_STRIPS * usual.share
    return replace(usual, neurons=max(usual.neurons, least), scale=scale, share=share)


def _without_folds(case: Case) -> Resolution:
    flat = is_flat(case)
    if foci(case):
        neurons = 700 if any(case.surface.domain.periodic) else 300 if flat else 400
        rule, fine = (_around_points(case, panels, cuts) for panels, cuts in ((6, 1), (10, 2)))
        return Resolution(neurons, SCALE, STRETCHED_SCALE, rule, fine)
    if flat:
        neurons = 240 if any(case.surface.domain.periodic) else FLAT_NEURONS  # a whole turn is twice as long as a side
        panels = 8 if any(case.surface.domain.periodic) else 5
        return Resolution(neurons, FLAT_SCALE, STRETCHED_SCALE, _rule(case, panels, 6), _rule(case, panels + 1, 7))
    return Resolution(CURVED_NEURONS, SCALE, STRETCHED_SCALE, _rule(case, 8, 6, 2.0), _rule(case, 11, 7, 2.0, 1))


# Widths of the levels of a path, in units of the usual width. The last one is also that of very long strips.
WIDTHS = (0.5, 1.0, 2.0, 3.5)
# By level, the factor of the scale along the longer side of a flat shell, at most; and the powers of the sides' ratio
# by which scales follow it along and across. They are for strips that coil; neighbours are not on record.
LENGTHENED = (1.0, 1.0, 2.5, 5.0, math.inf)
LENGTHWAYS, CROSSWAYS = 0.6, -0.25


def path_level_count(case: Case) -> int:
    """Return the number of levels of a path.

    With forces at points the first levels are already wide, and there is one less. The last level is for strips so long
    that the scales of the others do not suit their sides.
    """
    usual = len(LENGTHENED) - 1
    if foci(case):
        return usual - 1
    return usual + (is_flat(case) and _slenderness(case) ** LENGTHWAYS > LENGTHENED[usual - 1])


def first_path_level(case: Case) -> int:
    """Return the first useful level of a path: half of the usual width can't represent waves of a buckled shell."""
    return int(case.path.after_buckling == "follow")


POINT_GRADING = 1.5  # of panels toward a force at a point, beside its cuts; not on record


def _slenderness(case: Case) -> float:
    lengths = side_lengths(case)
    return max(lengths) / min(lengths)


def path_resolution(case: Case, number: int) -> Resolution:
    """Return one of ever finer resolutions for large displacements.

    Linear theory does not predict the coiling of a thin strip, so that finer levels refine its length more than its
    width.
    """
    usual = usual_resolution(case)
    neurons = usual.neurons * 3 // 4 if foci(case) else usual.neurons
    less = int(number == 0 or (number == 1 and not foci(case)))
    rule = replace(usual.rule, order=usual.rule.order - less)  # fewer features need fewer points
    finer = replace(usual, neurons=round(WIDTHS[min(number, len(WIDTHS) - 1)] * neurons), rule=rule)
    longer = int(np.argmax(side_lengths(case)))
    factor = min(_slenderness(case) ** LENGTHWAYS, LENGTHENED[number])
    if factor == 1.0 or not is_flat(case):
        return finer
    along = [factor ** (CROSSWAYS / LENGTHWAYS)] * 2
    along[longer] = factor
    rules = [_lengthened(spec, longer, factor) for spec in (rule, usual.fine)]
    return replace(finer, along=(along[0], along[1]), rule=rules[0], fine=rules[1])


def _lengthened(spec: RuleSpec, axis: int, factor: float) -> RuleSpec:
    panels = [spec.panels[0], spec.panels[1]]
    panels[axis] = round(panels[axis] * factor)
    return replace(spec, panels=(panels[0], panels[1]))


def _rule(case: Case, panels: int, order: int, grading: float = 1.0, cuts: int = 0) -> RuleSpec:
    """Return a rule with twice the panels along a periodic coordinate, whose inputs run through a whole turn.

    Each strip between folds has as many panels as a side.
    """
    first, second = (panels * sides for sides in sides_along(case.surface))
    return RuleSpec((first, second), order, grading, cuts, joints=joints_of(case))


def joints_of(case: Case) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the values of xi1 and of xi2 at which panels end: kinks, and ends of cells that tell a stiffness."""
    stiff = [f.division for f in case.features if f.role == "stiffness"]
    narrow = [[at for d in stiff for at in d.ends(axis)[::TOGETHER].tolist()] for axis in (0, 1)]
    for hinge in hinges_of(case):
        narrow[hinge.axis] += hinge.breaks[1:-1].tolist()
    first, second = (tuple(sorted({*kinks, *ends})) for kinks, ends in zip(case.kinks, narrow, strict=True))
    return first, second


def _around_points(case: Case, panels: int, cuts: int) -> RuleSpec:
    """Return a rule that is cut at focal points, with more panels in proportion to the stretch of the coordinates."""
    spec = _rule(case, panels, 7, POINT_GRADING, cuts)
    first, second = (round(n * uneven) for n, uneven in zip(spec.panels, unevenness(case), strict=True))
    return replace(spec, panels=(first, second), point_cuts=cuts)


def unevenness(case: Case) -> tuple[float, float]:
    """Return, for each coordinate, the largest ratio of its speed to the mean one along the same line."""
    points = case.surface.domain.grid(LINE, LINE)
    x = case.surface.derivatives(points, 1)
    speeds = [np.linalg.norm(x[key], axis=-1) for key in ((1, 0), (0, 1))]
    first, second = (float((s / s.mean(axis=axis, keepdims=True)).max()) for axis, s in enumerate(speeds))
    return first, second
