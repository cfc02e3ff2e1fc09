"""The figures of what is followed: load against displacement and shapes of paths, the ablation of strains, and cloth.

Of a motion there are trajectories, energies, how far solvers are apart, and strips of frames; of a path through
buckling its torque and strips of shapes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValues
from shellbench.bench.store.record import Record, portrait_of
from shellbench.protocol.picture import Along, Portrait
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, Ink
from shellbench.report.data.fields import Fields, read_fields
from shellbench.report.data.traces import (
    APART,
    BALANCE,
    BUCKLING,
    CURVE,
    ENERGY,
    FILM,
    FRAMES,
    MOTION,
    STATES,
    TracedRun,
    apart,
    frame_at,
    known_paths,
    known_points,
    limit_loads,
    path_run,
    portrayed,
    readable,
    reason,
    shown_marks,
    traced,
)
from shellbench.report.figures.film import SECONDS, film
from shellbench.report.figures.pictures import drawn, spread, states
from shellbench.report.figures.shells import Shell, scale_words, shapes_figure
from shellbench.report.figures.trace_figure import TIME, TracePanel, trace_figure
from shellbench.report.studies.strains import INKS, STRAIN, STRAINS, SUITE, bending_energies, rolled_figure, strain_rows

FEWEST = 2  # kept states that are worth standing side by side
MOST_FRAMES = 5  # in a row: every fifth of the time of a motion
MOST_FILMED, MOST_SOLVERS = 21, 3  # frames of a film, and solvers side by side in it
MOST_IN_A_ROW, MANY_IN_A_ROW = 4, 3  # states that fill one row only, and several
COMPONENTS = ("x", "y", "z")
TOTAL = "total_energy"  # where it is not kept, the solver's own balance is drawn
DRIFT_SHOWN = 1e-3  # of the largest energy: what is smaller is drawn as the rounding that it may be


def is_cloth(case: Portrait) -> bool:
    """Tell whether a case moves, or is followed through buckling: whether its shapes are shown as strips."""
    return case.ends is not None or case.buckles


def path_exhibits(evidence: Evidence) -> Iterator[Exhibit]:
    """Yield the figures of all paths that runs left."""
    default = list(_cases(evidence, evidence.made[evidence.made["default_settings"]]))
    for case, runs, values in default:
        made = list(zip(runs["record"], runs["solver"], strict=True))
        yield from _curves(f"{CURVE}{_name(runs)}", case, made, values, evidence.inks)
    for case, runs, _ in default:
        if not is_cloth(case):
            yield from _states(runs, evidence.folder)
    yield from _strains(evidence)


def motion_exhibits(evidence: Evidence) -> Iterator[Exhibit]:
    """Yield the figures of all motions, and of paths through buckling."""
    colours = evidence.inks
    for case, runs, values in _cases(evidence, evidence.made[evidence.made["leading"]]):
        if is_cloth(case):
            name, made = _name(runs), zip(runs["record"], runs["solver"], strict=True)
            left = [run for record, solver in made if (run := traced(record, case, solver)) is not None]
            if left and case.ends is not None:
                yield from _motion(name, case, left, values, colours)
                yield from _motion_differences(name, case, runs, evidence)
            elif left:
                yield from _buckling(name, case, left, values, colours)
            yield from _frames(name, case, runs, evidence.folder)


def _cases(evidence: Evidence, made: pd.DataFrame) -> Iterator[tuple[Portrait, pd.DataFrame, KnownValues]]:
    """Yield portrait, runs and known values of each case; of a user's own nothing is known."""
    for case, runs in portrayed(made):
        yield case, runs, KnownValues() if runs["own_case"].iloc[0] else evidence.known(_name(runs))


def _name(runs: pd.DataFrame) -> str:
    return str(runs["case"].iloc[0])


def _ranked(runs: pd.DataFrame, *first: str) -> pd.DataFrame:
    """Return runs in the order in which they are worth being shown: good ones, then by columns, then of small error."""
    size = runs["relative_error"].abs().fillna(0.0)
    ranked = runs.assign(failed=~runs["sound"], drawn=runs["seed"].notna(), seed=runs["seed"].fillna(0), size=size)
    return ranked.sort_values(["failed", *first, "size"], kind="stable")


