"""Training of a linear shell at rest: networks of ever larger width, their certificates, and their record.

The first network has plain inputs, and the widths of `training.default_plan_widths`. If challengers then still change
its answer, wider ones follow, as for `ndf-ritz`: their inputs are stretched toward edges and points, powers about
corners are among their features, and their rules are graded accordingly.
"""

from __future__ import annotations

import time
from dataclasses import replace

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.build import field_mirrors, focal_points, is_flat
from shellbench.solvers.ndf.field.choices import MULTIPLIERS, FieldSpec, StrainName
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import VALUE, Placement, smooth_activation
from shellbench.solvers.ndf.field.network import deep_random_features
from shellbench.solvers.ndf.field.quadrature import area_rule
from shellbench.solvers.ndf.field.supports import check_balance, point_supports
from shellbench.solvers.ndf.linear.answer import displacement_values
from shellbench.solvers.ndf.linear.challenge import with_uncertainty
from shellbench.solvers.ndf.linear.refinement import Level, first_level, next_level
from shellbench.solvers.ndf.linear.ritz_field import mirrors_by_default, part_resolution
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.strains.energy import certify, concentrated, energy_gap, why_exploited
from shellbench.solvers.ndf.training.trainer_settings import NDF, TrainerSettings
from shellbench.solvers.ndf.training.training import (
    CERTIFICATE,
    MIRRORED_SCALES,
    MIXED_SCALES,
    SINGULAR_SCALES,
    Plan,
    close_gap,
    default_plan_widths,
    first_state,
    train,
)
from shellbench.solvers.ndf.training.training_problem import FINAL_ORDER, Quadratures, Trained, TrainingProblem

SERVES = 10.0  # largest certified gain by challengers, in tolerances of training, with which a start's layers serve
ITERATIONS, MIXED_ITERATIONS = 3, 2  # by certified energy at equal time: a mixed start leaves less to training
WIDENED = "stretched", "edge_stretched", "multipliers", "detail", "slopes"  # choices of wider networks
WIDEST_TRAINED = 300  # a Gauss-Newton step costs the third power of the width


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


def uses_mirrors(case: Case, settings: TrainerSettings, start: Solution | None) -> bool:
    """Return True if planes of symmetry are built in: as in a start, or by settings, or if it is of advantage."""
    # Given widths serve for comparisons of fields with each other, and with those of other recipes.
    if isinstance(start, NdfSolution):
        return start.spec.mirrors
    if settings.mirrors is not None:
        return settings.mirrors
    return len(focal_points(case)) > 0 and not is_flat(case) and settings.widths is None


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
        fitted=settings.start == "fitted",
    )


