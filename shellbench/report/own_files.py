"""Files of a report in a folder that may hold others: an older report's go, nobody else's."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

MANIFEST = ".shellbench-report"


def remove_older(out: Path) -> None:
    """Remove the files that an earlier report listed as its own; OSError if one can't be."""
    manifest = out / MANIFEST
    if not manifest.is_file():
        return
    root = out.resolve()
    for name in manifest.read_text(encoding="utf-8").splitlines():
        path = out / name
        if name and path.resolve().is_relative_to(root):
            path.unlink(missing_ok=True)
    manifest.unlink()


def list_own(out: Path, written: Iterable[Path]) -> None:
    """List the files that a report wrote, relative to its folder, so that the next one can remove them."""
    names = sorted({path.relative_to(out).as_posix() for path in written if path.is_file()})
    write(out / MANIFEST, "".join(f"{name}\n" for name in names))


def write(path: Path, text: str) -> None:
    """Write a file of text, alike on every system."""
    path.write_text(text, encoding="utf-8", newline="\n")
