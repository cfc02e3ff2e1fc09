"""The section on calibration: how sure solvers are of their figures, and how right; see `bench.calibration`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from shellbench.bench.judge.calibration import ASKED_SHARE, MOST, TIMES, WITHIN, Calibration, Judged, calibrations
from shellbench.report.data.columns import Column, Line, column, count, significant
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, Ink
from shellbench.report.data.notation import Notation, quoted
from shellbench.report.data.section import Section
from shellbench.report.data.table import Note, Table
from shellbench.report.figures.panel import GREY, SMALLEST, add_legend, draw, entry, finish, open_figure

SIZE = (5.2, 3.9)  # inches
NAMED = 12  # figures that stand below the table at most
VERDICTS: Mapping[bool | None, str] = {True: "well calibrated", False: "over-confident", None: "states none"}
LINES: Mapping[float, Any] = {TIMES[0]: "-", WITHIN: (0, (4, 1.5)), MOST: (0, (1, 1.2))}
ROOM = 2.0  # factor that is left beside the marks
LARGEST = 1e3  # relative figure beyond which a mark stands at the edge


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no answer with a known value states an uncertainty."""
    found = calibrations({(row.run_id, row.quantity): row for row in evidence.rows}.values())
    if not any(one.judged for one in found):
        return None
    return Section(
        name="calibration",
        title="Errors against stated uncertainties",
        words=(
            "A solver that states how sure it is should be right about that too. Each figure with a known value is held"
            " against what its solver states of it: the ratio is the error over the sum of the stated uncertainty and"
            f" that of the known value. Asked are at most {WITHIN:g} for {100 * ASKED_SHARE:g} % of a solver's figures,"
            f" and never more than {MOST:g} where its run has status ok.",
        ),
        tables=(calibration_table(found),),
        exhibits=(_exhibit(found, evidence.inks),),
        details=(figures_table(found),),
    )


def calibration_table(found: Sequence[Calibration]) -> Table:
    """Return the table: a line for each solver."""
    return Table(
        name="calibration",
        title="Errors against stated uncertainties",
        caption="Figures with a known value and a stated uncertainty; the share of them whose error is at most 1, 2 and"
        " 5 times what is stated; the worst ratio, and where; figures with a known value of which nothing is stated.",
        data=pd.DataFrame([_line(one) for one in found]),
        columns=(
            "solver",
            column("figures", "Figures", count),
            *(column(f"within_{times:g}", f"Within {times:g}×", _per_cent) for times in TIMES),
            column("worst", "Worst", significant(2)),
            Column("Where", lambda line, notation: notation.escape(str(line["where"])), right=False),
            column("silent", "Without", count),
            Column("Verdict", _verdict, right=False),
        ),
        notes=tuple(
            Note(f"{one.solver}, {judged.name}", f"the error is {judged.ratio:.3g} times what is stated.")
            for one in found
            for judged in one.overconfident[:NAMED]
        ),
    )


def _line(one: Calibration) -> dict[str, Any]:
    worst = one.judged[0] if one.judged else None
    return {
        "block": "Solvers",
        "solver": one.solver,
        "figures": len(one.judged),
        **{f"within_{times:g}": one.share(times) for times in TIMES},
        "worst": worst.ratio if worst and math.isfinite(worst.ratio) else None,
        "where": worst.name if worst else "",
        "overconfident": len(one.overconfident),
        "silent": one.silent,
        "verdict": VERDICTS[one.holds],
    }


def _per_cent(value: Any, line: Line, notation: Notation) -> str:
    """Write a share with a decimal; what is not all is never rounded to it."""
    return notation.number(quoted(math.floor(1000 * value) / 10)) + notation.per_cent


def _verdict(line: Line, notation: Notation) -> str:
    words = notation.escape(str(line["verdict"]))
    return notation.strong(words) if line["verdict"] == VERDICTS[False] else words


def figures_table(found: Sequence[Calibration]) -> Table:
    """Return the long table: a line for each figure, each solver's worst first."""
    lines = [_figure_line(judged) for one in found for judged in one.judged]
    return Table(
        name="calibration_figures",
        title="Errors and stated uncertainties of all figures",
        caption="Magnitudes in the figure's unit; the stated uncertainty includes that of the known value.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Figure", lambda line, notation: notation.escape(str(line["figure"])), right=False),
            column("error", "Error", significant(2)),
            column("stated", "Stated", significant(2)),
            column("ratio", "Ratio", significant(2)),
        ),
    )


def _figure_line(one: Judged) -> dict[str, Any]:
    return {
        "block": one.row.solver,
        "case": one.row.case,
        "figure": one.name,
        "seed": one.row.seed,
        "quantity": one.row.quantity,
        "unit": one.row.unit,
        "status": one.row.status,
        "error": one.error,
        "stated": one.stated,
        "ratio": one.ratio if math.isfinite(one.ratio) else None,
        "run_id": one.row.run_id,
    }


def _exhibit(found: Sequence[Calibration], inks: Mapping[str, Ink]) -> Exhibit:
    return Exhibit(
        name="calibration",
        title="Errors against stated uncertainties",
        caption="A mark is a figure of a run: its true error over what its solver states, both relative to the known"
        f" value. Above the dotted line the error is more than {MOST:g} times what is stated. Open marks: answers that"
        " have not settled.",
        description="; ".join(map(str, found)),
        figure=calibration_figure(found, inks),
        run_ids=tuple(dict.fromkeys(j.row.run_id for one in found for j in one.judged if j.row.run_id)),
    )


def calibration_figure(found: Sequence[Calibration], inks: Mapping[str, Ink]) -> Figure:
    """Draw true errors over stated uncertainties, with lines at the ratios that are asked for."""
    figure, ((axes,),) = open_figure(SIZE)
    shown = [one for one in found if one.judged]
    stated = np.concatenate([_relative(one.judged, "stated") for one in shown])
    ends = np.array([stated.min() / ROOM, stated.max() * ROOM])
    for times, dashes in LINES.items():
        axes.plot(ends, times * ends, color=GREY, linewidth=0.8, linestyle=dashes, zorder=0)
    for one in shown:
        for settled in (True, False):
            marks = [j for j in one.judged if (j.row.status == "ok") == settled]
            x, y = (_relative(marks, name) for name in ("stated", "error"))
            draw(axes, x, y, inks[one.solver], "none", hollow=not settled, markersize=3.2)
    finish([axes], "stated uncertainty, relative", "true error, relative")
    solvers = {one.solver: entry(inks[one.solver], linestyle="none") for one in shown}
    lines = {f"{times:g} times what is stated": entry(linestyle=dashes) for times, dashes in LINES.items()}
    add_legend(figure, solvers | lines, 3)
    return figure


def _relative(marks: Sequence[Judged], name: str) -> Any:
    """Return errors, or what is stated, relative to each figure's scale; nothing is drawn smaller than rounding."""
    values = [getattr(one, name) / (one.scale or 1.0) for one in marks]
    return np.clip(np.asarray(values, dtype=float), SMALLEST, LARGEST)
