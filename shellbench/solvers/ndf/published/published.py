"""The recipe `ndf-published`: the training of Kairanda et al. 2023, sections 4 and 5.1, appendices A and D.

A SIREN of 5 x 512 sines with omega0 = 15, inputs in [0, 1], trained by Adam at 1e-4 for 2000 iterations (2500 on the
plate) on 20 x 20 stratified samples, with the published boundary functions and loss. Departures from the paper, and
choices that it does not state, with their reasons:

- Strains are linear. Those of eq. (30) give .406 on the plate and .253 on the roof, where the preprint's Table 3 has
  .487 and .3018; and its E = 30 for the cylinders is a mere scaling in linear theory only.
- Boundary functions are scaled to a maximum of 1 (see `published_network`).
- Young's modulus is scaled in training by a power of ten that follows from the case (see `usual_modulus_factor`); it is
  the published one for all four shells of the obstacle course.
- Free rigid motions are subtracted from the trained field in the mean over the area, as the case asks.
- Derivatives are propagated forward, with the same numbers as nested automatic differentiation gives.

The trained field's energy is integrated once more on a fine quadrature; the gap to the last losses is reported. It is
not gated: with 400 random samples it also measures the noise of the loss. A training fails if it ends above rest, or
with less than half of its best gain (see `published_training.why_collapsed`).

A case in motion is trained in space and time, on a functional, boundary functions and strains of its own: see
`published_motion`, where the gap of the functional has a bound. Static paths are declined.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import why_not_plain
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import build_features, build_inputs, focal_points, usual_resolution
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field, FixedFeatures
from shellbench.solvers.ndf.field.inputs import Inputs, foci
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import check_balance, point_supports
from shellbench.solvers.ndf.linear.declines import why_declined
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.motion.motion_solution import load_solution
from shellbench.solvers.ndf.published.checkpoint import Checkpoint, is_checkpoint, read_checkpoint
from shellbench.solvers.ndf.published.natural_gradient import NaturalGradient
from shellbench.solvers.ndf.published.published_motion import MotionTraining, load_motion, why_no_motion
from shellbench.solvers.ndf.published.published_motion_solution import is_motion
from shellbench.solvers.ndf.published.published_network import (
    InputScale,
    PublishedFactors,
    Siren,
    check_same_layers,
    initial_siren,
    published_ansatz,
)
from shellbench.solvers.ndf.published.published_samples import Sampler, expected_displacement, usual_modulus_factor
from shellbench.solvers.ndf.published.published_settings import (
    NDF_PUBLISHED,
    PublishedSettings,
    checkpoint_path,
    training_key,
)
from shellbench.solvers.ndf.published.published_training import (
    CERTIFIED,
    Adam,
    LossNotFinite,
    Optimiser,
    Plan,
    first_checkpoint,
    train,
    why_collapsed,
)
from shellbench.solvers.ndf.strains.energy import certify, concentrated

WINDOW = 100  # last losses whose mean is compared with the fine quadrature
RIGID_RULE = RuleSpec((4, 4), 4)  # for the mean rigid motion
MOST_WEIGHTS = 12_000  # of a natural step: its matrices of all weights by all take gigabytes beyond
OF_TRIALS = 2**32  # added to the seed, for draws on which steps are tried
PINNED_CUTS = 3  # further panels at points that are pinned within a tenth of a unit


def why_not_held(case: Case) -> str | None:
    """Return the reason that the published boundary functions can't hold a case, as one clause, or None if they can."""
    if refusal := why_not_plain(case, frozenset({"contact", "local loads"}) if case.dynamics else frozenset()):
        return refusal
    if case.dynamics is not None:
        return why_no_motion(case)
    if not case.linear:
        return "it trains what does not move in linear theory only, as the preprint's Table 3 must have been"
    if point_supports(case):
        return "its boundary functions hold edges, not single points"
    return why_declined(case)


def load(path: Path, solver: str) -> Solution:
    """Read a file of a solver of this recipe; InputError in one sentence if it is no such file."""
    return load_motion(path, solver) if is_motion(path) else load_solution(path, solver, published_ansatz)


