"""The exam of one solver: it solves the cases with known values with default settings, and gets its class.

The judgement is that of the gate, restricted to one solver. Every judged value counts, declined cases are listed, and a
case without an answer fails. Built-in solvers are graded in the same way as third-party solvers.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.classes import LOOSEST, Grade, grades
from shellbench.bench.judge.expected import expected_of_third_party
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import find_kind, kinds_of_theories
from shellbench.bench.run.execute import Executor, Observer, execute
from shellbench.bench.run.plan import FIRST_SEED, Plan, Request, make_plan
from shellbench.bench.store.current import CurrentRun, current_runs
from shellbench.bench.store.store import Store
from shellbench.problem import Problem


@dataclass(frozen=True)
class Sitting:
    """Result of an exam.

    Attributes
    ----------
    grade
        The class that the solver reaches, assuming that it passes its checks.
    missed
        Rows that miss even the loosest class, each with its reason.
    records
        Number of runs that were made.
    answers
        The runs that were graded.
    """

    grade: Grade
    missed: tuple[Row, ...]
    records: int
    answers: tuple[CurrentRun, ...] = ()


def suites_for(theories: Iterable[str], *, quick: bool) -> tuple[str, ...]:
    """Return the suites that grade a solver of these theories: those of its kinds of problem."""
    kinds = map(find_kind, kinds_of_theories(theories))
    return tuple(dict.fromkeys(suite for kind in kinds for suite in (kind.quick if quick else kind.exam)))


def questions(suites: Sequence[str]) -> list[Problem]:
    """Return the cases and variants of suites that known values judge, each once; InputError if a suite is unknown."""
    found = {case.name: case for suite in suites for case in catalog.cases_of(suite)}
    return [case for case in found.values() if is_judged(case)]


def is_judged(case: Problem) -> bool:
    """Return True if a known value judges a quantity of a case; always False for a user's own case."""
    known = () if catalog.is_own(case) else catalog.known_values(case.name).values
    return any(value.role == "judge" and value.theory == case.theory for value in known)


def plan_of(solver: str, cases: Sequence[Problem], store: Store, executor: Executor, threads: int) -> Plan:
    """Return the plan of the runs that a grade needs; runs with a valid record are kept.

    Raises
    ------
    InputError
        If the solver can't be imported.
    """
    request = Request(cases=tuple(case.name for case in cases), solvers=(solver,), seeds=(FIRST_SEED,), threads=threads)
    return make_plan(request, store.read(), expect=executor.expect)


def hold_exam(
    solver: str, cases: Sequence[Problem], store: Store, plan: Plan, executor: Executor, observer: Observer
) -> Sitting:
    """Run a solver on all cases without a valid record, and grade all its answers.

    Raises
    ------
    StoreError
        If the store can't be written.
    """
    # Suites are sorted from cheap to expensive. The reverse order starts long runs first, so that no core stays idle.
    with contextlib.closing(executor):
        outcomes = execute(plan.tasks[::-1], store, observer, executor, plan.seen)
    current = current_runs(store.read())
    expected = [expected_of_third_party("", case, solver, FIRST_SEED, current) for case in cases]
    rows = [row for one in expected for row in one.rows()]
    (grade,) = grades(rows, [solver], {solver: ""})
    return Sitting(
        grade=grade,
        missed=tuple(row for row in rows if row.status != "declined" and not row.passed),
        records=len(outcomes),
        answers=tuple(one.run for one in expected if one.run is not None),
    )


def missed_words(row: Row) -> str:
    """Describe in a line the failure of a row."""
    return f"{row.case} {row.quantity}: {row.reason or f'it misses class {LOOSEST:g}'}"
