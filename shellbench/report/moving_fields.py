"""How far apart two solvers' motions are: the difference of their displacements over the surface, at each frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait
from shellbench.report.fields import Fields, areas, read_fields
from shellbench.report.traces import Trace

Array = NDArray[np.float64]

SAME = 1e-6  # relative difference of marks of one frame


@dataclass(frozen=True)
class Apart:
    """The difference of a run's motion from the one that it is held against.

    Attributes
    ----------
    against
        Solver of the latter.
    rms
        Root of the mean square of the difference over the surface at each frame that both kept, m; zero at rest.
    """

    run_id: str
    against: str
    rms: Trace

    @property
    def largest(self) -> tuple[float, float]:
        """When it is largest, and how large."""
        place = int(np.argmax(self.rms.values))
        return float(self.rms.marks[place]), float(self.rms.values[place])


def yardstick(rows: Sequence[Row]) -> Row | None:
    """Return the row of the run that others are held against: the only good one without a seed, if there is one."""
    certain = {row.run_id: row for row in rows if row.seed is None and row.status == "ok"}
    return next(iter(certain.values())) if len(certain) == 1 else None


def apart(runs: Sequence[tuple[Row, Record]], folder: Path) -> dict[str, Apart]:
    """Return, by run id, how far the runs of one case are from the one that they are held against."""
    standard = yardstick([row for row, _ in runs])
    records = {record.run_id: record for _, record in runs}
    theirs = read_fields(records[standard.run_id or ""], folder) if standard is not None else None
    found: dict[str, Apart] = {}
    for _, record in runs:
        if standard is None or theirs is None or record.run_id == standard.run_id:
            continue
        ours = read_fields(record, folder)
        if ours is None or ours.position.shape != theirs.position.shape:
            continue
        rms = rms_difference(ours, theirs)
        if len(rms.marks) > 1:
            found[record.run_id] = Apart(record.run_id, standard.solver, rms)
    return found


def rms_difference(ours: Fields, theirs: Fields) -> Trace:
    """Return the root of the mean square of the difference over the reference surface, m, at marks of both."""
    weights = areas(theirs.position)
    frames = [(float(mark), i, frame_at(ours, float(mark))) for i, mark in enumerate(theirs.marks)]
    both = [(mark, i, j) for mark, i, j in frames if j is not None]
    squares = [np.sum((ours.displacements[j] - theirs.displacements[i]) ** 2, axis=-1) for _, i, j in both]
    means = [float(np.sqrt(np.sum(weights * square) / weights.sum())) for square in squares]
    return Trace(np.array([0.0, *(mark for mark, _, _ in both)]), np.array([0.0, *means]))


def frame_at(fields: Fields, mark: float) -> int | None:
    """Return which of the kept frames is at a mark; None if none is."""
    if not len(fields.marks):
        return None
    nearest = int(np.argmin(np.abs(fields.marks - mark)))
    return nearest if abs(fields.marks[nearest] - mark) <= SAME * max(abs(mark), SAME) else None


def shown_marks(case: Portrait, kept: Mapping[str, Fields], most: int) -> list[float]:
    """Return so many marks at most to show frames at: evenly spread over the time, or over the kept states."""
    rounded = {f"{mark:.6g}": float(mark) for fields in kept.values() for mark in fields.marks}
    marks = sorted(rounded.values())
    if not marks:
        return []
    if case.ends is None:
        places = np.unique(np.round(np.linspace(0, len(marks) - 1, min(most, len(marks)))).astype(int))
        return [marks[place] for place in places]
    wanted = np.linspace(0.0, case.way, most + 1)[1:]
    return sorted({marks[int(np.argmin(np.abs(np.subtract(marks, t))))] for t in wanted})
