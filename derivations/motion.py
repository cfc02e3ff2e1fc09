r"""Known values of napkins in motion: `spline_motion` on meshes graded toward the pin.

Both hang from an elastic pin at the corner (0, 1), which unlike a point support lets every quantity converge fast.

- napkin_plane: u_z = 0, gravity along -y. napkin_course is the same up to .4 s, its free corner told by the displacement.
- napkin_soft_pin: gravity tilted by 5 degrees, bending a hundred times stiffer. It buckles where it is compressed;
  from .5 s on the free corner's whip is the part that converges last.

A value is that of the fine mesh. Its uncertainty is the largest distance of the coarse mesh among the components of a
point, or among the energies, at that time: they trade with one another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .estimate import Estimate
from .explicit_motion import Moment, leapfrog, motion
from .over_time import at_time, between
from .spline_motion import Cloth, Pin
from .spline_shell import Splines
from .surface_strains import Array

GRAVITY = 9.8
TILT = np.radians(5.0)
PIN = Pin((0.0, 1.0), 2e4, 0.05)
FREE_CORNER = (1.0, 0.0)
PLANE_TIMES, TILTED_TIMES = (0.2, 0.4, 0.5), (0.2, 0.4, 0.6)
FRACTION = 0.9
"""Step of the leapfrog over its limit of stability."""
ROUNDING, LEAPFROG_ROUNDING = 1e-7, 2e-6
"""Error left by time steps on the meshes used here, m and J."""


@dataclass(frozen=True)
class Resolution:
    """Discretisation of the unit square.

    Attributes
    ----------
    spans : knot spans a side
    degree : degree of the splines
    grading : length l, m, of the spans' sizes sqrt(l^2 + r^2) with the distance r to the pin along a side
    tolerance : of the Runge-Kutta method; None for the leapfrog
    """

    spans: int
    degree: int
    grading: float = 0.4
    tolerance: float | None = 1e-7

    @property
    def breaks(self) -> Array:
        """Breaks from 0, where they are dense, to 1."""
        uniform = np.linspace(0.0, 1.0, self.spans + 1)
        return np.asarray(self.grading * np.sinh(uniform * np.arcsinh(1 / self.grading)))

    @property
    def splines(self) -> tuple[Splines, Splines]:
        """Splines along xi1 and xi2, dense toward the corner (0, 1)."""
        return Splines(self.breaks, self.degree), Splines((1 - self.breaks)[::-1], self.degree)


def napkin(resolution: Resolution, tilt: float | None = None, bending_factor: float = 1.0) -> Cloth:
    """Return the pinned napkin: plane if no tilt of gravity is given, else in space."""
    gravity: tuple[float, ...] = (0.0, -GRAVITY)
    if tilt is not None:
        gravity = (0.0, -GRAVITY * float(np.cos(tilt)), GRAVITY * float(np.sin(tilt)))
    return Cloth(resolution.splines, 5000.0, 0.25, 0.0012, 0.144, gravity, bending_factor, PIN)


def quantities(
    moments: Iterator[Moment], place: tuple[str, tuple[float, float]] = ("corner", FREE_CORNER), axes: str = "xyz"
) -> dict[str, float]:
    """Positions of a point and of the centre of mass along the axes, and energies, by the names of a case."""
    values: dict[str, float] = {}
    for moment in moments:
        cloth = moment.cloth
        name, point = place
        vectors = {name: cloth.position(moment.coefficients, *point), "centre": cloth.centre(moment.coefficients)}
        energies = cloth.energies(moment.coefficients, moment.velocity)
        kinds = {"kinetic": energies.kinetic, "membrane": energies.membrane}
        if len(cloth.gravity) == 3:
            kinds["bending"] = energies.bending
        wanted = ["xyz".index(axis) for axis in axes if "xyz".index(axis) < len(cloth.gravity)]
        values |= at_time(moment.time, {key: vector[wanted] for key, vector in vectors.items()}, kinds, axes)
    return values


def _moved(cloth: Cloth, times: tuple[float, ...], resolution: Resolution) -> dict[str, float]:
    if resolution.tolerance is None:
        return quantities(leapfrog(cloth, times, FRACTION))
    return quantities(motion(cloth, times, resolution.tolerance))


def plane_values(resolution: Resolution) -> dict[str, float]:
    """Values of napkin_plane on one mesh."""
    return _moved(napkin(resolution), PLANE_TIMES, resolution)


def soft_pin_values(resolution: Resolution) -> dict[str, float]:
    """Values of napkin_soft_pin on one mesh."""
    return _moved(napkin(resolution, TILT, 100.0), TILTED_TIMES, resolution)


def napkin_plane() -> dict[str, Estimate]:
    """Known values of the plane napkin."""
    return between(plane_values(Resolution(48, 4)), plane_values(Resolution(32, 4)), ROUNDING)


def course_values(plane: dict[str, Estimate]) -> dict[str, Estimate]:
    """Return the known values of napkin_course from those of napkin_plane: positions of the corner as displacements."""
    moved = {}
    for name, estimate in plane.items():
        if name.startswith("corner_x"):
            moved[name.replace("corner_x", "corner_right")] = replace(estimate, value=estimate.value - FREE_CORNER[0])
        elif name.startswith("corner_y"):
            moved[name.replace("corner_y", "corner_drop")] = replace(estimate, value=FREE_CORNER[1] - estimate.value)
    return plane | moved


def napkin_course() -> dict[str, Estimate]:
    """Known values of the plane napkin of the obstacle course."""
    return course_values(napkin_plane())


def napkin_soft_pin() -> dict[str, Estimate]:
    """Known values of the napkin that leaves its plane."""
    fine, coarse = (soft_pin_values(Resolution(*mesh, tolerance=None)) for mesh in ((64, 3), (48, 4)))
    return between(fine, coarse, LEAPFROG_ROUNDING)
