"""The gate of the course is tested on the answers of its napkin and its sleeve: each fault in them must turn it red.

Faults in the mechanics behind these answers are injected by tests/test_cloth_faults.py and tests/test_cloth_ndf_faults.py.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.listing import gated_quantities
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store.record import Measured, Record
from shellbench.bench.store.store import Contents, Store
from shellbench.bench.store.task import Task
from tests.injecting import room
from tests.test_faults import accuracy_gate

SUITE = "obstacle_course"
AT_REST = ("square_plate", "scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free")
MOVED = ("sleeve_course", "napkin_course")
SOLVERS = ("fem", "ndf", "ndf-ritz")
SCOPE = Scope(suites=(SUITE,), cases=MOVED)
PAIRS = [(case, solver) for case in MOVED for solver in SOLVERS]
EVERY = {(case, solver, q.name) for case, solver in PAIRS for q in catalog.named_case(case).quantities}


@cache
def tasks() -> list[Task]:
    """Return the runs that the course asks of the napkin and the sleeve, found once: solvers are asked for them."""
    return list(make_plan(Request(MOVED, (SUITE,)), Contents(())).tasks)


def right_values(case: str) -> dict[str, Measured]:
    """Return the known values of a case, each as an answer that states a hundredth of what `fem` is allowed."""
    known, theory = catalog.known_values(case), catalog.named_case(case).theory
    judges = {q.name: known.judge(q.name, theory) for q in catalog.named_case(case).quantities}
    return {
        name: Measured(value=judge.value, uncertainty=room(catalog.named_case(case), name, "fem") / 100)
        for name, judge in judges.items()
    }


def moved(case: str, solver: str, values: Mapping[str, Measured], share: float) -> dict[str, Measured]:
    """Return values that are off by a share of what a solver is allowed."""
    return {
        name: one.model_copy(update={"value": one.value + share * room(catalog.named_case(case), name, solver)})
        for name, one in values.items()
    }


def keep(store: Store, task: Task, **change: object) -> None:
    """Keep a record of a run whose values are the known ones, but for what changes."""
    record = Record(
        run_id=task.run_id,
        created=task.created,
        identity=task.identity,
        case_name=task.case_name,
        case=task.case,
        defaults=task.defaults,
        solver_label=task.solver_label,
        status="ok",
        seconds=1.0,
        values=right_values(task.case_name),
        environment=task.environment,
    )
    store.commit(store.begin(task.run_id), record.model_copy(update=change))


Change = dict[str, object]


def verdict_with(folder: Path, changes: Mapping[tuple[str, str], Change]) -> Verdict:
    """Return the verdict on right answers, but for what changes in those of a solver to a case."""
    store = Store(folder)
    for task in tasks():
        keep(store, task, **changes.get((task.case_name, task.identity.solver), {}))
    return accuracy_gate(store, SCOPE)


def red(verdict: Verdict) -> set[tuple[str, str, str]]:
    return {(f.row.case, f.row.solver, f.row.quantity) for f in verdict.accuracy if f.colour == "red"}


def test_the_course_asks_six_shells_and_draws_variants_of_those_at_rest() -> None:
    assert [case.name for case in catalog.members(SUITE)] == [*AT_REST, *MOVED]
    suite = catalog.find_suite(SUITE)
    for case in MOVED:
        assert {(run.solver, run.seeds) for run in suite.runs_for(case)} == {(solver, (0,)) for solver in SOLVERS}
    asked = {case.name.partition("@")[0] for case in catalog.cases_of(SUITE) if "@" in case.name}
    assert asked == set(AT_REST)


def test_every_figure_of_napkin_and_sleeve_is_gated_for_each_solver() -> None:
    for case in MOVED:
        every = {quantity.name for quantity in catalog.named_case(case).quantities}
        for solver in SOLVERS:
            assert {quantity.name for quantity in gated_quantities(catalog.named_case(case), solver)} == every


def test_right_answers_are_green(tmp_path: Path) -> None:
    verdict = verdict_with(tmp_path, {})
    assert {(f.row.case, f.row.solver, f.row.quantity) for f in verdict.accuracy} == EVERY
    assert {finding.colour for finding in verdict.accuracy} == {"green"}
    assert verdict.good()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("share", [1.1, -1.1])
def test_each_figure_beyond_its_tolerance_is_red(tmp_path: Path, share: float) -> None:
    changes = {pair: {"values": moved(*pair, right_values(pair[0]), share)} for pair in PAIRS}
    assert red(verdict_with(tmp_path, changes)) == EVERY
