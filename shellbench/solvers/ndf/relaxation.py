"""Relaxation: from any displacement down to a stable state, by Newton's method in a trust region.

At each iterate the potential energy is minimised by its exact second-order model within a ball, whose radius follows
from how well the model foretold the last gain (Moré & Sorensen 1983, SIAM J. Sci. Stat. Comput. 4; Conn, Gould & Toint
2000). That the ball is one of the stiffness at rest makes the step that of a pseudo-transient method,

    (K + mu K_rest) s = -g,

with the mu that the energy allows: it leaves a saddle along its most negative direction, only ever goes downhill, and
becomes Newton's method at the end.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from shellbench.solvers.ndf.equilibrium import CONVERGED, Deformed, NotConvergedError, PathProblem
from shellbench.solvers.ndf.newton import PathState

NEUTRAL = 1e-4
"""Eigenvalue of a tangent, relative to the stiffness at rest, that is called zero.

A perfect shell's smallest one falls from 1 at rest to 0 at the critical load, so one of this size moves that load by
about its own share. Waves that may travel around a shell have a zero one, of which a field makes a small number of
either sign."""
IMMATERIAL = 1e-4  # of the energy: what its own small slopes along neutral modes could at most promise a field
FIRST_RADIUS = 0.1  # of the norm of the energy there is
TRUSTED, DOUBTED = 0.75, 0.25  # shares of the foretold gain beyond which the radius grows, or shrinks
WIDER, NARROWER = 2.0, 0.25
NARROWEST = 1e-9  # of the norm of the energy: what is left to gain is rounding
MOST_STEPS = 400
SECULAR = 100  # bisections of the shift


def relaxed(problem: PathProblem, start: PathState, t: float) -> PathState:
    """Return a stable state at load factor t of no more energy than the start has there.

    Raises
    ------
    NotConvergedError
        If none was found.
    """
    basis = problem.basis
    weights = start.weights + basis.held @ (problem.targets(t) - problem.constraints @ start.weights)
    deformed = problem.deform(weights, t, start.deformed.angles)
    size = _size(deformed)
    radius = FIRST_RADIUS * size
    model: tuple[Tensor, Tensor, Tensor] | None = None
    for iteration in range(1, MOST_STEPS + 1):
        if model is None:
            tangent = basis.combine.T @ problem.tangent(deformed, t, weights) @ basis.combine
            if not bool(torch.isfinite(tangent).all()):
                raise NotConvergedError
            values, vectors = torch.linalg.eigh(tangent)
            model = values, vectors, -vectors.T @ (basis.combine.T @ deformed.residual)
        values, vectors, gradient = model
        scale = deformed.membrane + deformed.bending + abs(deformed.work)
        if float(values[0]) > -NEUTRAL:
            left = gradient**2 / values.abs().clamp_min(NEUTRAL)
            neutral = values.abs() <= NEUTRAL
            if float(left[neutral].sum()) <= IMMATERIAL * scale:  # the field's own doing: nothing to run after
                gradient, left = gradient.masked_fill(neutral, 0.0), left.masked_fill(neutral, 0.0)
            if float(left.sum()) <= CONVERGED * scale:
                return PathState(t, weights, deformed, iteration)
        step = trust_region_step(values, gradient, radius)
        foretold = -float(gradient @ step + (values * step * step).sum() / 2)
        change = basis.combine @ (vectors @ step)
        tried = problem.deform(weights + change, t, deformed.angles)
        gain = deformed.potential - tried.potential
        length = float(step.norm())
        if gain < DOUBTED * foretold or not gain > 0:
            radius = NARROWER * length
        elif gain > TRUSTED * foretold and length > 0.99 * radius:
            radius *= WIDER
        if gain > 0:
            weights, deformed, model = weights + change, tried, None
        elif radius < NARROWEST * size:
            break
    raise NotConvergedError


def trust_region_step(values: Tensor, gradient: Tensor, radius: float) -> Tensor:
    """Return the step (n,) of least g . s + s . K s / 2 within |s| <= radius, all in the eigenvectors of K.

    `values` (n,) are the ascending eigenvalues of K, `gradient` (n,) is g.
    """
    lowest = float(values[0])
    if lowest > 0:
        step = -gradient / values
        if float(step.norm()) <= radius:
            return step
    low = max(0.0, -lowest)
    high = low + float(gradient.norm()) / radius  # there the step is no longer than the radius
    floor = max(abs(lowest), float(values[-1]) * torch.finfo(values.dtype).eps)
    near = low + 1e-12 * floor
    hard = -gradient / (values + near)
    if float(hard.norm()) < radius:  # the gradient hardly leaves the saddle: the lowest direction fills the ball
        sign = -1.0 if float(gradient[0]) > 0 else 1.0
        rest = hard.clone()
        rest[0] = 0.0
        hard[0] = sign * max(radius**2 - float(rest @ rest), 0.0) ** 0.5
        return hard
    for _ in range(SECULAR):
        middle = (low + high) / 2
        if float((gradient / (values + middle)).norm()) > radius:
            low = middle
        else:
            high = middle
        if high - low <= 1e-12 * high:
            break
    return -gradient / (values + high)


def _size(deformed: Deformed) -> float:
    """Return the norm of the displacement that would store the energy by the stiffness at rest."""
    return math.sqrt(2 * (deformed.membrane + deformed.bending + abs(deformed.work)))
