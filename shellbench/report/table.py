"""A table: one set of numbers, written in any format.

The numbers are a pandas DataFrame at full precision, built once. A format chooses how each column is written,
never what: so the same numbers stand in the terminal, in Markdown, in LaTeX and in HTML, and the CSV has
all their digits. (The Styler of pandas would write LaTeX and HTML, but has no rows that head a block and no
scopes for screen readers.)
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, cast

import pandas as pd

from shellbench.report.columns import Column, Line, column
from shellbench.report.latex import write_latex
from shellbench.report.notation import HTML, LATEX_NOTATION, MARKDOWN, TEXT, Notation

Format = Literal["text", "markdown", "latex", "csv", "html"]
Cells = list[str]
FORMULA = re.compile(r"\s*[=+\-@]|\t")  # as spreadsheets and OWASP's page on CSV injection have it
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Note:
    """A remark below a table: what it is about, in plain words, and its source if it has one."""

    about: str
    text: str
    source: str = ""

    def write(self, notation: Notation) -> str:
        """Write the remark in a notation."""
        cited = f" {notation.cite(self.source)}" if self.source else ""
        return f"{notation.strong(notation.escape(self.about))}{cited}: {notation.escape(self.text)}"


@dataclass(frozen=True)
class Table:
    """A table with its caption and remarks.

    Attributes
    ----------
    name
        Stem of its files and its label in LaTeX.
    data
        One row for each row of the table, at full precision; the column `block` says under which heading.
    columns
        By their names in the vocabulary of `shellbench.report.columns`, or whole where they depart from it.
    suite
        That it is about, if it is about one; else its cases say so.
    """

    name: str
    title: str
    caption: str
    data: pd.DataFrame
    columns: tuple[str | Column, ...]
    notes: tuple[Note, ...] = ()
    sources: tuple[str, ...] = ()
    suite: str = ""

    @property
    def cited(self) -> tuple[str, ...]:
        """Keys of all sources in the table and its remarks."""
        return tuple(dict.fromkeys([*self.sources, *(note.source for note in self.notes if note.source)]))

    @cached_property
    def declared(self) -> tuple[Column, ...]:
        """The columns, those of the vocabulary with all that it says of them."""
        return tuple(column(one) if isinstance(one, str) else one for one in self.columns)

    def columns_in(self, notation: Notation) -> tuple[Column, ...]:
        """Return the columns that a notation shows."""
        return tuple(one for one in self.declared if not one.wide or notation not in (TEXT, LATEX_NOTATION))

    @cached_property
    def lines(self) -> list[tuple[str, list[Line]]]:
        """The heading of each block (plain words) with its rows of the data, once for all formats."""
        blocks = self.data.groupby("block", sort=False) if len(self.data) else ()
        return [(str(heading), cast(list[Line], rows.to_dict("records"))) for heading, rows in blocks]

    def blocks(self, notation: Notation) -> Iterator[tuple[str, list[Cells]]]:
        """Yield the heading of each block (plain words) with its rows of cells in a notation."""
        columns = self.columns_in(notation)
        for heading, lines in self.lines:
            yield heading, [[column.show(line, notation) for column in columns] for line in lines]

    def write(self, format: Format) -> str:
        """Write the table in a format."""
        return WRITERS[format](self)


def write_text(table: Table) -> str:
    """Write for the terminal: plain characters, aligned."""
    blocks = list(table.blocks(TEXT))
    columns = table.columns_in(TEXT)
    headings = [column.heading for column in columns]
    rows = [headings, *(row for _, block in blocks for row in block)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(headings))]

    def line(cells: Cells) -> str:
        aligned = (
            cell.rjust(width) if column.right else cell.ljust(width)
            for cell, width, column in zip(cells, widths, columns, strict=True)
        )
        return ("  " + "  ".join(aligned)).rstrip()

    rule = "-" * (sum(widths) + 2 * len(widths))
    lines = [table.title, rule, line(headings), rule]
    for heading, block in blocks:
        lines += [TEXT.escape(heading), *map(line, block)] if heading else [*map(line, block)]
    lines += [rule, *(note.write(TEXT) for note in table.notes)]
    return "\n".join(lines) + "\n"


def write_markdown(table: Table) -> str:
    """Write a pipe table; a block is headed by a row in bold."""
    width = len(table.declared)

    def line(cells: Cells) -> str:
        return f"| {' | '.join(cells)} |"

    lines = [
        line([MARKDOWN.escape(column.heading) for column in table.declared]),
        line(["---:" if column.right else ":---" for column in table.declared]),
    ]
    for heading, block in table.blocks(MARKDOWN):
        if heading:
            lines.append(line([MARKDOWN.strong(MARKDOWN.escape(heading)), *[""] * (width - 1)]))
        lines += map(line, block)
    lines += ["", MARKDOWN.escape(table.caption), ""]
    lines += [f"- {note.write(MARKDOWN)}" for note in table.notes]
    return "\n".join(lines).rstrip() + "\n"


def write_html(table: Table) -> str:
    """Write a table element whose blocks and rows have headers that screen readers announce."""
    columns = _telling(table)
    width = len(columns)
    sides = ["number" if column.right else "sentences" if column.wide else "words" for column in columns]
    head = "".join(
        f'<th scope="col" class="{side}">{HTML.escape(column.heading)}</th>'
        for column, side in zip(columns, sides, strict=True)
    )
    lines = [
        f'<table id="table-{table.name}">',
        f"<caption><strong>{HTML.escape(table.title)}.</strong> {HTML.escape(table.caption)}</caption>",
        f"<thead><tr>{head}</tr></thead>",
    ]
    for heading, block in table.lines:
        lines.append("<tbody>")
        if heading:
            words = f"<span>{HTML.escape(heading)}</span>"
            lines.append(f'<tr class="block"><th scope="rowgroup" colspan="{width}">{words}</th></tr>')
        for line in block:
            first, *rest = (_cell(column, side, line) for column, side in zip(columns, sides, strict=True))
            lines.append(f'<tr><th scope="row"{first}</th>{"".join(f"<td{cell}</td>" for cell in rest)}</tr>')
        lines.append("</tbody>")
    lines.append("</table>")
    if table.notes:
        notes = "".join(f"<li>{note.write(HTML)}</li>" for note in table.notes)
        lines.append(f'<ul class="notes">{notes}</ul>')
    return "\n".join(lines) + "\n"


def _telling(table: Table) -> list[Column]:
    """Return the columns that say something in some row: the page leaves out the others."""
    lines = [line for _, block in table.lines for line in block]
    silent = ("", HTML.missing)
    first, *rest = table.declared
    return [first, *(c for c in rest if not lines or any(c.show(line, HTML) not in silent for line in lines))]


def _cell(column: Column, side: str, line: Line) -> str:
    """Return attributes and content of a cell, to be put into its element."""
    value = column.sort_value(line)
    sorted_by = "" if value is None else f' data-value="{value!r}"'
    return f' class="{side}"{sorted_by}>{column.show(line, HTML)}'


def write_csv(table: Table) -> str:
    """Write the data itself, with all digits that tell doubles apart; text that a spreadsheet would run is quoted."""
    cells = {
        inert(name): pd.Series(list(map(inert, column)), index=column.index, dtype=column.dtype)
        for name, column in table.data.items()
    }
    text: str = pd.DataFrame(cells).to_csv(index=False, lineterminator="\n")
    return text


def inert(cell: Any) -> Any:
    """Return a cell that no spreadsheet takes for a formula: text that begins like one, and is no number, gets a '."""
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r", " ")  # pandas does not quote it, and it begins a new row
    return f"'{text}" if FORMULA.match(text) and not NUMBER.fullmatch(text) else text


WRITERS: dict[Format, Callable[[Table], str]] = {
    "text": write_text,
    "markdown": write_markdown,
    "latex": write_latex,
    "html": write_html,
    "csv": write_csv,
}
