"""The surface of a mesh: the number of spans of its spline, and the errors of position and curvature.

1. A fifth of the inner vertices, drawn by a fixed seed, is left out. Splines of 1, 2, 4, ... spans a side are fitted to
   the others, up to half as many spans as vertices. Their error at the vertices left out decides.
2. Among the splines whose error is hardly larger than the least, the one with the fewest spans is taken, in each
   direction: more spans would follow the noise, which curvature shows first.
3. This spline is fitted to all vertices. A second spline with a third more spans (fewer, if there are not enough
   vertices) is fitted to half of the inner vertices.

Stated errors. Position: the largest distance to a vertex that was left out, noise included. Curvature: the largest
difference of the two splines. Noise moves the fit to half of the vertices by as much as it moves the fit to all, so
that the difference contains the errors of noise and of knots. The error of knots falls with the fourth power of a span.
Therefore the difference is divided by 1 - (3/4)^4.
"""

from __future__ import annotations

import hashlib
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.errors import InputError
from shellbench.problems.shell.mesh.file import read_mesh
from shellbench.problems.shell.mesh.patch import COORDINATES, Patch, patch_of
from shellbench.problems.shell.mesh.spline import Spline, fit_spline, shape_of
from shellbench.protocol.schema import Finite, Model

Array = NDArray[np.float64]
SEED, LEFT_OUT = 21, 0.2
HARDLY = 1.2  # times the smallest error: a spline below it may have fewer spans
WELL_FITTED = 1e-9  # of the mesh's size: a spline that misses by less is not made finer
MOST_COEFFICIENTS = 6000  # coefficients of a component
SUFFICE = 1.5  # vertices for each coefficient of the second spline
ENOUGH = 12  # vertices for each coefficient, from which others are left out where spans are only tried
GRID = 41  # points a side at which curvatures are compared
FLAT = 1e-9  # smallest |a1 x a2| of a surface, relative to its largest
LESS = 1 - 0.75**4