def _curves(
    name: str,
    case: Portrait,
    made: Sequence[tuple[Record, str]],
    known: KnownValues,
    colours: Mapping[str, Ink],
    about: str = "load against displacement",
) -> Iterator[Exhibit]:
    runs = [run for record, legend in made if (run := path_run(record, case, legend)) is not None]
    series = [one for one in case.paths if any(one.name in run.traces for run in runs)]
    if not series:
        return
    load, limits = case.load_axis, tuple(limit_loads(case, known))
    panels = [
        TracePanel(
            names=(one.name,),
            label=_label(one.name, one.unit),
            along=load.label,
            title=one.description,
            known=tuple(known_paths(case, known, one)),
            load_scale=load.scale,
            limit_loads=limits,
        )
        for one in series
    ]
    shown = "; ".join(f"{one.name}: {one.description}" for one in series if one.description)
    diamonds = "Diamonds: limit points of the computed curves. " if case.controlled_by is not None else ""
    apart = "Buckled shapes may be turned or mirrored: there the lines of one point part. " if case.buckles else ""
    yield _drawing(
        name=name,
        title=f"{case.title}: {about}",
        caption="Marks on the lines are computed states; between them the lines only guide the eye. Open circles: known"
        " values that judge. Crosses: figures from elsewhere, of the theory named."
        f" {diamonds}{apart}{_failures(runs)}".rstrip(),
        description=f"{load.label} against {shown or ', '.join(readable(one.name) for one in series)}; "
        + "; ".join(f"{run.name}: {max(len(one.marks) for one in run.traces.values()) - 1} states" for run in runs),
        figure=trace_figure(panels, runs, colours, special="limit points"),
        runs=runs,
    )


def _states(runs: pd.DataFrame, folder: Path) -> Iterator[Exhibit]:
    """Draw the states of the best run that kept some: a good one, a certain one, one of small error."""
    ranked = _ranked(runs, "drawn")["record"]
    kept = ((record, found) for record in ranked if len(found := states(record, folder)) >= FEWEST)
    if (best := next(kept, None)) is None:
        return
    record, found = best
    shown = spread(found)
    words, shells = [words for words, _ in shown], [shell for _, shell in shown]
    columns = len(shells) if len(shells) <= MOST_IN_A_ROW else MANY_IN_A_ROW
    left_out = f" {len(shown)} of {len(found)} kept states." if len(shown) < len(found) else ""
    failed = f", which failed later: {record.reason}" if record.status != "ok" else ""
    yield Exhibit(
        name=f"{STATES}{record.case_name}",
        title=f"{shells[0].title}: shapes along the path",
        caption=f"The deformed shell, {scale_words(shells[0])}, with the reference surface as a wire.{left_out}"
        f" Solved by {record.identity.solver}{failed}.",
        description="; ".join(f"{mark}: {shell.words}" for mark, shell in shown),
        figure=shapes_figure([shells[at : at + columns] for at in range(0, len(shells), columns)], words),
        run_ids=(record.run_id,),
        drawing=False,
    )


def _strains(evidence: Evidence) -> Iterator[Exhibit]:
    shown, records = strain_rows(evidence), evidence.records
    rolled = catalog.find_suite(SUITE).rolled if SUITE in catalog.suite_names() else None
    energies = bending_energies(evidence, rolled or "")
    ids = tuple(dict.fromkeys(row.run_id for row in shown if row.case == rolled and row.run_id))
    plate = portrait_of(records[ids[0]]) if ids and ids[0] in records else None
    stiffness = plate.rolling_stiffness if plate is not None else None
    if stiffness is not None and (figure := rolled_figure(energies, stiffness)) is not None:
        yield Exhibit(
            name=f"{STRAIN}{rolled}",
            title="Bending energy of a rolled plate",
            caption="Left, the bending energy of a plate that is rolled to an angle, under each measure of strain, and"
            " in the middle relative to the exact one; lines are the closed forms. Right, the curvature that each"
            " measure sees at a point, relative to the true one: its square is the ratio of the bending stiffnesses.",
            description="; ".join(
                f"{strain}: " + ", ".join(f"{180 * at:.0f} degrees {value:.4g} J" for at, value in by_mark.items())
                for strain, by_mark in energies.items()
            ),
            figure=figure,
            run_ids=ids,
        )
    made = evidence.made[evidence.made["run_id"].isin({row.run_id for row in shown})]
    for case, runs, values in _cases(evidence, made):
        if len(runs) > 1:
            ordered = runs.sort_values("label", key=lambda labels: labels.map(STRAINS.index), kind="stable")
            paths = list(zip(ordered["record"], ordered["label"], strict=True))
            yield from _curves(f"{STRAIN}{_name(runs)}", case, paths, values, INKS, "the strain measures")


