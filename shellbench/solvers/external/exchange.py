"""Files between shellbench and a command: the mesh with all that holds and loads it, and the displacements of nodes.

Nodes are numbered from 1 in all of them, and units are those of the case (SI). `docs/any_program.md` describes them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure, without_middle
from shellbench.files import LARGEST_RESULT, read_file
from shellbench.problems.shell.deck.cells import MESHIO
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.vtu import read_vtu
from shellbench.problems.shell.sheet.formats import ELEMENTS, writers

Array = NDArray[np.float64]
MeshFormat = Literal["json", "tables", "vtu", "inp", "bdf", "msh"]
ResultFormat = Literal["csv", "dat", "vtu", "values"]

DECKS = ("inp", "bdf", "msh")  # formats as `shellbench sheet` writes them
NUMBER = "%.12e"  # format in tables: CalculiX reads 20 characters
SAME = 1e-6  # of the mesh's size: how far a place in a result may lie from its node
BETWEEN = re.compile(r"[\s,;]+")
BEGINS_DISPLACEMENTS = "displacements"  # in the line above them in a file .dat of CalculiX


def write_mesh(deck: Deck, held: NDArray[np.bool_], format: MeshFormat, folder: Path) -> Path:
    """Write a deck with what is held (v, 6) into a folder; return its file, or the folder of its tables."""
    if format == "tables":
        return _write_tables(deck, held, folder / "mesh")
    path = folder / f"mesh.{format}"
    if format in DECKS:
        element = next(name for name, one in ELEMENTS.items() if one.shape == deck.grid.shape)
        writers([deck], element, deck.part.whole.name)[f".{format}"](path)
    elif format == "vtu":
        import meshio

        data = {name: getattr(deck, name) for name in ("prescribed", "forces", "normals", "thickness")}
        data["held"] = held.astype(float)
        meshio.Mesh(deck.nodes, [(MESHIO[deck.grid.shape], deck.cells)], point_data=data).write(path)
    else:
        path.write_text(json.dumps(_mesh_data(deck, held)), encoding="utf-8")
    return path


def _mesh_data(deck: Deck, held: NDArray[np.bool_]) -> dict[str, Any]:
    """Return a deck as JSON data; lists over nodes are in the order of their numbers."""
    material = deck.part.case.material
    return {
        "case": deck.part.whole.name,
        "theory": deck.part.whole.theory,
        "shape": deck.grid.shape,
        "cells_along": list(deck.grid.counts),
        "material": {name: getattr(material, name) for name in ("youngs_modulus", "poissons_ratio", "thickness")},
        "cells": (deck.cells + 1).tolist(),
        "held": held.tolist(),
        **{name: getattr(deck, name).tolist() for name in ("nodes", "normals", "prescribed", "forces")},
        "sets": {name: (nodes + 1).tolist() for name, nodes in deck.sets.items()},
    }


def _write_tables(deck: Deck, held: NDArray[np.bool_], folder: Path) -> Path:
    """Write tables without headings, in the order of Abaqus's data lines."""
    folder.mkdir()
    (n, c), (m, d) = np.nonzero(held), np.nonzero(deck.forces)
    tables = {
        "nodes": [np.arange(1, len(deck.nodes) + 1), *deck.nodes.T],
        "cells": [np.arange(1, len(deck.cells) + 1), *(deck.cells.T + 1)],
        "held": [n + 1, c + 1, c + 1, deck.prescribed[n, c]],
        "forces": [m + 1, d + 1, deck.forces[m, d]],
    }
    for name, columns in tables.items():
        formats = [NUMBER if column.dtype.kind == "f" else "%d" for column in columns]
        np.savetxt(folder / f"{name}.csv", np.column_stack(columns), fmt=formats, delimiter=", ")
    return folder


def read_displacements(path: Path, format: ResultFormat, nodes: Array) -> tuple[Array, float]:
    """Return the displacements (v, 3) of the nodes (v, 3) that a program has written, and their rounding, m.

    The rounding is half a unit of the last digit of the largest displacement; 0 for a format that is no text.

    Raises
    ------
    SolveFailure
        If the file is malformed, or if a node has no displacement, no finite one, or two.
    InputError
        If it can't be read.
    """
    if format == "vtu":
        mesh, moved = read_vtu(read_file(path, LARGEST_RESULT))
        return _at_places(np.asarray(mesh.points, float), moved, nodes), 0.0
    rows = list(_rows(path, from_heading=format == "dat"))
    widths = {len(numbers) for _, numbers in rows}
    digits = max((digits for digits, _ in rows), default=0)  # of a value with as many as the format has
    if format == "dat" or widths == {4}:
        numbers = np.array([row[:4] for _, row in rows if len(row) >= 4]).reshape(-1, 4)
        found, moved = numbers[:, 0] - 1, numbers[:, 1:]
        if not np.all((found >= 0) & (found < len(nodes)) & (found == np.rint(found))):
            raise SolveFailure(f"its result has a node number that is not from 1 to {len(nodes)}")
        return _at_nodes(found.astype(int), moved, len(nodes)), _rounding(np.abs(moved).max(initial=0.0), digits)
    if widths == {6}:
        numbers = np.array([row for _, row in rows])
        return _at_places(numbers[:, :3], numbers[:, 3:], nodes), _rounding(np.abs(numbers[:, 3:]).max(), digits)
    raise SolveFailure("its result has neither 4 numbers in each line (node, ux, uy, uz) nor 6 (x, y, z, ux, uy, uz)")


