r"""Strips and round plates that a load presses onto something rigid: cases/contact_*.toml.

Without friction a plate that touches has its obstacle's slope and curvature where contact begins: displacement, slope
and moment are continuous there, and only the shear force jumps, by a line force of the obstacle. So a span of unknown
length a, B w'''' = q, has one condition more than it needs, and that one gives a. For a strip above a floor at distance
d these are a = (24 B d / q)^(1/4) with the line force q a / 2 where it is hinged, and (72 B d / q)^(1/4) with q a / 3
where it is clamped (Timoshenko & Woinowsky-Krieger 1959, section 3, has the family). Where it touches all along, the
pressure is q - B f'''' of an obstacle f(x), which is q + 3 B / R^3 at the top of a cylinder.

The round plate has w = q r^4 / 64 B + c1 + c2 r^2 + c3 log r + c4 r^2 log r (the same, section 15).

The judge solves the closed forms; on cylinders one equation for a. The second form solves the equations of equilibrium
on (0, 1), scaled by the unknown length, by collocation of fourth order (SciPy's `solve_bvp`), and integrates by Gauss's
rule.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq, minimize_scalar

from . import bar_impact
from .contact_in_motion import INTEGRATED
from .contact_in_motion import JUDGES as IN_MOTION
from .estimate import Estimate
from .heavy_contact import JUDGES as HEAVY
from .heavy_contact import SECOND_FORMS as BY_ENERGY

YOUNG, THICKNESS, LOAD = 1.2e7, 0.01, 3.0  # Pa, m, N/m^2
WIDTH, LENGTH = 0.1, 1.0  # of strips, m
B = YOUNG * THICKNESS**3 / 12  # of strips, whose Poisson's ratio is 0: 1 N m
DEPTH = 0.001  # of the floor, m
TOP, RADIUS, HILL = 0.45, 50.0, 0.0005  # of the cylinder: along the strip, its radius, and how deep its top is, m
RIDGE_TOP, RIDGE_RADIUS, RIDGE = 0.55, 50.0, 0.0004  # the same of the cylinder between clamps
ROUNDING = 1e-13
SMALL_SLOPES = 1e-6
"""Effect of a cylinder's horizontal push: 1e-8 m at a slope of 0.01, beside a gap of 5e-4 m."""
COLLOCATED = 1e-11
GAUSS = 40

Array = np.ndarray
Function = Callable[[float], float]


@dataclass(frozen=True)
class Span:
    """A span from a support to the edge of contact.

    Attributes
    ----------
    length
        a, m.
    line_force, reaction
        Of the obstacle where contact begins, and of the support, N/m.
    energy
        Of bending, J/m.
    deepest
        Largest deflection, m.
    """

    length: float
    line_force: float
    reaction: float
    energy: float
    deepest: float


Obstacle = Callable[[float], tuple[float, float, float, float]]
"""Depth of an obstacle, m, downward, at a distance from the support, and three derivatives."""


def floor(x: float) -> tuple[float, float, float, float]:
    """Return the floor."""
    return DEPTH, 0.0, 0.0, 0.0


def hill(distance: float, radius: float, deep: float) -> Obstacle:
    """Return a cylinder, whose top is at a distance from the support."""

    def depth(x: float) -> tuple[float, float, float, float]:
        s = x - distance
        root = np.sqrt(radius**2 - s**2)
        return deep + radius - root, s / root, radius**2 / root**3, 3 * radius**2 * s / root**5

    return depth


def _quartic(clamped: bool, a: float, f: float, slope: float, load: float = LOAD) -> Array:
    """Return the coefficients of x^0 to x^4 of the deflection with f and its slope at a."""
    q = load / (24 * B)
    powers = (2, 3) if clamped else (1, 3)
    matrix = np.array([[a**p for p in powers], [p * a ** (p - 1) for p in powers]])
    two = np.linalg.solve(matrix, [f - q * a**4, slope - 4 * q * a**3])
    coefficients = np.zeros(5)
    coefficients[list(powers)], coefficients[4] = two, q
    return coefficients


def span(obstacle: Obstacle, clamped: bool, longest: float, load: float = LOAD) -> Span:
    """Return a span by its quartic."""

    def excess(a: float) -> float:
        f, slope, curvature, _ = obstacle(a)
        return float(np.polynomial.Polynomial(_quartic(clamped, a, f, slope, load)).deriv(2)(a) - curvature)

    a = brentq(excess, 0.05, longest, xtol=1e-15, rtol=1e-14)
    f, slope, _, third = obstacle(a)
    w = np.polynomial.Polynomial(_quartic(clamped, a, f, slope, load))
    bent = (w.deriv(2) ** 2).integ()
    turning = [x.real for x in w.deriv().roots() if abs(x.imag) < ROUNDING and 0 < x.real < a]
    deepest = max(float(w(x)) for x in (a, *turning))
    return Span(a, B * (w.deriv(3)(a) - third), -B * w.deriv(3)(0.0), B / 2 * float(bent(a) - bent(0.0)), deepest)


