"""One solver over its versions: a section of the page, and what ``shellbench history`` prints."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from shellbench.bench.history import Figure, History
from shellbench.report.changes import closing_words, verdict_words
from shellbench.report.columns import Column, Line, Way, column, error, frame, present, significant, solution, words
from shellbench.report.evidence import Section, given
from shellbench.report.exhibit import COLOURS, MARKERS, Exhibit, Ink
from shellbench.report.notation import MARKDOWN, Notation, duration
from shellbench.report.panel import ERROR_LABEL, SMALLEST, add_legend, draw, entry, open_figure, tick
from shellbench.report.solutions import heading, solution_name
from shellbench.report.table import Note, Table

DIGITS = 6  # of values
WIDTH, HEIGHT, MARGIN = 7.4, 2.5, 0.6  # inches of the figure, of its panels, and of the legend
MOST_DRAWN = len(COLOURS)  # figures, so that each has a colour of its own
MANY = 3  # solvers that a heading does not name
LETTERS = 12  # of a version's name below an axis
COLUMNS = ("value", "error", "seconds", "memory", "verdict")
MOVED, UNSAID = {"loss", "gain", "changed"}, {"same", "new"}
PANELS = (ERROR_LABEL, "wall time of the solve (s)", "peak memory (MB)")


def section(history: History) -> Section:
    """Return the section of the page: versions, headline figures over them, and what each step lost or gained."""
    solvers = dict.fromkeys(figure.row.solver for figure in history.figures)
    return Section(
        name="history",
        title=f"History of {' and '.join(solvers)}" if len(solvers) < MANY else "History",
        words=(
            "The oldest version first. All are held against today's known values, whatever their code was, and each"
            " against the one before it, as by shellbench compare. Of several seeds the worst counts. Seconds compare"
            " on one machine alone.",
            *("; ".join(lines) + "." for lines in step_lines(history)),
        ),
        tables=_tables(history),
        exhibits=_exhibits(history),
        details=(replace(history_table(history, every=True), name="history_all"),),
    )


def as_text(history: History, width: int | None = None, every: bool = False) -> str:
    """Return a history as text: versions, figures, and a line for each step."""
    tables = [table.write("text", width) for table in _tables(history, every)]
    said = [f"{'  ' if place else ''}{line}" for lines in step_lines(history) for place, line in enumerate(lines)]
    if width is not None:
        said = [textwrap.fill(line, width, subsequent_indent="    ", break_on_hyphens=False) for line in said]
    return "\n".join([*tables, *said]) + "\n"


def as_markdown(history: History, every: bool = False) -> str:
    """Return a history as Markdown."""
    tables = [table.write("markdown") for table in _tables(history, every)]
    lines = [(place, line) for lines in step_lines(history) for place, line in enumerate(lines)]
    said = [f"{'  ' if place else ''}- {MARKDOWN.escape(line)}" for place, line in lines]
    return "\n\n".join([*tables, "\n".join(said)]) + "\n"


def _tables(history: History, every: bool = False) -> tuple[Table, ...]:
    return given(versions_table(history), history_table(history, every), cost_table(history))


def step_lines(history: History) -> list[list[str]]:
    """Return what each step lost and gained: a sentence, and what else is to be said of it, a line each."""
    found = []
    for step, (before, after) in zip(history.steps, pairwise(history.versions), strict=True):
        named = replace(step, before=replace(step.before, name=before.name), after=replace(step.after, name=after.name))
        found.append([verdict_words(named), *closing_words(named)])
    return found


def versions_table(history: History) -> Table:
    """Return a line for each version."""
    lines = [
        {
            "block": "",
            "version": version.name,
            "made_by": version.made_by,
            "runs": len(version.side.records),
            "environment": ", ".join(sorted({one.environment.processor for one in version.side.records.values()})),
        }
        for version in history.versions
    ]
    return Table(
        name="history_versions",
        title="Versions",
        caption="Commits that made the runs, and packages that are not of one version throughout.",
        data=frame(lines),
        columns=(
            column("version", "Version", words, right=False),
            column("made_by", "Made by", words, right=False),
            column("runs", "Runs", words),
            column("environment", "Machine", words, right=False),
        ),
        spare=("Machine",),
    )


def history_table(history: History, every: bool = False) -> Table:
    """Return a line for each headline figure that two versions have, a column for each version; or for all figures."""
    shown = [figure for figure in history.figures if every or figure.row.primary or _moved(figure)]
    data = frame([_line(figure, len(history.versions)) for figure in shown if every or _lasts(figure)])
    names = [version.name for version in history.versions]
    return Table(
        name="history",
        title="Errors over versions",
        caption="Relative to the known value; the value itself where none is known. In brackets what differs from the"
        " version before.",
        data=data,
        columns=(
            column("who", "Solution", solution, right=False),
            *(_error_column(place, name) for place, name in enumerate(names)),
        ),
        notes=tuple(Note("History", note) for note in history.notes),
        spare=tuple(names[1:-1]),
    )


def cost_table(history: History) -> Table:
    """Return seconds and memory of each run, a column for each version."""
    shown = [figure for figure in history.figures if figure.row.primary and _lasts(figure)]
    names = [version.name for version in history.versions]
    return Table(
        name="history_costs",
        title="Seconds and memory over versions",
        caption="Mean seconds of the solve, and the largest memory of its process, of runs that ended well.",
        data=frame([_line(figure, len(history.versions)) for figure in shown]),
        columns=(
            column("who", "Solution", solution, right=False),
            *(column(f"seconds_{place}", name, _cost(place)) for place, name in enumerate(names)),
        ),
        spare=tuple(names[1:-1]),
    )


def _moved(figure: Figure) -> bool:
    return any(entry.verdict in MOVED for entry in figure.entries)


def _lasts(figure: Figure) -> bool:
    return sum(entry.answer is not None for entry in figure.entries) > 1


def _line(figure: Figure, versions: int) -> Line:
    line: dict[str, Any] = {"block": heading(figure.row), "case": figure.row.case, "who": solution_name(figure.row)}
    line |= {f"{name}_{place}": None for name in COLUMNS for place in range(versions)}
    for one in figure.entries:
        if one.answer is not None:
            said = one.answer.worst.status if one.answer.worst.status != "ok" else one.verdict
            found = (one.answer.value, one.answer.error, one.seconds, one.memory_bytes, said)
            line |= {f"{name}_{one.version}": value for name, value in zip(COLUMNS, found, strict=True)}
    return line


def _error_column(place: int, name: str) -> Column:
    def said(text: str, line: Line, notation: Notation) -> str:
        verdict = line[f"verdict_{place}"]
        if not present(verdict) or verdict in UNSAID:
            return text
        words = notation.escape(str(verdict))
        return f"{text} ({notation.strong(words) if verdict not in ('gain', 'changed') else words})"

    def known(value: Any, line: Line, notation: Notation) -> str:
        return said(error(value, line, notation), line, notation)

    def unknown(line: Line, notation: Notation) -> str:
        value, verdict = line[f"value_{place}"], line[f"verdict_{place}"]
        if present(value):
            return said(significant(DIGITS)(value, line, notation), line, notation)
        return notation.strong(notation.escape(str(verdict))) if present(verdict) else ""

    return column(f"error_{place}", name, known, instead=unknown)


def _cost(place: int) -> Way:
    def written(value: Any, line: Line, notation: Notation) -> str:
        memory = line[f"memory_{place}"]
        of_memory = f", {memory / 1e6:.0f} MB" if present(memory) else ""
        return notation.escape(f"{duration(value)} s{of_memory}")

    return written


def _exhibits(history: History) -> tuple[Exhibit, ...]:
    drawn = [figure for figure in history.figures if figure.row.primary and _lasts(figure) and not figure.row.variant]
    if not drawn:
        return ()
    shown = sorted(drawn, key=lambda figure: not _moved(figure))[:MOST_DRAWN]
    more = (
        f" {len(shown)} of {len(drawn)} headline figures, those that changed first." if len(shown) < len(drawn) else ""
    )
    return (
        Exhibit(
            name="history",
            title="Error, time and memory over versions",
            caption=f"Headline figures, the oldest version at the left. A gap: no run, or none that ended well.{more}",
            description="; ".join(
                f"{_named(figure)}: {', '.join(one.verdict or 'first' for one in figure.entries)}" for figure in shown
            ),
            figure=history_figure(history, shown),
            run_ids=tuple(
                row.run_id for f in shown for e in f.entries if e.answer for row in e.answer.rows if row.run_id
            ),
        ),
    )


def _named(figure: Figure) -> str:
    return f"{figure.row.case_title or figure.row.case}, {solution_name(figure.row)}"


def history_figure(history: History, figures: Sequence[Figure]) -> Drawing:
    """Draw error, seconds and memory of headline figures over versions, a colour for each figure."""
    drawing, (panels,) = open_figure((WIDTH, HEIGHT + MARGIN), 1, len(PANELS))
    inks = {_named(figure): Ink(*ink) for figure, ink in zip(figures, zip(COLOURS, MARKERS, strict=True), strict=False)}
    for figure in figures:
        values = np.full((len(PANELS), len(history.versions)), np.nan)
        for one in figure.entries:
            off = one.answer.error if one.answer else None
            memory = one.memory_bytes / 1e6 if one.memory_bytes else np.nan
            wrong = np.nan if off is None else 100 * max(abs(off), SMALLEST)
            values[:, one.version] = wrong, one.seconds or np.nan, memory
        for axes, of_panel in zip(panels, values, strict=True):
            draw(axes, np.arange(len(of_panel)), of_panel, inks[_named(figure)])
    for axes, label in zip(panels, PANELS, strict=True):
        _finish(axes, label, [version.name for version in history.versions])
    add_legend(drawing, {_named(figure): entry(inks[_named(figure)]) for figure in figures}, 3)
    return drawing


def _finish(axes: Axes, label: str, names: Sequence[str]) -> None:
    """Tick an axis of versions, and the logarithmic one of what is drawn over them."""
    drawn: Any = np.concatenate([np.empty(0), *(line.get_ydata() for line in axes.get_lines())])
    if np.any(drawn > 0):
        axes.set_yscale("log")
        axes.set_ylim(np.nanmin(drawn) / 2, 2 * np.nanmax(drawn))
        tick(axes.yaxis)
    short = [name if len(name) <= LETTERS else f"{name[: LETTERS - 1]}…" for name in names]
    axes.set_xticks(
        range(len(names)), short, rotation=30 if len(names) > 2 else 0, ha="right" if len(names) > 2 else "center"
    )
    axes.set_xlim(-0.4, len(names) - 0.6)
    axes.set_title(label, loc="left")
