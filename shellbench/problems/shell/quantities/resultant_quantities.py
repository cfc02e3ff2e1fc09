"""Stress resultants as quantities: membrane forces, moments and transverse shear forces, per length.

They are components in the shell's own orthonormal frame: e_1 along the coordinate line of xi1, e_3 the normal along a_1
x a_2, and e_2 = e_3 x e_1 within the surface. With n^ab and m^ab conjugate to the strains of the theory,

    n_ij = n^ab (a_a . e_i)(a_b . e_j),    m_ij likewise,    q_i = (m^ab|_b)(a_a . e_i).

A positive moment stretches the side to which the normal points. The shear force follows from the equilibrium of
moments: on the side to which e_i points it pushes along the normal. Each solver computes resultants with its own
mechanics.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.question.conditions import Places
from shellbench.problems.shell.question.folds import ASIDE, Fold
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Edge, Point

Array = NDArray[np.float64]

PANELS, PANEL_POINTS = 16, 4  # of the rule along an edge
NEAR = 1e-9  # of a side: points that are nearer to each other are the same
COLUMNS = {"11": 0, "22": 1, "12": 2, "1": 0, "2": 1}


class PlacedQuantity(ShellQuantity):
    """A stress resultant or a stress at a point, its mean over points, or its mean along edges.

    Attributes
    ----------
    on
        Its places: corners and named points, or edges and parts of them.
    fold_side
        At points on a fold, the side on which it is taken: that of the smaller coordinate is "before".
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    on: Places
    fold_side: Literal["before", "after"] | None = None

    @property
    def places(self) -> tuple[str, ...]:
        """Names of its points or edges."""
        return self.on

    def check(self, shell: Any) -> None:
        """Raise ValueError if it has no value there, or the shell has no linear theory at rest."""
        if not shell.linear or shell.modal:
            raise ValueError(f"quantity '{self.name}' needs the theory kirchhoff-love-linear and a shell at rest")
        kinds = {type(shell.places[name]) for name in self.on}
        if kinds not in ({Point}, {Edge}):
            raise ValueError(f"quantity '{self.name}' needs points, or edges: 'on' is {list(self.on)}")
        domain = shell.surface.domain
        on_fold = {name for name in self.on if isinstance(shell.places[name], Point) and self._folds_at(shell, name)}
        if on_fold and self.fold_side is None:
            raise ValueError(
                f"quantity '{self.name}' is on '{min(on_fold)}', which lies on a fold: fold_side must be 'before' or"
                " 'after', since forces and moments differ there"
            )
        if self.fold_side is not None and on_fold != set(self.on):
            raise ValueError(f"quantity '{self.name}' has a fold_side, but not all of its places are points on folds")
        for what, name in _forced_points(shell):
            forced = domain.wrap(shell.places[name].xi)
            for place in (shell.places[on] for on in self.on):
                at = place.xi if isinstance(place, Point) else place.project(domain, forced)
                on_it = isinstance(place, Point) or bool(place.covers(domain, forced[1 - place.axis]))
                if on_it and np.all(np.abs(domain.wrap(at) - forced) <= NEAR * np.asarray(domain.size)):
                    raise ValueError(
                        f"quantity '{self.name}' has no value on '{place.name}': {what} acts at its point '{name}',"
                        " and forces and moments are infinite there"
                    )

    def corner_of(self, shell: Any) -> tuple[str, tuple[int, int]] | None:
        """Return the name of the first corner among its places, and the sides (0 or 1) of both coordinates; or None."""
        domain = shell.surface.domain
        if any(domain.periodic):
            return None
        for place in (shell.places[name] for name in self.on):
            share = (np.array(getattr(place, "xi", (np.nan, np.nan))) - domain.lower) / np.asarray(domain.size)
            if np.all(np.minimum(np.abs(share), np.abs(share - 1)) <= NEAR):
                return place.name, (round(share[0]), round(share[1]))
        return None

    @staticmethod
    def _folds_at(shell: Any, name: str) -> list[Fold]:
        """Return the folds on which a point lies."""
        domain, xi = shell.surface.domain, shell.places[name].xi
        size = domain.size
        return [f for f in shell.surface.fold_lines if abs(domain.wrap(xi)[f.axis] - f.at) <= NEAR * size[f.axis]]

    def check_motion(self, shell: Any, constant: bool) -> None:
        """Raise ValueError: only shells at rest have it."""
        raise ValueError(f"quantity '{self.name}' belongs to a case without [dynamics]")

    def rule(self, shell: Any) -> tuple[Array, Array]:
        """Return points (n, 2) and weights (n,) of its mean."""
        places = [shell.places[name] for name in self.on]
        if isinstance(places[0], Point):
            points = np.array([place.xi for place in places])
            shift = 4 * ASIDE * (-1 if self.fold_side == "before" else 1)
            for row, name in zip(points, self.on if self.fold_side else (), strict=False):
                for fold in self._folds_at(shell, name):
                    row[fold.axis] += shift * shell.surface.domain.size[fold.axis]
            return points, np.full(len(places), 1 / len(places))
        rules = [along_edge(shell, edge) for edge in places]
        weights = np.concatenate([w for _, w in rules])
        return np.concatenate([points for points, _ in rules]), weights / weights.sum()


