"""One solver over its versions: what each answered and took, and what every step from one to the next lost or gained.

A version is a store, a pack, or a commit that made runs in a store. Steps are comparisons as `shellbench compare` makes
them (`shellbench.bench.changes`), so that a loss is the same here and there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import Any

from shellbench.bench.changes import Answer, Comparison, Limits, compare_sides, same_figure
from shellbench.bench.row import Row
from shellbench.bench.sides import SHOWN, Scope, Side, commits_in, read_side
from shellbench.bench.store import Store
from shellbench.errors import InputError

APPEARED, GONE = "new", "gone"
DEFAULT = Limits()


@dataclass(frozen=True)
class Version:
    """One version.

    Attributes
    ----------
    name
        What a reader calls it, unlike that of any other.
    made_by
        Commits that made its runs, and the packages that are not of one version throughout the history.
    """

    name: str
    made_by: str
    side: Side


@dataclass(frozen=True)
class Entry:
    """What one version has of a figure.

    Attributes
    ----------
    seconds, memory_bytes
        Mean and largest of its runs; None where they did not end well or nothing was measured.
    verdict
        Of the step from the version before: "same", "loss", "gain" or "changed", `APPEARED`, `GONE`; empty of the first
        version, and where the two have asked different questions.
    """

    version: int
    answer: Answer | None
    seconds: float | None
    memory_bytes: int | None
    verdict: str


@dataclass(frozen=True)
class Figure:
    """One figure of one solver with its settings, over the versions that have it, and those that have lost it."""

    row: Row
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class History:
    """Versions, oldest first, the steps between them, and all figures."""

    versions: tuple[Version, ...]
    steps: tuple[Comparison, ...]
    figures: tuple[Figure, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for whatever is left out, or to know of a step."""
        return tuple(dict.fromkeys(note for step in self.steps for note in step.notes))


def read_history(names: Sequence[str], store: Store, scope: Scope, limits: Limits = DEFAULT) -> History:
    """Return the history of what is named, oldest first: folders of records, packs, or commits with runs in `store`.

    Without names it is that of all commits that made runs in `store`, in the order of their first runs.

    Raises
    ------
    InputError
        If there are fewer than two versions, a name is a solver's or none of these, or two versions that follow each
        other have no figure in common.
    """
    wanted = list(names) or [sha for sha, _ in commits_in(store.read())]
    if len(wanted) < 2:
        found = f"found {len(wanted)}" if names else f"store {store.folder} has runs of {len(wanted)}"
        raise InputError(f"a history needs two versions at least (stores, packs or commits), {found}")
    sides = [read_side(name, store, scope) for name in wanted]
    for name, side in zip(wanted, sides, strict=True):
        if side.what == "solver":
            raise InputError(f"'{name}' is a solver: name its stores, packs or commits, and give --solver {name}")
    steps = [compare_sides(old, new, limits) for old, new in pairwise(sides)]
    names_of_sides = _distinct([side.name for side in sides])
    made = [_packages(side) for side in sides]
    steady = {one for one in set().union(*made) if all(one in each for each in made)}
    versions = tuple(
        Version(name, _made_by(side, sorted(packages - steady)), side)
        for name, side, packages in zip(names_of_sides, sides, made, strict=True)
    )
    return History(versions, tuple(steps), tuple(_figures(sides, steps)))


def _distinct(names: Sequence[str]) -> list[str]:
    """Return the last part of each name, more of it where that is another's too."""
    ends = [Path(name).name or name for name in names]
    return [end if ends.count(end) == 1 else name for end, name in zip(ends, names, strict=True)]


def _packages(side: Side) -> set[tuple[str, str]]:
    return {item for record in side.records.values() for item in record.environment.versions.items()}


def _made_by(side: Side, packages: Sequence[tuple[str, str]]) -> str:
    commits = dict.fromkeys(
        f"{sha[:SHOWN]}{' and changes' if record.environment.git_dirty else ''}"
        for record in side.records.values()
        if (sha := record.environment.git_sha)
    )
    return ", ".join([*commits, *(f"{name} {version}" for name, version in packages)])


def _figures(sides: Sequence[Side], steps: Sequence[Comparison]) -> list[Figure]:
    # 1. The rows of each version by the figure that they are about, in the order in which figures first appear.
    # 2. What each step says of its figures.
    # 3. An entry for each version that has the figure, and for the first that has it no more.
    rows: dict[tuple[object, ...], dict[int, list[Row]]] = {}
    for place, side in enumerate(sides):
        for row in side.rows:
            rows.setdefault(same_figure(row), {}).setdefault(place, []).append(row)
    said = [{same_figure(change.row): change.verdict for change in step.changes} for step in steps]
    found = []
    for key, by_version in rows.items():
        entries: list[Entry] = []
        for place in range(len(sides)):
            here, before = by_version.get(place), by_version.get(place - 1)
            if here:
                verdict = "" if not place else said[place - 1].get(key, "") if before else APPEARED
                entries.append(_entry(place, here, verdict))
            elif before:
                entries.append(Entry(place, None, None, None, GONE))
        found.append(Figure(by_version[max(by_version)][0], tuple(entries)))
    return found


def _entry(place: int, rows: Sequence[Row], verdict: str) -> Entry:
    well = all(row.status == "ok" and row.seconds is not None for row in rows)
    peaks = [row.peak_memory_bytes for row in rows if row.peak_memory_bytes]
    seconds = fmean(row.seconds or 0.0 for row in rows) if well else None
    return Entry(place, Answer(tuple(rows)), seconds, max(peaks) if well and peaks else None, verdict)


def as_data(history: History) -> dict[str, Any]:
    """Return a history as JSON data: all figures."""
    return {
        "versions": [{"name": one.name, "what": one.side.what, "made_by": one.made_by} for one in history.versions],
        "figures": [
            {name: getattr(figure.row, name) for name in ("solver", "quantity", "primary", "at", "unit", "reference")}
            | {"case": figure.row.base, "variant": figure.row.variant, "settings": figure.row.overrides}
            | {
                "versions": [
                    {"version": history.versions[entry.version].name, "verdict": entry.verdict or None}
                    | {"seconds": entry.seconds, "peak_memory_bytes": entry.memory_bytes}
                    | (entry.answer.as_data() if entry.answer else {})
                    for entry in figure.entries
                ]
            }
            for figure in history.figures
        ],
        "notes": list(history.notes),
    }