def _motion(
    name: str, case: Portrait, runs: Sequence[TracedRun], known: KnownValues, colours: Mapping[str, Ink]
) -> Iterator[Exhibit]:
    if where := _traced_series(case.along, runs):
        panels = [_panel(one, case, known) for one in where]
        components = {one.name.rpartition("_")[2] for one in where} & set(COMPONENTS)
        columns = max(2, len(components)) if components else 3  # the components of a point stand side by side
        yield _drawing(
            name=f"{MOTION}{name}",
            title=f"{case.title}: trajectories",
            caption=f"Positions, and forces of supports where they are asked for, over time. {_legend(panels, runs)}",
            description=_ends(where, runs),
            figure=trace_figure(panels, runs, colours, columns),
            runs=runs,
        )
    stored = _traced_series(case.energies, runs)
    values = [run.traces[one.name].values for run in runs for one in stored if one.name in run.traces]
    drift = DRIFT_SHOWN * max((abs(one).max() for one in values), default=0.0)
    panels = [_panel(one, case, known, drift) for one in stored]
    if not any(TOTAL in panel.names for panel in panels) and any(BALANCE in run.traces for run in runs):
        panels.append(TracePanel((BALANCE,), "energy balance (J)", smallest=drift))
    yield _drawing(
        name=f"{ENERGY}{name}",
        title=f"{case.title}: energies",
        caption=f"Energies of the whole shell over time. {_legend(panels, runs)} The total energy, or the balance, is"
        " that of motion, strain and springs less the work that was done; by Newton's law it stays zero.",
        description=_ends(stored, runs),
        figure=trace_figure(panels, runs, colours, 2),
        runs=runs,
    )


def _motion_differences(name: str, case: Portrait, runs: pd.DataFrame, evidence: Evidence) -> Iterator[Exhibit]:
    found = apart(runs, evidence.folder)
    if not found:
        return
    against = next(iter(found.values())).against
    shown = [
        TracedRun(record.identity.solver, record.identity.seed, record.run_id, reason(record), {"rms": one.rms})
        for record in runs["record"]
        if (one := found.get(record.run_id)) is not None
    ]
    largest = [(run.words, *found[run.run_id].largest) for run in shown]
    words = [f"{name}: at most {value:.2g} m, at {at:.3g} s" for name, at, value in largest]
    yield _drawing(
        name=f"{APART}{name}",
        title=f"{case.title}: difference from {against}",
        caption=f"Root of the mean square, over the surface, of the difference between a solver's displacement and that"
        f" of {against}, at each kept frame. {'. '.join(words)}.",
        description="; ".join(words),
        figure=trace_figure([TracePanel(("rms",), "difference (m)", logarithmic=True)], shown, evidence.inks),
        runs=shown,
    )


def _buckling(
    name: str, case: Portrait, runs: Sequence[TracedRun], known: KnownValues, colours: Mapping[str, Ink]
) -> Iterator[Exhibit]:
    shown = _traced_series(case.along, runs)
    panels = [_panel(one, case, known) for one in shown]
    if not panels:
        return
    critical = "; ".join(
        f"{run.words}: {value:.4g} {one.quantity.unit} at {mark:.4g}"
        for one in shown
        for run in runs
        for mark, value in run.special.get(one.name, ())
    )
    yield _drawing(
        name=f"{BUCKLING}{name}",
        title=f"{case.title}: {' and '.join(readable(one.name) for one in shown)} along the path",
        caption=f"{_legend(panels, runs)} Diamonds: the critical state, at which the shell can buckle"
        f"{f' ({critical})' if critical else ''}; beyond it a buckled shape is followed.",
        description=_ends(shown, runs),
        figure=trace_figure(panels, runs, colours),
        runs=runs,
    )


