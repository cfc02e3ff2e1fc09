"""Running toys on a cluster in tests."""

from collections.abc import Sequence
from typing import Any

from shellbench_dask.cluster import DaskCluster
from two_workers import Cluster

from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import Observer, Outcome, execute
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from tests.patience import GUARD


def toy_tasks(store: Store, *behaviours: str, solver: str = "toy", **more: Any) -> list[Task]:
    """One task for each behaviour."""
    return [
        task
        for behaviour in behaviours
        for task in make_plan(
            Request(("strip",), (), (solver,), {solver: {"behaviour": behaviour, **more}}, threads=1),
            store.read(),
            True,
        ).tasks
    ]


def on_cluster(
    cluster: Cluster,
    tasks: Sequence[Task],
    store: Store,
    observer: Observer | None = None,
    said: list[str] | None = None,
    timeout: float | None = GUARD,
    jobs: int | None = None,
) -> list[Outcome]:
    """Run tasks by the cluster's workers, one thread each."""
    say = (said if said is not None else []).append
    return execute(tasks, store, observer or Silent(), DaskCluster(str(cluster.file), jobs, 1, timeout, say))


def by_behaviour(outcomes: Sequence[Outcome]) -> dict[str, Outcome]:
    return {outcome.task.settings["behaviour"]: outcome for outcome in outcomes}
