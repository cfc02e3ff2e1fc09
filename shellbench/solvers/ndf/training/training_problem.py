"""The problem of training: a field for a case, and the points at which its energy is taken."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs, focal_points, graded_points
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.field.network import Network, random_features
from shellbench.solvers.ndf.field.quadrature import RuleSpec
from shellbench.solvers.ndf.linear.solve import solve_part
from shellbench.solvers.ndf.strains.energy import concentrated
from shellbench.solvers.ndf.training.gauss_newton import Energy, Sample, Tips, energy_on, normal_equations_on

# Points a feature of the last hidden layer; more if the field is singular. With these, energies of converged fields on
# independent points agree to 1e-6 and less.
TRAINING_POINTS, SINGULAR_POINTS, MIRRORED_POINTS = 8.0, 18.0, 20.0
MOST_TRAINING_POINTS = 7200  # at first: with 400, 500 and 600 features about point forces gaps are 2e-6 alike
LEAST_POINTS = 550  # 4 x 4 panels: below, even the inputs are not resolved
CHECK = 2.0  # check points, as a multiple of the training points
TRAINING_ORDER, COARSE_ORDER, FINAL_ORDER = 6, 4, 7  # Gauss points along a panel
GRADING = 3.0  # of panels toward point forces, which have no cuts here; neighbours are not on record


@dataclass(frozen=True)
class Trained:
    """Weights, and their energy on the training and on the check points.

    Attributes
    ----------
    output
        (3, M) output layer, solved for on the training points.
    reactions
        (k,) forces of the point supports, N.
    evaluations
        Of the network's jets at one point since training began, a sweep back counted as one.
    """

    network: Network
    output: Tensor
    reactions: Tensor
    train: Energy
    check: Energy
    evaluations: int = 0

    @property
    def gap(self) -> float:
        """Disagreement of the two energies, relative to their magnitude."""
        return abs(self.train.gain - self.check.gain) / max(abs(2 * self.check.potential), np.finfo(float).tiny)


@dataclass(frozen=True)
class TrainingProblem:
    """A case as training uses it.

    Attributes
    ----------
    like
        A rule whose grading all rules have; None for the usual one.
    tally
        Counts a cost that is the same on any machine: "output layers" solved for.
    """

    ansatz: Ansatz
    features: Features
    spec: FieldSpec
    focal: Array
    like: RuleSpec | None = None
    tally: Counter[str] = field(default_factory=Counter)

    @classmethod
    def from_case(
        cls, case: Case, spec: FieldSpec, placement: Placement, like: RuleSpec | None = None
    ) -> TrainingProblem:
        """Prepare a case."""
        ansatz, inputs = build_ansatz(case, spec), build_inputs(case, spec)
        ones = placement.tensor(np.ones(inputs.count))
        features = build_features(case, spec, random_features(ones, 1, 0, spec.activation), placement, inputs)
        focal = focal_points(case) if like is None else graded_points(case, spec)
        return cls(ansatz, features, spec, focal, like)

    @property
    def singular(self) -> bool:
        """True if forces act at points."""
        return len(focal_points(self.ansatz.case)) > 0

    def with_network(self, network: Network) -> Features:
        """Return the features of a network."""
        old = self.features
        return Features(old.inputs, network, old.fixed, old.placement)

    def rule_spec(self, count: float, order: int, more: int = 0) -> RuleSpec:
        """Return a rule with about `count` points where energies are integrated, and `more` panels along each side."""
        if self.like is not None:
            points = len(self.ansatz.rule(self.focal, self.like).points)
            growth = math.sqrt(count / points) * self.like.order / order
            first, second = (max(2, round(growth * panels)) + more for panels in self.like.panels)
            return replace(self.like, panels=(first, second), order=order)
        count *= self.ansatz.mirrors.parts if self.ansatz.mirrors else 1  # rules are those of the whole shell
        turns = [2.0 if p else 1.0 for p in self.ansatz.case.surface.domain.periodic]
        side = math.sqrt(count / (turns[0] * turns[1])) / order
        first, second = (max(2, round(side * turn)) + more for turn in turns)
        return RuleSpec((first, second), order, GRADING if self.singular else 1.0, joints=self.ansatz.case.kinks)

    def sample(self, spec: RuleSpec) -> Sample:
        """Tabulate a rule."""
        return Sample.from_rule(self.ansatz, self.features, self.ansatz.rule(self.focal, spec))

    def tips(self, spec: RuleSpec) -> Tips:
        """Tabulate edge and point loads."""
        placement = self.features.placement
        return Tips.at_forces(self.features, concentrated(self.ansatz, spec, self.focal, placement))


@dataclass(frozen=True)
class Quadratures:
    """Training and check points, and the number of their refinements."""

    spec: RuleSpec
    train: Sample
    check: Sample
    tips: Tips
    refinement: float

    @classmethod
    def for_width(cls, problem: TrainingProblem, width: int, refinement: float = 1.0) -> Quadratures:
        """Take the points for a width."""
        each = SINGULAR_POINTS if problem.singular else TRAINING_POINTS
        if problem.ansatz.mirrors:
            each = MIRRORED_POINTS
        count = refinement * min(max(LEAST_POINTS, each * width), MOST_TRAINING_POINTS)
        spec, check = problem.rule_spec(count, TRAINING_ORDER), problem.rule_spec(CHECK * count, TRAINING_ORDER, more=1)
        return cls(spec, problem.sample(spec), problem.sample(check), problem.tips(check), refinement)

    @classmethod
    def from_rules(cls, problem: TrainingProblem, train: RuleSpec, check: RuleSpec) -> Quadratures:
        """Take the points of two rules."""
        return cls(train, problem.sample(train), problem.sample(check), problem.tips(check), 1.0)

    def evaluate(self, problem: TrainingProblem, network: Network) -> Trained:
        """Solve for the output layer on the training points and measure both energies."""
        return self.check_state(self.solve_output(problem, network))

    def solve_output(self, problem: TrainingProblem, network: Network) -> Trained:
        """Solve for the output layer on the training points; their energy also stands for that of the check points."""
        problem.tally["output layers"] += 1
        kept: list[Tensor] = []
        equations = normal_equations_on(self.train, self.tips, network, kept)
        features = problem.with_network(network)
        layer = solve_part(problem.ansatz, features, equations, np.arange(features.count))
        output = layer.weights.view(3, -1)
        energy = energy_on(self.train, self.tips, network, output, kept)
        return Trained(network, output, layer.reactions, energy, energy, len(self.train))

    def check_state(self, state: Trained) -> Trained:
        """Measure the energy on the check points too."""
        check = energy_on(self.check, self.tips, state.network, state.output)
        return replace(state, check=check, evaluations=state.evaluations + len(self.check))
