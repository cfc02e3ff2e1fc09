"""A real Dask cluster on this machine: a scheduler and workers, each a program of its own."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from tests.bench.conftest import PLUGIN
from tests.patience import GUARD, until

SERVER = "shellbench.bench.run.server"


@dataclass
class Cluster:
    """A scheduler and its workers, which know the toy plug-in.

    Attributes
    ----------
    file
        The scheduler file.
    """

    folder: Path
    plugin: Path = PLUGIN
    scheduler: subprocess.Popen[bytes] | None = None
    nannies: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def file(self) -> Path:
        return self.folder / "scheduler.json"

    @property
    def address(self) -> str:
        return str(json.loads(self.file.read_text(encoding="utf-8"))["address"])

    def start(self, workers: int = 2) -> Cluster:
        self.folder.mkdir(parents=True, exist_ok=True)
        listen = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
        self.scheduler = self._program("dask_scheduler", *listen, "--scheduler-file", str(self.file))
        until(
            lambda: self.file.is_file() and self.file.read_text(encoding="utf-8").endswith("}")
        )  # it is written whole
        self.ensure(workers)
        return self

    def ensure(self, workers: int) -> None:
        """Start workers until there are so many again, and wait for them."""
        self.nannies = [nanny for nanny in self.nannies if nanny.poll() is None]
        while len(self.nannies) < workers:
            self.add_worker()
        until(lambda: len(self.workers()) >= workers)

    def add_worker(self, *more: str) -> subprocess.Popen[bytes]:
        nanny = self._program(
            "dask_worker", "--scheduler-file", str(self.file), "--host", "127.0.0.1", "--nthreads", "1",
            "--no-dashboard", "--death-timeout", f"{GUARD:g}", "--local-directory", str(self.folder), *more,
        )  # fmt: skip
        self.nannies.append(nanny)
        return nanny

    def workers(self) -> dict[str, int]:
        """Threads of each worker by its address, as the scheduler says."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return dict(client.nthreads())

    def runs(self) -> list[psutil.Process]:
        """Processes of runs that go on: children of fork servers, which are children of their keepers."""
        return [p for nanny in self.nannies for p in descendants(nanny.pid) if is_run(p)]

    def kill_worker_of_a_run(self) -> None:
        """Kill a worker that has a run, and its nanny, by SIGKILL."""
        for nanny in self.nannies:
            family = descendants(nanny.pid)
            if any(map(is_run, family)):
                nanny.kill()
                for process in family:
                    if SERVER not in command(process):
                        with contextlib.suppress(psutil.NoSuchProcess):
                            process.kill()
                nanny.wait()
                return
        raise AssertionError("no worker has a run")

    def stop(self) -> None:
        programs = [p for p in (*self.nannies, self.scheduler) if p is not None]
        families = [process for program in programs for process in descendants(program.pid)]
        for program in programs:
            program.kill()
        for process in families:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        for program in programs:
            program.wait()

    def _program(self, module: str, *arguments: str) -> subprocess.Popen[bytes]:
        root = Path(__file__).parents[3]
        path = os.pathsep.join([str(self.plugin), str(root)])
        with (self.folder / "dask.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**os.environ, "PYTHONPATH": path},
                start_new_session=True,
            )


def descendants(pid: int) -> list[psutil.Process]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return list(psutil.Process(pid).children(recursive=True))
    return []


def is_run(process: psutil.Process) -> bool:
    with contextlib.suppress(psutil.Error):
        parents = process.parents()[:2]
        return len(parents) == 2 and all(SERVER in command(one) for one in (process, *parents))
    return False


def command(process: psutil.Process) -> str:
    with contextlib.suppress(psutil.Error):
        return " ".join(process.cmdline())
    return ""
