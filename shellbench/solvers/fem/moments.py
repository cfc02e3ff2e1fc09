"""Edge moments: forces and tangent of a moment that works on the angle by which the normal turns about a fixed axis.

With e the axis, n the deformed unit normal and p = n - (n . e) e its part across the axis, the angle between p and its
reference turns by

    d theta = (e x n) . dn / |p|^2,
    d2 theta = (e x n) . d2n / |p|^2 + sym 2 (e . n) ((e x n) . dn) (e . dn) / |p|^4,

(e . (dn x dn) is antisymmetric and cancels, because theta is a function of n). The moment's work is the integral of
M theta along the edge, so it has a potential and a symmetric tangent at any rotation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad
from shellbench.problems.shell.places import Edge
from shellbench.solvers.fem.assembly import COMPONENTS, NODE_DOFS, BlockMatrix, add_cell_matrices, basis_scales
from shellbench.solvers.fem.deformation import Deformation
from shellbench.solvers.fem.kinematics import DERIVATIVES, Midsurface
from shellbench.solvers.fem.mesh import CORNERS, FUNCTIONS, KINDS, Derivative, TensorMesh, tabulate

Array = NDArray[np.float64]

GAUSS_POINTS = 5  # a cell's side; exact to degree 9
SLOPES: tuple[Derivative, Derivative] = ((1, 0), (0, 1))


@dataclass(frozen=True)
class EdgeMoment:
    """A moment on an edge of c cells with g Gauss points each, n = c g points in all.

    Attributes
    ----------
    case, load
        Whose load it is.
    points
        (n, 2) curvilinear coordinates.
    nodes
        (c, 4) corners of the cells.
    slopes
        (c, g, 2, 16) derivatives of the cells' scaled basis in xi1 and xi2.
    reference
        Geometry at the points.
    lengths
        (n,) share of the edge's length.
    """

    case: Case
    load: MomentLoad
    points: Array
    nodes: NDArray[np.int64]
    slopes: Array
    reference: Midsurface
    lengths: Array

    @classmethod
    def on_edge(cls, case: Case, mesh: TensorMesh, load: MomentLoad, edge: Edge) -> EdgeMoment:
        """Tabulate an edge."""
        cells = mesh.edge_cells(edge)
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        unit = np.full((GAUSS_POINTS, 2), float(edge.side == "max"))
        unit[:, 1 - edge.axis] = (x + 1) / 2
        sizes = mesh.sizes[cells]
        points = mesh.domain.wrap(mesh.origins[cells][:, None] + unit * sizes[:, None]).reshape(-1, 2)
        reference = Midsurface.at(case.surface.derivatives(points, order=2))
        running = 1 - edge.axis
        speed = np.linalg.norm(reference.base[:, running], axis=-1)
        table = np.stack([tabulate(unit, d).reshape(-1, FUNCTIONS) for d in SLOPES], axis=1)
        scales = basis_scales(mesh, slice(None))[cells].reshape(len(cells), 1, 1, FUNCTIONS)
        return cls(
            case=case,
            load=load,
            points=points,
            nodes=mesh.nodes[cells],
            slopes=table / sizes[:, None, :, None] * scales,
            reference=reference,
            lengths=speed * (w / 2 * sizes[:, running, None]).ravel(),
        )

    @property
    def axis(self) -> Array:
        """(3,) unit vector e."""
        return np.asarray(np.asarray(self.load.axis) / np.linalg.norm(self.load.axis), dtype=float)

    def moments(self, t: float) -> Array:
        """Return the moments (n,) of the points' shares of the edge, N m, at a load factor."""
        return np.asarray(self.case.formula(self.load.value).derivatives(self.points, 0, t)[0, 0] * self.lengths)

    def deformation(self, q: Array) -> Deformation:
        """Return how a displacement (nodes, 12) deforms the edge; second derivatives do not count and are left out."""
        local = q[self.nodes].reshape(len(self.nodes), len(CORNERS), COMPONENTS, len(KINDS))
        local = np.swapaxes(local, 2, 3).reshape(len(self.nodes), 1, FUNCTIONS, COMPONENTS)
        gradients = np.zeros((len(self.points), len(DERIVATIVES), COMPONENTS))
        gradients[:, :2] = (self.slopes @ local).reshape(-1, 2, COMPONENTS)
        return Deformation.from_gradients(self.reference, gradients)

    def angles(self, q: Array, near: Array) -> Array:
        """Return the angles theta (n,), rad, of the many that differ by full turns those closest to `near` (n,)."""
        e = self.axis

        def across(vectors: Array) -> Array:
            return np.asarray(vectors - (vectors @ e)[:, None] * e)

        before, after = across(self.reference.normal), across(self.deformation(q).current.normal)
        angle = np.arctan2(np.cross(before, after) @ e, np.sum(before * after, axis=-1))
        turn = 2 * np.pi
        return np.asarray(angle + turn * np.round((near - angle) / turn))

    def forces(self, q: Array, t: float) -> Array:
        """Return the nodal forces (nodes, 12)."""
        rows = self._angle_rows(self.deformation(q)) * self.moments(t)[:, None]
        forces = np.zeros((len(q), NODE_DOFS))
        per_cell = rows.reshape(len(self.nodes), -1, 2, COMPONENTS)
        local = np.einsum("egac,egaf->efc", per_cell, self.slopes)
        local = local.reshape(-1, len(CORNERS), len(KINDS), COMPONENTS)
        for corner in range(len(CORNERS)):
            forces[self.nodes[:, corner]] += np.swapaxes(local[:, corner], 1, 2).reshape(-1, NODE_DOFS)
        return forces

    def add_tangent(self, matrix: BlockMatrix, q: Array, t: float) -> None:
        """Subtract the forces' derivative from a tangent stiffness, in place."""
        form = self._angle_form(self.deformation(q)) * self.moments(t)[:, None, None]
        per_cell = form.reshape(len(self.nodes), -1, 2, COMPONENTS, 2, COMPONENTS)
        local = np.einsum("egacbd,egaf,egbh->ecfdh", per_cell, self.slopes, self.slopes, optimize=True)
        shape = (COMPONENTS, len(CORNERS), len(KINDS))
        add_cell_matrices(matrix.blocks, self.nodes, -local.reshape(-1, *shape, *shape))

    def _angle_rows(self, deformation: Deformation) -> Array:
        """Return d theta (n, 6) on du,1 and du,2."""
        n, e = deformation.current.normal, self.axis
        across = 1 - (n @ e) ** 2
        return np.asarray((np.cross(e, n)[:, None] @ deformation.turning)[:, 0] / across[:, None])

    def _angle_form(self, deformation: Deformation) -> Array:
        """Return d2 theta (n, 6, 6)."""
        n, e = deformation.current.normal, self.axis
        along = n @ e
        across = (1 - along**2)[:, None, None]
        lean = np.cross(e, n)
        turned, tilted = (lean[:, None] @ deformation.turning)[:, 0], e @ deformation.turning
        product = 2 * along[:, None, None] * turned[:, :, None] * tilted[:, None, :]
        symmetric = (product + np.swapaxes(product, 1, 2)) / 2
        return np.asarray(deformation.second_turning(lean) / across + symmetric / across**2)


def edge_moments(case: Case, mesh: TensorMesh) -> Iterator[EdgeMoment]:
    """Yield the moments of a case, edge by edge."""
    for load in case.loads:
        if isinstance(load, MomentLoad):
            for place in (case.places[name] for name in load.on):
                if isinstance(place, Edge):
                    yield EdgeMoment.on_edge(case, mesh, load, place)
