"""The stored records of the published training: compared with today's training, and kept if that is the same.

A training takes ten minutes, and any change of the source would cost eight. `python -m tests.solvers.ndf.kept_trainings` repeats
the first iterations of each record, in the given folders or in both. They depend on loss, samples, weights at the start, Adam and the headline
quantity. If they agree with the record's history, the record is written again with today's source, and with today's
verdict on its certified energy and its course; `trained_by_source` keeps the source of the whole training.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from shellbench.bench.catalogue.catalog import named_case
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Store
from shellbench.problem import Progress, Step
from shellbench.solvers.ndf.published.checkpoint import read_checkpoint
from shellbench.solvers.ndf.published.published_settings import PublishedSettings, checkpoint_path
from shellbench.solvers.ndf.published.published_training import RECORD, why_collapsed
from shellbench.solvers.ndf.published_solver import PublishedSolver
from tests.solvers.ndf.trainings import sampler_of, trained

FOLDER, REPAIRED = (Path(__file__).parents[3] / f"reports/{name}" for name in ("published", "replication"))
BEGINNING = 2 * RECORD
ALIKE = 1e-3  # two processors part by 8e-5 over 50 iterations in single precision; other samples by far more


class Begun(Exception):
    """A training that is as far as it is looked at."""


def beginning(record: Record, folder: Path) -> tuple[Step, ...]:
    """The history of the first iterations, trained anew as a part of the whole: schedules know how long that is."""
    changed = {"seed": record.identity.seed, "checkpoint": str(folder), "checkpoint_every": BEGINNING}
    case, settings = named_case(record.case_name), PublishedSettings(**record.identity.settings | changed)

    def watched(told: Progress) -> None:
        if told.step == BEGINNING < settings.iterations:
            raise Begun

    try:
        return trained(case, settings, progress=watched).history
    except Begun:
        return read_checkpoint(checkpoint_path(case, settings)).history


def departure(record: Record) -> float:
    """Largest relative difference of energies and quantities over the first iterations, trained anew."""
    with tempfile.TemporaryDirectory() as place:
        now = beginning(record, Path(place))
    pairs = [
        (new, old)
        for step, kept in zip(now, record.history, strict=False)
        for new, old in [(step.energy, kept.energy), *((step.quantities[k], v) for k, v in kept.quantities.items())]
    ]
    return max(abs(new / old - 1) for new, old in pairs)


def judged(record: Record) -> Record:
    """The record with today's verdict; nothing moves the supports of these cases."""
    case = named_case(record.case_name)
    assert case.loads
    assert not sampler_of(case)[1].ansatz.lift.moves
    course = [(step.iteration, step.energy) for step in record.history]
    reason = why_collapsed(record.diagnostics["certified_energy"], course, 0.0, True)
    return record.model_copy(update={"status": "failed" if reason else "ok", "reason": reason})


def taken_over(record: Record) -> Record:
    """The record as one of today's source; ValueError if today's training is another."""
    if named_case(record.case_name).digest() != record.identity.case:
        raise ValueError(f"{record.run_id}: its case has changed, so it must be trained anew")
    if not (found := departure(record)) <= ALIKE:
        raise ValueError(f"{record.run_id}: its first iterations differ by {found:.1g}, so it must be trained anew")
    identity = record.identity.model_copy(update={"source": current_source(find_solver(PublishedSolver.name))})
    whole = {"rest_energy": 0.0, "trained_by_source": record.identity.source, **record.diagnostics}
    return judged(record).model_copy(update={"identity": identity, "diagnostics": whole})


def take_over(folder: Path) -> None:
    """Write all records of a folder again; none if one can't be taken over."""
    kept = Store(folder)
    records = [taken_over(record) for record in kept.read().records]
    with tempfile.TemporaryDirectory(dir=folder.parent) as place:
        again = Store(Path(place))
        for record in records:
            partial = again.begin(record.run_id)
            for file in filter(None, map(kept.file, (record.fields_file, record.solution_file))):
                shutil.copy(file, partial / file.name.removeprefix(f"{record.run_id}."))
            bare = {
                name: value and value.removeprefix(f"{record.run_id}.")
                for name, value in (("fields_file", record.fields_file), ("solution_file", record.solution_file))
            }
            again.commit(partial, record.model_copy(update=bare))
        for file in Path(place).glob("[!.]*"):
            shutil.copy(file, folder / file.name)


if __name__ == "__main__":
    for folder in map(Path, sys.argv[1:]) if sys.argv[1:] else (FOLDER, REPAIRED):
        take_over(folder)
