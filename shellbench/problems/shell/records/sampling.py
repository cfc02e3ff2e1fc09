"""Samples of a solution that a record keeps: the field on a grid and at probes, and a study of resolutions.

Probes: material points that are the same in every run of a case and lie on no regular grid.

Samples on a grid favour a solver whose nodes or training points lie on it too. The probes are the quasi-random sequence
R2 (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018): the multiples, modulo one, of 1/p and
1/p^2, where p solves p^3 = p + 1 as the golden ratio solves p^2 = p + 1.

A study of precision: the error of a solution whose stored numbers are rounded to a shorter format.

A study of frame rates: one motion, seen through frames from few to many.
"""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problem import NumberFormat
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.question.surface import Domain
from shellbench.problems.shell.records.series import frames, mark_reached
from shellbench.protocol.history import FrameRateStep, PrecisionStep, ResolutionStep, StateEnergies, finite_or_none

Array = NDArray[np.float64]

PROBES = 256
PLASTIC = 1.324717957244746  # the real root of p^3 = p + 1
SHIFT = 0.5  # of the whole sequence, as chosen by its author


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
    """Return the probes and their displacements as a record keeps them; see `shellbench.bench.store.record.Record`."""
    points = probes_of(case.surface.domain)
    states = states_at(solution, case, points)
    stacked = np.array(list(states.values()), dtype=float).reshape(-1, *points.shape[:-1], 3)
    return {"probes": points, "probe_marks": np.array(list(states), dtype=float), "probe": stacked}


PICTURE = 61  # points a side of the grid that pictures are drawn from
PICTURE_TYPE = np.float32  # of what nothing but pictures is made of: states of a path beside the last one, densities
DENSITIES = ("membrane_energy_density", "bending_energy_density")
RESOLUTIONS = (10, 25, 50, 100, 200)  # points a side
INNER_POINTS = ((0.5, 0.5), (0.25, 0.25), (0.37, 0.81), (0.7, 0.2), (0.93, 0.61))
"""Where the same material point is asked for in every grid, in fractions of the sides; off all the grids but one."""


def kept_fields(solution: DisplacementField, case: Shell) -> dict[str, NDArray[Any]] | None:
    """Return points, positions and displacements on a regular grid, see `Record.fields_file`.

    None if there is no finite field to keep: a path that failed at once has no state. Fields that the solution does not
    provide, such as energy densities, are left out.
    """
    xi = _picture_grid(case)
    displacement = state_at(solution, xi, None)
    if displacement is None:
        return None
    fields: dict[str, NDArray[Any]] = {"xi": xi, "position": case.surface.position(xi), "displacement": displacement}
    if not case.linear:
        states = states_at(solution, case, xi)
        stacked = np.array(list(states.values()), dtype=PICTURE_TYPE).reshape(-1, *displacement.shape)
        fields |= {"marks": np.array(list(states)), "displacements": stacked}
    return fields | _arrays(lambda: energy_densities(solution, xi)) | _arrays(lambda: probe_fields(solution, case))


def _picture_grid(case: Shell) -> Array:
    """Return a regular grid of which lines are moved onto folds, so that drawings have sharp edges there."""
    xi = case.surface.domain.grid(PICTURE, PICTURE)
    for fold in case.surface.fold_lines:
        lines = np.moveaxis(xi, fold.axis, 0)
        lines[np.abs(lines[:, 0, fold.axis] - fold.at).argmin(), :, fold.axis] = fold.at
    return np.asarray(xi)


def energy_densities(solution: DisplacementField, xi: Array) -> dict[str, NDArray[Any]]:
    """Return the finite energy densities (n, n) of the last state by name, in single precision, J/m^2."""
    if not hasattr(solution, "evaluate"):  # as in plug-ins that provide displacements alone
        return {}
    found = {name: np.asarray(solution.evaluate(name, xi)).astype(PICTURE_TYPE) for name in DENSITIES}
    return {name: density for name, density in found.items() if np.all(np.isfinite(density))}


