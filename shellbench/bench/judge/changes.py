"""Differences between two sides of a comparison: values, their cost, and runs that only one side has.

A loss is one of these:

- The run ended worse. The order is: ok, not settled, failed.
- A value passed its frozen tolerance and no longer does.
- The error grew by more than the threshold, relative to the known value.

An error within three uncertainties of the known value can't be told from zero. It is therefore replaced by three
uncertainties. Without a known value, a value can only change. Ratios of seconds and memory count as losses only if
the user gives a largest ratio.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import exp, isfinite, log
from statistics import fmean
from typing import Any, Literal

from shellbench.bench.judge.classes import BLUNT, CLASSES, scale_of
from shellbench.bench.judge.row import Row
from shellbench.bench.judge.sides import Side
from shellbench.bench.store.record import Record
from shellbench.errors import InputError

THRESHOLD = CLASSES[0]  # the tightest class of accuracy
LEAST_SECONDS = 0.1  # shorter differences come from the load of the machine
ENDED = ("ok", "not settled")  # from good to bad; other statuses are worse
Verdict = Literal["loss", "gain", "changed", "same"]


@dataclass(frozen=True)
class Limits:
    """Limits of a comparison: growth of an error, and largest ratios of seconds and memory; None for no limit."""

    threshold: float = THRESHOLD
    seconds: float | None = None
    memory: float | None = None


@dataclass(frozen=True)
class OneSide:
    """The value of one side: rows that differ in their seed only. The worst row counts."""

    rows: tuple[Row, ...]

    @cached_property
    def value(self) -> float | None:
        """Mean of the values; None if there are none."""
        values = [row.value for row in self.rows if row.value is not None]
        return fmean(values) if values else None

    @cached_property
    def error(self) -> float | None:
        """Signed error of largest magnitude, relative to the known value; near zero, to the largest of its unit."""
        return max((error for row in self.rows if (error := _error(row)) is not None), key=abs, default=None)

    @property
    def worst(self) -> Row:
        """The row of the run that ended worst."""
        return max(self.rows, key=_rank)

    @property
    def passed(self) -> bool | None:
        """True if all rows pass their tolerance; None if one of them is not gated."""
        said = [row.passed for row in self.rows]
        return None if None in said else all(said)

    def as_data(self) -> dict[str, Any]:
        """Return it as JSON data."""
        worst = self.worst
        uncertainties = [row.uncertainty for row in self.rows if row.uncertainty is not None]
        return {
            "status": worst.status,
            "value": self.value,
            "uncertainty": max(uncertainties, default=None),
            "error": self.error,
            "passed": self.passed,
            "seeds": [row.seed for row in self.rows if row.seed is not None],
            "reason": worst.reason,
            "run_ids": [row.run_id for row in self.rows],
        }


@dataclass(frozen=True)
class Change:
    """One value on both sides."""

    before: OneSide
    after: OneSide
    verdict: Verdict
    why: str = ""

    @property
    def row(self) -> Row:
        """A row of the second side that identifies the value."""
        return self.after.rows[0]


@dataclass(frozen=True)
class CostChange:
    """Cost of runs on both sides: mean seconds and largest memory. `why` is the reason if it is a loss."""

    row: Row
    seconds: tuple[float, float]
    memory: tuple[int, int] | None
    alike: bool
    why: str = ""

    @property
    def seconds_ratio(self) -> float | None:
        """Ratio of the second side to the first; None if the first took no time."""
        return self.seconds[1] / self.seconds[0] if self.seconds[0] > 0 else None

    @property
    def memory_ratio(self) -> float | None:
        """Ratio of the second side to the first; None if memory was not measured."""
        return self.memory[1] / self.memory[0] if self.memory and self.memory[0] > 0 else None


@dataclass(frozen=True)
class Comparison:
    """Differences between two sides.

    Attributes
    ----------
    gone, appeared
        One row for each run that only the first side has, and that only the second side has.
    """

    before: Side
    after: Side
    limits: Limits
    changes: tuple[Change, ...]
    costs: tuple[CostChange, ...]
    gone: tuple[Row, ...]
    appeared: tuple[Row, ...]
    notes: tuple[str, ...]

    @property
    def solvers(self) -> bool:
        """True if two solvers are compared, and not two states of the same solvers."""
        return self.after.what == "solver"

    def of(self, verdict: Verdict) -> list[Change]:
        """Return the changes with this verdict."""
        return [change for change in self.changes if change.verdict == verdict]

    @property
    def cost_losses(self) -> list[CostChange]:
        """Runs whose cost grew beyond its limit."""
        return [cost for cost in self.costs if cost.why]

    def good(self, gone_counts: bool = False) -> bool:
        """Return True if nothing was lost; with `gone_counts`, runs that only the first side has count as losses."""
        return not (self.of("loss") or self.cost_losses or (gone_counts and self.gone))


def compare_sides(before: Side, after: Side, limits: Limits) -> Comparison:
    """Compare two sides.

    Raises
    ------
    InputError
        If they have no value in common.
    """
    # 1. Group the rows of each side by the question and, unless solvers are compared, by solver and settings.
    # 2. If the sides have common seeds, compare only these.
    # 3. Compare the worst seed of each side.
    # 4. Report the other runs as gone or new.
    solvers = after.what == "solver"
    left, right = _grouped(before.rows, solvers), _grouped(after.rows, solvers)
    physics = [{run.case_name: run.identity.case for run in side.records.values()} for side in (before, after)]
    changes, costs, used = [], [], set[str | None]()
    other_cases: dict[str, None] = {}
    for key in [key for key in right if key in left]:
        old, new = _of_common_seeds(left[key], right[key])
        if not old or not new:
            continue
        used |= {row.run_id for row in (*old, *new)}
        if physics[0].get(old[0].case) != physics[1].get(new[0].case):
            other_cases[new[0].case] = None
            continue
        changes.append(_change(OneSide(old), OneSide(new), limits.threshold, solvers))
        if new[0].primary and (cost := _cost(old, new, before, after, limits)):
            costs.append(cost)
    if not changes:
        raise InputError(f"nothing to compare: {before.name} and {after.name} have no value in common")
    notes = [*before.notes, *after.notes]
    notes += [f"{case}: not compared, for the two sides have asked different questions" for case in other_cases]
    if not all(cost.alike for cost in costs):
        notes.append("seconds and memory were taken on other hardware or threads, so their ratios judge nothing")
    gone, appeared = (
        tuple({r.run_id: r for r in reversed(side.rows) if r.run_id not in used}.values())[::-1]
        for side in (before, after)
    )
    return Comparison(before, after, limits, tuple(changes), tuple(costs), gone, appeared, tuple(dict.fromkeys(notes)))


def same_figure(row: Row, solvers: bool = False) -> tuple[object, ...]:
    """Return the key that rows of one value share on both sides; between solvers only the case and quantity count."""
    who = () if solvers else (row.solver, json.dumps(row.overrides, sort_keys=True))
    return (row.case, row.own_case, row.quantity, row.at, *who)


def _grouped(rows: Iterable[Row], solvers: bool) -> dict[tuple[object, ...], list[Row]]:
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(same_figure(row, solvers), []).append(row)
    return groups


def _of_common_seeds(old: Sequence[Row], new: Sequence[Row]) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
    """Return the rows of seeds that both sides have; all rows if one side has no seeds."""
    before, after = ({row.seed for row in rows} for rows in (old, new))
    if None in before | after:
        return tuple(old), tuple(new)
    kept = [tuple(row for row in rows if row.seed in before & after) for rows in (old, new)]
    return kept[0], kept[1]


def _rank(row: Row) -> int:
    return ENDED.index(row.status) if row.status in ENDED else len(ENDED)


def _error(row: Row) -> float | None:
    if row.relative_error is not None or row.absolute_error is None:
        return row.relative_error
    scale = _scale(row)
    return row.absolute_error / scale if scale else None


def _scale(row: Row) -> float:
    return 1.0 if row.own_case and not row.unit else 0.0 if row.own_case else scale_of(row.case, row.unit)


def _known_error(row: Row) -> float:
    """Return the relative error below which the known value's uncertainty hides all differences."""
    size = abs(row.reference or 0.0) if row.relative_error is not None else _scale(row)
    return BLUNT * (row.reference_uncertainty or 0.0) / size if size else 0.0


