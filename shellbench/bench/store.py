"""The store: a folder of records, written so that a kill at any moment leaves none or a whole one.

A run works in a hidden folder ``.RUN_ID.partial`` inside the store. Committing it moves its files beside the
records and the record's own JSON last, each by a rename: a record that can be read is whole. Whoever works in
the store holds a shared lock on it; what dead runs left behind is cleaned by the next one that finds nobody
else at work.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from shellbench.bench.identity import run_key
from shellbench.bench.record import Record
from shellbench.errors import InputError, ShellbenchError
from shellbench.model import one_sentence

try:
    import fcntl
except ImportError:  # pragma: no cover - no such locks outside POSIX; then nothing is cleaned
    fcntl = None  # type: ignore[assignment]

RECORD = "record.json"
LOG = "log.txt"
RUN_ID = r"[A-Za-z0-9_-]+-\d{8}T\d{6}-[0-9a-f]{8}"
LEFT_BEHIND = re.compile(rf"({RUN_ID})\.(?!json$)[A-Za-z0-9.]+")
PARTIAL = re.compile(rf"\.({RUN_ID})\.partial")


class StoreError(ShellbenchError):
    """The store can't be written: the disk is full, or it may not be."""


@dataclass(frozen=True)
class Contents:
    """What a store holds.

    Attributes
    ----------
    records
        All whole records, oldest first.
    damaged
        One sentence for each file that is none.
    """

    records: tuple[Record, ...]
    damaged: tuple[str, ...] = ()


def newest(contents: Contents) -> list[Record]:
    """Return the newest record of each run that was made more than once, oldest first."""
    latest: dict[str, Record] = {}
    for record in contents.records:
        key = run_key(record.case_name, record.own_case, record.identity)
        latest.pop(key, None)
        latest[key] = record
    return list(latest.values())


@dataclass(frozen=True)
class Store:
    """A folder of records."""

    folder: Path

    def read(self) -> Contents:
        """Read all records; damaged ones are left out, each with a sentence.

        Raises
        ------
        InputError
            If there is something that is not a folder.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"store {self.folder}: is not a folder")
        records: list[Record] = []
        damaged: list[str] = []
        for path in sorted(self.folder.glob("*.json")):
            if "." in path.stem:  # what lies beside a record, such as a solution that its solver keeps as JSON
                continue
            try:
                record = Record.model_validate_json(path.read_bytes())
            except ValidationError as error:
                damaged.append(f"{path}: is left out, for it is no whole record ({one_sentence(error)})")
                continue
            except OSError as error:
                damaged.append(f"{path}: is left out, for it can't be read ({error.strerror})")
                continue
            records.append(record)
        return Contents(tuple(sorted(records, key=lambda r: (r.created, r.run_id))), tuple(damaged))

    def file(self, name: str | None) -> Path | None:
        """Return the path of a file beside a record; None if it has none or the file is gone."""
        path = self.folder / name if name and Path(name).name == name else None
        return path if path is not None and path.is_file() else None

    def begin(self, run_id: str) -> Path:
        """Make the folder in which a run works.

        Raises
        ------
        StoreError
            If it can't be made.
        """
        folder = self.folder / f".{run_id}.partial"
        with said_plainly(self.folder):
            folder.mkdir(parents=True)
        return folder

    def commit(self, partial: Path, record: Record) -> Record:
        """Move a run's files beside the records, and write the record last.

        Returns
        -------
        Record
            With the names under which its files were kept.

        Raises
        ------
        StoreError
            If the disk is full or the like; then nothing of the run is left.
        """
        moved: list[Path] = []
        try:
            with said_plainly(self.folder):
                names: dict[str, str | None] = {}
                for field, old in (("fields_file", record.fields_file), ("solution_file", record.solution_file)):
                    names[field] = self._move(partial, old, record.run_id, moved)
                self._move(partial, LOG, record.run_id, moved)
                whole = record.model_copy(update=names)
                document = partial / RECORD
                document.write_text(whole.model_dump_json(indent=1) + "\n", encoding="utf-8")
                _flush(document)
                target = self.folder / f"{record.run_id}.json"
                moved.append(target)
                document.replace(target)
                _flush(self.folder)
        except BaseException:
            for path in reversed(moved):  # the record first: none is better than half of one
                path.unlink(missing_ok=True)
            raise
        finally:
            self.discard(partial)
        return whole

    def _move(self, partial: Path, name: str | None, run_id: str, moved: list[Path]) -> str | None:
        """Move a file of a run to ``RUN_ID.`` and its name; a log of nothing is dropped."""
        source = partial / name if name else None
        if source is None or not source.is_file() or not source.stat().st_size:
            return None
        target = self.folder / f"{run_id}.{source.name}"
        _flush(source)
        moved.append(target)
        source.replace(target)
        return target.name

    def discard(self, partial: Path) -> None:
        """Remove the folder of a run that came to nothing."""
        shutil.rmtree(partial, ignore_errors=True)

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Hold the store for writing; clean it first if nobody else does.

        Raises
        ------
        InputError
            If there is something that is not a folder.
        StoreError
            If the folder can't be made or written.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"store {self.folder}: is not a folder")
        with said_plainly(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if fcntl is not None:
                with contextlib.suppress(OSError):
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    self._clean()
                with contextlib.suppress(OSError):
                    fcntl.flock(handle, fcntl.LOCK_SH)
            yield
        finally:
            os.close(handle)

    def _clean(self) -> None:
        for path in list(self.folder.iterdir()):
            if PARTIAL.fullmatch(path.name):
                self.discard(path)
            elif (found := LEFT_BEHIND.fullmatch(path.name)) and not (self.folder / f"{found[1]}.json").exists():
                path.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Bring a file or a folder to the disk, so that a power cut can't reorder the renames."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def said_plainly(folder: Path, what: str = "store") -> Iterator[None]:
    """Turn an error of the disk into one sentence about the store, or what it is."""
    try:
        yield
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise StoreError(f"{what} {folder}: the disk is full, so what was being written is lost") from None
        raise StoreError(f"{what} {folder}: can't be written ({error.strerror or error})") from None
