"""One step in time of the paper's scheme (section 3), for many chains at once.

    1  half a velocity update by all forces, then impulses
    2  position update
    3  collisions and lengths
    4  the other half of the velocity update at the new places, then impulses

`Scheme` chooses the printed or the corrected variants. Arrays of many chains have nodes first: (m, C, 3) without the
roots, which are (C, 3). Loose masses are chains of one infinitely long link.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.protocol.engine import thread_limit
from shellbench.solvers.rope import pulls
from shellbench.solvers.rope.contact import Normal, Push, collide, rebound
from shellbench.solvers.rope.placing import Placing, move_nodes, unit
from shellbench.solvers.rope.pulls import dot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
TAUT_ROUNDING = 1e-12  # relative to a link's length: a link that is shorter by no more is taut
Solve = Literal["direct", "sweeps"]


@dataclass(frozen=True)
class Scheme:
    """Choices of a time step.

    Attributes
    ----------
    printed
        Whether tensions are those of the printed equations (4), which hold for equal masses only.
    sweeps, tolerance
        Of `solve = "sweeps"`: so many sweeps, or until pulls change by less, relative to the largest.
    taut
        A link is taut if it is shorter than its longest by no more than this times g dt^2.
    again
        Whether impulses are also applied after the position update.
    resting
        Whether masses that touch an obstacle rebound at the end of the step too.
    compiled
        Whether steps are those of `compiled`: direct ones without obstacles, with the same answers to rounding.
    """

    printed: bool
    solve: Solve
    sweeps: int | None
    tolerance: float
    taut: float
    placing: Placing
    push: Push
    pushes: int
    normal: Normal
    again: bool
    resting: bool
    compiled: bool = False


@dataclass(frozen=True)
class Chains:
    """Data that do not change: lengths and masses (m, C), gravity, m/s^2, drag, kg/s, wind (3,), m/s, and obstacles.

    `root` gives position, velocity and acceleration of the roots, (C, 3) or (3,), at a time. `damping`, kg/s, is of the
    velocity relative to the node before. Springs of the `stiffness`, N/m, and the lengths `rest` (m, S), m, join chain
    c to the next one node by node, c < S; the last chain to the first if S = C.
    """

    lengths: Array
    masses: Array
    gravity: float
    root: Callable[[float], tuple[Array, Array, Array]]
    drag: float = 0.0
    wind: Array | None = None
    obstacles: tuple[Any, ...] = ()
    damping: float = 0.0
    stiffness: float = 0.0
    rest: Array | None = None

    @cached_property
    def chain_by_chain(self) -> tuple[Array, Array]:
        """Lengths and masses with chains first, (C, m), for compiled steps."""
        return np.ascontiguousarray(self.lengths.T), np.ascontiguousarray(self.masses.T)

    def stretch(self, places: Array, root: Array) -> float:
        """Return the largest excess of a link's length, relative to it; below zero if all are slack."""
        along = link_vectors(places, root)
        return float(np.sqrt((dot(along, along) / self.lengths**2).max())) - 1.0


@dataclass(frozen=True)
class Moving:
    """Places of all nodes, (m, C, 3), m, their velocities, m/s, and the time, s."""

    time: float
    places: Array
    velocities: Array


