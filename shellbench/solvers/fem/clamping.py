"""What a clamp asks between the nodes: the rotation about a curved edge, held weakly by Nitsche's method.

Ties hold the rotation about a clamped edge and its derivative at every node. Where the normal keeps its direction
along the edge that holds it everywhere. Where the normal turns, the rotation is a cubic times a varying normal and can
still open between the nodes; the moment of the clamp pulls it open, and the answer is off by first order in the mesh
size (with a small factor, the square of thickness over length). The terms

    integral of  m(u) theta(v) + m(v) (theta(u) - theta0) + k (theta(u) - theta0) theta(v),     k = gamma B / h,

along the edge remove that pull: theta = u,n . a3 is the rotation about the edge, m = m^ab n_a n_b the bending moment
of the field itself, n the outward conormal. They vanish for the exact solution, so the order of the element is kept.

Nitsche (1971), Über ein Variationsprinzip zur Lösung von Dirichlet-Problemen, Abh. Math. Sem. Hamburg 36.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import Support
from shellbench.problems.shell.places import Edge
from shellbench.solvers.fem.assembly import COMPONENTS, NODE_DOFS, BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.hermite import CORNERS, KINDS, Derivative, kind_scales, tabulate
from shellbench.solvers.fem.kinematics import DERIVATIVES, Midsurface, elasticity, strain_operator
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FIRST: tuple[Derivative, Derivative] = ((1, 0), (0, 1))
GAUSS_POINTS = 6  # a cell's side
GAMMA = 20.0  # above 4, the inverse inequality of a moment that is linear across the cell, with room to spare
STRAIGHT = 1e-10  # change of the unit normal along an edge below which it keeps its direction


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
        # 1. Gauss points on the edge, and the geometry there. An edge whose normal keeps its direction needs no terms.
        # 2. theta = n^a u,a . a3 and m = B H^{abcd} kappa_cd n_a n_b, as rows on the derivatives of u.
        # 3. theta0, the same rotation of the prescribed motion.
        # 4. Both as rows on the cells' degrees of freedom, with the length of edge and the spring k.
        # Textbook Nitsche replaces a strong condition. Here the ties hold theta strongly at the nodes. The terms see
        # only the gap between nodes.
        cells = mesh.edge_cells(edge)
        # The edge is a side of the unit cell: 0 or 1 in its fixed coordinate, all of the other one.
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        unit = np.full((GAUSS_POINTS, 2), float(edge.side == "max"))
        unit[:, 1 - edge.axis] = (x + 1) / 2
        sizes = mesh.sizes[cells]
        flat = mesh.domain.wrap(mesh.origins[cells][:, None] + unit * sizes[:, None]).reshape(-1, 2)
        surface = Midsurface.at(case.surface.derivatives(flat, order=2))
        if np.ptp(surface.normal, axis=0).max() <= STRAIGHT:
            return None
        outward = outward_conormal(surface, edge)
        parts = np.einsum("pai,pi->pa", surface.base, outward)  # n_a
        raised = np.einsum("pab,pb->pa", surface.contravariant_metric, parts)  # n^a

        material = case.material
        turning = np.zeros((len(flat), COMPONENTS, len(DERIVATIVES)))
        turning[:, :, :2] = surface.normal[:, :, None] * raised[:, None, :]
        # kappa = bbar - b gives m theta a plus, where textbooks with kappa = +u,ab have a minus.
        pairs = np.stack([parts[:, 0] ** 2, parts[:, 1] ** 2, parts[:, 0] * parts[:, 1]], axis=-1)
        bending = strain_operator(surface)[:, 3:]
        stresses = np.einsum("ps,pst->pt", pairs, elasticity(surface, material.poissons_ratio))
        moments = material.bending_stiffness * np.einsum("pt,ptcd->pcd", stresses, bending)
        target = []
        for t in states:
            motion = case.motion(support, edge, flat, t, order=1)
            target.append(sum(raised[:, a] * np.sum(motion[d] * surface.normal, axis=-1) for a, d in enumerate(FIRST)))

        per_cell = (len(cells), GAUSS_POINTS)
        lengths = np.linalg.norm(surface.base[:, 1 - edge.axis], axis=-1).reshape(per_cell)
        # k ~ B / h by the inverse inequality: h is the cell's extent across the edge, not along it.
        height = (surface.area.reshape(per_cell) / lengths).mean(axis=1) * sizes[:, edge.axis]
        return cls(
            cells=cells,
            nodes=mesh.nodes[cells],
            tilt=_on_cells(mesh, cells, unit, turning),
            moment=_on_cells(mesh, cells, unit, moments),
            target=np.stack(target, axis=-1).reshape(*per_cell, -1),
            weights=lengths * w / 2 * sizes[:, 1 - edge.axis, None],
            spring=GAMMA * material.bending_stiffness / height[:, None],
        )

    def add_to(self, matrix: BlockMatrix) -> None:
        """Add the terms to a stiffness matrix, in place."""
        # The bilinear form m(u) theta(v) + theta(u) m(v) + k theta(u) theta(v): symmetric, as Cholesky needs.
        weighted = self.tilt * self.weights[..., None]
        crossed = np.swapaxes(self.moment, 1, 2) @ weighted
        held = np.swapaxes(self.tilt, 1, 2) @ (weighted * self.spring[..., None])
        shape = (COMPONENTS, len(CORNERS), len(KINDS))
        add_cell_matrices(
            matrix.blocks, self.nodes, (crossed + np.swapaxes(crossed, 1, 2) + held).reshape(-1, *shape, *shape)
        )

    def right_hand_side(self, node_count: int) -> Array:
        """Return the nodal forces (nodes, 12, states) of the prescribed rotation."""
        # The same terms with theta0 for theta(u), on the right-hand side.
        rows = self.moment + self.tilt * self.spring[..., None]
        return self._scattered(rows, self.target, node_count)

    def gap_forces(self, q: Array) -> Array:
        """Return the nodal forces (nodes, 12, states) of the moments in what is left of theta - theta0."""
        local = q[self.nodes].reshape(len(self.nodes), len(CORNERS), COMPONENTS, len(KINDS), -1)
        # The clamp exerts m and k times the gap. The term m(v) gap is no force of it, and must not count as a reaction.
        gap = self.tilt @ np.swapaxes(local, 1, 2).reshape(len(self.nodes), self.tilt.shape[-1], -1) - self.target
        return self._scattered(self.moment, gap, len(q))

    def _scattered(self, rows: Array, values: Array, node_count: int) -> Array:
        work = np.swapaxes(rows, 1, 2) @ (values * self.weights[..., None])
        local = work.reshape(len(self.nodes), COMPONENTS, len(CORNERS), len(KINDS), -1)
        result = np.zeros((node_count, NODE_DOFS, values.shape[-1]))
        for corner in range(len(CORNERS)):
            result[self.nodes[:, corner]] += local[:, :, corner].reshape(len(local), NODE_DOFS, -1)
        return result


def clamped_edges(case: Case, mesh: TensorMesh, states: Sequence[float]) -> Iterator[ClampedEdge]:
    """Yield the clamped edges of a case on which the normal turns."""
    for support, place in case.supported_places():
        if support.clamped and isinstance(place, Edge):
            edge = ClampedEdge.on_edge(case, mesh, support, place, states)
            if edge is not None:
                yield edge


def outward_conormal(surface: Midsurface, edge: Edge) -> Array:
    """Return the unit vectors (n, 3) tangential to the surface, normal to an edge and away from the surface."""
    # a_t x a3 is normal to the edge in the surface. Its sign is settled by the base vector across the edge. That points
    # inward on the side "min", outward on the side "max".
    tangent = surface.base[:, 1 - edge.axis]
    conormal = np.cross(tangent, surface.normal)
    conormal /= np.linalg.norm(conormal, axis=-1, keepdims=True)
    inward = np.sum(conormal * surface.base[:, edge.axis], axis=-1, keepdims=True) < 0
    outward: Array = np.where(inward == (edge.side == "max"), -conormal, conormal)
    return outward


def _on_cells(mesh: TensorMesh, cells: Integers, unit: Array, rows: Array) -> Array:
    """Turn rows (points, 3, 5) on the derivatives of u into rows (cells, g, 48) on the degrees of freedom."""
    # A derivative on the cell is that of the unit cell over h1^i h2^j. The last factor turns the cell's degrees of
    # freedom into the nodes' scaled ones. Those are the same for neighbouring cells of other sizes.
    table = np.stack([tabulate(unit, d) for d in DERIVATIVES], axis=1)  # (g, 5, 4, 4)
    sizes = mesh.sizes[cells]
    steps = np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1)
    scales = kind_scales(sizes)[:, None] / mesh.node_scales[mesh.nodes[cells]]
    local = rows.reshape(len(cells), len(unit), COMPONENTS, -1) / steps[:, None, None]
    return np.asarray(np.einsum("egcd,gdak,eak->egcak", local, table, scales).reshape(len(cells), len(unit), -1))
