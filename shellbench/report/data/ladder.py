"""Runs of one case ordered by resolution, solver by solver, and the run that all are compared with.

All runs of a case were asked at the same material points, their probes. A level holds the runs of one solver that are
marginally different discretisations of each other: meshes with a row of cells more, other diagonals, or other seeds.
Between levels the resolution differs in earnest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import kept_arrays
from shellbench.report.data.rates import Rate, fitted_rate
from shellbench.report.data.runs import groups_alike, in_study, seed_words, variant_name

Array = NDArray[np.float64]
Finer = Literal["unknowns", "time steps"]

SAME = 1e-6  # relative difference of marks, or of points in units of the largest coordinate, that are one
ALIKE = 1.15  # ratio of unknowns, or of time steps, up to which discretisations differ marginally
TIME_STEP = "time_step"  # the setting of a solver that is told its steps
FINER: tuple[Finer, Finer] = ("unknowns", "time steps")


@dataclass(frozen=True)
class Probes:
    """Displacements (j, m, 3), m, at material points (m, 2) and marks (j,); see `Record`."""

    points: Array
    marks: Array
    displacements: Array

    @property
    def largest(self) -> float:
        """Largest magnitude of the displacement, m."""
        return float(np.linalg.norm(self.displacements, axis=-1).max(initial=0.0))


@dataclass(frozen=True)
class Difference:
    """Difference of two runs at the same material points.

    Attributes
    ----------
    marks
        (j,) marks that both reached.
    by_mark
        (j,) largest magnitude over the points, m.
    rms
        Root of the mean square of the magnitude over points and marks, m.
    """

    marks: Array
    by_mark: Array
    rms: float

    @property
    def largest(self) -> float:
        """Largest magnitude over points and marks, m."""
        return float(self.by_mark.max())


def read_probes(record: Record, folder: Path) -> Probes | None:
    """Return a run's displacements at its probes; None if they are absent, damaged or not finite."""
    kept = kept_arrays(record, folder, "probes", "probe_marks", "probe")
    if kept is None:
        return None
    probes = Probes(*kept)
    whole = probes.displacements.size and probes.displacements.shape == (len(probes.marks), len(probes.points), 3)
    return probes if whole else None


def difference(ours: Probes | None, theirs: Probes | None) -> Difference | None:
    """Return the difference of two runs; None if they have no point or no mark in common."""
    if ours is None or theirs is None or ours.points.shape != theirs.points.shape:
        return None
    if not np.allclose(ours.points, theirs.points, rtol=0.0, atol=SAME * np.abs(theirs.points).max()):
        return None
    extent = np.abs(theirs.marks).max()
    near = np.abs(ours.marks[:, None] - theirs.marks) <= SAME * max(extent, SAME)
    i, j = np.nonzero(near)
    if not len(i):
        return None
    apart = np.linalg.norm(ours.displacements[i] - theirs.displacements[j], axis=-1)
    return Difference(theirs.marks[j], apart.max(axis=1), float(np.sqrt(np.mean(apart**2))))


@dataclass(frozen=True, eq=False)
class Run:
    """One run that came to its end.

    Attributes
    ----------
    time_steps
        Of a motion, its steps; 0 where nothing moves. Of a solver that chooses them itself in every run, the most of
        all runs: then they are no resolution that was asked for.
    probes
        None if it kept none.
    """

    row: Row
    record: Record
    time_steps: int
    probes: Probes | None

    @property
    def unknowns(self) -> int:
        """Number of unknowns that were solved for or trained."""
        return self.record.parameters or 0

    @property
    def name(self) -> str:
        """Settings that depart from the solver's defaults, and the seed."""
        return f"{variant_name(self.row) or 'default settings'}{seed_words(self.row.seed)}"

    @property
    def largest(self) -> float:
        """Largest displacement that it is known to have anywhere, m."""
        seen = max((step.largest_displacement for step in self.record.resolution), default=0.0)
        return max(seen, self.probes.largest if self.probes is not None else 0.0)

    def difference(self, other: Run) -> Difference | None:
        """Return the difference from another run at the same material points."""
        return difference(self.probes, other.probes)


