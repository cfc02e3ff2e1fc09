"""The sections on what Kairanda et al. 2023 studied: sampling (VII), training time (IV), and supports (figure II, F.1).

Sampling goes from 5 to 25 points a side, and tells what too few of them do; training time shows the state of a field
whose training is stopped early; a support is built into the field, or asked for by a penalty.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.report.data.columns import Column, Line, column, rounded_value, share, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, Ink
from shellbench.report.data.fields import read_fields
from shellbench.report.data.notation import TEXT, Notation, duration, percent, plain, quoted, rounded
from shellbench.report.data.runs import headlines, in_order_of_cases
from shellbench.report.data.section import Section, failures
from shellbench.report.data.solutions import STATUS_WORDS
from shellbench.report.data.table import Table
from shellbench.report.figures import panel
from shellbench.report.figures.pictures import drawn
from shellbench.report.figures.shells import FEW_CELLS, Shell, aspect, colour_bar, draw_deformed, name_row
from shellbench.report.sections.resolution import metres, of_largest

POINTS = "quadrature_points"  # a solver's own count of the points that it was solved on, if it says one
CELLS = "cells"  # or the setting for the grid of its samples, one in each cell
PANEL, PANEL_HEIGHT, LEGEND = 3.2, 1.9, 0.7  # inches of a panel, and of the legend
ITERATIONS = "iterations"  # the setting that stops a training
ENERGY = "certified_energy"  # a solver's own word for its energy on a finer rule than it was trained on, J
ENERGY_DIGIT = 1e-7  # of an energy: what trainings differ by at their end
WIDTH, WIDEST = 7.2, 1.9  # inches of a row of states, and of one state
LOWEST, HIGHEST = 0.8, 1.5  # inches a state
TITLE, BAR, CURVES = 0.3, 0.5, 2.3  # inches of the states' titles, of the colour bar, and of the curves
SUPPORT_ERROR = "support_error"  # diagnostics of a solver that can leak: the largest displacement at held places, m
PENALTY = "penalty"  # the weight of the penalty, None where supports are built into the field


def sampling(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite studied sampling."""
    if (runs := sampled_runs(evidence)).empty:
        return None
    table = sampling_table(runs)
    lines = list(table.data.to_dict("records"))
    fixed = "; ".join(dict.fromkeys(f"{one['solver']}: {one['held_fixed']}" for one in lines if one["held_fixed"]))
    exhibit = Exhibit(
        name="sampling",
        title="Error and energy gap against points a side",
        caption="Error of the headline quantity, and difference of the energy between the points of the solve and a"
        " finer rule, against points a side. A mark is a run, the line the median of the seeds; open marks are runs"
        " that failed, refused for too large a gap if they ended. A gap of a solver that draws its points at"
        f" random measures the noise of its loss as well. Held fixed: {fixed}.",
        description="; ".join(map(_sampled_words, lines)),
        figure=sampling_figure(runs, evidence),
        run_ids=tuple(runs["run_id"]),
    )
    return Section(
        name="sampling",
        title="Sampling",
        words=(
            "How many points a field needs. An optimiser that sees the energy at few points lowers it there and lets"
            " the field go wild between them. Two remedies are compared: to draw the points anew at every iteration,"
            " and to hold the energy against a finer rule at the end and refuse what differs.",
            "A run with too large a gap is refused; it is shown with the value and the gap that it was refused with.",
        ),
        tables=(table,),
        exhibits=(exhibit,),
    )


def sampled_runs(evidence: Evidence) -> pd.DataFrame:
    """Return the study's runs by case, solver and points, with the points in all and a side of a square."""
    runs = headlines(evidence.runs, "sampling")
    points = pd.Series([points_of(one.record, one.row) for one in runs.itertuples()], runs.index, dtype=float)
    runs = runs.assign(points=points, a_side=np.sqrt(points), error=runs["relative_error"].abs())
    runs = runs.replace({"error": {math.inf: math.nan}, "energy_gap": {math.inf: math.nan, -math.inf: math.nan}})
    return in_order_of_cases(runs[points.notna()], ["solver", "points"])


