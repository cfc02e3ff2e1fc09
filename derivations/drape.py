"""Drapes on a ball, a torus and a prism by finite differences: a quarter of the sheet, mirrored, of least energy by L-BFGS.

It is the limit of structures whose side goes to zero with their bending stiffness kept: strain is the mean over
directions of the flat triangles at the corners of each cell, bending w_b s^2 (3/4 tr^2 k - 2 det k) of second
differences. At a free edge the curvature across it is a third of that along it, for the moment there is none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import torch
from scipy.optimize import minimize

from derivations.estimate import Estimate
from shellbench.bench.catalogue import catalog
from shellbench.solvers.field.mesh_solver import MeshField, solve_mesh

GAP = 0.002  # between a body and the sheet at rest
RADIUS = 0.2  # of the ball
RING, TUBE = 0.2, 0.08  # of the torus
HALF, ROUNDING = 0.25 / math.sqrt(2), 0.03  # side of the square prism, and of its edges
HEIGHT = 0.2
STRAIN, BEND, WEIGHT, COLLISION, SIDE = 0.005, 0.0005, 2 * 6e-4, 2.0, 0.01
CORNERS, DIRECTIONS = 6, 6


def from_ball(places: torch.Tensor) -> torch.Tensor:
    """Return the signed distances (...) of places (..., 3) from the middle of the sheet at rest, m."""
    return (places + torch.tensor([0.0, 0.0, RADIUS + GAP])).norm(dim=-1) - RADIUS


def from_torus(places: torch.Tensor) -> torch.Tensor:
    """Return those from the torus."""
    x, y, z = places.unbind(-1)
    return ((((x**2 + y**2).clamp(min=1e-30)).sqrt() - RING) ** 2 + (z + TUBE + GAP) ** 2).sqrt() - TUBE


def from_prism(places: torch.Tensor) -> torch.Tensor:
    """Return those from the square prism, whose core has half sides less by the rounding."""
    half = torch.tensor([HALF, HALF, HEIGHT / 2]) - ROUNDING
    beyond = (places + torch.tensor([0.0, 0.0, HEIGHT / 2 + GAP])).abs() - half
    outside = (beyond.clamp(min=0.0) ** 2).sum(-1).clamp(min=1e-30).sqrt()
    return outside + beyond.amax(-1).clamp(max=0.0) - ROUNDING


BODIES = {"field_drape": from_ball, "field_torus": from_torus, "field_prism": from_prism}


class Quarter:
    """A quarter of the sheet: vertices (n + 1, n + 1) from the pinned middle to the edges, at distances 1/2 n."""

    def __init__(self, count: int, distance: Callable[[torch.Tensor], torch.Tensor] = from_ball) -> None:
        self.count, self.step, self.distance = count, 0.5 / count, distance
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
        depth = torch.clamp(self.distance(places), max=0.0)
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


TRIANGLES = {"field_drape": 48, "field_torus": 76, "field_prism": 76}
"""Columns of the mesh."""
CELLS = 32  # of a quarter
BOUNDS = {
    "field_drape": {"corner": 1e-4, "edge": 5e-4, "penetration": 1e-4, "energy": 1e-6},
    "field_torus": {"corner": 2e-4, "edge": 1e-3, "penetration": 1e-4, "energy": 1e-6},
    "field_prism": {"corner": 2e-4, "edge": 2e-3, "penetration": 3e-4, "energy": 1e-6},
}
"""Uncertainty of the values: what meshes of triangles (52, 64, 76), differences (24, 32 cells of a quarter, in the same
state) and a grid (96 cells on the ball, 60 on the others) differ by, but for the last, whose structures have a side."""


@cache
def triangles(name: str) -> MeshField:
    """Return the sheet as a mesh of triangles, from where it lies flat; it shares nothing with grids."""
    return solve_mesh(catalog.named_case(name), TRIANGLES[name], lambda _: None)


def by_triangles(name: str) -> dict[str, Estimate]:
    """Return the figures of the mesh."""
    found = triangles(name)
    values = {quantity.name: quantity.measure(found) for quantity in found.case.quantities}
    places = found.mesh.rest + found.tensors["vertices"]  # between vertices triangles cut into the body
    values["penetration"] = -float(found.case.body.distance(places).min())
    return {quantity: Estimate(value, BOUNDS[name][quantity], "") for quantity, value in values.items()}


def by_differences(name: str) -> dict[str, Estimate]:
    """Return those of finite differences, in the state that the mesh is near; differences converge more slowly."""
    sheet, found = Quarter(CELLS, BODIES[name]), triangles(name)
    rest = sheet.rest.numpy()
    moved = found.displacement(np.minimum(rest.reshape(-1, 3)[:, :2] + 0.5, 1.0))
    places = sheet.least(rest + moved.reshape(rest.shape))
    values = {
        "corner": places[-1, -1, 2],
        "edge": places[0, -1, 2],
        "penetration": -float(sheet.distance(torch.tensor(places)).min()),
        "energy": float(sheet.energy(torch.tensor(places))),
    }
    return {quantity: Estimate(float(value), 5 * BOUNDS[name][quantity], "") for quantity, value in values.items()}
