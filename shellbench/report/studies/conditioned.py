"""Conditioned fields: one answer for a range of materials against one solve a material, and when it has paid.

Of problems whose portrait tells the material of their figures. The breakeven is how many materials must be asked until
a field's building has been saved: against the cheapest run that spends nothing beforehand and is no worse at its worst
material.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import portrait_of
from shellbench.report.data.columns import Column, column, count, frame, seconds, significant, solution
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, dashes_of
from shellbench.report.data.runs import grouped, solution_name
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table
from shellbench.report.figures import panel

CONDITIONED = "conditioned_"  # how names of figures begin
BEFORE, EACH = "seconds_before", "seconds_each"  # diagnostics of such an answer
SHOWN = 1e-16  # relative: errors below are drawn there
WIDE, HIGH = 6.2, 3.6  # inches
Material = tuple[float, float, float]


@dataclass(frozen=True)
class Conditioned:
    """A solution of one case, all seeds: its errors by quantity, and what it costs.

    Attributes
    ----------
    errors
        Of displacements, relative: the largest over seeds, by quantity.
    derivatives
        Of derivatives by the material, absolute.
    before, each
        Wall time until the first answer, s, and of each answer; means over seeds.
    """

    name: str
    rows: Sequence[Row]
    errors: Mapping[str, float]
    derivatives: Mapping[str, float]
    before: float
    each: float

    @property
    def case(self) -> str:
        """Name of its case."""
        return self.rows[0].case

    @property
    def sure(self) -> bool:
        """True if the run states an uncertainty of every displacement."""
        return all(row.uncertainty is not None for row in self.rows if row.quantity in self.errors)

    @property
    def worst(self) -> float:
        """Largest error of a displacement."""
        return max(self.errors.values())

    @property
    def mean(self) -> float:
        """Mean error of the displacements."""
        return math.fsum(self.errors.values()) / len(self.errors)


def section(found: Evidence) -> Section | None:
    """Return the section; None if no such problem was answered."""
    by_case = grouped(conditioned(found), lambda one: one.case)
    if not by_case:
        return None
    suites = dict.fromkeys(one.rows[0].suite for of_case in by_case.values() for one in of_case)
    names = catalog.suite_names()
    remarks = tuple(text for suite in suites if suite in names for text in catalog.find_suite(suite or "").remarks)
    figures = tuple(exhibit(of_case, found) for of_case in by_case.values())
    return Section("conditioned", "Conditioned fields", remarks, given(table(by_case)), figures, place="its suites")


def conditioned(found: Evidence) -> Iterator[Conditioned]:
    """Yield the solutions of problems that ask for many materials."""
    for of_case in grouped(found.rows, lambda row: row.case).values():
        record = next(
            (found.records[row.run_id] for row in of_case if row.run_id and row.run_id in found.records), None
        )
        portrait = portrait_of(record) if record is not None else None
        if portrait is None or not portrait.materials:
            continue
        good = [row for row in of_case if row.status in ("ok", "not settled") and row.run_id in found.records]
        for name, rows in grouped(good, solution_name).items():
            told = {row.run_id: found.records[row.run_id].diagnostics for row in rows if row.run_id}
            errors = _largest(rows, portrait.materials, lambda row: row.relative_error)
            if errors and all(BEFORE in one and EACH in one for one in told.values()):
                yield Conditioned(
                    name=name,
                    rows=rows,
                    errors=errors,
                    derivatives=_largest(rows, portrait.derivatives, lambda row: row.absolute_error),
                    before=_mean([one[BEFORE] for one in told.values()]),
                    each=_mean([one[EACH] for one in told.values()]),
                )


def _largest(rows: Sequence[Row], names: Any, error: Any) -> dict[str, float]:
    """Return the largest magnitude of an error over runs, by quantity."""
    of = grouped([row for row in rows if row.quantity in names and error(row) is not None], lambda row: row.quantity)
    return {name: max(abs(error(row)) for row in alike) for name, alike in of.items()}


def _mean(numbers: Sequence[float]) -> float:
    return math.fsum(numbers) / len(numbers)


def rival(one: Conditioned, others: Sequence[Conditioned], sure: bool = False) -> Conditioned | None:
    """Return the cheapest solution that spends nothing beforehand and is no worse; None if there is none.

    If `sure`, one that states its own uncertainty.
    """
    fair = [other for other in others if not other.before and other.worst <= one.worst and (other.sure or not sure)]
    return min(fair, key=lambda other: other.each, default=None)


def breakeven(before: float, each: float, other: float) -> int | None:
    """Return from how many answers on a field is cheaper than so many seconds an answer; None if it never is."""
    return math.ceil(before / (other - each)) if other > each else None


def table(by_case: Mapping[str, Sequence[Conditioned]]) -> Table:
    """Return the table of errors, costs and breakevens."""
    lines: list[dict[str, Any]] = []
    for case, solutions in by_case.items():
        for one in solutions:
            line: dict[str, Any] = {"block": one.rows[0].case_title or case, "case": case, "solution": one.name}
            line |= {"seeds": len({row.run_id for row in one.rows}), "worst": one.worst, "mean": one.mean}
            line |= {"derivative": max(one.derivatives.values(), default=None)}
            line |= {"before": one.before or None, "each": one.each}
            if one.before and (other := rival(one, solutions)) is not None:
                # The proof: the surest solve at each held-out material, where no series knows the displacement.
                surest = min((s for s in solutions if not s.before), key=lambda s: s.worst)
                proof = len(one.errors) * surest.each
                line |= {
                    "against": other.name,
                    "breakeven": breakeven(one.before, one.each, other.each),
                    "proven": breakeven(one.before + proof, one.each, other.each),
                }
                if (certain := rival(one, solutions, sure=True)) is not None:
                    line["sure"] = breakeven(one.before, one.each, certain.each)
            lines.append(line)
    columns: tuple[str | Column, ...] = (
        "solution",
        "seeds",
        column("worst", "Worst error", significant(2)),
        column("mean", "Mean error", significant(2)),
        column("derivative", "Of a derivative", significant(2)),
        column("before", "Built in (s)", seconds),
        column("each", "Each answer (s)", significant(2)),
        column("breakeven", "Breakeven", count),
        column("proven", "With its proof", count),
        column("against", "Against", solution),
        column("sure", "Against a sure one", count),
    )
    names = ["block", "case", "solution", "seeds", "worst", "mean", "derivative", "before", "each", "breakeven"]
    return Table(
        name="conditioned",
        title="One field for a range of materials",
        caption="Relative errors at held-out materials, and the largest absolute error of a derivative of the"
        " displacement's logarithm; of several seeds the worst. Breakeven: materials to ask until the field, its"
        " building included, has cost less than a solve each by the cheapest solution that is no worse at its worst"
        " material. With its proof: the solves at all held-out materials by which its error could be known are"
        " counted, too. Against a sure one: the rival must state its own error.",
        data=frame(lines, [*names, "proven", "against", "sure"]),
        columns=columns,
    )


def exhibit(solutions: Sequence[Conditioned], found: Evidence) -> Exhibit:
    """Return the figure of errors over the thickness."""
    row = solutions[0].rows[0]
    portrait = portrait_of(found.records[str(row.run_id)])
    assert portrait is not None
    materials, title = portrait.materials, row.case_title or row.case
    figure, panels = panel.open_figure((WIDE, HIGH))
    dashes, entries = dashes_of(one.name for one in solutions), {}
    for one in solutions:
        by_thickness = sorted((materials[name][0], max(error, SHOWN)) for name, error in one.errors.items())
        ink = found.inks[one.rows[0].solver]
        x, y = zip(*by_thickness, strict=True)
        panel.draw(panels[0, 0], x, y, ink, dashes[one.name])
        entries[one.name] = panel.entry(ink, linestyle=dashes[one.name])
    panel.finish([panels[0, 0]], "thickness (m)", "relative error")
    panel.add_legend(figure, entries, 3)
    return Exhibit(
        name=f"{CONDITIONED}{row.case}",
        title=f"{title}: error over the range of materials",
        caption="Relative error of the displacement at each held-out material, by its thickness; modulus and Poisson's"
        " ratio differ from mark to mark. Of several seeds the largest.",
        description="; ".join(f"{one.name}: at most {one.worst:.1e}" for one in solutions),
        figure=figure,
        run_ids=tuple(dict.fromkeys(str(row.run_id) for one in solutions for row in one.rows)),
    )
