"""Chains: steps a second against how many there are, by what records say of their own time.

A record's history tells the steps of each level of refinement, and when it ended. What is counted is the last level,
so that nothing is counted that compiles or imports. No verdict hangs on it: seconds are of the wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from shellbench.bench.catalogue.suite import Study
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.report.data.columns import column, frame, significant, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Dashes, Exhibit
from shellbench.report.data.runs import grouped, rows_of_study
from shellbench.report.data.table import Table
from shellbench.report.figures import panel

STUDY: Study = "speed"
SPEED = "speed_of_chains"  # name of the figure and the table
WIDTH, HEIGHT, ENTRY = 4.6, 3.1, 0.18  # inches of the figure, of it without its legend, and of a line of that
DIGITS = 2


@dataclass(frozen=True)
class Pace:
    """Steps a second of one run: of how many chains, and links of each, by whom, and on how many threads."""

    case: str
    title: str
    chains: int
    links: int
    solver: str
    label: str
    threads: int
    steps: float
    error: str
    run_id: str

    @property
    def name(self) -> str:
        """Name of the curve in legends: solver, label and threads."""
        threads = f"{self.threads} threads" if self.threads > 1 else ""
        return ", ".join(filter(None, (self.solver, self.label, threads)))

    @property
    def all_links(self) -> int:
        """Links of all chains."""
        return self.chains * self.links


def paces(found: Evidence) -> list[Pace]:
    """Return the paces of the study's runs, one for each."""
    seen = {row.run_id: row for row in rows_of_study(found.rows, STUDY) if row.primary and row.value is not None}
    return [pace for run_id, row in seen.items() if (pace := pace_of(found.records.get(run_id or ""), row))]


def pace_of(record: Record | None, row: Row) -> Pace | None:
    """Return the pace of a run; None if it is of no chains, or tells no steps."""
    steps = steps_a_second(record) if record is not None else None
    portrait = portrait_of(record) if record is not None else None
    if record is None or steps is None or portrait is None or portrait.chains is None:
        return None
    return Pace(
        row.case,
        row.case_title or row.case,
        *portrait.chains,
        row.solver,
        row.label,
        record.environment.threads,
        steps,
        "" if row.absolute_error is None else f"{abs(row.absolute_error):.1e} {row.unit}".strip(),
        record.run_id,
    )


def steps_a_second(record: Record) -> float | None:
    """Return the steps over the seconds of the last level of refinement; None of what tells no steps."""
    levels = record.history
    if len(levels) < 2 or not levels[-1].iterations:
        return None
    seconds = levels[-1].seconds - levels[-2].seconds
    return levels[-1].iterations / seconds if seconds > 0 else None


def speed_exhibit(found: Evidence, counted: Sequence[Pace]) -> Exhibit:
    """Return the figure: steps a second against chains times links."""
    return Exhibit(
        name=SPEED,
        title="Steps a second against chains and links",
        caption="Steps in time a second of the wall, of all chains at once, against the links of all chains, as runs"
        " had them in their finest solve; runs beside each other share cores. The table has chains and links.",
        description="; ".join(f"{p.name}, {p.chains} x {p.links}: {p.steps:.2g} a second" for p in counted),
        figure=speed_figure(found, counted),
        run_ids=tuple(pace.run_id for pace in counted),
    )


def speed_figure(found: Evidence, counted: Sequence[Pace]) -> Figure:
    """Draw a curve for each solver and label."""
    names = {pace.name for pace in counted}
    figure, panels = panel.open_figure((WIDTH, HEIGHT + ENTRY * len(names)))
    axes, entries = panels[0, 0], {}
    for of_solver in grouped(counted, lambda pace: pace.solver).values():
        for place, (name, curve) in enumerate(grouped(of_solver, lambda pace: pace.name).items()):
            dashes: Dashes = DASHES[place % len(DASHES)]
            ordered, ink = sorted(curve, key=lambda pace: pace.all_links), found.inks[curve[0].solver]
            panel.draw(axes, [p.all_links for p in ordered], [p.steps for p in ordered], ink, dashes)
            entries[name] = panel.entry(ink, linestyle=dashes)
    panel.finish([axes], "chains x links (links of all chains)", "steps a second (1/s)")
    panel.add_legend(figure, entries, most=1)  # two names with threads are broader than the figure
    return figure


def speed_table(counted: Sequence[Pace]) -> Table:
    """Return the table of the same figures."""
    lines: list[dict[str, Any]] = [
        {
            "block": f"{pace.title}: {pace.chains} x {pace.links}",
            "case": pace.case,
            "solution": pace.name,
            "pace": pace.steps,
            "link_pace": pace.steps * pace.all_links,
            "error": pace.error,
        }
        for of_case in grouped(counted, lambda pace: pace.case).values()
        for pace in of_case
    ]
    way = significant(DIGITS)
    return Table(
        name=SPEED,
        title="Steps a second",
        caption="Steps in time a second of the wall, of all chains at once, and that times all links; by how"
        " much the headline figure is off.",
        data=frame(lines, ["block", "case", "solution", "pace", "link_pace", "error"]),
        columns=(
            column("solution", "Solver", words, right=False),
            column("pace", "Steps a second", way),
            column("link_pace", "Links a second", way),
            column("error", "Off by", words),
        ),
    )
