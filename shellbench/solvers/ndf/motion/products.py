"""Products of placed waves: one hidden layer whose fields are computed by sums over one coordinate after the other.

A wave sin(k . xi + b) with k on a lattice is a sum of products of waves of xi1 and waves of xi2. Therefore the span of
placed waves (`smooth.placed_features`) consists of products phi_i(xi1) psi_j(xi2), where phi and psi combine waves of
one coordinate. With p of them a side, N = O(p^2) points of a product rule, and coefficients C, the field is

    u = Phi C Psi^T,    u,1 = Phi' C Psi^T,    and so on,

for O(p^3) operations (sum factorisation; Orszag 1980), where a table of all products takes O(p^4), and an orthonormal
basis of them O(p^6). Here the functions of each side are made orthonormal separately, smoothest functions first (the
operator of `smooth`), and products inherit both properties.

Products are ordered by their variation. A field of lower degree has the first of them, and does not change when
features are added.

With held edges, each side's functions are waves times the factor that vanishes at its held ends: the factor of a
rectangle is a product of such factors too (`factors.edge_factor`).

This requires one factor for all components, and a constant length of each coordinate: a plane whose edges are free, or
held as a whole and at rest, but not clamped. Points may be held, and springs may act.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.factors import Lift, edge_factor
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.inputs import Inputs
from shellbench.solvers.ndf.field.jets import COMPONENTS, D1, D2, D11, D22, VALUE, Array, Placement, product
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import line_rule
from shellbench.solvers.ndf.field.supports import edge_supports
from shellbench.solvers.ndf.strains.smooth import PERIOD, degrees, orthonormal

PLANES_ALONG = ((VALUE, D1, D11), (VALUE, D2, D22))  # planes of the derivatives along each side
HIGHEST_WAVE = (
    1.2  # highest frequency over the degree: with 1.5 steps of time are shorter by .6, and waves longer that are met
)
LINE_POINTS = 4  # Gauss points a degree on a line: products of two waves are integrated to rounding
PRODUCT_TENSORS = ("combine_1", "combine_2", "pairs", "degrees")  # tensors of a file, beside the network's
LOOKED_AT = 5  # points a side at which a case is looked at


def why_no_products(case: Case, spec: FieldSpec, inputs: Inputs) -> str | None:
    """Return the reason that a field is no sum of products of such functions, as one clause, or None if it is one."""
    if inputs.axes != (0, 1) or any(any(side) for side in inputs.even):
        return "its inputs are not the two coordinates alone"
    points = case.surface.domain.grid(LOOKED_AT, LOOKED_AT).reshape(-1, 2)
    if spec.components != "cartesian" or spec.supports != "hard":
        return "its components or supports are others"
    if Lift(case).moves:
        return "its edges are moved"
    everywhere = set(case.held_everywhere)
    for edge in edge_supports(case):
        if edge.slope or not edge.edge.whole or len(everywhere | set(edge.held)) < COMPONENTS:
            return "its edges are clamped, or held in parts or in some components"
    x = case.surface.derivatives(points, 2)
    straight = all(np.all(x[key] == 0) for key in ((2, 0), (1, 1), (0, 2)))
    if not straight or np.any(np.sum(x[1, 0] * x[0, 1], axis=-1)):
        return "its coordinates are not straight and at right angles"
    return None


@dataclass(frozen=True)
class Products:
    """Products of functions of one coordinate each, orthonormal in the area.

    Attributes
    ----------
    inputs
        The two coordinates, scaled to [-1, 1].
    network
        One layer of sines: waves of xi1, then waves of xi2.
    combine
        Combinations (waves, r) of them for each side, orthonormal on it, smoothest first.
    pairs
        (M, 2): numbers of the multiplied functions of the two sides, smoothest products first.
    degrees
        (M,): degree of each product, (m^2 + n^2)^(1/2) on a square if m and n functions of each side are smoother.
    placement
        Device and precision of the tensors.
    """

    inputs: Inputs
    network: Network
    combine: tuple[Tensor, Tensor]
    pairs: Tensor
    degrees: Tensor
    placement: Placement

    @property
    def count(self) -> int:
        """Number of products M."""
        return len(self.pairs)

    def up_to(self, degree: int) -> Products:
        """Return the products up to a degree, the first ones."""
        count = int((self.degrees <= degree).sum())
        return replace(self, pairs=self.pairs[:count], degrees=self.degrees[:count])

    def line(self, axis: int, at: Array) -> Tensor:
        """Return one side's functions with two derivatives (3, n, r) at values (n,) of its coordinate."""
        own = _waves_along(self.inputs, self.network, self.combine[0].shape[0], axis, at, self.placement)
        used = self.combine[axis][:, : int(self.pairs[:, axis].max()) + 1]
        return own @ used

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, M) at points (N, 2)."""
        (a, a1, a11), (b, b2, b22) = (self._lines(axis, points) for axis in (0, 1))
        return torch.stack([a * b, a1 * b, a * b2, a11 * b, a1 * b2, a * b22])

    def values(self, points: Array) -> Tensor:
        """Return the values (N, M) at points (N, 2)."""
        first, second = (self._lines(axis, points)[0] for axis in (0, 1))
        return first * second

    def _lines(self, axis: int, points: Array) -> Tensor:
        return self.line(axis, points[:, axis])[:, :, self.pairs[:, axis]]

    def tensors(self) -> dict[str, Tensor]:
        """Return the tensors of the products, beside the network's, by the names they have in a file."""
        pairs = self.pairs.to(self.degrees)
        return dict(zip(PRODUCT_TENSORS, (*self.combine, pairs, self.degrees), strict=True))

    @classmethod
    def from_tensors(cls, inputs: Inputs, network: Network, tensors: Mapping[str, Tensor]) -> Products:
        """Return the products of a file.

        Raises
        ------
        ValueError
            If its tensors do not match each other.
        """
        first, second, pairs, degrees = (tensors[name] for name in PRODUCT_TENSORS)
        if first.ndim != 2 or second.ndim != 2 or len(first) + len(second) != network.width:
            raise ValueError("its tensors do not fit each other")
        numbers = pairs.long()
        limits = numbers.new_tensor([first.shape[1], second.shape[1]])
        if (
            pairs.shape != (len(degrees), 2)
            or degrees.ndim != 1
            or not bool(((numbers >= 0) & (numbers < limits)).all())
        ):
            raise ValueError("its products do not fit their functions")
        return cls(inputs, network, (first, second), numbers, degrees, Placement(first.device, first.dtype))

    def on_grid(self, points: Array) -> Grid:
        """Return the products on a grid of points (n1 n2, 2), the second coordinate running first.

        Raises
        ------
        ValueError
            If the points are no such grid.
        """
        first, second = np.unique(points[:, 0]), np.unique(points[:, 1])
        grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
        if grid.shape != points.shape or not np.array_equal(grid, points):
            raise ValueError("products are summed on a grid of points alone")
        return Grid(self.line(0, first), self.line(1, second), self.pairs)


