"""Frozen tables and verdicts of an archive of records, to recognise a change that only moves code.

The archive is the records of the published training, or the store in SHELLBENCH_ARCHIVE. Its records count whatever
the source is today: their digests are pinned. `python -m tests.bench.frozen` writes the outputs again: beside this file
for the published ones, and into the archive otherwise.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from shellbench.bench.judge.compare import as_json, rows_and_notes
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import gate
from shellbench.bench.judge.verdicts import as_text
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.store import current
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from shellbench.report.sections.tables import render

PUBLISHED = Path(__file__).parents[2] / "reports/published"
ARCHIVE = Path(os.environ.get("SHELLBENCH_ARCHIVE", PUBLISHED))
FOLDER = Path(__file__).with_name("frozen") if ARCHIVE == PUBLISHED else ARCHIVE / ".frozen"


@contextmanager
def pinned(store: Store) -> Iterator[None]:
    """Let the records of a store count, whatever their solvers' source is today."""
    sources = {record.identity.solver: record.identity.source for record in store.read().records}

    def source(entry: SolverEntry, kind: str = "") -> str:
        return sources.get(entry.name, "")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(current, "current_source", source)
        yield


def outputs() -> dict[str, str]:
    """Return the outputs for the archive, by name of file."""
    store = Store(ARCHIVE)
    with pinned(store):
        rows = rows_and_notes(store)[0]
        try:
            judged = as_text(gate(store, None, Scope()), "none", verbose=True)
        except InputError as error:  # an archive of which nothing is gated
            judged = str(error)
        return {
            "table.json": as_json(rows) + "\n",
            "gate.txt": judged + "\n",
            **{f"table.{name}": render(rows, name) for name in ("text", "markdown", "latex", "csv")},
        }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in outputs().items():
        (FOLDER / name).write_text(text, encoding="utf-8", newline="\n")
