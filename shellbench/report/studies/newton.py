"""The finding on the published functional of motion: what the solvers' motions say, beside Newton's law.

Kairanda et al. 2023, eq. (35), add the kinetic energy to the potential energy and minimise the sum over time: the
inertia has the wrong sign. `DERIVATION` tells at what that sum is stationary, and why it has no motion by Newton's law.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import portrait_of_named
from shellbench.bench.store.record import Record, portrait_of
from shellbench.protocol.picture import Portrait
from shellbench.report.data.columns import Line, Show, column, present, significant
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.notation import Notation
from shellbench.report.data.runs import grouped, leading_rows, variant_name
from shellbench.report.data.section import Formula, Section, given
from shellbench.report.data.solutions import STATUS_WORDS
from shellbench.report.data.table import Note, Table
from shellbench.report.data.traces import Trace, TracedRun, traced, yardstick
from shellbench.report.figures.trace_figure import TracePanel, trace_figure

NEWTON = "newton"  # the section, its figure and its table
TITLE = "Newton’s law and the published functional"
FINE = 121  # points of a closed form
WAY = significant(4)  # how a way since rest is written
NOT_RUN = "not run"
STATIONARY = "stationary point of the published functional"
LAW = "Newton’s law, closed form"
DERIVATION: tuple[str, ...] = (
    (
        "Cloth moves by Newton’s law: areal density times acceleration is the load less the force of the strains. With"
        " the displacement u(ξ, t), the strain energy E(u) and the load f, from rest:"
    ),
    Formula("ρ ü = f − ∂E/∂u,   u(0) = 0,   u̇(0) = 0."),
    (
        "The published loss (Kairanda et al. 2023, eq. (35)) is the mean over space and time of potential energy plus"
        " kinetic energy, and training makes it as small as it can:"
    ),
    Formula("I[u] = ∫₀ᵀ ( E(u) − f·u + ½ ρ |u̇|² ) dt,   u(0) = 0."),
    (
        "(The integral over the surface is left out of the notation.) Vary u by δu with δu(0) = 0 and integrate the"
        " last term by parts:"
    ),
    Formula("δI = ∫₀ᵀ ( ∂E/∂u − f − ρ ü ) · δu dt + ρ u̇(T)·δu(T)."),
    "Nothing is prescribed at the final time T, so that I is stationary only where",
    Formula("ρ ü = ∂E/∂u − f   and   u̇(T) = 0."),
    (
        "The right-hand side is Newton’s with the opposite sign: as if the mass were negative, and with a condition at"
        " the end of time in place of rest at its beginning. The functional of mechanics has the difference,"
        " ½ ρ |u̇|² − E(u) + f·u (Hamilton’s principle), and is stationary at the motion, not minimal: no loss that is"
        " only made smaller finds it. Step by step in time a minimum does exist: what an implicit time integrator"
        " solves is the minimum of E(u) − f·u + (a positive factor) |u − predicted u|², an incremental potential."
    ),
    "Free fall. Nothing holds the napkin and nothing strains it: E = 0, f = ρ g, and the sum is stationary at",
    Formula("ü = −g,   u̇(T) = 0,   u = g (T t − t²/2)   in place of   u = g t²/2."),
    (
        "So it starts at full speed and comes to rest at T, where the two meet. At T/2 it has fallen"
        " (T²/2 − T²/8)/(T²/8) = 3.00 times as far as it should. The published field, u = F(ξ, t) t², starts at rest,"
        " and so can come as near to that motion as its network lets it, but not reach it at t = 0."
    ),
    (
        "Cloth that is held. As long as it moves little, each mode, of frequency ω and static displacement uₛ, swings"
        " by Newton’s law, and creeps by the published one:"
    ),
    Formula("u = uₛ (1 − cos ωt)   becomes   u = uₛ (1 − cosh ω(T − t) / cosh ωT)."),
    (
        "Where ωT is large it goes to its static shape at once, without overshoot and without swinging. Such a drape"
        " looks plausible and is no motion; only figures over time tell the two apart."
    ),
)


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
        Newton's law: its closed form, or the trace of a solver that obeys it.
    newton_by
        Name of this closed form or solver.
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
    def words(self) -> str:
        """Name of the series in words."""
        return self.series.replace("_", " ")

    @property
    def name(self) -> str:
        """Name in tables and figures: the case and the series."""
        return f"{self.case.title}: {self.words}"

    def moved(self, trace: Trace | None, t: float) -> float | None:
        """Return the way since rest; None if the trace does not reach so far."""
        value, rest = (None, None) if trace is None else (trace.at(t), trace.at(0.0))
        return None if value is None or rest is None else value - rest


def shown_cases() -> dict[str, str]:
    """Return the cases of the finding, as the suites declare them, with the series that is shown of each."""
    return {case: series for name in catalog.suite_names() for case, series in catalog.find_suite(name).newton.items()}


def findings(evidence: Evidence) -> list[Finding]:
    """Return the cases of the finding that anybody was asked to solve, each with what is known of it."""
    own = [row for row in evidence.headline if not row.own_case]
    headline = grouped(leading_rows(own), lambda row: row.case)
    asked = ((series, headline[case]) for case, series in shown_cases().items() if case in headline)
    found = (_finding(evidence.records, of_case, series) for series, of_case in asked)
    return [one for one in found if one is not None]


def _finding(records: Mapping[str, Record], rows: Sequence[Row], series: str) -> Finding | None:
    case = _portrait(rows, records)
    if case is None or case.ends is None:
        return None
    kept = ((row, record) for row in rows if (record := records.get(row.run_id or "")) is not None)
    left = ((row, traced(record, case, row.solver)) for row, record in kept)
    made = [(row, run) for row, run in left if run is not None and series in run.traces]
    forms = free_fall(case, series) or ()
    standard = yardstick([row for row, _ in made])
    newton, by = None, NOT_RUN
    if forms:
        newton, by = forms[0], "closed form"
    elif standard is not None:
        newton, by = next(run.traces[series] for row, run in made if row is standard), standard.solver
    why = {"missing": NOT_RUN, "ok": "left no motion"}
    status = dict.fromkeys(declared_solvers(case), NOT_RUN)
    status |= {row.solver: why.get(row.status) or STATUS_WORDS[row.status] for row in rows}
    return Finding(
        case=case,
        series=series,
        unit=next((one.quantity.unit for one in case.along if one.name == series), "m"),
        forms=forms,
        newton=newton,
        newton_by=by,
        runs=tuple(run for _, run in made),
        status={solver: words for solver, words in status.items() if solver not in {run.name for _, run in made}},
        variants={row.solver: words for row, _ in made if (words := variant_name(row))},
    )


def declared_solvers(case: Portrait) -> list[str]:
    """Return the solvers that the suites of a case declare runs of it for."""
    declared = [catalog.find_suite(name) for name in case.suites if name in catalog.suite_names()]
    suites = [suite for suite in declared if suite.study is None]  # a study asks something else of its runs
    runs = [run for suite in suites for run in suite.runs if not run.cases or case.name in run.cases]
    return list(dict.fromkeys(run.solver for run in runs))


def _portrait(rows: Sequence[Row], records: Mapping[str, Record]) -> Portrait | None:
    record = next((records[row.run_id] for row in rows if row.run_id and row.run_id in records), None)
    if record is not None:
        return portrait_of(record)
    name = rows[0].case
    return portrait_of_named(catalog.named_case(name)) if name in catalog.case_names() else None


def section(found: Evidence) -> Section:
    """Return the section of the finding, with its derivation."""
    return Section(
        name=NEWTON,
        title=TITLE,
        tables=given(newton_table(found)),
        exhibits=found.figures(NEWTON),
        parts=(Section("why", "Why", words=DERIVATION),),
        place="one suite",
    )


def newton_exhibits(evidence: Evidence) -> Iterator[Exhibit]:
    """Yield the figure that sets the cases of the finding side by side."""
    shown = [one for one in findings(evidence) if one.runs or one.forms]
    if not shown:
        return
    runs = [
        TracedRun(run.name, run.seed, run.run_id, run.reason, {one.case.name: run.traces[one.series]})
        for one in shown
        for run in one.runs
    ]
    panels = [
        TracePanel(
            (one.case.name,),
            f"{one.words} ({one.unit})",
            title=one.case.title,
            forms=dict(zip((LAW, STATIONARY), one.forms, strict=False)),
        )
        for one in shown
    ]
    missing = [f"{one.case.title}: {solver} {words}" for one in shown for solver, words in one.status.items()]
    yield Exhibit(
        name=NEWTON,
        title=TITLE,
        caption="How far the napkin has fallen in free fall, and the height of the centre of mass of the strip and of"
        " the napkin, over time. Black dashes: Newton’s law; grey dots: where the published functional is stationary;"
        " both in closed form." + (f" {'; '.join(missing)}." if missing else ""),
        description="; ".join(
            f"{one.name}, at the end: "
            + (", ".join(f"{r.name} {r.traces[one.series].values[-1]:.3g} {one.unit}" for r in one.runs) or NOT_RUN)
            for one in shown
        ),
        figure=trace_figure(panels, runs, evidence.inks),
        run_ids=tuple(dict.fromkeys(run.run_id for run in runs)),
    )


def newton_table(evidence: Evidence) -> Table | None:
    """Return the table of distances that each solver's cloth moved by half time and by the end, with Newton's law."""
    cases = findings(evidence)
    if not cases:
        return None
    solvers = list(dict.fromkeys(name for one in cases for name in (*(run.name for run in one.runs), *one.status)))
    variants = [Note(f"{one.case.title}, {name}", words) for one in cases for name, words in one.variants.items()]
    failed = [(one.case.title, run) for one in cases for run in one.runs if run.reason]
    return Table(
        name=NEWTON,
        title="Way since rest",
        caption="How far the point, or the centre of mass, has moved since rest (m), and in brackets its ratio to"
        " Newton’s law; means over seeds.",
        data=pd.DataFrame([_line(one, half, solvers) for one in cases for half in (True, False)]),
        columns=(
            "when",
            column("newton", "Newton’s law", _law, instead=lambda line, notation: notation.escape(line["newton_by"])),
            column("stationary", "Published functional, stationary", _with_ratio),
            *(column(solver, solver, _with_ratio, instead=_status_of(solver)) for solver in solvers),
        ),
        notes=(*variants, *(Note(f"{title}, {run.name}", f"failed: {run.reason}") for title, run in failed)),
    )


def _line(one: Finding, half: bool, solvers: Sequence[str]) -> dict[str, Any]:
    t = one.case.way / 2 if half else one.case.way
    line: dict[str, Any] = {
        "block": one.name,
        "case": one.case.name,
        "quantity": one.series,
        "unit": one.unit,
        "at": t,
        "when": f"{'T/2' if half else 'T'} = {t:g} s",
        "newton": one.moved(one.newton, t),
        "newton_by": one.newton_by,
        "stationary": one.moved(one.forms[1], t) if one.forms else None,
    }
    for solver in solvers:
        made = [one.moved(run.traces[one.series], t) for run in one.runs if run.name == solver]
        reached = [value for value in made if value is not None]
        line[solver] = float(np.mean(reached)) if reached else None
        line[f"{solver} status"] = one.status.get(solver, "" if made else NOT_RUN)
    return line


def _law(value: Any, line: Line, notation: Notation) -> str:
    return f"{WAY(value, line, notation)} {notation.escape(line['newton_by'])}"


def _with_ratio(value: Any, line: Line, notation: Notation) -> str:
    law = line["newton"]
    return WAY(value, line, notation) + (f" ({value / law:.2f})" if present(law) and law else "")


def _status_of(solver: str) -> Show:
    return lambda line, notation: notation.escape(str(line[f"{solver} status"]))
