"""Midsurfaces: position and exact derivatives at curvilinear coordinates (xi1, xi2).

Every surface of a case file becomes three formulas, one for each Cartesian component; planes and cylinders are short
names for common formulas. Geometry beyond position and its derivatives (metric, curvature, normal) is left to the
solvers, which implement it independently of each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from shellbench.problems.expression import Expression, derivatives_of
from shellbench.problems.shell.question.folds import (
    Fold,
    Piece,
    derivatives_by_piece,
    folds_of,
    pieces,
    position_jumps,
    why_rough,
)
from shellbench.protocol.schema import LARGEST, SMALLEST, Finite, Flag, Model, Positive

Array = NDArray[np.float64]
Coordinate = Literal["xi1", "xi2"]
COORDINATES: tuple[Coordinate, Coordinate] = ("xi1", "xi2")

FULL_TURN = 360.0  # degrees
DEGENERACY_SAMPLES = 33  # points a side of the grid on which a surface is checked for degeneracy
FLAT = 1e-8  # smallest admissible |a1 x a2| / (|a1| |a2|): the sine of the angle between the base vectors
POLE = 1e-9  # smallest admissible |a1 x a2|, relative to its largest on the surface
SUSPECT = 0.2  # of that: where |a1 x a2| is less on the grid, a finer grid is used
CLOSER, LOOKS, SUSPECTS = 9, 18, 4  # points a side of a closer look, looks at a place, and places
GAP = 1e-9  # largest admissible gap of a periodic surface, relative to its size


@dataclass(frozen=True)
class Domain:
    """The parametric rectangle of a surface.

    Attributes
    ----------
    lower, upper
        Bounds of (xi1, xi2): radians where the coordinate is an angle, metres otherwise.
    periodic, angle
        For each coordinate, whether it closes on itself and whether it is an angle.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    periodic: tuple[bool, bool]
    angle: tuple[bool, bool]

    @property
    def size(self) -> tuple[float, float]:
        """Lengths of the sides of the rectangle."""
        return (self.upper[0] - self.lower[0], self.upper[1] - self.lower[1])

    def internal(self, point: Sequence[float]) -> tuple[float, float]:
        """Convert a point from the units of the case file (degrees for angles) to radians."""
        first, second = (np.radians(p) if angle else p for p, angle in zip(point, self.angle, strict=True))
        return float(first), float(second)

    def wrap(self, points: ArrayLike) -> Array:
        """Bring periodic coordinates into [lower, upper); others are left as they are."""
        xi = np.array(points, dtype=float)
        for axis in range(2):
            if self.periodic[axis]:
                xi[..., axis] = self.lower[axis] + np.mod(xi[..., axis] - self.lower[axis], self.size[axis])
        return xi

    def contains(self, points: ArrayLike, slack: float = 1e-9) -> NDArray[np.bool_]:
        """Return a mask (...) of the points (..., 2) in the rectangle, up to `slack` of its side."""
        xi = self.wrap(points)
        margin = slack * np.asarray(self.size)
        inside = (xi >= np.asarray(self.lower) - margin) & (xi <= np.asarray(self.upper) + margin)
        return np.asarray(np.all(inside, axis=-1))

    def grid(self, n1: int, n2: int) -> Array:
        """Return (n1, n2, 2) points on a regular grid that includes all bounds."""
        first = np.linspace(self.lower[0], self.upper[0], n1)
        second = np.linspace(self.lower[1], self.upper[1], n2)
        return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1)


class Surface(Protocol):
    """Protocol of a midsurface, as solvers use it."""

    @property
    def domain(self) -> Domain:
        """The parametric rectangle."""
        ...

    @property
    def named_constants(self) -> dict[str, float]:
        """Constants that formulas on it may name."""
        ...

    @property
    def fold_lines(self) -> tuple[Fold, ...]:
        """Lines at which its tangent plane or its curvature jumps."""
        ...

    def position(self, points: ArrayLike) -> Array:
        """Return the positions (..., 3) in metres of points (..., 2)."""
        ...

    def derivatives(self, points: ArrayLike, order: int = 2) -> dict[tuple[int, int], Array]:
        """Return (i, j) -> (..., 3): the derivative i times in xi1 and j times in xi2, for i + j <= order."""
        ...


