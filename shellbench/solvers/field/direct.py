"""Grids that are solved for: the displacement of a grid without layers is linear in its coefficients.

A function is matched by least squares along one axis after the other. Losses of local structures are minimised by
Newton's method: the Hessian is exact for strain, that of Gauss and Newton for bending.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, diags, identity
from scipy.sparse.linalg import splu

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.field.case import Disc, FieldCase
from shellbench.problems.field.formulas import evaluated
from shellbench.problems.field.quantities import AXES, along_edge
from shellbench.problems.field.structure import lattice, weighted
from shellbench.solvers.field.basis import Sparse, along, matrix
from shellbench.solvers.field.energy import Sampled
from shellbench.solvers.field.field import LayeredField
from shellbench.solvers.field.sampling import Cells, positive
from shellbench.solvers.field.symmetry import fold_orbits, maps, span_of

Array = NDArray[np.float64]

MOST_STEPS = 50  # of Newton's method
SMALL = 1e-12  # relative: change of the energy at which it ends
ZERO_SPLINE = 1e-12  # of splines that are zero at a place
MOST_FOLDING, SMALL_FOLDING = 200, 1e-10  # of a sheet that meets a body
DAMPING = 1e-7  # of it, N/m for each square metre: a pinned point alone lets the sheet turn
FARTHEST, NEAR = 0.1, 3e-4  # m that a coefficient goes in a step; relative slope from which on Hessians are exact
INDEFINITE = 1e-9  # relative size of a negative pivot that is not rounding
ANCHOR = 1e-12  # relative stiffness that holds free unknowns while pins are extended
HALVINGS = 30  # of a step that does not lower the energy
PLAYS = 12  # of the two players: density, then minimiser
STEADY = 1e-10  # by which the density still moves when they end
PER_CELL = 4  # samples of a match along a cell
# Integral of a spline over a disc, as a share of the largest, from which on it takes part. On field_disc 8 cells err by
# 5e-4; with 1e-4 by 1.4 %, for splines at the rim then gain between the samples.
LEAST_CLOTH = 1e-2
GAUSS = {1: 2, 3: 3}  # points of a cell along a side, by degree: midpoints alone let splines gain at the edges


def form_of(cells: int, degree: int, confined: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the form of a field of one level without layers."""
    none = {"frequencies": 0, "layers": 0, "activation": "relu", "held": []}
    return {"cells": [cells], "degree": degree, "confined": list(confined), **none}


def fit_grid(case: FieldCase, cells: int, degree: int) -> LayeredField:
    """Return the grid that is nearest to the function on a lattice of points."""
    assert case.match is not None
    count = PER_CELL * cells
    inverse = np.linalg.pinv(along((np.arange(count) + 0.5) / count, cells, degree).toarray())
    values = evaluated(case.match.function, lattice(count)).reshape(count, count, 3)
    found = np.einsum("ia,jb,abk->ijk", inverse, inverse, values, optimize=True)
    return LayeredField(case, {"grid_0": found.reshape(-1, 3)}, form_of(cells, degree))


def onto_finer_grid(coarse: LayeredField, cells: int, degree: int) -> Array:
    """Return the coefficients (m, 3) on a grid that are nearest to a coarser grid's field."""
    count = PER_CELL * cells
    inverse = np.linalg.pinv(along((np.arange(count) + 0.5) / count, cells, degree).toarray())
    values = coarse.displacement(lattice(count)).reshape(count, count, 3)
    return np.asarray(np.einsum("ia,jb,abk->ijk", inverse, inverse, values, optimize=True)).reshape(-1, 3)


def gauss(cells: int, count: int) -> tuple[Array, Array]:
    """Return Gauss points (n, 2) of equal cells, so many along a side of each, and their areas (n,)."""
    places, weights = np.polynomial.legendre.leggauss(count)
    x = ((np.arange(cells)[:, None] + (places + 1) / 2) / cells).ravel()
    lengths = np.tile(weights / (2 * cells), cells)
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    return points, np.outer(lengths, lengths).ravel()


def gauss_of_disc(disc: Disc, cells: int, count: int) -> tuple[Array, Array]:
    """Return points (n, 2) of a disc, about as dense as those of cells, and their shares (n,) of it.

    Gauss points along radii are exact up to the rim, unlike points of cells that the rim cuts.
    """
    rings = math.ceil(disc.radius * cells * count)
    x, weights = np.polynomial.legendre.leggauss(rings)
    radii, around = (x + 1) / 2, math.ceil(2 * math.pi * rings)
    angles = 2 * math.pi * (np.arange(around) + 0.5) / around
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = 0.5 + disc.radius * radii[:, None, None] * directions
    return points.reshape(-1, 2), np.repeat(weights * radii / around, around)


