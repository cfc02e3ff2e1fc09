"""Places where formulas vary so quickly that samples may miss it, found by bounds that also hold between samples.

A rectangle is divided until the error of samples of its cells is a small share of the whole. In a cell of size h this
is the error bound of a polynomial through Chebyshev's points,

    e = min( max f - min f,  max |f^(k)|/k! 2 (h/4)^k ),    k = 1 .. 6,

along each coordinate, all from intervals that enclose f and its derivatives on the cell (`Expression.enclosed`). A
narrow peak, a jump, a kink or a pole keeps e large until cells are as small as it is, wherever it is. Smooth formulas
settle in some tens of cells. A cell is halved across the coordinate along which e is larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.expression import Expression
from shellbench.problems.interval import Interval

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Box = tuple[tuple[float, float], tuple[float, float]]  # bounds of xi1 and of xi2; an edge has one of no length
Measure = Literal["integral", "curvature"]
Place = tuple[float, float]
Lines = tuple[tuple[float, ...], tuple[float, ...]]
Group = tuple[Sequence[Expression], float]

TOLERANCES: dict[Measure, float] = {"integral": 1e-5, "curvature": 1e-3}
"""Shares of the whole: a tenth of the finest class of accuracy (1e-4) that answers are judged by. Of the second
derivatives of a surface, which layers average over their length, a thousandth."""
MOST_CELLS = 20_000  # of a formula: more take seconds, and no mesh would resolve such a formula
FIRST = 8  # cells a side, at first
ORDER = 6  # of the polynomials: cells and panels have as many Gauss points a side
AT_ONCE = 0.01  # of the largest share: cells that are halved together have no less
AT_A_TIME = 1024  # cells: their series fit into the cache
SAME_LINE = 1e-9  # of a side: ends of cells that are nearer to a known line lie on it
SHORTEST = 1e-12  # of the side: a shorter cell holds a jump, a kink or a pole
NARROW = 1 / 64  # of the side: samples of all meshes and rules resolve wider features
STRAIGHT = 1e-4  # curvature, in units of slope over side, of a surface that counts as none
POINTLIKE, MOST_PEAKS = NARROW / 16, 8  # of the side: cells that count as a point, and the largest number of these
ALIKE = 1e-6  # relative: longer cells are longer
FARTHER, GROWS = 16, 0.8  # sizes of the last cells at which a pole is tested; a slower growth has an integral
NAMES = ("xi1", "xi2")


@dataclass(frozen=True)
class Division:
    """Cells of a rectangle; in each, polynomials resolve a formula.

    Attributes
    ----------
    low, high
        (n, 2) corners of the cells, which cover the rectangle.
    halved
        (n, 2) whether a cell was halved along each coordinate.
    undecided
        A place where the formula varies more quickly than the smallest cells resolve; None if there is none.
    pole
        A place where it is not finite, or grows without bound; None if there is none.
    """

    low: Array
    high: Array
    halved: Mask
    undecided: Place | None = None
    pole: Place | None = None

    @cached_property
    def narrow(self) -> Mask:
        """(n, 2) whether a cell is narrow along each coordinate."""
        return (self.high - self.low < (1 - ALIKE) * NARROW * self.side) & self.halved

    @cached_property
    def side(self) -> Array:
        """(2,) the sides of the rectangle."""
        return np.asarray(self.high.max(axis=0) - self.low.min(axis=0))

    @cached_property
    def middles(self) -> Array:
        """(k, 2) the middles of narrow cells."""
        there = self.narrow.any(axis=1)
        return (self.low + self.high)[there] / 2

    def ends(self, axis: int) -> Array:
        """Return the ends (k,) of cells that are narrow along a coordinate, increasing."""
        there = self.narrow[:, axis]
        return np.unique([self.low[there, axis], self.high[there, axis]])

    def peaks(self, axes: Sequence[int], most: float) -> list[tuple[Place, float]]:
        """Return the middles and the length of the shortest cells, if these are shorter than `most` of each side.

        `axes` are the coordinates along which they have to be short. A formula with many such places has no peaks.
        """
        if self.undecided is not None:
            return []
        small = np.all((self.narrow & (self.high - self.low < most * self.side))[:, axes], axis=1)
        low, high, found = self.low[small], self.high[small], list[tuple[Place, float]]()
        while len(low) and len(found) <= MOST_PEAKS:
            size = np.prod(np.where(self.side > 0, high - low, 1.0), axis=1)
            near = np.all(np.abs(low - low[np.argmin(size)])[:, axes] <= NARROW * self.side[list(axes)], axis=1)
            core = near & (size <= 2 * size.min())
            found.append((place((low + high)[core].mean(axis=0) / 2), float((high - low)[core][:, axes].min())))
            low, high = low[~near], high[~near]
        return found if len(found) <= MOST_PEAKS else []

    def parts(self, lines: tuple[Array, Array], periodic: tuple[bool, bool]) -> tuple[Array, Array]:
        """Return origins and sizes (k, 2) of parts that make up a tensor mesh, none larger than narrow cells there.

        Parameters
        ----------
        lines
            Of the mesh, increasing; along a periodic coordinate over one period, from anywhere.
        periodic
            Whether each coordinate closes on itself.
        """
        low, high, narrow = self.low, self.high, self.narrow
        for axis in (a for a in (0, 1) if periodic[a]):  # cells below the first line are one period on
            seam = np.clip(lines[axis][0], low[:, axis], high[:, axis])
            before, after = high.copy(), low.copy()
            before[:, axis], after[:, axis] = seam, seam
            turn = self.side * (np.arange(2) == axis)
            low, high = np.concatenate([low + turn, after]), np.concatenate([before + turn, high])
            real = high[:, axis] > low[:, axis]
            low, high, narrow = low[real], high[real], np.concatenate([narrow, narrow])[real]
        shape = (len(lines[0]) - 1, len(lines[1]) - 1)
        slack = SHORTEST * self.side
        first, last = (
            np.stack([np.clip(np.searchsorted(lines[a], at[:, a]) - 1, 0, shape[a] - 1) for a in (0, 1)], axis=1)
            for at in (low + slack, high - slack)
        )
        # 1. Cells of the mesh that are longer than a narrow cell in them are cut.
        # 2. Their parts are their intersections with the cells of the division. Other cells stay whole.
        cut = np.zeros(shape, dtype=bool)
        for k in np.flatnonzero(narrow.any(axis=1)).tolist():
            here = tuple(slice(first[k, a], last[k, a] + 1) for a in (0, 1))
            longer = (np.diff(lines[a])[here[a]] > (1 + ALIKE) * (high - low)[k, a] for a in (0, 1))
            one, other = (each & narrow[k, a] for a, each in enumerate(longer))
            cut[here] |= one[:, None] | other
        begins, ends = (
            np.stack(np.meshgrid(*(each[way] for each in lines), indexing="ij"), axis=-1)
            for way in (slice(None, -1), slice(1, None))
        )
        starts, stops = [begins[~cut]], [ends[~cut]]
        for k in range(len(low)):
            here = tuple(slice(first[k, a], last[k, a] + 1) for a in (0, 1))
            there = cut[here]
            starts.append(np.maximum(begins[here][there], low[k]))
            stops.append(np.minimum(ends[here][there], high[k]))
        origins, sizes = np.concatenate(starts), np.concatenate(stops) - np.concatenate(starts)
        real = np.all(sizes > 0, axis=1)
        return origins[real], sizes[real]


def cut_line(line: Array, at: Array, periodic: bool) -> Array:
    """Return mesh lines with more of them at some coordinates, which may be a period away."""
    if periodic:
        at = line[0] + np.mod(at - line[0], line[-1] - line[0])
    inside = at[(at > line[0]) & (at < line[-1])]
    gap = SHORTEST * (line[-1] - line[0])
    return np.unique([*line, *(x for x in inside if np.abs(line - x).min() > gap)])


def divided(groups: Sequence[Group], box: Box, measure: Measure = "integral", lines: Lines = ((), ())) -> Division:
    """Divide a rectangle until samples resolve the formulas; see `shellbench.problems.features`.

    Parameters
    ----------
    groups
        Formulas of xi1, xi2 and t, and t. Formulas of a group are components of one vector: they are compared with each
        other. The cells resolve all groups.
    box
        The rectangle.
    measure
        Whether the integral of the samples' error is compared with that of the formulas; or, as for surfaces, the error
        of second derivatives with these.
    lines
        Values of xi1, and of xi2, with known kinks: cells end there.
    """
    keys = tuple((tuple(formula.key for formula in formulas), t) for formulas, t in groups)
    return _divided(keys, box, measure, lines)


@lru_cache(maxsize=1024)
def _divided(
    keys: tuple[tuple[tuple[tuple[object, ...], ...], float], ...], box: Box, measure: Measure, lines: Lines
) -> Division:
    groups = [([Expression.of_key(key) for key in each], t) for each, t in keys]
    axes = [a for a in (0, 1) if box[a][1] > box[a][0] and any(f.depends_on(NAMES[a]) for g, _ in groups for f in g)]
    low, high = grid(box, [FIRST if a in axes else 1 for a in (0, 1)], lines)
    cells = Division(low, high, np.zeros(low.shape, dtype=bool))
    for formulas, t in groups if axes else ():
        cells = Dividing(formulas, t, box, axes, measure, lines).of(cells)
    return cells


@dataclass(frozen=True)
class Dividing:
    """Divides cells for the formulas of one group; see `divided`."""

    formulas: Sequence[Expression]
    t: float
    box: Box
    axes: Sequence[int]
    measure: Measure
    lines: Lines

    @cached_property
    def side(self) -> Array:
        """Sides (2,) of the rectangle."""
        return np.array([stop - start for start, stop in self.box])

    @cached_property
    def nothing(self) -> Array:
        """Lengths (2,) below which a side is zero or rounding."""
        return np.asarray(SHORTEST * self.side + 8 * np.finfo(float).eps * np.abs(self.box).max(axis=1))

    def of(self, cells: Division) -> Division:
        """Return the cells, halved until they resolve the formulas."""
        # 1. The error of samples in each cell, along each coordinate, times the cell's area; and the integral of the
        #    formulas.
        # 2. The cells with the largest errors are halved, except those whose errors together are below the tolerance.
        # 3. Cells without size contain a jump, a kink or a pole, which is tested from its sides.
        low, high, halved = cells.low, cells.high, cells.halved
        error, whole = self.told(low, high)
        while True:
            size = high - low
            area = np.prod(np.where(self.side > 0, size, 1.0), axis=1)
            share, total = error.sum(axis=1) * area, float(whole @ area)
            last = np.any((size <= self.nothing)[:, self.axes], axis=1)
            by_share = np.flatnonzero(~last)[np.argsort(share[~last])]
            too_much = ~(np.cumsum(share[by_share]) <= TOLERANCES[self.measure] * total)
            too_much &= share[by_share] >= AT_ONCE * share[by_share[-1:]]
            wanted = by_share[too_much]
            if not len(wanted) or len(low) + len(wanted) > MOST_CELLS:
                break
            *new, split = self.halves(low[wanted], high[wanted], halved[wanted], error[wanted])
            found = self.told(*new)
            kept = np.ones(len(low), dtype=bool)
            kept[wanted] = False
            low, high, halved, error, whole = (
                np.concatenate([old[kept], more])
                for old, more in zip((low, high, halved, error, whole), (*new, split, *found), strict=True)
            )
        last &= share > 0
        undecided = place((low + size / 2)[wanted[-1]]) if len(wanted) else cells.undecided
        pole = self.pole(low[last], high[last]) if self.measure == "integral" else None
        return Division(low, high, halved, undecided, pole or cells.pole)

    def told(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Return the error of samples along each axis (n, axes) and the formulas' least magnitude (n,), by cell."""
        parts = [slice(start, start + AT_A_TIME) for start in range(0, len(low), AT_A_TIME)]
        each = [self._told(low[part], high[part]) for part in parts]
        return np.concatenate([error for error, _ in each]), np.concatenate([whole for _, whole in each])

    def _told(self, low: Array, high: Array) -> tuple[Array, Array]:
        # On a known line a formula has neither of its pieces: cells are evaluated a little inside. Around a closed
        # coordinate such a formula has another kink at the seam.
        inside = [low.copy(), high.copy()]
        for a in (a for a in self.axes if self.lines[a]):
            for ends, way in zip(inside, (1, -1), strict=True):
                on_line = np.isin(ends[:, a], (*self.lines[a], *self.box[a])) & (
                    (high - low)[:, a] > 4 * self.nothing[a]
                )
                ends[on_line, a] += way * self.nothing[a]
        boxes, half = boxes_of(inside[0], inside[1], self.t), (high - low) / 2
        error, whole = np.zeros((len(low), len(self.axes))), np.zeros(len(low))
        for formula in self.formulas:
            values = formula.enclosed(boxes)[0]
            if self.measure == "integral":
                whole += _least_size(values)
            for column, a in enumerate(self.axes):
                if not formula.depends_on(NAMES[a]):
                    continue
                terms = formula.enclosed(boxes, NAMES[a], ORDER)
                bounds = [2 * terms[k].size * (half[:, a] / 2) ** k for k in range(1, ORDER + 1)]
                least = np.fmin.reduce([values.high - values.low, *bounds])
                if self.measure == "curvature":
                    least = least / half[:, a] ** 2
                    whole += 2 * _least_size(terms[2]) + STRAIGHT * _least_size(terms[1]) / self.side[a]
                error[:, column] += np.where(np.isnan(least), np.inf, least)
        return error, whole

    def halves(self, low: Array, high: Array, halved: Mask, error: Array) -> tuple[Array, Array, Mask]:
        """Return the halves of cells, across the coordinate of the larger error; at equal errors, the longer side."""
        relative = (high - low)[:, self.axes] / self.side[self.axes]
        most = error == error.max(axis=1, keepdims=True)
        axis = np.array(self.axes)[np.argmax(np.where(most, relative, -1.0), axis=1)]
        rows = np.arange(len(axis))
        below, above = high.copy(), low.copy()
        below[rows, axis] = above[rows, axis] = (low + (high - low) / 2)[rows, axis]
        split = halved | (np.arange(2) == axis[:, None])
        return np.concatenate([low, above]), np.concatenate([below, high]), np.concatenate([split, split])

    def pole(self, low: Array, high: Array) -> Place | None:
        """Return a place among cells without size beside which a formula is not finite, or has no integral."""
        size, middle = high - low, low + (high - low) / 2
        for formula in self.formulas:
            beside = []
            for distance in (FARTHER, FARTHER**2):
                ends = [np.clip(middle + way * distance * size, *np.transpose(self.box)) for way in (-1.0, 1.0)]
                sizes = [np.abs(formula.derivatives(end, 0, self.t)[0, 0]) for end in ends]
                beside.append(np.max(sizes, axis=0))
            near, far = beside
            bad = ~np.isfinite(near) | (near > GROWS * FARTHER * far)
            if bad.any():
                return place(middle[np.argmax(bad)])
        return None