class AnalyticSurface(Model):
    """Base of the surfaces by formulas.

    It has no poles: a surface on which |a1 x a2| vanishes anywhere, as at the apex of a cone, is refused.
    """

    xi1: tuple[Finite, Finite] = Field(description="bounds of xi1; degrees if it is an angle")
    xi2: tuple[Finite, Finite] = Field(description="bounds of xi2; degrees if it is an angle")

    @property
    def angle_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates that are angles."""
        return ()

    @property
    def periodic_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates in which the surface closes on itself."""
        return ()

    @property
    def formulas(self) -> tuple[str, str, str]:
        """The three Cartesian components as text."""
        raise NotImplementedError

    @property
    def named_constants(self) -> dict[str, float]:
        """Constants that the formulas use."""
        return {}

    @property
    def fold_lines(self) -> tuple[Fold, ...]:
        """Lines at which its tangent plane or its curvature jumps."""
        return ()

    @cached_property
    def domain(self) -> Domain:
        """The parametric rectangle, angles in radians."""
        angle = tuple(name in self.angle_coordinates for name in COORDINATES)
        bounds = [
            np.radians(b) if is_angle else np.asarray(b)
            for b, is_angle in zip((self.xi1, self.xi2), angle, strict=True)
        ]
        return Domain(
            lower=(float(bounds[0][0]), float(bounds[1][0])),
            upper=(float(bounds[0][1]), float(bounds[1][1])),
            periodic=("xi1" in self.periodic_coordinates, "xi2" in self.periodic_coordinates),
            angle=(angle[0], angle[1]),
        )

    @cached_property
    def expressions(self) -> tuple[Expression, ...]:
        """The three formulas, read."""
        return tuple(Expression(text, COORDINATES, self.named_constants, piecewise=True) for text in self.formulas)

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """The parts between folds."""
        return pieces(self.expressions, self.domain.lower, self.domain.upper, self.fold_lines)

    def derivatives(self, points: ArrayLike, order: int = 2) -> dict[tuple[int, int], Array]:
        """Return exact partial derivatives of the position.

        Parameters
        ----------
        points
            (..., 2) curvilinear coordinates; angles in radians.
        order
            Highest total order.

        Returns
        -------
        dict
            (i, j) -> (..., 3), metres per unit of xi1**i xi2**j; (0, 0) is the position. On a fold, they are those of
            the side of the larger coordinate.
        """
        if self.fold_lines:
            return derivatives_by_piece(self.pieces, self.fold_lines, np.asarray(points, dtype=float), order)
        return derivatives_of(self.expressions, points, order)

    def position(self, points: ArrayLike) -> Array:
        """Return the positions (..., 3) in metres of points (..., 2)."""
        return self.derivatives(points, order=0)[0, 0]

    @model_validator(mode="after")
    def _is_regular(self) -> Self:
        for name, (low, high) in (("xi1", self.xi1), ("xi2", self.xi2)):
            if not low < high:
                raise ValueError(f"the bounds of {name} are [{low:g}, {high:g}]; the first must be the smaller")
            if high - low < SMALLEST:
                raise ValueError(f"{name} has a side of {high - low:g}, but it must be at least {SMALLEST:g}")
        x = self.derivatives(self.domain.grid(DEGENERACY_SAMPLES, DEGENERACY_SAMPLES), order=2)
        if not np.all(np.abs(x[0, 0]) <= LARGEST):
            raise ValueError(f"the surface is not finite, or above {LARGEST:g}, on the domain")
        if isinstance(self, ExpressionSurface):  # the named kinds and fitted meshes are smooth
            lower, upper = self.domain.lower, self.domain.upper
            if torn := position_jumps(self.expressions, lower, upper, self.fold_lines):
                raise ValueError(torn)
            if rough := why_rough(self.expressions, lower, upper, self.domain.angle, self.fold_lines):
                raise ValueError(rough)
        if not all(np.all(np.abs(value) <= LARGEST) for value in x.values()):
            raise ValueError(f"the surface or its derivatives are not finite, or above {LARGEST:g}, on the domain")
        a1, a2 = x[1, 0], x[0, 1]
        lengths = np.linalg.norm(a1, axis=-1) * np.linalg.norm(a2, axis=-1)
        areas = np.linalg.norm(np.cross(a1, a2), axis=-1)
        sines = areas / np.maximum(lengths, np.finfo(float).tiny)
        flat = self.domain.grid(DEGENERACY_SAMPLES, DEGENERACY_SAMPLES)[np.unravel_index(np.argmin(sines), sines.shape)]
        found = flat if sines.min() <= FLAT else self._pole(areas)
        if found is not None:
            at = ", ".join(
                f"{np.degrees(c) if angle else c:.6g}" for c, angle in zip(found, self.domain.angle, strict=True)
            )
            raise ValueError(
                f"the surface is degenerate: its base vectors a1 and a2 are parallel or zero at (xi1, xi2) = ({at});"
                " where coordinate lines meet in a pole, leave a hole or take other coordinates"
            )
        self._check_closure(x)
        return self

    def _pole(self, areas: Array) -> Array | None:
        """Return a point (2,) where |a1 x a2| vanishes, from its values on the grid; None if there is none."""
        # A grid misses zeros between its points. Therefore ever finer grids follow around its smallest values.
        domain, largest = self.domain, float(areas.max())
        grid = domain.grid(DEGENERACY_SAMPLES, DEGENERACY_SAMPLES).reshape(-1, 2)
        size = np.asarray(domain.size)
        smallest = np.argsort(areas.ravel())[:SUSPECTS]
        at, least = grid[smallest], areas.ravel()[smallest]
        suspect = (least > POLE * largest) & (least < SUSPECT * largest)
        steps = np.linspace(-1.0, 1.0, CLOSER)
        square = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        reach = size / (DEGENERACY_SAMPLES - 1)
        for _ in range(LOOKS if suspect.any() else 0):
            around = np.clip(at[suspect, None] + square * reach, domain.lower, domain.upper)
            x = self.derivatives(around, order=1)
            there = np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
            at[suspect] = np.take_along_axis(around, there.argmin(axis=1)[:, None, None], axis=1)[:, 0]
            least[suspect] = there.min(axis=1)
            reach = reach * 2 / (CLOSER - 1)
        poles = at[~(least > POLE * largest)]
        return np.asarray(poles[0]) if len(poles) else None

    def _check_closure(self, x: dict[tuple[int, int], Array]) -> None:
        for axis, name in enumerate(COORDINATES):
            if name not in self.periodic_coordinates:
                continue
            folded = any(fold.axis == axis and fold.at == self.domain.lower[axis] for fold in self.fold_lines)
            for value in [x[0, 0]] if folded else x.values():
                scale = np.abs(value).max() + np.finfo(float).tiny
                if np.abs(np.take(value, 0, axis) - np.take(value, -1, axis)).max() > GAP * scale:
                    raise ValueError(f"the surface is declared periodic in {name} but does not close smoothly")


