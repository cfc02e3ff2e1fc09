"""Sheets: problems as a person and any program take them, in words and as files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from shellbench.protocol.picture import Array, Scene

ANSWERS = ("case", "quantity", "at", "value", "unit", "cells", "unknowns", "seconds")
"""Columns of the table of answers: the last three may stay empty, and `at` where there is one state."""


@dataclass(frozen=True)
class Request:
    """Options of a sheet.

    Attributes
    ----------
    units
        Name of the system of units, such as "mm-N-MPa".
    cells
        Cells across the part, a number for each mesh; the kind chooses if there is none.
    elements
        Names of elements.
    whole
        True for meshes of the whole, not of the part between planes of symmetry.
    """

    units: str
    cells: tuple[int, ...]
    elements: tuple[str, ...]
    whole: bool = False


@dataclass(frozen=True)
class Sketch:
    """A drawing of a surface with what holds and loads it.

    Attributes
    ----------
    xi, position
        Parameters (n1, n2, 2) of points of the surface, and the points (n1, n2, 3).
    part
        (n, 3) outline of the part that is meshed.
    points
        Places (3,) by name.
    spread
        (n, 2, 3) points under a load over an area or along an edge, and its vector there.
    """

    scene: Scene
    xi: Array
    position: Array
    part: Array
    points: Mapping[str, Array]
    spread: Array


@dataclass(frozen=True)
class Sheet:
    """A problem for a person and a program.

    Attributes
    ----------
    name, title
        Of the problem.
    statement
        The question in Markdown.
    files
        Functions that write the files, by their names.
    answers
        Rows of the table of answers, by `ANSWERS`; values are empty.
    sketch
        Its drawing.
    """

    name: str
    title: str
    statement: str
    files: Mapping[str, Callable[[Path], None]]
    answers: tuple[tuple[str, ...], ...]
    sketch: Sketch
