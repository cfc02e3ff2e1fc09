"""Loads as forces at points, and the nodal forces that do the same work.

Whatever a load is, area load, pressure, gravity, edge load or point force, it becomes forces in newtons at the points
of a quadrature. Their work on the basis gives the nodal forces, their work on rigid motions the resultants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import AreaLoad, EdgeLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.places import Edge, Point
from shellbench.problems.shell.rigid import rigid_modes
from shellbench.solvers.fem.assembly import COMPONENTS, Quadrature, basis_scales, chunks
from shellbench.solvers.fem.kinematics import Midsurface
from shellbench.solvers.fem.mesh import CORNERS, KINDS, TensorMesh, kind_scales, tabulate
from shellbench.solvers.fem.moments import edge_moments
from shellbench.solvers.fem.rigid_motions import nodal_rigid_motions

Array = NDArray[np.float64]

EDGE_GAUSS_POINTS = 5  # a cell's side; exact to degree 9


@dataclass(frozen=True)
class Loading:
    """All loads of a case on a mesh; in the non-linear theory all but the moments, which depend on the deformation.

    Attributes
    ----------
    nodal
        (nodes, 12, states) work on the scaled degrees of freedom, J per metre.
    resultant
        (6, states) work on the six rigid motions.
    magnitude
        (6,) the same with all contributions counted positive, over all states: the scale of a rounding error.
    """

    nodal: Array
    resultant: Array
    magnitude: Array

    @classmethod
    def on_mesh(cls, case: Case, mesh: TensorMesh, quadrature: Quadrature, states: Sequence[float]) -> Loading:
        """Integrate the loads at each of the times or load factors `states`."""
        build = _Builder(case, mesh, len(states))
        build.add_area_loads(quadrature, states)
        for load in case.loads:
            for name in load.on if isinstance(load, EdgeLoad | PointLoad) else ():
                place = case.places[name]
                if isinstance(load, EdgeLoad) and isinstance(place, Edge):
                    build.add_edge_load(load, place, states)
                elif isinstance(load, PointLoad) and isinstance(place, Point):
                    build.add_point_load(load, place, states)
        if case.linear:
            build.add_moments(states)
        return cls(build.nodal, build.resultant, build.magnitude)


class _Builder:
    def __init__(self, case: Case, mesh: TensorMesh, states: int) -> None:
        self.case, self.mesh = case, mesh
        self.nodal = np.zeros((mesh.node_count, COMPONENTS * len(KINDS), states))
        self.resultant, self.magnitude = np.zeros((6, states)), np.zeros(6)

    def add_area_loads(self, quadrature: Quadrature, states: Sequence[float]) -> None:
        loads = [load for load in self.case.loads if isinstance(load, AreaLoad | PressureLoad | GravityLoad)]
        if not loads:
            return
        table = tabulate(quadrature.points, (0, 0)).reshape(len(quadrature.points), -1)
        for cells in chunks(self.mesh):
            points, weights = quadrature.on_cells(self.mesh, cells)
            surface = Midsurface.at(self.case.surface.derivatives(points.reshape(-1, 2), order=2))
            area = weights.ravel() * surface.area
            density = np.stack([self._density(loads, points.reshape(-1, 2), surface, t) for t in states], axis=-1)
            forces = density * area[:, None, None]
            self._add_work(points.reshape(-1, 2), forces)
            per_cell = forces.reshape(*weights.shape, -1)
            work = (table.T @ per_cell).reshape(len(per_cell), len(CORNERS), len(KINDS), COMPONENTS, -1)
            work = work * basis_scales(self.mesh, cells)[..., None, None]
            for corner in range(len(CORNERS)):
                block = np.swapaxes(work[:, corner], 1, 2)
                self.nodal[self.mesh.nodes[cells, corner]] += block.reshape(len(block), *self.nodal.shape[1:])

    def _density(
        self, loads: Sequence[AreaLoad | PressureLoad | GravityLoad], points: Array, surface: Midsurface, t: float
    ) -> Array:
        """Return the force per reference area (n, 3), N/m^2."""
        density = np.zeros((len(points), COMPONENTS))
        for load in loads:
            match load:
                case AreaLoad(vector=vector):
                    density += self.case.evaluate(vector, points, t)[0, 0]
                case PressureLoad(value=value):
                    density += self.case.formula(value).derivatives(points, 0, t)[0, 0][:, None] * surface.normal
                case GravityLoad(acceleration=acceleration):
                    density += self.case.material.areal_density * self.case.evaluate(acceleration, points, t)[0, 0]
                case _:
                    assert_never(load)
        return density

    def add_edge_load(self, load: EdgeLoad, edge: Edge, states: Sequence[float]) -> None:
        running = 1 - edge.axis
        line = self.mesh.lines[running]
        x, w = np.polynomial.legendre.leggauss(EDGE_GAUSS_POINTS)
        h = np.diff(line)[:, None]
        points = edge.points(self.mesh.domain, (line[:-1, None] + h * (x + 1) / 2).ravel())
        points = self.mesh.domain.wrap(points)
        tangent = self.case.surface.derivatives(points, order=1)[((1, 0), (0, 1))[running]]
        length = (h * w / 2).ravel() * np.linalg.norm(tangent, axis=-1)
        forces = [self.case.evaluate(load.vector, points, t)[0, 0] * length[:, None] for t in states]
        self._add_forces(points, np.stack(forces, axis=-1))

    def add_point_load(self, load: PointLoad, point: Point, states: Sequence[float]) -> None:
        points = np.array([point.xi])
        self._add_forces(points, np.stack([self.case.evaluate(load.force, points, t)[0, 0] for t in states], axis=-1))

    def add_moments(self, states: Sequence[float]) -> None:
        """Add the forces that moments exert on the undeformed shell."""
        rest = np.zeros(self.nodal.shape[:2])
        for moment in edge_moments(self.case, self.mesh):
            forces = np.stack([moment.forces(rest, t) for t in states], axis=-1)
            self.nodal += forces
            modes = nodal_rigid_motions(self.case, self.mesh)
            self.resultant += np.einsum("pcm,pcs->ms", modes, forces)
            self.magnitude += np.einsum("pcm,pcs->m", np.abs(modes), np.abs(forces))

    def _add_forces(self, points: Array, forces: Array) -> None:
        """Add forces (n, 3, states) at points (n, 2)."""
        nodes, unit, sizes = self.mesh.locate(points)
        basis = tabulate(unit, (0, 0)) * kind_scales(sizes)[:, None] / self.mesh.node_scales[nodes]
        work = np.einsum("pak,pcs->packs", basis, forces)
        np.add.at(self.nodal, nodes.ravel(), work.reshape(nodes.size, *self.nodal.shape[1:]))
        self._add_work(points, forces)

    def _add_work(self, points: Array, forces: Array) -> None:
        modes = rigid_modes(self.case.surface, points)[0, 0]
        self.resultant += np.einsum("pcm,pcs->ms", modes, forces)
        self.magnitude += np.einsum("pcm,pcs->m", np.abs(modes), np.abs(forces))