def solve(
    case: Case, settings: PublishedSettings, start: Solution | Path | None, progress: ProgressCallback
) -> Solution:
    """Train a field; see `shellbench.solvers.ndf.published_solver.PublishedSolver`."""
    training: _Training | MotionTraining
    if case.dynamics is None:
        training = _Training.from_case(case, settings)
    else:
        training = MotionTraining.from_case(case, settings, NDF_PUBLISHED)
    own = checkpoint_path(case, settings)
    if settings.keep == "best" and not settings.certify_every:
        raise InputError('setting keep = "best" needs certified energies, so certify_every must not be 0')
    plan = Plan(
        settings.iterations,
        settings.learning_rate,
        own,
        settings.checkpoint_every,
        cosine=settings.schedule == "cosine",
        averaging=settings.averaging,
        certify_every=settings.certify_every,
        keep_best=settings.keep == "best",
        optimiser=training.optimiser if isinstance(training, _Training) else Adam,
    )
    begin = start if start is not None or own is None or not own.exists() else own
    now = _start(training, settings.iterations, begin)
    resumed = now.iteration
    try:
        now = train(training.siren, now, training.sampler, plan, training.headline, progress, training.certify)
    except LossNotFinite as failure:
        partial = training.solution(failure.good, resumed) if failure.good.iteration else None
        raise SolveFailure(f"the training diverged: {failure}; try a smaller learning_rate", partial) from None
    if own:
        own.unlink(missing_ok=True)
    solution = training.solution(now, resumed)
    if reason := training.why_no_answer(solution):
        raise SolveFailure(reason, solution)
    return solution


def _start(training: _Training | MotionTraining, iterations: int, start: Solution | Path | None) -> Checkpoint:
    if isinstance(start, Path) and is_checkpoint(start):
        found = read_checkpoint(start)
        if found.key != training.key:
            raise InputError(f"{start}: is the checkpoint of another case, seed or settings")
        if found.iteration > iterations:
            raise InputError(f"{start}: has {found.iteration} iterations, more than the {iterations} asked for")
        return found
    if isinstance(start, Path):
        start = load(start, NDF_PUBLISHED)
    if start is None:
        return first_checkpoint(training.key, training.siren)
    lent = training.siren_of(start)
    if lent is None:
        raise InputError(f"{NDF_PUBLISHED} starts from a checkpoint or solution of its own only")
    check_same_layers(lent, training.siren)
    return first_checkpoint(training.key, lent)


