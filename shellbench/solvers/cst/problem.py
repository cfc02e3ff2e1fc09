"""A case on a mesh: elastic energy, loads and supports, and the minimum of the potential.

Supports are prescribed displacements of vertices. Rigid motions that no support holds are pinned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Support
from shellbench.problems.shell.question.places import Edge, Place, Point, Whole
from shellbench.solvers.cst.contact import Obstacles
from shellbench.solvers.cst.elastic import Elastic, Loading, Pattern
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

CONTRADICTION = 1e-9  # of the surface's size: how far two supports may move one vertex apart


@dataclass(frozen=True)
class Supports:
    """Displacements that supports prescribe at the vertices.

    Attributes
    ----------
    holds
        (supports, v, 3) True if a support prescribes a displacement.
    """

    case: Case
    mesh: TriangleMesh
    holds: NDArray[np.bool_]

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh) -> Supports:
        """Find the held vertices.

        Raises
        ------
        InputError
            If a point that is held lies on no vertex.
        """
        holds = np.zeros((len(case.supports), mesh.vertex_count, 3), dtype=bool)
        for support, place in case.supported_places():
            vertices = vertices_of(place, mesh)
            for component in support.held:
                holds[case.supports.index(support), vertices, "xyz".index(component)] = True
        return cls(case, mesh, holds)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(v, 3) True if a support prescribes a displacement."""
        return np.asarray(self.holds.any(axis=0))

    def share_of_forces(self, number: int) -> Array:
        """Return the share (v, 3) of a support in the forces; supports that hold the same vertex have equal shares."""
        return np.asarray(self.holds[number] / np.maximum(self.holds.sum(axis=0), 1))

    @cached_property
    def free(self) -> Integers:
        """Unknowns 3 v + component that nothing prescribes."""
        return np.flatnonzero(~self.held.ravel())

    @cached_property
    def moving(self) -> bool:
        """True if any support moves."""
        return any(support.motion is not None for support in self.case.supports)

    def prescribe(self, displacement: Array, t: float) -> Array:
        """Return the displacement (v, 3) with the prescribed values of supports at a time or load factor.

        Raises
        ------
        InputError
            If two supports move a shared vertex to different places.
        """
        result = np.where(self.held, 0.0, displacement)
        set_by = np.where(self.held, np.nan, 0.0)
        size = np.ptp(self.case.surface.position(self.mesh.domain.grid(3, 3)).reshape(-1, 3), axis=0).max()
        for support, place in self.case.supported_places():
            vertices = vertices_of(place, self.mesh)
            moved = self._motion(support, place, vertices, t)
            for component in support.held:
                c = "xyz".index(component)
                if np.nanmax(np.abs(set_by[vertices, c] - moved[:, c]), initial=0.0) > CONTRADICTION * size:
                    raise InputError(
                        f"{self.case.name}: two supports move a vertex on '{place.name}' to different places"
                    )
                result[vertices, c] = set_by[vertices, c] = moved[:, c]
        return result

    def _motion(self, support: Support, place: Place, vertices: Integers, t: float) -> Array:
        if support.motion is None:
            return np.zeros((len(vertices), 3))
        return self.case.motion(support, place, self.mesh.points[vertices], t)[0, 0]


def vertices_of(place: Place, mesh: TriangleMesh) -> Integers:
    """Return the vertices on a place; InputError if a point lies on none."""
    match place:
        case Edge():
            return mesh.edge_vertices(place)
        case Whole():
            return np.arange(mesh.vertex_count)
        case Point(name=name, xi=xi):
            vertex = mesh.vertex_at(xi)
            if vertex is None:
                n1, n2 = mesh.cells
                raise InputError(f"the support at '{name}' lies on no vertex of {n1} x {n2} cells; choose other cells")
            return np.array([vertex])


@dataclass(frozen=True)
class FreeMotions:
    """Free rigid motions: they are pinned while a case is solved, then removed in the mean over the area.

    Attributes
    ----------
    motions
        (3 v, k) their displacements of the vertices.
    pins
        (k,) unknowns that are held at zero, chosen to resist the motions best.
    """

    motions: Array
    pins: Integers

    @classmethod
    def from_case(cls, case: Case, supports: Supports) -> FreeMotions:
        """Choose the pins among the free unknowns."""
        names = [RIGID_MOTIONS.index(name) for name in case.remove_rigid_motions]
        modes = rigid_modes(case.surface, supports.mesh.points)[0, 0].reshape(-1, len(RIGID_MOTIONS))[:, names]
        if not names:
            return cls(modes, np.zeros(0, dtype=np.int64))
        _, _, order = qr(modes[supports.free].T, mode="economic", pivoting=True)
        return cls(modes, supports.free[np.sort(order[: len(names)])])

    def without_motions(self, displacement: Array, areas: Array) -> Array:
        """Return the displacement (v, 3) without its mean part along the motions, vertices weighed by areas (v,)."""
        weighted = self.motions * np.repeat(areas, 3)[:, None]
        part = np.linalg.solve(weighted.T @ self.motions, weighted.T @ displacement.ravel())
        return np.asarray(displacement - (self.motions @ part).reshape(-1, 3))


ARMIJO = 1e-4  # share of the decrease predicted by the slope that a step must bring
SHORTEST = 2.0**-30  # part of Newton's step below which a search along it gives up
ENERGY_ROUNDING = 1e-13  # of the sum of the energies: a smaller difference is rounding