def _change(before: OneSide, after: OneSide, threshold: float, solvers: bool) -> Change:
    """Decide if a value was lost, gained, changed, or is the same."""
    was, now = _rank(before.worst), _rank(after.worst)
    if was != now:
        why = after.worst.reason if now > was else before.worst.reason
        words = f"{before.worst.status} -> {after.worst.status}"
        return Change(before, after, "loss" if now > was else "gain", f"{words}{f': {why}' if why else ''}")
    # Each solver has its own tolerances, so that passing them can't rank two solvers.
    if not solvers and None not in (before.passed, after.passed) and before.passed != after.passed:
        row = after.rows[0]
        size = f"{row.tolerance:g} {row.unit}" if row.tolerance_is_absolute else f"{100 * (row.tolerance or 0):g} %"
        words = f"{'A' if before.passed else 'B'} alone meets the tolerance of {size}"
        return Change(before, after, "loss" if before.passed else "gain", words)
    old, new = before.error, after.error
    if old is not None and new is not None and isfinite(old) and isfinite(new):
        floor = _known_error(after.rows[0])
        grown = max(abs(new), floor) - max(abs(old), floor)
        if abs(grown) > threshold:
            return Change(
                before, after, "loss" if grown > 0 else "gain", f"error {100 * old:+.2g} % -> {100 * new:+.2g} %"
            )
        return Change(before, after, "same")
    if before.value is not None and after.value is not None:
        apart = abs(after.value - before.value)
        if apart > threshold * max(abs(before.value), abs(after.value)):
            return Change(before, after, "changed", f"by {apart:.2g} {after.rows[0].unit}".rstrip())
    return Change(before, after, "same")


