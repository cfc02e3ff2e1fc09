"""Derivatives of states and limit loads at finite strain, by the adjoint of the tangent.

At a load factor t a state satisfies R(q, t; p) = W'(q) - f(q, t) = 0 on free degrees of freedom. With K = R_q,

    dQ/dp = Q_p - lambda . R_p,    K^T lambda = Q_q.

On a path that a displacement c . q = d marks, the load factor is an unknown, too, and

    K^T lambda + alpha c = Q_q,    lambda . f_t = -Q_t.

With Q = t, lambda is along K^-1 c: at a limit point, where K is singular, it becomes the critical mode x, and dt/dp =
x . R_p / x . f_t. There t has an extremum in d, so that the change of d does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.quantities.quantities import (
    DisplacementQuantity,
    EnergyQuantity,
    LimitPoint,
    LoadQuantity,
    PositionQuantity,
    QuantityModel,
    curve,
)
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.parameters import Parameter
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.derivatives.adjoint import Adjoint, Target
from shellbench.solvers.fem.derivatives.deviation import Deviation
from shellbench.solvers.fem.derivatives.forms import rates, work_of
from shellbench.solvers.fem.mechanics.clamping import finite_clamps
from shellbench.solvers.fem.mechanics.kinematics import DERIVATIVES
from shellbench.solvers.fem.mesh.basis import COMPONENTS, KINDS
from shellbench.solvers.fem.path.continuation import dof_row
from shellbench.solvers.fem.path.finite_state import Constraint, FiniteState, UnsymmetricFactor, solve_on_free
from shellbench.solvers.fem.path.newton import state_on_path
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]

STATE, CHANGE = (0, 0), (1, 0)  # powers of the state and of the virtual displacement in the strains
STEPS = 4  # along the path from the nearest kept state to a limit point


@dataclass(frozen=True)
class FiniteAdjoint(Adjoint):
    """A shell at finite strain, for derivatives of its quantities."""

    @cached_property
    def problem(self) -> FiniteProblem:
        """The equations of equilibrium on the mesh."""
        return FiniteProblem.on_mesh(self.works.case, self.works.mesh, self.works.quadrature)

    @cached_property
    def row(self) -> Array | None:
        """(nodes, 12) c, if a displacement marks the path."""
        case = self.solution.case
        named = next((q for q in case.quantities if q.name == case.path.quantity), None)
        return dof_row(self.problem, named) if isinstance(named, DisplacementQuantity) else None

    def gradient(self, quantity: QuantityModel, parameters: Sequence[Parameter]) -> Array:
        """Return dQ/dp (parameters,).

        Raises
        ------
        InputError
            If this quantity has no derivative here.
        """
        deviations = [Deviation(self.solution.case, p) for p in parameters]
        state = self.state_of(quantity)
        target, by_load = self.finite_target(quantity, state)
        try:
            adjoint = self.finite_opposed(state, target.slope, by_load)
        except NotConvergedError:
            raise InputError("the tangent stiffness is singular there: it has no derivative") from None
        return np.asarray(target.explicit(deviations) - self.residual_work(state, adjoint, deviations))

    @cached_property
    def _states(self) -> dict[str, FiniteState]:
        return {}

    def state_of(self, quantity: QuantityModel) -> FiniteState:
        """Return the state that a quantity belongs to, with its own tangent."""
        if quantity.name not in self._states:
            self._states[quantity.name] = self._found_again(quantity)
        return self._states[quantity.name]

    def _found_again(self, quantity: QuantityModel) -> FiniteState:
        solution, problem = self.solution, self.problem
        if isinstance(quantity, LimitPoint):
            if quantity.gives != "load" or quantity.turning != "load":
                raise InputError("fem gives the derivatives of limit loads alone, not of displacements there")
            factor, at = curve(solution).turning_point("load", quantity.number)
        else:
            at = solution.states[solution.state(quantity.at)]
            factor = at if self.row is None else curve(solution).factor_at(at)
        near = int(np.argmin(np.abs(np.asarray(solution.states) - at)))
        q = self.works.scaled(solution.coefficients[..., near])
        start = problem.state_at(factor, q, problem.undeformed_state())
        try:
            if self.row is not None:
                begin = solution.states[near]
                known = curve(solution).factor_at(begin)
                start = problem.with_own_tangent(replace(start, t=known))
                for value in np.linspace(begin, at, STEPS + 1)[1:] if at != begin else [at]:
                    constraint = Constraint(self.row, 0.0, float(value))
                    start = problem.with_own_tangent(state_on_path(problem, start, constraint, (0 * q, 0.0)))
            return problem.with_own_tangent(start)
        except NotConvergedError:
            raise InputError("its state can't be found again from those that are kept") from None

    def finite_target(self, quantity: QuantityModel, state: FiniteState) -> tuple[Target, float]:
        """Return a quantity as a function of the displacement, and its derivative by the load factor."""
        u, works = self.field(state.q), self.works
        match quantity:
            case DisplacementQuantity() | PositionQuantity():
                return super().target(quantity, u), 0.0
            case LoadQuantity() | LimitPoint():
                return Target(np.zeros_like(state.q), lambda offs: np.zeros(len(offs))), quantity.scale
            case EnergyQuantity():
                parts = {"membrane_energy": (0,), "bending_energy": (1,)}.get(quantity.kind, (0, 1))
                both, density = np.stack([u, u], axis=-1), work_of(STATE, STATE, parts)
                return Target(
                    self._forces(state, parts),
                    lambda offs: rates(offs, works.on_cells(both, offs, density, 1, (STATE, CHANGE))) / 2,
                ), 0.0
        raise InputError(f"fem gives no derivative of a quantity of kind '{quantity.kind}' at finite strain")

    def _forces(self, state: FiniteState, parts: Sequence[int]) -> Array:
        """Return the nodal forces (nodes, 12) of membrane (0) or bending (1) stresses."""
        energy, forces = self.problem.energy, np.zeros_like(state.q)
        for portion, deformation, stress in zip(
            energy.portions, state.strained.deformations, state.strained.stresses, strict=True
        ):
            kept = np.array(stress)
            for part in {0, 1} - set(parts):
                kept[:, 3 * part : 3 * part + 3] = 0
            energy.add_forces(forces, portion, deformation.first_variation(kept))
        return forces

    def finite_opposed(self, state: FiniteState, slope: Array, by_load: float) -> Array:
        """Return lambda (nodes, 12)."""
        ties, factor = self.problem.ties(state.t), state.factor
        if factor is None:
            raise NotConvergedError
        if isinstance(factor, UnsymmetricFactor):
            factor = replace(factor, skew=BlockMatrix(-factor.skew.blocks, factor.skew.columns))
        found = solve_on_free(ties, factor, slope)
        if self.row is None:
            return found
        along, rate = solve_on_free(ties, factor, self.row), self.problem.force_rate(state.q)
        return np.asarray(found - along * (np.sum(rate * found) + by_load) / np.sum(rate * along))

    def residual_work(self, state: FiniteState, adjoint: Array, deviations: Sequence[Deviation]) -> Array:
        """Return lambda . R_p (deviations,)."""
        works, problem, t = self.works, self.problem, state.t
        both = np.stack([self.field(state.q), self.field(adjoint)], axis=-1)
        found = rates(deviations, works.on_cells(both, deviations, work_of(STATE, CHANGE), 1, (STATE, CHANGE)))
        for number, off in enumerate(deviations):
            if off.moves_surface and (problem.clamps or problem.moments or problem.pressure or self.turns(off, t)):
                raise InputError(
                    f"fem gives no derivative by '{off.parameter.name}' at finite strain with moments, following"
                    " pressures, or clamps and supports that turn"
                )
            if off.part is not None:
                part = FiniteProblem.on_mesh(off.part, works.mesh, works.quadrature)
                found[number] -= np.sum(part.applied_forces(state.q, t) * adjoint)
                continue
            found[number] += self._clamp_work(state, adjoint, off)
            dead = [load for load in self.solution.case.dead if not isinstance(load, MomentLoad)]
            found[number] -= works.load_work(both[..., 1], off, t, dead)
        return found

    def _clamp_work(self, state: FiniteState, adjoint: Array, off: Deviation) -> float:
        """Return the derivative of the work of the terms of clamps between nodes, by a number of the material."""
        if not self.problem.clamps or off.parameter.group != "material":
            return 0.0
        total = 0j
        for own, clamp in zip(self.problem.clamps, finite_clamps(off.moved, self.works.mesh), strict=True):
            moved = clamp.deform_edge(state.q, state.t)
            local = adjoint.reshape(-1, COMPONENTS, len(KINDS))[own.nodes]
            local = np.swapaxes(local, 1, 2).reshape(len(own.nodes), 1, -1, 1)
            change = (own.rows @ local).reshape(-1, len(DERIVATIVES) * COMPONENTS)
            tilt, rate = np.sum(moved.tilt * change, axis=-1), np.sum(moved.moment_rate * change, axis=-1)
            total += complex(own.weights @ ((moved.moment + clamp.spring * moved.gap) * tilt + moved.gap * rate))
        return off.rate(total)