@dataclass(frozen=True)
class Stepper:
    """Steps of one length, s, of some chains by a scheme."""

    chains: Chains
    scheme: Scheme
    step: float

    def links(self, places: Array, root: Array) -> tuple[Array, Array, Mask]:
        """Return directions (m, C, 3) and lengths (m, C), m, of all links, and which are taut."""
        along = link_vectors(places, root)
        lengths = np.sqrt(dot(along, along))
        room = self.scheme.taut * self.chains.gravity * self.step**2 + TAUT_ROUNDING * self.chains.lengths
        taut = lengths >= self.chains.lengths - np.where(np.isfinite(room), room, 0.0)
        return along / np.maximum(lengths, 1e-300)[..., None], lengths, taut

    def pull(self, rows: pulls.Rows, *, from_tip: bool) -> Array:
        """Return the pulls of links, (m, C)."""
        if not rows.taut.any():
            return np.zeros_like(rows.right)
        if self.scheme.solve == "direct":
            return pulls.direct_pulls(rows)
        return pulls.sweep_pulls(rows, self.scheme.sweeps, self.scheme.tolerance, from_tip=from_tip)

    def external(self, places: Array, velocities: Array, root_velocity: Array) -> Array:
        """Return the accelerations by gravity, wind, dampers and springs between chains, (m, C, 3), m/s^2."""
        given, chains = np.zeros_like(velocities), self.chains
        given[..., 2] = -chains.gravity
        if chains.drag:
            assert chains.wind is not None
            given += chains.drag / chains.masses[..., None] * (chains.wind - velocities)
        if chains.damping:
            dampers = -chains.damping * link_vectors(velocities, root_velocity)
            dampers[:-1] -= dampers[1:].copy()  # the reaction of the node after
            given += dampers / chains.masses[..., None]
        if chains.rest is not None:
            given += spring_forces(places, chains.rest, chains.stiffness) / chains.masses[..., None]
        return given

    def tensions(
        self, places: Array, velocities: Array, external: Array, root: tuple[Array, Array, Array]
    ) -> tuple[Array, Array]:
        """Return tensions (m, C), N, and the directions of links (m, C, 3).

        Relative accelerations along taut links balance the centripetal ones: eqs. (1) and (3).
        """
        directions, lengths, taut = self.links(places, root[0])
        apart, given = link_vectors(velocities, root[1]), link_vectors(external, root[2])
        across = dot(apart, apart) - dot(apart, directions) ** 2
        with np.errstate(all="ignore"):
            centripetal = np.where(lengths > 0, across / lengths, 0.0)
        if not self.scheme.printed:
            right = dot(given, directions) + centripetal
            return self.pull(pulls.mass_rows(directions, self.chains.masses, right, taut), from_tip=True), directions
        near, far = pulls.inverse_masses(self.chains.masses)
        force = centripetal / (near + far)
        weighed = self.chains.masses[..., None] * external
        weighed[1:] -= weighed[:-1].copy()
        right = dot(weighed, directions) + 2.0 * force
        right[0] += -force[0] - self.chains.masses[0] * dot(root[2] + 0.0 * external[0], directions[0])
        return self.pull(pulls.printed_rows(directions, right, taut), from_tip=True), directions

    def accelerate(self, places: Array, velocities: Array, root: tuple[Array, Array, Array]) -> Array:
        """Return velocities after half a step of all forces (eq. (2))."""
        external = self.external(places, velocities, root[1])
        strengths, directions = self.tensions(places, velocities, external, root)
        return velocities + 0.5 * self.step * (external + self.net_pulls(strengths, directions))

    def net_pulls(self, strengths: Array, directions: Array) -> Array:
        """Return the net pulls on nodes over their masses, (m, C, 3): eqs. (2) and (6)."""
        pulled = strengths[..., None] * directions
        net = -pulled
        net[:-1] += pulled[1:]
        return np.asarray(net / self.chains.masses[..., None])

    def apply_impulses(self, places: Array, velocities: Array, root: Array, root_velocity: Array) -> Array:
        """Return velocities that stretch no taut link (eqs. (6) to (9))."""
        directions, _, taut = self.links(places, root)
        right = dot(link_vectors(velocities, root_velocity), directions)
        rows = pulls.mass_rows(directions, self.chains.masses, right, taut)
        return velocities + self.net_pulls(self.pull(rows, from_tip=False), directions)

    def start(self, moving: Moving) -> Moving:
        """Return the initial state with velocities that its links allow."""
        root = self.chains.root(moving.time)
        return replace(moving, velocities=self.apply_impulses(moving.places, moving.velocities, root[0], root[1]))

    def state_tensions(self, moving: Moving) -> Array:
        """Return the tensions (m, C), N, of an instant."""
        root = self.chains.root(moving.time)
        external = self.external(moving.places, moving.velocities, root[1])
        return self.tensions(moving.places, moving.velocities, external, root)[0]

    def next_state(self, moving: Moving) -> Moving:
        """Return the state one step later."""
        root, later = self.chains.root(moving.time), self.chains.root(moving.time + self.step)
        if self.scheme.compiled:
            return self.compiled(moving, root, later)
        halfway = np.asarray(root[1] + 0.5 * self.step * root[2])
        velocities = self.accelerate(moving.places, moving.velocities, root)
        velocities = self.apply_impulses(moving.places, velocities, root[0], halfway)
        places = np.empty_like(moving.places)
        before = later[0] + np.zeros_like(places[0])
        for i in range(len(places)):
            before = places[i] = move_nodes(
                moving.places[i], velocities[i], before, self.chains.lengths[i], self.step, self.scheme.placing
            )
        if self.scheme.again:
            velocities = self.apply_impulses(places, velocities, later[0], halfway)
        touched: list[tuple[Any, Mask]] = []
        if self.chains.obstacles:
            places, velocities, touched = self.after_collisions(moving, places, velocities, later[0])
        velocities = self.accelerate(places, velocities, (later[0], halfway, later[2]))
        velocities = self.apply_impulses(places, velocities, later[0], later[1])
        if self.scheme.resting:
            for obstacle, touching in touched:
                offsets = (places - obstacle.at(moving.time + self.step)[0]).reshape(-1, 3)
                normals, body = obstacle.gradient(offsets), obstacle.velocity(offsets, moving.time + self.step)
                bounced = rebound(velocities.reshape(-1, 3), body, normals, obstacle.friction).reshape(velocities.shape)
                velocities = np.where(touching[..., None], bounced, velocities)
        return Moving(moving.time + self.step, places, velocities)

    def compiled(self, moving: Moving, root: tuple[Array, Array, Array], later: tuple[Array, Array, Array]) -> Moving:
        """Return the state one step later, by plain loops that numba compiles."""
        from shellbench.solvers.rope.compiled import step_in_parallel

        chains, scheme = self.chains, self.scheme
        # chains first, so that all numbers of a chain lie together; the result is a view, from which this copy is quick
        places, velocities = (np.array(each.swapaxes(0, 1), order="C") for each in (moving.places, moving.velocities))
        lengths, masses = chains.chain_by_chain
        still = np.zeros_like(places[:, 0])
        before, after = (np.ascontiguousarray([part + still for part in parts]) for parts in (root, later))
        room = scheme.taut * chains.gravity * self.step**2
        numbers = (self.step, float(chains.gravity), float(chains.drag), float(room))
        wind = np.zeros(3) if chains.wind is None else np.asarray(chains.wind, dtype=float)
        choices = (scheme.printed, scheme.placing == "rotation", scheme.again)
        step_in_parallel(thread_limit(), places, velocities, lengths, masses, before, after, wind, numbers, choices)
        return Moving(moving.time + self.step, places.swapaxes(0, 1), velocities.swapaxes(0, 1))

    def after_collisions(
        self, moving: Moving, places: Array, velocities: Array, root: Array
    ) -> tuple[Array, Array, list[tuple[Any, Mask]]]:
        """Return places and velocities after collisions, root to tip, each after its link's length (section 6)."""
        places, velocities = places.copy(), velocities.copy()
        touched = [(obstacle, np.zeros(places.shape[:2], dtype=bool)) for obstacle in self.chains.obstacles]
        before = root + np.zeros_like(places[0])
        times = moving.time, moving.time + self.step
        scheme = self.scheme
        for i in range(len(places)):
            along = places[i] - before
            long = np.sqrt(dot(along, along)) > self.chains.lengths[i]
            if long.any():
                with np.errstate(all="ignore"):
                    short = before + self.chains.lengths[i][:, None] * unit(along)
                places[i] = np.where(long[:, None], short, places[i])
            for obstacle, touching in touched:
                earlier = moving.places[i]
                met = collide(
                    obstacle, earlier, places[i], velocities[i], times, scheme.push, scheme.pushes, scheme.normal
                )
                places[i], velocities[i], touching[i] = met.places, met.velocities, met.touching
            before = places[i]
        return places, velocities, touched


def link_vectors(vectors: Array, root: Array) -> Array:
    """Return each node's vector (m, C, 3) less that of the node before it."""
    apart = vectors.copy()
    apart[1:] -= vectors[:-1]
    apart[0] -= root
    return apart


def spring_forces(places: Array, rest: Array, stiffness: float) -> Array:
    """Return the forces (m, C, 3), N, of springs of lengths `rest` (m, S), m, from each of S chains to the next one."""
    first = np.arange(rest.shape[1])
    second = (first + 1) % places.shape[1]
    apart = places[:, second] - places[:, first]
    strength = stiffness * (np.sqrt(dot(apart, apart)) - rest)[..., None] * unit(apart)
    found = np.zeros_like(places)
    found[:, first] += strength
    found[:, second] -= strength
    return found
