"""A case in motion: it is integrated in time on one mesh, and on finer meshes with shorter steps until it settles.

Halving the step divides the error in time by four. A mesh finer by the square root of two divides the error of the
fourth-order element by four. Each level does both.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.quantities.quantities import (
    ContactForce,
    EnergyQuantity,
    MotionEnergy,
    QuantityModel,
    ReactionQuantity,
    TorqueQuantity,
)
from shellbench.problems.shell.question.conditions import Rotation, Value
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.records.history import moving_uncertainty
from shellbench.solvers.fem.mesh.basis import COMPONENTS, KINDS, SAME, Derivative
from shellbench.solvers.fem.mesh.convergence import Estimate, estimate
from shellbench.solvers.fem.mesh.grading import FEWEST, SIZE_POINTS, Cells, axis_lines, graded_mesh, shell_size
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.motion.generalised_alpha import Instant, Scheme
from shellbench.solvers.fem.motion.motion_solution import MotionSolution
from shellbench.solvers.fem.motion.time_step import MovingShell
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]

FIRST: tuple[Derivative, Derivative] = ((1, 0), (0, 1))
BASE = 12  # cells of the coarsest mesh along the longer side
# Of a cell of the coarsest mesh that a membrane wave crosses in one step. A longer step does not follow such waves; a
# shorter one costs time.
COURANT = 0.3
FEWEST_STEPS, MOST_STEPS = 100, 1000  # of the coarsest level, whatever the speed of waves
ORDER = 2.0  # of the errors in the number of cells: the fourth in the size of one
# In log2 of a growth: allowed departure, by whole numbers of cells, from a level's growth by the root of two a side.
# Set with `contact_bar`, whose meshes grow unevenly; without an observed rate its stated uncertainty is 34 % instead of
# 3 %.
WHOLE = 0.1
MOST_LEVELS = 3  # from three values on the rate is observed
MOST_WORK = 400_000  # cells times steps: no level that takes more is begun
# Relative uncertainty after two levels beyond which a third one would be of no use: the motion depends on its meshes.
UNPREDICTABLE = 0.05
# Of the shell's size: a motion of at most this size is compared with itself.
HARDLY = 1e-2
SHORTEST = 2.0**-8  # of the usual step: if a shorter one is needed, the run ends
# Local error of a step in the displacement, relative to the size of the shell, beyond which it is cut. Less costs
# steps.
SMOOTH = 1e-3
ROOM = 1 / 16  # of that error, below which the next step may be twice as long, up to the usual one
FRAMES = 240  # instants that are kept of a run, evenly; between them the motion is interpolated


def why_declined(case: Case) -> str | None:
    """Return the property of a case in motion that fem can't take, as a clause, or None."""
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it can't follow moments on edges in time"
    if case.following:
        return "its pressures keep the normal of the shell at rest in time"
    if case.obstacles and case.dynamics is not None and case.dynamics.damped:
        return "it damps no motion beside obstacles"
    for support in case.supports:
        if support.clamped and isinstance(support.motion, Value):
            return f"it can't move the clamped support '{support.name}' by a formula in time"
        if support.clamped and isinstance(support.motion, Rotation) and case.obstacles:
            return f"it can't turn the clamped support '{support.name}' beside obstacles in time"
    return None


def usual_cells(case: Case, level: int, grading: float) -> Cells:
    """Return the cells of a level, as counted by `mesh.axis_lines`: fewer along the shorter coordinate lines."""
    domain = case.surface.domain
    x = case.surface.derivatives(domain.grid(SIZE_POINTS, SIZE_POINTS), order=1)
    sides = [size * float(np.linalg.norm(x[key], axis=-1).mean()) for size, key in zip(domain.size, FIRST, strict=True)]
    counts = []
    for axis, side in enumerate(sides):
        aim = max(FEWEST, round(BASE * 2 ** (level / 2) * side / max(sides)))
        # `axis_lines` counts cells of the longest part only: find the least request that gives `aim` cells in all.
        counts.append(next(n for n in count(FEWEST) if len(axis_lines(case, axis, n, grading)) > aim))
    return counts[0], counts[1]


def usual_step(case: Case) -> float:
    """Return the step in time of the coarsest level, s: a share of the time in which a wave crosses one of its cells.

    Membrane waves travel at sqrt(D / rho); in cloth they are slow enough to be visible.
    """
    assert case.dynamics is not None
    speed = math.sqrt(case.material.membrane_stiffness / case.material.areal_density)
    # An implicit step is stable at any Courant number. The bound serves to resolve the wave.
    crossing = shell_size(case) / BASE / speed
    until = case.dynamics.until
    steps = math.ceil(until / (COURANT * crossing))
    return until / min(max(steps, FEWEST_STEPS), MOST_STEPS)


