r"""A table: one set of numbers, written in any format.

The numbers are a pandas DataFrame at full precision, built once. A format chooses how each column is written,
never what: so the same numbers stand in the terminal, in Markdown, in LaTeX and in HTML, and the CSV has
all their digits. (The Styler of pandas would write LaTeX and HTML, but has no rows that head a block and no
scopes for screen readers.)

For LaTeX a table has booktabs, a caption that can be cited, and no more than a page has room for. A file is whole in
itself, to be read by ``\input``. A table that is longer than a page goes on in further floats of the same number; one
that is wider has its columns of words broken into lines. What does not fit even so is made smaller, which TeX decides,
as it alone knows the widths of letters. It needs the packages ``array``, ``booktabs`` and ``graphicx``. Letters that
LaTeX's fonts lack are written by what they have, so that a table compiles in any document.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, cast

import pandas as pd

from shellbench.report.data.columns import Column, Line, column
from shellbench.report.data.notation import HTML, LATEX_NOTATION, MARKDOWN, TEXT, Notation

Format = Literal["text", "markdown", "latex", "csv", "html"]
Cells = list[str]
FORMULA = re.compile(r"\s*[=+\-@]|\t")  # as spreadsheets and OWASP's page on CSV injection have it
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀ", "0123456789+-T", strict=True))
LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉ₛ", "0123456789s", strict=True))
GREEK = {
    "α": r"\alpha", "β": r"\beta", "γ": r"\gamma", "δ": r"\delta", "ε": r"\varepsilon", "ζ": r"\zeta", "η": r"\eta",
    "θ": r"\theta", "κ": r"\kappa", "λ": r"\lambda", "μ": r"\mu", "µ": r"\mu", "ν": r"\nu", "ξ": r"\xi", "π": r"\pi",
    "ρ": r"\rho", "σ": r"\sigma", "τ": r"\tau", "φ": r"\varphi", "χ": r"\chi", "ψ": r"\psi", "ω": r"\omega",
    "Γ": r"\Gamma", "Δ": r"\Delta", "Θ": r"\Theta", "Λ": r"\Lambda", "Ξ": r"\Xi", "Π": r"\Pi", "Σ": r"\Sigma",
    "Φ": r"\Phi", "Ψ": r"\Psi", "Ω": r"\Omega",
}  # fmt: skip
SIGNS = {
    "≤": r"\leq", "≥": r"\geq", "≈": r"\approx", "≠": r"\neq", "±": r"\pm", "·": r"\cdot", "∞": r"\infty",
    "√": r"\sqrt{}", "∂": r"\partial", "∇": r"\nabla", "∫": r"\int", "→": r"\rightarrow", "∈": r"\in", "½": r"\frac12",
    "⋅": r"\cdot", "×": r"\times", "−": "-", "≪": r"\ll", "≫": r"\gg", "∝": r"\propto", "′": r"'",
}  # fmt: skip
MARKS = {"’": "'", "‘": "`", "“": "``", "”": "''", "…": r"\ldots{}", "\u2009": r"\,", "\u202f": r"\,", "\xa0": "~"}
RUNS = re.compile(f"[{''.join(RAISED)}]+|[{''.join(LOWERED)}]+")
LAST_OF_FONT = "\u017f"  # Latin-1 and Latin Extended-A, whose letters are put together from others
SPECIAL = set(GREEK) | set(SIGNS) | set(MARKS)
PAGE_LINES = 76  # of \scriptsize on a page of A4 or letter paper, caption included
LINE_LETTERS = 135  # of \scriptsize in a line of 17 cm
GAP_LETTERS = 2  # what \tabcolsep takes on both sides of a column
WORDS_LETTERS = 30  # a wider column of words is broken into lines, where the table is too wide
LETTER_EM = 0.5  # mean width of a letter
RULED_LINES = 1.5  # a heading with the rule above it
LEAST_FIRST = 24  # letters of the first column on a narrow terminal
PACKAGES = ("array", "booktabs", "graphicx")


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
        By their names in the vocabulary of `shellbench.report.data.columns`, or whole where they depart from it.
    suite
        That it is about, if it is about one; else its cases say so.
    heading
        What its section is called, where that depends on what it is about.
    spare
        Headings of the columns that a narrow terminal goes without, the first of them first.
    """

    name: str
    title: str
    caption: str
    data: pd.DataFrame
    columns: tuple[str | Column, ...]
    notes: tuple[Note, ...] = ()
    sources: tuple[str, ...] = ()
    suite: str = ""
    heading: str = ""
    spare: tuple[str, ...] = ()

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

    def write(self, format: Format, width: int | None = None) -> str:
        """Write the table in a format; as text no wider than so many letters, where a width is given."""
        return write_text(self, width) if format == "text" else WRITERS[format](self)


