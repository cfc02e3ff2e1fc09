"""A synthetic study of resolutions: fields by formulas with known differences. No solver ran; no figure is a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Measured, Record
from shellbench.protocol.history import FrameRateStep, HistoryStep, PrecisionStep, ResolutionStep
from shellbench.report.data.evidence import Evidence
from tests.report.conftest import ENVIRONMENT, identity

PLATE, NAPKIN = "square_plate", "napkin_plane"
LENGTH = 0.5  # m, the largest displacement of the exact field
HEADLINE = 0.4  # m, its headline quantity
POINTS = np.array([[0.31, 0.47], [0.11, 0.83], [0.71, 0.29]])
SHAPE = np.array([[0.6, 0.0, 0.8], [0.0, 0.5, 0.0], [0.0, 0.0, 0.25]])  # lengths 1, 1/2, 1/4 at the three points
PROBE_RMS = float(np.sqrt(np.mean([1.0, 0.25, 0.0625])))  # of these lengths
MESHES, FRAMES = (10, 100), (11, 101)
INTERPOLATION = 2.0  # a mesh of n x n points differs by so much times the largest displacement / n^2
ROUNDING = {"float32": (4, 1e-7), "float16": (2, 1e-3)}  # bytes a number, and relative difference
UNCERTAINTY = 1e-9


def unknowns(n: int) -> int:
    return 12 * n * n


def run(
    folder: Path,
    case_name: str,
    solver: str,
    n: int,
    error: float,
    *,
    seed: int | None = None,
    label: str = "",
    marks: Sequence[float] = (1.0,),
    steps: int = 0,
    growth: float = 0.0,
    length: float = LENGTH,
    probes: bool = True,
    status: str = "ok",
    known: bool = True,
    suites: Sequence[str] = ("resolution",),
    count: int | None = None,
    overrides: Mapping[str, object] | None = None,
) -> tuple[Record, Row]:
    """A run whose displacement at mark t is (1 + error exp(growth t)) of the exact one, t times as large in motion."""
    case = catalog.named_case(case_name)
    settings = {"cells": [n, n], "label": label, "steps": steps}
    run_id = f"{case_name}-{solver}-{n}-{label.replace(' ', '_')}-{steps}-{seed}"
    ok, number = status == "ok", count or unknowns(n)
    if ok:
        at = np.array(marks, dtype=float)
        size = at / at[-1] * (1 + error * np.exp(growth * at))
        stored = {"probes": POINTS, "probe_marks": at, "probe_displacements": length * size[:, None, None] * SHAPE}
        np.savez_compressed(folder / f"{run_id}.npz", **(stored if probes else {}))
    value = HEADLINE * (1 + error)
    record = Record(
        run_id=run_id,
        created="2000-01-01T00:00:00Z",
        identity=identity(case, solver, settings, seed),
        case_name=case_name,
        case=case.model_dump(mode="json"),
        solver_label=f"synthetic {solver}",
        status=status,
        reason=None if ok else "it did not converge",
        seconds=1.0,
        peak_memory_bytes=200_000_000 + 1000 * number,
        idle_memory_bytes=200_000_000,
        parameters=number if ok else None,
        storage_bytes=8 * number * max(1, steps) if ok else None,
        values={case.primary.name: Measured(value=value)} if ok else {},
        history=tuple(
            HistoryStep(
                iteration=i, seconds=0.1 * i, energy=0.0, unknowns=number, at=marks[-1] * i / steps, phase="time"
            )
            for i in range(1, steps + 1)
        ),
        resolution=tuple(
            ResolutionStep(
                points=p,
                probe_difference=0.0,
                interpolation_difference=INTERPOLATION * length / p**2,
                interpolation_rms=0.5 * INTERPOLATION * length / p**2,
                largest_displacement=length,
            )
            for p in (MESHES if ok else ())
        ),
        frame_rates=tuple(
            FrameRateStep(
                frames=f,
                frames_per_second=(f - 1) / marks[-1],
                probe_difference=0.0,
                interpolation_difference=length / (f - 1) ** 2,
                interpolation_rms=0.5 * length / (f - 1) ** 2,
                largest_displacement=length,
            )
            for f in (FRAMES if steps and ok else ())
        ),
        precision=tuple(
            PrecisionStep(
                format=format,
                storage_bytes=size * number * max(1, steps),
                largest_difference=relative * length,
                rms_difference=0.5 * relative * length,
                quantities={case.primary.name: value * (1 + relative)},
            )
            for format, (size, relative) in (ROUNDING.items() if ok else ())
        ),
        environment=ENVIRONMENT,
        fields_file=f"{run_id}.npz" if ok else None,
    )
    row = Row(
        case=case_name,
        suite=suites[0],
        suites=tuple(suites),
        solver=solver,
        settings=settings,
        overrides=dict(overrides or {"cells": [n, n]}) if label else {},
        default_settings=not label,
        label=label,
        declared=True,
        seed=seed,
        quantity=case.primary.name,
        primary=True,
        at=1.0,
        value=value if ok else None,
        reference=HEADLINE if known else None,
        reference_uncertainty=UNCERTAINTY * HEADLINE if known else None,
        relative_error=error if known and ok else None,
        status=status,
        run_id=run_id,
        parameters=record.parameters,
        storage_bytes=record.storage_bytes,
        case_title=case.title,
        unit="m",
        description=case.primary.description,
    )
    return record, row


def evidence(folder: Path, runs: Sequence[tuple[Record, Row]]) -> Evidence:
    return Evidence({record.run_id: record for record, _ in runs}, [row for _, row in runs], folder)


def plate_runs(folder: Path) -> list[tuple[Record, Row]]:
    """A mesh of rate 2 with a marginally different one at each size, and a field with three seeds at two sizes."""
    runs = [run(folder, PLATE, "shells", n, 1 / n**2, label=f"cells {n}×{n}") for n in (4, 8, 16, 32, 64)]
    runs += [
        run(folder, PLATE, "shells", n, 1 / n**2 + 1e-3, label=f"cells {n}×{n + 1}", count=12 * n * (n + 1))
        for n in (8, 16, 32)
    ]
    for width, error in ((5, 2e-2), (10, 2e-3)):
        runs += [
            run(folder, PLATE, "field", width, error * (1 + 0.1 * s), seed=s, label=f"neurons {width}")
            for s in range(3)
        ]
    runs.append(run(folder, PLATE, "field", 99, 0.0, seed=5, label="neurons 99", status="failed"))
    runs.append(run(folder, PLATE, "shells", 128, 1e-7, suites=("obstacle_course",)))
    return runs


def napkin_runs(folder: Path) -> list[tuple[Record, Row]]:
    """A motion without known value, whose differences grow as exp(2 t), on ladders of cells and of time steps."""
    marks = tuple(np.linspace(0.1, 1.0, 10))
    made = {"marks": marks, "growth": 2.0, "known": False}
    runs = [
        run(folder, NAPKIN, "shells", n, 0.2 / n**2, label=f"cells {n}×{n}", steps=40, **made) for n in (4, 8, 16, 32)
    ]
    runs += [
        run(
            folder,
            NAPKIN,
            "shells",
            8,
            0.2 / 64 + 1e-2 / s,
            label=f"time_step {1 / s:g}",
            steps=s,
            overrides={"cells": [8, 8], "time_step": 1 / s},
            **made,
        )
        for s in (20, 80)
    ]
    runs += [
        run(folder, NAPKIN, "field", n, 0.05 / n, seed=0, label=f"neurons {n}", steps=100, **made) for n in (3, 6, 12)
    ]
    return runs
