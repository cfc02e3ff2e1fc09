"""Loads as forces at points, and the nodal forces of equal work.

Every load (area load, pressure, gravity, edge load, point force) becomes forces in newtons at the points of a
quadrature. Their work on the basis gives the nodal forces, and their work on rigid motions gives the resultants.

An edge moment has forces and a tangent. It works on the angle by which the normal turns about a fixed axis. With e the
axis, n the deformed unit normal and p = n - (n . e) e its part across the axis, the angle between p and its reference
turns by

    d theta = (e x n) . dn / |p|^2,
    d2 theta = (e x n) . d2n / |p|^2 + sym 2 (e . n) ((e x n) . dn) (e . dn) / |p|^4,

(e . (dn x dn) is antisymmetric and cancels, because theta is a function of n). The moment's work is the integral of
M theta along the edge, so it has a potential and a symmetric tangent at any rotation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.features import Division, cut_line
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.problems.shell.question.features import narrow_division
from shellbench.problems.shell.question.loads import (
    AreaLoad,
    EdgeLoad,
    GravityLoad,
    MomentLoad,
    PointLoad,
    PressureLoad,
)
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.mechanics.kinematics import DERIVATIVES, Deformation, Midsurface, outward_conormal
from shellbench.solvers.fem.mechanics.rigid_motions import nodal_rigid_motions
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, KINDS, Derivative, gauss_rule, kind_scales, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import EdgeRule, Quadrature, basis_scales, cell_portions

Array = NDArray[np.float64]

LOADED = 1024  # cells whose area is loaded at once: long formulas take as long for a few points as for thousands
EDGE_GAUSS_POINTS = 5  # a cell's side; exact to degree 9
SLOPES: tuple[Derivative, Derivative] = ((1, 0), (0, 1))


@dataclass(frozen=True)
class EdgeMoment:
    """A moment on an edge of c cells with g Gauss points each, n = c g points in all.

    Attributes
    ----------
    case, load
        The case and the load.
    points
        (n, 2) curvilinear coordinates.
    nodes
        (c, 4) corners of the cells.
    slopes
        (c, g, 2, f) derivatives of the cells' scaled basis in xi1 and xi2.
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
        rule = EdgeRule.on_edge(mesh, edge, EDGE_GAUSS_POINTS)
        reference = Midsurface.from_position(case.surface.derivatives(rule.points, order=2))
        running = 1 - edge.axis
        speed = np.linalg.norm(reference.base[:, running], axis=-1)
        table = np.stack([tabulate(rule.unit, d, mesh.basis).reshape(len(rule.unit), -1) for d in SLOPES], axis=1)
        scales = basis_scales(mesh, slice(None))[rule.cells].reshape(len(rule.cells), 1, 1, -1)
        return cls(
            case=case,
            load=load,
            points=rule.points,
            nodes=mesh.nodes[rule.cells],
            slopes=table / rule.sizes[:, None, :, None] * scales,
            reference=reference,
            lengths=speed * (rule.weights / 2 * rule.sizes[:, running, None]).ravel(),
        )

    @property
    def axis(self) -> Array:
        """(3,) unit vector e."""
        return np.asarray(np.asarray(self.load.axis) / np.linalg.norm(self.load.axis), dtype=float)

    def moments(self, t: float) -> Array:
        """Return the moments (n,) of the points' shares of the edge, N m, at a load factor."""
        return np.asarray(self.case.formula(self.load.value).derivatives(self.points, 0, t)[0, 0] * self.lengths)

    def deformation(self, q: Array) -> Deformation:
        """Return the deformation of the edge by a displacement (nodes, 12), without second derivatives.

        A moment does no work on second derivatives, so that they are left out.
        """
        local = q[self.nodes].reshape(len(self.nodes), len(CORNERS), COMPONENTS, -1)
        local = np.swapaxes(local, 2, 3).reshape(len(self.nodes), 1, -1, COMPONENTS)
        gradients = np.zeros((len(self.points), len(DERIVATIVES), COMPONENTS))
        gradients[:, :2] = (self.slopes @ local).reshape(-1, 2, COMPONENTS)
        return Deformation.from_gradients(self.reference, gradients)

    def angles(self, q: Array, near: Array) -> Array:
        """Return the angles theta (n,), rad; the number of full turns is chosen to be closest to `near` (n,)."""
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
        forces = np.zeros(q.shape)
        per_cell = rows.reshape(len(self.nodes), -1, 2, COMPONENTS)
        local = np.einsum("egac,egaf->efc", per_cell, self.slopes)
        local = local.reshape(len(local), len(CORNERS), -1, COMPONENTS)
        for corner in range(len(CORNERS)):
            forces[self.nodes[:, corner]] += np.swapaxes(local[:, corner], 1, 2).reshape(len(local), -1)
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
        return np.asarray((np.cross(e, n)[:, None] @ deformation.normal_change)[:, 0] / across[:, None])

    def _angle_form(self, deformation: Deformation) -> Array:
        """Return d2 theta (n, 6, 6)."""
        n, e = deformation.current.normal, self.axis
        along = n @ e
        across = (1 - along**2)[:, None, None]
        lean = np.cross(e, n)
        turned, tilted = (lean[:, None] @ deformation.normal_change)[:, 0], e @ deformation.normal_change
        product = 2 * along[:, None, None] * turned[:, :, None] * tilted[:, None, :]
        symmetric = (product + np.swapaxes(product, 1, 2)) / 2
        return np.asarray(deformation.second_normal_change(lean) / across + symmetric / across**2)


