"""Series of states for other programs: numbered files, a `.pvd` that lists them with their times, or one `.glb`."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.export import WRITERS, export, quadrilaterals, write
from shellbench.errors import InputError
from shellbench.sample import Sample

SERIES = (".pvd", ".glb", ".gif")
"""Formats that hold a series by themselves; those of one state become numbered files."""
FLOAT, INTEGER = 5126, 5125  # component types of glTF
MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
CLOTH = (0.35, 0.55, 0.75, 1.0)  # colour of a shell in viewers of glTF


def numbered(path: Path, number: int, suffix: str | None = None) -> Path:
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
    if path.suffix == ".glb":
        states = list(series)
        write(path, as_glb(states, scale))
        return len(states)
    if path.suffix not in (".pvd", *WRITERS):
        raise InputError(f"--out {path}: can't write a series as '{path.suffix}'")
    marks = []
    for number, one in enumerate(series):
        export(one, numbered(path, number, ".vtu" if path.suffix == ".pvd" else None), scale)
        marks.append(one.at)
    if path.suffix == ".pvd":
        write(path, as_pvd(path, marks))  # last: what it lists is there
    return len(marks)


def as_pvd(path: Path, marks: Sequence[float | None]) -> bytes:
    """Return the list of numbered .vtu files with their times that ParaView opens as one motion."""
    files = (
        f'    <DataSet timestep="{mark!r}" file={quoteattr(numbered(path, number, ".vtu").name)}/>'
        for number, mark in enumerate(marks)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>'
    return "\n".join([head, *files, "  </Collection>", "</VTKFile>", ""]).encode()


def as_glb(states: Sequence[Sample], scale: float) -> bytes:
    """Return a binary glTF 2.0 whose one mesh is the first state, with a morph target for each later one.

    Its animation goes through the states at their marks, as seconds. Numbers are of single precision, as the format
    asks. A quadrilateral is two triangles.
    """
    # A seam is shared only where every state closes: one mesh serves all.
    first, second = (all(one.closed[axis] for one in states) for axis in (0, 1))
    closed = first, second
    states = [replace(one, periodic=closed) for one in states]
    points = [one.vertices(one.deformed(scale)) for one in states]
    corners = quadrilaterals(len(states[0].xi), closed)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]).astype(np.uint32)
    times = np.array([one.at or 0.0 for one in states])
    weights = np.eye(len(states))[:, 1:]  # the first state is the mesh itself
    arrays: list[tuple[NDArray[Any], str]] = [(triangles.ravel(), "SCALAR"), (points[0], "VEC3")]
    arrays += [(one - points[0], "VEC3") for one in points[1:]]
    arrays += [(times - times[0], "SCALAR"), (weights.ravel(), "SCALAR")]
    targets = [{"POSITION": number} for number in range(2, len(states) + 1)]
    primitive = {"attributes": {"POSITION": 1}, "indices": 0, "targets": targets, "material": 0}
    sampler = {"input": len(states) + 1, "output": len(states) + 2, "interpolation": "LINEAR"}
    buffers, accessors, data = [], [], b""
    for values, kind in arrays:
        counts = values.dtype == np.uint32
        values = values if counts else values.astype(np.float32)
        rows = values.reshape(len(values), -1)
        buffers.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        accessors.append(
            {
                "bufferView": len(buffers) - 1,
                "componentType": INTEGER if counts else FLOAT,
                "count": len(values),
                "type": kind,
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
        data += values.tobytes()
    whole = {
        "asset": {"version": "2.0", "generator": "shellbench", "extras": {"title": states[-1].title}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive], "weights": [0.0] * len(targets)}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"baseColorFactor": CLOTH, "metallicFactor": 0}}],
        "animations": [{"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": buffers,
        "accessors": accessors,
    }
    text = json.dumps(whole, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), JSON_CHUNK) + text + struct.pack("<2I", len(data), BINARY_CHUNK) + data
    return struct.pack("<3I", MAGIC, VERSION, 12 + len(chunks)) + chunks
