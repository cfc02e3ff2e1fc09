"""Base of the solvers of ropes: the cases that they decline, their steps in time, and the uncertainty from levels.

This module contains no mechanics. A solver implements `answer`; one that follows motions has `refined` call it level by
level.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Solution, Step
from shellbench.problems.moving import moved
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.quantities import energies
from shellbench.problems.rope.solution import RopeMotion, RopeState
from shellbench.problems.solving import FreshSolver

Array = NDArray[np.float64]

HALVINGS = (4, 2, 1)  # steps in time of the levels, so many times as long as the finest
LEVEL_ROUNDING = 1e-14  # relative: rounding, which no level shows
WHOLE = 1e-9  # of a step: by how much a time may miss a whole number of them
FRAMES, FRAME = 120, 1 / 60  # most frames that are kept for pictures, and the shortest time between two, s
DRAWN = 200  # most nodes of a frame


class RopeSolver(FreshSolver):
    """A solver of chains or loose masses.

    A subclass gives `declines` and `answer`. Its module is light: it imports the modules that solve only when it is
    called.
    """

    def load(self, path: Path) -> Solution:
        """Read a file of `RopeMotion.save`; InputError in one sentence if it is no such file."""
        return RopeMotion.load(path)


class Watch:
    """Observer of the steps of one level: it counts them, reports progress, and keeps states and frames for pictures.

    Frames are at the same times whatever the steps: they are interpolated linearly between two steps.

    Parameters
    ----------
    words
        Name of the level.
    """

    def __init__(self, case: RopeCase, words: str, progress: ProgressCallback) -> None:
        self.words, self.progress, self.count = words, progress, 0
        self.every = max(FRAME, case.states[-1] / FRAMES)
        self.thin = -(-(len(case.masses) + case.chains) // DRAWN)
        self.frames: list[Array] = []
        self.states: list[RopeState] = []
        self.before: tuple[float, Array] | None = None

    @property
    def times(self) -> Array:
        """Times of the frames that are kept, s."""
        return np.asarray(self.every * np.arange(len(self.frames)))

    def due(self, time: float, step: float) -> bool:
        """Return True if a frame is due at this time, s, or before the end of the next step."""
        return time + step >= self.every * (len(self.frames) - WHOLE)

    def keep(self, time: float, nodes: Array) -> None:
        """Take nodes (n, 3), m, at a time, s, and keep the frames up to it."""
        nodes = np.array(nodes[:: self.thin])
        start, first = self.before or (time, nodes)
        while time >= (wanted := self.every * len(self.frames)) * (1 - WHOLE):
            share = min((wanted - start) / (time - start), 1.0) if time > start else 1.0
            self.frames.append(first + max(share, 0.0) * (nodes - first))
        self.before = time, nodes

    def stepped(self) -> None:
        """Count a step."""
        self.count += 1
        if self.count % 100 == 0:
            self.progress(Progress(self.count, None, self.words))


Follow = Callable[[Any, Watch], Sequence[RopeState]]
"""Follows a motion at a level; returns the states at the case's times. A SolveFailure brings those before it."""


def refined(
    case: RopeCase,
    levels: Mapping[str, Any],
    follow: Follow,
    told: Mapping[str, Any],
    progress: ProgressCallback,
) -> RopeMotion:
    """Follow a motion level by level, the finest last, and state the differences of the levels as uncertainty.

    A coarser level that fails is left out.

    Parameters
    ----------
    levels
        Arguments of `follow` from coarse to fine, by name of the level.
    told
        Diagnostics.

    Raises
    ------
    SolveFailure
        If the finest level fails; its earlier states come with it.
    """
    began, found = time.perf_counter(), []
    history: list[Step] = []
    for number, (words, level) in enumerate(levels.items()):
        watch = Watch(case, words, progress)
        try:
            motion = RopeMotion(case, tuple(follow(level, watch)))
        except (SolveFailure, InputError) as failure:  # an obstacle's formula may have no value where a mass gets to
            if number < len(levels) - 1:
                continue
            before = getattr(failure, "partial", None) or watch.states
            partial = RopeMotion(case, tuple(before), tuple(history))
            raise SolveFailure(str(failure), partial) from None
        found.append({quantity.name: quantity.measure(motion) for quantity in case.quantities})
        last, seconds = motion.kept[-1], time.perf_counter() - began
        energy = sum(energies(case, last.nodes, last.velocities))
        history.append(
            Step(number, seconds, energy, motion.parameters, quantities=found[-1], iterations=watch.count or None)
        )
    uncertainty = {name: settled([values[name] for values in found]) for name in found[-1]} if found[1:] else {}
    watch.keep(case.states[-1], motion.kept[-1].nodes)
    return replace(
        motion,
        history=tuple(history),
        uncertainty=uncertainty,
        diagnostics=told,
        frame_times=watch.times,
        frames=np.array(watch.frames),
    )


def settled(values: Sequence[float]) -> float:
    """Return an estimate of the last value's error; each level halves the step, and errors fall as the step."""
    changes = np.abs(np.diff(values))
    return float(np.max(changes / 2.0 ** np.arange(len(changes))[::-1])) + LEVEL_ROUNDING * abs(values[-1])


def halved(steps_per_second: float) -> dict[str, float]:
    """Return the levels of a rate of steps: a quarter of it, half of it, and the rate, 1/s."""
    rates = [steps_per_second / longer for longer in HALVINGS]
    return {f"{rate:g} steps a second": rate for rate in rates}


def spans(case: RopeCase, rate: float) -> Iterator[tuple[float, int, float]]:
    """Yield each of the case's times, s, with the number of steps from the time before, and their length, s.

    Steps are 1 / rate long, or shorter, so that all steps between two times have one length.
    """
    before = 0.0
    for until in case.states:
        count = math.ceil((until - before) * rate - WHOLE)
        yield until, count, (until - before) / count if count else 1.0 / rate
        before = until


def start_of(case: RopeCase) -> tuple[Array, Array]:
    """Return places and velocities, m and m/s, of all nodes at the start; the root of each chain comes first."""
    if case.particles:
        places = case.particles.places
        return places, np.zeros_like(places) + case.particles.velocity
    assert case.rope is not None
    root, velocity, _ = moved(case.rope.root, 0.0)
    places = np.vstack([root, case.rope.places])
    given = np.array(case.rope.velocities) if case.rope.velocities else np.zeros((len(places) - 1, 3))
    velocities = np.vstack([velocity, given])
    around = case.rope.around
    return around(places).reshape(-1, 3), around(velocities).reshape(-1, 3)


def roots_of(case: RopeCase) -> Callable[[float], tuple[Array, Array, Array]]:
    """Return a function of the time, s: position, velocity and acceleration of the roots, (chains, 3) each."""
    assert case.rope is not None
    path, around = case.rope.root, case.rope.around
    if any(isinstance(formula, str) for formula in path):
        return lambda time: tuple(map(around, moved(path, time)))  # type: ignore[return-value]
    place, velocity, acceleration = map(around, moved(path, 0.0))
    return lambda _: (place, velocity, acceleration)
