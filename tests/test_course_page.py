"""The page on the obstacle course shows what is kept of its runs."""

import re

from docs import course_page


def test_the_tables_of_the_page_are_those_of_the_kept_rows():
    text = course_page.PAGE.read_text(encoding="utf-8")
    assert re.findall(r"<!-- table (\w+) -->", text) == list(course_page.TABLES)
    for make in course_page.TABLES.values():
        assert "\n".join(make()) in text, "write it anew by `python -m docs.course_page`"


def test_a_cell_has_the_worst_error_the_longest_time_and_the_largest_memory():
    rows = [
        {"case": "c", "solver": "s", "value": 1.0, "relative_error": e, "absolute_error": None, "seconds": t, "peak_memory_bytes": m}
        for e, t, m in ((1e-3, 2.0, 3e6), (-2e-3, 1.0, 4e6))
    ]  # fmt: skip
    assert course_page.cell(rows, "c", "s") == "0.2 %, 2.0 s, 4 MB"
    assert course_page.cell(rows, "c", "other") == "not run"


def test_an_absolute_error_has_its_unit():
    row = {"case": "c", "solver": "s", "value": 1.0, "relative_error": None, "absolute_error": -3e-5, "unit": "m",
           "seconds": 1.0, "peak_memory_bytes": 1e6}  # fmt: skip
    assert course_page.cell([row], "c", "s").startswith("3e-05 m, ")
