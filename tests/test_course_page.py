"""The tables of three findings are those of the kept runs."""

import re

import pytest

from docs import course_page
from shellbench.report.data.kept_data import Summary
from tests.report.test_kept import CASE, summary


@pytest.mark.parametrize("page", course_page.TABLES, ids=lambda page: page.stem)
def test_the_tables_of_a_page_are_those_of_the_kept_rows(page):
    text = page.read_text(encoding="utf-8")
    makers = course_page.TABLES[page]
    assert re.findall(r"<!-- table (\w+) -->", text) == [make.__name__ for make in makers]
    for make in makers:
        assert "\n".join(make()) in text, "write it anew by `python -m docs.course_page`"


def test_a_cell_has_the_worst_error_the_longest_time_and_the_largest_memory():
    rows = [
        {"case": "c", "solver": "s", "value": 1.0, "relative_error": e, "absolute_error": None, "seconds": t, "peak_memory_bytes": m}
        for e, t, m in ((1e-3, 2.0, 3e6), (-2e-3, 1.0, 4e6))
    ]  # fmt: skip
    assert course_page.cell(rows, "c", "s") == "0.2 %, 2.0 s, 4 MB"
    assert course_page.cell(rows, "c", "s", memory=False) == "0.2 %, 2.0 s"
    assert course_page.cell(rows, "c", "other") == "not run"


def test_an_absolute_error_has_its_unit():
    row = {"case": "c", "solver": "s", "value": 1.0, "relative_error": None, "absolute_error": -3e-5, "unit": "m",
           "seconds": 1.0, "peak_memory_bytes": 1e6}  # fmt: skip
    assert course_page.cell([row], "c", "s").startswith("3e-5 m, ")


def test_the_cheapest_run_is_the_coarsest_from_which_on_all_finer_ones_hold_the_level(monkeypatch):
    found = Summary.model_validate(summary())
    # fem's errors: 4: 0.39 %, 8: 0.024 %; the field's: 0.3 and 0.6 % at all sizes
    assert course_page.cheapest(found, CASE, "fem", 1e-3) == "6.1 kB, 0.064 s"
    assert course_page.cheapest(found, CASE, "field", 1e-3) == "not reached"
    assert course_page.cheapest(found, CASE, "other", 1e-3) == "not run"
    monkeypatch.setattr(course_page, "read_summary", lambda: found)
    lines = course_page.at_equal_error()
    assert "commit c0ffee000000" in lines[0]
    assert len(lines) == 2 + 2 + len(course_page.LEVELS)
