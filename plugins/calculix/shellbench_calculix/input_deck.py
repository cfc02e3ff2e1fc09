"""The deck that CalculiX reads.

CalculiX makes solids of shell elements. A displacement of a shell's node is the mean of those at its top and bottom. A
rotation or a moment acts on the mean rotation of its fibre. Turning about the normal means nothing to a fibre: the
manual (section "Eight-node shell element") forbids to prescribe it unless all three rotations are, and wants a local
system where a held rotation is along no axis, as on a plane of symmetry across a curved shell. With such a system the
roof is .04 % too soft with 16 x 16 cells of S8R, and .2 % with 64; CalculiX issue 43 may be the reason. This deck has
none. Whole shells are solved unless `symmetry` is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problems.shell.deck.deck import Deck

Array = NDArray[np.float64]
ALONG = 1e-9  # sine of an angle that is rounding
DIGITS = 13  # of numbers: CalculiX reads the first 20 characters, and says nothing about the rest


def input_deck(deck: Deck, element: str, normals: bool) -> str:
    """Return the deck of a shell with an element, such as "S8R".

    Raises
    ------
    SolveFailure
        If a rotation is held that is along no axis.
    """
    lines = ["*NODE,NSET=ALL", *(f"{v},{_numbers(place)}" for v, place in enumerate(deck.nodes, 1))]
    lines += [f"*ELEMENT,TYPE={element},ELSET=SHELL"]
    lines += [f"{e},{','.join(map(str, nodes))}" for e, nodes in enumerate(deck.cells + 1, 1)]
    if normals:
        lines += ["*NORMAL"]
        lines += [f"{e},{v + 1},{_numbers(deck.normals[v])}" for e, nodes in enumerate(deck.cells, 1) for v in nodes]
    lines += ["*MATERIAL,NAME=M", "*ELASTIC", _numbers([deck.youngs_modulus[0], deck.poissons_ratio])]
    lines += ["*SHELL SECTION,ELSET=SHELL,MATERIAL=M", _numbers(deck.thickness[:1])]
    lines += ["*BOUNDARY", *_supports(deck), "*STEP", "*STATIC", "*CLOAD", *_loads(deck)]
    return "\n".join([*lines, "*NODE PRINT,NSET=ALL", "U", "*END STEP", ""])


def _numbers(values: Array | list[float]) -> str:
    return ",".join(f"{value:.{DIGITS}g}" for value in np.asarray(values, float))


def _supports(deck: Deck) -> Iterator[str]:
    for v in np.flatnonzero(deck.held.any(axis=-1)):
        held = [int(c) for c in np.flatnonzero(deck.held[v, :3])] + held_rotations(deck.held[v, 3:], deck.normals[v])
        for c in held:
            yield f"{v + 1},{c + 1},{c + 1},{_numbers([deck.prescribed[v, c]])}"


def held_rotations(mask: NDArray[np.bool_], normal: Array) -> list[int]:
    """Return the rotations 3, 4, 5 to hold so that a fibre (3,) turns about none of some axes; SolveFailure if none do.

    The parts of the axes in the shell span nothing, a line that should be along an axis, or all: then all are held.
    """
    across = np.eye(3)[mask] - np.outer(normal[mask], normal)
    sizes, directions = np.linalg.svd(across)[1:] if len(across) else (np.zeros(0), np.eye(3))
    rank = int(np.count_nonzero(sizes > ALONG))
    if rank != 1:
        return [3, 4, 5][: 3 * (rank == 2)]
    axis = int(np.argmax(np.abs(directions[0])))
    if np.delete(np.abs(directions[0]), axis).max() > ALONG:
        raise SolveFailure("a held rotation is along no axis, which CalculiX can't tell rightly in shells (issue 43)")
    return [3 + axis]


def _loads(deck: Deck) -> Iterator[str]:
    """Yield forces and moments on nodes, these without their part along the normal, which does no work on a fibre."""
    turns = deck.forces[:, 3:]
    turns = turns - np.sum(turns * deck.normals, axis=-1, keepdims=True) * deck.normals
    for v, load in enumerate(np.concatenate([deck.forces[:, :3], turns], axis=-1)):
        for c in np.flatnonzero(load):
            yield f"{v + 1},{c + 1},{_numbers([load[c]])}"
