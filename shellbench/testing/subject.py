"""The checked solver in a process of its own, with its solutions there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.plugins.subject import Respondent, Subject
from shellbench.bench.store.task import case_data
from shellbench.problem import Problem

Array = NDArray[np.float64]


def subject_of(entry: SolverEntry, seconds: float) -> Subject:
    """Start the process of a solver (`shellbench.testing.child`), with a limit for one answer.

    Raises
    ------
    NoAnswer
        If it can't be imported: usually `Refused` with the reason.
    """
    return Subject.start("shellbench.testing.child", entry.name, entry.target, seconds=seconds)


@dataclass(frozen=True)
class RemoteSolution:
    """A solution in the subject's process.

    Attributes
    ----------
    facts
        History, parameters, storage_bytes, uncertainty, and `faults`: its deviations from the protocol.
    """

    subject: Respondent
    key: str
    case: Any
    facts: Mapping[str, Any]

    def ask(self, method: str, *arguments: Any) -> Any:
        """Call a method of the solution and return its result."""
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
        """Write the solution; return its path."""
        return Path(self.subject.call("save", self.key, str(path)))


def solve_in(subject: Respondent, key: str, case: Problem, settings: Mapping[str, Any]) -> RemoteSolution:
    """Let a subject solve a case; raises `NoAnswer`."""
    data = {**case_data(case), "name": case.name}
    return RemoteSolution(subject, key, case, subject.call("solve", key, data, dict(settings)))


def load_in(subject: Respondent, key: str, case: Problem, path: Path) -> RemoteSolution:
    """Let a subject load a saved solution; raises `NoAnswer`."""
    return RemoteSolution(subject, key, case, subject.call("load", key, str(path)))
