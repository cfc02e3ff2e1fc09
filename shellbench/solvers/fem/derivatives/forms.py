"""Derivatives of virtual works with respect to parameters, at fixed fields on a fixed mesh.

The linear shell on a mesh satisfies R(u; p) . v = a(u, v; p) - l(v; p) = 0 for all v that the supports leave free: a is
the work of the stresses of u on the strains of v, with springs and the terms of clamps, and l that of the loads. The
mesh's coordinates stay fixed; where a bound of the surface is the parameter, points move with them (`Deviation.sites`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.features import narrow_division
from shellbench.problems.shell.question.loads import (
    AreaLoad,
    EdgeLoad,
    GravityLoad,
    Load,
    MomentLoad,
    PointLoad,
    PressureLoad,
)
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.solvers.fem.derivatives.deviation import Deviation
from shellbench.solvers.fem.derivatives.variations import Key, Strained, strained
from shellbench.solvers.fem.mechanics.assembly import derivatives_on_cells
from shellbench.solvers.fem.mechanics.bubble_conditions import GAUSS_POINTS, constant_normal
from shellbench.solvers.fem.mechanics.clamping import GAMMA
from shellbench.solvers.fem.mechanics.kinematics import DERIVATIVES, stiffness_moduli
from shellbench.solvers.fem.mechanics.loads import EDGE_GAUSS_POINTS, Loading
from shellbench.solvers.fem.mesh.basis import Derivative, kind_scales, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import EdgeRule, Quadrature, cell_portions

Array = NDArray[np.float64]
Numbers = NDArray[Any]

FIRST: Key = (1, 0)  # the variation by u
SECOND: Key = (0, 1)  # by v
PARTS = (0, 1)  # membrane, bending
PORTION = 256  # cells at once


def cross(first: Numbers, second: Numbers) -> Numbers:
    """Return vector products (n, 3) of real or complex vectors."""
    a, b = first.T, second.T
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], axis=-1)


def dot(first: Numbers, second: Numbers) -> Numbers:
    """Return scalar products (n,) without conjugation, which NumPy's `vdot` has."""
    return np.asarray(np.sum(first * second, axis=-1))


def length(vectors: Numbers) -> Numbers:
    """Return the analytic continuation of lengths (n, 1); NumPy's `norm` is no analytic function."""
    return np.sqrt(dot(vectors, vectors))[:, None]


Density = Callable[[Strained, Numbers, Case], Numbers]
"""From strains, from D and B (n, 2), and from the case to a density per area (n,)."""


def work_of(first: Key, second: Key, parts: Sequence[int] = PARTS) -> Density:
    """Return the work of the stresses of one variation of the strains on another one, as a density."""

    def density(strains: Strained, moduli: Numbers, case: Case) -> Numbers:
        ratios = case.material.poissons_ratios
        return np.asarray(sum(moduli[:, k] * strains.work(ratios[k], k, first, second) for k in parts))

    return density


def rates(deviations: Sequence[Deviation], values: Numbers) -> Array:
    """Return the derivatives (deviations,) of numbers made with deviating cases."""
    return np.array([off.rate(value) for off, value in zip(deviations, values, strict=True)])


