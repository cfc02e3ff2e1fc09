"""Solution of a case on ever finer meshes until all its quantities are converged."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_all, measure_reached
from shellbench.problems.shell.quantities.quantities import EnergyQuantity
from shellbench.problems.shell.records.path_end import cut_short
from shellbench.problems.shell.solution import checked_start
from shellbench.solvers.fem.derivatives.answer import with_derivatives
from shellbench.solvers.fem.linear import equilibrium
from shellbench.solvers.fem.linear.modes import solve_modes
from shellbench.solvers.fem.linear.symmetry import Folding
from shellbench.solvers.fem.mechanics.corners import Singularities
from shellbench.solvers.fem.mechanics.layers import layer_gradings
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.basis import CUBIC, Degree
from shellbench.solvers.fem.mesh.convergence import ASYMPTOTIC
from shellbench.solvers.fem.mesh.grading import (
    UNBROKEN,
    UNGRADED,
    Breaks,
    Cells,
    Ends,
    graded_mesh,
    singular_points,
    why_unresolved,
)
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.motion import motion
from shellbench.solvers.fem.motion.generalised_alpha import Scheme
from shellbench.solvers.fem.motion.motion_solution import MotionSolution
from shellbench.solvers.fem.path import large_displacement
from shellbench.solvers.fem.path.continuation import STEP_SHARE
from shellbench.solvers.fem.refinement import Level, balanced_share, first_level, level_cells, levels
from shellbench.solvers.fem.settings import FemSettings, takes_bubbles
from shellbench.solvers.stepping.control import SMALLEST_STEP

# Tolerances: relative uncertainty at which refinement stops, by the limit of the rate. Smaller ones cost meshes, up to
# `MOST_UNKNOWNS`. Larger ones give answers that a gate may refuse as too uncertain.
SMOOTH_TOLERANCE = 6e-7  # of a case whose loads and supports are spread out: the element converges fast
SINGULAR_TOLERANCE = 2.5e-5  # of a case with forces at points: deflections under a load need many cells
HIGHER_SINGULAR_TOLERANCE = 5e-6  # the same in degree 4 and 5, which need fewer
PRESCRIBED_TOLERANCE = 1e-9  # if nothing is solved for: finer meshes are cheap, and a known strain may be zero
MOTION_TOLERANCE = 1e-4  # of a motion: its steps in time are of second order
CONTACT_TOLERANCE = 5e-4  # with obstacles: the edge of contact may lie anywhere in a cell, and errors jump
LARGE_SMOOTH_TOLERANCE, LARGE_SINGULAR_TOLERANCE = 4e-6, 5e-4  # in the non-linear theory, where narrow loads are forces
MOST_UNKNOWNS, MOST_LARGE_UNKNOWNS = 165_000, 40_000  # of the finest mesh, in the linear and the non-linear theory
USUAL_DEGREE: Degree = 5  # if possible: it reaches 1e-6 soonest (tests/benchmarks/test_time_to_error.py)
GRADING: dict[Degree, float] = {3: 2.0, 4: 2.0, 5: 2.5}  # toward points, by default: higher degrees gain from more
FIRST_STEP, TRIAL_STEP = 1 / 8, 1 / 2  # of the path, at first; Newton's method has the last word
TRIAL_SHARE = 1 / 12  # of the path: its steps by displacement or arc length in a trial
SHORTEST_TRIAL_STEP = 0.04  # of the path: if a shorter step is needed, the trial ends
FIRST_TOUCH = 8  # most cells along a coordinate, as settings count them, where contact at finite strain begins
MOST_UNCERTAIN = 0.5  # relative uncertainty beyond which an answer is meaningless
FEWEST_TO_JUDGE = 3  # meshes after which such an answer is a failure
MOST_AGAIN = 3  # meshes like the last ones of an earlier solution, with which an edit begins
LEVEL, SHARE, MADE = "mesh_level", "mesh_share", "meshes"  # diagnostics: of the last mesh, and how many there were
FORGIVEN = 1  # meshes at the start of a sequence that may be too coarse to follow a path to its end
SHARE_OUT = EnergyQuantity(name="strain_energy", kind="strain_energy", primary=True)  # the only quantity of a trial

Gradings = tuple[Ends, tuple[Breaks, Breaks]]  # toward edges, and toward ends of their parts
OnMesh = Callable[[Cells], equilibrium.Equilibrium]


def solve(
    case: Case, chosen: FemSettings, start: Solution | None, progress: ProgressCallback
) -> FemSolution | MotionSolution:
    """Solve a case; see `shellbench.solvers.fem.solver.FemSolver`."""
    begin = None if start is None else checked_start(start, case, "fem", FemSolution)
    # the matrices are small: more threads gain nothing, and on a machine in use they wait for each other
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):
        if case.dynamics is not None:
            return _solve_motion(case, chosen, progress)
        return _refine(case, chosen, begin, progress)


def _solve_motion(case: Case, chosen: FemSettings, progress: ProgressCallback) -> MotionSolution:
    scheme = Scheme(chosen.spectral_radius)
    mesh = (chosen.cells, chosen.time_step, scheme, chosen.grading or GRADING[CUBIC], chosen.quadrature_order)
    return motion.solve(case, *mesh, chosen.tolerance or MOTION_TOLERANCE, progress)


def _refine(case: Case, chosen: FemSettings, start: FemSolution | None, progress: ProgressCallback) -> FemSolution:
    # 1. Choose gradings, tolerance and the largest mesh, and let trials share out the cells.
    # 2. Solve on ever finer meshes; record each one in the history.
    # 3. Stop when the largest uncertainty is within the tolerance, or the next mesh would be too large.
    # 4. Refuse an answer whose uncertainty exceeds `MOST_UNCERTAIN` after several meshes.
    began = time.perf_counter()
    # Meshes of the non-linear theory are not graded toward edges: this would slow down their steps.
    graded = case.linear and chosen.grading != 1 and not case.prescribed
    toward, slowest = _gradings(case) if graded else ((UNGRADED, UNBROKEN), ASYMPTOTIC)
    solve_on, trials = _solvers_on_meshes(case, chosen, toward, start, progress)
    tolerance = chosen.tolerance or usual_tolerance(case, case_degree(case, chosen))
    solved_once = case.linear or case.prescribed  # or never: where all is prescribed
    largest = chosen.max_unknowns or (MOST_UNKNOWNS if solved_once else MOST_LARGE_UNKNOWNS)
    steps: list[Step] = []
    differences: list[dict[str, Any]] = []
    coarsest: list[int] = []
    solution: FemSolution | None = None
    try:
        meshes = _Meshes.of_case(case, chosen, toward, trials, start)
        forgiven = 0 if case.linear or chosen.cells else FORGIVEN
        on_mesh = partial(with_derivatives, solve_on)
        for level in levels(case, iter(meshes), on_mesh, _measure, forgiven, slowest):
            seconds = time.perf_counter() - began
            found = level.equilibrium
            unknowns, cells = found.solution.parameters, list(found.solution.mesh.cells)
            newton = sum(step.iterations or 0 for step in found.solution.history) or 1
            potential, at = found.potential_energy, case.states[-1]
            steps.append(Step(len(steps), seconds, potential, unknowns, at, None, level.quantities, iterations=newton))
            if level.difference is not None:
                differences.append({"cells": cells, "largest_difference": level.difference})
            # The number of cells along a coordinate is rounded: a mesh that refines only the other one does not count.
            coarsest = coarsest or cells
            refined = all(now > then for now, then in zip(cells, coarsest, strict=True))
            converged = level.error <= tolerance and refined
            solution = _with_estimates(level, tuple(steps), differences, tolerance, converged, chosen)
            solution = solution.with_description(diagnostics={**solution.diagnostics, **meshes.diagnostics})
            progress(Progress(len(steps), None, f"{cells[0]} x {cells[1]} cells, error {level.error:.1e}"))
            size = found.solution.mesh.dof_count if case.prescribed else unknowns  # nothing is solved for, or some
            if converged or 2 * size > largest:
                break
    except SolveFailure as failure:
        raise SolveFailure(str(failure), partial=solution or failure.partial) from None
    except MemoryError:
        raise SolveFailure("the next mesh does not fit into memory", partial=solution) from None
    except np.linalg.LinAlgError:
        raise SolveFailure("the surface's metric is singular at a quadrature point", partial=solution) from None
    assert solution is not None  # there is always a first mesh
    if len(steps) >= FEWEST_TO_JUDGE and level.error > MOST_UNCERTAIN:
        finest = "{} x {}".format(*solution.mesh.cells)
        slowest_one = max(level.errors, key=level.errors.__getitem__)
        raise SolveFailure(
            f"the meshes do not resolve the shell: on the finest one, {finest} cells, {slowest_one} is uncertain by"
            f" {level.error:.0%} of its scale",
            partial=solution,
        )
    return solution


def _gradings(case: Case) -> tuple[Gradings, float]:
    """Return the gradings toward corners, thin layers and breaks of supports, and the slowest rate of the energy."""
    found = Singularities.of_case(case)
    corners, rate = found.edge_gradings, found.slowest_rate
    if case.modal:  # waves of modes have the same length all over the shell
        return (corners, found.break_gradings), rate
    # Edges that end at singular corners are graded for these: stronger grading would lack cells where layers cross the
    # shell.
    (a, b), (c, d) = np.where(np.array(corners) > 1, corners, layer_gradings(case)).tolist()
    return (((a, b), (c, d)), found.break_gradings), rate


def usual_tolerance(case: Case, degree: Degree) -> float:
    """Return the default relative uncertainty at which a case counts as converged."""
    if case.obstacles:
        return CONTACT_TOLERANCE
    if case.prescribed and degree > CUBIC:
        return PRESCRIBED_TOLERANCE
    if case.linear:
        singular = SINGULAR_TOLERANCE if degree == CUBIC else HIGHER_SINGULAR_TOLERANCE
        return singular if singular_points(case) else SMOOTH_TOLERANCE
    narrow = any(f.role == "load" and f.division.narrow.any() for f in case.features)
    return LARGE_SINGULAR_TOLERANCE if narrow or singular_points(case) else LARGE_SMOOTH_TOLERANCE


def case_degree(case: Case, settings: FemSettings) -> Degree:
    """Return the degree of the basis that a case is solved in."""
    return settings.degree or (USUAL_DEGREE if takes_bubbles(case) else CUBIC)


def _mesh(
    case: Case,
    cells: Cells,
    settings: FemSettings,
    degree: Degree,
    ends: Ends = UNGRADED,
    breaks: tuple[Breaks, Breaks] = UNBROKEN,
) -> TensorMesh:
    return graded_mesh(case, cells, settings.grading or GRADING[degree], ends, breaks, degree)


def _solvers_on_meshes(
    case: Case, settings: FemSettings, toward: Gradings, start: FemSolution | None, progress: ProgressCallback
) -> tuple[OnMesh, tuple[OnMesh, ...]]:
    """Return the function that solves a case on a mesh, and those of the trials that share out the cells.

    If a coarse mesh can't follow the path to its end, a trial in linear theory decides.
    """
    # 1. A case with a prescribed field is interpolated; one for modes is solved for modes; a linear one is solved once.
    # 2. A non-linear case follows its path on each mesh, guided by the states of the mesh before (`trail`).
    # 3. Its trial follows the path to the end alone; if that fails, the linear case at full load decides. Contact takes
    #    the path itself as the trial. Buckling has no trial, since its wave pattern depends on the mesh.
    degree = case_degree(case, settings)

    def linear(of: Case) -> OnMesh:
        touched: FemSolution | None = None
        folding = Folding(of)

        def solve(cells: Cells) -> equilibrium.Equilibrium:
            mesh = _mesh(of, cells, settings, degree, *toward)
            order = max(settings.quadrature_order, 2 * mesh.degree + 1)
            folded = folding.fold(mesh, order) if settings.symmetry and not mesh.folds else None
            how = of.states, order, settings.direct_solver
            if of.obstacles:  # the search of contact starts from that of the mesh before
                nonlocal touched
                found = equilibrium.solve(of, mesh, *how, touched)
                touched = found.solution
            elif folded is None:
                found = equilibrium.solve(of, mesh, *how)
            else:
                found = folding.unfold(folded, equilibrium.solve(folded.part.case, folded.mesh, *how))
            # one step, for the quantity that reads the energy of the history
            alone = Step(0, 0.0, found.potential_energy, found.solution.parameters, of.states[-1])
            return replace(found, solution=replace(found.solution, history=(alone,)))

        return solve

    if case.prescribed:

        def interpolate(cells: Cells) -> equilibrium.Equilibrium:
            mesh = _mesh(case, cells, settings, degree)
            return large_displacement.interpolate_prescribed(case, mesh, max(settings.quadrature_order, 2 * degree + 1))

        return interpolate, (interpolate,)

    if case.modal:

        def vibrate(cells: Cells) -> equilibrium.Equilibrium:
            mesh = _mesh(case, cells, settings, degree, *toward)
            return solve_modes(case, mesh, max(settings.quadrature_order, 2 * degree + 1), settings.direct_solver)

        return vibrate, (vibrate,)

    if case.linear:
        return linear(case), (linear(case),)

    def nonlinear(
        of: Case,
        first_step: float,
        shortest_step: float = SMALLEST_STEP,
        share: float = STEP_SHARE,
        earlier: FemSolution | None = None,
        trial: bool = False,
    ) -> OnMesh:
        trail: FemSolution | None = None

        def follow(cells: Cells) -> equilibrium.Equilibrium:
            nonlocal trail
            if of.obstacles and not (trail or earlier) and max(cells) > FIRST_TOUCH:
                # in each iteration a few points come into contact: the first mesh has few of them
                with contextlib.suppress(SolveFailure):
                    follow((max(1, cells[0] // 2), max(1, cells[1] // 2)))
            mesh = _mesh(of, cells, settings, degree)

            def tell(t: float) -> None:
                progress(Progress(0, None, f"{mesh.cells[0]} x {mesh.cells[1]} cells, load factor {t:.4g}"))

            steps = first_step, shortest_step
            order, begin = settings.quadrature_order, trail or earlier
            try:
                found, trail = large_displacement.solve(of, mesh, order, steps, begin, tell, share)
            except large_displacement.PathEndedError as end:
                if trial:
                    raise
                return replace(end.equilibrium, solution=cut_short(end.equilibrium.solution, str(end)))
            return found

        return follow

    if case.buckles:  # the wave pattern of buckling is found again on each mesh
        return (lambda cells: nonlinear(case, FIRST_STEP)(cells)), ()
    if case.obstacles:
        touching = nonlinear(case, FIRST_STEP)
        return touching, (touching,)
    last = case.model_copy(update={"path": case.path.model_copy(update={"states": (case.path.until,)})})
    if case.path.control == "load":  # a trial needs the end of the path only
        last = last.model_copy(update={"quantities": (SHARE_OUT.model_copy(update={"at": case.path.until}),)})
    unbent = linear(last.model_copy(update={"theory": "kirchhoff-love-linear"}))
    if start is not None and case.path.quantity is not None:
        what = "it does on paths under load only"
        raise InputError(f"fem can't go on from an earlier solution in {case.name}: {what}")
    trial = nonlinear(last, TRIAL_STEP, SHORTEST_TRIAL_STEP, TRIAL_SHARE, trial=True)
    return nonlinear(case, FIRST_STEP, earlier=start), (trial, unbent)


def _measure(solution: FemSolution) -> Mapping[str, float]:
    if solution.unsettled is not None:
        return measure_reached(solution)
    try:
        return measure_all(solution)
    except ValueError as error:  # the path lacks the state of a quantity
        raise SolveFailure(str(error), partial=solution) from None


@dataclass
class _Meshes:
    """The cells of the meshes to solve on, one after the other.

    Attributes
    ----------
    cells
        The only mesh's cells, if given.
    first, share, degree
        See `shellbench.solvers.fem.refinement.level_cells`; levels begin at `first`.
    made
        Number of meshes so far.
    """

    cells: Cells | None
    first: int
    share: int
    degree: Degree
    made: int = 0

    @classmethod
    def of_case(
        cls,
        case: Case,
        settings: FemSettings,
        toward: Gradings,
        trials: tuple[OnMesh, ...],
        start: FemSolution | None,
    ) -> _Meshes:
        """Let trials share out the cells, unless settings give the cells, or an earlier solution the shares."""
        degree = case_degree(case, settings)
        if settings.cells:
            return cls(settings.cells, 0, 0, degree)
        known = start.diagnostics if start is not None and start.mesh.degree == degree else {}
        if SHARE in known:
            # Take as many meshes as the start has taken, at most three: fewer give a worse estimate of the error, which
            # costs more.
            return cls(None, known[LEVEL] - min(known[MADE], MOST_AGAIN) + 1, known[SHARE], degree)
        first = first_level(lambda cells: _mesh(case, cells, settings, degree, *toward).dof_count, degree)
        share = 0  # unless a trial on coarse meshes gives another one; a failed trial is ignored
        for trial in trials:
            with contextlib.suppress(SolveFailure):
                share = balanced_share(trial, first - 1, degree)
                break
        return cls(None, first, share, degree)

    def __iter__(self) -> Iterator[Cells]:
        """Yield cells of ever finer meshes, or only those of the settings."""
        if self.cells is not None:
            yield self.cells
            return
        while True:
            self.made += 1
            yield level_cells(self.first + self.made - 1, self.share, self.degree)

    @property
    def diagnostics(self) -> dict[str, int]:
        """Diagnostics of the meshes, for solutions that start from this one."""
        return {} if self.cells else {LEVEL: self.first + self.made - 1, SHARE: self.share, MADE: self.made}


def _with_estimates(
    level: Level,
    steps: tuple[Step, ...],
    differences: list[dict[str, Any]],
    tolerance: float,
    converged: bool,
    settings: FemSettings,
) -> FemSolution:
    found = level.equilibrium
    known = {name: e for name, e in level.estimates.items() if len(steps) > 1}
    path = () if found.solution.case.linear else found.solution.history
    began = steps[-1].seconds - path[-1].seconds if path else 0.0  # when the last mesh was begun
    states = tuple(replace(s, iteration=len(steps) + s.iteration, seconds=began + s.seconds) for s in path)
    return found.solution.with_description(
        history=(*steps, *states),
        uncertainty={name: e.uncertainty for name, e in known.items()},
        extrapolated={name: e.extrapolated for name, e in known.items()},
        unsettled=found.solution.unsettled or why_unresolved(found.solution.case, found.solution.mesh),
        diagnostics={
            **found.solution.diagnostics,
            "converged": converged,
            "tolerance": tolerance,
            "relative_uncertainty": level.error if known else None,
            "not_converged": [name for name, error in level.errors.items() if not error <= tolerance],
            "cells": list(found.solution.mesh.cells),
            "rates": {name: e.rate for name, e in known.items() if e.rate is not None},
            "residual": found.residual,
            "last_correction": found.correction,
            "direct_solver": "dissection" if settings.direct_solver == "auto" else settings.direct_solver,
            "mesh_differences": list(differences),
        },
    )
