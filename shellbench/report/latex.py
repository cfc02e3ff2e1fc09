r"""A table for LaTeX: booktabs, a caption that can be cited, and no more than a page has room for.

A file is whole in itself, to be read by ``\input``. A table that is longer than a page goes on in further floats of the
same number; one that is wider has its columns of words broken into lines. What does not fit even so is made smaller,
which TeX decides, as it alone knows the widths of letters. It needs the packages ``array``, ``booktabs`` and
``graphicx``. Letters that LaTeX's fonts lack are written by what they have, so that a table compiles in any document.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from shellbench.report.notation import LATEX_NOTATION, TEXT

if TYPE_CHECKING:
    from shellbench.report.table import Cells, Table

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
PACKAGES = ("array", "booktabs", "graphicx")


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