def points_of(record: Record | None, row: Row) -> int | None:
    """Return on how many points a run was solved; None if neither its record nor its settings say it."""
    counted = record.diagnostics.get(POINTS) if record is not None else None
    if isinstance(counted, int):
        return counted
    match row.settings.get(CELLS):
        case [int(first), int(second)]:
            return first * second
    return None


def sampling_table(runs: pd.DataFrame) -> Table:
    """Return the table of points, errors and gaps, a line for runs that differ in their seed alone."""
    groups = runs.groupby(["case", "solver", "points"], sort=False)
    data = groups.agg(
        block=("title", "first"),
        held_fixed=("label", lambda labels: labels.iloc[0].rpartition(", ")[0]),
        a_side=("a_side", "first"),
        runs=("sound", "size"),
        failed=("sound", lambda sound: int((~sound).sum())),
        least_error=("error", "min"),
        largest_error=("error", "max"),
        least_gap=("energy_gap", "min"),
        largest_gap=("energy_gap", "max"),
        seconds=("seconds", lambda seconds: seconds.fillna(0.0).mean()),
        run_ids=("run_id", " ".join),
    ).reset_index()
    data["points"] = data["points"].astype(int)
    order = ["block", "case", "solver", "held_fixed", "points"]
    return Table(
        name="sampling",
        title="Points, error and energy gap",
        caption="Magnitude of the headline quantity's error and of the energy gap between the points of the solve and a"
        " finer rule, least and largest of the seeds; how many runs failed; mean wall time of the solve.",
        data=data[[*order, *data.columns.difference(order, sort=False)]],
        columns=(
            "solver",
            Column("Held fixed", lambda line, notation: notation.escape(line["held_fixed"]), right=False),
            column("a_side", "Points a side", lambda points, line, notation: f"{points:.3g}"),
            column("least_error", "Least error", share),
            column("largest_error", way=share),
            column("least_gap", "Least gap", share),
            column("largest_gap", "Largest gap", share),
            Column("Failed", _failed),
            "seconds",
        ),
    )


def _failed(line: Line, notation: Notation) -> str:
    failed, runs = int(line["failed"]), int(line["runs"])
    return notation.strong(f"{failed} of {runs}") if failed else f"0 of {runs}"


def _sampled_words(line: dict[str, Any]) -> str:
    largest = line["largest_error"]
    error = f"error up to {TEXT.number(percent(largest, signed=False))} %" if largest == largest else "no value"
    failed = f", {line['failed']} of {line['runs']} failed" if line["failed"] else ""
    return f"{line['block']}, {line['solver']}, {line['a_side']:.3g} points a side: {error}{failed}"


def sampling_figure(runs: pd.DataFrame, evidence: Evidence) -> Figure:
    """Draw error above and gap below, a column for each case; all seeds, and failed runs among them."""
    cases = runs.groupby("case", sort=False)
    size = max(4.2, PANEL * len(cases)), 2 * PANEL_HEIGHT + LEGEND
    figure, panels = panel.open_figure(size, 2, len(cases), sharey="row", sharex=True)
    for (_, of_case), pair in zip(cases, panels.T, strict=True):
        for axes, measure in zip(pair, ("error", "energy_gap"), strict=True):
            height = 100 * of_case[measure].abs().clip(lower=panel.SMALLEST)
            shown = of_case.assign(height=height).dropna(subset="height")
            for solver, marks in shown.groupby("solver", sort=False):
                ink, middle = evidence.inks[solver], marks.groupby("a_side")["height"].median()
                axes.plot(middle.index, middle, color=ink.colour, linewidth=1.0, alpha=0.8)
                panel.draw_runs(axes, marks[["a_side", "height", "sound"]], ink, zorder=3)
    panel.finish(panels[0], y=panel.ERROR_LABEL, floor=list(100 * cases["floor"].max()), log="y")
    panel.finish(panels[1], y="energy gap (%)", log="y")
    for axes, title in zip(panels[0], cases["title"].first(), strict=True):
        axes.set_title(plain(title), loc="left")
    for axes in panels[1]:
        axes.set_xlabel("points a side")
        axes.set_xticks(sorted(set(runs["a_side"].round().astype(int))))
    entries = {solver: panel.entry(evidence.inks[solver]) for solver in runs["solver"].unique()}
    panel.add_legend(figure, entries | panel.failed_entry(not runs["sound"].all()))
    return figure


