"""The answer of `p-naghdi`: coefficients of a grid on a part of the shell, and its mirror images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words
from shellbench.problems.shell.symmetry.symmetry import Part, part_of
from shellbench.solvers.naghdi.grid import Grid
from shellbench.solvers.naghdi.strains import FIELDS, Frame

Array = NDArray[np.float64]
CHUNK = 4096  # points that are evaluated together


@dataclass(frozen=True)
class GridSolution(ShellSolution):
    """Five fields on a grid; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    first, second
        Ends of cells along the coordinates.
    coefficients
        (functions, functions, 5).
    rigid
        (6,) rigid motion that is subtracted, m.
    membrane, bending
        Parts of the strain energy of the whole shell, J; that of shear counts with bending.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("p-naghdi, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("coefficients",)

    case: Case
    degree: int
    first: Array
    second: Array
    coefficients: Array
    rigid: Array
    membrane: float
    bending: float

    @property
    def parameters(self) -> int:
        """Number of coefficients."""
        return self.coefficients.size

    @cached_property
    def part(self) -> Part:
        """The part of the shell that the grid covers."""
        return part_of(self.case)

    @property
    def grid(self) -> Grid:
        """The grid."""
        return Grid((self.first, self.second), self.degree, self.part.case.surface.domain.periodic)

    def jets(self, points: Array) -> Array:
        """Return the fields and their slopes (N, 3, 5) at points (N, 2) of the part."""
        grid, out = self.grid, np.empty((len(points), 3, FIELDS))
        for start in range(0, len(points), CHUNK):
            chosen = slice(start, start + CHUNK)
            (a, along), (b, across) = (grid.at(axis, points[chosen, axis]) for axis in (0, 1))
            local = self.coefficients[grid.numbers(0)[a][:, :, None], grid.numbers(1)[b][:, None, :]]
            for d, (i, j) in enumerate(((0, 0), (1, 0), (0, 1))):
                one = (across[j][:, None, :, None] * local).sum(axis=2)
                out[chosen, d] = (along[i][:, :, None] * one).sum(axis=1)
        return out

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        folded = self.part.fold(xi)
        moved = rigid_modes(self.case.surface, folded.points)[0, 0] @ self.rigid
        return np.asarray(folded.signs * (self.jets(folded.points)[:, 0, :3] - moved))

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return covariant strains (N, 3) or energy densities (N,); the energy of shear is counted with bending."""
        folded = self.part.fold(xi)
        frame, z = Frame.at(self.part.case, folded.points), self.jets(folded.points).reshape(len(xi), -1)
        strain = np.einsum("nsz,nz->ns", frame.operator(), z)
        of, _, what = name.partition("_")
        if what == "strain":
            start = 0 if of == "membrane" else 3
            signs = np.ones((len(xi), 3))
            signs[:, 2] = folded.turned.prod(axis=-1) / 2  # a mirror changes the sign of the component 12
            return np.asarray(strain[:, start : start + 3] * signs)
        membrane, bending, shear = frame.stiffness(self.case)
        stiffness = membrane if of == "membrane" else bending + shear
        return np.asarray(0.5 * np.einsum("ns,nst,nt->n", strain, stiffness, strain))

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane energy, and that of bending and shear, J."""
        return self.membrane, self.bending

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that a file holds beside the case and the history."""
        words = {name: getattr(self, name) for name in ("degree", "membrane", "bending")}
        return words, {name: getattr(self, name) for name in ("first", "second", "coefficients", "rigid")}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> GridSolution:
        """Make a solution from the data of a file; ValueError or KeyError if they are inconsistent."""
        first, second, coefficients, rigid = (arrays[n] for n in ("first", "second", "coefficients", "rigid"))
        membrane, bending = (float(words[name]) for name in ("membrane", "bending"))
        found = cls(case, int(words["degree"]), first, second, coefficients, rigid, membrane, bending)
        grid = found.grid
        shape = (grid.count(0), grid.count(1), FIELDS)
        if found.coefficients.shape != shape or found.rigid.shape != (len(RIGID_MOTIONS),):
            raise ValueError("the coefficients do not fit the grid")
        return found
