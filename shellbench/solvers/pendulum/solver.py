"""The solver `pendulum-ode`: a chain by the angles of its links, Lagrange's equations and DOP853.

It shares no mechanics with `rope-exact`. Its links can't be slack: a link that would push ends the solve.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problem import Capabilities, ProgressCallback, Settings
from shellbench.problems.moving import moved
from shellbench.problems.rope.case import Rope, RopeCase
from shellbench.problems.rope.planar import pulling, start_angles, why_not_planar
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.problems.rope.solving import RopeSolver, Watch, refined
from shellbench.solvers.pendulum.motion import Pendulum, integrated

Array = NDArray[np.float64]

COARSER = 100.0  # times the tolerance: the difference of the two solves is the uncertainty


class PendulumSettings(Settings):
    """Settings of `PendulumSolver`."""

    tolerance: float = Field(1e-12, ge=1e-13, le=1e-3, description="relative and absolute, of a step of DOP853")


class PendulumSolver(RopeSolver):
    """Lagrange's equations of a planar chain."""

    name: ClassVar[str] = "pendulum-ode"
    capabilities: ClassVar[Capabilities] = Capabilities(("rigid-links",), "planar chains by their angles, DOP853")
    settings_type: ClassVar[type[Settings]] = PendulumSettings

    def declines(self, case: Any) -> str | None:
        """Return the reason that it declines a problem, as one clause, or None if it takes it."""
        return why_not_planar(case)

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> RopeMotion:
        """Follow the motion with two tolerances."""
        assert case.rope is not None
        pendulum, state = pendulum_of(case, case.rope), np.concatenate(start_angles(case))

        def follow(tolerance: float, watch: Watch) -> list[RopeState]:
            times = np.union1d(case.states, np.arange(0.0, case.states[-1], watch.every))
            rows = integrated(pendulum, state, tuple(map(float, times)), tolerance)
            for at, row in zip(times, rows, strict=True):
                watch.keep(float(at), in_space(pendulum, float(at), row)[0])
            return kept(case, pendulum, rows[np.isin(times, case.states)])

        levels = {f"tolerance {t:g}": t for t in (COARSER * settings.tolerance, settings.tolerance)}
        return refined(case, levels, follow, {"tolerance": settings.tolerance}, progress)


def pendulum_of(case: RopeCase, rope: Rope) -> Pendulum:
    """Return the equations of a case."""

    def root(at: float) -> tuple[Array, Array, Array]:
        place, velocity, acceleration = moved(rope.root, at)
        return place[::2], velocity[::2], acceleration[::2]

    wind = np.array(case.wind.velocity)[::2] if case.wind else np.zeros(2)
    drag = case.wind.drag if case.wind else 0.0
    return Pendulum(np.array(rope.link_lengths), case.masses, case.gravity, drag, wind, root, rope.damping)


def in_space(pendulum: Pendulum, at: float, row: Array) -> tuple[Array, Array]:
    """Return places and velocities of all nodes, (n + 1, 3)."""
    nodes, velocities = (np.insert(each, 1, 0.0, axis=1) for each in pendulum.nodes(at, *np.split(row, 2)))
    return nodes, velocities


def kept(case: RopeCase, pendulum: Pendulum, rows: Array) -> list[RopeState]:
    """Return the states; SolveFailure, with the earlier states, if a link would have to push."""
    states: list[RopeState] = []
    for at, row in zip(case.states, rows, strict=True):
        tensions = pulling(case, at, pendulum.tensions(at, *np.split(row, 2)), states)
        states.append(RopeState(*in_space(pendulum, at, row), tensions))
    return states
