"""The baseline: values of the suite when the baseline was last moved, deliberately and by a commit.

A value must stay within the widest of three bands: `DEVIATIONS` standard deviations over the baseline's seeds,
`ROOM` times the measured spread between processors (real or emulated) and numbers of threads, and `REPEATS`.
Costs are compared only between runs on the same processor with as many threads.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from statistics import fmean, stdev
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from shellbench.bench.judge.row import Finding, Row
from shellbench.bench.store.record import Record
from shellbench.disk import said_plainly
from shellbench.errors import InputError
from shellbench.files import read_file
from shellbench.problem import VARIANT
from shellbench.protocol.schema import Finite, Model, Name, one_sentence

REPEATS = 1e-6  # relative: changes of the last digits by other processors and libraries are far smaller
ROOM = 5.0  # times the measured spread: a few conditions do not include the worst one
DEVIATIONS = 5.0  # with three seeds the deviation itself is known to a factor of about two
SLOWER = 1.5  # seconds of a run on the same processor vary by some ten per cent
LARGER = 1.2  # likewise memory
LARGEST_FILE = 20_000_000  # bytes

Key = tuple[str, str, str, float | None]  # case, solver, quantity, mark


class BaselineValue(Model):
    """The values of one quantity of one solver with default settings, by seed ("none" for a deterministic one).

    Attributes
    ----------
    spread
        Largest difference of one seed's value between processors and numbers of threads, in the quantity's unit.
    """

    case: Name
    solver: str
    quantity: Name
    at: Finite | None
    values: Annotated[dict[str, Finite], Field(min_length=1)]
    spread: Annotated[Finite, Field(ge=0)] = 0.0

    @property
    def mean(self) -> float:
        """Mean over the seeds."""
        return fmean(self.values.values())

    @property
    def band(self) -> float:
        """Half width of the admissible band around the mean."""
        return max(DEVIATIONS * _deviation(tuple(self.values.values())), ROOM * self.spread, REPEATS * abs(self.mean))


class BaselineCost(Model):
    """The cost of one solver's runs on one case: the least over the seeds."""

    case: Name
    solver: str
    seconds: Annotated[Finite, Field(ge=0)]
    peak_memory_bytes: int | None
    parameters: int | None
    processor: str
    threads: int
    device: str
    gpu: str | None = None


class Baseline(Model):
    """The stored values and costs of the regression and cost gates."""

    schema_version: Literal[1] = 1
    values: tuple[BaselineValue, ...]
    costs: tuple[BaselineCost, ...]

    def value(self, row: Row) -> BaselineValue | None:
        """Return the remembered value of a row; None if there is none."""
        wanted = _key(row)
        return next((value for value in self.values if value.quantity == row.quantity and _key(value) == wanted), None)


