"""The tables of what was followed: what the way along a path took, and how cloth moved, in figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import fmean
from typing import Any

import pandas as pd

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.protocol.picture import Portrait
from shellbench.report.data.columns import (
    COST,
    Column,
    Line,
    at_most,
    code,
    column,
    error,
    frame,
    in_its_unit,
    present,
    significant,
    words,
)
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import Notation, rounded
from shellbench.report.data.runs import grouped, leading_rows
from shellbench.report.data.section import Section, failures, given
from shellbench.report.data.solutions import BAD, EXPECTED, verdict
from shellbench.report.data.table import Note, Table
from shellbench.report.data.traces import CLOTH, CURVE, STATES, Apart, Phase, apart, portrayed, steps_of

TIMES = "times_"  # how names of tables by time begin
GLANCE = significant(2)  # how an error, a drift and a difference are written


def paths(found: Evidence) -> Section:
    """Return the section of paths: what they took, and how they went."""
    tables, figures = given(effort_table(found)), found.figures(CURVE, STATES)
    return Section("paths", "Load paths", tables=tables, exhibits=figures, place="its suites")


def effort_table(evidence: Evidence) -> Table:
    """Return the table of path states, iterations and seconds."""
    followed = evidence.made["record"].map(lambda record: bool(steps_of(record, "path"))).astype(bool)
    walked = evidence.made[followed]
    lines = [
        {"block": runs["title"].iloc[0], "case": case, "solution": name} | effort(list(runs["record"]), "path")
        for (case, _, name), runs in walked.groupby(["case", "own_case", "solution"], sort=False)
    ]
    return Table(
        name="effort",
        title="Iterations and seconds",
        caption="Converged states of the path, Newton iterations that they took in all and at most in one step, and"
        " wall time and largest memory of the whole solve, in which there may be other discretisations too. Of several"
        " seeds: the most states, iterations, unknowns and memory, and the mean time. Runs that failed are counted up"
        " to their failure.",
        data=frame(lines),
        columns=("solution", column("seeds", "Runs"), "states", "iterations", "most_in_a_step", *COST),
        notes=failures(walked),
    )


def effort(records: Sequence[Record], phase: Phase) -> dict[str, Any]:
    """Return the cost of a solver's paths or motions: states, iterations, unknowns, seconds and memory."""
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


def cloth(found: Evidence) -> Section:
    """Return the section of cloth in motion, with a part for each case."""
    by_time = {table.name: table for table in by_time_tables(found)}
    titles = {row.case: row.case_title or row.case for row in found.compared}
    figures = {one.name: one for one in found.figures(*CLOTH)}
    parts = [
        Section(
            name=case,
            title=title,
            tables=given(by_time.get(f"{TIMES}{case}")),
            exhibits=tuple(figures[name] for prefix in CLOTH if (name := f"{prefix}{case}") in figures),
        )
        for case, title in titles.items()
    ]
    return Section(
        name="cloth",
        title="Cloth in motion",
        tables=given(motion_table(found)),
        parts=tuple(part for part in parts if part.shows),
        place="its suites",
    )


def motion_table(evidence: Evidence) -> Table:
    """Return the table of motions: last time reached, cost, energy lost, and difference from the other solvers."""
    lines: list[dict[str, Any]] = []
    notes: list[Note] = []
    against: dict[str, None] = {}
    for case, of_case in portrayed(evidence.made[evidence.made["leading"]]):
        if case.ends is None:
            continue
        found = apart(of_case, evidence.folder)
        against |= dict.fromkeys(one.against for one in found.values())
        for name, of_solution in of_case.groupby("solution", sort=False):
            course = _course(list(of_solution["record"]), case, found)
            lines.append({"block": case.title, "case": case.name, "solution": name} | course)
        notes += failures(of_case)
    standard = f" from that of {' or '.join(against)}" if against else ""
    return Table(
        name="motions",
        title="Motions",
        caption="The last time that was reached, steps in time and Newton iterations that they took, the largest energy"
        " that was lost or gained by the solver's own account, and the largest root mean square, over the"
        f" surface, of the difference of the displacement{standard}, beside those at the times asked for. Of several"
        " seeds the worst; time is their mean.",
        data=frame(lines),
        columns=(
            column("solution", way=code),
            column("reached", "Reached", at_most(4), unit="s"),
            "steps",
            "iterations",
            column("drift", "Energy drift", GLANCE, unit="J"),
            column("largest", "Largest difference", GLANCE, unit="m"),
            column("largest_at", "at", at_most(4), unit="s"),
            column("asked_differences", "Differences at the times asked for", _asked, unit="m", right=False, wide=True),
            "seconds",
        ),
        notes=tuple(notes),
    )


