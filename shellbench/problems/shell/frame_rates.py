"""A study of frame rates: one motion, seen through frames from few to many."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.account import FrameRateStep
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.probes import probes_of, state_at
from shellbench.problems.shell.series import reached
from shellbench.problems.shell.shell import Shell

Array = NDArray[np.float64]

RATES = (15, 30, 60, 120, 240)  # frames per second: those of films and screens, halved and doubled
MOST = 961  # frames: four seconds at the finest rate, so that a long motion costs no more
POINTS = 64  # of the probes: the first ones, which are spread as evenly as all of them
GOLDEN = (5**0.5 - 1) / 2  # its multiples, modulo one, are evenly spread and lie on no frame
SAME = 6  # decimals of a number of frames beyond which two solvers' last instants differ by rounding only
FIXED = 5  # instants that are asked for at every rate


def frame_rate_study(solution: DisplacementField, case: Shell) -> tuple[FrameRateStep, ...]:
    """Look at one motion through frames from coarse to fine, as far as it goes; nothing for a case at rest.

    Frames are asked for in the order of time, with the fixed instants among them; these are first asked for by
    themselves, the last one first. A motion that does not answer everywhere, or not by finite numbers, is not studied.
    """
    if case.dynamics is None or (end := reached(solution, case)) <= 0:
        return ()
    points = probes_of(case.surface.domain, POINTS)
    fixed = end * (GOLDEN * np.arange(1, FIXED + 1) % 1.0)
    alone = [state_at(solution, points, float(t)) for t in np.sort(fixed)[::-1]][::-1]
    counts = sorted({max(2, round(round(rate * end, SAME)) + 1) for rate in RATES})
    counts = [count for count in counts if count <= MOST]
    if not counts:
        return ()
    samples: dict[int, Array] = {}
    asked: dict[int, float] = {}
    for count in (*counts, 2 * max(counts) - 1):  # the last of them is what the others are held against
        times = np.linspace(0.0, end, count)
        every = np.concatenate([times, fixed])
        order = np.argsort(every, kind="stable")
        states = [state_at(solution, points, float(every[k])) for k in order]
        if any(state is None for state in (*states, *alone)):
            return ()
        field = np.array(states)
        is_fixed = order >= count
        samples[count] = field[~is_fixed]
        asked[count] = float(np.max(_lengths(field[is_fixed] - np.array(alone))))
    return tuple(_step(count, end, samples[count], samples[2 * max(counts) - 1], asked[count]) for count in counts)


def _step(count: int, end: float, frames: Array, motion: Array, asked: float) -> FrameRateStep:
    gaps = _lengths(joined(frames, np.linspace(0.0, count - 1.0, len(motion))) - motion)
    return FrameRateStep(
        frames=count,
        frames_per_second=(count - 1) / end,
        probe_difference=asked,
        interpolation_difference=float(np.max(gaps)),
        interpolation_rms=float(np.sqrt(np.mean(gaps**2))),
        largest_displacement=float(np.max(_lengths(frames))),
    )


def joined(frames: Array, places: Array) -> Array:
    """Join frames (n, ...) by straight lines; return them at places (k,), numbers of frames from 0 to n - 1."""
    before = np.clip(np.floor(places).astype(int), 0, len(frames) - 2)
    share = (places - before).reshape(-1, *(1,) * (frames.ndim - 1))
    return np.asarray((1 - share) * frames[before] + share * frames[before + 1])


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
