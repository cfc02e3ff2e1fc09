"""Ropes: errors against steps, sweeps and seconds, what an error takes, solvers side by side, and chains that move.

Of a setting that is a number, and of which runs of one solver have several values with all other settings alike, the
errors are a curve. Nothing here is about one kind of problem but what its portrait says: that answers are refined by
steps in time, and that frames of a chain are kept.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.report.data.columns import Column, Line, Way, column, frame, significant, solution, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Dashes, Exhibit, Ink
from shellbench.report.data.fields import Fields, read_ribbon
from shellbench.report.data.notation import Notation, duration, plain
from shellbench.report.data.rates import Rate, fitted_rate
from shellbench.report.data.runs import compared, grouped, leading_rows
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table
from shellbench.report.figures import panel
from shellbench.report.figures.pictures import PICTURE, pictured
from shellbench.report.sections.convergence import steps_in_time
from shellbench.report.studies.speed import paces, speed_exhibit, speed_table

SWEEPS = "sweeps_"  # how names of figures begin
FEWEST = 3  # values of a setting that make a curve
FIGURES = 5  # digits of a value, side by side
SHOWN = 8  # frames of a still picture
MOST_STILL = 4  # solvers in it
NARROWEST = 0.5  # of its height: the breadth of a panel whose chain does not swing
PANEL, TALL, MARGIN = 3.1, 2.5, 1.3  # inches of a panel, and for the legend
PERCENT = 100.0
STEPS = "steps_per_second"  # the setting that errors fall with
LEVELS = (1e-1, 1e-2, 1e-3, 1e-4)  # relative errors that a table tells the cost of
LABELS = {STEPS: "steps a second", "seconds": "wall time (s)"}


@dataclass(frozen=True)
class Curve:
    """Errors of one solver against one setting: values, relative errors and seconds, by value."""

    solver: str
    others: str
    setting: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    seconds: tuple[float, ...]
    floor: float
    run_ids: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name in legends: the solver and its other settings."""
        return f"{self.solver}, {self.others}" if self.others else self.solver


def section(found: Evidence) -> Section | None:
    """Return the section of ropes; None if there are none."""
    rows = [row for row in found.rows if steps_in_time(found, row)]
    if not rows:
        return None
    counted = paces(found)
    speed = (speed_exhibit(found, counted),) if counted else ()
    figures = (*sweep_exhibits(found, compared(rows)), *speed, *motion_exhibits(found))
    tables = given(side_by_side(rows), reached_table(compared(rows)), *([speed_table(counted)] if counted else []))
    return Section("ropes", "Ropes", (), tables, figures, place="its suites")


def curves(rows: Sequence[Row]) -> list[Curve]:
    """Return the curves of one case's headline figure."""
    good = [row for row in rows if row.primary and row.status == "ok" and row.reference and row.value is not None]
    found = []
    for solver, of_solver in grouped(good, lambda row: row.solver).items():
        for setting in of_solver[0].settings:
            alike = grouped(of_solver, lambda row, setting=setting: _all_but(row, setting))  # type: ignore[misc]
            for group in alike.values():
                by_value = {row.settings[setting]: row for row in group if _is_number(row.settings.get(setting))}
                if len(by_value) >= FEWEST:
                    found.append(_curve(solver, setting, [by_value[value] for value in sorted(by_value)]))
    return found


def _all_but(row: Row, setting: str) -> str:
    return json.dumps({key: value for key, value in row.settings.items() if key != setting}, sort_keys=True)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _curve(solver: str, setting: str, rows: Sequence[Row]) -> Curve:
    scale = abs(rows[0].reference or 1.0)
    departs = {key: value for row in rows for key, value in row.overrides.items() if key != setting}
    others = next((row.label.rpartition(", ")[0] for row in rows if row.label), "") or ", ".join(
        f"{key} {value}" for key, value in departs.items()
    )
    return Curve(
        solver,
        others,
        setting,
        tuple(float(row.settings[setting]) for row in rows),
        tuple(abs((row.value or 0.0) - (row.reference or 0.0)) / scale for row in rows),
        tuple(row.seconds or 0.0 for row in rows),
        (rows[0].reference_uncertainty or 0.0) / scale,
        tuple(row.run_id or "" for row in rows),
    )


def sweep_exhibits(found: Evidence, rows: Sequence[Row]) -> Iterator[Exhibit]:
    """Yield a figure for each case whose runs sweep over settings: error against each setting, and against seconds."""
    for case, of_case in grouped(rows, lambda row: row.case).items():
        swept = curves(of_case)
        if not swept:
            continue
        title = of_case[0].case_title or case
        headline = next(row for row in of_case if row.primary)
        fits = {curve: law(curve) for curve in swept}
        rates = [f"{curve.name}: {rate.slope:.1f}" for curve, rate in fits.items() if rate is not None]
        yield Exhibit(
            name=f"{SWEEPS}{case}",
            title=f"{title}: error against steps, sweeps and seconds",
            caption=f"Relative error of the headline figure, {headline.description or headline.quantity}, against each"
            " setting of which several values were run, all others alike; and against the wall time of the same runs,"
            " each of which solves with three steps in time. Dashed: power laws fitted to the finest values; their"
            " exponents stand at the right. What levels off converges to something else.",
            description=f"Fitted exponents: {'; '.join(rates)}." if rates else f"Errors of {title}",
            figure=sweep_figure(swept, fits, found),
            run_ids=tuple(dict.fromkeys(run_id for curve in swept for run_id in curve.run_ids)),
        )


