"""A case in motion: Newton's law for the output layer of given features, step by step from rest.

The equations of motion of the output weights are integrated by the explicit Runge-Kutta method of order eight of
Dormand and Prince with step control by its own error (Hairer, Norsett & Wanner 1993, DOP853). Cloth is soft: with the
smooth features of `smooth` the highest frequency of a napkin is near 1000 rad/s, which allows steps of some 5 ms, at
the cost of a dozen evaluations of the forces each. The alternative, an incremental potential minimised at each step by
Newton's method, takes longer steps but a matrix of all unknowns at each iteration. Measured side by side on the napkin
in its plane, 226 unknowns up to .2 s, one core, errors against tolerances of 1e-10:

    explicit, rtol 1e-5          374 evaluations     15 s    8e-8 m
    explicit, rtol 1e-7          590 evaluations     23 s    1e-9 m
    generalised-alpha, 1/120 s    48 iterations      17 s    1e-4 m
    generalised-alpha, 1/240 s    96 iterations      28 s    4e-5 m
    generalised-alpha, 1/480 s   188 iterations      62 s    2e-5 m

An iteration costs the third power of the number of unknowns, an evaluation the first. Steps shrink with the square of
the degree, and with its fourth power if bending determines them: a shell as stiff as steel would need the other scheme.

Products of placed waves (`products`) can be added during the motion: those of a higher degree begin with the present
ones, so that displacement, velocity and energy do not change. More are added when the shortest waves of the motion are
no longer small, which the field itself shows: see `needs_more_products`.

Ever finer features are tried until the motion settles; the change of the case's quantities between the last two levels
estimates their error. The integrator does not show exploitation of the quadrature. Therefore energies at the kept times
are computed again on a finer one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.records.history import moving_uncertainty
from shellbench.solvers.ndf.field.build import build_ansatz
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.jets import COMPONENTS, Array
from shellbench.solvers.ndf.field.quadrature import NOWHERE, area_rule
from shellbench.solvers.ndf.motion.integration import Stepping, StuckError, Track, integrate, padded
from shellbench.solvers.ndf.motion.motion_parts import Energies
from shellbench.solvers.ndf.motion.motion_problem import Motion
from shellbench.solvers.ndf.motion.motion_solution import Course, MotionSolution
from shellbench.solvers.ndf.motion.products import Products
from shellbench.solvers.ndf.strains.energy import why_exploited
from shellbench.solvers.ndf.strains.smooth import PANEL_ORDER, POINTS_A_DEGREE, finer, rule_of, smooth, width_for

DEGREES = (10, 13, 17, 22)  # along the longest side, of each level: each costs some four times the one before
SETTLED_MOTION = 2e-4  # change of the motion between levels, over the longest side, below which the finer one is kept
MORE_POINTS = 1.5  # times as many a degree, once a field has exploited its quadrature
MOST_POINTS = POINTS_A_DEGREE * MORE_POINTS**2  # twice more, then it gives up
TOLD_PARTS = 1000  # number of progress reports
PROBE = 21  # points a side at which motions are compared
MORE_GAUSS = 8  # Gauss points a side: few are not enough for waves of a low degree
FIRST_DEGREE = 13  # of products that follow a motion, and the growth of their degree at a time
DEGREE_GROWTH = 1.3  # as from one of `DEGREES` to the next
TOP = 0.8  # of the degree: higher degrees are the tail; neighbours are not on record
# Of the displacement, over the longest side: threshold for more features, which falls with a power of the degree.
TAIL = SETTLED_MOTION / 40
REFERENCE, TAIL_POWER = 30, 4.0
UNALLOCATED = "can't allocate memory"  # torch's message on a CPU, in a RuntimeError


@dataclass(frozen=True)
class MotionLevel:
    """Features up to a degree, of a network; Gauss points a panel, and in all as a share of the usual ones.

    With `grow`, products begin with few and follow the motion up to that degree.
    """

    degree: int
    features: Features | Products
    trained: int = 0
    order: int = PANEL_ORDER
    share: float = 1.0
    grow: bool = False

    @property
    def first(self) -> int:
        """The first degree of a motion."""
        return min(FIRST_DEGREE, self.degree) if self.grow else self.degree


def motion_levels(
    case: Case, widths: Sequence[int] | None, degrees: Sequence[int] | None = None
) -> list[tuple[int, int]]:
    """Return degrees with the widths of random features for them: given widths or degrees, or `DEGREES`."""
    if widths:
        return [(degree_of(case, width), width) for width in widths]
    return [(degree, width_for(case, degree)) for degree in degrees or DEGREES]


def degree_of(case: Case, width: int) -> int:
    """Return the degree that a width of random features represents."""
    degree = 1
    while width_for(case, degree + 1) <= width:
        degree += 1
    return degree


def solve(
    case: Case,
    spec: FieldSpec,
    solver: str,
    levels: Sequence[Callable[[], MotionLevel]],
    largest_gap: float,
    progress: ProgressCallback,
    stepping: Stepping | None = None,
) -> MotionSolution:
    """Follow a motion with ever finer features until it settles, or there are no finer ones.

    Raises
    ------
    SolveFailure
        If integration gets stuck, or a field exploits its quadrature; the motion up to there comes with it.
    """
    # Take features up to ever higher degrees until the motion settles between two of them:
    # 1. Set up equations of motion of the features, on a rule with a number of points a degree.
    # 2. Integrate from rest, and compute the energies again on a finer rule.
    # 3. If these disagree the field exploits its points: take more points for the next level, or repeat the last one.
    # 4. Compare with the level before. If a finer level fails, the level before is kept.
    # The textbook's estimate by the integrator covers time only. Here the error in space dominates, hence the
    # comparison.
    began = time.perf_counter()
    history: list[Step] = []
    before: MotionSolution | None = None
    change: float | None = None
    points = POINTS_A_DEGREE
    for number, build in enumerate(levels):
        level = build()
        kept = f"; what is kept is the whole motion of degree {before.diagnostics['degree']}" if before else ""
        while True:
            try:
                motion = prepare_motion(case, spec, level, points)
                solution = _Run(case, solver, motion, level, began, progress, stepping or Stepping(), points).solve()
            except SolveFailure as failure:  # the coarser field's result is kept, but not taken as the answer
                raise SolveFailure(f"at degree {level.degree} {failure}{kept}", before or failure.partial) from None
            except (MemoryError, RuntimeError) as error:
                if not (isinstance(error, MemoryError | torch.OutOfMemoryError) or UNALLOCATED in str(error)):
                    raise
                reason = f"the motion of degree {level.degree} does not fit into memory{kept}"
                raise SolveFailure(reason, before) from None
            exploited = why_exploited(solution.diagnostics["energy_gap"], largest_gap)
            if exploited is None:
                break
            if not points * MORE_POINTS <= MOST_POINTS:
                raise SolveFailure(f"{exploited}{kept}", before or solution)
            points *= MORE_POINTS
            # The next level integrates on the new rule anyway. Only the last one has to be repeated.
            if number < len(levels) - 1:
                break
        values = {q.name: measure(solution, q) for q in case.quantities}
        history.append(
            replace(solution.history[-1], iteration=len(history), phase="solve", iterations=None, quantities=values)
        )
        if before is not None:
            change = distance(before, solution)
            moved = {name: abs(values[name] - earlier) for name, earlier in history[-2].quantities.items()}
            solution = replace(solution, uncertainty=moving_uncertainty(case, values, moved))
        before = solution
        if change is not None and change <= SETTLED_MOTION and exploited is None:
            break
    assert before is not None  # there is a level
    settled = change is not None and change <= SETTLED_MOTION
    steps = tuple(replace(step, iteration=len(history) + step.iteration) for step in before.history)
    return replace(
        before,
        history=(*history, *steps),
        diagnostics={**before.diagnostics, "motion_change": change, "settled": settled},
    )


def prepare_motion(case: Case, spec: FieldSpec, level: MotionLevel, points: float) -> Motion:
    """Return the equations of motion of a level's features (for products, the first ones), on its rule."""
    spec = spec.model_copy(update={"t": 0.0})
    if isinstance(level.features, Products):
        return motion_of_products(case, spec, level, points, level.first)
    chosen = rule_of(case, level.degree, level.share * points, level.order)
    rule = area_rule(case.surface.domain, NOWHERE, chosen)
    features = smooth(build_ansatz(case, spec), level.features, rule, level.degree)
    return Motion(case, spec, features, chosen)


