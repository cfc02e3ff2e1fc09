"""The kept summary of the suite `resolution`: a file that ships, its data, and its runs put into sweeps.

See shellbench/report/sections/kept.py for what a page shows of it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, field_validator

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.record import ANSWERED
from shellbench.errors import InputError
from shellbench.protocol.schema import one_sentence
from shellbench.report.data.ladder import ALIKE
from shellbench.report.data.runs import grouped, groups_alike

FORMAT = 1
Triple = tuple[float, float, float]


class Part(BaseModel):
    """Immutable data of the summary; fields that are not read here are allowed."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Made(Part):
    """The commit and the machine that made the summary."""

    commit: str
    date: str
    processor: str = ""
    cores: int | None = None
    threads: int | None = None


class Apart(Part):
    """Largest and root mean square distance of two runs over all probes, m."""

    largest: float
    rms: float


class Grid(Part):
    """One solution asked through a grid of n x n points: its difference at the same points, and its mesh's, m."""

    points: int
    difference: float
    mesh_difference: float


class KeptCase(Part):
    """All runs of a case: `scale` is the largest displacement, m; all others are compared with `common_run`."""

    title: str
    scale: float | None = None
    common_run: str | None = None
    marks: tuple[float, ...] = ()


class KeptRun(Part):
    """One run; `displacement` (marks, points, 3) in m at the common points, bytes for `memory` and `storage`."""

    case: str
    solver: str
    label: str
    swept: str
    settings: dict[str, Any]
    seed: int | None
    status: str
    reason: str | None = None
    run_id: str = ""
    unknowns: int | None
    seconds: float | None
    memory: float | None
    storage: int | None
    value: float | None
    error: float | None = None
    displacement: tuple[tuple[Triple, ...] | None, ...] | None = None
    from_common: Apart | None = None
    from_coarser: Apart | None = None
    grids: tuple[Grid, ...] = ()

    @field_validator("run_id", mode="before")
    @classmethod
    def _made(cls, value: Any) -> Any:
        """Return an empty name for a run that was not made."""
        return value or ""

    @property
    def other_settings(self) -> str:
        """The settings that it shares with its sweep."""
        return repr(sorted((name, repr(value)) for name, value in self.settings.items() if name != self.swept))


Sweeps = Mapping[tuple[str, str, str], Sequence[KeptRun]]  # by solver, setting and other settings, coarse to fine


class Summary(Part):
    """The kept summary."""

    format: int
    made: Made
    cases: dict[str, KeptCase]
    runs: tuple[KeptRun, ...]


def shipped() -> Path:
    """Return the file of the summary; it need not be there."""
    return catalog.data_folder("reports") / "resolution.json"


def read_summary() -> Summary | None:
    """Return the summary that ships; None if there is none.

    Raises
    ------
    InputError
        In one sentence with the file and the field.
    """
    path = shipped()
    if not path.is_file():
        return None
    try:
        found = Summary.model_validate(data := json.loads(path.read_bytes()))
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error, data)}") from None
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error})") from None
    if found.format != FORMAT:
        raise InputError(f"{path}: has format {found.format}; this version of shellbench reads {FORMAT}")
    return found


def sweeps_of(runs: Sequence[KeptRun]) -> dict[tuple[str, str, str], list[KeptRun]]:
    """Return the runs of each sweep that answered, by solver, setting and other settings, from coarse to fine."""
    ended = [run for run in runs if run.status in ANSWERED and run.value is not None and run.unknowns]
    ordered = sorted(ended, key=lambda run: (run.solver, run.unknowns or 0, run.seed or 0))
    return grouped(ordered, lambda run: (run.solver, run.swept, run.other_settings))


def main_sweeps(sweeps: Sweeps) -> Iterator[tuple[str, list[KeptRun]]]:
    """Yield of each solver the runs of its longest sweep, with the lowest seed, from coarse to fine.

    Of sizes that differ only marginally it is the coarsest.
    """
    for solver, of_solver in grouped(sweeps.items(), lambda one: one[0][0]).items():
        longest = max((runs for _, runs in of_solver), key=lambda runs: len({run.label for run in runs}))
        seed = min((run.seed for run in longest if run.seed is not None), default=None)
        groups = groups_alike([run for run in longest if run.seed == seed], lambda run: run.unknowns or 0, ALIKE)
        yield solver, [group[0] for group in groups]


def largest_apart(one: KeptRun, other: KeptRun) -> float | None:
    """Return the largest difference of two runs over the common points and the marks that both reached, m."""
    found = [
        float(np.linalg.norm(np.array(a) - np.array(b), axis=-1).max())
        for a, b in zip(one.displacement or (), other.displacement or (), strict=False)
        if a and b and len(a) == len(b)
    ]
    return max(found, default=None)
