"""Triangle meshes with texture coordinates from OBJ (v, vt, f), ASCII PLY and the formats of meshio.

The reader is strict: if the file lacks something that a surface needs, it is refused in one sentence with the line.
Data that a surface does not use (normals, materials, groups, colours) are ignored. Polygons become fans of triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, without_middle
from shellbench.problems.shell.mesh.other import FORMATS, read_other

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
LARGEST = 200_000_000  # bytes; a million triangles take half of it
ON_A_SIDE = 1e-6  # of the rectangle's side: texture coordinates so near to each other are one; files have six digits
TEXTURE_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))  # of PLY, by the programs that write them


@dataclass(frozen=True)
class MeshFile:
    """Content of a mesh file, its indices counted from 0.

    Attributes
    ----------
    positions
        (n, 3), m.
    texture
        (m, 2), the coordinates (u, v).
    triangles
        (t, 3) indices of positions.
    corners
        (t, 3) indices of texture coordinates, corner by corner.
    """

    positions: Array
    texture: Array
    triangles: Indices
    corners: Indices


def read_mesh(content: bytes, suffix: str) -> MeshFile:
    """Read the content of a mesh file.

    Parameters
    ----------
    suffix
        Of the file's name, such as ".obj".

    Raises
    ------
    InputError
        As a clause without the file's name: the fault and its line.
    """
    readers: dict[str, Callable[[str], MeshFile]] = {".obj": _read_obj, ".ply": _read_ply}
    suffix = suffix.lower()
    if suffix not in (*readers, *FORMATS):
        known = ", ".join((*readers, *FORMATS))
        raise InputError(f"its name ends in '{without_middle(suffix)}', but a mesh is one of {known}")
    if suffix == ".ply" and b"format binary" in content[:200]:
        raise InputError("it is a binary PLY; write it as ASCII PLY or as OBJ")
    if suffix in FORMATS:
        positions, texture, faces = read_other(content, suffix)
        mesh = _mesh(positions.tolist(), texture.tolist(), [[(index, index) for index in face] for face in faces])
    else:
        try:
            mesh = readers[suffix](content.decode("utf-8"))
        except UnicodeDecodeError:
            raise InputError("it is not a text file in UTF-8") from None
    for what, values in (("position", mesh.positions), ("texture coordinate", mesh.texture)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"{what} {int(np.argmin(np.isfinite(values).all(axis=1))) + 1} is not finite")
    return _without_split_corners(mesh)


def _without_split_corners(mesh: MeshFile) -> MeshFile:
    """Return the mesh with the texture vertices of a vertex merged if they are at the same (u, v).

    Programs write a texture vertex for each corner of a face. At a true seam a vertex has texture vertices at several
    (u, v).
    """
    count = len(mesh.texture)
    keys, where = np.unique(mesh.triangles.ravel() * count + mesh.corners.ravel(), return_inverse=True)
    vertex, texture = np.divmod(keys, count)
    slack = ON_A_SIDE * np.ptp(mesh.texture[texture], axis=0)
    merged, left = texture.copy(), np.arange(len(keys))
    while len(left):  # once for each place that a vertex has in (u, v)
        _, first, owner = np.unique(vertex[left], return_index=True, return_inverse=True)
        chosen = texture[left[first]][owner]
        same = np.all(np.abs(mesh.texture[texture[left]] - mesh.texture[chosen]) <= slack, axis=1)
        merged[left[same]] = chosen[same]
        left = left[~same]
    return replace(mesh, corners=merged[where].reshape(-1, 3))


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines of an OBJ with their numbers; lines that end in a backslash continue, except comments."""
    begun, at = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        at = at if begun else number
        goes_on = line.rstrip().endswith("\\") and not (begun + line).lstrip().startswith("#")
        begun += line.rstrip()[:-1] + " " if goes_on else line
        if not goes_on:
            yield at, begun
            begun = ""
    if begun:
        yield at, begun


