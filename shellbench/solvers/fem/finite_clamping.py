"""A clamp at finite strain, between the nodes: Nitsche's terms for the exact bending strain.

On an edge whose position is prescribed the deformed surface is normal to the carried normal N' = R a3 where

    theta(u) = n^a (x,a + u,a) . N' = 0,

n the outward conormal of the reference. The ties hold theta at the nodes; as in `clamping`, the potential

    integral of  m(u) theta(u) + k theta(u)^2 / 2,    m = B H^{abcd} kappa_cd n_a n_b,    k = gamma B / h,

along the edge removes the pull of the moment m on what is left between them. Its first variation vanishes for the
exact solution, because m is what the clamp exerts on theta.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import Support
from shellbench.problems.shell.places import Edge
from shellbench.solvers.fem.assembly import COMPONENTS, NODE_DOFS, BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.clamping import GAMMA, GAUSS_POINTS, STRAIGHT, outward_conormal
from shellbench.solvers.fem.deformation import GRADIENT, Deformation
from shellbench.solvers.fem.hermite import CORNERS, KINDS, kind_scales, tabulate
from shellbench.solvers.fem.kinematics import DERIVATIVES, Midsurface, elasticity
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LOCAL = COMPONENTS * len(CORNERS) * len(KINDS)  # degrees of freedom of a cell


@dataclass(frozen=True)
class FiniteClamp:
    """A clamped edge on which the normal turns, at finite strain: c cells with g Gauss points each, n = c g points.

    Attributes
    ----------
    support
        What clamps it.
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
        # As `ClampedEdge.of`, but with the derivatives of u kept apart from the strains: these are not linear here.
        # 1. Gauss points on the edge, and the geometry there. An edge whose normal keeps its direction needs no terms.
        # 2. n^a for theta, and B H^{abcd} n_a n_b for m: both refer to the undeformed edge.
        # 3. Length of edge, and the spring k by the cell's extent across the edge.
        cells = mesh.edge_cells(edge)
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        unit = np.full((GAUSS_POINTS, 2), float(edge.side == "max"))
        unit[:, 1 - edge.axis] = (x + 1) / 2
        sizes = mesh.sizes[cells]
        flat = mesh.domain.wrap(mesh.origins[cells][:, None] + unit * sizes[:, None]).reshape(-1, 2)
        surface = Midsurface.at(case.surface.derivatives(flat, order=2))
        if np.ptp(surface.normal, axis=0).max() <= STRAIGHT:
            return None
        parts = np.einsum("pai,pi->pa", surface.base, outward_conormal(surface, edge))  # n_a
        raised = np.einsum("pab,pb->pa", surface.contravariant_metric, parts)
        pairs = np.stack([parts[:, 0] ** 2, parts[:, 1] ** 2, parts[:, 0] * parts[:, 1]], axis=-1)
        tensor = elasticity(surface, case.material.poissons_ratio)
        lengths = np.linalg.norm(surface.base[:, 1 - edge.axis], axis=-1)
        share = (w / 2 * sizes[:, 1 - edge.axis, None]).ravel()
        height = surface.area / lengths * np.repeat(sizes[:, edge.axis], GAUSS_POINTS)
        bending = case.material.bending_stiffness
        return cls(
            case=case,
            support=support,
            nodes=mesh.nodes[cells],
            reference=surface,
            rows=_derivative_rows(mesh, cells, unit),
            raised=raised,
            moments=bending * np.einsum("ps,pst->pt", pairs, tensor),
            weights=lengths * share,
            spring=GAMMA * bending / height,
        )

    def at(self, q: Array, t: float) -> _Clamped:
        """Deform the edge; the support has turned its normals as at the load factor or time t."""
        local = q.reshape(-1, COMPONENTS, len(KINDS))[self.nodes]  # (c, 4, 3, 4)
        local = np.swapaxes(local, 1, 2).reshape(len(self.nodes), 1, LOCAL, 1)
        gradients = (self.rows @ local).reshape(-1, len(DERIVATIVES), COMPONENTS)
        return _Clamped(self, Deformation.from_gradients(self.reference, gradients), self.case.turn(self.support, t))


@dataclass(frozen=True)
class _Clamped:
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
        return self._scattered(held + self.gap[:, None] * self.moment_rate, node_count)

    def gap_forces(self, node_count: int) -> Array:
        """Return the part of it (nodes, 12) that is no force of the support: of the moments in the gap."""
        return self._scattered(self.gap[:, None] * self.moment_rate, node_count)

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

    def _scattered(self, work: Array, node_count: int) -> Array:
        clamp = self.clamp
        weighted = (work * clamp.weights[:, None]).reshape(*clamp.rows.shape[:2], 1, GRADIENT)
        # Corner by corner no node occurs twice, so that indexed addition loses nothing.
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


def _derivative_rows(mesh: TensorMesh, cells: Integers, unit: Array) -> Array:
    """Return the maps (c, g, 15, 48) from cells' scaled degrees of freedom to the derivatives of u at points."""
    table = np.stack([tabulate(unit, d) for d in DERIVATIVES], axis=1)  # (g, 5, 4, 4)
    sizes = mesh.sizes[cells]
    steps = np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1)
    scales = kind_scales(sizes)[:, None] / mesh.node_scales[mesh.nodes[cells]]  # (c, 4, 4)
    rows = np.zeros((len(cells), len(unit), len(DERIVATIVES), COMPONENTS, COMPONENTS, len(CORNERS), len(KINDS)))
    scaled = table * scales[:, None, None] / steps[:, None, :, None, None]
    for c in range(COMPONENTS):
        rows[:, :, :, c, c] = scaled
    return rows.reshape(len(cells), len(unit), GRADIENT, LOCAL)
