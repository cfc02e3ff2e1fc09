"""Writing to a disk: what goes wrong is said in one sentence."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from shellbench.errors import InputError, ShellbenchError


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