def span_by_collocation(obstacle: Obstacle, clamped: bool, longest: float, load: float = LOAD) -> Span:
    """Return a span by the equation of equilibrium on the unit interval, with its length among the unknowns."""

    def rates(s: Array, y: Array, p: Array) -> Array:
        return p[0] * np.stack([y[1], y[2], y[3], np.full_like(s, load / B)])

    def ends(start: Array, end: Array, p: Array) -> Array:
        f = obstacle(float(p[0]))
        return np.array([start[0], start[1 if clamped else 2], end[0] - f[0], end[1] - f[1], end[2] - f[2]])

    s = np.linspace(0, 1, 21)
    guess = np.stack([DEPTH * s**2, 0 * s, 0 * s, 0 * s])
    found = solve_bvp(rates, ends, s, guess, p=[0.8 * longest], tol=COLLOCATED, max_nodes=5000)
    if not found.success:
        raise ArithmeticError(found.message)
    a = float(found.p[0])
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    bent = float(weights / 2 @ found.sol((nodes + 1) / 2)[2] ** 2) * a
    within = minimize_scalar(lambda s: -float(found.sol(s)[0]), bounds=(0.3, 1), method="bounded")
    deepest = max(-float(within.fun), float(found.y[0, -1]))
    return Span(a, B * (found.y[3, -1] - obstacle(a)[3]), -B * found.y[3, 0], B / 2 * bent, deepest)


def _strip(first: Span, second: Span, pushed: float, bent: float) -> dict[str, float]:
    """Return the values of a strip with two spans, for a force per width in between and the energy there."""
    return {
        "contact_point": first.length,
        "far_contact_point": second.length,
        "contact_force": WIDTH * (first.line_force + second.line_force + pushed),
        "penetration": 0.0,
        "hinge_force": WIDTH * (first.reaction + second.reaction),
        "largest_displacement": max(first.deepest, second.deepest),
        "strain_energy": WIDTH * (first.energy + second.energy + bent),
    }


def _on_floor(solve: Callable[[Obstacle, bool, float], Span], clamped: bool) -> dict[str, float]:
    one = solve(floor, clamped, 0.5 * LENGTH)
    return _strip(one, one, LOAD * (LENGTH - 2 * one.length), 0.0)


def _on_hill(
    solve: Callable[[Obstacle, bool, float], Span],
    clamped: bool = False,
    top: float = TOP,
    radius: float = RADIUS,
    deep: float = HILL,
) -> dict[str, float]:
    first = solve(hill(top, radius, deep), clamped, top)
    second = solve(hill(LENGTH - top, radius, deep), clamped, LENGTH - top)
    low, high = first.length - top, LENGTH - second.length - top
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    curvature = hill(0.0, radius, deep)
    s = low + (high - low) / 2 * (nodes + 1)
    bent = float(weights @ [curvature(x)[2] ** 2 for x in s]) * (high - low) / 2
    # The load, and the shear forces of the obstacle's own shape at both ends.
    pushed = LOAD * (high - low) - B * (curvature(high)[3] - curvature(low)[3])
    return _strip(first, second, pushed, B / 2 * bent)