def write_text(table: Table, width: int | None = None) -> str:
    """Write for the terminal: plain characters, aligned; no wider than so many, where a width is given."""
    columns = table.columns_in(TEXT)
    blocks = list(table.blocks(TEXT))
    rows = [[column.heading for column in columns], *(row for _, block in blocks for row in block)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(columns))]
    shown, first = _that_fit(table, widths, width)

    def line(cells: Cells) -> str:
        clipped = cells[0] if len(cells[0]) <= first else f"{cells[0][: first - 1]}…"
        aligned = (
            cell.rjust(size) if columns[i].right else cell.ljust(size)
            for i, cell, size in ((i, cells[i], widths[i]) if i else (0, clipped, first) for i in shown)
        )
        return ("  " + "  ".join(aligned)).rstrip()

    def words(text: str, indent: str = "") -> list[str]:
        return [text] if width is None else textwrap.wrap(text, width, subsequent_indent=indent) or [""]

    rule = "-" * (first + sum(widths[i] for i in shown if i) + 2 * len(shown))
    lines = [*words(table.title), rule, line(rows[0]), rule]
    for heading, block in blocks:
        lines += [*(words(TEXT.escape(heading)) if heading else ()), *map(line, block)]
    lines += [rule, *(part for note in table.notes for part in words(note.write(TEXT), "  "))]
    return "\n".join(lines) + "\n"


def _that_fit(table: Table, widths: Sequence[int], width: int | None) -> tuple[list[int], int]:
    """Return the columns that a width has room for, and the letters of the first; spare ones go first, then the last.

    The first column, which says what a row is about, is shortened and never left out.
    """
    headings = [column.heading for column in table.columns_in(TEXT)]
    shown, first = list(range(len(widths))), widths[0] if widths else 0
    going = [*(headings.index(name) for name in table.spare if name in headings), *reversed(shown[1:])]
    for i in dict.fromkeys(going):
        room = sys.maxsize if width is None else width - 2 - sum(2 + widths[j] for j in shown if j)
        if room >= min(first, LEAST_FIRST):
            return shown, min(first, room)
        shown.remove(i)
    return shown, first


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
    columns = _filled_columns(table)
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


def _filled_columns(table: Table) -> list[Column]:
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
        without_formula(name): pd.Series(list(map(without_formula, column)), index=column.index, dtype=column.dtype)
        for name, column in table.data.items()
    }
    text: str = pd.DataFrame(cells).to_csv(index=False, lineterminator="\n")
    return text


def without_formula(cell: Any) -> Any:
    """Return a cell that no spreadsheet takes for a formula: text that begins like one, and is no number, gets a '."""
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r", " ")  # pandas does not quote it, and it begins a new row
    return f"'{text}" if FORMULA.match(text) and not NUMBER.fullmatch(text) else text


