"""``shellbench run --scheduler`` as a user runs it: sentences, exit codes, interrupts."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from two_workers import Cluster

from shellbench.bench.store.store import Store
from tests.bench.conftest import PLUGIN
from tests.patience import COMMAND_LINE, GUARD, until

PRESSES = 20
IMPATIENT = f"from shellbench_dask import cluster; cluster.PATIENCE = 0.5; {COMMAND_LINE}"
WITHOUT_DASK = f"""
from shellbench.bench.plugins import registry
registered = registry.registered
registry.registered = lambda group, what: {{}} if what == "executor" else registered(group, what)
{COMMAND_LINE}
"""


@dataclass
class Program:
    """A command that runs."""

    process: subprocess.Popen[str]

    @classmethod
    def start(cls, code: str, *arguments: str | Path) -> Program:
        root = Path(__file__).parents[3]
        return cls(
            subprocess.Popen(
                [sys.executable, "-c", code, "run", *map(str, arguments)],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, "PYTHONPATH": os.pathsep.join([str(PLUGIN), str(root)])},
            )
        )

    def interrupt(self) -> None:
        """Press Ctrl-C, and again where Python lost it: it does, in a callback of its garbage collector."""
        for _ in range(PRESSES):
            self.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(GUARD / PRESSES)
                return

    def end(self) -> tuple[int, str, str]:
        """Exit code, standard output and standard error."""
        out, err = self.process.communicate(timeout=GUARD)
        return self.process.returncode, out, err


def test_without_the_plug_in_it_says_how_to_install_it(own_case: Path, store: Store) -> None:
    code, out, err = Program.start(WITHOUT_DASK, own_case, "--solver", "toy", "--scheduler", "a:1", "--store", store.folder).end()  # fmt: skip
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "python -m pip install ./plugins/dask" in err


@pytest.mark.long
def test_an_unreachable_scheduler_is_one_sentence(own_case: Path, store: Store) -> None:
    address = "tcp://127.0.0.1:9"
    code, out, err = Program.start(IMPATIENT, own_case, "--solver", "toy", "--scheduler", address, "--store", store.folder).end()  # fmt: skip
    assert (code, out) == (2, "")
    assert err.startswith(f"shellbench: --scheduler {address}: no Dask scheduler answers there")
    assert err.count("\n") == 1


def test_ctrl_c_stops_the_runs_on_the_workers_and_keeps_what_had_ended(
    cluster: Cluster, own_case: Path, store: Store
) -> None:
    program = Program.start(
        COMMAND_LINE, own_case, "--solver", "toy", "--set", "toy.behaviour=hang", "--solver", "toy-noisy",
        "--scheduler", cluster.file, "--store", store.folder, "--threads", "1",
    )  # fmt: skip
    until(lambda: store.read().records and cluster.runs())
    program.interrupt()
    code, _, err = program.end()
    assert code == 130
    # The scheduler's own client may complain of what it could not release before; ours is the last word.
    assert err.endswith("shellbench: interrupted: what had ended is kept, and the same command goes on from there\n")
    until(lambda: not cluster.runs())
    assert [record.identity.solver for record in store.read().records] == ["toy-noisy"]
    assert list(store.folder.glob(".*.partial")) == []


@pytest.fixture
def lone_scheduler(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler without workers."""
    cluster = Cluster(tmp_path / "lone")
    try:
        yield cluster.start(workers=0)
    finally:
        cluster.stop()


@pytest.mark.long
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_it_waits_for_workers_and_keeps_what_had_ended_when_the_scheduler_dies(
    lone_scheduler: Cluster, own_case: Path, store: Store, end: signal.Signals
) -> None:
    address = lone_scheduler.address
    program = Program.start(
        COMMAND_LINE, own_case, "--solver", "toy-noisy", "--solver", "toy", "--set", "toy.behaviour=hang",
        "--scheduler", address, "--store", store.folder,
    )  # fmt: skip
    assert program.process.stderr is not None
    waits = program.process.stderr.readline()
    assert waits == f"shellbench: no worker is connected to {address}: waiting for one\n"
    lone_scheduler.ensure(1)
    until(lambda: store.read().records and lone_scheduler.runs())
    assert lone_scheduler.scheduler is not None
    lone_scheduler.scheduler.send_signal(end)
    code, out, err = program.end()
    assert code == 1
    assert out.splitlines() == [line for line in out.splitlines() if line.startswith("ok own_strip toy-noisy seed 0 ")]
    assert err == (
        f"shellbench: the scheduler {address} is gone: what had ended is kept, and the same command goes on from there\n"
    )
    assert [record.identity.solver for record in store.read().records] == ["toy-noisy"]
    assert list(store.folder.glob(".*.partial")) == []
    until(lambda: not lone_scheduler.runs())
