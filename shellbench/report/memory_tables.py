"""The tables of memory: bytes at stated error, what rounding does, and what the solve itself took."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pandas as pd

from shellbench.report import cells
from shellbench.report.answers import (
    LEVELS,
    Answer,
    answers,
    change_by_rounding,
    fewest,
    fewest_for_headline,
    field_is_known,
    headline_is_known,
)
from shellbench.report.digits import byte_size, quoted
from shellbench.report.ladder import CaseRuns, Ladder
from shellbench.report.notation import Notation
from shellbench.report.resolution import relative
from shellbench.report.table import Column, Line, Show, Table, present

NOT_KNOWN, NOT_REACHED, REACHED = "not known", "not reached", "reached"
OWN, MESH = "its own numbers", "a mesh"
FIELD, HEADLINE = "field", "headline"


def percents(level: float) -> str:
    """Say a level in percent, as the heading of a column."""
    return f"{quoted(float(f'{100 * level:.6g}')).mantissa} %"


def level_table(cases: Sequence[CaseRuns]) -> Table | None:
    """Return the fewest bytes for each case, solver, way of keeping and level; None if nothing is known of any."""
    lines = [line for case in cases for ladder in case.ladders for line in _level_lines(case, ladder)]
    if not lines:
        return None
    data = pd.DataFrame(lines)
    sizes = [name for name in data if str(name).startswith("bytes_")]
    return Table(
        name="memory",
        title="Bytes at stated error",
        caption="The fewest bytes in which a solver's answer, of any resolution it was computed at, can be kept so that"
        " the displacement at all probes is within 1 %, 0.1 % or 0.01 % of the largest displacement of the best answer"
        " available, and so that the headline quantity is as near to its known value (a position: relative to the"
        " largest displacement); all finer runs of the solver, other seeds among them, must be so too. Its own numbers:"
        " coefficients or weights, as solved or rounded, where rounding's largest difference is added; a mesh: vertices"
        " of a regular grid (of a motion, times frames), where the interpolation's is added. Not known: the best"
        " answer, or the known value, is less certain than the level.",
        data=data.astype(dict.fromkeys(sizes, "Int64")),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Kept as", lambda line, notation: notation.escape(line["kept_as"]), right=False),
            *(Column(f"Field, {percents(level)}", _size(FIELD, level)) for level in LEVELS),
            *(Column(f"Headline, {percents(level)}", _size(HEADLINE, level)) for level in LEVELS),
            Column("Runs", _runs, right=False, wide=True),
        ),
    )


def _level_lines(case: CaseRuns, ladder: Ladder) -> Iterator[dict[str, Any]]:
    found = answers(case, ladder)
    for kept_as in (OWN, MESH):
        candidates = [answer for answer in found if (answer.kept == "mesh") == (kept_as == MESH)]
        if not candidates:
            continue
        line: dict[str, Any] = {"block": case.title, "case": case.case, "solver": ladder.solver, "kept_as": kept_as}
        for level in LEVELS:
            known = field_is_known(case, level)
            line |= _entry(FIELD, level, known, fewest(candidates, level, found) if known else None)
            known = headline_is_known(case, ladder, level) and kept_as == OWN
            line |= _entry(HEADLINE, level, known, fewest_for_headline(candidates, level, found) if known else None)
        yield line


def _entry(of: str, level: float, known: bool, answer: Answer | None) -> dict[str, Any]:
    key = f"{of}_{level:g}"
    if answer is None:
        status = NOT_REACHED if known else NOT_KNOWN
        return {
            f"status_{key}": status,
            f"bytes_{key}": None,
            f"format_{key}": "",
            f"run_{key}": "",
            f"run_id_{key}": "",
        }
    return {
        f"status_{key}": REACHED,
        f"bytes_{key}": answer.storage_bytes,
        f"format_{key}": answer.format,
        f"run_{key}": answer.run.name,
        f"run_id_{key}": answer.run.record.run_id,
    }


def _size(of: str, level: float) -> Show:
    key = f"{of}_{level:g}"

    def show(line: Line, notation: Notation) -> str:
        size = line[f"bytes_{key}"]
        if present(size):
            short = line[f"format_{key}"].removeprefix("mesh ").replace("as solved", "")
            return notation.escape(f"{byte_size(size)}{f' ({short})' if short else ''}")
        if line["kept_as"] == MESH and of == HEADLINE:
            return notation.missing
        return notation.escape(line[f"status_{key}"])

    return show


def _runs(line: Line, notation: Notation) -> str:
    names = dict.fromkeys(line[f"run_{of}_{level:g}"] for of in (FIELD, HEADLINE) for level in LEVELS)
    return notation.escape("; ".join(name for name in names if name)) or notation.missing


def rounding_table(cases: Sequence[CaseRuns]) -> Table | None:
    """Return what shorter numbers do to each solver's finest run; None if none was rounded."""
    lines = [
        {
            "block": case.title,
            "case": case.case,
            "solver": ladder.solver,
            "run": ladder.finest.name,
            "run_id": ladder.finest.record.run_id,
            "format": step.format,
            "storage_bytes": step.storage_bytes,
            "largest_difference": step.largest_difference,
            "rms_difference": step.rms_difference,
            "largest_displacement": ladder.finest.largest or None,
            "quantity": ladder.finest.row.quantity,
            "change": change_by_rounding(ladder.finest, step),
        }
        for case in cases
        for ladder in case.ladders
        for step in ladder.finest.record.precision
    ]
    if not lines:
        return None
    return Table(
        name="memory_rounding",
        title="Shorter numbers",
        caption="The numbers that each solver's finest run is kept in, rounded to a shorter format: bytes, difference"
        " from the solution as solved at the probes, relative to its largest displacement, and change of the headline"
        " quantity. What is asked of the rounded solution is computed in double precision.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Format", lambda line, notation: notation.escape(line["format"]), right=False),
            Column("Kept in", lambda line, notation: notation.escape(byte_size(line["storage_bytes"]))),
            Column("Largest", _or_not_finite("largest_difference")),
            Column("rms", _or_not_finite("rms_difference")),
            Column("Headline quantity", cells.error("change")),
        ),
    )


