"""A board: packs of many solvers in one table, with each value compared with today's known value.

Values, seconds and bytes come from packed records, stated results among them, whose names say so. Errors and verdicts
are computed from today's known values. A value is *re-measured* if the keeper of the board has a run of the same code
and settings that is no worse.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.changes import Limits, compare_sides
from shellbench.bench.judge.classes import judged_by_class
from shellbench.bench.judge.compare import as_json, rows_of
from shellbench.bench.judge.row import Row
from shellbench.bench.judge.sides import Side
from shellbench.bench.store.current import current_runs
from shellbench.bench.store.pack import SUFFIX, Pack, read_pack
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Contents, Store
from shellbench.errors import InputError

Mark = Literal["yes", "differs", "no"]
AGREES = 1e-5  # relative to the known value: largest loss of a repeated run; the finest error that is ranked
DIGITS = 6  # digits of a checksum that distinguish two packs of the same solver and version


@dataclass(frozen=True)
class Entry:
    """One submission.

    Attributes
    ----------
    name
        Name on the board: solver and version, and more if two packs have the same.
    rows
        A row for each figure of each run, its solver called by this name.
    records
        The runs by their name.
    marks
        By name of run and quantity: True if it was re-measured.
    differs
        Reasons why values were not confirmed, one clause each.
    notes
        One sentence for each omission.
    """

    pack: Pack
    name: str
    rows: tuple[Row, ...]
    records: Mapping[str, Record]
    marks: Mapping[tuple[str, str], Mark] = field(default_factory=dict)
    differs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def mark(self, run_ids: Sequence[str], quantity: str) -> Mark:
        """Return the mark of the runs of one line: the worst of their marks."""
        marks = {self.marks.get((run_id, quantity), "no") for run_id in run_ids}
        return "differs" if "differs" in marks else "no" if "no" in marks else "yes"


def read_board(folder: Path, own: Store | None = None) -> list[Entry]:
    """Return the submissions of a folder of packs.

    Parameters
    ----------
    own
        Runs of the keeper of the board; without any, nothing is re-measured.

    Raises
    ------
    InputError
        If the folder has no packs, or one of them is refused.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder of packs (`shellbench pack` makes one)")
    paths = sorted(folder.glob(f"*{SUFFIX}"))
    if not paths:
        raise InputError(f"{folder}: has no packs, which are files *{SUFFIX} (`shellbench pack` makes one)")
    packs = {pack.manifest.checksum: pack for pack in map(read_pack, paths)}  # the same file twice is one submission
    called = Counter(_name(pack) for pack in packs.values())
    mine = () if own is None else own.read().records
    return [_entry(pack, _name(pack, called[_name(pack)] > 1), mine) for pack in packs.values()]


def _name(pack: Pack, told_apart: bool = False) -> str:
    about = pack.manifest
    return f"{about.solver} {about.version}" + (f" ({about.checksum[:DIGITS]})" if told_apart else "")


def _entry(pack: Pack, name: str, mine: Sequence[Record]) -> Entry:
    rows, notes = _rows(pack.records)
    records = {record.run_id: record for record in pack.records}
    if not rows:
        raise InputError(f"{pack.path}: none of its runs answers a case of today ({'; '.join(notes)})")
    if why := pack.unchecked:
        notes = (*notes, f"not checked, and so of no class: {why}")
    marks, differs = _made_again(pack, rows, mine)
    named = tuple(row.model_copy(update={"solver": name}) for row in rows)
    return Entry(pack, name, named, records, marks, differs, notes)


def _rows(records: Sequence[Record]) -> tuple[list[Row], tuple[str, ...]]:
    """Return rows for any state of their solver's code, and the reasons why runs are left out."""
    found = current_runs(Contents(tuple(records)), any_code=True)
    reasons = Counter(reason for _, reason in found.stale.values())
    rows = rows_of(found)
    frozen = catalog.tolerances()
    judged = [row if row.solver in frozen or row.overrides else judged_by_class(row) for row in rows]
    notes = tuple(f"{count} of its runs left out: {reason}" for reason, count in sorted(reasons.items()))
    return judged, notes


def _made_again(
    pack: Pack, rows: Sequence[Row], mine: Sequence[Record]
) -> tuple[dict[tuple[str, str], Mark], tuple[str, ...]]:
    """Return the mark of each value, and reasons for differences between packed runs and own runs of the same code."""
    code = {(record.identity.source, record.case_name) for record in pack.records}
    copied = {record.run_id for record in pack.records}
    same = [r for r in mine if (r.identity.source, r.case_name) in code and r.run_id not in copied and not r.own_case]
    same = [r for r in same if r.identity.solver == pack.manifest.solver and r.stated is None]
    own_rows, _ = _rows(same)
    if not own_rows:
        return {}, ()
    sides = [
        Side(name, "store", tuple(found), {record.run_id: record for record in records})
        for name, found, records in (("submitted", rows, pack.records), ("made again", own_rows, same))
    ]
    try:
        compared = compare_sides(sides[0], sides[1], Limits(AGREES))
    except InputError:  # no value in common
        return {}, ()
    marks: dict[tuple[str, str], Mark] = {}
    differs = []
    for change in compared.changes:
        good = change.verdict in ("same", "gain")
        marks |= {(row.run_id or "", row.quantity): "yes" if good else "differs" for row in change.before.rows}
        if not good:
            differs.append(f"{change.row.case} {change.row.quantity}, made again: {change.why}")
    return marks, tuple(differs)


def board_as_json(entries: Sequence[Entry]) -> str:
    """Return a board as JSON: manifest, rows and marks of each submission."""
    data: list[dict[str, Any]] = []
    for entry in entries:
        rows = json.loads(as_json(entry.rows))
        for row in rows:
            row["remeasured"] = entry.marks.get((row["run_id"], row["quantity"]), "no")
        about = entry.pack.manifest.model_dump(mode="json", exclude={"runs"})
        notes = [*entry.notes, *entry.differs]
        data.append(
            {"name": entry.name, "pack": about, "unchecked": entry.pack.unchecked, "notes": notes, "rows": rows}
        )
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
