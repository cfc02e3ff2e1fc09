"""Contact of a Ritz field at finite strain: contact forces within each step of Newton's method.

A step minimises the quadratic model of the potential energy among changes of the output weights that leave no gap
negative, with gaps linearised at the present displacement. Forces at points are the multipliers; they, their smoothest
representatives and edges of contact are found as in linear theory (see `contact`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch, gaps
from shellbench.solvers.ndf.field.build import Resolution
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import VALUE, Array
from shellbench.solvers.ndf.linear.contact import Touching, draw_field
from shellbench.solvers.ndf.linear.contact_forces import (
    SLIGHT,
    Flags,
    contact_points,
    crease_mask,
    least_forces,
    smoothest_forces,
    typical_compliance,
)
from shellbench.solvers.ndf.linear.ritz_settings import NDF_RITZ, RitzSettings
from shellbench.solvers.ndf.linear.signs import Signs
from shellbench.solvers.ndf.linear.solution import PathSolution
from shellbench.solvers.ndf.path.continuation import load_steps
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.levels import PathLevel, disagreement, state_solution
from shellbench.solvers.ndf.path.newton import MOST_ITERATIONS, PathState, has_converged
from shellbench.solvers.stepping.control import NotConvergedError, PathEndsError

DIFFERENCE = 1e-6  # of the shell's size: step of differences of normals; truncation and rounding are both below 1e-9
SHUT = 1e-6  # of the largest displacement: gap of a point that the step before left in contact
PASSES = 2  # of smoothing forces: with one of them their resultant is short by 1e-4
STIFF = 100.0  # penalty of a point in contact, in the points' mean stiffness at rest; it has no effect at closed gaps


@dataclass(frozen=True)
class ContactRows:
    """Points at which gaps of a path's problem are evaluated.

    Attributes
    ----------
    line
        (n,) mask of the points on an edge of contact.
    """

    problem: PathProblem
    touch: Touch
    line: Flags

    @cached_property
    def values(self) -> Tensor:
        """(n, 3, 3 M): the displacement of the free field of output weights."""
        points, features = self.touch.points, self.problem.features
        matrix = self.problem.ansatz.factors.matrix(points, features.placement)[VALUE]
        return (matrix[..., None] * features.values(points)[:, None, None, :]).flatten(2)

    @cached_property
    def reduced(self) -> Tensor:
        """(n, 3, r): the same of the unknowns."""
        return self.values @ self.problem.basis.combine

    def displacement(self, weights: Tensor, t: float) -> Array:
        """Return the displacement (n, 3) of output weights (3 M,), m."""
        lift = self.problem.ansatz_at(t).lift.jet(self.touch.points, self.problem.features.placement)[VALUE]
        return np.asarray((self.values @ weights + lift).cpu().numpy())

    def curvature(self, forces: Array, u: Array, t: float) -> Tensor:
        """Return the part of the reduced tangent (r, r) from forces (n,), N, as the obstacles' normals turn."""
        # -x dn/dx. The force on a point that slides on a ball turns; without this term, Newton's method is slow there.
        on = np.flatnonzero(forces)
        case, points, rows = self.problem.ansatz.case, self.touch.points[on], self.reduced[on]
        step = DIFFERENCE * float(np.ptp(case.surface.position(self.touch.points), axis=0).max())
        turned = [
            (gaps(case, points, u[on] + e, t)[1] - gaps(case, points, u[on] - e, t)[1]) / (2 * step)
            for e in step * np.eye(3)
        ]
        form = rows.new_tensor(np.stack(turned, axis=-1) * forces[on, None, None])
        added: Tensor = -rows.flatten(0, 1).T @ (form @ rows).flatten(0, 1)
        return (added + added.T) / 2


