"""Editing: an edited problem from the earlier solution and from scratch, by what both took on the same machine.

The section covers problems whose portrait names an edit. It compares both with their stated errors, and at the time
at which their certified energies are equally low.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import portrait_of
from shellbench.report.data.columns import Column, column, count, frame, significant, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.runs import grouped, solution_name
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table

FIGURES = ("seconds", "seconds_to_energy", "steps", "unknowns", "energy")  # diagnostics, by way
WAYS = ("scratch", "start")


def section(found: Evidence) -> Section | None:
    """Return the section; None if no edited problem was answered."""
    lines = list(_lines(found))
    if not lines:
        return None
    suites = dict.fromkeys(line.pop("suite") for line in lines)
    remarks = tuple(
        text for suite in suites if suite in catalog.suite_names() for text in catalog.find_suite(suite).remarks
    )
    return Section("editing", "Editing", remarks, given(table(lines)), place="its suites")


def _lines(found: Evidence) -> Iterator[dict[str, Any]]:
    for case, of_case in grouped(found.rows, lambda row: row.case).items():
        good = [row for row in of_case if row.primary and row.run_id in found.records]
        good = [row for row in good if row.status in ("ok", "not settled")]
        portrait = portrait_of(found.records[str(good[0].run_id)]) if good else None
        if portrait is None or portrait.edit is None:
            continue
        for name, rows in grouped(good, solution_name).items():
            told = [found.records[str(row.run_id)].diagnostics for row in rows]
            yield line(rows, case, name, portrait.edit, told)


def line(rows: list[Row], case: str, name: str, edit: str, told: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return one line of the table: means over seeds, and ratios of means."""
    mean = {f"{key}_{way}": _mean(told, f"{key}_{way}") for key in FIGURES for way in WAYS}
    energies = [mean["energy_scratch"], mean["energy_start"]]
    apart = None
    if energies[0] and energies[1] is not None:
        apart = (energies[1] - energies[0]) / abs(energies[0])
    errors = [abs(row.relative_error) for row in rows if row.relative_error is not None]
    return {
        "block": rows[0].case_title or case,
        "case": case,
        "suite": rows[0].suite,
        "solution": name,
        "edit": edit,
        **mean,
        "ratio": ratio(mean["seconds_scratch"], mean["seconds_start"]),
        "ratio_to_energy": ratio(mean["seconds_to_energy_scratch"], mean["seconds_to_energy_start"]),
        "gap": apart,
        "apart": max((float(one["apart"]) for one in told), default=None),
        "error": max(errors, default=None),
    }


def ratio(scratch: float | None, start: float | None) -> float | None:
    """Return the ratio of the seconds from scratch to those from a start; None if either never became as accurate."""
    return scratch / start if scratch is not None and start else None


def _mean(told: Sequence[Mapping[str, Any]], key: str) -> float | None:
    values = [one.get(key) for one in told]
    return None if None in values or not values else fmean(float(value) for value in values if value is not None)


def table(lines: list[dict[str, Any]]) -> Table:
    """Return the table of edits."""
    columns: tuple[str | Column, ...] = (
        "solution",
        column("edit", "Edit", words),
        column("seconds_scratch", "From scratch (s)", significant(3)),
        column("seconds_start", "From the start (s)", significant(3)),
        column("ratio", "Ratio", significant(2)),
        column("seconds_to_energy_scratch", "To equal energy, from scratch (s)", significant(3)),
        column("seconds_to_energy_start", "From the start (s)", significant(3)),
        column("ratio_to_energy", "Ratio", significant(2)),
        column("steps_scratch", "Systems, from scratch", count),
        column("steps_start", "From the start", count),
        column("gap", "Energy above scratch", significant(2)),
        column("error", "Error", significant(2)),
    )
    names = ["block", "case", "solution", "edit", "ratio", "ratio_to_energy", "gap", "apart", "error"]
    return Table(
        name="editing",
        title="Edits, from the earlier solution and from scratch",
        caption="Processor seconds of one thread, both ways in one process. A ratio says how many times faster the"
        " earlier solution makes the edit. First come whole solves, with what they state of their errors. Then come the"
        " times until the certified potential energy was as low as that of both answers, but for the share"
        " that the case allows. Systems: linear systems solved for the answer, Newton steps among them,"
        " without those of trials that"
        " share out cells. Energy above scratch: of the answer from the start, relative. Error: of the answer from the"
        " start, against the known value.",
        data=frame(lines, [*names, *(f"{key}_{way}" for key in FIGURES for way in WAYS)]),
        columns=columns,
    )