@dataclass(frozen=True)
class Works:
    """Virtual works of fields on a mesh.

    Attributes
    ----------
    case, mesh, order
        The case, its mesh, and the order of the rule on cells.
    """

    case: Case
    mesh: TensorMesh
    order: int

    @cached_property
    def quadrature(self) -> Quadrature:
        """The rule on cells."""
        return Quadrature.of_order(self.mesh, self.order)

    def on_cells(
        self,
        fields: Array,
        deviations: Sequence[Deviation],
        density: Density,
        order: int = 1,
        keys: tuple[Key, Key] = (FIRST, SECOND),
    ) -> Numbers:
        """Return the integrals (deviations,) over the area of a density of two fields' strains, with each deviation.

        `fields` are coefficients (nodes, 3, kinds, 2) of u and v with their powers in the variations of the strains.
        Integrals are zero where a parameter changes no strain and no stiffness.
        """
        found = np.zeros(len(deviations), dtype=complex)
        for cells in cell_portions(self.mesh, PORTION):
            points, weights = self.quadrature.on_cells(self.mesh, cells)
            flat, measure = points.reshape(-1, 2), weights.ravel()
            gradients = derivatives_on_cells(self.mesh, cells, self.quadrature, fields)
            known: Strained | None = None
            for number, off in enumerate(deviations):
                if off.part is not None or off.parameter.point:
                    continue
                if off.moves_surface or known is None:
                    strains = strained(
                        off.position(flat), {key: gradients[..., k] for k, key in enumerate(keys)}, order
                    )
                    known = known if off.moves_surface else strains
                else:
                    strains = known
                sites: Any = off.sites(flat)[0]
                moduli = stiffness_moduli(off.moved.surface, off.moved.material, sites)
                found[number] += measure @ (strains.area * density(strains, moduli, off.moved))
        return found

    def stress_work(self, fields: Array, deviations: Sequence[Deviation], parts: Sequence[int] = PARTS) -> Array:
        """Return the derivatives of the work of the stresses of u on the strains of v."""
        return rates(deviations, self.on_cells(fields, deviations, work_of(FIRST, SECOND, parts)))

    def virtual_work(self, fields: Array, deviations: Sequence[Deviation], t: float) -> Array:
        """Return the derivatives (deviations,) of R(u) . v at the load factor t."""
        found = self.stress_work(fields, deviations)
        for number, off in enumerate(deviations):
            found[number] += self.spring_work(fields, off) + self.clamp_work(fields, off, t)
            found[number] -= self.load_work(fields[..., 1], off, t)
        return found

    def load_work(self, field: Array, off: Deviation, t: float, loads: Sequence[Load] | None = None) -> float:
        """Return the derivative of the work of the loads, all or some, on a field (nodes, 3, kinds)."""
        if off.part is not None:
            loading = Loading.on_mesh(off.part, self.mesh, self.quadrature, (t,))
            return float(np.sum(loading.nodal[..., 0] * self.scaled(field)))
        found = 0.0
        for load in self.case.loads if loads is None else loads:
            if isinstance(load, PointLoad):
                found += sum(self._point_work(load, name, field, off, t) for name in load.on)
            elif off.changes_loads:
                if narrow_division(self.case, load) is not None:
                    raise InputError("a load is narrower than the mesh's cells: its derivative is not taken here")
                found += off.rate(sum(work for work in self._work(load, field, off, t)))
        return found

    def _point_work(self, load: PointLoad, name: str, field: Array, off: Deviation, t: float) -> float:
        place = self.case.places[name]
        assert isinstance(place, Point)
        at = np.array([place.xi])
        moved = self.values(field, at, ((0, 0), (1, 0), (0, 1)))[0]
        force = off.moved.evaluate(load.force, off.sites(at)[0], t)[0, 0][0]
        slid = np.real(force) @ (off.slide(name) @ moved[1:])
        return off.rate(force @ moved[0]) + float(slid)

    def _work(self, load: Load, field: Array, off: Deviation, t: float) -> Iterator[complex]:
        """Yield the work of a spread load, portion by portion."""
        case = off.moved
        if isinstance(load, AreaLoad | GravityLoad | PressureLoad):
            for cells in cell_portions(self.mesh, PORTION):
                points, weights = self.quadrature.on_cells(self.mesh, cells)
                flat = points.reshape(-1, 2)
                moved = derivatives_on_cells(self.mesh, cells, self.quadrature, field[..., None], ((0, 0),))[:, 0, :, 0]
                x, xi = off.position(flat, 1), off.sites(flat)[0]
                normal = cross(x[1, 0], x[0, 1])
                area = length(normal)
                if isinstance(load, PressureLoad):
                    density = case.formula(load.value).derivatives(xi, 0, t)[0, 0][:, None] * normal / area
                elif isinstance(load, GravityLoad):
                    density = case.material.areal_density * case.evaluate(load.acceleration, xi, t)[0, 0]
                else:
                    density = case.evaluate(load.vector, xi, t)[0, 0]
                    if load.frame == "local":
                        along = x[1, 0] / length(x[1, 0])
                        density = _in_frame(density, along, cross(normal / area, along), normal / area)
                yield complex(weights.ravel() @ (area[:, 0] * dot(density, moved)))
            return
        assert isinstance(load, EdgeLoad | MomentLoad)
        for edge in (self.case.places[name] for name in load.on):
            assert isinstance(edge, Edge)
            rule = EdgeRule.on_edge(self.mesh, edge, EDGE_GAUSS_POINTS)
            running, xi = 1 - edge.axis, off.sites(rule.points)[0]
            x = off.position(rule.points)
            share = (rule.weights / 2 * rule.sizes[:, running, None]).ravel()
            speed = length(x[(0, 1) if running else (1, 0)])
            moved = self.on_edge(field, rule)
            if isinstance(load, MomentLoad):
                value = case.formula(load.value).derivatives(xi, 0, t)[0, 0]
                turn = value * _turn_about(load.axis, x, moved)
            else:
                vector = case.evaluate(load.vector, xi, t)[0, 0]
                if load.frame == "local":
                    vector = _in_frame(vector, *edge_frame(x, edge))
                turn = dot(vector, moved[:, 0])
            yield complex(share @ (speed[:, 0] * turn))

    def spring_work(self, fields: Array, off: Deviation) -> float:
        """Return the derivative of the work of the springs of u on v."""
        case = off.part or off.moved
        if not case.springs or not (off.moves_surface or off.part is not None):
            return 0.0

        def stiffness(case: Case, points: Array, xi: Numbers) -> Numbers:
            found = np.zeros((len(points), 3), dtype=complex)
            for spring in (off.part or case).springs:
                held = ["xyz".index(c) for c in spring.components]
                found[:, held] += case.formula(spring.stiffness).derivatives(xi, 0)[0, 0][:, None]
            return found

        found = self.products(fields, off, stiffness, SPRING_ORDER)
        return found.real if off.part is not None else off.rate(found)

    def mass_density(self, case: Case, points: Array, xi: Numbers) -> Numbers:
        """Return the mass per area (n, 1), kg/m^2."""
        return np.full((len(points), 1), case.material.areal_density)

    def products(
        self, fields: Array, off: Deviation, density: Callable[[Case, Array, Numbers], Numbers], order: int = 0
    ) -> complex:
        """Return the integral over the area of a density, by component, times the products of u and v."""
        quadrature = Quadrature.of_order(self.mesh, order) if order else self.quadrature
        found = 0j
        for cells in cell_portions(self.mesh, PORTION):
            points, weights = quadrature.on_cells(self.mesh, cells)
            flat = points.reshape(-1, 2)
            u, v = np.moveaxis(derivatives_on_cells(self.mesh, cells, quadrature, fields, ((0, 0),))[:, 0], -1, 0)
            x = off.position(flat, 1)
            area = weights.ravel() * length(cross(x[1, 0], x[0, 1]))[:, 0]
            found += complex(area @ dot(density(off.moved, flat, off.sites(flat)[0]) * u, v))
        return found

    def clamp_work(self, fields: Array, off: Deviation, t: float | None, symmetric: bool = True) -> float:
        """Return the derivative of the work of the terms of clamps between nodes (see `mechanics.clamping`).

        At rest where t is None. Without `symmetric` only of m(v) (theta(u) - theta0), which is no force of the support.
        """
        found = 0j
        case = off.moved
        if off.part is not None or off.parameter.point:
            return 0.0
        for support, edge in self.case.supported_places():
            if (
                not support.clamped
                or not isinstance(edge, Edge)
                or constant_normal(self.case, self.mesh, edge) is not None
            ):
                continue
            rule = EdgeRule.on_edge(self.mesh, edge, GAUSS_POINTS)
            x, shape = off.position(rule.points), (len(rule.cells), GAUSS_POINTS)
            _, outward, normal = edge_frame(x, edge)
            base = np.stack([x[1, 0], x[0, 1]], axis=1)
            parts = np.einsum("nai,ni->na", base, outward)
            both = [self.on_edge(fields[..., k], rule)[:, 1:] for k in (0, 1)]
            strains = strained(x, {FIRST: both[0], SECOND: both[1]}, 1)
            m11, m22, m12 = strains.metric
            raised = np.stack([m11 * parts[:, 0] + m12 * parts[:, 1], m12 * parts[:, 0] + m22 * parts[:, 1]], axis=-1)
            pairs = np.stack([parts[:, 0] ** 2, parts[:, 1] ** 2, parts[:, 0] * parts[:, 1]])
            sites: Any = off.sites(rule.points)[0]
            bent = stiffness_moduli(case.surface, case.material, sites)[:, 1]
            unit = Strained(
                strains.area, strains.metric, {(0, 0): np.concatenate([0 * pairs, pairs]), **strains.strains}
            )
            ratio = case.material.poissons_ratios[1]
            moments = [bent * unit.work(ratio, 1, (0, 0), key) for key in (FIRST, SECOND)]
            tilts: list[Any] = [sum(raised[:, a] * dot(f[:, a], normal) for a in (0, 1)) for f in both]
            if t is not None:
                motion = self.case.motion(support, edge, rule.points, t, order=1)
                tilts[0] = tilts[0] - sum(raised[:, a] * dot(motion[d], normal) for a, d in enumerate((FIRST, SECOND)))
            speed = length(x[(0, 1) if edge.axis == 0 else (1, 0)])[:, 0]
            height = (strains.area / speed).reshape(shape).mean(axis=1) * rule.sizes[:, edge.axis]
            spring = GAMMA * ((self.mesh.degree - 1) / 2) ** 2 * bent.reshape(shape).max(axis=1) / height
            share = speed * (rule.weights / 2 * rule.sizes[:, 1 - edge.axis, None]).ravel()
            total = moments[1] * tilts[0]
            if symmetric:
                total = total + moments[0] * tilts[1] + np.repeat(spring, GAUSS_POINTS) * tilts[0] * tilts[1]
            found += complex(np.sum(share * total))
        return off.rate(found)

    def scaled(self, field: Array) -> Array:
        """Return coefficients (nodes, 3, kinds) as scaled degrees of freedom (nodes, 3 kinds)."""
        return np.asarray((field * self.mesh.node_scales[:, None]).reshape(len(field), -1))

    def values(self, field: Array, points: Array, orders: Sequence[Derivative]) -> Array:
        """Return derivatives (n, orders, 3) of a field at points (n, 2)."""
        nodes, unit, sizes = self.mesh.locate(points)
        table = functions_at(self.mesh, unit, sizes, orders)
        return np.asarray(np.einsum("noak,nack->noc", table, field[nodes]))

    def on_edge(self, field: Array, rule: EdgeRule) -> Array:
        """Return the value and derivatives (n, 6, 3) of a field at the points of an edge."""
        count = len(rule.unit)
        nodes, sizes = np.repeat(self.mesh.nodes[rule.cells], count, axis=0), np.repeat(rule.sizes, count, axis=0)
        table = functions_at(self.mesh, np.tile(rule.unit, (len(rule.cells), 1)), sizes, ((0, 0), *DERIVATIVES))
        return np.asarray(np.einsum("noak,nack->noc", table, field[nodes]))


