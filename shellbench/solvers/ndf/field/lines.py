"""Features of a field about coordinate lines: edges of contact, and hinges.

Along an edge of contact the third derivative jumps. Without friction, displacement, slope and moment are continuous at
the edge, and the shear force jumps. Therefore the displacement is smooth up to s^3 times smooth functions on one side,
with s the distance from the edge. Features that are smooth everywhere would oscillate there.

A hinge is a narrow line along which a shell is much softer than beside it, so that the field turns there. Across such a
line forces N and moments M are smooth, and strains are not: they follow the compliance c, which is 1/(E h) of the
membrane and 1/(E h^3) of bending. Therefore displacements are integrals of the compliance,

    u = int c N,   w = int int c M,

with N and M about linear in the coordinate x that runs across the line. Integrals of c and (x - x0) c, times smooth
functions, span these displacements for any width of the line. Random features would need waves as short as the width.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.features import quick_lines
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.choices import Crease
from shellbench.solvers.ndf.field.geometry import LINE
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement, chebyshev, compose, coordinates, product

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

# Numbers of Chebyshev polynomials of the coordinate across a line, and of the other one, that multiply features.
CREASE_POLYNOMIALS, HINGE_POLYNOMIALS = (8, 3), (6, 3)
TOGETHER = 2  # cells that resolve a stiffness in a panel: its Gauss points are exact to twice their degree
PANEL_NODES = 8  # of the polynomial in a panel
TOLD = 1e-6  # of the largest compliance: allowed error of the polynomial of a panel, far below the error of a field
HALVINGS = 12  # of panels that no polynomial resolves: these stay
MIDDLE, ENDS = 0.5, (0.0, 1.0)  # of a line: place where its compliance is taken, and places where it may differ
SOFTER = 2.0  # times the compliance of most of the coordinate line: less is no hinge

Mask = NDArray[np.bool_]


def _centred(domain: Domain, points: Array, placement: Placement) -> list[Tensor]:
    """Return the jets (6, N) of both coordinates, scaled to [-1, 1]."""
    centred = []
    for axis, coordinate in enumerate(coordinates(points, placement)):
        unit = 2 / domain.size[axis] * coordinate
        unit[VALUE] -= (domain.lower[axis] + domain.upper[axis]) / domain.size[axis]
        centred.append(unit)
    return centred


def _times_polynomials(profile: Tensor, centred: list[Tensor], axis: int, counts: tuple[int, int]) -> list[Tensor]:
    """Return the products of a jet with so many polynomials of the coordinate of `axis`, and of the other one."""
    cuts = [product(profile, along) for along in chebyshev(centred[axis], counts[0])]
    return [product(cut, across) for cut in cuts for across in chebyshev(centred[1 - axis], counts[1])]


@dataclass(frozen=True)
class Creases:
    """Cubes of the distance on one side of coordinate lines, times polynomials of both coordinates.

    Attributes
    ----------
    domain
        Of the coordinates.
    lines
        Axis and value of the lines.
    """

    domain: Domain
    lines: tuple[Crease, ...]

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.lines) * math.prod(CREASE_POLYNOMIALS)

    def columns(self, points: Array, placement: Placement) -> list[Tensor]:
        """Return the jets (6, N) of all features at points (N, 2)."""
        centred = _centred(self.domain, points, placement)
        columns: list[Tensor] = []
        for axis, at, side in self.lines:
            s = side * centred[axis]
            s[VALUE] -= side * (2 * at - self.domain.lower[axis] - self.domain.upper[axis]) / self.domain.size[axis]
            v = s[VALUE].clamp_min(0.0)
            cube = compose((v**3, 3 * v**2, 6 * v), s)
            columns += _times_polynomials(cube, centred, axis, CREASE_POLYNOMIALS)
        return columns


@dataclass(frozen=True)
class Hinge:
    """A coordinate line across which compliances peak.

    Attributes
    ----------
    case
        The case with the material.
    axis
        Of the coordinate that runs across the line.
    at
        Value of that coordinate.
    start, stop
        Bounds of the part of the coordinate that belongs to this line.
    across
        Place on the line where its compliance is taken, as a share of the other coordinate's side.
    """

    case: Case
    axis: int
    at: float
    start: float
    stop: float
    across: float = MIDDLE

    def compliance(self, power: int) -> Callable[[Array], Array]:
        """Return 1/(E h^power) along the coordinate."""
        domain, material = self.case.surface.domain, self.case.material

        def along(x: Array) -> Array:
            points = np.tile(np.asarray(domain.lower) + self.across * np.asarray(domain.size), (x.size, 1))
            points[:, self.axis] = x.ravel()
            young, height = material.factors(points, self.case.surface.named_constants)
            return np.asarray(1 / (young * height**power)).reshape(x.shape)

        return along

    @cached_property
    def breaks(self) -> Array:
        """(n + 1,) ends of panels; in each, a polynomial resolves the compliance of bending."""
        ends = np.concatenate(
            [f.division.ends(self.axis)[::TOGETHER] for f in self.case.features if f.role == "stiffness"]
        )
        breaks = np.unique([self.start, *ends[(ends > self.start) & (ends < self.stop)], self.stop])
        along = self.compliance(3)
        between = np.linspace(0, 1, 2 * PANEL_NODES + 1)
        for _ in range(HALVINGS):
            found = _piecewise(along, breaks)
            points = breaks[:-1, None] + between * np.diff(breaks)[:, None]
            values = along(points)
            bad = np.abs(found(points) - values).max(axis=1) > TOLD * values.max()
            if not bad.any():
                break
            breaks = np.sort([*breaks, *((breaks[:-1] + breaks[1:]) / 2)[bad]])
        return breaks

    @cached_property
    def profiles(self) -> list[PPoly]:
        """Integrals of (x - at)^k c for k = 0, 1: twofold for bending, and single for the membrane."""
        side, found = self.case.surface.domain.size[self.axis], []
        for power, times in ((3, 2), (1, 1)):
            peak = _piecewise(self.compliance(power), self.breaks)
            # The compliance beside the line is smooth and is subtracted: otherwise profiles of several lines would
            # overlap.
            peak.c[-1] -= peak(self.breaks).min()
            for k in (0, 1):
                lever = _piecewise(lambda x, k=k: ((x - self.at) / side) ** k, self.breaks)  # type: ignore[misc]
                total = _piecewise(lambda x, p=peak, q=lever: p(x) * q(x), self.breaks)  # type: ignore[misc]
                size = np.abs(total.antiderivative()(self.breaks)).max()
                if size > 0:
                    total.c /= size
                    found.append(total.antiderivative(times))
        return found

    def columns(self, points: Array, coordinate: Tensor, placement: Placement) -> list[Tensor]:
        """Return the jets (6, N) of the profiles at points (N, 2), of the jet of the coordinate."""
        x = points[:, self.axis]
        inside = np.clip(x, self.start, self.stop)
        columns = []
        for profile in self.profiles:
            value, slope, bend = (profile.derivative(n)(inside) if n else profile(inside) for n in range(3))
            value = value + slope * (x - inside)
            bend = np.where(x == inside, bend, 0.0)
            parts = tuple(placement.tensor(part) for part in (value, slope, bend))
            columns.append(compose((parts[0], parts[1], parts[2]), coordinate))
        return columns


def _piecewise(formula: Callable[[Array], Array], breaks: Array) -> PPoly:
    """Return polynomials through Chebyshev's points of panels."""
    from scipy.interpolate import PPoly  # imported here, so that fields without such lines do not wait for it

    nodes = (1 - np.cos(np.pi * (np.arange(PANEL_NODES) + 0.5) / PANEL_NODES)) / 2
    sizes = np.diff(breaks)
    values = formula(breaks[:-1, None] + nodes * sizes[:, None])
    powers = np.arange(PANEL_NODES - 1, -1, -1)
    local = np.linalg.solve(nodes[:, None] ** powers, values.T)
    return PPoly(local / sizes ** powers[:, None], breaks)