@dataclass(frozen=True)
class RoundPlate:
    """A round plate with a hole above a floor, held at its rim: Poisson's ratio, radii, depth of the floor, and load."""

    poisson: float
    inner: float
    below: float
    load: float
    clamped: bool
    outer: float = 1.0

    @property
    def stiffness(self) -> float:
        """Of bending, N m."""
        return B / (1 - self.poisson**2)

    def series(self, r: float) -> tuple[Array, Array]:
        """Return derivatives 0 to 3 of the four solutions (4, 4), and of the load's part (4,), at a radius."""
        log = np.log(r)
        homogeneous = np.array(
            [
                [1.0, r**2, log, r**2 * log],
                [0.0, 2 * r, 1 / r, 2 * r * log + r],
                [0.0, 2.0, -1 / r**2, 2 * log + 3],
                [0.0, 0.0, 2 / r**3, 2 / r],
            ]
        )
        return homogeneous, self.load / (64 * self.stiffness) * np.array([r**4, 4 * r**3, 12 * r**2, 24 * r])

    def held(self, w: Array) -> Array:
        """Return the slope, or the moment over the stiffness, of derivatives 0 to 3 of w at the rim."""
        return np.asarray(w[1] if self.clamped else w[2] + self.poisson / self.outer * w[1])

    def asked(
        self, b: float, bent: Callable[[Array], tuple[Array, Array]], third: float, rim: Array
    ) -> dict[str, float]:
        """Return the values of a quarter from w' and w'' (n,) at radii, w''' at b, and all derivatives at the rim."""
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
        r = b + (self.outer - b) / 2 * (nodes + 1)
        slope, curved = bent(r)
        density = curved**2 + (slope / r) ** 2 + 2 * self.poisson * curved * slope / r
        # A line force where contact begins is the jump of the shear force, B w''' as w' and w'' vanish there.
        force = np.pi / 2 * (self.stiffness * third * b * -1.0 + self.load * (b**2 - self.inner**2) / 2)
        shear = self.stiffness * (rim[3] + rim[2] / self.outer - rim[1] / self.outer**2)
        energy = np.pi / 2 * self.stiffness / 2 * float(weights @ (density * r)) * (self.outer - b) / 2
        return {
            "contact_point": self.outer - b,
            "contact_force": force,
            "penetration": 0.0,
            "rim_force": np.pi / 2 * self.outer * float(shear),
            "largest_displacement": self.below,
            "strain_energy": energy,
        }


def plate_on_floor(plate: RoundPlate) -> dict[str, Estimate]:
    """Known values of a round plate by the closed form."""

    def coefficients(b: float) -> Array:
        (rim, load), (edge, own) = plate.series(plate.outer), plate.series(b)
        matrix = np.stack([rim[0], plate.held(rim), edge[0], edge[1]])
        right = [-load[0], -plate.held(load), plate.below - own[0], -own[1]]
        return np.linalg.solve(matrix, right)

    def at(r: float, c: Array) -> Array:
        shapes, own = plate.series(r)
        return np.asarray(shapes @ c + own)

    b = brentq(lambda r: float(at(r, coefficients(r))[2]), plate.inner + 0.1, 0.8, xtol=1e-15, rtol=1e-14)
    c = coefficients(b)

    def bent(radii: Array) -> tuple[Array, Array]:
        found = np.array([at(float(r), c) for r in radii])
        return found[:, 1], found[:, 2]

    return _estimates(plate.asked(b, bent, at(b, c)[3], at(plate.outer, c)), 1e2 * ROUNDING)


def plate_on_floor_by_collocation(plate: RoundPlate) -> dict[str, Estimate]:
    """The same by the equation of equilibrium in the radius, with the radius of contact among the unknowns."""

    def radius(s: Array, p: Array) -> Array:
        return p[0] + (plate.outer - p[0]) * s

    def rates(s: Array, y: Array, p: Array) -> Array:
        r = radius(s, p)
        fourth = plate.load / plate.stiffness - 2 * y[3] / r + y[2] / r**2 - y[1] / r**3
        return (plate.outer - p[0]) * np.stack([y[1], y[2], y[3], fourth])

    def ends(start: Array, end: Array, p: Array) -> Array:
        return np.array([start[0] - plate.below, start[1], start[2], end[0], plate.held(end)])

    s = np.linspace(0, 1, 21)
    guess = np.stack([plate.below * (1 - s**2), 0 * s, 0 * s, 0 * s])
    found = solve_bvp(rates, ends, s, guess, p=[0.5], tol=COLLOCATED, max_nodes=5000)
    if not found.success:
        raise ArithmeticError(found.message)
    b = float(found.p[0])

    def bent(radii: Array) -> tuple[Array, Array]:
        y = found.sol((radii - b) / (plate.outer - b))
        return y[1], y[2]

    return _estimates(plate.asked(b, bent, found.y[3, 0], found.y[:, -1]), 1e4 * COLLOCATED)


HINGED_PLATE = RoundPlate(poisson=0.3, inner=0.2, below=0.004, load=LOAD, clamped=False)
CLAMPED_PLATE = RoundPlate(poisson=0.25, inner=0.3, below=0.002, load=5.0, clamped=True)


def _estimates(values: dict[str, float], error: float) -> dict[str, Estimate]:
    units = {"strain_energy": "J"} | dict.fromkeys(
        ("contact_force", "hinge_force", "rim_force", "contact_force_10", "contact_force_50", "hinge_force_10"), "N"
    )
    return {
        name: Estimate(float(v), error * abs(float(v)) if v else 1e-12, units.get(name, "m"))
        for name, v in values.items()
    }


