"""The table of fields: how far the solvers' whole displacement fields are from each other.

A headline figure can be right by chance; a field can't. All fields are held on the grid that every record keeps,
against the field of a deterministic solver if there is exactly one, and of no other.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.columns import code, column, frame
from shellbench.report.evidence import Evidence, Section, given
from shellbench.report.solutions import grouped, solution_name
from shellbench.report.table import Table

Array = NDArray[np.float64]


def section(found: Evidence) -> Section:
    """Return the section of differences between fields."""
    tables = given(field_table(found))
    return Section("fields", "Whole fields", tables=tables, place="its suites")


def field_table(evidence: Evidence) -> Table:
    """Return the table of differences between fields."""
    headline = [
        row
        for row in evidence.headline
        if row.default_settings and row.status == "ok" and row.run_id in evidence.records  # the same load
    ]
    cases = grouped(headline, lambda row: (row.case, row.own_case)).values()
    lines = [line for of_case in cases for line in _lines(evidence, of_case)]
    return Table(
        name="fields",
        title="Differences between fields",
        caption="Root of the mean square over the shell's area, and largest, of the difference between displacement"
        " fields, relative to the same measure of the field that they are held against; the worst seed of each.",
        data=frame(lines),
        columns=(column("solution", way=code), "against", "seeds", "mean_square", "largest"),
    )


def _lines(evidence: Evidence, rows: Sequence[Row]) -> Iterator[dict[str, Any]]:
    """Yield a line for each solution of a case that has a field beside that of the only deterministic one."""
    kept = {row.run_id: read_fields(evidence.records[row.run_id or ""], evidence.folder) for row in rows}
    certain = {row.run_id: row.solver for row in rows if row.seed is None}
    theirs = kept[next(iter(certain))] if len(certain) == 1 else None
    if theirs is None or not np.any(theirs.displacement):
        return
    for name, of_solver in grouped(rows, solution_name).items():
        ours = {row.run_id: kept[row.run_id] for row in of_solver if row.run_id not in certain}
        found = {
            run_id: differences(one, theirs)
            for run_id, one in ours.items()
            if one is not None and one.position.shape == theirs.position.shape
        }
        if found:
            yield {
                "block": rows[0].case_title or rows[0].case,
                "case": rows[0].case,
                "solution": name,
                "against": next(iter(certain.values())),
                "seeds": len(found),
                "mean_square": max(square for square, _ in found.values()),
                "largest": max(largest for _, largest in found.values()),
                "run_ids": " ".join(map(str, found)),
            }


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
    kept = kept_arrays(record, folder, "xi", "position", "displacement", optional=("marks", "displacements"))
    if kept is None:
        return None
    xi, position, displacement, *states = kept
    fields = Fields(xi, position, displacement, *(states if states and len(states[0]) else ()))
    fits = position.shape == displacement.shape
    if len(fields.marks):
        fits &= fields.displacements.shape == (len(fields.marks), *displacement.shape)
    return fields if fits else None


def kept_arrays(record: Record, folder: Path, *names: str, optional: Sequence[str] = ()) -> list[Array] | None:
    """Return arrays that a run kept, the optional ones only if the first of them is there.

    None if it kept none, or they are lost, damaged or not finite.
    """
    try:
        with np.load(folder / (record.fields_file or ""), allow_pickle=False) as stored:
            wanted = (*names, *(optional if optional and optional[0] in stored else ()))
            arrays = [np.asarray(stored[name], dtype=float) for name in wanted]
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None
    return arrays if all(np.all(np.isfinite(one)) for one in arrays) else None


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