@dataclass(frozen=True)
class Hinges:
    """Profiles of all hinges of a case, times polynomials of both coordinates."""

    case: Case
    hinges: tuple[Hinge, ...]

    @property
    def count(self) -> int:
        """Number of features."""
        return len(self.coarser_mask())

    def coarser_mask(self) -> Mask:
        """Return (count,): True for features about the middle of their line; the others estimate the error."""
        each = [
            np.full(len(hinge.profiles) * math.prod(HINGE_POLYNOMIALS), hinge.across == MIDDLE) for hinge in self.hinges
        ]
        return np.concatenate(each)

    def columns(self, points: Array, placement: Placement) -> list[Tensor]:
        """Return the jets (6, N) of all features at points (N, 2)."""
        plain, centred = coordinates(points, placement), _centred(self.case.surface.domain, points, placement)
        columns: list[Tensor] = []
        for hinge in self.hinges:
            for profile in hinge.columns(points, plain[hinge.axis], placement):
                columns += _times_polynomials(profile, centred, hinge.axis, HINGE_POLYNOMIALS)
        return columns


def hinges_of(case: Case) -> tuple[Hinge, ...]:
    """Return the lines along open coordinates across which a shell is much softer than beside them."""
    domain, found = case.surface.domain, []
    for axis in (a for a in (0, 1) if not domain.periodic[a]):
        lower, upper = domain.lower[axis], domain.upper[axis]
        along = Hinge(case, axis, lower, lower, upper).compliance(3)
        # Formulas also vary quickly beside a peak; such places are no softer than most of the line.
        usual = SOFTER * float(np.median(along(np.linspace(lower, upper, LINE))))
        lines = sorted(at for at, _ in quick_lines(case, axis) if along(np.array([at]))[0] > usual)
        middles = [(a + b) / 2 for a, b in pairwise(lines)]
        for at, (start, stop) in zip(lines, pairwise([lower, *middles, upper]), strict=False):  # one part if no line
            hinge = Hinge(case, axis, at, start, stop)
            values = hinge.compliance(3)(hinge.breaks)
            others = [replace(hinge, across=share) for share in ENDS]
            other = (o for o in others if np.abs(o.compliance(3)(hinge.breaks) - values).max() > TOLD * values.max())
            found += [hinge, *other]
    return tuple(found)
