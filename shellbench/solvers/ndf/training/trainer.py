"""The recipe `ndf`: a deep coordinate network with all weights trained.

Three hidden layers by default. Every step solves for the output layer exactly (variable projection). The hidden weights
follow by Gauss-Newton with Marquardt's damping. A step counts only if independent points certify its gain; see
`training`. First-order training of the same energy takes thousands of iterations, because membrane and bending
stiffness differ by (L/h)^2; here a few are enough. `compare_with_challengers` estimates the uncertainty.

If challengers still change the answer, wider networks follow (`at_rest`).

Along a path under load, the hidden layers are trained at the states of the path, on the case's own energy
(`on_path`), and the path is followed again. On other paths, in motion and in modes, hidden layers stay as drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from shellbench.problem import Progress, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
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
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.levels import PathLevel
from shellbench.solvers.ndf.path.newton import PathState
from shellbench.solvers.ndf.strains.smooth import scales
from shellbench.solvers.ndf.training.at_rest import Training, field_spec
from shellbench.solvers.ndf.training.on_path import PATH_ITERATIONS, trained_level, why_not_trained
from shellbench.solvers.ndf.training.trainer_settings import NDF, TrainerSettings

FITTED = 40  # points a side to which the last hidden layer of a path or a motion is fitted


def follow(
    case: Case,
    spec: FieldSpec,
    settings: TrainerSettings,
    progress: ProgressCallback,
    begin: Solution | None = None,
) -> PathSolution:
    """Follow the path of a case with deep networks of ever larger width, those of the settings if there are any.

    With `begin`, an earlier path, it starts from that path's states, on its hidden layers.

    Raises
    ------
    SolveFailure
        If the path ends early for the widest, or its field exploits the quadrature.
    """
    # 1. For each width, draw a deep network.
    # 2. Follow the path level by level (`large_displacement.solve`). Where possible, train the hidden layers at the
    #    states of the path, and follow it again.
    # 3. With `begin`, take the hidden layers of the earlier path, and start from its states.
    placement, inputs = Placement.on(settings.device), build_inputs(case, spec)
    values = inputs.jets(case.surface.domain.grid(FITTED, FITTED).reshape(-1, 2), placement)[VALUE]
    focal = graded_points(case, spec)

    def build(number: int, width: int, kept: Network | None = None, trained: int = 0) -> PathLevel:
        chosen = path_resolution(case, number)
        layers, spread = (*settings.inner, width), placement.tensor(chosen.scales(inputs))
        network = kept or deep_random_features(values, spread, layers, settings.seed, settings.activation)
        features = build_features(case, spec, network, placement, inputs)
        return PathLevel(features, chosen.rule, chosen.fine, focal, chosen, trained)

    count = path_level_count(case)
    widths = settings.widths or tuple(
        path_resolution(case, number).neurons for number in range(first_path_level(case), count)
    )
    numbers = [max(0, count - len(widths) + k) for k in range(len(widths))]
    builds = [partial(build, number, width) for number, width in zip(numbers, widths, strict=True)]
    path = None
    if begin is not None:
        path, first = start_of_path(begin, case, NDF, widths)
        last = path.states[-1]
        trained = last.parameters - last.field.output.numel()
        kept = last.field.features.network
        builds = [partial(build, numbers[first], widths[first], kept, trained), *builds[first + 1 :]]

    def train(level: PathLevel, problem: PathProblem, states: Sequence[PathState]) -> PathLevel | None:
        width = level.features.network.width
        steps = PATH_ITERATIONS if settings.iterations is None else settings.iterations
        if begin is not None or not steps or why_not_trained(case, width) is not None:
            return None

        def tell(iteration: int, gain: float) -> None:
            progress(Progress(iteration, steps, f"training {width} features, {gain:.2g} of the energy gained"))

        return trained_level(level, problem, states, steps, tell)

    # At finite strain, challengers of trained layers would give uncertainties close to some tolerances, so that chance
    # would decide.
    seed = settings.seed if case.linear else None
    solution = large_displacement.solve(case, spec, NDF, builds, settings.largest_gap, seed, progress, path, train)
    hidden = "trained" if solution.parameters > solution.states[-1].field.output.numel() else "as drawn"
    return replace(solution, diagnostics={**solution.diagnostics, "hidden_layers": hidden})


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
        return follow(case, field_spec(settings, strain), settings, tell, begin)


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
