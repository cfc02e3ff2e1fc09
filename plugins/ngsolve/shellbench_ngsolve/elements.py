"""A mesh of NGSolve on a case's true midsurface, and its polynomials as arrays.

The mesh has the corners of a deck's triangles. Its curved triangles interpolate the surface at the places of a lattice:
a displacement of the flat triangles (`SetDeformation`) carries them there. Netgen's own way, `Curve`, asks a function
of Python 14,000 times for each triangle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import netgen.meshing as netgen
import ngsolve
import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.quantities.measure import load_density
from shellbench.problems.shell.question.loads import EdgeLoad, PointLoad
from shellbench.problems.shell.question.places import Edge, Point

Array = NDArray[np.float64]
SIDES = ("xi1_min", "xi1_max", "xi2_min", "xi2_max")
CORNERS = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])  # of NGSolve's reference triangle
MIDDLES = np.array([[0.5, 0.5], [0.0, 0.5], [0.5, 0.0]])  # of its sides: first to second corner, and so on
MORE_POINTS = 2  # points of Gauss's rule beyond the degree: loads and areas are no polynomials


def barycentric(places: Array) -> Array:
    """Return the shares (n, 3) of the corners at places (n, 2) of the reference triangle."""
    return np.column_stack([places, 1 - places.sum(axis=-1)])


@dataclass(frozen=True)
class CurvedMesh:
    """Curved triangles of one degree on a part of a shell.

    Attributes
    ----------
    deck
        Its corners are the nodes, its cells the triangles.
    degree
        Of the triangles' shape, and of displacements.
    """

    deck: Deck
    degree: int

    @cached_property
    def mesh(self) -> Any:
        """NGSolve's mesh; its sides are named as `SIDES`."""
        made, grid = netgen.Mesh(dim=3), self.deck.grid
        points = [made.Add(netgen.MeshPoint(netgen.Pnt(*map(float, x)))) for x in self.deck.nodes]
        face = made.Add(netgen.FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
        for cell in self.deck.cells:
            made.Add(netgen.Element2D(face, [points[v] for v in cell]))
        for number, name in enumerate(SIDES):
            axis, last = divmod(number, 2)
            made.SetCD2Name(number + 1, name)
            if not grid.closed[axis]:
                nodes = grid.edge(axis, bool(last))
                for a, b in pairwise(nodes):
                    made.Add(netgen.Element1D([points[a], points[b]], index=number + 1))
        return ngsolve.Mesh(made)

    @cached_property
    def scalars(self) -> Any:
        """Continuous polynomials, of which each component of a displacement is one."""
        return ngsolve.H1(self.mesh, order=self.degree)

    def curve(self) -> None:
        """Carry the flat triangles to the midsurface."""
        degree = self.degree
        lattice = np.array([(i / degree, j / degree) for i in range(degree + 1) for j in range(degree + 1 - i)])
        space = ngsolve.VectorH1(self.mesh, order=degree)
        moved = ngsolve.GridFunction(space)
        values = np.zeros((self.scalars.ndof, 3))
        for dofs, corners, shapes in self.triangles(lattice):
            offset = self._position(self.xi_at(corners, lattice)) - barycentric(lattice) @ self.deck.nodes[corners[0]]
            values[dofs] = np.linalg.solve(shapes, offset)
        for c in range(3):
            moved.components[c].vec.FV().NumPy()[:] = values[:, c]
        self.mesh.SetDeformation(moved)  # NGSolve keeps no reference: `mesh` must
        self.mesh.kept = moved

    def _position(self, xi: Array) -> Array:
        return self.deck.part.case.surface.position(xi)

    def xi_at(self, corners: tuple[Array, Array], places: Array) -> Array:
        """Return coordinates (n, 2) of the surface at places (n, 2) of a triangle with these corners."""
        return np.asarray(barycentric(places) @ corners[1])

    def triangles(self, places: Array) -> Iterator[tuple[list[int], tuple[Any, Array], Array]]:
        """Yield of each triangle: its unknowns (k,), its corners, and the shape functions (n, k) at places (n, 2).

        Corners are their nodes (3,) and their coordinates (3, 2), in NGSolve's order.
        """
        xi = self.deck.grid.mesh.xi[self.deck.grid.mesh.cells]
        for number, element in enumerate(self.scalars.Elements(ngsolve.BND)):
            nodes = np.array([vertex.nr for vertex in element.vertices])
            order = [list(self.deck.cells[number]).index(node) for node in nodes]
            finite = self.scalars.GetFE(ngsolve.ElementId(ngsolve.BND, number))
            shapes = np.array([list(finite.CalcShape(x, y)) for x, y in places])
            yield list(element.dofs), (nodes, xi[number][order]), shapes

    def loads(self) -> Array:
        """Return the work (m, 3) of all loads at each scalar unknown, along x, y and z.

        Areas and lengths are those of the true midsurface and its edges.
        """
        case, x, w = self.deck.part.case, *np.polynomial.legendre.leggauss(self.degree + MORE_POINTS)
        s, t = (a.ravel() for a in np.meshgrid((x + 1) / 2, (x + 1) / 2, indexing="ij"))
        places, weights = np.column_stack([s * (1 - t), t]), np.outer(w, w).ravel() / 4 * (1 - t)
        total = np.zeros((self.scalars.ndof, 3))
        for dofs, corners, shapes in self.triangles(places):
            points, sides = self.xi_at(corners, places), corners[1][:2] - corners[1][2]
            first = case.surface.derivatives(points, order=1)
            areas = np.linalg.norm(np.cross(first[1, 0], first[0, 1]), axis=-1) * abs(np.linalg.det(sides))
            density = load_density(case, points, self.deck.at)
            total[dofs] += shapes.T @ ((weights * areas)[:, None] * density)
        for load in case.loads:
            for place in (case.places[name] for name in (load.on if isinstance(load, EdgeLoad | PointLoad) else ())):
                if isinstance(load, EdgeLoad) and isinstance(place, Edge):
                    self._add_edge(case, load, place, (x + 1) / 2, w / 2, total)
                elif isinstance(load, PointLoad) and isinstance(place, Point):
                    force = case.evaluate(load.force, np.asarray(place.xi), self.deck.at)[0, 0]
                    total[self.deck.grid.nodes_of(place)] += force  # at a corner one shape function alone is not zero
        return total

    def _add_edge(self, case: Case, load: EdgeLoad, edge: Edge, local: Array, weights: Array, total: Array) -> None:
        """Add the work of a load on an edge, by Gauss's rule on the sides of triangles that lie on it."""
        on = set(self.deck.grid.edge(edge.axis, edge.side == "max").tolist())
        running = 1 - edge.axis
        for k in range(3):
            a, b = CORNERS[k], CORNERS[(k + 1) % 3]
            places = a + local[:, None] * (b - a)
            for dofs, corners, shapes in self.triangles(places):
                if {corners[0][k], corners[0][(k + 1) % 3]} <= on:
                    points = self.xi_at(corners, places)
                    tangent = case.surface.derivatives(points, order=1)[(0, 1) if running == 1 else (1, 0)]
                    step = abs(corners[1][(k + 1) % 3, running] - corners[1][k, running])
                    lengths = weights * step * np.linalg.norm(tangent, axis=-1)
                    density = case.evaluate(load.vector, points, self.deck.at)[0, 0]
                    total[dofs] += shapes.T @ (lengths[:, None] * density)

    def at_nodes(self, values: Array, deck: Deck) -> Array:
        """Return a displacement (v, 3) at the nodes of a deck with these cells of six nodes, from (m, 3) unknowns."""
        result = np.empty((len(deck.nodes), 3))
        middles = {(k, (k + 1) % 3): 3 + k for k in range(3)}
        for number, (dofs, corners, shapes) in enumerate(self.triangles(np.concatenate([CORNERS, MIDDLES]))):
            order = [list(self.deck.cells[number]).index(node) for node in corners[0]]
            sides = [(order[k], order[(k + 1) % 3]) for k in range(3)]
            nodes = [*order, *(middles.get(side, middles.get(side[::-1])) for side in sides)]
            result[deck.cells[number][nodes]] = shapes @ values[dofs]
        return result