def read_baseline(path: Path) -> Baseline | None:
    """Read a baseline; None if there is no such file; InputError in one sentence if it is malformed."""
    if not os.path.lexists(path):
        return None
    try:
        return Baseline.model_validate_json(read_file(path, LARGEST_FILE))
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error)}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_baseline(baseline: Baseline, path: Path) -> None:
    """Write a baseline, whole or not at all."""
    temporary = path.with_name(f".{path.name}.partial")
    with said_plainly(path.parent, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.write_text(baseline.model_dump_json(indent=1) + "\n", encoding="utf-8")
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def make_baseline(
    rows: Sequence[Row], records: Sequence[Record], old: Baseline | None = None, like: Sequence[Row] = ()
) -> Baseline:
    """Make a baseline of gated rows and their records; entries of `old` for other runs stay.

    Parameters
    ----------
    rows
        Gated rows, all with a value. Variants are not stored, because they depend on a draw.
    records
        The records behind them.
    like
        The same rows from other processors and numbers of threads. Without any, the old spread stays.
    """
    values: dict[Key, dict[str, float]] = {}
    for row in rows:
        if row.value is not None and row.variant is None:
            values.setdefault(_key(row), {})[_seed(row)] = row.value
    spreads = _spreads(values, like) if like else {_key(v): v.spread for v in (old.values if old else ())}
    new = [
        BaselineValue(case=c, solver=s, quantity=q, at=at, values=v, spread=spreads.get((c, s, q, at), 0.0))
        for (c, s, q, at), v in values.items()
    ]
    costs = {(r.case_name, r.identity.solver): _cost(r, records) for r in records if VARIANT not in r.case_name}
    moved = {(v.case, v.solver) for v in new}
    kept_values = [v for v in (old.values if old else ()) if (v.case, v.solver) not in moved]
    kept_costs = [c for c in (old.costs if old else ()) if (c.case, c.solver) not in moved]
    return Baseline(
        values=tuple(sorted((*kept_values, *new), key=lambda v: (v.case, v.solver, v.quantity))),
        costs=tuple(sorted((*kept_costs, *costs.values()), key=lambda c: (c.case, c.solver))),
    )


@lru_cache(maxsize=4096)  # cached: a gate needs the band of each row, and many rows share one
def _deviation(values: tuple[float, ...]) -> float:
    return stdev(values) if len(values) > 1 else 0.0


def _key(of: Row | BaselineValue) -> Key:
    return of.case, of.solver, of.quantity, of.at


def _seed(row: Row) -> str:
    return "none" if row.seed is None else str(row.seed)


def _spreads(values: Mapping[Key, Mapping[str, float]], like: Sequence[Row]) -> dict[Key, float]:
    """Return the largest distance of each value from the same seed's in other rows."""
    spreads: dict[Key, float] = {}
    for row in like:
        here = values.get(_key(row), {}).get(_seed(row))
        if here is not None and row.value is not None:
            spreads[_key(row)] = max(spreads.get(_key(row), 0.0), abs(row.value - here))
    return spreads


def _cost(record: Record, records: Sequence[Record]) -> BaselineCost:
    like = [r for r in records if (r.case_name, r.identity.solver) == (record.case_name, record.identity.solver)]
    quickest = min(like, key=lambda r: r.seconds)
    return BaselineCost(
        case=record.case_name,
        solver=record.identity.solver,
        seconds=quickest.seconds,
        peak_memory_bytes=quickest.peak_memory_bytes,
        parameters=quickest.parameters,
        processor=quickest.environment.processor,
        threads=quickest.environment.threads,
        device=quickest.identity.device,
        gpu=quickest.environment.gpu,
    )


def regression_finding(baseline: Baseline, row: Row) -> Finding | None:
    """Compare a row with the baseline's value; None if its run has no value (the accuracy gate reports it)."""
    if row.value is None:
        return None
    known = baseline.value(row)
    if known is None:
        return Finding(row, "not compared", "the baseline does not know it")
    change = row.value - known.mean
    said = f"{change / abs(known.mean):+.2e}" if known.mean else f"{change:+.2e} {row.unit}"
    allowed = f"{known.band / abs(known.mean):.2g}" if known.mean else f"{known.band:.2g} {row.unit}"
    if row.tolerance_is_absolute and row.tolerance:  # values near zero are rounding errors
        band = max(known.band, row.tolerance)
        said, allowed = f"{change:+.2e} {row.unit}", f"{band:.2g} {row.unit}"
    else:
        band = known.band
    good = math.isfinite(row.value) and abs(change) <= band
    return Finding(row, "green" if good else "red", f"changed by {said}, {allowed} allowed")


def cost_findings(baseline: Baseline, records: Sequence[Record]) -> list[Finding]:
    """Compare the fastest run of each case and solver with the fastest run of the baseline.

    The least over the seeds is compared, because the load of the machine only ever adds time.
    """
    quickest: dict[tuple[str, str], Record] = {}
    for record in sorted(records, key=lambda r: r.seconds, reverse=True):
        if record.status == "ok":
            quickest[record.case_name, record.identity.solver] = record
    return [finding for record in quickest.values() if (finding := _cost_finding(baseline, record))]


def _cost_finding(baseline: Baseline, record: Record) -> Finding | None:
    known = next((c for c in baseline.costs if (c.case, c.solver) == (record.case_name, record.identity.solver)), None)
    if known is None:
        return None
    row = cost_row(record)
    here = record.environment
    now = (here.processor, here.threads, record.identity.device, here.gpu)
    if now != (known.processor, known.threads, known.device, known.gpu):
        return Finding(row, "not compared", "it was made on other hardware")
    figures = [
        (record.seconds, known.seconds, SLOWER, "seconds"),
        (record.peak_memory_bytes, known.peak_memory_bytes, LARGER, "bytes at the peak"),
        (record.parameters, known.parameters, 1.0, "parameters"),
    ]
    worse = [
        f"{now_:.3g} {unit} instead of {then:.3g}"
        for now_, then, factor, unit in figures
        if now_ is not None and then is not None and now_ > factor * then
    ]
    return Finding(row, "red" if worse else "green", ", ".join(worse) or f"{record.seconds:.2f} s")


def cost_row(record: Record) -> Row:
    """Return a row that names a run and its cost."""
    return Row(
        case=record.case_name,
        suite=None,
        solver=record.identity.solver,
        settings=record.identity.settings,
        seed=record.identity.seed,
        quantity="cost",
        primary=False,
        at=1.0,
        value=None,
        status=record.status,
        seconds=record.seconds,
        peak_memory_bytes=record.peak_memory_bytes,
        parameters=record.parameters,
        storage_bytes=record.storage_bytes,
        run_id=record.run_id,
    )
