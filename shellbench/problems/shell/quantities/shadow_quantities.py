"""Quantities of the shadow that a shell throws along a direction: the drape test of Cusick (1965)."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.displacement_quantities import Direction
from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.protocol.schema import Vector

Array = NDArray[np.float64]

LINES = 360  # cells a side of the grid whose lines are projected; the error falls with the square of their size
RAYS = 720  # directions in which the outline is sought
ROUND = 1e-6  # amplitude of a wave of the outline, relative to its radius, below which it is rounding


class Shadow(ShellQuantity):
    """The drape coefficient, or the number of folds, of a ring whose inner rim rests on a disc.

    The shadow is the projection along `direction`. Its outline is the largest radius in each direction from the centre,
    so that it has to be star-shaped. The drape coefficient is the area between it and the disc, over that at rest; the
    disc is as large as the inner rim at rest. The number of folds is that of the largest wave of the outline's squared
    radius, and 0 if it is a circle.

    Attributes
    ----------
    centre
        Centre of the disc, m.
    direction
        Direction of the projection, of any length.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    of_field: ClassVar[bool] = True
    powers: ClassVar[tuple[int, int]] = (0, 0)
    kind: Literal["drape_coefficient", "folds"]
    centre: Vector = (0.0, 0.0, 0.0)
    direction: Direction
    unit: str = ""

    def check(self, shell: Any) -> None:
        """Raise ValueError if no edge of the shell is the disc's rim, or folds of an open shell are asked."""
        if self.kind == "folds" and not any(shell.surface.domain.periodic):
            raise ValueError(f"quantity '{self.name}' counts the folds of a closed ring, and this shell is open")
        radius, _ = self._project(shell.surface.position(self._grid(shell)))
        rim = min((radius[0], radius[-1], radius[:, 0], radius[:, -1]), key=np.max)
        if not rim.max() * (1 - ROUND) <= radius.min() or not radius.max() > rim.max() * (1 + ROUND):
            raise ValueError(f"quantity '{self.name}' needs a ring whose inner rim is a circle about its centre")

    def measure(self, solution: DisplacementField) -> float:
        """Return the drape coefficient, or the number of folds."""
        case, grid = solution.case, self._grid(solution.case)
        rest = case.surface.position(grid)
        moved = rest + solution.displacement(grid.reshape(-1, 2), at=self.at).reshape(rest.shape)
        disc = float(self._project(rest)[0].min())
        if self.kind == "folds":
            waves = np.abs(np.fft.rfft(self._outline(moved, disc)))
            number = 1 + int(np.argmax(waves[1:]))
            return float(number) if waves[number] > ROUND * waves[0] else 0.0
        # Areas are even in the size of a cell: Richardson's extrapolation from the grid and every other line of it.
        fine, coarse = (
            np.sum(self._outline(moved[::n, ::n], disc) - disc**2)
            / np.sum(self._outline(rest[::n, ::n], disc) - disc**2)
            for n in (1, 2)
        )
        return float(fine + (fine - coarse) / 3)

    def _grid(self, case: Any) -> Array:
        """Return the points (n, n, 2) of the grid."""
        grid: Array = case.surface.domain.wrap(case.surface.domain.grid(LINES + 1, LINES + 1))
        return grid

    def _project(self, positions: Array) -> tuple[Array, Array]:
        """Return radii, m, and angles of positions (..., 3) about the centre, seen along the direction."""
        axis = unit(self.direction)
        first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        plane = np.stack([first, np.cross(axis, first)], axis=-1) / np.linalg.norm(first)
        seen = (positions - np.array(self.centre)) @ plane
        return np.linalg.norm(seen, axis=-1), np.arctan2(seen[..., 1], seen[..., 0])

    def _outline(self, positions: Array, disc: float) -> Array:
        """Return the largest squared radius (RAYS,), m^2, in each direction, of the grid's lines and the disc."""
        radius, angle = self._project(positions)
        outline = np.full(RAYS, disc**2)
        for axis in (0, 1):
            r, turn = np.moveaxis(radius, axis, 0), np.unwrap(np.moveaxis(angle, axis, 0), axis=0) * RAYS / (2 * np.pi)
            ends = np.stack([turn[:-1], turn[1:]]), np.stack([r[:-1], r[1:]])
            (low, high), (inner, outer) = (e.reshape(2, -1) for e in ends)
            # rays k + 1/2 between the ends of a segment, all segments in one list
            first = np.ceil(np.minimum(low, high) - 0.5).astype(int)
            count = np.ceil(np.maximum(low, high) - 0.5).astype(int) - first
            segment = np.repeat(np.arange(len(count)), count)
            ray = first[segment] + np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
            share = (ray + 0.5 - low[segment]) / (high - low)[segment]
            reached = inner[segment] + share * (outer - inner)[segment]
            np.maximum.at(outline, ray % RAYS, reached**2)
        return outline