def solve(
    case: Case,
    cells: Cells | None,
    step: float | None,
    scheme: Scheme,
    grading: float,
    quadrature_order: int,
    tolerance: float,
    progress: ProgressCallback,
) -> MotionSolution:
    """Follow a motion on finer and finer levels until every quantity has settled.

    Parameters
    ----------
    case
        The case in motion.
    cells, step
        Mesh and step in time of the only level; if one of them is None it is the usual one; if both are None, levels
        are refined.
    scheme
        Of the steps in time.
    grading, quadrature_order
        Of the meshes.
    tolerance
        Uncertainty, relative to a quantity's scale, at which it counts as settled.
    progress
        Called with the progress of the steps.

    Raises
    ------
    SolveFailure
        If a step in time can't be cut further; the motion up to there, or that of a coarser level, comes with it.
    """
    assert case.dynamics is not None
    began = time.perf_counter()
    # Levels refine space and time at once, so that one sequence of values converges at one order, h^2:
    # 1. Choose mesh and step of the level; stop before one that takes too long.
    # 2. Follow the motion, and measure its quantities.
    # 3. Extrapolate in 1 / h, and compare the largest uncertainty with the tolerance.
    # 4. Stop if two levels differ so much that a third would be of no use.
    only = cells is not None or step is not None
    values: dict[str, list[float]] = {q.name: [] for q in case.quantities}
    levels: list[Step] = []
    resolutions: list[float] = []
    meshes: list[float] = []
    solution: MotionSolution | None = None
    for level in range(1 if only else MOST_LEVELS):
        mesh_cells = cells or usual_cells(case, level, grading)
        h = step or usual_step(case) / 2**level
        mesh = graded_mesh(case, mesh_cells, grading)
        if level and math.prod(mesh.cells) * case.dynamics.until / h > MOST_WORK:
            break
        # If a level fails, the complete answer of the level before stays.
        kept = f"; what is kept is the whole motion on {_cells(solution.mesh)}" if solution else ""
        try:
            found = follow(case, mesh, h, scheme, quadrature_order, progress)
        except SolveFailure as failure:
            raise SolveFailure(f"on {_cells(mesh)} {failure}{kept}", solution or failure.partial) from None
        except MemoryError:
            raise SolveFailure(f"the motion on {_cells(mesh)} does not fit into memory{kept}", solution) from None
        quantities = measure_all(found)
        # 1 / h grows by two a level. The mesh grows by its root, so that n^-4 is h^2 as well.
        grown = math.prod(mesh.cells) / math.prod(solution.mesh.cells) if solution else 1.0
        resolutions.append(1 / h)
        meshes.append(min(2.0, grown) * meshes[-1] if meshes else 1.0)
        for name, value in quantities.items():
            values[name].append(value)
        estimates = {name: estimate(v, resolutions) for name, v in values.items()}
        # Small whole numbers of cells grow by less, or not at all: changes then underestimate the error.
        last = [k for k, n in enumerate(meshes) if n not in meshes[k + 1 :]]  # the level with the least step on each
        for name, v in values.items():
            least = estimate([v[k] for k in last], _asked_refinement([meshes[k] for k in last]), ORDER).uncertainty
            estimates[name] = replace(estimates[name], uncertainty=max(estimates[name].uncertainty, least))
        scales = {q.name: _uncertainty_scale(found, q, quantities) for q in case.quantities}
        error = max(estimates[name].uncertainty / scales[name] for name in values)
        seconds = time.perf_counter() - began
        levels.append(
            Step(level, seconds, found.history[-1].energy, found.parameters, case.states[-1], None, quantities)
        )
        solution = _with_estimates(found, levels, estimates, tolerance, error, h, scheme)
        if error <= tolerance or UNPREDICTABLE < error < math.inf:
            break
    assert solution is not None  # there is a first level
    return solution


def _asked_refinement(meshes: list[float]) -> list[float]:
    """Return the refinement of meshes; three or more that grow nearly evenly count as even, without rounding."""
    # An observed rate of three meshes is sensitive to rounded numbers: 12, 18, 24 cells are meant to grow evenly. Two
    # meshes show no rate, and growth far from even is kept as it is.
    growths = np.diff(np.log2(meshes))
    asked = np.round(2 * growths) / 2  # sides that grow by the root of two
    if len(meshes) < 3 or not asked.all() or np.abs(growths - asked).max() > WHOLE:
        return meshes
    return [float(n) for n in 2 ** np.concatenate([[0.0], np.cumsum(asked)])]


