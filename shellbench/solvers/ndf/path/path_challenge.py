"""Uncertainty of a path of a field, from challengers at each state of the quantities.

The mechanism is that of linear shells (see `challenge`), on the tangent of a state: its features and challengers of
`ndf-ritz` share one Newton step from the state. The changes of each quantity and of the energy by this step are lower
bounds of the state's error. The path itself stays as it is. At a limit point the states next to it are challenged, and
the curve is drawn again through them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import Step
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.quantities.quantities import (
    CriticalPoint,
    DisplacementQuantity,
    EnergyQuantity,
    LargestDisplacement,
    LimitPoint,
    QuantityModel,
)
from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.field.build import Resolution, graded_points
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.field.quadrature import area_rule
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.linear.constraints import SAME_ROW
from shellbench.solvers.ndf.linear.refinement import (
    TRAINED_SHARE,
    ErrorBounds,
    challenger_spec,
    finer_rule,
    first_level,
    graded_rule,
    joined_features,
    probe,
    quantity_changes,
    scale,
    uncertainties,
    why_unsettled,
)
from shellbench.solvers.ndf.linear.regularised import JITTER, RegularisedInverse
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import Deformed, PathState
from shellbench.solvers.stepping.control import equal_marks

SETTLED_STATE = 2e-2  # of a scale: energies have twice the error of displacements, whose tolerance is at most 1e-2
RULE_GROWTH = (1 + TRAINED_SHARE) ** 0.5  # of panels a side: the same number of points a feature as without challengers
PART = 0.25  # of the gain: error of even a small part of the energy; on 48 drawn shells at most .24
PRESCRIBED = 1e-12  # of a quantity's scale, if nothing is solved for and all is rounding


def with_quadrature_error(solution: PathSolution, rounding: float) -> PathSolution:
    """Return a path that its case prescribes, with the uncertainty of its quantities: only its quadrature has an error.

    `rounding` is the energy, J, of rounding.
    """
    case, gap = solution.case, solution.diagnostics["energy_gap"]
    uncertainty: dict[str, float] = {}
    for q in case.quantities:
        value = {q.name: measure(solution, q)}
        scales = {q.name: scale(solution.state(q.at), q, value[q.name], rounding)}
        missed = ErrorBounds({q.name: rounding if isinstance(q, EnergyQuantity) else 0.0}, 0.0)
        uncertainty |= uncertainties(missed, gap, value, scales, PRESCRIBED)
    return replace(solution, uncertainty=uncertainty)


@dataclass(frozen=True)
class Challenge:
    """A path's problem with challengers added to its features.

    Attributes
    ----------
    problem
        Features: the path's independent ones, then the challengers as drawn.
    features
        Those of both fields, as drawn.
    solved
        (3 M,): numbers of the unknowns; not every component has powers about corners.
    row
        (3 M,) row of the displacement that controls the path, if there is one.
    """

    problem: PathProblem
    features: Features
    solved: Tensor
    row: Tensor | None

    @classmethod
    def of_path(cls, problem: PathProblem, solution: NdfSolution, usual: Resolution, seed: int) -> Challenge:
        """Draw challengers of a path's problem, whose last field is a solution of this resolution."""
        case, spec = solution.case, solution.spec
        level = first_level(case, usual, given_width=True, given_rule=True)
        width = solution.field.features.network.width
        number = max(1, round(TRAINED_SHARE * width / len(level.kinds)))
        # Both fields are integrated with as many points a feature as the path's own: otherwise the rule makes a
        # difference.
        rule = graded_rule(case, finer_rule(usual.rule, RULE_GROWTH))
        level = replace(level, resolution=replace(level.resolution, neurons=0), challengers=number)
        features = joined_features(solution.field, solution.spec, level, seed)
        assert isinstance(problem.features, Combined)
        old = problem.features.combine
        count, new = old.shape[1], features.count - len(old)
        combine = old.new_zeros((len(old) + new, count + new))
        combine[: len(old), :count] = old
        combine[len(old) :, count:].fill_diagonal_(1.0)
        allowed = torch.as_tensor(features.component_mask()[:, len(old) :])
        whole = torch.cat([torch.ones((3, count), dtype=torch.bool), allowed], dim=1)
        focal = graded_points(case, challenger_spec(spec))
        joined = PathProblem(problem.spec, problem.ansatz, Combined(features, combine), rule, focal)
        quantity = next((q for q in case.quantities if q.name == case.path.quantity), None)
        row = joined.functional(quantity) if isinstance(quantity, DisplacementQuantity) else None
        return cls(joined, features, torch.nonzero(whole.reshape(-1))[:, 0], row)

    def start(self, problem: PathProblem, state: PathState) -> tuple[Tensor, Deformed]:
        """Return the weights (3 M,) of a state of the path, and their deformation on the rule of the challenge."""
        output = state.weights.view(3, -1)
        weights = output.new_zeros((3, self.problem.features.count))
        weights[:, : output.shape[1]] = output
        near = [
            known.interpolate(angles, other)
            for known, other, angles in zip(problem.moments, self.problem.moments, state.deformed.angles, strict=True)
        ]
        return weights.reshape(-1), self.problem.deform(weights.reshape(-1), state.t, tuple(near))

    def step(self, weights: Tensor, deformed: Deformed, t: float, held: bool) -> tuple[Tensor, float, Tensor]:
        """Return one Newton step: changes of weights (3 M,) and load factor, and forces (k,) of the point supports.

        The load factor changes if the path's displacement is `held`.
        """
        # 1. Form K at the state, with the load's own stiffness; add the rows of point supports, times a stiffness.
        # 2. Take the regularised inverse, as for linear shells, but by LU, since a state need not be a minimum.
        # 3. Find multipliers that hold the points, for the residual and for the load's rate.
        # 4. Find the change of load that keeps the path's displacement.
        problem, solved = self.problem, self.solved
        matrix = problem.tangent(deformed, t, weights)
        load = problem.load_stiffness(weights, t)
        if load is not None:
            matrix = matrix - load
        rows, stiffness = problem.constraints, problem.ansatz.case.material.membrane_stiffness
        targets = problem.targets(t) - rows @ weights
        matrix = matrix + stiffness * rows.T @ rows
        right = [deformed.residual + stiffness * rows.T @ targets, *([problem.force_rate(weights)] if held else [])]
        inverse = RegularisedInverse.of_indefinite(matrix[solved][:, solved], JITTER)
        response = weights.new_zeros((len(weights), len(right) + len(rows)))
        response[solved] = inverse @ torch.cat([torch.stack(right, dim=1), rows.T], dim=1)[solved]
        free, pulled = response[:, : len(right)], response[:, len(right) :]
        beyond = rows @ free
        beyond[:, 0] -= targets
        multipliers = torch.linalg.pinv(rows @ pulled, rtol=SAME_ROW) @ beyond if len(rows) else beyond
        free = free - pulled @ multipliers
        change, forces, more = free[:, 0], -multipliers[:, 0], 0.0
        if held:
            assert self.row is not None
            more = -float(self.row @ change) / float(self.row @ free[:, 1])
            change, forces = change + more * free[:, 1], forces - more * multipliers[:, 1]
        return change, more, forces[: len(point_supports(problem.ansatz.case, t))]

    def field(
        self, solution: NdfSolution, weights: Tensor, energies: tuple[float, float], forces: Tensor
    ) -> NdfSolution:
        """Return the solution of a state with these weights, energies, J, and forces of point supports."""
        combined = self.problem.features
        assert isinstance(combined, Combined)
        output = weights.view(3, -1) @ combined.combine.T
        field = Field(solution.field.ansatz, self.features, output, output.new_zeros(6))
        rule = area_rule(solution.case.surface.domain, self.problem.focal, self.problem.rule_spec)
        return replace(
            solution,
            field=field.without_rigid_part(rule),
            rule=self.problem.rule_spec,
            membrane=energies[0],
            bending=energies[1],
            point_forces=tuple(forces.tolist()),
        )


