"""Singularities of a shell at its corners: their exponents from angle and supports (Williams 1952).

Close to a corner a shell is a plate. Across it w = r^(s+1) F(theta) solves the biharmonic equation with

    F = A cos (s+1) theta + B sin (s+1) theta + C cos (s-1) theta + D sin (s-1) theta,

and in it u = r^s (U, V) solves the equations of plane stress. Two conditions on each of both edges leave a determinant
of order four in s. Its roots with a positive real part are the exponents of strain-free, force-free fields: bending
moments and membrane forces go as r^(s-1), and the energy's error on uniform meshes of size h as h^(2 s).

An integer s belongs to polynomials, which are no singularities. Additional logarithms are not detected.

Meshes grade toward edges that end at a corner with infinite moments or forces, s < 1. With cells of size (i/n)^(g-1)/n
at line i the error of the energy goes as n^(-2 s g), until it is that of smooth fields.

Williams (1952), Surface stress singularities resulting from various boundary conditions in angular corners of plates
under bending, Proc. 1st US Nat. Congr. Appl. Mech., 325; Williams (1952), Stress singularities resulting from various
boundary conditions in angular corners of plates in extension, J. Appl. Mech. 19, 526.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import COMPONENTS, LOCAL, Support
from shellbench.problems.shell.question.loads import AreaLoad, EdgeLoad, MomentLoad, PointLoad, PressureLoad
from shellbench.problems.shell.question.places import SIDES, Edge, Side
from shellbench.solvers.fem.mechanics.kinematics import Midsurface
from shellbench.solvers.fem.mesh.basis import ROUNDING
from shellbench.solvers.fem.mesh.convergence import ASYMPTOTIC

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Determinant = Callable[[Complex], Complex]
Bending = Literal["clamped", "supported", "free", "mirrored"]

SMOOTH = 2.0  # real part up to which exponents are sought: from there on the element converges at its own rate
# Rate of the energy that grading restores. A higher one would cost cells inside, and digits at the corner.
GRADED_RATE = 3.0
FOLD_END = 0.6  # taken for where a fold ends; three plates' clamped corner, as on a Z-section, converges so
STEEPEST = 6.0  # grading: from here on the finest meshes gain nothing, and cells at the corner lose digits
INFINITE = 1.0  # below it moments or forces are infinite
WHOLE = 1e-5  # distance of an exponent from a whole number that is rounding of a double root
STARTS = 0.05  # between the real parts from which roots are sought: the starts of one root are many
FARTHEST = 0.2  # step of the secant method: longer ones would leave the strip, and all find the same root
ITERATIONS = 40  # of the secant method
ROOT_FOUND = 1e-7  # last step toward a root that was found; double ones are approached slowly
ALONG = 0.5  # square of the cosine between a held direction and the normal, or an edge, above which it is held along it
# Of an edge: distance from a corner, or from a change of supports, at which the supports are read. It exceeds the
# rounding of coordinates, and is less than any part of an edge.
NEARBY = 1e-7


@dataclass(frozen=True)
class Rim:
    """Conditions of supports on an edge at a corner.

    Attributes
    ----------
    bending
        Across the surface.
    held
        In the surface: number of directions held, and the angle of a single one from the edge, rad.
    """

    bending: Bending = "free"
    held: tuple[int, float] = (0, 0.0)


@lru_cache(maxsize=256)
def bending_exponent(
    angle: float, first: Bending, second: Bending, poissons_ratio: float, most: float = SMOOTH
) -> float:
    """Return the least real part of s in w = r^(s+1) F(theta) at a corner of this angle, rad; `most` if beyond."""
    nu = poissons_ratio

    def rows(s: Complex, theta: float, kind: Bending) -> Complex:
        f = _trigonometric(s, theta)
        match kind:
            case "clamped":
                return np.stack([f[0], f[1]])
            case "supported":  # no moment is no F'' where F is zero
                return np.stack([f[0], f[2]])
            case "mirrored":
                return np.stack([f[1], f[3]])
            case "free":  # no moment, and no force of Kirchhoff's
                moment = f[2] + ((s + 1) + nu * s * (s + 1)) * f[0]
                return np.stack([moment, f[3] + ((s + 1) ** 2 + (1 - nu) * s * (s - 1)) * f[1]])

    def determinant(s: Complex) -> Complex:
        return _determinant(np.concatenate([rows(s, 0.0, first), rows(s, angle, second)]))

    return least_exponent(determinant, most)


@lru_cache(maxsize=256)
def membrane_exponent(angle: float, first: Rim, second: Rim, poissons_ratio: float, most: float = SMOOTH) -> float:
    """Return the least real part of s in u = r^s (U, V) at a corner of this angle, rad; `most` if beyond."""
    nu = poissons_ratio
    kolosov = (3 - nu) / (1 + nu)  # of plane stress

    def rows(s: Complex, theta: float, rim: Rim) -> Complex:
        # Kolosov and Muskhelishvili: 2 G (u + i v) = k phi - z conj(phi') - conj(psi), phi and psi multiples of z^s.
        f = _trigonometric(s, theta)
        less, more = kolosov - s, kolosov + s
        turned = np.array([1.0, -1.0, 1.0, -1.0])[:, None]  # cos for sin, and sin for -cos
        swapped = np.array([1, 0, 3, 2])
        radial = np.stack([np.ones_like(s), np.ones_like(s), less, less])
        around = np.stack([-np.ones_like(s), -np.ones_like(s), more, more])
        u, u_theta = radial * f[0], radial * f[1]
        v, v_theta = around * turned * f[0][swapped], around * turned * f[1][swapped]
        # stresses over E / (1 - nu^2) r^(s-1)
        hoop = u + v_theta + nu * s * u
        shear = (1 - nu) / 2 * (u_theta + (s - 1) * v)
        count, along = rim.held
        if count == 2:
            return np.stack([u, v])
        if count == 0:
            return np.stack([shear, hoop])
        c, d = np.cos(along), np.sin(along)
        return np.stack([c * u + d * v, c * hoop - d * shear])

    def determinant(s: Complex) -> Complex:
        return _determinant(np.concatenate([rows(s, 0.0, first), rows(s, angle, second)]))

    return least_exponent(determinant, most)


def _trigonometric(s: Complex, theta: float) -> Complex:
    """Return cos and sin of (s+1) theta and (s-1) theta, and three derivatives: (4, 4, n) by derivative."""
    m = np.stack([s + 1, s - 1])
    up = np.exp(1j * theta * m)
    down = 1 / up
    c, d = (up + down) / 2, (up - down) / 2j
    table = np.array([[c, d], [-m * d, m * c], [-(m**2) * c, -(m**2) * d], [m**3 * d, -(m**3) * c]])
    return np.swapaxes(table, 1, 2).reshape(4, 4, -1)


def _determinant(rows: Complex) -> Complex:
    """Return the determinants (n,) of rows (4, 4, n)."""
    return np.asarray(np.linalg.det(np.moveaxis(rows, -1, 0)))


def least_exponent(determinant: Determinant, most: float) -> float:
    """Return the least real part of a determinant's roots that are not whole; `most` if it has none below."""
    # Secant steps run from many starts in the strip 0 < Re s < most, all at once. The textbook follows a root as the
    # angle grows from one with a known exponent. That needs no starts, but loses roots where two meet and become
    # complex.
    real, imaginary = np.meshgrid(np.arange(STARTS, most, STARTS), [0.0, 0.4, 1.0])
    before = (real + 1j * imaginary).ravel()
    at = before + (0.01 + 0.004j * (imaginary.ravel() > 0))
    value = determinant(before)
    step = at - before
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            new = determinant(at)
            slope = (new - value) / step
            step = np.where(np.abs(new) > 0, -new / slope, 0.0)
            step = np.where(np.isfinite(step), step, 0.0)
            large = np.abs(step) > FARTHEST
            step = np.where(large, FARTHEST * step / np.maximum(np.abs(step), 1.0), step)
            value, at = new, at + step
            if np.all((np.abs(step) < ROOT_FOUND) | (np.abs(at.real - most / 2) > most)):
                break
            step = np.where(step == 0.0, np.finfo(float).tiny, step)
    found = at[np.abs(step) < ROOT_FOUND]
    whole = np.abs(found - np.round(found.real)) < WHOLE
    candidates = found.real[~whole & (found.real > WHOLE) & (found.real < most)]
    return float(candidates.min(initial=most))