def _cells(mesh: TensorMesh) -> str:
    return f"{mesh.cells[0]} x {mesh.cells[1]} cells"


def _uncertainty_scale(solution: MotionSolution, quantity: QuantityModel, quantities: Mapping[str, float]) -> float:
    """Return the scale of a quantity's uncertainty: the size of the shell, the sum of energies, or the weight.

    If the shell hardly moves, the scale is its largest displacement, or its own energies: these are nothing beside its
    size.
    """
    case = solution.case
    value, size = abs(quantities[quantity.name]), shell_size(case)
    farthest = float(np.linalg.norm(solution.coefficients[:, :, 0], axis=1).max())
    hardly = farthest < HARDLY * size
    assert case.dynamics is not None
    match quantity:
        case EnergyQuantity() | MotionEnergy():
            frame = solution.frame(case.dynamics.until)
            speed = math.sqrt(case.material.membrane_stiffness / case.material.areal_density)
            # An energy may pass through zero. It is compared with a possible energy of the shell, not with itself.
            least = case.material.areal_density * frame.area * speed**2  # of strains of order one
            return max(value, sum(frame.energies()), 0.0 if hardly else 1e-2 * least, float(np.finfo(float).tiny))
        case ReactionQuantity() | TorqueQuantity():
            largest = float(np.abs(solution.support_forces[:, :, :, 0]).sum(axis=1).max(initial=0.0))
            return max(value, largest * (size if quantity.kind == "torque" else 1.0), float(np.finfo(float).tiny))
        case ContactForce():
            forces = solution.touch(quantity.at).forces
            return max(value, float(np.linalg.norm(forces, axis=-1).sum()), float(np.finfo(float).tiny))
        case _:
            return max(value, farthest if hardly else size, float(np.finfo(float).tiny))


def _with_estimates(
    found: MotionSolution,
    levels: list[Step],
    estimates: Mapping[str, Estimate],
    tolerance: float,
    error: float,
    step: float,
    scheme: Scheme,
) -> MotionSolution:
    known = {name: e for name, e in estimates.items() if math.isfinite(e.uncertainty)}
    began = levels[-1].seconds - found.history[-1].seconds
    steps = tuple(replace(s, iteration=len(levels) + s.iteration, seconds=began + s.seconds) for s in found.history)
    return replace(
        found,
        history=(*levels, *steps),
        uncertainty=moving_uncertainty(
            found.case, levels[-1].quantities, {name: e.uncertainty for name, e in known.items()}
        ),
        extrapolated={name: e.extrapolated for name, e in known.items()},
        diagnostics={
            **found.diagnostics,
            "converged": error <= tolerance,
            "tolerance": tolerance,
            "relative_uncertainty": error if known else None,
            "rates": {name: e.rate for name, e in known.items() if e.rate is not None},
            "cells": list(found.mesh.cells),
            "usual_time_step": step,
            "spectral_radius": scheme.spectral_radius,
            "interpolation": "bicubic Hermite in space, cubic Hermite in time",
        },
    )


