"""The isogeometric answer: a continuous field through its own rational B-splines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, state_number
from shellbench.problems.shell.symmetry import Part, part_of, whole_of
from shellbench.solvers.kratos.iga_conditions import control_forces, held_by
from shellbench.solvers.kratos.iga_mechanics import Integrals, densities, integrals, strains
from shellbench.solvers.kratos.nurbs import Midsurface, midsurface_of

Array = NDArray[np.float64]
Lines = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class IgaSolution(ShellSolution):
    """A displacement field on a NURBS patch, at one or several load factors.

    Attributes
    ----------
    part, midsurface
        The part of the case's shell that was solved, and its NURBS surface.
    coefficients
        (n1, n2, 3, states) displacements of the control points, m.
    states, factors
        Marks of the path (see `path.Path`), and load factors there: the same where the load is prescribed.
    parameters
        Components of control points that were solved for.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("kratos-iga, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("coefficients",)

    part: Part
    midsurface: Midsurface
    coefficients: Array
    states: tuple[float, ...]
    factors: tuple[float, ...]
    parameters: int

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.part.whole

    @property
    def degree(self) -> int:
        """Degree of the splines."""
        return self.midsurface.patch.bases[0].degree

    @property
    def lines(self) -> Lines:
        """Knot lines of the part, as values of the coordinates."""
        first, second = self.midsurface.patch.bases
        return first.lines, second.lines

    @property
    def storage_bytes(self) -> int:
        """Bytes of the coefficients and the knot lines; weights and control points follow from the case."""
        return super().storage_bytes + sum(8 * len(lines) for lines in self.lines)

    def state(self, at: float | None) -> int:
        """Return the number of a mark of the path; InputError if the case was not solved at it."""
        return state_number(self.case, self.states, at)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        folded = self.part.fold(xi)
        coefficients = self.coefficients[..., self.state(at)]
        return self.midsurface.patch.derivatives(coefficients, folded.points, order=0)[0, 0] * folded.signs

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        folded = self.part.fold(xi)
        patch = self.midsurface.patch
        x = self.case.surface.derivatives(self.case.surface.domain.wrap(folded.points), order=2)
        u = patch.derivatives(self.coefficients[..., self.state(at)], folded.points)
        strain = strains(x, u, self.case.linear)
        number = 0 if name.startswith("membrane") else 1
        if name.endswith("density"):
            return densities(x, strain, self.case.material)[:, number]
        # where one coordinate runs the other way, components 12 have the other sign
        strain[..., 2] *= folded.turned.prod(axis=-1)[:, None]
        return strain[:, number]

    @cached_property
    def _integrals(self) -> list[Integrals]:
        surface = self.midsurface
        return [
            integrals(self.case, surface.patch, surface.control_points, self.coefficients[..., number])
            for number in range(len(self.states))
        ]

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        membrane, bending = self._integrals[self.state(at)].energies * self.part.copies
        return float(membrane), float(bending)

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        They are what its control points lack for equilibrium: internal forces less loads. Since rigid motions of the
        field are those of its control points, the forces' moment about the centre is the support's.
        """
        state, patch = self.state(at), self.midsurface.patch
        lacking = self._integrals[state].forces - control_forces(self.part.case, patch, self.factors[state])
        places = self.midsurface.control_points
        if not self.case.linear:
            places = places + self.coefficients[..., state]
        force, moment = np.zeros(3), np.zeros(3)
        for mirrors in self.part.images():
            acting = held_by(self.part, number, mirrors, patch.shape)
            forces, arms = np.moveaxis(np.where(acting, lacking, 0.0), 0, -1), places
            for mirror in mirrors:
                forces, arms = forces * mirror.signs, mirror.reflected(arms)
            force += forces.sum(axis=(0, 1))
            moment += np.cross(arms - centre, forces).sum(axis=(0, 1))
        return force, moment

    def kept(self) -> tuple[Words, Arrays]:
        """Return what a file holds beside the case and the history."""
        return {"degree": self.degree, "symmetry": bool(self.part.mirrors)}, {
            "lines1": np.asarray(self.lines[0]),
            "lines2": np.asarray(self.lines[1]),
            "coefficients": self.coefficients,
            "states": np.asarray(self.states),
            "factors": np.asarray(self.factors),
        }

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> IgaSolution:
        """Make a solution of what a file holds; ValueError or KeyError if it does not fit together."""
        degree, lines1, lines2 = int(words["degree"]), arrays["lines1"].tolist(), arrays["lines2"].tolist()
        coefficients, states = arrays["coefficients"], tuple(arrays["states"].tolist())
        factors = tuple(arrays["factors"].tolist())
        if len(factors) != len(states) or coefficients.shape != (
            len(lines1) - 1 + degree,
            len(lines2) - 1 + degree,
            3,
            len(states),
        ):
            raise ValueError("coefficients do not fit the knot lines")
        lines = (tuple(lines1), tuple(lines2))
        return cls(
            part_of(case) if words["symmetry"] else whole_of(case),
            midsurface_of(case.surface, lines, degree, case.surface.domain.angle),
            coefficients,
            states,
            factors,
            int(words["parameters"]),
        )
