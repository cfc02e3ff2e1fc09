"""Equilibrium of Naghdi's shell on a grid: cells without their inner functions, one sparse solve, and its residuals.

Inner functions of a cell meet no other cell. They are eliminated cell by cell (static condensation), and the rest is
factorised once. Residuals are forces less stress times strain of the last answer, not the matrix times it. In a matrix
of a thin shell stretching and bending are summed, and bending loses digits. Corrections by the same factors regain
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bmat, csc_matrix, diags
from scipy.sparse.linalg import splu

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS
from shellbench.problems.shell.question.loads import EdgeLoad
from shellbench.problems.shell.question.places import Edge
from shellbench.solvers.naghdi.grid import Array, Grid, Numbers, functions, gauss
from shellbench.solvers.naghdi.strains import FIELDS, STRAINS, Frame, load_density
from shellbench.solvers.naghdi.supports import held_fields

MORE_POINTS = 3  # Gauss points a side beyond the degree: coefficients of a curved shell are no polynomials
CORRECTIONS, SETTLED = 8, 1e-13  # at most; of the energy, what a correction may add at the end
PARTS = slice(0, 3), slice(3, 6), slice(6, 8)  # rows of strains: membrane, bending, shear


@dataclass(frozen=True)
class Equilibrium:
    """The strains and forces of a grid.

    Attributes
    ----------
    tables
        For each coordinate (2, cells, points, degree + 1): values and slopes of its functions at Gauss points.
    roots
        (cells, cells, points, points, 8, 15): squares of roots times the jet sum up to twice the energy.
    areas
        (cells, cells, points, points) weights, m^2.
    forces
        (functions, functions, 5): work on each function.
    held
        The same shape: whether a function is held at zero.
    """

    case: Case
    grid: Grid
    tables: tuple[Array, Array]
    roots: Array
    areas: Array
    forces: Array
    held: NDArray[np.bool_]

    @classmethod
    def of(cls, case: Case, grid: Grid) -> Equilibrium:
        """Return strains, forces and supports of a case on a grid."""
        count = grid.degree + MORE_POINTS
        (first, w1), (second, w2) = (gauss(ends, count) for ends in grid.ends)
        table = functions(np.polynomial.legendre.leggauss(count)[0], grid.degree)
        tables = []
        for ends in grid.ends:
            scale = np.stack([np.ones(len(ends) - 1), 2 / np.diff(ends)])
            tables.append(scale[:, :, None, None] * table[:, None])
        shape = (*grid.cells, count, count)
        roots, areas, loads = np.empty((*shape, STRAINS, 3 * FIELDS)), np.empty(shape), np.empty((*shape, 3))
        for row in range(grid.cells[0]):
            xi = np.stack(np.broadcast_arrays(first[row][None, :, None], second[:, None, :]), axis=-1).reshape(-1, 2)
            frame = Frame.at(case, xi)
            areas[row] = frame.area.reshape(shape[1:]) * w1[row][:, None] * w2[:, None, :]
            loads[row] = load_density(case, frame, xi).reshape(*shape[1:], 3)
            operator = frame.operator()
            for stiffness, of in zip(frame.stiffness(case), PARTS, strict=True):
                root = np.swapaxes(np.linalg.cholesky(stiffness[:, of, of]), 1, 2)
                weighted = np.sqrt(areas[row]).reshape(-1, 1, 1) * (root @ operator[:, of])
                roots[row][..., of, :] = weighted.reshape(*shape[1:], -1, 3 * FIELDS)
        made = cls(case, grid, (tables[0], tables[1]), roots, areas, np.empty(0), np.empty(0, dtype=bool))
        jets = np.zeros((*shape, 3, FIELDS))
        jets[..., 0, :3] = areas[..., None] * loads
        forces = made.gathered(jets)
        forces[..., :3] += _edge_forces(case, grid)
        return cls(case, grid, made.tables, roots, areas, forces, _held(case, grid))

    def jets(self, coefficients: Array) -> Array:
        """Return fields and slopes (cells, cells, points, points, 3, 5) of coefficients (functions, functions, 5)."""
        local = coefficients[self.grid.numbers(0)[:, None, :, None], self.grid.numbers(1)[None, :, None, :]]
        (v1, s1), (v2, s2) = self.tables
        along = [np.einsum("api,abijk->abpjk", of, local, optimize=True) for of in (v1, s1)]
        pairs = ((along[0], v2), (along[1], v2), (along[0], s2))
        return np.stack([np.einsum("bqj,abpjk->abpqk", of, a, optimize=True) for a, of in pairs], axis=-2)

    def gathered(self, jets: Array) -> Array:
        """Return the work (functions, functions, 5) of each function on dual jets: the transpose of `jets`."""
        (v1, s1), (v2, s2) = self.tables
        pairs = ((v1, v2), (s1, v2), (v1, s2))
        local = sum(
            np.einsum("api,bqj,abpqk->abijk", first, second, jets[..., d, :], optimize=True)
            for d, (first, second) in enumerate(pairs)
        )
        total = np.zeros((self.grid.count(0), self.grid.count(1), FIELDS))
        np.add.at(total, (self.grid.numbers(0)[:, None, :, None], self.grid.numbers(1)[None, :, None, :]), local)
        return total

    def strained(self, coefficients: Array) -> Array:
        """Return roots times jets (cells, cells, points, points, 8)."""
        jets = self.jets(coefficients)
        return np.asarray(np.einsum("...sz,...z->...s", self.roots, jets.reshape(*jets.shape[:-2], -1), optimize=True))

    def residual(self, coefficients: Array) -> Array:
        """Return forces less those of the stresses (functions, functions, 5); zero where functions are held."""
        stressed = np.einsum("...sz,...s->...z", self.roots, self.strained(coefficients), optimize=True)
        return np.where(self.held, 0.0, self.forces - self.gathered(stressed.reshape(*stressed.shape[:-1], 3, FIELDS)))

    def energies(self, coefficients: Array) -> tuple[float, float, float]:
        """Return the energies of stretching, bending and shear, J."""
        strained = self.strained(coefficients)
        membrane, bending, shear = (0.5 * float(np.sum(strained[..., of] ** 2)) for of in PARTS)
        return membrane, bending, shear

    def solve(self, removed: tuple[str, ...]) -> Array:
        """Return the coefficients of equilibrium.

        Parameters
        ----------
        removed
            Rigid motions that nothing holds; some answer is made of many.

        Raises
        ------
        SolveFailure
            If a matrix is not positive, or corrections do not settle.
        """
        factors = _Factors.of(self, removed)
        answer = factors.solve(self.residual(np.zeros_like(self.forces)))
        scale = before = abs(float(np.vdot(self.forces, answer)))
        for _ in range(CORRECTIONS):
            left = self.residual(answer)
            change = factors.solve(left)
            added = abs(float(np.vdot(left, change)))
            if not added < before:
                break
            answer, before = answer + change, added
            if added <= SETTLED**2 * scale:
                break
        if not before <= SETTLED * scale:
            raise SolveFailure(f"corrections of the linear solve stay at {before / scale:.1g} of the energy")
        return answer


@dataclass(frozen=True)
class _Factors:
    """Factors of all cells, and of what is left.

    Attributes
    ----------
    cells
        By cell: the factors of its inner functions, and their response to its outer ones.
    outer, inner
        (cells, cells, n): numbers of the outer and inner functions of each cell, fields counted.
    """

    shape: tuple[int, ...]
    cells: list[tuple[tuple[Array, bool], Array]]
    outer: Numbers
    inner: Numbers
    free: Numbers
    scale: Array
    motions: int
    lu: object

    @classmethod
    def of(cls, shell: Equilibrium, removed: tuple[str, ...]) -> _Factors:
        """Eliminate the inner functions of each cell, and factorise the rest.

        Each cell's matrix is the square of its roots times functions.
        """
        grid, p = shell.grid, shell.grid.degree
        shape = shell.forces.shape
        i, j, k = (a.ravel() for a in np.meshgrid(np.arange(p + 1), np.arange(p + 1), np.arange(FIELDS), indexing="ij"))
        within = (i >= 2) & (j >= 2)
        number = (grid.numbers(0)[:, i][:, None] * shape[1] + grid.numbers(1)[:, j][None]) * FIELDS + k
        cells, blocks = [], []
        for first, second in np.ndindex(*grid.cells):
            matrix = _cell_matrix(shell, first, second)
            inside = cho_factor(matrix[np.ix_(within, within)], lower=True)
            across = matrix[np.ix_(within, ~within)]
            response = cho_solve(inside, across)
            blocks.append(matrix[np.ix_(~within, ~within)] - across.T @ response)
            cells.append((inside, response))
        outer, inner = number[..., ~within], number[..., within]
        flat = outer.reshape(len(cells), -1)
        rows, columns = np.repeat(flat, flat.shape[1], axis=1).ravel(), np.tile(flat, flat.shape[1]).ravel()
        size = int(np.prod(shape))
        whole = csc_matrix((np.array(blocks).ravel(), (rows, columns)), shape=(size, size))
        taken = np.zeros(size, dtype=bool)
        taken[flat] = True
        free = np.flatnonzero(taken & ~shell.held.ravel())
        skeleton = whole[free][:, free]
        scale = 1 / np.sqrt(skeleton.diagonal())
        scaled = diags(scale) @ skeleton @ diags(scale)
        motions = _rigid(shell, removed)[free]
        if motions.shape[1]:
            scaled = bmat([[scaled, csc_matrix(motions)], [csc_matrix(motions.T), None]])
        options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        return cls(shape, cells, outer, inner, free, scale, motions.shape[1], splu(csc_matrix(scaled), **options))

    def solve(self, right: Array) -> Array:
        """Return the answer (functions, functions, 5) to forces of the same shape."""
        total = right.ravel().copy()
        flat = [of.reshape(len(self.cells), -1) for of in (self.outer, self.inner)]
        for (_, response), outer, inner in zip(self.cells, *flat, strict=True):
            total[outer] -= response.T @ right.ravel()[inner]
        padded = np.concatenate([self.scale * total[self.free], np.zeros(self.motions)])
        answer = np.zeros(len(total))
        answer[self.free] = self.scale * self.lu.solve(padded)[: len(self.free)]  # type: ignore[attr-defined]
        for (inside, response), outer, inner in zip(self.cells, *flat, strict=True):
            answer[inner] = cho_solve(inside, right.ravel()[inner]) - response @ answer[outer]
        return answer.reshape(self.shape)


def _cell_matrix(shell: Equilibrium, first: int, second: int) -> Array:
    """Return the stiffness of a cell by its functions, the first coordinate's outermost and fields innermost."""
    roots = shell.roots[first, second]
    q, p1 = roots.shape[0], shell.grid.degree + 1
    (v1, s1), (v2, s2) = (of[:, n] for of, n in zip(shell.tables, (first, second), strict=True))
    total = np.zeros((q * q, STRAINS, p1 * p1, FIELDS))
    jets = roots.reshape(q * q, STRAINS, 3, FIELDS)
    for d, (one, other) in enumerate(((v1, v2), (s1, v2), (v1, s2))):
        table = (one[:, None, :, None] * other[None, :, None, :]).reshape(q * q, -1)
        total += table[:, None, :, None] * jets[:, :, None, d]
    flat = total.reshape(q * q * STRAINS, -1)
    return flat.T @ flat


