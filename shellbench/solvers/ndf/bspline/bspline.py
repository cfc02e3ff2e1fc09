"""The recipe `bspline-ritz`: a grid of cubic B-splines whose coefficients are solved for, on ever more cells.

Strains, energy, loads and supports are those of all fields here; only the trial functions differ. Each is zero except
on a few cells, so that the equations are sparse, and the cells of the grid are the panels of the quadrature.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from scipy.sparse import bmat, coo_matrix, diags
from scipy.sparse.linalg import splu

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.solvers.ndf.bspline.bspline_settings import SplineSettings
from shellbench.solvers.ndf.bspline.bspline_solution import SPEC, SplineSolution, solved_part, splines_of
from shellbench.solvers.ndf.bspline.splines import Splines
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import build_ansatz, focal_points, joints_of
from shellbench.solvers.ndf.field.inputs import edge_layers, foci
from shellbench.solvers.ndf.field.jets import VALUE, Array, Integers
from shellbench.solvers.ndf.field.quadrature import Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import check_balance, point_supports
from shellbench.solvers.ndf.linear.constraints import SAME_ROW, point_constraints, slope_constraints
from shellbench.solvers.ndf.linear.declines import why_declined
from shellbench.solvers.ndf.linear.refinement import ErrorBounds, scale, uncertainties, why_unsettled
from shellbench.solvers.ndf.linear.signs import rounding_energy
from shellbench.solvers.ndf.strains.energy import Table, concentrated, surface_area, tabulate
from shellbench.solvers.ndf.strains.reaction import edge_moments
from shellbench.solvers.ndf.strains.strain_measures import GRADIENTS

Sparse = Any  # scipy's matrices have no types

LEVELS = (4, 8, 16, 32, 64)  # cells along a side
CELL_POINTS = 2  # Gauss points of a cell along a side beyond the degree: boundary factors and surfaces are no splines
CERTIFYING_POINTS = 2  # more of them, for the certificate
CELL_BATCH = 2048  # points whose strain rows are held at once, in whole cells
SLOPE_POINTS = 2  # of a cell at an edge whose slope is held: as many as splines there, nearly twice
FEWEST = 3  # levels that show how fast changes shrink
UNTOLD = 1.0  # of the last change: estimated remaining error if there are fewer levels


def why_not_held(case: Case) -> str | None:
    """Return the reason that a grid can't represent a case of the linear theory, as one clause, or None if it can."""
    if case.dynamics is not None:
        return "it moves, and this solver takes shells at rest"
    if case.prescribed:
        return "it prescribes the whole surface, and this solver holds edges and corners"
    if free_motions(case).size and any(support.motion is not None for support in case.supports):
        return "its supports move and leave rigid motions free, which this solver removes from shells at rest only"
    return why_declined(case, SPEC)


@dataclass(frozen=True)
class Equations:
    """The energy 1/2 w K w - f w + c of coefficients w (3 M,), component by component, and conditions C w = d."""

    stiffness: Sparse
    load: Array
    constant: float
    conditions: Array
    targets: Array

    def potential(self, weights: Array) -> float:
        """Return the potential energy, J."""
        return float(0.5 * weights @ (self.stiffness @ weights) - self.load @ weights) + self.constant


def rule_of(case: Case, cells: int, settings: SplineSettings) -> RuleSpec:
    """Return the panels of a level, which are the grid's cells, graded by the settings."""
    panels = [cells * (2 if closed else 1) for closed in case.surface.domain.periodic]
    layers = edge_layers(case) if settings.layers and not foci(case) else None
    return RuleSpec(
        panels=(panels[0], panels[1]),
        order=settings.degree + CELL_POINTS,
        grading=settings.grading,
        layers=layers or (0.0, 0.0),
        joints=joints_of(case),
    )


@dataclass(frozen=True)
class CellPoints:
    """Points of whole cells, with the data of the energy there."""

    table: Table
    numbers: Integers
    jets: Array


