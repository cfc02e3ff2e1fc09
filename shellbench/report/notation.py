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
    number
        A number from its digits.
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
    """

    name: str
    escape: Callable[[str], str]
    number: Callable[[Digits], str]
    code: Callable[[str], str]
    cite: Callable[[str], str]
    strong: Callable[[str], str]
    per_cent: str
    missing: str

    def strong_number(self, digits: Digits) -> str:
        """Write a number that must not be overlooked."""
        return self.strong(self.number(digits))

    def error(self, relative: float) -> str:
        """Write a relative error in percent, with its sign and two significant digits."""
        return self.number(percent(relative)) + self.per_cent


def _doubt(digits: Digits) -> str:
    return "" if digits.uncertainty is None else f"({digits.uncertainty})"


def _text_number(digits: Digits) -> str:
    return f"{digits.mantissa}{_doubt(digits)}" + (f"e{digits.exponent}" if digits.exponent else "")


def _unicode_number(digits: Digits) -> str:
    text = digits.mantissa.replace("-", MINUS) + _doubt(digits)
    return text + (f"×10{str(digits.exponent).translate(SUPERSCRIPTS)}" if digits.exponent else "")


def _latex_number(digits: Digits) -> str:
    power = rf"\times10^{{{digits.exponent}}}" if digits.exponent else ""
    return f"${digits.mantissa}{_doubt(digits)}{power}$"


def _html_number(digits: Digits) -> str:
    text = digits.mantissa.replace("-", MINUS) + _doubt(digits)
    power = str(digits.exponent).replace("-", MINUS)
    return text + (f"×10<sup>{power}</sup>" if digits.exponent else "")


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
    number=_text_number,
    code=_one_line,
    cite=lambda key: f"[{_one_line(key)}]",
    strong=_one_line,
    per_cent=" %",
    missing="-",
)
MARKDOWN = Notation(
    name="markdown",
    escape=escape_markdown,
    number=_unicode_number,
    code=_markdown_code,
    cite=lambda key: _markdown_code(key),
    strong=lambda words: f"**{words}**",
    per_cent=f"{NARROW}%",
    missing="–",
)
LATEX_NOTATION = Notation(
    name="latex",
    escape=escape_latex,
    number=_latex_number,
    code=lambda text: rf"\texttt{{{escape_latex(text)}}}",
    cite=lambda key: rf"\cite{{{re.sub(r'[^A-Za-z0-9:_.+-]', '', key)}}}",
    strong=lambda words: rf"\textbf{{{words}}}",
    per_cent=r"\,\%",
    missing="--",
)
HTML = Notation(
    name="html",
    escape=escape_html,
    number=_html_number,
    code=lambda text: f"<code>{escape_html(text)}</code>",
    cite=lambda key: f'<a href="#source-{anchor(key)}">{escape_html(key)}</a>',
    strong=lambda words: f"<strong>{words}</strong>",
    per_cent=f"{NARROW}%",
    missing="–",
)
