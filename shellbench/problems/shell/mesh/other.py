"""Triangle meshes with texture coordinates from files of other programs, read by meshio.

Gmsh, Abaqus, Nastran and STL files can't hold texture coordinates. VTK files can: as point data `u` and `v`, or as one
array with both.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, without_middle

Array = NDArray[np.float64]
FORMATS = {
    ".bdf": "nastran",
    ".inp": "abaqus",
    ".msh": "gmsh",
    ".nas": "nastran",
    ".stl": "stl",
    ".vtk": "vtk",
    ".vtu": "vtu",
}
PAIRS = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("xi1", "xi2"))
BOTH = ("uv", "xi", "tcoords", "texture coordinates", "texturecoordinates", "texcoords")  # in small letters
CORNERS = {"triangle": 3, "triangle6": 3, "triangle7": 3, "quad": 4, "quad8": 4, "quad9": 4}  # later ones are on edges
# meshio would read any file named by an include. It removes stars from keywords, and takes lines without a star as
# keywords too.
INCLUDES = re.compile(rb"(?:^|[\r\n])(?!\*\*)[^\w,\r\n]*" + rb"\**".join(b"i n c l u d e".split()), re.IGNORECASE)
LINES = ("vertex", "line", "line3")  # which bound surfaces, and are none


def read_other(content: bytes, suffix: str) -> tuple[Array, Array, list[list[int]]]:
    """Return positions (n, 3), texture coordinates (n, 2) and faces of a mesh file that meshio reads.

    Raises
    ------
    InputError
        As a clause without the file's name.
    """
    mesh = meshio_mesh(content, suffix)
    points = np.asarray(mesh.points, float)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        raise InputError("it has no points of two or three coordinates")
    faces = list(_faces(mesh.cells, len(points)))
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1]))), _texture(mesh.point_data, len(points), suffix), faces


def meshio_mesh(content: bytes, suffix: str) -> Any:
    """Return the mesh that meshio reads, without its printing, and without its exit from the program on an error."""
    import meshio

    if FORMATS[suffix] == "abaqus" and INCLUDES.search(content):
        raise InputError("it includes another file: write it as one")
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as said:
        path = Path(folder) / f"mesh{suffix}"
        path.write_bytes(content)
        try:
            with contextlib.redirect_stderr(said), np.errstate(all="ignore"):
                return meshio.read(path, file_format=FORMATS[suffix])
        except (Exception, SystemExit) as error:  # a reader can raise any exception on unexpected content
            words = said.getvalue() if isinstance(error, SystemExit) else str(error)
            words = " ".join(words.replace(str(path), "it").split()) or type(error).__name__
            raise InputError(f"meshio can't read it as {FORMATS[suffix]}: {without_middle(words)}") from None


def _faces(blocks: Iterable[Any], count: int) -> Iterable[list[int]]:
    for block in blocks:
        kind, corners = block.type, np.asarray(block.data)
        if kind in LINES:
            continue
        if kind not in CORNERS and not kind.startswith("polygon"):
            raise InputError(f"it has cells of kind '{kind}': a surface is of triangles, quadrilaterals or polygons")
        if corners.size and not (corners.min() >= 0 and corners.max() < count):
            raise InputError(f"a face names a vertex that is none of the {count}")
        yield from corners[:, : CORNERS.get(kind)].tolist()


def _texture(data: Mapping[str, Any], count: int, suffix: str) -> Array:
    arrays = {name.lower(): np.asarray(values) for name, values in data.items()}
    for pair in PAIRS:
        if set(pair) <= set(arrays):
            return _numbers(np.stack([arrays[name].reshape(-1) for name in pair], axis=-1), count)
    for name in BOTH:
        if name in arrays and arrays[name].ndim == 2 and arrays[name].shape[1] >= 2:
            return _numbers(arrays[name][:, :2], count)
    where = "as point data 'u' and 'v'" if suffix in {".vtk", ".vtu"} else f"which a {suffix} file has no place for"
    raise InputError(
        f"it has no texture coordinates (u, v), {where}; they are the shell's xi1 and xi2: write the mesh as OBJ with"
        " lines 'vt u v', or as .vtu with point data 'u' and 'v'"
    )


def _numbers(texture: Array, count: int) -> Array:
    if texture.shape != (count, 2) or texture.dtype.kind not in "fiu":
        raise InputError(f"its texture coordinates are not two numbers for each of its {count} points")
    return texture.astype(float)
