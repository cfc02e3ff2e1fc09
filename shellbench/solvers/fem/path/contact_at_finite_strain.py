"""Static obstacles at finite strain: contact forces on a displaced shell within one step of Newton's method.

The augmented Lagrangian is that of `contact`, with gaps g(q) and directions at the shell's displacement in each
iteration:

    W(q) - f . q + sum over points of A (max(0, p - k g(q))^2 - p^2) / 2 k.

Newton's method changes the points in contact from iteration to iteration. Once it has converged, the pressures become
the multipliers p, until gaps are closed. A stiff obstacle would throw a distant shell back. Therefore, if no pressures
are known, k begins as soft as bending over the shell's length, and hardens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.contact import Touch, gaps
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.mechanics.contact_points import CLOSED, ContactPoints, Flags
from shellbench.solvers.fem.mesh.basis import COMPONENTS

Array = NDArray[np.float64]

# Of the shell's size: step of the differences of obstacles' normals. It is about the cube root of eps, where truncation
# and rounding of a central difference are equal.
DIFFERENCE = 1e-6


@dataclass(frozen=True)
class ContactState:
    """Contact of obstacles with a displaced shell.

    Attributes
    ----------
    displacement
        (n, 3) of the points, m.
    gap
        (n,) m.
    normal
        (n, 3) of the obstacles there.
    pressure
        (n,) Pa; negative at a held point that would separate.
    active
        (n,) True at points in contact.
    forces, nodal
        (n, 3) at the points, N, and (nodes, 12) of the mesh.
    """

    displacement: Array
    gap: Array
    normal: Array
    pressure: Array
    active: Flags
    forces: Array
    nodal: Array

    @property
    def gaps_are_closed(self) -> bool:
        """True if no point is inside an obstacle, and no pressed point is off it."""
        gap = np.where(self.pressure > 0, np.abs(self.gap), -self.gap)
        return bool(np.all(gap <= CLOSED * np.abs(self.displacement).max()))


@dataclass(frozen=True)
class Obstacles:
    """Obstacles at a load factor; see the module's docstring.

    Attributes
    ----------
    points
        Points at which the gap is evaluated.
    t
        Load factor.
    multipliers
        p (n,), Pa.
    held
        (n,) points that stay in contact whatever their gap; None for those with p > k g.
    softer
        Remaining factors of k before 1; the first is in use.
    """

    points: ContactPoints
    t: float
    multipliers: Array
    held: Flags | None = None
    softer: tuple[float, ...] = ()

    @property
    def penalty(self) -> Array:
        """The stiffness k (n,), N/m^3."""
        return self.points.penalty * (self.softer[0] if self.softer else 1.0)

    @classmethod
    def from_pressure(cls, points: ContactPoints, t: float, pressure: Array | None) -> Obstacles:
        """Begin with the pressures (n,) of another state and its points in contact, or else with a soft k."""
        if pressure is None or not np.any(pressure > 0):
            return cls(points, t, np.zeros(len(points.points)), None, tuple(points.penalty_factors()))
        return cls(points, t, pressure, pressure > 0)

    def contact_at(self, q: Array) -> ContactState:
        """Return the contact with the shell displaced by q (nodes, 12)."""
        points = self.points
        u = points.displacement(q[..., None])
        gap, normal = gaps(points.case, points.points, u, self.t)
        pushed = self.multipliers - self.penalty * gap
        active = pushed > 0 if self.held is None else self.held
        pressure = np.where(active, pushed, 0.0)
        forces = (pressure * points.areas.ravel())[:, None] * normal
        return ContactState(u, gap, normal, pressure, active, forces, points.nodal_forces(forces)[..., 0])

    def add_stiffness(self, matrix: BlockMatrix, pressed: ContactState) -> None:
        """Add the second derivative of the augmented Lagrangian at points in contact to a matrix."""
        # k n n - (p - k g) dn/dx. The second term is that of curved obstacles: the force on a point that slides on a
        # ball turns. Without this term Newton's method is slow there, and the inertia does not show stability.
        points, case = self.points, self.points.case
        on = np.flatnonzero(pressed.active)
        if not len(on):
            return
        at, u, normal = points.points[on], pressed.displacement[on], pressed.normal[on]
        step = DIFFERENCE * float(np.ptp(case.surface.position(at) + u, axis=0).max() + np.abs(u).max())
        turned = [
            (gaps(case, at, u + e, self.t)[1] - gaps(case, at, u - e, self.t)[1]) / (2 * step)
            for e in step * np.eye(COMPONENTS)
        ]
        curved = np.stack(turned, axis=-1)
        local = np.zeros((len(points.points), COMPONENTS, COMPONENTS))
        local[on] = self.penalty[on, None, None] * normal[:, :, None] * normal[:, None]
        local[on] -= pressed.pressure[on, None, None] * (curved + np.swapaxes(curved, 1, 2)) / 2
        local *= points.areas.reshape(-1, 1, 1)
        shape = points.areas.shape
        cells = np.flatnonzero(np.any(pressed.active.reshape(shape), axis=1))
        values, weighted = points.values[cells], local.reshape(*shape, COMPONENTS, COMPONENTS)[cells]
        terms = np.einsum("emij,emak,embl->eiakjbl", weighted, values, values, optimize=True)
        add_cell_matrices(matrix.blocks, points.mesh.nodes[cells], terms)

    def next_round(self, pressed: ContactState) -> Obstacles:
        """Take the pressures as multipliers."""
        return replace(self, multipliers=pressed.pressure)


def nearest_pressure(points: ContactPoints, touch: Touch) -> Array:
    """Return the pressure (n,) at points, Pa, of the nearest ones of another mesh."""
    pressure = np.linalg.norm(touch.forces, axis=-1) / np.prod(touch.lengths, axis=-1)
    return np.asarray(pressure[points.nearest_points_of(touch)])
