"""Stress resultants, by derivatives of a displacement that is brought into equilibrium again on a patch.

The energy of a field over a whole shell settles while its second and third derivatives still have errors, mostly at
edges, since rough combinations of features cost hardly any energy. Therefore, about a point,

    u = lift + M (Q + bubble P),

with the boundary matrix M of the shell's supports and polynomials Q and P. Q is fitted to the field, in displacements,
and P makes the energy of the patch least; the bubble vanishes with its slope at sides inside the shell. Then a(u, v) =
l(v) for all v = M bubble P, and at a supported edge the moment and the shear force of u are the reaction of the
support. Errors of the field at the patch's rim are smoothed toward its middle.

Two degrees of the polynomials give the uncertainty. If they differ, as in layers at edges, the patch is halved.

Membrane forces and moments consist of first and second derivatives of the displacement, which are exact. In contra-
variant components n = D H eps and m = B H kappa; with e_1 along a_1 and e_2 = a_3 x e_1 they become physical ones.
Shear forces need the moments' slopes, third derivatives of the displacement, but jets end at the second. Therefore
moments are taken at Chebyshev points of a short line through the point, along either coordinate, and the polynomial
through them is differentiated. A field is smooth, and on so short a line the polynomial's error is below rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.polynomial import chebyshev, legendre
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.places import SIDES, Edge, Point
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.choices import StrainName
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import PLANES, VALUE, Array, Placement, matrix_product
from shellbench.solvers.ndf.field.quadrature import ROUNDING, Rule, line_rule
from shellbench.solvers.ndf.field.supports import edge_supports
from shellbench.solvers.ndf.linear.regularised import JITTER, RegularisedInverse
from shellbench.solvers.ndf.strains.energy import add_gram, strain_matrix, symmetric, tables, value_vector
from shellbench.solvers.ndf.strains.strain_measures import Undeformed, stresses

SIDES_OF_PATCHES = (3 / 8, 3 / 16, 3 / 32)  # in sides of the shell
STEPS = 3  # patches begin at every third of their side, so that points lie near their middle
PATCH_DEGREES = (8, 10)  # of Q along each side
BUBBLE_DEGREES = 2  # degrees of P
PATCH_ORDER = 16  # Gauss points along a side of the patch, beside one a degree
AGREED = 1e-4  # difference of both degrees, relative to a point's largest component: a tenth of gates' tolerance
LINE_NODES = 9  # moments on a line, through which the polynomial goes
HALF_LINE = 0.02  # of a side: half the length of a line; shorter ones magnify rounding, longer ones no longer fit


@dataclass(frozen=True)
class Patch:
    """A part [lower, upper] of the parametric rectangle; `inner` are its sides (axis, side) inside the shell."""

    lower: tuple[float, float]
    upper: tuple[float, float]
    inner: frozenset[tuple[int, str]]

    def jets(self, points: Array, degree: int, placement: Placement) -> Tensor:
        """Return the jets (6, N, M) of bubble times Legendre polynomials at points (N, 2)."""
        tables = []
        for axis in (0, 1):
            half = (self.upper[axis] - self.lower[axis]) / 2
            y = (points[:, axis] - self.lower[axis]) / half - 1
            bubble: Array = np.ones(1)
            for side, root in zip(SIDES, ((0.5, 0.5), (0.5, -0.5)), strict=True):
                if (axis, side) in self.inner:
                    bubble = np.asarray(legendre.legmul(bubble, legendre.legmul(root, root)), dtype=float)
            series = [legendre.legmul(bubble, one) for one in np.eye(degree + 1)]
            columns = [[legendre.legval(y, legendre.legder(s, k)) for s in series] for k in range(3)]
            tables.append([np.stack(order, axis=-1) / half**k for k, order in enumerate(columns)])
        jets = [np.einsum("ni,nj->nij", tables[0][a], tables[1][b]).reshape(len(points), -1) for a, b in PLANES]
        return placement.tensor(np.stack(jets))

    def rule(self, order: int) -> Rule:
        """Return Gauss points of the patch."""
        (x, v), (y, w) = (line_rule(np.array(ends), order) for ends in zip(self.lower, self.upper, strict=True))
        return Rule(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(v, w).ravel())

    def contains(self, xi: tuple[float, float]) -> bool:
        """Return True if a point lies in the patch or on its rim."""
        return all(a <= at <= b for a, at, b in zip(self.lower, xi, self.upper, strict=True))


@dataclass(frozen=True)
class PatchField:
    """The displacement lift + M (Q + bubble P) on a patch; `output` (3, M) are the weights of Q, then of P."""

    ansatz: Ansatz
    patch: Patch
    degree: int
    output: Tensor

    def jet(self, points: Array) -> Tensor:
        """Return the jet (6, N, 3) of the displacement at points (N, 2) of the patch."""
        placement = Placement(self.output.device, self.output.dtype)
        free = (torch.cat(_bases(self.patch, self.degree, points, placement), dim=-1) @ self.output.T)[..., None]
        matrix = self.ansatz.factors.matrix(points, placement)
        return matrix_product(matrix, free)[..., 0] + self.ansatz.lift.jet(points, placement)


def _bases(patch: Patch, degree: int, points: Array, placement: Placement) -> tuple[Tensor, Tensor]:
    """Return the jets (6, N, .) of the basis functions of Q and bubble P."""
    plain = replace(patch, inner=frozenset())
    return plain.jets(points, degree, placement), patch.jets(points, degree + BUBBLE_DEGREES, placement)


@dataclass(frozen=True)
class Balance:
    """Maps from any field on a patch to Q and P.

    `fit` (F, N) maps the field's values at Gauss points (N, 2) to the weights of Q. The weights of P are `loaded` (U,)
    less `response` (U, 3 F) times those of Q.
    """

    points: Array
    fit: Tensor
    loaded: Tensor
    response: Tensor

    @classmethod
    def on(cls, ansatz: Ansatz, patch: Patch, degree: int, placement: Placement) -> Balance:
        """Find the maps for polynomials of a degree."""
        # 1. Fit M Q to M F at Gauss points by least squares.
        rule = patch.rule(degree + PATCH_ORDER)
        held = ansatz.factors.matrix(rule.points, placement)[VALUE]
        weights = (placement.tensor(rule.weights) * (held * held).sum(dim=(1, 2))).sqrt()[:, None]
        plain = replace(patch, inner=frozenset()).jets(rule.points, degree, placement)[VALUE]
        basis, triangle = torch.linalg.qr(weights * plain)
        fit = torch.linalg.solve_triangular(triangle, (weights * basis).T, upper=True)
        # 2. Find P by Ritz's method: K P = f - C Q.
        unknowns, fitted = 3 * (degree + BUBBLE_DEGREES + 1) ** 2, 3 * len(fit)
        stiffness, right = weights.new_zeros((unknowns, unknowns)), weights.new_zeros((unknowns, 1 + fitted))
        for points, table in tables(ansatz, rule, placement):
            of_q, of_p = _bases(patch, degree, points, placement)
            rows = strain_matrix(table, of_p)
            add_gram(stiffness, rows)
            right[:, 0] += value_vector(table.force, of_p[VALUE]) - rows.T @ table.offset.reshape(-1)
            right[:, 1:].addmm_(rows.T, strain_matrix(table, of_q))
        solved = RegularisedInverse.from_matrix(symmetric(stiffness), JITTER) @ right
        return cls(rule.points, fit, solved[:, 0], solved[:, 1:])

    def output(self, found: Field) -> Tensor:
        """Return the weights (3, M) of Q, then of P, that continue a field."""
        fitted = (self.fit @ (found.features.values(self.points) @ found.output.T)).T
        balanced = self.loaded - self.response @ fitted.reshape(-1)
        return torch.cat([fitted, balanced.view(3, -1)], dim=1)


Balances = dict[tuple[Patch, int], Balance]
"""By patch and degree: no field changes them, so that all fields of a case with the same supports may share them."""


@dataclass(frozen=True)
class Recovery:
    """Stress resultants of a field; `known` caches the solves on patches, for linear shells `at_rest` only."""

    found: Field
    measure: StrainName
    at_rest: bool
    balances: Balances = field(default_factory=dict)
    known: dict[Patch, tuple[PatchField, ...]] = field(default_factory=dict)

    def resultants(self, name: str, points: Array) -> Array:
        """Return resultants (2, N, 3), or shear forces (2, N, 2), at points (N, 2), by both degrees; see `RESULTANTS`.

        If no patch is possible, both are those of the field's own derivatives.
        """
        case = self.found.ansatz.case
        values = np.repeat(resultants(case, self.measure, self.found.jet, name, points)[None], 2, axis=0)
        differ = np.full(len(points), np.inf)
        for share in SIDES_OF_PATCHES:
            groups: dict[Patch, list[int]] = {}
            # Point by point, so that a patch does not depend on the other points.
            for k in np.flatnonzero(differ > AGREED * np.abs(values).max(axis=(0, 2))):
                groups.setdefault(self._patch(points[k], share), []).append(int(k))
            for patch, those in groups.items():
                if not (self.at_rest and self._fits_polynomials(patch)):
                    continue
                if patch not in self.known:
                    self.known[patch] = tuple(self._balance_patch(patch, degree) for degree in PATCH_DEGREES)
                both = np.stack([resultants(case, self.measure, u.jet, name, points[those]) for u in self.known[patch]])
                change = np.abs(both[1] - both[0]).max(axis=-1)
                better = change < differ[those]
                where = np.array(those)[better]
                values[:, where], differ[where] = both[:, better], change[better]
        return values

    def _balance_patch(self, patch: Patch, degree: int) -> PatchField:
        ansatz, key = self.found.ansatz, (patch, degree)
        if key not in self.balances:
            self.balances[key] = Balance.on(ansatz, patch, degree, self.found.features.placement)
        return PatchField(ansatz, patch, degree, self.balances[key].output(self.found))

    def _patch(self, point: Array, share: float) -> Patch:
        surface, ends, inner = self.found.ansatz.case.surface, [], set()
        domain = surface.domain
        for axis in (0, 1):
            step, most, place = share / STEPS, 1 - share, (point[axis] - domain.lower[axis]) / domain.size[axis]
            begin = round((place - share / 2) / step) * step
            folds = [
                (fold.at - domain.lower[axis]) / domain.size[axis] for fold in surface.fold_lines if fold.axis == axis
            ]
            if folds or not domain.periodic[axis]:  # patches lie beside folds
                cuts = np.unique([0.0, *folds, 1.0])
                number = int(np.clip(np.searchsorted(cuts, place, "right"), 1, len(cuts) - 1))
                low, high = cuts[number - 1], cuts[number]
                begin = float(min(max(begin, low), high - share))
            inside = (begin > ROUNDING, begin < most - ROUNDING)
            inner |= {(axis, s) for s, at in zip(SIDES, inside, strict=True) if at or domain.periodic[axis]}
            ends.append([domain.lower[axis] + domain.size[axis] * at for at in (begin, begin + share)])
        (a, b), (c, d) = ends
        return Patch((a, c), (b, d), frozenset(inner))

    def _fits_polynomials(self, patch: Patch) -> bool:
        """Return True if polynomials can fit a patch: no force or kink lies on it, nor a support beyond M."""
        ansatz, fixed = self.found.ansatz, self.found.features.fixed
        case = ansatz.case
        forced = {n for load in case.loads if isinstance(load, PointLoad | EdgeLoad | MomentLoad) for n in load.on}
        places = [*(case.places[n] for n in forced), *(place for _, place in case.supported_places())]
        on_points = any(isinstance(place, Point) and patch.contains(place.xi) for place in places)
        edges = {case.places[n] for n in forced} | {s.edge for s in edge_supports(case) if s.free}
        on_edges = any(isinstance(edge, Edge) and (edge.axis, edge.side) not in patch.inner for edge in edges)
        corner = all(len([a for a, _ in patch.inner if a == axis]) < len(SIDES) for axis in (0, 1))
        singular = fixed.creases is not None or (corner and fixed.corners is not None)
        slack = ROUNDING * np.asarray(case.surface.domain.size)  # of patches that end at a fold
        lower, upper = patch.lower + slack, patch.upper - slack
        kinks = any(lower[a] < at < upper[a] for a in (0, 1) for at in case.kinks[a])
        return not (ansatz.soft or on_points or on_edges or singular or kinks)


def resultants(case: Case, measure: StrainName, jet: Callable[[Array], Tensor], name: str, points: Array) -> Array:
    """Return resultants at points (N, 2) of a field with this displacement jet (6, N, 3); see `RESULTANTS`."""
    if name == "shear_force":
        return _shear_forces(case, measure, jet, points)
    surface, membrane, moments = _stress_resultants(case, measure, jet, points)
    frame = _frame_components(surface)
    full = _tensors(membrane if name == "membrane_force" else moments)
    turned = frame.mT @ full @ frame
    return np.asarray(torch.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], dim=-1).cpu().numpy())


def _stress_resultants(
    case: Case, measure: StrainName, jet: Callable[[Array], Tensor], points: Array
) -> tuple[Undeformed, Tensor, Tensor]:
    """Return the surface, and membrane forces and moments (N, 3) in contravariant components 11, 22, 12."""
    moved = jet(points)
    surface = Undeformed.at_points(case.surface, points, Placement(moved.device, moved.dtype))
    strains = surface.strained(measure, surface.gradients(moved)).strains
    # The strain 12 also counts for 21: conjugate to it is the component itself.
    found = stresses(surface.elasticity(case.material), strains)
    return surface, found[:, :3], found[:, 3:]


def _tensors(pairs: Tensor) -> Tensor:
    """Return tensors (N, 2, 2) of components 11, 22, 12 (N, 3)."""
    return pairs[:, [0, 2, 2, 1]].view(-1, 2, 2)


def _frame_components(surface: Undeformed) -> Tensor:
    """Return a_a . e_i (N, 2, 2)."""
    tangents = surface.geometry.tangents
    first = tangents[:, 0] / tangents[:, 0].norm(dim=-1, keepdim=True)
    second = torch.linalg.cross(surface.geometry.normal, first, dim=-1)
    return tangents @ torch.stack([first, second], dim=-1)


def _shear_forces(case: Case, measure: StrainName, jet: Callable[[Array], Tensor], points: Array) -> Array:
    """Return q_i (N, 2): q^a = m^ab,b + Gamma^a_bc m^cb + Gamma^b_bc m^ac, in the orthonormal frame."""
    surface, _, here = _stress_resultants(case, measure, jet, points)
    christoffel = surface.geometry.christoffel[:, [0, 2, 2, 1]].view(-1, 2, 2, 2)  # (N, b, c, a)
    moments = _tensors(here)
    total = torch.einsum("nbca,ncb->na", christoffel, moments) + torch.einsum("nbcb,nac->na", christoffel, moments)
    for axis in (0, 1):
        lines = [_line(case, axis, point) for point in points]
        along = np.repeat(points[:, None], LINE_NODES, axis=1)
        along[:, :, axis] = [nodes for nodes, _ in lines]
        _, _, there = _stress_resultants(case, measure, jet, case.surface.domain.wrap(along.reshape(-1, 2)))
        rows = here.new_tensor(np.array([row for _, row in lines]))
        total = total + torch.einsum("np,npa->na", rows, _tensors(there).view(len(points), LINE_NODES, 2, 2)[..., axis])
    return np.asarray((total[:, None] @ _frame_components(surface))[:, 0].cpu().numpy())


def _line(case: Case, axis: int, point: Array) -> tuple[Array, Array]:
    """Return coordinates (k,) of a line through a point, and the weights (k,) of the slope there."""
    domain = case.surface.domain
    size, kinks = domain.size[axis], case.kinks[axis]
    turns = [at + turn for turn in (-size, 0.0, size) for at in kinks]  # around a closed coordinate
    cuts = turns if domain.periodic[axis] else sorted((domain.lower[axis], *kinks, domain.upper[axis]))
    low = max((cut for cut in cuts if cut <= point[axis]), default=-np.inf)
    high = min((cut for cut in cuts if cut > point[axis]), default=np.inf)
    if not np.isfinite(high) and len(cuts) > 1:  # on the upper edge
        low, high = cuts[-2], cuts[-1]
    half = min(HALF_LINE * size, (high - low) / 2)
    middle = min(max(point[axis], low + half), max(high - half, low + half))
    nodes = chebyshev.chebpts1(LINE_NODES)
    slopes = [chebyshev.chebval((point[axis] - middle) / half, chebyshev.chebder(c)) for c in np.eye(LINE_NODES)]
    weights = np.array(slopes) @ np.linalg.inv(chebyshev.chebvander(nodes, LINE_NODES - 1)) / half
    return middle + half * nodes, weights