@dataclass(frozen=True)
class Ladder:
    """The runs of one solver on one case, from coarse to fine in levels."""

    solver: str
    levels: tuple[tuple[Run, ...], ...]

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """All runs, from coarse to fine."""
        return tuple(run for level in self.levels for run in level)

    @cached_property
    def finest(self) -> Run:
        """The run that stands for the finest level: most unknowns, and of these most time steps."""
        return leader(self.levels[-1])

    @cached_property
    def line(self) -> tuple[Run, ...]:
        """The runs that stand for the levels which have the finest run's time steps, from coarse to fine."""
        leaders = map(leader, self.levels)
        return tuple(run for run in leaders if _about_equal(run.time_steps, self.finest.time_steps))

    @cached_property
    def other_time_steps(self) -> tuple[Run, ...]:
        """The runs that stand for the other levels."""
        return tuple(run for run in map(leader, self.levels) if run not in self.line)

    def steps(self, finer: Finer) -> list[tuple[Run, Run]]:
        """Return pairs of runs of one seed, where possible, at successive levels of the one or the other resolution."""
        pairs: list[tuple[Run, Run]] = []
        for place, level in enumerate(self.levels):
            below = [other for other in self.levels[:place] if _coarser_in_one(leader(other), leader(level), finer)]
            if below:
                fine = leader(level)
                of_seed = [run for run in below[-1] if run.row.seed == fine.row.seed]
                pairs.append((leader(of_seed or below[-1]), fine))
        return pairs

    def last_step(self, finer: Finer) -> tuple[Run, Run] | None:
        """Return the finest pair of runs at successive levels; None if there is none."""
        return self.steps(finer)[-1] if self.steps(finer) else None

    def change(self) -> Difference | None:
        """Return the larger difference of the last step in unknowns and the last step in time."""
        pairs = [pair for finer in FINER if (pair := self.last_step(finer)) is not None]
        found = [change for coarse, fine in pairs if (change := fine.difference(coarse)) is not None]
        return max(found, key=lambda change: change.largest, default=None)


@dataclass(frozen=True)
class CaseRuns:
    """All runs of one case that can be compared.

    Attributes
    ----------
    failed
        Number of runs of the study that did not come to an end, by solver.
    """

    case: str
    title: str
    moves: bool
    ladders: tuple[Ladder, ...]
    failed: dict[str, int]

    @cached_property
    def yardstick(self) -> Run | None:
        """The run that solvers are compared with: of their finest, the one with the smallest uncertainty.

        Doubt is the larger of the headline's error, at least what is known of it, and of the whole field's change from
        the resolution before, both relative: a headline can be right by luck. A run that has no resolution before comes
        last; of equals, a run without a seed comes first, then one with more unknowns. Without a known value it is the
        run without a seed that changed least.
        """
        finest = {id(ladder.finest): ladder for ladder in self.ladders if ladder.finest.probes is not None}
        runs = [ladder.finest for ladder in finest.values()]

        def changed(run: Run) -> float:
            change = finest[id(run)].change()
            return math.inf if change is None else change.largest

        def doubtful(run: Run, error: float) -> tuple[bool, float]:
            size, change = run.largest or 1.0, changed(run)
            relative = error if run.row.relative_error is not None else error / size
            return math.isinf(change), relative if math.isinf(change) else max(relative, change / size)

        judged = [(doubtful(run, error), run) for run in runs if (error := _error(run.row)) is not None]
        if judged:
            return min(judged, key=lambda one: (one[0], one[1].row.seed is not None, -one[1].unknowns))[1]
        certain = [run for run in runs if run.row.seed is None] or runs
        return min(certain, key=lambda run: (changed(run), -run.unknowns), default=None)

    def line(self, ladder: Ladder, run: Run | None = None) -> dict[str, Any]:
        """Return the first cells of a table's line: the case, a solver and one of its runs."""
        said = {"block": self.title, "case": self.case, "solver": ladder.solver}
        return said if run is None else said | {"run": run.name, "run_id": run.record.run_id}

    @property
    def judged(self) -> bool:
        """True if the yardstick was chosen by its error, and not because a known value is lacking."""
        return self.yardstick is not None and _error(self.yardstick.row) is not None

    @cached_property
    def scale(self) -> float | None:
        """The largest displacement of the yardstick, m; None if there is no yardstick, or nothing moved."""
        return (self.yardstick.largest or None) if self.yardstick is not None else None

    @cached_property
    def doubt(self) -> float | None:
        """Uncertainty of the yardstick, m; None if it can't be estimated.

        This is its change from the next lower resolution, or else its smallest difference from another solver.
        """
        for ladder in self.ladders:
            if ladder.finest is self.yardstick and (change := ladder.change()) is not None:
                return change.largest
        others = [
            found.largest
            for ladder in self.ladders
            if self.yardstick is not None
            and ladder.finest is not self.yardstick
            and (found := self.yardstick.difference(ladder.finest)) is not None
        ]
        return min(others, default=None)


def leader(level: Sequence[Run]) -> Run:
    """Return the run that stands for a level: fewest unknowns, time steps and changed settings, the lowest seed."""
    return min(level, key=lambda run: (run.unknowns, run.time_steps, len(run.row.overrides), run.row.seed or 0))


def step_difference(step: tuple[Run, Run] | None) -> Difference | None:
    """Return the difference between the two runs of a step."""
    return None if step is None else step[1].difference(step[0])


