"""Losses of a trained field at places that it is asked: those of local structures, and those of a mesh's triangles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shellbench.problems.field.body import Body
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.formulas import evaluated
from shellbench.problems.field.structure import EDGES, MIDDLE, OUTER, corners

Array = NDArray[np.float64]
ToTensor = Callable[[NDArray[Any]], Tensor]
"""Makes a tensor of an array, in a number format and on a device."""


def strains(places: Tensor, rest: Tensor) -> Tensor:
    """Return the strain loss (n,) of triangles (n, 3, 3)."""
    lengths = [
        ((places[:, j] - places[:, i]).norm(dim=1) / (rest[:, j] - rest[:, i]).norm(dim=1) - 1) ** 2 for i, j in EDGES
    ]
    return torch.stack(lengths).sum(dim=0)


def bends(places: Tensor) -> Tensor:
    """Return the bending loss (n,) of structures (n, 6, 3)."""
    normals = []
    for a, b, c in (MIDDLE, *OUTER):
        normal = torch.linalg.cross(places[:, b] - places[:, a], places[:, c] - places[:, a])
        normals.append(normal / normal.norm(dim=1, keepdim=True))
    return torch.stack([((normals[0] - n) ** 2).sum(dim=1) for n in normals[1:]]).sum(dim=0)


class Losses:
    """Losses of a field at points (n, 2), with structures turned by angles (n,), and the places that they need.

    One call evaluates the field at all places.
    """

    def __init__(self, case: FieldCase, tensor: ToTensor, points: Array, angles: Array) -> None:
        self.case, self.tensor, self.points, cloth = case, tensor, points, case.cloth
        self.at = {"middle": points[:, None]}
        if case.match is None and cloth is not None:
            counts = {"triangle": (3, cloth.strain), "star": (6, cloth.bend + cloth.collision)}
            needed = {name: count for name, (count, weight) in counts.items() if weight}
            past = cloth.past_edges
            self.at = {name: corners(points, angles, cloth.side, n, past) for name, n in needed.items()} | self.at
        self.places = np.concatenate([at.reshape(-1, 2) for at in self.at.values()])

    def weighted(self, displacement: Tensor) -> Tensor:
        """Return the weighted sum of losses (n,) for the displacement of all places."""
        case, tensor, cloth = self.case, self.tensor, self.case.cloth
        if case.match is not None:
            return ((displacement - tensor(evaluated(case.match.function, self.points))) ** 2).sum(dim=1)
        assert cloth is not None
        parts: Any = torch.split(displacement, [at.shape[0] * at.shape[1] for at in self.at.values()])
        moved = {name: part.reshape(*at.shape[:2], 3) for (name, at), part in zip(self.at.items(), parts, strict=True)}
        rest = {name: tensor(case.rest(at.reshape(-1, 2))).reshape(*at.shape[:2], 3) for name, at in self.at.items()}
        places = {name: rest[name] + moved[name] for name in rest}
        found = cloth.gravity * cloth.mass_gravity * places["middle"][:, 0, 2]
        if cloth.strain:
            found = found + cloth.strain * strains(places["triangle"], rest["triangle"])
        if cloth.bend:
            found = found + cloth.bend * bends(places["star"])
        if case.body is not None:
            found = found + cloth.collision * depths(places["star"], case.body)
        return torch.as_tensor(found)


class MeshLosses(Losses):
    """Losses of a mesh at a field's own places: triangles and pairs of faces of its connectivity (section 4.2).

    Nodes are a lattice of `count` along a side, and one diagonal halves its squares: edges have three directions. Each
    triangle is the middle of a structure, whose outer faces are its neighbours.
    """

    def __init__(self, case: FieldCase, tensor: ToTensor, count: int) -> None:
        self.case, self.tensor = case, tensor
        along, squares = np.linspace(0, 1, count), (count - 1) ** 2
        self.places = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
        nodes = np.arange(count**2).reshape(count, count)
        a, b, c, d = (part.ravel() for part in (nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]))
        self.triangles = np.concatenate([np.stack([a, b, d], axis=1), np.stack([c, d, b], axis=1)])
        low = np.arange(squares).reshape(count - 1, count - 1)
        high = low + squares  # the second triangle of the same square
        pairs = ((low, high), (low[1:], high[:-1]), (low[:, 1:], high[:, :-1]))
        self.pairs = np.concatenate([np.stack([one.ravel(), other.ravel()], axis=1) for one, other in pairs])
        self.points = self.places[self.triangles].mean(axis=1)

    def weighted(self, displacement: Tensor) -> Tensor:
        """Return the weighted sum of losses (t,) of triangles; each pair of faces counts for both, in the mean."""
        case, tensor, cloth = self.case, self.tensor, self.case.cloth
        assert cloth is not None
        rest = tensor(case.rest(self.places))
        faces, resting = (rest + displacement)[self.triangles], rest[self.triangles]
        normal = torch.linalg.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normal = normal / normal.norm(dim=1, keepdim=True)
        apart = normal[self.pairs[:, 0]] - normal[self.pairs[:, 1]]
        found = cloth.strain * strains(faces, resting) + cloth.bend * 2 * (apart**2).sum() / len(faces)
        found = found + cloth.gravity * cloth.mass_gravity * faces[..., 2].mean(dim=1)
        if case.body is not None:  # three corners in the place of six
            found = found + 2 * cloth.collision * depths(faces, case.body)
        return torch.as_tensor(found)


def depths(places: Tensor, body: Body) -> Tensor:
    """Return the collision loss (n,) of structures (n, 6, 3): squares of depths, along normals at the places."""
    distance, normal = body.contact(places.detach().cpu().numpy().reshape(-1, 3).astype(float))
    flat = places.reshape(-1, 3)
    tangent = (torch.as_tensor(array, dtype=flat.dtype, device=flat.device) for array in (distance, normal))
    depth, outward = tangent
    depth = depth + ((flat - flat.detach()) * outward).sum(dim=1)  # the distance, and its slope
    return (torch.clamp(depth, max=0.0) ** 2).reshape(places.shape[:2]).sum(dim=1)
