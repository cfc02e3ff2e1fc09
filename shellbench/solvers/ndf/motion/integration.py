"""Newton's law of a field, integrated in time by Runge-Kutta steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.integrate import DOP853
from torch import Tensor

from shellbench.solvers.ndf.field.jets import COMPONENTS, Array
from shellbench.solvers.ndf.motion.motion_problem import Motion

RTOL, ATOL = 1e-6, 1e-8  # of y and y', in m sqrt(kg) and m/s sqrt(kg): errors then stay far below those of the field
MOST_TIME_STEPS = 6_000
STABLE = 5.5  # largest step times a root's magnitude: the method's amplification exceeds 1 from 5.9 on
FIRST = (
    1e-4  # of the whole time: the first step, before the error is known; a longer one is rejected, a shorter one grows
)


class StuckError(ArithmeticError):
    """The integration can't continue; the message is a clause with the reason."""


@dataclass(frozen=True)
class Stepping:
    """Settings of the steps in time: tolerances of the local error, and the largest number of steps."""

    rtol: float = RTOL
    atol: float = ATOL
    most_steps: int = MOST_TIME_STEPS


@dataclass
class Track:
    """Record of the integration so far: at each accepted step time, y, y', y'', work since rest, and the motion."""

    times: list[float] = field(default_factory=list)
    states: list[tuple[tuple[Array, Array, Array], float]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    evaluations: list[int] = field(default_factory=list)
    motions: list[Motion] = field(default_factory=list)


Finer = Callable[[Motion, Array, float], Motion | None]  # equations of motion to go on with from unknowns y and a time


def integrate(
    motion: Motion, marks: Sequence[float], stepping: Stepping, track: Track, finer: Finer | None = None
) -> Iterator[float]:
    """Integrate from rest, landing on every mark; yield the time of each accepted step, recorded in `track`.

    After each step, `finer` may return equations of motion with more features, of which the first are the present ones.

    Raises
    ------
    StuckError
        If a step can't be cut further, or too many were taken.
    """
    # 1. Bound the step by stability, and by the distance to the next mark.
    # 2. Step by DOP853 until the mark, and record each accepted step.
    # 3. Change to equations of motion with more features if `finer` returns them.
    # z = (y, y', work). The work of loads and supports is integrated too, for the balance of energy.
    evaluations = 0

    def law(t: float, z: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        count = motion.basis.size
        state = motion.features.placement.tensor(z[: 2 * count])
        acceleration, power = motion.accelerate(state[:count], state[count:], t)
        return np.concatenate([z[count : 2 * count], acceleration.cpu().numpy(), [power]])

    def record(t: float, z: Array, slope: Array) -> None:
        count = motion.basis.size
        track.times.append(t)
        known = z[:count].copy(), z[count : 2 * count].copy(), slope[count : 2 * count].copy()
        track.states.append((known, float(z[-1])))
        track.seconds.append(time.perf_counter())
        track.evaluations.append(evaluations)
        track.motions.append(motion)

    t, z, step = 0.0, np.zeros(2 * motion.basis.size + 1), FIRST * marks[-1]
    # An explicit method is unstable beyond this. Its error control would find the limit by rejected steps.
    longest = STABLE / motion.fastest_rate()
    if motion.dynamics.stiffness_damping and marks[-1] > stepping.most_steps * longest:
        raise StuckError(f"damping by stiffness makes its explicit steps too short: {longest:.2g} s")
    record(t, z, law(t, z))
    left = list(marks)
    while left:
        mark = left[0]
        first = min(step, longest, mark - t)
        # Integration ends at marks; these are no values of an interpolant: a load that jumps there is not smoothed.
        method = DOP853(law, t, z, mark, rtol=stepping.rtol, atol=stepping.atol, first_step=first, max_step=longest)
        following: Motion | None = None
        while method.status == "running" and following is None:
            if len(track.times) > stepping.most_steps:
                raise StuckError(f"the motion needs more than {stepping.most_steps} time steps")
            with np.errstate(invalid="ignore", over="ignore"):
                method.step()
            if method.status == "failed":
                raise StuckError("the time step can't be cut any further")
            t, z = float(method.t), method.y
            record(t, z, method.f)
            # Else the last step was cut at the mark, and is no guide for the next one's length.
            if method.status == "running":
                step = float(method.h_abs)
            yield t
            following = finer(motion, z[: motion.basis.size], t) if finer and t < marks[-1] else None
        if method.status == "finished":
            t = left.pop(0)
        if following is not None:
            z = extended_state(motion, following, z, t)
            motion = following
            longest = STABLE / motion.fastest_rate()


def extended_state(motion: Motion, following: Motion, z: Array, t: float) -> Array:
    """Return unknowns, rates and work of the same motion with more features, which begin with these."""
    count, placement = motion.basis.size, motion.features.placement
    parts = [
        following.unknowns(padded(motion.weights(placement.tensor(z[k * count : (k + 1) * count]), t, k), following))
        for k in (0, 1)
    ]
    return np.concatenate([*(part.cpu().numpy() for part in parts), z[-1:]])


def padded(w: Tensor, motion: Motion) -> Tensor:
    """Return output weights (3 M,) extended by zeros to those of a motion whose features begin with theirs."""
    own = w.view(COMPONENTS, -1)
    return torch.nn.functional.pad(own, (0, motion.features.count - own.shape[1])).reshape(-1)
