"""The recipe `ndf` at finite strain: a deep network whose output layer follows the path of a case.

The hidden layers are trained on the linearised problem at full load, which is cheap, and then kept: on plates and roofs
they are worth as much at finite strain as before training, so what decides there is the last hidden layer's width.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import ProgressCallback
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad
from shellbench.solvers.ndf import large_displacement
from shellbench.solvers.ndf.build import FieldSpec, graded_points
from shellbench.solvers.ndf.field import Ansatz, Features
from shellbench.solvers.ndf.jets import VALUE, Placement
from shellbench.solvers.ndf.large_displacement import Rung
from shellbench.solvers.ndf.network import Network, deep_random_features
from shellbench.solvers.ndf.path_solution import PathSolution
from shellbench.solvers.ndf.resolution import rung, rung_count
from shellbench.solvers.ndf.training import Plan, Quadratures, TrainingProblem, train, trusted

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
) -> PathSolution:
    """Follow the path of a case with deep networks of ever larger width, `plan.widths` if there are any.

    Raises
    ------
    SolveFailure
        If the path ends early for the widest, or its field exploits the quadrature.
    """
    full = case.path.until if case.path.control == "load" else 1.0
    linear = case.model_copy(update={"theory": "kirchhoff-love-linear"})
    problem = TrainingProblem.from_case(
        linear, spec.model_copy(update={"strain": "linear", "t": full}), placement, constraints
    )

    def build(number: int, width: int) -> Rung:
        chosen = rung(case, number)
        points = Quadratures.for_width(problem, width)
        scales = placement.tensor(chosen.scales(problem.features.inputs))
        values = points.train.inputs[VALUE]
        drawn = deep_random_features(values, scales, (*plan.inner, width), plan.seed, plan.activation)
        network = _trained(problem, plan, drawn, points) if may_be_trained(case, width) else drawn
        trained = 0 if network is drawn else network.parameters
        return Rung(problem.with_network(network), chosen.rule, chosen.fine, graded_points(case, spec), trained)

    count = rung_count(case)
    widths = plan.widths or tuple(rung(case, number).neurons for number in range(count))
    numbers = [max(0, count - len(widths) + k) for k in range(len(widths))]
    builds = [partial(build, number, width) for number, width in zip(numbers, widths, strict=True)]
    solution = large_displacement.solve(case, spec, solver, builds, largest_gap, progress)
    trained = solution.parameters > solution.states[-1].field.output.numel()
    hidden = "trained in linear theory" if trained else "as drawn"
    return replace(solution, diagnostics={**solution.diagnostics, "hidden_layers": hidden})


def may_be_trained(case: Case, width: int) -> bool:
    """Tell whether hidden layers can be trained: no wide ones, nor where all is prescribed or edge moments act.

    Nor where the shell is followed through buckling: linear theory would teach them states without waves.
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
    except SolveFailure:  # what was drawn is as good
        return network
    return state.network
