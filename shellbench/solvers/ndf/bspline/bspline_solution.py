"""The solution of `bspline-ritz`: coefficients of a grid of splines, evaluated anywhere and kept in one file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words
from shellbench.problems.shell.symmetry.symmetry import Part, part_of, whole_of
from shellbench.solvers.ndf.bspline.splines import Line, Splines
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import build_ansatz, focal_points
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import PLANES, VALUE, Array, Placement, matrix_product
from shellbench.solvers.ndf.field.quadrature import RuleSpec, ends_of
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.linear.solution import NdfSolution

SPEC = FieldSpec(slopes="rows")
"""Construction of the supports: as in linear answers of `ndf-ritz`."""


def solved_part(case: Case, symmetry: bool) -> Part:
    """Return the part of a shell that is solved: with `symmetry`, the smallest that planes of symmetry allow."""
    # Parts support neither springs nor parts of edges, and forces of point supports would have to be divided.
    whole = case.springs or case.edge_parts or case.focus or point_supports(case, SPEC.t)
    return whole_of(case) if whole or not symmetry else part_of(case)


def splines_of(case: Case, rule: RuleSpec, degree: int) -> Splines:
    """Return the splines whose cells are the panels of a rule. At kinks of formulas, ends of cells are double."""
    domain, focal = case.surface.domain, focal_points(case)
    lines = []
    for axis in (0, 1):
        ends = ends_of(domain, focal, rule, axis)
        inner = [at for at in rule.joints[axis] if ends[0] < at < ends[-1]]
        lines.append(Line(np.sort(np.concatenate([ends, inner])), degree, domain.periodic[axis]))
    return Splines((lines[0], lines[1]), Placement())


@dataclass(frozen=True)
class GridField:
    """u = lift + M F on a part of a shell, F a sum of splines, and its mirror images.

    It has the methods of a `shellbench.solvers.ndf.field.field.Field` of the whole shell.

    Attributes
    ----------
    part
        The part that was solved.
    on_part, ansatz
        Supports of the part, and of the whole, as built into the field.
    features
        Splines on the part.
    output
        (3, M): the coefficients.
    """

    part: Part
    on_part: Ansatz
    ansatz: Ansatz
    features: Splines
    output: Array

    def displacement(self, points: Array) -> Tensor:
        """Return the displacement (N, 3), metres, at points (N, 2)."""
        return self._planes(points, self.features.placement.of_values)[VALUE]

    def jet(self, points: Array) -> Tensor:
        """Return the jet (6, N, 3) of the displacement at points (N, 2)."""
        return self._planes(points, self.features.placement)

    def _planes(self, points: Array, placement: Placement) -> Tensor:
        folded = self.part.fold(points)
        numbers, jets = self.features.nonzero_at(folded.points)
        free = np.einsum("pnk,ink->pni", jets[: placement.planes], self.output[:, numbers], optimize=True)
        matrix = self.on_part.factors.matrix(folded.points, placement)
        found = matrix_product(matrix, placement.tensor(free)[..., None])[..., 0]
        if self.on_part.lift.moves:
            found = found + self.on_part.lift.jet(folded.points, placement)[: len(found)]
        # a mirror changes the sign of a component of the displacement, and of each derivative along a coordinate
        turned = np.stack([folded.turned[:, 0] ** i * folded.turned[:, 1] ** j for i, j in PLANES[: len(found)]])
        return found * placement.tensor(folded.signs) * placement.tensor(turned)[..., None]


@dataclass(frozen=True)
class SplineSolution(ShellSolution):
    """A grid of splines; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    symmetry
        Whether a part was solved, if planes of symmetry allow it.
    degree, rule
        Of the splines, and the quadrature whose panels are their cells.
    coefficients
        (3, M).
    membrane, bending
        Parts of the strain energy of the whole shell, J.
    point_forces
        (k,) forces of the point supports, N, in the order of `shellbench.solvers.ndf.field.supports.point_supports`.
    """

    formats: ClassVar[tuple[str, ...]] = ("bspline-ritz, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("coefficients",)

    case: Case
    symmetry: bool
    degree: int
    rule: RuleSpec
    coefficients: Array
    membrane: float
    bending: float
    point_forces: tuple[float, ...] = ()

    @property
    def parameters(self) -> int:
        """Number of coefficients."""
        return self.coefficients.size

    @cached_property
    def _field_solution(self) -> NdfSolution:
        part = solved_part(self.case, self.symmetry)
        features = splines_of(part.case, self.rule, self.degree)
        field: Any = GridField(
            part, build_ansatz(part.case, SPEC), build_ansatz(self.case, SPEC), features, self.coefficients
        )
        return NdfSolution(
            case=self.case,
            solver="",
            spec=SPEC,
            field=field,
            rule=self.rule,
            membrane=self.membrane,
            bending=self.bending,
            parameters=self.parameters,
            point_forces=self.point_forces,
        )

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self._field_solution.displacement_at(xi, at)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        return self._field_solution.field_at(name, xi, at)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self.membrane, self.bending

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        return self._field_solution.support_reaction(number, centre, focal_points(self.case))

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that `restored` needs of a file."""
        words = {name: getattr(self, name) for name in ("symmetry", "degree", "membrane", "bending", "point_forces")}
        return {**words, "rule": asdict(self.rule)}, {name: getattr(self, name) for name in self.numbers}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> SplineSolution:
        """Make a solution from the data of `kept`; ValueError or KeyError if they are inconsistent."""
        said = words["rule"]
        panels, layers, joints = tuple(said["panels"]), tuple(said["layers"]), tuple(map(tuple, said["joints"]))
        found = cls(
            case=case,
            symmetry=bool(words["symmetry"]),
            degree=int(words["degree"]),
            rule=RuleSpec(**{**said, "panels": panels, "layers": layers, "joints": joints}),
            coefficients=np.asarray(arrays["coefficients"], dtype=float),
            membrane=float(words["membrane"]),
            bending=float(words["bending"]),
            point_forces=tuple(map(float, words["point_forces"])),
        )
        part = solved_part(case, found.symmetry)
        if found.coefficients.shape != (3, splines_of(part.case, found.rule, found.degree).count):
            raise ValueError("its coefficients do not fit its grid")
        return found
