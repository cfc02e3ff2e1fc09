"""Mesh lines: uniform, or graded toward points with forces, edges at singular corners, and thin layers."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.features import quickness_in_words
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.solvers.fem.mesh.basis import CUBIC, ROUNDING, SAME, Degree
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Cells = tuple[int, int]

FEWEST = 2  # cells of a part that is graded toward one end, or half of another
USUAL = 8  # cells a side of meshes that take exactly the cells that resolve a stiffness
MOST_ADDED = 1600  # of these in one mesh: a formula that would add more is left to even meshes
COARSE = 4  # times as long as cells that resolve a stiffness: longer cells of a mesh do not resolve it
APART = 1 / 16  # of the side: cells further from each other belong to two places
SIZE_POINTS = 9  # a side of the grid on which the size of a shell, and its mean sides, are measured
NEAR = 0.5  # of the cells beside it: a line that is nearer to another is left out


def singular_points(case: Case) -> list[tuple[float, float]]:
    """Return the points where a force acts: point loads and supports, narrow loads, and the case's focus."""
    names = [*case.focus, *(name for load in case.loads if isinstance(load, PointLoad) for name in load.on)]
    places = [case.places[name] for name in names] + [place for _, place in case.supported_places()]
    peaks = (peak for feature in case.features for peak in feature.peaks)
    return sorted({*(place.xi for place in places if isinstance(place, Point)), *peaks})


def graded_segment(cells: int, exponents: tuple[float, float]) -> Array:
    """Return lines (cells + 1,) from 0 to 1 whose distances from either end grow by these powers; 1 grades nothing.

    Raises
    ------
    ValueError
        If both ends are graded and the number of cells is odd.
    """
    first, last = exponents
    if last == 1:
        return np.asarray(np.linspace(0.0, 1.0, cells + 1) ** first)
    if first == 1:
        return np.asarray(1.0 - graded_segment(cells, (last, first))[::-1])
    half, odd = divmod(cells, 2)
    if odd:
        raise ValueError("a segment that is graded toward both ends needs an even number of cells")
    return np.concatenate([graded_segment(half, (first, 1)) / 2, 1.0 - graded_segment(half, (last, 1))[-2::-1] / 2])


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


def break_coordinates(case: Case, axis: int) -> list[float]:
    """Return the coordinates at which parts of edges begin or end along an axis, or formulas have kinks."""
    parts = (place for place in case.places.values() if isinstance(place, Edge) and 1 - place.axis == axis)
    return sorted({*case.kinks[axis], *(at for part in parts if part.between for at in part.between)})


Breaks = Mapping[float, float]  # coordinate -> exponent of the grading toward it
Ends = tuple[tuple[float, float], tuple[float, float]]
UNGRADED: Ends = ((1.0, 1.0), (1.0, 1.0))
UNBROKEN: tuple[Breaks, Breaks] = ({}, {})


def axis_lines(
    case: Case,
    axis: int,
    cells: int,
    exponent: float,
    ends: tuple[float, float] = (1.0, 1.0),
    breaks: Breaks = UNBROKEN[0],
) -> Array:
    """Return the mesh lines of a coordinate.

    The coordinate is divided at two kinds of places. It is graded toward the singular points by `exponent`. It is
    graded toward ends of parts of edges and kinks of formulas by the exponents of `breaks`, if they name these. Toward
    its `ends` it is graded by their exponents. Each divided part counts as two halves if it is graded toward both ends
    or toward none. The longest of these gets `cells` cells, and shorter ones fewer, so that the cells on either side of
    a singular point are alike.
    """
    # 1. Collect the places of grading with their exponents, and merge coinciding ones.
    # 2. Divide the coordinate at them; a closed one begins at its first place.
    # 3. Give each part cells in proportion to its reach, and grade it toward its ends.
    # 4. Add lines where stiffness varies quickly.
    domain = case.surface.domain
    lower, upper = domain.lower[axis], domain.upper[axis]
    slack = SAME * domain.size[axis]
    graded = dict.fromkeys(marked_coordinates(case, axis), exponent)
    for at in break_coordinates(case, axis):
        near = next((mark for mark in graded if abs(mark - at) <= slack), at)
        graded[near] = max(graded.get(near, 1.0), breaks.get(at, 1.0))
    marks = sorted(graded)
    if domain.periodic[axis]:
        if marks and marks[-1] - marks[0] >= domain.size[axis] - slack:  # both names of the seam
            graded[marks[0]] = max(graded[marks[0]], graded[marks.pop()])
        stops = [*marks, marks[0] + domain.size[axis]] if marks else [lower, upper]
        powers = [*(graded[mark] for mark in marks), graded[marks[0]]] if marks else [1.0, 1.0]
    else:
        stops = [lower, *(m for m in marks if lower + slack < m < upper - slack), upper]
        powers = [max((graded[m] for m in marks if abs(m - stop) <= slack), default=1.0) for stop in stops]
        powers[0], powers[-1] = max(powers[0], ends[0]), max(powers[-1], ends[1])
    toward = list(pairwise(powers))
    halves = [1 if (first > 1) != (second > 1) else 2 for first, second in toward]
    reaches = np.diff(stops) / halves
    counts = np.ceil(cells * (reaches / reaches.max()) ** (1 / exponent) - SAME).astype(int)
    lines = [np.array([stops[0]])]
    for (start, stop), exponents, parts, count in zip(pairwise(stops), toward, halves, counts, strict=True):
        inside = graded_segment(parts * max(int(count), FEWEST), exponents)[1:-1]
        lines += [start + (stop - start) * inside, np.array([stop])]
    return _refine_at_quick_stiffness(case, axis, cells, np.concatenate(lines))


