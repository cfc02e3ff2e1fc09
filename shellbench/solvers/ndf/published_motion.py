"""The published training of a motion: Kairanda et al., sections 4 and 5.2, appendix E.

A SIREN in space and time is trained on the functional (35), which adds kinetic to potential energy. It is the paper's
in full: 5 x 512 sines with omega0 = 15 on inputs scaled to [0, 1], u = F t^2 B + motion with its soft boundary
functions, strains by eq. (30), 20 x 20 points by 20 times redrawn at each iteration, Adam at 1e-4 for 2000 iterations.
What departs from the paper, or is not said in it, and why:

- The sign of the first motion in eq. (72) is repaired (see `published_motion_field`).
- kappa of eq. (30) is symmetrised; elastic supports enter as energy.
- The velocity is one more derivative that is propagated forward, with the numbers of nested differentiation.

What it converges to is no motion by Newton's law (see `published_motion_loss`), which is a finding, not a fault of the
training: the reaction of a support is what Newton's law would need for the motion that comes out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from shellbench.errors import InputError
from shellbench.problem import Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.measure import measure
from shellbench.problems.shell.quantities import (
    CentreOfMass,
    DisplacementQuantity,
    PositionQuantity,
    ReactionQuantity,
    TorqueQuantity,
)
from shellbench.solvers.ndf.checkpoint import Checkpoint
from shellbench.solvers.ndf.jets import Array, Placement
from shellbench.solvers.ndf.published_motion_field import Ansatz, MotionField
from shellbench.solvers.ndf.published_motion_loss import MotionSampler, SpaceTime, why_not_sampled
from shellbench.solvers.ndf.published_motion_solution import TrainedMotion, read_motion
from shellbench.solvers.ndf.published_network import Siren, initial_siren
from shellbench.solvers.ndf.published_solver import PublishedSettings, training_key
from shellbench.solvers.ndf.published_training import why_collapsed
from shellbench.solvers.ndf.quadrature import RuleSpec, area_rule

WINDOW = 100  # last losses whose mean is held against the fine quadrature
FINE = RuleSpec((8, 8), 4)  # in space, of that quadrature
FINE_TIMES = 48  # Gauss points in time
BATCH_TIMES = 4  # of them that are evaluated at once


def why_no_motion(case: Case) -> str | None:
    """Return why the published functions can't hold or load a case in motion, as one clause; None if they can."""
    for quantity in case.quantities:
        if isinstance(quantity, ReactionQuantity | TorqueQuantity) and len(case.supports) > 1:
            return f"it can't tell the reaction of support '{quantity.support}' from that of others"
    return Ansatz.from_case(case, "both").supports.why_not_held() or why_not_sampled(case)


def load_motion(path: Path, solver: str) -> TrainedMotion:
    """Read what `TrainedMotion.save` wrote; InputError in one sentence if it is no motion of this solver."""
    header, case, siren = read_motion(path, solver)
    ansatz = Ansatz.from_case(case, header.periodic_input)
    if siren.weights[0].shape[1] != ansatz.count:
        raise InputError(f"{path}: is damaged: its weights do not fit its case")
    return TrainedMotion(
        solver,
        MotionField(ansatz, siren),
        header.strain,
        **header.course(),
    )