def break_exponents(case: Case) -> dict[tuple[int, Side, float], float]:
    """Return the least exponents at changes of supports within edges, if moments or forces are infinite there.

    The keys are the axis and the side of the edge, and the running coordinate.
    """
    return dict(_exponents_at_breaks(case))


def _exponents_at_breaks(case: Case) -> Iterator[tuple[tuple[int, Side, float], float]]:
    # A point within an edge is a corner of angle pi, with one rim on either side.
    domain = case.surface.domain
    edges = [place for _, place in case.supported_places() if isinstance(place, Edge)]
    for axis, side, at in sorted({(e.axis, e.side, at) for e in edges if e.between for at in e.between}):
        running = 1 - axis
        seam = domain.periodic[running]
        inside = domain.lower[running] < at < domain.upper[running]
        if not inside and not seam:
            continue
        edge = Edge("", axis, side)
        surface = Midsurface.from_position(case.surface.derivatives(edge.points(domain, np.array([at])), order=2))
        tangent = surface.base[0, running] / np.linalg.norm(surface.base[0, running])
        across = surface.base[0, axis] * (1.0 if side == "min" else -1.0)  # inward
        normal = np.cross(tangent, across)
        normal /= np.linalg.norm(normal)
        rims = [
            _rim(_supports_beside(case, edge, at + sign * NEARBY * domain.size[running]), sign * tangent, normal)
            for sign in (1.0, -1.0)
        ]
        found = _exponent(case, may_bend_and_stretch(case), np.pi, rims[0], rims[1])
        if found < INFINITE:
            yield (axis, side, at), found


