"""The parent of a program that runs code of others: it ends with the program and leaves no process behind.

It forks. The child becomes the program, in its own session. Actions of the program on its process group or its parent
therefore do not reach shellbench. The parent is the keeper. Orphans of the program's processes become its children (on
Linux, as a subreaper), in whatever session they are. The keeper kills them all as soon as the program has ended, or the
other end of its lifeline is closed. It exits with the program's status.
"""

from __future__ import annotations

import contextlib
import os
import runpy
import select
import signal
import sys
import time

SUBREAPER, DEATH_SIGNAL = 36, 1  # of prctl
PATIENCE = 10.0  # seconds in which all processes of a tree can be killed, however fast they fork
PAUSE = 0.005  # seconds between two checks of the remaining processes
LOOK = 1.0  # seconds between two checks of a program that may have ended silently
DEAF_TO = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM, signal.SIGPIPE)


def control(option: int, value: int) -> None:
    """Call Linux's prctl; do nothing on other systems."""
    if sys.platform == "linux":
        import ctypes

        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def adopt() -> None:
    """Have orphans among the descendants of this process become its children."""
    control(SUBREAPER, 1)


def descendants() -> set[int]:
    """Return the ids of the processes below this one; quickly, where there are none."""
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return set()
    import psutil

    return {process.pid for process in psutil.Process().children(recursive=True)}


def end_descendants(spared: frozenset[int] | set[int] = frozenset()) -> None:
    """Kill all processes below this one, except `spared`, until there are none."""
    began = time.monotonic()
    while (left := descendants() - spared) and time.monotonic() - began < PATIENCE:
        for number in (signal.SIGSTOP, signal.SIGKILL):  # stopped processes can't fork
            for pid in left:
                with contextlib.suppress(OSError):
                    os.kill(pid, number)
        for pid in left:
            with contextlib.suppress(OSError):  # not yet a child of this process
                os.waitpid(pid, os.WNOHANG)
        time.sleep(PAUSE)


def main() -> None:
    """Run a module, from the third argument on, as a kept program; the second argument is the lifeline's descriptor."""
    lifeline = int(sys.argv[1])
    adopt()
    program = os.fork()
    if program:
        keep(program, lifeline)
    os.close(lifeline)
    os.setsid()
    control(DEATH_SIGNAL, signal.SIGKILL)  # if the keeper is killed
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


def keep(program: int, lifeline: int) -> None:
    """Wait until a program has ended or the lifeline is cut, kill its remaining processes, and exit with its status."""
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    for number in DEAF_TO:
        signal.signal(number, signal.SIG_IGN)
    kept = sorted({lifeline, woken, wake})
    for first, last in zip([-1, *kept], [*kept, os.sysconf("SC_OPEN_MAX")], strict=True):
        os.closerange(first + 1, last)  # the streams belong to the program: their readers detect when it closes them
    status = None
    while True:
        with contextlib.suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                status = ended[1] if ended[0] == program else status
        if status is not None:
            break
        ready, _, _ = select.select([lifeline, woken], [], [], LOOK)
        if lifeline in ready:
            break
        if woken in ready:
            os.read(woken, 4096)
    end_descendants()
    if status is not None and os.WIFSIGNALED(status):
        with contextlib.suppress(ImportError, OSError, ValueError):
            import resource

            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError, ValueError):
            signal.signal(os.WTERMSIG(status), signal.SIG_DFL)
        os.kill(os.getpid(), os.WTERMSIG(status))
    os._exit(1 if status is None else os.waitstatus_to_exitcode(status) & 255)


if __name__ == "__main__":
    main()
