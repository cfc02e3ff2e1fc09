"""A deck in Nastran's format: long fields of 16 characters, grid points and elements numbered from 1."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from shellbench.problems.shell.deck.deck import Deck

SHEAR = 5 / 6  # TS/T, the share of the thickness that resists shear; Naghdi's theory here has the same


def _field(value: object, width: int = 16) -> str:
    if isinstance(value, float | np.floating):
        return f"{value:{width}.{width - 7}E}"
    return f"{'' if value is None else value!s:>{width}}"


def _card(name: str, *values: object) -> str:
    """Return an entry in long fields, four to a line."""
    lines = [values[k : k + 4] for k in range(0, len(values), 4)]
    lines += [()] if len(lines) == 1 else []
    heads = [f"{name}*", *("*" for _ in lines[1:])]
    return "\n".join(f"{head:<8}" + "".join(map(_field, line)) for head, line in zip(heads, lines, strict=True))


def _short(name: str, *values: object) -> str:
    """Return an entry in short fields, eight to a line."""
    lines = [values[k : k + 8] for k in range(0, len(values), 8)]
    heads = [name, *("" for _ in lines[1:])]
    return "\n".join(
        f"{head:<8}" + "".join(_field(v, 8) for v in line) for head, line in zip(heads, lines, strict=True)
    )


def _vectors(name: str, vectors: ArrayLike) -> Iterable[str]:
    """Return an entry for each grid point that a vector of (v, 3) acts on."""
    array = np.asarray(vectors)
    return (_card(name, 1, 1 + v, 0, 1.0, *array[v]) for v in np.flatnonzero(array.any(axis=-1)))


def bulk_data(deck: Deck, element: str, parameters: Iterable[tuple[str, object]] = (), normals: bool = False) -> str:
    """Write a deck: a linear static solution that prints all displacements.

    Loads act on grid points, supports hold their components along x, y and z.

    Parameters
    ----------
    deck
        Nodes, cells, supports and loads.
    element
        Name of the entry of its elements, such as "CQUAD4"; those that end in K are thin.
    parameters
        Names and values of PARAM entries.
    normals
        Whether the surface's normal is given at each grid point (SNORM).
    """
    shear = () if element.endswith("K") else (1, SHEAR)
    material = deck.part.case.isotropic
    lines = ["SOL 1", "CEND", "DISPLACEMENT = ALL", "SPC = 1", "LOAD = 1", "BEGIN BULK"]
    lines += [_short("PARAM", f"{name:<8}", value) for name, value in parameters]
    lines.append(_card("MAT1", 1, float(material.youngs_modulus), None, float(deck.poissons_ratio)))
    bending = None if material.bending_factor == 1.0 else float(material.bending_factor)  # 12 I/T^3
    lines.append(_card("PSHELL", 1, 1, float(material.thickness), 1, bending, *shear))
    lines += [_short(element, 1 + e, 1, *(1 + cell)) for e, cell in enumerate(deck.cells)]
    lines += [_card("GRID", 1 + v, None, *place) for v, place in enumerate(deck.nodes)]
    if normals:
        lines += [_card("SNORM", 1 + v, 0, *normal) for v, normal in enumerate(deck.normals)]
    lines += _vectors("FORCE", deck.forces[:, :3])
    lines += _vectors("MOMENT", deck.forces[:, 3:])
    still = deck.held & (deck.prescribed == 0)
    for v in np.flatnonzero(still.any(axis=-1)):
        lines.append(_short("SPC1", 1, "".join(str(1 + c) for c in np.flatnonzero(still[v])), 1 + v))
    for v, c in np.argwhere(deck.held & ~still):
        lines.append(_card("SPC", 1, 1 + v, 1 + c, float(deck.prescribed[v, c])))
    return "\n".join([*lines, "ENDDATA", ""])
