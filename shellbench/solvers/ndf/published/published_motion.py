"""The published training of a motion: Kairanda et al. 2023, sections 4 and 5.2, appendix E.

A SIREN in space and time is trained on the functional (35), which adds kinetic to potential energy. It follows the
paper in full: 5 x 512 sines with omega0 = 15 on inputs scaled to [0, 1], u = F t^2 B + motion with its soft boundary
functions, strains by eq. (30), 20 x 20 points by 20 times redrawn at each iteration, Adam at 1e-4 for 2000 iterations.
Departures from the paper, and choices that it does not state, with their reasons:

- The sign of the first motion in eq. (72) is corrected (see `published_motion_field`).
- kappa of eq. (30) is symmetric; elastic supports enter as energy.
- Obstacles, which the paper has in a preliminary experiment only, are in the loss as there.
- The velocity is one more derivative that is propagated forward, with the same numbers as nested differentiation.

It converges to a motion that does not obey Newton's law (see the functional below). This is a property of the
functional, not a fault of the training. The reaction of a support is the force that Newton's law requires for the
resulting motion.

The published functional of motion: the mean over time of potential *plus* kinetic energy.

    L = |Omega| / (N_Omega N_t) sum_ij (W - f . u + 1/2 k |u|^2 + 1/2 rho |du/dt|^2) sqrt(a)

(Kairanda et al. 2023, eq. (35)) at N_Omega points, one random one in each cell of a grid, and N_t times, one in each of
N_t intervals, all redrawn at every iteration; k is the stiffness of springs. The sum is over all pairs, as printed. It
is 1/T times the integral (33), so that its unit is J.

Its Euler-Lagrange equation is rho u'' = +dE/du: the sign of inertia is that of Newton's law reversed, and the final
time brings the natural condition du/dt = 0. A free fall from rest becomes u = g (T t - t^2 / 2).

Points and times are numbers of a counter-based generator, keyed by the seed and counted by the iteration, as in
`published_loss`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import InputError
from shellbench.problem import Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.quantities.quantities import CentreOfMass, DisplacementQuantity, PositionQuantity
from shellbench.solvers.ndf.field.choices import StrainName
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.quadrature import NOWHERE, RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import force_density
from shellbench.solvers.ndf.published.checkpoint import Checkpoint
from shellbench.solvers.ndf.published.published_motion_field import DT, Ansatz, MotionField, collision, motion_planes
from shellbench.solvers.ndf.published.published_motion_solution import TrainedMotion, read_motion
from shellbench.solvers.ndf.published.published_network import Siren, initial_siren
from shellbench.solvers.ndf.published.published_samples import stratified_samples
from shellbench.solvers.ndf.published.published_settings import PublishedSettings, training_key
from shellbench.solvers.ndf.published.published_training import why_collapsed
from shellbench.solvers.ndf.strains.strain_measures import MEASURES, Reference, Undeformed, gradient_map

# Departures that trainings of motions do not support.
OF_STATICS = ("optimiser", "singular", "pins", "components", "unit", "keep", "resample_every", "activation")
OF_TIMES = 1 << 64  # separate from the counters of the points: no iteration reaches it


def stratified_times(until: float, count: int, seed: int, iteration: int) -> Array:
    """Return one random time in each of `count` equal intervals, (T,), s, for one iteration of a training."""
    generator = np.random.Generator(np.random.Philox(key=seed, counter=(iteration << 128) + OF_TIMES))
    times: Array = until * (np.arange(count) + generator.random(count)) / count
    return times


@dataclass(frozen=True)
class SpaceTime:
    """N points by T times, with the data of the functional there beside the network.

    Attributes
    ----------
    inputs
        (7, T N, n): inputs of the network; times vary slowest.
    times
        (T,), s.
    factor, prescribed
        (6, N, 3) and (7, T, N, 3): B and the prescribed displacement.
    gradients
        (N, 5, 6): from a jet to u,1, u,2, d_11, d_22, d_12.
    reference
        The undeformed surface, times slowest: (T N, ...).
    elasticity
        (N, 2, 3, 3), N/m and N m.
    force
        (T, N, 3), N/m^2.
    springs
        (N, 3), N/m^3.
    weights
        (T, N), m^2: they sum up to the area.
    places
        (N, 2) and (T,), s: points and times in float64.
    """

    inputs: Tensor
    times: Tensor
    factor: Tensor
    prescribed: Tensor
    gradients: Tensor
    reference: Reference
    elasticity: Tensor
    force: Tensor
    springs: Tensor
    weights: Tensor
    density: float
    strain: StrainName
    case: Case
    places: tuple[Array, Array]

    @classmethod
    def at_points(
        cls, ansatz: Ansatz, strain: StrainName, points: Array, times: Array, share: Array, placement: Placement
    ) -> SpaceTime:
        """Tabulate in float64 at points (N, 2) and times (T,), whose parametric areas are `share` (T, N)."""
        case, exact = ansatz.case, placement._replace(dtype=torch.float64)
        surface = Undeformed.at_points(case.surface, points, exact)
        to, many = placement.dtype, len(times)

        def repeated(tensor: Tensor) -> Tensor:
            return tensor.to(to).expand(many, *tensor.shape).flatten(0, 1)

        moments = exact.tensor(times)
        reference = surface.reference
        return cls(
            inputs=ansatz.network_inputs(ansatz.space_inputs(points, exact), moments).to(to),
            times=moments.to(to),
            factor=ansatz.supports.factor(points, exact).to(to),
            prescribed=ansatz.prescribed_motion(points, times, exact).to(to),
            gradients=gradient_map(surface.geometry).to(to),
            reference=Reference(
                repeated(reference.base),
                repeated(reference.normal),
                repeated(reference.inverse),
                repeated(reference.curvature),
            ),
            elasticity=surface.elasticity(case.material).to(to),
            force=exact.tensor(np.stack([force_density(case, points, float(t)) for t in times])).to(to),
            springs=exact.tensor(case.spring_stiffness(points)).to(to),
            weights=(exact.tensor(share) * surface.geometry.jacobian).to(to),
            density=case.material.areal_density,
            strain=strain,
            case=case,
            places=(points, times),
        )

    def loss(self, siren: Siren) -> Tensor:
        """Return the functional of a network, J."""
        return self.functional(self.planes(siren))

    def planes(self, siren: Siren) -> Tensor:
        """Return the displacement's planes (7, T, N, 3)."""
        jets = siren.jets(self.inputs)
        return motion_planes(jets.view(len(jets), *self.weights.shape, 3), self.times, self.factor) + self.prescribed

    def functional(self, planes: Tensor) -> Tensor:
        """Return the functional of a displacement, J, from its planes (7, T, N, 3)."""
        u, velocity = planes[VALUE], planes[DT]
        density = 0.5 * (self.springs * u**2 + self.density * velocity**2).sum(-1) - (self.force * u).sum(-1)
        if self.case.obstacles:
            density = density + collision(self.case, *self.places, u)
        return (self.weights * (self.strain_energy(planes[:DT]) + density)).sum()

    def strain_energy(self, jets: Tensor) -> Tensor:
        """Return the strain energy density W (T, N), N/m, from the jets (6, T, N, 3) of a displacement."""
        gradients = self.gradients @ jets.permute(1, 2, 0, 3)
        strains = MEASURES[self.strain](self.reference, gradients.flatten(0, 1)).strains
        strains = strains.view(*self.weights.shape, 2, 3, 1)
        density: Tensor = 0.5 * (strains * (self.elasticity @ strains)).sum((-3, -2, -1))
        return density


