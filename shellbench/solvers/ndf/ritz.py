"""The recipe `ndf-ritz`: fixed random sine features, and a solve for the output layer. It trains nothing.

The strain energy of a linear shell is quadratic in the output weights, so that they follow from one symmetric positive
definite system, as in Ritz's method. The hidden layer keeps the weights drawn by the seed (random features, Rahimi &
Recht 2007). Widths, scales and quadrature follow from the case. Linear shells at rest are solved in `static`, and
refined by `refinement`; this module starts paths and motions.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import torch

from shellbench.errors import InputError
from shellbench.problem import ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import checked_start
from shellbench.solvers.ndf.field.build import (
    Resolution,
    build_features,
    build_inputs,
    first_path_level,
    graded_points,
    path_level_count,
    path_resolution,
)
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import Network, random_features
from shellbench.solvers.ndf.field.supports import edge_supports
from shellbench.solvers.ndf.linear import contact, static
from shellbench.solvers.ndf.linear.ritz_field import field_spec, is_path, with_settings
from shellbench.solvers.ndf.linear.ritz_settings import NDF_RITZ, RitzSettings
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.motion import motion
from shellbench.solvers.ndf.motion.motion_solution import MotionSolution, load_solution
from shellbench.solvers.ndf.motion.products import product_features, why_no_products
from shellbench.solvers.ndf.path import contact_at_finite_strain, large_displacement, modes
from shellbench.solvers.ndf.path.edited import start_of_path
from shellbench.solvers.ndf.path.levels import PathLevel
from shellbench.solvers.ndf.path.path_challenge import SETTLED_STATE
from shellbench.solvers.ndf.strains.smooth import LONG_ORDER, LONG_SHARE, placed_features, scales


def solve(
    case: Case, settings: RitzSettings, start: Solution | Path | None, progress: ProgressCallback
) -> NdfSolution | PathSolution | MotionSolution:
    """Solve a case; see `shellbench.solvers.ndf.ritz_solver.RitzSolver`."""
    spec = field_spec(case, settings)
    anew = case.dynamics is None and (case.obstacles or not is_path(case))
    if start is not None and anew:
        what = "it trains nothing, and solves linear shells and those in contact anew"
        raise InputError(f"{NDF_RITZ} can't go on from an earlier solution in {case.name}: {what}")
    begin = load_solution(start, NDF_RITZ) if isinstance(start, Path) else start
    if begin is not None:
        checked_start(begin, case, NDF_RITZ, NdfSolution, PathSolution)
    with torch.no_grad():
        if case.dynamics is not None:
            return _move(case, spec, settings, progress)
        if case.modal:
            return modes.solve(case, spec, settings, progress)
        if case.obstacles and not case.linear:
            return contact.solve(case, spec, settings, progress, contact_at_finite_strain.answer, SETTLED_STATE)
        if is_path(case):
            return _follow(case, spec, settings, begin, progress)
        if case.obstacles:
            return contact.solve(case, spec, settings, progress)
        return static.solve(case, spec, settings, progress)


def _follow(
    case: Case, spec: FieldSpec, settings: RitzSettings, begin: Solution | None, progress: ProgressCallback
) -> PathSolution:
    """Follow the path of a case with one level, if a setting fixes its width, or several; from the level of `begin`."""
    placement, focal, inputs = Placement.on(settings.device), graded_points(case, spec), build_inputs(case, spec)

    def build(chosen: Resolution, network: Network | None = None) -> PathLevel:
        if network is None:
            scales = placement.tensor(chosen.scales(inputs))
            network = random_features(scales, chosen.neurons, settings.seed, settings.activation)
        features = build_features(case, spec, network, placement, inputs)
        return PathLevel(features, chosen.rule, chosen.fine, focal, chosen)

    last = path_level_count(case) - 1
    numbers = range(first_path_level(case), last + 1) if settings.neurons is None else [last]
    tried = [with_settings(path_resolution(case, number), settings) for number in numbers]
    builds = [partial(build, chosen) for chosen in tried]
    path = None
    if begin is not None:
        path, first = start_of_path(begin, case, NDF_RITZ, [chosen.neurons for chosen in tried])
        kept = path.states[-1].field.features.network
        builds = [partial(build, tried[first], kept), *builds[first + 1 :]]
    told = (settings.largest_gap, settings.seed, progress, path)
    return large_displacement.solve(case, spec, NDF_RITZ, builds, *told)


def _move(case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback) -> MotionSolution:
    """Follow a motion with one level, if a setting fixes its width, or several."""
    spec = spec.model_copy(update={"stretched": False, "edge_stretched": False, "multipliers": 0})
    placement, inputs = Placement.on(settings.device), build_inputs(case, spec)

    placed = settings.hidden == "placed"
    sums = placed and why_no_products(case, spec, inputs) is None
    spec = spec.model_copy(update={"vanishing": sums and bool(edge_supports(case))})

    def build(degree: int, width: int) -> motion.MotionLevel:
        if sums:
            return motion.MotionLevel(
                degree, product_features(case, inputs, degree, placement), 0, share=LONG_SHARE, grow=settings.grow
            )
        if placed:
            network = placed_features(case, inputs, degree, placement)
        else:
            spread = placement.tensor(scales(case, inputs, degree))
            network = random_features(spread, width, settings.seed, settings.activation)
        features = build_features(case, spec, network, placement, inputs)
        return motion.MotionLevel(degree, features, 0, *((LONG_ORDER, LONG_SHARE) if placed else ()))

    levels = motion.motion_levels(case, None if settings.neurons is None else (settings.neurons,), settings.degrees)
    builds = [partial(build, degree, width) for degree, width in levels]
    return motion.solve(case, spec, NDF_RITZ, builds, settings.largest_gap, progress)
