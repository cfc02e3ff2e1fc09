"""Numbers and words as they are printed: how many digits of a number are worth it, and how a format writes them.

A value is printed down to the first digit of its uncertainty (two digits, where the first is a 1), as in
1.828195(5)e-5; an error in percent with its sign and two significant digits. Plain text, Markdown, LaTeX and HTML each
have a notation.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable
from dataclasses import dataclass

SMALLEST_PLAIN = -3  # values below 1e-3 and
LARGEST_PLAIN = 5  # from 1e6 on are printed with a power of ten
FIGURES = 6  # significant digits of a value whose uncertainty is not known
FINEST = 1e-9  # finest relative digit worth printing: no figure here is known better
QUOTED = 15  # significant digits in which a quoted figure survives double precision
PERCENT_FIGURES = 2
BYTES_A_POINT = 3 * 8  # displacement of a vertex in double precision; connectivity not counted
SMALLEST_PLAIN_PERCENT = -4  # errors below 1e-4 % are printed with a power of ten
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
class Digits:
    """A number as text: mantissa times ten to the exponent, with its uncertainty in the last digits.

    Attributes
    ----------
    mantissa
        With its sign, as "-" or "+", and the decimals worth printing.
    exponent
        0 if the number is printed plainly.
    uncertainty
        In units of the last digit of the mantissa; None if it isn't printed.
    """

    mantissa: str
    exponent: int = 0
    uncertainty: int | None = None


def order_of(value: float) -> int:
    """Return the power of ten of the first significant digit; value must not be zero."""
    return int(f"{abs(value):.{QUOTED}e}".partition("e")[2])


def last_order(value: float, uncertainty: float | None) -> int:
    """Return the power of ten of the last digit worth printing."""
    if not value:
        return order_of(uncertainty) if uncertainty else 0
    if not uncertainty or not math.isfinite(uncertainty):
        return order_of(value) - FIGURES + 1
    doubt = max(uncertainty, FINEST * abs(value))
    order = order_of(doubt)
    first = f"{doubt:.{QUOTED}e}"[0]
    return min(order - (first == "1"), order_of(value))


def rounded(value: float, uncertainty: float | None = None, *, show_uncertainty: bool = False) -> Digits:
    """Print a value with the digits that its uncertainty leaves.

    Parameters
    ----------
    value
        Finite.
    uncertainty
        Half width in the value's unit; None if unknown, and then `FIGURES` significant digits are printed.
    show_uncertainty
        Whether the uncertainty is printed too, in units of the last digit.
    """
    last = last_order(value, uncertainty)
    digits = _rounded_at(value, last)
    if not (show_uncertainty and uncertainty):
        return digits
    exponent = digits.exponent if value else min(last, 0)  # 0(5)e-9: nothing, to 5e-9
    return Digits(digits.mantissa, exponent, max(1, math.ceil(uncertainty / 10.0**last - 1e-6)))


def quoted(value: float, plain_from: int = SMALLEST_PLAIN) -> Digits:
    """Print a figure with the digits that its source gives: the shortest that mean the same number.

    Values of a smaller power of ten than `plain_from` are printed with it.
    """
    if not value:
        return Digits("0")
    text = f"{value:.{QUOTED - 1}e}"
    mantissa, _, exponent = text.partition("e")
    decimals = len(mantissa.rstrip("0").partition(".")[2])
    return _rounded_at(value, int(exponent) - decimals, plain_from)


def percent(error: float, *, signed: bool = True) -> Digits:
    """Print a relative error in percent with two significant digits; a sign is always shown where it means much."""
    value = 100.0 * error
    if not value:
        return Digits("0")
    leading = order_of(float(f"{value:.{PERCENT_FIGURES - 1}e}"))
    last = leading - PERCENT_FIGURES + 1
    digits = _rounded_at(value, last, plain_from=SMALLEST_PLAIN_PERCENT)
    return digits if value < 0 or not signed else Digits(f"+{digits.mantissa}", digits.exponent)


def allowance(tolerance: float) -> Digits:
    """Print a relative tolerance in percent, as it was declared."""
    return quoted(float(f"{100.0 * tolerance:.{FIGURES}g}"), SMALLEST_PLAIN_PERCENT)


def _rounded_at(value: float, last: int, plain_from: int = SMALLEST_PLAIN) -> Digits:
    """Print a value down to the digit of ten to the power `last`."""
    if not value:
        return Digits("0")
    exponent = order_of(round(value, -last) or value)
    if plain_from <= exponent <= LARGEST_PLAIN:
        return Digits(f"{round(value, -last):.{max(0, -last)}f}")
    decimals = max(0, exponent - last)
    mantissa, _, power = f"{value:.{decimals}e}".partition("e")
    return Digits(mantissa, int(power))


def byte_size(count: float) -> str:
    """Print a number of bytes in the unit that suits it, in powers of 1000."""
    size = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if size < 999.5 or unit == "GB":
            return f"{size:.0f} {unit}" if unit == "B" or size >= 99.5 else f"{size:.2g} {unit}"
        size /= 1000
    raise AssertionError


def duration(seconds: float) -> str:
    """Print seconds with two significant digits, whole above ten."""
    if seconds >= 9.95:
        return f"{seconds:.0f}"
    return f"{float(f'{seconds:.2g}'):.{max(0, 1 - order_of(seconds))}f}" if seconds > 0 else "0"


@dataclass(frozen=True)
class Notation:
    """Notation of one output format.

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


def plain(text: str) -> str:
    """Make words harmless to matplotlib's mathematical text."""
    return text.replace("\\", "\\\\").replace("$", r"\$")


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
