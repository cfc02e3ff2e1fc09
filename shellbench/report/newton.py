"""The finding on the published functional of motion: what the solvers' motions say, beside Newton's law.

`shellbench.report.derivation` says what that functional is stationary at, and why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from shellbench.bench import catalog
from shellbench.bench.kinds import portrait_of, portrait_of_named
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait
from shellbench.report.derivation import TITLE
from shellbench.report.digits import rounded
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import Notation
from shellbench.report.palette import inks
from shellbench.report.solutions import STATUS_WORDS, variant_name
from shellbench.report.suites import leading_rows
from shellbench.report.table import Column, Line, Note, Show, Table, present
from shellbench.report.trace_figure import TracePanel, trace_figure
from shellbench.report.traces import Trace, TracedRun, traced, yardstick

NEWTON = "newton"  # how names of the figures begin
FINE = 121  # points of a closed form
NOT_RUN = "not run"
HALF_AND_END = (("T/2", 0.5), ("T", 1.0))  # shares of the time, and what a line calls them
STATIONARY = "stationary point of the published functional"
LAW = "Newton’s law, closed form"


def free_fall(case: Portrait, series: str) -> tuple[Trace, Trace] | None:
    """Return the fall by Newton's law, and where the published functional is stationary, in closed form."""
    acceleration, direction, end = case.gravity, case.direction_of(series), case.ends
    if acceleration is None or direction is None or end is None:
        return None
    along = float(acceleration @ direction / np.linalg.norm(direction))
    t = np.linspace(0.0, end, FINE)
    return Trace(t, along * t**2 / 2), Trace(t, along * (end * t - t**2 / 2))


@dataclass(frozen=True)
class Finding:
    """One case of the finding.

    Attributes
    ----------
    series
        The series that is shown.
    forms
        Newton's law and the published functional in closed form, where there is one.
    newton
        What stands for Newton's law: its closed form, or the trace of the solver that is held against.
    newton_by
        What that is.
    runs
        The others' traces; `status` says by solver why there is none.
    variants
        By solver: how its run departs from the solver's defaults, where it does.
    """

    case: Portrait
    series: str
    unit: str
    forms: tuple[Trace, ...]
    newton: Trace | None
    newton_by: str
    runs: tuple[TracedRun, ...]
    status: Mapping[str, str]
    variants: Mapping[str, str]

    @property
    def what(self) -> str:
        """What is shown, in words."""
        return self.series.replace("_", " ")


def shown_cases() -> dict[str, str]:
    """Return the cases of the finding, as the suites declare them, with the series that is shown of each."""
    return {case: series for name in catalog.suite_names() for case, series in catalog.find_suite(name).newton.items()}


def findings(records: Mapping[str, Record], rows: Sequence[Row]) -> list[Finding]:
    """Return the cases of the finding that anybody was asked to solve, each with what is known of it."""
    found = []
    headline = leading_rows([row for row in rows if row.primary and not row.own_case])
    for name, series in shown_cases().items():
        of_case = [row for row in headline if row.case == name]
        made = [(row, records[row.run_id]) for row in of_case if row.run_id and row.run_id in records]
        case = portrait_of(made[0][1]) if made else _declared(name) if of_case else None
        if case is None or case.ends is None:
            continue
        left = [(row, run) for row, record in made if (run := traced(record, case, row.solver))]
        runs = [(row, run) for row, run in left if series in run.traces]
        forms = free_fall(case, series) or ()
        standard = yardstick([row for row, _ in runs])
        newton, by = None, NOT_RUN
        if forms:
            newton, by = forms[0], "closed form"
        elif standard is not None:
            newton, by = next(run.traces[series] for row, run in runs if row is standard), standard.solver
        status = dict.fromkeys(declared_solvers(case), NOT_RUN) | {row.solver: _status(row) for row in of_case}
        solved = {row.solver for row, _ in runs}
        found.append(
            Finding(
                case=case,
                series=series,
                unit=next((one.quantity.unit for one in case.along if one.name == series), "m"),
                forms=forms,
                newton=newton,
                newton_by=by,
                runs=tuple(run for _, run in runs),
                status={solver: words for solver, words in status.items() if solver not in solved},
                variants={row.solver: words for row, _ in runs if (words := variant_name(row))},
            )
        )
    return found


def declared_solvers(case: Portrait) -> list[str]:
    """Return the solvers that the suites of a case declare runs of it for."""
    declared = [catalog.find_suite(name) for name in case.suites if name in catalog.suite_names()]
    suites = [suite for suite in declared if suite.study is None]  # a study asks something else of its runs
    runs = [run for suite in suites for run in suite.runs if not run.cases or case.name in run.cases]
    return list(dict.fromkeys(run.solver for run in runs))