@dataclass(frozen=True)
class MotionSampler:
    """Source of the samples of a training; see `shellbench.solvers.ndf.published.published_training.Sampling`.

    Attributes
    ----------
    cells, times
        Numbers of cells of the grid along xi1 and xi2, and of intervals of time.
    placement
        Of the tensors.
    """

    ansatz: Ansatz
    strain: StrainName
    cells: tuple[int, int]
    times: int
    seed: int
    placement: Placement
    modulus_factor: float = 1.0

    @property
    def end(self) -> float:
        """Final time, s."""
        return self.ansatz.until

    def samples(self, start: int, stop: int) -> Iterator[SpaceTime]:
        """Yield the samples of iterations start, ..., stop - 1."""
        case, count = self.ansatz.case, math.prod(self.cells)
        share = np.full((self.times, count), math.prod(case.surface.domain.size) / (self.times * count))
        for iteration in range(start, stop):
            points = stratified_samples(case, self.cells, self.seed, iteration)
            times = stratified_times(self.ansatz.until, self.times, self.seed, iteration)
            yield SpaceTime.at_points(self.ansatz, self.strain, points, times, share, self.placement)


def why_not_sampled(case: Case) -> str | None:
    """Return the part of a case that the functional leaves out, as one clause; None if it has all."""
    if any(obstacle.friction for obstacle in case.obstacles):
        return "its obstacles have friction, and its loss of collisions has none"
    for load in case.loads:
        if load.kind not in ("area", "pressure", "gravity"):
            return f"its functional of motion knows no load of kind '{load.kind}'"
    return "its functional of motion knows no pressure that follows the shell" if case.following else None


WINDOW = 100  # last losses whose mean is compared with the fine quadrature
LARGEST_GAP = 0.1  # of the functional: mean of the last losses against the fine quadrature; chosen before any was seen
CERTIFYING_RULE = RuleSpec((8, 8), 4)  # in space, of that quadrature
FINE_TIMES = 48  # Gauss points in time
BATCH_TIMES = 4  # of them that are evaluated at once


