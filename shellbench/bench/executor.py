"""What makes runs: one interface for processes of this machine and for a cluster.

An executor takes tasks and yields what happens to them. It keeps nothing and shows nothing: each run that has ended
comes as a folder of files with its record, and `shellbench.bench.execute` does the rest, the same for all executors.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from shellbench.bench.record import Record
from shellbench.bench.store import Store
from shellbench.bench.task import Task
from shellbench.problem import Progress


@dataclass(frozen=True)
class Started:
    """A run has started."""

    task: Task


@dataclass(frozen=True)
class Progressed:
    """A run has come so far."""

    task: Task
    progress: Progress


@dataclass(frozen=True)
class Ended:
    """A run has ended.

    Attributes
    ----------
    folder
        Folder of the store in which it worked, with the files that its record names and its log.
    record
        What is to be kept; None if its input was refused.
    refused
        Why its input was refused, in one sentence.
    """

    task: Task
    folder: Path
    record: Record | None = None
    refused: str | None = None


Event = Started | Progressed | Ended


class Executor(Protocol):
    """Makes runs."""

    def expect(self, task: Task) -> None:
        """Get ready for runs of the solver of a task, without waiting."""
        ...

    def close(self) -> None:
        """End what was made ready and is not needed."""
        ...

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        """Make runs, in the order of `tasks` as far as it goes, each in a folder that the store begins.

        Closing the generator stops the runs that go on, and leaves nothing of them.

        Raises
        ------
        ShellbenchError
            In one sentence, if no more runs can be made.
        """
        ...
