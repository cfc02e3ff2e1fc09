"""Validity of records: a record counts if today's case, solver and settings would make it again and it is the newest.

Three keys distinguish runs:

- `run_key`: runs with equal keys replace each other, and the newest of them counts.
- `question`: a case, solver, settings and seed, independent of the code. An answer to it completes a plan.
- `is_answer`: decides which runs satisfy a line of a suite.

If a solver is not installed, changes of its source can't be detected. Its records are shown unchanged, so that tables
and figures can be made on any machine, but no gate accepts them. The same holds for a solver on an engine
(`shellbench.protocol.engine`) that is not installed.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.suite import SuiteRun
from shellbench.bench.plugins.kinds import kind_name, problem_of
from shellbench.bench.plugins.registry import solver_entries
from shellbench.bench.plugins.settings import difference, with_overrides
from shellbench.bench.store.environment import engine_distribution
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Contents
from shellbench.bench.store.task import Task
from shellbench.errors import InputError, PluginError
from shellbench.problem import Problem
from shellbench.protocol.engine import ENGINE, engine_version

UNSEALED = "it has no checksum, so nothing tells whether it was edited"


def run_key(run: Task | Record) -> str:
    """Return text that is equal for runs that can replace each other: the same identity under the same name."""
    return json.dumps([run.case_name, run.own_case, run.identity.model_dump(mode="json")], sort_keys=True)


def question(run: Task | Record) -> str:
    """Return text that is equal for runs of the same case, solver, settings and seed, with any code."""
    identity = run.identity
    return json.dumps([run.case_name, run.own_case, identity.solver, overrides_of(run), identity.seed], sort_keys=True)


def overrides_of(run: Task | Record) -> dict[str, Any]:
    """Return the settings of a run that differ from the defaults that its solver had then."""
    return difference(run.defaults, run.identity.settings)


def newest(contents: Contents) -> dict[str, Record]:
    """Return the newest record of each run that was made more than once, by `run_key`, oldest first."""
    # A dictionary keeps the place of an existing key. Removing it first moves the run to the end.
    latest: dict[str, Record] = {}
    for record in contents.records:
        key = run_key(record)
        latest.pop(key, None)
        latest[key] = record
    return latest


@dataclass(frozen=True)
class CurrentRun:
    """A valid record.

    Attributes
    ----------
    record
        The newest whole record of its identity.
    case
        Today's case.
    overrides
        Settings that differ from the defaults.
    declared_by
        Each suite that declares this run, with its name for it.
    installed
        True if the solver and its engine are installed, and are therefore known to be those of the record.
    """

    record: Record
    case: Problem
    overrides: Mapping[str, Any]
    declared_by: Mapping[str, str] = field(default_factory=dict)
    installed: bool = True

    @property
    def absent(self) -> str:
        """The solver or engine that is not installed, or that stated the values, in words."""
        identity = self.record.identity
        if self.record.stated is not None:
            return f"'{identity.solver}' was not computed here"
        engine = engine_distribution(identity.settings)
        if engine is not None and engine_version(engine) is None:
            return f"{engine}, the engine of solver '{identity.solver}', is not installed"
        return f"solver '{identity.solver}' is not installed"


@dataclass(frozen=True)
class CurrentRuns:
    """Valid records, and the reasons why the others are not.

    Attributes
    ----------
    runs
        Oldest first; one for each case, solver, settings and seed: among several devices the CPU's record counts.
    stale
        Records that are not valid, with the reason, by name.
    damaged
        One sentence for each file of the store that is no intact record.
    """

    runs: tuple[CurrentRun, ...]
    stale: Mapping[str, tuple[Record, str]]
    damaged: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each damaged file, each reason why records are not valid, and each remark on the others."""
        reasons = Counter(reason for _, reason in self.stale.values())
        counted = (f"{count} stored {_runs(count)} left out: {reason}" for reason, count in sorted(reasons.items()))
        absent = Counter(run.absent for run in self.runs if not run.installed)
        taken = (
            f"{name}: {count} stored {_runs(count)} shown as recorded, and no gate takes them"
            for name, count in sorted(absent.items())
        )
        return (*self.damaged, *counted, *taken)

    def narrowed(self, cases: Collection[tuple[str, bool]]) -> CurrentRuns:
        """Return the runs of some cases; each is its name, and whether it is a user's own."""
        runs = tuple(run for run in self.runs if (run.record.case_name, run.record.own_case) in cases)
        stale = {name: (r, why) for name, (r, why) in self.stale.items() if (r.case_name, r.own_case) in cases}
        return CurrentRuns(runs, stale, self.damaged)

    def find(
        self, case: str, solver: str, settings: Mapping[str, Any], seed: int, *, installed: bool = True
    ) -> CurrentRun | None:
        """Return the run of one of the suite's cases with these overrides and this seed, or without a seed.

        With `installed` the solver must be installed, so that the code of the record is known; gates require this.
        """
        for run in self.runs:
            identity = run.record.identity
            if (
                (run.case.name, identity.solver) == (case, solver)
                and not run.record.own_case
                and (run.installed or not installed)
                and identity.seed in {seed, None}
                and identity.settings == with_overrides(run.record.defaults, settings)
            ):
                return run
        return None

    def why_not(self, case: str, solver: str, seed: int) -> str | None:
        """Return the reason why the newest record of a case and solver does not count; None if there is none."""
        reasons = [
            reason
            for record, reason in self.stale.values()
            if (record.case_name, record.identity.solver) == (case, solver)
            and record.identity.seed in {seed, None}
            and not record.own_case
        ]
        return reasons[-1] if reasons else None


