"""The kept summary of the suite `resolution`: values, unknowns, seconds and bytes of its runs, without their fields.

The suite takes an hour. Its summary, one JSON file with a run a line, is committed with the commit and the machine that
made it, so that a page can show convergence and consistency beside runs of its own. docs/evidence.py re-makes it:

    python docs/evidence.py resolution

Displacements at common points are compared as they are, but for what a buckled shell of revolution leaves open: its
waves may stand at any angle. There each state is turned about the axis until its deepest dent is at xi1 = 0.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge import compare
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import ANSWERED, Record
from shellbench.bench.store.store import Store, silent
from shellbench.report.data.accuracy import swept_setting
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import kept_arrays
from shellbench.report.data.kept_data import FORMAT
from shellbench.report.data.ladder import SAME, CaseRuns, Difference, Probes, Run, case_runs, difference
from shellbench.report.data.rates import Yardstick, known_yardstick
from shellbench.report.data.runs import headlines

Array = NDArray[np.float64]

SUITE = "resolution"
POINTS = 5  # common material points whose displacements are kept
MOST_MARKS = 3  # times, or load factors, at which they are kept
GRIDS = (10, 50, 200)  # points a side of the grids that one solution is asked through
GOLDEN = 0.618  # of the length, modulo one: how far along the next point of a turned grid is
DIGITS = 6  # of displacements; of other numbers all are kept


@dataclass(frozen=True)
class _Kept:
    """Data that all lines of one case share."""

    runs: CaseRuns
    yardstick: Yardstick | None
    probes: Mapping[str, Probes]
    marks: tuple[float, ...]

    def difference(self, one: str, other: str | None) -> dict[str, float] | None:
        """Return the distance of two runs over all probes, m; None if they share none."""
        found = _apart(self.probes.get(one), self.probes.get(other or ""), self.marks)
        return None if found is None or one == other else {"largest": found.largest, "rms": found.rms}


def summary(evidence: Evidence) -> dict[str, Any]:
    """Return the summary of what a store holds of the suite, as JSON data; see docs/evidence.py.

    Lengths are in metres, sizes in bytes, `seconds` those of the wall.
    """
    made = {one.case: _kept(one, evidence) for one in case_runs(evidence)}
    rows = [row for row in headlines(evidence.runs)["row"] if row.case in made]
    records = [evidence.records[row.run_id] for row in rows if row.run_id in evidence.records]
    order = list(dict.fromkeys(row.case for row in rows))
    return {
        "format": FORMAT,
        "made": _origin(records),
        "cases": {case: _case_line(made[case], rows) for case in order},
        "runs": [_run_line(row, made[row.case], evidence) for row in rows],
    }


def _origin(records: Sequence[Record]) -> dict[str, Any]:
    """Return the commit, the day and the machine of most of the runs."""
    places = Counter(
        (one.environment.git_sha, one.environment.git_dirty, one.environment.processor, one.environment.platform,
         one.environment.cores, one.environment.threads)
        for one in records
    )  # fmt: skip
    (commit, dirty, processor, platform, cores, threads), count = places.most_common(1)[0]
    return {
        "suite": SUITE,
        "commit": commit,
        "dirty": dirty,
        "date": max(one.created for one in records)[:10],
        "cores": cores,
        "threads": threads,
        "processor": processor,
        "platform": platform,
        "runs": len(records),
        "runs_from_elsewhere": len(records) - count,
    }


def _kept(runs: CaseRuns, evidence: Evidence) -> _Kept:
    of_case = [run for ladder in runs.ladders for run in ladder.runs]
    rows = [run.row for run in of_case]
    turned = _is_turned(of_case[0].record)
    probes = {
        run.row.run_id or "": found
        for run in of_case
        if (found := _turned_probes(run, evidence.folder) if turned else run.probes) is not None
    }
    return _Kept(runs, known_yardstick(evidence.records, rows), probes, _common_marks(runs, probes))


def _is_turned(record: Record) -> bool:
    """Return True if waves of a buckled shell of revolution may stand at any angle."""
    surface, path = record.case.get("surface", {}), record.case.get("path") or {}
    return bool(surface.get("closed")) and path.get("after_buckling") == "follow"


def _turned_probes(run: Run, folder: Path) -> Probes | None:
    """Return the turned states of a run on its record's grid; None if it kept none."""
    kept = kept_arrays(run.record, folder, "xi", "position", "marks", "displacements")
    if kept is None or not len(kept[2]):
        return None
    xi, position, marks, states = kept
    return Probes(xi[:-1].reshape(-1, 2), marks, turned_states(position, states).reshape(len(marks), -1, 3))


