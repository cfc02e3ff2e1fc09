r"""Cantilevers and a skew plate from sets of benchmarks, by polynomials and by splines that are graded toward all edges.

- The twisted beam of MacNeal & Harder (1985), thick, and thin as by Simo, Fox & Rifai (1989): (x, y cos a, y sin a) with
  a = pi x / (2 L), clamped at x = 0. A force, spread over the end, pulls along z or along y.
- The curved beam of MacNeal & Harder: a quarter of a flat ring, clamped at one end. The force at the other end lies in
  the plane, along the radius, or is normal to it.
- Razzaque's skew plate (1973): angles of 60 and 120 degrees, pressed; two opposite sides are simply supported.

Stresses are singular where a clamped or supported edge meets a free one, and thin shells have layers along edges. The
judge has polynomials on cells that shrink toward all edges, and strains by covariant derivatives. The second form has
splines whose knot spans are halved toward the edges, and strains by products of vectors; in their frame, x,1, x,2 and
x,1 cross x,2, a clamp is exact. The plates either bend or stretch, so that the other components vanish.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from .corner_functions import Trial
from .corner_functions import skew_plate as by_powers
from .covariant_polynomials import CovariantShell, Line, graded
from .estimate import Estimate
from .hypar_polynomials import elasticity
from .linear_splines import Field, LinearShell
from .orthogonal_splines import OrthogonalShell
from .patch import breaks, ring
from .spline_shell import Ends, Splines
from .surface_strains import Array

Vector = tuple[float, float, float]
LENGTH, WIDTH = 12.0, 1.1
INNER, OUTER = 4.12, 4.32
SIDE = 10.0
OBLIQUE = 1 / 3, 2 / 3, 2 / 3
ROUNDING = 1e-9
"""Relative: thin shells lose digits to rounding even so."""


def twisted(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of (xi1, xi2 cos a, xi2 sin a), a = k xi1."""
    k, zero = np.pi / 2 / LENGTH, np.zeros_like(one)
    along = one if i == j == 0 else zero + float((i, j) == (1, 0))
    across = two if j == 0 else zero + float(j == 1)
    turned = k * one + i * np.pi / 2
    return np.stack([along, k**i * across * np.cos(turned), k**i * across * np.sin(turned)], axis=-1)


