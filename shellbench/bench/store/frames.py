"""Series of states for other programs: numbered files, and a `.pvd` that lists them with their times."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from shellbench.bench.store.export import WRITERS, export, write
from shellbench.errors import InputError
from shellbench.protocol.sample import Sample

SERIES = (".pvd",)
"""Formats that hold a series by themselves; those of one state become numbered files."""


def numbered_file(path: Path, number: int, suffix: str | None = None) -> Path:
    """Return the file of one state: skirt_007.obj of skirt.obj."""
    return path.with_name(f"{path.stem}_{number:03d}{suffix or path.suffix}")


def export_series(series: Iterable[Sample], path: Path, scale: float = 1.0) -> int:
    """Write a series of states in the format of the file's suffix; return their number.

    Raises
    ------
    InputError
        If the format is unknown, or needs a package that is not installed.
    StoreError
        If a file can't be written.
    """
    if path.suffix not in (".pvd", *WRITERS):
        raise InputError(f"--out {path}: can't write a series as '{path.suffix}'")
    marks = []
    for number, one in enumerate(series):
        export(one, numbered_file(path, number, ".vtu" if path.suffix == ".pvd" else None), scale)
        marks.append(one.at)
    if path.suffix == ".pvd":
        write(path, as_pvd(path, marks))  # written last, so that all listed files exist
    return len(marks)


def as_pvd(path: Path, marks: Sequence[float | None]) -> bytes:
    """Return the list of numbered .vtu files with their times that ParaView opens as one motion."""
    files = (
        f'    <DataSet timestep="{mark!r}" file={quoteattr(numbered_file(path, number, ".vtu").name)}/>'
        for number, mark in enumerate(marks)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>'
    return "\n".join([head, *files, "  </Collection>", "</VTKFile>", ""]).encode()