@dataclass(frozen=True)
class MotionTraining:
    """A case in motion and settings with all that is made of them; see `shellbench.solvers.ndf.published.Training`."""

    solver: str
    key: str
    siren: Siren
    sampler: MotionSampler

    @classmethod
    def from_case(cls, case: Case, settings: PublishedSettings, solver: str) -> MotionTraining:
        """Begin a training; InputError if the settings do not fit a motion."""
        if settings.modulus_factor is not None:
            raise InputError("setting modulus_factor belongs to the linear theory; in motion the modulus is the case's")
        placement = Placement.on(settings.device)._replace(dtype=getattr(torch, settings.dtype))
        ansatz = Ansatz.from_case(case, settings.periodic_input)
        shape = (ansatz.count, settings.layers, settings.width, settings.omega0)
        siren = initial_siren(*shape, settings.seed, placement)
        strain = settings.strain or "published"
        sampler = MotionSampler(ansatz, strain, settings.cells, settings.times, settings.seed, placement)
        return cls(solver, training_key(case, settings), siren, sampler)

    def watch(self, siren: Siren) -> dict[str, float]:
        """Return the headline quantity, if it is a displacement or position."""
        primary = self.sampler.ansatz.case.primary
        if not isinstance(primary, DisplacementQuantity | PositionQuantity | CentreOfMass):
            return {}
        return {primary.name: measure(self._solution(siren), primary)}

    def released(self, solution: Solution) -> Siren | None:
        """Return the network of an earlier solution; None if it is no motion of this recipe."""
        if not isinstance(solution, TrainedMotion) or solution.solver != self.solver:
            return None
        return solution.field.to(self.sampler.placement).siren

    @torch.no_grad()
    def solution(self, now: Checkpoint, resumed: int) -> TrainedMotion:
        """Return the trained motion, with its functional on a fine quadrature."""
        siren = self.siren.with_tensors([weight.to(self.siren.tensors[0]) for weight in now.weights])
        trained, fine = float(now.losses[-WINDOW:].mean()), self._fine_functional(siren)
        gap = abs(trained / fine - 1) if fine else 0.0
        *earlier, last = now.history
        return replace(
            self._solution(siren),
            history=(*earlier, replace(last, gap=gap)),
            diagnostics={
                "energy_gap": gap,
                "training_functional": trained,
                "fine_functional": fine,
                "rest_functional": self._fine_functional(_silent(siren)),
                "iterations": now.iteration,
                "resumed_at": resumed,
                "seconds_per_iteration": now.seconds / now.iteration,
                "strain": self.sampler.strain,
            },
        )

    def why_no_answer(self, solution: Solution) -> str | None:
        """See `shellbench.solvers.ndf.published.Training`; the functional takes the place of the energy."""
        fine, rest = (float(solution.diagnostics[f"{which}_functional"]) for which in ("fine", "rest"))
        loaded = bool(self.sampler.ansatz.case.loads) and rest == 0.0
        return why_collapsed(fine, [(step.iteration, step.energy) for step in solution.history], rest, loaded)

    def _solution(self, siren: Siren) -> TrainedMotion:
        return TrainedMotion(self.solver, MotionField(self.sampler.ansatz, siren), self.sampler.strain)

    def _fine_functional(self, siren: Siren) -> float:
        """Return the functional (35) by Gauss's rule in space and time, J."""
        exact = self.sampler.placement._replace(dtype=torch.float64)
        field = MotionField(self.sampler.ansatz, siren).to(exact)
        return sum(float(part.loss(field.siren)) for part in self._fine(exact))

    def _fine(self, placement: Placement) -> Iterator[SpaceTime]:
        ansatz, strain = self.sampler.ansatz, self.sampler.strain
        rule = area_rule(ansatz.case.surface.domain, np.zeros((0, 2)), FINE)
        x, w = np.polynomial.legendre.leggauss(FINE_TIMES)
        times: Array = ansatz.until * (x + 1) / 2
        for first in range(0, FINE_TIMES, BATCH_TIMES):
            part = slice(first, first + BATCH_TIMES)
            share = np.outer(w[part] / 2, rule.weights)
            yield SpaceTime.at_points(ansatz, strain, rule.points, times[part], share, placement)


def _silent(siren: Siren) -> Siren:
    """Return a network that is zero everywhere: what is left of its motion is that of the supports."""
    first, *_, last = siren.weights
    return Siren((first[:1] * 0, last[:, :1] * 0), (siren.biases[0][:1] * 0, siren.biases[-1] * 0), siren.omega0)