def _supports_beside(case: Case, edge: Edge, running: float) -> list[Support]:
    """Return the supports that hold an edge at a value of its running coordinate."""
    domain = case.surface.domain
    return [
        support
        for support, place in case.supported_places()
        if isinstance(place, Edge)
        and (place.axis, place.side) == (edge.axis, edge.side)
        and bool(place.covers(domain, np.array(running)))
    ]


def _exponent(case: Case, acting: tuple[bool, bool], angle: float, first: Rim, second: Rim) -> float:
    """Return the least exponent between two rims, of the fields that loads excite: see `may_bend_and_stretch`."""
    across, within = acting
    nu, nu_of_bending = case.material.poissons_ratios
    found = INFINITE
    if across:
        found = bending_exponent(angle, *sorted([first.bending, second.bending]), nu_of_bending, INFINITE)
    if within:
        found = min(found, membrane_exponent(angle, first, second, nu, INFINITE))
    return found


def corner_exponents(case: Case) -> dict[tuple[Side, Side], float]:
    """Return the least exponent at each corner (side of xi1, side of xi2) where moments or forces are infinite."""
    if any(case.surface.domain.periodic):
        return {}
    return dict(_exponents_at_corners(case))


def _exponents_at_corners(case: Case) -> Iterator[tuple[tuple[Side, Side], float]]:
    domain, acting = case.surface.domain, may_bend_and_stretch(case)
    for sides in product(SIDES, SIDES):
        edges = [_edge(case, axis, side) for axis, side in enumerate(sides)]
        corner = np.array([[edge.coordinate(domain) for edge in edges]])
        surface = Midsurface.from_position(case.surface.derivatives(corner, order=2))
        # Both edges as seen from the corner: the edge xi1 = const runs along a2, inward.
        inward = [1.0 if side == "min" else -1.0 for side in sides]
        along = [inward[1] * surface.base[0, 1], inward[0] * surface.base[0, 0]]
        along = [tangent / np.linalg.norm(tangent) for tangent in along]
        angle = float(np.arccos(np.clip(along[0] @ along[1], -1.0, 1.0)))
        angle = round(angle, 12)  # like corners are computed once
        # theta runs from the first edge to the second
        normal = np.cross(along[0], along[1])
        normal /= np.linalg.norm(normal)
        # the supports of each edge beside the corner
        beside = (
            corner[0, 1 - edge.axis] + inward[1 - edge.axis] * NEARBY * domain.size[1 - edge.axis] for edge in edges
        )
        first, second = (
            _rim(_supports_beside(case, edge, float(at)), tangent, normal)
            for edge, at, tangent in zip(edges, beside, along, strict=True)
        )
        found = _exponent(case, acting, angle, first, second)
        if found < INFINITE:
            yield sides, found


def _edge(case: Case, axis: int, side: Side) -> Edge:
    edge = case.places[f"xi{axis + 1}_{side}"]
    assert isinstance(edge, Edge)
    return edge


