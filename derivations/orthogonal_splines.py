"""Linear shells on splines, `linear_splines`, solved by orthogonal factors of their strains.

The roots of the energy of each knot span come from the same operators of strains. `least_squares`
eliminates them. Conditions of symmetry and loads on areas are not taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .least_squares import Piece, factors, minimiser, triangle
from .linear_splines import LinearShell
from .surface_strains import Array


@dataclass(frozen=True)
class OrthogonalShell:
    """A shell on splines, solved by orthogonal factors of its strains."""

    shell: LinearShell

    @cached_property
    def _kept(self) -> tuple[np.ndarray, Array]:
        """Number of each coefficient among the free ones, or -1, and its factor."""
        reduction = self.shell.reduction.tocoo()
        number, factor = np.full(reduction.shape[0], -1), np.zeros(reduction.shape[0])
        number[reduction.row], factor[reduction.row] = reduction.col, reduction.data
        return number, factor

    def _strips(self) -> Iterator[list[Piece]]:
        """Yield the unknowns and the roots of the energy of each span, by strip along xi1."""
        shell = self.shell
        across = len(shell.splines[1].breaks) - 1
        stretching = shell.young * shell.thickness / (1 - shell.poisson**2)
        roots = np.sqrt(stretching * np.array([1, shell.thickness**2 / 12]))
        number, factor = self._kept
        for i in range(len(shell.splines[0].breaks) - 1):
            part = slice(i * across, (i + 1) * across)
            one, two, weight = (array[part] for array in shell._places)
            strains, _, elastic, _, area = shell._point_matrices(one.ravel(), two.ravel())
            upper = np.swapaxes(np.linalg.cholesky(elastic * (area * weight.ravel())[:, None, None]), 1, 2)
            root = np.concatenate(
                [upper @ strains[:, 3 * k : 3 * k + 3].reshape(-1, 3, 18) * roots[k] for k in (0, 1)], axis=1
            )
            shapes = shell._shapes(part)
            numbers = shell._numbers[part]
            found = []
            for span, of_span in enumerate(numbers):
                rows = np.einsum("prkc,pkn->prcn", root.reshape(*weight.shape, 6, 6, 3)[span], shapes[span])
                rows = rows.reshape(-1, len(of_span))
                free = number[of_span] >= 0
                found.append((number[of_span[free]], triangle(rows[:, free] * factor[of_span[free]])))
            yield found

    @cached_property
    def free(self) -> Array:
        """The free coefficients."""
        return minimiser(factors(list(self._strips()), self.shell.reduction.shape[1]), self.load)

    @cached_property
    def load(self) -> Array:
        """Work of the forces on the free functions."""
        shell = self.shell
        work = np.zeros(shell.reduction.shape[0])
        for one, two, force in shell.forces:
            work += np.array(force) @ shell._all_rows(one, two)
        return np.asarray(shell.reduction.T @ work)

    def displacement(self, one: float, two: float) -> Array:
        """Cartesian displacement (3,) at a point, m."""
        return np.asarray(self.shell.rows(one, two) @ self.free)

    @property
    def energy(self) -> float:
        """Strain energy, J."""
        return float(self.load @ self.free) / 2
