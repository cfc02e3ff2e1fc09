"""The recipe `ndf`: a deep coordinate network with all weights trained.

Three hidden layers by default. Every step solves for the output layer exactly (variable projection). The hidden weights
follow by Gauss-Newton with Marquardt's damping. A step counts only if independent points certify its gain; see
`training`. First-order training of the same energy takes thousands of iterations, because membrane and bending
stiffness differ by (L/h)^2; here a few are enough. `challenge` estimates the uncertainty.

At finite strain, the output layer of a deep network follows the path of a case.

The hidden layers are trained on the linearised problem at full load, which is cheap, and then kept. On plates and roofs
the training gains nothing at finite strain, where the last hidden layer's width is decisive.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.solution import checked_start
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import (
    build_features,
    build_inputs,
    first_path_level,
    focal_points,
    graded_points,
    is_flat,
    path_level_count,
    path_resolution,
)
from shellbench.solvers.ndf.field.choices import FieldSpec, StrainName
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import VALUE, Placement, smooth_activation
from shellbench.solvers.ndf.field.network import Network, deep_random_features
from shellbench.solvers.ndf.field.quadrature import area_rule
from shellbench.solvers.ndf.field.supports import check_balance, point_supports
from shellbench.solvers.ndf.linear.answer import displacement_values
from shellbench.solvers.ndf.linear.challenge import stated
from shellbench.solvers.ndf.linear.constraints import point_constraints
from shellbench.solvers.ndf.linear.ritz_field import is_path, strain_of
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.motion import motion
from shellbench.solvers.ndf.motion.motion_solution import MotionSolution, load_solution
from shellbench.solvers.ndf.path import large_displacement, modes
from shellbench.solvers.ndf.path.edited import start_of_path
from shellbench.solvers.ndf.path.levels import PathLevel
from shellbench.solvers.ndf.strains.energy import certify, concentrated, energy_gap, exploits
from shellbench.solvers.ndf.strains.smooth import scales
from shellbench.solvers.ndf.training.trainer_settings import NDF, TrainerSettings
from shellbench.solvers.ndf.training.training import (
    CERTIFICATE,
    MIRRORED_SCALES,
    MIXED_SCALES,
    SINGULAR_SCALES,
    Plan,
    default_plan_widths,
    first_state,
    train,
    trusted,
)
from shellbench.solvers.ndf.training.training_problem import FINAL_ORDER, Quadratures, Trained, TrainingProblem

SERVES = 10.0  # largest certified gain by challengers, in tolerances of training, with which a start's layers serve
ITERATIONS, MIXED_ITERATIONS = 3, 2  # by certified energy at equal time: a mixed start leaves less to training
WIDEST_TRAINED = 300  # a Gauss-Newton step costs the third power of the width

Constraints = Callable[[Ansatz, Features], tuple[Tensor, Tensor]]


def follow(
    case: Case,
    spec: FieldSpec,
    plan: Plan,
    placement: Placement,
    constraints: Constraints,
    largest_gap: float,
    solver: str,
    progress: ProgressCallback,
    begin: Solution | None = None,
) -> PathSolution:
    """Follow the path of a case with deep networks of ever larger width, `plan.widths` if there are any.

    With `begin`, an earlier path, it starts from that path's states, on its hidden layers.

    Raises
    ------
    SolveFailure
        If the path ends early for the widest, or its field exploits the quadrature.
    """
    # 1. For each width, draw a deep network and train its hidden layers on the linear problem at full load, if
    #    possible.
    # 2. Follow the path with these layers kept, level by level (`large_displacement.solve`).
    # 3. With `begin`, take the hidden layers of the earlier path, and start from its states.
    full = case.path.until if case.path.control == "load" else 1.0
    linear = case.model_copy(update={"theory": "kirchhoff-love-linear"})
    problem = TrainingProblem.from_case(
        linear, spec.model_copy(update={"strain": "linear", "t": full}), placement, constraints
    )

    def build(number: int, width: int, kept: Network | None = None) -> PathLevel:
        chosen = path_resolution(case, number)
        if kept is not None:
            trained = kept.parameters if may_be_trained(case, width) else 0
            features = problem.with_network(kept)
            return PathLevel(features, chosen.rule, chosen.fine, graded_points(case, spec), chosen, trained)
        points = Quadratures.for_width(problem, width)
        scales = placement.tensor(chosen.scales(problem.features.inputs))
        values = points.train.inputs[VALUE]
        drawn = deep_random_features(values, scales, (*plan.inner, width), plan.seed, plan.activation)
        network = _trained(problem, plan, drawn, points) if may_be_trained(case, width) else drawn
        trained = 0 if network is drawn else network.parameters
        return PathLevel(
            problem.with_network(network), chosen.rule, chosen.fine, graded_points(case, spec), chosen, trained
        )

    count = path_level_count(case)
    widths = plan.widths or tuple(
        path_resolution(case, number).neurons for number in range(first_path_level(case), count)
    )
    numbers = [max(0, count - len(widths) + k) for k in range(len(widths))]
    builds = [partial(build, number, width) for number, width in zip(numbers, widths, strict=True)]
    path = None
    if begin is not None:
        path, first = start_of_path(begin, case, solver, widths)
        kept = path.states[-1].field.features.network
        builds = [partial(build, numbers[first], widths[first], kept), *builds[first + 1 :]]
    # Along paths, challengers of trained layers would give uncertainties close to some tolerances, so that chance would
    # decide.
    solution = large_displacement.solve(case, spec, solver, builds, largest_gap, None, progress, path)
    trained = solution.parameters > solution.states[-1].field.output.numel()
    hidden = "trained in linear theory" if trained else "as drawn"
    return replace(solution, diagnostics={**solution.diagnostics, "hidden_layers": hidden})


def may_be_trained(case: Case, width: int) -> bool:
    """Return True if hidden layers can be trained: they must not be wide, and not all prescribed or under edge moments.

    Paths through buckling are excluded too: training by linear theory gives states without waves.
    """
    prescribed = case.prescribed
    moments = any(isinstance(load, MomentLoad) for load in case.loads)
    buckles = case.path.after_buckling == "follow"
    return width <= WIDEST_TRAINED and not prescribed and not moments and not buckles


def _trained(problem: TrainingProblem, plan: Plan, network: Network, points: Quadratures) -> Network:
    """Return a better network, or the same one if no step is certified."""
    try:
        state, points = trusted(problem, plan, points.evaluate(problem, network), points)
        state, _ = train(problem, plan, state, points, lambda iteration, state: None)
    except SolveFailure:  # the drawn layers are as good
        return network
    return state.network


FITTED = 40  # points a side to which the last hidden layer of a motion is fitted


def solve(
    case: Case, settings: TrainerSettings, start: Solution | Path | None, tell: ProgressCallback
) -> NdfSolution | PathSolution | MotionSolution:
    """Train a field; see `shellbench.solvers.ndf.trainer_solver.NdfSolver`."""
    strain = strain_of(case, settings.strain)
    begin = load_solution(start, NDF) if isinstance(start, Path) else start
    if begin is not None:
        checked_start(begin, case, NDF, NdfSolution, PathSolution)
    with torch.no_grad():
        if case.dynamics is not None:
            smooth_activation(settings.activation)
            return _move(case, settings, strain, tell)
        if case.modal:
            chosen = RitzSettings(
                seed=settings.seed,
                device=settings.device,
                activation=settings.activation,
                neurons=settings.widths[-1] if settings.widths else None,
                largest_gap=settings.largest_gap,
            )
            recipe = modes.Recipe(NDF, settings.inner)
            return modes.solve(case, field_spec(settings, strain), chosen, tell, recipe)
        if not is_path(case):
            return _Run(case, settings, begin, tell).solve(begin)
        smooth_activation(settings.activation)
        return follow(
            case,
            field_spec(settings, strain),
            training_plan(settings, settings.widths or (), ()),
            Placement.on(settings.device),
            point_constraints,
            settings.largest_gap,
            NDF,
            tell,
            begin,
        )


def field_spec(settings: TrainerSettings, strain: StrainName) -> FieldSpec:
    """Return the choices of the field."""
    return FieldSpec(
        activation=settings.activation,
        periodic_input=settings.periodic_input,
        components=settings.components,
        stretched=settings.stretched,
        layer=settings.layer,
        multipliers=settings.singular,
        strain=strain,
    )


def mirrored(case: Case, settings: TrainerSettings, start: Solution | None) -> bool:
    """Return True if planes of symmetry are built in: as in a start, or by settings, or if it is of advantage."""
    # Given widths serve for comparisons of fields with each other, and with those of other recipes.
    if isinstance(start, NdfSolution):
        return start.spec.mirrors
    if settings.mirrors is not None:
        return settings.mirrors
    return len(focal_points(case)) > 0 and not is_flat(case) and settings.widths is None


def _move(case: Case, settings: TrainerSettings, strain: StrainName, tell: ProgressCallback) -> MotionSolution:
    """Follow a motion with deep networks of ever larger width, whose hidden layers stay as drawn."""
    spec = field_spec(settings, strain).model_copy(update={"stretched": False, "multipliers": 0})
    placement, inputs = Placement.on(settings.device), build_inputs(case, spec)
    values = inputs.jets(case.surface.domain.grid(FITTED, FITTED).reshape(-1, 2), placement)[VALUE]

    def build(degree: int, width: int) -> motion.MotionLevel:
        spread = placement.tensor(scales(case, inputs, degree))
        layers = (*settings.inner, width)
        network = deep_random_features(values, spread, layers, settings.seed, settings.activation)
        return motion.MotionLevel(degree, build_features(case, spec, network, placement, inputs))

    levels = motion.motion_levels(case, settings.widths)
    builds = [partial(build, degree, width) for degree, width in levels]
    solution = motion.solve(case, spec, NDF, builds, settings.largest_gap, tell)
    return replace(solution, diagnostics={**solution.diagnostics, "hidden_layers": "as drawn"})


def training_plan(settings: TrainerSettings, widths: tuple[int, ...], scales: tuple[tuple[float, float], ...]) -> Plan:
    """Return the limits of a training, with these widths and scales to start from."""
    return Plan(
        inner=settings.inner,
        widths=widths,
        scales=scales,
        activation=settings.activation,
        iterations=ITERATIONS if settings.iterations is None else settings.iterations,
        tolerance=settings.tolerance,
        gap=settings.gap,
        damping=settings.damping,
        seed=settings.seed,
        directions=settings.directions,
    )


class _Run:
    """One training: its states become the solution's history."""

    def __init__(
        self, case: Case, settings: TrainerSettings, start: Solution | None, progress: ProgressCallback
    ) -> None:
        smooth_activation(settings.activation)
        self.begin = time.perf_counter()
        self.case, self.settings, self.progress = case, settings, progress
        self.spec = field_spec(settings, "linear").model_copy(update={"mirrors": mirrored(case, settings, start)})
        self.problem = TrainingProblem.from_case(case, self.spec, Placement.on(settings.device), point_constraints)
        mirrors = self.problem.ansatz.mirrors
        widths, scales = default_plan_widths(case, self.problem.singular, mirrors.parts if mirrors else 1)
        mixed = scales == MIRRORED_SCALES or (scales == MIXED_SCALES and not settings.widths)
        # Given widths serve for comparisons of starts: the mixture is for the usual width only.
        if settings.widths and self.problem.singular and not mirrors:
            scales = SINGULAR_SCALES
        self.plan = training_plan(settings, settings.widths or widths, scales)
        if mixed:
            iterations = MIXED_ITERATIONS if settings.iterations is None else settings.iterations
            self.plan = replace(self.plan, mixed=True, iterations=iterations)
        self.history: list[Step] = []
        self.last: NdfSolution | None = None

    def solve(self, start: Solution | None) -> NdfSolution:
        try:
            self._tell(0, "looking for a start")
            state, points = self._first(start)
            spec, domain = points.spec, self.case.surface.domain
            check_balance(self.case, area_rule(domain, self.problem.focal, spec), spec, self.problem.focal)
            state, points = trusted(self.problem, self.plan, state, points)
            self._report(0, state)
            if start is not None:
                # One linear solve on the existing hidden layers. Challengers show if these suit the edit.
                found = self._certified(state, points, "the hidden layers of the start serve here, too")
                served = found.diagnostics["challenge_gain"] <= SERVES * self.settings.tolerance
                if served and found.unsettled is None:
                    return found
            state, ending = train(self.problem, self.plan, state, points, self._report)
            self._tell(self.plan.iterations, "certifying the energy on the finest quadrature")
            return self._certified(state, points, ending)
        except SolveFailure as failure:
            raise SolveFailure(f"training broke down: {failure}", failure.partial or self.last) from None

    def _first(self, start: Solution | None) -> tuple[Trained, Quadratures]:
        if start is None:
            return first_state(self.problem, self.plan)
        inputs = self.problem.features.inputs.count
        if not isinstance(start, NdfSolution) or start.field.features.network.weights[0].shape[1] != inputs:
            raise InputError(f"the start is no solution of '{NDF}' with the {inputs} inputs of this case")
        network = start.field.features.network
        points = Quadratures.for_width(self.problem, network.width)
        return points.evaluate(self.problem, network), points

    def _tell(self, step: int, message: str) -> None:
        self.progress(Progress(step, self.plan.iterations + 1, message))

    def _report(self, iteration: int, state: Trained) -> None:
        solution = self._solution(state, 1.0)
        solved = self.problem.tally["output layers"]
        step = Step(
            iteration=iteration,
            seconds=time.perf_counter() - self.begin,
            energy=state.train.potential,
            unknowns=solution.parameters,
            at=self.spec.t,
            gap=state.gap,
            quantities=displacement_values(solution),
            iterations=solved - sum(step.iterations or 0 for step in self.history),
        )
        self.history.append(step)
        self.last = replace(solution, history=tuple(self.history))
        self._tell(iteration, f"{solution.parameters} weights, energy {state.check.potential:.9g} J")

    def _solution(self, state: Trained, share: float) -> NdfSolution:
        field = Field(
            self.problem.ansatz,
            self.problem.with_network(state.network),
            share * state.output,
            state.output.new_zeros(6),
        )
        rule = self.problem.rule_spec(CERTIFICATE, FINAL_ORDER)
        return NdfSolution(
            case=self.case,
            solver=NDF,
            spec=self.spec,
            field=field,
            rule=rule,
            membrane=float("nan"),
            bending=float("nan"),
            parameters=state.network.parameters + state.output.numel(),
            history=tuple(self.history),
            point_forces=tuple((share * state.reactions).tolist()),
        )

    def _certified(self, state: Trained, points: Quadratures, ending: str) -> NdfSolution:
        problem = self.problem
        spec = problem.rule_spec(CERTIFICATE * len(points.train), FINAL_ORDER)
        rule = problem.ansatz.rule(problem.focal, spec)
        features = problem.with_network(state.network)
        forces = concentrated(problem.ansatz, spec, problem.focal, features.placement)
        (energies,) = certify(problem.ansatz, features, [state.output], rule, forces)
        moved = problem.ansatz.lift.moves or any(s.value for s in point_supports(self.case, self.spec.t))
        gap = energy_gap(state.train.potential, energies, moved)
        share = 1.0 if moved else energies.best
        membrane, bending, _ = energies.parts(share)
        solution = self._solution(state, share)
        train_rule = problem.ansatz.rule(problem.focal, points.spec)
        solution = replace(
            solution,
            field=solution.field.without_rigid_part(train_rule),
            rule=spec,
            membrane=membrane,
            bending=bending,
            diagnostics={
                "energy_gap": gap,
                "certified_energy": energies.potential(share),
                "ending": ending,
                "hidden_layers": [len(bias) for bias in state.network.biases],
                "quadrature_points": len(points.train),
                "check_points": len(points.check),
                "network_evaluations": state.evaluations,
                "fine_quadrature_points": len(rule.points),
            },
        )
        if (reason := exploits(gap, self.settings.largest_gap, "finest")) is not None:
            raise SolveFailure(f"{reason}; use smaller widths", solution)
        self._tell(self.plan.iterations, "letting challengers join")
        return stated(solution, self.plan.seed, self.history)
