"""A synthetic study of resolutions: fields by formulas with known differences. No solver ran; no figure is a result."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Measured, Record
from shellbench.errors import InputError
from shellbench.protocol.history import PrecisionStep
from shellbench.report.data.evidence import Evidence
from tests.report.conftest import headline_of, identity, keep

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


def only_suites(patch: pytest.MonkeyPatch, suites: Sequence[str], **facts: object) -> None:
    """Leave the catalog no suites but some, each a study of its name but for the obstacle course."""
    told = {"order": (), "title": "", "runs": (), "remarks": ()} | facts
    kept = {
        name: SimpleNamespace(name=name, study=None if name == "obstacle_course" else name, **told) for name in suites
    }

    def find(name):
        if name not in kept:
            raise InputError(name)
        return kept[name]

    patch.setattr(catalog, "suite_names", lambda: list(kept))
    patch.setattr(catalog, "find_suite", find)


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
        stored = {"probes": POINTS, "probe_marks": at, "probe": length * size[:, None, None] * SHAPE}
        np.savez_compressed(folder / f"{run_id}.npz", **(stored if probes else {}))
    value, bytes_ = HEADLINE * (1 + error), 8 * number * max(1, steps)
    facts: dict[str, Any] = {"status": status, "seconds": 1.0, "idle_memory_bytes": 200_000_000}
    facts["history"] = [
        {
            "iteration": i,
            "seconds": 0.1 * i,
            "energy": 0.0,
            "unknowns": number,
            "at": marks[-1] * i / steps,
            "phase": "time",
        }
        for i in range(1, steps + 1)
    ]
    if ok:
        facts |= {"parameters": number, "storage_bytes": bytes_, "values": {case.primary.name: Measured(value=value)}}
        facts["fields_file"] = f"{run_id}.npz"
        facts["resolution"] = [{"points": p} | interpolated(length, INTERPOLATION / p**2) for p in MESHES]
        facts["frame_rates"] = [
            {"frames": f, "frames_per_second": (f - 1) / marks[-1]} | interpolated(length, 1 / (f - 1) ** 2)
            for f in (FRAMES if steps else ())
        ]
        facts["precision"] = [
            PrecisionStep(
                format=format,
                storage_bytes=size * number * max(1, steps),
                largest_difference=relative * length,
                rms_difference=0.5 * relative * length,
                quantities={case.primary.name: value * (1 + relative)},
            )
            for format, (size, relative) in ROUNDING.items()
        ]
    else:
        facts["reason"] = "it did not converge"
    memory = 200_000_000 + 1000 * number
    record = keep(folder, run_id, case, identity(case, solver, settings, seed), peak_memory_bytes=memory, **facts)
    judged = {"reference": HEADLINE, "reference_uncertainty": UNCERTAINTY * HEADLINE} if known else {}
    row = headline_of(
        record,
        value if ok else None,
        suite=suites[0],
        suites=tuple(suites),
        overrides=dict(overrides or {"cells": [n, n]}) if label else {},
        default_settings=not label,
        label=label,
        declared=True,
        relative_error=error if known and ok else None,
        reason=None,
        **judged,
    )
    return record, row


def interpolated(length: float, share: float) -> dict[str, float]:
    """Differences after interpolation by a share of the largest displacement."""
    found = {"probe_difference": 0.0, "largest_displacement": length}
    return found | {"interpolation_difference": share * length, "interpolation_rms": 0.5 * share * length}


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
