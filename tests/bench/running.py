"""Running tasks in tests, as the command line does."""

from __future__ import annotations

from typing import Any

from shellbench.bench.display import Silent
from shellbench.bench.execute import Outcome, execute
from shellbench.bench.local import LocalProcesses
from shellbench.bench.plan import Request, make_plan
from shellbench.bench.record import Record
from shellbench.bench.store import Store


def run(
    store: Store,
    *cases: str,
    suites: tuple[str, ...] = (),
    solvers: tuple[str, ...] = (),
    settings: dict[str, dict[str, Any]] | None = None,
    seeds: tuple[int, ...] = (),
    force: bool = False,
    timeout: float | None = None,
    jobs: int = 2,
) -> list[Outcome]:
    """Plan and run."""
    request = Request(tuple(map(str, cases)), suites, solvers, settings or {}, seeds)
    plan = make_plan(request, store.read(), force)
    return execute(plan.tasks, store, Silent(), LocalProcesses(jobs, 1, timeout))


def behave(store: Store, behaviour: str, **more: Any) -> Record:
    """Run the strip by a toy solver that behaves like this; return its record."""
    outcome = run(store, "strip", solvers=("toy",), settings={"toy": {"behaviour": behaviour}}, **more)[0]
    assert outcome.record is not None
    return outcome.record
