"""The points at which a field's gaps to obstacles are evaluated, and the forces at these points.

Forces are multipliers, found from the dual problem: least squares with unknowns that are not negative (Lawson & Hanson
1974, chapter 23).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import nnls

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch
from shellbench.solvers.ndf.field.choices import Crease
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.field.quadrature import ROUNDING

Flags = NDArray[np.bool_]

GAP_POINTS = 600  # at which gaps are evaluated, while no edge of contact is known
ROWS_ACROSS, FEWEST_ROWS, MOST_ROWS = 80, 5, 12  # of the points across the edges of contact, and along these
GUARD = 2.0  # spacings outside an edge of contact that its own row represents
# The cases of the tuning of the next ones are not on record, except where a line states them.
LINE_FORCE = 10.0  # times as large a force costs no more on such a row: a line force is no noise
SLIGHT = 1e-9  # share of the mean compliance by which obstacles yield, which makes forces unique
SMOOTH = 1e-3  # the same for smooth forces
CLOSED = 3e-4  # of the largest displacement: gaps at which smooth forces may act
PRESSURE_REACH, FAR_REACH = 2.0, 8.0  # spacings over which forces make a pressure, with edges of contact known or not


def contact_points(case: Case, creases: tuple[Crease, ...], finer: float, ends: bool = False) -> Touch:
    """Return the points at which the gap is evaluated, in rows along both coordinates, with zero forces.

    `ends` are True if there are rows on the edges of the shell as well.
    """
    # 1. Choose the numbers of rows: more across edges of contact, few along them.
    # 2. Along each coordinate, place a row on each edge of contact (and on the shell's edges with `ends`), and even
    #    rows between.
    # 3. Form the grid of both coordinates, with the lengths that each point represents.
    domain, sides = case.surface.domain, np.asarray(side_lengths(case))
    if creases:
        across = {axis for axis, _, _ in creases}
        alike = ROWS_ACROSS * sides / sides[min(across)]
        counts = [
            ROWS_ACROSS if axis in across else int(np.clip(alike[axis], FEWEST_ROWS, MOST_ROWS)) for axis in (0, 1)
        ]
    else:
        counts = [max(4, round(float(np.sqrt(GAP_POINTS / sides.prod()) * side))) for side in sides]
    found = []
    for axis in (0, 1):
        # The row of an edge of contact represents half a spacing inside, and `GUARD` of them outside, where the gap
        # opens with the cube of the distance.
        h = domain.size[axis] / round(finer * counts[axis])
        lines = sorted((at, side) for other, at, side in creases if other == axis)
        first, last = domain.lower[axis], domain.upper[axis]
        rows = []  # each with the start and the end of the part of the shell that it represents
        for at, side in lines:
            below, above = (0.5, GUARD) if side > 0 else (GUARD, 0.5)
            rows.append((at - below * h, at, at + above * h))
        if ends and not domain.periodic[axis]:
            rows = [(first, first, first + h / 2), *rows, (last - h / 2, last, last)]
        breaks = [first, *(end for start, _, stop in rows for end in (start, stop)), last]
        if np.any(np.diff(breaks) < 0):
            raise SolveFailure("edges of contact lie closer than the points at which gaps are asked")
        points: list[Array] = []
        lengths: list[Array] = []
        for k, (start, stop) in enumerate(pairwise(breaks)):
            if start == stop:
                continue
            if k % 2:
                points.append(np.array([rows[k // 2][1]]))
                lengths.append(np.array([stop - start]))
                continue
            number = max(1, round((stop - start) / h))
            points.append(start + (stop - start) * (np.arange(number) + 0.5) / number)
            lengths.append(np.full(number, (stop - start) / number))
        found.append((np.concatenate(points), np.concatenate(lengths)))
    grid, sizes = (
        np.stack(np.meshgrid(found[0][k], found[1][k], indexing="ij"), axis=-1).reshape(-1, 2) for k in (0, 1)
    )
    x = case.surface.derivatives(grid, 1)
    speeds = np.stack([np.broadcast_to(np.linalg.norm(x[k], axis=-1), len(grid)) for k in ((1, 0), (0, 1))], axis=-1)
    spacing = np.array([domain.size[axis] / round(finer * counts[axis]) for axis in (0, 1)]) * speeds.max(axis=0)
    return Touch(grid, np.zeros((len(grid), 3)), sizes * speeds, (PRESSURE_REACH if creases else FAR_REACH) * spacing)


def least_forces(compliance: Array, gap: Array, give: Array) -> Array:
    """Return forces x (n,) >= 0 with gap + (compliance + give) x >= 0, one of both zero: N from m and m/N.

    Raises
    ------
    SolveFailure
        If rounding hides them.
    """
    if not np.any(gap < 0):
        return np.zeros(len(gap))  # SciPy's routine refuses an empty matrix
    # min x A x / 2 + gap x over x >= 0 with A = R^T R is the distance of R x from -R^-T gap: least squares.
    try:
        root = cholesky(compliance + np.diag(give))
        found, _ = nnls(root, -solve_triangular(root, gap, trans="T"), maxiter=50 * len(gap))
    except (LinAlgError, RuntimeError, ValueError) as error:
        raise SolveFailure(f"the forces of obstacles can't be found ({error})") from None
    return np.asarray(found)


def typical_compliance(compliance: Array, touch: Touch) -> Array:
    """Return the mean compliance (n,) of points, m/N, larger for points of smaller area."""
    area = touch.lengths.prod(axis=1)
    return np.asarray(np.mean(np.diag(compliance)) * area.mean() / area)


def smoothest_forces(
    compliance: Array, gap: Array, forces: Array, unit: Array, line: Flags, largest: float, passes: int = 1
) -> Array:
    """Return the forces (n,) >= 0, N, that move the shell as `forces` do and vary least.

    They act where gaps are closed. `gap` (n,) is the gap without them, `unit` their `typical_compliance`, `line` (n,)
    the points on an edge of contact, and `largest` the shell's largest displacement, m. Obstacles yield, so that a pass
    leaves a part of the response, which the next pass adds.
    """
    # Among the forces with the same response, take those with the least sum of squares per area. The textbook takes the
    # multipliers. Here there are more points than a smooth basis resolves, so that the multipliers are a few spikes:
    # their resultants are right, but their places are arbitrary.
    near = (gap + compliance @ forces <= CLOSED * largest) | (forces > 0)
    give = (SMOOTH * unit / np.where(line, LINE_FORCE, 1.0))[near]
    smooth = np.zeros(len(forces))
    among, asked = compliance[np.ix_(near, near)], (compliance @ forces)[near]
    for _ in range(passes):
        smooth[near] = least_forces(among, -asked - give * smooth[near], give)
    return smooth


def crease_mask(case: Case, touch: Touch, creases: tuple[Crease, ...]) -> Flags:
    """Return a mask (n,) of the points that are on an edge of contact."""
    line = np.zeros(len(touch.points), dtype=bool)
    for axis, at, _ in creases:
        line |= np.abs(touch.points[:, axis] - at) <= ROUNDING * case.surface.domain.size[axis]
    return line
