"""The cross-check of solvers: on each case, what every sweep of every solver comes to at its finest.

Seconds are set against each other where one command took them in one environment, on one core.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise

import pandas as pd

from shellbench.bench import catalog
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.suite import Study, value_words
from shellbench.report.accuracy import AnsweredCase, Family, Point, failed_runs, family, sizes
from shellbench.report.evidence import Evidence
from shellbench.report.rates import yardstick_of
from shellbench.report.runs import headlines
from shellbench.report.suites import study_of

STUDY: Study = "engines"
TOGETHER = 60.0  # seconds between runs that one command planned: a plan of hundreds of runs takes a few


@dataclass(frozen=True)
class CheckedCase(AnsweredCase):
    """One case with all who answered it, a family for each choice of a solver's settings.

    Attributes
    ----------
    base
        The solver to which the others are related: the first that the suite declares; empty if it did not answer. Its
        families come first, then the others by name.
    incomparable
        Why there are no ratios of seconds, as the end of a sentence; None if there are.
    """

    base: str
    incomparable: str | None

    @property
    def base_value(self) -> float | None:
        """Value of the finest run of the solver to which the others are related."""
        ours = [one for one in self.families if one.solver == self.base and one.finest is not None]
        finest = max(ours, key=lambda one: one.finest.unknowns if one.finest else 0, default=None)
        return finest.mean("value") if finest else None

    def least(self, level: float, one: Family) -> float | None:
        """Return the least seconds within a level by the strict rule of `Family.cheapest`."""
        found = one.cheapest(level, self.yardstick.floor, "seconds")
        return found[0] if found else None

    def ratio(self, level: float, one: Family) -> float | None:
        """Return these seconds over the least of the solver to which others are related; None if incomparable."""
        least = self.least(level, one)
        ours = [s for each in self.families if each.solver == self.base and (s := self.least(level, each)) is not None]
        return least / min(ours) if least is not None and ours and not self.incomparable else None


def checked_cases(evidence: Evidence) -> list[CheckedCase]:
    """Return the cross-check of each case that a suite of the study declares, in the suites' order."""
    runs = headlines(evidence.runs, STUDY)
    suites = dict.fromkeys(suite for row in runs["row"] for suite in row.suites if study_of(suite) == STUDY)
    order = {case: i for i, case in enumerate(case for suite in suites for case in catalog.find_suite(suite).order)}
    runs = runs.sort_values("case", key=lambda cases: cases.map(order).fillna(len(order)), kind="stable")
    cases = (_checked(of_case, evidence) for _, of_case in runs.groupby("case", sort=False))
    return [one for one in cases if one is not None]


def is_cross_check(cases: Sequence[CheckedCase]) -> bool:
    """Tell whether there is more than one solver: one alone checks nothing."""
    return len({one.solver for case in cases for one in case.families}) > 1


def _checked(runs: pd.DataFrame, evidence: Evidence) -> CheckedCase | None:
    rows = list(runs["row"])
    yardstick = yardstick_of(evidence.records, rows)
    families = _families(sizes(runs, yardstick))
    if yardstick is None or not families:
        return None
    suites = (suite for row in rows for suite in row.suites if study_of(suite) == STUDY)
    declared = next((run.solver for suite in suites for run in catalog.find_suite(suite).runs), "")
    base = declared if any(one.solver == declared for one in families) else ""
    return CheckedCase(
        first=rows[0],
        yardstick=yardstick,
        families=tuple(sorted(families, key=lambda one: (one.solver != base, one.solver, one.variant))),
        failed=failed_runs(rows),
        base=base,
        incomparable=why_incomparable(list(runs["record"].dropna())),
    )


def _families(points: Sequence[Point]) -> list[Family]:
    """Put runs of one solver that differ in one swept setting alone together, default settings among them."""
    found: dict[tuple[str, str, str], list[Point]] = {}
    for point in points:
        row = point.rows[0]
        swept = _swept(row)
        found.setdefault((row.solver, _variant(row, swept), swept), []).append(point)
    for solver, variant, swept in list(found):
        siblings = [key for key in found if key[:2] == (solver, variant) and key[2]]
        if not swept and siblings:  # a run with defaults is one size of a sweep that changes nothing else
            found[max(siblings, key=lambda key: len(found[key]))] += found.pop((solver, variant, swept))
    return [family(solver, swept, of_family, variant) for (solver, variant, swept), of_family in found.items()]


def _swept(row: Row) -> str:
    """Return the setting over which a suite swept to make a run, which may have its default there; empty if none."""
    named = row.label.rpartition(", ")[2].partition(" ")[0]
    return named if named in row.settings else ""


def _variant(row: Row, swept: str) -> str:
    """Return the settings beside the swept one; a suite's own words will not do, for suites may share a run."""
    fixed = {key: value for key, value in row.overrides.items() if key != swept}
    return ", ".join(f"{key} {value_words(value)}" for key, value in sorted(fixed.items()))


def why_incomparable(records: Sequence[Record]) -> str | None:
    """Say why ratios of the runs' seconds would mislead, as the end of a sentence; None if they would not.

    A record carries the time at which its run was planned; all runs of one command are planned together. It does not
    say how many runs the command made at a time, nor what else the machine did.
    """
    found = [record.environment for record in records]
    machines = dict.fromkeys(f"{one.processor}, {one.cores} cores, {one.platform}" for one in found)
    threads, versions = sorted({one.threads for one in found}), sorted({one.python for one in found})
    if len(machines) > 1:
        return f"they were taken on different machines ({'; '.join(machines)})"
    if len({one.gpu for one in found}) > 1 or len({record.identity.device for record in records}) > 1:
        return "some were taken on a GPU and some were not"
    if threads not in ([], [1]):
        return f"they were taken with {' and '.join(map(str, threads))} threads, not with one"
    if len(versions) > 1:
        return f"they were taken by different versions of Python ({', '.join(versions)})"
    named: dict[str, str] = {}  # not all runs name an engine or a plug-in
    for package, version in (item for one in found for item in one.versions.items()):
        if named.setdefault(package, version) != version:
            return f"they were taken with different versions of {package}"
    commands = planned_apart(records)
    if len(commands) > 1:
        return f"they were taken by {len(commands)} commands, planned at {' and '.join(commands)}"
    return None


def planned_apart(records: Sequence[Record]) -> list[str]:
    """Return when each command planned its first of the runs, to the second."""
    times = sorted(datetime.fromisoformat(created) for created in {record.created for record in records})
    later = [after for before, after in pairwise(times) if (after - before).total_seconds() > TOGETHER]
    return [time.strftime("%Y-%m-%d %H:%M:%S") for time in (*times[:1], *later)]
