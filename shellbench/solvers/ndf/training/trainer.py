"""The recipe `ndf`: a deep coordinate network with all weights trained.

Three hidden layers by default. Every step solves for the output layer exactly (variable projection). The hidden weights
follow by Gauss-Newton with Marquardt's damping. A step counts only if independent points certify its gain; see
`training`. First-order training of the same energy takes thousands of iterations, because membrane and bending
stiffness differ by (L/h)^2; here a few are enough. `challenge` estimates the uncertainty.

If challengers still change the answer, wider networks follow (`at_rest`).

Along a path under load, the hidden layers are trained at the states of the path, on the case's own energy
(`path.trained`), and the path is followed again. Other paths keep the layers as drawn, or trained on the linearised
problem at full load. In motion and in modes, hidden layers stay as drawn.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from shellbench.errors import SolveFailure
from shellbench.problem import ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.solution import checked_start
from shellbench.solvers.ndf.field.build import (
    build_features,
    build_inputs,
    first_path_level,
    graded_points,
    path_level_count,
    path_resolution,
)
from shellbench.solvers.ndf.field.choices import FieldSpec, StrainName
from shellbench.solvers.ndf.field.jets import VALUE, Placement, smooth_activation
from shellbench.solvers.ndf.field.network import Network, deep_random_features
from shellbench.solvers.ndf.linear.ritz_field import is_path, strain_of
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.motion import motion
from shellbench.solvers.ndf.motion.motion_solution import MotionSolution, load_solution
from shellbench.solvers.ndf.path import large_displacement, modes
from shellbench.solvers.ndf.path.edited import start_of_path
from shellbench.solvers.ndf.path.levels import PathLevel
from shellbench.solvers.ndf.path.trained import PATH_ITERATIONS, why_not_trained
from shellbench.solvers.ndf.strains.smooth import scales
from shellbench.solvers.ndf.training.at_rest import WIDEST_TRAINED, Training, field_spec, training_plan
from shellbench.solvers.ndf.training.trainer_settings import NDF, TrainerSettings
from shellbench.solvers.ndf.training.training import (
    Plan,
    train,
    trusted,
)
from shellbench.solvers.ndf.training.training_problem import Quadratures, TrainingProblem


def follow(
    case: Case,
    spec: FieldSpec,
    plan: Plan,
    placement: Placement,
    largest_gap: float,
    solver: str,
    progress: ProgressCallback,
    iterations: int,
    begin: Solution | None = None,
) -> PathSolution:
    """Follow the path of a case with deep networks of ever larger width, `plan.widths` if there are any.

    With `begin`, an earlier path, it starts from that path's states, on its hidden layers. Without, each network is
    trained by `iterations` steps.

    Raises
    ------
    SolveFailure
        If the path ends early for the widest, or its field exploits the quadrature.
    """
    # 1. For each width, draw a deep network. Where the path's own energy can't train it, train it on the linear problem
    #    at full load, if possible.
    # 2. Follow the path level by level (`large_displacement.solve`). Where possible, train the hidden layers at the
    #    states of the path, and follow it again.
    # 3. With `begin`, take the hidden layers of the earlier path, and start from its states.
    full = case.path.until if case.path.control == "load" else 1.0
    linear = case.model_copy(update={"theory": "kirchhoff-love-linear"})
    problem = TrainingProblem.from_case(linear, spec.model_copy(update={"strain": "linear", "t": full}), placement)

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
        linearly = why_not_trained(case, width) is not None and may_be_trained(case, width)
        network = _trained(problem, plan, drawn, points) if linearly else drawn
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
    # At finite strain, challengers of trained layers would give uncertainties close to some tolerances, so that chance
    # would decide.
    seed = plan.seed if case.linear else None
    steps = iterations if begin is None else 0
    solution = large_displacement.solve(case, spec, solver, builds, largest_gap, seed, progress, path, steps)
    trained = solution.parameters > solution.states[-1].field.output.numel()
    on_path = why_not_trained(case, solution.states[-1].field.features.network.width) is None
    hidden = "as drawn" if not trained else "trained on the path" if on_path else "trained in linear theory"
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
            return Training(case, settings, begin, tell).solve(begin)
        smooth_activation(settings.activation)
        return follow(
            case,
            field_spec(settings, strain),
            training_plan(settings, settings.widths or (), ()),
            Placement.on(settings.device),
            settings.largest_gap,
            NDF,
            tell,
            PATH_ITERATIONS if settings.iterations is None else settings.iterations,
            begin,
        )


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
