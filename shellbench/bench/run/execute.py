"""Runs by an executor: each is stored as soon as it has ended.

Executors have one interface, for processes of this machine and for a cluster. An executor takes tasks and yields their
events. It stores and shows nothing: each ended run is a folder of files with its record, and this module does the rest
for all executors.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from shellbench.bench.store.claims import Claims
from shellbench.bench.store.current import newest, run_key
from shellbench.bench.store.planned import note_ended, note_planned
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Say, Store, silent
from shellbench.bench.store.task import Task
from shellbench.errors import InputError
from shellbench.problem import Progress

LOOK = 0.2  # seconds between two checks of other commands' runs


@dataclass(frozen=True)
class Started:
    """A run has started."""

    task: Task


@dataclass(frozen=True)
class Progressed:
    """A run has made progress."""

    task: Task
    progress: Progress


@dataclass(frozen=True)
class Ended:
    """A run has ended.

    Attributes
    ----------
    folder
        Folder of the run in the store, with its log and the files that its record names.
    record
        The record to store; None if its input was refused.
    refused
        Reason why its input was refused, in one sentence.
    """

    task: Task
    folder: Path
    record: Record | None = None
    refused: str | None = None


Event = Started | Progressed | Ended


class Executor(Protocol):
    """Makes runs."""

    def expect(self, task: Task) -> None:
        """Prepare for runs of the solver of a task, without waiting."""
        ...

    def close(self) -> None:
        """End unused preparations."""
        ...

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        """Make runs, if possible in the order of `tasks`, each in a new folder of the store.

        Closing the generator stops the current runs and removes their folders.

        Raises
        ------
        ShellbenchError
            In one sentence, if no more runs can be made.
        """
        ...


@dataclass(frozen=True)
class Outcome:
    """The result of a task.

    Attributes
    ----------
    record
        The record that was stored; None if the input was refused.
    refused
        Reason why the solver refused its input, in one sentence.
    taken
        True if another command has made the run meanwhile.
    """

    task: Task
    record: Record | None = None
    refused: str | None = None
    taken: bool = False


class Observer(Protocol):
    """Interface of a progress display."""

    def started(self, task: Task) -> None:
        """Note that a task has started."""
        ...

    def progressed(self, task: Task, progress: Progress) -> None:
        """Note the progress of a task."""
        ...

    def ended(self, outcome: Outcome) -> None:
        """Note the end of a task."""
        ...


def execute(
    tasks: Sequence[Task],
    store: Store,
    observer: Observer,
    executor: Executor,
    seen: int | None = None,
    say: Say = silent,
) -> list[Outcome]:
    """Make runs, and store each as soon as it has ended; until then the store notes that it is planned.

    Parameters
    ----------
    tasks
        In the order in which to start them.
    seen
        Number of the newest record when the runs were planned. If other commands make some of the runs at the same
        time, this command waits for them and uses their records. None: all runs are made here.
    say
        Receives a sentence about runs of other commands that this command waits for.

    Returns
    -------
    list of Outcome
        In the order in which they ended.

    Raises
    ------
    StoreError
        If the store can't be written; ended runs are kept.
    ShellbenchError
        If the executor can make no more runs; ended runs are kept.
    KeyboardInterrupt
        Raised again after all runs have been stopped; ended runs are kept.
    """
    outcomes: list[Outcome] = []
    if not tasks:
        return outcomes
    with store.at_work(), Claims(store.folder) as claims:
        waiting, said = list(tasks), False
        while waiting:
            claimed = {task.run_id: task for task in waiting if seen is None or claims.take(run_key(task))}
            made = _made_since(seen, store) if seen is not None and claimed else {}
            here: list[Task] = []
            for task in claimed.values():
                if run_key(task) not in made:
                    here.append(task)
                    continue
                outcomes.append(Outcome(task, made[run_key(task)], taken=True))
                claims.drop(run_key(task))
                observer.ended(outcomes[-1])
            with contextlib.closing(_executed(here, store, observer, executor)) as ended:
                for outcome in ended:
                    outcomes.append(outcome)
                    claims.drop(run_key(outcome.task))
                    observer.ended(outcome)
            waiting = [task for task in waiting if task.run_id not in claimed]
            if waiting and not said:
                runs = "1 run is" if len(waiting) == 1 else f"{len(waiting)} runs are"
                say(f"{runs} being made by another command: waiting for the answer")
                said = True
            if waiting and not claimed:
                time.sleep(LOOK)
    return outcomes


def _made_since(seen: int, store: Store) -> dict[str, Record]:
    """Return the newest records of runs with a number larger than `seen`, by the run's key."""
    if store.last_number() <= seen:
        return {}
    return {key: record for key, record in newest(store.read()).items() if (record.sequence or 0) > seen}


def _executed(
    tasks: Sequence[Task], store: Store, observer: Observer, executor: Executor
) -> Generator[Outcome, None, None]:
    """Make runs that no other command makes."""
    if not tasks:
        return
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
                        outcome = store_run(event, store)
                        note_ended(event.task, store)
                        yield outcome
    except InputError:  # a run that can't start at all is bad input, and no plan
        for task in tasks:
            note_ended(task, store)
        raise


def store_run(ended: Ended, store: Store) -> Outcome:
    """Move the files of a run into the store, or remove them if its input was refused."""
    if ended.record is None:
        store.discard(ended.folder)
        return Outcome(ended.task, refused=ended.refused)
    return Outcome(ended.task, store.commit(ended.folder, ended.record))
