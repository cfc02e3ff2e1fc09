"""The solver under examination, seen from outside: a process that may crash or hang at the cost of one check."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.bench.process import SolverProcess, is_overdue, worked
from shellbench.bench.registry import SolverEntry
from shellbench.bench.task import case_data
from shellbench.problem import Problem

Array = NDArray[np.float64]
LOOK = 0.5  # seconds between two looks at a process that is given more time, as others keep it from computing


class NoAnswer(Exception):
    """What a solver did instead of answering, in one clause; a check that meets it unprepared has failed."""


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
    """Return the result of what a solver was asked for, or raise the `NoAnswer` that it was."""
    if kind == "ok":
        return result
    trouble, prefix = KINDS[kind]
    raise trouble(f"{operation} {prefix}{result}")


class Respondent(Protocol):
    """Who answers for a solver; see `Subject`."""

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        ...

    def call(self, operation: str, *arguments: Any) -> Any:
        """Have it do something."""
        ...

    def stop(self) -> None:
        """End it."""
        ...


@dataclass
class Subject:
    """A solver in a process of its own.

    Attributes
    ----------
    seconds
        Longest time that it may take for one answer (`shellbench.bench.process.is_overdue`).
    """

    solver: SolverProcess
    line: Connection
    seconds: float

    @classmethod
    def start(cls, entry: SolverEntry, seconds: float, threads: int = 1) -> Self:
        """Start the process and import the solver there.

        Raises
        ------
        NoAnswer
            If it can't be imported: `Refused` with the reason, as a rule.
        """
        ours, theirs = socket.socketpair()
        number = theirs.fileno()
        solver = SolverProcess.start(
            "shellbench.testing.child",
            *(str(number), entry.name, entry.target),
            threads=threads,
            stdin=subprocess.DEVNULL,
            pass_fds=[number],
        )
        theirs.close()
        subject = cls(solver, Connection(ours.detach()), seconds)
        try:
            subject._hear("the import")
        except NoAnswer:
            subject.stop()
            raise
        return subject

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self.solver.process.poll() is None and not self.line.closed

    def call(self, operation: str, *arguments: Any) -> Any:
        """Have it do something; see `shellbench.testing.child.Child` for what.

        Raises
        ------
        NoAnswer
            The kind says whether it refused, failed, raised or was lost.
        """
        what = str(arguments[1]) if operation == "ask" else operation
        try:
            self.line.send((operation, arguments))
        except OSError:
            raise Lost(f"{what}: {self._end()}") from None
        return self._hear(what)

    def _hear(self, operation: str) -> Any:
        try:
            if not self._answers_in_time():
                self.stop()
                raise Lost(f"{operation} did not end within {self.seconds:g} s")
            kind, result = self.line.recv()
        except (EOFError, OSError):
            raise Lost(f"{operation}: {self._end()}") from None
        return outcome(operation, kind, result)

    def _answers_in_time(self) -> bool:
        """Wait for an answer as long as it may take."""
        pid, began = self.solver.process.pid, time.monotonic()
        before = worked(pid)
        if self.line.poll(self.seconds):
            return True
        while not is_overdue(self.seconds, time.monotonic() - began, worked(pid) - before):
            if self.line.poll(LOOK):
                return True
        return False

    def _end(self) -> str:
        """Say how the process died."""
        try:
            code = self.solver.process.wait(5)
        except subprocess.TimeoutExpired:
            code = None
        words = self.solver.last_words()[:200]
        self.stop()
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        return f"its process died ({how}{': ' + words if words else ''})"

    def stop(self) -> None:
        """End the process and all that it has started."""
        if not self.line.closed:
            self.solver.end()
            self.line.close()


@dataclass(frozen=True)
class Answer:
    """A solution in the subject's process.

    Attributes
    ----------
    facts
        History, parameters, storage_bytes, uncertainty, and `faults`: what it lacks of the protocol.
    """

    subject: Respondent
    key: str
    case: Any
    facts: Mapping[str, Any]

    def ask(self, method: str, *arguments: Any) -> Any:
        """Call a method of the solution and return whatever it does."""
        return self.subject.call("ask", self.key, method, *arguments)

    def displacement(self, points: ArrayLike) -> Array:
        """Return the displacement (..., 3) at points (..., 2) at the last time or load factor, m."""
        return np.asarray(self.ask("displacement", points), dtype=float)

    def field(self, name: str, points: ArrayLike) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2)."""
        return np.asarray(self.ask("evaluate", name, points), dtype=float)

    def energies(self) -> tuple[float, float]:
        """Return membrane and bending energy, J."""
        membrane, bending = self.ask("energies")
        return float(membrane), float(bending)

    def state(self, at: float) -> dict[str, Array]:
        """Return the state of a rope at a time, its arrays and numbers by name."""
        return dict(self.subject.call("state", self.key, at))

    def values(self) -> Array:
        """Return all quantities of the case, in its order."""
        return np.array(list(self.subject.call("values", self.key).values()))

    def headline(self) -> float:
        """Return the case's headline quantity."""
        return float(self.subject.call("headline", self.key))

    def save(self, path: Path) -> Path:
        """Write the solution; return where it is."""
        return Path(self.subject.call("save", self.key, str(path)))


def solve_in(subject: Respondent, key: str, case: Problem, settings: Mapping[str, Any]) -> Answer:
    """Have a subject solve a case; raises `NoAnswer`."""
    data = {**case_data(case), "name": case.name}
    return Answer(subject, key, case, subject.call("solve", key, data, dict(settings)))


def load_in(subject: Respondent, key: str, case: Problem, path: Path) -> Answer:
    """Have a subject load a saved solution; raises `NoAnswer`."""
    return Answer(subject, key, case, subject.call("load", key, str(path)))
