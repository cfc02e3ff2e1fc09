"""Samples of a solution that a record keeps: the field on a grid and at probes, and a study of resolutions."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.account import ResolutionStep, StateEnergies
from shellbench.errors import InputError
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.places import Point
from shellbench.problems.shell.probes import probe_fields, state_at, states_at
from shellbench.problems.shell.shell import Shell
from shellbench.problems.shell.surface import Domain

Array = NDArray[np.float64]

PICTURE = 61  # points a side of the grid that pictures are drawn from
PICTURE_TYPE = np.float32  # of what nothing but pictures is made of: states of a path beside the last one, densities
DENSITIES = ("membrane_energy_density", "bending_energy_density")
RESOLUTIONS = (10, 25, 50, 100, 200)  # points a side
PROBES = ((0.5, 0.5), (0.25, 0.25), (0.37, 0.81), (0.7, 0.2), (0.93, 0.61))
"""Where the same material point is asked for in every grid, in fractions of the sides; off all the grids but one."""


def kept_fields(solution: DisplacementField, case: Shell) -> dict[str, NDArray[Any]] | None:
    """Return points, positions and displacements on a regular grid; see `shellbench.bench.record.Record.fields_file`.

    None if there is no finite field to keep: a path that failed at once has no state. What else a solution can't tell,
    such as energy densities, is left out.
    """
    xi = case.surface.domain.grid(PICTURE, PICTURE)
    displacement = state_at(solution, xi, None)
    if displacement is None:
        return None
    fields: dict[str, NDArray[Any]] = {"xi": xi, "position": case.surface.position(xi), "displacement": displacement}
    if not case.linear:
        states = states_at(solution, case, xi)
        stacked = np.array(list(states.values()), dtype=PICTURE_TYPE).reshape(-1, *displacement.shape)
        fields |= {"marks": np.array(list(states)), "displacements": stacked}
    return fields | _told(lambda: energy_densities(solution, xi)) | _told(lambda: probe_fields(solution, case))


def energy_densities(solution: DisplacementField, xi: Array) -> dict[str, NDArray[Any]]:
    """Return the finite energy densities (n, n) of the last state by name, in single precision, J/m^2."""
    if not hasattr(solution, "evaluate"):  # as in plug-ins that know displacements alone
        return {}
    found = {name: np.asarray(solution.evaluate(name, xi)).astype(PICTURE_TYPE) for name in DENSITIES}
    return {name: density for name, density in found.items() if np.all(np.isfinite(density))}


def _told(ask: Callable[[], dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return what a solution tells; nothing if it can't."""
    try:
        return ask()
    except (InputError, NotImplementedError):
        return {}
    except OSError:  # such as a full disk, which is no fault of the solution
        raise
    except Exception:
        traceback.print_exc()
        return {}


def energies_of_states(solution: DisplacementField, case: Shell) -> tuple[StateEnergies, ...]:
    """Return the energies of each kept state of a non-linear case; states that were not reached are left out."""
    found: list[StateEnergies] = []
    for mark in () if case.linear else case.states:
        try:
            membrane, bending = solution.energies(mark)
        except InputError:
            continue
        if np.isfinite(membrane) and np.isfinite(bending):
            found.append(StateEnergies(at=mark, membrane=float(membrane), bending=float(bending)))
    return tuple(found)


def resolution_study(solution: DisplacementField, case: Shell) -> tuple[ResolutionStep, ...]:
    """Look at one solution through grids from coarse to fine.

    Raises
    ------
    ValueError
        If the field is not finite at all of their points and the probes.
    """
    domain = case.surface.domain
    probes = np.asarray(domain.lower) + np.asarray(PROBES) * np.asarray(domain.size)
    named = [place.xi for place in case.places.values() if isinstance(place, Point)]
    probes = np.concatenate([probes, np.array(named).reshape(-1, 2)])
    alone = np.stack([solution.displacement(probe[None])[0] for probe in probes])
    if not np.all(np.isfinite(alone)):
        raise ValueError(f"its displacement is not finite at the point {_first_lost(probes, alone)}")
    samples: dict[int, Array] = {}
    asked: dict[int, float] = {}
    for n in RESOLUTIONS:
        points = np.concatenate([domain.grid(n, n).reshape(-1, 2), probes])
        displacement = solution.displacement(points)
        if not np.all(np.isfinite(displacement)):
            raise ValueError(f"its displacement is not finite at the point {_first_lost(points, displacement)}")
        samples[n] = displacement[: n * n].reshape(n, n, 3)
        asked[n] = _largest(displacement[n * n :] - alone)
    finest = max(RESOLUTIONS)
    steps: list[ResolutionStep] = []
    for n in RESOLUTIONS:
        gaps = bilinear(samples[n], domain, domain.grid(finest, finest)) - samples[finest]
        steps.append(
            ResolutionStep(
                points=n,
                probe_difference=asked[n],
                interpolation_difference=_largest(gaps),
                interpolation_rms=float(np.sqrt(np.mean(np.sum(gaps**2, axis=-1)))),
                largest_displacement=_largest(samples[n]),
            )
        )
    return tuple(steps)


def _first_lost(points: Array, displacement: Array) -> str:
    """Return the coordinates of the first point (m, 2) whose displacement (m, 3) is not finite."""
    lost = points[np.argmin(np.all(np.isfinite(displacement), axis=-1))]
    return f"({lost[0]:g}, {lost[1]:g})"


def bilinear(samples: Array, domain: Domain, points: Array) -> Array:
    """Interpolate samples (n, n, 3) on the regular grid of a domain at points (..., 2)."""
    n = samples.shape[0]
    scaled = (points - np.asarray(domain.lower)) / np.asarray(domain.size) * (n - 1)
    cell = np.clip(np.floor(scaled).astype(int), 0, n - 2)
    s, t = np.moveaxis(scaled - cell, -1, 0)[..., None]
    i, j = np.moveaxis(cell, -1, 0)
    below = (1 - s) * samples[i, j] + s * samples[i + 1, j]
    above = (1 - s) * samples[i, j + 1] + s * samples[i + 1, j + 1]
    return np.asarray((1 - t) * below + t * above)


def _largest(vectors: Array) -> float:
    return float(np.max(np.linalg.norm(vectors, axis=-1)))