def current_runs(contents: Contents, *, any_code: bool = False) -> CurrentRuns:
    """Select the valid records.

    With `any_code` records of every state of their solver's code and engine are valid, so that states of the code can
    be compared. Among records that differ only in their code the newest is valid.
    """
    # A record is valid if it would be made again today. The first failing check is the reason:
    # 1. A store has sealed it.
    # 2. Its case can be read.
    # 3. The case has the same digest today: that of the suite, or the newest one of a user's own.
    # 4. The solver's code has the same digest, if it is installed.
    # 5. Its engine has the same version, if that is installed.
    # One valid record is used for each case, solver, settings and seed. It is the newest on a CPU, if there is
    # one.
    asked = {(record.identity.solver, kind_name(record.case)) for record in contents.records}
    sources = {} if any_code else _current_sources(asked)
    # A user's own case has no file to compare with: its newest record defines it.
    own_physics = {r.case_name: r.identity.case for r in contents.records if r.own_case}  # the newest one's
    stale: dict[str, tuple[Record, str]] = {}
    runs: dict[tuple[object, ...], CurrentRun] = {}
    for record in newest(contents).values():
        identity = record.identity
        stated = record.stated is not None
        if record.sequence is None:
            stale[record.run_id] = (record, UNSEALED)
            continue
        try:
            case = _todays_case(record)
        except (ValidationError, InputError, PluginError):
            stale[record.run_id] = (record, "its case can't be read any more")
            continue
        wanted = own_physics[record.case_name] if record.own_case else case.digest()
        # The second part detects a user's own case whose stored text does not belong to its digest.
        if identity.case != wanted or case.digest() != identity.case:
            stale[record.run_id] = (record, "the case has changed since")
        # The digest of a solver that is not installed is assumed to be the same.
        elif not stated and sources.get((identity.solver, case.kind), identity.source) != identity.source:
            stale[record.run_id] = (record, "the solver has changed since")
        elif not any_code and (changed := _changed_engine(identity.settings)) is not None:
            stale[record.run_id] = (record, changed)
        else:
            settings = overrides_of(record) if any_code else identity.settings  # older code may have had fewer
            key = (record.own_case, record.case_name, identity.solver, repr(settings), identity.seed)
            # An answer of another device is valid only if no CPU has answered.
            if key not in runs or runs[key].record.identity.device != "cpu" or identity.device == "cpu":
                installed = not stated and (identity.solver, case.kind) in sources
                installed = installed and not _lacks_engine(identity.settings)
                runs[key] = CurrentRun(record, case, overrides_of(record), declared_by(record, case), installed)
    return CurrentRuns(tuple(runs.values()), stale, contents.damaged)


def _runs(count: int) -> str:
    return "run is" if count == 1 else "runs are"


def _todays_case(record: Record | Task) -> Problem:
    if not record.own_case and catalog.has_case(record.case_name):
        return catalog.named_case(record.case_name)
    return problem_of(record.case)


def _current_sources(asked: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Return the digests of the sources by name of solver and kind; only for installed ones."""
    entries = solver_entries()
    sources: dict[tuple[str, str], str] = {}
    for solver, kind in asked:
        try:
            sources[solver, kind] = current_source(entries[solver], kind)
        except (KeyError, InputError):  # not registered here, or its module is gone
            continue
    return sources


def _lacks_engine(settings: Mapping[str, Any]) -> bool:
    engine = engine_distribution(settings)
    return engine is not None and engine_version(engine) is None


def _changed_engine(settings: Mapping[str, Any]) -> str | None:
    """Return the difference between a record's engine and the installed one; None if they agree or one is unknown."""
    engine = engine_distribution(settings)
    installed = engine_version(engine) if engine is not None else None
    if engine is None or installed is None or installed == settings[ENGINE]:
        return None
    return f"its engine has changed since: {settings[ENGINE]}, now {installed.removeprefix(f'{engine} ')}"


def declared_by(run: Record | Task, case: Problem) -> dict[str, str]:
    """Return the suites that declare a run of a case, each with its name for the run."""
    known = () if run.own_case else catalog.suite_names()
    asked = {name: catalog.find_suite(name).runs_for(case.name) for name in case.suites if name in known}
    return {name: line.label for name, lines in asked.items() for line in lines if is_answer(run, line)}


def case_of_planned(task: Task) -> tuple[Problem, dict[str, str]] | None:
    """Return today's case of a planned run and the suites that declare it; None if it can't be read any more."""
    try:
        case = _todays_case(task)
    except (ValidationError, InputError, PluginError):
        return None
    return case, declared_by(task, case)


def is_answer(record: Record | Task, run: SuiteRun) -> bool:
    """Return True if a line of a suite declares the run of a record of the right case."""
    identity = record.identity
    return (
        identity.solver == run.solver
        and (identity.seed is None or identity.seed in run.seeds)
        and identity.settings == with_overrides(record.defaults, run.settings)
    )