def cell_points(ansatz: Ansatz, splines: Splines, spec: RuleSpec) -> Iterator[CellPoints]:
    """Yield the table at the points of cells, the splines (cells, k) of each, and their jets (6, points, k)."""
    rule = area_rule(ansatz.case.surface.domain, focal_points(ansatz.case), spec)
    area, per_cell = surface_area(ansatz, rule), spec.order**2
    shape = [line.cells * spec.order for line in splines.lines]
    # from rows of points that run through all cells to points cell by cell
    lines = np.arange(len(rule.points)).reshape(shape[0] // spec.order, spec.order, -1, spec.order)
    order = lines.transpose(0, 2, 1, 3).ravel()
    step = max(1, CELL_BATCH // per_cell) * per_cell
    for start in range(0, len(order), step):
        part = order[start : start + step]
        points = rule.points[part]
        numbers, jets = splines.nonzero_at(points)
        table = tabulate(ansatz, Rule(points, rule.weights[part]), splines.placement, area)
        yield CellPoints(table, numbers[::per_cell], jets)


def equations_of(ansatz: Ansatz, splines: Splines, spec: RuleSpec) -> Equations:
    """Integrate the energy of the coefficients, cell by cell."""
    # 1. Compute, at the points of a cell, rows of the roots of stiffness and weight, on the jets of the splines there.
    # 2. Add K of the cell, rows^T rows, to a sparse matrix; likewise the work of the loads, and means of rigid motions.
    # 3. Add forces and moments at points and edges.
    # 4. State the conditions: rigid motions left free have no mean; point supports; slopes that no factor holds.
    case, placement, focal = ansatz.case, splines.placement, focal_points(ansatz.case)
    count, unknowns = splines.count, 3 * splines.count
    load, constant = np.zeros(unknowns), 0.0
    anchors = np.zeros((free_motions(case).shape[1], unknowns))
    entries: list[Array] = []
    places: list[Integers] = []
    for found in cell_points(ansatz, splines, spec):
        table, cells, k = found.table, *found.numbers.shape
        rows = np.einsum("nrcp,pnk->nrck", table.rows.numpy(), found.jets, optimize=True).reshape(cells, -1, 3 * k)
        dofs = (np.arange(3)[:, None] * count + found.numbers[:, None]).reshape(cells, -1)
        entries.append((rows.transpose(0, 2, 1) @ rows).ravel())
        places.append(np.stack(np.broadcast_arrays(dofs[:, :, None], dofs[:, None])).reshape(2, -1))
        values = found.jets[VALUE].reshape(cells, -1, k)
        work = np.einsum("cqi,cqk->cik", table.force.numpy().reshape(cells, -1, 3), values)
        np.add.at(load, dofs, work.reshape(cells, -1))
        held = np.einsum("cqr,cq->cr", rows, table.offset.numpy().reshape(cells, -1)) if ansatz.lift.moves else None
        if held is not None:
            np.add.at(load, dofs, -held)
        for row, anchor in zip(anchors, table.anchors.numpy(), strict=True):
            np.add.at(row, dofs, np.einsum("cqi,cqk->cik", anchor.reshape(cells, -1, 3), values).reshape(cells, -1))
        constant += 0.5 * float((table.offset**2).sum()) - table.work
    at = np.concatenate(places, axis=1)
    stiffness = coo_matrix((np.concatenate(entries), (at[0], at[1])), shape=(unknowns, unknowns)).tocsc()
    forces = concentrated(ansatz, spec, focal, placement)
    if len(forces.points):
        load += (forces.force.T @ splines.values(forces.points)).numpy().ravel()
    for moment in edge_moments(ansatz, splines, spec, focal, finite=False):
        rest = torch.zeros((len(moment.lengths), GRADIENTS // 3, 3), dtype=torch.float64)
        load += moment.forces(rest, ansatz.t).numpy()
    slopes = slope_constraints(ansatz, splines, replace(spec, order=SLOPE_POINTS), focal)
    conditions = [point_constraints(ansatz, splines), *slopes]
    rows, targets = (torch.cat(both).numpy() for both in zip(*conditions, strict=True))
    return Equations(
        stiffness,
        load,
        constant - forces.work,
        np.concatenate([rows, anchors]),
        np.concatenate([targets, np.zeros(len(anchors))]),
    )


def minimise(equations: Equations) -> tuple[Array, Array]:
    """Return the coefficients (3 M,) of least energy, and the forces (c,) that hold the conditions.

    Raises
    ------
    SolveFailure
        If the equations have no solution.
    """
    # 1. Scale to a unit diagonal. A spline without energy gets a unit diagonal entry, and stays zero.
    # 2. Take the independent directions of the conditions (singular vectors): rows at many points of an edge repeat
    #    each other.
    # 3. Solve the saddle system of both, and once more for its residual.
    diagonal = equations.stiffness.diagonal()
    root = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 1.0)
    scaled = diags(root) @ equations.stiffness @ diags(root) + diags(np.where(diagonal > 0, 0.0, 1.0))
    rows = equations.conditions * root
    sizes = np.linalg.norm(rows, axis=1)
    kept = sizes > 0
    left, singular, right = np.linalg.svd(rows[kept] / sizes[kept, None], full_matrices=False)
    enough = singular > SAME_ROW * singular.max(initial=0.0)
    combine = (left[:, enough] / singular[enough]).T
    held, targets = right[enough], combine @ (equations.targets[kept] / sizes[kept])
    count = len(root)
    system = bmat([[scaled, held.T], [held, None]], format="csc") if len(held) else scaled.tocsc()
    load = np.concatenate([equations.load * root, targets])
    try:
        factors = splu(system)
    except RuntimeError:
        raise SolveFailure("the equations of the grid are singular: something is not held") from None
    found = factors.solve(load)
    found += factors.solve(load - system @ found)
    if not np.all(np.isfinite(found)):
        raise SolveFailure("the equations of the grid have no finite solution")
    forces = np.zeros(len(rows))
    forces[kept] = -(combine.T @ found[count:]) / sizes[kept]
    return root * found[:count], forces


def certified_energies(ansatz: Ansatz, splines: Splines, spec: RuleSpec, weights: Array) -> tuple[float, float, float]:
    """Return membrane, bending and springs' energy, J, on another rule."""
    parts, output = np.zeros(3), weights.reshape(3, -1)
    for found in cell_points(ansatz, splines, spec):
        cells, k = found.numbers.shape
        local = output[:, found.numbers].transpose(1, 0, 2)
        jets = found.jets.reshape(6, cells, -1, k)
        free = np.einsum("pcqk,cik->cqip", jets, local, optimize=True).reshape(-1, 3, 6)
        table = found.table
        strains = np.einsum("nrip,nip->nr", table.rows.numpy(), free) + table.offset.numpy()
        squares = 0.5 * (strains**2).sum(axis=0)
        parts += [squares[:3].sum(), squares[3:6].sum(), squares[6:].sum()]
    membrane, bending, springs = parts.tolist()
    return membrane, bending, springs


@dataclass(frozen=True)
class SolvedGrid:
    """One level's answer: see `shellbench.solvers.ndf.linear.answer.Candidate`."""

    solution: SplineSolution
    potential: float
    stored: float
    gap: float
    values: dict[str, float]

    def error_bounds(self, finer: SolvedGrid) -> ErrorBounds:
        """Return lower bounds of its errors, from its difference to a finer answer."""
        changes = {name: abs(value - self.values[name]) for name, value in finer.values.items()}
        return ErrorBounds(changes, abs(self.potential - finer.potential) / finer.stored)


def solve(case: Case, settings: SplineSettings, progress: ProgressCallback) -> SplineSolution:
    """Refine until an answer has settled, or no more cells are allowed.

    Raises
    ------
    SolveFailure
        If the equations have no solution.
    """
    # 1. Double the cells, level by level. The change of an answer estimates the error of the one before.
    # 2. From three levels on, the energies give the ratio of successive changes; the rest of the series estimates the
    #    error of the last answer. The ratio is at most the convergence of splines of this degree for smooth solutions.
    # 3. Stop if this error, and the difference to a finer rule in the energy, are a small part of each quantity.
    began, steps = time.perf_counter(), list[Step]()
    answers: list[SolvedGrid] = []
    levels = [level for level in LEVELS if level < settings.most_cells] + [settings.most_cells]
    if settings.cells is not None:
        levels = [max(LEVELS[0] // 2, settings.cells // 4), max(LEVELS[0] // 2, settings.cells // 2), settings.cells]
    with torch.no_grad():
        for cells in dict.fromkeys(levels):
            progress(Progress(len(answers), None, f"solving on {cells} cells a side"))
            answers.append(solve_level(case, settings, cells))
            last = answers[-1]
            steps.append(_history_step(last, len(steps), time.perf_counter() - began))
            if len(answers) < 2:
                continue
            solution = _as_answer(answers, settings.degree, tuple(steps))
            if settings.cells is None and len(answers) >= FEWEST and solution.unsettled is None:
                break
    return solution


def solve_level(case: Case, settings: SplineSettings, cells: int) -> SolvedGrid:
    """Solve on one grid."""
    part = solved_part(case, settings.symmetry)
    spec, ansatz = rule_of(part.case, cells, settings), build_ansatz(part.case, SPEC)
    splines = splines_of(part.case, spec, settings.degree)
    focal = focal_points(part.case)
    rule = area_rule(part.case.surface.domain, focal, spec)
    check_balance(part.case, rule, spec, focal)
    equations = equations_of(ansatz, splines, spec)
    weights, forces = minimise(equations)
    fine = replace(spec, order=spec.order + CERTIFYING_POINTS)
    membrane, bending, springs = certified_energies(ansatz, splines, fine, weights)
    rounding = rounding_energy(case.material.membrane_stiffness, surface_area(ansatz, rule))
    # Strains are computed on both rules; if a support moves, the lift strains the shell too, which only the finer rule
    # shows.
    stored, strained = membrane + bending + springs, 0.5 * float(weights @ (equations.stiffness @ weights))
    gap = 0.0 if ansatz.lift.moves else abs(strained - stored) / (stored + rounding)
    solution = SplineSolution(
        case=case,
        symmetry=settings.symmetry,
        degree=settings.degree,
        rule=spec,
        coefficients=weights.reshape(3, -1),
        membrane=part.copies * membrane,
        bending=part.copies * bending,
        point_forces=tuple(forces[: len(point_supports(part.case, SPEC.t))].tolist()),
        diagnostics={"energy_gap": gap, "cells": cells, "quadrature_points": len(rule.points)},
    )
    potential, whole = part.copies * equations.potential(weights), part.copies * (stored + rounding)
    alone = Step(0, 0.0, potential, solution.parameters, SPEC.t)  # for the quantity that is an energy of the history
    return SolvedGrid(solution, potential, whole, gap, dict(measure_all(replace(solution, history=(alone,)))))


def _history_step(answer: SolvedGrid, number: int, seconds: float) -> Step:
    asked = {q.name for q in answer.solution.case.quantities if isinstance(q, DisplacementQuantity)}
    return Step(
        iteration=number,
        seconds=seconds,
        energy=answer.potential,
        unknowns=answer.solution.parameters,
        at=SPEC.t,
        gap=answer.gap,
        quantities={name: value for name, value in answer.values.items() if name in asked},
    )


def remaining_error(last: float, former: float, fastest: float) -> float:
    """Return the estimated error of an answer, in units of its last change.

    It is the rest of a geometric series. Its ratio is that of the shares of energy gained by this change and by the one
    before, but not below `fastest`.
    """
    if not last < former:
        return math.inf if last > former else UNTOLD
    ratio = max(last / former, fastest)
    return ratio / (1 - ratio)


def _as_answer(answers: list[SolvedGrid], degree: int, steps: tuple[Step, ...]) -> SplineSolution:
    """Return the last answer with its history and uncertainty."""
    last, solution = answers[-1], answers[-1].solution
    since = answers[-2].error_bounds(last)
    left = UNTOLD
    if len(answers) >= FEWEST:
        former = answers[-3].error_bounds(answers[-2])
        left = min(UNTOLD, remaining_error(since.energy, former.energy, 4 ** (1 - degree)))
    scales = {q.name: scale(solution, q, last.values[q.name], last.stored) for q in solution.case.quantities}
    uncertainty = uncertainties(since.times(left), last.gap, last.values, scales)
    return replace(solution, history=steps, uncertainty=uncertainty, unsettled=why_unsettled(uncertainty, scales))
