"""Processes in which solvers live, and the other end of a fork server: start it, give it tasks, hear what it says."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import psutil

THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
READ = 65536  # bytes at once
COMPUTES = 0.05  # share of one processor from which a process counts as computing, and not as waiting for something
# What the C library (glibc; others ignore it) keeps of memory that is freed, bytes: arrays come and go, and a tenth of
# a large solve would pass in having the same pages cleared again. The most memory that is in use stays what it is.
KEPT_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(256 << 20)}
PATIENCE = 15.0  # seconds in which a keeper ends its program, before it is killed itself
STARTING = 120.0  # seconds in which a server has imported its solver
MOST_KEPT = 65536  # bytes of what a process wrote, in which its last line is looked for
LONGEST_EVENT = 65536  # bytes
MOST_WAITED = 20.0  # times the limit by the clock, that a process may compute for on the busiest machine


def worked(pid: int | None) -> float:
    """Return the seconds of processor time that a process and its children have had; 0 of one that is no more."""
    total = 0.0
    with contextlib.suppress(psutil.Error):
        if pid is not None:
            process = psutil.Process(pid)
            total = sum(process.cpu_times()[:4])  # user and system, its own and that of children that have ended
            for child in process.children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    total += sum(child.cpu_times()[:4])
    return total


def is_overdue(limit: float, waited: float, had: float) -> bool:
    """Return True if a process has used up its time, in seconds: limit, wall time and processor time.

    The load of a machine must not decide which process is stopped. A computing process therefore has its limit in
    processor time. A hanging process uses no processor time, so its limit is in wall time.
    """
    if waited < limit:
        return False
    return had >= limit or had < COMPUTES * waited or waited >= MOST_WAITED * limit


@dataclass
class SolverProcess:
    """A program of ours in a Python of its own, which an interrupt from the terminal does not reach.

    Its process is that of the program's keeper (`shellbench.bench.plugins.keeper`), which lives no longer than
    `lifeline`.
    """

    process: subprocess.Popen[bytes]
    errors: IO[bytes]
    lifeline: int

    @classmethod
    def start(cls, module: str, *arguments: str, threads: int, **streams: Any) -> SolverProcess:
        """Start a module with arguments; what it writes is kept, but for `streams`, those of `subprocess.Popen`."""
        limits = dict.fromkeys(THREAD_LIMITS, str(threads))
        waiting = {"OMP_WAIT_POLICY": "passive"}  # threads that spin would slow the runs beside them
        path = os.pathsep.join(p or os.curdir for p in sys.path)
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        held, lifeline = os.pipe()
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "shellbench.bench.plugins.keeper", str(held), module, *arguments],
                stdout=streams.pop("stdout", errors),
                stderr=errors,
                env={**KEPT_MEMORY, **os.environ, **limits, **waiting, "PYTHONPATH": path},
                start_new_session=True,  # an interrupt from the terminal is for us; we end it ourselves
                pass_fds=(held, *streams.pop("pass_fds", ())),
                **streams,
            )
        finally:
            os.close(held)
        return cls(process, errors, lifeline)

    def end(self) -> None:
        """Kill it and all that it has started."""
        if self.lifeline >= 0:
            os.close(self.lifeline)
            self.lifeline = -1
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:  # somebody has stopped the keeper
            self.process.kill()
            self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.errors):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()

    def last_words(self) -> str:
        """Return the last line that it wrote to standard error."""
        with contextlib.suppress(OSError, ValueError):
            self.errors.seek(max(0, self.errors.seek(0, os.SEEK_END) - MOST_KEPT))
            lines = self.errors.read().decode(errors="replace").strip().splitlines()
            return lines[-1].strip() if lines else ""
        return ""


GARBLED = {"event": "garbled"}


def event_of(line: bytes) -> dict[str, Any]:
    """Return an event of a server (see `shellbench.bench.run.server`), or `GARBLED`."""
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        return GARBLED
    match event:
        case (
            {"event": "ready"}
            | {"event": "started", "pid": int()}
            | {"event": "progress", "step": int(), "total": int() | None, "message": str()}
            | {"event": "ended", "status": int()}
        ):
            found: dict[str, Any] = event
            return found
    return GARBLED


@dataclass
class ServerProcess:
    """A running fork server of one solver.

    Attributes
    ----------
    solver
        Name of the solver.
    run_pid
        Process of the run that goes on; None between runs.
    ready
        Whether it has imported its solver.
    hung
        Whether it was ended, as it did not do so in time, or talked nonsense meanwhile.
    """

    solver: str
    server: SolverProcess
    run_pid: int | None = None
    ready: bool = False
    hung: bool = False
    _unread: bytes = field(default=b"", repr=False)

    @classmethod
    def start(cls, solver: str, target: str, threads: int) -> ServerProcess:
        """Start a server whose runs have so many threads; it needs a moment until it says ``ready``."""
        streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        server = SolverProcess.start("shellbench.bench.run.server", target, threads=threads, **streams)
        assert server.process.stdout is not None
        os.set_blocking(server.process.stdout.fileno(), False)
        return cls(solver, server)

    @property
    def process(self) -> subprocess.Popen[bytes]:
        """The process of the server."""
        return self.server.process

    def fileno(self) -> int:
        """Return the file descriptor to select on."""
        assert self.process.stdout is not None
        return self.process.stdout.fileno()

    def give(self, folder: Path) -> bool:
        """Have the task of a folder done; False if the server has died."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(str(folder.resolve())).encode() + b"\n")
            self.process.stdin.flush()
        except (OSError, ValueError):  # ValueError: it was ended
            return False
        return True

    def hear(self) -> list[dict[str, Any]]:
        """Return the events that have come in; one ``{"event": "died"}`` if the server is no more.

        The run that goes on has the stream, too. Where it wrote anything else to it, the last event is "garbled": after
        that nothing that the server says can be told from what the run does.
        """
        try:
            chunk = os.read(self.fileno(), READ)
        except BlockingIOError:
            return []
        *lines, self._unread = (self._unread + chunk).split(b"\n")
        events = [event_of(line) for line in lines]
        if len(self._unread) > LONGEST_EVENT:
            events.append(GARBLED)
        if GARBLED in events:
            return events[: events.index(GARBLED) + 1]
        for event in events:
            if event["event"] == "started":
                self.run_pid = event["pid"]
            elif event["event"] == "ended":
                self.run_pid = None
            self.ready = self.ready or event["event"] == "ready"
        return events if chunk else [*events, {"event": "died"}]

    def worked(self) -> float:
        """Return the seconds of processor time of the run that goes on."""
        return worked(self.run_pid)

    def kill_run(self) -> None:
        """Kill the run that goes on, and all that it started; the server says ``ended``."""
        if self.run_pid is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.run_pid, signal.SIGKILL)

    def end(self) -> None:
        """Kill the run, if there is one, and the server."""
        self.kill_run()
        self.server.end()

    def last_words(self) -> str:
        """Return the last line that the server wrote to standard error."""
        return self.server.last_words()
