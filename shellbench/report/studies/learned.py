"""Fields on the unit square: errors against epochs, parameters and seconds.

A figure for each problem whose answers are learned: what trains has a course of epochs, what is solved for has one
point. Samples and densities are shown of runs that kept both. Nothing here is about one kind of problem but what its
portrait says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import ANSWERED, Record, portrait_of
from shellbench.report.data.columns import Column, column, count, frame, seconds, significant, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import DASHES, Dashes, Exhibit
from shellbench.report.data.notation import plain
from shellbench.report.data.runs import grouped
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table
from shellbench.report.figures import panel

Array = NDArray[np.float64]
LEARNED, SAMPLES = "learned_", "samples_"  # how names of figures begin
ERRORS = (5e-3, 2e-3, 1e-3, 5e-4)  # of which the table says after how many epochs they are reached
PERCENT = 100.0
MOST_DRAWN = 4  # densities side by side
DOTS = 600  # samples of a picture
PANEL, TALL, MARGIN = 3.1, 2.5, 1.4  # inches of a panel, and for the legend


@dataclass(frozen=True)
class Learned:
    """One run: its row and record, the errors of the headline figure by epoch, and the array of samples, if kept."""

    row: Row
    record: Record
    epochs: tuple[int, ...]
    errors: tuple[float, ...]

    @property
    def name(self) -> str:
        """Name in legends: the solver and its variant."""
        return f"{self.row.solver}, {self.row.label}" if self.row.label else self.row.solver

    @property
    def error(self) -> float:
        """Its own error, in the figure's unit."""
        return abs((self.row.value or 0.0) - (self.row.reference or 0.0))

    def reaches(self, error: float) -> int | None:
        """Return the first epoch that was looked at with an error so small; None if there is none."""
        return next((epoch for epoch, found in zip(self.epochs, self.errors, strict=True) if found <= error), None)


def section(found: Evidence) -> Section | None:
    """Return the section of fields on the unit square; None if there are none."""
    runs = list(learned(found))
    if not runs:
        return None
    by_case = {
        case: of_case
        for case, of_case in grouped(runs, lambda run: run.row.case).items()
        if any(len(run.epochs) > 1 or kept_samples(run, found) is not None for run in of_case)
    }
    runs = [run for of_case in by_case.values() for run in of_case]
    if not runs:
        return None
    figures = [figure for case in by_case.values() for figure in course_exhibits(case, found)]
    return Section("learned", "Fields on the unit square", (), given(table(runs)), tuple(figures), place="its suites")


def learned(found: Evidence) -> Iterator[Learned]:
    """Yield the runs whose problem says that its answers are learned, with the headline figure."""
    for row in found.rows:
        record = found.records.get(row.run_id or "")
        case = portrait_of(record) if record is not None else None
        if record is None or case is None or not case.learns or not row.primary or row.status not in ANSWERED:
            continue
        if row.value is None or row.reference is None:
            continue
        trained = [step for step in record.history if row.quantity in step.quantities]
        errors = tuple(abs(step.quantities[row.quantity] - row.reference) for step in trained)
        yield Learned(row, record, tuple(step.iteration for step in trained), errors)


def table(runs: Sequence[Learned]) -> Table:
    """Return the table of epochs, parameters and seconds to errors."""
    names = {f"to_{error:g}": error for error in ERRORS}
    lines: list[dict[str, Any]] = []
    for run in runs:
        row = run.row
        line: dict[str, Any] = {"block": row.case_title or row.case, "case": row.case, "run": run.name}
        line |= {"parameters": run.record.parameters, "seconds": row.seconds, "error": run.error}
        line |= {"relative": PERCENT * run.error / abs(row.reference) if row.reference else None}
        line |= {"epochs": run.epochs[-1] if run.epochs else None}
        lines.append(line | {name: None if row.reference else run.reaches(error) for name, error in names.items()})
    columns: tuple[str | Column, ...] = (
        column("run", "Run", words),
        column("parameters", "Parameters", count),
        column("seconds", "Seconds", seconds),
        column("error", "Error", significant(3)),
        column("relative", "Relative (%)", significant(3)),
        column("epochs", "Epochs", count),
        *(column(name, f"to {error:g}", count) for name, error in names.items()),
    )
    return Table(
        name="learned",
        title="Parameters and epochs",
        caption="Headline error in its unit, and relative to the known value; where that is zero, the first epoch that"
        " was looked at with an error so small. A dash where there was none, or where nothing is trained.",
        data=frame(lines, ["block", "case", "run", "parameters", "seconds", "error", "relative", "epochs", *names]),
        columns=columns,
    )


def course_exhibits(runs: Sequence[Learned], found: Evidence) -> Iterator[Exhibit]:
    """Yield the figure of a problem that something was trained on: errors against epochs, parameters and seconds."""
    if not any(run.epochs for run in runs) or len(runs) < 2:
        return
    row = runs[0].row
    title = row.case_title or row.case
    yield Exhibit(
        name=f"{LEARNED}{row.case}",
        title=f"{title}: error against epochs, parameters and seconds",
        caption=f"Error of the headline figure, {row.description or row.quantity}. Lines: what is trained, epoch by"
        " epoch. Marks: answers, those of one solver joined where they differ in one setting. Epochs of different"
        " fields cost differently, and what is solved for has none.",
        description="; ".join(f"{run.name}: {run.error:.2g} {row.unit}" for run in runs),
        figure=course_figure(runs, found),
        run_ids=tuple(run.record.run_id for run in runs),
    )


