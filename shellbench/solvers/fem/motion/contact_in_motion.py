"""Obstacles during one step in time: pressure at its end, and friction along it.

At the end of a step no point is in an obstacle. The contact forces act as impulses at the beginning of the step: r =
M^-1 R of the nodal forces R moves the end by h^2 r and changes the velocity by h r. The generalised-alpha method treats
all other forces (`time_step`). An impact therefore brings a point's velocity along the normal to zero in two steps,
wherever in the step it happens: no point rebounds. A resting shell has its weight as R, and a sliding one the right
friction. With Chung & Hulbert's own treatment of forces a point would rebound, with a velocity that depends on the
instant of impact.

Friction is Coulomb's: a point moves with the obstacle as long as the tangential force is at most the coefficient times
the pressure; else the force has this magnitude, against the slip over the step.

The forces are the unknowns of a small dual problem: with a factorised tangent K of the shell without obstacles, unit
forces at points move points by B K^-1 B^T (Delassus's operator). The operator is kept as long as K, so that another set
of points in contact costs a dense solve and no factorisation.

Chen, Acary, Virlez & Brüls (2013), A nonsmooth generalized-alpha scheme for flexible multibody systems with unilateral
constraints, International Journal for Numerical Methods in Engineering 96, separate smooth forces and impulses too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch, nearest_obstacle
from shellbench.solvers.fem.mechanics.contact_points import REACH
from shellbench.solvers.fem.mechanics.kinematics import Midsurface
from shellbench.solvers.fem.mesh.basis import COMPONENTS, KINDS, ROUNDING, gauss_rule, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import basis_scales
from shellbench.solvers.fem.motion.contact_balance import Balance, Delassus

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Solve = Callable[[Array], Array]
"""Solves with the kept tangent and the supports: forces (nodes, 12, n) to displacements."""

STEEPER = 2.0  # weight of depths in the merit, in the largest force: more than one makes the least merit feasible
PORTION = 300  # unit forces that are solved for at once


def _rule_of_cell(first: bool, last: bool) -> tuple[Array, Array]:
    """Return points and weights on the unit cell: Gauss's two, and with the edges of the shell Radau's or Lobatto's."""
    # All are exact for cubics: a shell on a flat floor has an even pressure, and does not bend. There are as many
    # points as degrees of freedom of a C1 cubic spline. Gauss points alone would leave out the edges, which hit first
    # in the shell's own plane.
    root = np.sqrt(6)
    radau = np.array([0.0, (6 - root) / 10, (6 + root) / 10]), np.array([4, 16 + root, 16 - root]) / 36
    if first and last:
        return np.array([0.0, 0.5, 1.0]), np.array([1, 4, 1]) / 6
    if first:
        return radau
    if last:
        return 1 - radau[0][::-1], radau[1][::-1]
    x, w = gauss_rule(2)
    return (x + 1) / 2, w / 2


