"""The finding on the published functional of motion: what the solvers' motions say, beside Newton's law.

`shellbench.report.derivation` says what that functional is stationary at, and why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shellbench.bench import catalog
from shellbench.bench.portraits import portrait_of, portrait_of_named
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.portrait import Portrait
from shellbench.report.columns import Line, Show, column, present, significant
from shellbench.report.derivation import DERIVATION, TITLE
from shellbench.report.evidence import Evidence, Section, given
from shellbench.report.exhibit import Exhibit
from shellbench.report.motion_exhibits import TIME
from shellbench.report.moving_fields import yardstick
from shellbench.report.notation import Notation
from shellbench.report.palette import DASHES, inks
from shellbench.report.solutions import STATUS_WORDS, variant_name
from shellbench.report.suites import leading_rows
from shellbench.report.table import Note, Table
from shellbench.report.trace_figure import ClosedForm, TracePanel, trace_figure
from shellbench.report.traces import Trace, TracedRun, traced

Array = NDArray[np.float64]

NEWTON = "newton"  # how names of the figures begin
FINE = 121  # points of a closed form
GREY = "#777777"
WAY = significant(4)  # how a way since rest is written
NOT_RUN = "not run"
STATIONARY = "stationary point of the published functional"
LAW = "Newton’s law, closed form"


def free_fall(case: Portrait, series: str) -> tuple[ClosedForm, ClosedForm] | None:
    """Return the fall by Newton's law, and where the published functional is stationary, in closed form."""
    acceleration, direction, end = case.gravity, case.direction_of(series), case.ends
    if acceleration is None or direction is None or end is None:
        return None
    along = float(acceleration @ direction / np.linalg.norm(direction))
    t = np.linspace(0.0, end, FINE)
    return (
        ClosedForm(LAW, t, along * t**2 / 2),
        ClosedForm(STATIONARY, t, along * (end * t - t**2 / 2), GREY, DASHES[2]),
    )


@dataclass(frozen=True)
class Beside:
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
    forms: tuple[ClosedForm, ...]
    newton: Trace | None
    newton_by: str
    runs: tuple[TracedRun, ...]
    status: Mapping[str, str]
    variants: Mapping[str, str]

    @property
    def name(self) -> str:
        """What tables and figures call it."""
        return f"{self.case.title}: {self.series.replace('_', ' ')}"


def shown_cases() -> dict[str, str]:
    """Return the cases of the finding, as the suites declare them, with the series that is shown of each."""
    return {case: series for name in catalog.suite_names() for case, series in catalog.find_suite(name).newton.items()}