def pinned_coefficients(case: FieldCase, cells: int, degree: int) -> tuple[NDArray[np.bool_], Array]:
    """Return a mask of the coefficients (m, 3) that pinned edges prescribe, and their values (m, 3)."""
    side = cells + degree
    given, values = np.zeros((side, side, 3), dtype=bool), np.zeros((side, side, 3))
    for component in case.cloth.confined if case.cloth else ():
        given[..., AXES.index(component)] = True
    for pin in case.pins:
        for edge in pin.on:
            if edge == "rim":  # on which the field is zero
                continue
            axis, end = "uv".index(edge[0]), -1 if edge.endswith("max") else 0
            place: Any = (end, slice(None)) if axis == 0 else (slice(None), end)
            points = along_edge(edge, PER_CELL * cells)
            splines = along(points[:, 1 - axis], cells, degree).toarray()
            values[place] = np.linalg.lstsq(splines, evaluated(pin.displacement, points), rcond=None)[0]
            given[place] = True
    return given.reshape(-1, 3), values.reshape(-1, 3)


def free_map(
    case: FieldCase, cells: int, degree: int, given: NDArray[np.bool_], coefficients: Array, span: Sparse
) -> Sparse:
    """Return the sparse map from free unknowns to coefficients, by free component in turn.

    `span` is the same map without pins. A pinned point binds the unknowns whose splines are not zero there: the unknown
    of the largest spline follows from the others. Coefficients (m, 3) are changed so that they meet all pins.
    """
    axes = free_axes(case)
    taken = np.asarray(abs(span[given[:, axes].T.ravel()]).sum(axis=0)).ravel() > 0
    span = span[:, ~taken]
    for pin in (pin for pin in case.pins if pin.at):
        points = np.array(pin.at)
        values = evaluated(pin.displacement, points)
        splines = matrix(points, cells, degree)
        for number, place in product(range(len(points)), range(len(axes))):
            row = splines[[number]]
            share = (row @ span[place * len(given) : (place + 1) * len(given)]).toarray()[0]
            lead = int(np.abs(share).argmax())
            if abs(share[lead]) < ZERO_SPLINE:
                continue  # held already, by an edge or by symmetry
            off = values[number, axes[place]] - float((row @ coefficients[:, axes[place]])[0])
            coefficients[:, axes] += (span[:, [lead]].toarray() * off / share[lead]).reshape(len(axes), -1).T
            follows = identity(len(share), format="lil")
            follows[lead] = -share / share[lead]
            keep = np.arange(len(share)) != lead
            span = (span @ follows.tocsc()[:, keep]).tocsr()
    return span


def free_axes(case: FieldCase) -> list[int]:
    """Return the numbers of the components that are not confined."""
    return [number for number, axis in enumerate(AXES) if not case.cloth or axis not in case.cloth.confined]


def minimise_energy(sampled: Sampled, start: Array, span: Sparse) -> Iterator[tuple[float, Array]]:
    """Yield energy and coefficients after each step of Newton's method, until the energy is least.

    `span` is the map of `free_map`. The Hessian is the exact one if that is positive definite, else the convex one,
    damped. With a body the sheet folds on its way: steps are then short, with the convex Hessian, until they are whole
    and small.

    Raises
    ------
    SolveFailure
        If steps do not lower the energy, it has not settled, or the final state is no minimum.
    """
    # 1. Take energy, gradient and Hessian; solve for the Newton step of the free unknowns.
    # 2. If the exact Hessian is indefinite, take the convex one, damped, instead.
    # 3. Stop if the predicted gain is at rounding; refuse a saddle.
    # 4. Limit the step with a body, halve it until the energy falls, and return to the exact Hessian near the minimum.
    # The textbook shifts the Hessian until it is definite. Here a convex part of the energy's own Hessian replaces it.
    axes, meets = sampled.axes, sampled.body is not None
    convex, coefficients = meets, start
    most, small = (MOST_FOLDING, SMALL_FOLDING) if meets else (MOST_STEPS, SMALL)
    damping = DAMPING / len(start) * identity(span.shape[1], format="csr")
    idle = sampled.rounding(start)
    for _ in range(most):
        energy, gradient, hessian = sampled.derivatives(coefficients, convex=convex)
        reduced = span.T @ hessian @ span + (damping if convex else 0 * damping)
        found, negative = solve_symmetric(reduced, -(span.T @ gradient[:, axes].T.ravel()))
        if negative and not convex:
            convex = True
            continue
        step = np.zeros_like(coefficients)
        step[:, axes] = (span @ found).reshape(len(axes), -1).T
        if not np.all(np.isfinite(step)):
            raise SolveFailure("the losses leave some of the field undetermined: pins are missing, or samples")
        slope = float(np.sum(step * gradient))
        if abs(slope) <= small * (abs(energy) + abs(slope)) + idle:
            if convex and not meets and solve_symmetric(span.T @ sampled.derivatives(coefficients)[2] @ span, found)[1]:
                raise SolveFailure("the field rests at a saddle of the energy: the sheet would buckle from there")
            yield sampled.energy(coefficients + step), coefficients + step
            return
        share = min(1.0, FARTHEST / float(np.abs(step).max())) if meets else 1.0
        for _ in range(HALVINGS):
            if sampled.energy(coefficients + share * step) <= energy:
                break
            share /= 2
        else:
            raise SolveFailure("Newton's method finds no step that lowers the energy")
        convex = (meets or convex) and not (share == 1.0 and -slope <= NEAR * abs(energy))
        coefficients = coefficients + share * step
        yield sampled.energy(coefficients), coefficients
    raise SolveFailure(f"the energy has not settled after {most} steps of Newton's method")


