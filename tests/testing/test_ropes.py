"""The checks of ropes: a right solver passes all of them, and one with a fault fails the one that asks about it."""

import io

import pytest
from rich.console import Console

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problem import Capabilities
from shellbench.testing import ropes, suite
from shellbench.testing.child import capability_faults
from shellbench.testing.suite import OF_ROPE, OF_SOLVER
from tests.testing.swinging import FAULTS
from tests.testing.test_suite import examined, failed

REFINED = ({"steps_per_second": 15.0}, {"steps_per_second": 30.0}, {"steps_per_second": 60.0})


def test_a_right_solver_passes_every_check():
    lines = examined("SWINGING", "swinging")
    assert {line.check for line in lines} == {*OF_SOLVER, *OF_ROPE}
    assert {line.check: line.verdict.words for line in lines if line.verdict.status != "passed"} == {}
    assert {line.case for line in lines} == {"", "rope_pendulum"}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_solver_with_a_fault_fails_the_check_that_asks_about_it(fault):
    assert failed(examined(f"WRONG_{fault}", "swinging", checks=(FAULTS[fault],))) == {FAULTS[fault]}


def test_every_check_of_ropes_has_a_solver_that_fails_it():
    assert set(FAULTS.values()) == set(OF_ROPE)


def test_a_theory_of_a_kind_is_a_theory():
    assert capability_faults(Capabilities(("rigid-links",), "ropes")) == []
    assert "must be among" in capability_faults(Capabilities(("strings",), "ropes"))[0]


def test_a_rope_in_other_units_or_turned_is_the_same_rope():
    case = named_case("rope_jerk")
    turned = ropes.relocated(case, ropes.about_the_vertical(0.7), ropes.SHIFT)
    grams = ropes.rescaled(case)
    places = ropes.start_of(case)[0]
    assert ropes.start_of(turned)[0] - ropes.SHIFT == pytest.approx(places @ ropes.about_the_vertical(0.7).T)
    assert ropes.start_of(grams)[0] == pytest.approx(1000 * places)
    assert grams.masses == pytest.approx(1000 * case.masses)
    assert ropes.relocated(named_case("rope_falling_root"), ropes.about_the_vertical(0.7), ropes.SHIFT) is None
    assert ropes.rescaled(named_case("rope_wind")) is None


@pytest.mark.long
def test_our_own_solver_of_chains_at_rest_is_examined_on_one(tmp_path):
    out = io.StringIO()
    exam = suite.ExamOptions(None, tmp_path / "runs", 1)
    assert suite.check_solver("chain", console=Console(file=out, width=500), exam=exam) == 0
    text = out.getvalue()
    assert "answers (hanging_chain)" in text
    assert "(suite rope)" in text
    assert " failed" not in text
