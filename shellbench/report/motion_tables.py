"""The tables of motions: how each run went, and the quantities of a case by time, solvers side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import pandas as pd

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait
from shellbench.report import cells
from shellbench.report.digits import quoted, rounded
from shellbench.report.notation import Notation
from shellbench.report.solutions import BAD, EXPECTED, grouped, solution_name, verdict
from shellbench.report.suites import leading_rows
from shellbench.report.table import Column, Line, Note, Show, Table, present
from shellbench.report.traces import Apart, apart, motion_steps, runs_by_case

GLANCE = 2  # significant digits of an error, a drift and a difference


def motion_tables(records: Mapping[str, Record], rows: Sequence[Row], folder: Path) -> list[Table]:
    """Return all tables of motions."""
    course = motion_table(records, rows, folder)
    return [*([course] if course is not None else []), *by_time_tables(records, rows)]


def motion_table(records: Mapping[str, Record], rows: Sequence[Row], folder: Path) -> Table | None:
    """Return how far each motion came, what it took, what energy it lost and how far it is from the others."""
    lines: list[dict[str, Any]] = []
    notes: list[Note] = []
    against: dict[str, None] = {}
    headline = leading_rows([row for row in rows if row.primary])
    for runs in runs_by_case(records, headline).values():
        case = portrait_of(runs[0][1])
        if case is None or case.ends is None:
            continue
        found = apart(runs, folder)
        against |= dict.fromkeys(one.against for one in found.values())
        by_id = {record.run_id: record for _, record in runs}
        for name, of_solver in grouped((row for row, _ in runs), solution_name).items():
            made = [by_id[row.run_id or ""] for row in of_solver]
            lines.append({"block": case.title, "case": case.name, "solution": name} | _course(made, case, found))
            notes += [
                Note(f"{case.title}, {name}{'' if r.identity.seed is None else f', seed {r.identity.seed}'}", r.reason)
                for r in made
                if r.status != "ok" and r.reason
            ]
    if not lines:
        return None
    standard = f" from that of {' or '.join(against)}" if against else ""
    return Table(
        name="motions",
        title="Motions",
        caption="The last time that was reached, steps in time and Newton iterations that they took, the largest energy"
        " that was lost or gained by the solver's own account, and the largest root mean square, over the"
        f" surface, of the difference of the displacement{standard}, beside those at the times asked for. Of several"
        " seeds the worst; time is their mean.",
        data=pd.DataFrame(lines).astype({"steps": "Int64", "iterations": "Int64"}),
        columns=(
            Column("Solution", lambda line, notation: notation.code(line["solution"]), right=False),
            Column("Reached (s)", _figure("reached")),
            Column("Steps", cells.count("steps")),
            Column("Iterations", cells.count("iterations")),
            Column("Energy drift (J)", _figure("drift")),
            Column("Largest difference (m)", _figure("largest")),
            Column("at (s)", _figure("largest_at")),
            Column("Differences at the times asked for (m)", _asked, right=False, wide=True),
            Column("Time (s)", cells.seconds),
        ),
        notes=tuple(dict.fromkeys(notes)),
    )


def _course(made: Sequence[Record], case: Portrait, found: Mapping[str, Apart]) -> dict[str, Any]:
    steps = [motion_steps(record) for record in made]
    counted = [step.iterations for of_run in steps for step in of_run if step.iterations is not None]
    differences = [found[record.run_id] for record in made if record.run_id in found]
    worst = max(differences, key=lambda one: one.largest[1], default=None)
    asked: dict[float, float] = {}
    for t in case.states:
        values = [value for one in differences if (value := one.rms.at(t)) is not None]
        asked |= {t: max(values)} if values else {}
    ends = [of_run[-1].at for of_run in steps if of_run]
    ends += [record.series[0].marks[-1] for record in made if record.series and not motion_steps(record)]
    return {
        "reached": min(ends, default=None),
        "steps": max(map(len, steps)) or None,
        "iterations": max((sum(step.iterations or 0 for step in of_run) for of_run in steps if of_run), default=None)
        if counted
        else None,
        "drift": max((abs(step.energy) for of_run in steps for step in of_run), default=None),
        "largest": worst.largest[1] if worst else None,
        "largest_at": worst.largest[0] if worst else None,
        "asked_times": " ".join(f"{t:g}" for t in asked),
        "asked_differences": " ".join(repr(value) for value in asked.values()),
        "seconds": fmean(record.seconds for record in made),
        "run_ids": " ".join(record.run_id for record in made),
    }


def by_time_tables(records: Mapping[str, Record], rows: Sequence[Row]) -> list[Table]:
    """Return, for each case in motion, its quantities grouped by time with a pair of columns for each solver."""
    tables = []
    for (name, _), of_case in grouped(leading_rows(rows), lambda row: (row.case, row.own_case)).items():
        record = next((records[row.run_id] for row in of_case if row.run_id and row.run_id in records), None)
        case = portrait_of(record) if record is not None else None
        if case is not None and case.ends is not None:
            tables.append(_by_time(name, case, of_case))
    return tables


def _by_time(name: str, case: Portrait, rows: Sequence[Row]) -> Table:
    solvers = list(dict.fromkeys(row.solver for row in rows))
    order = {quantity.name: place for place, quantity in enumerate(case.quantities)}
    asked = grouped(sorted(rows, key=lambda row: (row.at or 0.0, order.get(row.quantity, 0))), lambda row: row.quantity)
    lines: list[dict[str, Any]] = []
    for quantity, of_quantity in asked.items():
        first = of_quantity[0]
        judge = next((row for row in of_quantity if row.reference is not None), first)
        line: dict[str, Any] = {
            "block": first.mark,
            "case": name,
            "quantity": quantity,
            "unit": first.unit,
            "at": first.at,
            "reference": judge.reference,
            "reference_uncertainty": judge.reference_uncertainty,
        }
        for solver in solvers:
            line |= _answer(solver, [row for row in of_quantity if row.solver == solver])
        lines.append(line)
    return Table(
        name=f"times_{name}",
        title=f"{case.title}: quantities by time",
        caption="Known values with their uncertainty in the last digits; each solver's mean over its seeds, and the"
        " error of its worst seed, in percent of the known value or, with a unit, as it is. Errors in bold fall short"
        " of what is asked.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Quantity", lambda line, notation: notation.escape(_words(line)), right=False),
            Column("Known value", _known),
            *(
                column
                for solver in solvers
                for column in (Column(solver, _value(solver)), Column("Error", _error(solver)))
            ),
        ),
    )


def _answer(solver: str, rows: Sequence[Row]) -> dict[str, Any]:
    values = [row.value for row in rows if row.value is not None]
    absolute = [row.absolute_error for row in rows if row.absolute_error is not None]
    relative = [row.relative_error for row in rows if row.relative_error is not None]
    words = verdict(rows) if rows else ""
    return {
        f"{solver} value": fmean(values) if values else None,
        f"{solver} error": max(absolute, key=abs, default=None),
        f"{solver} relative error": max(relative, key=abs, default=None),
        f"{solver} verdict": words,
    }


def _words(line: Line) -> str:
    name = str(line["quantity"])
    mark = f"_{1000 * line['at']:g}ms"
    return f"{name.removesuffix(mark).replace('_', ' ')} ({line['unit']})"


def _known(line: Line, notation: Notation) -> str:
    if not present(line["reference"]):
        return notation.missing
    return notation.number(rounded(line["reference"], line["reference_uncertainty"], show_uncertainty=True))


def _value(solver: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        value, error = line[f"{solver} value"], line[f"{solver} error"]
        if not present(value):
            words = str(line[f"{solver} verdict"])
            return notation.escape(words) if words in BAD else notation.missing
        doubts = [abs(error) / 10 if present(error) else 0.0, line["reference_uncertainty"] or 0.0]
        return notation.number(rounded(value, max(d for d in doubts if present(d)) or None))

    return show


def _error(solver: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        relative, absolute = line[f"{solver} relative error"], line[f"{solver} error"]
        if present(relative):
            text = notation.error(relative)
        elif present(absolute):
            unit = notation.escape(str(line["unit"]))
            text = f"{notation.number(rounded(absolute, _last_digit(absolute)))} {unit}"
        else:
            return notation.missing
        return notation.strong(text) if line[f"{solver} verdict"] in (*BAD, EXPECTED) else text

    return show


def _last_digit(value: float) -> float | None:
    """Return an uncertainty that leaves `GLANCE` digits of a value."""
    return abs(value) * 10.0 ** (1 - GLANCE) if value else None


def _figure(name: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        value = line[name]
        if not present(value):
            return notation.missing
        exact = name.endswith(("reached", "at"))
        return notation.number(quoted(float(f"{value:.4g}")) if exact else rounded(value, _last_digit(value)))

    return show


def _asked(line: Line, notation: Notation) -> str:
    times, values = (str(line[name]).split() for name in ("asked_times", "asked_differences"))
    shown = [
        f"{notation.number(rounded(float(value), _last_digit(float(value))))} {notation.escape(f'at {t} s')}"
        for t, value in zip(times, values, strict=True)
    ]
    return "; ".join(shown) or notation.missing