def _read_obj(text: str) -> MeshFile:
    positions: list[tuple[float, ...]] = []
    texture: list[tuple[float, ...]] = []
    faces: list[list[tuple[int, int]]] = []
    known: dict[str, tuple[int, int]] = {}  # a corner occurs once for each face around it
    for number, line in _statements(text):
        words = line.split()
        try:
            match words[:1]:
                case ["v"]:
                    positions.append(_floats(words[1:4], 3))
                case ["vt"]:
                    texture.append(_floats(words[1:3], 2))
                case ["f"]:
                    if len(words) < 4:
                        raise InputError("a face has fewer than three corners")
                    for word in words[1:]:
                        if word not in known or "-" in word:  # which counts from what is there
                            known[word] = _corner(word, len(positions), len(texture))
                    faces.append([known[word] for word in words[1:]])
                case ["l" | "curv" | "curv2" | "surf"]:
                    raise InputError(f"'{words[0]}' is no triangle or polygon")
        except InputError as error:
            raise InputError(f"line {number}: {error}") from None
        except ValueError:
            raise InputError(f"line {number}: can't read {line.strip()[:60]!r}") from None
    return _mesh(positions, texture, faces)


def _floats(words: Sequence[str], count: int) -> tuple[float, ...]:
    if len(words) < count:
        raise ValueError
    return tuple(map(float, words))


def _corner(word: str, positions: int, texture: int) -> tuple[int, int]:
    """Return the indices, from 0, of a corner such as ``12/7`` or ``12/7/3``; negative ones count from the end."""
    first, _, rest = word.partition("/")
    second = rest.partition("/")[0]
    if not second:
        raise InputError("a face has no texture coordinates, which are the shell's xi1 and xi2")
    found = []
    for what, text, count in (("position", first, positions), ("texture coordinate", second, texture)):
        index = int(text)
        index = index - 1 if index > 0 else count + index
        if not 0 <= index < count:
            raise InputError(f"a face names {what} {text}, and there are {count} before it")
        found.append(index)
    return found[0], found[1]


def _mesh(positions: Sequence[Sequence[float]], texture: Sequence[Sequence[float]], faces: object) -> MeshFile:
    fans = [
        (face[0], face[n], face[n + 1])
        for face in faces  # type: ignore[attr-defined]
        for n in range(1, len(face) - 1)
    ]
    if not fans:
        raise InputError("it has no faces")
    pairs = np.array(fans, dtype=np.int64)  # (t, 3, 2)
    return MeshFile(np.array(positions, float), np.array(texture, float), pairs[..., 0], pairs[..., 1])


def _read_ply(text: str) -> MeshFile:
    lines = iter(text.splitlines())
    if next(lines, "").strip() != "ply":
        raise InputError("its first line is not 'ply'")
    elements = _ply_header(lines)
    positions, texture, faces = [], [], []
    for name, count, properties in elements:
        rows = list(islice(lines, count))
        if len(rows) < count:
            raise InputError(f"it ends after {len(rows)} of {count} lines of '{name}'")
        try:
            if name == "vertex":
                columns = _ply_columns(properties)
                words = (row.split() for row in rows)
                found = [[float(row[column]) for column in columns] for row in words]
                positions, texture = [row[:3] for row in found], [row[3:] for row in found]
            elif name == "face":
                if properties[:1] not in (["vertex_indices"], ["vertex_index"]):
                    raise InputError("a face does not begin with its list of vertices")
                faces = [_ply_face(row.split(), len(positions)) for row in rows]
        except InputError:
            raise
        except (ValueError, IndexError):
            raise InputError(f"can't read the lines of '{name}'") from None
    return _mesh(positions, texture, faces)


def _ply_header(lines: Iterator[str]) -> list[tuple[str, int, list[str]]]:
    """Return name, number and names of properties of each element."""
    elements: list[tuple[str, int, list[str]]] = []
    for line in lines:
        match line.split():
            case ["format", form, *_] if form != "ascii":
                raise InputError(f"it is a PLY of format '{form}'; write it as ASCII PLY or as OBJ")
            case ["element", name, count] if count.isdigit():
                elements.append((name, int(count), []))
            case ["property", *_, name] if elements:
                elements[-1][2].append(name)
            case ["end_header"]:
                return elements
    raise InputError("its header does not end")


def _ply_columns(properties: Sequence[str]) -> list[int]:
    for pair in TEXTURE_NAMES:
        if set(pair) <= set(properties):
            return [properties.index(name) for name in ("x", "y", "z", *pair)]
    raise InputError("its vertices have no texture coordinates u and v, which are the shell's xi1 and xi2")


def _ply_face(words: Sequence[str], count: int) -> list[tuple[int, int]]:
    corners: Iterable[int] = map(int, words[1 : 1 + int(words[0])])
    face = [(index, index) for index in corners]
    if len(face) != int(words[0]) or len(face) < 3:
        raise InputError("a face has fewer corners than it says, or fewer than three")
    if any(not 0 <= index < count for index, _ in face):
        raise InputError(f"a face names a vertex that is none of the {count}")
    return face
