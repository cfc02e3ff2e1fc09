"""The solvers `rope-pbd` and `rope-xpbd`: chains whose links are constraints on positions, as in games.

    Müller et al. (2007), "Position based dynamics";  Macklin, Müller, Chentanez (2016), "XPBD";
    Macklin et al. (2019), "Small steps in physics simulation"

A step of length h moves each mass freely, and then puts right what is wrong with the links, one after another:

    v += h F / M,  x* = x + h v;  of each link that is longer than l, so many times:  x_near += w_near p e,
    x_far -= w_far p e,  p = (|x_far - x_near| - l) / (w_near + w_far),  w = 1 / M;  v = (x* - x) / h

The compliant form keeps the sum P of a link's pulls of the step. With the compliance a, m/N, and P + p >= 0,

    p = (|x_far - x_near| - l - a P / h^2) / (w_near + w_far + a / h^2).

P / h^2 is the tension. Links with odd numbers are put right at once, and
then the others: Gauss and Seidel's method in another order, which converges as fast along a chain.
No equation of the scheme in `solvers.rope` occurs here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import SolveFailure
from shellbench.model import Finite
from shellbench.problem import Capabilities, ProgressCallback, Settings
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.motion import moved
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.problems.rope.solving import RopeSolver, Watch, halved, refined, spans, start_of

Array = NDArray[np.float64]

TINY = 1e-300  # keeps directions of links without length finite
FAR = 1e9  # m: a motion that goes so far has diverged


class PbdSettings(Settings):
    """Settings of `PbdSolver`: one step, whose links are put right many times."""

    steps_per_second: Finite = Field(240.0, gt=0, le=1e7, description="of the finest of three solves")
    substeps: int = Field(1, ge=1, le=10_000, strict=True, description="parts of a step, each solved by itself")
    iterations: int = Field(20, ge=1, le=100_000, strict=True, description="how often all links are put right")
    stiffness: Finite = Field(1.0, gt=0, le=1, description="share of a link's excess that is put right at a time")


class XpbdSettings(Settings):
    """Settings of `XpbdSolver`: many small steps, whose links are put right once."""

    steps_per_second: Finite = Field(240.0, gt=0, le=1e7, description="of the finest of three solves")
    substeps: int = Field(20, ge=1, le=10_000, strict=True, description="parts of a step, each solved by itself")
    iterations: int = Field(1, ge=1, le=100_000, strict=True, description="how often all links are put right")
    compliance: Finite = Field(0.0, ge=0, description="of a link, m/N: 0 asks for a rigid one")


def put_right(nodes: Array, lengths: Array, inverse: Array, pulls: Array, stiffness: float, softness: float) -> None:
    """Put all links right once, in place, and add to their pulls.

    Parameters
    ----------
    nodes, inverse
        Places (n + 1, 3), m, and inverse masses (n + 1,), 1/kg, zero at the root.
    lengths, pulls
        (n,), m, and kg m: sums of the step so far.
    softness
        Compliance over h^2, 1/kg, of the compliant form; negative of the other one, which does not know of its pulls.
    """
    compliant = softness >= 0
    for first in (0, 1):
        near, far = nodes[first:-1:2], nodes[first + 1 :: 2]
        along = far - near
        found = np.sqrt(np.einsum("ik,ik->i", along, along))
        w_near, w_far, summed = inverse[first:-1:2], inverse[first + 1 :: 2], pulls[first::2]
        excess = found - lengths[first::2]
        if compliant:
            pull = np.maximum((excess - softness * summed) / (w_near + w_far + softness), -summed)
        else:
            pull = stiffness * np.maximum(excess, 0.0) / (w_near + w_far)
        summed += pull
        along *= (pull / np.maximum(found, TINY))[:, None]
        near += w_near[:, None] * along
        far -= w_far[:, None] * along


class PbdSolver(RopeSolver):
    """Position-based dynamics."""

    name: ClassVar[str] = "rope-pbd"
    capabilities: ClassVar[Capabilities] = Capabilities(("rigid-links",), "rope chains: position-based dynamics")
    settings_type: ClassVar[type[Settings]] = PbdSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = tuple({"steps_per_second": n} for n in (60.0, 240.0, 960.0))

    def declines(self, case: Any) -> str | None:
        """Return why it can't take a problem, as one clause, or None if it can."""
        if not isinstance(case, RopeCase) or case.rope is None:
            return "it solves ropes in motion only"
        if case.obstacles:
            return "it knows no obstacles"
        if case.states[0] == 0:
            return "it knows a link's pull after a step only, and figures at the start are asked for"
        return None

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> RopeMotion:
        """Follow the motion with three steps in time."""
        told = settings.model_dump()
        levels = halved(settings.steps_per_second)
        return refined(case, levels, lambda rate, watch: followed(case, settings, rate, watch), told, progress)


class XpbdSolver(PbdSolver):
    """Its compliant form, with small steps."""

    name: ClassVar[str] = "rope-xpbd"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("rigid-links",), "rope chains: compliant position-based dynamics with small steps"
    )
    settings_type: ClassVar[type[Settings]] = XpbdSettings


def followed(case: RopeCase, settings: Any, rate: float, watch: Watch) -> list[RopeState]:
    """Return the states at the case's times; SolveFailure, with those before, if the motion diverges."""
    assert case.rope is not None
    nodes, velocities = start_of(case)
    lengths, root = np.array(case.rope.link_lengths), case.rope.root
    inverse = np.concatenate([[0.0], 1.0 / case.masses])
    wind = np.array(case.wind.velocity) if case.wind else np.zeros(3)
    drag = (case.wind.drag if case.wind else 0.0) * inverse[:, None]
    down = np.array([0.0, 0.0, -case.gravity])
    stiffness, compliance = getattr(settings, "stiffness", 1.0), getattr(settings, "compliance", None)
    states: list[RopeState] = []
    stretch, time = 0.0, 0.0
    for until, count, step in spans(case, rate):
        h = step / settings.substeps
        softness = -1.0 if compliance is None else compliance / h**2
        for number in range(count * settings.substeps):
            if watch.due(time, h):
                watch.keep(time, nodes)
            time = until - (count * settings.substeps - 1 - number) * h
            before = nodes
            velocities = velocities + h * (down + drag * (wind - velocities))
            nodes = nodes + h * velocities
            nodes[0], root_velocity, _ = moved(root, time)
            pulls = np.zeros_like(lengths)
            for _ in range(settings.iterations):
                put_right(nodes, lengths, inverse, pulls, stiffness, softness)
            if not np.all(np.abs(nodes) < FAR):
                raise SolveFailure(f"the motion diverges at t = {time:g} s", states)
            velocities = (nodes - before) / h
            velocities[0] = root_velocity
            found = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
            stretch = max(stretch, float((found / lengths).max()) - 1.0)
            watch.stepped()
        states.append(RopeState(nodes, velocities, pulls / h**2, stretch))
    return states