def course_figure(runs: Sequence[Learned], found: Evidence) -> Figure:
    """Draw the panels."""
    figure, panels = panel.open_figure((PANEL * 3, TALL + MARGIN), 1, 3, sharey=True)
    dashes = _dashes(runs)
    entries: dict[str, Any] = {}
    for run in (run for run in runs if run.epochs):
        look = found.inks[run.row.solver], dashes[run.name]
        panel.draw(panels[0, 0], run.epochs, run.errors, *look)
        entries[run.name] = panel.entry(look[0], linestyle=look[1])
    solved = grouped([run for run in runs if not run.epochs], lambda run: (run.row.solver, _family(run)))
    groups = [*([run] for run in runs if run.epochs), *(list(group) for group in solved.values())]
    for group in groups:
        ink, dash = found.inks[group[0].row.solver], dashes[group[0].name]
        by_size = sorted(group, key=lambda run: run.record.parameters or 0)
        errors = [run.error for run in by_size]
        panel.draw(panels[0, 1], [run.record.parameters or 0 for run in by_size], errors, ink, dash)
        panel.draw(panels[0, 2], [run.row.seconds or 0.0 for run in by_size], errors, ink, dash)
        if not group[0].epochs:
            entries[_family(group[0])] = panel.entry(ink, linestyle=dash)
    unit = f" ({runs[0].row.unit})" if runs[0].row.unit else ""
    panel.finish([panels[0, 0]], "epochs", f"error{unit}")
    for axes, label in zip(panels[0, 1:], ("parameters", "wall time (s)"), strict=True):
        panel.finish([axes], label)
    panel.add_legend(figure, entries, 3)
    return figure


def _family(run: Learned) -> str:
    """Return the name without the value of a setting that a suite sweeps over."""
    head, comma, last = run.name.rpartition(", ")
    return head if comma and any(sign.isdigit() for sign in last) else run.name


def _dashes(runs: Sequence[Learned]) -> dict[str, Dashes]:
    """Return the dashes of runs: those of one solver have different ones."""
    found: dict[str, Dashes] = {}
    for of_solver in grouped(runs, lambda run: run.row.solver).values():
        families = list(dict.fromkeys(map(_family, of_solver)))
        found |= {run.name: DASHES[families.index(_family(run)) % len(DASHES)] for run in of_solver}
    return found


def samples(runs: Sequence[Learned], found: Evidence) -> Iterator[Exhibit]:
    """Yield the figure of densities that samples follow, and of the samples, run by run."""
    by_draws = sorted(runs, key=lambda run: not run.epochs)  # what is trained first: its samples are drawn
    kept = [(run, arrays) for run in by_draws if (arrays := kept_samples(run, found)) is not None]
    shown = [(run, arrays) for run, arrays in kept if np.ptp(arrays[0]) > 0][:MOST_DRAWN]
    if not shown:
        return
    row = shown[0][0].row
    title = row.case_title or row.case
    figure, panels = panel.open_figure((2.3 * len(shown) + 0.6, 2.9), 1, len(shown), sharey=True)
    top = max(float(density.max()) for _, (density, _) in shown)
    for axes, (run, (density, points)) in zip(panels[0], shown, strict=True):
        picture = axes.imshow(
            density.T, origin="lower", extent=(0, 1, 0, 1), vmin=0, vmax=top, cmap="Blues", interpolation="nearest"
        )
        axes.scatter(*points[:: max(1, len(points) // DOTS)].T, s=1.0, color="black", linewidths=0)
        axes.set_title(plain(run.name).replace(", ", ",\n", 1), loc="left")
        axes.set_xlabel("u")
        axes.grid(visible=False)
    panels[0, 0].set_ylabel("v")
    figure.colorbar(picture, ax=list(panels[0]), label="density, even samples: 1", shrink=0.8)
    yield Exhibit(
        name=f"{SAMPLES}{row.case}",
        title=f"{title}: where samples go",
        caption="Density that adaptive samples follow at the end, and the samples of the last epoch, or the points"
        " at which losses were integrated. Half of the samples follow the density unless the run says otherwise.",
        description="; ".join(f"{run.name}: density to {density.max():.2g}" for run, (density, _) in shown),
        figure=figure,
        run_ids=tuple(run.record.run_id for run, _ in shown),
    )


def kept_samples(run: Learned, found: Evidence) -> tuple[Array, Array] | None:
    """Return the density by cells and the points that a run kept; None if it kept none."""
    case = portrait_of(run.record)
    if case is None or case.sampled is None or run.record.fields_file is None:
        return None
    try:
        with np.load(found.folder / run.record.fields_file, allow_pickle=False) as stored:
            density, points = (stored[name] for name in case.sampled)
    except (OSError, KeyError, ValueError):
        return None
    return density, points