SPRING_ORDER = 19  # as in `shellbench.solvers.fem.mechanics.assembly`


def functions_at(mesh: TensorMesh, unit: Array, sizes: Array, orders: Sequence[Derivative]) -> Array:
    """Return derivatives (n, orders, 4, kinds) of the basis at points (n, 2) of the unit cells of sizes (n, 2)."""
    scales = kind_scales(sizes, mesh.basis)[:, None]
    tables = [
        tabulate(unit, d, mesh.basis) * scales / np.prod(sizes ** np.array(d), axis=-1)[:, None, None] for d in orders
    ]
    return np.stack(tables, axis=1)


def _in_frame(vectors: Numbers, *frame: Numbers) -> Numbers:
    return np.asarray(sum(vectors[:, k, None] * axis for k, axis in enumerate(frame)))


def edge_frame(x: dict[Derivative, Numbers], edge: Edge) -> tuple[Numbers, Numbers, Numbers]:
    """Return unit vectors (n, 3) along an edge, outward across it within the surface, and normal to the surface."""
    normal = cross(x[1, 0], x[0, 1])
    normal = normal / length(normal)
    along = x[(0, 1) if edge.axis == 0 else (1, 0)]
    along = along / length(along)
    across = cross(normal, along)
    return along, (-across if (edge.axis == 0) == (edge.side == "max") else across), normal


def _turn_about(axis: Sequence[float], x: dict[Derivative, Numbers], moved: Array) -> Numbers:
    """Return the angle (n,) by which the normal turns about an axis: (e x n) . dn / |n - (n . e) e|^2."""
    e = np.asarray(axis) / np.linalg.norm(axis)
    product = cross(x[1, 0], x[0, 1])
    area = length(product)
    normal = product / area
    change = (cross(moved[:, 1], x[0, 1]) + cross(x[1, 0], moved[:, 2])) / area  # less its part along n
    lean = cross(np.broadcast_to(e, normal.shape), normal)
    return np.asarray(dot(lean, change) / (1 - (normal @ e) ** 2))
