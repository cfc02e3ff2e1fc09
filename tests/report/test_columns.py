"""The vocabulary of columns: one heading, one side and one way of being written for each, in every table."""

import pandas as pd
import pytest

from shellbench.report.data.columns import (
    VOCABULARY,
    column,
    error,
    frame,
    in_its_unit,
    known_value,
    significant,
    strong,
    words,
)
from shellbench.report.data.notation import HTML, LATEX_NOTATION, MARKDOWN, TEXT
from shellbench.report.data.table import Table

VALUES = {"solution": "fem, fine", "solver": "fem", "seeds": 3, "unknowns": 1827, "seconds": 1.234, "error": -0.0123}


def cell(one, line, notation=TEXT):
    return one.show(line, notation)


@pytest.mark.parametrize("name", sorted(VOCABULARY))
def test_a_value_that_is_not_there_is_a_dash_and_nothing_where_there_is_nothing_to_say(name):
    one = column(name)
    for notation in (TEXT, MARKDOWN, LATEX_NOTATION, HTML):
        for line in ({}, {name: None}, {name: float("nan")}, {name: pd.NA}, {name: ""}):
            assert cell(one, line, notation) == notation.missing
            assert cell(one, line | {"kind": "judge"}, notation) == ""


def test_columns_are_named_and_the_rest_follows():
    table = Table("t", "T", "", pd.DataFrame([{"block": "", **VALUES}]), tuple(VALUES))
    head, _, line = table.write("markdown").splitlines()[:3]
    assert head == "| Solution | Solver | Seeds | Unknowns | Time (s) | Error |"
    assert line == "| `fem`, fine | `fem` | 3 | 1827 | 1.2 | −1.2\N{NARROW NO-BREAK SPACE}% |"
    assert [one.right for one in table.declared] == [False, False, True, True, True, True]
    assert [one.sort_value(VALUES) for one in table.declared] == [None, None, 3.0, 1827.0, 1.234, -0.0123]


def test_a_departure_is_said_where_it_is_and_changes_nothing_else():
    assert column("seeds", "Runs").heading == "Runs"
    assert cell(column("seeds", "Runs"), VALUES) == "3"
    drift = column("drift", "Energy drift", significant(2), unit="J")
    assert drift.heading == "Energy drift (J)"
    assert cell(drift, {"drift": 0.034567}) == "0.035"
    assert cell(drift, {"drift": 0.0}) == "0"
    assert column("seeds").heading == "Seeds"


def test_a_column_that_nobody_declared_is_an_error():
    with pytest.raises(KeyError):
        column("nobody_declared_it")


def test_what_stands_instead_of_a_value():
    absolute = in_its_unit("absolute", significant(2))
    one = column("relative", "Error", error, instead=absolute)
    assert cell(one, {"relative": 0.5, "absolute": 3e-9, "unit": "m"}) == "+50 %"
    assert cell(one, {"relative": None, "absolute": 3e-9, "unit": "m"}) == "3.0e-9 m"
    assert cell(one, {"relative": None, "absolute": None, "unit": "m"}) == "-"


def test_a_known_value_has_its_uncertainty_and_may_be_strong():
    line = {"reference": 0.4875, "reference_uncertainty": 2e-6}
    assert cell(column("reference"), line) == "0.487500(2)"
    assert cell(column("reference", way=strong(known_value)), line, MARKDOWN) == "**0.487500(2)**"
    assert cell(column("reference"), {"reference": 0.25, "reference_uncertainty": None}) == "0.250000"


def test_words_are_made_harmless_in_every_notation():
    one = column("hostile", "Hostile", words)
    line = {"hostile": "<b> | \\input{x}"}
    assert "<b>" not in cell(one, line, HTML)
    assert "\\input" not in cell(one, line, LATEX_NOTATION)
    assert cell(one, line, MARKDOWN).count("\\|") == 1


def test_whole_numbers_stay_whole_though_some_are_missing():
    data = frame([{"solution": "a", "steps": 3, "seeds": "0 1"}, {"solution": "b", "steps": None, "seeds": ""}])
    assert data.to_csv(index=False).splitlines()[1] == "a,3,0 1"
    assert data["steps"].dtype == "Int64"
