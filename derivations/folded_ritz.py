r"""Prismatic shells of flat strips and arcs joined along straight folds, by Ritz's method with polynomials.

A section in the plane (y, z) is a chain or net of strips; s runs along a strip from its first node to its second, with the angle
phi from y, phi' = k constant, t = (cos phi, sin phi) and n = e_x cross t. From u = u e_x + v t + w n,

    u,x = u_x e_x + v_x t + w_x n,    u,s = u_s e_x + (v_s - k w) t + (w_s + k v) n,

follow the linear strains eps_ab = (a_a . u,b + a_b . u,a) / 2 and kappa_ab = -u,ab . n (all Christoffel symbols vanish):

    eps_x = u_x       eps_s = v_s - k w                    2 eps_xs = u_s + v_x
    kap_x = -w_xx     kap_s = -(w_ss + 2 k v_s - k^2 w)    2 kap_xs = -2 (w_xs + k v_x)

Trial functions are products of polynomials in s and in x. Those in s are the end functions and bubbles of `strip`. End functions
of strips at a node are tied: they share u, the displacement along y and z, and the rotation w_s + k v about e_x. So a fold keeps
its angle, and balance of forces and moments is natural. Polynomials in x meet what the ends hold: each component has its
own set, that of v may be larger than that of w inside a strip. At a fold, v of one strip is w of another, and has the set of w.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.linalg import cho_factor, cho_solve

from .strip import Strip
from .surface_strains import Array

STRAINS = ("eps_x", "eps_s", "eps_xs", "kap_x", "kap_s", "kap_xs")
"""Names of strains; the mixed ones are doubled."""


@dataclass(frozen=True)
class Wall:
    """A strip of a section: its nodes, its direction at the start (rad from y), its width (m) and curvature phi' (1/m)."""

    start: int
    end: int
    direction: float
    width: float
    curvature: float = 0.0

    def frame(self, s: float) -> Array:
        """Rows t and n (2, 2) along y and z."""
        phi = self.direction + self.curvature * s
        return np.array([[np.cos(phi), np.sin(phi)], [-np.sin(phi), np.cos(phi)]])


def flat_walls(nodes: Sequence[tuple[float, float]], strips: Sequence[tuple[int, int]]) -> list[Wall]:
    """Walls of a polyline."""
    walls = []
    for first, second in strips:
        y, z = np.subtract(nodes[second], nodes[first])
        walls.append(Wall(first, second, float(np.arctan2(z, y)), float(np.hypot(y, z))))
    return walls


ENDS = {"free": (), "zero": (0,), "even": (1,), "clamped": (0, 1)}
"""Orders of the derivatives that vanish at an end of x, by its condition."""


@dataclass(frozen=True)
class Lengthwise:
    """Polynomials of x between breaks, joined by value and slope; `start` and `end` are names of `ENDS`."""

    breaks: tuple[float, ...]
    degree: int
    start: str = "free"
    end: str = "free"

    @cached_property
    def _numbers(self) -> tuple[Array, int]:
        """Number of each function of each span (-1: held), and their count: value and slope by break, then bubbles."""
        spans, free = len(self.breaks) - 1, np.ones((len(self.breaks), 2), dtype=bool)
        for place, name in ((0, self.start), (-1, self.end)):
            free[place, list(ENDS[name])] = False
        at_breaks = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        count = int(free.sum())
        bubbles = count + np.arange(spans * (self.degree - 3)).reshape(spans, -1)
        numbers = [np.concatenate([at_breaks[i], at_breaks[i + 1], bubbles[i]]) for i in range(spans)]
        return np.array(numbers), count + bubbles.size

    @property
    def count(self) -> int:
        """Number of functions."""
        return self._numbers[1]

    @property
    def rule(self) -> tuple[Array, Array]:
        """Points and weights that integrate products of two functions exactly."""
        x, weights = leggauss(self.degree + 1)
        half = np.diff(self.breaks)[:, None] / 2
        return (np.array(self.breaks[:-1])[:, None] + half * (1 + x)).ravel(), (half * weights).ravel()

    def at(self, x: Array, order: int = 0) -> Array:
        """Derivatives (points, functions) of an order up to 2."""
        x, size = np.asarray(x, float), self.degree + 1
        spans = np.clip(np.searchsorted(self.breaks, x, side="right") - 1, 0, len(self.breaks) - 2)
        found = np.zeros((len(x), self.count + 1))  # the last column takes what is held
        for span in np.unique(spans):
            there = np.flatnonzero(spans == span)
            strip = Strip(self.breaks[span], self.breaks[span + 1], self.degree)
            found[np.ix_(there, self._numbers[0][span])] = strip.basis(x[there])[order, :, 2, 2 * size :]
        return found[:, :-1]


