"""The section on training time: the state of a field when its training is stopped early (after Kairanda et al., IV)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.digits import duration, percent, rounded
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.fields import read_fields
from shellbench.report.notation import TEXT, Notation
from shellbench.report.palette import inks, style
from shellbench.report.scene import drawn
from shellbench.report.shells import Shell
from shellbench.report.solutions import grouped
from shellbench.report.studies import rows_of_study
from shellbench.report.table import Column, Line, Show, Table, present
from shellbench.report.training_figure import training_figure

ITERATIONS = "iterations"  # the setting that stops a training
ENERGY = "certified_energy"  # a solver's own word for its energy on a finer rule than it was trained on, J
ENERGY_DIGIT = 1e-7  # of an energy: what trainings differ by at their end


@dataclass(frozen=True)
class Stop:
    """A training stopped after so many iterations.

    Attributes
    ----------
    seconds
        Of training: up to the last entry of the history, without what is measured afterwards.
    error
        Relative, signed, of the headline quantity; None where no value is known.
    mean_displacement
        Mean of the displacement's magnitude over the record's grid, in the unit of the case's displacements.
    energy
        Potential energy of the state on a fine quadrature, J, if the solver reports it.
    shell
        The state, ready to be drawn.
    course
        (k,) training seconds and relative errors on the way, in magnitude.
    """

    case: str
    title: str
    solver: str
    iterations: int
    seconds: float
    value: float | None
    unit: str
    error: float | None
    floor: float
    mean_displacement: float | None
    energy: float | None
    sound: bool
    shell: Shell | None
    course: tuple[tuple[float, float], ...]
    run_id: str


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite stopped a training early."""
    stops = training_stops(evidence.records, evidence.rows, evidence.folder)
    if not stops:
        return None
    colours = inks(row.solver for row in evidence.rows)
    exhibits = []
    with style():
        for case, of_case in by_case(stops).items():
            title = of_case[0].title
            exhibits.append(
                Exhibit(
                    name=f"training_{case}",
                    title=f"{title}: state over training time",
                    caption="Above, the deformed shell when training is stopped, at one scale and in one range of"
                    " colours, under the iterations and the seconds of training. Below, the error of the headline"
                    " quantity (thin line: within the longest training) and the mean magnitude of the displacement over"
                    " a grid, against the seconds of training. Each mark is a run of its own from the start.",
                    description="; ".join(_words(stop) for stop in of_case),
                    figure=training_figure(of_case, colours),
                    run_ids=tuple(stop.run_id for stop in of_case),
                    drawing=False,
                )
            )
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


def by_case(stops: Sequence[Stop]) -> dict[str, list[Stop]]:
    """Return the stops of each case."""
    cases: dict[str, list[Stop]] = {}
    for stop in stops:
        cases.setdefault(stop.case, []).append(stop)
    return cases


def training_stops(records: Mapping[str, Record], rows: Sequence[Row], folder: Path) -> list[Stop]:
    """Return the stopped trainings, by case, solver and iterations; one run of each."""
    headline = [row for row in rows_of_study(rows, "training") if row.primary and not row.own_case]
    stops = []
    for (_, _, iterations), alike in grouped(headline, _stopped_at).items():
        row = alike[0]
        record = records.get(row.run_id or "")
        if record is not None and iterations is not None:
            stops.append(_stop(row, record, iterations, folder))
    several = {case for case, of_case in by_case(stops).items() if len({stop.iterations for stop in of_case}) > 1}
    cases = list(dict.fromkeys(stop.case for stop in stops))
    return sorted(
        (stop for stop in stops if stop.case in several),
        key=lambda stop: (cases.index(stop.case), stop.solver, stop.iterations),
    )


def _stopped_at(row: Row) -> tuple[str, str, int | None]:
    iterations = row.settings.get(ITERATIONS)
    return row.case, row.solver, iterations if isinstance(iterations, int) else None


def _stop(row: Row, record: Record, iterations: int, folder: Path) -> Stop:
    steps = [step for step in record.history if step.phase == "solve"]
    fields, case = read_fields(record, folder), portrait_of(record)
    reference = row.reference if row.relative_error is not None else None
    energy = record.diagnostics.get(ENERGY)
    watched = [(step.seconds, step.quantities[row.quantity]) for step in steps if row.quantity in step.quantities]
    return Stop(
        case=row.case,
        title=row.case_title or row.case,
        solver=row.solver,
        iterations=iterations,
        seconds=steps[-1].seconds if steps else record.seconds,
        value=row.value,
        unit=row.unit,
        error=row.relative_error,
        floor=(row.reference_uncertainty or 0.0) / abs(reference) if reference else 0.0,
        mean_displacement=float(np.linalg.norm(fields.displacement, axis=-1).mean()) if fields is not None else None,
        energy=float(energy) if isinstance(energy, int | float) and math.isfinite(energy) else None,
        sound=record.status == "ok",
        shell=drawn(record, case, fields, fields.displacement) if fields is not None and case is not None else None,
        course=tuple((s, abs(value / reference - 1)) for s, value in watched) if reference else (),
        run_id=record.run_id,
    )


def training_table(stops: Sequence[Stop]) -> Table:
    """Return the table of stopped trainings."""
    lines: list[dict[str, Any]] = [
        {
            "block": f"{stop.title} ({stop.unit})" if stop.unit else stop.title,
            "case": stop.case,
            "solver": stop.solver,
            "iterations": stop.iterations,
            "seconds": stop.seconds,
            "value": stop.value,
            "relative_error": stop.error,
            "mean_displacement": stop.mean_displacement,
            "energy": stop.energy,
            "failed": not stop.sound,
            "run_id": stop.run_id,
        }
        for stop in stops
    ]
    return Table(
        name="training_time",
        title="State over training time",
        caption="Headline quantity, its error, and the mean magnitude of the displacement over a grid when training is"
        " stopped after so many iterations and seconds; and the potential energy of the state on a quadrature finer"
        " than it was trained on. Training on points drawn at random lowers it in the mean only.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solver", _solver, right=False),
            Column("Iterations", lambda line, notation: str(int(line["iterations"]))),
            Column("Training (s)", lambda line, notation: notation.escape(duration(line["seconds"]))),
            Column("Headline quantity", _number("value")),
            Column("Error", _error),
            Column("Mean displacement", _number("mean_displacement")),
            Column("Energy (J)", _energy),
        ),
    )


def _solver(line: Line, notation: Notation) -> str:
    return notation.code(line["solver"]) + (" " + notation.strong("failed") if line["failed"] else "")


def _number(name: str) -> Show:
    def show(line: Line, notation: Notation) -> str:
        return notation.number(rounded(line[name])) if present(line[name]) else notation.missing

    return show


def _energy(line: Line, notation: Notation) -> str:
    energy = line["energy"]
    return notation.number(rounded(energy, ENERGY_DIGIT * abs(energy))) if present(energy) else notation.missing


def _error(line: Line, notation: Notation) -> str:
    return notation.error(line["relative_error"]) if present(line["relative_error"]) else notation.missing


def _words(stop: Stop) -> str:
    error = f", error {TEXT.number(percent(stop.error))} %" if stop.error is not None else ""
    return f"{stop.solver}, {stop.iterations} iterations, {duration(stop.seconds)} s{error}"