def _declared(name: str) -> Portrait | None:
    return portrait_of_named(catalog.named_case(name)) if name in catalog.case_names() else None


def _status(row: Row) -> str:
    return NOT_RUN if row.status == "missing" else STATUS_WORDS.get(row.status, "left no motion")


def newton_exhibits(records: Mapping[str, Record], rows: Sequence[Row]) -> Iterator[Exhibit]:
    """Yield the figure that sets the cases of the finding side by side."""
    shown = [one for one in findings(records, rows) if one.runs or one.forms]
    if not shown:
        return
    runs = [  # each case is a panel of its own
        TracedRun(run.name, run.seed, run.run_id, run.reason, {one.case.name: run.traces[one.series]})
        for one in shown
        for run in one.runs
    ]
    panels = [
        TracePanel(
            (one.case.name,),
            f"{one.what} ({one.unit})",
            title=one.case.title,
            forms=dict(zip((LAW, STATIONARY), one.forms, strict=False)),
        )
        for one in shown
    ]
    missing = [f"{one.case.title}: {solver} {words}" for one in shown for solver, words in one.status.items()]
    ends = [
        ", ".join(f"{run.name} {run.traces[one.series].values[-1]:.3g} {one.unit}" for run in one.runs) or NOT_RUN
        for one in shown
    ]
    yield Exhibit(
        name=NEWTON,
        title=TITLE,
        caption="How far the napkin has fallen in free fall, and the height of the centre of mass of the strip and of"
        " the napkin, over time. Black dashes: Newton’s law; grey dots: where the published functional is stationary;"
        " both in closed form." + (f" {'; '.join(missing)}." if missing else ""),
        description="; ".join(
            f"{one.case.title}: {one.what}, at the end: {end}" for one, end in zip(shown, ends, strict=True)
        ),
        figure=trace_figure(panels, runs, inks(row.solver for row in rows)),
        run_ids=tuple(dict.fromkeys(run.run_id for run in runs)),
        drawing=True,
    )


def newton_table(records: Mapping[str, Record], rows: Sequence[Row]) -> Table | None:
    """Return how far each solver's cloth has moved at half of the time and at its end, beside Newton's law."""
    cases = findings(records, rows)
    solvers = list(dict.fromkeys(name for one in cases for name in (*(run.name for run in one.runs), *one.status)))
    lines = [_line(one, solvers, words, share * one.case.way) for one in cases for words, share in HALF_AND_END]
    if not lines:
        return None
    notes = [Note(f"{one.case.title}, {name}", words) for one in cases for name, words in one.variants.items()]
    failed = [(one.case.title, run) for one in cases for run in one.runs if run.reason]
    notes += [Note(f"{title}, {run.name}", f"failed: {run.reason}") for title, run in failed]
    return Table(
        name="newton",
        title="Way since rest",
        caption="How far the point, or the centre of mass, has moved since rest (m), and in brackets its ratio to"
        " Newton’s law; means over seeds.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Time", lambda line, notation: notation.escape(str(line["when"])), right=False),
            Column("Newton’s law", _law),
            Column("Published functional, stationary", _ratio("stationary")),
            *(Column(solver, _ratio(solver)) for solver in solvers),
        ),
        notes=tuple(notes),
    )


def _line(one: Finding, solvers: Sequence[str], words: str, t: float) -> dict[str, Any]:
    line: dict[str, Any] = {
        "block": f"{one.case.title}: {one.what}",
        "case": one.case.name,
        "quantity": one.series,
        "unit": one.unit,
        "at": t,
        "when": f"{words} = {t:g} s",
        "newton": _moved(one.newton, t),
        "newton_by": one.newton_by,
        "stationary": _moved(one.forms[1], t) if one.forms else None,
    }
    for solver in solvers:
        made = [_moved(run.traces[one.series], t) for run in one.runs if run.name == solver]
        values = [value for value in made if value is not None]
        line[solver] = float(np.mean(values)) if values else None
        line[f"{solver} status"] = one.status.get(solver, "" if made else NOT_RUN)
    return line


def _moved(trace: Trace | None, t: float) -> float | None:
    value, rest = (None, None) if trace is None else (trace.at(t), trace.at(0.0))
    return None if value is None or rest is None else value - rest


def _law(line: Line, notation: Notation) -> str:
    by = notation.escape(str(line["newton_by"]))
    return f"{_number(line['newton'], notation)} {by}" if present(line["newton"]) else by


def _ratio(name: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        value, law = line[name], line["newton"]
        if not present(value):
            words = str(line.get(f"{name} status", ""))
            return notation.escape(words) if words else notation.missing
        ratio = f" ({value / law:.2f})" if present(law) and law else ""
        return _number(value, notation) + ratio

    return show


def _number(value: float, notation: Notation) -> str:
    return notation.number(rounded(value, abs(value) * 1e-3 or None))
