"""The solvers `rope-printed` and `rope-exact`: one scheme in time, as the paper prints it and corrected.

    Jin et al., "A Neural-Network-Based Approach for Loose-Fitting Clothing", sections 3 to 6

What is corrected: tensions between unequal masses, links that are taut within what gravity moves in a step, and
masses that follow an obstacle's surface. Each solve is made with three steps in time, and what halvings change is
stated as the uncertainty; coarser steps that diverge are left out of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import InputError, SolveFailure
from shellbench.model import Finite
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution, Step
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.motion import moved
from shellbench.problems.rope.obstacle import deepest
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.solvers.rope.contact import Normal, Push
from shellbench.solvers.rope.placing import Placing
from shellbench.solvers.rope.stepping import Chains, Moving, Scheme, Solve, Stepper

Array = NDArray[np.float64]

LEVELS = (4, 2, 1)  # of the step in time: steps that are so many times as long
FAR = 1e9  # times its extent: a motion that goes so far has diverged
ROUNDING = 1e-15


class RopeSettings(Settings):
    """Settings of `ExactSolver`."""

    steps_per_second: Finite = Field(240.0, gt=0, le=1e7, description="of the finest of three solves")
    solve: Solve = Field("direct", description="pulls of links: direct, or by sweeps of Gauss and Seidel")
    sweeps: Annotated[int, Field(ge=1, strict=True)] | None = Field(
        None, description='of `solve = "sweeps"`: how many; None: until they change by less than the tolerance'
    )
    tolerance: Finite = Field(1e-6, gt=0, lt=1, description="of sweeps: change relative to the largest pull")
    taut: Finite = Field(
        0.4, ge=0, le=100, description="a link is taut if shorter than its length by at most this times g dt^2"
    )
    placing: Placing = Field("rotation", description="what a taut link does: it turns, or is evolved and projected")
    push: Push = Field(
        "history", description="out of an obstacle: along gradient or reverse way, or from where it was met"
    )
    pushes: int = Field(1, ge=1, le=1000, strict=True, description="how often a push by the depth is repeated")
    normal: Normal = Field("gradient", description="of the rebound: gradient of the distance, or the reverse way")
    again: bool = Field(False, description="whether impulses are applied after the position update too")
    resting: bool = Field(True, description="whether what touches an obstacle rebounds at the end of a step too")


class PrintedSettings(RopeSettings):
    """Settings of `PrintedSolver`: the choices that the paper makes, where it says them.

    The direct solve gives what its sweeps converge to.
    """

    taut: Finite = Field(
        0.0, ge=0, le=100, description="a link is taut if shorter than its length by at most this times g dt^2"
    )
    push: Push = Field(
        "reverse", description="out of an obstacle: along gradient or reverse way, or from where it was met"
    )
    normal: Normal = Field("reverse", description="of the rebound: gradient of the distance, or the reverse way")
    resting: bool = Field(False, description="whether what touches an obstacle rebounds at the end of a step too")


def scheme_of(settings: RopeSettings, *, printed: bool) -> Scheme:
    """Return the scheme that settings choose."""
    return Scheme(printed=printed, **settings.model_dump(exclude={"steps_per_second"}))


def chains_of(case: RopeCase) -> tuple[Chains, Moving]:
    """Return the chains of a case and their start: one chain, or each loose mass on a link without end."""
    rope, particles = case.rope, case.particles
    wind = case.wind
    drag, air = (wind.drag, np.array(wind.velocity)) if wind else (0.0, None)
    root: Callable[[float], tuple[Array, Array, Array]]
    if rope:
        path = rope.root
        places, lengths, masses = rope.places[:, None], np.array(rope.link_lengths)[:, None], case.masses[:, None]
        velocities = np.array(rope.velocities)[:, None] if rope.velocities else np.zeros_like(places)
        root = lambda t: moved(path, t)  # noqa: E731
    else:
        assert particles is not None
        places, masses = particles.places[None], case.masses[None]
        lengths, velocities = np.full_like(masses, np.inf), np.zeros_like(places) + particles.velocity
        root = lambda t: (np.zeros(3), np.zeros(3), np.zeros(3))  # noqa: E731
    chains = Chains(lengths, masses, case.gravity, root, drag, air, tuple(case.obstacles))
    return chains, Moving(0.0, places, velocities)


def kept(case: RopeCase, chains: Chains, stepper: Stepper, moving: Moving, stretch: float, depth: float) -> RopeState:
    """Return what is kept of an instant."""
    tensions = stepper.state_tensions(moving)
    if case.particles:
        return RopeState(moving.places[0], moving.velocities[0], np.zeros(0), stretch, depth)
    place, velocity, _ = chains.root(moving.time)
    nodes, velocities = np.vstack([place, moving.places[:, 0]]), np.vstack([velocity, moving.velocities[:, 0]])
    return RopeState(nodes, velocities, tensions[:, 0], stretch, depth)


def followed(case: RopeCase, scheme: Scheme, rate: float, tell: Callable[[int], None]) -> list[RopeState]:
    """Return the states at the case's times.

    Raises
    ------
    SolveFailure
        If the motion diverges; the states before are its `partial`, a list.
    """
    chains, moving = chains_of(case)
    far = FAR * max(1.0, float(np.abs(moving.places).max()))
    states: list[RopeState] = []
    stretch, depth, steps = 0.0, 0.0, 0
    moving = Stepper(chains, scheme, 1.0 / rate).start(moving)
    for until in case.states:
        count = math.ceil((until - moving.time) * rate - 1e-9)
        stepper = Stepper(chains, scheme, (until - moving.time) / count if count else 1.0 / rate)
        for number in range(count):
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    moving = stepper.after(moving)
            except np.linalg.LinAlgError:
                raise SolveFailure(f"the pulls of links have no solution at t = {moving.time:g}", states) from None
            if not np.all(np.abs(moving.places) < far):
                raise SolveFailure(f"the motion diverges at t = {moving.time:g} s", states)
            if number == count - 1:
                moving = Moving(until, moving.places, moving.velocities)
            if case.rope:
                lengths = stepper.links(moving.places, chains.root(moving.time)[0])[1]
                stretch = max(stretch, float((lengths / chains.lengths).max()) - 1.0)
            if case.obstacles:
                depth = max(depth, deepest(case.obstacles, moving.places.reshape(-1, 3), moving.time))
            steps += 1
            tell(steps)
        states.append(kept(case, chains, stepper, moving, stretch, depth))
    return states


class ExactSolver:
    """The scheme with the corrections."""

    name: ClassVar[str] = "rope-exact"
    printed: ClassVar[bool] = False
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("rigid-links",), "rope chains: the published scheme, corrected"
    )
    settings_type: ClassVar[type[RopeSettings]] = RopeSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = tuple({"steps_per_second": n} for n in (60.0, 120.0, 240.0))

    def declines(self, case: Any) -> str | None:
        """Return why it can't take a problem: nothing in it moves."""
        return None if isinstance(case, RopeCase) and case.moving else "it solves ropes and loose masses in motion only"

    def solve(
        self,
        case: RopeCase,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> RopeMotion:
        """Follow the motion with three steps in time.

        Raises
        ------
        SolveFailure
            If it diverges; the states before come with it.
        InputError
            If an earlier solution is given, or the case is declined.
        """
        if start is not None:
            raise InputError(f"{self.name} starts from no earlier solution")
        if reason := self.declines(case):
            raise InputError(f"{case.name}: {reason}")
        chosen = settings if isinstance(settings, RopeSettings) else self.settings_type.model_validate(settings or {})
        scheme = scheme_of(chosen, printed=self.printed)
        began, found = time.perf_counter(), []
        history: list[Step] = []
        for number, longer in enumerate(LEVELS):
            rate = chosen.steps_per_second / longer

            def tell(step: int, rate: float = rate) -> None:
                if progress and step % 100 == 0:
                    progress(Progress(step, None, f"{rate:g} steps a second"))

            try:
                motion = RopeMotion(case, tuple(followed(case, scheme, rate, tell)))
            except SolveFailure as failure:
                if longer > 1:  # a step that is too long says nothing of the answer
                    continue
                partial = RopeMotion(case, tuple(failure.partial), tuple(history))
                raise SolveFailure(str(failure), partial) from None
            found.append({quantity.name: quantity.measure(motion) for quantity in case.quantities})
            last = motion.kept[-1]
            moves = 0.5 * float(case.masses @ np.sum(last.velocities[case.first :] ** 2, axis=1))
            energy = moves + case.gravity * float(case.masses @ last.nodes[case.first :, 2])
            history.append(Step(number, time.perf_counter() - began, energy, motion.parameters, quantities=found[-1]))
        uncertainty = {name: settled([values[name] for values in found]) for name in found[-1]} if found[1:] else {}
        told = {
            "steps_per_second": chosen.steps_per_second,
            "taut_within": chosen.taut * case.gravity / chosen.steps_per_second**2,
        }
        return RopeMotion(case, motion.kept, tuple(history), uncertainty, told)

    def load(self, path: Path) -> RopeMotion:
        """Read what `RopeMotion.save` wrote; InputError in one sentence if it is none."""
        return RopeMotion.load(path)


def settled(values: Sequence[float]) -> float:
    """Return how wrong the last value may be, of steps halved each time, if errors fall as the step."""
    changes = np.abs(np.diff(values))
    return float(np.max(changes / 2.0 ** np.arange(len(changes))[::-1])) + ROUNDING * abs(values[-1])


class PrintedSolver(ExactSolver):
    """The scheme as it is printed."""

    name: ClassVar[str] = "rope-printed"
    printed: ClassVar[bool] = True
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("rigid-links",), "rope chains: the published scheme as printed"
    )
    settings_type: ClassVar[type[RopeSettings]] = PrintedSettings
