"""The command: what it prints, and what it ends with."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from shellbench.bench.plugins.registry import SolverEntry
from shellbench.cli import app
from shellbench.errors import InputError
from shellbench.testing import suite
from shellbench.testing.examination import Verdict
from shellbench.testing.grading import ExamOptions
from shellbench.testing.suite import Line


@pytest.fixture
def lines(monkeypatch):
    made = [Line("protocol", "", Verdict("passed", "well")), Line("units", "square_plate", Verdict("not shown", "why"))]
    monkeypatch.setattr(suite, "find_solver", lambda name: SolverEntry(name, "nowhere:X", "", ""))
    monkeypatch.setattr(suite, "examine", lambda *_: iter(made))
    return made


def printed(**options):
    out = io.StringIO()
    code = suite.check_solver("mine", console=Console(file=out, width=500), **options)
    return code, out.getvalue()


def test_each_check_has_a_line_and_all_together_one(lines):
    code, text = printed()
    first, second, last = text.splitlines()
    assert code == 0
    assert first.split() == ["passed", "protocol:", "well"]
    assert second.startswith("not shown")
    assert last == "mine: 1 passed, 1 not shown"


def test_a_failed_check_ends_in_one(lines):
    lines.append(Line("work", "square_plate", Verdict("failed", "too much")))
    code, text = printed()
    assert code == 1
    assert "1 failed" in text


def test_json_says_the_same(lines):
    code, text = printed(as_json=True)
    data = json.loads(text)
    assert code == 0
    assert data["solver"] == "mine"
    assert data["checks"][1] == {"check": "units", "case": "square_plate", "status": "not shown", "words": "why"}


def test_refinements_are_read_from_coarse_to_fine():
    assert suite.given_refinements("cells=[2, 2];[4, 4];[8, 8]") == (
        {"cells": [2, 2]},
        {"cells": [4, 4]},
        {"cells": [8, 8]},
    )
    assert suite.given_refinements(None) == ()
    with pytest.raises(InputError, match="--refine"):
        suite.given_refinements("cells=1;2")


def test_settings_of_another_solver_are_refused():
    assert suite.given_settings("mine", ["mine.order=3"]) == {"order": 3}
    with pytest.raises(InputError, match="mine"):
        suite.given_settings("mine", ["fem.order=3"])


def test_an_unknown_solver_is_bad_usage():
    with pytest.raises(InputError, match="unknown solver"):
        suite.check_solver("no_such_solver")


def test_the_command_line_passes_all_on(monkeypatch):
    given = {}

    def check(name, cases, settings, **options):
        given.update(name=name, cases=cases, settings=settings, **options)
        return 1

    monkeypatch.setattr(suite, "check_solver", check)
    options = ["--case", "square_plate", "--set", "mine.order=3", "--refine", "order=1;2;3", "--timeout", "5", "--json"]
    result = CliRunner().invoke(app, ["check-solver", "mine", *options])
    assert result.exit_code == 1
    assert given == {
        "name": "mine",
        "cases": ["square_plate"],
        "settings": ["mine.order=3"],
        "refine": "order=1;2;3",
        "seconds": 5.0,
        "as_json": True,
        "exam": ExamOptions((), Path("reports/runs")),  # of the cases that are named
    }


@pytest.mark.parametrize(
    ("options", "suites"),
    [
        ([], (None, False)),  # of the solver's kinds of problem
        (["--quick"], (None, True)),
        (["--suite", "shapes"], (("shapes",), False)),
        (["--case", "square_plate", "--quick"], (None, True)),
    ],
)
def test_what_it_is_graded_by(monkeypatch, options, suites):
    given = {}
    monkeypatch.setattr(suite, "check_solver", lambda *_, **more: given.update(more) or 0)
    assert CliRunner().invoke(app, ["check-solver", "mine", *options]).exit_code == 0
    assert (given["exam"].suites, given["exam"].quick) == suites


def test_quick_and_suites_exclude_each_other(monkeypatch):
    monkeypatch.setattr(suite, "check_solver", lambda *_, **__: 0)
    assert CliRunner().invoke(app, ["check-solver", "mine", "--quick", "--suite", "shapes"]).exit_code == 2
