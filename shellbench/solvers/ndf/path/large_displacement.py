"""A case at finite strain: the path of equilibrium from rest for the output layer of given features.

Ever finer levels of features are solved until the certified potential energy at the end of the path settles. Without a
reference, this energy shows that a field is rich enough for the shell's deformation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.problems.shell.records.path_end import cut_short
from shellbench.problems.shell.variants.edit import between
from shellbench.solvers.ndf.field.build import build_ansatz
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.factors import turns_clamps
from shellbench.solvers.ndf.field.quadrature import area_rule
from shellbench.solvers.ndf.field.supports import check_balance
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.path.buckling import follow_steps
from shellbench.solvers.ndf.path.continuation import arc_length_steps, displacement_steps, load_steps
from shellbench.solvers.ndf.path.edited import states_of_edit
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.levels import PathLevel, disagreement, state_solution
from shellbench.solvers.ndf.path.newton import Deformed, PathState, equilibrium
from shellbench.solvers.ndf.path.path_challenge import challenge_path, with_quadrature_error
from shellbench.solvers.ndf.strains.energy import why_exploited
from shellbench.solvers.stepping.control import NotConvergedError, PathEndsError, equal_marks

Training = Callable[[PathLevel, PathProblem, Sequence[PathState]], PathLevel | None]
"""Returns a level with hidden layers trained at states of its path, or None if nothing is gained."""

SETTLED_PATH = 2e-4  # relative change of the certified energy from level to level; the finer one lacks far less


def solve(
    case: Case,
    spec: FieldSpec,
    solver: str,
    levels: Sequence[Callable[[], PathLevel]],
    largest_gap: float,
    seed: int | None,
    progress: ProgressCallback,
    start: PathSolution | None = None,
    train: Training | None = None,
) -> PathSolution:
    """Follow the path of a case with ever finer features until its energy settles, or there are no finer ones.

    `seed` draws the challengers that estimate the path's uncertainty; with None no uncertainty is stated. `start` is an
    earlier path on the features of the first level: states begin at its own, and its energy counts as settled if it
    was. If `train` returns a better level for a path's states, the path is followed again with it.

    Raises
    ------
    SolveFailure
        If the finest path ends early, or a field exploits its quadrature; the states up to there come with it.
    InputError
        If the loads are not in balance.
    """
    # 1. Follow the path on the next level, with the states of the level before as guesses.
    # 2. Compare the certified energies of the two levels at the end of the path.
    # 3. Stop when their change is small; a failed coarse level is skipped.
    # 4. Let challengers state the uncertainty.
    began = time.perf_counter()
    history: list[Step] = []
    before: float | None = None
    change: float | None = None
    solution: PathSolution | None = None
    stood = start is not None and bool(start.diagnostics.get("settled"))
    coarse: _Run | None = None
    for number, build in enumerate(levels):
        run = _Run(case, spec, solver, build(), began, largest_gap, progress, None if number else start)
        try:
            solution = run.solve(coarse)
            energy = solution.diagnostics["certified_energy"]
        except SolveFailure as failure:
            if number == len(levels) - 1:  # the coarser field's path is kept, but not taken as the answer
                raise SolveFailure(str(failure), solution or failure.partial) from None
            before = coarse = None
            continue
        if train and (level := train(run.level, run.problem, run.states)) is not None:
            trained = _Run(case, spec, solver, level, began, largest_gap, progress)
            with suppress(SolveFailure):  # then the path of the drawn layers stays
                found = trained.solve(coarse)
                if found.diagnostics["certified_energy"] < energy:
                    solution, run = found, trained
        coarse = run
        # Levels are compared before training: a trained level and the next one may agree by chance.
        if before is not None:
            magnitude = sum(solution.energies()) + abs(sum(solution.energies()) - energy)
            change = abs(energy - before) / magnitude if magnitude else 0.0
        before = energy
        history.append(run.level_step(len(history), solution))
        if stood and start is not None:
            change = start.diagnostics["energy_change"]
        if run.prescribed or (change is not None and change <= SETTLED_PATH):
            break
    assert solution is not None  # there is a level, and the last one would have raised
    states = tuple(replace(s, iteration=len(history) + s.iteration) for s in solution.history)
    diagnostics = {
        **solution.diagnostics,
        "energy_change": change,
        "settled": run.prescribed or (change is not None and change <= SETTLED_PATH),
    }
    whole = replace(solution, history=(*history, *states), diagnostics=diagnostics)
    return whole if seed is None else run.with_uncertainty(whole, seed)


class _Run:
    """One level: a path, its certificate, and its record."""

    def __init__(
        self,
        case: Case,
        spec: FieldSpec,
        solver: str,
        level: PathLevel,
        began: float,
        largest_gap: float,
        progress: ProgressCallback,
        start: PathSolution | None = None,
    ) -> None:
        self.start = start
        self.case, self.spec, self.solver, self.level = case, spec, solver, level
        self.began, self.largest_gap, self.progress = began, largest_gap, progress
        self.prescribed = case.prescribed
        ansatz = build_ansatz(case, spec)
        rule = area_rule(case.surface.domain, level.focal, level.rule)
        for t in case.states if case.path.quantity is None else (1.0,):
            check_balance(case, rule, level.rule, level.focal, t)
        problem = PathProblem(spec, ansatz, level.features, level.rule, level.focal)
        self.problem = problem if self.prescribed else problem.independent()
        self.quantities = {q.name: q for q in case.quantities if isinstance(q, DisplacementQuantity)}
        self.rows = self._rows(0.0)
        self.controlled = self.rows.get(case.path.quantity or "")

    def solve(self, coarse: _Run | None = None) -> PathSolution:
        states: list[PathState] = []
        seconds: list[float] = []
        reason: str | None = None
        try:
            for state in self._states(coarse):
                states.append(replace(state, tangent=None))
                seconds.append(time.perf_counter() - self.began)
                self.progress(Progress(len(states), None, f"{self.problem.features.count} features, t = {state.t:.4g}"))
        except PathEndsError as error:
            reason = str(error)
        except NotConvergedError:
            reason = "the tangent stiffness is singular"
        if not states:
            raise SolveFailure(f"{reason}: no state beyond rest converged")
        self.states = states
        solution = self._build_solution(states, seconds, complete=reason is None)
        if reason is not None:
            solution = cut_short(solution, f"{reason}; the last converged load factor is {states[-1].t:.6g}")
        if (reason := why_exploited(solution.diagnostics["energy_gap"], self.largest_gap)) is not None:
            raise SolveFailure(reason, solution)
        return solution

    def with_uncertainty(self, solution: PathSolution, seed: int) -> PathSolution:
        """Return the path with the uncertainty of its quantities."""
        if self.prescribed:
            return with_quadrature_error(solution, self.problem.rounding_energy)
        if self.case.path.after_buckling == "follow":
            return solution  # with neutral modes one linear solve is no estimate
        return challenge_path(self.problem, self.states, solution, self.level.resolution, seed, self._field)

    def level_step(self, iteration: int, solution: PathSolution) -> Step:
        """Return one step for the whole level."""
        gap = solution.diagnostics["energy_gap"]
        return replace(solution.history[-1], iteration=iteration, gap=gap, phase="solve", iterations=self.iterations)

    def _states(self, coarse: _Run | None) -> Iterator[PathState]:
        case, problem = self.case, self.problem
        if self.prescribed:
            rest = PathState.rest(problem)
            for t in case.states:
                yield PathState(t, rest.weights, problem.deform(rest.weights, t))
            return
        if case.linear:
            for t in case.states:
                yield equilibrium(problem, PathState.rest(problem), t)
            return
        if self.start is not None:
            yield from states_of_edit(problem, self._edited_problem, self.start, case.states)
            return
        match case.path.control:
            case "load" if case.buckles:
                yield from follow_steps(problem, case.path_marks, coarse.fit_states(problem) if coarse else ())
            case "load":
                yield from load_steps(problem, case.states)
            case "displacement":
                yield from displacement_steps(problem, self._row, case.states, case.path.until)
            case "arc_length":
                yield from arc_length_steps(problem, self._row, case.states, case.path.until)

    def _edited_problem(self, share: float) -> PathProblem:
        """Return the problem at a share of the edit that leads from the start to the case."""
        assert self.start is not None
        ansatz = build_ansatz(between(self.start.case, self.case, share), self.spec)
        return PathProblem(self.spec, ansatz, self.level.features, self.level.rule, self.level.focal).independent()

    def _rows(self, t: float) -> dict[str, Tensor]:
        if t and not turns_clamps(self.case):
            return self.rows
        return {name: self.problem.functional(q, t) for name, q in self.quantities.items()}

    @property
    def _row(self) -> Tensor:
        assert self.controlled is not None
        return self.controlled

    def _build_solution(self, states: Sequence[PathState], seconds: Sequence[float], complete: bool) -> PathSolution:
        case = self.case
        marks = [s.t if self.controlled is None else float(self.controlled @ s.weights) for s in states]
        kept = []
        for mark in case.states:
            there = [k for k, value in enumerate(marks) if equal_marks(value, mark)]
            kept += there[:1]
        kept = sorted({*kept, *(k for k, state in enumerate(states) if state.critical)})
        if not complete and len(states) - 1 not in kept:
            kept.append(len(states) - 1)
        fine = replace(self.problem, rule_spec=self.level.fine)
        certified = [self._certified_state(fine, states[k]) for k in kept]
        gaps = {
            k: disagreement(states[k].deformed, deformed, self.problem.rounding_energy)
            for k, deformed in zip(kept, certified, strict=True)
        }
        fields = tuple(self._state(states[k], deformed) for k, deformed in zip(kept, certified, strict=True))
        history = tuple(
            self._step(k, state, after, gaps.get(k))
            for k, (state, after) in enumerate(zip(states, seconds, strict=True))
        )
        return PathSolution(
            marks=tuple(marks[k] for k in kept),
            states=fields,
            history=history,
            diagnostics={
                "energy_gap": float(np.max(list(gaps.values()))),
                "certified_energy": certified[-1].potential,
                "strain": self.spec.strain,
                "features": self.level.features.count,
                "independent_features": 0 if self.prescribed else self.problem.features.count,
                "neurons": self.level.features.network.width,
                "quadrature_points": len(self.problem.weights),
                "fine_quadrature_points": len(fine.weights),
                "newton_iterations": self.iterations,
            },
        )

    def fit_states(self, problem: PathProblem) -> list[PathState]:
        """Return the states at marks and the critical one, fitted to a finer problem."""
        other = replace(self.problem, rule_spec=problem.rule_spec, focal=problem.focal)
        found = []
        for state in self.states:
            if state.critical or state.t in self.case.states:
                weights = problem.fit_weights(other, state.weights)
                deformed = problem.deform(weights, state.t, self._angles(problem, state))
                found.append(replace(state, weights=weights, deformed=deformed))
        return found

    @property
    def iterations(self) -> int:
        """Newton iterations of all states."""
        return sum(state.iterations for state in self.states)

    def _certified_state(self, fine: PathProblem, state: PathState) -> Deformed:
        """Return the deformation of a state on the finer rule."""
        return fine.deform(state.weights, state.t, self._angles(fine, state))

    def _angles(self, problem: PathProblem, state: PathState) -> tuple[Tensor, ...]:
        """Return the rotation angles of a state's normals, on another problem's rule."""
        each = zip(self.problem.moments, problem.moments, state.deformed.angles, strict=True)
        return tuple(known.interpolate(angles, other) for known, other, angles in each)

    def _step(self, number: int, state: PathState, seconds: float, gap: float | None) -> Step:
        return Step(
            iteration=number,
            seconds=seconds,
            energy=state.deformed.potential,
            unknowns=0 if self.prescribed else self.problem.basis.size,
            at=state.t,
            gap=gap,
            quantities={
                name: float(row @ state.weights) + self.problem.lift_share(self.quantities[name], state.t)
                for name, row in self._rows(state.t).items()
            },
            phase="critical" if state.critical else "path",
            iterations=state.iterations,
        )

    def _state(self, state: PathState, certified: Deformed) -> NdfSolution:
        return replace(self._field(state), membrane=certified.membrane, bending=certified.bending)

    def _field(self, state: PathState) -> NdfSolution:
        """Return the solution of a state, its energies left out."""
        return state_solution(self.problem, self.level, self.solver, state)
