"""The answer: a displacement field that can be asked anywhere (the protocol `shellbench.problem.Solution`).

Everything that shellbench shows of a solver it measures through this class. A solution must answer at any points,
one or a million, in any shape (..., 2); a solver on a mesh interpolates with its own basis.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from shellbench.errors import InputError
from shellbench.problem import NumberFormat, Step
from shellbench.problems.rounding import shortened
from shellbench.problems.shell.case import Case

from plate_series import plate as series
from plate_series.plate import Array, Plate
from plate_series.reading import plate_of

DAMAGE = (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


@dataclass(frozen=True)
class PlateSolution:
    """A double sine series that answers a case.

    Attributes
    ----------
    case
        The case it answers.
    coefficients
        (terms, terms) c_mn of odd m and n, m, along the normal a3 = z.
    history
        How it came about: one step for each number of terms that was tried.
    diagnostics
        Figures about the solve, JSON values only.
    uncertainty
        The solver's own estimate of its error by quantity; may be empty.
    extrapolated
        Values extrapolated from the history by quantity; may be empty. They never replace the answer.
    """

    case: Case
    coefficients: Array
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def plate(self) -> Plate:
        """What the series needs of the case."""
        return plate_of(self.case)

    @property
    def parameters(self) -> int:
        """Number of free parameters that were solved for."""
        return int(self.coefficients.size)

    @property
    def storage_bytes(self) -> int:
        """Bytes that `displacement` needs beside the case."""
        return int(self.coefficients.nbytes)

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at points (..., 2); the load is the same at any mark `at`."""
        xi = np.asarray(points, dtype=float)
        w = series.derivative(self.plate, self.coefficients, xi, (0, 0))
        return np.stack([np.zeros_like(w), np.zeros_like(w), w], axis=-1)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return zeros (..., 3): nothing moves in a static case."""
        return np.zeros((*np.asarray(points).shape[:-1], 3))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return strains (..., 3) or energy densities (...) at points (..., 2); KeyError for an unknown name.

        The names, components and units are those of `shellbench.problem.FIELDS`. In linear theory a plate under
        normal load does not stretch.
        """
        xi = np.asarray(points, dtype=float)
        match name:
            case "membrane_strain":
                return np.zeros((*xi.shape[:-1], 3))
            case "membrane_energy_density":
                return np.zeros(xi.shape[:-1])
            case "bending_strain":
                return series.bending_strain(self.plate, self.coefficients, xi)
            case "bending_energy_density":
                return series.bending_energy_density(self.plate, self.coefficients, xi)
        raise KeyError(name)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        return 0.0, series.bending_energy(self.plate, self.coefficients)

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that the rim exerts on the plate.

        By virtual work: under a rigid motion of plate and rim no strain changes, so that the rim takes the whole
        load. This is what makes it exact, and why a case with several supports is declined.
        """
        if support != self.case.supports[0].name:
            raise InputError(f"{self.case.name}: no support is called '{support}'")
        (low1, low2), (a, b) = self.plate.lower, self.plate.size
        force = np.array([0.0, 0.0, -self.plate.load * a * b])
        middle = np.array([low1 + a / 2, low2 + b / 2, 0.0])
        return force, np.cross(middle - np.asarray(centre, dtype=float), force)

    def rounded(self, format: NumberFormat) -> tuple[PlateSolution, int]:
        """Return the solution with its coefficients rounded to a format, and the bytes that they take (optional)."""
        short = shortened(self.coefficients, format)
        return replace(self, coefficients=short.expanded()), short.nbytes

    def save(self, path: Path) -> Path:
        """Write an npz file without pickles; return its path, which ends in .npz."""
        target = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        words = {
            "name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            "history": [asdict(step) for step in self.history],
            "diagnostics": dict(self.diagnostics),
            "uncertainty": dict(self.uncertainty),
        }
        np.savez(target, allow_pickle=False, words=np.asarray(json.dumps(words)), coefficients=self.coefficients)
        return target

    @classmethod
    def load(cls, path: Path) -> PlateSolution:
        """Read what `save` wrote; InputError in one sentence if the file is missing or damaged."""
        try:
            with np.load(path, allow_pickle=False) as data:
                words, coefficients = json.loads(str(data["words"])), data["coefficients"]
            case = Case.model_validate({**words["case"], "name": words["name"]})
            history = tuple(Step(**step) for step in words["history"])
            return cls(case, coefficients, history, words["diagnostics"], words["uncertainty"])
        except OSError as error:
            raise InputError(f"{path}: can't be read ({error.strerror or 'damaged'})") from None
        except DAMAGE:
            raise InputError(f"{path}: is damaged, or not a solution of plate-series") from None
