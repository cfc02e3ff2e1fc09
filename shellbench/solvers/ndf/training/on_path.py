"""Training of a field's hidden layers on the case's own energy, at the states of its path.

A step is that of linear theory (see `gauss_newton`), taken about loaded states: the first variation of the strains at a
state stands for the linear strains. After each step, Newton's method solves for the output layer of every state. It
starts from the field that is closest, in the stiffness at rest, to the state on the network before. One network serves
all states: the objective is the sum of their potential energies, each relative to its own magnitude.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.ansatz import Combined
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.jets import COMPONENTS
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import force_density
from shellbench.solvers.ndf.linear.refinement import finer_rule
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.levels import PathLevel
from shellbench.solvers.ndf.path.newton import Deformed, PathState, equilibrium
from shellbench.solvers.ndf.strains.energy import Table, concentrated
from shellbench.solvers.ndf.strains.strain_measures import GRADIENTS
from shellbench.solvers.ndf.training.gauss_newton import (
    Quadratic,
    Sample,
    Tips,
    energy_gradient,
    flatten,
    forward,
    gradient,
    quadratic_model,
    unflatten,
)
from shellbench.solvers.ndf.training.training import AGREEMENT, ATTEMPTS, EASE, HARDEN
from shellbench.solvers.stepping.control import NotConvergedError, equal_marks

PATH_ITERATIONS = 12  # at most, a level; on plates, roofs and cantilevers the last ones gain little
WIDEST = 150  # network that is trained: each step takes the third power of the width, for each of the states
DAMPING = 0.1  # Marquardt's, at the start
MOST_STATES = 3  # of a path that a network is trained on: the last one, and others evenly before it
LEAST_GAIN = 1e-5  # of the mean relative energy of the states, below which training ends
COARSE = 0.75  # of the panels a side, for the Gauss-Newton matrix; its order is less by one or two in turn


def why_not_trained(case: Case, width: int) -> str | None:
    """Return the reason that a network isn't trained on a case's path, as one clause; None if it is."""
    if width > WIDEST:
        return f"the network has more than {WIDEST} neurons in its last hidden layer"
    if case.prescribed:
        return "all of the displacement is prescribed"
    if case.path.control != "load":
        return f"the path is controlled by {case.path.control.replace('_', ' ')}"
    if case.buckles:
        return "the path goes through buckling"
    if case.following:
        return "a pressure follows the shell and has no potential"
    if case.obstacles:
        return "the shell touches obstacles"
    return None


@dataclass(frozen=True)
class Trial:
    """A network with the states of a path, and their certified energies.

    Attributes
    ----------
    problem, states
        The problem in independent combinations of the network's features, and its states of equilibrium.
    certified
        Deformation of each state on the finer rule.
    """

    problem: PathProblem
    states: tuple[PathState, ...]
    certified: tuple[Deformed, ...]

    @classmethod
    def of_states(cls, problem: PathProblem, states: Sequence[PathState], fine: RuleSpec) -> Trial:
        """Certify states on a finer rule."""
        finer = replace(problem, rule_spec=fine)

        def near(state: PathState) -> tuple[Tensor, ...]:
            each = zip(problem.moments, finer.moments, state.deformed.angles, strict=True)
            return tuple(known.interpolate(angles, other) for known, other, angles in each)

        return cls(problem, tuple(states), tuple(finer.deform(s.weights, s.t, near(s)) for s in states))

    @property
    def features(self) -> Features:
        """The network's features, before they are combined."""
        combined = self.problem.features
        assert isinstance(combined, Combined)
        assert isinstance(combined.features, Features)
        return combined.features

    def output(self, state: PathState) -> Tensor:
        """Return the output layer (3, M) of a state on the network's features."""
        combined = self.problem.features
        assert isinstance(combined, Combined)
        return state.weights.view(COMPONENTS, -1) @ combined.combine.T

    def gains(self, new: Trial) -> tuple[float, float]:
        """Return the mean relative fall of energy to a new trial, by the path's rule and by the finer one."""
        pairs = [(a.deformed, b.deformed) for a, b in zip(self.states, new.states, strict=True)]

        def mean(falls: Sequence[tuple[Deformed, Deformed]]) -> float:
            return sum((old.potential - now.potential) / old.magnitude for old, now in falls) / len(falls)

        return mean(pairs), mean(list(zip(self.certified, new.certified, strict=True)))


