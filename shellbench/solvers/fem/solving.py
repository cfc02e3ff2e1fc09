"""Solving a case on ever finer meshes until all its quantities are converged."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.measure import measure_all
from shellbench.problems.shell.quantities import EnergyQuantity
from shellbench.solvers.fem import equilibrium, large_displacement, motion
from shellbench.solvers.fem.corners import break_gradings, edge_gradings, slowest_rate
from shellbench.solvers.fem.mesh import (
    CUBIC,
    UNBROKEN,
    UNGRADED,
    Breaks,
    Degree,
    Ends,
    TensorMesh,
    graded_mesh,
    singular_points,
)
from shellbench.solvers.fem.modes import solve_modes
from shellbench.solvers.fem.refinement import (
    ASYMPTOTIC,
    Cells,
    Level,
    balanced_share,
    first_level,
    level_cells,
    levels,
)
from shellbench.solvers.fem.solution import FemSolution, MotionSolution
from shellbench.solvers.fem.solver import FemSettings, takes_bubbles
from shellbench.solvers.fem.symmetry import FoldedMesh
from shellbench.solvers.fem.time_step import Scheme

SMOOTH_TOLERANCE = 6e-7  # of a case whose loads and supports are spread out: the element converges fast
SINGULAR_TOLERANCE = 2.5e-5  # of a case with forces at points: deflections under a load need many cells
HIGHER_SINGULAR_TOLERANCE = 5e-6  # the same in degree 4 and 5, which need fewer
MOTION_TOLERANCE = 1e-4  # of a motion: its steps in time are of second order
LARGE_SMOOTH_TOLERANCE, LARGE_SINGULAR_TOLERANCE = 4e-6, 5e-4  # the same in the non-linear theory
MOST_UNKNOWNS, MOST_LARGE_UNKNOWNS = 165_000, 40_000  # of the finest mesh, in the linear and the non-linear theory
USUAL_DEGREE: Degree = 5  # where it is taken: reaches 1e-6 soonest (tests/benchmarks/test_time_to_error.py)
GRADING: dict[Degree, float] = {3: 2.0, 4: 2.0, 5: 2.5}  # toward points, usually: higher degrees gain from more
FIRST_STEP, TRIAL_STEP = 1 / 8, 1 / 2  # of the path, at first; Newton's method has the last word
SHORTEST_STEP, SHORTEST_TRIAL_STEP = 1e-4, 0.04  # of the path: where a shorter one were needed, the path ends
MOST_UNCERTAIN = 0.5  # relative uncertainty beyond which an answer says nothing
FEWEST_TO_JUDGE = 3  # meshes after which such an answer is a failure
FORGIVEN = 1  # meshes at the start of a sequence that may be too coarse to follow a path to its end
SHARE_OUT = EnergyQuantity(name="strain_energy", kind="strain_energy", primary=True)  # all that a trial is asked for

Gradings = tuple[Ends, tuple[Breaks, Breaks]]  # toward edges, and toward ends of their parts
OnMesh = Callable[[Cells], equilibrium.Equilibrium]


def solve(case: Case, chosen: FemSettings, progress: ProgressCallback) -> FemSolution | MotionSolution:
    """Solve a case; see `shellbench.solvers.fem.solver.FemSolver`."""
    # the matrices are small: more threads gain nothing, and on a machine in use they wait for each other
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):
        if case.dynamics is not None:
            return _moved(case, chosen, progress)
        return _refined(case, chosen, progress)


def _moved(case: Case, chosen: FemSettings, progress: ProgressCallback) -> MotionSolution:
    scheme = Scheme(chosen.spectral_radius)
    mesh = (chosen.cells, chosen.time_step, scheme, chosen.grading or GRADING[CUBIC], chosen.quadrature_order)
    return motion.solve(case, *mesh, chosen.tolerance or MOTION_TOLERANCE, progress)


def _refined(case: Case, chosen: FemSettings, progress: ProgressCallback) -> FemSolution:
    began = time.perf_counter()
    # Meshes of the non-linear theory are not graded toward edges: their steps would suffer.
    graded = case.linear and chosen.grading != 1 and not case.prescribed
    toward = (edge_gradings(case), break_gradings(case)) if graded else (UNGRADED, UNBROKEN)
    slowest = slowest_rate(case) if graded else ASYMPTOTIC
    on_mesh, trials = _solves(case, chosen, toward, progress)
    tolerance = chosen.tolerance or usual_tolerance(case, case_degree(case, chosen))
    largest = chosen.max_unknowns or (MOST_UNKNOWNS if case.linear else MOST_LARGE_UNKNOWNS)
    steps: list[Step] = []
    differences: list[dict[str, Any]] = []
    coarsest: list[int] = []
    solution: FemSolution | None = None
    try:
        meshes = _meshes(case, chosen, toward, trials)
        forgiven = 0 if case.linear or chosen.cells else FORGIVEN
        for level in levels(case, meshes, on_mesh, _measured, forgiven, slowest):
            seconds = time.perf_counter() - began
            found = level.equilibrium
            unknowns, cells = found.solution.parameters, list(found.solution.mesh.cells)
            steps.append(
                Step(len(steps), seconds, found.potential_energy, unknowns, case.states[-1], None, level.quantities)
            )
            if level.difference is not None:
                differences.append({"cells": cells, "largest_difference": level.difference})
            # The number of cells along a coordinate is rounded: a mesh that refines the other alone says nothing of it.
            coarsest = coarsest or cells
            refined = all(now > then for now, then in zip(cells, coarsest, strict=True))
            converged = level.error <= tolerance and refined
            solution = _finished(level, tuple(steps), differences, tolerance, chosen)
            progress(Progress(len(steps), None, f"{cells[0]} x {cells[1]} cells, error {level.error:.1e}"))
            if converged or 2 * unknowns > largest:
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
        raise SolveFailure(
            f"the meshes do not resolve the shell: on the finest one, {finest} cells, some quantity is uncertain by"
            f" {level.error:.0%} of itself",
            partial=solution,
        )
    return solution


def usual_tolerance(case: Case, degree: Degree) -> float:
    """Return the relative uncertainty at which a case counts as converged, unless a setting says otherwise."""
    if case.linear:
        singular = SINGULAR_TOLERANCE if degree == CUBIC else HIGHER_SINGULAR_TOLERANCE
        return singular if singular_points(case) else SMOOTH_TOLERANCE
    return LARGE_SINGULAR_TOLERANCE if singular_points(case) else LARGE_SMOOTH_TOLERANCE


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


def _solves(
    case: Case, settings: FemSettings, toward: Gradings, progress: ProgressCallback
) -> tuple[OnMesh, tuple[OnMesh, ...]]:
    """Return how a case is solved on a mesh, and how trials are made that share out the cells.

    Where a coarse mesh can't follow the path to its end, a trial in linear theory decides.
    """
    degree = case_degree(case, settings)

    def linear(of: Case) -> OnMesh:
        def solve(cells: Cells) -> equilibrium.Equilibrium:
            mesh = _mesh(of, cells, settings, degree, *toward)
            order = max(settings.quadrature_order, 2 * mesh.degree + 1)
            folded = FoldedMesh.from_case(of, mesh, order) if settings.symmetry else None
            how = of.states, order, settings.direct_solver
            if folded is None:
                return equilibrium.solve(of, mesh, *how)
            return folded.unfolded(equilibrium.solve(folded.part.case, folded.mesh, *how))

        return solve

    if case.prescribed:

        def interpolate(cells: Cells) -> equilibrium.Equilibrium:
            mesh = _mesh(case, cells, settings, degree)
            return large_displacement.prescribed(case, mesh, settings.quadrature_order)

        return interpolate, (interpolate,)

    if case.modal:

        def vibrate(cells: Cells) -> equilibrium.Equilibrium:
            mesh = _mesh(case, cells, settings, degree, *toward)
            return solve_modes(case, mesh, max(settings.quadrature_order, 2 * degree + 1), settings.direct_solver)

        return vibrate, (vibrate,)

    if case.linear:
        return linear(case), (linear(case),)

    def nonlinear(of: Case, first_step: float, shortest_step: float = SHORTEST_STEP) -> OnMesh:
        trail: FemSolution | None = None

        def follow(cells: Cells) -> equilibrium.Equilibrium:
            nonlocal trail
            mesh = _mesh(of, cells, settings, degree)

            def tell(t: float) -> None:
                progress(Progress(0, None, f"{mesh.cells[0]} x {mesh.cells[1]} cells, load factor {t:.4g}"))

            steps = first_step, shortest_step
            found, trail = large_displacement.solve(of, mesh, settings.quadrature_order, steps, trail, tell)
            return found

        return follow

    if case.path.after_buckling == "follow":  # which wave pattern a shell buckles into is found anew on each mesh
        return (lambda cells: nonlinear(case, FIRST_STEP)(cells)), ()
    last = case.model_copy(update={"path": case.path.model_copy(update={"states": (case.path.until,)})})
    if case.path.control == "load":  # a trial needs the end of the path only
        last = last.model_copy(update={"quantities": (SHARE_OUT.model_copy(update={"at": case.path.until}),)})
    unbent = linear(last.model_copy(update={"theory": "kirchhoff-love-linear"}))
    return nonlinear(case, FIRST_STEP), (nonlinear(last, TRIAL_STEP, SHORTEST_TRIAL_STEP), unbent)


def _measured(solution: FemSolution) -> Mapping[str, float]:
    try:
        return measure_all(solution)
    except ValueError as error:  # the path lacks a point that a quantity is asked at
        raise SolveFailure(str(error), partial=solution) from None


def _meshes(case: Case, settings: FemSettings, toward: Gradings, trials: tuple[OnMesh, ...]) -> Iterator[Cells]:
    """Yield the cells of the meshes to solve on; the first one takes the trials that share them out."""
    if settings.cells:
        yield settings.cells
        return
    degree = case_degree(case, settings)
    first = first_level(lambda cells: _mesh(case, cells, settings, degree, *toward).dof_count, degree)
    share = 0  # unless a trial on coarse meshes says otherwise; one that fails says nothing of finer ones
    for trial in trials:
        with contextlib.suppress(SolveFailure):
            share = balanced_share(trial, first - 1, degree)
            break
    for level in itertools.count(first):
        yield level_cells(level, share, degree)


def _finished(
    level: Level,
    steps: tuple[Step, ...],
    differences: list[dict[str, Any]],
    tolerance: float,
    settings: FemSettings,
) -> FemSolution:
    found = level.equilibrium
    known = {name: e for name, e in level.estimates.items() if len(steps) > 1}
    path = found.solution.history
    began = steps[-1].seconds - path[-1].seconds if path else 0.0  # when the last mesh was taken up
    states = tuple(replace(s, iteration=len(steps) + s.iteration, seconds=began + s.seconds) for s in path)
    return replace(
        found.solution,
        history=(*steps, *states),
        uncertainty={name: e.uncertainty for name, e in known.items()},
        extrapolated={name: e.extrapolated for name, e in known.items()},
        diagnostics={
            "converged": level.error <= tolerance,
            "tolerance": tolerance,
            "relative_uncertainty": level.error if known else None,
            "cells": list(found.solution.mesh.cells),
            "rates": {name: e.rate for name, e in known.items() if e.rate is not None},
            "residual": found.residual,
            "last_correction": found.correction,
            "direct_solver": "dissection" if settings.direct_solver == "auto" else settings.direct_solver,
            "mesh_differences": list(differences),
        },
    )
