"""A level of features for a path, and its states as solutions."""

from __future__ import annotations

from dataclasses import dataclass

from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.field.build import Resolution, build_ansatz
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import Deformed, PathState


@dataclass(frozen=True)
class PathLevel:
    """Features with the two rules of their energy, and the points toward which these are graded.

    `resolution` gives challengers the scales of the features.
    """

    features: Features
    rule: RuleSpec
    fine: RuleSpec
    focal: Array
    resolution: Resolution
    trained: int = 0


def state_solution(problem: PathProblem, level: PathLevel, solver: str, state: PathState) -> NdfSolution:
    """Return the solution of a state of a path, its energies left out."""
    features, combined, case = level.features, problem.features, problem.ansatz.case
    output = state.weights.view(3, -1)
    if isinstance(combined, Combined):
        output = output @ combined.combine.T
    spec = problem.spec.model_copy(update={"t": state.t})
    field = Field(build_ansatz(case, spec), features, output, output.new_zeros(6))
    rule = area_rule(case.surface.domain, level.focal, level.rule)
    supports = point_supports(case, state.t)
    # If all is prescribed there is no basis, and no point is held.
    held = -problem.basis.held.T @ state.deformed.residual if supports else output.new_zeros(0)
    return NdfSolution(
        case=case,
        solver=solver,
        spec=spec,
        field=field.without_rigid_part(rule),
        rule=level.fine,
        membrane=float("nan"),
        bending=float("nan"),
        parameters=0 if case.prescribed else output.numel() + level.trained,
        point_forces=tuple(held[: len(supports)].tolist()),
    )


def disagreement(trained: Deformed, certified: Deformed, rounding: float) -> float:
    """Return the difference of two potential energies, relative to their magnitude or to the energy of rounding, J."""
    return abs(trained.potential - certified.potential) / max(certified.magnitude, rounding)