def _cost(old: Sequence[Row], new: Sequence[Row], before: Side, after: Side, limits: Limits) -> CostChange | None:
    """Return the cost of runs on both sides; None unless all of them ended well."""
    if any(row.status != "ok" or row.seconds is None for row in (*old, *new)):
        return None
    was, now = (fmean(row.seconds or 0.0 for row in rows) for rows in (old, new))
    peaks = [[row.peak_memory_bytes for row in rows if row.peak_memory_bytes] for rows in (old, new)]
    memory = (max(peaks[0]), max(peaks[1])) if all(peaks) else None
    alike = len({*_hardware(old, before.records), *_hardware(new, after.records)}) == 1
    why = []
    if alike and limits.seconds and now > limits.seconds * was and now - was > LEAST_SECONDS:
        why.append(f"{now:.3g} s instead of {was:.3g}")
    if alike and limits.memory and memory and memory[1] > limits.memory * memory[0]:
        why.append(f"{memory[1] / 1e6:.3g} MB instead of {memory[0] / 1e6:.3g}")
    return CostChange(new[0], (was, now), memory, alike, ", ".join(why))


def _hardware(rows: Sequence[Row], records: Mapping[str, Record]) -> set[tuple[object, ...]]:
    found = [records[row.run_id] for row in rows if row.run_id is not None and row.run_id in records]
    return {(r.environment.processor, r.environment.threads, r.identity.device, r.environment.gpu) for r in found}


def mean_ratio(ratios: Iterable[float | None]) -> float | None:
    """Return the geometric mean of ratios; None if there are none."""
    logs = [log(ratio) for ratio in ratios if ratio]
    return exp(fmean(logs)) if logs else None


def as_data(found: Comparison) -> dict[str, Any]:
    """Return a comparison as JSON data, with the values of every verdict."""
    return {
        **{name: {"name": s.name, "what": s.what} for name, s in (("a", found.before), ("b", found.after))},
        "threshold": found.limits.threshold,
        "losses": len(found.of("loss")) + len(found.cost_losses),
        "gains": len(found.of("gain")),
        "figures": [
            _named(change.row, found.solvers)
            | {name: getattr(change.row, name) for name in ("quantity", "primary", "at", "unit", "reference")}
            | {"a": change.before.as_data(), "b": change.after.as_data()}
            | {"verdict": change.verdict, "reason": change.why or None}
            for change in found.changes
        ],
        "costs": [
            _named(cost.row, found.solvers)
            | {"seconds": list(cost.seconds), "seconds_ratio": cost.seconds_ratio}
            | {"peak_memory_bytes": cost.memory and list(cost.memory), "memory_ratio": cost.memory_ratio}
            | {"like_hardware": cost.alike, "verdict": "loss" if cost.why else "same", "reason": cost.why or None}
            for cost in found.costs
        ],
        **{
            name: [_named(row, False) | {"seed": row.seed, "status": row.status, "run_id": row.run_id} for row in rows]
            for name, rows in (("gone", found.gone), ("appeared", found.appeared))
        },
        "notes": list(found.notes),
    }


def _named(row: Row, solvers: bool) -> dict[str, Any]:
    who = {} if solvers else {"solver": row.solver, "settings": row.overrides}
    return {"case": row.base, "variant": row.variant} | who


def as_json(found: Comparison) -> str:
    """Return a comparison as JSON; numbers that are not finite as null."""
    return json_text(as_data(found))


def json_text(data: Any) -> str:
    """Return JSON data as text; numbers that are not finite as null."""
    return json.dumps(_finite(data), indent=1, allow_nan=False)


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not isfinite(data) else data
