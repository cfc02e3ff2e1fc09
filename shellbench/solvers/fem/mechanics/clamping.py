"""Conditions of a clamp between the nodes: Nitsche's method holds the rotation about a curved edge weakly.

Ties hold the rotation about a clamped edge and its derivative at every node. If the normal keeps its direction along
the edge, this holds the rotation everywhere. If the normal turns, the rotation is a cubic times a varying normal and
need not vanish between the nodes. The moment of the clamp opens it there, and the answer has an error of first order in
the mesh size (with a small factor, the square of thickness over length). The terms

    integral of  m(u) theta(v) + m(v) (theta(u) - theta0) + k (theta(u) - theta0) theta(v),     k = gamma B / h,

along the edge remove this error: theta = u,n . a3 is the rotation about the edge, m = m^ab n_a n_b the bending moment
of the field itself, n the outward conormal. The terms vanish for the exact solution, so that the order of the element
is kept.

Nitsche (1971), Über ein Variationsprinzip zur Lösung von Dirichlet-Problemen, Abh. Math. Sem. Hamburg 36.

A clamp at finite strain, between the nodes: Nitsche's terms for the exact bending strain.

On an edge whose position is prescribed the deformed surface is normal to the carried normal N' = R a3 where

    theta(u) = n^a (x,a + u,a) . N' = 0,

n the outward conormal of the reference. The ties hold theta at the nodes; as above, the potential

    integral of  m(u) theta(u) + k theta(u)^2 / 2,    m = B H^{abcd} kappa_cd n_a n_b,    k = gamma B / h,

along the edge removes the same error between them. Its first variation vanishes for the exact solution, because m is
the moment of the clamp on theta.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.places import Edge
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS, BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.mechanics.bubble_conditions import GAUSS_POINTS, constant_normal
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    GRADIENT,
    Deformation,
    Midsurface,
    elasticities,
    outward_conormal,
    stiffness_moduli,
    strain_operator,
)
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, KINDS, Derivative, kind_scales, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import EdgeRule

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FIRST: tuple[Derivative, Derivative] = ((1, 0), (0, 1))
# Of Nitsche's terms. Below 4, the constant of the inverse inequality of a moment that is linear across the cell, the
# energy has no minimum; far above, K is ill-conditioned. Any value between gives the same rate.
GAMMA = 20.0


@dataclass(frozen=True)
class ClampedEdge:
    """A clamped edge on which the normal turns: c cells with g Gauss points each.

    Attributes
    ----------
    cells
        (c,) numbers of the cells.
    nodes
        (c, 4) their corners.
    tilt, moment
        (c, g, 48) rows of theta and m on the cells' scaled degrees of freedom: component, corner, kind.
    target
        (c, g, states) theta0.
    weights, spring
        (c, g) length of edge, and (c, 1) k.
    """

    cells: Integers
    nodes: Integers
    tilt: Array
    moment: Array
    target: Array
    weights: Array
    spring: Array

    @classmethod
    def on_edge(
        cls, case: Case, mesh: TensorMesh, support: Support, edge: Edge, states: Sequence[float]
    ) -> ClampedEdge | None:
        """Integrate along an edge; None where its normal keeps its direction."""
        # 1. Find Gauss points on the edge, and the geometry there. If the normal keeps its direction, return None.
        # 2. theta = n^a u,a . a3 and m = B H^{abcd} kappa_cd n_a n_b, as rows on the derivatives of u.
        # 3. theta0, the same rotation of the prescribed motion.
        # 4. Convert both to rows on the cells' degrees of freedom, with the length of edge and the spring k.
        # In the textbook, Nitsche's terms replace a strong condition. Here the ties hold theta strongly at the nodes,
        # and the terms act on the gap between nodes only.
        if constant_normal(case, mesh, edge) is not None:
            return None
        rule = EdgeRule.on_edge(mesh, edge, GAUSS_POINTS)
        surface = Midsurface.from_position(case.surface.derivatives(rule.points, order=2))
        outward = outward_conormal(surface, edge)
        parts = np.einsum("pai,pi->pa", surface.base, outward)  # n_a
        raised = np.einsum("pab,pb->pa", surface.contravariant_metric, parts)  # n^a

        material = case.material
        turning = np.zeros((len(rule.points), COMPONENTS, len(DERIVATIVES)))
        turning[:, :, :2] = surface.normal[:, :, None] * raised[:, None, :]
        # kappa = bbar - b gives m theta a plus, where textbooks with kappa = +u,ab have a minus.
        pairs = np.stack([parts[:, 0] ** 2, parts[:, 1] ** 2, parts[:, 0] * parts[:, 1]], axis=-1)
        bending = strain_operator(surface)[:, 3:]
        stresses = np.einsum("ps,pst->pt", pairs, elasticities(surface, material)[:, 1])
        bent = stiffness_moduli(case.surface, material, rule.points)[:, 1]
        moments = np.einsum("p,pt,ptcd->pcd", bent, stresses, bending)
        target = []
        for t in states:
            motion = case.motion(support, edge, rule.points, t, order=1)
            target.append(sum(raised[:, a] * np.sum(motion[d] * surface.normal, axis=-1) for a, d in enumerate(FIRST)))

        per_cell = (len(rule.cells), GAUSS_POINTS)
        lengths = np.linalg.norm(surface.base[:, 1 - edge.axis], axis=-1).reshape(per_cell)
        # k ~ B / h by the inverse inequality: h is the cell's extent across the edge, not along it.
        height = (surface.area.reshape(per_cell) / lengths).mean(axis=1) * rule.sizes[:, edge.axis]
        return cls(
            cells=rule.cells,
            nodes=mesh.nodes[rule.cells],
            tilt=_rows_on_dofs(mesh, rule, turning),
            moment=_rows_on_dofs(mesh, rule, moments),
            target=np.stack(target, axis=-1).reshape(*per_cell, -1),
            weights=lengths * rule.weights / 2 * rule.sizes[:, 1 - edge.axis, None],
            spring=GAMMA
            * ((mesh.degree - 1) / 2) ** 2
            * bent.reshape(per_cell).max(axis=1, keepdims=True)
            / height[:, None],
        )

    def add_to(self, matrix: BlockMatrix | CellMatrices) -> None:
        """Add the terms to a stiffness matrix, in place."""
        # The bilinear form m(u) theta(v) + theta(u) m(v) + k theta(u) theta(v): symmetric, as Cholesky needs.
        weighted = self.tilt * self.weights[..., None]
        crossed = np.swapaxes(self.moment, 1, 2) @ weighted
        held = np.swapaxes(self.tilt, 1, 2) @ (weighted * self.spring[..., None])
        shape = (COMPONENTS, len(CORNERS), self.kinds)
        terms = (crossed + np.swapaxes(crossed, 1, 2) + held).reshape(-1, *shape, *shape)
        if isinstance(matrix, CellMatrices):
            matrix.add(self.cells, terms)
        else:
            add_cell_matrices(matrix.blocks, self.nodes, terms)

    @property
    def kinds(self) -> int:
        """Numbers that a node carries of each component."""
        return int(self.tilt.shape[-1]) // (COMPONENTS * len(CORNERS))

    def right_hand_side(self, node_count: int) -> Array:
        """Return the nodal forces (nodes, 12, states) of the prescribed rotation."""
        # The same terms with theta0 for theta(u), on the right-hand side.
        rows = self.moment + self.tilt * self.spring[..., None]
        return self._nodal_forces(rows, self.target, node_count)

    def gap_forces(self, q: Array) -> Array:
        """Return the nodal forces (nodes, 12, states) of the moments on the remaining gap theta - theta0."""
        local = q[self.nodes].reshape(len(self.nodes), len(CORNERS), COMPONENTS, self.kinds, -1)
        # The clamp exerts m and k times the gap. The term m(v) gap is no force of it, and must not count as a reaction.
        gap = self.tilt @ np.swapaxes(local, 1, 2).reshape(len(self.nodes), self.tilt.shape[-1], -1) - self.target
        return self._nodal_forces(self.moment, gap, len(q))

    def transposed_gap(self, q: Array) -> Array:
        """Return the transpose (nodes, 12) of `gap_forces`, less its constant part, applied to a motion (nodes, 12)."""
        local = q[self.nodes].reshape(len(self.nodes), len(CORNERS), COMPONENTS, self.kinds)
        moments = self.moment @ np.swapaxes(local, 1, 2).reshape(len(self.nodes), -1, 1)
        return self._nodal_forces(self.tilt, moments, len(q))[..., 0]

    def _nodal_forces(self, rows: Array, values: Array, node_count: int) -> Array:
        work = np.swapaxes(rows, 1, 2) @ (values * self.weights[..., None])
        local = work.reshape(len(self.nodes), COMPONENTS, len(CORNERS), self.kinds, -1)
        carried = COMPONENTS * self.kinds
        result = np.zeros((node_count, carried, values.shape[-1]))
        for corner in range(len(CORNERS)):
            result[self.nodes[:, corner]] += local[:, :, corner].reshape(len(local), carried, -1)
        return result


def clamped_edges(case: Case, mesh: TensorMesh, states: Sequence[float]) -> Iterator[ClampedEdge]:
    """Yield the clamped edges of a case on which the normal turns."""
    for support, place in case.supported_places():
        if support.clamped and isinstance(place, Edge):
            edge = ClampedEdge.on_edge(case, mesh, support, place, states)
            if edge is not None:
                yield edge


def _derivative_tables(mesh: TensorMesh, rule: EdgeRule) -> tuple[Array, Array, Array]:
    """Return the tables that map cells' degrees of freedom to the derivatives of u at points of an edge.

    These are the derivatives (g, 5, 4, 4) of the unit cell's basis, the powers (c, 5) of the cells' sizes that divide
    them, and the factors (c, 4, 4) from the nodes' scaled degrees of freedom to those of the cells.
    """
    # The nodes' are the same for neighbouring cells of other sizes.
    table = np.stack([tabulate(rule.unit, d, mesh.basis) for d in DERIVATIVES], axis=1)
    powers = np.stack([rule.sizes[:, 0] ** i * rule.sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1)
    return table, powers, kind_scales(rule.sizes, mesh.basis)[:, None] / mesh.node_scales[mesh.nodes[rule.cells]]


def _rows_on_dofs(mesh: TensorMesh, rule: EdgeRule, rows: Array) -> Array:
    """Turn rows (points, 3, 5) on the derivatives of u into rows (cells, g, 48) on the degrees of freedom."""
    table, powers, scales = _derivative_tables(mesh, rule)
    shape = len(rule.cells), len(rule.unit)
    local = rows.reshape(*shape, COMPONENTS, -1) / powers[:, None, None]
    return np.asarray(np.einsum("egcd,gdak,eak->egcak", local, table, scales).reshape(*shape, -1))


LOCAL = COMPONENTS * len(CORNERS) * len(KINDS)  # degrees of freedom of a cell


@dataclass(frozen=True)
class FiniteClamp:
    """A clamped edge on which the normal turns, at finite strain: c cells with g Gauss points each, n = c g points.

    Attributes
    ----------
    support
        The support that clamps it.
    nodes
        (c, 4) corners of its cells.
    reference
        Geometry at the points.
    rows
        (c, g, 15, 48) from a cell's scaled degrees of freedom to the derivatives of u.
    raised
        (n, 2) n^a.
    moments
        (n, 3) from the bending strains to m.
    weights, spring
        (n,) length of edge, and k.
    """

    case: Case
    support: Support
    nodes: Integers
    reference: Midsurface
    rows: Array
    raised: Array
    moments: Array
    weights: Array
    spring: Array

    @classmethod
    def on_edge(cls, case: Case, mesh: TensorMesh, support: Support, edge: Edge) -> FiniteClamp | None:
        """Integrate along an edge; None where its normal keeps its direction."""
        # As in `ClampedEdge`, but with the derivatives of u kept apart from the strains: these are not linear here.
        # 1. Find Gauss points on the edge, and the geometry there. If the normal keeps its direction, return None.
        # 2. n^a for theta, and B H^{abcd} n_a n_b for m: both refer to the undeformed edge.
        # 3. Length of edge, and the spring k by the cell's extent across the edge.
        if constant_normal(case, mesh, edge) is not None:
            return None
        rule = EdgeRule.on_edge(mesh, edge, GAUSS_POINTS)
        surface = Midsurface.from_position(case.surface.derivatives(rule.points, order=2))
        parts = np.einsum("pai,pi->pa", surface.base, outward_conormal(surface, edge))  # n_a
        raised = np.einsum("pab,pb->pa", surface.contravariant_metric, parts)
        pairs = np.stack([parts[:, 0] ** 2, parts[:, 1] ** 2, parts[:, 0] * parts[:, 1]], axis=-1)
        tensor = elasticities(surface, case.material)[:, 1]
        lengths = np.linalg.norm(surface.base[:, 1 - edge.axis], axis=-1)
        share = (rule.weights / 2 * rule.sizes[:, 1 - edge.axis, None]).ravel()
        height = surface.area / lengths * np.repeat(rule.sizes[:, edge.axis], GAUSS_POINTS)
        bending = stiffness_moduli(case.surface, case.material, rule.points)[:, 1]
        return cls(
            case=case,
            support=support,
            nodes=mesh.nodes[rule.cells],
            reference=surface,
            rows=_derivative_rows(mesh, rule),
            raised=raised,
            moments=np.einsum("p,ps,pst->pt", bending, pairs, tensor),
            weights=lengths * share,
            spring=GAMMA * bending / height,
        )

    def deform_edge(self, q: Array, t: float) -> _MovedClamp:
        """Deform the edge; the support's normals have turned as at the load factor or time t."""
        local = q.reshape(-1, COMPONENTS, len(KINDS))[self.nodes]  # (c, 4, 3, 4)
        local = np.swapaxes(local, 1, 2).reshape(len(self.nodes), 1, LOCAL, 1)
        gradients = (self.rows @ local).reshape(-1, len(DERIVATIVES), COMPONENTS)
        return _MovedClamp(self, Deformation.from_gradients(self.reference, gradients), self.case.turn(self.support, t))


