"""Output of ``shellbench compare``: the verdict, losses and gains, and tables of values and costs."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from shellbench.bench.judge.changes import Change, Comparison, mean_ratio
from shellbench.bench.judge.row import Row
from shellbench.report.data.columns import Column, Line, column, error, frame, significant, solution, words
from shellbench.report.data.notation import MARKDOWN, Notation
from shellbench.report.data.runs import seed_words, solution_name
from shellbench.report.data.solutions import heading
from shellbench.report.data.table import Table

FIGURES = 7  # significant digits of values
MOST_NAMED = 20  # runs that only one side has, in a list


def as_text(found: Comparison, width: int | None = None, every: bool = False) -> str:
    """Return a comparison as text: tables of the headlines and of what is not the same, the verdict at the end."""
    parts = [table.write("text", width) for table in _tables(found, every)]
    said = [*closing_words(found), verdict_words(found)]
    if width is not None:
        said = [textwrap.fill(line, width, subsequent_indent="  ", break_on_hyphens=False) for line in said]
    return "\n".join([*parts, *said]) + "\n"


def as_markdown(found: Comparison) -> str:
    """Return a comparison as Markdown for a pull request: the verdict first, what is the same folded away."""
    told = [change for change in found.changes if change.verdict != "same"]
    said = "\n".join(f"- {MARKDOWN.escape(line)}" for line in closing_words(found))
    parts = [f"**{MARKDOWN.escape(verdict_words(found))}**", *([said] if said else [])]
    if told:
        parts.append(_figures(found, told).write("markdown"))
    folded = [table.write("markdown") for table in _tables(found, every=True)]
    parts += [f"<details><summary>All {len(found.changes)} figures, and what they cost</summary>", *folded]
    return "\n\n".join([*parts, "</details>"]) + "\n"


def verdict_words(found: Comparison) -> str:
    """Say in one sentence how the second side compares with the first."""
    losses, gains, changed = (len(found.of(verdict)) for verdict in ("loss", "gain", "changed"))
    costs = len(found.cost_losses)
    parts = [
        f"{losses} lost" if losses else "nothing lost",
        f"{gains} gained" if gains else "",
        f"{changed} changed with no known value" if changed else "",
        f"{costs} cost{'s' if costs == 1 else ''} too much more" if costs else "",
    ]
    count = f"{len(found.changes)} figure{'' if len(found.changes) == 1 else 's'}"
    return f"{found.before.name} -> {found.after.name}: {', '.join(filter(None, parts))}, of {count}"


def _tables(found: Comparison, every: bool) -> Iterator[Table]:
    shown = [change for change in found.changes if every or change.row.primary or change.verdict != "same"]
    yield _figures(found, shown)
    if found.costs:
        yield _costs(found)


def _figures(found: Comparison, changes: Sequence[Change]) -> Table:
    data = frame([_figure(found, change) for change in changes])
    return Table(
        name="changes",
        title=f"Figures: A is {found.before.name}, B is {found.after.name}",
        caption="Errors are relative to the known value; of several seeds the worst counts.",
        data=data,
        columns=(
            column("who", "Solution", solution, right=False),
            column("before", "A", significant(FIGURES)),
            column("after", "B", significant(FIGURES)),
            column("error_before", "Error of A", error),
            column("error_after", "Error of B", error),
            column("verdict", "Verdict", _verdict, right=False),
        ),
        spare=("A", "B"),
    )


def _figure(found: Comparison, change: Change) -> Line:
    row = change.row
    return {
        "block": heading(row),
        "who": "both" if found.solvers else solution_name(row),
        "before": change.before.value,
        "after": change.after.value,
        "error_before": change.before.error,
        "error_after": change.after.error,
        "verdict": change.verdict,
    }


def _verdict(value: str, line: Line, notation: Notation) -> str:
    return notation.strong(notation.escape(value)) if value == "loss" else notation.escape(value)


def _costs(found: Comparison) -> Table:
    lines = [
        {
            "block": "",
            "who": _row_name(found, cost.row),
            "seconds": cost.seconds[0],
            "seconds_after": cost.seconds[1],
            "seconds_ratio": cost.seconds_ratio,
            "memory": cost.memory[0] if cost.memory else None,
            "memory_after": cost.memory[1] if cost.memory else None,
            "memory_ratio": cost.memory_ratio,
            "verdict": "loss" if cost.why else "",
        }
        for cost in found.costs
    ]
    return Table(
        name="cost_changes",
        title=f"Costs: A is {found.before.name}, B is {found.after.name}",
        caption="Seconds are means over seeds, memory is the largest.",
        data=frame(lines),
        columns=(
            column("who", "Run", words, right=False),
            _seconds("seconds", "A (s)"),
            _seconds("seconds_after", "B (s)"),
            column("seconds_ratio", "B/A", significant(2)),
            _memory("memory", "A (MB)"),
            _memory("memory_after", "B (MB)"),
            column("memory_ratio", "B/A", significant(2)),
            column("verdict", "Verdict", _verdict, right=False, instead=lambda line, notation: " "),
        ),
    )


def _seconds(name: str, heading: str) -> Column:
    return column(name, heading, significant(2))


def _memory(name: str, heading: str) -> Column:
    def megabytes(value: float, line: Line, notation: Notation) -> str:
        return f"{value / 1e6:.0f}"

    return column(name, heading, megabytes)


def closing_words(found: Comparison) -> list[str]:
    """Return the closing lines: reasons of losses and gains, results in one store only, and ratios of cost."""
    seconds = mean_ratio(cost.seconds_ratio for cost in found.costs)
    memory = mean_ratio(cost.memory_ratio for cost in found.costs)
    ratios = [f"{ratio:.2f} times the {what}" for ratio, what in ((seconds, "seconds"), (memory, "memory")) if ratio]
    alike: dict[tuple[str, str, str], list[str]] = {}
    for verdict in ("loss", "gain", "changed"):
        for change in found.changes:
            if change.verdict == verdict:
                key = (verdict, _row_name(found, change.row), change.why)
                alike.setdefault(key, []).append(change.row.quantity)
    told = [f"{verdict}: {name} {', '.join(of)}: {why}" for (verdict, name, why), of in alike.items()]
    told += [f"loss: {_row_name(found, cost.row)} takes {cost.why}" for cost in found.cost_losses]
    for name, rows in ((found.before.name, found.gone), (found.after.name, found.appeared)):
        if rows:
            told.append(f"only in {name}: {_run_list(rows)}")
    if ratios:
        told.append(f"{found.after.name} takes {' and '.join(ratios)} of {found.before.name}, in the geometric mean")
    return told


def _row_name(found: Comparison, row: Row) -> str:
    return row.case if found.solvers else f"{row.case} {solution_name(row)}"


def _run_list(rows: Iterable[Row]) -> str:
    names = list(dict.fromkeys(f"{row.case} {solution_name(row)}{seed_words(row.seed)}" for row in rows))
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return "; ".join(names[:MOST_NAMED]) + more
