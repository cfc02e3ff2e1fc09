"""Claims on runs: commands that work in one store at the same time make each run once.

A claim is a lock on a file of the store, by the run's key. It ends with its process, so that no command waits for a
killed one.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from shellbench.disk import said_plainly

try:
    import fcntl
except ImportError:  # pragma: no cover - no such locks outside POSIX; then each command makes its own runs
    fcntl = None  # type: ignore[assignment]

NAME = ".claim-"  # begins the name of a claim's file


@dataclass
class Claims:
    """The claims of one command in a store; all are released at the end of the context."""

    folder: Path
    held: dict[str, int] = field(default_factory=dict)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for key in list(self.held):
            self.drop(key)

    def _path(self, key: str) -> Path:
        return self.folder / f"{NAME}{hashlib.sha256(key.encode()).hexdigest()[:32]}"

    def take(self, key: str) -> bool:
        """Claim a run; return False if another command has.

        Raises
        ------
        StoreError
            If the store can't be written.
        """
        if fcntl is None or key in self.held:
            return True
        path = self._path(key)
        while True:
            with said_plainly(self.folder):
                handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(handle)
                return False
            except OSError:  # a file system without locks
                pass
            # Releasing a claim removes the file: a lock on a removed file is not valid.
            with contextlib.suppress(FileNotFoundError):
                if path.stat().st_ino == os.fstat(handle).st_ino:
                    self.held[key] = handle
                    return True
            os.close(handle)

    def drop(self, key: str) -> None:
        """Release a claim."""
        handle = self.held.pop(key, None)
        if handle is not None:
            self._path(key).unlink(missing_ok=True)
            os.close(handle)