def edge_moments(case: Case, mesh: TensorMesh) -> Iterator[EdgeMoment]:
    """Yield the moments of a case, edge by edge."""
    for load in case.loads:
        if isinstance(load, MomentLoad):
            for place in (case.places[name] for name in load.on):
                if isinstance(place, Edge):
                    yield EdgeMoment.on_edge(case, mesh, load, place)


@dataclass(frozen=True)
class AreaPortion:
    """Some cells of a mesh with the data to load their n Gauss points.

    Attributes
    ----------
    cells
        Slice or numbers of the cells.
    points
        (n, 2) curvilinear coordinates.
    surface
        Geometry there.
    area
        (n,) undeformed area of each point, m^2.
    scales
        (cells, 4, (p - 1)^2) from the unit cell's basis to the scaled degrees of freedom.
    """

    cells: slice
    points: Array
    surface: Midsurface
    area: Array
    scales: Array


def area_rule(case: Case, mesh: TensorMesh, quadrature: Quadrature) -> Iterator[AreaPortion]:
    """Yield the cells of a mesh, portion by portion."""
    for cells in cell_portions(mesh, LOADED):
        points, weights = quadrature.on_cells(mesh, cells)
        flat = points.reshape(-1, 2)
        surface = Midsurface.from_position(case.surface.derivatives(flat, order=2))
        yield AreaPortion(cells, flat, surface, weights.ravel() * surface.area, basis_scales(mesh, cells))


@dataclass(frozen=True)
class Loading:
    """All loads of a case on a mesh; in the non-linear theory only the dead ones.

    In that theory, moments and following pressures depend on the deformation: see `EdgeMoment` and `following`.

    Attributes
    ----------
    nodal
        (nodes, 12, states) work on the scaled degrees of freedom, J per metre.
    resultant
        (6, states) work on the six rigid motions.
    magnitude
        (6,) the same with the absolute values of all contributions, over all states: the scale of a rounding error.
    """

    nodal: Array
    resultant: Array
    magnitude: Array

    @classmethod
    def on_mesh(
        cls,
        case: Case,
        mesh: TensorMesh,
        quadrature: Quadrature,
        states: Sequence[float],
        rule: Iterable[AreaPortion] | None = None,
    ) -> Loading:
        """Integrate the loads at the times or load factors `states`; `rule` is the rule of the area, if known."""
        build = _Builder(case, mesh, len(states))
        build.add_area_loads(quadrature, states, rule)
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


def _from_local(vectors: Array, surface: Midsurface, running: int, across: Array | None = None) -> Array:
    """Return vectors (n, 3) along a base vector, across it in the surface and along the normal as Cartesian ones."""
    along = surface.base[:, running] / np.linalg.norm(surface.base[:, running], axis=-1, keepdims=True)
    if across is None:
        across = np.cross(surface.normal, along)
    return np.asarray(np.einsum("pk,kpc->pc", vectors, np.stack([along, across, surface.normal])))


