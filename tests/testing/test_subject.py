"""A solver's process: a fault of its own costs one check, and is reported in one sentence."""

import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.plugins.subject import Lost, NoAnswer
from shellbench.errors import InputError
from shellbench.testing.child import solution_faults
from shellbench.testing.subject import solve_in, subject_of
from shellbench.testing.suite import CheckOptions, examine
from tests.patience import GUARD
from tests.testing.navier import NavierSolver

PLATE = named_case("square_plate")


def entry_of(attribute, module="tests.testing.naughty"):
    return SolverEntry("navier", f"{module}:{attribute}", "", "")


@pytest.mark.parametrize(
    ("attribute", "words"),
    [
        pytest.param("CRASH", "signal 11", marks=pytest.mark.long),
        ("EXIT", "exit code 3: words that are no answer"),
        ("RAISE", "ZeroDivisionError: a bug in the solver"),
    ],
)
def test_a_solve_that_does_not_answer_says_how_it_ended(attribute, words):
    subject = subject_of(entry_of(attribute), seconds=GUARD)
    with pytest.raises(NoAnswer, match=words):
        solve_in(subject, "plate", PLATE, {})
    subject.stop()


def test_a_solve_that_hangs_is_ended():
    subject = subject_of(entry_of("HANG"), seconds=GUARD)
    subject.seconds = 0.5  # from now on: the import may take longer
    with pytest.raises(Lost, match=r"did not end within 0\.5 s"):
        solve_in(subject, "plate", PLATE, {})
    assert not subject.alive


@pytest.mark.parametrize(
    ("said", "good"),
    [(None, True), ("centre still moves by 2e-3", True), ("", False), ("two\nlines", False), (1, False)],
)
def test_what_has_not_settled_is_said_in_one_clause(said, good):
    solution = NavierSolver().solve(PLATE, NavierSolver.settings_type())
    solution.unsettled = said
    assert ("a solution's unsettled is neither None nor one clause" in solution_faults(solution, "shell")) != good


def test_what_a_solver_prints_does_not_disturb_its_answers():
    subject = subject_of(entry_of("PRINT"), seconds=GUARD)
    answer = solve_in(subject, "plate", PLATE, {})
    assert answer.displacement([[50.0, 50.0]])[0, 2] == pytest.approx(-0.487482, rel=1e-4)
    subject.stop()


def test_a_crash_is_one_finding_and_not_several():
    lines = list(
        examine(entry_of("CRASH"), CheckOptions(seconds=GUARD, checks=("declining", "answers", "fields", "units")))
    )
    by_check = {line.check: line.verdict for line in lines}
    assert by_check["declining"].status == "passed"
    assert by_check["answers"].status == "failed"
    assert "its process died" in by_check["answers"].words
    assert by_check["fields"].status == "not shown"
    assert by_check["units"].status != "passed"


def test_a_solver_that_can_not_be_imported_is_bad_usage():
    with pytest.raises(InputError, match=r"^solver 'navier' can't be used: .*no_such_module"):
        list(examine(entry_of("X", "no_such_module"), CheckOptions()))


def test_settings_that_are_refused_are_bad_usage():
    with pytest.raises(InputError, match="field 'terms'"):
        list(examine(entry_of("NAVIER", "tests.testing.navier"), CheckOptions(settings={"terms": 0})))
