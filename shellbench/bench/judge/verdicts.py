"""Texts about the results of the gates, and about changes of a moved baseline."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from shellbench.bench.judge.baseline import Baseline
from shellbench.bench.judge.gate import Verdict
from shellbench.bench.judge.lock import LockCheck
from shellbench.bench.judge.row import Finding, Row

MARKS = {
    "red": "RED",
    "green": "ok",
    "expected failure": "expected failure",
    "not compared": "not compared",
    "not judged": "declined",
}


def as_text(
    verdict: Verdict, baseline: str, cost: bool = False, verbose: bool = False, regression: bool = False
) -> str:
    """Return the result of the gates as text: one line for each gate and for each row that is not green."""
    lines = [f"narrowed to {verdict.scope.narrowed}"] if verdict.scope.narrowed else []
    lines += _gate("accuracy", verdict.accuracy, verbose)
    if verdict.baseline:
        lines += _gate("regression", verdict.regression, verbose, judged=regression)
        lines += _gate("cost", verdict.cost, verbose, judged=cost)
    else:
        lines.append(f"regression, cost: not judged, for there is no baseline {baseline}")
    lines += _calibration(verdict, verbose)
    if verdict.claims:
        lines += _gate("claims", verdict.claims, verbose, judged=False, otherwise="not held")
    lines += [f"class: {grade}" for grade in verdict.grades]
    lines += _lock(verdict.lock)
    lines += [verdict.beyond] if verdict.beyond else []
    lines.append("every gate holds" if verdict.good(cost, regression) else "a gate fell short")
    return "\n".join(lines)


def in_short(verdict: Verdict) -> str:
    """Return the results of the accuracy gate and the lock, and the verdict."""
    lines = [*_gate("accuracy", verdict.accuracy, verbose=False), *_lock(verdict.lock)]
    return "\n".join([*lines, "every gate holds" if verdict.good() else "a gate fell short"])


def _gate(
    name: str, findings: Sequence[Finding], verbose: bool, judged: bool = True, otherwise: str = "changed"
) -> Iterator[str]:
    marks = MARKS if judged else MARKS | {"red": otherwise}  # reported rows without a verdict
    counts = {mark: sum(finding.colour == colour for finding in findings) for colour, mark in marks.items()}
    said = ", ".join(f"{count} {mark}" for mark, count in counts.items() if count) or "nothing to compare"
    yield f"{name}{'' if judged else ' (reported only)'}: {said}"
    shown = [f for f in findings if verbose or f.colour in {"red", "expected failure", "not judged"}]
    alike: dict[tuple[str, str, str, str], list[Row]] = {}
    for finding in sorted(shown, key=lambda f: list(marks).index(f.colour)):
        key = (marks[finding.colour], finding.row.case, finding.row.solver, finding.sentence)
        alike.setdefault(key, []).append(finding.row)
    for (mark, case, solver, sentence), rows in alike.items():
        yield f"  {mark:<4} {case} {solver}{_seeds(rows)} {_listed(row.quantity for row in rows)}: {sentence}"


def _calibration(verdict: Verdict, verbose: bool) -> Iterator[str]:
    if verdict.calibration:
        yield from _gate("calibration", verdict.calibration, verbose)
    yield from (f"calibration: {one}" for one in verdict.calibrations)


def _lock(lock: LockCheck) -> Iterator[str]:
    part = " of what is judged" if lock.part else ""
    exam = f"exam {lock.version or '?'}: {lock.cases} cases, {lock.figures} figures{part}"
    yield f"lock: {len(lock.broken)} RED of {exam}" if lock.broken else f"lock: {exam}, as locked"
    yield from (f"  RED  {words}" for words in lock.broken)
    if lock.unlocked:
        yield f"  not yet locked: {'; '.join(lock.unlocked)}"


def _seeds(rows: Sequence[Row]) -> str:
    seeds = [str(row.seed) for row in rows if row.seed is not None]
    return f" seed {_listed(seeds)}" if seeds else ""


def _listed(names: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(names))


def changes(old: Baseline | None, new: Baseline) -> str:
    """Return the differences of a new baseline from the old one as text."""
    known = {(v.case, v.solver, v.quantity, v.at): v for v in (old.values if old else ())}
    lines: list[str] = []
    for value in new.values:
        before = known.get((value.case, value.solver, value.quantity, value.at))
        name = f"{value.case} {value.solver} {value.quantity}"
        if before is None:
            lines.append(f"  new      {name}: {value.mean:.8g}")
        elif before.values != value.values:
            lines.append(
                f"  changed  {name}: {before.mean:.8g} -> {value.mean:.8g}{_relative(before.mean, value.mean)}"
            )
    return "\n".join(_headed(lines, len(new.values)))


def _relative(before: float, after: float) -> str:
    return f" ({(after - before) / abs(before):+.2e})" if before else ""


def _headed(lines: Iterable[str], total: int) -> Iterator[str]:
    listed = list(lines)
    yield f"{len(listed)} of {total} values change"
    yield from listed
