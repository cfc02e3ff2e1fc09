"""Files that users name; their kind and size are checked before reading."""

from __future__ import annotations

import stat
from pathlib import Path

from shellbench.errors import InputError

LARGEST_RESULT = 1_000_000_000  # bytes, of a file of results
KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def check_file(path: Path, most: int) -> None:
    """Check that a path names a regular file that is not too large.

    Reading an unused pipe would block, and a device may never end.

    Raises
    ------
    InputError
        As a clause without the path: the kind or size of the file, and the allowed ones.
    """
    try:
        about = path.stat()
    except (OSError, ValueError) as error:  # a null byte in a path is a ValueError
        raise InputError(f"it can't be read ({_why(error)})") from None
    if not stat.S_ISREG(about.st_mode):
        raise InputError(f"it is no regular file, but {KINDS.get(stat.S_IFMT(about.st_mode), 'of another kind')}")
    if about.st_size > most:
        raise InputError(f"it has {about.st_size} bytes, and may have at most {most}")


def read_file(path: Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes.

    Raises
    ------
    InputError
        As `check_file`.
    """
    check_file(path, most)
    try:
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise InputError(f"it can't be read ({_why(error)})") from None
    if len(data) > most:  # it grew, or its size was not known
        raise InputError(f"it has more than the {most} bytes allowed")
    return data


def _why(error: OSError | ValueError) -> str:
    return str(getattr(error, "strerror", None) or error)
