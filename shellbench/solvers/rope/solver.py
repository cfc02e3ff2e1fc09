"""The solvers `rope-printed` and `rope-exact`: a scheme in time as printed in the paper, and corrected.

    Jin et al., "A Neural-Network-Based Approach for Loose-Fitting Clothing", sections 3 to 6

The corrections concern tensions between unequal masses, links that are taut up to the displacement by gravity in a
step, and masses that follow an obstacle's surface. Each case is solved with three steps in time, and the change by
halving the step is stated as the uncertainty. Coarser steps that diverge are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, ProgressCallback, Settings
from shellbench.problems.obstacle import deepest
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.problems.rope.solving import RopeSolver, Watch, halved, refined, roots_of, spans, start_of
from shellbench.protocol.engine import need
from shellbench.protocol.schema import Finite
from shellbench.solvers.rope.contact import Normal, Push
from shellbench.solvers.rope.placing import Placing
from shellbench.solvers.rope.stepping import Chains, Moving, Scheme, Solve, Stepper

Array = NDArray[np.float64]

FAR = 1e9  # times its extent: a motion that goes so far, or so far in a second, has diverged


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
    compiled: bool = Field(
        False,
        description="whether steps are compiled (extra `compiled`): direct ones, without obstacles",
    )

    @model_validator(mode="after")
    def _compiled_steps_are_direct(self) -> Self:
        if self.compiled and self.solve != "direct":
            raise ValueError("compiled steps are direct: 'compiled' and solve = \"sweeps\" exclude each other")
        return self


class PrintedSettings(RopeSettings):
    """Settings of `PrintedSolver`: the paper's choices, as far as it states them.

    The direct solve gives the limit of the paper's sweeps.
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
    """Return the scheme of the settings."""
    return Scheme(printed=printed, **settings.model_dump(exclude={"steps_per_second"}))


def chains_of(case: RopeCase) -> tuple[Chains, Moving]:
    """Return the chains of a case and their start; each loose mass is on a link without end."""
    wind = case.wind
    drag, air = (wind.drag, np.array(wind.velocity)) if wind else (0.0, None)
    places, velocities = start_of(case)
    if case.rope:
        lengths = np.tile(np.array(case.rope.link_lengths)[:, None], case.chains)
        masses = case.masses.reshape(lengths.shape[::-1]).T
        shape = (*masses.T.shape, 3)
        first, going = (
            np.ascontiguousarray(case.free(each).reshape(shape).swapaxes(0, 1)) for each in (places, velocities)
        )
        bodies, damping = tuple(case.obstacles), case.rope.damping
        chains = Chains(lengths, masses, case.gravity, roots_of(case), drag, air, bodies, damping)
        if lateral := case.rope.lateral:
            apart = np.linalg.norm(np.roll(first, -1, axis=1) - first, axis=-1)
            rest = apart[:, : case.chains if case.chains > 2 else 1]  # two chains have one spring a node
            rest = rest if lateral.rest is None else np.full_like(rest, lateral.rest)
            chains = replace(chains, stiffness=lateral.stiffness, rest=rest)
        return chains, Moving(0.0, first, going)
    masses, still = case.masses[None], (np.zeros(3), np.zeros(3), np.zeros(3))
    lengths = np.full_like(masses, np.inf)
    chains = Chains(lengths, masses, case.gravity, lambda _: still, drag, air, tuple(case.obstacles))
    return chains, Moving(0.0, places[None], velocities[None])


def recorded_state(case: RopeCase, stepper: Stepper, moving: Moving, stretch: float, depth: float) -> RopeState:
    """Return the state to keep of an instant."""
    tensions = np.zeros(0) if case.particles else stepper.state_tensions(moving).T.ravel()
    root, velocity, _ = stepper.chains.root(moving.time)
    return RopeState(
        every_node(case, moving.places, root), every_node(case, moving.velocities, velocity), tensions, stretch, depth
    )


def every_node(case: RopeCase, vectors: Array, root: Array) -> Array:
    """Return a vector of each node, (n, 3): of loose masses in their order, else chain after chain, the root first."""
    return vectors[0] if case.particles else np.vstack([root[None], vectors]).swapaxes(0, 1).reshape(-1, 3)


def follow_rope(case: RopeCase, scheme: Scheme, rate: float, watch: Watch) -> list[RopeState]:
    """Return the states at the case's times.

    Raises
    ------
    SolveFailure
        If the motion diverges; the earlier states are its `partial`, a list.
    """
    chains, moving = chains_of(case)
    far = FAR * max(1.0, float(np.abs(moving.places).max()))
    states = watch.states
    stretch, depth = 0.0, 0.0
    moving = Stepper(chains, scheme, 1.0 / rate).start(moving)
    for until, count, step in spans(case, rate):
        stepper = Stepper(chains, scheme, step)
        for number in range(count):
            if watch.due(moving.time, step):
                watch.keep(moving.time, every_node(case, moving.places, chains.root(moving.time)[0]))
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    moving = stepper.next_state(moving)
            except np.linalg.LinAlgError:
                raise SolveFailure(f"the pulls of links have no solution at t = {moving.time:g}", states) from None
            # links keep places near, whatever the speeds
            if not (np.all(np.abs(moving.places) < far) and np.all(np.abs(moving.velocities) < far)):
                raise SolveFailure(f"the motion diverges at t = {moving.time:g} s", states)
            if number == count - 1:
                moving = Moving(until, moving.places, moving.velocities)
            if case.rope:
                stretch = max(stretch, chains.stretch(moving.places, chains.root(moving.time)[0]))
            if case.obstacles:
                depth = max(depth, deepest(case.obstacles, moving.places.reshape(-1, 3), moving.time))
            watch.stepped()
        states.append(recorded_state(case, stepper, moving, stretch, depth))
    return states


class ExactSolver(RopeSolver):
    """The scheme with the corrections."""

    name: ClassVar[str] = "rope-exact"
    printed: ClassVar[bool] = False
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("rigid-links",), "rope chains: the published scheme, corrected"
    )
    settings_type: ClassVar[type[RopeSettings]] = RopeSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = tuple({"steps_per_second": n} for n in (60.0, 120.0, 240.0))

    def declines(self, case: Any) -> str | None:
        """Return the reason that it declines a problem, or None: something in it has to move."""
        return None if isinstance(case, RopeCase) and case.moving else "it solves ropes and loose masses in motion only"

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> RopeMotion:
        """Follow the motion with three steps in time."""
        if settings.compiled:
            need("compiled", ("numba",))
            if case.obstacles or (case.rope and (case.rope.damping or case.rope.lateral)):
                raise InputError(f"{case.name}: compiled steps know no obstacles, no damping and no springs")
        scheme, rate = scheme_of(settings, printed=self.printed), settings.steps_per_second
        told = {"steps_per_second": rate, "taut_within": settings.taut * case.gravity / rate**2}
        return refined(case, halved(rate), lambda level, watch: follow_rope(case, scheme, level, watch), told, progress)


class PrintedSolver(ExactSolver):
    """The scheme as it is printed."""

    name: ClassVar[str] = "rope-printed"
    printed: ClassVar[bool] = True
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("rigid-links",), "rope chains: the published scheme as printed"
    )
    settings_type: ClassVar[type[RopeSettings]] = PrintedSettings
