"""Ropes: point masses on rigid links, at rest between two ends or in motion from a root, and loose masses.

A file has one of four tables. `[chain]` hangs between two ends: node 0 is at (0, 0) and node n at (span, -drop) of
the plane (x, z), z upward. `[net]` is a cloth of masses and springs in that plane, held at its upper corners.
`[rope]` moves from its root, node 0, whose place is a formula of the time; a taut link, as long as it can be, carries
a pull, and a slack link none. With a `count` there are several such chains, each turned about the z axis; their nodes
are numbered chain after chain, each from its root on, and so are their links. Springs and dampers can join them.
`[particles]` are loose masses, which obstacles can meet. Impacts lose the normal velocity, when a link becomes taut
and when a mass meets an obstacle.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shellbench.problem import Problem
from shellbench.problems.moving import Path, moved
from shellbench.problems.obstacle import Obstacle, deepest
from shellbench.problems.rope.quantities import STILL, RopeQuantity
from shellbench.protocol.schema import Finite, Model, Positive, Vector

Array = NDArray[np.float64]
LONGEST = 1000  # links
MOST_CHAINS = 100_000  # chains, or loose masses
ROOT_SAMPLES = 1000  # times at which a root's motion is looked at
LATER = {"count": 1, "damping": 0.0, "lateral": None}  # defaults of keys that older records do not have
SLOPPY = 1e-9  # relative: by how much rounding may stretch a link at the start


class Chain(Model):
    """The chain and where it hangs, in SI units."""

    links: int = Field(ge=2, le=LONGEST, strict=True, description="number of links; one mass between each two")
    link_length: Positive = Field(description="length of a link, m")
    mass: Positive = Field(description="mass of each node between the ends, kg")
    gravity: Positive = Field(9.81, description="acceleration, m/s^2")
    span: Positive = Field(description="horizontal distance of the ends, m")
    drop: Finite = Field(0.0, description="how far the last end is below the first, m")

    @model_validator(mode="after")
    def _reaches(self) -> Self:
        length, distance = self.links * self.link_length, np.hypot(self.span, self.drop)
        if distance >= length:
            raise ValueError(f"the ends are {distance:g} m apart, but the chain is {length:g} m long")
        return self


class Net(Model):
    """Masses on springs in rows and columns, in the plane (x, z); the upper corners are held at (0, 0) and (span, 0).

    Nodes are numbered row by row from the first corner on; links are the springs along rows, then those along columns.
    """

    rows: int = Field(1, ge=1, le=50, strict=True, description="rows of masses, from the held one down")
    columns: int = Field(ge=3, le=50, strict=True, description="masses of each row")
    spacing: Positive = Field(description="length without force of springs along rows and columns, m")
    mass: Positive = Field(description="of each, kg")
    gravity: Positive = Field(9.81, description="acceleration, m/s^2")
    span: Positive = Field(description="distance of the held corners, m")
    stiffness: Positive = Field(description="of springs along rows and columns, N/m")
    shearing: Annotated[Finite, Field(ge=0)] = Field(0.0, description="stiffness of springs along diagonals, N/m")


class Wind(Model):
    """A drag that pulls each mass toward the wind's velocity."""

    drag: Positive = Field(description="force over relative velocity, kg/s")
    velocity: Vector = Field((0.0, 0.0, 0.0), description="of the air, m/s")


class Lateral(Model):
    """Weak springs between nodes of the same number in neighbouring chains; they pull and push."""

    stiffness: Positive = Field(description="force over elongation, N/m")
    rest: Positive | None = Field(None, description="length without force, m; left out: the distance at the start")