@dataclass(frozen=True)
class ChallengedState:
    """A state of the path before and after the step with challengers: fields, and energies on one rule.

    Attributes
    ----------
    solutions
        Solutions of the state, before and after.
    probed
        (n, 3): their displacements at points all over the shell, metres.
    steps
        Of the history.
    gained
        Energy, as a share of the stored energy.
    of_displacements
        Relative error of displacements (see `_share_of_work`).
    """

    solutions: tuple[NdfSolution, NdfSolution]
    probes: tuple[Array, Array]
    steps: tuple[Step, Step]
    gained: float
    of_displacements: float


def challenge_path(
    problem: PathProblem,
    states: Sequence[PathState],
    solution: PathSolution,
    usual: Resolution,
    seed: int,
    solution_of: Callable[[PathState], NdfSolution],
) -> PathSolution:
    """Return a path with the uncertainty of its quantities; `seed` draws the challengers.

    Parameters
    ----------
    problem, states
        The path's problem, and all its states.
    solution
        The path, whose history ends with these states.
    usual
        The resolution of its features.
    solution_of
        Returns the solution of a state.
    """
    # 1. Challenge the states of the quantities, and those about turning points.
    # 2. Compute the change of each quantity from the state, or the curve, without challengers to that with them, on one
    #    rule.
    # 3. State uncertainties as for linear shells, by the change and by the energy gained at the quantity's own states.
    case, offset = solution.case, len(solution.history) - len(states)
    challenge = Challenge.of_path(problem, solution.states[-1], usual, seed)
    gap = solution.diagnostics["energy_gap"]
    known: dict[tuple[int, bool], ChallengedState] = {}
    uncertainty: dict[str, float] = {}
    scales: dict[str, float] = {}
    gains = [0.0]
    for q in case.quantities:
        held = case.path.quantity is not None and not (isinstance(q, LimitPoint) and q.turning == "displacement")
        numbers = _quantity_states(q, solution, offset)
        if not numbers:
            continue  # one linear solve is no estimate of it
        for k in numbers:
            if (k, held) not in known:
                step = solution.history[offset + k]
                known[k, held] = _challenge_state(challenge, problem, states[k], step, solution_of(states[k]), held)
        there = {offset + k: known[k, held] for k in numbers}
        last = there[max(there)]
        histories = [
            tuple(there[k].steps[n] if k in there else step for k, step in enumerate(solution.history)) for n in (0, 1)
        ]
        both = zip(last.solutions, histories, strict=True)
        try:
            values = [{q.name: measure(replace(state, history=history), q)} for state, history in both]
        except ValueError:
            continue  # the turning point has moved: nothing is stated
        changed = quantity_changes(case, values[0], values[1], last.probes)
        scales[q.name] = scale(last.solutions[0], q, values[0][q.name], problem.rounding_energy, last.probes[0])
        gains.append(max(found.gained for found in there.values()))
        moved = isinstance(q, DisplacementQuantity | LargestDisplacement)
        share = max(found.of_displacements for found in there.values()) if moved else gains[-1]
        # The gain is that of the whole energy; a small part has a smaller error, and its own change counts too.
        of = max(abs(values[0][q.name]), PART * scales[q.name]) if isinstance(q, EnergyQuantity) else scales[q.name]
        uncertainty |= uncertainties(ErrorBounds(changed, share), gap, values[0], {q.name: of})
    return replace(
        solution,
        uncertainty=uncertainty,
        unsettled=solution.unsettled or why_unsettled(uncertainty, scales, SETTLED_STATE),
        diagnostics={
            **solution.diagnostics,
            "challenge_gain": max(gains),
            "challengers": challenge.features.count - solution.states[-1].field.features.count,
        },
    )