class Plane(AnalyticSurface):
    """The plane x = (xi1, xi2, 0)."""

    kind: Literal["plane"]

    @property
    def formulas(self) -> tuple[str, str, str]:
        """The three Cartesian components as text."""
        return ("xi1", "xi2", "0")


class Cylinder(AnalyticSurface):
    """A circular cylinder: xi1 is the angle, xi2 the length along the axis.

    About y (Kairanda et al. 2023, eq. (24)): x = (R cos xi1, xi2, R sin xi1); about z (eq. (63)):
    x = (R cos xi1, R sin xi1, xi2); about x: x = (xi2, R cos xi1, R sin xi1).

    Attributes
    ----------
    axis
        Axis of the cylinder.
    closed
        Whether the surface closes on itself in xi1, which then spans 360 degrees.
    """

    kind: Literal["cylinder"]
    axis: Literal["x", "y", "z"] = "y"
    radius: Positive = Field(description="R, metres")
    closed: Flag = False

    @property
    def angle_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates that are angles."""
        return ("xi1",)

    @property
    def periodic_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates in which the surface closes on itself."""
        return ("xi1",) if self.closed else ()

    @property
    def formulas(self) -> tuple[str, str, str]:
        """The three Cartesian components as text."""
        first, second = "R*cos(xi1)", "R*sin(xi1)"
        match self.axis:
            case "x":
                return ("xi2", first, second)
            case "y":
                return (first, "xi2", second)
            case "z":
                return (first, second, "xi2")

    @property
    def named_constants(self) -> dict[str, float]:
        """Constants that the formulas use."""
        return {"R": self.radius}

    @model_validator(mode="after")
    def _spans_a_turn_if_closed(self) -> Self:
        span = self.xi1[1] - self.xi1[0]
        if self.closed and abs(span - FULL_TURN) > 1e-9:
            raise ValueError(f"a closed cylinder spans 360 degrees of xi1; found {span:g}")
        if span > FULL_TURN:
            raise ValueError(f"a cylinder spans at most 360 degrees of xi1; found {span:g}")
        return self


class ExpressionSurface(AnalyticSurface):
    """Any analytic surface: three formulas in xi1 and xi2 with named constants.

    Attributes
    ----------
    x, y, z
        Component of the position, m: a formula in xi1 and xi2.
    constants
        Numbers that the formulas may name, those of supports and loads too.
    periodic
        Coordinates in which the surface closes on itself, smoothly.
    angles
        Coordinates that are angles: their bounds, and points, are given in degrees; formulas get radians.
    folds, hinges
        Values of xi1 and of xi2 at which the tangent plane or the curvature jumps, such as `{ xi1 = [1.0, 2.0] }`. A
        fold keeps its angle, and a hinge leaves it free. One coordinate has them all; in linear theory.
    """

    kind: Literal["expression"]
    x: str
    y: str
    z: str
    constants: dict[str, Finite] = Field(default_factory=dict)
    periodic: tuple[Coordinate, ...] = ()
    angles: tuple[Coordinate, ...] = ()
    folds: dict[Coordinate, tuple[Finite, ...]] = Field(default_factory=dict)
    hinges: dict[Coordinate, tuple[Finite, ...]] = Field(default_factory=dict)

    @property
    def angle_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates that are angles."""
        return self.angles

    @cached_property
    def fold_lines(self) -> tuple[Fold, ...]:
        """Lines at which its tangent plane or its curvature jumps; ValueError if one is not inside."""
        return folds_of(self.folds, self.hinges, self.domain.lower, self.domain.upper, self.angles, self.periodic)

    @property
    def periodic_coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates in which the surface closes on itself."""
        return self.periodic

    @property
    def formulas(self) -> tuple[str, str, str]:
        """The three Cartesian components as text."""
        return (self.x, self.y, self.z)

    @property
    def named_constants(self) -> dict[str, float]:
        """Constants that the formulas use."""
        return self.constants