def _frames(name: str, case: Portrait, runs: pd.DataFrame, folder: Path) -> Iterator[Exhibit]:
    """Draw a row of shapes for each solver: of its runs a good one, of the lowest seed, of small error."""
    best: dict[str, tuple[Record, Fields]] = {}
    for record in _ranked(runs, "seed")["record"]:
        solver = record.identity.solver
        fields = read_fields(record, folder) if solver not in best else None
        if fields is not None and len(fields.marks):
            best[solver] = record, fields
    marks = shown_marks(case, {solver: fields for solver, (_, fields) in best.items()}, MOST_FRAMES)
    together, words = [fields for _, fields in best.values()], [case.mark_words(mark) for mark in marks]

    def strips_at(marks: Sequence[float]) -> dict[str, list[Shell | None]]:
        return {
            solver: [
                None if at is None else drawn(record, case, fields, fields.displacements[at], together)
                for at in (frame_at(fields, mark) for mark in marks)
            ]
            for solver, (record, fields) in sorted(best.items(), key=lambda item: item[1][0].identity.seed is not None)
        }

    strips = strips_at(marks)
    first = next((shell for strip in strips.values() for shell in strip if shell is not None), None)
    if first is None:
        return
    failed = "".join(
        f" {solver} failed: {why.rstrip('.')}." for solver, (record, _) in best.items() if (why := reason(record))
    )
    yield Exhibit(
        name=f"{FRAMES}{name}",
        title=f"{case.title}: {'frames of the motion' if case.ends else 'shapes along the path'}",
        caption=f"A row for each solver, one view and one scale for all; the deformed shell is drawn"
        f" {scale_words(first)}, the reference surface as a wire.{failed}",
        description="; ".join(
            f"{solver}, {at}: {shell.words}"
            for solver, strip in strips.items()
            for at, shell in zip(words, strip, strict=True)
            if shell is not None
        ),
        figure=shapes_figure(list(strips.values()), words, list(strips)),
        run_ids=tuple(record.run_id for record, _ in best.values()),
        drawing=False,
    )
    if case.ends is None:
        return
    every = shown_marks(case, {solver: fields for solver, (_, fields) in best.items()}, MOST_FILMED)
    filmed = dict(list(strips_at(every).items())[:MOST_SOLVERS])
    yield Exhibit(
        name=f"{FILM}{name}",
        title=f"{case.title}: film",
        caption=f"{len(every)} frames from {case.mark_words(every[0])} to {case.mark_words(every[-1])}, shown twice in"
        f" {2 * SECONDS:g} s; {scale_words(first)}.",
        description=f"the motion of the figure of its frames, by {' and '.join(filmed)}",
        figure=shapes_figure([row[-1:] for row in filmed.values()], words[-1:], list(filmed)),
        run_ids=tuple(best[solver][0].run_id for solver in filmed),
        drawing=False,
        film=lambda: film(list(filmed.values()), [case.mark_words(mark) for mark in every], list(filmed), 2),
    )


def _drawing(
    name: str, title: str, caption: str, description: str, figure: Figure, runs: Sequence[TracedRun]
) -> Exhibit:
    return Exhibit(name, title, caption, description, figure, tuple(run.run_id for run in runs))


def _traced_series(series: Sequence[Along], runs: Sequence[TracedRun]) -> list[Along]:
    """Return the series of which a run left a trace."""
    return [one for one in series if any(one.name in run.traces for run in runs)]


def _panel(one: Along, case: Portrait, known: KnownValues, smallest: float = 0.0) -> TracePanel:
    return TracePanel(
        names=(one.name, BALANCE) if one.name == TOTAL else (one.name,),
        label=_label(one.name, one.quantity.unit),
        along=TIME if case.ends is not None else case.load_words,
        title=one.quantity.description,
        known=tuple(known_points(case, known, one)),
        smallest=smallest,
    )


def _label(name: str, unit: str) -> str:
    return readable(name) + (f" ({unit})" if unit else "")


def _legend(panels: Sequence[TracePanel], runs: Sequence[TracedRun]) -> str:
    """Say what marks are seen, and which runs failed."""
    judges = {points.judges for panel in panels for points in panel.known}
    words = ["Open circles: known values, with their uncertainty."] if True in judges else []
    words += ["Crosses: figures of other origin."] if False in judges else []
    words += [failures] if (failures := _failures(runs)) else []
    return " ".join(words) or "A line for each run."


def _failures(runs: Sequence[TracedRun]) -> str:
    return " ".join(dict.fromkeys(f"{run.words} failed: {run.reason.rstrip('.')}." for run in runs if run.reason))


def _ends(series: Sequence[Along], runs: Sequence[TracedRun]) -> str:
    """Say where each trace begins and ends."""
    words = []
    for one in series:
        ends = [(run.words, run.traces[one.name].values) for run in runs if one.name in run.traces]
        unit = one.quantity.unit
        parts = (f"{name} from {values[0]:.3g} to {values[-1]:.3g} {unit}" for name, values in ends)
        words.append(f"{readable(one.name)}: {', '.join(parts)}")
    return "; ".join(words)
