import html
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.report.notation import HTML, LATEX_NOTATION, MARKDOWN, TEXT, Digits, anchor

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
