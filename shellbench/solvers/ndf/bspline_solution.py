"""The solution of `bspline-ritz`: coefficients of a grid of splines, asked anywhere and kept in one file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import torch

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words
from shellbench.solvers.ndf.build import FieldSpec, build_ansatz, focal_points
from shellbench.solvers.ndf.energy import rigid_part
from shellbench.solvers.ndf.field import Field
from shellbench.solvers.ndf.jets import Array, Placement
from shellbench.solvers.ndf.quadrature import RuleSpec, area_rule, ends_of
from shellbench.solvers.ndf.solution import NdfSolution
from shellbench.solvers.ndf.splines import Line, Splines

SPEC = FieldSpec(slopes="rows")
"""How supports are built in: as in linear answers of `ndf-ritz`."""


def splines_of(case: Case, rule: RuleSpec, degree: int) -> Splines:
    """Return the splines whose cells are the panels of a rule. Where a formula has a kink, ends of cells are double."""
    domain, focal = case.surface.domain, focal_points(case)
    lines = []
    for axis in (0, 1):
        ends = ends_of(domain, focal, rule, axis)
        inner = [at for at in rule.joints[axis] if ends[0] < at < ends[-1]]
        lines.append(Line(np.sort(np.concatenate([ends, inner])), degree, domain.periodic[axis]))
    return Splines((lines[0], lines[1]), Placement())


@dataclass(frozen=True)
class SplineSolution(ShellSolution):
    """A grid of splines; see `shellbench.problem.Solution` for the protocol.

    Attributes
    ----------
    degree, rule
        Of the splines, and the quadrature whose panels are their cells.
    coefficients
        (3, M).
    membrane, bending
        Parts of the strain energy, J.
    point_forces
        (k,) forces of the point supports, N, in the order of `shellbench.solvers.ndf.supports.point_supports`.
    rigid
        (6,): the rigid motion that is taken away, see `shellbench.solvers.ndf.field.Field`.
    """

    formats: ClassVar[tuple[str, ...]] = ("bspline-ritz, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("coefficients", "rigid")

    case: Case
    degree: int
    rule: RuleSpec
    coefficients: Array
    membrane: float
    bending: float
    point_forces: tuple[float, ...] = ()
    rigid: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def parameters(self) -> int:
        """Number of coefficients."""
        return self.coefficients.size

    @cached_property
    def _field(self) -> Field:
        features: Any = splines_of(self.case, self.rule, self.degree)
        output, rigid = torch.from_numpy(self.coefficients), torch.from_numpy(self.rigid)
        return Field(build_ansatz(self.case, SPEC), features, output, rigid)

    @cached_property
    def _answered(self) -> NdfSolution:
        return NdfSolution(
            case=self.case,
            solver="",
            spec=SPEC,
            field=self._field,
            rule=self.rule,
            membrane=self.membrane,
            bending=self.bending,
            parameters=self.parameters,
            point_forces=self.point_forces,
        )

    def without_rigid_motion(self) -> SplineSolution:
        """Return the solution without the rigid motions, left free by the supports, that it has in the mean."""
        rule = area_rule(self.case.surface.domain, focal_points(self.case), self.rule)
        return replace(self, rigid=rigid_part(self._field, rule).numpy())

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self._answered.displacement_at(xi, at)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        return self._answered.field_at(name, xi, at)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        return self.membrane, self.bending

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell."""
        return self._answered.pushed(number, centre, focal_points(self.case))

    def kept(self) -> tuple[Words, Arrays]:
        """Return what `restored` needs of a file."""
        words = {name: getattr(self, name) for name in ("degree", "membrane", "bending", "point_forces")}
        return {**words, "rule": asdict(self.rule)}, {name: getattr(self, name) for name in self.numbers}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> SplineSolution:
        """Make a solution of what `kept` gave; ValueError or KeyError if it does not fit together."""
        said = words["rule"]
        panels, layers, joints = tuple(said["panels"]), tuple(said["layers"]), tuple(map(tuple, said["joints"]))
        rule = RuleSpec(**{**said, "panels": panels, "layers": layers, "joints": joints})
        found = cls(
            case=case,
            degree=int(words["degree"]),
            rule=rule,
            coefficients=np.asarray(arrays["coefficients"], dtype=float),
            membrane=float(words["membrane"]),
            bending=float(words["bending"]),
            point_forces=tuple(map(float, words["point_forces"])),
            rigid=np.asarray(arrays["rigid"], dtype=float),
        )
        if found.coefficients.shape != (3, splines_of(case, rule, found.degree).count) or found.rigid.shape != (6,):
            raise ValueError("its coefficients do not fit its grid")
        return found