def turned_states(position: Array, states: Array) -> Array:
    """Return states (j, n - 1, m, 3) in cylindrical components, each turned until a dent is at xi1 = 0.

    `position` (n, m, 3) and `states` (j, n, m, 3) are on a grid whose first and last column are one. Around the axis
    the values are interpolated by trigonometric polynomials; the angle is that of the largest wave half way along.
    """
    spectrum = np.fft.rfft(_cylindrical(position[:-1], states[:, :-1]), axis=1)
    waves = np.arange(spectrum.shape[1])
    middle = spectrum[:, 1:, spectrum.shape[2] // 2, 0]
    largest = np.abs(middle).argmax(axis=1)
    phase = np.angle(middle[np.arange(len(states)), largest])
    dent = (np.pi - phase) / waves[1:][largest]
    turned = spectrum * np.exp(1j * np.outer(dent, waves))[:, :, None, None]
    return np.asarray(np.fft.irfft(turned, n=len(position) - 1, axis=1))


def _cylindrical(position: Array, states: Array) -> Array:
    """Return displacements (j, n, m, 3) in components along the radius, around the axis and along it."""
    axis = int(np.argmin(np.ptp(position[:, 0], axis=0)))
    one, two = ((axis + k) % 3 for k in (1, 2))
    radius = np.hypot(position[..., one], position[..., two])
    c, s = position[..., one] / radius, position[..., two] / radius
    u, v = states[..., one], states[..., two]
    return np.stack([c * u + s * v, c * v - s * u, states[..., axis]], axis=-1)


def _common_marks(runs: CaseRuns, probes: Mapping[str, Probes]) -> tuple[float, ...]:
    """Return marks that the finest runs of all solvers have reached, increasing: the last one, and some on the way."""
    finest = [probes.get(ladder.finest.row.run_id or "") for ladder in runs.ladders]
    known = [one.marks for one in finest if one is not None]
    if not known:
        return ()
    near = SAME * max(float(np.abs(marks).max()) for marks in known)
    common = [float(m) for m in known[0] if all(np.any(np.abs(other - m) <= near) for other in known)]
    last = len(common) - 1
    places = dict.fromkeys(round((k + 1) * last / MOST_MARKS) for k in range(MOST_MARKS))
    return tuple(common[place] for place in places) if common else ()


def _case_line(kept: _Kept, rows: Sequence[Row]) -> dict[str, Any]:
    first = next(row for row in rows if row.case == kept.runs.case)
    common = kept.runs.yardstick
    probes = next(iter(kept.probes.values()), None)
    yardstick = kept.yardstick
    turned = common is not None and _is_turned(common.record)
    return {
        "title": first.case_title or first.case,
        "quantity": first.quantity,
        "description": first.description,
        "unit": first.unit,
        "at": first.at,
        "reference": first.reference,
        "reference_uncertainty": first.reference_uncertainty,
        "error_scale": yardstick.scale if yardstick else None,
        "error_floor": yardstick.floor if yardstick else None,
        "error_words": yardstick.words if yardstick else None,
        "scale": kept.runs.scale,
        "common_run": common.row.run_id if common else None,
        "marks": list(kept.marks),
        "components": ["radial", "around", "axial"] if turned else ["x", "y", "z"],
        "turned": turned,
        "points": [] if probes is None else _rounded(probes.points[_chosen(probes)]),
    }


def _chosen(probes: Probes) -> NDArray[np.int64]:
    """Return the numbers of the common points: the first of the probes; on a turned grid, from the dent on around."""
    number = np.arange(min(POINTS, len(probes.points)))
    around = len(np.unique(probes.points[:, 0]))
    if around == len(probes.points):
        return number.astype(np.int64)
    along = len(probes.points) // around
    places = along * ((0.5 + number * GOLDEN) % 1)
    return np.asarray(number * around // POINTS * along + places.astype(int), dtype=np.int64)


def _run_line(row: Row, kept: _Kept, evidence: Evidence) -> dict[str, Any]:
    record = evidence.records.get(row.run_id or "")
    probes = kept.probes.get(row.run_id or "")
    common = kept.runs.yardstick
    coarser = _coarser(row, kept.runs)
    peak, idle = row.peak_memory_bytes, row.idle_memory_bytes
    return {
        "case": row.case,
        "solver": row.solver,
        "label": row.label,
        "settings": row.overrides,
        "swept": swept_setting(row),
        "seed": row.seed,
        "status": row.status,
        "reason": row.reason,
        "run_id": row.run_id,
        "unknowns": row.parameters,
        "seconds": row.seconds,
        "memory": peak - idle if peak and idle and peak > idle else None,
        "peak_memory": peak,
        "storage": row.storage_bytes,
        "value": row.value,
        "uncertainty": row.uncertainty,
        "error": _error(row, kept.yardstick),
        "tolerance": row.tolerance,
        "passed": row.passed,
        "displacement": _displacements(probes, kept.marks),
        "from_common": kept.difference(row.run_id or "", common.row.run_id if common else None),
        "coarser_run": coarser,
        "from_coarser": kept.difference(row.run_id or "", coarser),
        "grids": [
            {
                "points": step.points,
                "difference": step.probe_difference,
                "mesh_difference": step.interpolation_difference,
            }
            for step in (record.resolution if record else ())
            if step.points in GRIDS
        ],
    }


def _error(row: Row, yardstick: Yardstick | None) -> float | None:
    """Return the magnitude of the headline's error as figures draw it; None without an answer or a known value."""
    if yardstick is None or row.value is None or row.status not in ANSWERED:
        return None
    return abs(yardstick.error(row.value))


def _displacements(probes: Probes | None, marks: Sequence[float]) -> list[Any] | None:
    """Return the displacement at the common points by mark, None for a mark that was not reached."""
    if probes is None:
        return None
    extent = float(np.abs(probes.marks).max(initial=0.0))
    found = []
    for mark in marks:
        near = np.flatnonzero(np.abs(probes.marks - mark) <= SAME * extent)
        found.append(_rounded(probes.displacements[near[0], _chosen(probes)]) if len(near) else None)
    return found


def _coarser(row: Row, runs: CaseRuns) -> str | None:
    """Return the run of the next coarser size of the same sweep and seed."""
    swept = swept_setting(row)
    alike = [
        run
        for ladder in runs.ladders
        if ladder.solver == row.solver
        for run in ladder.runs
        if run.row.seed == row.seed and swept_setting(run.row) == swept and run.unknowns < (row.parameters or 0)
    ]
    return max(alike, key=lambda run: run.unknowns).row.run_id if alike else None


def _apart(ours: Probes | None, theirs: Probes | None, marks: Sequence[float]) -> Difference | None:
    """Return the difference of two runs at the common marks only."""
    return difference(_at_marks(ours, marks), _at_marks(theirs, marks))


def _at_marks(probes: Probes | None, marks: Sequence[float]) -> Probes | None:
    if probes is None or not marks:
        return probes
    near = np.abs(probes.marks[:, None] - np.array(marks)) <= SAME * np.abs(probes.marks).max(initial=0.0)
    kept = near.any(axis=1)
    return Probes(probes.points, probes.marks[kept], probes.displacements[kept]) if kept.any() else None


def _rounded(values: Array) -> Any:
    return [[float(f"{x:.{DIGITS}g}") for x in line] for line in values.tolist()]


def as_text(data: Mapping[str, Any]) -> str:
    """Return the summary as JSON with a case and a run a line."""
    cases = [f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in data["cases"].items()]
    runs = [f"  {json.dumps(one)}" for one in data["runs"]]
    head = [f" {json.dumps(key)}: {json.dumps(data[key])}," for key in ("format", "made")]
    parts = ["{", *head, ' "cases": {', ",\n".join(cases), " },", ' "runs": [', ",\n".join(runs), " ]", "}"]
    return "\n".join(parts) + "\n"


def of_store(store: Store, cases: Sequence[str] = ()) -> dict[str, Any]:
    """Return the summary of a store's runs of the suite, of these cases alone if some are named.

    Raises
    ------
    InputError
        If the store can't be read.
    """
    rows, _ = compare.rows_and_notes(store, (SUITE,), tuple(cases))
    order = catalog.find_suite(SUITE).order
    rows = sorted((row for row in rows if row.case in order), key=lambda row: order.index(row.case))
    return summary(Evidence(store.records_of({row.run_id for row in rows}, silent), rows, store.folder))