def spread_of(level: Sequence[Run]) -> tuple[float, float] | None:
    """Return the largest, and the root mean square, of the differences between any two runs of a level, m."""
    found = [d for i, one in enumerate(level) for other in level[:i] if (d := one.difference(other)) is not None]
    if not found:
        return None
    return max(d.largest for d in found), float(np.sqrt(np.mean([d.rms**2 for d in found])))


def order_of(case: CaseRuns, ladder: Ladder) -> Rate | None:
    """Return the fitted power law of the largest relative difference from the solver's finest run.

    Runs no farther from it than twice its own last step are left out: they owe their small difference to their
    nearness, not to their resolution.
    """
    last = step_difference(ladder.last_step("unknowns"))
    if last is None or not case.scale:
        return None
    pairs = to_finest(ladder.line, ladder.finest)
    errors = [found.largest / case.scale for _, found in pairs]
    return fitted_rate([float(x) for x, _ in pairs], errors, last.largest / case.scale)


def to_finest(runs: Sequence[Run], finest: Run) -> list[tuple[int, Difference]]:
    """Return unknowns of the runs, and how far they are from the finest."""
    found = [(run.unknowns, run.difference(finest)) for run in runs if run is not finest]
    return [(unknowns, one) for unknowns, one in found if one is not None]


def drift(run: Run, finest: Run, quantity: str) -> float | None:
    """Return a quantity less that of the finest run, relative to the latter; None if one is missing or that is zero."""
    ours, theirs = run.record.values.get(quantity), finest.record.values.get(quantity)
    if ours is None or theirs is None or not theirs.value:
        return None
    return (ours.value - theirs.value) / abs(theirs.value)


def case_runs(evidence: Evidence) -> list[CaseRuns]:
    """Return the runs of each case with default settings, and those of studies of the resolution."""
    headline = evidence.runs[evidence.runs["primary"]]
    chosen = headline[headline["leading"] | in_study(headline, "resolution")]
    found = []
    for (case, _), of_case in chosen.groupby(["case", "own_case"], sort=False):
        solvers = of_case.groupby("solver", sort=False)
        ladders = [Ladder(str(solver), _levels(runs)) for solver, one in solvers if (runs := _runs(one, evidence))]
        lost = of_case["status"].isin(("failed", "timeout")).groupby(of_case["solver"], sort=False).sum()
        if ladders:
            moves = any(run.time_steps for ladder in ladders for run in ladder.runs)
            failed = {str(solver): int(count) for solver, count in lost.items() if count}
            found.append(CaseRuns(case, of_case["title"].iloc[0], moves, tuple(ladders), failed))
    return found


def _runs(of_solver: pd.DataFrame, evidence: Evidence) -> list[Run]:
    """Return the runs of a solver that came to their end, each once."""
    ended = of_solver.drop_duplicates("run_id").dropna(subset="record")
    runs = [
        Run(one.row, one.record, _time_steps(one.record), read_probes(one.record, evidence.folder))
        for one in ended.itertuples()
        if one.record.status == "ok" and one.record.parameters
    ]
    if not any(TIME_STEP in row.overrides for row in of_solver["row"]):
        most = max((run.time_steps for run in runs), default=0)
        runs = [replace(run, time_steps=most) for run in runs]
    return runs


def _time_steps(record: Record) -> int:
    """Return the steps of the last passage through time: a solver that refines goes through it several times."""
    steps, upto = 0, math.inf
    for step in reversed([step for step in record.history if step.phase == "time"]):
        if step.at >= upto:
            break
        steps, upto = steps + 1, step.at
    return steps


def _levels(runs: Sequence[Run]) -> tuple[tuple[Run, ...], ...]:
    ordered = sorted(runs, key=lambda run: (run.unknowns, run.time_steps, run.row.seed or 0))
    return tuple(
        level
        for like in groups_alike(ordered, lambda run: run.unknowns, ALIKE)
        for level in groups_alike(sorted(like, key=lambda run: run.time_steps), lambda run: run.time_steps, ALIKE)
    )


def _coarser_in_one(coarse: Run, fine: Run, finer: Finer) -> bool:
    """Tell whether a run is coarser than another in one way, and alike in the other."""
    if finer == "unknowns":
        return fine.unknowns > ALIKE * coarse.unknowns and _about_equal(coarse.time_steps, fine.time_steps)
    return fine.time_steps > ALIKE * coarse.time_steps and _about_equal(coarse.unknowns, fine.unknowns)


def _about_equal(one: int, other: int) -> bool:
    return max(one, other) <= ALIKE * min(one, other)


def _error(row: Row) -> float | None:
    """Return the error of the headline, relative or, where it is judged so, absolute; at least what is known of it."""
    doubt = row.reference_uncertainty or 0.0
    if row.relative_error is not None:
        return max(abs(row.relative_error), doubt / abs(row.reference) if row.reference else 0.0)
    return None if row.absolute_error is None else max(abs(row.absolute_error), doubt)
