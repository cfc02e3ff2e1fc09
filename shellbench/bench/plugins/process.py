"""Processes of solvers, and the client of a fork server: start it, send tasks, receive events."""

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

from shellbench.protocol.program import CALLERS_PATH

THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
READ = 65536  # bytes at once
COMPUTES = 0.05  # share of one processor from which a process counts as computing, and not as waiting for something
# Freed memory that the C library (glibc; others ignore it) keeps, bytes. Arrays are allocated often, and a tenth of
# a large solve would be spent on clearing the same pages again. The peak memory is unchanged.
KEPT_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(256 << 20)}
PATIENCE = 15.0  # seconds in which a keeper ends its program, before it is killed itself
STARTING = 120.0  # seconds in which a server has imported its solver
MOST_KEPT = 65536  # bytes at the end of the output, in which the last line is searched
LONGEST_EVENT = 65536  # bytes
MOST_WAITED = 20.0  # largest wall time of a computing process on a busy machine, as a multiple of the limit


def cpu_time(pid: int | None) -> float:
    """Return the processor time, s, of a process and its children; 0 if it has ended."""
    total = 0.0
    with contextlib.suppress(psutil.Error):
        if pid is not None:
            process = psutil.Process(pid)
            total = sum(process.cpu_times()[:4])  # user and system time, of the process and of its ended children
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
    """A program of shellbench in its own Python process, which an interrupt from the terminal does not reach.

    Its process is that of the program's keeper (`shellbench.bench.plugins.keeper`), which ends with `lifeline`.
    """

    process: subprocess.Popen[bytes]
    errors: IO[bytes]
    lifeline: int

    @classmethod
    def start(cls, module: str, *arguments: str, threads: int, **streams: Any) -> SolverProcess:
        """Start a module with arguments; its output is kept, except for `streams`, as in `subprocess.Popen`."""
        limits = dict.fromkeys(THREAD_LIMITS, str(threads))
        waiting = {"OMP_WAIT_POLICY": "passive"}  # spinning threads would slow other runs
        path = os.pathsep.join(p or os.curdir for p in sys.path)
        callers = {CALLERS_PATH: os.environ.get("PYTHONPATH", "")}  # for programs that a solver calls
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        held, lifeline = os.pipe()
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "shellbench.bench.plugins.keeper", str(held), module, *arguments],
                stdout=streams.pop("stdout", errors),
                stderr=errors,
                env={**KEPT_MEMORY, **callers, **os.environ, **limits, **waiting, "PYTHONPATH": path},
                start_new_session=True,  # only this process gets interrupts from the terminal, and it ends the program
                pass_fds=(held, *streams.pop("pass_fds", ())),
                **streams,
            )
        finally:
            os.close(held)
        return cls(process, errors, lifeline)

    def end(self) -> None:
        """Kill it and all processes that it has started."""
        if self.lifeline >= 0:
            os.close(self.lifeline)
            self.lifeline = -1
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:  # the keeper was stopped
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
        Process of the current run; None between runs.
    ready
        True once it has imported its solver.
    hung
        True if it was killed, because it did not import in time or wrote invalid output.
    """

    solver: str
    server: SolverProcess
    run_pid: int | None = None
    ready: bool = False
    hung: bool = False
    _unread: bytes = field(default=b"", repr=False)

    @classmethod
    def start(cls, solver: str, target: str, threads: int) -> ServerProcess:
        """Start a server whose runs have `threads_each` threads; it sends ``ready`` after its imports."""
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

    def send_task(self, folder: Path) -> bool:
        """Send the task of a folder; return False if the server has died."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(str(folder.resolve())).encode() + b"\n")
            self.process.stdin.flush()
        except (OSError, ValueError):  # ValueError: it was ended
            return False
        return True

    def read_events(self) -> list[dict[str, Any]]:
        """Return the new events; one ``{"event": "died"}`` if the server has ended.

        The current run shares the stream. If the run wrote to it, the last event is "garbled": after that, events of
        the server can't be distinguished from output of the run.
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

    def cpu_time(self) -> float:
        """Return the processor time of the current run, s."""
        return cpu_time(self.run_pid)

    def kill_run(self) -> None:
        """Kill the current run and all processes that it started; the server sends ``ended``."""
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