def _course(made: Sequence[Record], case: Portrait, found: Mapping[str, Apart]) -> dict[str, Any]:
    steps, took = [steps_of(record, "time") for record in made], effort(made, "time")
    differences = [found[record.run_id] for record in made if record.run_id in found]
    worst = max(differences, key=lambda one: one.largest[1], default=None)
    asked: dict[float, float] = {}
    for t in case.states:
        values = [value for one in differences if (value := one.rms.at(t)) is not None]
        asked |= {t: max(values)} if values else {}
    ends = [of_run[-1].at for of_run in steps if of_run]
    ends += [record.series[0].marks[-1] for record in made if record.series and not steps_of(record, "time")]
    return {
        "reached": min(ends, default=None),
        "steps": took["states"] or None,
        "iterations": took["iterations"],
        "drift": max((abs(step.energy) for of_run in steps for step in of_run), default=None),
        "largest": worst.largest[1] if worst else None,
        "largest_at": worst.largest[0] if worst else None,
        "asked_times": " ".join(f"{t:g}" for t in asked),
        "asked_differences": " ".join(repr(value) for value in asked.values()),
        "seconds": took["seconds"],
        "run_ids": took["run_ids"],
    }


def by_time_tables(evidence: Evidence) -> list[Table]:
    """Return, for each case in motion, its quantities grouped by time with a pair of columns for each solver."""
    tables, records = [], evidence.records
    for (name, _), of_case in grouped(leading_rows(evidence.compared), lambda row: (row.case, row.own_case)).items():
        record = next((records[row.run_id] for row in of_case if row.run_id and row.run_id in records), None)
        case = portrait_of(record) if record is not None else None
        if case is not None and case.ends is not None:
            tables.append(_by_time(name, case, of_case))
    return tables


def _by_time(name: str, case: Portrait, rows: Sequence[Row]) -> Table:
    solvers = list(dict.fromkeys(row.solver for row in rows))
    order = {quantity.name: place for place, quantity in enumerate(case.quantities)}
    asked = grouped(sorted(rows, key=lambda row: (row.at or 0.0, order.get(row.quantity, 0))), lambda row: row.quantity)
    return Table(
        name=f"{TIMES}{name}",
        title=f"{case.title}: quantities by time",
        caption="Known values with their uncertainty in the last digits; each solver's mean over its seeds, and the"
        " error of its worst seed, in percent of the known value or, with a unit, as it is. Errors in bold fall short"
        " of what is asked.",
        data=pd.DataFrame([_line(of_quantity, solvers) for of_quantity in asked.values()]),
        columns=(
            column("quantity", "Quantity", _with_unit, right=False),
            "reference",
            *(one for solver in solvers for one in (_answer(solver), _error(solver))),
        ),
    )


def _line(rows: Sequence[Row], solvers: Sequence[str]) -> dict[str, Any]:
    first = rows[0]
    judge = next((row for row in rows if row.reference is not None), first)
    line: dict[str, Any] = {
        "block": first.mark,
        "case": first.case,
        "quantity": first.quantity,
        "unit": first.unit,
        "at": first.at,
        "reference": judge.reference,
        "reference_uncertainty": judge.reference_uncertainty,
    }
    answers = grouped(rows, lambda row: row.solver)
    for solver in solvers:
        line |= _found(solver, answers.get(solver, []))
    return line


def _found(solver: str, rows: Sequence[Row]) -> dict[str, Any]:
    values = [row.value for row in rows if row.value is not None]
    absolute = [row.absolute_error for row in rows if row.absolute_error is not None]
    relative = [row.relative_error for row in rows if row.relative_error is not None]
    return {
        f"{solver} value": fmean(values) if values else None,
        f"{solver} error": max(absolute, key=abs, default=None),
        f"{solver} relative error": max(relative, key=abs, default=None),
        f"{solver} verdict": verdict(rows) if rows else "",
    }


def _with_unit(value: Any, line: Line, notation: Notation) -> str:
    name = str(value).removesuffix(f"_{1000 * line['at']:g}ms").replace("_", " ")
    return words(f"{name} ({line['unit']})", line, notation)


def _answer(solver: str) -> Column:
    def number(value: Any, line: Line, notation: Notation) -> str:
        absolute = line[f"{solver} error"]
        doubts = [abs(absolute) / 10 if present(absolute) else 0.0, line["reference_uncertainty"] or 0.0]
        return notation.number(rounded(value, max(d for d in doubts if present(d)) or None))

    def otherwise(line: Line, notation: Notation) -> str:
        status = line[f"{solver} verdict"]
        return notation.escape(status) if status in BAD else ""

    return column(f"{solver} value", solver, number, instead=otherwise)


def _error(solver: str) -> Column:
    absolute = in_its_unit(f"{solver} error", GLANCE)
    plain = column(f"{solver} relative error", "Error", error, instead=absolute)

    def written(line: Line, notation: Notation) -> str:
        text = plain.show(line, notation)
        short = text != notation.missing and line[f"{solver} verdict"] in (*BAD, EXPECTED)
        return notation.strong(text) if short else text

    return replace(plain, show=written)


def _asked(value: Any, line: Line, notation: Notation) -> str:
    asked = zip(str(line["asked_times"]).split(), str(value).split(), strict=True)
    return "; ".join(f"{GLANCE(float(one), line, notation)} {notation.escape(f'at {t} s')}" for t, one in asked)
