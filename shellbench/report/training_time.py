"""The section on training time: the state of a field when its training is stopped early (after Kairanda et al., IV)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shellbench.bench.kinds import portrait_of
from shellbench.report.columns import Column, Line, column
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit, Ink
from shellbench.report.fields import drawn, read_fields
from shellbench.report.notation import TEXT, Notation, duration, percent, rounded
from shellbench.report.panel import ERROR_LABEL, SMALLEST, add_legend, draw, entry, finish
from shellbench.report.runs import headlines, in_order_of_cases
from shellbench.report.shells import FEW_CELLS, Shell, aspect, colour_bar, draw_deformed, name_row
from shellbench.report.table import Table

ITERATIONS = "iterations"  # the setting that stops a training
ENERGY = "certified_energy"  # a solver's own word for its energy on a finer rule than it was trained on, J
ENERGY_DIGIT = 1e-7  # of an energy: what trainings differ by at their end
WIDTH, WIDEST = 7.2, 1.9  # inches of a row of states, and of one state
LOWEST, HIGHEST = 0.8, 1.5  # inches a state
TITLE, BAR, CURVES = 0.3, 0.5, 2.3  # inches of the states' titles, of the colour bar, and of the curves


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite stopped a training early."""
    stops = training_stops(evidence)
    if stops.empty:
        return None
    exhibits = [
        Exhibit(
            name=f"training_{case}",
            title=f"{of_case['title'].iloc[0]}: state over training time",
            caption="Above, the deformed shell when training is stopped, at one scale and in one range of"
            " colours, under the iterations and the seconds of training. Below, the error of the headline"
            " quantity (thin line: within the longest training) and the mean magnitude of the displacement over"
            " a grid, against the seconds of training. Each mark is a run of its own from the start.",
            description="; ".join(map(_words, of_case.to_dict("records"))),
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
    """Return what became of a training when it was stopped.

    These are its seconds, up to the last entry of the history, without what is measured afterwards; the mean magnitude
    of the displacement over the record's grid; the potential energy on a fine quadrature, J, if the solver reports it;
    the shell, ready to be drawn; and the course: seconds and magnitudes of relative errors on the way.
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
            column("value", "Headline quantity", _number),
            "relative_error",
            column("mean_displacement", "Mean displacement", _number),
            column("energy", "Energy (J)", _energy),
        ),
    )


def _solver(line: Line, notation: Notation) -> str:
    return notation.code(line["solver"]) + (" " + notation.strong("failed") if line["failed"] else "")


def _number(value: float, line: Line, notation: Notation) -> str:
    return notation.number(rounded(value))


def _energy(energy: float, line: Line, notation: Notation) -> str:
    return notation.number(rounded(energy, ENERGY_DIGIT * abs(energy)))


def _words(stop: dict[str, Any]) -> str:
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
    finish([errors], "training time (s)", ERROR_LABEL, floor=100 * stops["floor"].max())
    finish([means], "training time (s)", f"mean displacement ({unit})", log="x")
    means.set_ylim(bottom=0.0)
    add_legend(below, {solver: entry(evidence.inks[solver]) for solver, _ in solvers}, len(solvers))
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
        errors.plot(seconds, 100 * sizes.clip(min=SMALLEST), color=ink.colour, linewidth=0.6, alpha=0.6)
    shown = stops.dropna(subset="mean_displacement")
    means.plot(shown["seconds"], shown["mean_displacement"], color=ink.colour, linewidth=0.8)
    for sound, of_kind in stops.groupby("sound"):
        sizes = 100 * of_kind["relative_error"].abs().clip(lower=SMALLEST)
        draw(errors, of_kind["seconds"], sizes, ink, "none", hollow=not sound)
        draw(means, of_kind["seconds"], of_kind["mean_displacement"], ink, "none", hollow=not sound)
