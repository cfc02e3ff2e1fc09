"""Each check can fail: a right solver passes all of them, and one with a single fault fails the one that asks about it."""

import json
from functools import cache

import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.bench.plugins import kinds
from shellbench.bench.plugins.inside import answer
from shellbench.bench.plugins.registry import SolverEntry, load_solver
from shellbench.bench.plugins.subject import outcome
from shellbench.testing import child
from shellbench.testing.child import Child
from shellbench.testing.suite import OF_CASE, OF_SOLVER, CheckOptions, examine
from tests.testing import falling
from tests.testing.navier import FAULTS


class InProcess:
    """A solver that answers from this process: as `Subject` does, but for crashes."""

    def __init__(self, entry):
        self.child = Child(load_solver(entry))
        self.alive = True

    def call(self, operation, *arguments):
        what = arguments[1] if operation == "ask" else operation
        return outcome(what, *answer(getattr(self.child, operation), arguments))

    def stop(self):
        self.alive = False


@cache
def made_before(data):
    return kinds.problem_of(json.loads(data))


def examined(attribute, module="navier", **wish):
    """Examine in this process, which reads each shipped case once: a process of a solver reads all of them again."""
    entry = SolverEntry(module, f"tests.testing.{module}:{attribute}", "", "")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "problem_of", lambda data: made_before(json.dumps(data)))
        return list(examine(entry, CheckOptions(**wish), start=lambda: InProcess(entry)))


NOT_OF_STATICS = {"course"}
NOT_OF_A_FALL = {"seam", "linearity", "work", "convergence", "derivatives"}
UNTOLD_OF_A_FALL = {"storage"}  # its file has no arrays


def test_a_right_solver_passes_every_check():
    lines = examined("NAVIER")
    assert {line.check for line in lines} == {*OF_SOLVER, *OF_CASE}
    assert {line.check: line.verdict for line in lines if line.verdict.status != "passed"}.keys() == NOT_OF_STATICS


def test_a_right_motion_passes_every_check_of_motions():
    lines = examined("FALLING", "falling")
    by_status = {
        status: {line.check for line in lines if line.verdict.status == status}
        for status in ("failed", "not applicable", "not shown")
    }
    assert by_status == {"failed": set(), "not applicable": NOT_OF_A_FALL, "not shown": UNTOLD_OF_A_FALL}


@pytest.mark.parametrize("fault", falling.FAULTS)
def test_a_motion_with_a_fault_fails_that_check_and_no_other(fault):
    assert failed(examined(f"WRONG_{fault}", "falling")) == {falling.FAULTS[fault]}


def failed(lines):
    return {line.check for line in lines if line.verdict.status == "failed"}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_solver_with_a_fault_fails_the_check_that_asks_about_it(fault):
    assert failed(examined(f"WRONG_{fault}", checks=(FAULTS[fault],))) == {FAULTS[fault]}


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_and_no_other(fault):
    assert failed(examined(f"WRONG_{fault}")) == {FAULTS[fault]}


def test_every_check_has_a_solver_that_fails_it():
    assert {*FAULTS.values(), *falling.FAULTS.values()} == {*OF_SOLVER, *OF_CASE}


def test_a_case_that_is_declined_is_not_applicable_with_the_reason():
    lines = [line for line in examined("NAVIER", cases=(named_case("scordelis_lo"),)) if line.case]
    assert {line.verdict.status for line in lines} == {"not applicable"}
    assert all("simply supported" in line.verdict.words for line in lines)


def test_another_plate_converges_elsewhere_and_is_said_to():
    (line,) = examined("WRONG_soft", checks=("convergence",))
    assert line.verdict.status == "not shown"
    assert "converges to 0.536" in line.verdict.words  # 1.1 times the known 0.487482
    assert "known is 0.487482" in line.verdict.words


def test_a_solver_that_takes_nothing_cheap_is_examined_on_what_it_takes():
    (line,) = examined("PICKY", "naughty", checks=("history",))
    assert (line.case, line.verdict.status) == ("pinched_cylinder_free", "failed")


def test_numbers_that_can_not_be_altered_are_not_taken_for_numbers_that_do_not_count():
    (line,) = examined("SEALED", "naughty", checks=("storage",))
    assert line.verdict.status == "not shown"
    assert "coefficients, seal can't be altered" in line.verdict.words
