"""Convergence, memory and consistency of cases whose runs at many resolutions are not in the store, from kept ones.

The suite `resolution` takes an hour. A summary of its runs is committed, and ships, as reports/resolution.json. A page
shows it beside the runs of its own store and marks both apart. Errors of both are against the known value as it is now.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from statistics import fmean

from matplotlib.figure import Figure

from shellbench.bench.judge.row import Row
from shellbench.report.data.accuracy import SMALLEST, CaseAccuracy, Family, Measure, Point, family, sizes
from shellbench.report.data.columns import Line, column, frame, share, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, Ink, inks
from shellbench.report.data.kept_data import (
    Apart,
    KeptCase,
    KeptRun,
    Made,
    Sweeps,
    largest_apart,
    main_sweeps,
    read_summary,
    sweeps_of,
)
from shellbench.report.data.notation import Notation
from shellbench.report.data.rates import known_yardstick
from shellbench.report.data.runs import grouped, headlines, seed_words
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table
from shellbench.report.figures import panel
from shellbench.report.sections.cost import cost_figure
from shellbench.report.sections.resolution import of_largest

MEASURES: tuple[Measure, ...] = ("storage", "memory", "seconds")
COMPARED = 3  # finest sizes of a sweep whose displacements stand beside each other
WIDTH, HEIGHT, MARGIN = 3.5, 2.3, 0.45  # inches: a panel, its height, and the legend
LEAST = 1e-10  # difference relative to the largest displacement below which rounding is all there is
FAILED = ("failed", "timeout")
OWN, KEPT = "this report", "kept"


def section(evidence: Evidence) -> Section | None:
    """Return the section; None without a summary, or if the store has the runs of all its cases itself."""
    shown = headlines(evidence.runs)
    shown = shown[shown["compared"]]
    if shown.empty or (summary := read_summary()) is None:
        return None
    studied = headlines(evidence.runs, "resolution")
    missing = set(shown["case"]) - set(studied.loc[~studied["default_settings"], "case"])
    cases = [case for case in summary.cases if case in missing]
    lines = {case: sweeps_of([run for run in summary.runs if run.case == case]) for case in cases}
    failed = grouped([run for run in summary.runs if run.status in FAILED], lambda run: run.case)
    found = [one for case in cases if (one := _accuracy(evidence, case, lines[case], failed.get(case, ()))) is not None]
    about = {case: summary.cases[case] for case in cases}
    solvers = {run.solver for run in summary.runs}
    tables = given(size_table(found, finest_only=True), point_table(about, lines))
    if not tables:
        return None
    return Section(
        name="kept",
        title="Many resolutions",
        words=tuple(_words(summary.made)),
        tables=tables,
        exhibits=tuple(_exhibits(inks([*evidence.inks, *solvers]), found, about, lines)),
        details=given(size_table(found, finest_only=False)),
        place="its suites",
    )


def _words(made: Made) -> Iterator[str]:
    machine = ", ".join(filter(None, (made.processor, f"{made.cores} cores" if made.cores else "")))
    yield (
        "Elements, fields and the mesh simulator were asked for the same shells at many resolutions. These runs are"
        f" kept: they were made by commit {made.commit[:12]} on {made.date} ({machine or 'machine not stated'}), with"
        f" {made.threads or 'an unknown number of'} thread(s) each. Runs of this report's own store stand beside them:"
        f" marks with a black rim, and lines that say “{OWN}”. Seconds of the two compare only on the same machine."
    )
    yield (
        "Errors of both are against the known value, and a line of a figure is one sweep; with several seeds a mark is"
        " their geometric mean. Displacements are compared at the same material points and marks of all runs."
        " Every continuous field, of finite elements as of a network, repeats its answer at the same point through any"
        " grid: that is a property of continuity, no merit of a solver. What tells solvers apart is how far"
        " discretisations are from each other, and from the common run."
    )


def _accuracy(evidence: Evidence, case: str, sweeps: Sweeps, failed: Sequence[KeptRun]) -> CaseAccuracy | None:
    """Return errors and cost of a case: a family for each kept sweep, and one without a sweep for each own solver."""
    runs = headlines(evidence.runs)
    runs = runs[(runs["case"] == case) & runs["default_settings"]]
    rows: list[Row] = list(runs["row"])
    yardstick = known_yardstick(evidence.records, rows)
    if yardstick is None:
        return None
    own = grouped(sizes(runs, yardstick), lambda point: point.rows[0].solver)
    families = [family(solver, "", points) for solver, points in own.items()]
    for (solver, swept, _), of_sweep in sweeps.items():
        points = [
            _point(alike, tuple(max(SMALLEST, abs(yardstick.error(run.value or 0.0))) for run in alike))
            for alike in grouped(of_sweep, lambda run: run.label).values()
        ]
        families.append(family(solver, swept or "default settings", points))
    lost = {
        solver: [f"{run.label}{seed_words(run.seed)}: {run.reason or run.status}" for run in runs]
        for solver, runs in grouped(failed, lambda run: run.solver).items()
    }
    return CaseAccuracy(rows[0], yardstick, tuple(families), lost, ())


def _point(alike: Sequence[KeptRun], errors: tuple[float, ...]) -> Point:
    """Return the runs of one size, which differ in their seed alone."""
    memory = [run.memory for run in alike if run.memory is not None]
    return Point(
        unknowns=max(run.unknowns or 0 for run in alike),
        seconds=fmean(run.seconds or 0.0 for run in alike),
        memory=max(memory, default=None),
        errors=errors,
        sound=all(run.status == "ok" for run in alike),
        run_ids=tuple(run.run_id for run in alike),
        rows=(),
        storage=max((run.storage or 0 for run in alike), default=0) or None,
        label=alike[0].label,
    )


def size_table(found: Sequence[CaseAccuracy], *, finest_only: bool) -> Table:
    """Return error and cost of own runs and of kept ones, of these of the finest size of each sweep or of all."""
    lines = [
        {
            "block": one.title,
            "case": one.case,
            "solver": each.solver,
            "rows": KEPT if each.swept else OWN,
            "run": point.label if each.swept else "default settings",
            "unknowns": point.unknowns,
            "seconds": point.seconds,
            "storage_bytes": point.storage,
            "solve_memory_bytes": point.memory,
            "worst": max(point.errors),
            "seeds": len(point.errors),
            "run_ids": " ".join(point.run_ids),
        }
        for one in found
        for each in sorted(one.families, key=lambda each: (each.solver, bool(each.swept)))
        if not (finest_only and each.swept) or each is _longest(one, each.solver)
        for point in (each.points[-1:] if finest_only else each.points)
    ]
    return Table(
        name="kept_runs" if finest_only else "kept_all_runs",
        title="Runs of this report and kept runs",
        caption="Error of the headline quantity against its known value, the worst of the seeds, with unknowns, wall"
        " time, bytes that keep the solution and peak memory of the solve above what its process held before."
        f" {OWN.capitalize()}: from its own store, with default settings; {KEPT}: from the summary"
        + (", the finest size of each solver's longest sweep." if finest_only else ", all sizes."),
        data=frame(lines),
        columns=(
            "solver",
            column("rows", "From", words),
            "run",
            "unknowns",
            "seconds",
            "storage_bytes",
            "solve_memory_bytes",
            column("worst", "Error", share),
            "seeds",
        ),
        notes=tuple(note for one in found for note in one.failures(" among the kept runs and are left out")),
    )


def _longest(one: CaseAccuracy, solver: str) -> Family:
    """Return the kept sweep of a solver that has most sizes."""
    return next(each for each in one.of(solver) if each.swept)


def point_table(about: Mapping[str, KeptCase], lines: Mapping[str, Sweeps]) -> Table:
    """Return the distances of the finest discretisations of each solver from each other and from the common run."""
    found = []
    for case, sweeps in lines.items():
        for solver, runs in main_sweeps(sweeps):
            finest = ([run for run in runs if run.displacement] or list(runs))[-COMPARED:]
            steps = [largest_apart(one, other) for one, other in pairwise(finest)]
            is_common = finest[-1].run_id == about[case].common_run
            found.append(
                {
                    "block": about[case].title,
                    "case": case,
                    "solver": solver,
                    "discretisations": ", ".join(run.label for run in finest),
                    "first": steps[0] if len(steps) > 1 else None,
                    "last": steps[-1] if steps else None,
                    "probes": finest[-1].from_coarser.largest if finest[-1].from_coarser else None,
                    "common": finest[-1].from_common.largest if finest[-1].from_common else None,
                    "is_common": is_common,
                    "largest_displacement": about[case].scale,
                    "run_ids": " ".join(run.run_id for run in finest),
                }
            )
    return Table(
        name="kept_points",
        title="Three discretisations at common points",
        caption="Largest difference of the displacement between successive ones of the three finest discretisations of"
        " a sweep (lowest seed) at five common points and up to three marks; of the last step also over all points that"
        " were asked; and of the finest from the common run. Relative to the largest displacement; kept with six"
        " digits, so that 0 is less than 1e-6 of a displacement. A small step is no small error: see the distance from"
        " the common run.",
        data=frame(found),
        columns=(
            "solver",
            column("discretisations", "Discretisations", words),
            column("first", "First step", of_largest),
            column("last", "Last step", of_largest),
            column("probes", "Last step, all points", of_largest),
            column("common", "From the common run", of_largest, instead=_is_common),
        ),
    )


def _common_words(case: KeptCase, sweeps: Sweeps) -> str:
    """Return a note: the common run, and the solver that is compared with its own run."""
    for of_sweep in sweeps.values():
        for run in of_sweep:
            if run.run_id == case.common_run:
                return (
                    f"The common run is of {run.solver}, {run.label or 'default settings'}: the left curve of that"
                    " solver tells how it converges; how right it is, the error against the known value does."
                )
    return ""


def _is_common(line: Line, notation: Notation) -> str:
    return notation.escape("itself") if line["is_common"] else notation.missing


def _exhibits(
    colours: Mapping[str, Ink],
    found: Sequence[CaseAccuracy],
    about: Mapping[str, KeptCase],
    lines: Mapping[str, Sweeps],
) -> Iterator[Exhibit]:
    for one in found:
        own = tuple(run for each in one.families if not each.swept for point in each.points for run in point.run_ids)
        yield Exhibit(
            name=f"kept_convergence_{one.case}",
            title=f"{one.title}: error and cost",
            caption=f"Error of the {one.quantity} against unknowns, wall time and peak memory of the solve (above what"
            f" the process held before). Errors are against {one.yardstick.words}. Lines: sweeps of kept runs, a mark"
            " for each size, with several seeds their geometric mean and a bar from the least to the largest."
            f" {panel.FLOOR_WORDS} Black rims: runs of this report with default settings. Dashed, with the exponent at"
            " the right: slopes fitted to the finest sizes at which errors still fall.",
            description=f"{one.title}: error of {', '.join(one.solvers)} against unknowns, seconds and memory",
            figure=cost_figure(one, colours, "default settings, this report"),
            run_ids=own,
        )
        figure = consistency_figure(about[one.case], dict(main_sweeps(lines[one.case])), colours)
        if figure is not None:
            yield Exhibit(
                name=f"kept_consistency_{one.case}",
                title=f"{one.title}: resolution consistency",
                caption="Kept runs: largest difference of the displacement from the common run and from the next"
                " coarser run of the same sweep, over the same material points and marks, relative to the largest"
                " displacement."
                f" {_common_words(about[one.case], lines[one.case])}",
                description=f"{one.title}: differences between resolutions",
                figure=figure,
                run_ids=own,
            )


def consistency_figure(
    case: KeptCase, runs: Mapping[str, Sequence[KeptRun]], colours: Mapping[str, Ink]
) -> Figure | None:
    """Draw how far runs are from the common one and from the next coarser one; None if nothing moved."""
    if not case.scale:
        return None
    figure, ((left, right),) = panel.open_figure((2 * WIDTH, HEIGHT + MARGIN), 1, 2)
    for solver, of_solver in runs.items():
        ink = colours[solver]
        panel.draw(left, *_drawn(((run.unknowns, run.from_common) for run in of_solver), case.scale), ink)
        panel.draw(right, *_drawn(((run.unknowns, run.from_coarser) for run in of_solver), case.scale), ink)
    for axes, title in ((left, "From the common run"), (right, "From the next coarser run")):
        panel.finish([axes], "unknowns", "difference (% of the largest)", title)
    shown = {
        solver for solver, of_solver in runs.items() if any(run.from_common or run.from_coarser for run in of_solver)
    }
    panel.add_legend(figure, {solver: panel.entry(colours[solver]) for solver in runs if solver in shown})
    return figure


def _drawn(found: Iterable[tuple[int | None, Apart | None]], scale: float) -> tuple[list[int], list[float]]:
    """Return unknowns and differences, % of the largest displacement, that are more than rounding."""
    kept = [(x, 100 * apart.largest / scale) for x, apart in found if x and apart and apart.largest > LEAST * scale]
    return [x for x, _ in kept], [apart for _, apart in kept]
