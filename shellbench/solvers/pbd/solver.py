"""The solvers `rope-pbd` and `rope-xpbd`: chains whose links are constraints on positions, as in games.

    Müller et al. (2007), "Position based dynamics";  Macklin, Müller, Chentanez (2016), "XPBD";
    Macklin et al. (2014), "Unified particle physics", friction;  (2019), "Small steps in physics simulation"

A step of length h moves each mass freely, and then corrects the links, one after another:

    v += h F / M,  x* = x + h v;  of each link that is longer than l, so many times:  x_near += w_near p e,
    x_far -= w_far p e,  p = (|x_far - x_near| - l) / (w_near + w_far),  w = 1 / M;  v = (x* - x) / h

The compliant form keeps the sum P of a link's pulls of the step. With the compliance a, m/N, and P + p >= 0,

    p = (|x_far - x_near| - l - a P / h^2) / (w_near + w_far + a / h^2).

P / h^2 is the tension. Links with odd numbers are corrected at once, and then the others: this is Gauss and Seidel's
method in another order, which converges as fast along a chain.

Obstacles follow after the links. A mass at a depth d moves by d along the gradient. Its relative displacement of the
step along the surface is reduced by friction: by mu d, or to zero. A mass that passes through an obstacle within a step
is missed. No equation of the scheme in `solvers.rope` occurs here.

Arrays have nodes first and chains after them, (n + 1, C, 3); loose masses are chains of one node without a link.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import SolveFailure
from shellbench.problem import Capabilities, ProgressCallback, Settings
from shellbench.problems.obstacle import deepest
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.problems.rope.solving import RopeSolver, Watch, halved, refined, roots_of, spans, start_of
from shellbench.protocol.schema import Finite

Array = NDArray[np.float64]

TINY = 1e-300  # keeps directions of links without length finite
FAR = 1e9  # m: a motion that goes so far has diverged


class PbdSettings(Settings):
    """Settings of `PbdSolver`: one step, with many corrections of its links."""

    steps_per_second: Finite = Field(240.0, gt=0, le=1e7, description="of the finest of three solves")
    substeps: int = Field(1, ge=1, le=10_000, strict=True, description="parts of a step, each solved by itself")
    iterations: int = Field(20, ge=1, le=100_000, strict=True, description="how often all links are put right")
    stiffness: Finite = Field(1.0, gt=0, le=1, description="share of a link's excess that is put right at a time")


class XpbdSettings(Settings):
    """Settings of `XpbdSolver`: many small steps, with one correction of the links each."""

    steps_per_second: Finite = Field(240.0, gt=0, le=1e7, description="of the finest of three solves")
    substeps: int = Field(20, ge=1, le=10_000, strict=True, description="parts of a step, each solved by itself")
    iterations: int = Field(1, ge=1, le=100_000, strict=True, description="how often all links are put right")
    compliance: Finite = Field(0.0, ge=0, description="of a link, m/N: 0 asks for a rigid one")


def put_right(nodes: Array, lengths: Array, inverse: Array, pulls: Array, stiffness: float, softness: float) -> None:
    """Correct all links once, in place, and add to their pulls.

    Parameters
    ----------
    nodes, inverse
        Places (n + 1, ..., 3), m, and inverse masses (n + 1, ...), 1/kg, zero at the root.
    lengths, pulls
        (n, ...), m, and kg m: sums of the step so far.
    softness
        Compliance over h^2, 1/kg, of the compliant form; negative for the other form, which ignores its pulls.
    """
    compliant = softness >= 0
    for first in (0, 1):
        near, far = nodes[first:-1:2], nodes[first + 1 :: 2]
        along = far - near
        found = np.sqrt(np.einsum("...k,...k->...", along, along))
        w_near, w_far, summed = inverse[first:-1:2], inverse[first + 1 :: 2], pulls[first::2]
        excess = found - lengths[first::2]
        if compliant:
            pull = np.maximum((excess - softness * summed) / (w_near + w_far + softness), -summed)
        else:
            pull = stiffness * np.maximum(excess, 0.0) / (w_near + w_far)
        summed += pull
        along *= (pull / np.maximum(found, TINY))[..., None]
        near += w_near[..., None] * along
        far -= w_far[..., None] * along


def pushed_out(nodes: Array, before: Array, obstacle: Any, was: Array, now: Array) -> None:
    """Push masses out of an obstacle, in place, with its friction.

    Parameters
    ----------
    nodes, before
        Places (..., 3), m, now and at the start of the step.
    was, now
        Centre of the obstacle at the start and the end of the step, (3,), m.
    """
    offsets = nodes - now
    depth = np.maximum(0.0, -obstacle.distance(offsets))
    if not depth.any():
        return
    normal = obstacle.gradient(offsets)
    nodes += depth[..., None] * normal
    if obstacle.friction:
        way = (nodes - before) - (now - was)
        sliding = way - np.einsum("...k,...k->...", way, normal)[..., None] * normal
        slides = np.sqrt(np.einsum("...k,...k->...", sliding, sliding))
        nodes -= np.minimum(1.0, obstacle.friction * depth / np.maximum(slides, TINY))[..., None] * sliding


class PbdSolver(RopeSolver):
    """Position-based dynamics."""

    name: ClassVar[str] = "rope-pbd"
    capabilities: ClassVar[Capabilities] = Capabilities(("rigid-links",), "rope chains: position-based dynamics")
    settings_type: ClassVar[type[Settings]] = PbdSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = tuple({"steps_per_second": n} for n in (60.0, 240.0, 960.0))

    def declines(self, case: Any) -> str | None:
        """Return the reason that it declines a problem, as one clause, or None if it takes it."""
        if not isinstance(case, RopeCase) or not case.moving:
            return "it solves ropes and loose masses in motion only"
        if case.rope and (case.rope.damping or case.rope.lateral):
            return "it knows no damping of links and no springs between chains"
        return None

    def declines_quantity(self, case: Any, quantity: Any) -> str | None:
        """Return the reason that it can't give a quantity, as one clause, or None if it can."""
        return "it knows a link's pull after a step only, and the start is asked for" if quantity.at == 0 else None

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> RopeMotion:
        """Follow the motion with three steps in time."""
        told = settings.model_dump()
        levels = halved(settings.steps_per_second)
        return refined(case, levels, lambda rate, watch: followed(case, settings, rate, watch), told, progress)


