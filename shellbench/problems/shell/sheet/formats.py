"""Decks as files: Abaqus and CalculiX (.inp), Nastran (.bdf), Gmsh (.msh), VTK (.vtu), and the nodal loads (.csv).

A deck is a step of a path. The nodal loads and supports of a step are those at its end, and programs go there from the
end of the step before. Numbers have as many digits as the fields of the formats take.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.deck.cells import MESHIO, Shape
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.nodal import held_components
from shellbench.problems.shell.question.places import Edge, Point, Whole

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Element:
    """An element by the shape of its cells, and its name in Nastran."""

    shape: Shape
    nastran: str


ELEMENTS: Mapping[str, Element] = {  # by their names in Abaqus and CalculiX
    "S3": Element("tri3", "CTRIA3"),
    "S4": Element("quad4", "CQUAD4"),
    "S4R": Element("quad4", "CQUAD4"),
    "S6": Element("tri6", "CTRIA6"),
    "S8R": Element("quad8", "CQUAD8"),
}
K6ROT = "100."  # stiffness of rotations about the normal: on flat cells of a curved shell, 0 gives no limit
PER_LINE = 8  # numbers
ABAQUS = "** in Abaqus: "  # before lines that CalculiX must not read
SMALLEST_LOAD = 1e-14  # of the largest, which is rounding
FIRST_STEP = 0.1  # of a step at large displacements
MOST_STEPS = 1000


def writers(decks: Sequence[Deck], element: str, title: str) -> dict[str, Callable[[Path], None]]:
    """Return by the ending of a file's name the function that writes it.

    Parameters
    ----------
    decks
        One mesh at increasing load factors, a step each.
    element
        One of `ELEMENTS`.
    title
        A line for the heads of files.
    """
    return {
        ".inp": lambda path: _write_lines(path, _abaqus(decks, element, title)),
        ".bdf": lambda path: _write_lines(path, _nastran(decks, ELEMENTS[element].nastran, title)),
        ".msh": lambda path: _write_gmsh(path, decks[-1]),
        ".vtu": lambda path: _write_vtu(path, decks[-1]),
        "_loads.csv": lambda path: _write_loads(path, decks),
    }


def set_name(place: str) -> str:
    """Return the name of a place as that of a set of nodes."""
    return place.replace(",", "_").upper()


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    with path.open("w", encoding="ascii", errors="replace", newline="\n") as file:
        file.writelines(f"{line}\n" for line in lines)


def _rows(numbers: Integers) -> Iterator[str]:
    for start in range(0, len(numbers), PER_LINE):
        yield ", ".join(str(n + 1) for n in numbers[start : start + PER_LINE])


def _real(value: float) -> str:
    return f"{value:.12e}"  # CalculiX reads 20 letters


def _bordering(deck: Deck) -> Mapping[str, Integers]:
    """Return the cells along each edge: those with a side on it."""
    edges = (name for name, place in deck.part.case.places.items() if isinstance(place, Edge))
    return {name: np.flatnonzero(np.isin(deck.cells, deck.sets[name]).sum(axis=1) > 1) for name in edges}


def _loads(deck: Deck) -> Iterator[tuple[int, int, float]]:
    """Yield node, component and value of each nodal force and moment that is more than rounding."""
    for part in (slice(0, 3), slice(3, 6)):
        least = SMALLEST_LOAD * float(np.abs(deck.forces[:, part]).max(initial=0.0))
        for node, component in np.argwhere(np.abs(deck.forces[:, part]) > least):
            yield int(node), part.start + int(component), float(deck.forces[node, part.start + component])


def _abaqus(decks: Sequence[Deck], element: str, title: str) -> Iterator[str]:
    deck = decks[-1]
    yield from ("*HEADING", title, "*NODE, NSET=ALL")
    yield from (f"{n}, {', '.join(map(_real, x))}" for n, x in enumerate(deck.nodes, 1))
    yield f"*ELEMENT, TYPE={element}, ELSET=SHELL"
    yield from (f"{n}, {', '.join(str(v + 1) for v in cell)}" for n, cell in enumerate(deck.cells, 1))
    for kind, sets in (("NSET", deck.sets), ("ELSET", _bordering(deck))):
        for name, members in sets.items():
            yield f"*{kind}, {kind}={set_name(name)}"
            yield from _rows(members)
    yield from ("*MATERIAL, NAME=MATERIAL", "*ELASTIC")
    yield f"{_real(deck.part.case.isotropic.youngs_modulus)}, {_real(deck.poissons_ratio)}"
    yield from ("*SHELL SECTION, ELSET=SHELL, MATERIAL=MATERIAL", _real(deck.part.case.isotropic.thickness))
    # CalculiX makes solids of shells, whose nodes have the mean rotation of points on the normal, so that of axes which
    # span the normal one depends on the others.
    held_turns = zip("XYZ", deck.held_without_drilling[:, 3:].T, strict=True)
    turns = {axis: np.flatnonzero(held) for axis, held in held_turns if held.any()}
    for axis, nodes in turns.items():
        yield f"*NSET, NSET=NO_TURN_{axis}"
        yield from _rows(nodes)
    yield "*BOUNDARY"
    told = np.zeros_like(deck.held)
    for support, place in deck.part.case.supported_places():
        yield f"** {support.name}"
        nodes = deck.grid.nodes_of(place)
        named = set_name(place.name) if place.name in deck.sets else "ALL" if isinstance(place, Whole) else ""
        names = [named] if named else [str(n + 1) for n in nodes]
        for component in held_components(deck.part.case, support, place) or ():
            told[nodes, component] = True
            mark = "" if component < 3 else ABAQUS
            yield from (f"{mark}{name}, {component + 1}, {component + 1}" for name in names)
    for node, component in np.argwhere((deck.held & ~told)[:, :3]):
        yield from ("** against a rigid motion", f"{node + 1}, {component + 1}, {component + 1}")
    for axis in turns:
        yield f"NO_TURN_{axis}, {4 + 'XYZ'.index(axis)}, {4 + 'XYZ'.index(axis)}"
    for step in decks:
        yield f"** load factor {step.at:g}"
        yield "*STEP" if deck.part.whole.linear else f"*STEP, NLGEOM=YES, INC={MOST_STEPS}"
        yield from ["*STATIC"] + ([] if deck.part.whole.linear else [f"{FIRST_STEP}, 1."])
        moved = np.argwhere(step.prescribed != 0)
        yield from ["*BOUNDARY"] * bool(len(moved))
        yield from (f"{n + 1}, {c + 1}, {c + 1}, {_real(step.prescribed[n, c])}" for n, c in moved)
        loads = list(_loads(step))
        yield from ["*CLOAD"] * bool(loads)
        yield from (f"{n + 1}, {c + 1}, {_real(value)}" for n, c, value in loads)
        last = f"FREQUENCY={MOST_STEPS}"  # at the end of the step only
        yield from (f"*NODE PRINT, NSET=ALL, {last}", "U", f"*NODE FILE, {last}", "U")
        yield from (f"*EL PRINT, ELSET=SHELL, TOTALS=YES, {last}", "ELSE", "*END STEP")


def _large(name: str, *fields: int | float | str) -> Iterator[str]:
    """Yield the lines of a card in large fields, four of 16 letters a line."""
    words = [f"{f:.9E}" if isinstance(f, float) else str(f) for f in fields]
    for start in range(0, len(words), 4):
        head = f"{name}*" if start == 0 else "*"
        yield head.ljust(8) + "".join(word.rjust(16) for word in words[start : start + 4])


def _small(name: str, *fields: int | str) -> Iterator[str]:
    """Yield the lines of a card in small fields, eight of 8 letters a line."""
    for start in range(0, len(fields), 8):
        head = name if start == 0 else ""
        yield head.ljust(8) + "".join(str(f).rjust(8) for f in fields[start : start + 8])


def _nastran(decks: Sequence[Deck], entry: str, title: str) -> Iterator[str]:
    deck, linear = decks[-1], decks[-1].part.whole.linear
    yield from (f"SOL {101 if linear else 106}", "CEND", f"TITLE = {title[:60]}", "DISPLACEMENT = ALL", "ESE = ALL")
    moves = any(np.any(step.prescribed) for step in decks)
    supports = dict(enumerate(decks, 1)) if moves else {1: deck}  # MYSTRAN takes one set
    for number in range(1, len(decks) + 1):
        yield from (f"SUBCASE {number}", f"  SPC = {number if number in supports else 1}")
        yield from [f"  LOAD = {number}"] * bool(np.any(decks[number - 1].forces)) + ["  NLPARM = 1"] * (not linear)
    yield from ("BEGIN BULK", "PARAM,POST,-1", f"PARAM,K6ROT,{K6ROT}")
    yield from [] if linear else ["PARAM,LGDISP,1", "NLPARM,1,10"]
    for name, nodes in deck.sets.items():
        yield f"$ nodes of {set_name(name)}:"
        yield from (f"$   {row}" for row in _rows(nodes))
    for n, x in enumerate(deck.nodes, 1):
        yield from _large("GRID", n, "", *map(float, x))
    for n, cell in enumerate(deck.cells, 1):
        yield from _small(entry, n, 1, *(int(v) + 1 for v in cell))
    material = deck.part.case.isotropic
    yield from _large("MAT1", 1, material.youngs_modulus, "", material.poissons_ratio)
    sheared = deck.part.whole.theory.startswith("naghdi") or deck.grid.order == 2  # those elements always shear
    yield f"$ {'with' if sheared else 'no MID3: without'} transverse shear"
    yield from _large("PSHELL", 1, 1, material.thickness, 1, "", 1 if sheared else "")
    for number, step in supports.items():
        for n in np.flatnonzero(step.held.any(axis=1)).tolist():
            at_rest = np.flatnonzero(step.held[n] & (step.prescribed[n] == 0))
            yield from _small("SPC1", number, "".join(str(c + 1) for c in at_rest), n + 1) if len(at_rest) else ()
        for n, c in np.argwhere(step.prescribed != 0).tolist():
            yield from _large("SPC", number, n + 1, c + 1, float(step.prescribed[n, c]))
    for number, step in enumerate(decks, 1):
        for n, c, value in _loads(step):
            axes = [float(c % 3 == axis) for axis in range(3)]
            yield from _large("FORCE" if c < 3 else "MOMENT", number, n + 1, "", value, *axes)
    yield "ENDDATA"


def _write_gmsh(path: Path, deck: Deck) -> None:
    """Write nodes and cells, and a physical group for each edge and point."""
    import meshio

    groups: list[tuple[str, str, Any, int]] = [("SHELL", MESHIO[deck.grid.shape], deck.cells, 2)]
    for name, place in deck.part.case.places.items():
        if isinstance(place, Edge):
            line = deck.grid.edge(place.axis, place.side == "max")
            first = np.arange(0, len(line) - 1, deck.grid.order)
            ends = [line[first], line[first + deck.grid.order], *([line[first + 1]] if deck.grid.order == 2 else [])]
            sides = np.stack(ends, axis=-1)
            sides = sides[np.isin(sides, deck.sets[name]).all(axis=1)]
            groups.append((set_name(name), "line3" if deck.grid.order == 2 else "line", sides, 1))
        elif isinstance(place, Point) and name in deck.sets:
            groups.append((set_name(name), "vertex", deck.sets[name][:, None], 0))
    tags = [np.full(len(cells), number) for number, (_, _, cells, _) in enumerate(groups, 1)]
    mesh = meshio.Mesh(
        deck.nodes,
        [(cell, cells) for _, cell, cells, _ in groups],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([number, size]) for number, (name, _, _, size) in enumerate(groups, 1)},
    )
    meshio.write(path, mesh, file_format="gmsh22", binary=False)


def _write_vtu(path: Path, deck: Deck) -> None:
    """Write nodes and cells; at the nodes the loads, what is held, normals, and 1 on each set."""
    import meshio

    at_nodes: dict[str, Array] = {"force": deck.forces[:, :3], "moment": deck.forces[:, 3:], "normal": deck.normals}
    at_nodes |= {"held_displacement": deck.held[:, :3].astype(float), "held_rotation": deck.held[:, 3:].astype(float)}
    for name, nodes in deck.sets.items():
        at_nodes[set_name(name)] = np.isin(np.arange(len(deck.nodes)), nodes).astype(float)
    meshio.Mesh(deck.nodes, [(MESHIO[deck.grid.shape], deck.cells)], point_data=at_nodes).write(path)


def _write_loads(path: Path, decks: Sequence[Deck]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["at", "node", "x", "y", "z", "Fx", "Fy", "Fz", "Mx", "My", "Mz"])
        for deck in decks:
            at = "" if deck.part.whole.linear and len(decks) == 1 else f"{deck.at:g}"
            for node in sorted({node for node, _, _ in _loads(deck)}):
                table.writerow([at, node + 1, *map(repr, map(float, (*deck.nodes[node], *deck.forces[node])))])
