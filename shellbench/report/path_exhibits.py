"""The figures of non-linear cases: curves, shapes along the path, and the ablation of strains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from shellbench.bench import catalog
from shellbench.bench.portraits import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.reference import KnownValues
from shellbench.bench.row import Row
from shellbench.report.curve_figure import CurvePanel, curve_figure
from shellbench.report.exhibit import Exhibit
from shellbench.report.motion_exhibits import is_cloth
from shellbench.report.palette import Ink, inks
from shellbench.report.paths import (
    PathRun,
    known_paths,
    limit_loads,
    path_run,
    readable,
    runs_by_case,
)
from shellbench.report.scene import states
from shellbench.report.shells import scale_words
from shellbench.report.solutions import Known
from shellbench.report.states import spread, states_figure
from shellbench.report.strains import INKS, STRAIN, STRAINS, SUITE, bending_energies, rolled_figure, strain_rows

CURVE, STATES = "curve_", "states_"  # how names of figures begin
FEWEST = 2  # kept states that are worth standing side by side


def path_exhibits(records: Mapping[str, Record], rows: Sequence[Row], folder: Path, known: Known) -> Iterator[Exhibit]:
    """Yield the figures of all paths that runs left; see `shellbench.report.exhibits.exhibits`."""
    headline = [row for row in rows if row.primary]
    colours = inks(row.solver for row in rows)
    default = [row for row in headline if row.default_settings]
    for (name, own), runs in runs_by_case(records, default).items():
        values = KnownValues() if own else known(name)
        paths = [(record, row.solver) for row, record in runs]
        if exhibit := _curves(f"{CURVE}{name}", paths, values, colours):
            yield exhibit
    for runs in runs_by_case(records, default).values():
        case = portrait_of(runs[0][1])
        if case is not None and not is_cloth(case) and (exhibit := _states(runs, folder)):
            yield exhibit
    yield from _strains(records, rows, known)


def _curves(
    name: str, made: Sequence[tuple[Record, str]], known: KnownValues, colours: Mapping[str, Ink], about: str = ""
) -> Exhibit | None:
    case = portrait_of(made[0][0])
    if case is None:
        return None
    runs = [run for record, legend in made if (run := path_run(record, case, legend)) is not None]
    series = [one for one in case.paths if any(one.name in run.displacements for run in runs)]
    if not series:
        return None
    load = case.load_axis
    turning = case.controlled_by is not None
    panels = [CurvePanel(one, tuple(known_paths(case, known, one))) for one in series]
    figure = curve_figure(panels, runs, load, colours, turning=turning, limit_loads=limit_loads(case, known))
    shown = "; ".join(f"{one.name}: {one.description}" for one in series if one.description)
    failures = " ".join(dict.fromkeys(_failure(run) for run in runs if run.reason))
    return Exhibit(
        name=name,
        title=f"{case.title}: {about or 'load against displacement'}",
        caption="Marks on the lines are computed states; between them the lines only guide the eye. Open circles: known"
        " values that judge. Crosses: figures from elsewhere, of the theory named."
        f" {'Diamonds: limit points of the computed curves. ' if turning else ''}{failures}".rstrip(),
        description=f"{load.label} against {shown or ', '.join(readable(one.name) for one in series)}; "
        + "; ".join(f"{run.name}: {len(run.factors) - 1} states" for run in runs),
        figure=figure,
        run_ids=tuple(run.run_id for run in runs),
        drawing=True,
    )


def _failure(run: PathRun) -> str:
    seed = "" if run.seed is None else f", seed {run.seed}"
    return f"{run.name}{seed} failed: {(run.reason or '').rstrip('.')}."


def _states(runs: Sequence[tuple[Row, Record]], folder: Path) -> Exhibit | None:
    """Draw the states of the best run that kept some: a good one, a certain one, one of small error."""
    ranked = sorted(
        runs, key=lambda run: (run[1].status != "ok", run[0].seed is not None, abs(run[0].relative_error or 0.0))
    )
    for row, record in ranked:
        kept = states(record, folder)
        if len(kept) < FEWEST:
            continue
        shown = spread(kept)
        left_out = f" {len(shown)} of {len(kept)} kept states." if len(shown) < len(kept) else ""
        return Exhibit(
            name=f"{STATES}{record.case_name}",
            title=f"{shown[0][1].title}: shapes along the path",
            caption=f"The deformed shell, {scale_words(shown[0][1])}, with the reference surface as a wire.{left_out}"
            f" Solved by {row.solver}{'' if record.status == 'ok' else f', which failed later: {record.reason}'}.",
            description="; ".join(
                f"{mark}: displacement from {one.coloured.min():.3g} {one.unit} to {one.coloured.max():.3g} {one.unit}"
                for mark, one in shown
            ),
            figure=states_figure(shown),
            run_ids=(record.run_id,),
            drawing=False,
        )
    return None


def _strains(records: Mapping[str, Record], rows: Sequence[Row], known: Known) -> Iterator[Exhibit]:
    shown = strain_rows(rows)
    rolled = catalog.find_suite(SUITE).rolled if SUITE in catalog.suite_names() else None
    energies = bending_energies(records, rows, rolled or "")
    ids = tuple(dict.fromkeys(row.run_id for row in shown if row.case == rolled and row.run_id))
    case = portrait_of(records[ids[0]]) if ids and ids[0] in records else None
    stiffness = case.rolling_stiffness if case is not None else None
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
            drawing=True,
        )
    for (name, own), runs in runs_by_case(records, [row for row in shown if row.primary]).items():
        ordered = sorted(runs, key=lambda run: STRAINS.index(run[0].label))
        paths = [(record, row.label) for row, record in ordered]
        values = KnownValues() if own else known(name)
        if len(paths) > 1 and (exhibit := _curves(f"{STRAIN}{name}", paths, values, INKS, "the strain measures")):
            yield exhibit
