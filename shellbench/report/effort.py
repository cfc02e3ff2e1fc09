"""The table of effort: what the way along each path took, in states, iterations and seconds."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean
from typing import Any

from shellbench.bench.record import Record
from shellbench.report.columns import COST, column, frame
from shellbench.report.evidence import Evidence, Section, given
from shellbench.report.solutions import grouped
from shellbench.report.table import Note, Table
from shellbench.report.trace_exhibits import CURVE, STATES
from shellbench.report.traces import Phase, steps_of


def section(found: Evidence) -> Section:
    """Return the section of paths: what they took, and how they went."""
    tables, figures = given(effort_table(found)), found.figures(CURVE, STATES)
    return Section("paths", "Load paths", tables=tables, exhibits=figures, place="its suites")


def effort_table(evidence: Evidence) -> Table:
    """Return the table of path states, iterations and seconds."""
    lines: list[dict[str, Any]] = []
    notes: list[Note] = []
    walked = evidence.made["record"].map(lambda record: bool(steps_of(record, "path"))).astype(bool)
    for (case, _, name), runs in evidence.made[walked].groupby(["case", "own_case", "solution"], sort=False):
        title, followed = runs["title"].iloc[0], list(runs["record"])
        lines.append({"block": title, "case": case, "solution": name} | effort(followed, "path"))
        failed = grouped((one for one in followed if one.status != "ok"), lambda one: one.reason or one.status)
        for reason, alike in failed.items():
            seeds = ", ".join(str(record.identity.seed) for record in alike if record.identity.seed is not None)
            words = f"{title}, {name}" + (f", seed {seeds}" if seeds else "") + f" ({alike[0].status})"
            notes.append(Note(words, reason))
    return Table(
        name="effort",
        title="Iterations and seconds",
        caption="Converged states of the path, Newton iterations that they took in all and at most in one step, and"
        " wall time and largest memory of the whole solve, in which there may be other discretisations too. Of several"
        " seeds: the most states, iterations, unknowns and memory, and the mean time. Runs that failed are counted up"
        " to their failure.",
        data=frame(lines),
        columns=("solution", column("seeds", "Runs"), "states", "iterations", "most_in_a_step", *COST),
        notes=tuple(notes),
    )


def effort(records: Sequence[Record], phase: Phase) -> dict[str, Any]:
    """Return what the paths, or motions, of runs took."""
    ways = [steps_of(record, phase) for record in records]
    counted = [[step.iterations for step in way if step.iterations is not None] for way in ways]
    return {
        "seeds": len(records),
        "states": max(map(len, ways)),
        "iterations": max((sum(counts) for counts in counted if counts), default=None),
        "most_in_a_step": max((max(counts) for counts in counted if counts), default=None),
        "unknowns": max((step.unknowns for way in ways for step in way), default=None),
        "seconds": fmean(record.seconds for record in records),
        "peak_memory_bytes": max((r.peak_memory_bytes for r in records if r.peak_memory_bytes), default=None),
        "run_ids": " ".join(record.run_id for record in records),
    }
