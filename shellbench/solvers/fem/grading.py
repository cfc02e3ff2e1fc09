"""Mesh lines: uniform, or graded toward the points where forces act."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import PointLoad
from shellbench.problems.shell.places import Point
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]

FEWEST = 2  # cells of a part that is graded toward one end, or half of another
SAME = 1e-9  # coordinates that differ by less of the side are the same


def singular_points(case: Case) -> list[tuple[float, float]]:
    """Return the points where a concentrated force acts, point loads and point supports, and the case's focus."""
    names = [*case.focus, *(name for load in case.loads if isinstance(load, PointLoad) for name in load.on)]
    places = [case.places[name] for name in names] + [place for _, place in case.supported_places()]
    return sorted({place.xi for place in places if isinstance(place, Point)})


def segment(cells: int, graded: tuple[bool, bool], exponent: float) -> Array:
    """Return lines (cells + 1,) from 0 to 1 with sizes that shrink toward the graded ends.

    Raises
    ------
    ValueError
        If both ends are graded and the number of cells is odd.
    """
    match graded:
        case (False, False):
            return np.linspace(0.0, 1.0, cells + 1)
        case (True, False):
            return np.asarray(np.linspace(0.0, 1.0, cells + 1) ** exponent)
        case (False, True):
            return 1.0 - segment(cells, (True, False), exponent)[::-1]
        case _:
            half, odd = divmod(cells, 2)
            if odd:
                raise ValueError("a segment that is graded toward both ends needs an even number of cells")
            first = segment(half, (True, False), exponent) / 2
            return np.concatenate([first, 1.0 - first[-2::-1]])


def marked_coordinates(case: Case, axis: int) -> list[float]:
    """Return the different coordinates of the singular points along an axis, increasing."""
    domain = case.surface.domain
    slack = SAME * domain.size[axis]
    marks: list[float] = []
    for mark in sorted(float(domain.wrap(point)[axis]) for point in singular_points(case)):
        seam = domain.periodic[axis] and domain.upper[axis] - mark <= slack  # the other name of the lower bound
        place = domain.lower[axis] if seam else mark
        if all(abs(place - known) > slack for known in marks):
            marks.append(place)
    return sorted(marks)


def axis_lines(case: Case, axis: int, cells: int, exponent: float) -> Array:
    """Return the mesh lines of a coordinate.

    The coordinate is divided at the singular points; each divided part counts as two halves if it is graded toward
    both ends or toward none. The longest of these gets `cells` cells, and shorter ones fewer, so that the cells on
    either side of a singular point are alike.
    """
    domain = case.surface.domain
    lower, upper = domain.lower[axis], domain.upper[axis]
    slack = SAME * domain.size[axis]
    marks = marked_coordinates(case, axis)
    if domain.periodic[axis]:
        stops = [*marks, marks[0] + domain.size[axis]] if marks else [lower, upper]
        graded = [bool(marks)] * len(stops)
    else:
        stops = [lower, *(m for m in marks if lower + slack < m < upper - slack), upper]
        graded = [any(abs(m - stop) <= slack for m in marks) for stop in stops]
    ends = list(pairwise(graded))
    halves = [1 if first != second else 2 for first, second in ends]
    reaches = np.diff(stops) / halves
    counts = np.ceil(cells * (reaches / reaches.max()) ** (1 / exponent) - SAME).astype(int)
    lines = [np.array([stops[0]])]
    for (start, stop), toward, parts, count in zip(pairwise(stops), ends, halves, counts, strict=True):
        inside = segment(parts * max(int(count), FEWEST), toward, exponent)[1:-1]
        lines += [start + (stop - start) * inside, np.array([stop])]
    return np.concatenate(lines)


def graded_mesh(case: Case, cells: tuple[int, int], exponent: float) -> TensorMesh:
    """Return a mesh with `cells` along each coordinate as `axis_lines` counts them."""
    return TensorMesh(
        case.surface.domain,
        (axis_lines(case, 0, cells[0], exponent), axis_lines(case, 1, cells[1], exponent)),
    )
