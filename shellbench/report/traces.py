"""From records to traces: what each run's quantities were over time, or along a path, and what is known of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shellbench.account import HistoryStep
from shellbench.bench.record import Record
from shellbench.bench.reference import KnownValue, KnownValues
from shellbench.portrait import Along, Portrait
from shellbench.report.paths import words_of

Array = NDArray[np.float64]

BALANCE = "energy_balance"  # a trace of the solver's own: see `shellbench.problem.Step.energy` of a step in time


@dataclass(frozen=True)
class Trace:
    """What one thing was at marks, both (n,)."""

    marks: Array
    values: Array

    def at(self, mark: float) -> float | None:
        """Return the value at a mark, between known ones by a straight line; None beyond the last."""
        rounding = 1e-9 * max(1.0, abs(mark))
        if not len(self.marks) or not self.marks[0] - rounding <= mark <= self.marks[-1] + rounding:
            return None
        return float(np.interp(mark, self.marks, self.values))


@dataclass(frozen=True)
class TracedRun:
    """What one run left.

    Attributes
    ----------
    name
        What the legend calls it.
    reason
        Why the run failed; None if it didn't.
    traces
        By name of series.
    critical
        By name of series: the mark of the critical state and the value there.
    """

    name: str
    seed: int | None
    run_id: str
    reason: str | None
    traces: Mapping[str, Trace]
    critical: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class KnownPoints:
    """What is known of one series: values (n,) at marks (n,) and their uncertainties, NaN where not known.

    Attributes
    ----------
    judges
        Whether they decide on solvers.
    critical
        Whether they are of a critical state.
    """

    label: str
    judges: bool
    marks: Array
    values: Array
    uncertainties: Array
    critical: bool = False


def traced(record: Record, case: Portrait, name: str) -> TracedRun | None:
    """Return the traces that a run left; None if it left none."""
    traces = {one.name: Trace(np.array(one.marks), np.array(one.values)) for one in record.series}
    if not traces:
        return None
    if steps := motion_steps(record):
        traces[BALANCE] = Trace(
            np.array([0.0, *(step.at for step in steps)]), np.array([0.0, *(step.energy for step in steps)])
        )
    if case.ends is None:  # a path starts at rest, where there is no force
        traces = {key: Trace(np.append(0.0, one.marks), np.append(0.0, one.values)) for key, one in traces.items()}
    reason = None if record.status == "ok" else record.reason or record.status
    return TracedRun(name, record.identity.seed, record.run_id, reason, traces, dict(_critical_of(record, traces)))


def motion_steps(record: Record) -> list[HistoryStep]:
    """Return the steps in time of a run."""
    return [step for step in record.history if step.phase == "time"]


def _critical_of(record: Record, traces: Mapping[str, Trace]) -> Iterator[tuple[str, tuple[float, float]]]:
    step = next((step for step in record.history if step.phase == "critical"), None)
    for name, trace in traces.items() if step is not None else ():
        value = trace.at(step.at) if step is not None else None
        if step is not None and value is not None:
            yield name, (step.at, value)


def known_points(case: Portrait, known: KnownValues, series: Along) -> list[KnownPoints]:
    """Return what is known of a series: the values that judge, then those of other origins."""
    found: dict[tuple[str, bool], list[tuple[float, KnownValue]]] = {}
    for name in series.quantities:
        at = case.quantity(name).at
        for value in known.of(name, "judge", "origin", "literature", "published"):
            judges = value.role == "judge"
            if judges and value.theory != case.theory:
                continue
            found.setdefault((_label(value), judges), []).append((at, value))
    points = [_points(label, judges, pairs) for (label, judges), pairs in found.items()]
    points += _critical_points(case, known, series)
    return sorted(points, key=lambda one: not one.judges)


def _label(value: KnownValue) -> str:
    if value.role == "judge":
        return "known value"
    return "second origin" if value.role == "origin" else words_of(value.label, value.source, value.theory)


def _points(label: str, judges: bool, pairs: Sequence[tuple[float, KnownValue]], critical: bool = False) -> KnownPoints:
    marks, values = np.array([(at, value.value) for at, value in pairs]).T
    doubts = np.array([np.nan if value.uncertainty is None else value.uncertainty for _, value in pairs])
    return KnownPoints(label, judges, marks, values, doubts, critical)


def _critical_points(case: Portrait, known: KnownValues, series: Along) -> Iterator[KnownPoints]:
    """Yield the known critical state, where both its mark and the value of the series there are known."""
    for there in (q for q in case.criticals if q.gives in series.quantities):
        for mark in (q for q in case.criticals if q.gives == "load"):
            at, value = known.judge(mark.name, case.theory), known.judge(there.name, case.theory)
            if at is not None and value is not None:
                yield _points("known critical state", True, [(at.value / mark.scale, value)], critical=True)