@dataclass(frozen=True)
class TouchingPoints:
    """The n points of a mesh at which the gap is evaluated in motion.

    Attributes
    ----------
    points
        (n, 2) in the domain, in rows along both coordinates.
    operator
        (3 n, 12 nodes) from scaled degrees of freedom to displacements.
    lengths, reach
        See `shellbench.problems.shell.question.contact.Touch`.
    """

    case: Case
    mesh: TensorMesh
    points: Array
    operator: sp.csr_matrix
    lengths: Array
    reach: Array

    @classmethod
    def on_mesh(cls, case: Case, mesh: TensorMesh) -> TouchingPoints:
        """Choose the points of a mesh."""
        rows = []
        for axis, count in enumerate(mesh.cells):
            ends = [
                (k == 0, k == count - 1) if not mesh.domain.periodic[axis] else (False, False) for k in range(count)
            ]
            rules = [_rule_of_cell(*end) for end in ends]
            rows.append(
                (
                    np.repeat(np.arange(count), [len(x) for x, _ in rules]),
                    *map(np.concatenate, zip(*rules, strict=True)),
                )
            )
        (i, x, v), (j, y, w) = rows
        cells = (i[:, None] * mesh.cells[1] + j).ravel()
        unit, shares = (
            np.stack(np.meshgrid(*pair, indexing="ij"), axis=-1).reshape(-1, 2) for pair in ((x, y), (v, w))
        )
        points = mesh.domain.wrap(mesh.origins[cells] + unit * mesh.sizes[cells])
        base = Midsurface.from_position(case.surface.derivatives(points, order=2)).base
        sides = np.linalg.norm(base, axis=-1).reshape(-1, 2) * mesh.sizes[cells]
        values = (tabulate(unit, (0, 0)) * basis_scales(mesh, slice(None))[cells]).reshape(len(cells), -1)
        # row: a point's component; column: node, component, kind
        kinds = np.arange(len(KINDS))
        columns = (mesh.nodes[cells][..., None] * COMPONENTS * len(KINDS) + kinds).reshape(len(cells), 1, -1)
        columns = columns + (np.arange(COMPONENTS) * len(KINDS))[:, None]
        each = np.broadcast_to(values[:, None], columns.shape)
        starts = np.arange(0, columns.size + 1, columns.shape[-1])
        shape = (COMPONENTS * len(cells), COMPONENTS * len(KINDS) * mesh.node_count)
        operator = sp.csr_matrix((each.ravel(), columns.ravel(), starts), shape=shape)
        return cls(case, mesh, points, operator, sides * shares, REACH * sides.max(axis=0))

    @cached_property
    def rest_positions(self) -> Array:
        """(n, 3) where the points are at rest, m."""
        return self.case.surface.position(self.points)

    def nearest_obstacles(self, u: Array, t: float) -> tuple[Array, Array, Integers]:
        """Return gaps (n,), m, normals (n, 3) and numbers of obstacles (n,) for points displaced by u (n, 3)."""
        return nearest_obstacle(self.case, self.points, u, t, self.rest_positions)

    def displacement(self, q: Array) -> Array:
        """Return the displacement (n, 3) at the points of q (nodes, 12)."""
        return np.asarray((self.operator @ q.ravel()).reshape(-1, COMPONENTS))

    def nodal_forces(self, forces: Array) -> Array:
        """Return the nodal forces (nodes, 12) of forces (n, 3), N, at the points."""
        return np.asarray((self.operator.T @ forces.ravel()).reshape(self.mesh.node_count, -1))

    def touch(self, forces: Array) -> Touch:
        """Return forces (n, 3) at the points as contact."""
        return Touch(self.points, forces, self.lengths, self.reach)


@dataclass
class Compliance:
    """Displacements of some points by unit forces at them, from a kept tangent: B K^-1 B^T.

    Attributes
    ----------
    chosen
        (w,) numbers of the points.
    matrix
        (w, 3, w, 3) m/N, in the step's own unknown.
    """

    points: TouchingPoints
    solve: Solve
    chosen: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    matrix: Array = field(default_factory=lambda: np.zeros((0, COMPONENTS, 0, COMPONENTS)))
    _framed: Delassus | None = None

    def in_axes(self, normal: Array, rough: bool) -> Delassus:
        """Return the matrix in axes of normals (w, 3): the last ones as long as these are the same."""
        if self._framed is None or not np.array_equal(self._framed.axes[:, 0], normal):
            self._framed = Delassus.from_compliance(self.matrix, normal, rough)
        return self._framed

    def add_points(self, more: Integers) -> None:
        """Add points."""
        old = len(self.chosen)
        self.chosen = np.concatenate([self.chosen, more])
        rows = self._rows(self.chosen)
        columns = []
        for start in range(0, len(more), PORTION):
            unit = self._rows(more[start : start + PORTION]).T.toarray()
            moved = self.solve(unit.reshape(self.points.mesh.node_count, -1, unit.shape[-1]))
            columns.append(rows @ moved.reshape(unit.shape))
        new = np.concatenate(columns, axis=1).reshape(len(self.chosen), COMPONENTS, len(more), COMPONENTS)
        matrix = np.empty((len(self.chosen), COMPONENTS, len(self.chosen), COMPONENTS))
        matrix[:old, :, :old], matrix[:, :, old:] = self.matrix, new
        matrix[old:, :, :old] = new[:old].transpose(2, 3, 0, 1)
        self.matrix = matrix

    def _rows(self, points: Integers) -> sp.csr_matrix:
        return self.points.operator[(COMPONENTS * points[:, None] + np.arange(COMPONENTS)).ravel()]


