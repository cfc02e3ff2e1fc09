"""Division of nodal forces among the supports that hold a node.

A support bears the force along its own edges. If several supports hold the same direction at a node, the node's force
has two parts: the forces of their edges over half a cell, and a force concentrated at the point, such as twice the
twisting moment at a plate's corner. By convention, each of the supports bears an equal share of the concentrated force.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.problems.shell.question.places import Edge, Place, Point
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

# A condition this close to a combination of the others is redundant, and must agree with them: the root of rounding.
RANK_TOLERANCE = 1e-8
CENTROID = 3 / 10  # of the Hermite cubic that is 1 at 0 and 0 at 1, from 0


@dataclass(frozen=True)
class Conditions:
    """Linear conditions on the degrees of freedom of n nodes, r of each.

    Attributes
    ----------
    support
        Number of the support that states them; -1 if a fold does.
    nodes
        (n,) different nodes.
    rows
        (n, r, 12) coefficients of the scaled degrees of freedom.
    values
        (n, r, states) right-hand sides.
    acting
        (n, 12) degrees of freedom on which the support can exert a force; a clamp acts on all slopes across its edge.
    edge
        Edge on which the nodes lie in a row, or None.
    """

    support: int
    nodes: Integers
    rows: Array
    values: Array
    acting: Flags
    edge: Edge | None


def support_nodes(mesh: TensorMesh, place: Place) -> Integers:
    """Return the nodes (n,) of a place."""
    match place:
        case Edge():
            return mesh.edge_nodes(place)
        case Point():
            return np.array([mesh.node_at(place.xi)])
        case _:
            return np.arange(mesh.node_count)


@dataclass(frozen=True)
class EdgeEnd:
    """The end of a support's edge: its force there is a sum of those at the next two nodes along it."""

    support: int
    node: int
    beside: tuple[int, int]
    parts: tuple[float, float]


def edge_ends(support: int, nodes: Integers, line: Array) -> Iterator[EdgeEnd]:
    """Yield both ends of an edge with nodes (n,) at coordinates (n,)."""
    # The force per length is linear over the first three cells. A nodal force is its value at the centroid of the
    # node's function, times half of the cells at the node.
    if len(nodes) < 4:
        return
    for order in (slice(None), slice(None, None, -1)):
        first, second, third = np.abs(np.diff(line[order])[:3])
        at = np.array([first + CENTROID * (second - first), first + second + CENTROID * (third - second)])
        ahead = (at[0] - CENTROID * first) / (at[1] - at[0])
        parts = first * np.array([1 + ahead, -ahead]) / np.array([first + second, second + third])
        end, *beside = nodes[order][:3]
        yield EdgeEnd(support, int(end), (int(beside[0]), int(beside[1])), (float(parts[0]), float(parts[1])))


@dataclass(frozen=True)
class Sharing:
    """Division of the forces at k nodes with d degrees of freedom among s supports.

    Attributes
    ----------
    holders
        (k, s, d) True if a support acts on a degree of freedom.
    values
        (3,) the degrees of freedom that are components of the displacement.
    ends
        Ends of the supports' edges, their nodes numbered as here.
    meeting, division
        (m,) nodes where several supports act on one degree of freedom, and (m, s, d, d) maps from the forces there to
        the part of each support.
    """

    holders: Flags
    values: Integers
    ends: tuple[EdgeEnd, ...]
    meeting: Integers
    division: Array

    @classmethod
    def from_conditions(
        cls, stated: Sequence[Conditions], nodes: Integers, rows: Array, owners: Integers, mesh: TensorMesh
    ) -> Sharing:
        """Divide by the rows (k, r, d) at nodes (k,), and the supports (k, r) that state them."""
        count = 1 + max((c.support for c in stated), default=-1)
        holders, found = np.zeros((len(nodes), count, rows.shape[2]), dtype=bool), list[EdgeEnd]()
        for c in stated:
            at = np.searchsorted(nodes, c.nodes)
            holders[at, c.support] |= c.acting
            if c.edge is not None and not mesh.domain.periodic[1 - c.edge.axis]:
                found += edge_ends(c.support, at, mesh.node_points[c.nodes, 1 - c.edge.axis])
        # A force R^T m has its least multipliers m: unique where conditions differ, equal where they are the same.
        meeting = np.flatnonzero((holders.sum(axis=1) > 1).any(axis=1))
        least = np.swapaxes(np.linalg.pinv(rows[meeting], rcond=RANK_TOLERANCE), 1, 2)
        own = owners[meeting, None] == np.arange(count)[:, None]
        division = np.swapaxes(rows[meeting, None] * own[..., None], 2, 3) @ least[:, None]
        values = np.arange(len(COMPONENTS)) * len(mesh.kinds)
        return cls(holders, values, tuple(end for end in found if end.node in meeting), meeting, division)

    def shares(self, forces: Array) -> Array:
        """Return the part (s, k, d, n) of each support in nodal forces (k, d, n)."""
        # 1. Extrapolate the forces of edges along their last cells from the nodes beside.
        # 2. Divide the rest by the conditions, as far as these differ.
        # 3. Divide the remainder, such as that of a clamp's terms, into equal shares by convention.
        result = np.zeros((self.holders.shape[1], *forces.shape))
        for end in self.ends:
            near = sum(part * forces[node, self.values] for node, part in zip(end.beside, end.parts, strict=True))
            result[end.support, end.node, self.values] += near * self.holders[end.node, end.support, self.values, None]
        rest = (forces - result.sum(axis=0))[self.meeting, None]
        result[:, self.meeting] += np.swapaxes(self.division @ rest, 0, 1)
        equal = self.holders / np.maximum(self.holders.sum(axis=1, keepdims=True), 1)
        return np.asarray(result + np.swapaxes(equal, 0, 1)[..., None] * (forces - result.sum(axis=0)))
