"""The isogeometric answer: a continuous field through its own rational B-splines."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problem import FIELDS, NumberFormat, Step
from shellbench.problems.rounding import shortened
from shellbench.problems.shell.case import Case
from shellbench.solvers.kratos.iga_loads import control_forces
from shellbench.solvers.kratos.iga_mechanics import Integrals, densities, integrals, strains
from shellbench.solvers.kratos.iga_supports import held_by
from shellbench.solvers.kratos.nurbs import Midsurface, midsurface_of
from shellbench.solvers.kratos.symmetry import Part, part_of, whole_of

Array = NDArray[np.float64]
Lines = tuple[tuple[float, ...], tuple[float, ...]]

MARK = "kratos-iga, format 1"
DAMAGE = (ValueError, KeyError, TypeError, EOFError, IndexError, zipfile.BadZipFile, zlib.error)
SLACK = 1e-9  # relative distance of a load factor from one that was solved for


@dataclass(frozen=True)
class IgaSolution:
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
    history, diagnostics, uncertainty, extrapolated
        See `shellbench.problem.Solution`.
    """

    part: Part
    midsurface: Midsurface
    coefficients: Array
    states: tuple[float, ...]
    factors: tuple[float, ...]
    parameters: int
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.part.case

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
        return self.coefficients.nbytes + sum(8 * len(lines) for lines in self.lines)

    def state(self, at: float | None) -> int:
        """Return the number of a mark of the path.

        Raises
        ------
        InputError
            If the case was not solved at it.
        """
        if at is None:
            return len(self.states) - 1
        nearest = int(np.argmin(np.abs(np.asarray(self.states) - at)))
        if abs(self.states[nearest] - at) > SLACK * max(1.0, abs(at)):
            known = ", ".join(f"{s:g}" for s in self.states)
            raise InputError(f"{self.case.name}: solved at {known}, not at {at:g}")
        return nearest

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at points (..., 2)."""
        xi = np.asarray(points, dtype=float)
        folded = self.part.fold(xi.reshape(-1, 2))
        coefficients = self.coefficients[..., self.state(at)]
        u = self.midsurface.patch.derivatives(coefficients, folded.points, order=0)[0, 0]
        return np.asarray((u * folded.signs).reshape(*xi.shape[:-1], 3))

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) at points (..., 2): zero, because nothing moves."""
        return np.zeros((*np.asarray(points).shape[:-1], 3))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2)."""
        if name not in FIELDS:
            raise KeyError(name)
        xi = np.asarray(points, dtype=float)
        folded = self.part.fold(xi.reshape(-1, 2))
        patch = self.midsurface.patch
        x = self.case.surface.derivatives(self.case.surface.domain.wrap(folded.points), order=2)
        u = patch.derivatives(self.coefficients[..., self.state(at)], folded.points)
        strain = strains(x, u, self.case.linear)
        number = 0 if name.startswith("membrane") else 1
        if name.endswith("density"):
            return densities(x, strain, self.case.material)[:, number].reshape(xi.shape[:-1])
        # where one coordinate runs the other way, components 12 have the other sign
        strain[..., 2] *= folded.turned.prod(axis=-1)[:, None]
        return strain[:, number].reshape(*xi.shape[:-1], 3)

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

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        They are what its control points lack for equilibrium: internal forces less loads. Since rigid motions of the
        field are those of its control points, the forces' moment about the centre is the support's.
        """
        names = [s.name for s in self.case.supports]
        if support not in names:
            raise InputError(f"{self.case.name}: no support is called '{support}'; known are {', '.join(names)}")
        number, patch = self.state(at), self.midsurface.patch
        lacking = self._integrals[number].forces - control_forces(self.part, patch, self.factors[number])
        places = self.midsurface.control_points
        if not self.case.linear:
            places = places + self.coefficients[..., number]
        force, moment = np.zeros(3), np.zeros(3)
        for images in self.part.images():
            acting = held_by(self.part, names.index(support), images, patch.shape)
            forces, arms = np.moveaxis(np.where(acting, lacking, 0.0), 0, -1), np.array(places)
            for mirror in images:
                forces = forces * mirror.signs
                arms[..., mirror.normal] = 2 * mirror.offset - arms[..., mirror.normal]
            force += forces.sum(axis=(0, 1))
            moment += np.cross(arms - np.asarray(centre, dtype=float), forces).sum(axis=(0, 1))
        return force, moment

    def rounded(self, format: NumberFormat) -> tuple[IgaSolution, int]:
        """Return the field with its coefficients rounded to a format, and the bytes it takes; knot lines stay."""
        kept = shortened(self.coefficients, format)
        bytes_taken = self.storage_bytes + kept.nbytes - self.coefficients.nbytes
        unchanged = kept.numbers is self.coefficients
        return (self if unchanged else replace(self, coefficients=kept.expanded())), bytes_taken

    def save(self, path: Path) -> Path:
        """Write an npz file without pickles; return its path, which ends in .npz."""
        target = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        words = {
            "mark": MARK,
            "case_name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            "degree": self.degree,
            "symmetry": bool(self.part.mirrors),
            "parameters": self.parameters,
            "history": [asdict(step) for step in self.history],
            "diagnostics": dict(self.diagnostics),
            "uncertainty": dict(self.uncertainty),
            "extrapolated": dict(self.extrapolated),
        }
        np.savez(
            target,
            allow_pickle=False,
            words=np.asarray(json.dumps(words)),
            lines1=np.asarray(self.lines[0]),
            lines2=np.asarray(self.lines[1]),
            coefficients=self.coefficients,
            states=np.asarray(self.states),
            factors=np.asarray(self.factors),
        )
        return target

    @classmethod
    def load(cls, path: Path) -> IgaSolution:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged, or not a solution of this solver.
        """
        try:
            with np.load(path, allow_pickle=False) as data:
                arrays = {name: data[name] for name in data.files}
            words = json.loads(str(arrays.pop("words")))
            if words["mark"] != MARK:
                raise ValueError("of another format")
            return cls._assembled(words, arrays)
        except OSError as error:
            reason = error.strerror or "damaged"
            raise InputError(f"{path}: can't be read as a solution of kratos-iga ({reason})") from None
        except DAMAGE:
            raise InputError(f"{path}: is damaged, or not a solution of kratos-iga") from None

    @classmethod
    def _assembled(cls, words: Mapping[str, Any], arrays: Mapping[str, Array]) -> IgaSolution:
        case = Case.model_validate({**words["case"], "name": words["case_name"]})
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
            tuple(Step(**step) for step in words["history"]),
            words["diagnostics"],
            words["uncertainty"],
            words["extrapolated"],
        )