def why_no_motion(case: Case) -> str | None:
    """Return the reason that the published functions can't hold or load a case in motion, as one clause, or None."""
    return Ansatz.from_case(case, "both").supports.why_not_held() or why_not_sampled(case)


def load_motion(path: Path, solver: str) -> TrainedMotion:
    """Read a file of `TrainedMotion.save`; InputError in one sentence if it is no motion of this solver."""
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
    """A case in motion and settings, with the objects made of them."""

    solver: str
    key: str
    siren: Siren
    sampler: MotionSampler

    @classmethod
    def from_case(cls, case: Case, settings: PublishedSettings, solver: str) -> MotionTraining:
        """Begin a training; InputError if the settings do not fit a motion."""
        usual = PublishedSettings()
        if other := [name for name in OF_STATICS if getattr(settings, name) != getattr(usual, name)]:
            raise InputError(f"setting {other[0]} belongs to cases at rest, and this one moves")
        if settings.modulus_factor is not None:
            raise InputError("setting modulus_factor belongs to the linear theory; in motion the modulus is the case's")
        placement = Placement.on(settings.device)._replace(dtype=getattr(torch, settings.dtype))
        ansatz = Ansatz.from_case(case, settings.periodic_input)
        shape = (ansatz.count, settings.layers, settings.width, settings.omega0)
        siren = initial_siren(*shape, settings.seed, placement)
        strain = settings.strain or "published"
        sampler = MotionSampler(ansatz, strain, settings.cells, settings.times, settings.seed, placement)
        return cls(solver, training_key(case, settings), siren, sampler)

    def headline(self, siren: Siren) -> dict[str, float]:
        """Return the headline quantity, if it is a displacement or position."""
        primary = self.sampler.ansatz.case.primary
        if not isinstance(primary, DisplacementQuantity | PositionQuantity | CentreOfMass):
            return {}
        return {primary.name: measure(self._solution(siren), primary)}

    def certify(self, siren: Siren) -> dict[str, float]:
        """Return no energies: a functional in space and time is computed at the end only."""
        return {}

    def siren_of(self, solution: Solution) -> Siren | None:
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
                "rest_functional": self._fine_functional(_zero_network(siren)),
                "iterations": now.iteration,
                "resumed_at": resumed,
                "seconds_per_iteration": now.seconds / now.iteration,
                "strain": self.sampler.strain,
            },
        )

    def why_no_answer(self, solution: Solution) -> str | None:
        """Return the reason that a motion is no answer, in one sentence, or None; the functional is its energy."""
        gap = float(solution.diagnostics["energy_gap"])
        # The mean of fewer losses is of a network that still changes.
        if gap > LARGEST_GAP and int(solution.diagnostics["iterations"]) >= WINDOW:
            return f"the functional of its samples is {gap:.0%} off a fine quadrature's, more than {LARGEST_GAP:.0%}"
        fine, rest = (float(solution.diagnostics[f"{which}_functional"]) for which in ("fine", "rest"))
        if rest and fine - rest > LARGEST_GAP * abs(rest):
            return f"the training came to no answer: its functional is {fine:.3g} J, and {rest:.3g} J without a network"
        loaded = bool(self.sampler.ansatz.case.loads) and rest == 0.0
        return why_collapsed(fine, [(step.iteration, step.energy) for step in solution.history], rest, loaded)

    def _solution(self, siren: Siren) -> TrainedMotion:
        return TrainedMotion(self.solver, MotionField(self.sampler.ansatz, siren), self.sampler.strain)

    def _fine_functional(self, siren: Siren) -> float:
        """Return the functional (35) by Gauss's rule in space and time, J."""
        exact = self.sampler.placement._replace(dtype=torch.float64)
        field = MotionField(self.sampler.ansatz, siren).to(exact)
        return sum(float(part.loss(field.siren)) for part in self._fine_samples(exact))

    def _fine_samples(self, placement: Placement) -> Iterator[SpaceTime]:
        """Yield the points and times of Gauss's rule, some times at once."""
        ansatz, strain = self.sampler.ansatz, self.sampler.strain
        rule = area_rule(ansatz.case.surface.domain, NOWHERE, CERTIFYING_RULE)
        x, w = np.polynomial.legendre.leggauss(FINE_TIMES)
        times: Array = ansatz.until * (x + 1) / 2
        for first in range(0, FINE_TIMES, BATCH_TIMES):
            part = slice(first, first + BATCH_TIMES)
            share = np.outer(w[part] / 2, rule.weights)
            yield SpaceTime.at_points(ansatz, strain, rule.points, times[part], share, placement)


def _zero_network(siren: Siren) -> Siren:
    """Return a network that is zero everywhere: only the motion of the supports remains."""
    first, *_, last = siren.weights
    return Siren((first[:1] * 0, last[:, :1] * 0), (siren.biases[0][:1] * 0, siren.biases[-1] * 0), siren.omega0)
