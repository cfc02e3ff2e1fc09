"""Contact of the linear shell with obstacles: the least energy among displacements that enter no obstacle.

The gap is evaluated at p - 1 Gauss points of a cell along each coordinate, the number of a C1 spline's degrees of
freedom there. A shell in full contact then follows the obstacle as closely as it can. The pressures at these points are
the multipliers of an augmented Lagrangian. Mechanics, supports and direct solver are those of `equilibrium`. The
contact stiffness couples within single cells, so that the pattern of K stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from shellbench.errors import SolveFailure
from shellbench.problems.shell.question.contact import gaps
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.mechanics.contact_points import CLOSED, ContactPoints, Flags
from shellbench.solvers.fem.mesh.basis import COMPONENTS

if TYPE_CHECKING:
    from shellbench.solvers.fem.algebra.direct_solve import LinearSolution
    from shellbench.solvers.fem.mesh.basis import ROUNDING
from shellbench.solvers.fem.mechanics.solution import FemSolution

Array = NDArray[np.float64]
Matrix = BlockMatrix | CellMatrices
SolveLinear = Callable[[Matrix, Array], tuple[Array, "LinearSolution"]]
"""Solves K q = f with the supports: the matrix and forces (nodes, 12, 1) to q and how sure it is."""

MOST_MULTIPLIERS, MOST_SETS = 20, 60  # updates of the multipliers, and of the points in contact between two of them
FEW_SETS = 5  # while obstacles are soft


@dataclass(frozen=True)
class ContactEquilibrium:
    """A displacement that enters no obstacle, with the forces of the obstacles.

    Attributes
    ----------
    q
        (nodes, 12, 1).
    answer
        Its last linear solve, with the effect of rounding.
    forces
        (c m, 3) at the points, N.
    """

    q: Array
    answer: LinearSolution
    forces: Array


def solve_contact(
    points: ContactPoints, matrix: Matrix, forces: Array, t: float, solve: SolveLinear, near: FemSolution | None = None
) -> ContactEquilibrium:
    """Return the displacement of least energy that enters no obstacle.

    Parameters
    ----------
    points
        Points at which the gap is evaluated.
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
    # 1. Compute the gap g and its direction n at the present displacement: curved obstacles are planes for this step.
    #    The first displacement is zero, so that no shell ends on the far side of an obstacle.
    # 2. With pressures p given, minimise the energy plus the integral of max(0, p - k g)^2 / 2 k: Newton's method on
    #    the points with p > k g. If a set of points occurs again, the step ends at the exact minimum along it: the
    #    function is convex and piecewise quadratic, so that the iteration terminates.
    # 3. Set p = max(0, p - k g), and repeat until gaps in contact are closed. Forces are in balance throughout.
    # The textbook's primal-dual active set holds gaps by multipliers in the linear system. Here there are as many
    # points as degrees of freedom, at some edges one more, and such a system is singular; the penalty leaves K
    # definite. In one iteration an edge of contact moves by at most the length at which bending is as stiff as the
    # penalty, a point or two. Therefore it is searched with soft obstacles first, or on a coarser mesh.
    area, stiff = points.areas.ravel(), points.penalty
    if near is None:
        q, answer = solve(matrix, forces)
        u, pressed = np.zeros((len(area), COMPONENTS)), None
        softness = points.penalty_factors()
    else:
        q, u, pressed, softness = None, near.displacement(points.points), points.pressed_near(near.touch()), np.zeros(0)
    pressure = np.zeros(len(area))
    for step in range(MOST_MULTIPLIERS):
        gap, normal = gaps(points.case, points.points, u, t)
        plane = _ShellAbovePlanes(points, matrix, forces, gap - np.sum(normal * u, axis=-1), normal, solve)
        for soft in softness if step == 0 else ():
            q, answer, _ = plane.minimise(q, pressure, soft * stiff, None, FEW_SETS)
        q, answer, done = plane.minimise(q, pressure, stiff, pressed if step == 0 else None, MOST_SETS)
        if not done:
            raise SolveFailure("the points in contact with an obstacle do not settle")
        pressure = np.maximum(pressure - stiff * plane.gap(q), 0.0)
        u = points.displacement(q)
        gap, _ = gaps(points.case, points.points, u, t)
        largest = float(np.abs(u).max())
        if np.all(np.where(pressure > 0, np.abs(gap), -gap) <= CLOSED * largest):
            return ContactEquilibrium(q, answer, (pressure * area)[:, None] * normal)
    raise SolveFailure("the gaps between an obstacle and the shell do not close")


@dataclass(frozen=True)
class _ShellAbovePlanes:
    """The shell above planes: at each point the gap is offset + normal . u."""

    points: ContactPoints
    matrix: Matrix
    forces: Array
    offset: Array
    normal: Array
    solve: SolveLinear

    def gap(self, q: Array) -> Array:
        """Return the gap (c m,) at the points."""
        return self.offset + self.displacement_along_normals(q)

    def displacement_along_normals(self, q: Array) -> Array:
        """Return the displacement (c m,) along the normals."""
        return np.asarray(np.sum(self.normal * self.points.displacement(q), axis=-1))

    def minimise(
        self, q: Array | None, pressure: Array, stiff: Array, active: Flags | None, most: int
    ) -> tuple[Array, LinearSolution, bool]:
        """Return the minimum for given pressures, and True if it is one; see `solve_contact`.

        It starts from points in contact, or from a displacement.
        """
        area = self.points.areas.ravel()
        seen: set[bytes] = set()
        for _ in range(most):
            if active is None:
                assert q is not None  # one of both is given
                active = pressure - stiff * self.gap(q) > 0
            pushed = ((pressure - stiff * self.offset) * area * active)[:, None] * self.normal
            stiffened = self.points.with_penalty(self.matrix, self.normal, stiff * active)
            found, answer = self.solve(stiffened, self.forces + self.points.nodal_forces(pushed))
            if np.array_equal(active, pressure - stiff * self.gap(found) > 0):
                return found, answer, True
            share = 1.0
            if q is not None and active.tobytes() in seen:
                change = found - q
                moved = self.displacement_along_normals(change)
                pushing = pressure - stiff * self.gap(q)
                share = _step_share(self.matrix, self.forces, q, change, (pushing, stiff * moved, area * moved))
            seen.add(active.tobytes())
            q = found if q is None else q + share * (found - q)
            active = None
        assert q is not None
        return q, answer, False


def _step_share(matrix: Matrix, forces: Array, q: Array, change: Array, pressed: tuple[Array, Array, Array]) -> float:
    """Return the share of a step, from 0 to 1, at which the minimised function is least."""
    # Its derivative along the step, the work of the residual forces, increases: r(s) = a + b s - max(0, p - s m) . w.
    pressures, slopes, works = pressed
    stiff = matrix @ change
    start, growth = float(np.sum(stiff * q) - np.sum(forces * change)), float(np.sum(stiff * change))

    def work(s: float) -> float:
        return start + growth * s - float(np.maximum(pressures - s * slopes, 0.0) @ works)

    if work(1.0) <= 0 or work(0.0) >= 0:
        return 1.0
    return float(brentq(work, 0.0, 1.0, xtol=ROUNDING))
