"""Pages on the papers: every row has an answer or a reason, and names cases, suites and quantities that exist."""

import re
from fnmatch import filter as matching
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog

PAGES = sorted((Path(__file__).parents[1] / "docs/papers").glob("0*.md"))
NAME = re.compile(r"`([a-z][a-z0-9]*_[a-z0-9_*]*)(?:@\w+)?`")


def rows(text):
    """Cells of each row: item of the paper, case or page, what came out, reason that it was not done."""
    lines = [line for line in text.splitlines() if line.startswith("|") and not set(line) <= set("|- ")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return [row for row in cells if not row[-1].startswith("not done")]


def unanswered(text):
    """Rows that are not four cells, or have neither an answer with its place nor a reason."""
    return [row for row in rows(text) if len(row) != 4 or not row[0] or not ((row[1] and row[2]) or row[3])]


def unknown(text):
    """Names in the second cells that are no case, suite or quantity."""
    quantities = {
        of for name in catalog.case_names() for q in catalog.named_case(name).quantities for of in (q.name, q.kind)
    }
    known = {*catalog.case_names(), *catalog.suite_names(), *quantities}
    return [name for row in rows(text) for name in NAME.findall(row[1]) if not matching(known, name)]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_row_has_an_answer_that_exists(path):
    text = path.read_text(encoding="utf-8")
    assert len(rows(text)) > 10
    assert unanswered(text) == []
    assert unknown(text) == []


def test_rows_without_an_answer_and_wrong_names_are_seen():
    text = "| paper | case | came out | not done, because |\n|---|---|---|---|\n| a | `square_plate` | 1 | |\n"
    wrong = "| b | | 1 | |\n| c | `square_plate` | | |\n| d | page | 1 |\n"
    assert [row[0] for row in unanswered(text + wrong)] == ["b", "c", "d"]
    assert unknown(text + "| e | `roof_*`, `no_such_case`, `no_*` | 1 | |") == ["no_such_case", "no_*"]
