"""Quantities of fields, of samples of a density, and of distances from a body."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from shellbench.problem import Quantity
from shellbench.problems.field.formulas import evaluated
from shellbench.problems.field.structure import lattice, weighted
from shellbench.protocol.schema import Finite

Share = Annotated[Finite, Field(ge=0, le=1)]
Point = tuple[Share, Share]
Axis = Literal["x", "y", "z"]
Edge = Literal["u_min", "u_max", "v_min", "v_max"]
AXES = "xyz"
ALONG = 200  # points along an edge
FINE = 1000  # of a lattice along a side, at most


def along_edge(edge: Edge, count: int = ALONG) -> np.ndarray[Any, Any]:
    """Return the midpoints (count, 2) of equal parts of an edge."""
    axis, end = "uv".index(edge[0]), float(edge.endswith("max"))
    points = np.full((count, 2), end)
    points[:, 1 - axis] = (np.arange(count) + 0.5) / count
    return points


class PointValue(Quantity):
    """A component of the field at a point, or a derivative of it."""

    kind: Literal["value"]
    point: Point = Field(description="(u, v)")
    axis: Axis = Field(description="which component")
    orders: tuple[Annotated[int, Field(ge=0, le=2)], Annotated[int, Field(ge=0, le=2)]] = Field(
        (0, 0), description="derivatives in u and v"
    )

    def measure(self, solution: Any) -> float:
        """Return the value, m; ValueError if the representation has no such derivative."""
        found = solution.displacement(np.array([self.point]), self.orders)
        return float(found[0, AXES.index(self.axis)])


class Elongation(Quantity):
    """The mean displacement of an edge in a direction, m."""

    kind: Literal["elongation"]
    edge: Edge = Field(description="which")
    direction: tuple[Finite, Finite, Finite] = Field(description="unit vector")

    def measure(self, solution: Any) -> float:
        """Return the elongation, m."""
        return float(np.mean(solution.displacement(along_edge(self.edge)) @ np.array(self.direction)))


class RmsError(Quantity):
    """The root of the mean square distance from the function, over the midpoints of a lattice, m."""

    kind: Literal["rms_error"]
    lattice: int = Field(200, ge=1, le=FINE, strict=True, description="cells along a side")

    def measure(self, solution: Any) -> float:
        """Return the error, m."""
        points = lattice(self.lattice)
        off = solution.displacement(points) - evaluated(solution.case.match.function, points)
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


class MeanLoss(Quantity):
    """The mean of a loss of local structures, without its weight, or of all with their weights."""

    kind: Literal["strain", "bend", "gravity", "collision", "energy"]
    unit: str = ""
    lattice: int = Field(32, ge=1, le=FINE, strict=True, description="cells along a side, with a structure in each")
    turns: int = Field(4, ge=1, le=100, strict=True, description="orientations of each structure")

    def measure(self, solution: Any) -> float:
        """Return the mean, without unit."""
        points = solution.case.within(lattice(self.lattice))
        losses, cloth = solution.losses(points, self.turns), solution.case.cloth
        found = weighted(losses, cloth.weights) if self.kind == "energy" else losses[self.kind]
        return float(np.mean(found))


class Folds(Quantity):
    """A harmonic of the directions of folds: 1 if all run along an angle or its turns, 0 if none is preferred.

    It is the mean of cos(order (a - along)) over angles a of fold lines, at u, v. A point counts by the difference
    of its squared principal curvatures; the fold line is that of the smaller one.
    """

    kind: Literal["folds"]
    unit: str = ""
    order: int = Field(ge=2, le=48, multiple_of=2, strict=True, description="of the harmonic, which is even")
    along: Finite = Field(0.0, description="angle from u, degrees")
    lattice: int = Field(100, ge=1, le=FINE, strict=True, description="cells along a side")
    width: Annotated[Finite, Field(gt=0, le=0.1)] = Field(
        0.02, description="distance over which places are compared, m: folds that are narrower are not seen"
    )

    def measure(self, solution: Any) -> float:
        """Return the harmonic, without unit."""
        points, case = self.width + (1 - 2 * self.width) * lattice(self.lattice), solution.case
        steps = self.width * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        near = (points[:, None] + steps).reshape(-1, 2)
        x = (case.rest(near) + solution.displacement(near)).reshape(-1, 3, 3, 3)
        normal = np.cross(x[:, 2, 1] - x[:, 0, 1], x[:, 1, 2] - x[:, 1, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        second = (
            x[:, 2, 1] - 2 * x[:, 1, 1] + x[:, 0, 1],
            (x[:, 2, 2] - x[:, 2, 0] - x[:, 0, 2] + x[:, 0, 0]) / 4,
            x[:, 1, 2] - 2 * x[:, 1, 1] + x[:, 1, 0],
        )
        a, b, c = (np.sum(part * normal, axis=1) for part in second)
        line = 0.5 * np.arctan2(2 * b, a - c) + np.where(a + c > 0, np.pi / 2, 0)
        weights = np.abs(a + c) * np.hypot(a - c, 2 * b)
        return float(weights @ np.cos(self.order * (line - np.radians(self.along))) / weights.sum())


class Penetration(Quantity):
    """The largest depth of points below the body's surface, over midpoints of a lattice, m; zero if there is none."""

    kind: Literal["penetration"]
    lattice: int = Field(200, ge=1, le=FINE, strict=True, description="cells along a side")

    def measure(self, solution: Any) -> float:
        """Return the depth, m: by exact distances, whatever the body's vertices."""
        points = lattice(self.lattice)
        places = solution.case.rest(points) + solution.displacement(points)
        return max(0.0, -float(np.min(solution.case.body.distance(places))))


