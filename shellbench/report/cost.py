"""The section on convergence and cost: what an answer of a given accuracy takes, in unknowns, seconds and memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pandas as pd

from shellbench.report.accuracy import CaseAccuracy, Measure, accuracies
from shellbench.report.cost_figure import MEASURES, cost_figure
from shellbench.report.digits import byte_size, duration, percent
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import MINUS, TEXT, Notation
from shellbench.report.palette import inks, style
from shellbench.report.provenance import makings
from shellbench.report.rates import FEWEST
from shellbench.report.studies import remarks_on
from shellbench.report.table import Column, Line, Note, Show, Table, present

LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)
TITLES: dict[Measure, str] = {
    "unknowns": "Unknowns at a stated error",
    "seconds": "Seconds at a stated error",
    "memory": "Peak memory at a stated error",
}
WHAT: dict[Measure, str] = {
    "unknowns": "Fewest unknowns",
    "seconds": "Least wall time of the solve, s,",
    "memory": "Least peak memory of the solve, above what the process held before,",
}
WRITTEN: dict[Measure, Callable[[float], str]] = {
    "unknowns": lambda cost: str(round(cost)),
    "seconds": duration,
    "memory": byte_size,
}
RULE = (
    "with which the headline quantity is within the given error for every seed and in all finer runs of the same sweep,"
    " the uncertainty of the known value counted against it. The exponent is that of a power law fitted to the finest"
    " sizes of the longest sweep whose error lies above that uncertainty and still falls; for fields it describes the"
    " runs and is no asymptotic order. None is given where what it took less than doubled over these sizes."
)


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite studied the resolution of any case."""
    found = accuracies(evidence.records, evidence.rows)
    if not found:
        return None
    colours = inks(row.solver for row in evidence.rows)
    with style():
        exhibits = tuple(
            Exhibit(
                name=f"cost_{one.case}",
                title=f"{one.title}: error and cost",
                caption=_caption(one),
                description=_description(one),
                figure=cost_figure(one, colours),
                run_ids=_run_ids(one),
                drawing=True,
            )
            for one in found
        )
    return Section(
        name="cost",
        title="Convergence and cost",
        words=(
            "What an answer takes, by each solver: the relative error of a case's headline quantity against unknowns,"
            " wall time and memory. Errors are relative to the known value of the case; where none is known, to the"
            " best answer; those of a position, to the extent of the shell. The figure says so.",
            "Seconds are wall time of the solve alone, on a machine that may have had other work: compare them within"
            " one environment only, and as factors rather than digits. Memory is the largest resident memory of the"
            " process less what it held before the solve; below about 10 MB it tells of the libraries alone.",
            *remarks_on(evidence.rows, "resolution"),
        ),
        tables=tuple(cost_table(found, measure, environments(evidence)) for measure in MEASURES),
        exhibits=exhibits,
    )


def environments(evidence: Evidence) -> dict[str, int]:
    """Return the number of each run's environment, as the page counts them."""
    return {making.record.run_id: making.environment for making in makings(evidence.records, evidence.rows)[0]}


def cost_table(found: Sequence[CaseAccuracy], measure: Measure, environment: Mapping[str, int]) -> Table:
    """Return the table of what each solver takes to be within each of `LEVELS`."""
    lines: list[dict[str, Any]] = []
    for one in found:
        for solver in one.solvers:
            families, floor = one.of(solver), one.yardstick.floor
            rate, order = families[0].rate(measure, floor), families[0].order(floor)
            runs = [run_id for family in families for point in family.points for run_id in point.run_ids]
            line: dict[str, Any] = {"block": one.title, "case": one.case, "solver": solver}
            for level in LEVELS:
                ways = [way for family in families if (way := family.cheapest(level, floor, measure))]
                cost, point = min(ways, key=lambda way: way[0], default=(None, None))
                line |= {f"to_{level:g}": cost, f"runs_{level:g}": " ".join(point.run_ids) if point else ""}
            line |= {
                "exponent": rate.slope if rate else None,
                "order": order if measure == "unknowns" else None,
                "environment": ", ".join(map(str, sorted({environment[run] for run in runs if run in environment}))),
            }
            lines.append(line)
    of_measure = {
        "unknowns": (Column("Order in h", _figure("order")),),
        "seconds": (Column("Environment", lambda line, notation: notation.escape(line["environment"])),),
        "memory": (),
    }
    return Table(
        name=f"cost_{measure}",
        title=TITLES[measure],
        caption=f"{WHAT[measure]} {RULE}",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            *(Column(f"{100 * level:g} %", _cost(level, measure)) for level in LEVELS),
            Column("Exponent", _figure("exponent")),
            *of_measure[measure],
        ),
        notes=tuple(_notes(found)),
    )


def _notes(found: Sequence[CaseAccuracy]) -> list[Note]:
    notes = []
    for one in found:
        if one.yardstick.run_id:
            notes.append(Note(one.title, f"errors are against {one.yardstick.words}."))
        for solver, reasons in one.failed.items():
            runs = f"{len(reasons)} runs" if len(reasons) > 1 else "one run"
            first = f"; the first, {reasons[0]}" if len(reasons) > 1 else f", {reasons[0]}"
            notes.append(Note(f"{one.title}, {solver}", f"{runs} failed and reached nothing{first}"))
    return notes


def _cost(level: float, measure: Measure) -> Show:
    def show(line: Line, notation: Notation) -> str:
        cost = line[f"to_{level:g}"]
        return notation.escape(WRITTEN[measure](cost)) if present(cost) else notation.missing

    return show


def _figure(name: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        value = line[name]
        return notation.escape(f"{value:.1f}".replace("-", MINUS)) if present(value) else notation.missing

    return show


def _caption(one: CaseAccuracy) -> str:
    rates = (
        "Numbers at the right: slopes fitted to the finest sizes of each solver's longest sweep at which errors still"
        " fall, drawn dashed below (a field's errors follow no power law for long)."
    )
    level = any(
        len(family.points) >= FEWEST and len({point.unknowns for point in family.points}) == 1
        for family in one.families
    )
    steps = " Dotted: a sweep that leaves the unknowns as they are, as over the time step." if level else ""
    return (
        f"Error of the {one.quantity} against unknowns, wall time and peak memory of the solve (above what the process"
        f" held before). Errors are against {one.yardstick.words}. A mark is one size: with several seeds the"
        f" geometric mean, with a bar from the least to the largest. {rates}{steps}"
    )


def _description(one: CaseAccuracy) -> str:
    best = []
    for solver in one.solvers:
        error = min((point.error for family in one.of(solver) for point in family.points if point.sound), default=None)
        best.append(
            f"{solver} down to {TEXT.number(percent(error, signed=False))} %"
            if error is not None
            else f"{solver} failed"
        )
    return f"{one.title}, relative error of the {one.quantity}: {'; '.join(best)}"


def _run_ids(one: CaseAccuracy) -> tuple[str, ...]:
    points = [run_id for family in one.families for point in family.points for run_id in point.run_ids]
    return tuple(dict.fromkeys([*points, *(course.run_id for course in one.refinements)]))