def motion_of_products(case: Case, spec: FieldSpec, level: MotionLevel, points: float, degree: int) -> Motion:
    """Return the equations of motion of products up to a degree."""
    assert isinstance(level.features, Products)
    # One panel: its points crowd at edges, where such fields vary most.
    chosen = rule_of(case, degree, level.share * points, math.ceil(level.share * points * degree) + MORE_GAUSS)
    return Motion(case, spec, level.features.up_to(degree), chosen)


def needs_more_products(motion: Motion, w: Tensor, tail: float) -> bool:
    """Return True if the displacement in the highest degrees of products exceeds `tail` times the longest side.

    As products are orthonormal in the area, the root mean square of that part of the displacement is the norm of its
    weights. This needs no quadrature, so that none can be exploited.
    """
    features = motion.features
    assert isinstance(features, Products)
    last = features.degrees > TOP * float(features.degrees[-1])
    rough = float(w.view(COMPONENTS, -1)[:, last].norm()) / math.sqrt(motion.area)
    return rough > tail * max(side_lengths(motion.case))


def distance(first: MotionSolution, second: MotionSolution) -> float:
    """Return the largest root mean square over the shell of two motions' difference, relative to the longest side."""
    case = second.case
    points = case.surface.domain.grid(PROBE, PROBE).reshape(-1, 2)
    # The comparison is at the asked times, over the whole shell: a single point may agree by chance.
    apart = [first.displacement(points, at) - second.displacement(points, at) for at in case.states]
    return max(float(np.sqrt(np.mean(np.sum(d * d, axis=-1)))) for d in apart) / max(side_lengths(case))