class XpbdSolver(PbdSolver):
    """Position-based dynamics in its compliant form, with small steps."""

    name: ClassVar[str] = "rope-xpbd"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("rigid-links",), "rope chains: compliant position-based dynamics with small steps"
    )
    settings_type: ClassVar[type[Settings]] = XpbdSettings


def followed(case: RopeCase, settings: Any, rate: float, watch: Watch) -> list[RopeState]:
    """Return the states at the case's times; SolveFailure, with the earlier states, if the motion diverges."""
    # 1. Move all masses freely by a substep, and the root as prescribed.
    # 2. Correct the links and push masses out of obstacles, `iterations` times.
    # 3. Take velocities from the differences of places; record stretch and depth.
    # 4. Keep a state at each of the case's times; pulls over h^2 are the tensions.
    rope, chains = case.rope, case.chains or len(case.masses)
    nodes, velocities = (np.array(by_node(each, chains)) for each in start_of(case))
    inverse = by_node(1.0 / case.masses, chains)
    lengths = np.array(rope.link_lengths if rope else [])[:, None] + np.zeros(chains)
    if rope:
        inverse, roots = np.vstack([np.zeros((1, chains)), inverse]), roots_of(case)
    wind = np.array(case.wind.velocity) if case.wind else np.zeros(3)
    drag = (case.wind.drag if case.wind else 0.0) * inverse[..., None]
    down = np.array([0.0, 0.0, -case.gravity])
    stiffness, compliance = getattr(settings, "stiffness", 1.0), getattr(settings, "compliance", None)
    states = watch.states
    stretch, depth, time, first = 0.0, 0.0, 0.0, 1 if rope else 0
    now = [obstacle.at(time)[0] for obstacle in case.obstacles]
    for until, count, step in spans(case, rate):
        h = step / settings.substeps
        softness = -1.0 if compliance is None else compliance / h**2
        pulls = np.zeros_like(lengths)
        for number in range(count * settings.substeps):
            if watch.due(time, h):
                watch.keep(time, by_chain(nodes))
            before, was = nodes, now
            time = until - (count * settings.substeps - 1 - number) * h
            velocities = velocities + h * (down + drag * (wind - velocities))
            nodes = nodes + h * velocities
            if rope:
                nodes[0], root_velocity, _ = roots(time)
            now = [obstacle.at(time)[0] for obstacle in case.obstacles]
            pulls = np.zeros_like(lengths)
            for _ in range(settings.iterations):
                put_right(nodes, lengths, inverse, pulls, stiffness, softness)
                for obstacle, *centres in zip(case.obstacles, was, now, strict=True):
                    pushed_out(nodes[first:], before[first:], obstacle, *centres)
            if not np.all(np.abs(nodes) < FAR):
                raise SolveFailure(f"the motion diverges at t = {time:g} s", states)
            velocities = (nodes - before) / h
            if rope:
                velocities[0] = root_velocity
                found = np.linalg.norm(np.diff(nodes, axis=0), axis=-1)
                stretch = max(stretch, float((found / lengths).max()) - 1.0)
            if case.obstacles:
                depth = max(depth, deepest(case.obstacles, nodes[first:], time))
            if (number + 1) % settings.substeps == 0:
                watch.stepped()
        states.append(RopeState(by_chain(nodes), by_chain(velocities), by_chain(pulls) / h**2, stretch, depth))
    return states


def by_node(values: Array, chains: int) -> Array:
    """Return values of chain after chain, (chains * n, ...), with nodes or links first: (n, chains, ...)."""
    return values.reshape(chains, -1, *values.shape[1:]).swapaxes(0, 1)


def by_chain(values: Array) -> Array:
    """Return the reverse of `by_node`."""
    return values.swapaxes(0, 1).reshape(-1, *values.shape[2:])
