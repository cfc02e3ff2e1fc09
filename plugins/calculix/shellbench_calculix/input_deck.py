"""The deck that CalculiX reads.

CalculiX makes solids of shell elements. A displacement of a shell's node is the mean of those at its top and bottom. A
rotation or a moment acts on the mean rotation of its fibre. Turning about the normal means nothing to a fibre: the
manual (section "Eight-node shell element") forbids to prescribe it unless all three rotations are, and wants a local
system where a held rotation is along no axis. At such nodes (planes of symmetry across a curved shell) the deck has a
system of its own: along the held rotation in the shell, across it, and along the normal.

Quadratic elements have nodes in the middle of the thickness, too, which a held displacement leaves free. At a plane of
symmetry that softens the last row of cells (.04 % of the roof's deflection with 16 cells, a quarter of it with 64), so
that whole shells are solved unless a case asks for such planes.
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
    """Return the deck of a shell with an element, such as "S8R"; SolveFailure if supports can't be told."""
    lines = ["*NODE,NSET=ALL", *_rows(deck.nodes)]
    lines += [f"*ELEMENT,TYPE={element},ELSET=SHELL"]
    lines += [f"{e},{','.join(map(str, nodes))}" for e, nodes in enumerate(deck.cells + 1, 1)]
    if normals:
        lines += ["*NORMAL"]
        lines += [
            f"{e},{v + 1},{_numbers(deck.normals[v])}" for e, nodes in enumerate(deck.cells, 1) for v in nodes
        ]
    lines += ["*MATERIAL,NAME=M", "*ELASTIC", _numbers([deck.youngs_modulus[0], deck.poissons_ratio])]
    lines += ["*SHELL SECTION,ELSET=SHELL,MATERIAL=M", _numbers(deck.thickness[:1])]
    systems: dict[int, Array] = {}
    held: list[str] = []
    for v in np.flatnonzero(deck.held.any(axis=-1)):
        frame, rotations = _held_rotations(deck.held[v, 3:], deck.normals[v])
        held += [f"{v + 1},{4 + k},{4 + k},0." for k in rotations]
        if frame is None:
            held += [f"{v + 1},{c + 1},{c + 1},{_numbers([deck.prescribed[v, c]])}" for c in _true(deck.held[v, :3])]
        else:
            systems[v] = frame
            held += _held_displacements(int(v), frame, deck.held[v, :3], deck.prescribed[v, :3])
    for v, frame in systems.items():
        lines += [f"*NSET,NSET=N{v + 1}", f"{v + 1}", f"*TRANSFORM,NSET=N{v + 1},TYPE=R", _numbers(frame[:2].ravel())]
    equations = [line for line in held if line.startswith("*EQUATION")]
    lines += [line.replace(" ", "\n") for line in equations]
    lines += ["*BOUNDARY", *(line for line in held if not line.startswith("*"))]
    lines += ["*STEP", "*STATIC", "*CLOAD", *_loads(deck, systems)]
    return "\n".join([*lines, "*NODE PRINT,NSET=ALL,GLOBAL=YES", "U", "*END STEP", ""])


def _numbers(values: Array | list[float]) -> str:
    return ",".join(f"{value:.{DIGITS}g}" for value in np.asarray(values, float))


def _rows(values: Array) -> Iterator[str]:
    return (f"{v},{_numbers(row)}" for v, row in enumerate(values, 1))


def _true(mask: NDArray[np.bool_]) -> list[int]:
    return [int(k) for k in np.flatnonzero(mask)]


def _held_rotations(mask: NDArray[np.bool_], normal: Array) -> tuple[Array | None, list[int]]:
    """Return the system (3, 3) of a node, None for x, y and z, and the rotations 0, 1, 2 about its axes that are held."""
    across = np.eye(3)[mask] - np.outer(normal[mask], normal)  # their parts in the shell
    sizes, directions = np.linalg.svd(across)[1:] if len(across) else (np.zeros(0), np.eye(3))
    rank = int(np.count_nonzero(sizes > ALONG))
    if rank != 1:
        return None, [0, 1, 2][: 3 * (rank == 2)]
    tangent = directions[0]
    axis = int(np.argmax(np.abs(tangent)))
    if np.delete(np.abs(tangent), axis).max() < ALONG:
        return None, [axis]
    return np.stack([tangent, np.cross(normal, tangent), normal]), [0]


def _held_displacements(v: int, frame: Array, mask: NDArray[np.bool_], values: Array) -> Iterator[str]:
    """Yield what holds displacements along x, y and z of a node with a system of its own."""
    for c in range(3):
        if mask.all():
            yield f"{v + 1},{c + 1},{c + 1},{_numbers([float(frame[c] @ values)])}"
        elif mask[c]:
            if values[c]:
                raise SolveFailure("a node on a plane of symmetry is moved, which CalculiX's equations can't tell")
            shares = [k for k in np.argsort(-np.abs(frame[:, c])) if abs(frame[k, c]) > ALONG]
            if len(shares) == 1:
                yield f"{v + 1},{shares[0] + 1},{shares[0] + 1},0."
            else:
                yield f"*EQUATION {len(shares)} " + ",".join(f"{v + 1},{k + 1},{_numbers([frame[k, c]])}" for k in shares)


def _loads(deck: Deck, systems: dict[int, Array]) -> Iterator[str]:
    """Yield forces and moments on nodes, these without their part along the normal, which does no work on a fibre."""
    turns = deck.forces[:, 3:]
    turns = turns - np.sum(turns * deck.normals, axis=-1, keepdims=True) * deck.normals
    for v, pair in enumerate(np.stack([deck.forces[:, :3], turns], axis=1)):
        local = pair @ systems[v].T if v in systems else pair
        for k in np.flatnonzero(local):
            yield f"{v + 1},{k + 1},{_numbers([local.ravel()[k]])}"
