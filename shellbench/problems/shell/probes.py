"""Probes: material points that are the same in every run of a case and lie on no regular grid.

Samples on a grid flatter a solver whose nodes or training points lie on it too. The probes are the quasi-random
sequence R2 (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018): the multiples, modulo one, of
1/p and 1/p^2, where p solves p^3 = p + 1 as the golden ratio solves p^2 = p + 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.series import frames
from shellbench.problems.shell.shell import Shell
from shellbench.problems.shell.surface import Domain

Array = NDArray[np.float64]

PROBES = 256
PLASTIC = 1.324717957244746  # the real root of p^3 = p + 1
SHIFT = 0.5  # of the whole sequence, as its author has it


def probes_of(domain: Domain, count: int = PROBES) -> Array:
    """Return the first points (count, 2) of the sequence in a domain."""
    number = np.arange(1, count + 1)[:, None]
    shares = (SHIFT + number / PLASTIC ** np.array([1, 2])) % 1.0
    return np.asarray(np.asarray(domain.lower) + shares * np.asarray(domain.size))


def state_at(solution: DisplacementField, points: Array, mark: float | None) -> Array | None:
    """Return the displacement (..., 3) at points (..., 2) of a state; None if it was not reached or is not finite."""
    try:
        field = solution.displacement(points, at=mark)
    except InputError:
        return None
    return field if np.all(np.isfinite(field)) else None


def states_at(solution: DisplacementField, case: Shell, points: Array) -> dict[float, Array]:
    """Return the displacements (..., 3) at points (..., 2) by mark: of all frames, or the only state."""
    if case.linear:
        last = state_at(solution, points, None)
        return {} if last is None else {case.states[-1]: last}
    found = {mark: state_at(solution, points, mark) for mark in frames(solution, case)}
    return {mark: field for mark, field in found.items() if field is not None}


def probe_fields(solution: DisplacementField, case: Shell) -> dict[str, NDArray[Any]]:
    """Return the probes and their displacements as a record keeps them; see `shellbench.bench.record.Record`."""
    points = probes_of(case.surface.domain)
    states = states_at(solution, case, points)
    stacked = np.array(list(states.values()), dtype=float).reshape(-1, *points.shape[:-1], 3)
    return {"probes": points, "probe_marks": np.array(list(states), dtype=float), "probe_displacements": stacked}
