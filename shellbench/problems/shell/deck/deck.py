"""A deck: a part of a shell on a mesh, with all that holds and loads its nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.deck import nodal
from shellbench.problems.shell.deck.cells import Shape
from shellbench.problems.shell.deck.grid import Grid
from shellbench.problems.shell.question.directions import local_directions
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.problems.shell.symmetry.symmetry import Part

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

IN_SPAN = 1 - 1e-6  # part of the normal along held axes, from which they span it


@dataclass(frozen=True)
class Deck:
    """Nodes and cells, with supports and loads on the nodes; units are the case's.

    Attributes
    ----------
    part
        The part of the shell that is meshed; it lies between planes of symmetry, or is the whole.
    grid
        Its mesh.
    at
        Load factor.
    """

    part: Part
    grid: Grid
    at: float = 1.0

    @classmethod
    def of(
        cls, part: Part, counts: tuple[int, int], shape: Shape = "quad4", distortion: float = 0.0, at: float = 1.0
    ) -> Deck:
        """Mesh a part with so many cells along xi1 and xi2; InputError if it can't be."""
        periodic = part.case.surface.domain.periodic
        return cls(part, Grid(part.lower, part.upper, periodic, counts, shape, distortion), at)

    @cached_property
    def nodes(self) -> Array:
        """(v, 3) places of the nodes on the midsurface, m."""
        return self.part.case.surface.position(self.grid.nodes)

    @property
    def cells(self) -> Integers:
        """(e, k) nodes of each cell, in the order of `shellbench.problems.shell.deck.cells`."""
        return self.grid.cells

    @cached_property
    def normals(self) -> Array:
        """(v, 3) unit normals of the midsurface at the nodes."""
        return local_directions(self.part.case.surface, self.grid.nodes)[:, 2]

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(v, 6) displacements and rotations along x, y and z that are prescribed: supports, mirrors, and pins.

        Pins hold the rigid motions that nothing else holds; `without_rigid` takes these out of an answer.
        """
        mask = nodal.held(self.part.case, self.grid)
        mask.ravel()[nodal.loose(self.part.case, self.grid, mask)[1]] = True
        return mask

    @cached_property
    def held_without_drilling(self) -> NDArray[np.bool_]:
        """(v, 6) as `held`, without rotations about the normal, which many shell elements do not have.

        Where the held axes span the normal, one of them depends on the others: the nearest to the normal is left out.
        """
        mask = self.held.copy()
        along = np.where(mask[:, 3:], np.abs(self.normals), 0.0)
        spanned = np.flatnonzero(np.linalg.norm(along, axis=1) > IN_SPAN)
        mask[spanned, 3 + along[spanned].argmax(axis=1)] = False
        return mask

    @cached_property
    def prescribed(self) -> Array:
        """(v, 6) values of what is held: m, and zero for rotations."""
        return nodal.prescribed(self.part.case, self.grid, self.at)

    @cached_property
    def forces(self) -> Array:
        """(v, 6) forces, N, and moments, N m, on the nodes."""
        return nodal.forces(self.part.case, self.grid, self.at)

    @cached_property
    def thickness(self) -> Array:
        """(v,) thickness at the nodes, m."""
        return self.part.case.isotropic.thickness * self._factors[1]

    @cached_property
    def youngs_modulus(self) -> Array:
        """(v,) Young's modulus at the nodes, Pa."""
        return self.part.case.isotropic.youngs_modulus * self._factors[0]

    @property
    def poissons_ratio(self) -> float:
        """Poisson's ratio."""
        return self.part.case.isotropic.poissons_ratio

    @cached_property
    def _factors(self) -> tuple[Array, Array]:
        case = self.part.case
        modulus, thickness = case.material.factors(self.grid.nodes, case.surface.named_constants)
        return np.broadcast_to(modulus, len(self.nodes)), np.broadcast_to(thickness, len(self.nodes))

    @property
    def unknowns(self) -> int:
        """Displacements and rotations that are free."""
        return int(np.count_nonzero(~self.held))

    @cached_property
    def sets(self) -> Mapping[str, Integers]:
        """Nodes of each named place of the part: edges, corners and points, planes of symmetry among them."""
        found = {}
        for name, place in self.part.case.places.items():
            if isinstance(place, Edge) or (isinstance(place, Point) and self.grid.node_at(place.xi) is not None):
                found[name] = self.grid.nodes_of(place)
        return found

    def without_rigid(self, displacements: Array) -> Array:
        """Return displacements (v, 3) without their mean part along the rigid motions that the case removes."""
        motions, pins = nodal.loose(self.part.case, self.grid, self.held)
        if not len(pins):
            return displacements
        weighted = motions[:, :3] * nodal.areas(self.part.case, self.grid)[:, None, None]
        left = np.einsum("vca,vcb->ab", weighted, motions[:, :3])
        part = np.linalg.solve(left, np.einsum("vca,vc->a", weighted, displacements))
        return np.asarray(displacements - motions[:, :3] @ part)
