"""One cluster for all tests of this folder."""

from collections.abc import Iterator

import pytest

pytest.importorskip("distributed", reason="needs Dask: python -m pip install ./plugins/dask")

from two_workers import Cluster

from shellbench.bench.catalogue import brought
from tests.bench.conftest import own_case, plugin, store, toys

__all__ = ["own_case", "plugin", "store", "toys"]  # fixtures of toys


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what other installed packages bring: the toys' catalog has nothing that they add to."""
    monkeypatch.setattr(brought, "_brought", lambda path: ())


@pytest.fixture(scope="session")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    cluster = Cluster(tmp_path_factory.mktemp("dask"))
    try:
        yield cluster.start()
    finally:
        cluster.stop()


@pytest.fixture
def cluster(started: Cluster) -> Cluster:
    """A cluster of two workers at least; tests may kill them."""
    started.ensure(2)
    return started