def follow(
    case: Case,
    mesh: TensorMesh,
    usual: float,
    scheme: Scheme,
    quadrature_order: int,
    progress: Callable[[Progress], None],
) -> MotionSolution:
    """Follow a motion on one mesh by steps of a usual length, shorter if needed.

    Raises
    ------
    SolveFailure
        If a step can't be cut further; the motion up to there comes with it.
    """
    assert case.dynamics is not None
    began, until = time.perf_counter(), case.dynamics.until
    # One mesh in time, a step in four:
    # 1. Step. If Newton's method fails, or the local error is too large, halve the step and repeat it.
    # 2. Double the next one if the error leaves room, up to the usual length.
    # 3. Record the balance of energy: kinetic, elastic and that of springs, less the work of loads and supports, and
    #    with what damping took. The loss by impacts and friction is no drift.
    # 4. Keep every n-th instant, and the ends of steps of another length.
    # Textbooks scale a step by a root of its error. Here it is halved and doubled only: lengths repeat, and a
    # factorised tangent serves one length (`time_step`).
    shell = MovingShell(FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, quadrature_order)), scheme)
    allowed = SMOOTH * shell_size(case)
    # A whole number of equal steps, so that the last one is not a short one.
    usual = until / math.ceil(until / usual * (1 - SAME))
    h, now = usual, shell.initial_instant(usual)
    kept, drift = [now], 0.0
    reactions: list[tuple[float, Array]] = []
    steps: list[Step] = []
    unknowns = int(np.count_nonzero(shell.problem.ties(until).free))
    every = math.ceil(until / usual / FRAMES)
    reason: str | None = None
    while now.t < until * (1 - SAME):
        h = min(h, until - now.t)
        try:
            found = shell.step(now, h)
            # Error estimate of Zienkiewicz & Xie (1991): the displacement less that of an acceleration linear over the
            # step. It costs nothing. The first step is exempt: there the acceleration may jump.
            local = h**2 * abs(scheme.beta - 1 / 6) * float(np.abs(found.a - now.a)[:, :: len(KINDS)].max())
            why = "" if local <= allowed or now.t == 0.0 else f"the motion is too quick for a step of {h:.2g} s"
        except NotConvergedError:
            why = f"a step of {h:.2g} s did not converge"
        # The state `now` is unchanged: a refused step only costs time.
        if why and h > SHORTEST * usual:
            h /= 2
            continue
        if why:
            reason = f"{why} at t = {now.t:.6g} s, and it can't be cut further"
            break
        # Reactions balance within the step, not at its end.
        middle = now.t + (1 - scheme.alpha_f) * h
        whole = h == usual
        # An impulse belongs to the beginning of its step. In lasting contact, stored rates are those in the middle of
        # the impulse. An impact does not change the path before it.
        if kept[-1] is now and now.touch is not None and np.any(now.touch):
            kept[-1] = replace(now, impulse=found.impulse)
        now = found
        if local <= ROOM * allowed:
            h = min(2 * h, usual)
        balance = sum(shell.energies(now)) - now.supplied
        drift = max(drift, abs(balance + now.lost))
        number = len(steps)
        steps.append(
            Step(number, time.perf_counter() - began, balance, unknowns, now.t, phase="time", iterations=now.iterations)
        )
        last = now.t >= until * (1 - SAME)
        if last or not whole or (number + 1) % every == 0:
            kept.append(now)
            reactions.append((middle, now.reaction))
        if number % every == 0 or last:
            progress(Progress(round(1000 * now.t / until), 1000, f"{_cells(mesh)}, t = {now.t:.4g} s"))
    if len(kept) < 2:
        raise SolveFailure(f"{reason}: no step in time converged")
    solution = _solution(shell, quadrature_order, kept, reactions, unknowns)
    solution = replace(
        solution,
        history=tuple(steps),
        diagnostics={
            "energy_drift": drift,
            **({"lost_in_contact": now.lost} if case.obstacles else {}),
            "time_steps": len(steps),
            "newton_iterations": sum(s.iterations or 0 for s in steps),
            "shortest_time_step": float(np.diff([0.0, *(s.at for s in steps)]).min()),
        },
    )
    if reason:
        raise SolveFailure(reason, partial=solution)
    return solution


def _solution(
    shell: MovingShell,
    quadrature_order: int,
    kept: list[Instant],
    reactions: list[tuple[float, Array]],
    unknowns: int,
) -> MotionSolution:
    problem = shell.problem
    case, mesh = problem.case, problem.mesh
    scales, points = mesh.node_scales[:, None, :, None], shell.points
    touched = [instant for instant in kept if instant.touch is not None]
    shape = (mesh.node_count, COMPONENTS, len(KINDS), -1)
    ties = problem.ties(kept[-1].t)
    # Prescribed values change in time, but held nodes do not: the last instant's ties serve for all.
    shares = ties.sharing.shares(np.stack([r[ties.nodes] for _, r in reactions], axis=-1))
    forces = shares.reshape(len(case.supports), len(ties.nodes), *shape[1:-1], len(reactions))
    return MotionSolution(
        case=case,
        mesh=mesh,
        times=np.array([instant.t for instant in kept]),
        coefficients=np.stack([instant.q for instant in kept], axis=-1).reshape(shape) / scales,
        rates=np.stack([instant.velocity for instant in kept], axis=-1).reshape(shape) / scales,
        support_nodes=ties.nodes,
        reaction_times=np.array([t for t, _ in reactions]),
        support_forces=forces * scales[ties.nodes],
        quadrature_order=quadrature_order,
        parameters=unknowns,
        touch_times=np.array([k.t - k.length for k in touched]),
        touching=tuple(points.touch(k.touch) for k in touched if points is not None and k.touch is not None),
    )
