"""One cluster for all tests of this folder."""

from collections.abc import Iterator

import pytest

from tests.bench.cluster.two_workers import Cluster


@pytest.fixture(scope="package")  # no longer: other tests look at all processes that this one has started
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="needs the extra dask")
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