class Rope(Model):
    """A chain of masses that moves from its root, in SI units; or several, each turned about the z axis."""

    link_lengths: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=LONGEST)] = Field(
        description="longest length of each link from the root on, m; as many links as entries"
    )
    masses: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=LONGEST)] = Field(
        description="mass at the far end of each link, kg"
    )
    gravity: Annotated[Finite, Field(ge=0)] = Field(9.81, description="acceleration, m/s^2, along -z")
    root: Path = Field((0.0, 0.0, 0.0), description="where node 0 is, m: numbers, or formulas of the time t")
    angle: Finite | None = Field(
        None, description="start: of all links from straight down toward x, degrees; instead of `start`"
    )
    start: tuple[Vector, ...] = Field((), description="start: places of the nodes from 1 on, m")
    velocities: tuple[Vector, ...] = Field(
        (), description="start: velocities of the nodes from 1 on, m/s; left out: at rest"
    )
    count: int = Field(
        1,
        ge=1,
        le=MOST_CHAINS,
        strict=True,
        description="how many such chains: each is turned about the z axis, by an equal part of the circle",
    )
    damping: Annotated[Finite, Field(ge=0)] = Field(
        0.0, description="force on a node over its velocity relative to the node before, which feels the reaction, kg/s"
    )
    lateral: Lateral | None = Field(None, description="springs between neighbouring chains")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        links = len(self.link_lengths)
        if len(self.masses) != links:
            raise ValueError(f"there are {len(self.masses)} masses, but {links} link_lengths")
        if (self.angle is None) == (not self.start):
            raise ValueError("exactly one of 'angle' and 'start' says where the nodes are")
        for name in ("start", "velocities"):
            if getattr(self, name) and len(getattr(self, name)) != links:
                raise ValueError(
                    f"'{name}' has {len(getattr(self, name))} entries, but there are {links} nodes to place"
                )
        if self.lateral and self.count == 1:
            raise ValueError("springs of 'lateral' are between chains, but the count is 1")
        nodes = np.concatenate([moved(self.root, 0.0)[0][None], self.places])
        lengths = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
        for number, (found, allowed) in enumerate(zip(lengths, self.link_lengths, strict=True), start=1):
            if not 0 < found <= allowed * (1 + SLOPPY):
                raise ValueError(
                    f"link {number} is {found:g} m long at the start, but it must be above 0 and at most {allowed:g}"
                )
        return self

    @property
    def places(self) -> Array:
        """Positions of the nodes from 1 on at the start, (n, 3), m."""
        if self.angle is None:
            return np.array(self.start, dtype=float)
        along = np.array([np.sin(np.radians(self.angle)), 0.0, -np.cos(np.radians(self.angle))])
        return np.asarray(moved(self.root, 0.0)[0] + np.cumsum(self.link_lengths)[:, None] * along)

    def around(self, vectors: Array) -> Array:
        """Return vectors (..., 3) of the first chain as those of each chain, (count, ..., 3)."""
        if self.count == 1:
            return vectors[None]
        angles = 2 * np.pi / self.count * np.arange(self.count)
        turns = np.zeros((self.count, 3, 3))
        turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
        turns[:, 1, 0], turns[:, 2, 2] = np.sin(angles), 1.0
        turns[:, 0, 1] = -turns[:, 1, 0]
        return np.asarray(np.einsum("cij,...j->c...i", turns, vectors))


class Particles(Model):
    """Loose masses, in SI units; `count` of them can be set between two places."""

    mass: Positive = Field(1.0, description="of each, kg")
    gravity: Annotated[Finite, Field(ge=0)] = Field(0.0, description="acceleration, m/s^2, along -z")
    start: Annotated[tuple[Vector, ...], Field(min_length=1)] = Field(
        description="places, m; two ends if there is a count"
    )
    count: Annotated[int, Field(ge=2, le=MOST_CHAINS, strict=True)] | None = Field(
        None, description="how many stand evenly from the first place of `start` to before the second"
    )
    velocity: Vector = Field((0.0, 0.0, 0.0), description="of all at the start, m/s")

    @model_validator(mode="after")
    def _counts_between_two(self) -> Self:
        if self.count is not None and len(self.start) != 2:
            raise ValueError(f"a count needs two places in 'start', but there are {len(self.start)}")
        return self

    @property
    def places(self) -> Array:
        """Positions at the start, (n, 3), m; with a `count`, they are the middles of equal parts."""
        if self.count is None:
            return np.array(self.start, dtype=float)
        first, last = np.array(self.start, dtype=float)
        return np.asarray(first + ((np.arange(self.count) + 0.5) / self.count)[:, None] * (last - first))