class Parameters(Quantity):
    """Number of parameters of the field."""

    kind: Literal["parameters"]
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the count."""
        return float(solution.parameters)


class Cell(Quantity):
    """The row or column, from 1, of the cell that two random numbers pick."""

    kind: Literal["row", "column"]
    numbers: Point = Field(description="random numbers of the row and the column")
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the number of the row or column."""
        row, column = solution.pick(np.array([self.numbers[0]]), np.array([self.numbers[1]]))
        return float((row if self.kind == "row" else column)[0] + 1)


class Cumulative(Quantity):
    """The cumulated probability of a cell within its row: eq. (11)."""

    kind: Literal["cumulative"]
    row: int = Field(ge=1, strict=True, description="from 1")
    column: int = Field(ge=1, strict=True, description="from 1")
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the probability."""
        return float(solution.cumulative(self.row - 1)[self.column - 1])


class ChiSquared(Quantity):
    """Pearson's statistic of the counts of points in cells that have a probability; infinite if others have points."""

    kind: Literal["chi_squared"]
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the statistic."""
        share, counts = solution.case.density.shares, solution.counts()
        if counts[share == 0].any():
            raise ValueError("a cell without probability has points")
        expected = share[share > 0] * counts.sum()
        return float(np.sum((counts[share > 0] - expected) ** 2 / expected))


class Mean(Quantity):
    """The mean coordinate of all points after steps of Lloyd's relaxation."""

    kind: Literal["mean"]
    axis: Literal["u", "v"] = Field(description="which coordinate")
    steps: int = Field(0, ge=0, le=100_000, strict=True, description="steps of the relaxation")
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the mean."""
        return float(np.mean(solution.relaxed(self.steps)[:, "uv".index(self.axis)]))


class Distance(Quantity):
    """The signed distance of a place from the body, m."""

    kind: Literal["distance"]
    place: tuple[Finite, Finite, Finite] = Field(description="m")

    def measure(self, solution: Any) -> float:
        """Return the distance, m."""
        return float(solution.distance(np.array([self.place]))[0])


class DistanceError(Quantity):
    """The largest error of the distance of places on the body's surface, as many as vertices and between them, m."""

    kind: Literal["distance_error"]

    def measure(self, solution: Any) -> float:
        """Return the error, m."""
        return float(np.max(np.abs(solution.distance(solution.between))))


FIT = (PointValue, Elongation, RmsError, Parameters, MeanLoss)
CLOTH = (PointValue, Elongation, Parameters, MeanLoss, Folds, Penetration)
DENSITY = (Cell, Cumulative, ChiSquared, Mean)
BODY = (Distance, DistanceError)
FieldQuantity = Annotated[
    PointValue
    | Elongation
    | RmsError
    | MeanLoss
    | Folds
    | Penetration
    | Parameters
    | Cell
    | Cumulative
    | ChiSquared
    | Mean
    | Distance
    | DistanceError,
    Field(discriminator="kind"),
]
