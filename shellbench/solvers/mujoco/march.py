"""Steps in time, and the frames that are kept of them.

MuJoCo's semi-implicit Euler rule is v(n+1) = v(n) + h a(x(n)), x(n+1) = x(n) + h v(n+1), of first order if both v and x
begin at rest: a free fall then runs ahead by g h t/2. The same rule is the leapfrog of Verlet (1967), of second order,
if its velocities are taken for those half a step earlier than its positions. A staggered motion begins with the
velocity -h a(0)/2 and reads velocities so: at a frame they are the mean of the engine's before and after.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from shellbench.errors import InputError
from shellbench.solvers.mujoco.cloth import Cloth
from shellbench.solvers.mujoco.elasticity import Elasticity
from shellbench.solvers.mujoco.loading import Loading
from shellbench.solvers.mujoco.solver import Integrator

Array = NDArray[np.float64]

SHARE = 0.25  # of 2/omega, the longest step at which leapfrog is stable at rest; stretched cloth is stiffer
MOST_STEPS = 10_000_000
NUDGE = 1e-6  # of a cell's diagonal, by which forces are differentiated
ENOUGH = 1e-2  # relative accuracy of the square of the highest frequency
FEW = 12  # unknowns whose matrix is written out instead
ROUNDING = 1e-9  # of a step or a frame


@dataclass(frozen=True)
class Pace:
    """How a motion is cut into equal frames, and frames into equal steps."""

    until: float
    frames: int
    steps: int

    @classmethod
    def from_rates(cls, until: float, frame_rate: float, time_step: float) -> Pace:
        """Return the pace whose frames and steps are as long as asked for, or a little shorter.

        Raises
        ------
        InputError
            If that makes too many steps.
        """
        if not until / time_step <= MOST_STEPS:
            raise InputError(f"field 'time_step': {time_step:g} s makes more than {MOST_STEPS} steps in {until:g} s")
        frames = max(1, math.ceil(until * frame_rate - ROUNDING))
        return cls(until, frames, max(1, math.ceil(until / frames / time_step - ROUNDING)))

    @property
    def time_step(self) -> float:
        """Length of a step, s."""
        return self.until / (self.frames * self.steps)

    def time(self, step: int) -> float:
        """Return the time after a number of steps, s."""
        return self.until * step / (self.frames * self.steps)


@dataclass(frozen=True)
class Frame:
    """The state at one time, s: displacements and velocities (v, 3), and the work that loads have done, J."""

    at: float
    displacement: Array
    velocity: Array
    work: float


def usual_step(elasticity: Elasticity, loading: Loading, damping: float = 0.0) -> float:
    """Return a quarter of the longest step, s, at which the leapfrog rule is stable around rest.

    That is 2/w (sqrt(1 + z^2) - z), with z = beta w/2 the damping ratio at the highest frequency w and beta Rayleigh's
    `damping`, s (Belytschko, Liu & Moran 2000, section 6.2).
    """
    highest = highest_frequency(elasticity, loading)
    ratio = damping * highest / 2
    return SHARE * 2 / highest / (math.sqrt(1 + ratio**2) + ratio)


def highest_frequency(elasticity: Elasticity, loading: Loading) -> float:
    """Return the highest natural frequency at rest, rad/s, by Lanczos' method.

    Raises
    ------
    InputError
        If supports hold all vertices.
    """
    grid = elasticity.grid
    free = ~grid.held
    if not free.any():
        raise InputError("field 'cells': supports hold all vertices; choose more cells")
    root = np.sqrt(np.broadcast_to(loading.masses[:, None], free.shape)[free])
    size = NUDGE * math.sqrt(2 * float(grid.areas.max()))

    def stiffness(scaled: Array) -> Array:
        direction = np.zeros(free.shape)
        direction[free] = scaled.ravel() / root
        part = size / max(float(np.abs(direction).max()), np.finfo(float).tiny)
        change = elasticity.forces(grid.rest + part * direction) - elasticity.forces(grid.rest - part * direction)
        return np.asarray((change / (2 * part) + loading.springs * direction)[free] / root)

    if len(root) <= FEW:
        return math.sqrt(float(np.linalg.eigvals(np.array([stiffness(row) for row in np.eye(len(root))])).real.max()))
    operator = LinearOperator((len(root), len(root)), matvec=stiffness, dtype=float)
    start = np.random.default_rng(0).standard_normal(len(root))
    (square,) = eigsh(operator, k=1, which="LA", tol=ENOUGH, v0=start, return_eigenvectors=False)
    return math.sqrt(float(square))


def march(cloth: Cloth, loading: Loading, integrator: Integrator, staggered: bool, pace: Pace) -> Iterator[Frame]:
    """Follow the motion from rest and yield its frames, rest first; it ends early where the engine gives up."""
    h, case = pace.time_step, loading.case
    force, work, done = loading.forces(0.0), 0.0, 0
    cloth.push(force)
    if staggered:
        cloth.set_velocity(-h / 2 * force / cloth.masses[:, None])

    def advance(count: int) -> float:
        """Take steps from the step that is done; return the work of loads that change, J."""
        nonlocal force
        if case.steady:
            cloth.step(count)
            return 0.0
        gained = 0.0
        for step in range(done, done + count):
            if integrator == "RK4":  # it holds applied forces through a step: take their mean
                cloth.push(loading.forces(pace.time(step) + h / 2))
            before = cloth.displacement()
            cloth.step()
            after = loading.forces(pace.time(step + 1))
            gained += float(np.sum((force + after) / 2 * (cloth.displacement() - before)))
            force = after
            cloth.push(force)
        return gained

    with _quiet():
        for number in range(pace.frames + 1):
            displacement, velocity = cloth.displacement(), cloth.velocity()
            at = float(np.sum(force * displacement)) if case.steady else work
            if staggered:
                work += advance(1)
                done += 1
                velocity = (velocity + cloth.velocity()) / 2
            if not cloth.well:
                return
            yield Frame(pace.time(number * pace.steps), displacement, velocity, at)
            if number < pace.frames:
                ahead = (number + 1) * pace.steps - done
                work += advance(ahead)
                done += ahead


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the engine from writing its warnings to a file; they are counted in its data all the same."""
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)
