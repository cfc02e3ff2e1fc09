"""Smooth trial functions: combinations of features with a limited number of waves, and rules that suit them.

Random features are nearly dependent, and their last independent combinations are rough. The combinations are ordered by
the scalar operator

    sum_a (L / L_a) d/dt_a ( t_a (1 - t_a) d/dt_a ),   t_a = 0 .. 1 along side a of length L_a, L the longest,

whose eigenfunctions along one side are Legendre's polynomials P_m, with the eigenvalues m (m + 1). Its weight vanishes
at the edges, so that it imposes no condition there, and smooth fields converge faster than any power of the degree.
Eigenfunctions of the plain stiffness have no slope across free edges, and converge as a power of the degree (Canuto et
al., Spectral Methods, 2006, section 2.3). A periodic side has the weight 1/4, which gives it waves of the same length.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.ansatz import Ansatz, Combined, FeatureSet, independent_combinations
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.inputs import Inputs
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Array, Placement
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import NOWHERE, Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.strains.strain_measures import Undeformed

WEIGHT_REACH = 2.5  # standard deviations of the weights within which waves of the highest degree are drawn
SURPLUS = 1.5  # random features, in products of degrees: with both, nine in ten polynomials of a degree are met
POINTS_A_DEGREE = 2.0  # Gauss points a degree, at first: strain energy is of the fourth degree in the field
PANEL_ORDER = 6  # Gauss points a panel
LONG_ORDER = 22  # the same for placed features: a few long panels crowd points at edges, where such fields vary most
LONG_SHARE = 3 / 4  # of the usual points: exact for third powers of the field; strain energy has fourth ones
PERIOD = 1.5  # of placed waves, in sides: longer ones depend more on each other, shorter ones fit edges worse
HIGHEST_PLACED = 1.5  # their highest frequency, over that of a polynomial of the degree in the middle of a side
CERTIFYING_PANELS = 1.25  # times as many panels, of the certificate, with one more point in each
SPRING = 1e-6  # relative error of the springs' whole stiffness that is negligible for the motion
MOST_PANELS = 64  # of a side, for springs


def degrees(case: Case, degree: int) -> tuple[float, float]:
    """Return the highest degree along each side, from that along the longest."""
    lengths = side_lengths(case)
    first, second = (max(1.0, degree * math.sqrt(length / max(lengths))) for length in lengths)
    return first, second


def width_for(case: Case, degree: int) -> int:
    """Return the number of random features that represent the fields up to a degree."""
    first, second = degrees(case, degree)
    return math.ceil(SURPLUS * (first + 1) * (second + 1))


def scales(case: Case, inputs: Inputs, degree: int) -> Array:
    """Return the standard deviation (n,) of the weights of each input."""
    along = degrees(case, degree)
    periodic = case.surface.domain.periodic
    plain = [
        along[axis] / (2 * math.pi if periodic[axis] else WEIGHT_REACH) for axis in inputs.axes if axis is not None
    ]
    return np.array(plain)


def placed_features(case: Case, inputs: Inputs, degree: int, placement: Placement) -> Network:
    """Return one layer of sines with the weights of a lattice, a Fourier series of a longer period (Huybrechs 2010).

    It has all waves up to a frequency, each as a sine and a cosine. Drawn weights leave gaps, more so at higher
    degrees. For degree 22, polynomials of .6 of it have errors of 4 %, here of .3 %; for degree 9, of .1 %, here of 2
    %.

    Raises
    ------
    InputError
        If a coordinate is periodic, since it enters as a cosine and a sine.
    """
    if inputs.axes != (0, 1):
        raise InputError(f'{case.name}: setting hidden = "placed" needs two coordinates that are not periodic')
    most = [max(1.0, HIGHEST_PLACED * PERIOD * along / math.pi) for along in degrees(case, degree)]
    reach = [range(-int(each), int(each) + 1) for each in most]
    waves = [
        (first, second)
        for first in reach[0]
        for second in reach[1]
        if (first, second) > (0, 0) and (first / most[0]) ** 2 + (second / most[1]) ** 2 <= 1  # half of the plane
    ]
    weight = placement.tensor(np.array(waves)) * (math.pi / PERIOD)
    phases = torch.tensor([0.0, math.pi / 2]).to(weight).repeat_interleave(len(weight))
    return Network((weight.repeat(2, 1),), (phases,))


def rule_of(case: Case, degree: int, points: float = POINTS_A_DEGREE, order: int = PANEL_ORDER) -> RuleSpec:
    """Return a rule with a number of points a degree that resolves the springs."""
    first, second = (math.ceil(points * along / order) for along in degrees(case, degree))
    spec = RuleSpec((first, second), order, joints=case.kinks)
    exact = _stiffness(case, replace(spec, panels=(MOST_PANELS, MOST_PANELS)))
    while max(spec.panels) < MOST_PANELS:
        if np.all(np.abs(_stiffness(case, spec) - exact) <= SPRING * exact):
            break
        spec = replace(spec, panels=(spec.panels[0] + 1, spec.panels[1] + 1))
    return spec


def finer(spec: RuleSpec) -> RuleSpec:
    """Return the finer rule that certifies another one."""
    panels = (math.ceil(CERTIFYING_PANELS * spec.panels[0]), math.ceil(CERTIFYING_PANELS * spec.panels[1]))
    return replace(spec, panels=panels, order=spec.order + 1)


def _stiffness(case: Case, spec: RuleSpec) -> Array:
    rule = area_rule(case.surface.domain, NOWHERE, spec)
    return np.asarray(rule.weights @ case.spring_stiffness(rule.points))


def smooth(ansatz: Ansatz, features: FeatureSet, rule: Rule, degree: int) -> Combined:
    """Return combinations of features up to a degree, orthonormal in the area with the boundary matrix included."""
    domain, placement = ansatz.case.surface.domain, features.placement
    jacobian = Undeformed.at_points(ansatz.case.surface, rule.points, placement).geometry.jacobian
    held = ansatz.factors.matrix(rule.points, placement)[VALUE]
    weights = placement.tensor(rule.weights) * jacobian * (held * held).sum(dim=(1, 2)) / 3
    jets = features.jets(rule.points)
    combine = orthonormal(jets, weights)
    lengths = side_lengths(ansatz.case)
    operator = combine.new_zeros((combine.shape[1],) * 2)
    for axis, plane in enumerate((D1, D2)):
        t = placement.tensor((rule.points[:, axis] - domain.lower[axis]) / domain.size[axis])
        weight = torch.full_like(t, 1 / 4) if domain.periodic[axis] else t * (1 - t)
        stretch = domain.size[axis] ** 2 * max(lengths) / lengths[axis]
        operator += _gram(jets[plane] @ combine, stretch * weight * weights)
    values, vectors = torch.linalg.eigh(operator)
    kept = values <= degree * (degree + 1)
    return Combined(features, combine @ vectors[:, kept])


def orthonormal(jets: Tensor, weights: Tensor) -> Tensor:
    """Return orthonormal combinations (M, r) of features with jets (6, N, M).

    The constant feature, the output layer's bias, is removed from the others and kept: otherwise a part of it might be
    left out as nearly dependent.
    """
    values = jets[VALUE]
    constant = torch.nonzero(jets[[D1, D2]].abs().amax(dim=(0, 1)) == 0)[:, 0]
    if not len(constant):
        return independent_combinations(_gram(values, weights))
    one = int(constant[0])
    level = values[:, one]
    squared = (weights * level) @ level
    less = torch.eye(values.shape[1]).to(values)
    less[one] -= (weights * level) @ values / squared
    less = less[:, torch.arange(values.shape[1]) != one]
    combine = less @ independent_combinations(_gram(values @ less, weights))
    first = torch.zeros_like(combine[:, :1])
    first[one] = squared**-0.5
    return torch.cat([first, combine], dim=1)


def _gram(values: Tensor, weights: Tensor) -> Tensor:
    product: Tensor = values.T @ (weights[:, None] * values)
    return (product + product.T) / 2
