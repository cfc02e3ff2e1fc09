"""Fields for motion: orthonormal in mass, ordered by how quickly they vary, and as smooth at edges as inside.

Random features are nearly dependent, and what they leave to tell apart at the end is rough. Their combinations are
ordered by the scalar operator

    sum_a (L / L_a) d/dt_a ( t_a (1 - t_a) d/dt_a ),   t_a = 0 .. 1 along side a of length L_a, L the longest,

whose eigenfunctions along one side are Legendre's polynomials P_m, with the eigenvalues m (m + 1). Because its weight
vanishes at the edges it asks for no condition there, so that smooth fields converge faster than any power of the
degree; eigenfunctions of the plain stiffness have no slope across free edges and converge as a power of it (Canuto et
al., Spectral Methods, 2006, section 2.3). A periodic side has the weight 1/4, which gives it waves of the same length.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.inputs import Inputs
from shellbench.solvers.ndf.jets import D1, D2, VALUE, Array
from shellbench.solvers.ndf.quadrature import Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.resolution import side_lengths
from shellbench.solvers.ndf.sampled import Combined, FeatureSet, independent
from shellbench.solvers.ndf.undeformed import Undeformed

REACH = 2.5  # standard deviations of the weights within which waves of the highest degree are drawn
SURPLUS = 1.5  # random features, in products of degrees: with both, nine in ten polynomials of a degree are met
POINTS = 2.0  # Gauss points a degree, at first: strain energy is of the fourth degree in the field
ORDER = 6  # Gauss points a panel
FINER = 1.25  # panels of the certificate
SPRING = 1e-6  # relative error of the springs' whole stiffness that is nothing to the motion
MOST_PANELS = 64  # of a side, for springs
NOWHERE = np.zeros((0, 2))


def degrees(case: Case, degree: int) -> tuple[float, float]:
    """Return the highest degree along each side, for that along the longest."""
    lengths = side_lengths(case)
    first, second = (max(1.0, degree * math.sqrt(length / max(lengths))) for length in lengths)
    return first, second


def widest(case: Case, degree: int) -> int:
    """Return the number of random features that hold the fields up to a degree."""
    first, second = degrees(case, degree)
    return math.ceil(SURPLUS * (first + 1) * (second + 1))


def scales(case: Case, inputs: Inputs, degree: int) -> Array:
    """Return the standard deviation (n,) of the weights of each input."""
    along = degrees(case, degree)
    periodic = case.surface.domain.periodic
    plain = [along[axis] / (2 * math.pi if periodic[axis] else REACH) for axis in inputs.axes if axis is not None]
    return np.array(plain)


def rule_of(case: Case, degree: int, points: float = POINTS) -> RuleSpec:
    """Return a rule of some points a degree that takes the springs in."""
    first, second = (math.ceil(points * along / ORDER) for along in degrees(case, degree))
    exact = _stiffness(case, RuleSpec((MOST_PANELS, MOST_PANELS), ORDER))
    while max(first, second) < MOST_PANELS:
        if np.all(np.abs(_stiffness(case, RuleSpec((first, second), ORDER)) - exact) <= SPRING * exact):
            break
        first, second = first + 1, second + 1
    return RuleSpec((first, second), ORDER)


def finer(spec: RuleSpec) -> RuleSpec:
    """Return the rule that another one is judged by."""
    return RuleSpec((math.ceil(FINER * spec.panels[0]), math.ceil(FINER * spec.panels[1])), spec.order + 1)


def _stiffness(case: Case, spec: RuleSpec) -> Array:
    rule = area_rule(case.surface.domain, NOWHERE, spec)
    return np.asarray(rule.weights @ case.spring_stiffness(rule.points))


def smooth(ansatz: Ansatz, features: FeatureSet, rule: Rule, degree: int) -> Combined:
    """Return combinations of features up to a degree, orthonormal in the area, the boundary matrix taken in."""
    domain, placement = ansatz.case.surface.domain, features.placement
    jacobian = Undeformed.at_points(ansatz.case.surface, rule.points, placement).geometry.jacobian
    held = ansatz.factors.matrix(rule.points, placement)[VALUE]
    weights = placement.tensor(rule.weights) * jacobian * (held * held).sum(dim=(1, 2)) / 3
    jets = features.jets(rule.points)
    combine = _independent(jets, weights)
    lengths = side_lengths(ansatz.case)
    operator = combine.new_zeros((combine.shape[1],) * 2)
    for axis, plane in enumerate((D1, D2)):
        t = placement.tensor((rule.points[:, axis] - domain.lower[axis]) / domain.size[axis])
        weight = torch.full_like(t, 0.25) if domain.periodic[axis] else t * (1 - t)
        stretch = domain.size[axis] ** 2 * max(lengths) / lengths[axis]
        operator += _gram(jets[plane] @ combine, stretch * weight * weights)
    values, vectors = torch.linalg.eigh(operator)
    kept = values <= degree * (degree + 1)
    return Combined(features, combine @ vectors[:, kept])


def _independent(jets: Tensor, weights: Tensor) -> Tensor:
    """Return orthonormal combinations (M, r) of features with jets (6, N, M).

    The constant one, the output layer's bias, is taken out of the others and kept: what is left out because it nearly
    depends on others would else be a part of it.
    """
    values = jets[VALUE]
    constant = torch.nonzero(jets[[D1, D2]].abs().amax(dim=(0, 1)) == 0)[:, 0]
    if not len(constant):
        return independent(_gram(values, weights))
    one = int(constant[0])
    level = values[:, one]
    squared = (weights * level) @ level
    less = torch.eye(values.shape[1]).to(values)
    less[one] -= (weights * level) @ values / squared
    less = less[:, torch.arange(values.shape[1]) != one]
    combine = less @ independent(_gram(values @ less, weights))
    first = torch.zeros_like(combine[:, :1])
    first[one] = squared**-0.5
    return torch.cat([first, combine], dim=1)


def _gram(values: Tensor, weights: Tensor) -> Tensor:
    product: Tensor = values.T @ (weights[:, None] * values)
    return (product + product.T) / 2