class _Run:
    """One level: a motion, its certificate, and its record."""

    def __init__(
        self,
        case: Case,
        solver: str,
        motion: Motion,
        level: MotionLevel,
        began: float,
        progress: ProgressCallback,
        stepping: Stepping,
        points: float,
    ) -> None:
        self.case, self.solver, self.motion, self.level = case, solver, motion, level
        self.began, self.progress, self.stepping = began, progress, stepping
        self.points = points
        self.degree = level.first
        self.growth = [[self.degree, 0.0]] if level.grow else []  # degrees, and the times from which they are used

    def solve(self) -> MotionSolution:
        track, reason, until = Track(), "", self.case.states[-1]
        finer = self._finer_motion if self.level.grow else None
        try:
            for t in integrate(self.motion, self.case.states, self.stepping, track, finer):
                done = f"degree {self.degree}, t = {t:.4g} s of {until:g} s"
                self.progress(Progress(int(TOLD_PARTS * t / until), TOLD_PARTS, done))
        except StuckError as error:
            reason = str(error)
        if len(track.times) < 2:
            raise SolveFailure(f"{reason}: no time step from rest converged")
        solution = self._build_solution(track)
        if reason:
            raise SolveFailure(f"{reason}; the last time reached is {track.times[-1]:.6g} s", solution)
        return solution

    def _finer_motion(self, motion: Motion, y: Array, t: float) -> Motion | None:
        """Return equations of motion with more products if the field needs them, and there are more; else None."""
        tail = TAIL * (REFERENCE / self.level.degree) ** TAIL_POWER
        w = motion.weights(motion.features.placement.tensor(y), t)
        if self.degree == self.level.degree or not needs_more_products(motion, w, tail):
            return None
        self.degree = min(math.ceil(DEGREE_GROWTH * self.degree), self.level.degree)
        self.growth.append([self.degree, t])
        return motion_of_products(self.case, motion.spec, self.level, self.points, self.degree)

    def _build_solution(self, track: Track) -> MotionSolution:
        """Return the motion up to the last accepted step, with its energies and their certificates."""
        # 1. Compute output weights with two derivatives at all accepted steps, extended to the features of the last
        #    step.
        # 2. Compute the energies on the rule of the motion, and the drift of their balance.
        # 3. Certify energies on the finer rule at the marks.
        motion, placement = track.motions[-1], self.motion.features.placement
        # Keep weights, rates and accelerations at each step for quintic Hermite interpolation in time.
        outputs = [
            [by.weights(placement.tensor(state[order]), t, order) for order in range(3)]
            for by, t, (state, _) in zip(track.motions, track.times, track.states, strict=True)
        ]
        energies = [by.energies(o[0], o[1], t) for by, t, o in zip(track.motions, track.times, outputs, strict=True)]
        weights, rates, seconds = (torch.stack([padded(o[k], motion).view(3, -1) for o in outputs]) for k in range(3))
        # Energy less work since rest: zero for exact integration in time, for any features.
        lost = [e.total - work for e, (_, work) in zip(energies, track.states, strict=True)]
        solution = MotionSolution(
            case=self.case,
            solver=self.solver,
            spec=motion.spec,
            features=motion.features,
            course=Course(np.array(track.times), weights, rates, seconds),
            rule=finer(motion.rule_spec),
            parameters=motion.basis.size + self.level.trained,
        )
        gaps = {k: _gap(energies[k], solution.balance(track.times[k])) for k in self._marks(track)}
        before = [0, *track.evaluations]
        history = tuple(
            Step(
                iteration=k - 1,
                seconds=track.seconds[k] - self.began,
                energy=lost[k],
                unknowns=track.motions[k].basis.size,
                at=track.times[k],
                gap=gaps.get(k),
                phase="time",
                iterations=track.evaluations[k] - before[k],
            )
            for k in range(1, len(track.times))
        )
        return replace(
            solution,
            history=history,
            diagnostics={
                "energy_gap": float(np.max(list(gaps.values()))),
                "energy_drift": max(abs(value) for value in lost),
                "strain": motion.spec.strain,
                "degree": self.degree,
                "features": self.level.features.count,
                "independent_features": motion.features.count,
                "neurons": self.level.features.network.width,
                "quadrature_points": len(motion.areas),
                "time_steps": len(history),
                "force_evaluations": track.evaluations[-1],
                "interpolation": "quintic Hermite in time",
                **({"growth": self.growth} if self.growth else {}),
            },
        )

    def _marks(self, track: Track) -> list[int]:
        """Return the steps at which energies are certified: asked times, and the last one."""
        return sorted({k for k, t in enumerate(track.times) if t in self.case.states} | {len(track.times) - 1})


def _gap(found: Energies, fine: Energies) -> float:
    """Return the difference of two strain energies, relative to the sum of all energies."""
    return abs(found.strain - fine.strain) / fine.total if fine.total else 0.0
