"""Making runs by an executor, and keeping each in the store as soon as it has ended.

What makes runs: one interface for processes of this machine and for a cluster.

An executor takes tasks and yields what happens to them. It keeps nothing and shows nothing: each run that has ended
comes as a folder of files with its record, and `shellbench.bench.execute` does the rest, the same for all executors.
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from shellbench.bench.planned import note_ended, note_planned
from shellbench.bench.record import Record
from shellbench.bench.store import Store
from shellbench.bench.task import Task
from shellbench.errors import InputError
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


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes
    ----------
    record
        What was kept; None if the input was refused.
    refused
        Why the solver refused its input, in one sentence.
    """

    task: Task
    record: Record | None = None
    refused: str | None = None


class Observer(Protocol):
    """Who wants to see runs go by."""

    def started(self, task: Task) -> None:
        """Note that a task has started."""
        ...

    def progressed(self, task: Task, progress: Progress) -> None:
        """Note how far a task is."""
        ...

    def ended(self, outcome: Outcome) -> None:
        """Note that a task has ended, and how."""
        ...


def execute(tasks: Sequence[Task], store: Store, observer: Observer, executor: Executor) -> list[Outcome]:
    """Make runs, and keep each in the store as soon as it has ended; until then the store says that it is planned.

    Parameters
    ----------
    tasks
        In the order in which to start them.

    Returns
    -------
    list of Outcome
        In the order in which they ended.

    Raises
    ------
    StoreError
        If the store can't be written; runs that had ended are kept.
    ShellbenchError
        If the executor can make no more runs; runs that had ended are kept.
    KeyboardInterrupt
        Passed on after all runs have been stopped; runs that had ended are kept.
    """
    outcomes: list[Outcome] = []
    if not tasks:
        return outcomes
    with store.at_work():
        note_planned(tasks, store)
        try:
            with contextlib.closing(executor.run(tasks, store)) as events:
                for event in events:
                    match event:
                        case Started(task):
                            observer.started(task)
                        case Progressed(task, progress):
                            observer.progressed(task, progress)
                        case Ended():
                            outcomes.append(kept(event, store))
                            note_ended(event.task, store)
                            observer.ended(outcomes[-1])
        except InputError:  # what can't be begun at all is bad input, and no plan
            for task in tasks:
                note_ended(task, store)
            raise
    return outcomes


def kept(ended: Ended, store: Store) -> Outcome:
    """Move what a run has left into the store, or drop it if its input was refused."""
    if ended.record is None:
        store.discard(ended.folder)
        return Outcome(ended.task, refused=ended.refused)
    return Outcome(ended.task, store.commit(ended.folder, ended.record))
