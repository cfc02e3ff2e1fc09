"""Training of the hidden weights by Adam (Kingma & Ba, arXiv:1412.6980), what Gauss-Newton is compared with.

All else is as in `training`: the same start, the same points, the output layer solved for exactly at every iteration,
and a state counts only if independent points certify it. So what differs is the step alone.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.training.gauss_newton import energy_gradient, flatten, unflatten
from shellbench.solvers.ndf.training.training import Plan, Report, agree
from shellbench.solvers.ndf.training.training_problem import Quadratures, Trained, TrainingProblem

RECORD = 25  # iterations between two looks at the check points


def train_by_adam(
    problem: TrainingProblem, plan: Plan, state: Trained, points: Quadratures, report: Report
) -> tuple[Trained, str]:
    """Train all weights; return the best certified state and why training ended.

    `report` is called with each certified state.
    """
    # 1. Gradient on the training points, at the output layer that is best for the hidden weights.
    # 2. Adam's step, its rate falling to nothing along half a cosine; then the output layer anew.
    # 3. Every so often the check points judge: better on both sets alike, and the state is kept.
    theta = flatten(state.network)
    adam = torch.optim.Adam([theta], lr=plan.learning_rate)
    now, best, spent = state, state, state.evaluations
    for iteration in range(1, plan.iterations + 1):
        # The energy is divided by its own size: Adam's least denominator (1e-8) then means the same for all shells.
        size = max(abs(now.train.potential), torch.finfo(theta.dtype).tiny)
        theta.grad = energy_gradient(points.train, points.tips, now.network, now.output) / size
        adam.param_groups[0]["lr"] = plan.learning_rate * 0.5 * (1 + math.cos(math.pi * iteration / plan.iterations))
        adam.step()
        spent += 3 * len(points.train)
        try:
            now = points.solved(problem, unflatten(theta, state.network))
        except SolveFailure:
            return replace(best, evaluations=spent), "the energy was not finite any more"
        if iteration % RECORD == 0 or iteration == plan.iterations:
            seen = points.checked(now)
            spent += len(points.check)
            if agree(seen, best) and seen.gap <= max(plan.gap, best.gap):
                best = replace(seen, evaluations=spent)
                report(iteration, best)
    return replace(best, evaluations=spent), "all iterations were made"