def law(curve: Curve) -> Rate | None:
    """Return the power law of errors that fall from value to value; None of others, which have none."""
    falls = all(after < before for before, after in pairwise(curve.errors))
    return fitted_rate(curve.values, curve.errors, curve.floor) if falls else None


def sweep_figure(swept: Sequence[Curve], fits: dict[Curve, Rate | None], found: Evidence) -> Figure:
    """Draw the curves, a panel for each setting, and one against seconds."""
    by_setting = grouped(swept, lambda curve: curve.setting)
    order = sorted(by_setting, key=lambda setting: -len(by_setting[setting]))
    dashes = _dashes(swept)
    count, columns = len(order) + 1, min(len(order) + 1, 2)
    lines = -(-count // columns)
    figure, panels = panel.open_figure((PANEL * columns, TALL * lines + MARGIN), lines, columns)
    flat = list(panels.flat)
    for axes in flat[count:]:
        axes.remove()
    for axes, setting in zip(flat, order, strict=False):
        for curve in by_setting[setting]:
            _draw(axes, curve.values, curve.errors, found.inks[curve.solver], dashes[curve])
        label = LABELS.get(setting, setting.replace("_", " "))
        panel.finish([axes], label, panel.ERROR_LABEL, below=panel.FOR_SLOPES)
        laws = [
            (rate, f"$x^{{{rate.slope:.1f}}}$", found.inks[curve.solver].colour)
            for curve in by_setting[setting]
            if (rate := fits[curve]) is not None
        ]
        panel.draw_slopes(axes, laws)
    cost = flat[len(order)]
    for curve in swept:
        _draw(cost, curve.seconds, curve.errors, found.inks[curve.solver], dashes[curve])
    panel.finish([cost], LABELS["seconds"], panel.ERROR_LABEL)
    entries = {curve.name: panel.entry(found.inks[curve.solver], linestyle=dashes[curve]) for curve in swept}
    panel.add_legend(figure, entries, 2)
    return figure


def _dashes(swept: Sequence[Curve]) -> dict[Curve, Dashes]:
    """Return the dashes of curves: those of one solver have different ones."""
    return {
        curve: DASHES[place % len(DASHES)]
        for of_solver in grouped(swept, lambda curve: curve.solver).values()
        for place, curve in enumerate(of_solver)
    }


def _draw(axes: Axes, x: Sequence[float], errors: Sequence[float], ink: Ink, dashes: Dashes) -> None:
    points = [(a, PERCENT * e) for a, e in zip(x, errors, strict=True) if a > 0 and e > 0]
    panel.draw(axes, [a for a, _ in points], [e for _, e in points], ink, dashes)


def side_by_side(rows: Sequence[Row]) -> Table:
    """Return the table of all figures with the known value, and each solver's with its own settings beside it."""
    own = leading_rows([row for row in rows if row.default_settings])
    solvers = list(dict.fromkeys(row.solver for row in own))
    lines = []
    for (case, quantity), alike in grouped(own, lambda row: (row.case, row.quantity)).items():
        first = alike[0]
        values = {row.solver: row.value for row in alike if row.status in ("ok", "not settled")}
        if len(values) > 1:
            unit = f" ({first.unit})" if first.unit else ""
            line: dict[str, Any] = {"block": first.case_title or case, "case": case, "figure": f"{quantity}{unit}"}
            lines.append(line | {"known": first.reference} | {solver: values.get(solver) for solver in solvers})
    way = significant(FIGURES)
    columns: tuple[str | Column, ...] = (
        column("figure", "Figure", words),
        column("known", "Known", way),
        *(column(solver, solver, way) for solver in solvers),
    )
    return Table(
        name="side_by_side",
        title="Solvers side by side",
        caption="Each figure as solvers have it with their own settings, and as it is known.",
        data=frame(lines, ["block", "case", "figure", "known", *solvers]),
        columns=columns,
    )


def reached_at(curve: Curve, level: float) -> tuple[float, float, bool] | None:
    """Return the seconds and the value of its setting from which on a curve is within a relative error.

    Between two runs both are read off straight lines in logarithms. The uncertainty of the known value counts against
    it, and so does a later run that is farther off: a single small error may be a change of sign.

    Returns
    -------
    tuple or None
        Seconds, value, and whether the first run is within the error already; None if the last run is not.
    """
    errors = [error + curve.floor for error in curve.errors]
    outside = [place for place, error in enumerate(errors) if error > level]
    if not outside:
        return curve.seconds[0], curve.values[0], True
    before = outside[-1]
    if before == len(errors) - 1 or min(curve.seconds) <= 0:
        return None
    above, below = errors[before], max(errors[before + 1], np.finfo(float).tiny)
    part = math.log(above / level) / math.log(above / below)
    seconds, value = (
        math.exp((1 - part) * math.log(ends[before]) + part * math.log(ends[before + 1]))
        for ends in (curve.seconds, curve.values)
    )
    return seconds, value, False


def reached_table(rows: Sequence[Row]) -> Table:
    """Return the table of seconds and steps a second that solvers take to be within each of `LEVELS`."""
    lines: list[dict[str, Any]] = []
    for case, of_case in grouped(rows, lambda row: row.case).items():
        for curve in curves(of_case):
            if curve.setting == STEPS:
                line: dict[str, Any] = {"block": of_case[0].case_title or case, "case": case, "solution": curve.name}
                for level in LEVELS:
                    seconds, value, at_once = reached_at(curve, level) or (None, None, False)
                    line |= {f"to_{level:g}": seconds, f"steps_{level:g}": value, f"at_once_{level:g}": at_once}
                lines.append(line)
    return Table(
        name="time_to_error",
        title="Seconds to an error",
        caption="Wall time, s, and in brackets steps a second, from which on the headline figure is within a relative"
        " error, by straight lines between runs in logarithms. A run solves with three steps, and its seconds are of"
        " all of them. At most: so much took the coarsest run, which is nearer already. A dash: no run is so near."
        " What is near by chance, as where a step ends on an impact, counts too.",
        data=frame(lines),
        columns=(
            column("solution", "Solver", solution),
            *(column(f"to_{level:g}", f"{PERCENT * level:g} %", _taken(level)) for level in LEVELS),
        ),
    )


def _taken(level: float) -> Way:
    """Return a format for the seconds to an error, with the steps per second."""

    def written(value: float, line: Line, notation: Notation) -> str:
        most = "at most " if line[f"at_once_{level:g}"] else ""
        steps = float(f"{line[f'steps_{level:g}']:.2g}")
        return notation.escape(f"{most}{duration(value)} ({steps:.0f})")

    return written


def motion_exhibits(found: Evidence) -> Iterator[Exhibit]:
    """Yield a picture of each chain that moved; the page puts the view with its slider in its place."""
    for case, records in pictured(found.records, found.compared).items():
        portrait = portrait_of(records[0])
        if portrait is None or portrait.frames is None:
            continue
        seen = [(one, ribbon) for one in records if (ribbon := read_ribbon(one, found.folder, portrait)) is not None]
        moving = [(one, ribbon) for one, ribbon in seen if len(ribbon.marks) > 1]
        if not moving:
            continue
        shown = moving[:MOST_STILL]
        yield Exhibit(
            name=f"{PICTURE}{case}",
            title=f"{portrait.title}: the motion",
            caption=f"The chain at {SHOWN} times from 0 (pale) to {moving[0][1].marks[-1]:.3g} s, seen along y. In the"
            " browser it can be turned, and followed in time by a slider.",
            description=f"{portrait.title}, by {', '.join(one.identity.solver for one, _ in shown)}",
            figure=draw_chains(shown, found),
            run_ids=tuple(one.run_id for one, _ in shown),
        )


def draw_chains(shown: Sequence[tuple[Record, Fields]], found: Evidence) -> Figure:
    """Draw chains at some times, a panel for each solver."""
    figure, panels = panel.open_figure((1.9 * len(shown) + 0.5, 2.4), 1, len(shown), sharex=True, sharey=True)
    for axes, (record, ribbon) in zip(panels[0], shown, strict=True):
        nodes = ribbon.position.mean(axis=1) + ribbon.displacements.mean(axis=2)
        solver = record.identity.solver
        look: dict[str, Any] = {"color": found.inks[solver].colour, "marker": ".", "markersize": 3.0}
        times = np.unique(np.linspace(0, len(nodes) - 1, SHOWN).round().astype(int))
        for place, at in enumerate(times):
            axes.plot(nodes[at, :, 0], nodes[at, :, 2], alpha=0.2 + 0.8 * place / max(len(times) - 1, 1), **look)
        axes.set_aspect("equal", adjustable="box")
        axes.set_title(plain(solver), loc="left")
        axes.set_xlabel("x (m)")
    panels[0, 0].set_ylabel("z (m)")
    middle, least = np.mean(panels[0, 0].get_xlim()), NARROWEST * np.ptp(panels[0, 0].get_ylim())
    if np.ptp(panels[0, 0].get_xlim()) < least:
        panels[0, 0].set_xlim(middle - least / 2, middle + least / 2)
    return figure
