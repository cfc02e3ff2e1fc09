"""The table of fields: how far the solvers' whole displacement fields are from each other.

A headline figure can be right by chance; a field can't. All fields are held on the grid that every record keeps,
against the field of a deterministic solver if there is exactly one, and of no other.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.columns import code, column
from shellbench.report.evidence import Evidence, Section, given
from shellbench.report.solutions import grouped, solution_name
from shellbench.report.table import Table, frame

Array = NDArray[np.float64]


def section(found: Evidence) -> Section:
    """Return the section of differences between fields."""
    tables = given(field_table(found.records, found.compared, found.folder))
    return Section("fields", "Whole fields", tables=tables, place="its suites")


def field_table(records: Mapping[str, Record], rows: Sequence[Row], folder: Path) -> Table | None:
    """Return the table of differences between fields; None if there are no two to compare."""
    lines: list[dict[str, Any]] = []
    headline = [
        row
        for row in rows
        if row.primary and row.default_settings and row.status == "ok" and row.run_id in records  # the same load
    ]
    for (case, _), of_case in grouped(headline, lambda row: (row.case, row.own_case)).items():
        certain = {row.run_id: row for row in of_case if row.seed is None}
        if len(certain) != 1:
            continue
        yardstick = next(iter(certain.values()))
        theirs = read_fields(records[yardstick.run_id or ""], folder)
        for name, of_solver in grouped(of_case, solution_name).items():
            found = [
                (row.run_id, *differences(ours, theirs))
                for row in of_solver
                if row is not yardstick
                and theirs is not None
                and np.any(theirs.displacement)
                and (ours := read_fields(records[row.run_id or ""], folder)) is not None
                and ours.position.shape == theirs.position.shape
            ]
            if found:
                lines.append(
                    {
                        "block": of_case[0].case_title or case,
                        "case": case,
                        "solution": name,
                        "against": yardstick.solver,
                        "seeds": len(found),
                        "mean_square": max(square for _, square, _ in found),
                        "largest": max(largest for _, _, largest in found),
                        "run_ids": " ".join(str(run_id) for run_id, _, _ in found),
                    }
                )
    if not lines:
        return None
    return Table(
        name="fields",
        title="Differences between fields",
        caption="Root of the mean square over the shell's area, and largest, of the difference between displacement"
        " fields, relative to the same measure of the field that they are held against; the worst seed of each.",
        data=frame(lines),
        columns=(column("solution", way=code), "against", "seeds", "mean_square", "largest"),
    )


@dataclass(frozen=True)
class Fields:
    """What a run kept of its solution: points (n, n, 2), positions and displacements (n, n, 3) in metres.

    Attributes
    ----------
    marks, displacements
        Of the kept states of a path, (k,) and (k, n, n, 3); none for a linear case.
    """

    xi: Array
    position: Array
    displacement: Array
    marks: Array = field(default_factory=lambda: np.empty(0))
    displacements: Array = field(default_factory=lambda: np.empty((0, 0, 0, 3)))


def read_fields(record: Record, folder: Path) -> Fields | None:
    """Return the fields that a run kept; None if it kept none, or they are lost, damaged or not finite."""
    if record.fields_file is None:
        return None
    try:
        with np.load(folder / record.fields_file, allow_pickle=False) as stored:
            xi, position, displacement = (
                np.asarray(stored[name], dtype=float) for name in ("xi", "position", "displacement")
            )
            marks = np.asarray(stored.get("marks", []), dtype=float)
            states = stored["displacements"] if len(marks) else np.empty((0, *displacement.shape))
            fields = Fields(xi, position, displacement, marks, np.asarray(states, dtype=float))
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None
    fits = position.shape == displacement.shape and fields.displacements.shape == (len(marks), *displacement.shape)
    whole = fits and all(np.all(np.isfinite(a)) for a in (xi, position, displacement, marks, fields.displacements))
    return fields if whole else None


def differences(ours: Fields, theirs: Fields) -> tuple[float, float]:
    """Return the relative mean-square and largest difference of two fields on the same grid."""
    weights = areas(theirs.position)
    difference = np.linalg.norm(ours.displacement - theirs.displacement, axis=-1)
    size = np.linalg.norm(theirs.displacement, axis=-1)
    mean_square = np.sqrt(np.sum(weights * difference**2) / np.sum(weights * size**2))
    return float(mean_square), float(difference.max() / size.max())


def areas(position: Array) -> Array:
    """Return the share (n1, n2) of the surface's area that belongs to each point of a grid (n1, n2, 3)."""
    first, second = np.gradient(position, axis=0), np.gradient(position, axis=1)
    weights = np.linalg.norm(np.cross(first, second), axis=-1)
    for axis in (0, 1):  # the trapezoidal rule: half a cell at the ends
        ends = [slice(None), slice(None)]
        for end in (0, -1):
            ends[axis] = end  # type: ignore[call-overload]
            weights[tuple(ends)] *= 0.5
    return np.asarray(weights)