@dataclass(frozen=True)
class _MovedClamp:
    clamp: FiniteClamp
    deformation: Deformation
    turn: Array

    @cached_property
    def tilt(self) -> Array:
        """(n, 15) first variation of theta, which is linear in u."""
        # The exact condition is x,a n^a . n = 0 with the deformed normal n, and not linear. Where the edge's position
        # is prescribed, n is the carried normal N', which is known. So theta becomes linear in u.
        normal = self.clamp.reference.normal @ self.turn.T
        rows = np.zeros((len(normal), len(DERIVATIVES), COMPONENTS))
        rows[:, :2] = self.clamp.raised[:, :, None] * normal[:, None, :]
        return rows.reshape(-1, GRADIENT)

    @cached_property
    def gap(self) -> Array:
        """(n,) theta."""
        # theta = n^a x,a . N' takes the deformed base vectors x,a, not u,a: it has no target to subtract.
        base = np.concatenate([self.deformation.current.base, np.zeros((len(self.tilt), 3, COMPONENTS))], axis=1)
        return np.asarray(np.sum(self.tilt * base.reshape(-1, GRADIENT), axis=-1))

    @cached_property
    def moment(self) -> Array:
        """(n,) m, N."""
        return np.asarray(np.sum(self.clamp.moments * self.deformation.strains[:, 3:], axis=-1))

    @cached_property
    def moment_rate(self) -> Array:
        """(n, 15) first variation of m."""
        return np.asarray((self.clamp.moments[:, None] @ self.deformation.operator[:, 3:])[:, 0])

    @property
    def potential(self) -> float:
        """The terms' potential, J."""
        clamp = self.clamp
        return float(clamp.weights @ (self.moment * self.gap + clamp.spring / 2 * self.gap**2))

    def gradient(self, node_count: int) -> Array:
        """Return the first variation of the potential (nodes, 12)."""
        # dJ = (m + k theta) dtheta + theta dm: the force of the clamp, and the term that makes the form symmetric.
        held = (self.moment + self.clamp.spring * self.gap)[:, None] * self.tilt
        return self._nodal_forces(held + self.gap[:, None] * self.moment_rate, node_count)

    def gap_forces(self, node_count: int) -> Array:
        """Return the part of the gradient (nodes, 12) that is no force of the support: moments on the gap."""
        return self._nodal_forces(self.gap[:, None] * self.moment_rate, node_count)

    def add_tangent(self, matrix: BlockMatrix) -> None:
        """Add the second variation, in place."""
        clamp = self.clamp
        # d2J = theta d2m + dm dtheta + dtheta dm + k dtheta dtheta, since d2theta = 0. m is linear in the bending
        # strain. So theta d2m is the geometric part of a stress theta B H n n.
        resultants = np.concatenate([np.zeros_like(clamp.moments), self.gap[:, None] * clamp.moments], axis=1)
        form = self.deformation.second_variation(resultants)
        crossed = self.moment_rate[:, :, None] * self.tilt[:, None, :]
        form += crossed + np.swapaxes(crossed, 1, 2)
        form += clamp.spring[:, None, None] * self.tilt[:, :, None] * self.tilt[:, None, :]
        form = (form * clamp.weights[:, None, None]).reshape(*clamp.rows.shape[:2], GRADIENT, GRADIENT)
        blocks = (np.swapaxes(clamp.rows, 2, 3) @ form @ clamp.rows).sum(axis=1)
        shape = (COMPONENTS, len(CORNERS), len(KINDS))
        add_cell_matrices(matrix.blocks, clamp.nodes, blocks.reshape(-1, *shape, *shape))

    def _nodal_forces(self, work: Array, node_count: int) -> Array:
        clamp = self.clamp
        weighted = (work * clamp.weights[:, None]).reshape(*clamp.rows.shape[:2], 1, GRADIENT)
        # At one corner of all cells no node occurs twice, so that indexed addition is complete.
        local = (weighted @ clamp.rows).sum(axis=(1, 2)).reshape(-1, COMPONENTS, len(CORNERS), len(KINDS))
        result = np.zeros((node_count, NODE_DOFS))
        for corner in range(len(CORNERS)):
            result[clamp.nodes[:, corner]] += local[:, :, corner].reshape(-1, NODE_DOFS)
        return result


def finite_clamps(case: Case, mesh: TensorMesh) -> Iterator[FiniteClamp]:
    """Yield the clamped edges of a case on which the normal turns."""
    for support, place in case.supported_places():
        if support.clamped and isinstance(place, Edge):
            clamp = FiniteClamp.on_edge(case, mesh, support, place)
            if clamp is not None:
                yield clamp


def _derivative_rows(mesh: TensorMesh, rule: EdgeRule) -> Array:
    """Return the maps (c, g, 15, 48) from cells' scaled degrees of freedom to the derivatives of u at points."""
    table, powers, scales = _derivative_tables(mesh, rule)
    shape = len(rule.cells), len(rule.unit)
    rows = np.zeros((*shape, len(DERIVATIVES), COMPONENTS, COMPONENTS, len(CORNERS), len(KINDS)))
    scaled = table * scales[:, None, None] / powers[:, None, :, None, None]
    for c in range(COMPONENTS):
        rows[:, :, :, c, c] = scaled
    return rows.reshape(*shape, GRADIENT, LOCAL)