class ResultantQuantity(PlacedQuantity):
    """A stress resultant, which solvers give by its kind."""

    def component_of(self, values: Array) -> Array:
        """Return the component (n,) that is asked for, of values (n, 3) or (n, 2) in the shell's frame."""
        raise NotImplementedError

    def measure(self, solution: DisplacementField) -> float:
        """Return the resultant, N/m or N, or its mean."""
        points, weights = self.rule(solution.case)
        values = self.turned(solution.case, points, solution.evaluate(self.kind, points, at=self.at))
        return float(weights @ self.component_of(values))

    def turned(self, shell: Any, points: Array, values: Array) -> Array:
        """Return values at points, which are in the shell's frame, in the axes that are asked for."""
        return values


class TensorResultant(ResultantQuantity):
    """A resultant that is a symmetric tensor of the surface.

    Attributes
    ----------
    component
        In the frame of its axes; or a principal value, of which the first is the larger one.
    axes
        The shell's frame, or the directions 1 and 2 of an orthotropic material.
    """

    component: Literal["11", "22", "12", "principal_1", "principal_2"]
    axes: Literal["shell", "material"] = "shell"

    def check(self, shell: Any) -> None:
        """Raise ValueError if it has no value there, or the material no axes."""
        super().check(shell)
        if self.axes == "material" and shell.material.kind != "orthotropic":
            raise ValueError(f"quantity '{self.name}' is along the axes of the material, and an isotropic one has none")

    def turned(self, shell: Any, points: Array, values: Array) -> Array:
        """Return values (n, 3) in its axes."""
        return values if self.axes == "shell" else turned_tensor(values, *material_axis(shell, points))

    def component_of(self, values: Array) -> Array:
        """Return the component (n,) of values (n, 3): 11, 22, 12."""
        return tensor_component(values, self.component)


def material_axis(shell: Any, points: Array) -> tuple[Array, Array]:
    """Return the share of direction 1 of an orthotropic material along e_1 and e_2 of the shell's frame, each (n,)."""
    x, material = shell.surface.derivatives(points, order=1), shell.material
    first, line = x[1, 0], x[1, 0] if material.along == "xi1" else x[0, 1]
    second = np.cross(np.cross(x[1, 0], x[0, 1]), first)
    lengths = (np.linalg.norm(e, axis=1) for e in (first, second))
    along, aside = (np.sum(e * line, axis=1) / size for e, size in zip((first, second), lengths, strict=True))
    angle = np.arctan2(aside, along) + np.radians(material.angle)
    return np.cos(angle), np.sin(angle)


def turned_tensor(values: Array, c: Array, s: Array) -> Array:
    """Return tensors 11, 22, 12 (n, 3) in axes, of which the first has the cosine and sine (n,)."""
    first, second, shear = values.T
    both = 2 * c * s * shear
    turned = c * c * first + both + s * s * second, s * s * first - both + c * c * second
    return np.stack([*turned, c * s * (second - first) + (c * c - s * s) * shear], axis=1)


def tensor_component(values: Array, component: str) -> Array:
    """Return a component or a principal value (n,) of symmetric tensors 11, 22, 12 (n, 3)."""
    if component in COLUMNS:
        return np.asarray(values[:, COLUMNS[component]])
    first, second, shear = values.T
    radius = np.hypot((first - second) / 2, shear)
    return np.asarray((first + second) / 2 + (radius if component == "principal_1" else -radius))


class MembraneForce(TensorResultant):
    """A membrane force, N/m."""

    powers: ClassVar[tuple[int, int]] = (-1, 1)
    kind: Literal["membrane_force"]
    unit: str = "N/m"


class Moment(TensorResultant):
    """A bending or twisting moment per length, N; positive where it stretches the side to which the normal points."""

    powers: ClassVar[tuple[int, int]] = (0, 1)
    kind: Literal["moment"]
    unit: str = "N"


class ShearForce(ResultantQuantity):
    """A transverse shear force, N/m, from the equilibrium of moments.

    Attributes
    ----------
    component
        Direction in the surface, in the shell's frame, of the normal of the section on which it acts.
    """

    powers: ClassVar[tuple[int, int]] = (-1, 1)
    kind: Literal["shear_force"]
    component: Literal["1", "2"]
    unit: str = "N/m"

    def component_of(self, values: Array) -> Array:
        """Return the component (n,) of values (n, 2)."""
        return np.asarray(values[:, COLUMNS[self.component]])


def _forced_points(shell: Any) -> Iterator[tuple[str, str]]:
    """Yield the supports and loads at single points, with the names of these points."""
    for load in shell.loads:
        if isinstance(load, PointLoad):
            yield from (("a point load", name) for name in load.on)
    for support, place in shell.supported_places():
        if isinstance(place, Point):
            yield f"support '{support.name}'", place.name


def along_edge(shell: Any, edge: Edge) -> tuple[Array, Array]:
    """Return points (n, 2) and weights (n,), m, that integrate along an edge: Gauss's rule on panels."""
    domain, running = shell.surface.domain, 1 - edge.axis
    start, stop = edge.bounds(domain)
    inside = [at for at in shell.kinks[running] if start < at < stop]
    ends = np.unique([*np.linspace(start, stop, PANELS + 1), *inside])
    x, w = np.polynomial.legendre.leggauss(PANEL_POINTS)
    half = np.diff(ends)[:, None] / 2
    points = edge.points(domain, (ends[:-1, None] + half * (x + 1)).ravel())
    tangents = shell.surface.derivatives(points, order=1)[(0, 1) if running else (1, 0)]
    return points, (half * w).ravel() * np.linalg.norm(tangents, axis=-1)
