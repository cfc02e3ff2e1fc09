"""Contact of the linear shell with obstacles: the least energy among displacements that enter none.

The gap is asked at p - 1 Gauss points of a cell along each coordinate, as many as a C1 spline of degree p has freedom
there: what touches everywhere then follows the obstacle as exactly as it can. The pressures at these points are the
multipliers of an augmented Lagrangian. Mechanics, supports and direct solver are those of `equilibrium`; what is added
to the stiffness lies within single cells, so that its pattern stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.contact import Touch, gaps
from shellbench.solvers.fem.block_matrix import BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.cell_matrices import CellMatrices
from shellbench.solvers.fem.kinematics import Midsurface, stiffness_moduli
from shellbench.solvers.fem.mesh import COMPONENTS, CORNERS, TensorMesh, gauss_rule, tabulate
from shellbench.solvers.fem.quadrature import Quadrature, basis_scales, chunks

if TYPE_CHECKING:
    from shellbench.solvers.fem.direct_solve import Answer
    from shellbench.solvers.fem.solution import FemSolution

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Matrix = BlockMatrix | CellMatrices
SolveLinear = Callable[[Matrix, Array], tuple[Array, "Answer"]]
"""Solves K q = f with the supports: the matrix and forces (nodes, 12, 1) to q and how sure it is."""

STIFFNESS = 100.0  # of a point in contact, in that of bending between such points: each step divides gaps by that
MOST_STEPS, MOST_SETS = 20, 60  # of the multipliers, and of points in contact between two of them
FEW_SETS = 5  # while obstacles are soft
SETTLED = 1e-8  # of the largest displacement: gaps that are closed
SOFTER = 1 / 40  # of the penalty, while an edge of contact is far from its place; it moves 2.5 times as far
REACH = 2.0  # cells over which forces make a pressure


@dataclass(frozen=True)
class ContactPoints:
    """The points of a mesh at which the gap is asked, m of them in each of c cells.

    Attributes
    ----------
    points
        (c m, 2) in the domain.
    areas
        (c, m) of the shell at rest that they stand for, m^2.
    values
        (c, m, 4, kinds) basis functions there, in the scaled degrees of freedom.
    stiffness
        (c, m) of the penalty, N/m^3.
    lengths, reach
        See `shellbench.problems.shell.contact.Touch`.
    """

    case: Case
    mesh: TensorMesh
    points: Array
    areas: Array
    values: Array
    stiffness: Array
    lengths: Array
    reach: Array

    @classmethod
    def on_mesh(cls, case: Case, mesh: TensorMesh) -> ContactPoints:
        """Choose the points of a mesh."""
        count = mesh.degree - 1
        x, w = gauss_rule(count)
        unit = np.stack(np.meshgrid((x + 1) / 2, (x + 1) / 2, indexing="ij"), axis=-1).reshape(-1, 2)
        one, two = (part.ravel() / 2 for part in np.meshgrid(w, w, indexing="ij"))
        rule = Quadrature(unit, one * two)
        table = tabulate(unit, (0, 0), mesh.degree)
        points, areas, values, stiffness, lengths, longest = [], [], [], [], [], []
        for cells in chunks(mesh):
            at, weights = rule.on_cells(mesh, cells)
            flat = at.reshape(-1, 2)
            surface = Midsurface.at(case.surface.derivatives(flat, order=2))
            bending = stiffness_moduli(case.surface, case.material, flat)[:, 1].reshape(weights.shape)
            area = surface.area.reshape(weights.shape)
            sides = np.linalg.norm(surface.base, axis=-1).reshape(*weights.shape, 2) * mesh.sizes[cells][:, None]
            points.append(flat)
            areas.append(weights * area)
            values.append(table * basis_scales(mesh, cells)[:, None])
            stiffness.append(STIFFNESS * bending * np.sum((count / sides) ** 4, axis=-1))
            lengths.append((sides * np.stack([one, two], axis=-1)).reshape(-1, 2))
            longest.append(sides.reshape(-1, 2).max(axis=0))
        whole = [np.concatenate(part) for part in (points, areas, values, stiffness, lengths)]
        return cls(case, mesh, whole[0], whole[1], whole[2], whole[3], whole[4], REACH * np.max(longest, axis=0))

    def displacement(self, q: Array) -> Array:
        """Return the displacement (c m, 3) at the points of q (nodes, 12, 1)."""
        nodal = q.reshape(-1, COMPONENTS, len(self.mesh.kinds))[self.mesh.nodes]
        found = np.einsum("cmak,caik->cmi", self.values, nodal, optimize=True)
        return np.asarray(found.reshape(-1, COMPONENTS))

    def nodal(self, forces: Array) -> Array:
        """Return the nodal forces (nodes, 12, 1) of forces (c m, 3), N, at the points."""
        spread = np.einsum("cmak,cmi->caik", self.values, forces.reshape(*self.areas.shape, COMPONENTS), optimize=True)
        result = np.zeros((self.mesh.node_count, COMPONENTS, len(self.mesh.kinds)))
        for corner in range(len(CORNERS)):
            np.add.at(result, self.mesh.nodes[:, corner], spread[:, corner])
        return result.reshape(len(result), -1, 1)

    def stiffened(self, matrix: Matrix, normals: Array, penalty: Array) -> Matrix:
        """Return a stiffness matrix with the penalty (c m,) of the points in contact, N/m^3, zero at others."""
        stiff = (self.areas * penalty.reshape(self.areas.shape))[..., None]
        cells = np.flatnonzero(np.any(stiff > 0, axis=(1, 2)))
        if not len(cells):
            return matrix
        directions = normals.reshape(*self.areas.shape, COMPONENTS)[cells]
        values = self.values[cells]
        rows = np.einsum("cmi,cmak->cmiak", directions, values).reshape(*values.shape[:2], -1)
        terms = np.swapaxes(rows * stiff[cells], 1, 2) @ rows
        shape = (COMPONENTS, *values.shape[2:])
        terms = terms.reshape(-1, *shape, *shape)
        if isinstance(matrix, CellMatrices):
            stiffened = matrix.with_own(cells)
            stiffened.add(cells, terms)
            return stiffened
        result = replace(matrix, blocks=matrix.blocks.copy())
        add_cell_matrices(result.blocks, self.mesh.nodes[cells], terms)
        return result

    @cached_property
    def penalty(self) -> Array:
        """(c m,) stiffness of each point, N/m^3."""
        return self.stiffness.ravel()

    def softness(self) -> Array:
        """Return factors of the penalty, increasing to 1: the first has the length of the shell."""
        size = float(np.ptp(self.case.surface.position(self.points), axis=0).max())
        coarse = size / (self.reach.min() / REACH)
        return np.asarray([SOFTER**k for k in range(math.ceil(-math.log(coarse**4) / math.log(SOFTER)), 0, -1)])

    def nearest(self, touch: Touch) -> NDArray[np.int64]:
        """Return the numbers (c m,) of the nearest points of another mesh."""
        _, nearest = cKDTree(touch.points / self.mesh.domain.size).query(self.points / self.mesh.domain.size)
        return np.asarray(nearest)

    def pressed(self, touch: Touch) -> Flags:
        """Return which points (c m,) are nearest to pressed points of another mesh."""
        return np.asarray(np.any(touch.forces[self.nearest(touch)] != 0, axis=-1))

    def touch(self, forces: Array) -> Touch:
        """Return forces (c m, 3) with what they act on."""
        return Touch(self.points, forces, self.lengths, self.reach)


@dataclass(frozen=True)
class Settled:
    """A displacement that enters no obstacle, and is pressed by those it touches.

    Attributes
    ----------
    q
        (nodes, 12, 1).
    answer
        How sure its last linear solve is.
    forces
        (c m, 3) at the points, N.
    """

    q: Array
    answer: Answer
    forces: Array


def settle(
    points: ContactPoints, matrix: Matrix, forces: Array, t: float, solve: SolveLinear, near: FemSolution | None = None
) -> Settled:
    """Return the displacement of least energy that enters no obstacle.

    Parameters
    ----------
    points
        Where the gap is asked.
    matrix, forces
        Of the shell without obstacles; (nodes, 12, 1).
    t
        Load factor.
    solve
        The direct solver.
    near
        An answer on another mesh, to start from.

    Raises
    ------
    SolveFailure
        If the points in contact do not settle, or their gaps do not close.
    """
    # 1. The gap g and its direction n where the shell is: obstacles that are curved are planes for this step. From rest
    #    on, so that no shell is thrown to the far side of one.
    # 2. With pressures p given, minimise the energy plus the integral of max(0, p - k g)^2 / 2 k: Newton's method on
    #    the points with p > k g. Where the same points come again, the step goes no further than to the exact minimum
    #    along it: the function is convex and piecewise quadratic, so that this ends.
    # 3. p = max(0, p - k g), and all over again, until gaps in contact are closed. Forces are in balance throughout.
    # The textbook's primal-dual active set holds gaps by multipliers in the linear system. There are as many points as
    # there is freedom, at some edges one too many, and such a system is singular; the penalty leaves K definite. And an
    # edge of contact moves by no more than the length at which bending is as stiff as the penalty, a point or two at a
    # time. So it is sought with soft obstacles first, or on a coarser mesh.
    area, stiff = points.areas.ravel(), points.penalty
    if near is None:
        q, answer = solve(matrix, forces)
        u, pressed = np.zeros((len(area), COMPONENTS)), None
        softness = points.softness()
    else:
        q, u, pressed, softness = None, near.displacement(points.points), points.pressed(near.touch()), np.zeros(0)
    pressure = np.zeros(len(area))
    for step in range(MOST_STEPS):
        gap, normal = gaps(points.case, points.points, u, t)
        plane = _Plane(points, matrix, forces, gap - np.sum(normal * u, axis=-1), normal, solve)
        for soft in softness if step == 0 else ():
            q, answer, _ = plane.minimum(q, pressure, soft * stiff, None, FEW_SETS)
        q, answer, done = plane.minimum(q, pressure, stiff, pressed if step == 0 else None, MOST_SETS)
        if not done:
            raise SolveFailure("the points in contact with an obstacle do not settle")
        pressure = np.maximum(pressure - stiff * plane.gap(q), 0.0)
        u = points.displacement(q)
        gap, _ = gaps(points.case, points.points, u, t)
        largest = float(np.abs(u).max())
        if np.all(np.where(pressure > 0, np.abs(gap), -gap) <= SETTLED * largest):
            return Settled(q, answer, (pressure * area)[:, None] * normal)
    raise SolveFailure("the gaps between an obstacle and the shell do not close")


@dataclass(frozen=True)
class _Plane:
    """The shell above planes: at each point the gap is offset + normal . u."""

    points: ContactPoints
    matrix: Matrix
    forces: Array
    offset: Array
    normal: Array
    solve: SolveLinear

    def gap(self, q: Array) -> Array:
        """Return the gap (c m,) at the points."""
        return self.offset + self.along(q)

    def along(self, q: Array) -> Array:
        """Return the displacement (c m,) along the normals."""
        return np.asarray(np.sum(self.normal * self.points.displacement(q), axis=-1))

    def minimum(
        self, q: Array | None, pressure: Array, stiff: Array, active: Flags | None, most: int
    ) -> tuple[Array, Answer, bool]:
        """Return the minimum with pressures given, and whether it is one; see `settle`.

        It starts from points in contact, or from a displacement.
        """
        area = self.points.areas.ravel()
        seen: set[bytes] = set()
        for _ in range(most):
            if active is None:
                assert q is not None  # one of both is given
                active = pressure - stiff * self.gap(q) > 0
            pushed = ((pressure - stiff * self.offset) * area * active)[:, None] * self.normal
            stiffened = self.points.stiffened(self.matrix, self.normal, stiff * active)
            found, answer = self.solve(stiffened, self.forces + self.points.nodal(pushed))
            if np.array_equal(active, pressure - stiff * self.gap(found) > 0):
                return found, answer, True
            share = 1.0
            if q is not None and active.tobytes() in seen:
                change = found - q
                moved = self.along(change)
                pushing = pressure - stiff * self.gap(q)
                share = _length(self.matrix, self.forces, q, change, (pushing, stiff * moved, area * moved))
            seen.add(active.tobytes())
            q = found if q is None else q + share * (found - q)
            active = None
        assert q is not None
        return q, answer, False


def _length(matrix: Matrix, forces: Array, q: Array, change: Array, pressed: tuple[Array, Array, Array]) -> float:
    """Return the share of a step, from 0 to 1, at which the function that is minimised is least."""
    # Its derivative along the step, work of the forces that are left, grows: r(s) = a + b s - max(0, p - s m) . w.
    pressures, slopes, works = pressed
    stiff = matrix @ change
    start, growth = float(np.sum(stiff * q) - np.sum(forces * change)), float(np.sum(stiff * change))

    def work(s: float) -> float:
        return start + growth * s - float(np.maximum(pressures - s * slopes, 0.0) @ works)

    if work(1.0) <= 0 or work(0.0) >= 0:
        return 1.0
    return float(brentq(work, 0.0, 1.0, xtol=1e-12))
