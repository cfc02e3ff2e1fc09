"""The drape on a ball by finite differences: a quarter of the sheet, mirrored, of least energy by L-BFGS.

It is the limit of structures whose side goes to zero with their bending stiffness kept: strain is the mean over
directions of the flat triangles at the corners of each cell, bending w_b s^2 (3/4 tr^2 k - 2 det k) of second
differences. At a free edge the curvature across it is a third of that along it, for the moment there is none.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import torch
from scipy.optimize import minimize

from derivations.estimate import Estimate
from shellbench.bench.catalogue import catalog
from shellbench.solvers.field.mesh_solver import MeshField, solve_mesh

RADIUS, GAP = 0.2, 0.002
STRAIN, BEND, WEIGHT, COLLISION, SIDE = 0.005, 0.0005, 2 * 6e-4, 2.0, 0.01
CORNERS, DIRECTIONS = 6, 6


class Quarter:
    """A quarter of the sheet: vertices (n + 1, n + 1) from the pinned middle to the edges, at distances 1/2 n."""

    def __init__(self, count: int) -> None:
        self.count, self.step = count, 0.5 / count
        along = torch.arange(count + 1, dtype=torch.float64) * self.step
        self.rest = torch.stack(
            [*torch.meshgrid(along, along, indexing="ij"), torch.zeros(count + 1, count + 1)], dim=2
        )
        self.rest = self.rest.double()
        ends = torch.ones(count + 1, dtype=torch.float64)
        ends[0] = ends[-1] = 0.5
        self.share = self.step**2 * ends[:, None] * ends[None, :]
        self.free = torch.ones_like(self.rest)
        self.free[0, :, 0] = 0.0  # mirrored
        self.free[:, 0, 1] = 0.0
        self.free[0, 0] = 0.0  # pinned
        angle = math.pi * torch.arange(DIRECTIONS, dtype=torch.float64) / DIRECTIONS
        self.directions = torch.stack([torch.cos(angle), torch.sin(angle)])

    def second(self, places: torch.Tensor, axis: int) -> torch.Tensor:
        """Return second differences along an axis; zero on the free edge, mirrored in the middle."""
        x = places.transpose(0, axis)
        mirror = torch.tensor([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]][axis], dtype=torch.float64)
        padded = torch.cat([x[1:2] * mirror, x])
        found = (padded[2:] - 2 * padded[1:-1] + padded[:-2]) / self.step**2
        return torch.cat([found, torch.zeros_like(x[:1])]).transpose(0, axis)

    def energy(self, places: torch.Tensor) -> torch.Tensor:
        """Return four times the energy of a quarter."""
        du, dv = (places[1:] - places[:-1]) / self.step, (places[:, 1:] - places[:, :-1]) / self.step
        strain = torch.zeros((), dtype=torch.float64)
        for one in (du[:, :-1], du[:, 1:]):
            for other in (dv[:-1], dv[1:]):
                edges = one[..., None] * self.directions[0] + other[..., None] * self.directions[1]
                strain = strain + 3 * ((edges.norm(dim=2) - 1) ** 2).mean(dim=2).sum() * self.step**2 / 4
        uu, vv = self.second(places, 0), self.second(places, 1)
        uv = (du[:, 1:] - du[:, :-1]) / self.step
        whole = 0.75 * ((uu**2).sum(2) + (vv**2).sum(2)) - 0.5 * (uu * vv).sum(2)
        edge = 2 / 3 * ((uu**2).sum(2) + (vv**2).sum(2))  # one of them is zero there
        inside = torch.ones_like(whole)
        inside[-1], inside[:, -1] = 0.0, 0.0
        bend = (self.share * (inside * whole + (1 - inside) * edge)).sum() + 2 * (uv**2).sum() * self.step**2
        centre = torch.tensor([0.0, 0.0, -RADIUS - GAP], dtype=torch.float64)
        depth = torch.clamp((places - centre).norm(dim=2) - RADIUS, max=0.0)
        pushed = CORNERS * COLLISION * depth**2 + WEIGHT * places[..., 2]
        return 4 * (STRAIN * strain + BEND * SIDE**2 * bend + (self.share * pushed).sum())

    def least(self, start: np.ndarray, steps: int = 20_000) -> np.ndarray:
        """Return the places of least energy near where they start, (n + 1, n + 1, 3)."""
        scale = torch.sqrt(self.share.max() / self.share)[..., None] * self.free

        def both(x: np.ndarray) -> tuple[float, np.ndarray]:
            moved = torch.tensor(x.reshape(self.rest.shape), requires_grad=True)
            value = self.energy(self.rest + moved * scale) * 1e4
            (slope,) = torch.autograd.grad(value, moved)
            return float(value.detach()), slope.numpy().ravel()

        first = start - self.rest.numpy()
        first = np.where(scale.numpy() > 0, first / np.where(scale.numpy() > 0, scale.numpy(), 1), 0)
        options = {"maxiter": steps, "maxfun": 2 * steps, "maxcor": 40, "ftol": 1e-15, "gtol": 1e-9}
        found = minimize(both, first.ravel(), jac=True, method="L-BFGS-B", options=options)
        return np.asarray(self.rest.numpy() + found.x.reshape(self.rest.shape) * scale.numpy())


TRIANGLES, CELLS = 48, 32  # columns of the mesh; cells of a quarter
BOUNDS = {"corner": 1e-4, "edge": 5e-4, "penetration": 1e-4, "energy": 1e-6}
"""Uncertainty of the values: what two meshes of triangles (52, 76), differences (24, 32 cells of a quarter, in the
same state) and a grid of 96 cells differ by, but for the last, whose structures have a side."""


@cache
def triangles() -> MeshField:
    """Return the sheet as a mesh of triangles, from where it lies flat; it shares nothing with grids."""
    return solve_mesh(catalog.named_case("field_drape"), TRIANGLES, lambda _: None)


def by_triangles() -> dict[str, Estimate]:
    """Return the figures of the mesh."""
    found = triangles()
    values = {quantity.name: quantity.measure(found) for quantity in found.case.quantities}
    places = found.mesh.rest + found.tensors["vertices"]  # between vertices triangles cut into the ball
    values["penetration"] = -float(found.case.body.distance(places).min())
    return {name: Estimate(value, BOUNDS[name], "") for name, value in values.items()}


def by_differences() -> dict[str, Estimate]:
    """Return those of finite differences, in the state that the mesh is near; differences converge more slowly."""
    sheet, found = Quarter(CELLS), triangles()
    rest = sheet.rest.numpy()
    moved = found.displacement(np.minimum(rest.reshape(-1, 3)[:, :2] + 0.5, 1.0))
    places = sheet.least(rest + moved.reshape(rest.shape))
    centre = np.array([0.0, 0.0, -RADIUS - GAP])
    values = {
        "corner": places[-1, -1, 2],
        "edge": places[0, -1, 2],
        "penetration": RADIUS - np.linalg.norm(places - centre, axis=2).min(),
        "energy": float(sheet.energy(torch.tensor(places))),
    }
    return {name: Estimate(float(value), 5 * BOUNDS[name], "") for name, value in values.items()}
