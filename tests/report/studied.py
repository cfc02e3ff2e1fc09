"""Synthetic records of studies, their figures made from formulas. No solver ran; no figure is a result."""

from collections.abc import Sequence
from pathlib import Path

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.suite import value_words
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.protocol.history import HistoryStep
from shellbench.report.data.evidence import Evidence
from tests.report.conftest import record, row

IDLE = 200_000_000  # bytes before the solve
BYTES_AN_UNKNOWN = 5000
SECONDS_AN_UNKNOWN = 1e-4
UNKNOWNS_A_CELL = 12

Run = tuple[Record, Row]


def evidence(folder: Path, runs: Sequence[Run]) -> Evidence:
    return Evidence({made.run_id: made for made, _ in runs}, [of for _, of in runs], folder)


def studied(
    folder: Path,
    study: str,
    solver: str,
    settings: dict[str, object],
    error: float,
    *,
    case: str = "square_plate",
    seed: int | None = None,
    unknowns: int = 1000,
    status: str = "ok",
    history: tuple[HistoryStep, ...] = (),
    gap: float | None = None,
    diagnostics: dict[str, object] | None = None,
) -> Run:
    """A run of a study whose time and memory are proportional to its unknowns."""
    diagnostics = (diagnostics or {}) | ({} if gap is None else {"energy_gap": gap})
    reason = None if status == "ok" else "it was refused"
    made = record(
        folder, catalog.named_case(case), solver, seed, error, history, diagnostics, settings, unknowns=unknowns
    ).model_copy(
        update={
            "status": status,
            "reason": reason,
            "seconds": SECONDS_AN_UNKNOWN * unknowns,
            "idle_memory_bytes": IDLE,
            "peak_memory_bytes": IDLE + BYTES_AN_UNKNOWN * unknowns,
        }
    )
    label = ", ".join(f"{key} {value_words(value)}" for key, value in settings.items())
    measured = row(made, None, label, study)
    return made, measured.model_copy(update={"idle_memory_bytes": IDLE, "energy_gap": gap, "declared": True})


def meshes(folder: Path, solver: str, errors: dict[tuple[int, int], float], **more: object) -> list[Run]:
    """Runs of a sweep over meshes, the error of each by its cells."""
    return [
        studied(
            folder,
            "resolution",
            solver,
            {"cells": list(cells)},
            error,
            unknowns=UNKNOWNS_A_CELL * cells[0] * cells[1],
            **more,  # type: ignore[arg-type]
        )
        for cells, error in errors.items()
    ]