def solve_symmetric(matrix: Sparse, right: Array) -> tuple[Array, bool]:
    """Return the solution (n,) of a symmetric system, not finite if it has none; and whether it is indefinite.

    Elimination without exchange of rows keeps the inertia: pivots have the signs of eigenvalues (Sylvester).
    """
    try:
        factors = splu(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:  # singular
        return np.full(len(right), np.nan), False
    pivots = factors.U.diagonal()
    return np.asarray(factors.solve(right)), bool(pivots.min() < -INDEFINITE * pivots.max())


def harmonic_extension(sampled: Sampled, start: Array, span: Sparse, cells: int, degree: int) -> Array:
    """Return coefficients (m, 3) whose displacement is the harmonic extension of that of moved pins.

    If the pins' displacement is affine, so is the extension. Newton's method therefore never starts from cells torn by
    pins.
    """
    axes = sampled.axes
    if not np.any(start[:, axes]):
        return start
    points, areas = gauss(cells, degree + 1)
    slopes = [matrix(points, cells, degree, orders) for orders in ((1, 0), (0, 1))]
    one = sum(part.T @ diags(areas) @ part for part in slopes)
    whole = block_diag([one] * len(axes), format="csr")
    # unknowns that no pin moves stay in place
    anchor = ANCHOR * one.diagonal().mean() * identity(span.shape[1], format="csr")
    right = -(span.T @ (whole @ start[:, axes].T.ravel()))
    found, _ = solve_symmetric(span.T @ whole @ span + anchor, right)
    moved = start.copy()
    moved[:, axes] += (span @ found).reshape(len(axes), -1).T
    return moved


@dataclass(frozen=True)
class SampleWeights:
    """Weights of the samples of a minimisation: even ones, or a density that follows the losses.

    With `share` above 0, that share of the samples follows the density of `cells` along a side. Unless `weighted`,
    losses count as often as they are sampled, as in the paper; that is the mean over all draws.
    """

    share: float
    weighted: bool
    cells: int


def minimise(
    case: FieldCase,
    cells: int,
    degree: int,
    play: SampleWeights,
    progress: ProgressCallback,
    coarse: LayeredField | None = None,
    symmetric: bool = True,
    count: int | None = None,
) -> LayeredField:
    """Return the grid of least energy; with a density that follows the losses, the equilibrium of both players.

    It starts from a coarser grid's answer, if there is one. `count` is the number of Gauss points of a cell along a
    side; None for that of its degree.
    """
    # 1. Prepare Gauss points, pinned coefficients, and the map from free (or symmetric) unknowns.
    # 2. Weigh the samples by the density, and minimise by Newton's method from the last coefficients.
    # 3. With a density, set it by the new losses, and repeat until it is steady.
    assert case.cloth is not None
    began, history = time.perf_counter(), list[Step]()
    many = count or GAUSS[degree]
    points, areas = gauss_of_disc(case.disc, cells, many) if case.disc else gauss(cells, many)
    given, start = pinned_coefficients(case, cells, degree)
    if case.disc:  # splines with almost no cloth leave the field undetermined
        has = np.asarray(areas @ matrix(points, cells, degree)).ravel()
        given |= (has < LEAST_CLOTH * has.max())[:, None]
    if coarse is not None:
        start = np.where(given, start, onto_finer_grid(coarse, cells, degree))
    same = maps(case) if symmetric and not play.share else maps(case)[:1]
    span = free_map(case, cells, degree, given, start, span_of(cells + degree, free_axes(case), same))
    form = form_of(cells, degree, case.cloth.confined)
    middles, shares = lattice(play.cells), np.ones((play.cells, play.cells))
    plays = 0
    for _ in range(PLAYS if play.share else 1):
        plays += 1
        density = play.share * Cells(shares).density(points) + 1 - play.share
        ones = np.ones(len(points)) if play.weighted else density
        sampled = Sampled.of(case, cells, degree, *fold_orbits(points, areas * ones, same))
        if coarse is None and plays == 1:
            start = harmonic_extension(sampled, start, span, cells, degree)
        for energy, coefficients in minimise_energy(sampled, start, span):
            history.append(Step(len(history), time.perf_counter() - began, energy, span.shape[1]))
            progress(Progress(len(history), None, f"energy {energy:.6g}"))
            start = coefficients
        found = LayeredField(case, {"grid_0": start}, form, tuple(history))
        losses = positive(weighted(found.losses(middles), case.cloth.weights)).reshape(shares.shape)
        before, shares = shares, losses / losses.mean()
        if np.abs(shares - before).max() <= STEADY * shares.max():
            break
    pictures = {"points": points, "density": shares} if play.share else {}
    return LayeredField(case, found.tensors, form, tuple(history), diagnostics={"plays": plays}, pictures=pictures)
