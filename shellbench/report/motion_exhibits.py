"""The figures of cloth: trajectories, energies, how far solvers are apart, strips of frames; torque along a path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.reference import KnownValues
from shellbench.bench.row import Row
from shellbench.portrait import Along, Portrait
from shellbench.report.exhibit import Exhibit
from shellbench.report.fields import Fields, read_fields
from shellbench.report.frames import MOST_FRAMES, Strip, strips_figure
from shellbench.report.moving_fields import apart, frame_at, shown_marks
from shellbench.report.palette import Ink, inks
from shellbench.report.paths import readable, runs_by_case
from shellbench.report.scene import drawn
from shellbench.report.shells import Shell, scale_words
from shellbench.report.solutions import Known
from shellbench.report.suites import leading_rows
from shellbench.report.trace_figure import TracePanel, trace_figure
from shellbench.report.traces import BALANCE, TracedRun, known_points, traced

MOTION, ENERGY, APART, FRAMES = "motion_", "energy_", "apart_", "frames_"  # how names of figures begin
BUCKLING = "buckling_"
CLOTH = (MOTION, ENERGY, APART, BUCKLING, FRAMES)
TIME = "time t (s)"
COMPONENTS = ("x", "y", "z")
DRIFT_SHOWN = 1e-3  # of the largest energy: what is smaller is drawn as the rounding that it may be
Runs = Sequence[tuple[Row, Record]]


def is_cloth(case: Portrait) -> bool:
    """Tell whether a case moves, or is followed through buckling: whether its shapes are shown as strips."""
    return case.ends is not None or case.buckles


def motion_exhibits(
    records: Mapping[str, Record], rows: Sequence[Row], folder: Path, known: Known
) -> Iterator[Exhibit]:
    """Yield the figures of all motions, and of paths through buckling; see `shellbench.report.exhibits.exhibits`."""
    colours = inks(row.solver for row in rows)
    headline = leading_rows([row for row in rows if row.primary])
    for (name, own), runs in runs_by_case(records, headline).items():
        case = portrait_of(runs[0][1])
        if case is None or not is_cloth(case):
            continue
        values = KnownValues() if own else known(name)
        left = [run for row, record in runs if (run := traced(record, case, row.solver)) is not None]
        if left and case.ends is not None:
            yield from _motion(name, case, left, values, colours)
            yield from _apart(name, case, runs, folder, colours)
        elif left:
            yield from _buckling(name, case, left, values, colours)
        yield from _frames(name, case, runs, folder)


def _motion(
    name: str, case: Portrait, runs: Sequence[TracedRun], known: KnownValues, colours: Mapping[str, Ink]
) -> Iterator[Exhibit]:
    where = [one for one in case.along if any(one.name in run.traces for run in runs)]
    if where:
        panels = [_panel(one, case, known) for one in where]
        yield Exhibit(
            name=f"{MOTION}{name}",
            title=f"{case.title}: trajectories",
            caption=f"Positions, and forces of supports where they are asked for, over time. {_legend(panels, runs)}",
            description="; ".join(_described(one, runs) for one in where),
            figure=trace_figure(panels, runs, TIME, colours, _columns(where)),
            run_ids=tuple(run.run_id for run in runs),
            drawing=True,
        )
    stored = [one for one in case.energies if any(one.name in run.traces for run in runs)]
    largest = max(
        (abs(run.traces[o.name].values).max() for run in runs for o in stored if o.name in run.traces), default=0
    )
    panels = [
        _panel(one, case, known, DRIFT_SHOWN * largest, (BALANCE,) if one.name == "total_energy" else ())
        for one in stored
    ]
    if not any(one.name == "total_energy" for one in stored) and any(BALANCE in run.traces for run in runs):
        panels.append(TracePanel((BALANCE,), "energy balance (J)", smallest=DRIFT_SHOWN * largest))
    balance = (
        " The total energy, or the balance, is that of motion, strain and springs less the work that was done; by"
        " Newton's law it stays zero."
    )
    yield Exhibit(
        name=f"{ENERGY}{name}",
        title=f"{case.title}: energies",
        caption=f"Energies of the whole shell over time. {_legend(panels, runs)}{balance}",
        description="; ".join(_described(one, runs) for one in stored),
        figure=trace_figure(panels, runs, TIME, colours, 2),
        run_ids=tuple(run.run_id for run in runs),
        drawing=True,
    )


def _apart(name: str, case: Portrait, runs: Runs, folder: Path, colours: Mapping[str, Ink]) -> Iterator[Exhibit]:
    found = apart(runs, folder)
    if not found:
        return
    against = next(iter(found.values())).against
    drawn_runs = [
        TracedRun(row.solver, row.seed, record.run_id, _reason(record), {"rms": found[record.run_id].rms})
        for row, record in runs
        if record.run_id in found
    ]
    words = []
    for run in drawn_runs:
        at, largest = found[run.run_id].largest
        words.append(f"{_named(run)}: at most {largest:.2g} m, at {at:.3g} s")
    yield Exhibit(
        name=f"{APART}{name}",
        title=f"{case.title}: difference from {against}",
        caption=f"Root of the mean square, over the surface, of the difference between a solver's displacement and that"
        f" of {against}, at each kept frame. {'. '.join(words)}.",
        description="; ".join(words),
        figure=trace_figure([TracePanel(("rms",), "difference (m)", logarithmic=True)], drawn_runs, TIME, colours),
        run_ids=tuple(run.run_id for run in drawn_runs),
        drawing=True,
    )


def _buckling(
    name: str, case: Portrait, runs: Sequence[TracedRun], known: KnownValues, colours: Mapping[str, Ink]
) -> Iterator[Exhibit]:
    shown = [one for one in case.along if any(one.name in run.traces for run in runs)]
    panels = [_panel(one, case, known) for one in shown]
    if not panels:
        return
    critical = "; ".join(
        f"{_named(run)}: {run.critical[one.name][1]:.4g} {one.quantity.unit} at {run.critical[one.name][0]:.4g}"
        for one in shown
        for run in runs
        if one.name in run.critical
    )
    yield Exhibit(
        name=f"{BUCKLING}{name}",
        title=f"{case.title}: {' and '.join(readable(one.name) for one in shown)} along the path",
        caption=f"{_legend(panels, runs)} Diamonds: the critical state, at which the shell can buckle"
        f"{f' ({critical})' if critical else ''}; beyond it a buckled shape is followed.",
        description="; ".join(_described(one, runs) for one in shown),
        figure=trace_figure(panels, runs, case.load_words, colours),
        run_ids=tuple(run.run_id for run in runs),
        drawing=True,
    )


def _frames(name: str, case: Portrait, runs: Runs, folder: Path) -> Iterator[Exhibit]:
    best: dict[str, tuple[Record, Fields]] = {}
    ranked = sorted(runs, key=lambda run: (run[1].status != "ok", run[0].seed or 0, abs(run[0].relative_error or 0.0)))
    for row, record in ranked:
        fields = read_fields(record, folder) if row.solver not in best else None
        if fields is not None and len(fields.marks):
            best[row.solver] = record, fields
    marks = shown_marks(case, {solver: fields for solver, (_, fields) in best.items()}, MOST_FRAMES)
    if not marks:
        return
    together = [fields for _, fields in best.values()]
    strips = [
        Strip(solver, tuple(_frame(record, case, fields, mark, together) for mark in marks))
        for solver, (record, fields) in sorted(best.items(), key=lambda item: item[1][0].identity.seed is not None)
    ]
    first = next((shell for strip in strips for shell in strip.shells if shell is not None), None)
    if first is None:
        return
    failed = "".join(
        f" {solver} failed: {(record.reason or record.status).rstrip('.')}."
        for solver, (record, _) in best.items()
        if record.status != "ok"
    )
    words = [case.mark_words(mark) for mark in marks]
    yield Exhibit(
        name=f"{FRAMES}{name}",
        title=f"{case.title}: {'frames of the motion' if case.ends else 'shapes along the path'}",
        caption=f"A row for each solver, one view and one scale for all; the deformed shell is drawn"
        f" {scale_words(first)}, the reference surface as a wire.{failed}",
        description="; ".join(
            f"{strip.solver}, {at}: displacement from {shell.coloured.min():.3g} {shell.unit} to"
            f" {shell.coloured.max():.3g} {shell.unit}"
            for strip in strips
            for at, shell in zip(words, strip.shells, strict=True)
            if shell is not None
        ),
        figure=strips_figure(strips, words),
        run_ids=tuple(record.run_id for record, _ in best.values()),
        drawing=False,
    )


def _frame(record: Record, case: Portrait, fields: Fields, mark: float, among: Sequence[Fields]) -> Shell | None:
    place = frame_at(fields, mark)
    return None if place is None else drawn(record, case, fields, fields.displacements[place], among)


def _panel(
    one: Along, case: Portrait, known: KnownValues, smallest: float = 0.0, instead: tuple[str, ...] = ()
) -> TracePanel:
    unit = f" ({one.quantity.unit})" if one.quantity.unit else ""
    return TracePanel(
        names=(one.name, *instead),
        label=f"{readable(one.name)}{unit}",
        title=one.quantity.description,
        known=tuple(known_points(case, known, one)),
        smallest=smallest,
    )


def _columns(series: Sequence[Along]) -> int:
    """Return how many panels to put in a row: the components of a point stand side by side."""
    components = {one.name.rpartition("_")[2] for one in series} & set(COMPONENTS)
    return max(2, len(components)) if components else 3


def _legend(panels: Sequence[TracePanel], runs: Sequence[TracedRun]) -> str:
    """Say what marks are seen, and which runs failed."""
    points = [points for panel in panels for points in panel.known]
    words = []
    if any(one.judges for one in points):
        words.append("Open circles: known values, with their uncertainty.")
    if any(not one.judges for one in points):
        words.append("Crosses: figures of other origin.")
    words += dict.fromkeys(f"{_named(run)} failed: {run.reason.rstrip('.')}." for run in runs if run.reason)
    return " ".join(words) or "A line for each run."


def _described(one: Along, runs: Sequence[TracedRun]) -> str:
    ends = []
    for run in runs:
        if one.name in run.traces:
            values = run.traces[one.name].values
            ends.append(f"{_named(run)} from {values[0]:.3g} to {values[-1]:.3g} {one.quantity.unit}")
    return f"{readable(one.name)}: {', '.join(ends)}"


def _named(run: TracedRun) -> str:
    return run.name if run.seed is None else f"{run.name}, seed {run.seed}"


def _reason(record: Record) -> str | None:
    return None if record.status == "ok" else record.reason or record.status
