"""The verdict in short: how many gated figures hold, and each solver's worst error case by case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from shellbench.bench.row import Row
from shellbench.report.notation import Notation, power_of_ten
from shellbench.report.solutions import (
    BAD,
    EXPECTED,
    NOT_GATED,
    PASS,
    SHORT,
    STATUS_WORDS,
    grouped,
    same_but_for_seed,
    solution_name,
    verdict,
)


@dataclass(frozen=True)
class Verdict:
    """How the gated rows came out.

    Attributes
    ----------
    bad_runs, beside
        Runs that failed or are missing: of all that any gate judges, and of those that none does, such as ablations.
    without_answer
        Gated figures that fell short because their run failed or is missing.
    """

    gated: int
    held: int
    expected: int
    bad_runs: int
    beside: int = 0
    without_answer: int = 0

    @property
    def good(self) -> bool:
        """Whether everything that is gated holds, and something is."""
        return self.gated > 0 and self.held == self.gated

    @property
    def words(self) -> str:
        """The verdict in one sentence."""
        short = self.gated - self.held - self.without_answer
        have = "have" if self.without_answer != 1 else "has"
        held = f"{'All' if self.good else f'{self.held} of'} {self.gated} gated figures hold"
        parts = (
            held if self.gated else "Nothing is gated here",
            f"{short} fell short" if short else "",
            f"{self.without_answer} {have} no answer" if self.without_answer else "",
            f"{_counted(self.expected, 'expected failure')} (open findings)" if self.expected else "",
            f"{_counted(self.bad_runs, 'run')} failed or missing" if self.bad_runs else "",
            f"{_counted(self.beside, 'run')} beside them, which no gate judges, failed" if self.beside else "",
        )
        return "; ".join(filter(None, parts)) + "."


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"


@dataclass(frozen=True)
class Cell:
    """One solver on one case.

    Attributes
    ----------
    state
        "good", "bad", "expected" or "open".
    """

    words: str
    state: str


@dataclass(frozen=True)
class Shortfall:
    """Runs of one solver on one case that fell short for the same reason: which seeds, in what, and why."""

    case: str
    solution: str
    words: str


def shortfalls(rows: Sequence[Row]) -> list[Shortfall]:
    """Return what did not hold or has no answer, a line for each case, solver and reason."""
    bad = [row for row in rows if row.passed is False or row.status not in ("ok", "declined")]
    groups = grouped(bad, lambda row: (row.case_title or row.case, solution_name(row), row.status, row.reason or ""))
    found = []
    for (case, solution, status, reason), of_group in groups.items():
        seeds = list(dict.fromkeys(str(row.seed) for row in of_group if row.seed is not None))
        which = f"seed{'s' if len(seeds) > 1 else ''} {', '.join(seeds)}, " if seeds else ""
        what = f"{STATUS_WORDS.get(status, SHORT)} ({', '.join(dict.fromkeys(row.quantity for row in of_group))})"
        found.append(Shortfall(case, solution, f"{which}{what}" + (f": {reason}" if reason else "")))
    return found


def overall(rows: Sequence[Row]) -> Verdict:
    """Return how the gated rows came out."""
    gated = [row for row in rows if row.passed is not None]
    judged = {row.run_id for row in rows if row.passed is not None or row.open_finding}
    bad: set[tuple[object, ...]] = set()
    beside: set[tuple[object, ...]] = set()
    for row in rows:
        if row.status not in ("ok", "declined"):
            of = bad if row.run_id is None or row.run_id in judged else beside
            of.add((row.case, same_but_for_seed(row), row.seed))
    return Verdict(
        gated=len(gated),
        held=sum(bool(row.passed) for row in gated),
        expected=sum(row.passed is None and row.open_finding is not None for row in rows),
        bad_runs=len(bad),
        beside=len(beside - bad),
        without_answer=sum(not row.passed and row.status != "ok" for row in gated),
    )


def matrix(rows: Sequence[Row], notation: Notation) -> tuple[list[str], list[tuple[str, list[Cell]]]]:
    """Return the gated solvers, and for each case its title and each solver's worst headline error on it.

    The verdict of a cell is over all gated quantities of the case, not the headline alone.
    """
    gated = [row for row in rows if row.passed is not None or row.open_finding]
    of_both = grouped(gated, lambda row: (row.case, solution_name(row)))
    solvers = list(dict.fromkeys(solver for _, solver in of_both))
    titles = {row.case: row.case_title or row.case for row in gated}
    return solvers, [
        (title, [_cell(of_both.get((case, solver), []), notation) for solver in solvers])
        for case, title in titles.items()
    ]


def _cell(rows: Sequence[Row], notation: Notation) -> Cell:
    if not rows:
        return Cell(notation.missing, "open")
    words = verdict(rows)
    state = {PASS: "good", EXPECTED: "expected", NOT_GATED: "open"}.get(words, "bad" if words in BAD else "open")
    headline = [row for row in rows if row.primary]
    errors = [row.relative_error for row in headline if row.relative_error is not None]
    if not errors:
        return Cell(notation.escape(words), state)
    shown = [max(errors, key=abs)]
    if headline[0].tolerance is not None and not headline[0].tolerance_is_absolute:
        shown.append(headline[0].tolerance)
    numbers = " / ".join(notation.number(power_of_ten(one)) for one in shown)
    return Cell(f"{notation.escape(words)}: {numbers}", state)