def touch(load: float) -> tuple[float, float, float]:
    """Return values of a hinged strip that touches the floor with its middle only, from its quartic.

    These are half of the line force of the floor, the force of a hinge, N/m, and the deflection halfway between, m. The
    middle stays convex as long as load LENGTH^4 <= 384 B DEPTH.
    """
    w = np.polynomial.Polynomial(_quartic(False, LENGTH / 2, DEPTH, 0.0, load))
    assert w.deriv(2)(LENGTH / 2) <= 0
    return B * w.deriv(3)(LENGTH / 2), -B * w.deriv(3)(0.0), float(w(LENGTH / 4))


def touch_by_superposition(load: float) -> tuple[float, float, float]:
    """The same: a simply supported beam under the load, and under the force that lifts its middle back to the floor."""
    span, x = LENGTH, LENGTH / 4
    force = 48 * B / span**3 * (5 * load * span**4 / (384 * B) - DEPTH)
    assert load * span**2 / 8 >= force * span / 4  # the moment in the middle: it touches there alone
    sunk = load * x * (span**3 - 2 * span * x**2 + x**3) / (24 * B)
    lifted = force * x * (3 * span**2 - 4 * x**2) / (48 * B)
    return force / 2, (load * span - force) / 2, sunk - lifted


def _pressed(strip: Span, load: float) -> float:
    """Return the force of the floor, N/m: that at the line where contact begins, and the load beyond."""
    return strip.line_force + load * (LENGTH / 2 - strip.length)


def _pressed_by_balance(strip: Span, load: float) -> float:
    """Return the same: all of the load that the hinge does not carry."""
    return load * LENGTH / 2 - strip.reaction


def _stages(
    touched: Callable[[float], tuple[float, float, float]],
    of: Callable[..., Span],
    pressed: Callable[[Span, float], float],
    error: float,
) -> dict[str, Estimate]:
    """Known values of half a strip under a tenth of the load, half of it, and all of it."""
    force, hinge, quarter = touched(LOAD / 10)
    half, lies = (of(floor, False, LENGTH / 2, load) for load in (LOAD / 2, LOAD))
    values = {
        "contact_point_10": LENGTH / 2,
        "contact_force_10": WIDTH * force,
        "quarter_deflection_10": quarter,
        "hinge_force_10": WIDTH * hinge,
        "contact_force_50": WIDTH * pressed(half, LOAD / 2),
        "contact_point": lies.length,
        "contact_force": WIDTH * pressed(lies, LOAD),
        "penetration": 0.0,
        "hinge_force": WIDTH * lies.reaction,
        "largest_displacement": lies.deepest,
    }
    return _estimates(values, error)


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "contact_strip_hinged": lambda: _estimates(_on_floor(span, False), 10 * ROUNDING),
    "contact_strip_clamped": lambda: _estimates(_on_floor(span, True), 10 * ROUNDING),
    "contact_strip_mesh": lambda: _estimates(_on_floor(span, True), 10 * ROUNDING),
    "contact_strip_stages": lambda: _stages(touch, span, _pressed, 10 * ROUNDING),
    "contact_hill": lambda: _estimates(_on_hill(span), SMALL_SLOPES),
    "contact_plate": lambda: plate_on_floor(HINGED_PLATE),
    "contact_plate_clamped": lambda: plate_on_floor(CLAMPED_PLATE),
    "contact_ridge": lambda: _estimates(_on_hill(span, True, RIDGE_TOP, RIDGE_RADIUS, RIDGE), SMALL_SLOPES),
    **IN_MOTION,
    **bar_impact.JUDGES,
    **HEAVY,
}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "contact_strip_hinged": lambda: _estimates(_on_floor(span_by_collocation, False), 1e4 * COLLOCATED),
    "contact_strip_clamped": lambda: _estimates(_on_floor(span_by_collocation, True), 1e4 * COLLOCATED),
    "contact_strip_mesh": lambda: _estimates(_on_floor(span_by_collocation, True), 1e4 * COLLOCATED),
    "contact_strip_stages": lambda: _stages(
        touch_by_superposition, span_by_collocation, _pressed_by_balance, 1e4 * COLLOCATED
    ),
    "contact_hill": lambda: _estimates(_on_hill(span_by_collocation), SMALL_SLOPES),
    "contact_plate": lambda: plate_on_floor_by_collocation(HINGED_PLATE),
    "contact_plate_clamped": lambda: plate_on_floor_by_collocation(CLAMPED_PLATE),
    "contact_ridge": lambda: _estimates(
        _on_hill(span_by_collocation, True, RIDGE_TOP, RIDGE_RADIUS, RIDGE), SMALL_SLOPES
    ),
    **INTEGRATED,
    **bar_impact.SECOND_FORMS,
    **BY_ENERGY,
}
