"""The finite element solution: a continuous field by its own C1 interpolation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import middle_and_size, motions_of
from shellbench.problems.shell.question.contact import Touch, kept_touch, restored_touch
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, state_number
from shellbench.solvers.fem.mechanics.assembly import derivatives_on_cells
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    Deformation,
    Midsurface,
    cross,
    dot,
    elasticities,
    linear_strains,
    points_fastest,
    stiffness_moduli,
)
from shellbench.solvers.fem.mechanics.resultants import resultants
from shellbench.solvers.fem.mechanics.rigid_motions import nodal_rigid_motions
from shellbench.solvers.fem.mechanics.strain_energy import stiffening_membrane
from shellbench.solvers.fem.mesh.basis import (
    COMPONENTS,
    CUBIC,
    KINDS,
    Derivative,
    axis_functions,
    cell_functions,
    kind_scales,
    present_on_axis,
)
from shellbench.solvers.fem.mesh.bubbles import interpolation_coefficients
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import CHUNK, Quadrature, cell_portions

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
EnergyRule = list[tuple[Integers, Midsurface, Array]]  # see `FemSolution.energy_rule`

FORMATS = ("fem, format 1", 1)  # of files; the second is the older name of the first format
INTEGRATED = ("_energies", "area", "energy_rule")  # cached data of the displacement field alone
POINTS = 1024  # at which a field is evaluated at once


@dataclass(frozen=True)
class FemSolution(ShellSolution):
    """A displacement field on a tensor mesh, at one or several times or load factors.

    Attributes
    ----------
    case
        The case it answers.
    mesh
        Mesh of the field.
    coefficients
        (nodes, 3, (p - 1)^2, states) u, u,1, u,2 and u,12 of each component at each node, and from degree 4 on the
        bubbles of the cell that begins there.
    states
        Times, or load factors.
    support_nodes, support_forces
        (k,) nodes with supports, and (supports, k, 3, 4, states) the forces there that each of the case's supports
        exerts: the residual of equilibrium, conjugate to `coefficients`.
    quadrature_order
        Of the rule that energies are integrated by.
    parameters
        Degrees of freedom that were solved for.
    images
        Number of mirror images of the first cells that make up the field, along each coordinate (see `symmetry`); 1 if
        the part that was solved does not begin at the first mesh line.
    touching
        Contact forces by state; empty without obstacles.
    """

    formats: ClassVar[tuple[str | int, ...]] = FORMATS
    numbers: ClassVar[tuple[str, ...]] = ("coefficients",)

    case: Case
    mesh: TensorMesh
    coefficients: Array
    states: tuple[float, ...]
    support_nodes: NDArray[np.int64]
    support_forces: Array
    quadrature_order: int
    parameters: int
    images: tuple[int, int] = (1, 1)
    touching: tuple[Touch, ...] = ()

    @property
    def storage_bytes(self) -> int:
        """Bytes of the coefficients and the mesh lines."""
        return super().storage_bytes + sum(line.nbytes for line in self.mesh.lines)

    def state(self, at: float | None) -> int:
        """Return the number of a time or load factor; InputError if the case was not solved at it."""
        return state_number(self.case, self.states, at)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self.partial(xi, (0, 0), at)

    def partial(self, points: ArrayLike, order: Derivative, at: float | None = None) -> Array:
        """Return a partial derivative (..., 3) of the displacement at points (..., 2)."""
        # u = sum over a and b of F_a(x1) F_b(x2) u_ab, with p + 1 functions along each coordinate. The coefficients are
        # collected once, by cell. The points run fastest, so that sums over a and b are sums of long rows.
        xi = np.asarray(points, dtype=float)
        flat, basis = xi.reshape(-1, 2), self.mesh.basis
        carried = self._factors_by_cell(self.state(at))
        found = np.empty((len(flat), COMPONENTS))
        for start in range(0, len(flat), POINTS):  # in portions that stay in the cache
            portion = slice(start, start + POINTS)
            cells, unit, sizes = self.mesh.find_cells(flat[portion])
            along, across = (
                axis_functions(unit[:, axis], order[axis], basis.degree, basis.folded == axis)
                .reshape(len(unit), -1)
                .T[present_on_axis(basis, axis)]
                for axis in (0, 1)
            )
            terms = carried.take(cells, axis=-1)
            terms *= np.ascontiguousarray(along)[:, None]
            sums = terms.sum(axis=1)
            sums *= across
            values = sums.sum(axis=1)
            if any(order):
                values /= np.prod(sizes ** np.array(order), axis=-1)
            found[portion] = values.T
        return found.reshape(*xi.shape[:-1], COMPONENTS)

    @cached_property
    def _factors_by_cell(self) -> Callable[[int], Array]:
        """Factors of the cells' functions at a state, (3, p + 1, p + 1, cells), as a function; see `cell_functions`."""
        return lru_cache(maxsize=1)(self._collect_factors)

    def _collect_factors(self, state: int) -> Array:
        nodes, sizes = self.mesh.cell_corners
        corners, kinds = cell_functions(self.mesh.basis)
        carried = self.coefficients[..., state].transpose(1, 2, 0)[:, kinds[..., None], nodes.T[corners]]
        carried *= kind_scales(sizes, self.mesh.basis).T[kinds]
        return np.asarray(carried)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        strains, densities = self._fields(xi.tobytes(), self.state(at))
        part = 0 if name.startswith("membrane") else 1
        return strains[:, part] if name.endswith("strain") else densities[:, part]

    @cached_property
    def _fields(self) -> Callable[[bytes, int], tuple[Array, Array]]:
        """Strains (n, 2, 3) and energy densities (n, 2) at points and a state, cached, since both are often needed."""

        def strained(points: bytes, state: int) -> tuple[Array, Array]:
            xi, at = np.frombuffer(points).reshape(-1, 2), self.states[state]
            gradients = np.stack([self.partial(xi, d, at) for d in DERIVATIVES], axis=1)
            return self._strains(xi, gradients)

        return lru_cache(maxsize=1)(strained)

    def with_description(self, **more: Any) -> FemSolution:
        """Return the solution with changed fields that describe it; integrals of its displacement field stay cached."""
        found = replace(self, **more)
        found.__dict__.update({name: self.__dict__[name] for name in INTEGRATED if name in self.__dict__})
        return found

    def resultant_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return membrane forces or moments (N, 3), or shear forces (N, 2), at points (N, 2), recovered on patches."""
        return resultants(self, name, xi, at)

    def _strains(self, points: Array, gradients: Array) -> tuple[Array, Array]:
        """Return strains (n, 2, 3) and energy densities (n, 2), membrane before bending.

        `gradients` (n, 5, 3) are the derivatives of the displacement in the order of `DERIVATIVES`.
        """
        surface = Midsurface.from_position(self.case.surface.derivatives(self.mesh.domain.wrap(points), order=2))
        strains = self._strained(surface, gradients).reshape(-1, 2, 3)
        material = self.case.material
        stiffness = stiffness_moduli(self.case.surface, material, self.mesh.domain.wrap(points))
        stresses = (strains[:, :, None] @ elasticities(surface, material))[:, :, 0]
        densities = stiffness / 2 * np.sum(stresses * strains, axis=-1)
        if (membrane := stiffening_membrane(surface, material)) is not None:
            densities[:, 0] = membrane.respond(strains[:, 0])[0]
        return strains, densities

    def _strained(self, surface: Midsurface, gradients: Array) -> Array:
        """Return the strains (n, 6) of the case's theory."""
        if self.case.linear:
            return linear_strains(surface, gradients)
        return Deformation.from_gradients(surface, gradients).strains

    @cached_property
    def area(self) -> float:
        """Area of the midsurface, m^2."""
        quadrature, total = Quadrature.of_order(self.mesh, self.quadrature_order), 0.0
        for cells in self._cells():
            points, weights = quadrature.on_cells(self.mesh, cells)
            surface = Midsurface.from_position(self.case.surface.derivatives(points.reshape(-1, 2), order=2))
            total += float(weights.ravel() @ surface.area)
        return total * self.images[0] * self.images[1]

    def _cells(self) -> Iterator[Integers]:
        """Yield the numbers of the cells whose mirror images the others are, in portions."""
        inside = np.ones(len(self.mesh.origins), dtype=bool)
        for axis, (line, images) in enumerate(zip(self.mesh.lines, self.images, strict=True)):
            middles = self.mesh.origins[:, axis] + self.mesh.sizes[:, axis] / 2
            inside &= middles < line[(len(line) - 1) // images]
        numbers = np.flatnonzero(inside)
        for start in range(0, len(numbers), CHUNK):
            yield numbers[start : start + CHUNK]

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        return self._energies[self.state(at)]

    @cached_property
    def _energies(self) -> list[tuple[float, float]]:
        quadrature = Quadrature.of_order(self.mesh, self.quadrature_order)
        total = np.zeros((len(self.states), 2))
        for cells, surface, stiffness in self.energy_rule:
            gradients = derivatives_on_cells(self.mesh, cells, quadrature, self.coefficients)
            membrane = stiffening_membrane(surface, self.case.material)
            for state in range(len(self.states)):
                strains = self._strained(surface, gradients[..., state])
                if membrane is not None:
                    share = quadrature.on_cells(self.mesh, cells)[1].ravel() * surface.area
                    total[state, 0] += share @ membrane.respond(strains[:, :3])[0]
                for part in (0, 1) if membrane is None else (1,):
                    three = strains[:, 3 * part : 3 * part + 3]
                    for row in range(3):
                        total[state, part] += dot(stiffness[:, part, row], three) @ three[:, row] / 2
        total *= self.images[0] * self.images[1]
        return [(float(membrane), float(bending)) for membrane, bending in total]

    @cached_property
    def energy_rule(self) -> EnergyRule:
        """By portion of cells, the geometry at their Gauss points, and the weighted stiffness there (n, 2, 3, 3)."""
        quadrature, case, rule = Quadrature.of_order(self.mesh, self.quadrature_order), self.case, []
        for cells in self._cells():
            points, weights = quadrature.on_cells(self.mesh, cells)
            flat = points.reshape(-1, 2)
            surface = Midsurface.from_position(case.surface.derivatives(flat, order=2))
            share = stiffness_moduli(case.surface, case.material, flat) * (weights.ravel() * surface.area)[:, None]
            stiffness = elasticities(surface, case.material) * share[:, :, None, None]
            rule.append((cells, surface.with_points_fastest(), points_fastest(stiffness)))
        return rule

    def rounded(self, format: NumberFormat) -> tuple[FemSolution, int]:
        """Return the solution with coefficients rounded to a format, and the bytes it takes."""
        short, bytes_taken = super().rounded(format)
        if "energy_rule" in vars(self):  # it is cached, and the mesh does not change
            vars(short)["energy_rule"] = self.energy_rule
        return short, bytes_taken

    @cached_property
    def _support_positions(self) -> Array:
        """(k, kinds, 3) the midsurface in the basis, at nodes with supports."""
        wrap, surface = self.mesh.domain.wrap, self.case.surface
        if self.mesh.degree > CUBIC:
            found = interpolation_coefficients(self.mesh, lambda points: surface.derivatives(wrap(points), order=2))
            return np.swapaxes(found[self.support_nodes], 1, 2)
        x = surface.derivatives(wrap(self.mesh.node_points[self.support_nodes]), order=2)
        return np.stack([x[kind] for kind in KINDS], axis=1)

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        Both are the work of the nodal forces on the interpolant of a rigid motion of the support: of the undeformed
        one in linear theory, of the deformed one in the non-linear theory.
        """
        forces = self.support_forces[number, ..., self.state(at)]
        arms = self._support_positions.copy()
        arms[:, 0] -= centre
        if not self.case.linear:
            arms = arms + np.swapaxes(self.coefficients[self.support_nodes, ..., self.state(at)], 1, 2)
        moment = np.cross(arms, np.swapaxes(forces, 1, 2)).sum(axis=(0, 1))
        return forces[:, :, 0].sum(axis=0), moment

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of obstacles on the shell at a state."""
        return self.touching[self.state(at)] if self.touching else super().touch(at)

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that a file holds beside the case and the history."""
        words = {"quadrature_order": self.quadrature_order, "images": self.images, "degree": self.mesh.degree}
        return words, {
            **kept_touch(self.touching),
            "lines1": self.mesh.lines[0],
            "lines2": self.mesh.lines[1],
            "coefficients": self.coefficients,
            "states": np.asarray(self.states),
            "support_nodes": self.support_nodes,
            "support_forces": self.support_forces,
        }

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> FemSolution:
        """Make a solution from the data of a file; ValueError or KeyError if they are inconsistent."""
        lines, surface = (arrays["lines1"], arrays["lines2"]), case.surface
        mesh = TensorMesh(surface.domain, lines, words.get("degree", CUBIC), surface.fold_lines)
        states = tuple(float(s) for s in arrays["states"])
        nodes = np.asarray(arrays["support_nodes"], dtype=np.int64)
        coefficients, forces = arrays["coefficients"], arrays["support_forces"]
        first, second = words.get("images", (1, 1))
        carried = len(mesh.kinds)
        if coefficients.shape != (mesh.node_count, 3, carried, len(states)):
            raise ValueError("coefficients do not fit the mesh")
        if forces.shape != (len(case.supports), len(nodes), 3, carried, len(states)):
            raise ValueError("forces do not fit the supports")
        order, unknowns = int(words["quadrature_order"]), int(words["parameters"])
        images = (int(first), int(second))
        return cls(case, mesh, coefficients, states, nodes, forces, order, unknowns, images, restored_touch(arrays))


def mean_rigid_motion(case: Case, mesh: TensorMesh, quadrature: Quadrature, coefficients: Array, loose: Array) -> Array:
    """Return the part of a field (nodes, 3, 4, states) that is a loose rigid motion in the mean over the area."""
    motions = (nodal_rigid_motions(case, mesh) @ loose).reshape(*coefficients.shape[:-1], -1)
    motions = motions / mesh.node_scales[:, None, :, None]
    fields = np.concatenate([coefficients, motions], axis=-1)
    products = np.zeros((loose.shape[1], fields.shape[-1]))
    centre, size = middle_and_size(case.surface)
    for cells in cell_portions(mesh):
        points, weights = quadrature.on_cells(mesh, cells)
        x = case.surface.derivatives(points.reshape(-1, 2), order=1)
        area = weights.ravel() * np.linalg.norm(cross(x[1, 0], x[0, 1]), axis=-1)
        exact = motions_of((x[0, 0] - centre) / size, True) @ loose
        values = derivatives_on_cells(mesh, cells, quadrature, fields, ((0, 0),))
        weighted = (exact * area[:, None, None]).reshape(-1, loose.shape[1])
        products += weighted.T @ values.reshape(-1, fields.shape[-1])
    overlap, gram = np.split(products, [coefficients.shape[-1]], axis=1)
    return np.asarray(motions @ np.linalg.solve(gram, overlap))
