"""The figure of memory: error against bytes, bytes against the resolution that is asked for, memory of the solve."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from shellbench.report.answers import BYTES_A_POINT, LEVELS, Answer, fewest, field_is_known
from shellbench.report.consistency_figure import logarithmic, tick
from shellbench.report.digits import byte_size, percent
from shellbench.report.ladder import CaseRuns, Run
from shellbench.report.notation import TEXT
from shellbench.report.palette import DASHES, Ink

WIDTH, HEIGHT, MARGIN = 2.53, 2.15, 0.45  # inches: a panel, and the legend below
PAIR = 3.5  # inches of a panel of two beside each other
MEGABYTE = 1e6
GREY = "#666666"
FORMATS: Mapping[str, dict[str, Any]] = {
    "float32": {"markersize": 4.5, "fillstyle": "none"},
    "float16": {"markersize": 3.0, "fillstyle": "none"},
}
SMALLEST = 1e-10  # relative difference below which rounding is all there is
SCREEN = 0.9  # opacity of lines


def memory_figure(case: CaseRuns, kept: Mapping[str, Sequence[Answer]], inks: Mapping[str, Ink]) -> Figure:
    """Draw one case.

    Parameters
    ----------
    kept
        By solver: the ways in which its answers can be kept.
    """
    rows, columns, width = (2, 2, PAIR) if case.moves else (1, 3, WIDTH)
    figure = Figure(figsize=(width * columns, HEIGHT * rows + MARGIN), layout="constrained")
    panels = list(figure.subplots(rows, columns).flat)
    _errors(panels[0], case, kept, inks)
    _asked_points(panels[1], case, kept, inks)
    if case.moves:
        _asked_frames(panels[2], case, kept, inks)
    _solve(panels[-1], case, inks)
    entries: dict[str, Any] = {
        ladder.solver: Line2D([], [], color=inks[ladder.solver].colour, marker=inks[ladder.solver].marker)
        for ladder in case.ladders
    }
    shown = {answer.format for found in kept.values() for answer in found if answer.kept == "rounded"}
    for format, look in FORMATS.items():
        if format in shown:
            entries[format] = Line2D([], [], color=GREY, marker="o", linestyle="none", **look)
    entries["mesh made from it"] = Line2D([], [], color=GREY, linestyle=":", marker=".")
    labels = [label.replace("$", r"\$") for label in entries]
    figure.legend(entries.values(), labels, loc="outside lower center", ncols=min(6, len(entries)))
    return figure


def _errors(axes: Axes, case: CaseRuns, kept: Mapping[str, Sequence[Answer]], inks: Mapping[str, Ink]) -> None:
    for ladder in case.ladders:
        ink = inks[ladder.solver]
        found = kept[ladder.solver]
        known = [answer for answer in found if answer.difference is not None and answer.difference > SMALLEST]
        solved = [answer for answer in known if answer.kept == "solved"]
        look_solved: dict[str, Any] = {"color": ink.colour, "marker": ink.marker, "markeredgecolor": "white"}
        on_line = _points([answer for answer in solved if answer.run in ladder.line])
        beside = _points([answer for answer in solved if answer.run not in ladder.line])
        axes.plot(*on_line, markeredgewidth=0.4, **look_solved)
        axes.plot(*beside, markeredgewidth=0.4, linestyle="none", **look_solved)
        for format, look in FORMATS.items():
            rounded = _points([answer for answer in known if answer.format == format])
            axes.plot(*rounded, color=ink.colour, marker=ink.marker, linestyle="none", markeredgewidth=0.7, **look)
        front = _points(_front([answer for answer in known if answer.kept == "mesh"]))
        axes.plot(*front, color=ink.colour, linestyle=":", marker=".", markersize=5, linewidth=1.1, alpha=SCREEN)
    logarithmic(axes)
    low, high = axes.get_ylim()
    for level in LEVELS:
        axes.axhline(100 * level, color="#444444", linewidth=0.7, linestyle=DASHES[1], zorder=1)
    axes.set_ylim(min(low, 50 * min(LEVELS)), max(high, 200 * max(LEVELS)))
    if case.doubt and case.scale:
        doubt = 100 * case.doubt / case.scale
        axes.axhspan(axes.get_ylim()[0] / 1e3, doubt, color="#BBBBBB", alpha=0.35, linewidth=0, zorder=0)
        axes.set_ylim(min(low, 50 * min(LEVELS)), max(high, 200 * max(LEVELS)))
    axes.set_title("Error against bytes", loc="left")
    axes.set_ylabel("difference (% of the largest)")
    _bytes_axis(axes, "x")
    tick(axes.yaxis)


def _front(candidates: Sequence[Answer]) -> list[Answer]:
    """Return the meshes that no smaller one outdoes, from small to large."""
    front: list[Answer] = []
    for answer in sorted(candidates, key=lambda one: (one.storage_bytes, one.difference or 0.0)):
        if not front or (answer.difference or 0.0) < (front[-1].difference or 0.0):
            front.append(answer)
    return front


def _points(found: Sequence[Answer]) -> tuple[list[int], list[float]]:
    ordered = sorted(found, key=lambda answer: answer.storage_bytes)
    return [answer.storage_bytes for answer in ordered], [100 * (answer.difference or 0.0) for answer in ordered]


def _asked_points(axes: Axes, case: CaseRuns, kept: Mapping[str, Sequence[Answer]], inks: Mapping[str, Ink]) -> None:
    run, scale = case.yardstick, case.scale or 1.0
    grids = sorted(run.record.resolution, key=lambda step: step.points) if run is not None else []
    frames = max((step.frames for step in run.record.frame_rates), default=1) if run is not None else 1
    states = frames if case.moves else len(run.probes.marks) if run is not None and run.probes is not None else 1
    _asked(
        axes,
        case,
        [
            (step.points, BYTES_A_POINT * step.points**2 * states, step.interpolation_difference / scale)
            for step in grids
        ],
        kept,
        inks,
    )
    axes.set_xlabel("points a side that are asked for")
    axes.set_title(f"Asked for points, {frames} frames" if case.moves else "Asked for points", loc="left")


def _asked_frames(axes: Axes, case: CaseRuns, kept: Mapping[str, Sequence[Answer]], inks: Mapping[str, Ink]) -> None:
    run, scale = case.yardstick, case.scale or 1.0
    rates = sorted(run.record.frame_rates, key=lambda step: step.frames) if run is not None else []
    points = max((step.points for step in run.record.resolution), default=1) if run is not None else 1
    _asked(
        axes,
        case,
        [
            (step.frames_per_second, BYTES_A_POINT * points**2 * step.frames, step.interpolation_difference / scale)
            for step in rates
        ],
        kept,
        inks,
    )
    axes.set_xlabel("frames a second that are asked for")
    axes.set_title(f"Asked for frames, {points}×{points} points", loc="left")


def _asked(
    axes: Axes,
    case: CaseRuns,
    mesh: Sequence[tuple[float, int, float]],
    kept: Mapping[str, Sequence[Answer]],
    inks: Mapping[str, Ink],
) -> None:
    """Draw the bytes of meshes, with what they add, and level lines of solutions that answer at any resolution."""
    axes.plot([x for x, _, _ in mesh], [size for _, size, _ in mesh], color=GREY, linestyle=":", marker=".")
    for x, size, added in mesh[:-1]:  # the finest is what the others are held against
        words = TEXT.number(percent(added, signed=False)) + " %"
        axes.annotate(
            words, (x, size), xytext=(-3, 2), textcoords="offset points", ha="right", fontsize=6.0, color="#444444"
        )
    for place, (solver, found) in enumerate(kept.items()):
        own = [answer for answer in found if answer.kept != "mesh"]
        known = [level for level in LEVELS if field_is_known(case, level)]
        reached = [(level, best) for level in known if (best := fewest(own, level, found)) is not None]
        if not reached:
            continue
        level, best = reached[-1]
        axes.axhline(best.storage_bytes, color=inks[solver].colour, linewidth=1.3, alpha=SCREEN)
        axes.annotate(
            f"within {100 * level:g} %",
            (1.0, best.storage_bytes),
            xycoords=("axes fraction", "data"),
            xytext=(-2 - 42 * (place % 2), 2),
            textcoords="offset points",
            ha="right",
            fontsize=6.0,
            color=inks[solver].colour,
        )
    logarithmic(axes)
    axes.margins(x=0.18, y=0.1)
    tick(axes.xaxis)
    _bytes_axis(axes, "y")


def _solve(axes: Axes, case: CaseRuns, inks: Mapping[str, Ink]) -> None:
    for ladder in case.ladders:
        ink = inks[ladder.solver]
        look: dict[str, Any] = {"color": ink.colour, "marker": ink.marker, "markeredgecolor": "white"}
        beside = [run for run in ladder.runs if run not in ladder.line]
        axes.plot(*_peaks(ladder.line), markeredgewidth=0.4, **look)
        axes.plot(*_peaks(beside), markeredgewidth=0.4, linestyle="none", **look)
    logarithmic(axes)
    axes.set_xlabel("unknowns")
    axes.set_ylabel("peak less idle (MB)")
    axes.set_title("Memory of the solve", loc="left")
    axes.margins(x=0.12, y=0.12)
    tick(axes.xaxis)
    tick(axes.yaxis)


def _peaks(runs: Sequence[Run]) -> tuple[list[int], list[float]]:
    found = [
        (run.unknowns, (peak - idle) / MEGABYTE)
        for run in runs
        if (peak := run.record.peak_memory_bytes) is not None
        and (idle := run.record.idle_memory_bytes) is not None
        and peak > idle
    ]
    return [unknowns for unknowns, _ in found], [size for _, size in found]


def _bytes_axis(axes: Axes, which: str) -> None:
    """Label an axis of bytes in kB, MB, GB."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xlabel if which == "x" else axes.set_ylabel)("bytes that keep it")
    if axis.get_scale() != "log":
        return
    low, high = sorted(axis.get_view_interval())
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    every = max(1, math.ceil((last - first) / 4))
    places = [10.0**power for power in range(first, last + 1, every)]
    axis.set_ticks(places, [byte_size(place) for place in places])
    axis.set_ticks([], minor=True)