def training(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite stopped a training early."""
    if (stops := training_stops(evidence)).empty:
        return None
    exhibits = [
        Exhibit(
            name=f"training_{case}",
            title=f"{of_case['title'].iloc[0]}: state over training time",
            caption="Above, the deformed shell when training is stopped, at one scale and in one range of"
            " colours, under the iterations and the seconds of training. Below, the error of the headline"
            " quantity (thin line: within the longest training) and the mean magnitude of the displacement over"
            " a grid, against the seconds of training. Each mark is a run of its own from the start.",
            description="; ".join(map(_stopped_words, of_case.to_dict("records"))),
            figure=training_figure(of_case, evidence),
            run_ids=tuple(of_case["run_id"]),
            drawing=False,
        )
        for case, of_case in stops.groupby("case", sort=False)
    ]
    return Section(
        name="training_time",
        title="State over training time",
        words=(
            "What a user sees who stops a training early. Every state is a run of its own with the same seed, so that"
            " the states of one recipe lie on one course. Seconds are wall time on a machine that may have had other"
            " work.",
            "Nought iterations of a recipe that solves for its output layer are its start: random features with the"
            " best output layer for them. A training that ends by itself stays as it is, whatever more it may do."
            " Training lowers the energy of the whole shell; a single figure of it that is right by chance early on"
            " may get worse while the energy falls.",
        ),
        tables=(training_table(stops),),
        exhibits=tuple(exhibits),
    )


def training_stops(evidence: Evidence) -> pd.DataFrame:
    """Return the stopped trainings, by case, solver and iterations; one run of each.

    Beside the columns of runs, each has its `iterations`, and what `_state` says.
    """
    runs = headlines(evidence.runs, "training")
    asked = [row.settings.get(ITERATIONS) for row in runs["row"]]
    runs = runs.assign(iterations=[one if isinstance(one, int) else math.nan for one in asked])
    runs = runs.drop_duplicates(["case", "solver", "iterations"]).dropna(subset=["iterations", "record"])
    several = runs.groupby("case")["iterations"].transform("nunique") > 1
    stops = in_order_of_cases(runs[several].astype({"iterations": int}), ["solver", "iterations"])
    states = [_state(run, evidence.folder) for run in stops.to_dict("records")]
    return stops.assign(**{name: [state[name] for state in states] for name in states[0]}) if states else stops


def _state(run: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the state of a training when it was stopped.

    It has the seconds up to the last entry of the history, the mean magnitude of the displacement over the record's
    grid, the potential energy on a fine quadrature, J, if the solver reports it, the shell, ready to be drawn, and the
    course: seconds and magnitudes of relative errors during the training.
    """
    record, reference = run["record"], run["reference"]
    steps = [step for step in record.history if step.phase == "solve"]
    watched = [step for step in steps if run["quantity"] in step.quantities]
    fields, case = read_fields(record, folder), portrait_of(record)
    energy = record.diagnostics.get(ENERGY)
    judged = math.isfinite(run["relative_error"])
    course = [(step.seconds, abs(step.quantities[run["quantity"]] / reference - 1)) for step in watched if judged]
    return {
        "seconds": steps[-1].seconds if steps else record.seconds,
        "mean_displacement": float(np.linalg.norm(fields.displacement, axis=-1).mean()) if fields else math.nan,
        "energy": float(energy) if isinstance(energy, int | float) and math.isfinite(energy) else math.nan,
        "shell": drawn(record, case, fields, fields.displacement) if fields and case else None,
        "course": tuple(course),
        "floor": run["floor"] if judged else 0.0,
        "sound": record.status == "ok",
    }


def training_table(stops: pd.DataFrame) -> Table:
    """Return the table of stopped trainings."""
    units = stops["unit"].map(lambda unit: f" ({unit})" if unit else "")
    data = stops.assign(block=stops["title"] + units, failed=~stops["sound"])
    shown = ["block", "case", "solver", "iterations", "seconds", "value", "relative_error"]
    return Table(
        name="training_time",
        title="State over training time",
        caption="Headline quantity, its error, and the mean magnitude of the displacement over a grid when training is"
        " stopped after so many iterations and seconds; and the potential energy of the state on a quadrature finer"
        " than it was trained on. Training on points drawn at random lowers it in the mean only.",
        data=data[[*shown, "mean_displacement", "energy", "failed", "run_id"]],
        columns=(
            Column("Solver", _solver, right=False),
            "iterations",
            column("seconds", "Training (s)"),
            column("value", "Headline quantity", rounded_value),
            "relative_error",
            column("mean_displacement", "Mean displacement", rounded_value),
            column("energy", "Energy (J)", _energy),
        ),
    )


def _solver(line: Line, notation: Notation) -> str:
    return notation.code(line["solver"]) + (" " + notation.strong("failed") if line["failed"] else "")


def _energy(energy: float, line: Line, notation: Notation) -> str:
    return notation.number(rounded(energy, ENERGY_DIGIT * abs(energy)))


def _stopped_words(stop: dict[str, Any]) -> str:
    size = stop["relative_error"]
    error = f", error {TEXT.number(percent(size))} %" if math.isfinite(size) else ""
    return f"{stop['solver']}, {stop['iterations']} iterations, {duration(stop['seconds'])} s{error}"


def training_figure(stops: pd.DataFrame, evidence: Evidence) -> Figure:
    """Draw a row of states for each solver, and error and mean displacement of all of them below."""
    solvers = stops.groupby("solver", sort=False)
    shells = [shell for shell in stops["shell"] if shell is not None]
    columns = int(solvers.size().max())
    width = min(WIDEST, WIDTH / columns)
    low = float(np.clip(width * aspect(shells), LOWEST, HIGHEST)) + TITLE if shells else 0.1
    upper = low * len(solvers) + BAR
    figure = Figure(figsize=(WIDTH, upper + CURVES), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(upper, CURVES)).flat
    panels = above.subplots(len(solvers), columns, squeeze=False)
    for row, (solver, of_solver) in zip(panels, solvers, strict=True):
        for axes in row:
            axes.set_axis_off()
        for axes, stop in zip(row, of_solver.to_dict("records"), strict=False):
            _draw_state(axes, stop, shells)
        name_row(row[0], solver, evidence.inks[solver].colour)
    if shells:
        colour_bar(above, list(panels.flat), *shells, shrink=0.5, aspect=34)
    errors, means = below.subplots(1, 2)
    for solver, of_solver in solvers:
        _draw_curves(errors, means, of_solver, evidence.inks[solver])
    unit = stops["unit"].iloc[0] or "m"
    panel.finish([errors], "training time (s)", panel.ERROR_LABEL, floor=100 * stops["floor"].max())
    panel.finish([means], "training time (s)", f"mean displacement ({unit})", log="x")
    means.set_ylim(bottom=0.0)
    panel.add_legend(below, {solver: panel.entry(evidence.inks[solver]) for solver, _ in solvers}, len(solvers))
    return figure


def _draw_state(axes: Axes, stop: dict[str, Any], shells: list[Shell]) -> None:
    words = f"{stop['iterations']} iteration{'' if stop['iterations'] == 1 else 's'}\n{duration(stop['seconds'])} s"
    axes.set_title(words + ("" if stop["sound"] else ", failed"), fontsize=7.5, pad=2)
    if stop["shell"] is not None:
        draw_deformed(axes, stop["shell"], shells, cells=FEW_CELLS)


def _draw_curves(errors: Axes, means: Axes, stops: pd.DataFrame, ink: Ink) -> None:
    longest = stops.loc[stops["iterations"].idxmax()]
    if longest["course"]:
        seconds, sizes = np.transpose(longest["course"])
        errors.plot(seconds, 100 * sizes.clip(min=panel.SMALLEST), color=ink.colour, linewidth=0.6, alpha=0.6)
    shown = stops.dropna(subset="mean_displacement")
    means.plot(shown["seconds"], shown["mean_displacement"], color=ink.colour, linewidth=0.8)
    marks = stops.assign(size=100 * stops["relative_error"].abs().clip(lower=panel.SMALLEST))
    panel.draw_runs(errors, marks[["seconds", "size", "sound"]], ink)
    panel.draw_runs(means, marks[["seconds", "mean_displacement", "sound"]], ink)


def supports(evidence: Evidence) -> Section | None:
    """Return the section; None if no run held its supports by a penalty."""
    if (table := support_table(evidence)) is None:
        return None
    return Section(
        name="supports",
        title="Hard and soft supports",
        words=(
            "A support can be built into the form of a field, which then holds it for all weights, or it can be"
            " asked for by a penalty: a spring of a chosen weight along the held places. A soft support leaks by what"
            " the spring gives; too stiff a spring makes the equations ill-conditioned. The weight has to be found by"
            " trial, and no weight holds the support exactly.",
        ),
        tables=(table,),
    )


def support_table(evidence: Evidence) -> Table | None:
    """Return a line for each run that says how well it holds its supports, of cases with a penalty in any run."""
    runs = evidence.runs[evidence.runs["primary"]].dropna(subset="record")
    found = runs.assign(
        penalty=[_diagnostic(record, PENALTY) for record in runs["record"]],
        support_error=[_diagnostic(record, SUPPORT_ERROR) for record in runs["record"]],
        largest_displacement=[
            max((step.largest_displacement for step in record.resolution), default=math.nan)
            for record in runs["record"]
        ],
    ).dropna(subset="support_error")
    soft = found["penalty"].fillna(0.0) != 0
    found = found[found["case"].isin(found.loc[soft, "case"]) & (soft | found["default_settings"])]
    first = found.groupby(["case", "solution"], sort=False)["seed"].transform(lambda seeds: seeds.iloc[0])
    found = found[(found["seed"] == first) | (found["seed"].isna() & first.isna())]
    if found.empty:
        return None
    found = in_order_of_cases(found.assign(weight=found["penalty"].replace(0.0, np.nan)), ["weight"])
    ended = found["status"].map({"ok": "solved", **STATUS_WORDS})
    data = found.assign(block=found["title"], ended=ended.fillna(found["status"]))
    shown = ["block", "case", "solution", "run_id", "penalty", "support_error", "largest_displacement"]
    return Table(
        name="supports",
        title="Hard and soft supports",
        caption="Weight of the penalty (none: the support is built into the field), largest displacement at held"
        " places, that share of the largest displacement of the shell, and the error of the headline quantity."
        " One seed.",
        data=data[[*shown, "relative_error", "ended"]],
        columns=(
            "solution",
            column("penalty", "Weight", _weight, instead=lambda line, notation: "none"),
            column("support_error", "At held places (m)", metres),
            column("support_error", "Of the largest", of_largest),
            "relative_error",
            column("ended", way=words),
        ),
        notes=failures(found),
    )


def _diagnostic(record: Record, name: str) -> float:
    value = record.diagnostics.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _weight(value: float, line: Line, notation: Notation) -> str:
    return notation.number(quoted(value))
