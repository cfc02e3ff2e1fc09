"""The solvers `inverse-transform` and `nearest-vertex`: points of a density, and distances from a body of vertices.

Shu et al., section 3.2, eq. (8) to (13); section 3.3.4, eq. (26)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problem import Capabilities, ProgressCallback, SeededSettings, Settings
from shellbench.problems.field.body import Ball
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.solution import FieldAnswer
from shellbench.problems.field.solving import LEVEL_ROUNDING, FieldSolver
from shellbench.protocol.schema import Finite

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drawn(FieldAnswer):
    """Points of a density: `points` (n, 2)."""

    def pick(self, u: Array, v: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows and columns, from 0, that random numbers (k,) pick."""
        rows, columns = self._cells().pick(u, v)
        return rows, columns

    def cumulative(self, row: int) -> Array:
        """Return the cumulated probability (n,) of columns within a row, from 0."""
        return np.asarray(self._cells().conditional(row))

    def counts(self) -> Array:
        """Return the number (m, n) of points in each cell."""
        size = np.array(self._cells().shares.shape)
        rows, columns = np.minimum((self.tensors["points"] * size).astype(int), size - 1).T
        return np.bincount(rows * size[1] + columns, minlength=size.prod()).reshape(size).astype(float)

    def relaxed(self, steps: int) -> Array:
        """Return the points (n, 2) after steps of Lloyd's relaxation: along u alone if there is one column."""
        from shellbench.solvers.field.sampling import relaxed, relaxed_on_a_line

        points = self.tensors["points"]
        if self._cells().shares.shape[1] > 1:
            return relaxed(points, steps)
        order = np.argsort(points[:, 0])
        return np.stack([relaxed_on_a_line(points[order, 0], steps), points[order, 1]], axis=1)

    def _cells(self) -> Any:
        from shellbench.solvers.field.sampling import Cells

        assert self.case.density is not None
        return Cells(self.case.density.shares)


class DrawSettings(SeededSettings):
    """Settings of `InverseTransformSolver`."""

    draws: int | None = Field(None, ge=1, le=10_000_000, strict=True, description="points; None: what the case says")


class InverseTransformSolver(FieldSolver):
    """Points by inverse transform of a density by cells."""

    name: ClassVar[str] = "inverse-transform"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("sampling",), "points of a density by inverse transform, as published"
    )
    settings_type: ClassVar[type[DrawSettings]] = DrawSettings

    def answer(self, case: FieldCase, settings: DrawSettings, progress: ProgressCallback) -> Drawn:
        """Draw points, or take the quantiles. What is drawn is as uncertain as its statistic is."""
        from shellbench.solvers.field.sampling import Cells

        density = case.density
        assert density is not None
        count = settings.draws or density.draws
        if density.points == "draws":
            points = Cells(density.shares).draw(count, np.random.default_rng(settings.seed))
        else:
            middles = (np.arange(count) + 0.5) / count
            shares = density.shares[:, 0]
            edges = np.linspace(0, 1, len(shares) + 1)
            places = np.interp(middles, np.concatenate([[0.0], np.cumsum(shares)]), edges)
            points = np.stack([places, np.full(count, 0.5)], axis=1)
        answer = Drawn(case, {"points": points})
        drawn = density.points == "draws"
        spread = {
            "chi_squared": math.sqrt(2 * (np.count_nonzero(density.shares) - 1)),
            "mean": 1 / math.sqrt(12 * count) if drawn else LEVEL_ROUNDING,
        }
        return Drawn(
            case, answer.tensors, uncertainty={q.name: spread.get(q.kind, LEVEL_ROUNDING) for q in case.quantities}
        )

    def load(self, path: Path) -> Drawn:
        """Read points that were saved."""
        return Drawn.load(path)


@dataclass(frozen=True)
class Vertices(FieldAnswer):
    """A body by its `places` and `normals`, (n, 3); `between` (k, 3) are places on its surface far from vertices."""

    @property
    def between(self) -> Array:
        """Places (k, 3) on the surface."""
        return np.asarray(self.tensors["between"])

    def distance(self, places: Array) -> Array:
        """Return d.n (k,), m, of places (k, 3) from their nearest vertices: eq. (26)."""
        from scipy.spatial import cKDTree

        nearest = cKDTree(self.tensors["places"]).query(places)[1]
        apart = places - self.tensors["places"][nearest]
        along = np.sum(apart * self.tensors["normals"][nearest], axis=1)
        return np.asarray(along - self.form["epsilon"])


class VertexSettings(Settings):
    """Settings of `NearestVertexSolver`."""

    epsilon: Finite = Field(0.0, ge=0, description="what (26) takes off a distance, m; the paper gives no number")


class NearestVertexSolver(FieldSolver):
    """Distances from the tangent plane of the nearest vertex."""

    name: ClassVar[str] = "nearest-vertex"
    capabilities: ClassVar[Capabilities] = Capabilities(
        ("nearest-vertex",), "distance from the plane of the nearest vertex, as published"
    )
    settings_type: ClassVar[type[VertexSettings]] = VertexSettings

    def answer(self, case: FieldCase, settings: VertexSettings, progress: ProgressCallback) -> Vertices:
        """Return the body's vertices; between them lie the circumcentres of the triangles of their hull."""
        from scipy.spatial import ConvexHull

        assert isinstance(case.body, Ball)
        normals = case.body.normals
        triangles = normals[ConvexHull(normals).simplices]
        middles = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        middles *= np.sign(np.sum(middles * triangles[:, 0], axis=1))[:, None]
        between = np.array(case.body.centre) + case.body.radius * middles
        tensors = {"places": case.body.places, "normals": normals, "between": between}
        found = Vertices(case, tensors, {"epsilon": settings.epsilon})
        # At r from the centre the error is r (1 - cos a), a the angle to the nearest vertex.
        worst = float(np.max(np.abs(found.distance(between)))) / case.body.radius
        known = {q.name: LEVEL_ROUNDING for q in case.quantities} | {
            q.name: worst * math.dist(q.place, case.body.centre) for q in case.quantities if q.kind == "distance"
        }
        return replace(found, uncertainty=known)

    def load(self, path: Path) -> Vertices:
        """Read vertices that were saved."""
        return Vertices.load(path)