@dataclass(frozen=True)
class Grid:
    """Products on a grid: sums over one coordinate, and then over the other.

    Attributes
    ----------
    first, second
        (3, n, r): functions of the two sides with their first and second derivatives.
    pairs
        (M, 2): numbers of the multiplied functions.
    """

    first: Tensor
    second: Tensor
    pairs: Tensor

    def fields(self, output: Tensor) -> Tensor:
        """Return u, u,1, u,2, u,11, u,22, u,12 (N, 6, 3) for output weights (3, M)."""
        (_, n1, r1), (_, n2, r2) = self.first.shape, self.second.shape
        square = output.new_zeros((COMPONENTS, r1, r2))
        square[:, self.pairs[:, 0], self.pairs[:, 1]] = output
        half = (self.first.reshape(-1, r1) @ square).view(COMPONENTS, 3, n1, r2)
        b, b2, b22 = self.second.mT
        found = output.new_empty((n1, n2, 6, COMPONENTS))
        for plane, (along, other) in enumerate(((0, b), (1, b), (0, b2), (2, b), (0, b22), (1, b2))):
            found[:, :, plane] = (half[:, along] @ other).permute(1, 2, 0)
        return found.view(-1, 6, COMPONENTS)

    def pull_back(self, conjugate: Tensor) -> Tensor:
        """Return the vector (3, M) on the output weights of forces (N, 6, 3) conjugate to the fields."""
        (_, n1, r1), (_, n2, r2) = self.first.shape, self.second.shape
        u, u1, u2, u11, u22, u12 = conjugate.view(n1, n2, 6, COMPONENTS).permute(2, 3, 0, 1)
        b, b2, b22 = self.second
        half = torch.stack([u @ b + u2 @ b2 + u22 @ b22, u1 @ b + u12 @ b2, u11 @ b], dim=1)
        square = self.first.reshape(-1, r1).T @ half.view(COMPONENTS, -1, r2)
        return square[:, self.pairs[:, 0], self.pairs[:, 1]]


