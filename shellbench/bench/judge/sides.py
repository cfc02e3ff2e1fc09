"""The sides of a comparison: the runs of a store or a pack, or of a solver or a commit in a store.

Runs of every state of their solver's code count, because a comparison shows the effect of changed code. Both sides are
compared with today's known values. A run whose case has changed since is therefore left out.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import asked_cases, rows_of
from shellbench.bench.judge.row import Row, in_suites
from shellbench.bench.store.current import CurrentRuns, current_runs
from shellbench.bench.store.pack import SUFFIX, read_pack
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Contents, Store
from shellbench.errors import InputError
from shellbench.protocol.spelling import did_you_mean

What = Literal["store", "pack", "solver", "commit"]
COMMIT = re.compile(r"[0-9a-f]{4,40}")
PATIENCE = 10.0  # seconds for git to answer
SHOWN = 8  # letters of a commit


@dataclass(frozen=True)
class Scope:
    """Scope of a comparison: names of cases (or paths), suites and solvers; an empty field includes all."""

    cases: tuple[str, ...] = ()
    suites: tuple[str, ...] = ()
    solvers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Side:
    """One side.

    Attributes
    ----------
    name
        Name for readers: a folder, a pack, a solver, or the beginning of a commit.
    rows
        A row for each figure of each run.
    records
        The runs by their name.
    notes
        One sentence for each omission.
    """

    name: str
    what: What
    rows: tuple[Row, ...]
    records: Mapping[str, Record]
    notes: tuple[str, ...] = ()


def read_sides(one: str, other: str, store: Store, scope: Scope) -> tuple[Side, Side]:
    """Return the two sides that were named.

    A name is a solver's that has runs in `store`, a folder of records, a pack, or a commit: its first digits, or what
    git calls it in the folder that the command was given in.

    Raises
    ------
    InputError
        If a name is unknown or has no runs in the scope, or if a solver is compared with a store, pack or commit.
    """
    kinds = [_kind(name, store) for name in (one, other)]
    if ("solver" in kinds) and kinds != ["solver", "solver"]:
        at = kinds.index("solver")
        raise InputError(
            f"'{(one, other)[at]}' is a solver and '{(one, other)[1 - at]}' a {kinds[1 - at]}: compare two solvers of"
            " one store, or two stores or commits (a folder of that name is ./NAME)"
        )
    return read_side(one, store, scope), read_side(other, store, scope)


def read_side(name: str, store: Store, scope: Scope) -> Side:
    """Return one side; see `read_sides`."""
    wanted = asked_cases(scope.cases, scope.suites)
    for suite in scope.suites:
        catalog.find_suite(suite)
    return _side(name, _kind(name, store), store, scope, wanted)


def _kind(name: str, store: Store) -> What:
    """Return the kind of thing that a name refers to; InputError if the name has no runs."""
    bare = os.sep not in name and not name.startswith(".")
    contents = store.read() if bare else Contents(())
    solvers = sorted({record.identity.solver for record in contents.records})
    if name in solvers:
        return "solver"
    if Path(name).is_dir():
        return "store"
    if name.endswith(SUFFIX) and Path(name).is_file():
        return "pack"
    if not bare:
        raise InputError(f"store {name}: is not there")
    if _commit(name, contents) is not None:
        return "commit"
    commits = sorted({(record.environment.git_sha or "")[:SHOWN] for record in contents.records} - {""})
    known = [f"{words} {', '.join(names)}" for words, names in (("solvers", solvers), ("commits", commits)) if names]
    has = f"has {' and '.join(known)}" if known else "has no runs"
    hint = did_you_mean(name, [*solvers, *commits])
    raise InputError(f"'{name}' is no folder, and store {store.folder} has no runs of it{hint}: the store {has}")


def _commit(name: str, contents: Contents) -> str | None:
    """Return the commit of a name, if a run of the store was made by it."""
    made = {record.environment.git_sha for record in contents.records if record.environment.git_sha}
    found = {sha for sha in made if COMMIT.fullmatch(name) and sha.startswith(name)}
    if not found and made and (sha := _ask_git(name)) in made:
        return sha
    if len(found) > 1:
        raise InputError(f"commit '{name}' is {len(found)} commits that have runs: give more of its digits")
    return next(iter(found), None)


def _ask_git(name: str) -> str | None:
    command = ("git", "rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@dataclass(frozen=True)
class _Packed:
    """A pack, read as a store is."""

    path: Path

    def read(self) -> Contents:
        return Contents(read_pack(self.path).records)


def _side(name: str, what: What, store: Store, scope: Scope, wanted: set[tuple[str, bool]]) -> Side:
    path = Path(name)
    sources: dict[str, Store | _Packed] = {"store": Store(path), "pack": _Packed(path)}
    contents = sources.get(what, store).read()
    label, notes = name, list(contents.damaged)
    if what == "commit":
        sha = _commit(name, contents)
        records = tuple(record for record in contents.records if record.environment.git_sha == sha)
        contents, label = Contents(records), (sha or name)[:SHOWN]
        if dirty := sum(bool(record.environment.git_dirty) for record in records):
            notes.append(f"{label}: {_runs(dirty)} made with changes that are in no commit")
    found = current_runs(contents, any_code=True)
    notes += [f"{label}: {_runs(count)} left out: {why}" for why, count in sorted(_reasons(found).items())]
    solvers = (name,) if what == "solver" else scope.solvers
    kept = tuple(run for run in found.runs if not solvers or run.record.identity.solver in solvers)
    rows = in_suites(rows_of(replace(found, runs=kept)), scope.suites)
    rows = [row for row in rows if row.value is not None or not row.stated]  # a value that was not stated is no loss
    if scope.cases:
        rows = [row for row in rows if (row.case, row.own_case) in wanted]
    if what == "solver":
        others = len({row.run_id for row in rows if not row.default_settings})
        notes += [f"{label}: {_runs(others)} left out: settings are not the defaults"] if others else []
        rows = [row for row in rows if row.default_settings]
    if not rows:
        where = f"{what} {name}" if what in {"store", "pack"} else f"store {store.folder}"
        of = "" if what in {"store", "pack"} else f" of {what} '{name}'"
        raise InputError(f"{where}: holds no runs{of} that can be compared{f' ({notes[0]})' if notes else ''}")
    named = {row.run_id for row in rows}
    records_of = {run.record.run_id: run.record for run in kept if run.record.run_id in named}
    return Side(label, what, tuple(rows), records_of, tuple(notes))


def _reasons(found: CurrentRuns) -> Counter[str]:
    return Counter(reason for _, reason in found.stale.values())


def _runs(count: int) -> str:
    return "1 run is" if count == 1 else f"{count} runs are"