@dataclass(frozen=True)
class _Training:
    """A case and settings, with the objects made of them."""

    case: Case
    settings: PublishedSettings
    key: str
    spec: FieldSpec
    ansatz: Ansatz
    inputs: Inputs
    siren: Siren
    scale: InputScale
    sampler: Sampler

    @classmethod
    def from_case(cls, case: Case, settings: PublishedSettings) -> _Training:
        if settings.strain not in (None, "linear"):
            raise InputError(f"setting strain = '{settings.strain}' belongs to cases in motion; here it is 'linear'")
        placement = Placement.on(settings.device)._replace(dtype=getattr(torch, settings.dtype))
        spec = FieldSpec(
            activation=settings.activation,
            periodic_input=settings.periodic_input,
            components=settings.components,
            pins=settings.pins,
            stretched=False,
            multipliers=settings.singular,
        )
        ansatz, inputs, focal = published_ansatz(case, spec), build_inputs(case, spec), focal_points(case)
        edges = usual_resolution(case).rule
        check_balance(case, area_rule(case.surface.domain, focal, edges), edges, focal)
        scale = InputScale.from_inputs(inputs, placement)
        if settings.unit == "load" and settings.modulus_factor:
            raise InputError('setting unit = "load" says the unit of the output, so modulus_factor must be left out')
        usual = expected_displacement if settings.unit == "load" else usual_modulus_factor
        factor = settings.modulus_factor or usual(ansatz)
        every = settings.resample_every
        shape = (inputs.count, settings.layers, settings.width, settings.omega0)
        singular = FixedFeatures.from_case(case, foci(case, spec.layer), spec.multipliers)
        return cls(
            case,
            settings,
            training_key(case, settings),
            spec,
            ansatz,
            inputs,
            initial_siren(*shape, settings.seed, placement, settings.activation, singular.count - 1),
            scale,
            Sampler(ansatz, inputs, scale, settings.cells, settings.seed, factor, edges, placement, every, singular),
        )

    def optimiser(self, network: Siren, now: Checkpoint) -> Optimiser:
        """Begin or continue the optimiser of a network."""
        if self.settings.optimiser == "adam":
            return Adam(network, now)
        if network.parameters > MOST_WEIGHTS:
            many = f"at most {MOST_WEIGHTS:,} weights, and this network has {network.parameters:,}"
            raise InputError(f'setting optimiser = "natural" takes {many}: use a smaller width, such as 24')
        apart = replace(self.sampler, seed=self.settings.seed + OF_TRIALS)
        trials = apart.samples(now.iteration, self.settings.iterations)
        return NaturalGradient.begin(network, now, trials)

    def field(self, siren: Siren, dtype: torch.dtype) -> Field:
        """Return the displacement field of a network, without its mean rigid motion."""
        network, output = siren.as_field(self.scale, self.sampler.modulus_factor)
        placement = self.sampler.placement._replace(dtype=dtype)
        features = build_features(self.case, self.spec, network.to(dtype), placement, self.inputs)
        field = Field(self.ansatz, features, output.to(dtype), output.new_zeros(6, dtype=dtype))
        return field.without_rigid_part(area_rule(self.case.surface.domain, focal_points(self.case), RIGID_RULE))

    def headline(self, siren: Siren) -> dict[str, float]:
        """Return the headline quantity, if it is a displacement."""
        primary = self.case.primary
        if not isinstance(primary, DisplacementQuantity):
            return {}
        field = self.field(siren, self.sampler.placement.dtype)
        solution = NdfSolution(self.case, NDF_PUBLISHED, self.spec, field, RIGID_RULE, 0.0, 0.0, 0)
        return {primary.name: measure(solution, primary)}

    def certify(self, siren: Siren) -> dict[str, float]:
        """Return energies on the rule of a solved field: finer than the samples, coarser than the final rule."""
        return self._energies(siren, self._refine_at_pins(usual_resolution(self.case).rule))[0]

    def _refine_at_pins(self, spec: RuleSpec) -> RuleSpec:
        """Return a rule with more cuts toward pins, which are narrow, if there are any."""
        narrow = isinstance(self.ansatz.factors, PublishedFactors) and self.ansatz.factors.pins
        return replace(spec, cuts=spec.cuts + PINNED_CUTS) if narrow else spec

    def _energies(self, siren: Siren, spec: RuleSpec) -> tuple[dict[str, float], float, int]:
        """Return the energies of a network on a rule, the energy at rest, all in J, and the number of points."""
        exact, focal = self.field(siren, torch.float64), focal_points(self.case)
        rule = area_rule(self.case.surface.domain, focal, spec)
        forces = concentrated(self.ansatz, spec, focal, exact.features.placement)
        found = certify(self.ansatz, exact.features, [exact.output], rule, forces)[0]
        membrane, bending, work = found.parts()
        energies = {CERTIFIED: membrane + bending - work, "membrane_energy": membrane, "bending_energy": bending}
        return energies, found.potential(0.0), len(rule.points)

    def siren_of(self, solution: Solution) -> Siren | None:
        """Return the network of an earlier solution; None if it is no field of this recipe."""
        if not isinstance(solution, NdfSolution) or solution.solver != NDF_PUBLISHED:
            return None
        place = self.siren.tensors[0]
        moved = solution.field.features.network.to(place)
        output = solution.field.output.to(place)
        return Siren.from_field(moved, output, self.settings.omega0, self.scale, self.sampler.modulus_factor)

    @torch.no_grad()
    def solution(self, now: Checkpoint, resumed: int) -> NdfSolution:
        """Return the trained field with its energy on the fine quadrature."""
        siren = self.siren.with_tensors([weight.to(self.siren.tensors[0]) for weight in now.best or now.answer])
        field = self.field(siren, self.sampler.placement.dtype)
        fine = self._refine_at_pins(usual_resolution(self.case).fine)
        energies, rest, points = self._energies(siren, fine)
        trained = self.sampler.modulus_factor * float(now.losses[-WINDOW:].mean())
        certified = energies[CERTIFIED]
        gap = abs(trained / certified - 1) if certified else 0.0
        *earlier, last = now.history
        if not now.best:
            last = replace(last, gap=gap, quantities={**last.quantities, **energies})
        return NdfSolution(
            case=self.case,
            solver=NDF_PUBLISHED,
            spec=self.spec,
            field=field,
            rule=fine,
            membrane=energies["membrane_energy"],
            bending=energies["bending_energy"],
            parameters=siren.parameters,
            history=(*earlier, last),
            diagnostics={
                "energy_gap": gap,
                "training_energy": trained,
                "certified_energy": certified,
                "rest_energy": rest,
                "iterations": now.iteration,
                "resumed_at": resumed,
                "seconds_per_iteration": now.seconds / now.iteration,
                "modulus_factor": self.sampler.modulus_factor,
                "fine_quadrature_points": points,
            },
        )

    def why_no_answer(self, solution: Solution) -> str | None:
        """Return the reason that a trained field is no answer, in one sentence; None if nothing speaks against it."""
        certified, rest = (float(solution.diagnostics[f"{which}_energy"]) for which in ("certified", "rest"))
        loaded = bool(self.case.loads) and not self.ansatz.lift.moves
        return why_collapsed(certified, [(step.iteration, step.energy) for step in solution.history], rest, loaded)
