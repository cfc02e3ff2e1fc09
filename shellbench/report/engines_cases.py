"""The cross-check of solvers: on each case, what every sweep of every solver comes to at its finest.

Seconds are set against each other where one command took them in one environment, on one core.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from statistics import fmean

from shellbench.bench import catalog
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.suite import Study, value_words
from shellbench.engine import ENGINE
from shellbench.report.accuracy import Family, Point, failed_runs, point_of
from shellbench.report.solutions import grouped, heading, same_but_for_seed
from shellbench.report.suites import rows_of_study, study_of
from shellbench.report.yardstick import Yardstick, yardstick_of

STUDY: Study = "engines"
TOGETHER = 60.0  # seconds between runs that one command planned: a plan of hundreds of runs takes a few
Size = tuple[Point, Sequence[Row]]


@dataclass(frozen=True)
class Contender:
    """One solver with one choice of settings, over all sizes that it ran with.

    Attributes
    ----------
    variant
        Its settings that depart from the defaults, the swept one left out, in words; empty if none does.
    finest, rows
        The finest run that ended well, and its rows, one for each seed; None if no run did.
    engine
        Name and version of what the solver stands on; empty if it stands on none.
    """

    family: Family
    variant: str
    finest: Point | None
    rows: Sequence[Row]
    engine: str

    @property
    def solver(self) -> str:
        """Name of the solver."""
        return self.family.solver

    @property
    def name(self) -> str:
        """The solver and its settings, as a line of a table."""
        return f"{self.solver}, {self.variant}" if self.variant else self.solver

    def mean(self, name: str) -> float | None:
        """Return a number of the finest run, the mean of its seeds; None if one of them states none."""
        values = [getattr(row, name) for row in self.rows]
        return fmean(values) if values and None not in values else None

    @property
    def alone(self) -> bool:
        """Whether there is no second size that could confirm a size."""
        return len(self.family.points) == 1


@dataclass(frozen=True)
class CheckedCase:
    """One case with all who answered it.

    Attributes
    ----------
    heading
        Case, quantity and unit in words.
    known
        A row that carries the known value.
    base
        The solver to which the others are related: the first that the suite declares; empty if it did not answer.
    contenders
        Those of `base` first, then by name.
    failed
        By solver, in a clause each, the runs that did not end well.
    incomparable
        Why there are no ratios of seconds, as the end of a sentence; None if there are.
    """

    case: str
    title: str
    heading: str
    known: Row
    yardstick: Yardstick
    base: str
    contenders: tuple[Contender, ...]
    failed: Mapping[str, Sequence[str]]
    incomparable: str | None

    @property
    def base_value(self) -> float | None:
        """Value of the finest run of the solver to which the others are related."""
        ours = [one for one in self.contenders if one.solver == self.base and one.finest is not None]
        finest = max(ours, key=lambda one: one.finest.unknowns if one.finest else 0, default=None)
        return finest.mean("value") if finest else None

    def least(self, level: float, contender: Contender) -> float | None:
        """Return the least seconds within a level by the strict rule of `Family.cheapest`."""
        found = contender.family.cheapest(level, self.yardstick.floor, "seconds")
        return found[0] if found else None

    def ratio(self, level: float, contender: Contender) -> float | None:
        """Return these seconds over the least of the solver to which others are related; None if incomparable."""
        least = self.least(level, contender)
        ours = [s for one in self.contenders if one.solver == self.base and (s := self.least(level, one)) is not None]
        return least / min(ours) if least is not None and ours and not self.incomparable else None


def checked_cases(records: Mapping[str, Record], rows: Sequence[Row]) -> list[CheckedCase]:
    """Return the cross-check of each case that a suite of the study declares, in the suites' order."""
    headline = [row for row in rows_of_study(rows, STUDY) if row.primary and not row.own_case]
    suites = dict.fromkeys(suite for row in headline for suite in row.suites if study_of(suite) == STUDY)
    order = {case: i for i, case in enumerate(case for suite in suites for case in catalog.find_suite(suite).order)}
    headline = sorted(headline, key=lambda row: order.get(row.case, len(order)))
    found = (_checked(records, of_case) for of_case in grouped(headline, lambda row: row.case).values())
    return [one for one in found if one is not None]


def is_cross_check(cases: Sequence[CheckedCase]) -> bool:
    """Tell whether there is more than one solver: one alone checks nothing."""
    return len({one.solver for case in cases for one in case.contenders}) > 1


def _checked(records: Mapping[str, Record], rows: Sequence[Row]) -> CheckedCase | None:
    yardstick = yardstick_of(records, rows)
    contenders = _contenders(rows, yardstick) if yardstick is not None else []
    if yardstick is None or not contenders:
        return None
    declared = _first_declared(rows)
    base = declared if any(one.solver == declared for one in contenders) else ""
    timed = [record for row in rows if (record := records.get(row.run_id or "")) is not None]
    return CheckedCase(
        case=rows[0].case,
        title=rows[0].case_title or rows[0].case,
        heading=heading(rows[0]),
        known=rows[0],
        yardstick=yardstick,
        base=base,
        contenders=tuple(sorted(contenders, key=lambda one: (one.solver != base, one.solver, one.variant))),
        failed=failed_runs(rows),
        incomparable=why_incomparable(timed),
    )


def _first_declared(rows: Sequence[Row]) -> str:
    suites = (suite for row in rows for suite in row.suites if study_of(suite) == STUDY)
    return next((run.solver for suite in suites for run in catalog.find_suite(suite).runs), "")


def _contenders(rows: Sequence[Row], yardstick: Yardstick) -> list[Contender]:
    """Put runs of one solver that differ in one swept setting alone together, default settings among them."""
    sizes: dict[tuple[str, str, str], list[Size]] = {}
    for alike in grouped(rows, same_but_for_seed).values():
        point = point_of(alike, yardstick)
        if point is not None:
            swept = _swept(alike[0])
            sizes.setdefault((alike[0].solver, _variant(alike[0], swept), swept), []).append((point, alike))
    for solver, variant, swept in list(sizes):
        siblings = [key for key in sizes if key[:2] == (solver, variant) and key[2]]
        if not swept and siblings:  # a run with defaults is one size of a sweep that changes nothing else
            sizes[max(siblings, key=lambda key: len(sizes[key]))] += sizes.pop((solver, variant, swept))
    return [_contender(*key, found) for key, found in sizes.items()]


def _swept(row: Row) -> str:
    """Return the setting over which a suite swept to make a run, which may have its default there; empty if none."""
    named = row.label.rpartition(", ")[2].partition(" ")[0]
    return named if named in row.settings else ""


def _variant(row: Row, swept: str) -> str:
    """Return the settings beside the swept one; a suite's own words will not do, for suites may share a run."""
    fixed = {key: value for key, value in row.overrides.items() if key != swept}
    return ", ".join(f"{key} {value_words(value)}" for key, value in sorted(fixed.items()))


def _contender(solver: str, variant: str, swept: str, sizes: Sequence[Size]) -> Contender:
    ordered = sorted(sizes, key=lambda size: (size[0].unknowns, size[0].seconds))
    none: tuple[None, Sequence[Row]] = (None, ())
    finest, rows = next(((point, alike) for point, alike in reversed(ordered) if point.sound), none)
    engines = dict.fromkeys(
        str(engine) for _, alike in ordered for row in alike if (engine := row.settings.get(ENGINE)) is not None
    )
    return Contender(
        family=Family(solver, swept, tuple(point for point, _ in ordered)),
        variant=variant,
        finest=finest,
        rows=rows,
        engine=", ".join(engines),
    )


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