@dataclass(frozen=True)
class Section:
    """Trial functions over a section of walls: columns of (u, v, w) by wall."""

    walls: tuple[Wall, ...]
    degree: int
    held: dict[int, str]
    """Components held at a node: "u", "y", "z" and "r", the rotation; "v" and "w" where no strip turns off."""
    hinges: tuple[int, ...] = ()
    """Nodes at which strips turn apart."""

    @cached_property
    def strips(self) -> list[Strip]:
        """One-dimensional trial functions of each wall."""
        return [Strip(0.0, wall.width, self.degree) for wall in self.walls]

    @cached_property
    def columns(self) -> tuple[list[Array], Array]:
        """Coefficients of each strip's trial functions (3 (degree + 1), columns), and each column's set of x: "u", "v", "w"."""
        size, kinds = 3 * (self.degree + 1), []
        parts: list[list[Array]] = [[] for _ in self.walls]

        def add(kind: str, by_wall: dict[int, Array]) -> None:
            kinds.append(kind)
            for number, part in enumerate(parts):
                part.append(by_wall.get(number, np.zeros(size)))

        # 1. Node by node: u, displacement along y and z (v and w where no strip turns off), rotation.
        ends: dict[int, list[tuple[int, str]]] = {}
        for number, wall in enumerate(self.walls):
            ends.setdefault(wall.start, []).append((number, "left"))
            ends.setdefault(wall.end, []).append((number, "right"))
        for node, there in ends.items():
            held, smooth = self.held.get(node, ""), self._smooth(there)
            for kind in "uyzr":
                if kind in held:
                    continue
                local = smooth and not set(held) & set("yz") and kind in "yz"
                if local and {"y": "v", "z": "w"}[kind] in held:
                    continue
                groups = [[end] for end in there] if kind == "r" and node in self.hinges else [there]
                for group in groups:
                    by_wall = {number: self._end(number, side, kind, local) for number, side in group}
                    add("u" if kind == "u" else "v" if local and kind == "y" else "w", by_wall)
        # 2. Bubbles, which vanish at the nodes.
        tied = {self.strips[0].end_coefficient(f"{name}({side})") for side in ("left", "right") for name in "UVW"}
        tied |= {self.strips[0].end_coefficient(f"W'({side})") for side in ("left", "right")}
        for number in range(len(self.walls)):
            for i in sorted(set(range(size)) - tied):
                add("uvw"[i // (self.degree + 1)], {number: np.eye(size)[i]})
        return [np.array(part).T for part in parts], np.array(kinds)

    def _smooth(self, there: Sequence[tuple[int, str]]) -> bool:
        """Return true if all strips at a node run on in one direction: along it they share v, and w across it."""
        frames = [self.walls[i].frame(0.0 if side == "left" else self.walls[i].width) for i, side in there]
        return all(np.allclose(frame, frames[0]) for frame in frames)

    def _end(self, number: int, side: str, kind: str, local: bool) -> Array:
        """Coefficients of a wall for a unit of one node value; where `local`, "y" is v and "z" is w."""
        wall, strip = self.walls[number], self.strips[number]
        found = np.zeros(3 * (self.degree + 1))
        if kind == "u":
            found[strip.end_coefficient(f"U({side})")] = 1
        elif kind == "r":
            found[strip.end_coefficient(f"W'({side})")] = 1
        else:
            axis = "yz".index(kind)
            t, n = np.eye(2) if local else wall.frame(0.0 if side == "left" else wall.width)
            found[strip.end_coefficient(f"V({side})")] = t[axis]
            found[strip.end_coefficient(f"W({side})")] = n[axis]
            found[strip.end_coefficient(f"W'({side})")] = -wall.curvature * t[axis]
        return found

    def tables(self, wall: int, s: Array) -> Array:
        """Values and derivatives (order, points, component, columns) of a wall at s."""
        return np.tensordot(self.strips[wall].basis(s), self.columns[0][wall], axes=1)

    def strains(self, wall: int, s: Array) -> dict[str, dict[int, Array]]:
        """Strains by the order of the derivative of x: tables (points, columns) of a wall at s."""
        values, k = self.tables(wall, s), self.walls[wall].curvature
        u, v, w = (values[:, :, i] for i in range(3))
        return {
            "eps_x": {1: u[0]},
            "eps_s": {0: v[1] - k * w[0]},
            "eps_xs": {0: u[1], 1: v[0]},
            "kap_x": {2: -w[0]},
            "kap_s": {0: -(w[2] + 2 * k * v[1] - k**2 * w[0])},
            "kap_xs": {1: -2 * (w[1] + k * v[0])},
        }


class Prism:
    """A prismatic shell: a section, polynomials of x for u, v and w, and a plate's stiffnesses D (N/m) and B (N m)."""

    def __init__(
        self, section: Section, sets: dict[str, Lengthwise], thickness: float, young: float, poisson: float
    ) -> None:
        self.section, self.sets = section, sets
        self.stretching = young * thickness / (1 - poisson**2)
        self.bending = self.stretching * thickness**2 / 12
        self.law = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
        self.kinds = {kind: np.flatnonzero(section.columns[1] == kind) for kind in sets}
        counts = [len(self.kinds[kind]) * sets[kind].count for kind in sets]
        bounds = np.concatenate([[0], np.cumsum(counts)])
        self.slots = {kind: slice(int(bounds[i]), int(bounds[i + 1])) for i, kind in enumerate(sets)}
        self.size = int(bounds[-1])

    def row(self, cross: Array, along: Callable[[Lengthwise], Array]) -> Array:
        """Functional (size,) from one of columns and one of functions of x."""
        return np.concatenate([np.kron(cross[self.kinds[kind]], along(one)) for kind, one in self.sets.items()])

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        """Points and weights over x that integrate products of functions exactly."""
        return next(iter(self.sets.values())).rule

    def stiffness(self, part: str) -> Array:
        """Stiffness (size, size) of "eps", the membrane, or of "kap", bending."""
        # 1. Over the section: matrices by the orders of the derivatives of x.
        names = [name for name in STRAINS if name.startswith(part)]
        factor, cross = {"eps": self.stretching, "kap": self.bending}[part], {}
        for number, strip in enumerate(self.section.strips):
            s, weights, _ = strip.quadrature
            strains = self.section.strains(number, s)
            for i, one in enumerate(names):
                for j, two in enumerate(names):
                    if self.law[i, j] == 0:
                        continue
                    for p, left in strains[one].items():
                        for q, right in strains[two].items():
                            term = factor * self.law[i, j] * (left * weights[:, None]).T @ right
                            cross[p, q] = cross.get((p, q), 0) + term
        # 2. Products with those over x.
        x, weights = self._whole
        found = np.zeros((self.size, self.size))
        for (p, q), matrix in cross.items():
            for a, one in self.sets.items():
                for b, two in self.sets.items():
                    block = matrix[np.ix_(self.kinds[a], self.kinds[b])]
                    if block.any():
                        along = (one.at(x, p) * weights[:, None]).T @ two.at(x, q)
                        found[self.slots[a], self.slots[b]] += np.kron(block, along)
        return found

    def area_load(self, wall: int, component: int, density: float) -> Array:
        """Work (size,) of a constant load per area along u, v or w (0, 1, 2) of a wall."""
        s, weights, _ = self.section.strips[wall].quadrature
        cross = density * weights @ self.section.tables(wall, s)[0, :, component]
        x, dx = self._whole
        return self.row(cross, lambda one: dx @ one.at(x))

    def edge_load(
        self, wall: int, component: int, density: float | Callable[[Array], Array], x: float, order: int = 0
    ) -> Array:
        """Work (size,) of a load per length, a number or a function of s, over the end x of a wall.

        With `order` 1 it works on the derivative by x: -m for a moment m that stretches the side of n, on w.
        """
        s, weights, _ = self.section.strips[wall].quadrature
        size = density(s) if callable(density) else density
        cross = (size * weights) @ self.section.tables(wall, s)[0, :, component]
        return self.row(cross, lambda one: one.at(np.array([x]), order)[0])

    def side_load(self, wall: int, component: int, density: float, s: float) -> Array:
        """Work (size,) of a constant load per length along the line s of a wall."""
        cross = density * self.section.tables(wall, np.array([s]))[0, 0, component]
        x, dx = self._whole
        return self.row(cross, lambda one: dx @ one.at(x))

    def place(self, wall: int, component: int, s: float, x: float, order: int = 0) -> Array:
        """Row (size,) of u, v or w, or of a derivative of s, at a point."""
        cross = self.section.tables(wall, np.array([s]))[order, 0, component]
        return self.row(cross, lambda one: one.at(np.array([x]))[0])

    def strain(self, name: str, wall: int, s: float, x: float) -> Array:
        """Row (size,) of a strain at a point."""
        parts = self.section.strains(wall, np.array([s]))[name]
        rows = [
            self.row(table[0], lambda one, order=order: one.at(np.array([x]), order)[0])
            for order, table in parts.items()
        ]
        return np.sum(rows, axis=0)

    def resultant(self, name: str, wall: int, s: float, x: float) -> Array:
        """Row (size,) of n_x, n_s, n_xs (N/m), m_x, m_s or m_xs (N) at a point; moments stretch the side of n."""
        kind, component = name.split("_")
        part, factor = ("eps", self.stretching) if kind == "n" else ("kap", self.bending)
        law = self.law[["x", "s", "xs"].index(component)]
        terms = [
            factor * c * self.strain(f"{part}_{end}", wall, s, x)
            for c, end in zip(law, ("x", "s", "xs"), strict=True)
            if c
        ]
        return np.sum(terms, axis=0)

    def solve(self, load: Array, given: Array | None = None) -> tuple[Array, float, float]:
        """Coefficients under a load (size,), and the energies of stretching and of bending, J.

        `given` (size,) prescribes the coefficients that are not NaN in it.
        """
        membrane, bending = self.stiffness("eps"), self.stiffness("kap")
        whole, found = membrane + bending, np.zeros(self.size)
        free = np.ones(self.size, dtype=bool)
        if given is not None:
            free = np.isnan(given)
            found[~free] = given[~free]
        scale = 1 / np.sqrt(np.diagonal(whole)[free])
        matrix, right = scale[:, None] * whole[np.ix_(free, free)] * scale, scale * (load - whole @ found)[free]
        factor = cho_factor(matrix)
        part = cho_solve(factor, right)
        found[free] = scale * (part + cho_solve(factor, right - matrix @ part))
        return found, float(found @ membrane @ found) / 2, float(found @ bending @ found) / 2