class MeshFit(Model):
    """Splines fitted to a mesh, with their stated errors.

    Attributes
    ----------
    sha256
        Of the mesh file.
    vertices, triangles
        Numbers of vertices and triangles; vertices of a seam count twice.
    position_error
        Stated error of position, m.
    curvature_error
        Stated error of curvature, 1/m.
    largest_curvature
        Of the surface, 1/m, to compare with.
    first, second
        The spline that is the surface, and one with other knots through half of the vertices.
    """

    sha256: str
    vertices: int
    triangles: int
    position_error: Finite
    curvature_error: Finite
    largest_curvature: Finite
    first: Spline
    second: Spline = Field(repr=False)

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Bounds of xi1 and of xi2."""
        low, high = self.first.lower, self.first.upper
        return (low[0], high[0]), (low[1], high[1])

    @classmethod
    def of(cls, content: bytes, suffix: str, periodic: tuple[str, ...] | None) -> Self:
        """Fit the content of a mesh file; InputError, as a clause, if it is not one patch of a surface."""
        patch = patch_of(read_mesh(content, suffix), periodic)
        fitting = _Fitting(patch, tuple(name in (periodic or ()) for name in COORDINATES))  # type: ignore[arg-type]
        spans = fitting.choose_spans()
        first = fitting.fit(spans)
        _check_normals(first, patch)
        second = fitting.alternative_spline(spans)
        missed = fitting.distances(fitting.fit(spans, fitting.kept))
        return cls(
            sha256=hashlib.sha256(content).hexdigest(),
            vertices=len(patch.xi),
            triangles=len(patch.triangles),
            position_error=float(missed.max()),
            curvature_error=_difference(first, second) / LESS,
            largest_curvature=_difference(first, None),
            first=first,
            second=second,
        )


class _Fitting:
    """Fits of a patch, with some vertices left out where spans are tried."""

    def __init__(self, patch: Patch, periodic: tuple[bool, bool]) -> None:
        self.patch, self.periodic = patch, periodic
        drawn = np.random.default_rng(SEED).random(len(patch.xi))
        self.order = np.argsort(drawn)
        self.left_out = patch.inner & (drawn < LEFT_OUT)
        self.half = ~patch.inner | (drawn >= 0.5)
        self.kept = ~self.left_out

    def fit(self, spans: tuple[int, int], chosen: NDArray[np.bool_] | None = None) -> Spline:
        patch = self.patch
        there = slice(None) if chosen is None else chosen
        return fit_spline(patch.xi[there], patch.positions[there], (patch.lower, patch.upper), spans, self.periodic)

    def alternative_spline(self, spans: tuple[int, int]) -> Spline:
        """Return a spline with other knots, fitted to half of the inner vertices."""
        more = spans[0] + -(-spans[0] // 3), spans[1] + -(-spans[1] // 3)
        fewer = max(1, spans[0] * 2 // 3), max(1, spans[1] * 2 // 3)
        enough = SUFFICE * np.prod(shape_of(more, self.periodic)) <= self.half.sum()
        return self.fit(more if enough else fewer, self.half)

    def distances(self, spline: Spline) -> Array:
        """Return the distances of a spline from the vertices left out."""
        where = self.left_out if np.any(self.left_out) else slice(None)
        x = spline.derivatives(self.patch.xi[where], 0)[0, 0]
        return np.asarray(np.linalg.norm(x - self.patch.positions[where], axis=-1))

    def left_out_error(self, spans: tuple[int, int]) -> float:
        """Return the root mean square by which a spline of so many spans misses the vertices left out."""
        tried = self.kept
        enough = ENOUGH * int(np.prod(shape_of(spans, self.periodic)))
        if enough < tried.sum():  # the boundary stays
            tried = np.zeros_like(self.kept)
            tried[self.order[: -(-enough * len(tried) // int(self.kept.sum()))]] = True
            tried = (tried | ~self.patch.inner) & self.kept
        return float(np.sqrt(np.mean(self.distances(self.fit(spans, tried)) ** 2)))

    def choose_spans(self) -> tuple[int, int]:
        """Return the numbers of spans."""
        most = tuple(max(1, (count - 1) // 2) for count in self.patch.counts)
        found: dict[tuple[int, int], float] = {}
        level = 1
        while True:
            spans = (min(level, most[0]), min(level, most[1]))
            if found and (spans in found or np.prod(shape_of(spans, self.periodic)) > MOST_COEFFICIENTS):
                break
            found[spans] = self.left_out_error(spans)
            if found[spans] < WELL_FITTED * self.patch.size:
                break
            level *= 2
        allowed = max(HARDLY * min(found.values()), WELL_FITTED * self.patch.size)
        spans = next(spans for spans, error in found.items() if error <= allowed)
        for axis in (0, 1):
            while spans[axis] > 1:
                fewer = (spans[0] // 2, spans[1]) if axis == 0 else (spans[0], spans[1] // 2)
                if self.left_out_error(fewer) > allowed:
                    break
                spans = fewer
        return spans


def _check_normals(spline: Spline, patch: Patch) -> None:
    """Raise InputError if the surface folds: a triangle's normal opposes the spline's, or the spline has none."""
    corners = patch.positions[patch.triangles]
    x = spline.derivatives(patch.xi[patch.triangles].mean(axis=1), 1)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = np.sum(facing * np.cross(x[1, 0], x[0, 1]), axis=-1)
    if not np.all(along > 0):
        at = patch.xi[patch.triangles[np.argmax(~(along > 0))]].mean(axis=0)
        raise InputError(
            f"the surface folds near (u, v) = ({at[0]:.4g}, {at[1]:.4g}): a triangle looks the other way than the"
            " surface fitted to it; or noise is as large as triangles are"
        )


def _difference(one: Spline, other: Spline | None) -> float:
    """Return the largest difference of two splines' normal curvatures, 1/m; without the other, that to a plane."""
    low, size = np.asarray(one.lower), np.subtract(one.upper, one.lower)
    steps = np.linspace(0.0, 1.0, GRID)
    points = low + size * np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    x = one.derivatives(points, 2)
    y = other.derivatives(points, 2) if other is not None else {key: np.zeros_like(value) for key, value in x.items()}
    across = np.cross(x[1, 0], x[0, 1])
    areas = np.linalg.norm(across, axis=-1, keepdims=True)
    if not np.all(areas > FLAT * areas.max()):
        raise InputError("the surface is degenerate: somewhere its coordinate lines meet, or run along each other")
    normal = across / areas
    # in the metric, so that it does not matter how coordinates run: the largest eigenvalue of a^-1 db
    metric, curving = (
        np.stack([np.stack([f[0], f[1]], -1), np.stack([f[1], f[2]], -1)], -1)
        for f in (
            [np.sum(x[i] * x[j], axis=-1) for i, j in (((1, 0), (1, 0)), ((1, 0), (0, 1)), ((0, 1), (0, 1)))],
            [np.sum((x[key] - y[key]) * normal, axis=-1) for key in ((2, 0), (1, 1), (0, 2))],
        )
    )
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(metric, curving))).max())