def skew(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of (xi1 + xi2 / 2, sqrt(3) / 2 xi2, 0)."""
    zero = np.zeros_like(one)
    by_one = one if i == j == 0 else zero + float((i, j) == (1, 0))
    by_two = two if i == j == 0 else zero + float((i, j) == (0, 1))
    return np.stack([by_one + by_two / 2, np.sqrt(0.75) * by_two, zero], axis=-1)


def along_lines(surface: Field) -> Field:
    """Frame x,1, x,2 and x,1 cross x,2, with the derivatives of the product."""

    def frame(one: Array, two: Array, i: int, j: int) -> Array:
        cross = np.zeros((*one.shape, 3))
        for k in range(i + 1):
            for m in range(j + 1):
                times = _choose(i, k) * _choose(j, m)
                first, second = surface(one, two, k + 1, m), surface(one, two, i - k, j - m + 1)
                cross += times * np.cross(first, second)
        return np.stack([surface(one, two, i + 1, j), surface(one, two, i, j + 1), cross], axis=1)

    return frame


def _choose(n: int, k: int) -> int:
    return 2 if (n, k) == (2, 1) else 1


@dataclass(frozen=True)
class Benchmark:
    """A patch, its support, its load, and what is asked.

    Attributes
    ----------
    surface : derivatives of the position
    domain : lower and upper ends of xi1 and of xi2
    young, poisson, thickness : Pa, 1, m
    support : `clamp` at the start of xi1, or `sides`, both ends of xi2 without their slope
    force : that of the end of xi1, spread over its length, N; or of the area, Pa
    asked : the displacements of the case: place and direction
    part : what does not vanish: the plates bend or stretch
    """

    surface: Field
    domain: tuple[float, float, float, float]
    young: float
    poisson: float
    thickness: float
    support: Literal["clamp", "sides"]
    force: Vector
    asked: dict[str, tuple[float, float, Vector]]
    part: Literal["all", "stretching", "bending"] = "all"

    @property
    def clamped(self) -> bool:
        """Return True if the load acts at the end opposite a clamp."""
        return self.support == "clamp"


def twisted_beam(thickness: float, force: float, along: Literal["y", "z"]) -> Benchmark:
    """The twisted beam."""
    direction = (0.0, 1.0, 0.0) if along == "y" else (0.0, 0.0, 1.0)
    asked = {"tip_displacement": (LENGTH, 0.0, direction), "oblique_displacement": (8.0, 0.3, OBLIQUE)}
    domain = 0.0, LENGTH, -WIDTH / 2, WIDTH / 2
    load = (0.0, force * direction[1], force * direction[2])
    return Benchmark(twisted, domain, 29e6, 0.22, thickness, "clamp", load, asked)


def curved_beam(direction: Vector) -> Benchmark:
    """The curved beam, its clamp on the axis of x; at its end the radius goes along y."""
    asked = {
        "tip_displacement": (np.pi / 2, (INNER + OUTER) / 2, direction),
        "oblique_displacement": (np.radians(50.0), 4.3, OBLIQUE),
    }
    part: Literal["stretching", "bending"] = "bending" if direction[2] else "stretching"
    return Benchmark(ring, (0.0, np.pi / 2, INNER, OUTER), 1e7, 0.25, 0.1, "clamp", direction, asked, part)


def skew_plate() -> Benchmark:
    """Razzaque's plate."""
    asked = {
        "centre_deflection": (SIDE / 2, SIDE / 2, (0.0, 0.0, -1.0)),
        "free_edge_deflection": (0.0, SIDE / 2, (0.0, 0.0, -1.0)),
    }
    domain = 0.0, SIDE, 0.0, SIDE
    return Benchmark(skew, domain, 1085.0, 0.31, 0.01, "sides", (0.0, 0.0, -1e-6), asked, "bending")


def values_of(case: Benchmark, answer: CovariantShell | OrthogonalShell) -> dict[str, float]:
    """Values of the case: m and J, and of the plate on two sides Pa."""
    found = {
        name: float(answer.displacement(one, two) @ np.array(direction))
        for name, (one, two, direction) in case.asked.items()
    }
    found["strain_energy"] = answer.energy
    if isinstance(answer, CovariantShell) and not case.clamped:
        stresses = lower_stresses(case, *answer.strains(SIDE / 2, SIDE / 2))
        first, second = np.linalg.eigvalsh(stresses)[::-1]
        found |= {
            "centre_stress": float(first),
            "centre_equivalent_stress": float(np.sqrt(first**2 - first * second + second**2)),
        }
    return found


def lower_stresses(case: Benchmark, strains: Array, tangents: Array) -> Array:
    """Stresses (2, 2) at the lower face of a plate, Pa, -6 m / h^2, along orthonormal axes."""
    h, inverse = case.thickness, np.asarray(np.linalg.inv(tangents @ tangents.T), dtype=np.float64)
    bending = case.young * h**3 / (12 * (1 - case.poisson**2))
    m = bending * elasticity(inverse[None], case.poisson)[0] @ strains[3:]
    moments = tangents[:, :2].T @ np.array([[m[0], m[2]], [m[2], m[1]]]) @ tangents[:, :2]
    return np.asarray(-6 * moments / h**2)


# --- polynomials ---------------------------------------------------------------------------------

Level = tuple[tuple[int, int], int, int]
"""Cells along both coordinates, degree, and how often cells at edges are cut."""
LEVELS: dict[str, tuple[Level, Level]] = {
    "clamp": (((5, 2), 9, 5), ((5, 2), 8, 4)),
    "sides": (((3, 3), 10, 7), ((3, 3), 9, 6)),
}
"""The fine level and the coarse one."""
CUTS_AT_LOAD = 2
"""Cuts at the loaded end, where corners are free and hardly singular."""


def polynomial_shell(case: Benchmark, level: Level) -> CovariantShell:
    """The shell on polynomials."""
    (along, across_it), degree, cuts = level
    lower, upper, near, far = case.domain
    ends = cuts, CUTS_AT_LOAD if case.clamped else cuts
    lines = (
        Line(graded(lower, upper, along, ends), degree),
        Line(graded(near, far, across_it, (cuts, cuts)), degree),
    )
    free = 0, 0
    within, normal = ((1, 0), (2, 0)) if case.clamped else (free, free)
    sides = free if case.clamped else (1, 1)
    tangential = None if case.part == "bending" else (within, free)
    across = None if case.part == "stretching" else (normal, sides)
    force = np.array(case.force)
    return CovariantShell(
        case.surface, lines, (tangential, tangential, across), case.young, case.poisson, case.thickness,
        **({"pull": force / (far - near)} if case.clamped else {"push": force}),
    )  # fmt: skip


def by_polynomials(case: Benchmark) -> dict[str, Estimate]:
    """Known values; the uncertainty is the change from a lower degree and fewer cuts."""
    return _between(*(values_of(case, polynomial_shell(case, level)) for level in LEVELS[case.support]))


def _between(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    def unit(name: str) -> str:
        return "J" if name.endswith("energy") else "Pa" if name.endswith("stress") else "m"

    return {name: Estimate.between(v, coarse[name], unit(name), ROUNDING * abs(v)) for name, v in fine.items()}


# --- second forms: splines, and of the skew plate powers of its corners ------------------------------------------------------------------------

Mesh = tuple[tuple[int, int], int, int]
"""Spans along both coordinates, degree, and halvings."""
MESHES: tuple[Mesh, Mesh] = ((12, 4), 7, 9), ((12, 4), 6, 7)
"""The fine mesh and the coarse one."""


def spline_shell(case: Benchmark, mesh: Mesh) -> LinearShell:
    """A clamped shell on splines, their spans halved toward the ends of both coordinates."""
    spans, degree, halvings = mesh
    lower, upper, near, far = case.domain
    one = breaks(lower, upper, spans[0], (True, True), halvings)
    two = breaks(near, far, spans[1], (True, True), halvings)
    splines = Splines(one, degree), Splines(two, degree)
    free: Ends = ("free", "free")
    ends: list[tuple[Ends, Ends]] = [(("zero", "free"), free), (("zero", "free"), free), (("clamped", "free"), free)]
    return LinearShell(
        case.surface, along_lines(case.surface), splines, ends, case.young, case.poisson, case.thickness,
        forces=_spread(case, splines[1]),
    )  # fmt: skip


def _spread(case: Benchmark, across: Splines) -> tuple[tuple[float, float, Vector], ...]:
    """The force of the end by Gauss's rule; the length of xi2 is that of its line there."""
    points, weights = (array.ravel() for array in across.gauss)
    total = case.domain[3] - case.domain[2]
    force = np.array(case.force)
    return tuple((case.domain[1], p, tuple(force * w / total)) for p, w in zip(points, weights, strict=True))


def by_splines(case: Benchmark) -> dict[str, Estimate]:
    """The same by splines; the uncertainty is the change from a lower degree and fewer halvings."""
    shells = (OrthogonalShell(spline_shell(case, mesh)) for mesh in MESHES)
    return _between(*(values_of(case, shell) for shell in shells))


def skew_by_corners() -> dict[str, Estimate]:
    """Razzaque's plate by powers of its corners; the uncertainty is the change from fewer of them."""
    case = CASES["skew_plate_two_sides"]
    trials = Trial(24, 20, case.poisson), Trial(16, 10, case.poisson)
    return _between(*(by_powers(SIDE, case.thickness, case.young, -case.force[2], trial) for trial in trials))


CASES: dict[str, Benchmark] = {
    "twisted_beam_thick_y": twisted_beam(0.32, 1.0, "y"),
    "twisted_beam_thick_z": twisted_beam(0.32, 1.0, "z"),
    "twisted_beam_thin_y": twisted_beam(0.0032, 1e-6, "y"),
    "twisted_beam_thin_z": twisted_beam(0.0032, 1e-6, "z"),
    "curved_beam_in_plane": curved_beam((0.0, 1.0, 0.0)),
    "curved_beam_out_of_plane": curved_beam((0.0, 0.0, 1.0)),
    "skew_plate_two_sides": skew_plate(),
}
JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    name: partial(by_polynomials, case) for name, case in CASES.items()
}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    name: partial(by_splines, case) if case.clamped else skew_by_corners for name, case in CASES.items()
}