def read_values(path: Path, names: Sequence[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Return values of quantities, and their rounding, from lines "quantity, value".

    Raises
    ------
    SolveFailure
        If one is missing or not finite.
    """
    found: dict[str, float] = {}
    rounded: dict[str, float] = {}
    for number, line in _lines(path):
        entries = BETWEEN.split(line.strip())
        if entries not in ([""], ["quantity", "value"]):
            if len(entries) != 2 or entries[0] in found:
                raise SolveFailure(f"line {number} of its result is no quantity and its value, or the second of one")
            found[entries[0]] = _number(entries[1], number)
            rounded[entries[0]] = _rounding(found[entries[0]], _digits(entries[1]))
    lacking = [name for name in names if not np.isfinite(found.get(name, np.nan))]
    if lacking:
        raise SolveFailure(f"its result has no finite value of {', '.join(lacking)}")
    return {name: found[name] for name in names}, {name: rounded[name] for name in names}


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    return enumerate(read_file(path, LARGEST_RESULT).decode(errors="replace").splitlines(), 1)


def _number(text: str, line: int) -> float:
    try:
        return float(text)
    except ValueError:
        raise SolveFailure(f"line {line} of its result: found '{without_middle(text)}', which is no number") from None


def _digits(text: str) -> int:
    """Return the number of significant digits of a number."""
    return len(re.split("[eEdD]", text)[0].lstrip("+-0.").replace(".", ""))


def _rounding(value: float, digits: int) -> float:
    """Return half a unit of the last of a value's significant digits; 0 for zero, of which it is not known."""
    return float(10.0 ** (np.floor(np.log10(abs(value))) + 1 - digits) / 2) if 0 < abs(value) < np.inf else 0.0


def _rows(path: Path, from_heading: bool) -> Iterator[tuple[int, list[float]]]:
    """Yield digits of displacements and numbers of lines; of a file with headings those after that of displacements."""
    wanted = not from_heading
    for number, line in _lines(path):
        entries = BETWEEN.split(line.strip(" \t,;"))
        if entries == [""] or line.lstrip().startswith("#"):
            continue
        if from_heading and entries[0][0].isalpha():
            wanted = entries[0] == BEGINS_DISPLACEMENTS
        elif wanted and not (number == 1 and entries[-1] == "uz"):
            yield max(map(_digits, entries[-3:])), [_number(entry, number) for entry in entries]


def _at_places(places: Array, moved: Array, nodes: Array) -> Array:
    """Return displacements by node from those at places; SolveFailure if a place is no node, or a node is two."""
    from scipy.spatial import cKDTree

    if not np.all(np.isfinite(places)):
        raise SolveFailure("its result has a place that is not finite")
    slack = SAME * float(np.ptp(nodes, axis=0).max())
    tree = cKDTree(nodes)
    far, found = tree.query(places)
    if np.any(far > slack):
        where = ", ".join(f"{x:.6g}" for x in places[int(np.argmax(far))])
        raise SolveFailure(f"its result has a place ({where}) at which the mesh has no node")
    if tree.query_pairs(slack):
        raise SolveFailure("nodes of the mesh share a place: results have to give their numbers")
    return _at_nodes(found, moved, len(nodes))


def _at_nodes(found: NDArray[np.int64], moved: Array, count: int) -> Array:
    """Return displacements (count, 3) by node; SolveFailure if a node has none, two, or one that is not finite."""
    times = np.bincount(found, minlength=count)
    if np.any(times != 1):
        node = int(np.argmax(times != 1))
        many = "no displacement" if times[node] == 0 else f"{times[node]} displacements"
        raise SolveFailure(f"its result has {np.count_nonzero(times)} of {count} nodes; node {node + 1} has {many}")
    if not np.all(np.isfinite(moved)):
        node = int(found[np.argmax(~np.isfinite(moved).all(axis=-1))])
        raise SolveFailure(f"its result has a displacement that is not finite, at node {node + 1}")
    ordered = np.empty((count, 3))
    ordered[found] = moved
    return ordered