def _arrays(ask: Callable[[], dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return the arrays that a call on the solution gives; none if it fails."""
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
    """Compare one solution with its samples on grids from coarse to fine.

    Raises
    ------
    ValueError
        If the field is not finite at all of their points and the probes.
    """
    domain = case.surface.domain
    probes = np.asarray(domain.lower) + np.asarray(INNER_POINTS) * np.asarray(domain.size)
    named = [place.xi for place in case.places.values() if isinstance(place, Point)]
    probes = np.concatenate([probes, np.array(named).reshape(-1, 2)])
    alone = np.stack([solution.displacement(probe[None])[0] for probe in probes])
    if not np.all(np.isfinite(alone)):
        raise ValueError(f"its displacement is not finite at the point {_first_infinite(probes, alone)}")
    samples: dict[int, Array] = {}
    asked: dict[int, float] = {}
    for n in RESOLUTIONS:
        points = np.concatenate([domain.grid(n, n).reshape(-1, 2), probes])
        displacement = solution.displacement(points)
        if not np.all(np.isfinite(displacement)):
            raise ValueError(f"its displacement is not finite at the point {_first_infinite(points, displacement)}")
        samples[n] = displacement[: n * n].reshape(n, n, 3)
        asked[n] = _largest(displacement[n * n :] - alone)
    finest = max(RESOLUTIONS)
    steps: list[ResolutionStep] = []
    for n in RESOLUTIONS:
        gaps = bilinear(samples[n], finest) - samples[finest]
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


def _first_infinite(points: Array, displacement: Array) -> str:
    """Return the coordinates of the first point (m, 2) whose displacement (m, 3) is not finite."""
    lost = points[np.argmin(np.all(np.isfinite(displacement), axis=-1))]
    return f"({lost[0]:g}, {lost[1]:g})"


def bilinear(samples: Array, count: int) -> Array:
    """Interpolate samples (n, n, 3) on a regular grid at the points (count, count, 3) of another one."""
    places = np.linspace(0.0, len(samples) - 1.0, count)
    along = np.swapaxes(interpolate_frames(samples, places), 0, 1)  # one coordinate after the other
    return np.swapaxes(interpolate_frames(along, places), 0, 1)


def _largest(vectors: Array) -> float:
    return float(np.max(np.linalg.norm(vectors, axis=-1)))


FORMATS: tuple[NumberFormat, ...] = ("float64", "float32", "float16")
MARKS = 5  # states at which the fields are compared, the last one among them
UNREACHED = (InputError, ValueError)


def precision_study(solution: DisplacementField, case: Shell, values: Mapping[str, float]) -> tuple[PrecisionStep, ...]:
    """Compare a solution with itself in shorter formats; empty if it can't be rounded or has no state.

    `values` are the quantities of the solution as solved, by name: a format in which it stays the very same is not
    measured again.
    """
    rounded: Callable[[NumberFormat], tuple[DisplacementField, int] | None] | None = getattr(solution, "rounded", None)
    points = probes_of(case.surface.domain)
    exact = {
        mark: field for mark in marks_of(solution, case) if (field := state_at(solution, points, mark)) is not None
    }
    if rounded is None or not exact:
        return ()
    steps: list[PrecisionStep] = []
    for number_format in FORMATS:
        answer = rounded(number_format)
        if answer is None:  # from a plug-in that has only the protocol's stub
            return ()
        short, storage_bytes = answer
        found = [state_at(short, points, mark) for mark in exact]
        compared: dict[str, Any] = {}
        if all(field is not None for field in found):
            gaps = np.linalg.norm(np.array(found) - np.array(list(exact.values())), axis=-1)
            compared = {
                "largest_difference": float(np.max(gaps)),
                "rms_difference": float(np.sqrt(np.mean(gaps**2))),
                "quantities": quantities_of(short, case, values if short is solution else {}),
            }
        steps.append(PrecisionStep(format=number_format, storage_bytes=int(storage_bytes), **compared))
    return tuple(steps)


def marks_of(solution: DisplacementField, case: Shell) -> tuple[float | None, ...]:
    """Return the states to compare: the only one of a linear case (None), else some evenly spread states."""
    if case.linear:
        return (None,)
    every = frames(solution, case)
    chosen = np.linspace(len(every), 0, MARKS, endpoint=False).round().astype(int) - 1
    return tuple(every[k] for k in sorted({*chosen.tolist()}) if k >= 0)


def quantities_of(solution: DisplacementField, case: Shell, known: Mapping[str, float]) -> dict[str, float]:
    """Return the finite values of the quantities that a field alone defines; known values are not measured again."""
    found: dict[str, float] = {}
    for quantity in case.quantities:
        if quantity.of_field:
            with contextlib.suppress(*UNREACHED):
                value = known[quantity.name] if quantity.name in known else measure(solution, quantity)
                if finite_or_none(value) is not None:
                    found[quantity.name] = value
    return found


RATES = (15, 30, 60, 120, 240)  # frames per second: those of films and screens, halved and doubled
MOST_FRAMES = 961  # frames: four seconds at the finest rate, so that a long motion costs no more
POINTS = 64  # of the probes: the first ones, which are spread as evenly as all of them
GOLDEN = (5**0.5 - 1) / 2  # its multiples, modulo one, are evenly spread and coincide with no frame
SAME = 6  # decimals of a number of frames: later ones differ between solvers by rounding only
FIXED = 5  # instants that are asked for at every rate


def frame_rate_study(solution: DisplacementField, case: Shell) -> tuple[FrameRateStep, ...]:
    """Compare one motion with its frames at rates from coarse to fine, as far as it goes; empty for a case at rest.

    Frames are asked for in the order of time, with the fixed instants among them; these are first asked for by
    themselves, the last one first. A motion whose answers are missing or not finite somewhere is not studied.
    """
    if case.dynamics is None or (end := mark_reached(solution, case)) <= 0:
        return ()
    points = probes_of(case.surface.domain, POINTS)
    fixed = end * (GOLDEN * np.arange(1, FIXED + 1) % 1.0)
    alone = [state_at(solution, points, float(t)) for t in np.sort(fixed)[::-1]][::-1]
    counts = sorted({max(2, round(round(rate * end, SAME)) + 1) for rate in RATES})
    counts = [count for count in counts if count <= MOST_FRAMES]
    if not counts:
        return ()
    samples: dict[int, Array] = {}
    asked: dict[int, float] = {}
    for count in (*counts, 2 * max(counts) - 1):  # the last one is the reference of the others
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
    gaps = _lengths(interpolate_frames(frames, np.linspace(0.0, count - 1.0, len(motion))) - motion)
    return FrameRateStep(
        frames=count,
        frames_per_second=(count - 1) / end,
        probe_difference=asked,
        interpolation_difference=float(np.max(gaps)),
        interpolation_rms=float(np.sqrt(np.mean(gaps**2))),
        largest_displacement=float(np.max(_lengths(frames))),
    )


def interpolate_frames(frames: Array, places: Array) -> Array:
    """Join frames (n, ...) by straight lines; return them at places (k,), numbers of frames from 0 to n - 1."""
    before = np.clip(np.floor(places).astype(int), 0, len(frames) - 2)
    share = (places - before).reshape(-1, *(1,) * (frames.ndim - 1))
    return np.asarray((1 - share) * frames[before] + share * frames[before + 1])


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
