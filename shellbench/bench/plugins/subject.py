"""Code of others in a process of its own, which may crash, hang or return invalid data at the cost of one answer."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import time
from dataclasses import dataclass
from typing import Any, Protocol, Self

import psutil

from shellbench.bench.plugins.line import LOOK, Line, Look
from shellbench.bench.plugins.process import SolverProcess, cpu_time, is_overdue

GIGABYTE = 1e9


class NoAnswer(Exception):
    """Raised with one clause if a solver gives no answer; an uncaught one fails the check."""


class Refused(NoAnswer):
    """It raised InputError."""


class SolveFailed(NoAnswer):
    """It raised SolveFailure."""


class UnknownName(NoAnswer):
    """It raised KeyError."""


class Raised(NoAnswer):
    """It raised something else."""


class Lost(NoAnswer):
    """Its process died, or did not answer in time."""


KINDS: dict[str, tuple[type[NoAnswer], str]] = {
    "refused": (Refused, "refused: "),
    "failed": (SolveFailed, "failed: "),
    "unknown": (UnknownName, "raised "),
    "raised": (Raised, "raised "),
}


def outcome(operation: str, kind: str, result: Any) -> Any:
    """Return the result of a request to a solver, or raise its `NoAnswer`."""
    if kind == "ok":
        return result
    trouble, prefix = KINDS[kind]
    raise trouble(f"{operation} {prefix}{result}")


class Respondent(Protocol):
    """Interface of a solver's process; see `Subject`."""

    @property
    def alive(self) -> bool:
        """True if the solver still accepts questions."""
        ...

    def call(self, operation: str, *arguments: Any) -> Any:
        """Have it do something."""
        ...

    def stop(self) -> None:
        """End it."""
        ...


@dataclass
class Subject:
    """A process that answers (`shellbench.bench.plugins.inside.serve`).

    Attributes
    ----------
    seconds
        Longest time for one answer (`shellbench.bench.plugins.process.is_overdue`).
    memory
        Largest memory during an answer, bytes; None for no limit.
    greeting
        Its message when it was ready.
    """

    process: SolverProcess
    line: Line
    seconds: float
    memory: float | None = None
    greeting: Any = None
    asked: int = 0

    @classmethod
    def start(cls, module: str, *arguments: str, seconds: float, memory: float | None = None, threads: int = 1) -> Self:
        """Start a module whose first argument is the descriptor of its end of a line, and wait for its imports.

        Raises
        ------
        NoAnswer
            If an import fails: usually `Refused` with the reason.
        """
        ours, theirs = socket.socketpair()
        number = theirs.fileno()
        process = SolverProcess.start(
            module, str(number), *arguments, threads=threads, stdin=subprocess.DEVNULL, pass_fds=(number,)
        )
        theirs.close()
        subject = cls(process, Line(ours), seconds, memory)
        try:
            subject.greeting = subject._hear("the import", subject._look("the import"))
        except NoAnswer:
            subject.stop()
            raise
        return subject

    @property
    def alive(self) -> bool:
        """True if the solver still accepts questions."""
        return self.process.process.poll() is None and not self.line.closed

    def call(self, operation: str, *arguments: Any) -> Any:
        """Have it do something; its module says what it can do.

        Raises
        ------
        NoAnswer
            The class tells if it refused, failed, raised another error or was lost.
        """
        what = str(arguments[1]) if operation == "ask" else operation
        look = self._look(what)
        self.asked += 1
        try:
            self.line.send((self.asked, operation, arguments), look)
        except OSError:
            raise Lost(f"{what}: {self._end()}") from None
        return self._hear(what, look)

    def _hear(self, operation: str, look: Look) -> Any:
        try:
            match self.line.receive(look):
                case [self.asked, str() as kind, result] if kind == "ok" or (kind in KINDS and isinstance(result, str)):
                    return outcome(operation, kind, result)
        except (EOFError, OSError):
            raise Lost(f"{operation}: {self._end()}") from None
        except ValueError:  # no message, then
            pass
        self.stop()
        raise Lost(f"{operation}: it wrote something else than its answer to where answers go")

    def _look(self, operation: str) -> Look:
        """Return a check of the process that ends it and raises `Lost` once it exceeds its time or memory."""
        pid, began = self.process.process.pid, time.monotonic()
        before, looked = cpu_time(pid), began

        def look() -> None:
            nonlocal looked
            if time.monotonic() - looked < LOOK:
                return
            looked = time.monotonic()
            if self.memory is not None and memory_of(pid) > self.memory:
                self.stop()
                raise Lost(f"{operation} took more than {self.memory / GIGABYTE:.3g} GB of memory")
            waited = time.monotonic() - began
            if waited >= self.seconds and is_overdue(self.seconds, waited, cpu_time(pid) - before):
                self.stop()
                raise Lost(f"{operation} did not end within {self.seconds:g} s")

        return look

    def _end(self) -> str:
        """Describe the end of the process."""
        try:
            code = self.process.process.wait(5)
        except subprocess.TimeoutExpired:
            self.stop()
            return "it closed the line on which answers go"
        words = self.process.last_words()[:200]
        self.stop()
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"its process died ({how}{': ' + words if words else ''})"

    def stop(self) -> None:
        """End the process and all processes that it has started."""
        if not self.line.closed:
            self.process.end()
            self.line.close()


def memory_of(pid: int) -> float:
    """Return the resident memory of a process and its children, bytes."""
    total = 0.0
    with contextlib.suppress(psutil.Error):
        for process in (top := psutil.Process(pid), *top.children(recursive=True)):
            with contextlib.suppress(psutil.Error):
                total += process.memory_info().rss
    return total
