"""Passports: which stiffness each solver simulates, and the master curve of the heavy cantilever with all on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.passport import PROPERTIES, SUITE
from shellbench.bench.judge.row import Row
from shellbench.report.data.columns import Line, at_most, column, frame, present, significant, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.notation import Notation, rounded
from shellbench.report.data.runs import grouped
from shellbench.report.data.section import Section
from shellbench.report.data.table import Table
from shellbench.report.figures import panel
from shellbench.report.studies.stiffnesses import Entry, elastica, gamma_of, passport

CURVE = "master_curve"
LEAST, ROUNDING = 1e-5, 1e-9  # of a ratio: the last digit that is shown, and a doubt that says nothing
FIRST = next(one.case for one in PROPERTIES if one.rule == "hanging")
HANGING = [one for one in PROPERTIES if one.rule == "hanging" and one.case == FIRST]
SIZE = (4.6, 3.4)  # inches
TIPS = [0.44 - 0.02 * 1.36**k for k in range(24)]  # logarithms of the tip's angle along the curve


def section(found: Evidence) -> Section | None:
    """Return the section; None if nothing of the suite was run."""
    rows = [row for row in found.rows if row.suite == SUITE]
    if not rows:
        return None
    return Section(
        "passport",
        "Passports",
        catalog.find_suite(SUITE).remarks,
        (table(rows),),
        tuple(exhibit for exhibit in (curve_exhibit(found, rows),) if exhibit is not None),
        place="its suites",
    )


def table(rows: Sequence[Row]) -> Table:
    """Return the table of passports, a block for each solver."""
    lines = [
        line(solver, entry)
        for solver, of_solver in grouped(rows, lambda row: row.solver).items()
        for entry in passport(of_solver)
        if entry.ratio is not None or entry.others or entry.reason
    ]
    return Table(
        name=SUITE,
        title="Passports",
        caption="What each solver really simulates, as a multiple of what it was given: on its finest mesh, with what"
        " it states of its error there, or else the change from its next coarser mesh. Beside it stand other settings,"
        " such as other cuts of the cells.",
        data=frame(lines, ["block", "property", "nominal", "unit", "ratio", "doubt", "others"]),
        columns=(
            column("property", "Property", words, right=False),
            column("nominal", "The material's", at_most(6)),
            column("unit", "Unit", words, right=False),
            column("ratio", "Ratio", _ratio),
            column("doubt", "Uncertain by", _doubt),
            column("others", "By other settings", words, right=False),
        ),
        suite=SUITE,
    )


def _ratio(value: Any, line: Line, notation: Notation) -> str:
    doubt = line["doubt"]
    return notation.number(rounded(value, max(doubt, LEAST) if present(doubt) else LEAST))


def _doubt(value: Any, line: Line, notation: Notation) -> str:
    return significant(2)(value, line, notation) if value > ROUNDING else f"below {ROUNDING:g}"


def line(solver: str, entry: Entry) -> dict[str, Any]:
    """Return a line of the table."""
    others = "; ".join(f"{said}: {ratio:.4g}" for said, ratio in entry.others.items())
    return {
        "block": solver,
        "property": entry.of.words,
        "nominal": entry.nominal,
        "unit": entry.of.unit,
        "ratio": entry.ratio,
        "doubt": entry.doubt,
        "others": others or entry.reason,
    }


def curve_exhibit(found: Evidence, rows: Sequence[Row]) -> Exhibit | None:
    """Return the figure: H / W against Gamma, the elastica's curve and what solvers have; None if none has any."""
    marks = [mark for mark in _marks(rows) if mark[2] > 0]
    if not marks:
        return None
    said = "; ".join(f"{solver}, Gamma {gamma:.4g}: {shape:.5g}" for solver, gamma, shape, _ in marks)
    return Exhibit(
        name=f"{CURVE}_{FIRST}",
        title="The heavy cantilever's master curve",
        caption="Drop H over reach W of a strip that is clamped level and hangs under its own weight, against Gamma ="
        " q L^3 / B: the inextensible elastica (line), and each solver where it was asked. A mark above the curve is a"
        " solver that is too soft.",
        description=said,
        figure=curve_figure(found, marks),
        run_ids=tuple(dict.fromkeys(run_id for *_, run_id in marks)),
    )


def _marks(rows: Sequence[Row]) -> list[tuple[str, float, float, str]]:
    """Return solver, Gamma, H / W and run of each strip that hangs."""
    marks = []
    for run_id, of_run in grouped([row for row in rows if row.run_id], lambda row: str(row.run_id)).items():
        mine = {row.quantity: row for row in of_run if row.case == FIRST and row.value is not None}
        for one in HANGING:
            if set(one.quantities) <= mine.keys():
                shape, known = (
                    _shape(*(getattr(mine[name], which) for name in one.quantities)) for which in ("value", "reference")
                )
                marks.append((of_run[0].solver, gamma_of(known), shape, run_id))
    return marks


def _shape(drop: float, shortening: float) -> float:
    return drop / (1 - shortening)


def curve_figure(found: Evidence, marks: Sequence[tuple[str, float, float, str]]) -> Figure:
    """Draw the curve and the marks."""
    figure, panels = panel.open_figure(SIZE)
    axes, curve = panels[0, 0], [elastica(x) for x in TIPS]
    axes.plot(*zip(*curve, strict=True), color="0.4", zorder=1)
    entries = {"elastica": panel.entry(color="0.4", marker="")}
    for solver, of_solver in grouped(marks, lambda mark: mark[0]).items():
        ink = found.inks[solver]
        panel.draw(axes, [mark[1] for mark in of_solver], [mark[2] for mark in of_solver], ink, "none", hollow=True)
        entries[solver] = panel.entry(ink, linestyle="none")
    axes.set_xscale("log")
    axes.set_yscale("log")
    panel.finish([axes], "Gamma = q L$^3$ / B", "H / W")
    panel.add_legend(figure, entries)
    return figure
