"""Writing to a disk with errors in one sentence, and the user's cache of results that can be made again."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from shellbench.errors import InputError, ShellbenchError

SETTLED = 2_000_000_000  # ns after which a change has another time on any file system


class StoreError(ShellbenchError):
    """The store can't be written: the disk is full, or it may not be."""


@contextlib.contextmanager
def said_plainly(folder: Path, what: str = "store") -> Iterator[None]:
    """Turn an error of the disk into one sentence about the store, or what it is."""
    try:
        yield
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise StoreError(f"{what} {folder}: the disk is full, so what was being written is lost") from None
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(f"{what} {folder}: its name is too long") from None
        raise StoreError(f"{what} {folder}: can't be written ({error.strerror or error})") from None


Look = tuple[int, int, int, int]  # number of a file or folder, changes in ns, and bytes


def look_up(path: Path) -> Look | None:
    """Return inode, times of change and size of a file or folder: they change when it does. None if it is not there."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_ino, status.st_ctime_ns, status.st_mtime_ns, status.st_size


def is_settled(seen: Look | None) -> bool:
    """Tell if a later change of the file is bound to have another time: clocks of file systems have steps."""
    return seen is None or time.time_ns() - max(seen[1:3]) > SETTLED


def cache_folder() -> Path | None:
    """Return the user's folder for what can be made again; None if the user has no home."""
    with contextlib.suppress(RuntimeError):
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "shellbench"
    return None


def read_cache(name: str) -> Any:
    """Return the data that `write_cache` has kept under a name; None if there are none that can be read."""
    folder = cache_folder()
    with contextlib.suppress(OSError, ValueError, RecursionError):
        if folder and (folder / name).is_file():
            return json.loads((folder / name).read_bytes())
    return None


def write_cache(name: str, data: Mapping[str, Any]) -> None:
    """Keep data in the user's cache, whole or not at all; what can't be kept is made again."""
    folder = cache_folder()
    if folder is None:
        return
    with contextlib.suppress(OSError):
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        partial = file.with_suffix(f".{secrets.token_hex(4)}")
        partial.write_text(json.dumps(data), encoding="utf-8")
        partial.replace(file)
