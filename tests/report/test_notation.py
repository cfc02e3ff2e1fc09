import html
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.report.data.notation import (
    HTML,
    LATEX_NOTATION,
    MARKDOWN,
    TEXT,
    Digits,
    allowance,
    anchor,
    byte_size,
    duration,
    percent,
    quoted,
    rounded,
)

reals = st.floats(1e-12, 1e12).flatmap(lambda x: st.sampled_from([x, -x]))


def number(digits: Digits) -> float:
    return float(f"{digits.mantissa}e{digits.exponent}")


@pytest.mark.parametrize(
    ("value", "uncertainty", "mantissa", "exponent", "doubt"),
    [
        (0.4874823193, 5e-8, "0.48748232", 0, 5),
        (1.828195e-5, 5e-11, "1.828195", -5, 5),
        (0.30059246, 1.2e-6, "0.3005925", 0, 12),  # a first digit of 1 keeps a second
        (1021.5, 3.0, "1022", 0, 3),
        (2.0e8, 4e5, "2.000", 8, 4),
        (-0.0123, 2e-4, "-0.0123", 0, 2),
    ],
)
def test_a_value_ends_where_its_uncertainty_begins(value, uncertainty, mantissa, exponent, doubt):
    assert rounded(value, uncertainty, show_uncertainty=True) == Digits(mantissa, exponent, doubt)


@given(reals, st.floats(1e-9, 0.3))
def test_rounding_stays_within_the_uncertainty(value, relative):
    uncertainty = relative * abs(value)
    digits = rounded(value, uncertainty, show_uncertainty=True)
    assert abs(number(digits) - value) <= 0.5 * uncertainty * (1 + 1e-9) + 1e-15 * abs(value)
    last = math.log10(abs(value)) - math.log10(uncertainty)
    told = digits.mantissa if "." in digits.mantissa else digits.mantissa.rstrip("0")  # zeros that only fill up
    figures = sum(c.isdigit() for c in told.lstrip("-0."))
    assert figures <= last + 3  # and no more digits than it leaves


@given(reals)
def test_a_quoted_figure_is_the_number_itself(value):
    figure = float(f"{value:.6g}")
    assert number(quoted(figure)) == pytest.approx(figure, rel=1e-14)


def test_a_quoted_figure_keeps_its_own_digits():
    assert quoted(0.3024) == Digits("0.3024")
    assert quoted(1.8248e-5) == Digits("1.8248", -5)
    assert quoted(4.52e-4) == Digits("4.52", -4)
    assert quoted(300.0) == Digits("300")


@pytest.mark.parametrize(
    ("error", "mantissa", "exponent"),
    [
        (0.0, "0", 0),
        (4.2e-6, "+0.00042", 0),
        (-7.23e-5, "-0.0072", 0),
        (0.00996, "+1.0", 0),
        (-0.999, "-100", 0),
        (9.3, "+930", 0),
        (1.6e-7, "+1.6", -5),
        (-2.14e-9, "-2.1", -7),
    ],
)
def test_an_error_is_in_percent_with_sign_and_two_digits(error, mantissa, exponent):
    assert percent(error) == Digits(mantissa, exponent)


@given(reals)
def test_an_error_in_percent_is_right_to_two_digits(error):
    assert number(percent(error)) == pytest.approx(100 * error, rel=0.05 + 1e-9)
    assert percent(error).mantissa[0] == ("+" if error > 0 else "-")


@pytest.mark.parametrize(
    ("tolerance", "mantissa"), [(1e-6, "0.0001"), (1.5e-4, "0.015"), (1e-3, "0.1"), (5e-5, "0.005")]
)
def test_a_tolerance_is_as_declared(tolerance, mantissa):
    assert allowance(tolerance) == Digits(mantissa)


def test_bytes_are_in_powers_of_a_thousand():
    assert [byte_size(n) for n in (0, 999, 1234, 43_464, 960_000, 310_000_000, 2.5e9)] == [
        "0 B",
        "999 B",
        "1.2 kB",
        "43 kB",
        "960 kB",
        "310 MB",
        "2.5 GB",
    ]


def test_seconds_have_two_digits():
    assert [duration(s) for s in (0.0, 0.0234, 0.196, 3.04, 9.97, 61.3)] == ["0", "0.023", "0.20", "3.0", "10", "61"]


NOTATIONS = (TEXT, MARKDOWN, LATEX_NOTATION, HTML)
HOSTILE = (
    '<script>alert("x")</script> & 50 % of $\\int_a^b$ ~{#1} | [a](javascript:b) `c` *d* _e_\n\\input{/etc/passwd}'
)


def test_one_number_in_every_notation():
    digits = Digits("-1.828195", -5, 12)
    assert TEXT.number(digits) == "-1.828195(12)e-5"
    assert MARKDOWN.number(digits) == "−1.828195(12)×10⁻⁵"
    assert LATEX_NOTATION.number(digits) == r"$-1.828195(12)\times10^{-5}$"
    assert HTML.number(digits) == "−1.828195(12)×10<sup>−5</sup>"


def test_html_says_the_words_and_nothing_else():
    written = HTML.escape(HOSTILE)
    assert "<" not in written
    assert '"' not in written
    assert html.unescape(written) == " ".join(HOSTILE.split())


def test_latex_keeps_no_command_of_the_words():
    written = LATEX_NOTATION.escape(HOSTILE)
    bare = re.sub(r"\\text[a-z]+\{\}|\\[{}$&#%_]", "", written)
    assert not set(bare) & set('\\{}$&#%_^~<>|"')


def test_markdown_can_not_open_a_column_a_tag_or_a_link():
    written = MARKDOWN.escape(HOSTILE)
    assert "\n" not in written
    assert not re.search(r"(?<!\\)[|<>\[\]*_`$~]", written)


@given(st.text(max_size=60))
def test_no_notation_breaks_a_line_or_fails(text):
    for notation in NOTATIONS:
        for written in (notation.escape(text), notation.code(text), notation.cite(text)):
            assert "\n" not in written
            assert "\r" not in written


@given(st.text(max_size=30))
def test_anchors_are_plain(text):
    assert re.fullmatch(r"[a-z0-9-]*", anchor(text))


@pytest.mark.parametrize("notation", NOTATIONS, ids=lambda n: n.name)
def test_an_error_carries_its_sign_and_unit(notation):
    written = notation.error(-0.0123)
    assert "1.2" in written
    assert re.search("[-−]", written)
    assert "%" in written