class _Builder:
    def __init__(self, case: Case, mesh: TensorMesh, states: int) -> None:
        self.case, self.mesh = case, mesh
        self.nodal = np.zeros((mesh.node_count, COMPONENTS * len(mesh.kinds), states))
        self.resultant, self.magnitude = np.zeros((6, states)), np.zeros(6)

    def add_area_loads(
        self, quadrature: Quadrature, states: Sequence[float], rule: Iterable[AreaPortion] | None
    ) -> None:
        # If a load's own cells are narrower than cells of the mesh, the latter are cut, and loaded part by part.
        loads: list[AreaLoad | PressureLoad | GravityLoad] = []
        for load in self.case.dead:
            if isinstance(load, AreaLoad | PressureLoad | GravityLoad):
                division = narrow_division(self.case, load)
                if division is None:
                    loads.append(load)
                else:
                    self._add_cut_load(load, division, quadrature, states)
        if not loads:
            return
        table = tabulate(quadrature.points, (0, 0), self.mesh.basis).reshape(len(quadrature.points), -1)
        for part in area_rule(self.case, self.mesh, quadrature) if rule is None else rule:
            points, surface = part.points, part.surface
            density = np.stack([self._density(loads, points, surface, t) for t in states], axis=-1)
            forces = density * part.area[:, None, None]
            self._add_work(points, forces)
            per_cell = forces.reshape(len(part.scales), len(table), -1)
            work = (table.T @ per_cell).reshape(len(per_cell), len(CORNERS), len(self.mesh.kinds), COMPONENTS, -1)
            work = work * part.scales[..., None, None]
            for corner in range(len(CORNERS)):
                block = np.swapaxes(work[:, corner], 1, 2)
                self.nodal[self.mesh.nodes[part.cells, corner]] += block.reshape(len(block), *self.nodal.shape[1:])

    def _add_cut_load(
        self,
        load: AreaLoad | PressureLoad | GravityLoad,
        division: Division,
        quadrature: Quadrature,
        states: Sequence[float],
    ) -> None:
        origins, sizes = division.parts(self.mesh.lines, self.mesh.domain.periodic)
        for start in range(0, len(origins), LOADED):
            some = slice(start, start + LOADED)
            points = origins[some, None] + quadrature.points * sizes[some, None]
            weights = quadrature.weights * np.prod(sizes[some], axis=-1, keepdims=True)
            flat = points.reshape(-1, 2)
            wrapped = self.mesh.domain.wrap(flat)
            surface = Midsurface.from_position(self.case.surface.derivatives(wrapped, order=2))
            density = np.stack([self._density([load], wrapped, surface, t) for t in states], axis=-1)
            self._add_forces(flat, density * (weights.ravel() * surface.area)[:, None, None])

    def _density(
        self, loads: Sequence[AreaLoad | PressureLoad | GravityLoad], points: Array, surface: Midsurface, t: float
    ) -> Array:
        """Return the force per reference area (n, 3), N/m^2."""
        density = np.zeros((len(points), COMPONENTS))
        for load in loads:
            match load:
                case AreaLoad(vector=vector, frame=frame):
                    given = self.case.evaluate(vector, points, t)[0, 0]
                    density += given if frame == "global" else _from_local(given, surface, 0)
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
        if (division := narrow_division(self.case, load, edge)) is not None:
            line = cut_line(line, division.ends(running), self.mesh.domain.periodic[running])
        x, w = gauss_rule(EDGE_GAUSS_POINTS)
        loaded = edge.covers(self.mesh.domain, (line[:-1] + line[1:]) / 2)
        h = np.diff(line)[loaded, None]
        points = edge.points(self.mesh.domain, (line[:-1][loaded, None] + h * (x + 1) / 2).ravel())
        points = self.mesh.domain.wrap(points)
        surface = Midsurface.from_position(self.case.surface.derivatives(points, order=2))
        length = (h * w / 2).ravel() * np.linalg.norm(surface.base[:, running], axis=-1)
        given = [self.case.evaluate(load.vector, points, t)[0, 0] for t in states]
        if load.frame == "local":
            given = [_from_local(vectors, surface, running, outward_conormal(surface, edge)) for vectors in given]
        forces = [density * length[:, None] for density in given]
        self._add_forces(points, np.stack(forces, axis=-1))

    def add_point_load(self, load: PointLoad, point: Point, states: Sequence[float]) -> None:
        points = np.array([point.xi])
        self._add_forces(points, np.stack([self.case.evaluate(load.force, points, t)[0, 0] for t in states], axis=-1))

    def add_moments(self, states: Sequence[float]) -> None:
        """Add the forces of moments on the undeformed shell."""
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
        basis, scales = self.mesh.basis, self.mesh.node_scales[nodes]
        values = tabulate(unit, (0, 0), basis) * kind_scales(sizes, basis)[:, None] / scales
        work = np.einsum("pak,pcs->packs", values, forces)
        np.add.at(self.nodal, nodes.ravel(), work.reshape(nodes.size, *self.nodal.shape[1:]))
        self._add_work(points, forces)

    def _add_work(self, points: Array, forces: Array) -> None:
        if self.case.dynamics is not None:
            return  # a motion needs no balance
        modes = rigid_modes(self.case.surface, points)[0, 0]
        self.resultant += np.einsum("pcm,pcs->ms", modes, forces)
        self.magnitude += np.einsum("pcm,pcs->m", np.abs(modes), np.abs(forces))