def _rim(supports: list[Support], tangent: Array, normal: Array) -> Rim:
    """Return the conditions of supports on an edge with this tangent, away from the corner, and this surface normal."""
    if not supports:
        return Rim()
    axes = dict(zip((*COMPONENTS, *LOCAL), (*np.eye(3), tangent, np.cross(normal, tangent), normal), strict=True))
    held = np.array([axes[name] for s in supports for name in s.held])
    slope = any(s.holds_slope for s in supports)
    _, values, directions = np.linalg.svd(held.reshape(-1, 3))
    directions = directions[: np.count_nonzero(values > ROUNDING)]
    lifted = float(np.sum((directions @ normal) ** 2)) > ALONG
    bending: Bending = ("clamped" if slope else "supported") if lifted else ("mirrored" if slope else "free")
    # The parts of the held directions in the surface. Oblique directions count if they lie mostly in it.
    inside = directions - np.outer(directions @ normal, normal)
    _, values, inside = np.linalg.svd(inside) if len(inside) else (None, np.zeros(0), np.zeros((0, 3)))
    inside = inside[: np.count_nonzero(values**2 > ALONG)]
    angle = float(np.arctan2(inside[0] @ np.cross(normal, tangent), inside[0] @ tangent)) if len(inside) == 1 else 0.0
    return Rim(bending, (min(len(inside), 2), round(angle % np.pi, 12)))


@dataclass(frozen=True)
class Singularities:
    """Exponents of all points of a case where moments or forces are infinite, and the meshes that resolve them.

    Attributes
    ----------
    corners
        Exponents by the sides of xi1 and xi2 that meet.
    breaks
        Exponents by axis and side of an edge, and by the running coordinate at which its supports change.
    """

    corners: Mapping[tuple[Side, Side], float]
    breaks: Mapping[tuple[int, Side, float], float]

    @classmethod
    def of_case(cls, case: Case) -> Singularities:
        """Find all singularities of a case."""
        return cls(corner_exponents(case), {**break_exponents(case), **dict(_fold_ends(case))})

    @property
    def edge_gradings(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """By coordinate, the exponents g of the mesh lines' distances from its lower and its upper edge."""
        found = dict.fromkeys(product((0, 1), SIDES), 1.0)
        for sides, exponent in self.corners.items():
            for axis, side in enumerate(sides):
                found[axis, side] = max(found[axis, side], _grading(exponent))
        for (axis, side, _), exponent in self.breaks.items():
            found[axis, side] = max(found[axis, side], _grading(exponent))
        return (found[0, "min"], found[0, "max"]), (found[1, "min"], found[1, "max"])

    @property
    def break_gradings(self) -> tuple[dict[float, float], dict[float, float]]:
        """By coordinate, the exponents g of the mesh lines' distances from where supports change within edges."""
        found: tuple[dict[float, float], dict[float, float]] = {}, {}
        for (axis, _, at), exponent in self.breaks.items():
            found[1 - axis][at] = max(found[1 - axis].get(at, 1.0), _grading(exponent))
        return found

    @property
    def slowest_rate(self) -> float:
        """Rate, in the mesh size, at which the energy converges on meshes that are graded so."""
        exponents = [*self.corners.values(), *self.breaks.values()]
        return min((2 * s * _grading(s) for s in exponents), default=ASYMPTOTIC)


def _fold_ends(case: Case) -> Iterator[tuple[tuple[int, Side, float], float]]:
    """Yield the ends of folds on edges that are clamped or loaded; at diaphragms and mirrors all is smooth."""
    loaded = {name for load in case.loads if isinstance(load, EdgeLoad) for name in load.on}
    held = {name for support in case.supports if support.clamped for name in support.on}
    for fold, side in product(case.surface.fold_lines, SIDES):
        edge = _edge(case, 1 - fold.axis, side)
        if edge.name in loaded | held:
            yield (edge.axis, side, fold.at), FOLD_END


def _grading(exponent: float) -> float:
    return min(GRADED_RATE / (2 * exponent), STEEPEST)


def may_bend_and_stretch(case: Case) -> tuple[bool, bool]:
    """Return two flags: True if the case may bend, True if it may stretch. On a plate, not every load does both."""
    domain = case.surface.domain
    normals = Midsurface.from_position(case.surface.derivatives(domain.grid(5, 5).reshape(-1, 2), order=2)).normal
    if np.ptp(normals, axis=0).max() > ROUNDING or any(s.motion is not None for s in case.supports):
        return True, True
    if case.modal:
        return True, False  # the first modes of a plate bend it
    normal = normals[0]
    across = within = False
    for load in case.loads:
        match load:
            case PressureLoad() | MomentLoad():
                across = True
            case AreaLoad(frame="local") | EdgeLoad(frame="local"):
                return True, True
            case _:
                numbers = load.force if isinstance(load, PointLoad) else load.formulas
                if not all(isinstance(number, int | float) for number in numbers):
                    return True, True
                vector = np.array(numbers, dtype=float)
                size = max(float(np.linalg.norm(vector)), float(np.finfo(float).tiny))
                across |= abs(vector @ normal) > ROUNDING * size
                within |= float(np.linalg.norm(vector - (vector @ normal) * normal)) > ROUNDING * size
    return across, within