def contact_state(points: ContactRows, start: PathState, t: float) -> tuple[PathState, Touch]:
    """Return the state at a load factor that enters no obstacle, from another one, and the contact forces.

    Raises
    ------
    NotConvergedError
        If Newton's method does not converge, or passes a state that is no minimum among those in contact.
    SolveFailure
        If rounding hides the forces.
    """
    # 1. Compute rows G of the gaps' rates, the tangent K with predicted stresses (see `newton`), and the residual r of
    #    the loads, each in the basis of independent fields.
    # 2. Add a penalty on the gaps of points that were pressed in the step before. It makes K definite if only contact
    #    holds the shell: a strip that is pushed along a floor would buckle under dead forces. If the gaps stay closed,
    #    the penalty has no effect.
    # 3. Solve dy = K^-1 (r + G^T x), with x >= 0 such that g + G dy >= 0, one of both zero: the dual problem with the
    #    compliance G K^-1 G^T. The x are total forces, not increments.
    # 4. Stop when the energy dy K dy of the step is at rounding; then take the smoothest forces.
    problem, placement = points.problem, points.problem.features.placement
    case, basis = problem.ansatz.case, problem.basis
    weights, deformed, geometric = start.weights, start.deformed, start.deformed.stresses
    moved = basis.held @ (problem.targets(t) - problem.constraints @ weights)
    if bool(moved.any()):
        geometric = problem.predicted_stresses(deformed, moved)
        weights = weights + moved
    deformed = problem.deform(weights, t, start.deformed.angles)
    forces, first = np.zeros(len(points.touch.points)), 0.0
    for iteration in range(1, MOST_ITERATIONS + 1):
        u = points.displacement(weights, t)
        gap, normal = gaps(case, points.touch.points, u, t)
        rows = (placement.tensor(normal)[:, None] @ points.reduced)[:, 0]
        pressed = forces > 0 if iteration > 1 else gap <= SHUT * np.abs(u).max()
        stiff = STIFF / float((rows * rows).sum(dim=1).mean())
        closed = rows[torch.as_tensor(pressed)]
        matrix = basis.combine.T @ problem.tangent(deformed, t, weights, geometric) @ basis.combine
        matrix = (matrix + matrix.T) / 2 + points.curvature(forces, u, t) + stiff * closed.T @ closed
        right = basis.combine.T @ deformed.residual - stiff * closed.T @ placement.tensor(gap[pressed])
        factor, failed = torch.linalg.cholesky_ex(matrix)
        if int(failed) or not bool(torch.isfinite(matrix).all()):
            break
        half = torch.linalg.solve_triangular(factor, torch.cat([right[:, None], rows.T], dim=1), upper=False)
        free, response = half[:, 0], half[:, 1:]
        compliance = (response.T @ response).cpu().numpy()
        offset = gap + (response.T @ free).cpu().numpy()
        unit = typical_compliance(compliance, points.touch)
        forces = least_forces(compliance, offset, SLIGHT * unit)
        step = free + response @ placement.tensor(forces)
        decrement = float(step @ step)
        change = basis.combine @ torch.linalg.solve_triangular(factor.T, step[:, None], upper=True)[:, 0]
        geometric = problem.predicted_stresses(deformed, change, t)
        weights = weights + change
        deformed = problem.deform(weights, t, deformed.angles)
        first = first or decrement
        if has_converged(problem, deformed, decrement, first):
            largest = float(np.abs(points.displacement(weights, t)).max())
            smooth = smoothest_forces(compliance, offset, forces, unit, points.line, largest, PASSES)[:, None] * normal
            residual = deformed.residual + (placement.tensor(smooth)[:, None] @ points.values).sum(dim=(0, 1))
            state = PathState(t, weights, replace(deformed, residual=residual), iteration)
            return state, replace(points.touch, forces=smooth)
    raise NotConvergedError


def answer(
    case: Case, spec: FieldSpec, settings: RitzSettings, resolution: Resolution, seed: int, finer: float
) -> Touching:
    """Return the path of a case on a resolution, from rest; see `shellbench.solvers.ndf.linear.contact.ContactSolve`.

    Raises
    ------
    SolveFailure
        If the path ends early.
    """
    # 1. Draw features, and choose the points of contact.
    # 2. Follow load steps with contact from rest.
    # 3. Certify the energy of each kept state on the finer rule.
    ansatz, features, (rule, fine), focal = draw_field(case, spec, settings, resolution, seed)
    level = PathLevel(features, rule, fine, focal, resolution)
    problem = PathProblem(spec, ansatz, features, rule, focal).independent()
    touch = contact_points(case, spec.creases, finer, ends=True)
    points = ContactRows(problem, touch, crease_mask(case, touch, spec.creases))
    touches: dict[float, Touch] = {}

    def find(_: PathProblem, start: PathState, t: float) -> PathState:
        state, touches[t] = contact_state(points, start, t)
        return state

    states: list[PathState] = []
    try:
        states.extend(load_steps(problem, case.states, find))
    except PathEndsError as error:
        raise SolveFailure(f"{error}") from None
    judge, kept, gap = replace(problem, rule_spec=fine), [], 0.0
    for state in (state for state in states if state.t in case.states):
        certified = judge.deform(state.weights, state.t)
        gap = max(gap, disagreement(state.deformed, certified, problem.rounding_energy))
        solution = state_solution(problem, level, NDF_RITZ, state)
        membrane, bending = certified.membrane, certified.bending
        kept.append(replace(solution, membrane=membrane, bending=bending, touching=touches[state.t]))
    path = PathSolution(
        marks=case.states,
        states=tuple(kept),
        diagnostics={
            "energy_gap": gap,
            "certified_energy": certified.potential,
            "neurons": resolution.neurons,
            "newton_iterations": sum(state.iterations for state in states),
            "contact_points": len(touch.points),
            "pressed_points": int(np.count_nonzero(np.any(touches[states[-1].t].forces != 0, axis=1))),
        },
    )
    return Touching(path, certified.potential, Signs(gap, taken_up=1.0, unseen_turning=0.0, jitter_share=0.0))
