"""The finite element answer: a continuous field through its own C1 interpolation."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
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
from shellbench.solvers.fem.assembly import CHUNK, COMPONENTS, Quadrature, derivative_on_cells
from shellbench.solvers.fem.deformation import Deformation
from shellbench.solvers.fem.hermite import FUNCTIONS, Derivative, kind_scales, tabulate
from shellbench.solvers.fem.kinematics import DERIVATIVES, Midsurface, elasticity, strain_operator
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FORMAT = 1  # of the files that `FemSolution.save` writes


@dataclass(frozen=True)
class FemSolution:
    """A displacement field on a tensor mesh, at one or several times or load factors.

    Attributes
    ----------
    case
        The case it answers.
    mesh
        Mesh of the field.
    coefficients
        (nodes, 3, 4, states) u, u,1, u,2 and u,12 of each component at each node.
    states
        Times, or load factors.
    support_nodes, support_forces
        (k,) nodes with supports, and (supports, k, 3, 4, states) the forces there that each of the case's supports
        exerts: the residual of equilibrium, conjugate to `coefficients`.
    quadrature_order
        Of the rule that energies are integrated by.
    parameters
        Degrees of freedom that were solved for.
    images
        Along each coordinate, of how many mirror images of its first cells the field consists (see `symmetry`); 1 where
        the part that was solved does not begin at the first mesh line.
    history, diagnostics, uncertainty, extrapolated
        See `shellbench.problem.Solution`.
    """

    case: Case
    mesh: TensorMesh
    coefficients: Array
    states: tuple[float, ...]
    support_nodes: NDArray[np.int64]
    support_forces: Array
    quadrature_order: int
    parameters: int
    images: tuple[int, int] = (1, 1)
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    @property
    def storage_bytes(self) -> int:
        """Bytes of the coefficients and the mesh lines."""
        return self.coefficients.nbytes + sum(line.nbytes for line in self.mesh.lines)

    def state(self, at: float | None) -> int:
        """Return the number of a time or load factor.

        Raises
        ------
        InputError
            If the case was not solved at it.
        """
        if at is None:
            return len(self.states) - 1
        nearest = int(np.argmin(np.abs(np.asarray(self.states) - at)))
        if abs(self.states[nearest] - at) > 1e-9 * max(1.0, abs(at)):
            known = ", ".join(f"{s:g}" for s in self.states)
            raise InputError(f"{self.case.name}: solved at {known}, not at {at:g}")
        return nearest

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at points (..., 2)."""
        return self.derivative(points, (0, 0), at)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) at points (..., 2): zero, because nothing moves."""
        return np.zeros((*np.asarray(points).shape[:-1], 3))

    def derivative(self, points: ArrayLike, order: Derivative, at: float | None = None) -> Array:
        """Return a partial derivative (..., 3) of the displacement at points (..., 2)."""
        xi = np.asarray(points, dtype=float)
        nodes, unit, sizes = self.mesh.locate(xi.reshape(-1, 2))
        steps = np.prod(sizes ** np.array(order), axis=-1) if any(order) else np.ones(len(sizes))
        basis = tabulate(unit, order) * (kind_scales(sizes) / steps[:, None])[:, None]
        nodal = np.ascontiguousarray(np.swapaxes(self.coefficients[..., self.state(at)], 1, 2))
        local = nodal[nodes].reshape(len(nodes), FUNCTIONS, COMPONENTS)
        return np.asarray((basis.reshape(-1, 1, FUNCTIONS) @ local).reshape(*xi.shape[:-1], COMPONENTS))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2)."""
        if name not in FIELDS:
            raise KeyError(name)
        xi = np.asarray(points, dtype=float)
        points = xi.reshape(-1, 2)
        gradients = np.stack([self.derivative(points, d, at) for d in DERIVATIVES], axis=-1)
        strains, densities, _ = self._strains(points, gradients)
        part = 0 if name.startswith("membrane") else 1
        if name.endswith("strain"):
            return strains[:, part].reshape(*xi.shape[:-1], 3)
        return densities[:, part].reshape(xi.shape[:-1])

    def _strains(self, points: Array, gradients: Array) -> tuple[Array, Array, Array]:
        """Return strains (n, 2, 3), energy densities (n, 2) and areas (n,), membrane before bending.

        `gradients` (n, 3, 5) are the derivatives of the displacement in the order of `DERIVATIVES`.
        """
        surface = Midsurface.at(self.case.surface.derivatives(self.mesh.domain.wrap(points), order=2))
        if self.case.linear:
            values = gradients.shape[1] * gradients.shape[2]
            operator = strain_operator(surface).reshape(len(points), 6, values)
            strains = (operator @ gradients.reshape(len(points), values, 1)).reshape(-1, 2, 3)
        else:
            strains = Deformation.of(surface, np.swapaxes(gradients, 1, 2)).strains.reshape(-1, 2, 3)
        material = self.case.material
        stiffness = np.array([material.membrane_stiffness, material.bending_stiffness])
        stresses = strains @ elasticity(surface, material.poissons_ratio)
        return strains, stiffness / 2 * np.sum(stresses * strains, axis=-1), surface.area

    @cached_property
    def area(self) -> float:
        """Area of the midsurface, m^2."""
        quadrature, total = Quadrature.of_order(self.mesh, self.quadrature_order), 0.0
        for cells in self._cells():
            points, weights = quadrature.on_cells(self.mesh, cells)
            surface = Midsurface.at(self.case.surface.derivatives(points.reshape(-1, 2), order=2))
            total += float(weights.ravel() @ surface.area)
        return total * self.images[0] * self.images[1]

    def _cells(self) -> Iterator[Integers]:
        """Yield the numbers of the cells whose mirror images the others are, in portions."""
        inside = np.ones(len(self.mesh.origins), dtype=bool)
        for axis, (line, images) in enumerate(zip(self.mesh.lines, self.images, strict=True)):
            middles = self.mesh.origins[:, axis] + self.mesh.sizes[:, axis] / 2
            inside &= middles < line[(len(line) - 1) // images]
        numbers = np.flatnonzero(inside)
        for start in range(0, len(numbers), CHUNK):
            yield numbers[start : start + CHUNK]

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        return self._energies[self.state(at)]

    @cached_property
    def _energies(self) -> list[tuple[float, float]]:
        quadrature = Quadrature.of_order(self.mesh, self.quadrature_order)
        total = np.zeros((len(self.states), 2))
        for cells in self._cells():
            points, weights = quadrature.on_cells(self.mesh, cells)
            gradients = np.stack(
                [derivative_on_cells(self.mesh, cells, quadrature, self.coefficients, d) for d in DERIVATIVES], axis=-1
            )
            for state in range(len(self.states)):
                _, densities, area = self._strains(points.reshape(-1, 2), gradients[:, :, state])
                total[state] += (weights.ravel() * area) @ densities
        total *= self.images[0] * self.images[1]
        return [(float(membrane), float(bending)) for membrane, bending in total]

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        Both are the work of the nodal forces on the interpolant of a rigid motion of the support: of the undeformed
        one in linear theory, of the deformed one in the non-linear theory.
        """
        names = [s.name for s in self.case.supports]
        if support not in names:
            raise InputError(f"{self.case.name}: no support is called '{support}'; known are {', '.join(names)}")
        forces = self.support_forces[names.index(support), ..., self.state(at)]
        points = self.mesh.domain.wrap(self.mesh.node_points[self.support_nodes])
        x = self.case.surface.derivatives(points, order=2)
        arms = np.stack([x[0, 0] - np.asarray(centre, dtype=float), x[1, 0], x[0, 1], x[1, 1]], axis=1)
        if not self.case.linear:
            arms = arms + np.swapaxes(self.coefficients[self.support_nodes, ..., self.state(at)], 1, 2)
        moment = np.cross(arms, np.swapaxes(forces, 1, 2)).sum(axis=(0, 1))
        return forces[:, :, 0].sum(axis=0), moment

    def rounded(self, format: NumberFormat) -> tuple[FemSolution, int]:
        """Return the field with its coefficients rounded to a format, and the bytes it takes.

        They are scaled by their largest magnitude before (see `rounding`). The mesh lines, of which there
        are few, stay as they are. Forces of supports are no part of the field and are not rounded.
        """
        short = shortened(self.coefficients, format)
        if short.numbers is self.coefficients:
            return self, self.storage_bytes
        bytes_taken = self.storage_bytes - self.coefficients.nbytes + short.nbytes
        return replace(self, coefficients=short.expanded()), bytes_taken

    def save(self, path: Path) -> Path:
        """Write an npz file without pickles; return its path, which ends in .npz."""
        target = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        words = {
            "format": FORMAT,
            "case_name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            "history": [asdict(step) for step in self.history],
            "diagnostics": dict(self.diagnostics),
            "uncertainty": dict(self.uncertainty),
            "extrapolated": dict(self.extrapolated),
            "quadrature_order": self.quadrature_order,
            "parameters": self.parameters,
            "images": self.images,
        }
        arrays = {
            "lines1": self.mesh.lines[0],
            "lines2": self.mesh.lines[1],
            "coefficients": self.coefficients,
            "states": np.asarray(self.states),
            "support_nodes": self.support_nodes,
            "support_forces": self.support_forces,
        }
        np.savez(target, allow_pickle=False, words=np.asarray(json.dumps(words)), **arrays)
        return target

    @classmethod
    def load(cls, path: Path) -> FemSolution:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged, or not a solution of this solver.
        """
        solution: FemSolution = read_solution(path, {False: cls.assembled})
        return solution

    @classmethod
    def assembled(cls, case: Case, arrays: Mapping[str, Array], words: Mapping[str, Any]) -> FemSolution:
        """Make a solution of what a file holds; ValueError or KeyError if it does not fit together."""
        mesh = TensorMesh(case.surface.domain, (arrays["lines1"], arrays["lines2"]))
        states = tuple(float(s) for s in arrays["states"])
        nodes = np.asarray(arrays["support_nodes"], dtype=np.int64)
        coefficients, forces = arrays["coefficients"], arrays["support_forces"]
        images = words.get("images", (1, 1))
        if coefficients.shape != (mesh.node_count, 3, 4, len(states)):
            raise ValueError("coefficients do not fit the mesh")
        if forces.shape != (len(case.supports), len(nodes), 3, 4, len(states)):
            raise ValueError("forces do not fit the supports")
        return cls(
            case,
            mesh,
            coefficients,
            states,
            nodes,
            forces,
            int(words["quadrature_order"]),
            int(words["parameters"]),
            (int(images[0]), int(images[1])),
            tuple(Step(**step) for step in words["history"]),
            words["diagnostics"],
            words["uncertainty"],
            words["extrapolated"],
        )


Assemble = Callable[[Case, Mapping[str, Array], Mapping[str, Any]], Any]


def read_solution(path: Path, assemble: Mapping[bool, Assemble]) -> Any:
    """Read a file of this solver, and make of it what `assemble` says for one in motion (True) or a static one (False).

    Raises
    ------
    InputError
        If the file is missing, damaged, or not a solution of this solver.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        words = json.loads(str(arrays.pop("words")))
        if words["format"] != FORMAT:
            raise InputError(f"{path}: is of format {words['format']}; this program reads format {FORMAT}")
        case = Case.model_validate({**words["case"], "name": words["case_name"]})
        return assemble[case.dynamics is not None](case, arrays, words)
    except OSError as error:
        raise InputError(f"{path}: can't be read as a solution of fem ({error.strerror or 'damaged'})") from None
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, EOFError, IndexError, zipfile.BadZipFile, zlib.error):
        raise InputError(f"{path}: is damaged, or not a solution of fem") from None
