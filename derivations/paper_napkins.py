r"""Known values of the napkins of Kairanda et al. 2023 (section E.1) while they have any: `spline_motion` on graded meshes.

- napkin_corner, napkin_moving_corners: held at points, in their own plane. The energy grows with the fourth power of
  the stretch, which makes a point support meaningful: points have a capacity in W^{1,4}. Close to one the displacement
  grows as r^{2/3}, the radial solution r^{(p-n)/(p-1)} of the p-Laplace equation with p = 4 in n = 2 dimensions, and
  what a mesh of span h there misses is in proportion to h^{2/3} likewise. Values are extrapolated to a span of zero as
  a series in that power. The meshes are uniform: grading leaves the whip of the free corner coarse, whose values then
  differ from mesh to mesh by far more.
- napkin_fixed_edges: two edges held, gravity across. A thin layer of bending grows at the held edges, toward which the
  mesh is graded. It wrinkles as finely as a mesh allows once parts of it are compressed; only what the wrinkles leave
  alone has a value, and only early.

All are followed along the path that keeps their symmetry; rounding leaves it as soon as that path is unstable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .estimate import Estimate
from .explicit_motion import leapfrog, motion
from .motion import GRAVITY, Resolution, quantities
from .over_time import between, extrapolated
from .spline_motion import Cloth
from .spline_shell import Splines
from .surface_strains import Array

MATERIAL = (5000.0, 0.25, 0.0012, 0.144)
SPEED, RAMP = 0.2, 0.05
"""Of the corners that move inward, m/s, and the time in which they come to it, s."""
TIMES, SWING_TIMES = (0.2, 0.4), (0.2, 0.4, 1.0)
"""At which the values of different meshes agree; napkin_corner loses that at about 1.4 s only."""
TOLERANCE, FRACTION = 1e-6, 0.8
"""Of the Runge-Kutta method; step of the leapfrog over its limit of stability."""
SPANS, UNIFORM = (24, 36, 54), 1e3
"""Spans a side of the meshes that are extrapolated; a grading that leaves them as good as equal."""
CAPACITY = 2 / 3
"""Order of the error in the span at a point support."""
ROUNDING = 1e-6
"""Error left by time steps, m and J."""


def held_corner(resolution: Resolution) -> Cloth:
    """Return the plane napkin held at the corner (0, 1)."""
    splines = resolution.splines
    return Cloth(splines, *MATERIAL, (0.0, -GRAVITY), held=((0, splines[1].count - 1),))


def toward_both_ends(resolution: Resolution) -> Array:
    """Breaks of the unit interval, as dense at both ends as those of the resolution are at one."""
    half = Resolution(resolution.spans // 2, resolution.degree, 2 * resolution.grading).breaks / 2
    return np.asarray(np.concatenate([half, (1 - half)[-2::-1]]))


def moving_corners(resolution: Resolution) -> Cloth:
    """Return the plane napkin whose corners (0, 1) and (1, 1) move inward by SPEED (t - RAMP (1 - exp(-t / RAMP)))."""
    splines = Splines(toward_both_ends(resolution), resolution.degree), resolution.splines[1]
    last = splines[1].count - 1

    def inward(time: float) -> Array:
        return np.asarray(SPEED / RAMP * np.exp(-time / RAMP) * np.array([[1.0, -1.0], [0.0, 0.0]]))

    return Cloth(splines, *MATERIAL, (0.0, -GRAVITY), held=((0, last), (splines[0].count - 1, last)), moved=inward)


def held_edges(resolution: Resolution) -> Cloth:
    """Return the napkin in space with its edges xi1 = 0 and xi2 = 0 held, dense toward both."""
    line = Splines(resolution.breaks, resolution.degree)
    held = [(0, j) for j in range(line.count)] + [(i, 0) for i in range(1, line.count)]
    return Cloth((line, line), *MATERIAL, (0.0, 0.0, -GRAVITY), held=tuple(held))


def corner_values(resolution: Resolution, times: Sequence[float] = SWING_TIMES) -> dict[str, float]:
    """Values of napkin_corner on one mesh."""
    return quantities(leapfrog(held_corner(resolution), times, FRACTION))


def moving_values(resolution: Resolution, times: Sequence[float] = TIMES) -> dict[str, float]:
    """Values of napkin_moving_corners on one mesh."""
    moments = motion(moving_corners(resolution), times, TOLERANCE)
    return quantities(moments, ("middle", (0.5, 0.0)), "y")


def edges_values(resolution: Resolution, times: Sequence[float] = TIMES) -> dict[str, float]:
    """Values of napkin_fixed_edges on one mesh."""
    return quantities(motion(held_edges(resolution), times, TOLERANCE), ("corner", (1.0, 1.0)), "xz")


def to_a_point(compute: Callable[[Resolution], dict[str, float]], meshes: Sequence[Resolution]) -> dict[str, Estimate]:
    """Limits of the values of three meshes, coarse to fine, for a span of zero at the point support."""
    return extrapolated([(mesh.breaks[1] ** CAPACITY, compute(mesh)) for mesh in meshes], ROUNDING)


def napkin_corner() -> dict[str, Estimate]:
    """Known values of the napkin held at a corner."""
    return to_a_point(corner_values, [Resolution(spans, 3, UNIFORM) for spans in SPANS])


def napkin_corner_early() -> dict[str, Estimate]:
    """Known values of the napkin held at a corner, at the first of its times."""
    return to_a_point(
        lambda mesh: corner_values(mesh, SWING_TIMES[:1]), [Resolution(spans, 3, UNIFORM) for spans in SPANS]
    )


def napkin_moving_corners() -> dict[str, Estimate]:
    """Known values of the napkin whose corners move, until it becomes unstable."""
    return to_a_point(moving_values, [Resolution(spans, 3, UNIFORM) for spans in SPANS])


def napkin_fixed_edges() -> dict[str, Estimate]:
    """Known values of the napkin with two held edges, before its wrinkles matter; its bending energy is all theirs."""
    values = between(edges_values(Resolution(40, 4, 0.25)), edges_values(Resolution(32, 3, 0.25)), ROUNDING)
    return {name: estimate for name, estimate in values.items() if "bending" not in name}
