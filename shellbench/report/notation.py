"""Notations: how numbers, words and sources are written in plain text, Markdown, LaTeX and HTML."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from dataclasses import dataclass

from shellbench.report.digits import Digits, percent

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS, NARROW, NO_BREAK = "\N{MINUS SIGN}", "\N{NARROW NO-BREAK SPACE}", "\N{NO-BREAK SPACE}"
LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "×": r"$\times$",
    "²": r"$^2$",
    "³": r"$^3$",
    "°": r"$^\circ$",
    "†": r"$^\dagger$",
    MINUS: r"$-$",
    "–": "--",
    "—": "---",
    NO_BREAK: "~",
    NARROW: r"\,",
}


@dataclass(frozen=True)
class Notation:
    """How one output format writes things.

    Attributes
    ----------
    escape
        Plain words, with whatever is special in the format made harmless.
    power
        What follows a mantissa: a power of ten other than 1.
    code
        A name in typewriter.
    cite
        A source, from its key in the bibliography.
    strong
        Words (already escaped) that must not be overlooked.
    per_cent
        The sign of percent with the space before it.
    missing
        What stands where there is no value.
    minus
        The sign of what is negative.
    formula
        Encloses a number.
    """

    name: str
    escape: Callable[[str], str]
    power: Callable[[int], str]
    code: Callable[[str], str]
    cite: Callable[[str], str]
    strong: Callable[[str], str]
    per_cent: str
    missing: str
    minus: str = MINUS
    formula: str = ""

    def number(self, digits: Digits) -> str:
        """Write a number from its digits, with its uncertainty in the last ones."""
        doubt = "" if digits.uncertainty is None else f"({digits.uncertainty})"
        power = self.power(digits.exponent) if digits.exponent else ""
        return f"{self.formula}{digits.mantissa.replace('-', self.minus)}{doubt}{power}{self.formula}"

    def strong_number(self, digits: Digits) -> str:
        """Write a number that must not be overlooked."""
        return self.strong(self.number(digits))

    def error(self, relative: float) -> str:
        """Write a relative error in percent, with its sign and two significant digits."""
        return self.number(percent(relative)) + self.per_cent


def _one_line(text: str) -> str:
    return " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split())


def escape_markdown(text: str) -> str:
    """Make text harmless in a Markdown table: one line, no markup, no HTML, no new column."""
    return re.sub(r"([\\`*_{}\[\]<>|~$&])", r"\\\1", _one_line(text))


def escape_latex(text: str) -> str:
    """Make text harmless in LaTeX: every special character is printed as itself."""
    return "".join(LATEX.get(c, c) for c in _one_line(text))


def escape_html(text: str) -> str:
    """Make text harmless in HTML, in attributes too."""
    return html.escape(_one_line(text), quote=True)


def anchor(key: str) -> str:
    """Return a name for a link target: letters, digits and hyphens only."""
    return re.sub(r"[^A-Za-z0-9]+", "-", key).strip("-").lower()


def _markdown_code(text: str) -> str:
    return f"`{_one_line(text).replace('`', chr(39)).replace('|', '/')}`"


TEXT = Notation(
    name="text",
    escape=_one_line,
    power=lambda power: f"e{power}",
    code=_one_line,
    cite=lambda key: f"[{_one_line(key)}]",
    strong=_one_line,
    per_cent=" %",
    missing="-",
    minus="-",
)
MARKDOWN = Notation(
    name="markdown",
    escape=escape_markdown,
    power=lambda power: f"×10{str(power).translate(SUPERSCRIPTS)}",
    code=_markdown_code,
    cite=_markdown_code,
    strong=lambda words: f"**{words}**",
    per_cent=f"{NARROW}%",
    missing="–",
)
LATEX_NOTATION = Notation(
    name="latex",
    escape=escape_latex,
    power=lambda power: rf"\times10^{{{power}}}",
    code=lambda text: rf"\texttt{{{escape_latex(text)}}}",
    cite=lambda key: rf"\cite{{{re.sub(r'[^A-Za-z0-9:_.+-]', '', key)}}}",
    strong=lambda words: rf"\textbf{{{words}}}",
    per_cent=r"\,\%",
    missing="--",
    minus="-",
    formula="$",
)
HTML = Notation(
    name="html",
    escape=escape_html,
    power=lambda power: f"×10<sup>{str(power).replace('-', MINUS)}</sup>",
    code=lambda text: f"<code>{escape_html(text)}</code>",
    cite=lambda key: f'<a href="#source-{anchor(key)}">{escape_html(key)}</a>',
    strong=lambda words: f"<strong>{words}</strong>",
    per_cent=f"{NARROW}%",
    missing="–",
)