@dataclass(frozen=True)
class TriangleProblem:
    """The data that are fixed while a case is solved on a mesh."""

    case: Case
    mesh: TriangleMesh
    elastic: Elastic
    loading: Loading
    supports: Supports
    loose: FreeMotions

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh) -> TriangleProblem:
        """Put a case on a mesh; InputError if it does not fit it."""
        elastic = Elastic.from_case(case, mesh)
        supports = Supports.from_case(case, mesh)
        return cls(
            case, mesh, elastic, Loading.from_case(case, mesh, elastic), supports, FreeMotions.from_case(case, supports)
        )

    @cached_property
    def pattern(self) -> Pattern:
        """Pattern of the matrices of the unknowns that are neither held nor pinned."""
        return Pattern.from_elastic(self.elastic, np.setdiff1d(self.supports.free, self.loose.pins))

    def internal_forces(self, displacement: Array) -> Array:
        """Return the forces (v, 3) that hold triangles, hinges and springs in a displacement, N."""
        return self.elastic.gradient(displacement) + self.loading.springs * displacement

    def obstacles_at(self, at: float, dt: float) -> Obstacles | None:
        """Return the obstacles at the end of a step in time dt, s, or None if there are none."""
        if not self.case.obstacles:
            return None
        return Obstacles.in_step(self.case, self.mesh.points, self.loading.mass, at, dt)

    def strain_energy(self, displacement: Array) -> float:
        """Return the energy of triangles, hinges and springs, J."""
        return sum(self.elastic.energies(displacement)) + float(np.sum(self.loading.springs * displacement**2) / 2)


@dataclass(frozen=True)
class Minimum:
    """Result of Newton's method.

    Attributes
    ----------
    displacement
        (v, 3).
    iterations
        Newton steps.
    correction
        The largest displacement of the last one, m.
    """

    displacement: Array
    iterations: int
    correction: float


def factorise(matrix: csc_array) -> Callable[[Array], Array]:
    """Factorise a symmetric matrix; SolveFailure if it is singular."""
    try:
        options = {"SymmetricMode": True}
        solve: Callable[[Array], Array] = splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
        ).solve
    except RuntimeError:
        raise SolveFailure("the stiffness matrix is singular") from None
    return solve


def minimise(
    problem: TriangleProblem,
    start: Array,
    force: Array,
    inertia: Array,
    target: Array,
    smallest: float,
    most: int,
    pressing: Obstacles | None = None,
) -> Minimum:
    """Minimise W(u) - f.u + 1/2 sum of m_i |u_i - target_i|^2 over the free vertices by Newton's method.

    Obstacles, if there are any (`pressing`), add the energy of their penalty.

    The exact second derivative is used if its step leads downhill and is convex along itself, else a positive definite
    one; each step is halved until it brings a decrease (Armijo).

    Parameters
    ----------
    problem
        Case and mesh.
    start
        (v, 3) initial guess; held vertices stay there.
    force
        (v, 3) f, N.
    inertia
        (v,) m, kg/s^2; zero in statics.
    target
        (v, 3) positions of the vertices by inertia alone.
    smallest
        Length of a step, m, at which the search ends.
    most
        Newton steps after which the search gives up.

    Raises
    ------
    SolveFailure
        If no minimum is found.
    """
    # 1. Compute the gradient of the potential on the free vertices.
    # 2. Take Newton's step by the exact second derivative, or by a definite one if that step leads uphill.
    # 3. Halve the step (Armijo) until the energy falls or only rounding is left.
    # 4. Stop when the step is shorter than asked for.
    # The textbook stops at a small gradient, whose unit and size differ from case to case. Here a length is compared.
    pattern, springs = problem.pattern, problem.loading.springs
    diagonal = (inertia[:, None] + springs).ravel()[pattern.free]

    def energy(u: Array) -> tuple[float, float]:
        parts = np.array([
            problem.strain_energy(u), -np.sum(force * u), np.sum(inertia[:, None] * (u - target) ** 2) / 2,
            pressing.energy(u) if pressing else 0.0,
        ])  # fmt: skip
        return float(parts.sum()), float(np.abs(parts).sum())

    u = start.copy()
    value, scale = energy(u)
    for iteration in range(1, most + 1):
        gradient = problem.internal_forces(u) - force + inertia[:, None] * (u - target)
        if pressing:
            gradient -= pressing.forces(u)
        g = gradient.ravel()[pattern.free]
        step = _newton_step(problem, u, g, diagonal, pressing)
        correction, slope, part = float(np.abs(step).max(initial=0.0)), float(g @ step), 1.0
        while True:
            trial = u.copy()
            trial.ravel()[pattern.free] += part * step
            if correction <= smallest:  # too short for a difference of energies
                return Minimum(trial, iteration, correction)
            found, size = energy(trial)
            # A share of the energies is allowed on top: near the minimum their difference is rounding.
            if found - value <= ARMIJO * part * slope + ENERGY_ROUNDING * max(scale, size):
                break
            part /= 2
            if part < SHORTEST:
                raise SolveFailure("Newton's method finds no way downhill")
        u, value, scale = trial, found, size
    raise SolveFailure(f"Newton's method did not converge in {most} steps")


def _newton_step(problem: TriangleProblem, u: Array, g: Array, diagonal: Array, pressing: Obstacles | None) -> Array:
    # LU, not Cholesky: it takes an indefinite matrix; the step is checked to be downhill and convex along itself. The
    # textbook shifts the whole matrix until Cholesky succeeds. Here a definite matrix, made element by element,
    # replaces the exact one if that fails.
    for definite in (False, True):
        matrix = problem.pattern.matrix(problem.elastic.tangent_values(u, definite), diagonal)
        if pressing:
            matrix = matrix + pressing.tangent(u, problem.pattern.free)
        try:
            step = -factorise(matrix)(g)
        except SolveFailure:
            if definite:
                raise
            continue
        if definite or (np.all(np.isfinite(step)) and g @ step < 0 < step @ (matrix @ step)):
            return step
        if not g.any():
            return step
    raise AssertionError  # the definite step is always returned
