"""The tables of queries: whether a solution answers the same through any grid and at any frame rate.

A continuous field answers the same at a material point whatever grid it is asked through; a mesh made from it adds
an interpolation error that falls with its resolution, and costs memory that rises with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from shellbench.protocol.history import FrameRateStep, ResolutionStep
from shellbench.report.data.columns import Line, code, column, frame, present, share
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.ladder import CaseRuns
from shellbench.report.data.notation import BYTES_A_POINT, TEXT, Notation, byte_size, percent, rounded
from shellbench.report.data.runs import groups_alike, in_order_of_cases
from shellbench.report.data.table import Note, Table

SAME_RATE = 1.2  # ratio up to which frame rates stand in one column
ADDED = ("interpolation_difference", "interpolation_rms")  # what a mesh, or a sequence of frames, would add
SOLUTION = column("solution", way=code)


def representatives(evidence: Evidence) -> pd.DataFrame:
    """Return one run (the first seed that answered) of each solver and variant, case by case.

    Of a solver that ran in studies alone it is the run with most unknowns.
    """
    runs = evidence.runs
    runs = runs[runs["primary"] & runs["sound"]].dropna(subset="record")
    led = runs["compared"].groupby([runs["case"], runs["solver"]]).transform("any")
    largest = runs[~led].fillna({"unknowns": 0.0}).groupby(["case", "solver"])["unknowns"].idxmax()
    shown = runs[runs["compared"] | runs.index.isin(largest)]
    return in_order_of_cases(shown.drop_duplicates(["case", "solution"]), [])


def _common(evidence: Evidence) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield what all tables say of a representative, and its record."""
    for run in evidence.once(representatives).itertuples():
        yield {"block": run.title, "case": run.case, "solution": run.solution, "run_id": run.run_id}, run.record


def resolution_table(evidence: Evidence) -> Table:
    """Return the table of bytes and of differences between grids."""
    seen = [(common, record) for common, record in _common(evidence) if record.resolution]
    grids = sorted({step.points for _, record in seen for step in record.resolution})
    lines = [
        {
            **common,
            "parameters": record.parameters,
            "storage_bytes": record.storage_bytes,
            **_queried(record.resolution),
            **{f"{kind}_{step.points}": getattr(step, kind) for kind in ADDED for step in record.resolution},
        }
        for common, record in seen
    ]
    said = ", ".join(map(str, grids))
    memory = "; ".join(f"{n}×{n} points: {byte_size(BYTES_A_POINT * n * n)}" for n in grids)
    return Table(
        name="resolution",
        title="Memory and resolution",
        caption="Bytes to keep each solution; the largest difference at the same material points between queries"
        f" through grids of {said} points a side (zero, or rounding, of every continuous field); and the largest"
        " difference between the solution and the bilinear mesh of n×n points made from it, at the points of the finest"
        " grid. Differences are relative to the largest displacement.",
        data=frame(lines),
        columns=(
            *(SOLUTION, "parameters", "storage_bytes"),
            column("probe_difference", "Same point, any grid", of_largest),
            *(column(f"interpolation_difference_{n}", f"Mesh {n}×{n}", of_largest) for n in grids[:-1]),
        ),
        notes=(Note("A mesh's own memory", f"{memory} (three doubles a point)"),),
    )


def frame_rate_table(evidence: Evidence) -> Table:
    """Return the table of motions seen at many frame rates."""
    seen = [(common, record) for common, record in _common(evidence) if record.frame_rates]
    rates = nominal_rates([step.frames_per_second for _, record in seen for step in record.frame_rates])
    lines = [
        {
            **common,
            **_queried(record.frame_rates),
            **{
                f"{kind}_{rates[step.frames_per_second]}": getattr(step, kind)
                for step in record.frame_rates
                for kind in ("frames", *ADDED)
            },
        }
        for common, record in seen
    ]
    shown = sorted(set(rates.values()))
    return Table(
        name="frame_rates",
        title="One motion at many frame rates",
        caption="The largest difference at the same material points and instants between queries among even frames, at"
        f" about {', '.join(map(str, shown))} a second; and the largest difference between the motion and frames joined"
        " by straight lines, over the instants of the most frames. Differences are relative to the largest"
        " displacement at the probes.",
        data=frame(lines),
        columns=(
            SOLUTION,
            column("probe_difference", "Same instant, any rate", of_largest),
            *(column(f"interpolation_difference_{rate}", f"{rate} a second", of_largest) for rate in shown[:-1]),
        ),
    )


def _queried(steps: Sequence[ResolutionStep | FrameRateStep]) -> dict[str, float]:
    return {name: max(getattr(step, name) for step in steps) for name in ("largest_displacement", "probe_difference")}


def nominal_rates(rates: Sequence[float]) -> dict[float, int]:
    """Return for each frame rate one that stands for those near it: whole frames seldom fit a motion's length."""
    groups = groups_alike(sorted(set(rates)), lambda rate: rate, SAME_RATE)
    return {rate: round(math.sqrt(group[0] * group[-1])) for group in groups for rate in group}


def metres(value: float, line: Line, notation: Notation) -> str:
    """Write a length of which the first digits count."""
    return notation.number(rounded(value, value / 10)) if value else "0"


def of_largest(value: float, line: Line, notation: Notation) -> str:
    """Write a length in percent of the largest displacement of its line."""
    largest = line["largest_displacement"]
    return share(value / largest, line, notation) if present(largest) and largest else notation.missing


def yardstick_words(case: CaseRuns) -> str:
    """Name the run that all solvers are compared with, the reason, and its uncertainty."""
    run = case.yardstick
    if run is None:
        return "No run kept its answer at the probes."
    why = (
        "of all finest runs the one with the smallest doubt (headline's error or last change of the field)"
        if case.judged
        else "no value is known, and of the finest runs without a seed it changed least from the resolution before it"
        if run.row.seed is None
        else "no value is known, and there is no run without a seed"
    )
    known = (
        f"it is known to {TEXT.number(percent(case.doubt / case.scale, signed=False))} % itself"
        if case.doubt is not None and case.scale
        else "nothing tells how well it is known itself"
    )
    return f"Held against: {run.row.solver}, {run.name} ({run.unknowns} unknowns), {why}; {known}."