@dataclass(frozen=True)
class StepPush:
    """Contact in an iteration: forces (n, 3), N, and their part in the equation of the step's unknown.

    That part is `nodal` (nodes, 12), and `rubbing` (nodes, 12) of friction alone. `weight`, N, multiplies the depths in
    the merit function.
    """

    forces: Array
    nodal: Array
    rubbing: Array
    weight: float


@dataclass(frozen=True)
class StepContact:
    """Obstacles during a step; see the module's docstring.

    Attributes
    ----------
    points
        Points at which the gap is evaluated.
    begin, end
        Times, s.
    start
        (n, 3) displacement at the beginning of the step, m.
    before
        (n, 3) forces of the step before, N.
    """

    points: TouchingPoints
    begin: float
    end: float
    start: Array
    before: Array

    def gap(self, u: Array) -> tuple[Array, Array, Integers]:
        """Return gaps (n,), m, normals (n, 3) and obstacles' numbers (n,) at the step's end, displaced by u (n, 3)."""
        return self.points.nearest_obstacles(u, self.end)

    def depths(self, u: Array) -> Array:
        """Return the depths (n,) of points in obstacles at the step's end, m."""
        return np.maximum(-self.gap(u)[0], 0.0)

    def repel(self, u: Array, step: Array, compliance: Compliance, share: float, whole: float) -> tuple[Array, Array]:
        """Return the forces (n, 3), N, that keep points out of obstacles, taken as planes, and the step with them.

        Parameters
        ----------
        u
            (n, 3) displacement of the step's end now, m.
        step
            (nodes, 12) step of the unknown without obstacles.
        compliance
            Of that unknown.
        share, whole
            Factor of a force in the equation of the unknown, and factor from a change of the unknown to one of the
            step's end.

        Raises
        ------
        NotConvergedError
            If no set of points in contact is found.
        """
        # 1. Choose candidates: points that were pressed, points that would be inside, and points that the others push
        #    in.
        # 2. Extend the compliance by new candidates.
        # 3. Find the forces of the candidates from the small dual problem (`Balance`).
        # 4. Add the response to the step; repeat until no further point enters.
        gap, normal, nearest = self.gap(u)
        obstacles = self.points.case.obstacles
        friction = np.array([o.friction for o in obstacles])[nearest]
        rough = any(o.friction > 0 for o in obstacles)
        slip = u - self.start - self._obstacle_shifts[nearest]
        free = whole * self.points.displacement(step)
        least = ROUNDING * max(np.abs(gap).max(), np.abs(free).max())
        forces, moved, answer = np.zeros_like(u), free, step
        wanted = np.any(self.before != 0, axis=-1)
        while True:
            wanted |= gap + np.sum(normal * moved, axis=-1) < -least
            wanted[compliance.chosen] = False
            if np.any(wanted):
                compliance.add_points(np.flatnonzero(wanted))
            elif answer is not step or not len(compliance.chosen):
                return forces, answer
            w = compliance.chosen
            unit = share * whole
            small = Balance(
                compliance.matrix, normal[w], friction[w], (gap + np.sum(normal * free, axis=-1))[w] / unit,
                (slip + free)[w] / unit, least / unit, compliance.in_axes(normal[w], rough),
            )  # fmt: skip
            forces[w] = small.forces(self.before[w])
            answer = step + share * compliance.solve(self.points.nodal_forces(forces)[..., None])[..., 0]
            moved = whole * self.points.displacement(answer)

    def work(self, forces: Array) -> float:
        """Return the work that moving obstacles do by forces (n, 3), J."""
        _, _, nearest = self.points.nearest_obstacles(self.start, self.begin)
        return float(np.sum(forces * self._obstacle_shifts[nearest]))

    @property
    def _obstacle_shifts(self) -> Array:
        """(obstacles, 3) displacements of the obstacles in the step, m."""
        return np.array([o.at(self.end)[0] - o.at(self.begin)[0] for o in self.points.case.obstacles])