def trained_level(
    level: PathLevel,
    problem: PathProblem,
    states: Sequence[PathState],
    iterations: int,
    tell: Callable[[int, float], None],
) -> PathLevel | None:
    """Return the level with its hidden layers trained at states of its path; None if no step is certified.

    `tell` is called with the number of each step and the mean relative energy gained so far.
    """
    # An iteration in four:
    # 1. At each state take the tangent strains on the path's rule (gradient) and on a coarser one (matrix).
    # 2. Sum the models of all states, each relative to the magnitude of its energy.
    # 3. Increase the damping until a step is certified: with Newton's method for each state, the energy falls by about
    #    the same amount on both rules.
    # 4. Stop if the gain is small.
    # The model leaves out the geometric stiffness: it is then positive for any state, and only the speed depends on it.
    marks, least = problem.ansatz.case.states, problem.rounding_energy
    wanted = [s for s in states if s.deformed.magnitude > least and any(equal_marks(s.t, mark) for mark in marks)]
    if not wanted:
        return None
    every = -(-len(wanted) // MOST_STATES)
    now = Trial.of_states(problem, wanted[::-1][::every][::-1], level.fine)
    damping, total = DAMPING, 0.0
    for iteration in range(1, iterations + 1):
        local = _energy_model(now, iteration)
        theta, network = flatten(now.features.network), now.features.network
        better, gain = None, 0.0
        for attempt in range(ATTEMPTS):
            if (step := local.step(damping)) is not None:
                better, gain = _try_network(now, unflatten(theta + step, network), level.fine)
            if better is not None:
                damping /= 1.0 if attempt else EASE
                break
            damping *= HARDEN
        if better is None:
            break
        now, total = better, total + gain
        tell(iteration, total)
        if gain < LEAST_GAIN:
            break
    if total == 0.0:
        return None
    return replace(level, features=now.features, trained=now.features.network.parameters)


def _try_network(now: Trial, network: Network, fine: RuleSpec) -> tuple[Trial | None, float]:
    """Return the trial of a network and its certified gain; None if the gain is not certified."""
    old = now.problem
    try:
        problem = replace(old, features=replace(now.features, network=network)).independent()
        states = []
        for state in now.states:
            weights = problem.fit_weights(old, state.weights)
            near = PathState(state.t, weights, problem.deform(weights, state.t, state.deformed.angles))
            states.append(equilibrium(problem, near, state.t))
        new = Trial.of_states(problem, states, fine)
    except (NotConvergedError, SolveFailure):  # the step was too long
        return None, 0.0
    seen, sure = now.gains(new)
    agrees = seen > 0 and sure > 0 and abs(seen - sure) <= AGREEMENT * min(seen, sure)
    return (new if agrees and all(state.stable for state in states) else None), sure


def _energy_model(now: Trial, iteration: int) -> Quadratic:
    """Return the sum of the states' models of the energy in the hidden weights."""
    rule = now.problem.rule_spec
    coarse = finer_rule(replace(rule, order=rule.order - 1 - iteration % 2), COARSE)
    models = []
    for state in now.states:
        output, network = now.output(state), now.features.network
        sample, ansatz = tangent_sample(now, state, rule), replace(now.problem.ansatz_at(state.t), t=state.t)
        forces = concentrated(ansatz, rule, now.problem.focal, now.features.placement)
        tips = Tips.at_forces(now.features, forces)
        slope = energy_gradient(sample, tips, network, output) - _moment_work(now, state)
        local = quadratic_model(sample, tips, tangent_sample(now, state, coarse), network, output, None, slope)
        share = 1 / state.deformed.magnitude
        models.append(Quadratic(share * local.slope, share * local.matrix, share * local.floor))
    return reduce(lambda a, b: Quadratic(a.slope + b.slope, a.matrix + b.matrix, a.floor + b.floor), models)


def tangent_sample(now: Trial, state: PathState, spec: RuleSpec) -> Sample:
    """Return the points of a rule with the strains' first variation at a state.

    As in `strains.energy.Table`, the rows contain the roots of stiffness and area; with the offset, rows times the jet
    of the state are its strains.
    """
    features, output, t = now.features, now.output(state), state.t
    here = replace(now.problem, features=features, rule_spec=spec)
    ansatz, placement, sampled = here.ansatz_at(t), features.placement, here.sampled_at(t)
    strained = sampled.undeformed.strained(here.spec.strain, sampled.gradients(output, here.lift_at(t)))
    root = torch.linalg.cholesky(here.elasticity).mT
    variation = root @ strained.variation.view(-1, 2, 3, GRADIENTS)
    rows = (variation.view(-1, 6, GRADIENTS) @ sampled.through).view(-1, 6, COMPONENTS, 6)
    strains = (root @ strained.strains.view(-1, 2, 3, 1)).view(-1, 6)
    points = area_rule(ansatz.case.surface.domain, here.focal, spec).points
    inputs, fixed = features.inputs.jets(points, placement), features.fixed.jets(points, placement)
    jet = sampled.jets @ output.T
    offset = strains - torch.einsum("nrcp,npc->nr", rows, jet)
    force = placement.tensor(force_density(ansatz.case, points, t)) * here.areas[:, None]
    on_free = (sampled.matrix.mT @ force[..., None])[..., 0]
    return Sample(Table(rows, offset, on_free, 0.0, rows.new_zeros((0, len(rows), COMPONENTS))), inputs, fixed)


def _moment_work(now: Trial, state: PathState) -> Tensor:
    """Return the work (P,) of edge moments on a unit of the hidden weights, by their forces on the features' jets."""
    network, output = now.features.network, now.output(state)
    total = output.new_zeros(network.parameters)
    for moment in now.problem.moments:
        sampled = moment.sampled
        slopes = sampled.gradients(
            state.weights.view(COMPONENTS, -1), sampled.lift_gradients(now.problem.ansatz_at(state.t))
        )
        conjugate = slopes.new_zeros((len(slopes), GRADIENTS))
        conjugate[:, :6] = moment.rows(slopes) * moment.moments(state.t)[:, None]
        pull = (conjugate[:, None] @ sampled.through).view(-1, COMPONENTS, 6)
        _, tape = forward(network, now.features.inputs.jets(sampled.points, now.features.placement))
        total += gradient(network, tape, pull.mT @ output[:, : network.width])
    return total