class Training:
    """One training: its states become the solution's history."""

    def __init__(
        self, case: Case, settings: TrainerSettings, start: Solution | None, progress: ProgressCallback
    ) -> None:
        smooth_activation(settings.activation)
        self.begin = time.perf_counter()
        self.case, self.settings, self.progress = case, settings, progress
        self.placement = Placement.on(settings.device)
        self.spec = field_spec(settings, "linear").model_copy(update={"mirrors": uses_mirrors(case, settings, start)})
        like = None
        if isinstance(start, NdfSolution) and start.spec.detail:  # widened: its inputs and its rules
            self.spec = self.spec.model_copy(update={name: getattr(start.spec, name) for name in WIDENED})
            like = first_level(case, part_resolution(case, field_mirrors(case, self.spec))).resolution.rule
        self.problem = TrainingProblem.from_case(case, self.spec, self.placement, like)
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
        self.before = 0  # steps of narrower networks
        self.last: NdfSolution | None = None

    def solve(self, start: Solution | None) -> NdfSolution:
        """Train networks until one has settled, or no wider one is allowed; with given widths, these only."""
        try:
            state, points = self._first_state(start)
            found = self._train(state, points, start is not None)
        except SolveFailure as failure:
            raise SolveFailure(f"training broke down: {failure}", failure.partial or self.last) from None
        # Given widths or iterations serve for comparisons: such a field stays as it is.
        given = self.settings.widths or self.settings.iterations is not None
        if found.unsettled is None or given or start is not None:
            return found
        return self._train_wider(found)

    def _train(self, state: Trained, points: Quadratures, kept: bool = False, train_it: bool = True) -> NdfSolution:
        """Return the certified field of a network, trained unless its `kept` hidden layers serve."""
        spec, domain = points.spec, self.case.surface.domain
        check_balance(self.case, area_rule(domain, self.problem.focal, spec), spec, self.problem.focal)
        state, points = close_gap(self.problem, self.plan, state, points)
        self._record_state(0, state)
        if kept:
            # One linear solve on the existing hidden layers. Challengers show if these suit the edit.
            found = self._certified_solution(state, points, "the hidden layers of the start serve here, too")
            served = found.diagnostics["challenge_gain"] <= SERVES * self.settings.tolerance
            if served and found.unsettled is None:
                return found
        ending = "the network is too wide for training"
        if train_it:
            state, ending = train(self.problem, self.plan, state, points, self._record_state)
        self._tell(self.plan.iterations, "certifying the energy on the finest quadrature")
        return self._certified_solution(state, points, ending)

    def _train_wider(self, best: NdfSolution) -> NdfSolution:
        """Return the answer of least certified energy of further networks, each wider than the one before."""
        # 1. Take the resolution of a level of `ndf-ritz`, and the scales of its features and of its challengers.
        # 2. Fit a deep network to such features, train it, and let challengers state its uncertainty.
        # 3. Until it settles, take the next level.
        planes = mirrors_by_default(self.case) if self.settings.mirrors is None else self.settings.mirrors
        mirrors = field_mirrors(self.case, self.spec.model_copy(update={"mirrors": planes}))
        first = first_level(self.case, part_resolution(self.case, mirrors))
        level: Level | None = first
        while level is not None and best.unsettled is not None:
            found = self._train_level(level, mirrors is not None)
            # A field of more energy is no better, settled or not; that of two rules differs by rounding.
            least = best.diagnostics["certified_energy"]
            if found is not None and found.diagnostics["certified_energy"] <= least + self.settings.tolerance * abs(
                least
            ):
                best = found
            level = next_level(first, level, "anew", self.settings.most_neurons)
        return replace(best, history=tuple(self.history))

    def _train_level(self, level: Level, mirrors: bool) -> NdfSolution | None:
        """Return the field of a deep network fitted to the features of a level and trained; None if it is no answer."""
        choices = {
            "stretched": True,
            "edge_stretched": True,
            "multipliers": self.spec.multipliers or MULTIPLIERS,
            "detail": level.detail,
            "slopes": "rows",
            "mirrors": mirrors,
        }
        self.spec = self.spec.model_copy(update=choices)
        resolution = level.resolution
        problem = TrainingProblem.from_case(self.case, self.spec, self.placement, resolution.rule)
        self.problem = problem = replace(problem, tally=self.problem.tally)
        points = Quadratures.from_rules(problem, resolution.rule, resolution.fine)
        inputs = problem.features.inputs
        scales = level.each_scale(inputs, self.placement)
        width = len(scales)
        inner = tuple(max(size, inputs.count) for size in self.plan.inner)
        network = deep_random_features(
            points.train.inputs[VALUE], scales, (*inner, width), self.plan.seed, self.plan.activation
        )
        self.before = self.history[-1].iteration + 1
        self._tell(0, f"training {width} neurons in the last hidden layer")
        try:
            return self._train(points.evaluate(problem, network), points, train_it=width <= WIDEST_TRAINED)
        except SolveFailure:  # the next level has more points
            return None

    def _first_state(self, start: Solution | None) -> tuple[Trained, Quadratures]:
        """Return the state before training, and its points: from the start if there is one."""
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

    def _record_state(self, iteration: int, state: Trained) -> None:
        """Add a certified state of the training to the history."""
        solution = self._solution(state, 1.0)
        solved = self.problem.tally["output layers"]
        step = Step(
            iteration=self.before + iteration,
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

    def _certified_solution(self, state: Trained, points: Quadratures, ending: str) -> NdfSolution:
        """Return the field of a state with its energy on the finest rule, and its uncertainty by challengers."""
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
        if (reason := why_exploited(gap, self.settings.largest_gap, "finest")) is not None:
            raise SolveFailure(f"{reason}; use smaller widths", solution)
        self._tell(self.plan.iterations, "letting challengers join")
        return with_uncertainty(solution, self.plan.seed, self.history)