def _held(case: Case, grid: Grid) -> NDArray[np.bool_]:
    """Return a mask (functions, functions, 5) of the functions that supports hold at zero."""
    held = np.zeros((grid.count(0), grid.count(1), FIELDS), dtype=bool)
    for field, edges in enumerate(held_fields(case)):
        for edge in edges:
            number = 0 if edge.side == "min" else grid.corners(edge.axis) - 1
            held[..., field][(number, slice(None)) if edge.axis == 0 else (slice(None), number)] = True
    return held


def _edge_forces(case: Case, grid: Grid) -> Array:
    """Return the work (functions, functions, 3) of loads on edges on each function."""
    total = np.zeros((grid.count(0), grid.count(1), 3))
    for load in (load for load in case.loads if isinstance(load, EdgeLoad)):
        for name in load.on:
            edge = case.places[name]
            assert isinstance(edge, Edge)
            along = 1 - edge.axis
            running, weights = (of.ravel() for of in gauss(grid.ends[along], grid.degree + MORE_POINTS))
            xi = edge.points(case.surface.domain, running)
            slope = case.surface.derivatives(xi, 1)[(0, 1) if along else (1, 0)]
            force = case.evaluate(load.vector, xi)[0, 0] * (weights * np.linalg.norm(slope, axis=-1))[:, None]
            cell, found = grid.at(along, running)
            work = np.zeros((grid.count(along), 3))
            np.add.at(work, grid.numbers(along)[cell], found[0][:, :, None] * force[:, None])
            number = 0 if edge.side == "min" else grid.corners(edge.axis) - 1
            total[(number, slice(None)) if edge.axis == 0 else (slice(None), number)] += work
    return total


def _rigid(shell: Equilibrium, removed: tuple[str, ...]) -> Array:
    """Return rigid motions (functions, n) at the corners of cells, zero elsewhere: what holds them at some place."""
    grid = shell.grid
    n1, n2 = grid.corners(0), grid.corners(1)
    xi = np.stack(np.meshgrid(grid.ends[0][:n1], grid.ends[1][:n2], indexing="ij"), axis=-1)
    wanted = [RIGID_MOTIONS.index(name) for name in removed]
    out = np.zeros((grid.count(0), grid.count(1), FIELDS, len(wanted)))
    out[:n1, :n2, :3] = rigid_modes(shell.case.surface, xi)[0, 0][..., wanted]
    return out.reshape(grid.count(0) * grid.count(1) * FIELDS, len(wanted))
