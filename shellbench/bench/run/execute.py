"""Making runs by an executor, and keeping each in the store as soon as it has ended.

What makes runs: one interface for processes of this machine and for a cluster.

An executor takes tasks and yields what happens to them. It keeps nothing and shows nothing: each run that has ended
comes as a folder of files with its record, and `shellbench.bench.run.execute` does the rest, the same for all
executors.
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

LOOK = 0.2  # seconds between two looks at what other commands do


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


def execute(
    tasks: Sequence[Task],
    store: Store,
    observer: Observer,
    executor: Executor,
    seen: int | None = None,
    say: Say = silent,
) -> list[Outcome]:
    """Make runs, and keep each in the store as soon as it has ended; until then the store says that it is planned.

    Parameters
    ----------
    tasks
        In the order in which to start them.
    seen
        Number of the newest record that was known when the runs were planned. Runs that other commands make at the same
        time are waited for, and their records taken. None: all runs are made here.
    say
        Takes a sentence about what is waited for.

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
    """Make runs that nobody else makes."""
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
                        outcome = kept(event, store)
                        note_ended(event.task, store)
                        yield outcome
    except InputError:  # what can't be begun at all is bad input, and no plan
        for task in tasks:
            note_ended(task, store)
        raise


def kept(ended: Ended, store: Store) -> Outcome:
    """Move what a run has left into the store, or drop it if its input was refused."""
    if ended.record is None:
        store.discard(ended.folder)
        return Outcome(ended.task, refused=ended.refused)
    return Outcome(ended.task, store.commit(ended.folder, ended.record))