def _quantity_states(q: QuantityModel, solution: PathSolution, offset: int) -> tuple[int, ...]:
    """Return the numbers of the path's states that determine a quantity; none for a critical state.

    There are none either for the position of an extremum along the curve: it depends on the slope of the changes there,
    not on their size.
    """
    steps, path = solution.history[offset:], solution.case.path
    if isinstance(q, CriticalPoint) or (isinstance(q, LimitPoint) and q.gives != q.turning):
        return ()
    along = [step.at if path.quantity is None else step.quantities[path.quantity] for step in steps]
    if not isinstance(q, LimitPoint):
        mark = solution.marks[-1] if q.at is None else q.at
        there = (k for k, value in enumerate(along) if equal_marks(value, mark))
        return tuple(islice(there, 1))
    values = np.array([0.0, *([step.at for step in steps] if q.turning == "load" else along)])
    turns = np.nonzero(np.diff(np.sign(np.diff(values))))[0]  # state k + 1 of rest and the others is k of these
    middle = int(turns[q.number - 1]) if len(turns) >= q.number else len(steps) - 1
    return tuple(k for k in range(middle - 1, middle + 2) if 0 <= k < len(steps))


def _challenge_state(
    challenge: Challenge, problem: PathProblem, state: PathState, step: Step, solution: NdfSolution, held: bool
) -> ChallengedState:
    """Return a state with the change of its fields and energies by one step with challengers."""
    weights, deformed = challenge.start(problem, state)
    change, more, forces = challenge.step(weights, deformed, state.t, held)
    gained = float(deformed.residual @ change) / 2
    quantities = dict(step.quantities)
    if challenge.row is not None:
        quantities[solution.case.path.quantity or ""] += float(challenge.row @ change)
    steps = (
        replace(step, energy=deformed.potential),
        replace(step, energy=deformed.potential - gained, at=state.t + more, quantities=quantities),
    )
    energies = challenge.problem.predicted_energies(deformed, change, state.t)
    solutions = (
        replace(solution, membrane=deformed.membrane, bending=deformed.bending),
        challenge.field(solution, weights + change, energies, forces),
    )
    share = abs(gained) / (deformed.membrane + deformed.bending + problem.rounding_energy)
    of_work = share if held else _share_of_work(challenge.problem, deformed, change, state.t, abs(gained))
    return ChallengedState(solutions, (probe(solutions[0]), probe(solutions[1])), steps, share, min(share, of_work))


def _share_of_work(problem: PathProblem, deformed: Deformed, change: Tensor, t: float, gained: float) -> float:
    """Return the relative error of the displacement on which dead loads work, from a Newton step (3 M,).

    Let the loads be multiplied by s, and let w be their work at s = 1. In equilibrium the potential energy changes with
    s by the loads' work on the displacement: dPi/ds = -w (Hellmann and Feynman). This also holds for a field whose
    energy is too high by e(s). Therefore its w is too small by de/ds, which to first order is the loads' work on the
    Newton step. In linear shells e grows as s^2: de/ds = 2 e, and with w = 2 U the share is e / U, as there. If loads
    do more work than twice the stored energy, as in a hanging strip, e / U is no share of any displacement.
    """
    # The work on the step may be small by chance; the energy can't: therefore 2 e is the least value.
    if problem.moments or problem.pressure is not None or not deformed.work:
        return math.inf  # their work is not that of dead loads
    return max(2 * gained, abs(float(problem.forces(t)[0] @ change))) / abs(deformed.work)
