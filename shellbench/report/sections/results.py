"""The results of a suite at a glance: the verdict on each solver, the headline values, and error against cost.

A solver with frozen tolerances is judged by them. Any other solver is judged by its class of accuracy
(`shellbench.bench.judge.classes`), and its verdict is stated beside that of the suite.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from matplotlib.figure import Figure

from shellbench.bench.judge.classes import LOOSEST, grades
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.registry import given_as
from shellbench.bench.store.conformance import read_conformance, why_unchecked
from shellbench.bench.store.store import Store
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, Ink
from shellbench.report.data.notation import NO_BREAK, TEXT, Notation, duration, percent, rounded
from shellbench.report.data.rates import FEWEST
from shellbench.report.data.runs import grouped, is_graded, leading_rows, rows_at_home, solution_name, suite_title
from shellbench.report.data.solutions import (
    BAD,
    EXPECTED,
    PASS,
    Verdict,
    allowed_words,
    overall,
    size_words,
    value_words,
    verdict,
)
from shellbench.report.figures import panel

RESULTS = "results_"  # how names of figures begin
MOST_NUMBERED = 12  # cases whose numbers stand beside their marks
STATES = {PASS: "good", EXPECTED: "expected"} | dict.fromkeys(BAD, "bad")


@dataclass(frozen=True)
class Cell:
    """One solver on one case.

    Attributes
    ----------
    state
        "good", "bad", "expected" or "open".
    error
        Error of the headline value, the worst of the seeds, in the notation of the page.
    words
        The verdict on all values of the case, and the value that fails.
    size
        Magnitude of the error, by which a column is sorted.
    """

    state: str
    error: str
    words: str
    size: float | None = None


@dataclass(frozen=True)
class Standing:
    """The verdict on one solver.

    Attributes
    ----------
    short, words
        A few words for the head of a column, and sentences.
    by_class
        Whether it is judged by its class.
    """

    solution: str
    state: str
    short: str
    words: str
    by_class: bool = False


@dataclass(frozen=True)
class Results:
    """The verdict on a suite, the standing of each solver, and a line of cells for each case."""

    verdict: Verdict
    standings: list[Standing]
    lines: list[tuple[str, list[Cell]]]

    @property
    def by_class(self) -> list[Standing]:
        """Standings of the solvers that are judged by class."""
        return [one for one in self.standings if one.by_class]

    @property
    def state(self) -> str:
        """Return the state of the suite: good if every gate holds, and every solver judged by class holds one."""
        if not self.verdict.gated and not self.by_class:
            return "open"
        if self.verdict.gated and not self.verdict.good:
            return "bad"
        return "good" if all(one.state == "good" for one in self.by_class) else "expected"


def results(rows: Sequence[Row], notation: Notation, unchecked: Mapping[str, str]) -> Results:
    """Return the results of a suite.

    Parameters
    ----------
    rows
        That are compared, of all quantities.
    unchecked
        By solver without frozen tolerances: why it is not checked, as a clause; empty if it is.
    """
    of_both = grouped(rows, lambda row: (row.case, solution_name(row)))
    of_solution = grouped(rows, solution_name)
    solutions = sorted(of_solution, key=lambda name: any(map(is_graded, of_solution[name])))
    titles = {row.case: row.case_title or row.case for row in rows}
    return Results(
        overall([row for row in rows if not is_graded(row)]),
        [_standing(name, of_solution[name], unchecked) for name in solutions],
        [
            (title, [_cell(of_both.get((case, name), []), notation) for name in solutions])
            for case, title in titles.items()
        ],
    )


def unchecked(store: Store, found: Evidence) -> dict[str, str]:
    """Return the clause that says why a solver judged by class is not checked; empty if it is checked."""
    noted, graded = read_conformance(store).found, {row.solver for row in found.compared if is_graded(row)}
    runs = grouped(found.records.values(), lambda record: record.identity.solver)
    return {name: why_unchecked(name, runs.get(name, ()), noted) for name in graded}


def _standing(name: str, rows: Sequence[Row], unchecked: Mapping[str, str]) -> Standing:
    graded = [row for row in rows if is_graded(row) and row.reference is not None]
    if graded:
        return _class_of(name, graded, unchecked)
    judged = overall(rows)
    if not judged.gated and not judged.expected:
        return Standing(name, "bad" if judged.bad_runs else "open", "not gated", judged.words)
    open_words = f", {judged.expected} expected to fail" if judged.expected else ""
    state = "good" if judged.held == judged.gated else "bad"
    return Standing(name, state, f"{judged.held} of {judged.gated} pass{open_words}", judged.words)


def _class_of(name: str, rows: Sequence[Row], unchecked: Mapping[str, str]) -> Standing:
    (grade,) = grades(rows, [name], {name: unchecked.get(name, "")})
    worst = f" Worst: {grade.worst.case}, {value_words(grade.worst, False)}." if grade.worst else ""
    if grade.held:
        words = f"All {grade.figures} values{grade.on} are within {100 * grade.held:g} %.{worst}"
        return Standing(name, "good", f"class {class_words(grade.held)}{grade.on}", words, True)
    checks = f" Not checked: {grade.unchecked} (shellbench check-solver {given_as(name)})." if grade.unchecked else ""
    if grade.within:
        words = f"No class without checks; all values are within {100 * grade.within:g} %.{worst}{checks}"
        return Standing(name, "expected", "not checked", words, True)
    return Standing(name, "bad", "no class", f"No class: an error exceeds {100 * LOOSEST:g} %.{worst}{checks}", True)


def class_words(held: float | None) -> str:
    """Return a class as a power of ten; "none" if no class is held."""
    return f"{held:.0e}".replace("e-0", "e-") if held else "none"


def _cell(rows: Sequence[Row], notation: Notation) -> Cell:
    if not rows:
        return Cell("open", notation.missing, "")
    word, headline = verdict([row for row in rows if row.gated] or rows), [row for row in rows if row.primary]
    seconds = [row.seconds for row in headline if row.seconds is not None]
    errors = [row for row in headline if row.judged_error is not None]
    worst = max(errors, key=lambda row: abs(row.judged_error or 0.0), default=None)
    words = [word, f"{duration(fmean(seconds))}{NO_BREAK}s"] if seconds else [word]
    if (failing := _failing(rows)) is not None:
        what = f"{allowed_words(failing)} allowed" if failing.primary else value_words(failing)
        words[0] = f"{word}, {what}" if failing.primary else f"{word}: {what}"
    state, told = STATES.get(word, "open"), " · ".join(words)
    if worst is not None:
        return Cell(state, size_words(worst, worst.judged_error, notation), told, abs(worst.judged_error or 0.0))
    shown = (
        f"{notation.number(rounded(row.value, row.uncertainty))} {notation.escape(row.unit)}".strip()
        for row in headline
        if row.value is not None
    )
    return Cell(state, next(shown, notation.missing), told)


def _failing(rows: Sequence[Row]) -> Row | None:
    """Return the value that fails, or is expected to: the headline, or else the one with the worst error; or None."""
    short = [row for row in rows if row.passed is False or (row.passed is None and row.open_finding)]
    known = [row for row in short if row.judged_error is not None and row.tolerance]
    return max(
        known, key=lambda row: (row.primary, abs(row.judged_error or 0.0) / (row.tolerance or 1.0)), default=None
    )


def cost_exhibits(evidence: Evidence) -> Iterator[Exhibit]:
    """Yield a figure for each suite: error against wall time, a mark for each case and solver."""
    for suite, of_suite in rows_at_home(evidence.headline).items():
        rows = [row for row in leading_rows(of_suite) if row.relative_error is not None and row.seconds]
        marks = grouped(rows, lambda row: (row.case_title or row.case, row.solver))
        titles = list(dict.fromkeys(title for title, _ in marks))
        if len(marks) < FEWEST:
            continue
        named = "; ".join(f"{i} {title}" for i, title in enumerate(titles, 1)) if len(titles) <= MOST_NUMBERED else ""
        best = {solver: min(map(_error, of)) for solver, of in grouped(rows, lambda row: row.solver).items()}
        yield Exhibit(
            name=f"{RESULTS}{suite}",
            title=f"{suite_title(suite)}: error and cost",
            caption="Relative error of the headline value against wall time of the solve, default settings. With"
            f" several seeds: the largest error and the mean time. {panel.FLOOR_WORDS}{f' {named}.' if named else ''}",
            description="Smallest errors: "
            + ", ".join(f"{name} {TEXT.number(percent(size, signed=False))} %" for name, size in best.items()),
            figure=cost_figure(marks, titles, evidence.inks),
            run_ids=tuple(dict.fromkeys(row.run_id for row in rows if row.run_id)),
        )


def _error(row: Row) -> float:
    """Return the magnitude of a relative error; no less than a tenth of what the known value is known to."""
    floor = (row.reference_uncertainty or 0.0) / abs(row.reference or 1.0)
    return max(abs(row.relative_error or 0.0), floor / panel.BELOW_FLOOR, panel.SMALLEST)


def cost_figure(
    marks: Mapping[tuple[str, str], Sequence[Row]], titles: Sequence[str], inks: Mapping[str, Ink]
) -> Figure:
    """Draw error against seconds; numbers beside the marks name the cases where these are few."""
    figure, ((axes,),) = panel.open_figure((5.2, 3.3))
    for (title, solver), rows in marks.items():
        x, y = fmean(row.seconds or 0.0 for row in rows), 100 * max(map(_error, rows))
        panel.draw_runs(axes, [(x, y, all(row.status == "ok" for row in rows))], inks[solver], markersize=6)
        if len(titles) <= MOST_NUMBERED:
            place = {"xytext": (4, 2), "textcoords": "offset points", "fontsize": 6.5, "color": panel.GREY}
            axes.annotate(str(titles.index(title) + 1), (x, y), **place)
    panel.finish([axes], "wall time of the solve (s)", panel.ERROR_LABEL)
    failed = any(row.status != "ok" for rows in marks.values() for row in rows)
    entries = {solver: panel.entry(inks[solver], linestyle="none") for _, solver in marks}
    panel.add_legend(figure, entries | panel.failed_entry(failed))
    return figure
