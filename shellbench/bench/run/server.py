"""The fork server of one solver: imports it once, then forks a new process for each run.

A run therefore starts in milliseconds, and a crash costs that run only. The memory of a run is its own and that of its
solver; a server with all solvers would count the memory of all. The server is a program of its own, started with the
thread limits in its environment. It reads the folders of tasks from standard input, one a line, and runs one at a time.
It writes events to standard output, one JSON object a line:

    {"event": "ready"}
    {"event": "started", "pid": 123}
    {"event": "progress", "step": 3, "total": 20, "message": "..."}
    {"event": "ended", "status": 0}          exit status, or minus the number of the signal

When standard input ends, for instance because the parent was killed, the run is killed too.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import threading
import traceback
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from shellbench.bench.plugins.keeper import adopt, descendants, end_descendants
from shellbench.bench.plugins.kinds import DEFAULT, find_kind, load_here, module_of
from shellbench.bench.plugins.source import import_closure, source_digest
from shellbench.bench.run import worker
from shellbench.bench.store.identity import MEASURING
from shellbench.bench.store.store import LOG
from shellbench.problem import Progress

LINE = 300  # characters of a message; a line up to PIPE_BUF (512 bytes at least, 4096 mostly) is written in one piece
LOOK = 0.5  # seconds between two checks if a run has ended and left processes behind


def main(target: str) -> None:
    """Serve runs of one solver, ``module:attribute``, until standard input ends."""
    events = os.dup(1)
    os.dup2(2, 1)  # output of an import is no event
    load_here()
    adopt()  # orphans of runs become children of the server
    warnings.filterwarnings("ignore", message=".*multi-threaded, use of fork.*", category=DeprecationWarning)
    module = target.partition(":")[0]
    with contextlib.suppress(Exception):  # the run will report the error
        import_module(module)
        find_kind(DEFAULT)
        source_digest([module, module_of(DEFAULT), MEASURING])  # cached: each run checks if it has changed
    import_what_solves(module)
    say(events, event="ready")
    waiting = b""
    while chunk := os.read(0, 65536):
        *lines, waiting = (waiting + chunk).split(b"\n")
        for line in lines:
            serve(Path(json.loads(line)), events)


def import_what_solves(module: str) -> None:
    """Import the modules that a built-in solver imports when it is called, so that no run waits for them."""
    if module.partition(".")[0] == "shellbench":  # a plug-in may have a reason for late imports
        for name in import_closure(module):
            with contextlib.suppress(Exception):
                import_module(name)


def say(events: int, **event: Any) -> None:
    """Write one event; ignore a closed stream."""
    with contextlib.suppress(OSError):
        os.write(events, json.dumps(event).encode() + b"\n")


def serve(folder: Path, events: int) -> None:
    """Fork a process for one run, and wait for its end or for the end of standard input."""
    spared = descendants()  # what an import has started
    alive, held = os.pipe()
    serving, ours = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.setsid()  # so that the run and all that it starts can be killed at once
        os.close(alive)
        os.close(ours)
        end_with(serving)
        child(folder, events)
    os.close(held)  # now only the child holds it: it reads as ended when the child has
    os.close(serving)
    say(events, event="started", pid=pid)
    ended = 0
    while not ended:
        ready, _, _ = select.select([alive, 0], [], [], LOOK)
        if 0 in ready:  # no task is sent during a run: standard input has ended
            kill(pid)
        ended, status = os.waitpid(pid, 0 if ready else os.WNOHANG)
    os.close(alive)
    os.close(ours)
    kill(pid)  # remaining processes of the run, in its session
    end_descendants(spared)  # or in others
    say(events, event="ended", status=os.waitstatus_to_exitcode(status))


def kill(group: int) -> None:
    """Kill a run and all that it started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def end_with(server: int) -> None:
    """Kill this run and all its processes as soon as the server has died, which closes its end of a pipe."""

    def wait() -> None:
        os.read(server, 1)
        os.killpg(0, signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()


def child(folder: Path, events: int) -> NoReturn:
    """Make the run of a folder in this process, and exit."""
    status = 1
    try:
        nothing = os.open(os.devnull, os.O_RDONLY)
        log = os.open(folder / LOG, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        os.dup2(nothing, 0)
        os.dup2(log, 1)
        os.dup2(log, 2)

        def tell(progress: Progress) -> None:
            say(
                events,
                event="progress",
                step=int(progress.step),
                total=None if progress.total is None else int(progress.total),
                message=progress.message[:LINE],
            )

        worker.work(folder, tell)
        status = 0
    except BaseException:
        with contextlib.suppress(BaseException):
            traceback.print_exc()
    finally:
        with contextlib.suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    main(sys.argv[1])