def _or_not_finite(name: str) -> Show:
    shown: Callable[[Line, Notation], str] = relative(name)

    def show(line: Line, notation: Notation) -> str:
        return shown(line, notation) if present(line[name]) else notation.escape("not finite")

    return show


def solve_lines(case: CaseRuns, ladder: Ladder, *, finest_only: bool) -> Iterator[dict[str, Any]]:
    """Yield what runs took: unknowns, bytes kept, and the memory of the solving process."""
    for run in (ladder.finest,) if finest_only else ladder.runs:
        record = run.record
        peak, idle = record.peak_memory_bytes, record.idle_memory_bytes
        yield {
            "block": case.title,
            "case": case.case,
            "solver": ladder.solver,
            "run": run.name,
            "run_id": record.run_id,
            "unknowns": run.unknowns,
            "time_steps": run.time_steps,
            "storage_bytes": record.storage_bytes,
            "peak_memory_bytes": peak,
            "solve_memory_bytes": peak - idle if peak is not None and idle is not None else None,
        }


def solve_table(cases: Sequence[CaseRuns], *, finest_only: bool = True) -> Table | None:
    """Return the memory of the solve, of each solver's finest run or of all; None if it was never measured."""
    lines = [
        line
        for case in cases
        for ladder in case.ladders
        for line in solve_lines(case, ladder, finest_only=finest_only)
        if line["peak_memory_bytes"] is not None
    ]
    if not lines:
        return None
    sizes = ("storage_bytes", "peak_memory_bytes", "solve_memory_bytes")
    return Table(
        name="memory_solve" if finest_only else "memory_runs",
        title="Memory of the solve" if finest_only else "Memory of all runs",
        caption="Largest resident memory of the solving process; and the same less what the process held before the"
        " solve, its libraries above all." + (" Each solver's finest run." if finest_only else ""),
        data=pd.DataFrame(lines).astype(dict.fromkeys(sizes, "Int64")),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Run", lambda line, notation: notation.escape(line["run"]), right=False),
            Column("Unknowns", lambda line, notation: str(line["unknowns"])),
            Column("Kept in", cells.memory("storage_bytes")),
            Column("Peak less idle", cells.memory("solve_memory_bytes")),
            Column("Peak", cells.memory("peak_memory_bytes")),
        ),
    )