def product_features(case: Case, inputs: Inputs, degree: int, placement: Placement) -> Products:
    """Return the products of placed waves up to a degree along the longest side; see `why_no_products`."""
    # 1. Take, for each side, the waves of `placed_features` along it, including the constant.
    # 2. Form their independent combinations, orthonormal on the side, as eigenfunctions of the operator of `smooth`.
    # 3. Take all products up to the degree, smoothest first.
    along = degrees(case, degree)
    layers = [_waves(most, placement) for most in along]
    weights = [torch.stack([w, torch.zeros_like(w)][:: 1 - 2 * axis], dim=-1) for axis, (w, _) in enumerate(layers)]
    network = Network((torch.cat(weights),), (torch.cat([b for _, b in layers]),))
    first = len(layers[0][0])
    sides = [
        _orthonormal(case, inputs, network, first, axis, math.ceil(LINE_POINTS * along[axis]), placement)
        for axis in (0, 1)
    ]
    one, two = (degree / most * torch.arange(side.shape[1]) for most, side in zip(along, sides, strict=True))
    total = torch.hypot(one[:, None], two).flatten().to(sides[0])
    order = torch.argsort(total, stable=True)
    pairs = torch.stack([order // len(two), order % len(two)], dim=-1)
    return Products(inputs, network, (sides[0], sides[1]), pairs, total[order], placement).up_to(degree)


def _waves(degree: float, placement: Placement) -> tuple[Tensor, Tensor]:
    """Return weights and phases of one coordinate's waves: the constant, and a sine and a cosine of each frequency."""
    count = int(max(1.0, HIGHEST_WAVE * PERIOD * degree / math.pi))
    frequency = placement.tensor(np.arange(1.0, 1 + count)) * (math.pi / PERIOD)
    phases = frequency.new_tensor([0.0, math.pi / 2]).repeat_interleave(count)
    return torch.cat([frequency.new_zeros(1), frequency, frequency]), torch.cat([phases[-1:], phases])


def _waves_along(inputs: Inputs, network: Network, first: int, axis: int, at: Array, placement: Placement) -> Tensor:
    """Return one side's waves with two derivatives (3, n, waves), zero at its held ends, at values (n,)."""
    case = inputs.case
    points = np.tile(np.asarray(case.surface.domain.lower), (len(at), 1))
    points[:, axis] = at
    waves = network.features(inputs.jets(points, placement))
    own = waves[..., :first] if axis == 0 else waves[..., first:]
    held = {support.edge for support in edge_supports(case) if support.edge.axis == axis}
    if held:
        factor = edge_factor(case.surface.domain, held, inputs.even, points, placement)
        own = product(factor[..., None], own)
    return own[list(PLANES_ALONG[axis])]


def _orthonormal(
    case: Case, inputs: Inputs, network: Network, first: int, axis: int, order: int, placement: Placement
) -> Tensor:
    """Return combinations (waves, r) orthonormal on a side, in metres, smoothest first."""
    domain = case.surface.domain
    low, high, size = domain.lower[axis], domain.upper[axis], domain.size[axis]
    at, weights = line_rule(np.array([low, high]), order)
    own = _waves_along(inputs, network, first, axis, at, placement)
    share = placement.tensor(weights * (side_lengths(case)[axis] / size))
    combine = orthonormal(own, share)
    t = placement.tensor((at - low) / size)
    steep = own[1] @ combine
    operator = steep.T @ ((share * size**2 * t * (1 - t))[:, None] * steep)
    _, vectors = torch.linalg.eigh((operator + operator.T) / 2)
    functions: Tensor = (combine @ vectors).contiguous()
    return functions
