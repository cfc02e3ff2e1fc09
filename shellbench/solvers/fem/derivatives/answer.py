"""The finite element answer with derivatives of its quantities."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import (
    DerivativeQuantity,
    DisplacementQuantity,
    EnergyQuantity,
    LimitPoint,
    LoadQuantity,
    ModeQuantity,
    PositionQuantity,
    PotentialEnergy,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
)
from shellbench.problems.shell.quantities.resultant_quantities import COLUMNS, MembraneForce, Moment
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.parameters import Parameter, parameters_of
from shellbench.problems.shell.question.places import Point
from shellbench.solvers.fem.algebra.direct_solve import Solve
from shellbench.solvers.fem.derivatives.adjoint import Adjoint, turning
from shellbench.solvers.fem.derivatives.deviation import Deviation
from shellbench.solvers.fem.derivatives.finite import FiniteAdjoint
from shellbench.solvers.fem.derivatives.modal import mode_gradient
from shellbench.solvers.fem.linear.equilibrium import Equilibrium, LinearShell
from shellbench.solvers.fem.linear.modes import FULL_LOAD
from shellbench.solvers.fem.mechanics.constraints import support_ties
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.basis import CUBIC
from shellbench.solvers.fem.mesh.grading import UNBROKEN, UNGRADED, Cells, graded_mesh
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]

COARSE = (4, 4)  # cells of the mesh on which conditions of supports are looked at


@dataclass(frozen=True)
class FemAnswer(FemSolution):
    """A solution of `fem` that gives derivatives of its quantities with respect to parameters of its case."""

    @classmethod
    def of(cls, solution: FemSolution, assembled: tuple[LinearShell, Solve] | None = None) -> Self:
        """Return a solution as one that gives derivatives; it keeps the assembled shell if that is of the same mesh."""
        found = cls(**{field.name: getattr(solution, field.name) for field in fields(FemSolution)})
        if assembled is not None and assembled[0].mesh is solution.mesh:
            vars(found._adjoint).update(shell=assembled[0], _factor=[assembled[1]])
        return found

    def derivative(self, quantity: QuantityModel, parameter: str) -> float:
        """Return dQ/dp of a quantity of the case, in the units of both; see `gradient`."""
        # all that the case asks of this quantity come from one solve
        if (quantity.name, parameter) not in self._known:
            asked = [q for q in self.case.quantities if isinstance(q, DerivativeQuantity)]
            names = [q.with_respect_to for q in asked if q.derivative_of == quantity.name]
            chosen = list(dict.fromkeys([*names, parameter]))
            for name, value in zip(chosen, self.gradient(quantity, chosen), strict=True):
                self._known[quantity.name, name] = float(value)
        return self._known[quantity.name, parameter]

    def gradient(self, quantity: QuantityModel, parameters: Sequence[str]) -> Array:
        """Return dQ/dp (parameters,) of a quantity with respect to parameters, from one further solve.

        Raises
        ------
        InputError
            If there is no such parameter, or `fem` gives no derivative of this quantity.
        """
        known = parameters_of(self.case)
        if unknown := [name for name in parameters if name not in known]:
            raise InputError(f"{self.case.name} has no parameter '{unknown[0]}'; known are {', '.join(known)}")
        chosen = [known[name] for name in parameters]
        for parameter in chosen:
            if reason := why_no_derivative(self.case, quantity, parameter):
                raise InputError(f"{self.case.name}: {reason}")
        if isinstance(quantity, ModeQuantity):
            return mode_gradient(self, quantity, chosen)
        return self._adjoint.gradient(quantity, chosen)

    def interpolation_error(self, quantity: QuantityModel) -> float:
        """Return the relative error of a limit load by interpolation between states; 0 for other quantities."""
        if not isinstance(quantity, LimitPoint) or not isinstance(self._adjoint, FiniteAdjoint):
            return 0.0
        return abs(quantity.scale * self._adjoint.state_of(quantity).t / quantity.measure(self) - 1)

    @cached_property
    def _known(self) -> dict[tuple[str, str], float]:
        return {}

    @cached_property
    def _adjoint(self) -> Adjoint:
        return Adjoint(self) if self.case.linear else FiniteAdjoint(self)


def with_derivatives(solve: Callable[[Cells], Equilibrium], cells: Cells) -> Equilibrium:
    """Solve on a mesh; return the answer with a solution that gives derivatives."""
    found = solve(cells)
    return replace(found, solution=FemAnswer.of(found.solution, found.assembled), assembled=None)


def why_no_derivative(case: Case, quantity: QuantityModel, parameter: Parameter | None = None) -> str | None:
    """Return the reason that `fem` gives no derivative of a quantity (by a parameter), as one clause, or None."""
    if case.surface.fold_lines:
        return "fem gives no derivatives of shells with folds"
    if case.material.kind == "orthotropic":
        return "fem gives no derivatives of orthotropic shells"
    if case.prescribed:
        return "nothing is solved for where the whole surface is prescribed"
    kinds: tuple[type, ...] = (DisplacementQuantity, PositionQuantity, EnergyQuantity)
    linear = (PotentialEnergy, ReactionQuantity, TorqueQuantity, ModeQuantity, MembraneForce, Moment)
    kinds += linear if case.linear else (LoadQuantity, LimitPoint)
    if not isinstance(quantity, kinds):
        return f"fem gives no derivative of a quantity of kind '{quantity.kind}' in this theory"
    if isinstance(quantity, LimitPoint) and not quantity.gives == quantity.turning == "load":
        return "fem gives derivatives of limit loads alone, not of displacements there"
    if isinstance(quantity, MembraneForce | Moment) and not (
        quantity.component in COLUMNS and all(isinstance(case.places[name], Point) for name in quantity.on)
    ):
        return "fem gives derivatives of components of membrane forces and moments at points alone"
    mesh = graded_mesh(
        case, COARSE, 1.0, UNGRADED, UNBROKEN, CUBIC
    )  # conditions of supports are of the same kind on any
    if isinstance(quantity, ReactionQuantity | TorqueQuantity):
        sharing = support_ties(case, mesh, case.states).sharing
        number = [support.name for support in case.supports].index(quantity.support)
        if np.any(sharing.holders[sharing.meeting, number]):
            return f"support '{quantity.support}' meets another one, and fem gives no derivative of its force"
    return None if parameter is None else _why_not_by(case, quantity, parameter, mesh)


def _why_not_by(case: Case, quantity: QuantityModel, parameter: Parameter, mesh: TensorMesh) -> str | None:
    held = {name for support in case.supports for name in support.on if name in case.points}
    if parameter.bound and (held or case.edge_parts or any(case.kinks)):
        return "named points with supports, parts of edges and kinks do not follow a bound of the surface"
    if parameter.point and parameter.point[0] in held:
        return f"a support holds the point '{parameter.point[0]}'"
    if parameter.group != "surface":
        return None
    if isinstance(quantity, TorqueQuantity):
        return "fem gives no derivative of a torque by a number of the surface"
    if not case.linear and (case.following or any(isinstance(load, MomentLoad) for load in case.loads)):
        return "at finite strain moments and following pressures are not differentiated by a number of the surface"
    try:
        turned = turning(case, mesh, Deviation(case, parameter), FULL_LOAD if case.modal else case.states[-1])
    except InputError as error:  # such as a plane of symmetry that would lean
        return f"with another '{parameter.name}' its supports make no sense: {error}"
    if turned and (case.modal or not case.linear):
        return f"its supports turn with '{parameter.name}', which fem takes into account in linear statics only"
    return None