class RopeCase(Problem):
    """Masses on links, or loose ones, and the quantities asked of them.

    Attributes
    ----------
    chain
        A chain that hangs between two ends.
    net
        A cloth of masses and springs that hangs from its upper corners.
    rope
        A chain that moves from its root, or several.
    particles
        Loose masses.
    wind
        Wind that drags them.
    obstacles
        Bodies that they can't enter.
    quantities
        Quantities asked of every answer; exactly one is primary.
    """

    kind: Literal["rope"]
    theory: Literal["rigid-links", "springs"]
    chain: Chain | None = None
    net: Net | None = None
    rope: Rope | None = None
    particles: Particles | None = None
    wind: Wind | None = None
    obstacles: tuple[Obstacle, ...] = ()
    quantities: Annotated[tuple[RopeQuantity, ...], Field(min_length=1)]

    @property
    def moving(self) -> Rope | Particles | None:
        """The rope or the particles that move; None for a chain at rest."""
        return self.rope or self.particles

    @property
    def chains(self) -> int:
        """Number of chains; none of loose masses."""
        return 0 if self.particles else self.rope.count if self.rope else 1

    @property
    def at_rest(self) -> str:
        """Name of the table of a case at rest."""
        return "net" if self.net else "chain"

    def free(self, vectors: Array) -> Array:
        """Return the rows (n, ...) of nodes that move freely, taken from the rows of all nodes of a motion."""
        if not self.chains:
            return vectors
        by_chain = vectors.reshape(self.chains, -1, *vectors.shape[1:])
        return by_chain[:, 1:].reshape(-1, *vectors.shape[1:])

    @cached_property
    def masses(self) -> Array:
        """Masses that move freely, (n,), kg."""
        if self.rope:
            return np.tile(self.rope.masses, self.rope.count)
        if self.particles:
            return np.full(len(self.particles.places), self.particles.mass)
        if self.net:
            return np.full(self.net.rows * self.net.columns - 2, self.net.mass)
        assert self.chain is not None
        return np.full(self.chain.links - 1, self.chain.mass)

    @property
    def gravity(self) -> float:
        """Acceleration along -z, m/s^2."""
        weighs = self.chain or self.net or self.moving
        assert weighs is not None
        return weighs.gravity

    @property
    def links(self) -> int:
        """Number of links, of all chains."""
        if self.net:
            return self.net.rows * (self.net.columns - 1) + (self.net.rows - 1) * self.net.columns
        return self.chain.links if self.chain else len(self.masses) if self.rope else 0

    def physics(self) -> dict[str, Any]:
        """Return all data that an answer depends on, without absent tables and keys of a rope at their defaults."""
        tables = ("chain", "net", "rope", "particles", "wind", "obstacles")
        data = {key: value for key, value in super().physics().items() if value or key not in tables}
        if self.rope:
            data["rope"] = {key: value for key, value in data["rope"].items() if LATER.get(key, self) != value}
        return data

    @model_validator(mode="after")
    def _parts_are_there(self) -> Self:
        if sum(table is not None for table in (self.chain, self.net, self.rope, self.particles)) != 1:
            raise ValueError("exactly one of the tables 'chain', 'rope', 'particles' and 'net' must be there")
        if (self.theory == "springs") != (self.net is not None):
            raise ValueError("the theory of a net is 'springs', that of all else 'rigid-links'")
        if not self.moving and (self.wind or self.obstacles):
            raise ValueError("a chain between two ends, or a net, has no wind and no obstacles; 'rope' has")
        nodes = len(self.masses) + (self.chains if self.moving else 2)
        for quantity in self.quantities:
            if not self.moving and not isinstance(quantity, STILL):
                raise ValueError(f"quantity '{quantity.name}' is of a motion, but this {self.at_rest} is at rest")
            if self.moving and quantity.at < 0:
                raise ValueError(f"quantity '{quantity.name}' is asked at {quantity.at:g} s, before the start")
            if hasattr(quantity, "link") and not self.links:
                raise ValueError(f"quantity '{quantity.name}' is of a link, but loose masses have none")
            number, last = getattr(quantity, "node", 0), nodes - 1
            if hasattr(quantity, "link"):
                number, last = quantity.link, self.links
            if number > last:
                raise ValueError(f"quantity '{quantity.name}' is of number {number}, but {last} is the last")
        self._check_obstacles()
        return self

    def _check_obstacles(self) -> None:
        """Raise ValueError if a root jumps, or a mass or root starts inside an obstacle or is led into one."""
        if self.moving is None:
            return
        places = self.rope.around(self.rope.places) if self.rope else self.moving.places
        if deep := deepest(self.obstacles, places, 0.0):
            raise ValueError(f"a mass is {deep:g} m deep in an obstacle at the start")
        if self.rope is None or (not any(isinstance(f, str) for f in self.rope.root) and not self.obstacles):
            return
        times = np.linspace(0.0, self.states[-1], ROOT_SAMPLES + 1)
        places = np.array([moved(self.rope.root, time)[0] for time in times])
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        if steps.max() > sum(self.rope.link_lengths):
            raise ValueError(f"the root jumps by {steps.max():g} m near t = {times[steps.argmax()]:g}")
        for time, place in zip(times, places, strict=True):
            if deepest(self.obstacles, self.rope.around(place), float(time)):
                raise ValueError(f"an obstacle is around the root at t = {time:g}")
