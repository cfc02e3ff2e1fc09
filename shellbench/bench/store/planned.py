"""Planned runs: the store has a small file for each run, from before the first solve until the run has ended.

A killed run leaves its file. Tables, reports and gates can therefore report a planned run that did not end. A file that
is older than an answer to the same question is ignored.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from shellbench.bench.store.current import question
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.disk import said_plainly
from shellbench.errors import InputError
from shellbench.files import read_file

FOLDER = ".planned"
LARGEST_FILE = 2_000_000  # bytes
DID_NOT_END = "planned, but did not end: run it again, or name fewer cases"


@dataclass(frozen=True)
class PlannedRuns:
    """Runs that were planned in a store.

    Attributes
    ----------
    tasks
        Tasks of the runs whose end was not noted, oldest first, one for each question.
    damaged
        One sentence for each file that can't be read.
    """

    tasks: tuple[Task, ...] = ()
    damaged: tuple[str, ...] = ()


def note_planned(tasks: Sequence[Task], store: Store) -> None:
    """Note that runs are planned; older notes of the same questions are dropped.

    Raises
    ------
    StoreError
        If the store can't be written.
    """
    folder = store.folder / FOLDER
    asked = {question(task) for task in tasks}
    for old in read_planned(store).tasks:
        if question(old) in asked:
            note_ended(old, store)
    with said_plainly(store.folder):
        folder.mkdir(parents=True, exist_ok=True)
        for task in tasks:
            partial = folder / f".{task.run_id}.partial"
            partial.write_text(task.model_dump_json(), encoding="utf-8")
            partial.replace(folder / f"{task.run_id}.json")


def note_ended(task: Task, store: Store) -> None:
    """Note that a run has ended, with any status."""
    folder = store.folder / FOLDER
    with contextlib.suppress(OSError):
        (folder / f"{task.run_id}.json").unlink(missing_ok=True)
        folder.rmdir()  # if it was the last file


def planned_files(store: Store) -> list[Path]:
    """Return the files of planned runs in a store."""
    return sorted((store.folder / FOLDER).glob("[!.]*.json"))


def read_planned(store: Store) -> PlannedRuns:
    """Read the planned runs of a store that were not noted as ended."""
    found: dict[str, Task] = {}
    damaged: list[str] = []
    for path in planned_files(store):
        try:
            task = Task.model_validate_json(read_file(path, LARGEST_FILE))
        except (InputError, ValidationError):
            damaged.append(f"{path}: says of no run that it was planned; remove it")
            continue
        found[question(task)] = task
    return PlannedRuns(tuple(sorted(found.values(), key=lambda task: (task.created, task.run_id))), tuple(damaged))


def not_ended(planned: PlannedRuns, answered: Iterable[Task | Record]) -> tuple[Task, ...]:
    """Return the planned runs without a valid record."""
    known = {question(run) for run in answered}
    return tuple(task for task in planned.tasks if question(task) not in known)
