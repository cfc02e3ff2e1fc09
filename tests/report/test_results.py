"""Each solver has a column and a verdict of its own, and what fails shows the value that fails."""

import pytest

from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import HTML, rounded
from shellbench.report.data.solutions import shortfalls
from shellbench.report.sections.results import cost_exhibits, results


def theirs(store, error):
    """Rows of a solver without frozen tolerances, as the gate leaves them: not judged."""
    rows = [row for row in store.rows if row.solver == "fem" and row.suite == "obstacle_course"]
    found = {"solver": "theirs", "relative_error": error, "tolerance": None, "passed": None}
    return [row.model_copy(update=found | {"value": row.reference * (1 + error)}) for row in rows]


@pytest.mark.parametrize(
    ("error", "unchecked", "short", "state"),
    [
        (5e-4, "", "class 1e-3", "good"),
        (5e-4, "no checks are known of it", "not checked", "expected"),
        (-0.4, "", "no class", "bad"),
    ],
)
def test_another_s_solver_is_shown_with_its_class(store, error, unchecked, short, state):
    good = [row for row in store.rows if row.solver == "fem"]
    shown = Evidence({}, [*good, *theirs(store, error)], store.folder).compared
    found = results(shown, HTML, {"theirs": unchecked})
    assert found.verdict.words == "All 4 gated values pass."
    assert [one.solution for one in found.standings] == ["fem", "theirs"]
    (own,) = found.by_class
    assert (own.short, own.state) == (short, state)
    assert found.state == ("good" if state == "good" else "expected")  # every gate holds, and not every solver a class
    cells = {title: cell for title, (_, cell) in found.lines}
    assert len(cells) == 4
    assert all(("fail, 1 % allowed" in cell.words) == (state == "bad") for cell in cells.values())
    assert all("%" in cell.error for cell in cells.values())


def test_an_expected_failure_shows_the_value_that_fails(store):
    headline = next(row for row in store.rows if row.solver == "fem")
    other = {"quantity": "membrane_energy", "primary": False, "passed": None, "relative_error": 6.7e-5}
    rows = [headline, headline.model_copy(update=other | {"open_finding": "known", "tolerance": 1e-5})]
    ((_, (cell,)),) = results(rows, HTML, {}).lines
    assert cell.state == "expected"
    assert cell.words.startswith("expected failure: membrane energy +0.0067 % (0.001 % allowed)")
    (line,) = shortfalls(rows)
    assert line.words == "expected failure (membrane energy +0.0067 % (0.001 % allowed)): known"


def test_error_against_cost_has_a_mark_for_each_case_and_solver(store):
    rows = [row for row in store.rows if not row.label]
    (made,) = cost_exhibits(Evidence({}, rows, store.folder))
    marks = [line for line in made.figure.axes[0].get_lines() if len(line.get_xdata())]
    assert made.name == "results_obstacle_course"
    assert len(marks) == 12
    assert "1 Square plate; 2 Scordelis-Lo roof" in made.caption


def test_nought_is_printed_so():
    assert rounded(0.0, 1e-24).mantissa == "0"
    shown = rounded(0.0, 5e-9, show_uncertainty=True)
    assert (shown.mantissa, shown.exponent, shown.uncertainty) == ("0", -9, 5)
