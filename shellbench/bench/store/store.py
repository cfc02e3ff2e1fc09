"""The store: a folder of records, written so that a kill at any moment leaves no partial record.

A run works in a hidden folder ``.RUN_ID.partial`` inside the store. Committing it moves its files beside the
records and the record's own JSON last, each by a rename: a record that can be read is whole. It gets the next
sequence number, which determines the newest record independently of clocks. Every command that works in the store
holds a shared lock on it. Remains of dead runs are removed by the next command that is alone in the store.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.record import LARGEST_RECORD, Record, document, read_document, readable
from shellbench.disk import said_plainly
from shellbench.errors import InputError
from shellbench.files import read_file
from shellbench.problem import VARIANT

try:
    import fcntl
except ImportError:  # pragma: no cover - no such locks outside POSIX; then nothing is cleaned
    fcntl = None  # type: ignore[assignment]

RECORD = "record.json"
LOG = "log.txt"
LOCK = ".lock"
NUMBERING = ".sequence"  # locked while a record gets its number
RUN_ID = r"[A-Za-z0-9_-]+-\d{8}T\d{6}-[0-9a-f]{8}"
LEFT_BEHIND = re.compile(rf"({RUN_ID})\.(?!json$)[A-Za-z0-9.]+")
PARTIAL = re.compile(rf"\.({RUN_ID})\.partial")


Say = Callable[[str], None]  # takes one sentence


def silent(sentence: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Contents:
    """The content of a store.

    Attributes
    ----------
    records
        All intact records, oldest first.
    damaged
        One sentence for each file that is not a record, or whose content does not match its checksum.
    """

    records: tuple[Record, ...]
    damaged: tuple[str, ...] = ()


@dataclass(frozen=True)
class Store:
    """A folder of records."""

    folder: Path
    _numbers: dict[str, int] = field(default_factory=dict, init=False, repr=False, compare=False)  # of files read

    def read(self) -> Contents:
        """Read all records; damaged ones are left out, each with a sentence.

        Raises
        ------
        InputError
            If the path is not a folder, or can't be read.
        """
        records: list[Record] = []
        damaged: list[str] = []
        cases = set(catalog.case_names())
        for name in self.names():
            try:
                records.append(_of_a_case(self._read(name), cases))
            except InputError as error:
                damaged.append(f"{self.folder / name}: is left out, for {error}")
        return Contents(tuple(sorted(records, key=lambda record: record.order)), tuple(damaged))

    def names(self) -> list[str]:
        """Return the names of the files that should be records; files that belong to a record have a second dot."""
        try:
            names = [path.name for path in self.folder.iterdir()]
        except FileNotFoundError:
            return []
        except NotADirectoryError:
            if not self.folder.exists():  # something above it is a file
                return []
            raise InputError(f"store {self.folder}: is not a folder") from None
        except OSError as error:
            raise InputError(f"store {self.folder}: can't be read ({error.strerror})") from None
        return sorted(name for name in names if name.endswith(".json") and name.count(".") == 1)

    def _read(self, name: str) -> Record:
        """Read one record; InputError, as a clause, if it is invalid or damaged."""
        record = read_document(read_file(self.folder / name, LARGEST_RECORD))
        self._numbers[name] = record.sequence or 0
        return record

    def last_number(self) -> int:
        """Return the largest sequence number of the records; 0 if none has one."""
        for name in self.names():
            if name not in self._numbers:  # records do not change
                with contextlib.suppress(InputError):
                    self._read(name)
        return max(self._numbers.values(), default=0)

    def check(self, record: Record, name: str | None) -> str | None:
        """Return the reason why a file beside a record is damaged, in one sentence; None if it is intact or absent."""
        path = self.folder / name if name else None
        if path is None or name is None or not path.exists():
            return None
        if not path.is_file():
            return f"{path}: is left out, for it is no regular file"
        try:
            whole = name not in record.checksums or _digest(path) == record.checksums[name]
        except OSError as error:
            return f"{path}: is left out, for it can't be read ({error.strerror})"
        return None if whole else f"{path}: is left out, for it is damaged: its content does not match its checksum"

    def records_of(self, run_ids: Collection[str | None], say: Say) -> dict[str, Record]:
        """Return the records of runs by name, to open their fields; damaged files are reported and left out."""
        found: dict[str, Record] = {}
        for record in self.read().records:
            if record.run_id in run_ids:
                damage = self.check(record, record.fields_file)
                if damage is not None:
                    say(damage)
                    record = record.model_copy(update={"fields_file": None})
                found[record.run_id] = record
        return found

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
            With its number, and the names and checksums of its files. Fields that could not be read back are left out.

        Raises
        ------
        StoreError
            If the disk is full, for instance; then nothing of the run is left.
        """
        # A transaction by renames, which are atomic on one file system:
        # 1. Flush and rename the files of the run beside the records. Without a record they are ignored.
        # 2. Take checksums, and the next number under a lock.
        # 3. Write the record in the hidden folder, flush it, rename it, and flush the folder: only now the run exists.
        # 4. After any error take back what was moved, the record first.
        # A kill between two steps leaves files without a record, which the next `at_work` removes.
        moved: list[Path] = []
        try:
            with said_plainly(self.folder):
                fields_file = self._move(partial, record.fields_file, record.run_id, moved)
                solution_file = self._move(partial, record.solution_file, record.run_id, moved)
                self._move(partial, LOG, record.run_id, moved)
                kept = {
                    "fields_file": fields_file,
                    "solution_file": solution_file,
                    "checksums": {name: _digest(self.folder / name) for name in (fields_file, solution_file) if name},
                }
                with self._numbering() as number:
                    # A record that can be written but not read would be damaged by shellbench itself.
                    whole = readable(record.model_copy(update={**kept, "sequence": number}))
                    written = partial / RECORD
                    written.write_bytes(document(whole))
                    _flush(written)
                    target = self.folder / f"{record.run_id}.json"
                    moved.append(target)
                    written.replace(target)
                    _flush(self.folder)
        except BaseException:
            for path in reversed(moved):  # the record first: no record is better than a partial one
                path.unlink(missing_ok=True)
            raise
        finally:
            self.discard(partial)
        return whole

    @contextlib.contextmanager
    def _numbering(self) -> Iterator[int]:
        """Yield the next sequence number, under a lock until its record is in the store."""
        # The lock is held until the record is in place: otherwise two commands could read the same last number. It has
        # its own file, because all writers share the other lock.
        handle = os.open(self.folder / NUMBERING, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if fcntl is not None:
                with contextlib.suppress(OSError):  # a file system without locks
                    fcntl.flock(handle, fcntl.LOCK_EX)
            yield self.last_number() + 1
        finally:
            os.close(handle)

    def _move(self, partial: Path, name: str | None, run_id: str, moved: list[Path]) -> str | None:
        """Move a file of a run to ``RUN_ID.`` and its name; an empty log is removed."""
        source = partial / name if name else None
        if source is None or not source.is_file() or not source.stat().st_size:
            return None
        target = self.folder / f"{run_id}.{source.name}"
        _flush(source)
        # Noted before the rename, so that an error during it leaves nothing behind.
        moved.append(target)
        source.replace(target)
        return target.name

    def discard(self, partial: Path) -> None:
        """Remove the folder of a run without a result."""
        shutil.rmtree(partial, ignore_errors=True)

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Lock the store for writing; first clean it if no other command uses it.

        Raises
        ------
        InputError
            If the path is not a folder.
        StoreError
            If the folder can't be made or written.
        """
        self.names()
        with said_plainly(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if fcntl is not None:
                with contextlib.suppress(OSError):
                    # Only a command that is alone in the store cleans it: a hidden folder may be another run. Otherwise
                    # this fails at once.
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


def _of_a_case(record: Record, cases: Collection[str]) -> Record:
    """Return the record if its case is one of the suite's or a user's own; else InputError, as a clause."""
    found, named = record.case_name[:60], str(record.case.get("name"))[:60]
    if not record.own_case and record.case_name.partition(VARIANT)[0] not in cases:
        raise InputError(f"there is no case {found!r}")
    if record.case.get("name") != record.case_name:
        raise InputError(f"field 'case_name': found {found!r}, but its case is {named!r}")
    return record


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _flush(path: Path) -> None:
    """Flush a file or a folder to the disk, so that a power cut can't reorder the renames."""
    # A rename may reach the disk before the renamed data: both are flushed, data first.
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
