"""Motion by backward Euler, as cloth simulators take it (Baraff & Witkin 1998; ARCSim).

Each step minimises W(u) - f.u + m/(2 dt^2) |u - u_n - dt v_n|^2 with lumped masses; then v = (u - u_n)/dt. It is of
first order, and takes energy out of what oscillates within a few steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, SolveFailure
from shellbench.solvers.cst.problem import TriangleProblem, minimise

Array = NDArray[np.float64]

MOST_INSTANTS = 100_000  # steps in time: their frames are kept
MOST_STEPS = 60  # Newton steps in one step in time


@dataclass(frozen=True)
class Frame:
    """The state at one time.

    Attributes
    ----------
    at
        s.
    displacement
        (v, 3).
    energy
        Kinetic and strain energy less the work done by loads and supports, J.
    iterations
        Newton steps.
    """

    at: float
    displacement: Array
    energy: float
    iterations: int


def step_count(until: float, time_step: float) -> int:
    """Return the number of equal steps, none of them longer than `time_step`; InputError if they are too many."""
    steps = until / time_step * (1 - 1e-12)
    if not steps <= MOST_INSTANTS:
        raise InputError(f"field 'time_step': {time_step:g} s makes more than {MOST_INSTANTS} steps in {until:g} s")
    return max(1, math.ceil(steps))


def march(problem: TriangleProblem, until: float, steps: int, tolerance: float, tell: Callable[[Frame], None]) -> None:
    """Follow the motion from rest by equal steps in time.

    Parameters
    ----------
    problem
        Case and mesh.
    until
        Final time, s.
    steps
        Number of steps.
    tolerance
        Newton's last correction, relative to the shell's size.
    tell
        Is given each frame as it is found.

    Raises
    ------
    SolveFailure
        If Newton's method finds no minimum.
    """
    dt, mass = until / steps, problem.loading.mass
    size = float(np.ptp(problem.elastic.rest, axis=0).max())
    u = np.zeros_like(problem.elastic.rest)
    v, held = np.zeros_like(u), problem.supports.held
    work, inertia = 0.0, mass / dt**2
    steady = problem.loading.forces(0.0) if problem.case.steady else None
    for number in range(1, steps + 1):
        t = until * number / steps
        force = problem.loading.forces(t) if steady is None else steady
        target = u + dt * v
        start = problem.supports.prescribe(target, t)
        try:
            found = minimise(problem, start, force, inertia, target, tolerance * size, MOST_STEPS)
        except SolveFailure as failure:
            raise SolveFailure(f"{failure} at {t:.4g} s") from None
        moved = found.displacement - u
        reaction = problem.internal(found.displacement) - force + inertia[:, None] * (found.displacement - target)
        work += float(np.sum(force * moved) + np.sum((reaction * moved)[held]))
        u, v = found.displacement, moved / dt
        energy = problem.strain_energy(u) + float(np.sum(mass[:, None] * v**2)) / 2 - work
        tell(Frame(t, u, energy, found.iterations))