@dataclass
class _Page:
    """One float: blocks of rows, and remarks below them."""

    lines: float = 0.0
    blocks: list[tuple[str, list[Cells]]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def write_latex(table: Table) -> str:
    """Write a table for booktabs, with caption, label and remarks; sources are cited by their keys."""
    needed = ", ".join(PACKAGES)
    alignments, heights = _layout(table)
    floats = [_float(table, page, alignments, first=i == 0) for i, page in enumerate(_pages(table, heights))]
    return with_letters_of_latex(f"% needs the packages {needed}\n" + "\n".join(floats))


def _pages(table: Table, heights: Sequence[int]) -> Iterator[_Page]:
    """Fill pages with blocks, which are broken only if they are longer than a page, and then with remarks."""
    tex = LATEX_NOTATION
    head = 3 + _lines_of(_caption(table))
    page = _Page(lines=head)
    left = iter(heights)
    for heading, rows in table.blocks(tex):
        tall = [next(left) for _ in rows]
        if page.blocks and page.lines + RULED_LINES + sum(tall) > PAGE_LINES:
            yield page
            page = _Page(lines=head)
        page.blocks.append((heading, []))
        page.lines += RULED_LINES
        for row, height in zip(rows, tall, strict=True):
            if page.blocks[-1][1] and page.lines + height > PAGE_LINES:
                yield page
                page = _Page(lines=head + RULED_LINES, blocks=[(heading, [])])
            page.blocks[-1][1].append(row)
            page.lines += height
    for note in (note.write(tex) for note in table.notes):
        if page.lines + _lines_of(note) > PAGE_LINES and (page.blocks or page.notes):
            yield page
            page = _Page(lines=3)
        page.notes.append(note)
        page.lines += _lines_of(note)
    yield page


def _float(table: Table, page: _Page, alignments: Sequence[str], first: bool) -> str:
    lines = [r"\begin{table*}[!htbp]", r"  \centering", r"  \scriptsize", r"  \setlength{\tabcolsep}{3pt}"]
    if first:
        lines += [rf"  \caption[{LATEX_NOTATION.escape(table.title)}]{{{_caption(table)}}}"]
        lines += [rf"  \label{{tab:{table.name.replace('_', '-')}}}"]
    else:
        lines += [rf"  Table~\ref{{tab:{table.name.replace('_', '-')}}}, continued\par\medskip"]
    if page.blocks or first:
        lines += _tabular(table, page, alignments)
    if page.notes:
        lines += [r"  \par\medskip", r"  \begin{minipage}{\linewidth}", r"    \raggedright"]
        lines += [rf"    {note}\par" for note in page.notes]
        lines += [r"  \end{minipage}"]
    lines.append(r"\end{table*}")
    return "\n".join(lines) + "\n"


def _tabular(table: Table, page: _Page, alignments: Sequence[str]) -> list[str]:
    tex = LATEX_NOTATION
    columns = table.columns_in(tex)
    width = len(columns)
    lines = [
        r"  \setbox0=\hbox{%",
        rf"  \begin{{tabular}}{{{''.join(alignments)}}}",
        r"    \toprule",
        f"    {' & '.join(tex.escape(column.heading) for column in columns)} \\\\",
    ]
    for heading, block in page.blocks:
        lines.append(r"    \midrule")
        if heading:
            lines.append(rf"    \multicolumn{{{width}}}{{l}}{{\emph{{{tex.escape(heading)}}}}} \\")
        lines += [f"    {' & '.join(row)} \\\\" for row in block]
    lines += [r"    \bottomrule", r"  \end{tabular}}%"]
    return [*lines, r"  \ifdim\wd0>\linewidth\resizebox{\linewidth}{!}{\box0}\else\box0\fi"]


def _caption(table: Table) -> str:
    tex = LATEX_NOTATION
    cited = f" Sources: {', '.join(map(tex.cite, table.sources))}." if table.sources else ""
    return f"{tex.strong(tex.escape(table.title) + '.')} {tex.escape(table.caption)}{cited}"


def _layout(table: Table) -> tuple[list[str], list[int]]:
    """Return the alignment of each column, and how many lines each row takes; words are broken in a wide table."""
    columns = table.columns_in(LATEX_NOTATION)
    rows = [[len(cell) for cell in row] for _, block in table.blocks(TEXT) for row in block]
    natural = [max([len(one.heading), *(row[i] for row in rows)]) + GAP_LETTERS for i, one in enumerate(columns)]
    wide = sum(natural) > LINE_LETTERS
    words = [wide and not one.right and need > WORDS_LETTERS for one, need in zip(columns, natural, strict=True)]
    others = sum(need for need, word in zip(natural, words, strict=True) if not word)
    share = max(WORDS_LETTERS, (LINE_LETTERS - others) // max(1, sum(words)))
    widths = [min(share, need) if word else 0 for need, word in zip(natural, words, strict=True)]
    alignments = [
        rf">{{\raggedright\arraybackslash}}p{{{LETTER_EM * width:g}em}}" if width else "r" if one.right else "l"
        for one, width in zip(columns, widths, strict=True)
    ]
    heights = [max(-(-cell // width) if width else 1 for cell, width in zip(row, widths, strict=True)) for row in rows]
    return alignments, heights


def _lines_of(latex: str) -> int:
    return -(-len(latex) // LINE_LETTERS)


def with_letters_of_latex(latex: str) -> str:
    """Return LaTeX in which every letter can be set; one that nothing stands for becomes its number, as [U+2603]."""
    dotted = re.sub("(.)\N{COMBINING DOT ABOVE}", r"\\.{\1}", latex)
    raised = RUNS.sub(_script, dotted).replace(r"\textquotedbl{}", "''")  # which the encoding T1 alone has
    return "".join(letter if letter <= LAST_OF_FONT and letter not in SPECIAL else _sign(letter) for letter in raised)


def _script(run: re.Match[str]) -> str:
    raised = run[0][0] in RAISED
    digits = "".join((RAISED if raised else LOWERED)[letter] for letter in run[0])
    return rf"\ensuremath{{{{}}{'^' if raised else '_'}{{{digits}}}}}"


def _sign(letter: str) -> str:
    if letter in MARKS:
        return MARKS[letter]
    command = GREEK.get(letter) or SIGNS.get(letter)
    return rf"\ensuremath{{{command}}}" if command else f"[U+{ord(letter):04X}]"


WRITERS: dict[Format, Callable[[Table], str]] = {
    "text": write_text,
    "markdown": write_markdown,
    "latex": write_latex,
    "html": write_html,
    "csv": write_csv,
}