def place(point: Array) -> Place:
    """Return a point (2,) as two numbers."""
    return float(point[0]), float(point[1])


def grid(box: Box, cells: Sequence[int], lines: Lines = ((), ())) -> tuple[Array, Array]:
    """Return corners (n, 2) of so many equal cells along each coordinate, cut at lines."""
    ends = [
        np.unique([*_away(np.linspace(*bounds, n + 1), own), *(at for at in own if bounds[0] < at < bounds[1])])
        if bounds[1] > bounds[0]
        else np.array(bounds)
        for bounds, n, own in zip(box, cells, lines, strict=True)
    ]
    low, high = (
        np.stack(np.meshgrid(*parts, indexing="ij"), axis=-1).reshape(-1, 2)
        for parts in ([e[:-1] for e in ends], [e[1:] for e in ends])
    )
    return low, high


def _away(ends: Array, lines: Sequence[float]) -> list[float]:
    """Return the ends of cells without those, between the first and the last, that only rounding parts from lines."""
    gap = SAME_LINE * (ends[-1] - ends[0])
    inside = [end for end in ends[1:-1].tolist() if all(abs(end - at) > gap for at in lines)]
    return [float(ends[0]), *inside, float(ends[-1])]


def boxes_of(low: Array, high: Array, t: float) -> dict[str, Interval]:
    """Return the intervals of xi1, xi2 and t in cells."""
    boxes = {name: Interval(low[:, a], high[:, a]) for a, name in enumerate(NAMES)}
    return {**boxes, "t": Interval(np.full(len(low), t), np.full(len(low), t))}


def _least_size(found: Interval) -> Array:
    least = np.maximum(np.maximum(found.low, -found.high), 0.0)
    return np.where(np.isfinite(least), least, 0.0)
