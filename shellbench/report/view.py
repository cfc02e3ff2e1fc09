"""What a shell's view in three dimensions shows: each solver's displacement of one case, state by state."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait
from shellbench.report.fields import Fields, read_fields
from shellbench.report.projection import Camera
from shellbench.report.scene import picture_scale
from shellbench.report.states import spread
from shellbench.report.suites import leading_rows

Array = NDArray[np.float64]

FINE, COARSE = 61, 31  # points a side at most, of one state and of several
MOST_STATES = 21  # on a slider: more are not told apart, and each takes its bytes
MARK_DIGITS = 6  # marks that agree in so many digits are the same state
ENERGY_PARTS = ("membrane_energy_density", "bending_energy_density")
MAGNIFIED = 2.0  # the slider's end, in picture scales, where displacements are small


@dataclass(frozen=True)
class Answer:
    """One solver's answer.

    Attributes
    ----------
    label
        The solver, and how its run ended if not well.
    states
        Displacement (n1, n2, 3), m, of each of the view's marks; None where the run kept no such state.
    density
        Strain energy per area (n1, n2), J/m2, of the last state that the run kept; None if it kept none.
    """

    label: str
    run_id: str
    states: tuple[Array | None, ...]
    density: Array | None


@dataclass(frozen=True)
class View:
    """One case, to be turned.

    Attributes
    ----------
    position
        (n1, n2, 3), m, of the reference surface.
    marks
        Words for each state; one without words where the case is linear.
    held
        Axis of the parameters and end, "min" or "max", of each held edge.
    scale, largest_scale
        Factor of the displacement at first, and at the slider's end.
    direction
        Colour by the displacement's component along it at first; by its magnitude if None.
    """

    case: str
    title: str
    unit: str
    position: Array
    marks: tuple[str, ...]
    held: tuple[tuple[int, str], ...]
    scale: float
    largest_scale: float
    camera: Camera
    direction: tuple[float, float, float] | None
    answers: tuple[Answer, ...]


def views(records: Mapping[str, Record], rows: Sequence[Row], folder: Path) -> dict[str, View]:
    """Return a view of each case of which a run kept its field, by name of case.

    Parameters
    ----------
    records
        By run id.
    rows
        That compare them.
    folder
        Where the records' files are.
    """
    made = {case: view(of_case, folder) for case, of_case in answered(records, rows).items()}
    return {case: one for case, one in made.items() if one is not None}


def led_by(view: View, run_id: str) -> View:
    """Return the view with a run's answer first: what is seen at first is what the still picture shows."""
    return replace(view, answers=tuple(sorted(view.answers, key=lambda answer: answer.run_id != run_id)))


def answered(records: Mapping[str, Record], rows: Sequence[Row]) -> dict[str, list[Record]]:
    """Return, for each case, a record for each solver: of its own runs that kept a field, that of the lowest seed."""
    chosen: dict[str, dict[str, tuple[int, Record]]] = {}
    for row in leading_rows([row for row in rows if row.primary]):
        record = records.get(row.run_id or "")
        if record is None or record.fields_file is None:
            continue
        of_case, seed = chosen.setdefault(row.case, {}), row.seed or 0
        if row.solver not in of_case or seed < of_case[row.solver][0]:
            of_case[row.solver] = (seed, record)
    return {case: [record for _, record in of_case.values()] for case, of_case in chosen.items()}


def view(records: Sequence[Record], folder: Path) -> View | None:
    """Return the view of one case; None if none of its records has a field that can be read."""
    found = [(record, fields) for record in records if (fields := read_fields(record, folder)) is not None]
    case = portrait_of(found[0][0]) if found else None
    scene = case.scene if case is not None else None
    if case is None or scene is None:
        return None
    reference = found[0][1].position
    found = [(record, fields) for record, fields in found if fields.position.shape == reference.shape]
    marks = spread(sorted({key for _, fields in found for key in states_of(fields)}), MOST_STATES)
    thin = stride(len(reference), FINE if len(marks) == 1 else COARSE)
    scale = picture_scale(scene, reference, [state for _, fields in found for state in states_of(fields).values()])
    return View(
        case=found[0][0].case_name,
        title=case.title,
        unit=case.unit_of_length,
        position=reference[::thin, ::thin],
        marks=tuple(case.mark_words(mark) if moves(case, marks) else "" for mark in marks),
        held=tuple(dict.fromkeys(scene.held)),
        scale=scale,
        largest_scale=scale * (1.0 if moves(case, marks) else MAGNIFIED),
        camera=Camera(*scene.view, scene.up),
        direction=scene.direction,
        answers=tuple(answer(record, fields, marks, thin, folder) for record, fields in found),
    )


def answer(record: Record, fields: Fields, marks: Sequence[float], thin: int, folder: Path) -> Answer:
    """Return what a view shows of one record, every `thin`-th point of its grid."""
    states, density = states_of(fields), energy_density(record, folder)
    kept = density is not None and density.shape == fields.xi.shape[:2] and max(states) in marks
    return Answer(
        label=record.identity.solver + ("" if record.status == "ok" else f" ({record.status})"),
        run_id=record.run_id,
        states=tuple(states[mark][::thin, ::thin] if mark in states else None for mark in marks),
        density=density[::thin, ::thin] if density is not None and kept else None,
    )


def energy_density(record: Record, folder: Path) -> Array | None:
    """Return the strain energy per area (n1, n2) that a run kept; None if it kept none or it is not finite."""
    try:
        with np.load(folder / (record.fields_file or ""), allow_pickle=False) as stored:
            density = np.sum([np.asarray(stored[name], dtype=float) for name in ENERGY_PARTS], axis=0)
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None
    return density if np.all(np.isfinite(density)) else None


def states_of(fields: Fields) -> dict[float, Array]:
    """Return the displacements that a run kept, by mark; the mark of a linear answer is 1."""
    if not len(fields.marks):
        return {1.0: fields.displacement}
    return {
        float(f"{mark:.{MARK_DIGITS}g}"): states
        for mark, states in zip(fields.marks, fields.displacements, strict=True)
    }


def moves(case: Portrait, marks: Sequence[float]) -> bool:
    """Tell whether a case has states to tell apart."""
    return len(marks) > 1 or case.ends is not None


def stride(points: int, most: int) -> int:
    """Return the smallest step through a grid's points a side that keeps both ends and leaves at most `most`."""
    steps = (step for step in range(1, points) if (points - 1) % step == 0 and (points - 1) // step < most)
    return next(steps, points - 1)
