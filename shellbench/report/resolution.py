"""The tables of queries: whether a solution answers the same through any grid and at any frame rate.

A continuous field answers the same at a material point whatever grid it is asked through; a mesh made from it adds
an interpolation error that falls with its resolution, and costs memory that rises with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report import cells
from shellbench.report.digits import byte_size, percent, rounded
from shellbench.report.notation import Notation
from shellbench.report.solutions import solution_name
from shellbench.report.suites import compared
from shellbench.report.table import Column, Line, Note, Show, Table, present

MESH_BYTES_A_POINT = 3 * 8  # displacement of a vertex in double precision; connectivity not counted
MESH_DIFFERENCES = "mesh_differences"
SAME_RATE = 1.2  # ratio up to which frame rates stand in one column


def representatives(records: Mapping[str, Record], rows: Sequence[Row]) -> list[tuple[Row, Record]]:
    """Return one run (the first seed that answered) of each solver and variant, case by case.

    Of a solver that ran in studies alone it is the run with most unknowns.
    """
    found: dict[tuple[str, str], tuple[Row, Record]] = {}
    answered = [
        (row, record)
        for row in rows
        if row.primary and (record := records.get(row.run_id or "")) is not None and record.status == "ok"
    ]
    plain = {id(row) for row in compared([row for row, _ in answered])}
    led = {(row.case, row.solver) for row, _ in answered if id(row) in plain}
    largest: dict[tuple[str, str], tuple[Row, Record]] = {}
    for row, record in answered:
        if (row.case, row.solver) not in led:
            best = largest.setdefault((row.case, row.solver), (row, record))
            if (record.parameters or 0) > (best[1].parameters or 0):
                largest[row.case, row.solver] = row, record
    shown = plain | {id(row) for row, _ in largest.values()}
    for row, record in answered:
        if id(row) in shown:
            found.setdefault((row.case, solution_name(row)), (row, record))
    order = list(dict.fromkeys(case for case, _ in found))
    return sorted(found.values(), key=lambda pair: order.index(pair[0].case))


def resolution_table(records: Mapping[str, Record], rows: Sequence[Row]) -> Table | None:
    """Return the table of bytes and of differences between grids; None if no run was seen through grids."""
    lines: list[dict[str, Any]] = []
    grids = sorted({step.points for _, record in representatives(records, rows) for step in record.resolution})
    for row, record in representatives(records, rows):
        if not record.resolution:
            continue
        largest = max(step.largest_displacement for step in record.resolution)
        line: dict[str, Any] = {
            "block": row.case_title or row.case,
            "case": row.case,
            "solution": solution_name(row),
            "run_id": record.run_id,
            "parameters": record.parameters,
            "storage_bytes": record.storage_bytes,
            "largest_displacement": largest,
            "probe_difference": max(step.probe_difference for step in record.resolution),
        }
        line |= {f"interpolation_difference_{step.points}": step.interpolation_difference for step in record.resolution}
        line |= {f"interpolation_rms_{step.points}": step.interpolation_rms for step in record.resolution}
        lines.append(line)
    if not lines:
        return None
    words = ", ".join(map(str, grids))
    return Table(
        name="resolution",
        title="Memory and resolution",
        caption="Bytes to keep each solution; the largest difference at the same material points between queries"
        f" through grids of {words} points a side; and the largest difference between the solution and the bilinear"
        f" mesh of n×n points made from it, at the points of the finest grid. Differences are relative to the largest"
        " displacement.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solution", lambda line, notation: notation.code(line["solution"]), right=False),
            Column("Unknowns", cells.count("parameters")),
            Column("Kept in", lambda line, notation: _size(line["storage_bytes"], notation)),
            Column("Same point, any grid", relative("probe_difference")),
            *(Column(f"Mesh {n}×{n}", relative(f"interpolation_difference_{n}")) for n in grids[:-1]),
        ),
        notes=(
            Note(
                "A mesh's own memory",
                "; ".join(f"{n}×{n} points: {byte_size(MESH_BYTES_A_POINT * n * n)}" for n in grids)
                + " (three doubles a point)",
            ),
        ),
    )


def frame_rate_table(records: Mapping[str, Record], rows: Sequence[Row]) -> Table | None:
    """Return the table of motions seen at many frame rates; None if no run was."""
    lines: list[dict[str, Any]] = []
    seen = [pair for pair in representatives(records, rows) if pair[1].frame_rates]
    rates = nominal_rates([step.frames_per_second for _, record in seen for step in record.frame_rates])
    for row, record in seen:
        line: dict[str, Any] = {
            "block": row.case_title or row.case,
            "case": row.case,
            "solution": solution_name(row),
            "run_id": record.run_id,
            "largest_displacement": max(step.largest_displacement for step in record.frame_rates),
            "probe_difference": max(step.probe_difference for step in record.frame_rates),
        }
        for step in record.frame_rates:
            rate = rates[step.frames_per_second]
            line[f"frames_{rate}"] = step.frames
            line[f"interpolation_difference_{rate}"] = step.interpolation_difference
            line[f"interpolation_rms_{rate}"] = step.interpolation_rms
        lines.append(line)
    if not lines:
        return None
    shown = sorted(set(rates.values()))
    return Table(
        name="frame_rates",
        title="One motion at many frame rates",
        caption="The largest difference at the same material points and instants between queries among even frames, at"
        f" about {', '.join(map(str, shown))} a second; and the largest difference between the motion and frames joined"
        " by straight lines, over the instants of the most frames. Differences are relative to the largest"
        " displacement at the probes.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solution", lambda line, notation: notation.code(line["solution"]), right=False),
            Column("Same instant, any rate", relative("probe_difference")),
            *(Column(f"{rate} a second", relative(f"interpolation_difference_{rate}")) for rate in shown[:-1]),
        ),
    )


def nominal_rates(rates: Sequence[float]) -> dict[float, int]:
    """Return for each frame rate one that stands for those near it: whole frames seldom fit a motion's length."""
    groups: list[list[float]] = []
    for rate in sorted(set(rates)):
        if groups and rate <= SAME_RATE * groups[-1][0]:
            groups[-1].append(rate)
        else:
            groups.append([rate])
    return {rate: round(math.sqrt(group[0] * group[-1])) for group in groups for rate in group}


