"""Cases about fields over the unit square, densities and distances.

A file has one of these tables. `[match]` is a function that a field is fitted to. `[cloth]` weighs losses of local
structures; a field minimises their mean over the square. Beside `[match]`, `[cloth]` only defines the measured losses.
`[density]` is a probability by cells, from which points are drawn. `[body]` is a ball, a torus or a prism that a cloth
touches, or a ball of vertices whose distance is asked.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from shellbench.problem import Problem
from shellbench.problems.field.body import Ball, Body
from shellbench.problems.field.formulas import Formulas, evaluated
from shellbench.problems.field.quantities import BODY, CLOTH, DENSITY, FIT, Axis, Edge, FieldQuantity, Point
from shellbench.problems.field.structure import WIDEST, lattice
from shellbench.protocol.schema import Finite, Flag, Model, Positive

Array = NDArray[np.float64]
NotNegative = Annotated[Finite, Field(ge=0)]
LOOKED_AT = 50  # cells along a side at whose midpoints formulas must be finite
MIDDLE = np.array([0.5, 0.5])
LARGEST_DENSITY = 1000  # rows and columns of a density


class Match(Model):
    """The function that the field is fitted to."""

    function: Formulas = Field(description="components, m: numbers, or formulas of u and v")


class Training(Model):
    """Limits of a training: its epochs and samples. Solvers that do not train ignore them."""

    epochs: int = Field(ge=1, le=1_000_000, strict=True, description="steps of the optimiser")
    samples: int = Field(64, ge=1, le=1000, strict=True, description="samples of an epoch: so many, squared")


class Cloth(Model):
    """Losses of local structures, each with its weight."""

    side: Annotated[Finite, Field(gt=0, lt=1 / WIDEST)] = Field(description="of a triangle, m")
    strain: NotNegative = Field(0.0, description="weight of eq. (19)")
    bend: NotNegative = Field(0.0, description="weight of eq. (22)")
    gravity: NotNegative = Field(0.0, description="weight of eq. (24)")
    collision: NotNegative = Field(0.0, description="weight of eq. (26)")
    mass_gravity: Positive = Field(1.0, description="m g of eq. (24): mass of a sample times acceleration, N")
    rest: Formulas = Field(("u", "v", 0.0), description="places without displacement, m; z points upward")
    past_edges: Flag = Field(False, description="whether structures reach past the edges, where splines go on")
    confined: tuple[Axis, ...] = Field((), description="components of the displacement that are zero everywhere")

    @property
    def weights(self) -> dict[str, float]:
        """Weights by loss."""
        return {name: getattr(self, name) for name in ("strain", "bend", "gravity", "collision")}


class Disc(Model):
    """A mask: the cloth is the disc within the unit square, and is held at its rim.

    Structures may reach past the rim, where the field goes on.
    """

    radius: Annotated[Finite, Field(gt=0, le=0.5)] = Field(description="of the disc, about the middle of the square")

    def level(self, points: Array) -> Array:
        """Return 1 - (r / R)^2 (n,) at points (n, 2): 1 in the middle, 0 on the rim, negative outside."""
        return np.asarray(1 - np.sum((points - MIDDLE) ** 2, axis=-1) / self.radius**2)


class Pin(Model):
    """Edges and points whose displacement is given."""

    on: tuple[Edge | Literal["rim"], ...] = Field((), description="edges; 'rim' is that of a disc")
    at: tuple[Point, ...] = Field((), description="points (u, v)")
    displacement: Formulas = Field((0.0, 0.0, 0.0), description="m: numbers, or formulas of u and v")

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        if not self.on and not self.at:
            raise ValueError("a pin needs edges ('on') or points ('at')")
        return self


class Density(Model):
    """A probability by cells of the unit square: rows along u, columns along v.

    Attributes
    ----------
    cells
        Weights of the cells, a list for each row; any positive sum.
    """

    cells: Annotated[tuple[Annotated[tuple[NotNegative, ...], Field(min_length=1, max_length=LARGEST_DENSITY)], ...],
                     Field(min_length=1, max_length=LARGEST_DENSITY)] = Field(
        description="of each cell, a list a row; any positive sum"
    )  # fmt: skip
    draws: int = Field(1000, ge=1, le=10_000_000, strict=True, description="points to draw")
    points: Literal["draws", "quantiles"] = Field(
        "draws", description="whether points are drawn, or are quantiles along u of a density with one column"
    )

    @model_validator(mode="after")
    def _is_a_density(self) -> Self:
        if len({len(row) for row in self.cells}) > 1:
            raise ValueError("the rows of 'cells' differ in length")
        if not sum(map(sum, self.cells)) > 0:
            raise ValueError("the sum of 'cells' must be positive")
        if self.points == "quantiles" and len(self.cells[0]) != 1:
            raise ValueError(f"quantiles need one column in 'cells', but there are {len(self.cells[0])}")
        return self

    @property
    def shares(self) -> Array:
        """Probabilities (m, n), whose sum is 1."""
        cells = np.array(self.cells)
        return np.asarray(cells / cells.sum())


class FieldCase(Problem):
    """A field over the unit square, or points, or distances, and the quantities asked of them.

    Attributes
    ----------
    match
        A function that the field is fitted to.
    cloth
        Losses of local structures.
    network
        Representation of the field, if its parameters are counted: the published plain network, the one with positional
        encoding, the multi-resolution grid with its decoder, or the vertices of a mesh.
    training
        Limits of a training.
    disc
        A disc to which the cloth is cut.
    pins
        Edges and points whose displacement is given.
    density
        A probability from which points are drawn.
    body
        An obstacle of the cloth, a ball unless `kind` says otherwise; or a ball of vertices whose distance is asked.
    quantities
        Quantities asked of every answer; exactly one is primary.
    """

    kind: Literal["field"]
    theory: Literal["fit", "local-structures", "sampling", "nearest-vertex"]
    match: Match | None = None
    cloth: Cloth | None = None
    network: Literal["plain", "positional", "grid", "vertices"] | None = None
    training: Training | None = None
    disc: Disc | None = None
    pins: tuple[Pin, ...] = ()
    density: Density | None = None
    body: Body | None = None
    quantities: Annotated[tuple[FieldQuantity, ...], Field(min_length=1)]

    @property
    def has_field(self) -> bool:
        """True if the case asks for a field."""
        return self.match is not None or self.cloth is not None

    def physics(self) -> dict[str, Any]:
        """Return all data that an answer depends on, without tables that the file does not have."""
        tables = ("match", "cloth", "network", "training", "disc", "pins", "density", "body")
        found = {key: value for key, value in super().physics().items() if value or key not in tables}
        if self.pins:  # a pin of edges has no points, and the other way round
            found["pins"] = [{key: value for key, value in pin.items() if value} for pin in found["pins"]]
        if self.cloth and not self.cloth.past_edges:  # so that digests of cases without this field stay as they were
            del found["cloth"]["past_edges"]
        if isinstance(self.body, Ball):  # the kind that bodies had before others existed
            del found["body"]["kind"]
        return found

    def within(self, points: Array) -> Array:
        """Return those of points (n, 2) that are cloth."""
        return points if self.disc is None else points[self.disc.level(points) > 0]

    def rest(self, points: Array) -> Array:
        """Return places (n, 3) of points (n, 2) without displacement, m."""
        return evaluated(self.cloth.rest if self.cloth else ("u", "v", 0.0), points)

    @field_validator("body", mode="before")
    @classmethod
    def _is_a_ball(cls, body: Any) -> Any:
        return {"kind": "ball"} | body if isinstance(body, dict) else body

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        asked = {
            "fit": (self.match is not None, "match", FIT),
            "local-structures": (self.cloth is not None and self.match is None, "cloth", CLOTH),
            "sampling": (self.density is not None, "density", DENSITY),
            "nearest-vertex": (self.body is not None, "body", BODY),
        }
        there, table, allowed = asked[self.theory]
        if not there:
            raise ValueError(f"theory '{self.theory}' needs the table '{table}'" + (
                " without 'match'" if table == "cloth" and self.cloth else ""
            ))  # fmt: skip
        others: dict[str, object] = {"density": self.density, "match": self.match} | (
            {} if self.match else {"cloth": self.cloth}
        )
        others |= {} if self.theory == "local-structures" else {"body": self.body}
        for name, other in others.items():
            if other is not None and name != table:
                raise ValueError(f"theory '{self.theory}' has no table '{name}'")
        if self.pins and self.theory != "local-structures":
            raise ValueError("only a field of local structures has pins")
        for quantity in self.quantities:
            if not isinstance(quantity, allowed):
                raise ValueError(f"quantity '{quantity.name}' can't be asked with theory '{self.theory}'")
            if quantity.kind in ("strain", "bend", "gravity", "energy") and self.cloth is None:
                raise ValueError(f"quantity '{quantity.name}' needs the table 'cloth'")
            if quantity.kind in ("collision", "penetration") and self.body is None:
                raise ValueError(f"quantity '{quantity.name}' needs the table 'body'")
        if self.theory == "local-structures" and self.cloth:
            if (self.body is not None) != (self.cloth.collision > 0):
                raise ValueError("a body and a positive 'cloth.collision' go together")
        elif self.cloth and self.cloth.collision:
            raise ValueError("field 'cloth.collision' must be 0 with theory 'fit'")
        elif self.body is not None and self.body.is_exact:
            raise ValueError("theory 'nearest-vertex' needs 'body.vertices'")
        self._check_disc()
        self._check_density()
        self._check_formulas()
        return self

    def _check_disc(self) -> None:
        """Refuse a disc that is not held at its whole rim alone, and a rim without a disc."""
        if self.disc is None and any("rim" in pin.on for pin in self.pins):
            raise ValueError("only a disc has a rim: the table 'disc' is missing")
        if self.disc and (self.theory != "local-structures" or self.body or self.pins != (Pin(on=("rim",)),)):
            raise ValueError("a disc is a cloth without a body, and its only pin holds the 'rim' where it is")

    def _check_density(self) -> None:
        if self.density is None:
            return
        rows, columns = self.density.shares.shape
        for quantity in self.quantities:
            if quantity.kind == "cumulative" and not (quantity.row <= rows and quantity.column <= columns):
                raise ValueError(f"quantity '{quantity.name}' is of a cell beyond {rows} rows and {columns} columns")

    def _check_formulas(self) -> None:
        """Refuse formulas that are not finite somewhere on the square."""
        points = lattice(LOOKED_AT)
        named = {f"pins.{number}.displacement": pin.displacement for number, pin in enumerate(self.pins)}
        named |= {"match.function": self.match.function} if self.match else {}
        named |= {"cloth.rest": self.cloth.rest} if self.cloth else {}
        for name, formulas in named.items():
            bad = ~np.isfinite(evaluated(formulas, points)).all(axis=1)
            if bad.any():
                u, v = points[bad.argmax()]
                raise ValueError(f"field '{name}' is not finite at u = {u:g}, v = {v:g}")
