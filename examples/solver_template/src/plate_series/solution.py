"""The answer: a displacement field that can be evaluated anywhere (the protocol `shellbench.problem.Solution`).

shellbench measures a solver only through this class. The base class adds points of any shape (..., 2), files, rounding,
bytes and zero velocity. This class has the arrays, and the values at points (N, 2). A solver on a mesh interpolates
with its own basis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words

from plate_series import plate as series
from plate_series.plate import Array, Plate
from plate_series.reading import plate_of


@dataclass(frozen=True)
class PlateSolution(ShellSolution):
    """A double sine series that answers a case.

    Attributes
    ----------
    case
        The solved case.
    coefficients
        (terms, terms) c_mn of odd m and n, m, along the normal a3 = z.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("plate-series, format 1",)  # of files: change it with what they hold
    numbers: ClassVar[tuple[str, ...]] = ("coefficients",)  # the arrays that the displacement is made of

    case: Case
    coefficients: Array

    @cached_property
    def plate(self) -> Plate:
        """The data of the case that the series needs."""
        return plate_of(self.case)

    @property
    def parameters(self) -> int:
        """Number of free parameters that were solved for."""
        return int(self.coefficients.size)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3), m; the load is the same at any mark `at`."""
        w = series.derivative(self.plate, self.coefficients, xi, (0, 0))
        return np.stack([np.zeros_like(w), np.zeros_like(w), w], axis=-1)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,): a plate under normal load does not stretch in linear theory.

        The names, components and units are those of `shellbench.problem.FIELDS`.
        """
        if name == "bending_strain":
            return series.bending_strain(self.plate, self.coefficients, xi)
        if name == "bending_energy_density":
            return series.bending_energy_density(self.plate, self.coefficients, xi)
        return np.zeros((len(xi), 3) if name == "membrane_strain" else len(xi))

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        return 0.0, series.bending_energy(self.plate, self.coefficients)

    def derivative(self, quantity: Any, parameter: str) -> float:
        """Return dQ/dp of a quantity of the case: all values are proportional to a power of q / B, energies to q^2 / B."""
        material, value = self.case.material, float(quantity.measure(self))
        nu = material.poissons_ratio
        by_stiffness = {  # d log B / dp
            "material.youngs_modulus": 1 / material.youngs_modulus,
            "material.thickness": 3 / material.thickness,
            "material.poissons_ratio": 2 * nu / (1 - nu**2),
        }
        if parameter == "loads.1":
            return value * (2 if "energy" in quantity.kind else 1)
        return -value * by_stiffness[parameter]

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that the rim exerts on the plate.

        By virtual work: a rigid motion of plate and rim changes no strain, so that the rim takes the whole load. The
        result is therefore exact, and a case with several supports is declined.
        """
        (low1, low2), (a, b) = self.plate.lower, self.plate.size
        force = np.array([0.0, 0.0, -self.plate.load * a * b])
        return force, np.cross(np.array([low1 + a / 2, low2 + b / 2, 0.0]) - centre, force)

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> PlateSolution:
        """Make a solution from the content of a file."""
        return cls(case, arrays["coefficients"])