def mesh_table(records: Mapping[str, Record], rows: Sequence[Row]) -> Table | None:
    """Return the table of differences between successive meshes of one solver; None if no solver reports them."""
    lines: list[dict[str, Any]] = []
    for row, record in representatives(records, rows):
        reported = record.diagnostics.get(MESH_DIFFERENCES)
        largest = max((step.largest_displacement for step in record.resolution), default=None)
        for step in reported if isinstance(reported, list) else ():
            if not isinstance(step, dict) or not isinstance(step.get("largest_difference"), int | float):
                continue
            lines.append(
                {
                    "block": row.case_title or row.case,
                    "case": row.case,
                    "solution": solution_name(row),
                    "run_id": record.run_id,
                    "mesh": "×".join(str(n) for n in step.get("cells", ())),
                    "difference": float(step["largest_difference"]),
                    "largest_displacement": largest,
                }
            )
    if not lines:
        return None
    return Table(
        name="meshes",
        title="Differences between meshes",
        caption="Largest difference of the displacement between each mesh of one solve and the mesh before it, at"
        " fixed material points; relative to the largest displacement.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solution", lambda line, notation: notation.code(line["solution"]), right=False),
            Column("Mesh (cells)", lambda line, notation: notation.escape(line["mesh"])),
            Column("Difference to the mesh before (m)", _difference),
            Column("Relative", relative("difference")),
        ),
    )


def _size(value: float, notation: Notation) -> str:
    return notation.escape(byte_size(value)) if present(value) else notation.missing


def _difference(line: Line, notation: Notation) -> str:
    value = line["difference"]
    return notation.number(rounded(value, value / 10)) if value else "0"


def relative(name: str) -> Show:
    """Return how to show a length of a line's data: in percent of its largest displacement."""

    def show(line: Line, notation: Notation) -> str:
        value, largest = line.get(name), line["largest_displacement"]
        if not present(value) or not present(largest) or not largest:
            return notation.missing
        return notation.number(percent(value / largest, signed=False)) + notation.per_cent

    return show
