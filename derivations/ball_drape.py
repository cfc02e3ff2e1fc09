r"""A heavy cloth that hangs over a ball: cases/contact_drape.toml, on splines against a soft ball that hardens.

The potential energy of `spline_shell` and, at its quadrature points, the penalty k/2 min(0, d)^2 of the distance d from
the ball an area. Newton's method finds its least value while the weight grows, and then while k does. The error of a
penalty is of the first order in 1 / k, so that two of them are extrapolated. The pin is a stiff spring. Of the
discretisation tells a coarser one.

Beside it stands `fem` on two meshes, conforming cubics with multipliers: what is judged, so that one origin alone is apart
from it.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .estimate import Estimate
from .patch import Mesh, breaks, plane, uniform
from .spline_shell import Array, Ends, Shell

SIDES, RADIUS, WEIGHT = (0.5, 0.3), 0.25, 0.4
"""Of the quarter, and of the ball, m; of the cloth, N/m^2."""
PIN = 1e4
"""Stiffness of the pin's spring, N/m."""
SOFT, HARD = 1e3, 0.99e6
"""Penalties of the ball, N/m^3: while the weight grows, and at last."""
FINE, COARSE = Mesh((40, 24), 4), Mesh((28, 17), 4)
STEPS, ITERATIONS, CONVERGED, SHORTEST = 8, 60, 1e-9, 1e-3


class Draped:
    """A quarter of the cloth on splines, with what the ball exerts on its quadrature points."""

    def __init__(self, mesh: Mesh) -> None:
        splines = mesh.splines(*(breaks(0.0, side, n) for side, n in zip(SIDES, mesh.spans, strict=True)))
        mirrored: Ends = ("zero", "free")
        even: Ends = ("even", "free")
        ends = [(mirrored, even), (even, mirrored), (even, even)]
        self.shell = Shell(plane, splines, ends, 1e5, 0.3, 0.005, load=uniform(0.0, 0.0, -WEIGHT))
        shapes = self.shell._shapes(0, 0)
        count = splines[0].count * splines[1].count
        spans, points, functions = shapes.shape
        rows = np.repeat(np.arange(spans * points), functions)
        columns = np.repeat(self.shell._spans, points, axis=0).ravel()
        values = sparse.csr_array((shapes.ravel(), (rows, columns)), shape=(spans * points, count))
        self.values = sparse.csr_array(sparse.kron(sparse.eye_array(3), values) @ self.shell.reduction)
        self.weights = self.shell._reference[2].ravel()
        self.rest = self.shell._of_points(lambda a, b: plane(a, b, 0, 0)).reshape(-1, 3)
        self.pin = sparse.csr_array(self.shell.row(0.0, 0.0, (0.0, 0.0, 1.0))[None])

    def pushed(self, free: Array, k: float) -> tuple[Array, sparse.csr_array]:
        """Forces of the ball and the pin on the free coefficients, and the stiffness that they add."""
        places = self.rest + (self.values @ free).reshape(3, -1).T - [0.0, 0.0, -RADIUS]
        far = np.linalg.norm(places, axis=1)
        depth, normal = np.maximum(RADIUS - far, 0.0), places / far[:, None]
        force = (k * depth * self.weights)[:, None] * normal
        outer = normal[:, :, None] * normal[:, None]
        local = k * ((depth > 0)[:, None, None] * outer - (depth / far)[:, None, None] * (np.eye(3) - outer))
        local *= self.weights[:, None, None]
        blocks = [[sparse.diags_array(local[:, i, j]) for j in range(3)] for i in range(3)]
        stiffness = self.values.T @ sparse.block_array(blocks) @ self.values + PIN * self.pin.T @ self.pin
        held = PIN * (self.pin.T @ (self.pin @ free))
        return self.values.T @ force.T.ravel() - held, sparse.csr_array(stiffness)

    def least(self, free: Array, factor: float, k: float) -> Array:
        """Return the coefficients that balance a part of the weight, from others nearby."""
        stress = None
        for _ in range(ITERATIONS):
            at = self.shell.linearised(free)
            force, stiffness = self.pushed(free, k)
            residual = factor * self.shell.load_vector + force - at.forces()
            tangent = sparse.csc_array(at.stiffness(stress) + stiffness)
            step = splu(tangent, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01).solve(residual)
            stress = at.predicted_stress(step)
            free = free + step
            size = np.abs(step).max() / np.abs(free).max()
            if size < CONVERGED:
                return free
            if not np.isfinite(size) or np.abs(free).max() > 10:
                break
        raise ArithmeticError(f"no equilibrium of the cloth at {factor:.3g} of its weight")

    def path(self) -> Array:
        """Return the coefficients under the whole weight, on the soft ball, the weight having grown from nothing."""
        free, factor, step = np.zeros(self.shell.reduction.shape[1]), 0.0, 1 / STEPS
        while factor < 1.0:
            try:
                free = self.least(free, min(1.0, factor + step), SOFT)
                factor, step = min(1.0, factor + step), 1.5 * step
            except ArithmeticError:
                step /= 2
                if step < SHORTEST:
                    raise
        return free

    def asked(self, free: Array) -> Array:
        """Drops of the corner and of the long side's end, m; strain energy, J."""
        down = (0.0, 0.0, -1.0)
        drops = [self.shell.row(*place, down) @ free for place in (SIDES, (SIDES[0], 0.0))]
        return np.array([*drops, sum(self.shell.energies(free))])


def _values(mesh: Mesh) -> tuple[Array, Array]:
    """Return the values of the case, extrapolated to a rigid ball, and the size of the extrapolation."""
    cloth, found = Draped(mesh), []
    free, k = cloth.path(), SOFT
    while k < HARD:
        k *= 10**0.5
        free = cloth.least(free, 1.0, k)
        found.append(cloth.asked(free))
    rigid = found[-1] + (found[-1] - found[-2]) / (10**0.5 - 1)
    return rigid, np.abs(rigid - found[-1])


def drape() -> dict[str, Estimate]:
    """Known values; the uncertainty is what the coarser splines and the softer ball change."""
    (fine, soft), (coarse, _) = _values(FINE), _values(COARSE)
    names = (("corner_drop", "m"), ("side_drop", "m"), ("strain_energy", "J"))
    errors = np.abs(fine - coarse) + soft
    found = {name: Estimate(float(v), float(e), u) for (name, u), v, e in zip(names, fine, errors, strict=True)}
    return {**found, "penetration": Estimate(0.0, 1e-12, "m")}


JUDGES = {"contact_drape": drape}