def beside(records: Mapping[str, Record], rows: Sequence[Row]) -> list[Beside]:
    """Return the cases of the finding that anybody was asked to solve, each with what is known of it."""
    found = []
    headline = leading_rows([row for row in rows if row.primary and not row.own_case])
    for name, series in shown_cases().items():
        of_case = [row for row in headline if row.case == name]
        case = _case(name, of_case, records)
        if not of_case or case is None or case.ends is None:
            continue
        runs = [
            (row, run)
            for row in of_case
            if row.run_id
            and row.run_id in records
            and (run := traced(records[row.run_id], case, row.solver))
            and series in run.traces
        ]
        forms = free_fall(case, series) or ()
        standard = yardstick([row for row, _ in runs])
        newton, by = None, NOT_RUN
        if forms:
            newton, by = Trace(forms[0].marks, forms[0].values), "closed form"
        elif standard is not None:
            newton, by = next(run.traces[series] for row, run in runs if row is standard), standard.solver
        unit = next((one.quantity.unit for one in case.along if one.name == series), "m")
        left = {run.name for _, run in runs}
        status = dict.fromkeys(declared_solvers(case), NOT_RUN) | {row.solver: _status(row) for row in of_case}
        found.append(
            Beside(
                case=case,
                series=series,
                unit=unit,
                forms=tuple(forms),
                newton=newton,
                newton_by=by,
                runs=tuple(run for _, run in runs),
                status={solver: words for solver, words in status.items() if solver not in left},
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


def _case(name: str, rows: Sequence[Row], records: Mapping[str, Record]) -> Portrait | None:
    record = next((records[row.run_id] for row in rows if row.run_id and row.run_id in records), None)
    if record is not None:
        return portrait_of(record)
    return portrait_of_named(catalog.named_case(name)) if name in catalog.case_names() else None


def _status(row: Row) -> str:
    return NOT_RUN if row.status == "missing" else STATUS_WORDS.get(row.status, "left no motion")


def section(found: Evidence) -> Section:
    """Return the section of the finding, with its derivation."""
    return Section(
        name=NEWTON,
        title=TITLE,
        tables=given(newton_table(found.records, found.compared)),
        exhibits=found.figures(NEWTON),
        parts=(Section("why", "Why", words=DERIVATION),),
        place="one suite",
    )


def newton_exhibits(records: Mapping[str, Record], rows: Sequence[Row]) -> Iterator[Exhibit]:
    """Yield the figure that sets the cases of the finding side by side."""
    shown = [one for one in beside(records, rows) if one.runs or one.forms]
    if not shown:
        return
    runs = [
        TracedRun(run.name, run.seed, run.run_id, run.reason, {one.case.name: run.traces[one.series]})
        for one in shown
        for run in one.runs
    ]
    panels = [
        TracePanel((one.case.name,), f"{one.series.replace('_', ' ')} ({one.unit})", one.case.title, forms=one.forms)
        for one in shown
    ]
    missing = [f"{one.case.title}: {solver} {words}" for one in shown for solver, words in one.status.items()]
    yield Exhibit(
        name=NEWTON,
        title=TITLE,
        caption="How far the napkin has fallen in free fall, and the height of the centre of mass of the strip and of"
        " the napkin, over time. Black dashes: Newton’s law; grey dots: where the published functional is stationary;"
        " both in closed form." + (f" {'; '.join(missing)}." if missing else ""),
        description="; ".join(_told(one) for one in shown),
        figure=_figure(panels, runs, rows),
        run_ids=tuple(dict.fromkeys(run.run_id for run in runs)),
        drawing=True,
    )


def _figure(panels: Sequence[TracePanel], runs: Sequence[TracedRun], rows: Sequence[Row]) -> Figure:
    return trace_figure(panels, runs, TIME, inks(row.solver for row in rows))


def _told(one: Beside) -> str:
    ends = [f"{run.name} {run.traces[one.series].values[-1]:.3g} {one.unit}" for run in one.runs]
    return f"{one.name}, at the end: {', '.join(ends) or NOT_RUN}"


def newton_table(records: Mapping[str, Record], rows: Sequence[Row]) -> Table | None:
    """Return how far each solver's cloth has moved at half of the time and at its end, beside Newton's law."""
    cases = beside(records, rows)
    solvers = list(dict.fromkeys(name for one in cases for name in (*(run.name for run in one.runs), *one.status)))
    lines: list[dict[str, Any]] = []
    for one in cases:
        assert one.case.ends is not None
        end = one.case.way
        for words, t in (("T/2", end / 2), ("T", end)):
            law = _moved(one.newton, t)
            line: dict[str, Any] = {
                "block": one.name,
                "case": one.case.name,
                "quantity": one.series,
                "unit": one.unit,
                "at": t,
                "when": f"{words} = {t:g} s",
                "newton": law,
                "newton_by": one.newton_by,
                "stationary": _moved(Trace(one.forms[1].marks, one.forms[1].values), t) if one.forms else None,
            }
            for solver in solvers:
                made = [_moved(run.traces[one.series], t) for run in one.runs if run.name == solver]
                values = [value for value in made if value is not None]
                line[solver] = float(np.mean(values)) if values else None
                line[f"{solver} status"] = one.status.get(solver, "" if made else NOT_RUN)
            lines.append(line)
    if not lines:
        return None
    return Table(
        name="newton",
        title="Way since rest",
        caption="How far the point, or the centre of mass, has moved since rest (m), and in brackets its ratio to"
        " Newton’s law; means over seeds.",
        data=pd.DataFrame(lines),
        columns=(
            "when",
            column("newton", "Newton’s law", _law, instead=lambda line, notation: notation.escape(line["newton_by"])),
            column("stationary", "Published functional, stationary", _with_ratio),
            *(column(solver, solver, _with_ratio, instead=_status_of(solver)) for solver in solvers),
        ),
        notes=_remarks(cases),
    )


def _moved(trace: Trace | None, t: float) -> float | None:
    value, rest = (None, None) if trace is None else (trace.at(t), trace.at(0.0))
    return None if value is None or rest is None else value - rest


def _remarks(cases: Sequence[Beside]) -> tuple[Note, ...]:
    variants = [Note(f"{one.case.title}, {name}", words) for one in cases for name, words in one.variants.items()]
    failed = [(one.case.title, run) for one in cases for run in one.runs if run.reason]
    return (*variants, *(Note(f"{title}, {run.name}", f"failed: {run.reason}") for title, run in failed))


def _law(value: Any, line: Line, notation: Notation) -> str:
    return f"{WAY(value, line, notation)} {notation.escape(line['newton_by'])}"


def _with_ratio(value: Any, line: Line, notation: Notation) -> str:
    law = line["newton"]
    return WAY(value, line, notation) + (f" ({value / law:.2f})" if present(law) and law else "")


def _status_of(solver: str) -> Show:
    return lambda line, notation: notation.escape(str(line[f"{solver} status"]))
