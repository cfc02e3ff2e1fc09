"""The earlier solution that a run continues: found in the store by the name of its run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from shellbench.bench.store.store import Contents, Store
from shellbench.errors import InputError

START = "start"  # among the settings of an identity: runs from different starts are different runs


@dataclass(frozen=True)
class Earlier:
    """An earlier run: its name, its solver's name, and the file of its solution."""

    run_id: str
    solver: str
    file: Path


def find_earlier(run_id: str, store: Store, contents: Contents) -> Earlier:
    """Return an earlier run by its name; InputError in one sentence if it is not there, or has no intact solution."""
    record = next((record for record in contents.records if record.run_id == run_id), None)
    if record is None:
        raise InputError(f"--start {run_id}: no run in {store.folder} has this name; `table --format json` names them")
    file = None if record.solution_file is None else store.file(record.solution_file)
    if record.solution_file is None or file is None or not Path(file).is_file():
        raise InputError(f"--start {run_id}: this run left no solution")
    if damage := store.check(record, record.solution_file):
        raise InputError(f"--start {run_id}: {damage}")
    return Earlier(run_id, record.identity.solver, Path(file).resolve())
