"""Sampling: the densities that adaptive samples follow, where samples go, and what they do to the figure that is asked.

Of problems whose answers are fields, where at least one run kept a density. What is solved for uses the mean over all
draws, so that its bias is that of the functional; what is trained has also not settled.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shellbench.report.data.columns import Column, column, frame, significant, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.runs import grouped
from shellbench.report.data.section import Section, given
from shellbench.report.data.table import Table
from shellbench.report.figures import panel
from shellbench.report.studies.learned import PERCENT, Learned, kept_samples, learned, samples

Array = NDArray[np.float64]
BIAS = "bias_"  # how names of figures begin
EVEN, ADAPTIVE = "even", "adaptive"
WIDE, TALL = 4.6, 3.4  # inches


def section(found: Evidence) -> Section | None:
    """Return the section on samples; None if no run kept a density."""
    by_case = {
        case: kept
        for case, runs in grouped(learned(found), lambda run: run.row.case).items()
        if any((kept := {run.record.run_id: kept_samples(run, found) for run in runs}).values())
    }
    runs = [run for run in learned(found) if run.row.case in by_case]
    if not runs:
        return None
    densities = {run_id: one for kept in by_case.values() for run_id, one in kept.items()}
    figures = [
        figure
        for of_case in grouped(runs, lambda run: run.row.case).values()
        for figure in (*samples(of_case, found), *bias_exhibits(of_case, densities, found))
    ]
    return Section("samples", "Sampling", (), given(table(runs, densities)), tuple(figures), place="its suites")


def sampling_of(run: Learned, density: Any) -> tuple[str, str, float | None]:
    """Return the sampling of a run: even or adaptive, weighting by areas, and the adaptive share."""
    if density is None:
        return EVEN, "", 0.0
    settings = run.row.settings
    return ADAPTIVE, "yes" if settings.get("weighted") else "no", settings.get("adaptive_share")


def signed_error(run: Learned) -> float | None:
    """Return the signed error of the headline figure, relative to the known value, in percent."""
    row = run.row
    return PERCENT * (row.value / row.reference - 1) if row.value is not None and row.reference else None


def table(runs: Sequence[Learned], densities: Mapping[str, Any]) -> Table:
    """Return the table of samples and of what they do to the figure."""
    lines: list[dict[str, Any]] = []
    for run in runs:
        density = densities[run.record.run_id]
        kind, weighed, share = sampling_of(run, density)
        line: dict[str, Any] = {"block": run.row.case_title or run.row.case, "case": run.row.case, "run": run.name}
        line |= {"samples": kind, "weighed": weighed, "adaptive": share if density else None, "off": signed_error(run)}
        even = None if density is None else density[0] / density[0].mean()
        line |= {
            "least": None if even is None else float(even.min()),
            "most": None if even is None else float(even.max()),
        }
        lines.append(line)
    columns: tuple[str | Column, ...] = (
        column("run", "Run", words),
        column("samples", "Samples", words),
        column("adaptive", "Adaptive share", significant(2)),
        column("weighed", "Weighed", words),
        column("least", "Least density", significant(2)),
        column("most", "Largest density", significant(3)),
        column("off", "Off (%)", significant(3)),
    )
    return Table(
        name="samples",
        title="Samples and their bias",
        caption="Density relative to even samples, at the end. Off: the headline figure less the known one, relative"
        " to it. Unless weighed by their areas, adaptive samples minimise another functional, whatever their number.",
        data=frame(lines, ["block", "case", "run", "samples", "adaptive", "weighed", "least", "most", "off"]),
        columns=columns,
    )


def bias_exhibits(runs: Sequence[Learned], densities: Mapping[str, Any], found: Evidence) -> Iterator[Exhibit]:
    """Yield the figure of what the adaptive share does to the headline figure, where it differs between runs."""
    placed = [(run, *sampling_of(run, densities[run.record.run_id])) for run in runs if signed_error(run) is not None]
    placed = [one for one in placed if one[3] is not None]
    if len({share for *_, share in placed}) < 3:
        return
    row = runs[0].row
    yield Exhibit(
        name=f"{BIAS}{row.case}",
        title=f"{row.case_title or row.case}: bias of adaptive samples",
        caption=f"{row.description or row.quantity}: error against the share of samples that follow the density."
        " Filled: all samples count alike, as published. Open: weighed by their areas, or even.",
        description="; ".join(f"{run.name}: {signed_error(run):.3g} %" for run, *_ in placed),
        figure=bias_figure(placed, found),
        run_ids=tuple(run.record.run_id for run, *_ in placed),
    )


def bias_figure(placed: Sequence[tuple[Learned, str, str, Any]], found: Evidence) -> Figure:
    """Draw errors against shares."""
    figure, panels = panel.open_figure((WIDE, TALL))
    axes, entries = panels[0, 0], dict[str, Any]()
    for solver, of_solver in grouped(placed, lambda one: one[0].row.solver).items():
        ink = found.inks[solver]
        for hollow in (False, True):
            chosen = sorted(
                (float(share), signed_error(run) or 0.0)
                for run, kind, weighed, share in of_solver
                if (kind == EVEN or weighed == "yes") == hollow
            )
            panel.draw(axes, [x for x, _ in chosen], [y for _, y in chosen], ink, "none", hollow=hollow)
        entries[solver] = panel.entry(ink, linestyle="none")
    axes.axhline(0.0, color=panel.GREY, linewidth=0.6)
    axes.set_xlabel("share of adaptive samples")
    axes.set_ylabel("off the known value (%)")
    panel.add_legend(figure, entries, 3)
    return figure
