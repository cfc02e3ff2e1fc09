from shellbench.report.data.runs import rows_of_study, studies_of
from tests.report.studied import studied


def test_a_row_belongs_to_the_studies_that_declare_it(tmp_path):
    _, row = studied(tmp_path, "sampling", "field", {"cells": [5, 5]}, 0.1)
    both = row.model_copy(update={"suites": ("obstacle_course", "training", "sampling", "a suite of old")})
    assert studies_of(row) == {"sampling"}
    assert studies_of(both) == {"sampling", "training"}
    assert studies_of(row.model_copy(update={"suites": ("obstacle_course",)})) == set()
    assert rows_of_study([row, both], "training") == [both]


def test_a_run_that_no_suite_declares_is_part_of_no_study(tmp_path):
    _, row = studied(tmp_path, "sampling", "field", {"cells": [5, 5]}, 0.1)
    assert studies_of(row.model_copy(update={"declared": False})) == set()