def _refine_at_quick_stiffness(case: Case, axis: int, cells: int, lines: Array) -> Array:
    """Return the mesh lines with further ones where the stiffness of a case varies quickly.

    At `USUAL` cells these are the ends of the cells that resolve it; other meshes have more or fewer in proportion.
    """
    for feature in case.features:
        both = [feature.division.ends(a) for a in (0, 1)]
        ends = both[axis]
        if feature.role != "stiffness" or not len(ends) or (len(both[0]) + 1) * (len(both[1]) + 1) > MOST_ADDED:
            continue
        # distant places are resolved separately
        for run in np.split(ends, 1 + np.flatnonzero(np.diff(ends) > APART * feature.division.side[axis])):
            count = max(2, round((len(run) - 1) * cells / USUAL))
            at = np.interp(np.linspace(0, len(run) - 1, count + 1), np.arange(len(run)), run)
            if case.surface.domain.periodic[axis]:
                at = np.sort(lines[0] + np.mod(at - lines[0], lines[-1] - lines[0]))
            # lines as near to another as its own neighbours are left out, except required ones
            gaps = np.diff(at)
            nearest = np.abs(lines[:, None] - at).argmin(axis=1)
            near = np.abs(lines - at[nearest]) < NEAR * np.minimum(np.r_[gaps, gaps[-1]], np.r_[gaps[0], gaps])[nearest]
            fixed = [lines[0], lines[-1], *break_coordinates(case, axis), *marked_coordinates(case, axis)]
            kept = ~near | (np.abs(lines[:, None] - fixed).min(axis=1) <= SAME * case.surface.domain.size[axis])
            taken = np.abs(lines[kept][:, None] - at).min(axis=0) > ROUNDING * case.surface.domain.size[axis]
            lines = np.sort(np.concatenate([lines[kept], at[taken]]))
    return lines


def why_unresolved(case: Case, mesh: TensorMesh) -> str | None:
    """Return a formula that varies within less than a cell of the mesh, and its place, as one clause, or None."""
    for feature in case.features if not case.modal else ():
        division = feature.division
        for axis in (0, 1) if feature.role == "stiffness" else ():
            there = division.narrow[:, axis]
            middles = mesh.into_period((division.low + division.high)[there] / 2)[:, axis]
            line = mesh.lines[axis]
            cells = np.diff(line)[np.clip(np.searchsorted(line, middles) - 1, 0, len(line) - 2)]
            needed = (division.high - division.low)[there, axis]
            if np.any(cells > COARSE * needed):
                return f"{feature.what} {quickness_in_words(case, feature, axis)}, and the mesh does not resolve it"
    return None


def shell_size(case: Case) -> float:
    """Return the longest side of the box around the midsurface, m."""
    position = case.surface.position(case.surface.domain.grid(SIZE_POINTS, SIZE_POINTS))
    return float(np.ptp(position, axis=(0, 1)).max())


def graded_mesh(
    case: Case,
    cells: tuple[int, int],
    exponent: float,
    ends: Ends = UNGRADED,
    breaks: tuple[Breaks, Breaks] = UNBROKEN,
    degree: Degree = CUBIC,
) -> TensorMesh:
    """Return a mesh with `cells` along each coordinate as `axis_lines` counts them."""
    first, second = (axis_lines(case, a, cells[a], exponent, ends[a], breaks[a]) for a in (0, 1))
    return TensorMesh(case.surface.domain, (first, second), degree, case.surface.fold_lines)
