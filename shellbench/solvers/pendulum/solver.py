"""The solver `pendulum-ode`: a chain by the angles of its links, Lagrange's equations and DOP853.

It shares no mechanics with `rope-exact`. Its links can't be slack: a chain that lets go ends the solve.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution, Step
from shellbench.problems.rope.case import Rope, RopeCase
from shellbench.problems.rope.motion import moved
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.solvers.pendulum.motion import Pendulum, integrated

Array = NDArray[np.float64]

COARSER = 100.0  # times the tolerance: what the two solves differ by is the uncertainty
SLACK = 1e-9  # of the weight: a push that is no larger is rounding
SHORT = 1e-9  # of a length: a link that is shorter by more is slack
ROUNDING = 1e-14


class PendulumSettings(Settings):
    """Settings of `PendulumSolver`."""

    tolerance: float = Field(1e-12, ge=1e-13, le=1e-3, description="relative and absolute, of a step of DOP853")


class PendulumSolver:
    """Lagrange's equations of a planar chain."""

    name: ClassVar[str] = "pendulum-ode"
    capabilities: ClassVar[Capabilities] = Capabilities(("rigid-links",), "planar chains by their angles, DOP853")
    settings_type: ClassVar[type[Settings]] = PendulumSettings

    def declines(self, case: Any) -> str | None:
        """Return why it can't take a problem, as one clause, or None if it can."""
        if not isinstance(case, RopeCase) or case.rope is None:
            return "it solves ropes in motion only"
        if case.obstacles:
            return "it knows no obstacles"
        rope = case.rope
        if any(formula != 0 for formula in (rope.root[1], *rope_offsets(rope))):
            return "it solves motions in the plane (x, z) only"
        if case.wind and case.wind.velocity[1] != 0:
            return "it solves motions in the plane (x, z) only"
        arms, apart = at_start(rope)
        if np.any(np.linalg.norm(arms, axis=1) < np.array(rope.link_lengths) * (1 - SHORT)):
            return "a link is slack at the start"
        speed = np.abs(apart).max(initial=0.0)
        if np.any(np.abs(np.sum(arms * apart, axis=1)) > SHORT * np.array(rope.link_lengths) * speed):
            return "velocities at the start change the length of a link"
        return None

    def solve(
        self,
        case: RopeCase,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> RopeMotion:
        """Follow the motion with two tolerances.

        Raises
        ------
        SolveFailure
            If a link lets go; the states before come with it.
        InputError
            If an earlier solution is given, or the case is declined.
        """
        if start is not None:
            raise InputError(f"{self.name} starts from no earlier solution")
        if reason := self.declines(case):
            raise InputError(f"{case.name}: {reason}")
        assert case.rope is not None
        chosen = settings if isinstance(settings, PendulumSettings) else PendulumSettings.model_validate(settings or {})
        began, history, found = time.perf_counter(), [], []
        pendulum, state = pendulum_of(case, case.rope), state_of(case.rope)
        for number, tolerance in enumerate((COARSER * chosen.tolerance, chosen.tolerance)):
            rows, asked = integrated(pendulum, state, case.states, tolerance)
            motion = RopeMotion(case, kept(case, pendulum, rows))
            found.append({quantity.name: quantity.measure(motion) for quantity in case.quantities})
            history.append(
                Step(number, time.perf_counter() - began, 0.0, len(state), quantities=found[-1], iterations=asked)
            )
            (progress or (lambda _: None))(Progress(number, 2, f"tolerance {tolerance:g}"))
        coarse, fine = found
        uncertainty = {name: abs(fine[name] - coarse[name]) + ROUNDING * abs(fine[name]) for name in fine}
        return RopeMotion(case, motion.kept, tuple(history), uncertainty, {"tolerance": chosen.tolerance})

    def load(self, path: Path) -> RopeMotion:
        """Read what `RopeMotion.save` wrote; InputError in one sentence if it is none."""
        return RopeMotion.load(path)


def rope_offsets(rope: Rope) -> tuple[float, ...]:
    """Return what at the start is off the plane (x, z)."""
    return (*rope.places[:, 1], *(velocity[1] for velocity in rope.velocities))


def at_start(rope: Rope) -> tuple[Array, Array]:
    """Return links and relative velocities at the start, (n, 2), in the plane (x, z)."""
    place, velocity, _ = moved(rope.root, 0.0)
    velocities = np.array(rope.velocities) if rope.velocities else np.zeros((len(rope.masses), 3))
    arms = np.diff(np.vstack([place, rope.places]), axis=0)
    return arms[:, ::2], np.diff(np.vstack([velocity, velocities]), axis=0)[:, ::2]


def state_of(rope: Rope) -> Array:
    """Return angles and their rates at the start, (2 n,)."""
    arms, apart = at_start(rope)
    rates = (arms[:, 0] * apart[:, 1] - arms[:, 1] * apart[:, 0]) / np.sum(arms**2, axis=1)
    return np.concatenate([np.arctan2(arms[:, 0], -arms[:, 1]), rates])


def pendulum_of(case: RopeCase, rope: Rope) -> Pendulum:
    """Return the equations of a case."""

    def root(at: float) -> tuple[Array, Array, Array]:
        place, velocity, acceleration = moved(rope.root, at)
        return place[::2], velocity[::2], acceleration[::2]

    wind = np.array(case.wind.velocity)[::2] if case.wind else np.zeros(2)
    drag = case.wind.drag if case.wind else 0.0
    return Pendulum(np.array(rope.link_lengths), case.masses, case.gravity, drag, wind, root)


def kept(case: RopeCase, pendulum: Pendulum, rows: Array) -> tuple[RopeState, ...]:
    """Return the states; SolveFailure, with those before, where a link would have to push."""
    states: list[RopeState] = []
    weight = float(case.masses.sum()) * case.gravity
    for at, row in zip(case.states, rows, strict=True):
        angles, rates = np.split(row, 2)
        tensions = pendulum.tensions(at, angles, rates)
        if tensions.min() < -SLACK * max(weight, float(tensions.max())):
            raise SolveFailure(f"a link lets go before t = {at:g}", RopeMotion(case, tuple(states)))
        nodes, velocities = (np.insert(each, 1, 0.0, axis=1) for each in pendulum.nodes(at, angles, rates))
        states.append(RopeState(nodes, velocities, np.maximum(tensions, 0.0)))
    return tuple(states)
